"""Let a robot walk from where it stands: its gait, the way into the gait's first posture, and what it walks on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import Gaits, load_gaits
from simrob_drake.programs.gaits.quadruped import crawl, trot
from simrob_drake.programs.gaits.walk import walk
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.stations.config import FloorConfig, Input, ServoConfig, StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver

_READY_TIME = 2.0
"""Time to take the posture in which a gait begins [s]."""
_SETTLE_TIME = 0.5
"""Time to stand in it [s]."""
_SAMPLE = 0.01  # s between the samples of the way into it
_BESIDE = 1.0  # floor beyond the way [m]
_MAX_STEP = 0.01  # of the solver [s]: a walk's references are held over a step
_SCALED = ("step_length", "stride", "sideways", "turn_deg")  # what an amplitude scales
_PLANNERS: dict[str, Callable[..., JointMotion]] = {"walks": walk, "trots": trot, "crawls": crawl}


def walking(
    robot: LeggedGeometry, steps: int, amplitude: float, name: str | None, changes: Mapping[str, Any]
) -> tuple[StationConfig, Trajectory, float]:
    """Return the station as a robot walks in it, the reference from where it stands, and the duration [s].

    Args:
        robot: who walks.
        steps: how many.
        amplitude: scales lengths and turns of the steps.
        name: of the gait; the first for the robot's feet if None.
        changes: other figures of the gait.

    Raises:
        SimrobError: as :meth:`simrob_drake.LeggedRobot.walk`.
    """
    _check(robot, steps, amplitude)
    gaits = load_gaits(robot.model.name)
    kind, gait = _gait(robot, gaits, name)
    figures = getattr(gaits, kind)[gait]
    scaled = {key: amplitude * value for key in _SCALED if (value := getattr(figures, key, 0.0))}
    motion = _PLANNERS[kind](robot.model.name, int(steps), gait, **{**scaled, **changes})
    times, positions, velocities = _from_here(robot.reference, motion)
    trajectory = PiecewisePolynomial.CubicHermite(times, positions.T, velocities.T)
    return _ground(robot, motion, figures.servo), trajectory, float(times[-1])


def _check(robot: LeggedGeometry, steps: int, amplitude: float) -> None:
    model, config = robot.model, robot.cell.config
    if model.feet is None or model.base == "fixed":
        raise InvalidParameter("robot", model.name, "one with feet, to walk")
    if config.mode == "kinematic" or config.floor is None or config.contact is None:
        raise InvalidParameter("station", config.name, "a dynamic one with a floor and contact, to walk on")
    if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or steps < 1:
        raise InvalidParameter("steps", steps, "a whole number of at least 1")
    if not np.isfinite(amplitude):
        raise InvalidParameter("amplitude", amplitude, "a finite number; 1 walks as the gait's figures say")


def _gait(robot: LeggedGeometry, gaits: Gaits, name: str | None) -> tuple[str, str]:
    """Return the kind and the name of a gait that suits the robot's feet."""
    feet = robot.model.feet
    assert feet is not None  # checked
    worn = robot.cell.config.robots[robot.name].feet or feet.default
    known = {gait: kind for kind in _PLANNERS for gait in getattr(gaits, kind)}
    if name is not None and name not in known:
        raise UnknownName(f"gait of {robot.model.name}", name, known)
    for gait, kind in known.items():
        made_for = getattr(getattr(gaits, kind)[gait], "feet", None) or feet.default
        if name in (None, gait) and made_for == worn:
            return kind, gait
    wanted = f"one for the feet {worn}" if name is None else f"one for feet that are not {worn}"
    raise InvalidParameter(f"gait of {robot.model.name}", name or "none", wanted)


def _from_here(start: Vector, motion: JointMotion) -> tuple[Vector, Vector, Vector]:
    """Return times, angles and their rates: into the first posture of a motion, a rest, and the motion."""
    ready = sequence(start, [_READY_TIME], [motion.positions[0]])
    times = np.arange(0.0, _READY_TIME, _SAMPLE)
    begun = _READY_TIME + _SETTLE_TIME
    return (
        np.concatenate([times, [_READY_TIME], begun + motion.times]),
        np.vstack([ready.vector_values(times).T, motion.positions[0], motion.positions]),
        np.vstack([ready.derivative().vector_values(times).T, np.zeros_like(start), motion.velocities]),
    )


def _ground(robot: LeggedGeometry, motion: JointMotion, servo: Mapping[str, Any]) -> StationConfig:
    """Return the station with a floor that is large enough, the gait's servos and steps that follow it."""
    config = robot.cell.config
    assert config.floor is not None  # checked
    way = np.linalg.norm(motion.root[1][:, :2] - motion.root[1][0, :2], axis=1).max()
    here = np.abs(robot.base_pose.translation()[:2]).max()
    size = max(config.floor.size, float(np.ceil(2.0 * (here + way + _BESIDE))))
    own = config.servo_of(robot.name).model_dump(exclude_unset=True)
    entry = robot.cell.config.robots[robot.name]
    robots = {**config.robots, robot.name: entry.model_copy(update={"servo": ServoConfig(**{**own, **servo})})}
    inputs: tuple[Input, ...] = tuple(dict.fromkeys((*config.inputs, "reference_velocity")))
    solver = config.solver
    if isinstance(solver, ContinuousSolver) and solver.scheme == "cenic":
        solver = solver.model_copy(update={"max_step": min(solver.max_step, _MAX_STEP)})
    floor = FloorConfig(size=size)
    return config.model_copy(update={"floor": floor, "robots": robots, "inputs": inputs, "solver": solver})
