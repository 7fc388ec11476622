"""What a walk remembers from a sample to the next."""

from __future__ import annotations

from cmath import exp as turned_by
from itertools import accumulate, chain
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.walking.parameters import EVENEST, SOFTEST
from simrob_drake.walking.steps import Command, Landing


class Step(NamedTuple):
    """The step that is under way, and the command that it follows.

    Attributes:
        standing: the foot, 0 the right one, 1 the left one.
        active: whether a step is under way; else both stand.
        time: since it began [s].
        transfer: in which the weight goes over at its start [s].
        nominal: when it ends unless disturbed [s].
        late: how long the foot has been late [s].
        braced: for how long the robot stands before it walks on [s].
        zmp_from, heading_from: where zero-moment point and trunk's heading came from [m, rad].
        speed, turn: that the steps follow [m/s, rad/s].
    """

    standing: float = 1.0
    active: float = 0.0
    time: float = 0.0
    transfer: float = 0.0
    nominal: float = 0.0
    late: float = 0.0
    braced: float = 0.0
    zmp_from: complex = 0j
    heading_from: float = 0.0
    speed: complex = 0j
    turn: float = 0.0

    @property
    def sides(self) -> tuple[int, int]:
        """The groups of feet that stand, and that swing."""
        standing = int(self.standing)
        return standing, 1 - standing

    @property
    def command(self) -> Command:
        """What the steps shall come to."""
        return Command(self.speed, self.turn)


class Swing(NamedTuple):
    """The other foot, which swings: where [m], turned by how much [rad], and its share of the way, 0 to 1."""

    place: complex = 0j
    yaw: float = 0.0
    share: float = 0.0


class Trunk(NamedTuple):
    """The references of the trunk.

    Attributes:
        com, zmp: of the centre of mass, and of the zero-moment point [m].
        heading: where it looks, from the foot that stands [rad].
        lean, pitch: to the right and ahead [rad].
        rise: of the root, over its usual height there [m].
        desired_heading: where it shall look in the world [rad].
    """

    com: complex = 0j
    zmp: complex = 0j
    heading: float = 0.0
    lean: float = 0.0
    pitch: float = 0.0
    rise: float = 0.0
    desired_heading: float = 0.0


class Ground(NamedTuple):
    """The ground under the feet.

    Attributes:
        height: under the other foot over that under the foot that stands [m].
        slope: ahead and to the left [1].
        tilt, foot_tilt: of the line between the feet of a pair over that: of those that stand, and that swing [1].
    """

    height: float = 0.0
    slope: complex = 0j
    tilt: complex = 0j
    foot_tilt: complex = 0j


class Learnt(NamedTuple):
    """What lasts of the errors, and is taken out.

    Attributes:
        counter: to lean and pitch, against what the servos give way under the trunk's weight [rad].
        sag: how far the centre of mass lasts to be from its reference [m].
        trim: what the planned speed has beyond the command's, for the way to be as long as that asks [m/s].
        turn_back: turn that brings the trunk back to its heading, added to the command's [rad/s].
    """

    counter: complex = 0j
    sag: complex = 0j
    trim: complex = 0j
    turn_back: float = 0.0


class Stride(NamedTuple):
    """Where a walk is in its step, seen from the foot that stands: x ahead, y left, as complex numbers [m]."""

    step: Step = Step()
    swing: Swing = Swing()
    landing: Landing = Landing(0.0, 0j)
    trunk: Trunk = Trunk()
    ground: Ground = Ground()
    learnt: Learnt = Learnt()

    def on_the_other_foot(self) -> Stride:
        """Return it seen from the foot that swung, which stands now."""
        step, (origin, yaw, _), landing, trunk, ground, learnt = self
        turn = turned_by(-1j * yaw)
        heading, zmp = trunk.heading - yaw, (trunk.zmp - origin) * turn
        return Stride(
            step._replace(standing=1.0 - step.standing, time=0.0, late=0.0, zmp_from=zmp, heading_from=heading),
            Swing((0j - origin) * turn, -yaw, 0.0),
            landing,
            trunk._replace(com=(trunk.com - origin) * turn, zmp=zmp, heading=heading, rise=trunk.rise - ground.height),
            Ground(-ground.height, ground.slope * turn, ground.foot_tilt * turn, ground.tilt * turn),
            learnt._replace(sag=learnt.sag.conjugate(), trim=learnt.trim * turn),
        )

    def numbers(self) -> Vector:
        """Return it as numbers, shape (:data:`NUMBERS`,)."""
        return np.array([*chain.from_iterable(self)], dtype=complex).view(float)

    @classmethod
    def of(cls, numbers: Vector) -> Stride:
        """Return the one that numbers (:data:`NUMBERS`,) describe."""
        pairs = zip(_PLACES, numbers.view(complex).tolist(), numbers[::2].tolist(), strict=True)
        values = [whole if place else real for place, whole, real in pairs]
        return cls(*[group._make(values[start:end]) for group, start, end in _GROUPS])


def eased(share: float, peak: float = SOFTEST) -> float:
    """Return how much of a way from rest to rest is done at a share of its time, both 0 to 1.

    ``peak`` is its largest speed in mean ones: 1.875 where accelerations begin and end at 0, 1.5 where they jump.
    """
    even = (SOFTEST - peak) / (SOFTEST - EVENEST)
    soft = share**3 * (10.0 + share * (6.0 * share - 15.0))
    return soft + even * (share * share * (3.0 - 2.0 * share) - soft) if even else soft


def gone(before: float, now: float, peak: float = SOFTEST) -> float:
    """Return how much of what is left of a way from rest to rest is done between two shares of its time."""
    left = 1.0 - eased(min(before, 1.0), peak)
    return min((eased(min(now, 1.0), peak) - 1.0 + left) / max(left, 1e-3), 1.0)


_PLACES = [isinstance(value, complex) for group in Stride() for value in group]
_ENDS = [*accumulate(map(len, Stride()))]
_GROUPS: list[tuple[Any, int, int]] = [
    (type(group), end - len(group), end) for group, end in zip(Stride(), _ENDS, strict=True)
]
NUMBERS = 2 * len(_PLACES)
"""How many numbers describe a stride."""
