r"""The walking engine: from a command, and what the robot does, to a posture at each sample.

In each step the divergent component :math:`\xi` of a pendulum (:mod:`pendulum`) goes where the next steps need it, and
the centre of mass comes after it, :math:`\dot c = \omega (\xi - c)`; the legs put the feet where they shall be. With
feedback, an error of :math:`\xi` changes place and time of the landing (:mod:`steps`), and the reference of the centre
of mass and of the trunk's lean come to what is measured, so that the joints do not push against a fall but step after
it. A step ends when the foot touches.
"""

from __future__ import annotations

import math
from cmath import exp as turned_by
from collections.abc import Iterable, Sequence
from dataclasses import replace

from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector
from simrob_drake.walking.body import Body, Seen
from simrob_drake.walking.figures import Feedback, WalkingFigures
from simrob_drake.walking.measured import Measured, planes, sloped, uphill
from simrob_drake.walking.pendulum import weights
from simrob_drake.walking.steps import Command, Divergent, Landing, Steps, within
from simrob_drake.walking.stride import Stride, eased, gone

_FIRST_ROUNDS, _SETTLINGS = 10, 12  # of Newton's method, from a posture that may be far away; of the centre of mass
_LINES = 8  # that tell of a slope before the first step, each by what those before it left
_TOGETHER = 0.01  # how near to its place a foot stands when a walk ends [m]
_SQUARE = 0.02  # the turn back at most with which it ends: a turn that was commanded is gone to its end [rad/s]
_LANDS = 0.03  # before landing, in which the foothold stays [s]
_TOUCHES = 0.001  # over the lowest foot [m]
_TRIM = 0.15, 0.1  # most that is added to speeds, ahead and sideways [m/s]
_STILL = 2.0  # times what is let be of a walk is let be of a robot that stands
_BRACED, _OVER = 0.2, 0.5  # how long an error must be over [s], and below which part of what braces a robot it is
_DOUBTED = 0.1  # part of what is learnt else, while steps answer an error
_COUNTER = 0.15, 0.15  # most of a counter-lean, to the right and ahead [rad]
_SAG = 0.03, 0.03  # most that is learnt of the distance from the reference [m]
_ASIDE = 0.3  # most of a turn back [rad/s]


class Engine:
    """Makes a walk, sample by sample; it remembers nothing but what a :class:`Stride` and a posture tell."""

    def __init__(self, body: Body, figures: WalkingFigures, groups: Sequence[Sequence[int]], period: float) -> None:
        """Prepare.

        Args:
            body: the robot's kinematics.
            figures: of its walk.
            groups: the feet that stand and swing together, the right ones first.
            period: between samples [s].
        """
        self.body, self._figures, self._groups, self._period = body, figures, groups, period
        homes = [complex(*home[:2]) + 1j * math.copysign(figures.widen, home[1]) for home in body.homes]
        middles = [sum(homes[foot] for foot in group) / len(group) for group in groups]
        self._about = [[homes[foot] - middle for foot in group] for group, middle in zip(groups, middles, strict=True)]
        self._planes = [planes(about) for about in self._about]
        self._turns = figures.fastest.turn_deg > 0
        self._rolls = 1.0 + body.over / (figures.height - body.over)
        self.steps = Steps(figures, 0.5 * (middles[1] - middles[0]).imag, self._rolls)

    def standing(self, posture: Vector, slope: complex = 0j) -> tuple[Stride, Vector]:
        """Return a stride in which both feet stand side by side, and its posture (n,), found from one that is alike."""
        foot = self.steps.beside(0)
        middle = self.steps.middle(1, foot)
        stride = Stride(foot=foot, landing=foot, com=middle, zmp=middle, zmp_from=middle, slope=slope)
        for _ in range(_SETTLINGS):
            self.body.take(posture)
            posture = self._posture(stride, self.body.centre(), 0.0, _FIRST_ROUNDS)
        return stride, posture

    def measured(self, stride: Stride, seen: Seen, forces: Sequence[float] | None = None) -> Measured:
        """Return what the robot does, from the foot that stands; ``forces`` on its feet, if they are known [N]."""
        here, there = (self._groups[place] for place in self._both(stride))
        places = [seen.feet[foot].GetAsMatrix34().tolist() for foot in here]
        points = [complex(x[3], y[3]) for x, y, _ in places]
        origin = sum(points) / len(points)
        if len(places) > 1:  # balls roll and turn with their legs; the line between them does not
            about = zip(points, self._about[int(stride.standing)], strict=True)
            ahead = sum((point - origin) * place.conjugate() for point, place in about)
        else:
            ahead = sum(complex(x[0], y[0]) for x, y, _ in places)
        turn = ahead.conjugate() / abs(ahead)
        (x, y, z), (vx, vy, _) = seen.com.tolist(), seen.speed.tolist()
        com, speed = turn * (complex(x, y) - origin), turn * complex(vx, vy) / self._rolls
        omega = self._omega(max(z - min(seen.lowest), 0.05))
        forward, sideways, up = seen.trunk.matrix().tolist()
        heading = math.atan2(sideways[0], forward[0])
        slope = self._sloping(stride, places, turn)
        told = self._figures.feedback
        if forces is not None and told is not None and told.touch is not None:
            down = tuple(forces[foot] > told.touch for foot in there)
            hangs = tuple(forces[foot] < told.touch for foot in here)
            touches = all(down)
        else:
            down = hangs = ()
            lowest = seen.lowest
            stands = sum(lowest[foot] for foot in here) / len(here)
            swung = (complex(*seen.feet[foot].translation()[:2].tolist()) - origin for foot in there)
            over = (lowest[foot] - uphill(stride.slope, turn * at) for foot, at in zip(there, swung, strict=True))
            touches = min(over) < stands + _TOUCHES
        return Measured(com, com + speed / omega, up[1], -up[0], heading, slope, touches, down, hangs)

    def _omega(self, height: float) -> float:
        """Return that of the pendulum [1/s]: its point comes after it where feet are balls, and it falls slower."""
        return math.sqrt(STANDARD_GRAVITY / (height * self._rolls))

    def _sloping(self, stride: Stride, places: Sequence[Sequence[Sequence[float]]], turn: complex) -> complex:
        """Return the slope under feet that stand: that of their soles; where they are balls, along their line alone."""
        if not self.body.over:
            tilted = sum(complex(x[2], y[2]) for x, y, _ in places)
            return -turn * tilted / max(sum(z[2] for _, _, z in places), 0.5)
        standing, known = int(stride.standing), stride.slope + stride.tilt
        feet = zip(self._about[standing], places, strict=True)
        return known + sloped(self._planes[standing], [z[3] - uphill(known, at) for at, (_, _, z) in feet])

    def slope(self, seen: Seen) -> complex:
        """Return the slope under all feet of a robot that stands, each group telling of it in turn."""
        stride = Stride(standing=0.0)
        for _ in range(_LINES):
            slope = self.measured(stride, seen).slope
            stride = stride.changed(slope=slope, standing=1.0 - stride.standing)
        return slope

    def sample(
        self, stride: Stride, posture: Vector, command: Command, measured: Measured | None
    ) -> tuple[Stride, Vector]:
        """Return where a walk is a sample later, and its posture (n,); without feedback if nothing is measured."""
        self.body.take(posture)
        centre = self.body.centre()
        omega = self._omega(self._figures.height + centre[2])
        told = self._figures.feedback if measured is not None else None
        if measured is not None:
            measured = replace(measured, com=measured.com - stride.sag, xi=measured.xi - stride.sag)
        stride, xi = self._planned(stride, command, omega, told, measured)
        before, (stride, lift) = stride, self._swung(stride)
        if told is not None and measured is not None:
            if stride.share > told.early:
                stride = self._found(before, stride, measured.down)
            stride = self._lowered(stride, told, measured.hangs)
            stride = self._followed(stride, told, measured, xi)
        com = stride.com + (1.0 - math.exp(-omega * self._period)) * (xi - stride.com)
        stride = stride.changed(com=com)
        posture = self._posture(stride, centre, lift)
        return self._later(stride, command, told, measured, xi, lift), posture

    def _followed(self, stride: Stride, told: Feedback, measured: Measured, xi: complex) -> Stride:
        """Return the stride with its references nearer to what is measured, and what lasts of the difference learnt."""
        if stride.braced > 0:
            return stride  # its soles tilt on a floor that does not
        if not stride.steps or self.steps.transfer < stride.transfer > stride.time:
            grounded = stride.slope + self._part(told.ground) * (measured.slope - stride.slope)
            return stride.changed(slope=grounded)  # it stands on both feet, and stiff: they hold it
        follows, returns = self._part(told.lean_follow), 1.0 - self._part(told.lean_return)
        lean = returns * (stride.lean + follows * (measured.lean - stride.lean))
        pitch = returns * (stride.pitch + follows * (measured.pitch - stride.pitch))
        com = stride.com + self._part(told.follow) * (measured.com - stride.com)
        rise = stride.rise - self._part(told.level) * stride.rise
        tilt = stride.tilt + self._part(told.even) * (measured.slope - stride.slope - stride.tilt)
        calm = _DOUBTED if _beyond(measured.xi - xi, told) else 1.0  # who is pushed stands on the edges of its soles
        counter = stride.counter - calm * told.upright * self._period * complex(measured.lean, measured.pitch)
        stride = stride.changed(
            slope=stride.slope + self._part(calm * told.ground) * (measured.slope - stride.slope),
            sag=_clipped(stride.sag + self._part(calm * told.learns) * (measured.com - stride.com), _SAG),
            counter=_clipped(counter, _COUNTER),
        )
        return stride.changed(com=com, lean=lean, pitch=pitch, rise=rise, tilt=tilt)

    # Where the divergent component and the feet go

    def _planned(
        self, stride: Stride, command: Command, omega: float, told: Feedback | None, measured: Measured | None
    ) -> tuple[Stride, complex]:
        """Return the stride with its landing decided, and where the divergent component shall be."""
        steps = self.steps
        if not stride.steps:
            off = measured.xi - stride.zmp if told is not None and measured is not None else 0j
            error = _beyond(off, told, _STILL)
            if stride.braced > 0:
                over = told is None or told.braces is None or abs(off.imag) < _OVER * told.braces
                return stride.changed(braced=stride.braced - self._period if over else _BRACED), stride.zmp
            if command.moves or error:
                stride = self._begun(stride, command, error)
                stride = stride if measured is None else stride.changed(course=measured.heading)
            else:
                return stride, stride.zmp
        if told is not None and measured is not None and self._turns:
            off = math.remainder(stride.course - measured.heading, math.tau)
            stride = stride.changed(
                aside=within(told.holds * off, _ASIDE), course=stride.course + command.turn * self._period
            )
        standing = int(stride.standing)
        rest, planned = steps.rest_point(standing), steps.planned(1 - standing, stride.trimmed)
        planned = Landing(stride.nominal, planned.place, planned.yaw)
        share = min(stride.time / stride.transfer, 1.0) if stride.transfer > 0 else 1.0
        stride = stride.changed(zmp=stride.zmp_from + share * (rest - stride.zmp_from))
        after = steps.after(standing, stride.trimmed, omega)
        if told is None or measured is None:
            stride = stride.landing_at(planned)
        elif stride.time <= stride.ends - _LANDS:
            own = self._wanted(stride, Landing(stride.ends, planned.place), omega, rest, after)
            error = _beyond(measured.xi - own, told)
            if error:
                held = _clipped(told.push * error, told.edge)
                now = Divergent(own + error, omega, stride.time, stride.transfer, stride.zmp + held, rest + held)
                planned = steps.adjusted(1 - standing, planned, now, stride.foot, after)
            stride = stride.landing_at(planned)
        xi = self._wanted(stride, Landing(stride.ends, stride.landing), omega, rest, after)
        if told is None or measured is None or abs((measured.xi - xi).imag) < (told.braces or math.inf):
            return stride, xi
        middle = steps.middle(standing, stride.foot)
        stride = stride.changed(steps=0.0, braced=_BRACED, speed=0j, turn=0.0, zmp=middle, zmp_from=middle)
        return stride, middle

    def _wanted(
        self, stride: Stride, landing: Landing, omega: float, rest: complex, after: tuple[float, complex]
    ) -> complex:
        """Return where the divergent component must be now for a landing."""
        left = max(landing.time - stride.time, 0.0)
        start, stays, end = weights(omega, left, min(max(stride.transfer - stride.time, 0.0), left))
        return start * stride.zmp + stays * rest + end * ((1.0 - after[0]) * landing.place + after[1])

    def _begun(self, stride: Stride, command: Command, error: complex) -> Stride:
        """Return a first step: at leisure with the right foot, or at once with the foot on the side of an error."""
        if error and error.imag * (stride.standing - 0.5) > 0:
            stride = stride.on_the_other_foot()
        settle = 0.0 if error else self._figures.settle
        stride = self._next(stride, command, hurries=bool(error))
        ends = settle + self._figures.step_time
        begins = {"steps": 1.0, "time": 0.0, "share": 0.0, "heading_from": stride.heading}
        return stride.changed(transfer=settle, nominal=ends, ends=ends, **begins)

    def _next(self, stride: Stride, command: Command, *, hurries: bool) -> Stride:
        """Return a step that begins now."""
        figures = self._figures
        told = stride.command.nearer(command, figures.quicken)
        transfer = 0.0 if hurries else self.steps.transfer
        time = figures.step_time
        return stride.changed(transfer=transfer, nominal=time, ends=time, speed=told.speed, turn=told.turn)

    def _swung(self, stride: Stride) -> tuple[Stride, float]:
        """Return the stride with its foot further on its way, and how high that is [m]."""
        after = stride.time + self._period
        length = stride.ends - stride.transfer
        if not stride.steps or after <= stride.transfer or length <= 0:
            return stride, 0.0
        share = max(min((after - stride.transfer) / length, 1.0), stride.share)
        part = gone(stride.share, share)
        foot = stride.foot + part * (stride.landing - stride.foot)
        yaw = stride.foot_yaw + part * (stride.landing_yaw - stride.foot_yaw)
        way = eased(min(after / stride.ends, 1.0))
        heading = stride.heading_from + way * (stride.landing_yaw - stride.heading_from)
        early = max(self._figures.feedback.early, 0.1) if self._figures.feedback is not None else 1.0
        stays = 1.0 - gone(stride.share / early, share / early)  # before the ground may be felt, and then no more
        height, tilt = stride.height * stays, stride.foot_tilt * stays
        stride = stride.changed(foot=foot, foot_yaw=yaw, share=share, heading=heading, height=height, foot_tilt=tilt)
        return stride, self._lift(share)

    def _lift(self, share: float) -> float:
        return float(self._figures.lift * (4.0 * share * (1.0 - share)) ** self._figures.rises)

    def _found(self, before: Stride, stride: Stride, down: Sequence[bool]) -> Stride:
        """Return the stride with the feet that feel the ground as high as before, while others come down."""
        sunk = self._lift(before.share) - self._lift(stride.share)
        return self._raised(stride, [sunk * each for each in down])

    def _lowered(self, stride: Stride, told: Feedback, hangs: Sequence[bool]) -> Stride:
        """Return the stride with the feet that should stand and feel nothing further down, if late ones are sought."""
        if not (any(hangs) and told.late and stride.steps and stride.time > stride.transfer):
            return stride
        ways = [each * told.search * self._period for each in hangs]
        tilt = stride.tilt - sloped(self._planes[int(stride.standing)], ways)
        mean = sum(ways) / len(ways)
        return stride.changed(tilt=tilt, height=stride.height + mean, rise=stride.rise + mean)

    def _raised(self, stride: Stride, ways: Sequence[float]) -> Stride:
        """Return the stride with each foot that swings raised by a way of its own [m]; none where none are told."""
        if not any(ways):
            return stride
        tilt = stride.foot_tilt + sloped(self._planes[1 - int(stride.standing)], ways)
        return stride.changed(height=stride.height + sum(ways) / len(ways), foot_tilt=tilt)

    def _later(
        self,
        stride: Stride,
        command: Command,
        told: Feedback | None,
        measured: Measured | None,
        xi: complex,
        lift: float,
    ) -> Stride:
        """Return the stride at the next sample, perhaps on the other foot."""
        if not stride.steps:
            return stride
        stride = stride.changed(time=stride.time + self._period)
        touches = told is not None and measured is not None and measured.touches and stride.share > told.early
        if stride.time < stride.ends - 1e-9 and not touches:
            return stride
        if told is not None and not touches and stride.waits < told.late:
            down = measured.down if measured is not None else ()
            lower = told.search * self._period
            ways = [each * lower - lower for each in down] or [-lower] * len(self._about[1 - int(stride.standing)])
            return self._raised(stride.changed(waits=stride.waits + self._period), ways)
        error = _beyond(measured.xi - xi, told) if measured is not None else 0j
        off = abs(stride.foot - self.steps.beside(1 - int(stride.standing)))
        if told is not None and abs(error) <= told.hurry:
            way = self.steps.planned(1 - int(stride.standing), stride.command).place - stride.foot
            way += (stride.time - stride.nominal) / self._rolls * stride.speed
            trim = stride.trim + told.cruise / self._figures.step_time * way
            stride = stride.changed(trim=_clipped(trim, _TRIM))
        stride = stride.changed(height=stride.height + lift).on_the_other_foot()
        hurries = told is not None and abs(error) > told.hurry
        ends = max(off / _TOGETHER, abs(stride.aside) / _SQUARE) <= 1.0 and not hurries
        if ends and not (command.moves or stride.command.moves):
            middle = self.steps.middle(int(stride.standing), stride.foot)
            return stride.changed(steps=0.0, zmp=middle, zmp_from=middle)
        return self._next(stride, command, hurries=hurries)

    # Postures

    def _posture(self, stride: Stride, centre: Vector, lift: float, rounds: int = 1) -> Vector:
        """Return the posture (n,) of a stride whose foot is ``lift`` high, from the one that the body took."""
        figures, body = self._figures, self.body
        pitch = math.radians(figures.pitch_deg) + stride.pitch + stride.counter.imag
        rotation = RotationMatrix.MakeZRotation(stride.heading).multiply(RotationMatrix.MakeYRotation(pitch))
        rotation = rotation.multiply(RotationMatrix.MakeXRotation(stride.lean + stride.counter.real))
        x, y, _ = rotation.multiply(centre).tolist()
        root = RigidTransform(rotation, [stride.com.real - x, stride.com.imag - y, figures.height + stride.rise])
        ahead, left = _pair(stride.slope)
        ground = RotationMatrix.MakeYRotation(-math.atan(ahead)).multiply(RotationMatrix.MakeXRotation(math.atan(left)))
        swings = ground.multiply(RotationMatrix.MakeZRotation(stride.foot_yaw))
        turned, here = turned_by(1j * stride.foot_yaw), int(stride.standing)
        feet: dict[int, RigidTransform] = {}

        def put(group: int, turn: RotationMatrix, places: Iterable[complex], height: float, tilt: complex) -> None:
            for foot, place, about in zip(self._groups[group], places, self._about[group], strict=True):
                up = body.over + height + uphill(stride.slope, place) + uphill(tilt, about)
                feet[foot] = RigidTransform(turn, [place.real, place.imag, up])

        put(here, ground, self._about[here], 0.0, stride.tilt)
        moved = (stride.foot + turned * about for about in self._about[1 - here])
        put(1 - here, swings, moved, stride.height + lift, stride.foot_tilt)
        return body.reached(root, [feet[foot] for foot in range(len(feet))], rounds)

    def felt(self, stride: Stride) -> Sequence[int]:
        """Return the feet whose forces count: those that may touch, and those that stand while late ones are sought."""
        told, (here, there) = self._figures.feedback, self._both(stride)
        if told is None:
            return ()
        down = self._groups[there] if stride.share > told.early else ()
        return (*down, *(self._groups[here] if told.late else ()))

    def _both(self, stride: Stride) -> tuple[int, int]:
        """Return the places of the feet that stand and of those that swing."""
        return int(stride.standing), 1 - int(stride.standing)

    def _part(self, rate: float) -> float:
        """Return by how much a value that goes at a rate [1/s] comes nearer in a sample."""
        return 1.0 - math.exp(-rate * self._period)


def _beyond(error: complex, told: Feedback | None, times: float = 1.0) -> complex:
    """Return an error of the divergent component without some times of what is let be."""
    if told is None:
        return 0j
    ahead, left = (times * part for part in told.let_be)
    return complex(
        math.copysign(max(abs(error.real) - ahead, 0.0), error.real),
        math.copysign(max(abs(error.imag) - left, 0.0), error.imag),
    )


def _clipped(place: complex, most: tuple[float, float]) -> complex:
    ahead, left = most
    return complex(within(place.real, ahead), within(place.imag, left))


def _pair(place: complex) -> tuple[float, float]:
    return place.real, place.imag
