r"""Where a walk goes, sample by sample: the divergent component, the landing of each step, and what is learnt.

In each step the divergent component :math:`\xi` of a pendulum (:mod:`pendulum`) goes where the next steps need it, and
the centre of mass comes after it, :math:`\dot c = \omega (\xi - c)`. With feedback, an error of :math:`\xi` changes
place and time of the landing (:mod:`steps`), and the reference of the centre of mass and of the trunk's lean come to
what is estimated, so that the joints do not push against a fall but step after it. A step ends when the foot touches.
"""

import math
from cmath import exp as turned_by
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from simrob_drake.walking.body import StanceFeet, sloped, uphill
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.height_map import HeightMap, Places
from simrob_drake.walking.parameters import Feedback, WalkingParameters
from simrob_drake.walking.steps import Command, Divergent, Landing, Steps, weights, within
from simrob_drake.walking.stride import Ground, Learnt, Stride, Swing, Trunk, eased, gone

_TOGETHER = 0.01  # how near to its place a foot stands when a walk ends [m]
_SQUARE = 0.02  # the turn back at most with which it ends: a turn that was commanded is gone to its end [rad/s]
_LANDS = 0.03  # before landing, in which the foothold stays [s]
_TRIM = 0.15, 0.1  # most that is added to speeds, ahead and sideways [m/s]
_STILL = 2.0  # times the error that a walk ignores, of a robot that stands
_BRACED, _OVER = 0.2, 0.5  # how long an error must be over [s], and below which part of what braces a robot it is
_DOUBTED = 0.1  # part of what is learnt else, while steps answer an error
_COUNTER = 0.15, 0.15  # most of a counter-lean, to the right and ahead [rad]
_SAG = 0.03, 0.03  # most that is learnt of the distance from the reference [m]
_TURN_BACK = 0.3  # most of a turn back [rad/s]


class WalkPlanner:
    """Plans a walk, sample by sample; it remembers nothing but what a :class:`Stride` tells."""

    def __init__(
        self, parameters: WalkingParameters, stance: StanceFeet, period: float, height_map: HeightMap | None = None
    ) -> None:
        """Prepare; ``period`` is between samples [s], ``height_map`` of a ground that is known."""
        self._parameters, self._stance, self._period, self._map = parameters, stance, period, height_map
        self._turns = parameters.max_speed.turn_deg > 0
        self.steps = Steps(parameters, stance.half, stance.rolls)
        self._reacts, self._feedback = parameters.feedback is not None, parameters.feedback or Feedback()
        # the part of a swing before the ground may be felt
        self._blind_part = max(self._feedback.early_touchdown, 0.1) if self._reacts else 1.0

    def sample(
        self, stride: Stride, command: Command, estimate: Estimate | None, omega: float
    ) -> tuple[Stride, float, Stride]:
        """Return where a walk is a sample later, how high its foot is then [m], and where the next sample begins.

        Args:
            stride: where it is.
            command: what it is asked for.
            estimate: what the robot does; None: it goes without feedback.
            omega: of the pendulum [1/s].
        """
        if estimate is not None:
            sag = stride.learnt.sag
            estimate = Estimate(estimate.com - sag, estimate.xi - sag, *estimate[2:]) if self._reacts else None
        stride, xi = self._planned(stride, command, omega, estimate)
        before, (stride, lift) = stride, self._swung(stride, estimate)
        if estimate is not None:
            stride = self._felt(before, stride, estimate)
            stride = self._followed(stride, estimate, xi)
        com = stride.trunk.com
        trunk = Trunk(com + (1.0 - math.exp(-omega * self._period)) * (xi - com), *stride.trunk[1:])
        stride = Stride(stride.step, stride.swing, stride.landing, trunk, stride.ground, stride.learnt)
        return stride, lift, self._later(stride, command, estimate, xi, lift)

    def _followed(self, stride: Stride, estimate: Estimate, xi: complex) -> Stride:
        """Return the stride with its references nearer to the estimate, and what lasts of the difference learnt."""
        (step, swing, landing, trunk, ground, learnt), feedback, part = stride, self._feedback, self._part
        if step.braced > 0:
            return stride  # its soles tilt on a floor that does not
        if not step.active or self.steps.transfer < step.transfer > step.time:
            grounded = ground.slope + part(feedback.slope_rate) * (estimate.slope - ground.slope)
            return stride._replace(ground=ground._replace(slope=grounded))  # it stands stiff on both feet: they hold it
        follows, returns = part(feedback.lean_rate), 1.0 - part(feedback.upright_rate)
        calm = _DOUBTED if self._beyond(estimate.xi - xi) else 1.0  # who is pushed stands on the edges of soles
        slope = ground.slope + part(calm * feedback.slope_rate) * (estimate.slope - ground.slope)
        tilt = ground.tilt + part(feedback.level_rate) * (estimate.slope - ground.slope - ground.tilt)
        sag = learnt.sag + part(calm * feedback.offset_rate) * (estimate.com - trunk.com)
        counter = learnt.counter - calm * feedback.lean_integral * self._period * complex(estimate.lean, estimate.pitch)
        followed = Trunk(
            trunk.com + part(feedback.com_rate) * (estimate.com - trunk.com),
            trunk.zmp,
            trunk.heading,
            returns * (trunk.lean + follows * (estimate.lean - trunk.lean)),
            returns * (trunk.pitch + follows * (estimate.pitch - trunk.pitch)),
            trunk.rise - part(feedback.height_rate) * trunk.rise,
            trunk.desired_heading,
        )
        learnt = Learnt(_clipped(counter, _COUNTER), _clipped(sag, _SAG), learnt.trim, learnt.turn_back)
        return Stride(step, swing, landing, followed, Ground(ground.height, slope, tilt, ground.foot_tilt), learnt)

    def _planned(
        self, stride: Stride, command: Command, omega: float, estimate: Estimate | None
    ) -> tuple[Stride, complex]:
        """Return the stride with its landing decided, and where the divergent component shall be."""
        if not stride.step.active:
            stride = self._started(stride, command, estimate)
            if not stride.step.active:
                return stride, stride.trunk.zmp
        feedback, steps = self._feedback, self.steps
        step, swing, landing, trunk, ground, learnt = stride
        heading = trunk.desired_heading
        if estimate is not None and self._turns:
            off = math.remainder(heading - estimate.heading, math.tau)
            learnt = Learnt(*learnt[:3], within(feedback.heading_gain * off, _TURN_BACK))
            heading += command.turn * self._period
        standing, trimmed = int(step.standing), Command(step.speed + learnt.trim, step.turn + learnt.turn_back)
        rest, (_, place, yaw) = steps.rest_points[standing], steps.planned(1 - standing, trimmed)
        planned = self._on_even_ground(stride, estimate, Landing(step.nominal, place, yaw))
        place = planned.place
        share = min(step.time / step.transfer, 1.0) if step.transfer > 0 else 1.0
        zmp = step.zmp_from + share * (rest - step.zmp_from)
        after = steps.after(standing, trimmed, omega)

        def xi_for(time: float, place: complex) -> complex:
            """Return where the divergent component must be now for a landing."""
            left = max(time - step.time, 0.0)
            start, stays, end = weights(omega, left, min(max(step.transfer - step.time, 0.0), left))
            return start * zmp + stays * rest + end * ((1.0 - after[0]) * place + after[1])

        if estimate is None:
            landing = planned
        elif step.time <= landing.time - _LANDS:
            own = xi_for(landing.time, place)
            error = self._beyond(estimate.xi - own)
            if error:
                alone = len(self._stance.groups[standing]) == 1  # a trot would only hasten
                if alone and step.time < step.transfer <= steps.transfer:  # it lifts at once: its step is the answer
                    step, zmp = step._replace(transfer=step.time), rest
                held = _clipped(feedback.zmp_gain * error, feedback.zmp_limit)
                now = Divergent(own + error, omega, step.time, step.transfer, zmp + held, rest + held)
                planned = steps.adjusted(1 - standing, planned, now, swing.place, after)
                planned = self._on_even_ground(stride, estimate, planned)
            landing = planned
        xi = xi_for(landing.time, landing.place)
        limit = feedback.brace_threshold
        if estimate is not None and limit is not None and abs((estimate.xi - xi).imag) >= limit:
            xi = zmp = steps.middle(standing, swing.place)
            step = step._replace(active=0.0, braced=_BRACED, speed=0j, turn=0.0, zmp_from=zmp)
        return Stride(step, swing, landing, Trunk(trunk.com, zmp, *trunk[2:6], heading), ground, learnt), xi

    def _started(self, stride: Stride, command: Command, estimate: Estimate | None) -> Stride:
        """Return the stride of a robot that stands, with its first step begun if there is a reason to."""
        step, limit = stride.step, self._feedback.brace_threshold
        off = estimate.xi - stride.trunk.zmp if estimate is not None else 0j
        if step.braced > 0:
            over = limit is None or abs(off.imag) < _OVER * limit
            return stride._replace(step=step._replace(braced=step.braced - self._period if over else _BRACED))
        error = self._beyond(off, _STILL)
        if not (command.moves or error):
            return stride
        stride = self._begun(stride, command, error)
        heading = stride.trunk.desired_heading if estimate is None else estimate.heading
        return stride._replace(trunk=stride.trunk._replace(desired_heading=heading))

    def _begun(self, stride: Stride, command: Command, error: complex) -> Stride:
        """Return a first step: at leisure with the right foot, or at once with the foot on the side of an error."""
        if error and error.imag * (stride.step.standing - 0.5) > 0:
            stride = stride.on_the_other_foot()
        settle = 0.0 if error else self._parameters.settle
        stride = self._next(stride, command, hurries=bool(error))
        ends = settle + self._parameters.step_time
        begun = stride.step._replace(
            active=1.0, time=0.0, transfer=settle, nominal=ends, heading_from=stride.trunk.heading
        )
        return stride._replace(
            step=begun, swing=stride.swing._replace(share=0.0), landing=stride.landing._replace(time=ends)
        )

    def _next(self, stride: Stride, command: Command, *, hurries: bool) -> Stride:
        """Return a step that begins now."""
        step, time = stride.step, self._parameters.step_time
        speed, turn = step.command.nearer(command, self._parameters.max_speed_change)
        transfer = 0.0 if hurries else self.steps.transfer
        begun = step._replace(transfer=transfer, nominal=time, speed=speed, turn=turn)
        return stride._replace(step=begun, landing=stride.landing._replace(time=time))

    def _swung(self, stride: Stride, estimate: Estimate | None) -> tuple[Stride, float]:
        """Return the stride with its foot further on its way, and how high that is [m]."""
        step, swing, landing, trunk, ground, learnt = stride
        after, length = step.time + self._period, landing.time - step.transfer
        if not step.active or after <= step.transfer or length <= 0:
            return stride, 0.0
        share = max(min((after - step.transfer) / length, 1.0), swing.share)
        part, early = gone(swing.share, share, self._parameters.swing_peak), self._blind_part
        way = eased(min(after / landing.time, 1.0))
        heading = step.heading_from + way * (landing.yaw - step.heading_from)
        stays = 1.0 - gone(swing.share / early, share / early)  # before the ground may be felt, and then no more
        swing = Swing(
            swing.place + part * (landing.place - swing.place), swing.yaw + part * (landing.yaw - swing.yaw), share
        )
        trunk = Trunk(trunk.com, trunk.zmp, heading, *trunk[3:])
        if self._map is None or estimate is None:
            ground = Ground(ground.height * stays, ground.slope, ground.tilt, ground.foot_tilt * stays)
        else:
            ground = self._over_map(stride, estimate, share, self._map)
        return Stride(step, swing, landing, trunk, ground, learnt), self._lift(share)

    def _over_map(self, stride: Stride, estimate: Estimate, share: float, known: HeightMap) -> Ground:
        """Return the ground with each swinging foot further on its way to the height of its place on a map.

        Up in the part of the swing before the ground may be felt, down in what comes after it; who feels it stays.
        """
        (here, there), (_, _, before), early = stride.step.sides, stride.swing, self._blind_part
        (height, slope, tilt, foot_tilt), landing, about = stride.ground, stride.landing, self._stance.about[there]
        yaw, level = turned_by(1j * landing.yaw), self._level(estimate, here, known)
        places = [landing.place + yaw * each for each in about]
        found, heights = known.heights([estimate.in_world(place) for place in places]), list[float]()
        late = 1.0 - early
        up = gone(before / early, share / early)
        down = gone(max(before - early, 0.0) / late, max(share - early, 0.0) / late) if late else up
        feels = estimate.down if before > self._feedback.early_touchdown else ()
        for number, (place, each, top) in enumerate(zip(places, about, found, strict=True)):
            now = height + uphill(foot_tilt, each)
            way = top - level - uphill(slope, place) - now
            stays = number < len(feels) and feels[number]
            heights.append(now if stays else now + (up if way > 0 else down) * way)
        middle = sum(heights) / len(heights)
        return Ground(middle, slope, tilt, sloped(self._stance.planes[there], heights))

    def _level(self, estimate: Estimate, group: int, known: HeightMap) -> float:
        """Return how high the ground is under the feet of a group that stands, by a map [m]."""
        heights = known.heights([estimate.in_world(each) for each in self._stance.about[group]])
        return sum(heights) / len(heights)

    def _on_even_ground(self, stride: Stride, estimate: Estimate | None, landing: Landing) -> Landing:
        """Return a landing where the ground is even, if that is known; near that of the last sample."""
        if self._map is None or estimate is None:
            return landing
        swinging, yaw = stride.step.sides[1], turned_by(1j * landing.yaw)
        feet = [estimate.in_world(landing.place + yaw * each) for each in self._stance.about[swinging]]
        chosen = stride.landing.place - landing.place if stride.step.time > 0 else 0j

        def allowed(shifts: Places) -> npt.NDArray[np.bool_]:
            return self.steps.allowed(swinging, landing.place + shifts * estimate.turn)

        level, rise = self._level(estimate, stride.step.sides[0], self._map), self._parameters.foothold.rise
        shift = self._map.shift(feet, chosen * estimate.turn.conjugate(), allowed, level, rise)
        return landing._replace(place=landing.place + shift * estimate.turn)

    def _lift(self, share: float) -> float:
        parameters, held = self._parameters, self._feedback.landing_height * eased(min(2.0 * share, 1.0))
        return float(parameters.lift * (4.0 * share * (1.0 - share)) ** parameters.lift_exponent + held)

    def _felt(self, before: Stride, stride: Stride, estimate: Estimate) -> Stride:
        """Return the stride with its feet where they feel the ground, or seek it.

        Those that swing and feel it stay as high as before, while others come down; those that should stand and feel
        nothing come further down, if late ones are sought.
        """
        step, feedback, (down, hangs) = stride.step, self._feedback, (estimate.down, estimate.hangs)
        if any(down) and stride.swing.share > feedback.early_touchdown:
            sunk = self._lift(before.swing.share) - self._lift(stride.swing.share)
            stride = self._raised(stride, [sunk * each for each in down])
        if any(hangs) and feedback.late_touchdown and step.active and step.time > step.transfer:
            ways = [each * feedback.search_speed * self._period for each in hangs]
            (height, slope, tilt, foot_tilt), trunk = stride.ground, stride.trunk
            tilt -= sloped(self._stance.planes[int(step.standing)], ways)
            mean = sum(ways) / len(ways)
            ground = Ground(height + mean, slope, tilt, foot_tilt)
            stride = stride._replace(ground=ground, trunk=trunk._replace(rise=trunk.rise + mean))
        return stride

    def _raised(self, stride: Stride, ways: Sequence[float]) -> Stride:
        """Return the stride with each foot that swings raised by a way of its own [m]; nothing where none is."""
        if not any(ways):
            return stride
        height, slope, tilt, foot_tilt = stride.ground
        foot_tilt += sloped(self._stance.planes[1 - int(stride.step.standing)], ways)
        return stride._replace(ground=Ground(height + sum(ways) / len(ways), slope, tilt, foot_tilt))

    def _later(self, stride: Stride, command: Command, estimate: Estimate | None, xi: complex, lift: float) -> Stride:
        """Return the stride at the next sample, perhaps on the other foot."""
        step, swing, landing, trunk, ground, learnt = stride
        if not step.active:
            return stride
        feedback, swinging, time = self._feedback, 1 - int(step.standing), step.time + self._period
        step = step._replace(time=time)
        touches = estimate is not None and estimate.touches and swing.share > feedback.early_touchdown
        if time < landing.time - 1e-9 and not touches:
            return Stride(step, swing, landing, trunk, ground, learnt)
        if estimate is not None and not touches and step.late < feedback.late_touchdown:
            lower = feedback.search_speed * self._period
            ways = [each * lower - lower for each in estimate.down] or [-lower] * len(self._stance.about[swinging])
            return self._raised(stride._replace(step=step._replace(late=step.late + self._period)), ways)
        error = abs(self._beyond(estimate.xi - xi)) if estimate is not None else 0.0
        hurries = estimate is not None and error > feedback.hurry_threshold
        if estimate is not None and not hurries:
            way = self.steps.planned(swinging, step.command).place - swing.place
            way += (time - step.nominal) / self._stance.rolls * step.speed
            trim = learnt.trim + feedback.speed_integral / self._parameters.step_time * way
            learnt = learnt._replace(trim=_clipped(trim, _TRIM))
        rests = self._on_even_ground(stride, estimate, Landing(landing.time, self.steps.apart[swinging]))
        off = abs(swing.place - rests.place)
        ground = ground._replace(height=ground.height + lift)
        stride = Stride(step, swing, landing, trunk, ground, learnt).on_the_other_foot()
        ends = max(off / _TOGETHER, abs(learnt.turn_back) / _SQUARE) <= 1.0 and not hurries
        if ends and not (command.moves or step.command.moves):
            middle = self.steps.middle(swinging, stride.swing.place)
            step, trunk = stride.step._replace(active=0.0, zmp_from=middle), stride.trunk._replace(zmp=middle)
            return stride._replace(step=step, trunk=trunk)
        return self._next(stride, command, hurries=hurries)

    def _part(self, rate: float) -> float:
        """Return by how much a value that goes at a rate [1/s] comes nearer in a sample."""
        return 1.0 - math.exp(-rate * self._period)

    def _beyond(self, error: complex, times: float = 1.0) -> complex:
        """Return an error of the divergent component without some times the deadband."""
        ahead, left = self._feedback.deadband
        return complex(
            math.copysign(max(abs(error.real) - times * ahead, 0.0), error.real),
            math.copysign(max(abs(error.imag) - times * left, 0.0), error.imag),
        )


def _clipped(place: complex, most: tuple[float, float]) -> complex:
    ahead, left = most
    return complex(within(place.real, ahead), within(place.imag, left))
