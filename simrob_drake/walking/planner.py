r"""Planner of a walk: in every sample, it moves the references of the trunk and of the feet.

The divergent component :math:`\xi` of a linear inverted pendulum (:mod:`simrob_drake.walking.steps`) goes where the
next steps need it, and the centre of mass c follows it: :math:`\dot c = \omega (\xi - c)`.

With feedback, a measured error of :math:`\xi` changes the place and time of the landing. The references of the centre
of mass and of the trunk's lean approach their estimates, so that the joints do not push against a fall, but the robot
steps after it. A step ends when the swing foot touches the ground.

Positions are complex numbers [m], measured from the stance foot: the real part ahead, the imaginary part to the left.
A foot may be a group of feet, such as the pair of a trot; its position is that of the middle of the group.

At the start of a step the weight is transferred: the zero-moment point goes to the rest point of the stance foot, while
both feet stand. Then the swing foot lifts. The share of its swing is the elapsed part of the swing's duration, 0 to 1.
A step hurries if its foot lifts at once, without a transfer. A robot braces if it stands on both feet until an error is
over. Errors within the deadband are not answered. Heights of the swing foot consist of the height of the ground that
is expected below it, and of its lift above that.

The state of a walk, a :class:`Stride`, has six parts: the current step with the command that it follows; the pose and
the share of the swing foot; the landing; the references of the trunk (centre of mass, zero-moment point, heading, lean
and rise of the root); the ground, with its slope [1], the height of the ground under the swing foot in addition to the
slope, and for pairs the tilt of the line between their feet; and corrections, which are learnt slowly. An
:class:`Estimate` is the motion as measured. With force sensors it also has `down`, whether each foot of the swing group
feels the ground, and `hangs`, whether each foot of the stance group does not.

In names, com is the centre of mass, zmp the zero-moment point, and dcm the divergent component. So is xi: that of the
estimate is measured, any other is a reference.
"""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from simrob_drake.walking.body import StanceFeet, height_on_slope, slope_through
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.height_map import HeightMap, Places
from simrob_drake.walking.parameters import Feedback, WalkingParameters
from simrob_drake.walking.steps import (
    Command,
    DivergentComponent,
    Landing,
    LandingCondition,
    Steps,
    clamp,
    weights,
)
from simrob_drake.walking.stride import (
    Corrections,
    Ground,
    Stride,
    Swing,
    Trunk,
    progress_since,
    smoothstep,
)

# Limits of the corrections. They keep a wrong measurement from carrying the robot away.
# Largest correction of the trunk's lean to the right and ahead [rad].
_LARGEST_LEAN = (0.15, 0.15)
# Largest offset of the centre of mass that is learnt, ahead and to the left [m].
_LARGEST_COM_OFFSET = (0.03, 0.03)
# Largest speed that is added to the commanded one, ahead and to the left [m/s].
_LARGEST_TRIM = (0.15, 0.1)
# Largest turning speed that is added to the commanded one [rad/s].
_LARGEST_TURN_BACK = 0.3
# Part of the usual rates of learning while steps answer an error: the robot then stands on the edges of its soles [1].
_RATE_IN_ERROR = 0.1

# A walk ends if the swing foot is as near as this to its place [m].
_END_DISTANCE = 0.01
# A walk ends if the turn back is not faster than this, so that a commanded turn is completed [rad/s].
_END_TURN = 0.02
# The foothold is fixed for this time before the landing: the foot could not follow any more [s].
_FIXED_FOOTHOLD = 0.03
# A standing robot ignores errors up to this multiple of the deadband [1].
_DEADBANDS_STANDING = 2.0
# A braced robot walks on after the error has been small for this time [s] ...
_BRACE_TIME = 0.2
# ... and small means below this part of the error that braces the robot [1].
_BRACE_HYSTERESIS = 0.5

# Least part of a swing in which a foot goes to the height of the ground, also if it may feel the ground earlier [1].
_LEAST_HEIGHT_PART = 0.1
# Times of a landing are equal if they differ by less [s].
_SAME_TIME = 1e-9


class _Support(NamedTuple):
    """The rest of the present step, as it moves the divergent component.

    Attributes:
        omega: natural frequency of the pendulum [1/s].
        time: time since the step began [s].
        transfer: duration of the weight transfer at the start of the step [s].
        zmp: position of the zero-moment point now [m].
        rest: position where the zero-moment point rests after the transfer [m].
        condition: condition on the divergent component at the landing.
    """

    omega: float
    time: float
    transfer: float
    zmp: complex
    rest: complex
    condition: LandingCondition

    def dcm_for(self, time: float, foothold: complex) -> complex:
        """Compute where the divergent component must be now for a landing [m].

        Args:
            time: time of the landing since the step began [s].
            foothold: position of the landing [m].
        """
        remaining = max(time - self.time, 0.0)
        transfer = min(max(self.transfer - self.time, 0.0), remaining)
        start, rest, end = weights(self.omega, remaining, transfer)
        return start * self.zmp + rest * self.rest + end * self.condition.dcm_for(foothold)


class WalkPlanner:
    """Plans a walk sample by sample. All of its state is in the :class:`Stride`.

    Attributes:
        steps: footsteps of the robot.
    """

    def __init__(
        self,
        parameters: WalkingParameters,
        stance: StanceFeet,
        period: float,
        height_map: HeightMap | None = None,
    ) -> None:
        """Create the planner of a robot.

        Args:
            parameters: parameters of the walk.
            stance: positions of the feet in the robot's stance.
            period: sample time [s].
            height_map: heights of the ground, or None if they are unknown.
        """
        self._parameters = parameters
        self._stance = stance
        self._period = period
        self._map = height_map
        self._can_turn = parameters.max_speed.turn_deg > 0
        self.steps = Steps(parameters, stance.half_width, stance.roll_factor)

        self._has_feedback = parameters.feedback is not None
        self._feedback = parameters.feedback or Feedback()
        # First part of a swing, in which a foot goes to the height of the ground. With a height map, it only goes up
        # then. The part ends when the foot may feel the ground, but has a least value. Without feedback it is the whole
        # swing.
        self._height_part = 1.0
        if self._has_feedback:
            self._height_part = max(self._feedback.early_touchdown, _LEAST_HEIGHT_PART)

    def sample(
        self, stride: Stride, command: Command, estimate: Estimate | None, omega: float
    ) -> tuple[Stride, float, Stride]:
        """Advance a walk by one sample.

        Args:
            stride: state of the walk.
            command: desired motion.
            estimate: what the sensors measure, or None to walk without feedback. It has no effect if the parameters
                have no feedback.
            omega: natural frequency of the pendulum [1/s].

        Returns:
            The references of this sample, the height of the swing foot above the expected ground [m], and the state of
            the walk for the next sample.
        """
        if not self._has_feedback:
            estimate = None
        if estimate is not None:
            # An offset that lasts is no error.
            offset = stride.corrections.com_offset
            estimate = estimate._replace(com=estimate.com - offset, xi=estimate.xi - offset)

        # The landing first, as the divergent component depends on it; then the feet and the trunk follow. `before`
        # still has the swing foot of the last sample, and `now` that of this one.
        before, xi = self._plan_step(stride, command, omega, estimate)
        now, lift = self._move_swing_foot(before, estimate)
        if estimate is not None:
            now = self._respond_to_contact(before, now, estimate)
            now = self._follow_estimate(now, estimate, xi)

        # The centre of mass follows the divergent component: d(com)/dt = omega (xi - com), exact over one period.
        com = now.trunk.com
        com = com + (1.0 - math.exp(-omega * self._period)) * (xi - com)
        now = now._replace(trunk=now.trunk._replace(com=com))
        return now, lift, self._advance(now, command, estimate, xi, lift)

    def _follow_estimate(self, stride: Stride, estimate: Estimate, xi: complex) -> Stride:
        """Move the references towards the estimate, and learn the errors that last.

        It does so during the steps of a walk. While the robot stands, and in the weight transfer of a first step if
        that is longer than usual, only the slope of the ground is learnt; while it is braced, nothing is.

        Args:
            stride: references of this sample.
            estimate: what the sensors measure.
            xi: reference of the divergent component [m].

        Returns:
            The stride with changed references of the trunk, ground and corrections.
        """
        feedback = self._feedback
        step = stride.step
        if step.brace_time > 0:
            return stride  # a braced robot may stand on the edges of its soles, which do not show the slope then
        slope_error = estimate.slope - stride.ground.slope
        # Only the first step of a walk may have a longer weight transfer than the others.
        is_first_transfer = step.transfer > self.steps.transfer and step.time < step.transfer
        if not step.active or is_first_transfer:
            # A robot that stands still with both feet on the ground is held by them: only the slope is learnt.
            slope = stride.ground.slope + self._part(feedback.slope_rate) * slope_error
            return stride._replace(ground=stride.ground._replace(slope=slope))

        is_in_error = self._outside_deadband(estimate.xi - xi) != 0
        rate = _RATE_IN_ERROR if is_in_error else 1.0
        ground = stride.ground._replace(
            slope=stride.ground.slope + self._part(rate * feedback.slope_rate) * slope_error,
            tilt=stride.ground.tilt
            + self._part(feedback.level_rate) * (slope_error - stride.ground.tilt),
        )
        return stride._replace(
            trunk=self._trunk_towards(stride, estimate),
            ground=ground,
            corrections=self._learn_from(stride, estimate, rate),
        )

    def _trunk_towards(self, stride: Stride, estimate: Estimate) -> Trunk:
        """Move the trunk's references towards the estimate, and the trunk back to upright and to its height.

        Each is a first-order lag with the sample time T: x + (1 - exp(-rate T)) (measured - x).

        Args:
            stride: references of this sample.
            estimate: what the sensors measure.
        """
        feedback = self._feedback
        trunk = stride.trunk
        lean_part = self._part(feedback.lean_rate)
        # The part of a lean that remains while it decays to upright.
        remaining_part = 1.0 - self._part(feedback.upright_rate)
        return trunk._replace(
            com=trunk.com + self._part(feedback.com_rate) * (estimate.com - trunk.com),
            lean=remaining_part * (trunk.lean + lean_part * (estimate.lean - trunk.lean)),
            pitch=remaining_part * (trunk.pitch + lean_part * (estimate.pitch - trunk.pitch)),
            rise=trunk.rise - self._part(feedback.height_rate) * trunk.rise,
        )

    def _learn_from(self, stride: Stride, estimate: Estimate, rate: float) -> Corrections:
        """Learn the lean of the trunk and the offset of the centre of mass that last.

        Args:
            stride: references of this sample.
            estimate: what the sensors measure, but for the offset that is already learnt, which `sample` has
                subtracted: what is left of the error is added to the offset by a small part.
            rate: factor of the rates of learning [1].
        """
        feedback = self._feedback
        corrections = stride.corrections

        # Integral feedback: the trunk leans against the measured lean until that is zero.
        lean = complex(estimate.lean, estimate.pitch)
        lean_integral = (
            corrections.lean_integral - rate * feedback.lean_integral * self._period * lean
        )

        com_error = estimate.com - stride.trunk.com
        com_offset = corrections.com_offset + self._part(rate * feedback.offset_rate) * com_error
        return corrections._replace(
            lean_integral=_clamp_parts(lean_integral, _LARGEST_LEAN),
            com_offset=_clamp_parts(com_offset, _LARGEST_COM_OFFSET),
        )

    def _plan_step(
        self, stride: Stride, command: Command, omega: float, estimate: Estimate | None
    ) -> tuple[Stride, complex]:
        """Decide where and when the step lands, and where the divergent component shall be now.

        It also begins the first step of a walk, turns back to the desired heading, and stops a walk that has to brace.

        Args:
            stride: state of the walk.
            command: desired motion.
            omega: natural frequency of the pendulum [1/s].
            estimate: what the sensors measure, or None to walk without feedback.

        Returns:
            The stride with its landing, zero-moment point and end of the weight transfer, and the reference of the
            divergent component [m].
        """
        if not stride.step.active:
            stride = self._start_if_needed(stride, command, estimate)
        if not stride.step.active:
            # The divergent component of a robot that stands is at rest, at the zero-moment point.
            return stride, stride.trunk.zmp

        if estimate is not None and self._can_turn:
            stride = self._hold_heading(stride, command, estimate)
        step = stride.step
        standing, swinging = step.sides
        corrected = Command(
            speed=step.speed + stride.corrections.speed_trim,
            turn=step.turn + stride.corrections.turn_back,
        )
        usual = self.steps.plan_landing(swinging, corrected)
        # The first step of a walk takes longer than usual: `nominal` is the planned duration of this step.
        planned = self._shift_to_even_ground(stride, estimate, usual._replace(time=step.nominal))

        # The zero-moment point goes to its rest point on a straight line while the weight is transferred.
        rest = self.steps.rest_points[standing]
        share = min(step.time / step.transfer, 1.0) if step.transfer > 0 else 1.0
        support = _Support(
            omega=omega,
            time=step.time,
            transfer=step.transfer,
            zmp=step.zmp_from + share * (rest - step.zmp_from),
            rest=rest,
            condition=self.steps.dcm_at_landing(standing, corrected, omega),
        )

        # Without an estimate the landing is the planned one. With one, errors are answered by another landing until
        # `_FIXED_FOOTHOLD` before it; after that, the landing of the last sample stays.
        landing = stride.landing
        if estimate is None:
            landing = planned
        elif step.time <= landing.time - _FIXED_FOOTHOLD:
            support, landing = self._answer_error(stride, estimate, planned, support)
        xi = support.dcm_for(landing.time, landing.place)

        stride = stride._replace(
            step=step._replace(transfer=support.transfer),
            landing=landing,
            trunk=stride.trunk._replace(zmp=support.zmp),
        )
        if self._must_brace(estimate, xi):
            return self._brace(stride)
        return stride, xi

    def _hold_heading(self, stride: Stride, command: Command, estimate: Estimate) -> Stride:
        """Turn the desired heading by the command, and set the turning speed that brings the trunk back to it.

        Args:
            stride: state of the walk.
            command: desired motion.
            estimate: what the sensors measure, with the heading of the trunk in the world.
        """
        desired = stride.trunk.desired_heading
        error = math.remainder(desired - estimate.heading, math.tau)
        turn_back = clamp(self._feedback.heading_gain * error, _LARGEST_TURN_BACK)
        return stride._replace(
            trunk=stride.trunk._replace(desired_heading=desired + command.turn * self._period),
            corrections=stride.corrections._replace(turn_back=turn_back),
        )

    def _answer_error(
        self, stride: Stride, estimate: Estimate, planned: Landing, support: _Support
    ) -> tuple[_Support, Landing]:
        """Adjust the landing to an error of the divergent component.

        Args:
            stride: state of the walk, with the landing of the last sample.
            estimate: what the sensors measure.
            planned: landing without an error.
            support: what remains of the step.

        Returns:
            What remains of the step, whose weight transfer ends now if the swing foot may lift at once, and the
            landing. If the error is within the deadband, they are `support` and `planned`.
        """
        feedback = self._feedback
        standing, swinging = stride.step.sides
        # The error is measured against the landing time of the last sample: a hastened step stays hastened.
        desired = support.dcm_for(stride.landing.time, planned.place)
        error = self._outside_deadband(estimate.xi - desired)
        if not error:
            return support, planned

        # A single foot lifts at once, as its step is the answer. A pair does not: a trot would only become hasty. Nor
        # does the foot of a walk's first step, whose longer transfer has to bring the weight over first. The groups of
        # both sides have as many feet.
        is_single = len(self._stance.groups[standing]) == 1
        is_transferring = support.time < support.transfer
        is_usual_transfer = support.transfer <= self.steps.transfer
        if is_single and is_transferring and is_usual_transfer:
            support = support._replace(transfer=support.time, zmp=support.rest)

        # Soles bring the zero-moment point beyond the error, which then grows more slowly. This counts in the
        # prediction for the landing only: the reference of the zero-moment point, in `support`, stays.
        shift = _clamp_parts(feedback.zmp_gain * error, feedback.zmp_limit)
        state = DivergentComponent(
            xi=desired + error,  # as measured, but for the deadband
            omega=support.omega,
            now=support.time,
            lift_off=support.transfer,
            zmp=support.zmp + shift,
            rest=support.rest + shift,
        )
        foot = stride.swing.place
        adjusted = self.steps.adjust_landing(swinging, planned, state, foot, support.condition)
        return support, self._shift_to_even_ground(stride, estimate, adjusted)

    def _must_brace(self, estimate: Estimate | None, xi: complex) -> bool:
        """Check whether an error to the side has reached the threshold from which the robot braces.

        Returns False without an estimate, and if the parameters set no `brace_threshold`.

        Args:
            estimate: what the sensors measure, or None to walk without feedback.
            xi: reference of the divergent component [m].
        """
        threshold = self._feedback.brace_threshold
        if estimate is None or threshold is None:
            return False
        return abs((estimate.xi - xi).imag) >= threshold

    def _brace(self, stride: Stride) -> tuple[Stride, complex]:
        """Stop the walk on both feet. Returns the stride and its divergent component [m].

        The zero-moment point goes to the middle of the feet's rest points. `_start_if_needed` ends the bracing.
        """
        zmp = self.steps.middle(int(stride.step.standing), stride.swing.place)
        step = stride.step._replace(
            active=0.0, brace_time=_BRACE_TIME, speed=0j, turn=0.0, zmp_from=zmp
        )
        return stride._replace(step=step, trunk=stride.trunk._replace(zmp=zmp)), zmp

    def _start_if_needed(
        self, stride: Stride, command: Command, estimate: Estimate | None
    ) -> Stride:
        """Begin the first step of a standing robot, if there is a command or an error of the divergent component.

        A braced robot does not step: it counts down the time for which it stays braced while the error to the side is
        small, and begins anew if the error is large again.

        Args:
            stride: state of the standing robot.
            command: desired motion.
            estimate: what the sensors measure, or None to walk without feedback.

        Returns:
            The stride of the first step, or that of the robot which goes on standing.
        """
        step = stride.step
        # The divergent component of a robot that stands should rest at the zero-moment point.
        error = estimate.xi - stride.trunk.zmp if estimate is not None else 0j
        if step.brace_time > 0:
            threshold = self._feedback.brace_threshold
            is_small = threshold is None or abs(error.imag) < _BRACE_HYSTERESIS * threshold
            remaining = step.brace_time - self._period if is_small else _BRACE_TIME
            return stride._replace(step=step._replace(brace_time=remaining))

        error = self._outside_deadband(error, _DEADBANDS_STANDING)
        if not (command.moves or error):
            return stride
        stride = self._begin_first_step(stride, command, error)
        # The walk keeps the heading in which the robot stands.
        heading = stride.trunk.desired_heading if estimate is None else estimate.heading
        return stride._replace(trunk=stride.trunk._replace(desired_heading=heading))

    def _begin_first_step(self, stride: Stride, command: Command, error: complex) -> Stride:
        """Begin the first step.

        Without an error the present swing foot steps, after the weight has gone to the other foot for `settle` seconds.
        With an error the foot lifts at once: the one on the side of the error, or the present swing foot if the error
        has no part to a side.

        Args:
            stride: state of the standing robot.
            command: desired motion.
            error: part of the divergent component's error outside of the deadband [m], or 0.
        """
        # Positive if the left foot (index 1) stands, negative if the right one does. An imaginary part above zero is to
        # the left, too. The foot on the side of the error must swing, as it can step further out than the other one.
        side_of_stance_foot = stride.step.standing - 0.5
        if error and error.imag * side_of_stance_foot > 0:
            stride = stride.on_the_other_foot()
        settling = 0.0 if error else self._parameters.settle
        stride = self._begin_step(stride, command, hurries=bool(error))

        # A first step has other durations than those that `_begin_step` set: only the settling comes before it.
        duration = settling + self._parameters.step_time
        step = stride.step._replace(
            active=1.0,
            time=0.0,
            transfer=settling,
            nominal=duration,
            heading_from=stride.trunk.heading,
        )
        return stride._replace(
            step=step,
            swing=stride.swing._replace(share=0.0),
            landing=stride.landing._replace(time=duration),
        )

    def _begin_step(self, stride: Stride, command: Command, *, hurries: bool) -> Stride:
        """Begin a step whose speed approaches the command.

        It sets the durations and the speeds of the step. The place of the landing follows in `_plan_step`.

        Args:
            stride: state of the walk, seen from the foot that stands in the step.
            command: desired motion.
            hurries: whether the foot lifts at once, without a weight transfer.
        """
        duration = self._parameters.step_time
        change = self._parameters.max_speed_change
        new_command = stride.step.command.approach(command, change)
        step = stride.step._replace(
            transfer=0.0 if hurries else self.steps.transfer,
            nominal=duration,
            speed=new_command.speed,
            turn=new_command.turn,
        )
        return stride._replace(step=step, landing=stride.landing._replace(time=duration))

    def _move_swing_foot(self, stride: Stride, estimate: Estimate | None) -> tuple[Stride, float]:
        """Move the swing foot and the ground below it towards the landing, and turn the trunk.

        Nothing moves while the robot stands, before the weight has been transferred, or if no time is left for a swing.

        Args:
            stride: state of the walk, with the landing of the step.
            estimate: what the sensors measure, or None to walk without feedback.

        Returns:
            The stride, and the height of the swing foot above the expected ground [m], which is 0 if nothing moves.
        """
        step = stride.step
        swing = stride.swing
        landing = stride.landing
        time = step.time + self._period
        duration = landing.time - step.transfer
        if not step.active or time <= step.transfer or duration <= 0:
            return stride, 0.0

        # The share never goes back, also if the landing is postponed.
        share = max(min((time - step.transfer) / duration, 1.0), swing.share)
        # Part of the remaining way that is done in this sample. The landing may have moved since the last sample. The
        # `swing_peak` is the peak speed of the foot over its mean speed.
        part_of_rest = progress_since(swing.share, share, self._parameters.swing_peak)
        new_swing = Swing(
            place=swing.place + part_of_rest * (landing.place - swing.place),
            yaw=swing.yaw + part_of_rest * (landing.yaw - swing.yaw),
            share=share,
        )

        # The trunk stands still during the transfer. At the first sample after it, the heading jumps to the elapsed
        # share of the whole step. The foot turns by the share of its swing.
        turn_share = smoothstep(min(time / landing.time, 1.0))
        heading = step.heading_from + turn_share * (landing.yaw - step.heading_from)
        ground = self._ground_of_swing(stride, estimate, share)
        stride = stride._replace(
            swing=new_swing,
            trunk=stride.trunk._replace(heading=heading),
            ground=ground,
        )
        return stride, self._lift_at(share)

    def _ground_of_swing(self, stride: Stride, estimate: Estimate | None, share: float) -> Ground:
        """Compute the ground under the swing foot, from the height map if there is one and an estimate.

        Otherwise the ground is expected to have no steps: in the first part of the swing (`_height_part`), the height
        under the foot goes to that of the stance foot, and then stays there. With a slope, these are the heights in
        addition to the slope.

        Args:
            stride: state of the walk, with the swing of the last sample.
            estimate: what the sensors measure, or None to walk without feedback.
            share: share of the swing's duration at this sample.
        """
        if self._map is not None and estimate is not None:
            return self._ground_of_map(stride, estimate, share, self._map)
        height_part = self._height_part
        # Part of the way to go at the last sample that is still to go now. Beyond the first part of the swing it is 0.
        remainder = 1.0 - progress_since(stride.swing.share / height_part, share / height_part)
        return stride.ground._replace(
            height=stride.ground.height * remainder,
            foot_tilt=stride.ground.foot_tilt * remainder,
        )

    def _ground_of_map(
        self, stride: Stride, estimate: Estimate, share: float, height_map: HeightMap
    ) -> Ground:
        """Move each swing foot towards the height of the map at its foothold.

        Heights of feet are those of a :class:`Ground`: above the middle of the stance feet, in addition to the ground's
        slope. A foot that is too low goes up in the first part of the swing (`_height_part`). A foot that is too high
        goes down in the rest of the swing, or in the first part if that is the whole swing. A foot that feels the
        ground by its force sensor stays, once the swing is beyond `early_touchdown`.

        Args:
            stride: state of the walk, with the swing of the last sample.
            estimate: what the sensors measure.
            share: share of the swing's duration at this sample.
            height_map: the height map.

        Returns:
            The ground with the height of the swing foot, and for a pair the slope of the line between its feet.
        """
        standing, swinging = stride.step.sides
        offsets = self._stance.offsets[swinging]
        landing = stride.landing
        yaw = cmath.exp(1j * landing.yaw)
        level = self._level_of(estimate, standing, height_map)
        footholds = [landing.place + yaw * offset for offset in offsets]
        tops = height_map.heights([estimate.in_world(foothold) for foothold in footholds])

        # Parts of the remaining distances up and down that are done in this sample, from 0 to 1; 1 in the last sample,
        # so that the foot arrives. After the first part of the swing, `up` is 0. Before its end, `down` is 0.
        before = stride.swing.share
        height_part = self._height_part
        rest = 1.0 - height_part
        up = progress_since(before / height_part, share / height_part)
        down = up
        if rest:
            down = progress_since(
                max(before - height_part, 0.0) / rest, max(share - height_part, 0.0) / rest
            )

        ground = stride.ground
        can_feel = before > self._feedback.early_touchdown
        has_contact = estimate.down if can_feel and estimate.down else (False,) * len(offsets)
        heights = list[float]()
        for foothold, offset, top, stays in zip(footholds, offsets, tops, has_contact, strict=True):
            now = ground.height + height_on_slope(ground.foot_tilt, offset)
            error = top - level - height_on_slope(ground.slope, foothold) - now
            part = up if error > 0 else down
            heights.append(now if stays else now + part * error)
        return ground._replace(
            height=sum(heights) / len(heights),
            foot_tilt=slope_through(self._stance.slope_weights[swinging], heights),
        )

    def _level_of(self, estimate: Estimate, group: int, height_map: HeightMap) -> float:
        """Compute the mean height of the map under the feet of the stance group [m].

        Args:
            estimate: what the sensors measure, with the position of the stance foot in the world.
            group: index of the stance group.
            height_map: the height map.
        """
        offsets = self._stance.offsets[group]
        heights = height_map.heights([estimate.in_world(offset) for offset in offsets])
        return sum(heights) / len(heights)

    def _shift_to_even_ground(
        self, stride: Stride, estimate: Estimate | None, landing: Landing
    ) -> Landing:
        """Shift a landing to a near place where the ground is even.

        Without a height map or an estimate, the landing stays as planned.

        Args:
            stride: state of the walk, with the landing of the last sample.
            estimate: what the sensors measure, or None to walk without feedback.
            landing: the landing as planned.
        """
        if self._map is None or estimate is None:
            return landing
        standing, swinging = stride.step.sides
        yaw = cmath.exp(1j * landing.yaw)
        offsets = self._stance.offsets[swinging]
        feet = [estimate.in_world(landing.place + yaw * offset) for offset in offsets]

        # The choice of the last sample is kept if it is nearly as good, so that the foothold does not jump.
        last_shift = stride.landing.place - landing.place if stride.step.time > 0 else 0j
        last_shift_in_world = last_shift * estimate.turn.conjugate()

        def is_allowed(shifts: Places) -> npt.NDArray[np.bool_]:
            """Check which shifts in the world [m] the legs can reach."""
            return self.steps.is_allowed(swinging, landing.place + shifts * estimate.turn)

        level = self._level_of(estimate, standing, self._map)
        largest_rise = self._parameters.foothold.rise
        shift = self._map.shift(feet, last_shift_in_world, is_allowed, level, largest_rise)
        return landing._replace(place=landing.place + shift * estimate.turn)

    def _lift_at(self, share: float) -> float:
        """Height of the swing foot above the expected ground at a share s of the swing's duration [m].

        It is lift (4 s (1 - s))^exponent plus the part of the landing height that is reached, which is all of it from
        the middle of the swing on.
        """
        parameters = self._parameters
        landing_height = self._feedback.landing_height * smoothstep(min(2.0 * share, 1.0))
        lift = parameters.lift * (4.0 * share * (1.0 - share)) ** parameters.lift_exponent
        return float(lift + landing_height)

    def _respond_to_contact(self, before: Stride, stride: Stride, estimate: Estimate) -> Stride:
        """Keep swing feet that feel the ground where they are, and lower stance feet that do not.

        Swing feet are kept once the swing is beyond `early_touchdown`; stance feet are lowered while the other foot
        swings, and only if `late_touchdown` is not 0. Nothing changes without force sensors in the feet: `down` and
        `hangs` of the estimate are empty then.

        Args:
            before: stride with the swing of the last sample.
            stride: stride with the swing of this sample.
            estimate: what the sensors measure.
        """
        feedback = self._feedback
        step = stride.step
        if any(estimate.down) and stride.swing.share > feedback.early_touchdown:
            # The feet that feel the ground stay where they are, while others come down: they are raised by as much as
            # the lift descends in this sample, or lowered while it still ascends. `has_contact` counts as 1 or 0.
            descent = self._lift_at(before.swing.share) - self._lift_at(stride.swing.share)
            stride = self._raise_swing_feet(
                stride, [descent * has_contact for has_contact in estimate.down]
            )

        is_swinging = step.active and step.time > step.transfer
        if any(estimate.hangs) and feedback.late_touchdown and is_swinging:
            # Each stance foot that hangs goes down by its distance. Heights are measured from the middle of the stance
            # feet: as the middle goes down, the swing foot and the root become higher above it. The distances point
            # down, so the tilt of the line between the stance feet changes by minus their slope.
            distances = [hangs * feedback.search_speed * self._period for hangs in estimate.hangs]
            mean = sum(distances) / len(distances)
            slope_of_distances = slope_through(
                self._stance.slope_weights[int(step.standing)], distances
            )
            stride = stride._replace(
                ground=stride.ground._replace(
                    height=stride.ground.height + mean,
                    tilt=stride.ground.tilt - slope_of_distances,
                ),
                trunk=stride.trunk._replace(rise=stride.trunk.rise + mean),
            )
        return stride

    def _raise_swing_feet(self, stride: Stride, distances: Sequence[float]) -> Stride:
        """Raise each foot of the swing group by its own distance [m]. If all distances are 0, nothing changes.

        This raises the ground that is expected below the feet: its mean height, and its slope between the feet.
        """
        if not any(distances):
            return stride
        slope_weights = self._stance.slope_weights[1 - int(stride.step.standing)]
        ground = stride.ground._replace(
            height=stride.ground.height + sum(distances) / len(distances),
            foot_tilt=stride.ground.foot_tilt + slope_through(slope_weights, distances),
        )
        return stride._replace(ground=ground)

    def _advance(
        self, stride: Stride, command: Command, estimate: Estimate | None, xi: complex, lift: float
    ) -> Stride:
        """Advance the time, and go over to the other foot if the swing foot has landed.

        The foot may touch from the share `early_touchdown` of its swing on. After the planned time of the landing, a
        foot that does not touch goes on down for the time `late_touchdown` [s], and then counts as landed. Without an
        estimate, the foot lands at the planned time.

        Args:
            stride: references of this sample.
            command: desired motion.
            estimate: what the sensors measure, or None to walk without feedback.
            xi: reference of the divergent component [m].
            lift: height of the swing foot above the expected ground [m].

        Returns:
            The state of the walk for the next sample: the same step, the next one, or a robot that stands.
        """
        step = stride.step
        if not step.active:
            return stride
        feedback = self._feedback
        time = step.time + self._period
        stride = stride._replace(step=step._replace(time=time))

        can_touch = stride.swing.share > feedback.early_touchdown
        touches = estimate is not None and estimate.touches and can_touch
        is_due = time >= stride.landing.time - _SAME_TIME
        if not is_due and not touches:
            return stride
        # A foot that is due but does not feel the ground goes on down for a while.
        if estimate is not None and not touches and step.late < feedback.late_touchdown:
            return self._search_ground(stride, estimate)

        # A large error cannot wait for the weight transfer: the next foot lifts at once.
        error = abs(self._outside_deadband(estimate.xi - xi)) if estimate is not None else 0.0
        hurries = estimate is not None and error > feedback.hurry_threshold
        if estimate is not None and not hurries:
            # A step that answers an error has another length than planned on purpose: nothing is learnt from it.
            stride = self._trim_speed(stride)
        return self._change_feet(stride, command, estimate, lift, hurries=hurries)

    def _search_ground(self, stride: Stride, estimate: Estimate) -> Stride:
        """Lower the swing feet that are late, and count their time. Feet that feel the ground stay.

        Without force sensors, all feet of the group go down.
        """
        step = stride.step._replace(late=stride.step.late + self._period)
        descent = self._feedback.search_speed * self._period
        # 0 for a foot with contact, which counts as 1, and -descent for the others.
        distances = [has_contact * descent - descent for has_contact in estimate.down]
        if not distances:
            swinging = stride.step.sides[1]
            distances = [-descent] * len(self._stance.offsets[swinging])
        return self._raise_swing_feet(stride._replace(step=step), distances)

    def _trim_speed(self, stride: Stride) -> Stride:
        """Learn from a step that was too short or too long: change `speed_trim` by a part of the distance it lacks.

        The step lacks the distance that the command asks for in the time that the step took, minus the distance that
        the foot has gone. The lack of a step that was too long is negative.
        """
        step = stride.step
        # The landing that the command itself asks for, without the corrections that are learnt.
        commanded = self.steps.plan_landing(step.sides[1], step.command)
        lack = commanded.place - stride.swing.place
        # A step that took longer than planned lacks more, and one that ended early lacks less. The distance of the foot
        # is that of the robot divided by the roll factor: feet that are balls roll over the remaining distance.
        extra_time = step.time - step.nominal
        lack += extra_time / self._stance.roll_factor * step.speed

        gain = self._feedback.speed_integral / self._parameters.step_time
        speed_trim = _clamp_parts(stride.corrections.speed_trim + gain * lack, _LARGEST_TRIM)
        return stride._replace(corrections=stride.corrections._replace(speed_trim=speed_trim))

    def _change_feet(
        self,
        stride: Stride,
        command: Command,
        estimate: Estimate | None,
        lift: float,
        *,
        hurries: bool,
    ) -> Stride:
        """Stand on the foot that has landed, and begin the next step or end the walk.

        Args:
            stride: state at the end of a step.
            command: desired motion.
            estimate: what the sensors measure, or None to walk without feedback.
            lift: height at which the foot has landed above the expected ground [m].
            hurries: whether the next foot lifts at once, as there is a large error.

        Returns:
            The state as seen from the foot that has landed, with the next step, or of a robot that stands.
        """
        swinging = stride.step.sides[1]
        # Where the foot would stand at the end of a walk: next to the stance foot, on even ground.
        next_to_stance_foot = Landing(stride.landing.time, self.steps.standing_places[swinging])
        side_by_side = self._shift_to_even_ground(stride, estimate, next_to_stance_foot)
        distance = abs(stride.swing.place - side_by_side.place)
        turn_back = abs(stride.corrections.turn_back)

        # An early foot has met higher ground: its present height is that of the ground.
        ground = stride.ground._replace(height=stride.ground.height + lift)
        stride = stride._replace(ground=ground).on_the_other_foot()
        # The walk ends side by side, and only if neither the present command nor that of the ended step is a motion.
        is_settled = max(distance / _END_DISTANCE, turn_back / _END_TURN) <= 1.0 and not hurries
        if is_settled and not (command.moves or stride.step.command.moves):
            middle = self.steps.middle(swinging, stride.swing.place)
            return stride._replace(
                step=stride.step._replace(active=0.0, zmp_from=middle),
                trunk=stride.trunk._replace(zmp=middle),
            )
        return self._begin_step(stride, command, hurries=hurries)

    def _part(self, rate: float) -> float:
        """Part of its error that a first-order lag with a rate [1/s] removes in one sample [1]."""
        return 1.0 - math.exp(-rate * self._period)

    def _outside_deadband(self, error: complex, deadbands: float = 1.0) -> complex:
        """Reduce each part of an error of the divergent component by its deadband. A part within it becomes 0.

        Args:
            error: error ahead (real part) and to the left (imaginary part) [m].
            deadbands: multiple of the deadband that is ignored [1].
        """
        ahead, left = self._feedback.deadband
        return complex(
            math.copysign(max(abs(error.real) - deadbands * ahead, 0.0), error.real),
            math.copysign(max(abs(error.imag) - deadbands * left, 0.0), error.imag),
        )


def _clamp_parts(value: complex, limits: tuple[float, float]) -> complex:
    """Limit the real part and the imaginary part of a complex number, each by its own limit."""
    limit_ahead, limit_left = limits
    return complex(clamp(value.real, limit_ahead), clamp(value.imag, limit_left))
