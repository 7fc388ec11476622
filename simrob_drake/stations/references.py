"""Make the reference that a configuration, or a caller of simulate(), asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import (
    ReferenceSource,
    add_sine,
    add_trajectory,
    hermite,
    hold,
    move,
    ramp,
    sequence,
    table,
)
from simrob_drake.csv_files import read_columns
from simrob_drake.errors import InvalidConfig, InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import AxisValues
from simrob_drake.stations.reference_config import Hold, Move, Ramp, ReferenceConfig, Sequence, SineWave, Table
from simrob_drake.stations.robots import StationRobot

TIME_COLUMN = "time"

Samples = tuple[npt.ArrayLike, npt.ArrayLike]
"""Times (m,) [s] and positions (m, n) [rad]."""


def add_reference(
    builder: DiagramBuilder,
    wanted: ReferenceConfig | Trajectory | Samples,
    robot: StationRobot,
    *,
    start: Vector,
    derivatives: bool = False,
) -> ReferenceSource:
    """Add the source of a robot's reference.

    Args:
        builder: the diagram under construction.
        wanted: the reference section of a station, a trajectory of shape (n, 1) [rad], or samples. Samples are joined
            by straight lines, as Simulink joins them, but by a smooth curve where derivatives are needed.
        robot: whom it is for.
        start: where the reference of a station begins, shape (n,) [rad or m].
        derivatives: whether velocity and acceleration are needed, too.

    Raises:
        SimrobError: a reference that does not fit the robot.
    """
    name = f"{robot.prefix}reference_source"
    if isinstance(wanted, SineWave):
        return add_sine(
            builder,
            start,
            robot.model.user_units * robot.model.axis_vector(wanted.amplitude_deg, "reference.amplitude_deg"),
            frequency=wanted.frequency,
            phase=np.deg2rad(robot.model.axis_vector(wanted.phase_deg, "reference.phase_deg")),
            name=name,
        )
    if isinstance(wanted, tuple):
        trajectory = _through(wanted, robot, linear=not derivatives)
    else:
        trajectory = wanted if isinstance(wanted, Trajectory) else _trajectory(wanted, robot, start)
    if trajectory.rows() != len(robot.axes):
        expected = f"{len(robot.axes)} joints: {', '.join(robot.axes)}"
        raise InvalidParameter("reference", f"a trajectory of {trajectory.rows()} joints", expected)
    return add_trajectory(builder, trajectory, name=name, derivatives=derivatives)


def read_table(file: Path, axes: list[str]) -> Samples:
    """Read a CSV file with a column ``time`` [s] and one of each of these names [rad, or what they say].

    Raises:
        InvalidConfig: the file cannot be read, lacks a column, or holds something that is no number.
    """
    values, _ = read_columns(file, [TIME_COLUMN, *axes])
    if len(values) < 2:
        raise InvalidConfig(file, "", "holds fewer than two rows of values")
    return values[:, 0], values[:, 1:]


def speed_columns(axes: list[str]) -> list[str]:
    """Return what the columns of the axes' speeds are called in a CSV file."""
    return [f"v.{axis}" for axis in axes]


def _trajectory(config: ReferenceConfig, robot: StationRobot, start: Vector) -> Trajectory:
    match config:
        case Hold():
            return hold(start if config.target_deg is None else _si(config.target_deg, robot, start))
        case Ramp():
            target = _si(config.target_deg, robot, start)
            return ramp(start, target, duration=config.duration, start_time=config.start)
        case Move():
            target = _si(config.target_deg, robot, start)
            return move(start, target, duration=config.duration, start_time=config.start)
        case Sequence():
            targets = [start]
            for waypoint in config.targets:
                targets.append(_si(waypoint.target_deg, robot, targets[-1]))
            return sequence(start, [waypoint.time for waypoint in config.targets], targets[1:])
        case Table():
            if config.interpolation == "hermite":
                times, values = read_table(config.file, [*robot.axes, *speed_columns(robot.axes)])
                return hermite(times, *np.hsplit(np.asarray(values), 2))
            samples = read_table(config.file, robot.axes)
            return _through(samples, robot, linear=config.interpolation == "linear")
        case SineWave():
            raise TypeError("a sine is a block of its own, not a trajectory")


def _through(samples: Samples, robot: StationRobot, *, linear: bool) -> Trajectory:
    """Return the trajectory through samples."""
    positions = np.asarray(samples[1], dtype=float)
    if positions.ndim != 2 or positions.shape[1] != len(robot.axes):
        shape = " x ".join(str(size) for size in positions.shape)
        raise InvalidParameter("reference", f"an array of {shape}", f"of {len(robot.axes)} columns, one a joint [rad]")
    return table(samples[0], positions, linear=linear)


def _si(values: AxisValues, robot: StationRobot, otherwise: Vector) -> Vector:
    """Return a user's figures per axis in SI; axes that a mapping leaves out stay where they were."""
    units = robot.model.user_units
    return np.asarray(units * robot.model.axis_vector(values, "reference.target_deg", otherwise / units))
