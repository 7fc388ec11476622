r"""Footsteps that follow a command, and that bring a disturbed robot back to its walk.

The robot is a linear inverted pendulum with the centre of mass c, the zero-moment point p and
:math:`\omega = \sqrt{g/h}`. Its divergent component of motion is :math:`\xi` (Englsberger 2015, Khadiv 2020):

.. math:: \xi = c + \dot c / \omega, \qquad \dot\xi = \omega (\xi - p), \qquad \dot c = \omega (\xi - c) .

In a step of duration T the zero-moment point first moves from :math:`p_0` to :math:`p_1`, on a straight line in the
time D, and then stays there. The end of the step therefore decides where :math:`\xi` must be at its start:

.. math:: \xi_0 = w_0 p_0 + w_1 p_1 + e^{-\omega T} \xi_T, \qquad
    w_0 = 1 - \frac{1 - e^{-\omega D}}{\omega D}, \quad w_1 = 1 - e^{-\omega T} - w_0 .

Positions are complex numbers [m], measured from the stance foot: the real part ahead, the imaginary part to the left.
A multiplication by exp(i a) turns a position by the angle a to the left. The foot that stands has the index `standing`,
the foot that moves the index `swinging`: 0 is the right one, 1 the left one. A foot may be a group of feet. In names,
dcm or xi is the divergent component of motion, and zmp the zero-moment point.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.walking.parameters import Feedback, WalkingParameters

# Steps that are planned after the next one. Later steps change the divergent component by less than a hundredth.
_STEPS_AHEAD = 3
# Spacing of the landing times that are compared [s].
_TIME_GRID = 0.02
# Two times of landing are the same if they differ by less [s].
_SAME_TIME = 1e-9
# Below this product of omega and transfer time [1], w_0 is zero: the formula would divide by zero.
_NO_TRANSFER = 1e-9
# A slower command counts as standing [m/s, rad/s].
_SLOWEST = 1e-9


class Weights(NamedTuple):
    """Weights of a step in the divergent component at its start [1]; their sum is 1.

    Attributes:
        start: w_0, of the zero-moment point at the start of the step.
        rest: w_1, of the zero-moment point at its end.
        end: weight of the divergent component at the end of the step.
    """

    start: float
    rest: float
    end: float


def weights(omega: float, time: float, transfer: float) -> Weights:
    """Compute the weights of the rest of a step in its divergent component, by the equations of the module.

    Args:
        omega: natural frequency of the pendulum [1/s].
        time: remaining duration T of the step [s].
        transfer: remaining time D in which the zero-moment point moves [s].
    """
    exponent = omega * transfer
    start = 1.0 - (1.0 - math.exp(-exponent)) / exponent if exponent > _NO_TRANSFER else 0.0
    end = math.exp(-omega * time)
    return Weights(start, 1.0 - end - start, end)


class Command(NamedTuple):
    """Desired motion of a robot.

    Attributes:
        speed: speed ahead (real part) and to the left (imaginary part) [m/s].
        turn: turning speed to the left [rad/s].
    """

    speed: complex = 0j
    turn: float = 0.0

    @property
    def moves(self) -> bool:
        """True if the command is a motion, False if it is to stand."""
        return abs(self.speed) > _SLOWEST or abs(self.turn) > _SLOWEST

    def approach(self, target: Command, largest_change: tuple[float, float, float]) -> Command:
        """Change the command towards another one.

        Args:
            target: the command to approach.
            largest_change: most that the speed ahead and to the left [m/s] and the turning speed [deg/s] change.

        Returns:
            The changed command. It is the target if all changes are within their limits.
        """
        ahead, left, turn_deg = largest_change
        speed_error = target.speed - self.speed
        turn_error = target.turn - self.turn
        speed_change = complex(clamp(speed_error.real, ahead), clamp(speed_error.imag, left))
        turn_change = clamp(turn_error, math.radians(turn_deg))
        return Command(self.speed + speed_change, self.turn + turn_change)


class Landing(NamedTuple):
    """End of a step, as seen from the stance foot.

    Attributes:
        time: time from the start of the step to the landing [s].
        place: foothold [m].
        yaw: angle by which the foot is turned to the left when it lands [rad].
    """

    time: float
    place: complex
    yaw: float = 0.0


class LandingCondition(NamedTuple):
    """Condition on the divergent component when the swing foot lands, so that the next steps go as planned.

    With the foothold u it is (1 - start) u + offset.

    Attributes:
        start: weight w_0 of the next step's first zero-moment point, which is that of the present step [1].
        offset: divergent component for a foothold at the origin [m].
    """

    start: float
    offset: complex

    def dcm_for(self, foothold: complex) -> complex:
        """Divergent component that a foothold [m] requires [m]."""
        return (1.0 - self.start) * foothold + self.offset

    def foothold_for(self, dcm: complex) -> complex:
        """Foothold that a divergent component [m] requires [m]."""
        return (dcm - self.offset) / (1.0 - self.start)


class Steps:
    """Footsteps of a robot whose two groups of feet stand and swing in turn.

    Group 0 is on the right, group 1 on the left. Each group is one foot or several feet that move together.

    Attributes:
        transfer: time in which the weight goes over to the stance foot at the start of a step [s].
        rest_points: position of the zero-moment point while a foot stands, from that foot, for each group [m].
        apart: position of each group from the other one in a robot at rest [m].
    """

    def __init__(
        self, parameters: WalkingParameters, half_width: float, roll_factor: float = 1.0
    ) -> None:
        """Create the footsteps of a walk.

        Args:
            parameters: parameters of the walk.
            half_width: distance from the robot's middle to the middle of each group, to the side [m].
            roll_factor: ratio of the robot's way to the way of its legs [1]. Above 1 if the feet are balls, which roll
                while they stand.
        """
        self._step_time = parameters.step_time
        # Speed times pace is the length of a step of the legs [s]. Balls roll on by the rest.
        self._pace = parameters.step_time / roll_factor
        self._foothold = parameters.foothold
        self._feedback = parameters.feedback
        self.transfer = parameters.double_support * parameters.step_time

        # Inward is to the left of the right foot, and to the right of the left foot.
        right = complex(parameters.zmp_ahead, parameters.zmp_inward)
        left = complex(parameters.zmp_ahead, -parameters.zmp_inward)
        self.rest_points = (right, left)
        self.standing_places = (complex(0.0, -2.0 * half_width), complex(0.0, 2.0 * half_width))

    def middle(self, standing: int, foot: complex) -> complex:
        """Position of the zero-moment point while the robot stands on both feet [m].

        Args:
            standing: index of the foot from which positions are measured.
            foot: position of the other foot [m], which looks in the same direction.
        """
        return 0.5 * (self.rest_points[standing] + foot + self.rest_points[1 - standing])

    def is_allowed(
        self, swinging: int, places: npt.NDArray[np.complex128]
    ) -> npt.NDArray[np.bool_]:
        """Check which positions (any shape) [m] are within the footholds that the robot's parameters allow.

        Args:
            swinging: index of the swing foot.
            places: positions as complex numbers, measured from the stance foot.

        Returns:
            True for each allowed position, in the shape of `places`.
        """
        foothold = self._foothold
        outward = _outward(swinging) * places.imag
        is_within_length = (places.real <= foothold.ahead) & (places.real >= -foothold.behind)
        is_within_width = (outward >= foothold.inner) & (outward <= foothold.outer)
        return np.asarray(is_within_length & is_within_width)

    def plan_landing(self, swinging: int, command: Command) -> Landing:
        """Plan the landing of a step without disturbances.

        The middle of the robot moves and turns by the command, with each foot at its usual distance to the side.

        Args:
            swinging: index of the swing foot.
            command: the command that the step follows.
        """
        yaw = command.turn * self._pace
        place = self._planned_place(swinging, command, cmath.exp(1j * yaw))
        return Landing(self._step_time, place, yaw)

    def _planned_place(self, swinging: int, command: Command, turn: complex) -> complex:
        """Compute the foothold of a step without disturbances [m].

        Args:
            swinging: index of the swing foot.
            command: the command that the step follows.
            turn: turn of the robot in the step, as a complex number of length one: exp(i yaw).
        """
        # From the stance foot to the robot's middle, and from there to the swing foot's side, which has turned.
        to_side = 0.5 * self.standing_places[swinging]
        return command.speed * self._pace + to_side + turn * to_side

    def dcm_at_start(
        self,
        standing: int,
        command: Command,
        step_weights: Weights,
        zmp_from: complex,
        steps_ahead: int = _STEPS_AHEAD,
    ) -> complex:
        """Compute the divergent component at the start of a step that is followed by others, as planned [m].

        Args:
            standing: index of the stance foot of the first step, from which all positions are measured.
            command: the command that all steps follow.
            step_weights: weights of each step.
            zmp_from: position of the zero-moment point at the start of the first step [m].
            steps_ahead: count of further steps. The robot rests after the last one.
        """
        swinging = 1 - standing
        turn = cmath.exp(1j * command.turn * self._pace)

        # The feet stand in turn, so there are two values of each quantity: index 0 for the first, third ... step, on
        # the foot `standing`, and index 1 for the steps between them. They are seen from the stance foot of their step.
        rest_points = (self.rest_points[standing], self.rest_points[swinging])
        footholds = (
            self._planned_place(swinging, command, turn),
            self._planned_place(standing, command, turn),
        )
        # The same rest points as seen from the stance foot of the following step: at the foothold, turned by `turn`.
        rest_points_from_next = (
            (rest_points[0] - footholds[0]) / turn,
            (rest_points[1] - footholds[1]) / turn,
        )

        # After the last step the robot stands on both feet, and the divergent component rests in the middle of their
        # rest points, here seen from the foot that landed last. Go back step by step from there.
        last = steps_ahead % 2
        dcm = 0.5 * (rest_points_from_next[last] + rest_points[1 - last])
        for step in range(steps_ahead, -1, -1):
            index = step % 2
            # The zero-moment point comes from the rest point of the step before, which has the other index.
            zmp_before = rest_points_from_next[1 - index] if step else zmp_from
            end = footholds[index] + turn * dcm  # measured from the stance foot of this step
            dcm = (
                step_weights.start * zmp_before
                + step_weights.rest * rest_points[index]
                + step_weights.end * end
            )
        return dcm

    def dcm_at_landing(self, standing: int, command: Command, omega: float) -> LandingCondition:
        """Compute the condition on the divergent component at the end of the present step.

        The condition is linear in the foothold u: the divergent component is (1 - start) u + offset.

        Args:
            standing: index of the stance foot of the present step.
            command: the command that the next steps follow. The foot must land with the yaw that it asks for.
            omega: natural frequency of the pendulum [1/s].
        """
        step_weights = weights(omega, self._step_time, self.transfer)
        turn = cmath.exp(1j * command.turn * self._pace)
        # When the swing foot lands at u, the zero-moment point is at the rest point r of the present foot. Seen from
        # the foot that lands, it is at p = (r - u) / turn.
        # The next step must begin with a divergent component that is linear in p: dcm + w_0 p, seen from the foot that
        # lands. Its constant dcm is the result of `dcm_at_start` for p = 0.
        # Seen from the present foot, it is u + turn (dcm + w_0 (r - u) / turn) = (1 - w_0) u + (turn dcm + w_0 r).
        dcm = self.dcm_at_start(1 - standing, command, step_weights, 0j)
        offset = turn * dcm + step_weights.start * self.rest_points[standing]
        return LandingCondition(step_weights.start, offset)

    def adjust_landing(
        self,
        swinging: int,
        planned: Landing,
        state: DivergentComponent,
        foot: complex,
        condition: LandingCondition,
    ) -> Landing:
        r"""Find the landing that answers an error of the divergent component best.

        The planned landing time, if the foot can land by then, is compared with other times T by a cost. These are on a
        grid, from one grid step from now, or the least swing time if that is later, to the longest swing time:

        .. math:: |u^* - u|^2 + k_u |u - u_0|^2 + k_T (T - T_0)^2

        with the foothold :math:`u^*` after which the next steps go as planned (``desired``), the foothold u that the
        foot takes (``place``, see `_reachable_place`), the planned foothold :math:`u_0` and time :math:`T_0`, and the
        parameters `place_weight` :math:`k_u` and `time_weight` :math:`k_T`.

        Args:
            swinging: index of the swing foot.
            planned: landing without the error.
            state: the divergent component.
            foot: position of the swing foot [m].
            condition: condition on the divergent component at the landing.

        Returns:
            The best landing: its time, its foothold u, and the yaw of the planned one.
        """
        feedback = self._feedback
        assert feedback is not None  # a walk without feedback keeps its planned landings
        lift_off = state.lift_off
        swing_start = max(state.now, lift_off)
        # One sample of the grid must remain for the foot to move, and a swing has a least duration.
        earliest = max(state.now + _TIME_GRID, lift_off + feedback.min_swing_time)
        latest = lift_off + feedback.max_swing_time
        # At least one time of the grid is compared, also if no time is left before the latest one.
        count = max(math.ceil((latest - earliest) / _TIME_GRID), 1)
        times = (planned.time, *(earliest + _TIME_GRID * index for index in range(count)))

        best = planned
        least_cost = math.inf
        for time in times:
            if time < earliest - _SAME_TIME:
                continue  # the planned time may be too early
            desired = condition.foothold_for(state.at(time))
            place = self._reachable_place(
                swinging, planned, desired, foot, time - swing_start, feedback
            )
            cost = (
                abs(desired - place) ** 2 + feedback.place_weight * abs(place - planned.place) ** 2
            )
            cost += feedback.time_weight * (time - planned.time) ** 2
            if cost < least_cost:
                best = Landing(time, place, planned.yaw)
                least_cost = cost
        return best

    def _reachable_place(
        self,
        swinging: int,
        planned: Landing,
        desired: complex,
        foot: complex,
        time: float,
        feedback: Feedback,
    ) -> complex:
        """Compute the foothold that answers a desired one [m].

        It is a compromise with the planned one, limited to the allowed footholds, or the point on the straight way
        there that the foot reaches in time at its largest speed. From a foot beyond the allowed footholds, this point
        may be beyond them, too.

        Args:
            swinging: index of the swing foot.
            planned: landing without an error.
            desired: foothold that the divergent component requires [m].
            foot: position of the swing foot [m].
            time: time that the foot has for its motion [s]: until it lands, from now, or from its lift-off if that is
                later.
            feedback: parameters of the feedback.
        """
        foothold = self._foothold
        side = _outward(swinging)

        # The least of |u* - u|^2 + k_u |u - u_0|^2 is at u = u_0 + (u* - u_0) / (1 + k_u). The step answers the share
        # step_gain of it.
        gain = feedback.step_gain / (1.0 + feedback.place_weight)
        place = planned.place + gain * (desired - planned.place)

        # Legs end the reach ahead and outward; inward, the feet must not cross.
        ahead = min(max(place.real, -foothold.behind), foothold.ahead)
        outward = min(max(side * place.imag, foothold.inner), foothold.outer)
        path = complex(ahead, side * outward) - foot

        # The joints of the legs have a largest speed, and so has the foot.
        longest = feedback.max_foot_speed * max(time, 0.0)
        if abs(path) > longest:
            path *= longest / abs(path)
        return foot + path


@dataclass(frozen=True)
class DivergentComponent:
    """The divergent component in a step, and the zero-moment point that moves it until the swing foot lands.

    Attributes:
        xi: divergent component now, from the stance foot [m].
        omega: natural frequency of the pendulum [1/s].
        now: time since the step began [s].
        lift_off: time at which the swing foot lifts and the zero-moment point comes to rest, since the step began [s].
        zmp: position of the zero-moment point now [m].
        rest: position where the zero-moment point rests [m].
    """

    xi: complex
    omega: float
    now: float
    lift_off: float
    zmp: complex
    rest: complex

    def at(self, time: float) -> complex:
        """Predict the divergent component at a later time since the step began [m]. The foot must have lifted by then.

        It solves the equation of the module for the end: xi_T = (xi_0 - w_0 p_0 - w_1 p_1) exp(omega T).
        """
        start, rest, end = weights(self.omega, time - self.now, max(self.lift_off - self.now, 0.0))
        return (self.xi - start * self.zmp - rest * self.rest) / end


def clamp(value: float, limit: float) -> float:
    """Limit a value to the range from -limit to +limit."""
    return min(max(value, -limit), limit)


def _outward(swinging: int) -> float:
    """Sign of the direction to a foot's own side: +1 (left) for foot 1, -1 (right) for foot 0."""
    return 1.0 if swinging else -1.0


keep_former_attributes(Command, nearer="approach")
keep_former_attributes(
    Steps,
    allowed="is_allowed",
    planned="plan_landing",
    start_of="dcm_at_start",
    after="dcm_at_landing",
    adjusted="adjust_landing",
)
keep_former_attributes(DivergentComponent, lifts="lift_off")
if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"Divergent": "DivergentComponent", "within": "clamp"})
