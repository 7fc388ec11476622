"""State of a walk from one sample to the next.

All positions are in the plane of the floor, as complex numbers [m]: the real part is ahead, the imaginary part to the
left. They are measured from the stance foot, in the direction in which the stance foot looks. In names, com is the
centre of mass and zmp the zero-moment point. A foot may be a group of feet; its position is that of the group's middle.
"""

from __future__ import annotations

import cmath
from itertools import accumulate, chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.walking.parameters import EVENEST, SOFTEST
from simrob_drake.walking.steps import Command, Landing

# The least part of a motion that `progress_since` divides by, so that the end of a motion does not divide by zero.
_LEAST_REMAINDER = 1e-3


class Step(NamedTuple):
    """The current step, and the command that it follows.

    Attributes:
        standing: index of the stance foot: 0 the right one, 1 the left one.
        active: 1 during a step, 0 while the robot stands on both feet.
        time: time since the step began [s].
        transfer: duration of the weight transfer at the start of the step [s].
        nominal: planned duration of the step, without disturbances [s].
        late: time since the swing foot should have touched the ground [s].
        brace_time: remaining time for which the robot stands braced before it walks on [s].
        zmp_from: position of the zero-moment point at the start of the step [m].
        heading_from: heading of the trunk at the start of the step [rad].
        speed: speed that the step follows [m/s].
        turn: turning speed that the step follows [rad/s].
    """

    standing: float = 1.0
    active: float = 0.0
    time: float = 0.0
    transfer: float = 0.0
    nominal: float = 0.0
    late: float = 0.0
    brace_time: float = 0.0
    zmp_from: complex = 0j
    heading_from: float = 0.0
    speed: complex = 0j
    turn: float = 0.0

    @property
    def sides(self) -> tuple[int, int]:
        """Indices of the stance group and of the swing group of feet."""
        standing = int(self.standing)
        return standing, 1 - standing

    @property
    def command(self) -> Command:
        """Command that the step follows."""
        return Command(self.speed, self.turn)


class Swing(NamedTuple):
    """Pose of the swing foot, or of the middle of the swing group.

    Attributes:
        place: position of the foot [m].
        yaw: angle by which the foot is turned to the left [rad].
        share: elapsed part of the swing's duration, 0 to 1.
    """

    place: complex = 0j
    yaw: float = 0.0
    share: float = 0.0


class Trunk(NamedTuple):
    """References of the trunk.

    Attributes:
        com: position of the centre of mass [m].
        zmp: position of the zero-moment point [m].
        heading: heading of the trunk relative to the stance foot [rad].
        lean: lean of the trunk to the right [rad].
        pitch: lean of the trunk ahead [rad].
        rise: height of the root above its usual height over the stance foot [m].
        desired_heading: heading in the world that the commands ask for [rad].
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
        height: height of the ground under the middle of the swing feet above that under the middle of the stance feet,
            in addition to the height by `slope` [m].
        slope: slope of the ground, ahead and to the left [1].
        tilt: slope of the line between the two feet of the stance pair, in addition to `slope` [1].
        foot_tilt: slope of the line between the two feet of the swing pair, in addition to `slope` [1].
    """

    height: float = 0.0
    slope: complex = 0j
    tilt: complex = 0j
    foot_tilt: complex = 0j


class Corrections(NamedTuple):
    """Slow corrections of errors that last.

    Attributes:
        lean_integral: angle added to the trunk's lean (real part, to the right) and pitch (imaginary part, ahead), as
            the servos give way under the weight of the trunk [rad].
        com_offset: lasting distance of the measured centre of mass from its reference [m].
        speed_trim: speed added to the commanded one, so that steps become as long as commanded [m/s].
        turn_back: turning speed added to the commanded one, so that the trunk returns to its heading [rad/s].
    """

    lean_integral: complex = 0j
    com_offset: complex = 0j
    speed_trim: complex = 0j
    turn_back: float = 0.0


class Stride(NamedTuple):
    """State of a walk. Positions are measured from the stance foot, ahead and to the left."""

    step: Step = Step()
    swing: Swing = Swing()
    landing: Landing = Landing(0.0, 0j)
    trunk: Trunk = Trunk()
    ground: Ground = Ground()
    corrections: Corrections = Corrections()

    def on_the_other_foot(self) -> Stride:
        """Exchange stance foot and swing foot: the state as measured from the foot that has landed.

        A point p becomes (p - u) exp(-i yaw), with the position u and the angle yaw of the foot that has landed. A
        direction is only turned, and heights count from the ground under that foot. The command of the step stays, as
        it is relative to the robot; so do the planned durations, lean and pitch of the trunk, the heading in the world,
        and the landing: the next step sets its own durations and landing.
        """
        origin = self.swing.place
        yaw = self.swing.yaw
        turn = cmath.exp(-1j * yaw)
        zmp = (self.trunk.zmp - origin) * turn
        heading = self.trunk.heading - yaw

        step = self.step._replace(
            standing=1.0 - self.step.standing,
            time=0.0,
            late=0.0,
            zmp_from=zmp,
            heading_from=heading,
        )
        swing = Swing(place=(0j - origin) * turn, yaw=-yaw, share=0.0)
        trunk = self.trunk._replace(
            com=(self.trunk.com - origin) * turn,
            zmp=zmp,
            heading=heading,
            rise=self.trunk.rise - self.ground.height,
        )
        # The pair that was swinging now stands, so the two tilts change places.
        ground = Ground(
            height=-self.ground.height,
            slope=self.ground.slope * turn,
            tilt=self.ground.foot_tilt * turn,
            foot_tilt=self.ground.tilt * turn,
        )
        # The offset comes from the legs, which are mirror images; the trim is a speed and turns with the foot.
        corrections = self.corrections._replace(
            com_offset=self.corrections.com_offset.conjugate(),
            speed_trim=self.corrections.speed_trim * turn,
        )
        return Stride(step, swing, self.landing, trunk, ground, corrections)

    def numbers(self) -> Vector:
        """Convert the state to a vector of shape (:data:`NUMBERS`,), as the loop's discrete state stores it."""
        # Each value takes two numbers, also a real one: one conversion of all values is fastest.
        values = [*chain.from_iterable(self)]
        return np.array(values, dtype=complex).view(float)

    @classmethod
    def of(cls, numbers: Vector) -> Stride:
        """Convert a vector of shape (:data:`NUMBERS`,) back to the state: the inverse of :meth:`numbers`."""
        # `_IS_COMPLEX` and `_GROUPS`, at the end of the module, list the types of the values and the classes of their
        # groups, such as `Step` and `Swing`. Of a real value's two numbers, the first one is the value.
        as_complex = numbers.view(complex).tolist()
        real_parts = numbers[::2].tolist()
        pairs = zip(_IS_COMPLEX, as_complex, real_parts, strict=True)
        values = [whole if is_complex else real for is_complex, whole, real in pairs]
        return cls(*[group_class._make(values[start:end]) for group_class, start, end in _GROUPS])


def smoothstep(share: float, peak: float = SOFTEST) -> float:
    r"""Compute the part of a rest-to-rest motion that is done at a share of its duration.

    With the share s, it is :math:`10 s^3 - 15 s^4 + 6 s^5` for the softest motion, :math:`3 s^2 - 2 s^3` for the most
    even one, and a mixture of both in between.

    Args:
        share: elapsed share of the duration, 0 to 1.
        peak: largest speed over the mean speed: 1.875 for the softest motion, whose acceleration begins and ends at
            zero, and 1.5 for the most even one, whose acceleration jumps.
    """
    # The quintic: position, speed and acceleration are continuous at both ends.
    soft = share**3 * (10.0 + share * (6.0 * share - 15.0))
    evenness = (SOFTEST - peak) / (SOFTEST - EVENEST)
    if not evenness:
        return soft
    # The cubic: position and speed are continuous.
    even = share * share * (3.0 - 2.0 * share)
    return soft + evenness * (even - soft)


def progress_since(before: float, now: float, peak: float = SOFTEST) -> float:
    """Compute the part of the remaining motion that is done between two shares of its duration.

    A motion whose goal changes in every sample goes this part of the way to its present goal, and so arrives in time.

    Args:
        before: share of the duration at the last sample. Values above 1 count as 1.
        now: share of the duration at this sample. Values above 1 count as 1.
        peak: largest speed over the mean speed, from 1.5 for the most even motion to 1.875 for the softest one.

    Returns:
        The part, from 0 to 1.
    """
    # progress = (s(now) - s(before)) / (1 - s(before)), with the part s of the whole motion.
    remainder = 1.0 - smoothstep(min(before, 1.0), peak)
    progress = smoothstep(min(now, 1.0), peak) - 1.0 + remainder
    return min(progress / max(remainder, _LEAST_REMAINDER), 1.0)


# A vector holds two numbers for each value of a stride, the second one zero if the value is real.
_IS_COMPLEX = [isinstance(value, complex) for group in Stride() for value in group]
_ENDS = [*accumulate(map(len, Stride()))]
# Class of each group of values, and the indices of its first value and of the one after its last.
_GROUPS: list[tuple[Any, int, int]] = [
    (type(group), end - len(group), end) for group, end in zip(Stride(), _ENDS, strict=True)
]
NUMBERS = 2 * len(_IS_COMPLEX)
"""Size of the vector that describes a stride."""

keep_former_attributes(Step, braced="brace_time")
keep_former_attributes(Corrections, counter="lean_integral", sag="com_offset", trim="speed_trim")
keep_former_attributes(Stride, learnt="corrections")
if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"Learnt": "Corrections", "eased": "smoothstep", "gone": "progress_since"}
    )
