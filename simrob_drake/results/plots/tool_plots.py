"""The plot of a robot's tool: its place and orientation in the world, as asked and as reached."""

import numpy as np

from simrob_drake.frames import Vector, matrices_from_xyz_quaternions, poses_from_matrices
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.grid import ERROR, ERROR_HEIGHT, REFERENCE, VALUE, Curve, Plot, Stack, dashed
from simrob_drake.results.record.run import RecordedRun

_PARTS = ("x", "y", "z", "Rz", "Ry", "Rx")
_PLACE, _ORIENTATION = slice(0, 3), slice(3, 6)


@np.errstate(over="ignore", invalid="ignore")  # of a run that diverged
def tcp_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Return x, y and z of the tool centre point and its angles Rz, Ry and Rx, each with its reference and error.

    The reference is where the axes' references put the tool, on the root link as it stands. The error of an angle is
    how far the tool must still turn about that axis of the world.
    """
    reached, desired = matrices_from_xyz_quaternions(result.pose("tcp", robot.name)), reference_tools(result, robot)
    poses, references = _steady(poses_from_matrices(reached)), _steady(poses_from_matrices(desired))
    turns = np.round((poses[0] - references[0]) / (2 * np.pi)) * 2 * np.pi
    turns[_PLACE] = 0.0
    shown, targets = _for_users(poses), _for_users(references + np.nan_to_num(turns))
    errors = np.hstack([1e3 * (desired - reached)[:, :3, 3], np.rad2deg(_turns(reached, desired))[:, ::-1]])
    stacks = []
    for place, part in enumerate(_PARTS):
        label, unit = ("position [m]", "mm") if place < _PLACE.stop else ("orientation [deg]", "deg")
        curves = [Curve(shown[:, place], "tool centre point", VALUE), dashed(targets[:, place], "reference", REFERENCE)]
        plots = [Plot(label, curves)]
        if result.config.mode == "dynamic":
            error = Curve(errors[:, place], "error (of angles: about the world's z, y, x)", ERROR)
            plots.append(Plot(f"error [{unit}]", [error], ERROR_HEIGHT))
        stacks.append(Stack(part, plots))
    return stacks


def reference_tools(result: RecordedRun, robot: StationRobot) -> Vector:
    """Return where the references of a robot's axes put its tool centre point, on its root as it stood, (m, 4, 4).

    In a program it is the tool that each run had.
    """
    if result.runs:
        parts = [reference_tools(run, run.plant.robots[robot.name]) for run in result.runs]
        return np.concatenate([*(part[:-1] for part in parts[:-1]), parts[-1]])
    plant, tool = robot.plant, robot.tools[robot.tcp]
    context = plant.CreateDefaultContext()
    positions = robot.axis_map.spread_positions(result.axes("q_ref", robot.name), result.positions_at(result.times))
    matrices = np.full((len(positions), 4, 4), np.nan)
    for row in np.flatnonzero(np.isfinite(positions).all(axis=1)):
        plant.SetPositions(context, positions[row])
        matrices[row] = tool.CalcPoseInWorld(context).GetAsMatrix4()
    return matrices


def _steady(poses: Vector) -> Vector:
    """Return pose vectors (m, 6) whose angles do not jump by whole turns."""
    poses[:, _ORIENTATION] = np.unwrap(poses[:, _ORIENTATION], axis=0)
    return poses


def _for_users(poses: Vector) -> Vector:
    return np.hstack([poses[:, _PLACE], np.rad2deg(poses[:, _ORIENTATION])])


def _turns(reached: Vector, desired: Vector) -> Vector:
    """Return the rotation vectors (m, 3) [rad] in the world's axes that lead from one set of matrices to another."""
    turn = desired[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)
    across = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2
    sine, cosine = np.linalg.norm(across, axis=1), (np.trace(turn, axis1=1, axis2=2) - 1) / 2
    return np.asarray(across * (np.arctan2(sine, cosine) / np.maximum(sine, np.finfo(float).tiny))[:, np.newaxis])
