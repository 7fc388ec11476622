"""What a walk remembers from a sample to the next."""

from __future__ import annotations

from cmath import exp as turned_by
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.walking.steps import Command, Landing


@dataclass(frozen=True)
class Stride:
    """Where a walk is in its step, seen from the foot that stands: x ahead, y left, as complex numbers [m].

    Attributes:
        standing: the foot, 0 the right one, 1 the left one.
        steps: whether a step is under way; else both stand.
        time: since the step began [s].
        transfer: in which the weight goes over at its start [s].
        nominal: when it ends unless disturbed [s].
        ends: when it ends [s].
        com: the reference of the centre of mass.
        zmp, zmp_from: of the zero-moment point, and where that came from.
        foot, foot_yaw: of the other foot, which swings [rad].
        share: how far its swing is, 0 to 1.
        landing, landing_yaw: where it lands.
        heading, heading_from: of the trunk, and where that came from [rad].
        lean, pitch: of the trunk, to the right and ahead [rad].
        counter: to lean and pitch, against what the servos give way under its weight [rad].
        sag: how far the centre of mass lasts to be from its reference [m].
        height: of the ground under the other foot over that under the foot that stands [m].
        rise: of the root, over its usual height there [m].
        slope: of the ground, ahead and to the left [1].
        tilt, foot_tilt: of the line between the feet of a pair over that: of those that stand, and that swing [1].
        speed, turn: that the steps follow [m/s, rad/s].
        course: where the trunk shall look in the world [rad].
        aside: turn that brings it back there, added to the command's [rad/s].
        trim: what the planned speed has beyond the command's, for the way to be as long as that asks [m/s].
        waits: how long the foot has been late [s].
        braced: for how long the robot stands before it walks on [s].
    """

    standing: float = 1.0
    steps: float = 0.0
    time: float = 0.0
    transfer: float = 0.0
    nominal: float = 0.0
    ends: float = 0.0
    com: complex = 0j
    zmp: complex = 0j
    zmp_from: complex = 0j
    foot: complex = 0j
    foot_yaw: float = 0.0
    share: float = 0.0
    landing: complex = 0j
    landing_yaw: float = 0.0
    heading: float = 0.0
    heading_from: float = 0.0
    lean: float = 0.0
    pitch: float = 0.0
    counter: complex = 0j
    sag: complex = 0j
    height: float = 0.0
    rise: float = 0.0
    slope: complex = 0j
    tilt: complex = 0j
    foot_tilt: complex = 0j
    speed: complex = 0j
    turn: float = 0.0
    course: float = 0.0
    aside: float = 0.0
    trim: complex = 0j
    waits: float = 0.0
    braced: float = 0.0

    def changed(self, **changes: Any) -> Stride:
        """Return it with some of its values changed: as ``dataclasses.replace``, in a tenth of the time."""
        other = object.__new__(Stride)
        values = other.__dict__
        values |= self.__dict__
        values |= changes
        return other

    @property
    def command(self) -> Command:
        """What the steps shall come to."""
        return Command(self.speed, self.turn)

    @property
    def trimmed(self) -> Command:
        """What they are planned by."""
        return Command(self.speed + self.trim, self.turn + self.aside)

    def on_the_other_foot(self) -> Stride:
        """Return it seen from the foot that swung, which stands now."""
        turn = turned_by(-1j * self.foot_yaw)

        def seen(place: complex) -> complex:
            return (place - self.foot) * turn

        heading = self.heading - self.foot_yaw
        return self.changed(
            standing=1.0 - self.standing,
            time=0.0,
            com=seen(self.com),
            zmp=seen(self.zmp),
            zmp_from=seen(self.zmp),
            foot=seen(0j),
            foot_yaw=-self.foot_yaw,
            share=0.0,
            heading=heading,
            heading_from=heading,
            height=-self.height,
            rise=self.rise - self.height,
            sag=self.sag.conjugate(),
            slope=self.slope * turn,
            tilt=self.foot_tilt * turn,
            foot_tilt=self.tilt * turn,
            trim=self.trim * turn,
            waits=0.0,
        )

    def landing_at(self, landing: Landing) -> Stride:
        """Return it with another end of the step."""
        return self.changed(ends=landing.time, landing=landing.place, landing_yaw=landing.yaw)

    def numbers(self) -> Vector:
        """Return it as numbers, shape (:data:`NUMBERS`,)."""
        return np.array(_VALUES(self), dtype=complex).view(float)

    @classmethod
    def of(cls, numbers: Vector) -> Stride:
        """Return what numbers (:data:`NUMBERS`,) tell."""
        values: list[complex] = numbers.copy().view(complex).tolist()
        stride: Stride = object.__new__(cls)
        stride.__dict__.update(
            (name, value if place else value.real) for name, place, value in zip(_NAMES, _PLACES, values, strict=True)
        )
        return stride


def eased(share: float) -> float:
    """Return how much of a way from rest to rest is done at a share of its time, both 0 to 1."""
    return share**3 * (10.0 + share * (6.0 * share - 15.0))


def gone(before: float, now: float) -> float:
    """Return how much of what is left of a way from rest to rest is done between two shares of its time."""
    left = 1.0 - eased(min(before, 1.0))
    return min((eased(min(now, 1.0)) - 1.0 + left) / max(left, 1e-3), 1.0)


_NAMES = [field.name for field in fields(Stride)]
_PLACES = [isinstance(field.default, complex) for field in fields(Stride)]
_VALUES = attrgetter(*_NAMES)
NUMBERS = 2 * len(_NAMES)
"""How many numbers tell a stride."""
