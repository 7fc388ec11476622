"""Commands of a walk, limited to what the legs can follow.

A command is a desired speed, ahead (real part) and to the left (imaginary part) of the robot, with a turning speed. It
comes from a user who steers, from another block, from a table of times or from a path. Points and directions of a path
are complex numbers in the world: x + iy.
"""

from __future__ import annotations

import cmath
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import atan2, cos, degrees, isfinite, pi, radians, tan
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.base.sections import NotNegative, Number, Speed, Strict
from simrob_drake.walking.parameters import MaxSpeed
from simrob_drake.walking.steps import Command, clamp

# Points, or angles, are the same if they differ by less [m, rad].
_SAME = 1e-6
# Times that differ by so little are the same sample [s].
_TIME_ROUNDING = 1e-9

# Gains and limits of the path follower.
# Largest progress on the path in one sample [m]. A measured pose that jumps must not skip a part of the path.
_LARGEST_PROGRESS = 0.05
# Time from a command to its effect: the follower looks ahead by it [s].
_LOOK_AHEAD = 0.4
# Speed back to the path for a distance to its side [1/s].
_SIDE_GAIN = 0.8
# Largest angle between the path and the way back to it [rad].
_LARGEST_APPROACH = 0.7
# Turning speed for an error of the heading [1/s].
_HEADING_GAIN = 1.5
# Speed at the end of the path for the remaining distance [1/s] ...
_BRAKING_GAIN = 0.7
# ... and the least speed there [m/s].
_LEAST_SPEED = 0.03
# The end is reached within this distance [m] and this error of the heading [rad].
_END_DISTANCE = 0.02
_END_HEADING = 0.05
# Part of the largest turning speed that the curvature of the path may take. The rest is for corrections [1].
_CURVE_PART = 0.8
# Least factor 1 - curvature * distance. It is zero at the centre of an arc, where every point of it is as near.
_LEAST_SHORTENING = 0.2


class Waypoints(Strict):
    """Path on straight lines between points, with rounded corners."""

    points: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=2)]
    """Points x, y in the world [m]. The first one is within 0.5 m of the robot's initial position."""
    speed: Annotated[Speed, Field(gt=0)] = 0.1
    """Speed along the path [m/s]."""
    rounding: NotNegative = 0.2
    """Largest distance from a corner at which its arc begins, never beyond the middle of a line [m]. With 0, the robot
    turns on the spot."""
    laps: Annotated[int, Field(strict=True, ge=1, le=1000)] | None = None
    """Count of rounds on a closed path. The path is open if this is not set."""
    heading_deg: Number | None = None
    """Heading at the end, from the world's x axis [deg]. If it is not set, the robot keeps the one in which it
    arrives."""

    @model_validator(mode="after")
    def _check_points(self) -> Waypoints:
        """Check that no two consecutive points are the same: the line between them has no direction.

        Raises:
            ValueError: two consecutive points differ by less than `_SAME`.
        """
        corners = self.corners
        # On a closed path the point after the last one is the first one again.
        count = len(self.points)
        for number, (before, corner) in enumerate(pairwise(corners)):
            if abs(corner - before) < _SAME:
                raise ValueError(
                    message(
                        "walking.same_points",
                        "points {first} and {second} of the path are the same; leave one of them out",
                        first=number % count,
                        second=(number + 1) % count,
                    )
                )
        return self

    @property
    def corners(self) -> list[complex]:
        """Points of the path as complex numbers, in order [m].

        With laps, they are repeated for each lap, and the first one follows once more at the end.
        """
        once = [complex(*point) for point in self.points]
        if self.laps is None:
            return once
        return [*once * self.laps, once[0]]


@dataclass(frozen=True)
class Spot:
    """Point of a path.

    Attributes:
        place: position as a complex number [m].
        direction: direction of the path there, as a complex number of length one.
        curvature: curvature of the path there, positive to the left [1/m].
    """

    place: complex
    direction: complex
    curvature: float = 0.0

    def at_distance(self, distance: float) -> Spot:
        """Point that is further along by a distance [m] on an arc, or a line, of the same curvature."""
        if not self.curvature:
            return Spot(self.place + self.direction * distance, self.direction)
        # The direction turns by curvature times distance; the position is its integral over the distance.
        turn = cmath.exp(1j * self.curvature * distance)
        place = self.place + self.direction * (turn - 1) / (1j * self.curvature)
        return Spot(place, self.direction * turn, self.curvature)


class Path:
    """Path of lines and arcs, one after the other.

    Attributes:
        length: length of the path [m].
    """

    def __init__(self, corners: Sequence[complex], rounding: float) -> None:
        """Create the path through corners, the inner ones of which are rounded.

        Args:
            corners: positions as complex numbers [m].
            rounding: largest distance from a corner at which its arc begins [m].
        """
        sides = [end - start for start, end in pairwise(corners)]
        turns = [cmath.phase(after / before) for before, after in pairwise(sides)]
        cuts = _cut_corners(sides, turns, rounding)

        self._starts = list[Spot]()  # first point of each line and arc
        lengths = list[float]()
        for number, side in enumerate(sides):
            direction = side / abs(side)
            cut_before = cuts[number]
            cut_after = cuts[number + 1]
            self._starts.append(Spot(corners[number] + cut_before * direction, direction))
            lengths.append(abs(side) - cut_before - cut_after)
            if cut_after:
                # An arc that turns by a touches both lines at the distance tan(a / 2) / curvature from the corner.
                turn = turns[number]
                curvature = tan(turn / 2) / cut_after
                self._starts.append(
                    Spot(corners[number + 1] - cut_after * direction, direction, curvature)
                )
                lengths.append(turn / curvature)
        # Distance of each line and arc from the start of the path [m]. The last sum is where the path ends.
        self._start_distances = [0.0, *accumulate(lengths)]
        self.length = self._start_distances.pop()

    def at(self, distance: float) -> Spot:
        """Point of the path at a distance from its start [m]. Beyond its ends, the first or last part goes on."""
        number = max(bisect_right(self._start_distances, distance) - 1, 0)
        return self._starts[number].at_distance(distance - self._start_distances[number])


def _cut_corners(sides: Sequence[complex], turns: Sequence[float], rounding: float) -> list[float]:
    """Compute how much of the lines the arc of each corner replaces [m]: the same distance before and after it.

    Args:
        sides: vectors along the n lines [m].
        turns: angles between consecutive lines, n - 1 of them [rad].
        rounding: largest distance [m].

    Returns:
        One distance for each of the n + 1 points. It is 0 for both ends.
    """
    cuts = [0.0] * (len(sides) + 1)
    for number, turn in enumerate(turns):
        # A straight corner has nothing to round, and no arc touches both lines of a path that turns back.
        if _SAME < abs(turn) < pi - _SAME:
            cuts[number + 1] = min(rounding, abs(sides[number]) / 2, abs(sides[number + 1]) / 2)
    return cuts


class _RootPose(NamedTuple):
    """Pose of a robot in the plane.

    Attributes:
        place: position as a complex number [m].
        direction: direction in which the robot looks, as a complex number of length one.
    """

    place: complex
    direction: complex


class Follower:
    """Computes the commands that lead a robot along a path, from the pose of its root.

    Attributes:
        path: the path.
    """

    def __init__(self, waypoints: Waypoints, max_speed: MaxSpeed, facing: float) -> None:
        """Create the follower of a path.

        Args:
            waypoints: points of the path, and the speed.
            max_speed: largest commands that the legs can follow.
            facing: direction in which the robot looks if its root is not turned, from the world's x axis [rad].
        """
        self.path = Path(waypoints.corners, waypoints.rounding)
        # The path is followed at a speed that the legs have. The station warns if that is less than desired.
        self._speed = min(waypoints.speed, max_speed.ahead)
        self._facing = facing
        self._largest_sideways = max_speed.sideways
        self._largest_turn = radians(max_speed.turn_deg)
        self._end_heading = (
            None if waypoints.heading_deg is None else radians(waypoints.heading_deg)
        )

    def now(self, base: Vector, progress: float) -> tuple[Command | None, float]:
        """Compute the command at a pose of the robot.

        Args:
            base: pose of the root x y z [m] qw qx qy qz, shape (7,).
            progress: distance on the path that was done at the last sample [m].

        Returns:
            The command, and the new progress [m]. Once the robot has arrived, the command is to stand, and the progress
            is beyond the length of the path. If the pose is not finite, the command is None and the progress unchanged.
        """
        pose = self._root_pose(base)
        if pose is None:
            return None, progress
        length = self.path.length
        if progress > length:
            return Command(), progress

        # Project the robot onto the path. At the distance d to the left of an arc of curvature k, the robot covers
        # 1 - k d times the distance that its projection covers on the arc.
        spot = self.path.at(progress)
        offset = (pose.place - spot.place) / spot.direction  # along the path, and to its left [m]
        advance = offset.real / max(1.0 - spot.curvature * offset.imag, _LEAST_SHORTENING)
        new_progress = min(max(progress + clamp(advance, _LARGEST_PROGRESS), 0.0), length)

        remaining = length - new_progress
        if remaining < _END_DISTANCE:
            return self._turn_at_end(pose, new_progress)
        # The spot stays that of the last progress, from which the offset is measured.
        return self._command_along(pose, spot, offset, new_progress), new_progress

    def _root_pose(self, base: Vector) -> _RootPose | None:
        """Convert the pose of the root to one in the plane. Returns None if it is not finite.

        Args:
            base: pose of the root x y z [m] qw qx qy qz, shape (7,).
        """
        x = float(base[0])
        y = float(base[1])
        w = float(base[3])
        i = float(base[4])
        j = float(base[5])
        k = float(base[6])
        # Yaw of the quaternion w + i x + j y + k z.
        heading = atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k)) + self._facing
        if not isfinite(x + y + heading):
            return None
        return _RootPose(complex(x, y), cmath.exp(1j * heading))

    def _turn_at_end(self, pose: _RootPose, progress: float) -> tuple[Command, float]:
        """Turn on the spot to the heading at the end of the path, if one is desired.

        Args:
            pose: pose of the robot.
            progress: distance on the path that is done [m].

        Returns:
            The command and the progress [m]. Once the robot has arrived, or if it cannot turn, the command is to stand,
            and the progress is one metre beyond the length of the path, which marks the arrival.
        """
        error = 0.0
        if self._end_heading is not None:
            error = cmath.phase(cmath.exp(1j * self._end_heading) / pose.direction)
        if abs(error) < _END_HEADING or not self._largest_turn:
            return Command(), self.path.length + 1.0  # arrived
        return Command(0j, clamp(_HEADING_GAIN * error, self._largest_turn)), progress

    def _command_along(
        self, pose: _RootPose, spot: Spot, offset: complex, progress: float
    ) -> Command:
        """Compute the command on the way: follow the path ahead of the robot, and return to it from the side.

        Args:
            pose: pose of the robot.
            spot: point of the path at the last progress.
            offset: position of the robot from that point, along the path and to its left [m].
            progress: distance on the path that is done at this sample [m].
        """
        length = self.path.length
        soon = self.path.at(min(progress + _LOOK_AHEAD * self._speed, length))

        # Slow down towards the end, and in bends that ask for more than a part (`_CURVE_PART`) of the largest turning
        # speed: the rest of it is kept for corrections of the heading.
        remaining = length - progress
        speed = min(self._speed, _BRAKING_GAIN * remaining + _LEAST_SPEED)
        curvature = max(abs(spot.curvature), abs(soon.curvature))
        if curvature:
            speed = min(speed, _CURVE_PART * self._largest_turn / curvature)

        # The desired direction leads back to the path: `back` is a speed to its left [m/s]. A robot that looks
        # elsewhere first turns, then walks: the cosine of the error is a factor of its speed.
        back = clamp(-_SIDE_GAIN * offset.imag, self._speed * tan(_LARGEST_APPROACH))
        # The heading is computed with the full speed along the path. With the low speed near the end, `back` would be
        # the larger part, and a small distance to the side would turn the robot across the path.
        heading_error = cmath.phase(soon.direction * complex(self._speed, back) / pose.direction)
        velocity = (
            soon.direction * complex(speed, back) * max(cos(heading_error), 0.0) / pose.direction
        )

        ahead = max(min(velocity.real, self._speed), 0.0)
        sideways = clamp(velocity.imag, self._largest_sideways)
        turn = clamp(soon.curvature * speed + _HEADING_GAIN * heading_error, self._largest_turn)
        return Command(complex(ahead, sideways), turn)


class Commanded(Strict):
    """Command of a walk from a time on."""

    time: NotNegative = 0.0
    """Time from which the command holds [s]."""
    ahead: Number = 0.0
    """Speed ahead [m/s]."""
    sideways: Number = 0.0
    """Speed to the left [m/s]."""
    turn_deg: Number = 0.0
    """Turning speed to the left [deg/s]."""

    @property
    def command(self) -> Command:
        """The command in SI units."""
        return Command(complex(self.ahead, self.sideways), radians(self.turn_deg))


class ExcessivePart(NamedTuple):
    """Part of a command that is beyond what the legs can follow.

    Attributes:
        key: name of the part: ``ahead``, ``sideways`` or ``turn_deg``.
        value: desired value.
        limit: value that the legs can follow.
        unit: unit of both.
    """

    key: str
    value: float
    limit: float
    unit: str


def clip_command(command: Command, max_speed: MaxSpeed) -> Command:
    """Limit a command to what the legs can follow, each of its three parts by its own limits.

    Args:
        command: the command.
        max_speed: largest commands that the legs can follow.

    Returns:
        The limited command. It is the same object if the command is within the limits.
    """
    ahead = min(max(command.speed.real, -max_speed.backward), max_speed.ahead)
    left = clamp(command.speed.imag, max_speed.sideways)
    turn = clamp(command.turn, radians(max_speed.turn_deg))
    # Callers compare the objects: a new one means that the command was clipped.
    is_same = ahead == command.speed.real and left == command.speed.imag and turn == command.turn
    return command if is_same else Command(complex(ahead, left), turn)


def find_excess(command: Command, max_speed: MaxSpeed) -> list[ExcessivePart]:
    """Find the parts of a command that the legs cannot follow: none, or up to three.

    Args:
        command: the command.
        max_speed: largest commands that the legs can follow.
    """
    limit = clip_command(command, max_speed)
    parts = (
        ExcessivePart("ahead", command.speed.real, limit.speed.real, "m/s"),
        ExcessivePart("sideways", command.speed.imag, limit.speed.imag, "m/s"),
        ExcessivePart("turn_deg", degrees(command.turn), degrees(limit.turn), "deg/s"),
    )
    return [part for part in parts if part.value != part.limit]


class Commander:
    """Selects the command of a walk at each sample.

    The first of these sources that has a command decides: a user who steers, an input port, a table from its first
    time on, a path. Without any of them the robot stands.

    The walking loop stores two values for the commander (:attr:`MEMORY`): ``hand`` (4), which is 1 and the user's
    command, or zero if no user steers, and ``progress`` (1), the distance on the path that is done [m].
    """

    MEMORY: Mapping[str, Vector | float] = {"hand": np.zeros(4), "progress": 0.0}

    def __init__(self, table: Sequence[Commanded], path: Follower | None) -> None:
        """Create the commander of a walk.

        Args:
            table: commands in the order of their times.
            path: follower of a path, or None.
        """
        self._times = [entry.time for entry in table]
        self._table = [entry.command for entry in table]
        self._path = path

    def now(
        self, time: float, hand: Vector, by_port: Vector | None, base: Vector, progress: float
    ) -> tuple[Command | None, float]:
        """Select the command at a time.

        Args:
            time: time since the run began [s].
            hand: stored command of a user, shape (4,): 1, then speed ahead and to the left [m/s] and turning speed
                [rad/s]; all zero if no user steers. It has no effect at time zero.
            by_port: value of the input port, shape (3,): speed ahead and to the left [m/s], turning speed [rad/s]. It
                is None without such a port, and not finite if the port has no command.
            base: pose of the root x y z [m] qw qx qy qz, shape (7,).
            progress: distance on the path that is done so far [m].

        Returns:
            The command and the new progress [m], which only changes while the path decides. The command is None if the
            path decides and the pose is not finite.
        """
        # At time zero, the stored command of a user is from an earlier run, which this one continues. The walking loop
        # deletes it in this sample.
        user_steers = hand[0] and time
        if user_steers:
            return command_of(hand[1:]), progress
        # The sum is finite if all values are, and takes one call.
        if by_port is not None and isfinite(by_port.sum()):
            return command_of(by_port), progress
        entry = bisect_right(self._times, time + _TIME_ROUNDING) - 1
        if entry >= 0:
            return self._table[entry], progress
        if self._path is not None:
            return self._path.now(base, progress)
        return Command(), progress


def command_of(values: Vector) -> Command:
    """Convert a vector (3,) to a command: speed ahead and to the left [m/s], turning speed [rad/s]."""
    ahead, left, turn = values.tolist()
    return Command(complex(ahead, left), turn)


keep_former_attributes(Spot, after="at_distance")
if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"clipped": "clip_command", "beyond": "find_excess"})
