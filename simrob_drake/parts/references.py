"""The kinds of reference that a station file can name: desired positions of a robot's axes over time.

Values *per axis* are one number for all axes, a list in their order, or a mapping by name. Positions are in the user's
units there: deg, or m for prismatic axes. Axes that a mapping does not name stay where they are. A robot has n axes;
trajectories are functions of time with values of shape (n, 1), as Drake's are. The *firmness* of an axis is the degree
to which a section gives its position, from not named at all to named alone; of coupled axes, the least firm ones give
way.
"""

from abc import ABC, abstractmethod
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.trajectories import Trajectory

from simrob_drake.base.arguments import SHORTEST
from simrob_drake.base.errors import InvalidConfig, InvalidParameter
from simrob_drake.base.files import read_columns
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Duration, Frequency, Instant, NotNegative, Strict
from simrob_drake.blocks.cruise import cruise_to
from simrob_drake.blocks.references import (
    Reference,
    Samples,
    SineReference,
    hermite,
    hold,
    interpolate_samples,
    move,
    ramp,
    sequence,
)
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues, PositiveAxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.coupled_axes import Firmness


class ReferenceSection(Strict, ABC):
    """A section ``reference``: desired positions of a robot's axes over time."""

    kind: str

    @abstractmethod
    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Reference:
        """Create the desired positions over time, shape (n, 1) [rad or m].

        Args:
            robot: the robot.
            start: positions at the start, shape (n,) [rad or m].

        Raises:
            SimrobError: a value does not fit the robot; names the key.
        """

    def caption(self, model: RobotModel) -> str:
        """Describe the reference of a robot in words, with its start time if it is not 0, for the block picture."""
        # Not all kinds have a start time: a sine or a table begins with the run.
        start = getattr(self, "start", 0.0)
        words = self._words(model)
        if not start:
            return words
        return message(
            "parts.reference_from", "{words}, from {start:g} s", words=words, start=start
        )

    @abstractmethod
    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""

    def targets_by_axis(self) -> list[AxisValues | None]:
        """Values per axis that determine the motion; an entry is None if it leaves all axes at their start."""
        return [getattr(self, "target_deg", None)]

    def postures(self) -> list[AxisValues]:
        """Postures through which the reference goes, per axis in the user's units."""
        # None is the initial posture, which the section does not give.
        return [values for values in self.targets_by_axis() if values is not None]

    def firmness(self, model: RobotModel) -> list[Firmness]:
        """Find how firmly the section gives the motion of each of the n axes of a robot, from PASSIVE to NAMED."""
        # An axis is as firm as in the posture that gives it most firmly.
        of_postures = [model.firmness(values) for values in self.targets_by_axis()]
        return [max(of_axis) for of_axis in zip(*of_postures, strict=True)]

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Values per axis by their keys, which are checked against a robot's axes: all keys that end in ``_deg``."""
        # The iterator of a section yields pairs of a key and its value.
        return {key: value for key, value in self if key.endswith("_deg")}


def si_positions(
    values: AxisValues, robot: ResolvedRobot, otherwise: Vector, key: str = "reference.target_deg"
) -> Vector:
    """Convert values per axis from the user's units to rad or m, shape (n,).

    Speeds, accelerations and jerks are converted by the same factors: deg/s to rad/s, and so on.

    Args:
        values: the values.
        robot: the robot.
        otherwise: values of the axes that a mapping leaves out, shape (n,), in the units of the result.
        key: key of the station that has the values, for errors.

    Raises:
        SimrobError: a list has a wrong length, or a mapping names an axis that the robot does not have.
    """
    # The mapping is completed in the user's units, and all axes are converted together.
    units = robot.model.user_units
    return np.asarray(units * robot.model.axis_vector(values, key, otherwise / units))


class ToOnePosture(ReferenceSection):
    """A motion to one posture within a given time."""

    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    duration: Duration = 1.0
    """Duration of the motion [s]."""
    start: Instant = 0.0
    """Time at which the motion begins [s]."""

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        return message(
            "parts.reference_to_posture",
            "{kind} to {posture} in {duration:g} s",
            kind=self.kind,
            posture=shown_positions(self.target_deg, model),
            duration=self.duration,
        )


class Hold(ReferenceSection):
    """Stay at one posture."""

    kind: Literal["hold"]
    target_deg: AxisValues | None = None
    """Posture, per axis; by default the initial one."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m]."""
        # Axes that the posture does not name hold their initial position.
        return hold(
            start if self.target_deg is None else si_positions(self.target_deg, robot, start)
        )

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        if self.target_deg is None:
            return message("parts.reference_holds_start", "hold the initial posture")
        posture = shown_positions(self.target_deg, model)
        return message("parts.reference_holds", "hold {posture}", posture=posture)


class SmoothMove(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return move(start, target, duration=self.duration, start_time=self.start)


class Ramp(ToOnePosture):
    """Go to a posture at constant speed, like SimRob's interpolated moves, and stay there."""

    kind: Literal["ramp"]
    blend: NotNegative = 0.0
    """Time in which the speed rises at the start, and falls at the end [s]. By default it jumps."""

    @model_validator(mode="after")
    def _check_blend(self) -> "Ramp":
        """Check that the speed can rise and fall within the duration.

        Raises:
            ValueError: the blend takes half of the duration or more.
        """
        # The rise and the fall must not overlap, so each takes less than half of the duration.
        if self.blend and not self.blend < self.duration / 2:
            raise ValueError(
                message(
                    "parts.blend_too_long",
                    "blend is {blend:g} s; it must be less than half the duration, {duration:g} s",
                    blend=self.blend,
                    duration=self.duration,
                )
            )
        return self

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return ramp(start, target, duration=self.duration, start_time=self.start, blend=self.blend)


_ROUNDING = 1e-9
"""Relative tolerance of limits: values that were converted from a robot's own limits pass."""


class Cruise(ReferenceSection):
    """A straight motion to one posture: all axes arrive at the same time, and none exceeds its limits."""

    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    speed_deg: PositiveAxisValues | None = None
    """Largest speed, per axis [deg/s, or m/s]. By default the limit of the URDF, which it must not exceed."""
    acceleration_deg: PositiveAxisValues | None = None
    """Largest acceleration, per axis [deg/s², or m/s²]. By default the limit of the robot's files, which it must not
    exceed."""
    start: Instant = 0.0
    """Time at which the motion begins [s]."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m].

        Raises:
            InvalidParameter: an axis that moves has no limit, or a value exceeds the robot's limit.
        """
        target = si_positions(self.target_deg, robot, start)
        # An axis that does not move needs no limits, and its URDF may have none.
        is_moving = target != start
        speeds = _checked_limits("speed_deg", self.speed_deg, robot, robot.speed_limits, is_moving)
        # URDF itself has no limits of accelerations: they are from Drake's extension of it, or the robot's own file.
        own_accelerations = robot.model.accelerations
        accelerations = _checked_limits(
            "acceleration_deg", self.acceleration_deg, robot, own_accelerations, is_moving
        )
        return cruise_to(
            start, target, speeds, accelerations, self._jerks(robot), start_time=self.start
        )

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        """Largest jerk of each axis, shape (n,) [rad/s³ or m/s³]; infinite here, so that the acceleration jumps.

        A kind may also return None: then the acceleration rises for a third of the phase of acceleration.
        """
        return np.full(len(robot.axes), np.inf)

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        return message(
            "parts.reference_cruises",
            "{kind} to {posture}",
            # A kind such as `s_curve` is written with a hyphen in words.
            kind=self.kind.replace("_", "-"),
            posture=shown_positions(self.target_deg, model),
        )


class Trapezoid(Cruise):
    """Go to a posture with constant acceleration, constant speed, and constant deceleration."""

    kind: Literal["trapezoid"]


class SCurve(Cruise):
    """Go to a posture like a trapezoid, but with an acceleration that does not jump."""

    kind: Literal["s_curve"]
    jerk_deg: PositiveAxisValues | None = None
    """Largest jerk, per axis [deg/s³, or m/s³]. By default the acceleration rises for a third of the ramp."""

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        """Largest jerk of each axis, shape (n,) [rad/s³ or m/s³].

        None if the section does not limit it: then the acceleration rises for a third of the phase of acceleration.
        """
        if self.jerk_deg is None:
            return None
        # Axes that a mapping does not name have no limit. An infinite jerk is a jump of the acceleration.
        unlimited = np.full(len(robot.axes), np.inf)
        return si_positions(self.jerk_deg, robot, unlimited, "reference.jerk_deg")


def _checked_limits(
    key: str, values: AxisValues | None, robot: ResolvedRobot, limits: Vector, is_moving: Vector
) -> Vector:
    """Choose the largest speeds or accelerations of a motion, and check them against the robot's own limits.

    Args:
        key: key of the reference: ``speed_deg`` or ``acceleration_deg``.
        values: values of this key; None if the section does not give it.
        robot: the robot.
        limits: the robot's own limits, shape (n,) [rad/s or m/s; rad/s² or m/s²]; infinite if it has none.
        is_moving: whether each axis moves, shape (n,).

    Returns:
        The values of the key, and the robot's own limits for axes without one, shape (n,) [units of ``limits``].

    Raises:
        InvalidParameter: a value exceeds the robot's limit, or an axis that moves has no limit.
    """
    chosen = limits if values is None else si_positions(values, robot, limits, f"reference.{key}")
    # Errors show values in the user's units, as the station file gives them.
    per_time = "s²" if key == "acceleration_deg" else "s"
    for axis, (value, limit) in enumerate(zip(chosen, limits, strict=True)):
        unit = robot.model.user_units[axis]
        unit_name = f"{robot.model.unit_names[axis]}/{per_time}"
        where = message(
            "parts.reference_of_axis",
            "reference.{key} of {prefix}{axis}",
            key=key,
            prefix=robot.prefix,
            axis=robot.axes[axis],
        )
        # The tolerance is relative, since the limits of axes differ by orders of magnitude.
        if value > limit * (1 + _ROUNDING):
            raise InvalidParameter(
                where,
                compound("{value:.5g} {per_time}", value=value / unit, per_time=unit_name),
                message(
                    "parts.limit_of_robot",
                    "at most {limit:.5g}, the robot's own limit",
                    limit=limit / unit,
                ),
            )
        if is_moving[axis] and not np.isfinite(value):
            raise InvalidParameter(
                where,
                None,
                message(
                    "parts.rate_needed",
                    "given [{per_time}], since the robot's files have no such limit",
                    per_time=unit_name,
                ),
            )
    return chosen


class Waypoint(Strict):
    """A posture of a sequence, and its time."""

    time: Duration
    """Time at which the posture is reached [s]."""
    target_deg: AxisValues
    """Posture, per axis. Axes that a mapping leaves out stay where they were."""


class Sequence(ReferenceSection):
    """Go through postures, with rest at each of them and continuous acceleration."""

    kind: Literal["sequence"]
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures and their times, in the order of time."""

    @model_validator(mode="after")
    def _check_times(self) -> "Sequence":
        """Check that the times rise by `SHORTEST` or more: a motion within no time would be infinitely fast.

        Raises:
            ValueError: a time follows the one before by less than `SHORTEST`.
        """
        times = [target.time for target in self.targets]
        if any(later - earlier < SHORTEST for earlier, later in pairwise(times)):
            raise ValueError(
                message(
                    "parts.sequence_must_rise",
                    "the times of a sequence must increase by {shortest:g} s or more from target to target",
                    shortest=SHORTEST,
                )
            )
        return self

    def targets_by_axis(self) -> list[AxisValues | None]:
        """Values per axis of each posture."""
        return [target.target_deg for target in self.targets]

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Values per axis of the postures, by a text that names their time, which errors show in place of a key."""
        return {f"targets at {target.time:g} s": target.target_deg for target in self.targets}

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m]."""
        # Axes that a posture does not name stay where the posture before has them.
        postures = [start]
        for waypoint in self.targets:
            postures.append(si_positions(waypoint.target_deg, robot, postures[-1]))
        return sequence(start, [waypoint.time for waypoint in self.targets], postures[1:])

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        return message(
            "parts.reference_sequence",
            "sequence of {count} {count:posture|postures} in {duration:g} s",
            count=len(self.targets),
            duration=self.targets[-1].time,
        )


class SineWave(ReferenceSection):
    """Swing about the initial posture."""

    kind: Literal["sine"]
    amplitude_deg: AxisValues = 10.0
    """Amplitude, per axis."""
    frequency: Frequency = 0.5
    """Frequency [Hz]."""
    phase_deg: AxisValues = 0.0
    """Phase at the start, per axis; 0 starts in the middle."""

    def targets_by_axis(self) -> list[AxisValues | None]:
        """The amplitudes per axis, which determine the axes that move."""
        return [self.amplitude_deg]

    def postures(self) -> list[AxisValues]:
        """Postures through which the reference goes: an empty list, as the amplitudes are no positions."""
        return []

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> SineReference:
        """Create the sine about the positions at the start [rad or m].

        Args:
            robot: the robot.
            start: positions at the start, shape (n,) [rad or m].
        """
        model = robot.model
        # q(t) = centre + amplitude sin(2 pi f t + phase). A phase is an angle of the wave, not of the axis, so it is in
        # degrees for axes that slide, too.
        return SineReference(
            centre=start,
            amplitude=model.user_units
            * model.axis_vector(self.amplitude_deg, "reference.amplitude_deg"),
            frequency=self.frequency,
            phase=np.deg2rad(model.axis_vector(self.phase_deg, "reference.phase_deg")),
        )

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        return message(
            "parts.reference_sine",
            "sine ±{amplitude}, {frequency:g} Hz",
            amplitude=shown_positions(self.amplitude_deg, model),
            frequency=self.frequency,
        )


TIME_COLUMN = "time"
"""Name of the column with the times in a CSV file."""

MOST_VALUES = 500_000
"""Largest count of values in a table: more take a gigabyte of memory in a run."""

Interpolation = Literal["cubic", "linear", "hermite"]


class Table(ReferenceSection):
    """Follow a CSV file with a column `time` [s] and a column for each axis [rad or m] with the axis's name."""

    kind: Literal["table"]
    file: Path
    """The CSV file; relative paths start at the station's file."""
    interpolation: Interpolation = "cubic"
    """Cubic: a spline with continuous acceleration. Linear: straight lines. Hermite: cubics with the speeds [rad/s or
    m/s] of the columns `v.<axis>`, one for each axis."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Create the trajectory, shape (n, 1) [rad or m].

        Up to the time of the first row of the table, it is at the posture of this row. The positions at the start have
        no effect.

        Raises:
            InvalidConfig: the file cannot be read, or its content is wrong.
        """
        times, values = self.rows(robot.axes)
        if self.interpolation == "hermite":
            # `rows` reads the columns of the positions, and then those of the speeds.
            positions, speeds = np.hsplit(np.asarray(values), 2)
            return hermite(times, positions, speeds)
        return interpolate_samples(times, values, linear=self.interpolation == "linear")

    def firmness(self, model: RobotModel) -> list[Firmness]:
        """Firmness of each axis: NAMED for all, since each has a column in the file."""
        return [Firmness.NAMED] * len(model.axes)

    def rows(self, axes: list[str]) -> Samples:
        """Read the file and check its times.

        Args:
            axes: names of the robot's n axes.

        Returns:
            The times, shape (m,) [s], and the positions, shape (m, n) [rad or m]. For the interpolation "hermite" the
            speeds [rad/s or m/s] follow in the same array, shape (m, 2 n).

        Raises:
            InvalidConfig: the file cannot be read, lacks a column, contains a value that is no number, has times that
                do not rise, or has fewer than two rows or too many.
        """
        # Columns with speeds are only read if they are used.
        names = [*axes, *speed_columns(axes)] if self.interpolation == "hermite" else axes
        # The numbers of the lines in the file are for errors.
        values, lines = read_columns(self.file, [TIME_COLUMN, *names])
        # One row is a posture, which has no motion.
        if len(values) < 2:
            raise InvalidConfig(
                self.file,
                "",
                message(
                    "parts.fewer_than_two_rows",
                    "has fewer than two rows of values; a motion needs at least two",
                ),
            )
        if values.size > MOST_VALUES:
            # The bound is on values, since tables of robots with many axes have wider rows.
            most = MOST_VALUES // values.shape[1]
            raise InvalidConfig(
                self.file,
                "",
                message(
                    "parts.too_many_rows",
                    "has {count} rows; reduce it to at most {most}",
                    count=len(values),
                    most=most,
                ),
            )
        times = values[:, 0]
        # A spline divides by the differences of the times. Entry i is that between the rows i and i + 1.
        too_close = np.flatnonzero(np.diff(times) < SHORTEST)
        if too_close.size:
            row = too_close[0]
            before = times[row]
            after = times[row + 1]
            text = message(
                "parts.times_must_rise",
                "time {after:g} s follows {before:g} s; times must increase by {shortest:g} s or more from row to row",
                after=after,
                before=before,
                shortest=SHORTEST,
            )
            raise InvalidConfig(
                self.file, message("base.line", "line {line}", line=lines[row + 1]), text
            )
        return times, values[:, 1:]

    def _words(self, model: RobotModel) -> str:
        """Describe the reference in words, without its start time."""
        return message("parts.reference_table", "table {file}", file=self.file.name)


def speed_columns(axes: list[str]) -> list[str]:
    """Names of the columns with the axes' speeds in a CSV file."""
    return [f"v.{axis}" for axis in axes]


KINDS = Kinds(
    __name__,
    {
        "hold": "Hold",
        "ramp": "Ramp",
        "move": "SmoothMove",
        "trapezoid": "Trapezoid",
        "s_curve": "SCurve",
        "sequence": "Sequence",
        "sine": "SineWave",
        "table": "Table",
    },
    base=ReferenceSection,
    point="references",
)
ReferenceConfig = Annotated[ReferenceSection, KINDS]
