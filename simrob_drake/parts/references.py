"""What a robot is asked to do over time: the kinds of reference that a station file can name."""

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
    """A section ``reference``: what a robot is asked to do over time."""

    kind: str

    @abstractmethod
    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Reference:
        """Return it over time, shape (n, 1) [rad or m], from a start (n,).

        Raises SimrobError: what does not fit the robot; names the key.
        """

    def caption(self, model: RobotModel) -> str:
        """Describe the reference of a robot in words, for the block picture."""
        start = getattr(self, "start", 0.0)
        words = self._words(model)
        if not start:
            return words
        return message("parts.reference_from", "{words}, from {start:g} s", words=words, start=start)

    @abstractmethod
    def _words(self, model: RobotModel) -> str: ...

    def targets_by_axis(self) -> list[AxisValues | None]:
        """Values per axis that say where axes go; None where the section leaves all of them at their start."""
        return [getattr(self, "target_deg", None)]

    def postures(self) -> list[AxisValues]:
        """Positions per axis at which the section wants the robot, in the user's units."""
        return [values for values in self.targets_by_axis() if values is not None]

    def firmness(self, model: RobotModel) -> list[Firmness]:
        """Find how firmly the section gives the motion of each of the n axes of a robot: see :class:`Firmness`."""
        each = [model.firmness(values) for values in self.targets_by_axis()]
        return [max(of_axis) for of_axis in zip(*each, strict=True)]

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Return the figures per axis, by their keys, to be checked against a robot's axes: all that are in degrees."""
        return {key: value for key, value in self if key.endswith("_deg")}


def si_positions(
    values: AxisValues, robot: ResolvedRobot, otherwise: Vector, key: str = "reference.target_deg"
) -> Vector:
    """Return a user's figures per axis in SI, shape (n,); axes that a mapping leaves out stay where they were."""
    units = robot.model.user_units
    return np.asarray(units * robot.model.axis_vector(values, key, otherwise / units))


class ToOnePosture(ReferenceSection):
    """What moves to one posture share."""

    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    duration: Duration = 1.0
    """Time that the move takes [s]."""
    start: Instant = 0.0
    """When it begins [s]."""

    def _words(self, model: RobotModel) -> str:
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
    """Posture, per axis; the initial one unless given."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        return hold(start if self.target_deg is None else si_positions(self.target_deg, robot, start))

    def _words(self, model: RobotModel) -> str:
        if self.target_deg is None:
            return message("parts.reference_holds_start", "hold the start")
        posture = shown_positions(self.target_deg, model)
        return message("parts.reference_holds", "hold {posture}", posture=posture)


class SmoothMove(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return move(start, target, duration=self.duration, start_time=self.start)


class Ramp(ToOnePosture):
    """Go to a posture at constant speed, as SimRob's interpolated moves do, and stay there."""

    kind: Literal["ramp"]
    blend: NotNegative = 0.0
    """How long the speed grows at the start, and falls at the end [s]; at once unless given."""

    @model_validator(mode="after")
    def _blends_apart(self) -> "Ramp":
        if self.blend and not self.blend < self.duration / 2:
            raise ValueError(
                message(
                    "parts.blend_too_long",
                    "blend, {blend:g} s, must be less than half of the duration, {duration:g} s",
                    blend=self.blend,
                    duration=self.duration,
                )
            )
        return self

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return ramp(start, target, duration=self.duration, start_time=self.start, blend=self.blend)


_ROUNDING = 1e-9


class Cruise(ReferenceSection):
    """What cruises to one posture: straight, all axes at the same time, and none beyond its limits."""

    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    speed_deg: PositiveAxisValues | None = None
    """Largest speed, per axis [deg/s, or m/s]; that of the URDF unless given, and not beyond."""
    acceleration_deg: PositiveAxisValues | None = None
    """Largest acceleration, per axis [deg/s², or m/s²]; that of the robot's files unless given, and not beyond."""
    start: Instant = 0.0
    """When it begins [s]."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory (n, 1) [rad or m]; raises InvalidParameter: no limit, or one beyond the robot's."""
        target = si_positions(self.target_deg, robot, start)
        speeds = _within("speed_deg", self.speed_deg, robot, robot.speed_limits, target != start)
        limits = robot.model.accelerations
        accelerations = _within("acceleration_deg", self.acceleration_deg, robot, limits, target != start)
        return cruise_to(start, target, speeds, accelerations, self._jerks(robot), start_time=self.start)

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        return np.full(len(robot.axes), np.inf)

    def _words(self, model: RobotModel) -> str:
        return message(
            "parts.reference_cruises",
            "{kind} to {posture}",
            kind=self.kind.replace("_", "-"),
            posture=shown_positions(self.target_deg, model),
        )


class Trapezoid(Cruise):
    """Go to a posture: speed up evenly, cruise, slow down."""

    kind: Literal["trapezoid"]


class SCurve(Cruise):
    """Go to a posture as a trapezoid does, with an acceleration that does not jump."""

    kind: Literal["s_curve"]
    jerk_deg: PositiveAxisValues | None = None
    """Largest jerk, per axis [deg/s³, or m/s³]; unless given, the acceleration rises for a third of the ramp."""

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        endless = np.full(len(robot.axes), np.inf)
        return None if self.jerk_deg is None else si_positions(self.jerk_deg, robot, endless, "reference.jerk_deg")


def _within(key: str, values: AxisValues | None, robot: ResolvedRobot, limits: Vector, moves: Vector) -> Vector:
    """Return limits (n,) of the axes as the user wants them, of those that move finite and not beyond their own."""
    chosen = limits if values is None else si_positions(values, robot, limits, f"reference.{key}")
    for axis, (own, limit) in enumerate(zip(chosen, limits, strict=True)):
        unit, per_time = robot.model.user_units[axis], f"{robot.model.unit_names[axis]}/{'s²' if 'acc' in key else 's'}"
        where = message(
            "parts.reference_of_axis",
            "reference.{key} of {prefix}{axis}",
            key=key,
            prefix=robot.prefix,
            axis=robot.axes[axis],
        )
        if own > limit * (1 + _ROUNDING):
            most = message("parts.limit_of_robot", "at most {limit:.5g}, the robot's own limit", limit=limit / unit)
            raise InvalidParameter(where, compound("{value:.5g} {per_time}", value=own / unit, per_time=per_time), most)
        if moves[axis] and not np.isfinite(own):
            raise InvalidParameter(
                where,
                None,
                message("parts.rate_needed", "given [{per_time}]: the robot's files tell none", per_time=per_time),
            )
    return chosen


class Waypoint(Strict):
    """A posture and the time to be there."""

    time: Duration
    """When to be there [s]."""
    target_deg: AxisValues
    """Posture, per axis; a mapping leaves the other axes where they were."""


class Sequence(ReferenceSection):
    """Go through postures, resting at each, with continuous acceleration."""

    kind: Literal["sequence"]
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures and their times, which rise."""

    @model_validator(mode="after")
    def _sorted(self) -> "Sequence":
        times = [target.time for target in self.targets]
        if any(later - earlier < SHORTEST for earlier, later in pairwise(times)):
            raise ValueError(
                message(
                    "parts.sequence_must_rise",
                    "the times of a sequence rise from target to target, by {shortest:g} s or more",
                    shortest=SHORTEST,
                )
            )
        return self

    def targets_by_axis(self) -> list[AxisValues | None]:
        """Values per axis of each posture."""
        return [target.target_deg for target in self.targets]

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Return the targets."""
        return {f"targets at {target.time:g} s": target.target_deg for target in self.targets}

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        postures = [start]
        for waypoint in self.targets:
            postures.append(si_positions(waypoint.target_deg, robot, postures[-1]))
        return sequence(start, [waypoint.time for waypoint in self.targets], postures[1:])

    def _words(self, model: RobotModel) -> str:
        return message(
            "parts.reference_sequence",
            "sequence of {count} postures in {duration:g} s",
            count=len(self.targets),
            duration=self.targets[-1].time,
        )


class SineWave(ReferenceSection):
    """Swing about the initial posture."""

    kind: Literal["sine"]
    amplitude_deg: AxisValues = 10.0
    """Largest distance from the middle, per axis."""
    frequency: Frequency = 0.5
    """Swings a second [Hz]."""
    phase_deg: AxisValues = 0.0
    """Angle at the start, per axis; 0 starts in the middle."""

    def targets_by_axis(self) -> list[AxisValues | None]:
        """The amplitudes per axis: they say which axes move."""
        return [self.amplitude_deg]

    def postures(self) -> list[AxisValues]:
        """None: the amplitudes are no positions."""
        return []

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> SineReference:
        """Return the swing about ``start`` (n,) [rad or m]."""
        model = robot.model
        return SineReference(
            centre=start,
            amplitude=model.user_units * model.axis_vector(self.amplitude_deg, "reference.amplitude_deg"),
            frequency=self.frequency,
            phase=np.deg2rad(model.axis_vector(self.phase_deg, "reference.phase_deg")),
        )

    def _words(self, model: RobotModel) -> str:
        return message(
            "parts.reference_sine",
            "sine ±{amplitude}, {frequency:g} Hz",
            amplitude=shown_positions(self.amplitude_deg, model),
            frequency=self.frequency,
        )


TIME_COLUMN = "time"
MOST_VALUES = 500_000  # more take a gigabyte of memory in a run

Interpolation = Literal["cubic", "linear", "hermite"]


class Table(ReferenceSection):
    """Follow a CSV file: a column `time` [s] and one for each axis [rad], named as the axis."""

    kind: Literal["table"]
    file: Path
    """The CSV file; relative paths start at the station's file."""
    interpolation: Interpolation = "cubic"
    """Cubic: a spline with continuous acceleration. Linear: straight lines. Hermite: cubics with the speeds [rad/s]
    that stand in a column `v.<axis>` for each axis."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]; the table says where it begins."""
        times, values = self.rows(robot.axes)
        if self.interpolation == "hermite":
            return hermite(times, *np.hsplit(np.asarray(values), 2))
        return interpolate_samples(times, values, linear=self.interpolation == "linear")

    def firmness(self, model: RobotModel) -> list[Firmness]:
        """Return NAMED for all axes: each has a column in the file."""
        return [Firmness.NAMED] * len(model.axes)

    def rows(self, axes: list[str]) -> Samples:
        """Return the times (m,) [s] and the values (m, n), or (m, 2n) with speeds, of the file.

        Raises InvalidConfig: the file cannot be read, lacks a column, holds something that is no number, times that do
        not rise, or far too many rows.
        """
        names = [*axes, *speed_columns(axes)] if self.interpolation == "hermite" else axes
        values, lines = read_columns(self.file, [TIME_COLUMN, *names])
        if len(values) < 2:
            raise InvalidConfig(
                self.file, "", message("parts.fewer_than_two_rows", "holds fewer than two rows of values")
            )
        if values.size > MOST_VALUES:
            most = MOST_VALUES // values.shape[1]
            raise InvalidConfig(
                self.file,
                "",
                message(
                    "parts.too_many_rows",
                    "holds {count} rows; thin it out to at most {most}",
                    count=len(values),
                    most=most,
                ),
            )
        times = values[:, 0]
        close = np.flatnonzero(np.diff(times) < SHORTEST)
        if close.size:
            before, after = times[close[0] : close[0] + 2]
            text = message(
                "parts.times_must_rise",
                "time {after:g} s after {before:g} s; times must rise by {shortest:g} s or more from row to row",
                after=after,
                before=before,
                shortest=SHORTEST,
            )
            raise InvalidConfig(self.file, message("base.line", "line {line}", line=lines[close[0] + 1]), text)
        return times, values[:, 1:]

    def _words(self, model: RobotModel) -> str:
        return message("parts.reference_table", "table {file}", file=self.file.name)


def speed_columns(axes: list[str]) -> list[str]:
    """Return what the columns of the axes' speeds are called in a CSV file."""
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
