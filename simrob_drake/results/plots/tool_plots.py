"""The plot of a robot's tool: its place and orientation in the world, as asked and as reached."""

import numpy as np

from simrob_drake.frames import Vector, matrices_from_xyz_quaternions, poses_from_matrices
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.grid import ERROR, ERROR_HEIGHT, REFERENCE, VALUE, Curve, Plot, Stack, dashed
from simrob_drake.results.record.run import RecordedRun

_PARTS = ("x", "y", "z", "Rz", "Ry", "Rx")
_PLACE, _ORIENTATION = slice(0, 3), slice(3, 6)
_ERROR_UNITS = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # mm and deg
_LOCKED = 80.0  # deg of Ry, from where on small turns are large angles Rz and Rx
_LOCK = "large where Ry is near ±90"


@np.errstate(over="ignore", invalid="ignore")  # of a run that diverged
def tcp_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Return x, y and z of the tool centre point and its angles Rz, Ry and Rx, each with its reference and error.

    The reference is where the axes' references put the tool, on the root link as it stands. Each error is the
    reference minus what was reached, of the same number.
    """
    reached, desired = matrices_from_xyz_quaternions(result.pose("tcp", robot.name)), reference_tools(result, robot)
    poses, references = poses_from_matrices(reached), poses_from_matrices(desired)
    poses[:, _ORIENTATION] = np.unwrap(poses[:, _ORIENTATION], axis=0)
    references[:, _ORIENTATION] = _nearest(references[:, _ORIENTATION], poses[:, _ORIENTATION])
    shown, targets = _for_users(poses), _for_users(references)
    locked = _LOCK if (np.abs(shown[:, _PARTS.index("Ry")]) > _LOCKED).any() else ""
    errors = (targets - shown) * _ERROR_UNITS
    stacks = []
    for place, part in enumerate(_PARTS):
        label, unit = ("position [m]", "mm") if place < _PLACE.stop else ("orientation [deg]", "deg")
        curves = [Curve(shown[:, place], "tool centre point", VALUE), dashed(targets[:, place], "reference", REFERENCE)]
        plots = [Plot(label, curves, note=locked if part in ("Rz", "Rx") else "")]
        if result.config.mode == "dynamic":
            error = Curve(errors[:, place], "error: reference - tool centre point", ERROR)
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


def _nearest(angles: Vector, reached: Vector) -> Vector:
    """Return the angles Rz, Ry and Rx (m, 3) [rad] of the same orientations that lie nearest to those reached."""
    same = np.stack([angles, angles * (1.0, -1.0, 1.0) + np.pi])
    same += 2 * np.pi * np.round((reached - same) / (2 * np.pi))
    first, second = np.abs(same - reached).sum(axis=2)
    return np.asarray(np.where((second < first)[:, np.newaxis], same[1], same[0]))


def _for_users(poses: Vector) -> Vector:
    return np.hstack([poses[:, _PLACE], np.rad2deg(poses[:, _ORIENTATION])])
