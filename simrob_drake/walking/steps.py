"""Where feet land: as a command wants it, and so that a robot which is off its course comes to rest on it."""

from __future__ import annotations

from cmath import exp as turned_by
from dataclasses import dataclass
from math import ceil, radians
from typing import NamedTuple

from simrob_drake.walking.figures import Feedback, WalkingFigures
from simrob_drake.walking.pendulum import weights

_AHEAD = 3  # steps that are looked ahead: what comes later counts for a hundredth
_GRID = 0.02  # between the times of landing that are compared [s]


@dataclass(frozen=True)
class Command:
    """What a robot shall do: speeds [m/s] and turn [rad/s]."""

    speed: complex = 0j
    turn: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return abs(self.speed) > 1e-9 or abs(self.turn) > 1e-9

    def nearer(self, wanted: Command, most: tuple[float, float, float]) -> Command:
        """Return a command nearer to another one, each part by its largest change (ahead, left, turn [deg/s])."""
        ahead, left, turn = most
        way, more = wanted.speed - self.speed, wanted.turn - self.turn
        step = complex(within(way.real, ahead), within(way.imag, left))
        return Command(self.speed + step, self.turn + within(more, radians(turn)))


class Landing(NamedTuple):
    """How a step ends: when [s], where [m] and turned by how much [rad], from the foot that stands."""

    time: float
    place: complex
    yaw: float = 0.0


class Steps:
    """Footsteps of a robot whose feet, one or a group, stand and swing in turn: 0 the right ones, 1 the left ones."""

    def __init__(self, figures: WalkingFigures, half: float, rolls: float = 1.0) -> None:
        """Prepare.

        Args:
            figures: of the walk.
            half: how far the middles of the two groups are to the side of the robot's [m].
            rolls: how much further than its legs go a robot gets because its feet roll meanwhile.
        """
        self._half, self._time, self._pace = half, figures.step_time, figures.step_time / rolls
        self.transfer = figures.double_support * figures.step_time
        self._inward, self._ahead = figures.zmp_inward, figures.zmp_ahead
        self._reach, self._feedback = figures.reach, figures.feedback

    def rest_point(self, standing: int) -> complex:
        """Return where the zero-moment point stays while a foot stands, from that foot."""
        return complex(self._ahead, self._inward if standing == 0 else -self._inward)

    def beside(self, swinging: int) -> complex:
        """Return where a foot stands from the other one, in a robot at rest."""
        return complex(0.0, 2.0 * self._half if swinging else -2.0 * self._half)

    def middle(self, standing: int, foot: complex) -> complex:
        """Return where the zero-moment point rests while both feet stand, the other one beside the first."""
        return 0.5 * (self.rest_point(standing) + foot + self.rest_point(1 - standing))

    def planned(self, swinging: int, command: Command) -> Landing:
        """Return where a foot lands by a command: about the middle of the robot, which goes and turns."""
        yaw, out = command.turn * self._pace, 0.5 * self.beside(swinging)
        return Landing(self._time, command.speed * self._pace + out + turned_by(1j * yaw) * out, yaw)

    def start_of(self, standing: int, command: Command, omega: float, before: complex, ahead: int = _AHEAD) -> complex:
        """Return the divergent component at the start of a planned step, and of those after it.

        Args:
            standing: the foot, from which it is seen.
            command: that all steps follow.
            omega: of the pendulum [1/s].
            before: where the zero-moment point comes from.
            ahead: how many steps more are looked at; then the robot rests.
        """
        start, rest, end = weights(omega, self._time, self.transfer)
        turn = turned_by(1j * command.turn * self._pace)
        here = self.rest_point(standing), self.rest_point(1 - standing)  # in this step, in the next, and so on in turn
        lands = self.planned(1 - standing, command).place, self.planned(standing, command).place
        came = [(place - landed) / turn for place, landed in zip(here, lands, strict=True)]  # seen from the next foot
        found = 0.5 * (came[ahead % 2] + here[1 - ahead % 2])
        for step in range(ahead, -1, -1):  # from rest backwards
            own = step % 2
            found = start * (came[1 - own] if step else before) + rest * here[own] + end * (lands[own] + turn * found)
        return found

    def after(self, standing: int, command: Command, omega: float) -> tuple[float, complex]:
        """Return what the divergent component must be when the swinging foot lands at u: (1 - a) u + b, as a and b.

        a counts the zero-moment point from which the next step begins, that of the foot which stands now.
        """
        swinging, here = 1 - standing, self.rest_point(standing)
        turn = turned_by(1j * command.turn * self._pace)
        start = weights(omega, self._time, self.transfer).start
        return start, turn * self.start_of(swinging, command, omega, 0j) + start * here

    def adjusted(
        self, swinging: int, planned: Landing, xi: Divergent, foot: complex, after: tuple[float, complex]
    ) -> Landing:
        """Return the landing that serves a divergent component best, within reach of the foot in the time.

        Times on a grid are compared by

        .. math:: |u^* - u|^2 + k_u |u - u_0|^2 + k_T (T - T_0)^2

        with the foothold u* by which the next steps are as planned, u what the foot reaches of it, and the planned
        :math:`u_0` and :math:`T_0`.
        """
        told = self._feedback
        assert told is not None  # who has none does not ask
        first = max(xi.now + _GRID, xi.lifts + told.shortest)
        count = max(ceil((xi.lifts + told.longest - first) / _GRID), 1)
        best, least = planned, float("inf")
        for time in (planned.time, *(first + _GRID * number for number in range(count))):
            if time < first - 1e-9:
                continue
            wanted = (xi.at(time) - after[1]) / (1.0 - after[0])
            place = self._reached(swinging, planned, wanted, foot, time - max(xi.now, xi.lifts), told)
            cost = abs(wanted - place) ** 2 + told.keeps_place * abs(place - planned.place) ** 2
            cost += told.keeps_time * (time - planned.time) ** 2
            if cost < least:
                best, least = Landing(time, place, planned.yaw), cost
        return best

    def _reached(
        self, swinging: int, planned: Landing, wanted: complex, foot: complex, time: float, told: Feedback
    ) -> complex:
        """Return what a foot reaches in a time of where it is wanted."""
        side, reach = (1.0 if swinging else -1.0), self._reach
        place = planned.place + told.gain / (1.0 + told.keeps_place) * (wanted - planned.place)
        out = min(max(side * place.imag, reach.near), reach.far)
        way = complex(min(max(place.real, -reach.behind), reach.ahead), side * out) - foot
        most = told.foot_speed * max(time, 0.0)
        return foot + (way * (most / abs(way)) if abs(way) > most else way)


@dataclass(frozen=True)
class Divergent:
    """The divergent component in a step, and where it goes while the foot stands.

    Attributes:
        xi: where it is, from the foot that stands [m].
        omega: of the pendulum [1/s].
        now: time since the step began [s].
        lifts: when the other foot lifts, and the zero-moment point is at rest [s].
        zmp: where that is now.
        rest: where it rests.
    """

    xi: complex
    omega: float
    now: float
    lifts: float
    zmp: complex
    rest: complex

    def at(self, time: float) -> complex:
        """Return where it is at a later time of the step."""
        start, rest, end = weights(self.omega, time - self.now, max(self.lifts - self.now, 0.0))
        return (self.xi - start * self.zmp - rest * self.rest) / end


def within(value: float, most: float) -> float:
    """Return a number, or the nearest between ``-most`` and ``most``."""
    return min(max(value, -most), most)
