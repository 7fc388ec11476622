"""What a walk is asked for: by hand, by another block, by a table or by a path, and within what the legs can follow."""

from __future__ import annotations

from bisect import bisect_right
from cmath import exp as turned_by
from cmath import phase
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import atan2, cos, degrees, isfinite, pi, radians, tan
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Speed, Strict
from simrob_drake.walking.parameters import MaxSpeed
from simrob_drake.walking.steps import Command, clamp

_SAME = 1e-6  # of points [m]
_HOP = 0.05  # how much further on its path a robot comes in a sample, at most [m]
_SOON = 0.4  # how far ahead is looked: what is commanded shows as late as that [s]
_ACROSS = 0.8  # of the way back to the path [1/s]
_STEEPEST = 0.7  # at which it comes back [rad]
_TURNS = 1.5  # of the way back to its direction [1/s]
_BRAKES = 0.7  # of the way that is left: how fast it comes to the end [1/s]
_CREEPS = 0.03  # and at least [m/s]
_ARRIVED = 0.02  # from the end [m]
_FACES = 0.05  # from the heading at the end [rad]
_SPARE = 0.8  # part of the largest turn that the path itself may take


class Waypoints(Strict):
    """Points that a robot goes by, on straight lines whose corners are rounded."""

    points: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=2)]
    """x, y in the world [m]; the first one within 0.5 m of where the robot begins."""
    speed: Annotated[Speed, Field(gt=0)] = 0.1
    """[m/s]."""
    rounding: NotNegative = 0.2
    """How far from a corner its arc begins at most; never beyond the middles of the lines [m]. 0: turn on the spot."""
    laps: Annotated[int, Field(strict=True, ge=1, le=1000)] | None = None
    """How often round a closed path; open unless given."""
    heading_deg: Number | None = None
    """Where the robot looks at the end, from the world's x [deg]; as it comes unless given."""

    @model_validator(mode="after")
    def _apart(self) -> Waypoints:
        corners = self.corners
        same = [number for number in range(1, len(corners)) if abs(corners[number] - corners[number - 1]) < _SAME]
        if same:
            raise ValueError(
                message(
                    "walking.same_points",
                    "points {first} and {second} of the path are the same",
                    first=same[0] - 1,
                    second=same[0],
                )
            )
        return self

    @property
    def corners(self) -> list[complex]:
        """All points in order, those of each lap."""
        once = [complex(*point) for point in self.points]
        return once if self.laps is None else [*once * self.laps, once[0]]


@dataclass(frozen=True)
class Spot:
    """A place on a path: where [m], its direction as a complex number of length one, and its curvature [1/m]."""

    place: complex
    direction: complex
    curvature: float = 0.0

    def after(self, way: float) -> Spot:
        """Return the place after a way of the same curvature [m]."""
        turn = turned_by(1j * self.curvature * way)
        if self.curvature:
            return Spot(
                self.place + self.direction * (turn - 1) / (1j * self.curvature), self.direction * turn, self.curvature
            )
        return Spot(self.place + self.direction * way, self.direction)


class Path:
    """Lines and arcs, one after the other.

    Attributes:
        length: of all [m].
    """

    def __init__(self, corners: Sequence[complex], rounding: float) -> None:
        """Make the path through corners [m], each of which but the ends is cut off by ``rounding`` at most [m]."""
        sides = [b - a for a, b in pairwise(corners)]
        turns = [phase(b / a) for a, b in pairwise(sides)]
        cuts = [0.0] * (len(sides) + 1)
        for number, turn in enumerate(turns):
            if _SAME < abs(turn) < pi - _SAME:  # else there is nothing to be cut off, or no arc that touches both
                cuts[number + 1] = min(rounding, abs(sides[number]) / 2, abs(sides[number + 1]) / 2)
        self._starts, lengths = list[Spot](), list[float]()
        for number, side in enumerate(sides):
            direction = side / abs(side)
            begins, ends = cuts[number], cuts[number + 1]
            self._starts.append(Spot(corners[number] + begins * direction, direction))
            lengths.append(abs(side) - begins - ends)
            if ends:
                turn = turns[number]
                curvature = tan(turn / 2) / ends
                self._starts.append(Spot(corners[number + 1] - ends * direction, direction, curvature))
                lengths.append(turn / curvature)
        self._begins = [0.0, *accumulate(lengths)]
        self.length = self._begins.pop()

    def at(self, along: float) -> Spot:
        """Return a place by its way from the start [m]."""
        number = max(bisect_right(self._begins, along) - 1, 0)
        return self._starts[number].after(along - self._begins[number])


class Follower:
    """Commands a robot along a path, by where its root is."""

    def __init__(self, waypoints: Waypoints, max_speed: MaxSpeed, facing: float) -> None:
        """Prepare.

        Args:
            waypoints: what to follow.
            max_speed: that the legs can do.
            facing: where the robot looks while its root is not turned, from the world's x axis [rad].
        """
        self.path = Path(waypoints.corners, waypoints.rounding)
        self._speed, self._facing = min(waypoints.speed, max_speed.ahead), facing
        self._aside, self._turn = max_speed.sideways, radians(max_speed.turn_deg)
        self._heading = None if waypoints.heading_deg is None else radians(waypoints.heading_deg)

    def now(self, base: Vector, progress: float) -> tuple[Command | None, float]:
        """Return the command for where the robot is, and its progress [m]; beyond the length once it has arrived.

        None, and the progress that was, if its pose is not a number.

        Args:
            base: pose of its root, x y z qw qx qy qz [m].
            progress: so far [m].
        """
        x, y, _, w, i, j, k = base.tolist()
        looks = atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k)) + self._facing
        if not isfinite(x + y + looks):
            return None, progress
        sight = turned_by(1j * looks)
        length = self.path.length
        if progress > length:
            return Command(), progress
        spot = self.path.at(progress)
        off = (complex(x, y) - spot.place) / spot.direction
        hop = off.real / max(1.0 - spot.curvature * off.imag, 0.2)
        progress = min(max(progress + clamp(hop, _HOP), 0.0), length)
        left = length - progress
        if left < _ARRIVED:
            error = 0.0 if self._heading is None else phase(turned_by(1j * self._heading) / sight)
            if abs(error) < _FACES or not self._turn:
                return Command(), length + 1.0
            return Command(0j, clamp(_TURNS * error, self._turn)), progress
        soon = self.path.at(min(progress + _SOON * self._speed, length))
        speed = min(self._speed, _BRAKES * left + _CREEPS)
        bend = max(abs(spot.curvature), abs(soon.curvature))
        if bend:
            speed = min(speed, _SPARE * self._turn / bend)
        back = clamp(-_ACROSS * off.imag, self._speed * tan(_STEEPEST))
        error = phase(soon.direction * complex(self._speed, back) / sight)
        way = soon.direction * complex(speed, back) * max(cos(error), 0.0) / sight
        aside = clamp(way.imag, self._aside)
        turn = clamp(soon.curvature * speed + _TURNS * error, self._turn)
        return Command(complex(max(min(way.real, self._speed), 0.0), aside), turn), progress


_ROUNDING = 1e-9  # s


class Commanded(Strict):
    """What the robot shall do from a time on."""

    time: NotNegative = 0.0
    """[s]."""
    ahead: Number = 0.0
    """[m/s]."""
    sideways: Number = 0.0
    """To the left [m/s]."""
    turn_deg: Number = 0.0
    """To the left [deg/s]."""

    @property
    def command(self) -> Command:
        """The same as a command."""
        return Command(complex(self.ahead, self.sideways), radians(self.turn_deg))


def clipped(command: Command, max_speed: MaxSpeed) -> Command:
    """Return what of a command the legs can follow; the same object if that is all of it."""
    ahead = min(max(command.speed.real, -max_speed.backward), max_speed.ahead)
    left = clamp(command.speed.imag, max_speed.sideways)
    turn = clamp(command.turn, radians(max_speed.turn_deg))
    same = ahead == command.speed.real and left == command.speed.imag and turn == command.turn
    return command if same else Command(complex(ahead, left), turn)


def beyond(command: Command, max_speed: MaxSpeed) -> list[tuple[str, float, float, str]]:
    """Return what of a command the legs cannot follow: keys, values, what they can, units."""
    can = clipped(command, max_speed)
    parts = (
        ("ahead", command.speed.real, can.speed.real, "m/s"),
        ("sideways", command.speed.imag, can.speed.imag, "m/s"),
        ("turn_deg", degrees(command.turn), degrees(can.turn), "deg/s"),
    )
    return [part for part in parts if part[1] != part[2]]


class Commander:
    """Says what a walk is asked for at each sample.

    The first of these that says anything: a hand, an input, a table from its first time on, a path; else to stand.
    What it remembers is part of the walk's memory: ``hand`` (4), whether a hand commands and its command, and
    ``progress`` (1), how far it is on its path [m].
    """

    MEMORY: Mapping[str, Vector | float] = {"hand": np.zeros(4), "progress": 0.0}

    def __init__(self, table: Sequence[Commanded], path: Follower | None) -> None:
        """Prepare, with the rows of a table in the order of their times."""
        self._times, self._table = [row.time for row in table], [row.command for row in table]
        self._path = path

    def now(
        self, time: float, hand: Vector, by_port: Vector | None, base: Vector, progress: float
    ) -> tuple[Command | None, float]:
        """Return what is asked for, and how far on its path the robot is; None if the path does not see where that is.

        Args:
            time: since the run began [s]; no hand has commanded when it begins.
            hand: what is remembered of it.
            by_port: an input (3): speeds ahead and to the left [m/s], turn [rad/s]; not a number says nothing.
            base: pose of the root, x y z qw qx qy qz.
            progress: so far [m].
        """
        if hand[0] and time:
            return command_of(hand[1:]), progress
        if by_port is not None and isfinite(by_port.sum()):
            return command_of(by_port), progress
        row = bisect_right(self._times, time + _ROUNDING) - 1
        if row >= 0:
            return self._table[row], progress
        return (Command(), progress) if self._path is None else self._path.now(base, progress)


def command_of(values: Vector) -> Command:
    """Return numbers (3) as a command: speeds ahead and to the left [m/s], turn [rad/s]."""
    ahead, left, turn = values.tolist()
    return Command(complex(ahead, left), turn)
