"""What a walk is asked for: by hand, by another block, by a table or by a path, and within what the legs can follow."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import degrees, isfinite, radians

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.sections import NotNegative, Number, Strict
from simrob_drake.walking.parameters import MaxSpeed
from simrob_drake.walking.path import Follower
from simrob_drake.walking.steps import Command, within

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
    left = within(command.speed.imag, max_speed.sideways)
    turn = within(command.turn, radians(max_speed.turn_deg))
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
