r"""Where feet land: as a command wants it, and so that a robot which is off its course comes to rest on it.

Told by the divergent component of a linear inverted pendulum in closed form (Englsberger 2015, Khadiv 2020). With the
centre of mass c, :math:`\omega = \sqrt{g/h}` and the zero-moment point p,

.. math:: \xi = c + \dot c / \omega, \qquad \dot\xi = \omega (\xi - p), \qquad \dot c = \omega (\xi - c) .

In a step of time T the zero-moment point goes from :math:`p_0` to :math:`p_1` on a straight line in the time D, and
stays there; then what comes after it decides where :math:`\xi` must be at its start:

.. math:: \xi_0 = w_0 p_0 + w_1 p_1 + e^{-\omega T} \xi_T, \qquad
    w_0 = 1 - \frac{1 - e^{-\omega D}}{\omega D}, \quad w_1 = 1 - e^{-\omega T} - w_0 .
"""

from __future__ import annotations

import math
from cmath import exp as turned_by
from dataclasses import dataclass
from math import ceil, radians
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from simrob_drake.walking.parameters import Feedback, WalkingParameters


class Weights(NamedTuple):
    """What of a step its zero-moment point at its start, that at its end, and the end of the step count for."""

    start: float
    rest: float
    end: float


def weights(omega: float, time: float, transfer: float) -> Weights:
    """Return the weights of a step [1].

    Args:
        omega: of the pendulum [1/s].
        time: T, that the step still takes [s].
        transfer: D, that the zero-moment point still goes [s].
    """
    way = omega * transfer
    start = 1.0 - (1.0 - math.exp(-way)) / way if way > 1e-9 else 0.0
    end = math.exp(-omega * time)
    return Weights(start, 1.0 - end - start, end)


_AHEAD = 3  # steps that are looked ahead: what comes later counts for a hundredth
_GRID = 0.02  # between the times of landing that are compared [s]


class Command(NamedTuple):
    """What a robot shall do: speeds [m/s] and turn [rad/s]."""

    speed: complex = 0j
    turn: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return abs(self.speed) > 1e-9 or abs(self.turn) > 1e-9

    def nearer(self, target: Command, most: tuple[float, float, float]) -> Command:
        """Return a command nearer to another one, each part by its largest change (ahead, left, turn [deg/s])."""
        ahead, left, turn = most
        way, more = target.speed - self.speed, target.turn - self.turn
        step = complex(within(way.real, ahead), within(way.imag, left))
        return Command(self.speed + step, self.turn + within(more, radians(turn)))


class Landing(NamedTuple):
    """How a step ends: when [s], where [m] and turned by how much [rad], from the foot that stands."""

    time: float
    place: complex
    yaw: float = 0.0


class Steps:
    """Footsteps of a robot whose feet, one or a group, stand and swing in turn: 0 the right ones, 1 the left ones."""

    def __init__(self, parameters: WalkingParameters, half: float, rolls: float = 1.0) -> None:
        """Prepare.

        Args:
            parameters: of the walk.
            half: how far the middles of the two groups are to the side of the robot's [m].
            rolls: how much further than its legs go a robot gets because its feet roll meanwhile.
        """
        self._time, self._pace = parameters.step_time, parameters.step_time / rolls
        self.transfer = parameters.double_support * parameters.step_time
        self._foothold, self._feedback = parameters.foothold, parameters.feedback
        ahead, inward = parameters.zmp_ahead, parameters.zmp_inward
        self.rest_points = complex(ahead, inward), complex(ahead, -inward)
        """Where the zero-moment point stays while a foot stands, from that foot."""
        self.apart = complex(0.0, -2.0 * half), complex(0.0, 2.0 * half)
        """Where a foot stands from the other one, in a robot at rest."""

    def middle(self, standing: int, foot: complex) -> complex:
        """Return where the zero-moment point rests while both feet stand, the other one beside the first."""
        return 0.5 * (self.rest_points[standing] + foot + self.rest_points[1 - standing])

    def allowed(self, swinging: int, places: npt.NDArray[np.complex128]) -> npt.NDArray[np.bool_]:
        """Tell which of some places, complex, a foot may land at."""
        out, foothold = (1.0 if swinging else -1.0) * places.imag, self._foothold
        ahead = (places.real <= foothold.ahead) & (places.real >= -foothold.behind)
        return np.asarray(ahead & (out >= foothold.inner) & (out <= foothold.outer))

    def planned(self, swinging: int, command: Command) -> Landing:
        """Return where a foot lands by a command: about the middle of the robot, which goes and turns."""
        yaw = command.turn * self._pace
        return Landing(self._time, self._place(swinging, command, turned_by(1j * yaw)), yaw)

    def _place(self, swinging: int, command: Command, turn: complex) -> complex:
        """Return that place, for a turn by its end as a complex number of length one."""
        out = 0.5 * self.apart[swinging]
        return command.speed * self._pace + out + turn * out

    def start_of(
        self, standing: int, command: Command, parts: Weights, before: complex, ahead: int = _AHEAD
    ) -> complex:
        """Return the divergent component at the start of a planned step, and of those after it.

        Args:
            standing: the foot, from which it is seen.
            command: that all steps follow.
            parts: the weights of each.
            before: where the zero-moment point comes from.
            ahead: how many steps more are looked at; then the robot rests.
        """
        (start, rest, end), swinging, turn = parts, 1 - standing, turned_by(1j * command.turn * self._pace)
        here = self.rest_points[standing], self.rest_points[swinging]  # in this step, in the next, and so on in turn
        lands = self._place(swinging, command, turn), self._place(standing, command, turn)
        came = (here[0] - lands[0]) / turn, (here[1] - lands[1]) / turn  # seen from the next foot
        found = 0.5 * (came[ahead % 2] + here[1 - ahead % 2])
        for step in range(ahead, -1, -1):  # from rest backwards
            own = step % 2
            found = start * (came[1 - own] if step else before) + rest * here[own] + end * (lands[own] + turn * found)
        return found

    def after(self, standing: int, command: Command, omega: float) -> tuple[float, complex]:
        """Return what the divergent component must be when the swinging foot lands at u: (1 - a) u + b, as a and b.

        a counts the zero-moment point from which the next step begins, that of the foot which stands now.
        """
        parts, turn = weights(omega, self._time, self.transfer), turned_by(1j * command.turn * self._pace)
        begins = self.start_of(1 - standing, command, parts, 0j)
        return parts.start, turn * begins + parts.start * self.rest_points[standing]

    def adjusted(
        self, swinging: int, planned: Landing, xi: Divergent, foot: complex, after: tuple[float, complex]
    ) -> Landing:
        """Return the landing that serves a divergent component best, within reach of the foot in the time.

        Times on a grid are compared by

        .. math:: |u^* - u|^2 + k_u |u - u_0|^2 + k_T (T - T_0)^2

        with the foothold u* by which the next steps are as planned, u what the foot reaches of it, and the planned
        :math:`u_0` and :math:`T_0`.
        """
        feedback = self._feedback
        assert feedback is not None  # who has none does not ask
        first = max(xi.now + _GRID, xi.lifts + feedback.min_swing_time)
        count = max(ceil((xi.lifts + feedback.max_swing_time - first) / _GRID), 1)
        best, least = planned, float("inf")
        for time in (planned.time, *(first + _GRID * number for number in range(count))):
            if time < first - 1e-9:
                continue
            desired = (xi.at(time) - after[1]) / (1.0 - after[0])
            place = self._reached(swinging, planned, desired, foot, time - max(xi.now, xi.lifts), feedback)
            cost = abs(desired - place) ** 2 + feedback.place_weight * abs(place - planned.place) ** 2
            cost += feedback.time_weight * (time - planned.time) ** 2
            if cost < least:
                best, least = Landing(time, place, planned.yaw), cost
        return best

    def _reached(
        self, swinging: int, planned: Landing, desired: complex, foot: complex, time: float, feedback: Feedback
    ) -> complex:
        """Return what a foot reaches in a time of where it is wanted."""
        side, foothold = (1.0 if swinging else -1.0), self._foothold
        place = planned.place + feedback.step_gain / (1.0 + feedback.place_weight) * (desired - planned.place)
        out = min(max(side * place.imag, foothold.inner), foothold.outer)
        way = complex(min(max(place.real, -foothold.behind), foothold.ahead), side * out) - foot
        most = feedback.max_foot_speed * max(time, 0.0)
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
