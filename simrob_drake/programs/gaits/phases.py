"""Phases of a planned gait, and the sampled plan that they add up to.

A gait whose motion is planned before it begins is a sequence of phases. In each :class:`Phase` some feet swing to their
next foothold, while the zero-moment point (ZMP) moves over the feet that stand. :func:`gait_plan` puts phases one after
the other and samples the paths of feet, ZMP and trunk at equal steps of time: the result is a :class:`GaitPlan`.

Positions are in the frame of the ground from which the robot starts: x ahead, y to the left, the origin in the middle
of the feet. A foothold is a vector (3,): x [m], y [m] and the foot's turn to the left [rad].
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from simrob_drake.base.arguments import whole
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import smooth

SAMPLE = 0.01
"""Time between the samples of a plan [s]."""

# Limits of a plan. A second of a plan takes 50 ms to compute, so the longest one takes about a minute.
_LONGEST = 1000.0  # duration [s]
_MOST_STEPS = 10_000  # count of steps

_ROUNDING = 1e-9  # error of a sum of times that is no fault of the user [s]


@dataclass(frozen=True)
class Phase:
    """A part of a gait during which the same feet swing, and all others stand.

    Attributes:
        duration: duration of the phase [s].
        zmp: zero-moment point at the end of the phase, shape (2,) [m].
        transfer: time from the start of the phase in which the ZMP moves there, at a constant speed [s]. If it is 0,
            the ZMP jumps there at the start of the phase.
        swing: foothold (3,) on which each swinging foot lands, by the foot's name.
        lift: largest height of the swinging feet [m].
        delay: time from the start of the phase until the feet lift off [s].
        rest: time from the touchdown until the end of the phase [s].
        heading: turn of the trunk at the end of the phase, to the left [rad]. The trunk turns there smoothly during the
            whole phase.
        hold: time that the swinging feet stay at their largest height [s]. If it is 0, they only pass through it.
    """

    duration: float
    zmp: Vector
    transfer: float
    swing: Mapping[str, Vector] = field(default_factory=dict)
    lift: float = 0.0
    delay: float = 0.0
    rest: float = 0.0
    heading: float = 0.0
    hold: float = 0.0

    def __post_init__(self) -> None:
        """Check the times.

        Raises:
            InvalidParameter: the duration is not positive, or the parts of the phase take longer than the phase.
        """
        if not self.duration > 0:
            raise InvalidParameter(
                message("programs.duration_of_phase", "duration of a phase"),
                self.duration,
                message("programs.positive_time", "positive [s]"),
            )
        is_transfer_too_long = self.transfer > self.duration + _ROUNDING
        # Some time has to be left in which the feet rise and sink.
        is_swing_too_short = self.delay + self.rest + self.hold >= self.duration
        if is_transfer_too_long or is_swing_too_short:
            raise InvalidParameter(
                "phase",
                repr(self),
                message(
                    "programs.phase_longer_than_parts",
                    "a phase that is longer than its parts: transfer, and delay, hold and rest together",
                ),
            )


@dataclass(frozen=True)
class GaitPlan:
    """Paths of the feet, the trunk and the zero-moment point, sampled at m equal steps of time.

    Attributes:
        times: times of the samples, shape (m,) [s].
        feet: path of each sole by the foot's name, shape (m, 4): x, y, height [m] and turn to the left [rad].
        zmp: desired zero-moment point, shape (m, 2) [m].
        heading: turn of the trunk to the left, shape (m,) [rad].
        ground: height of the ground over which the trunk is carried, shape (m,), or one number [m].
        standing: whether each foot stands, by the foot's name, shape (m,). If it is empty, a foot stands
            while the height of its sole is 0.
    """

    times: Vector
    feet: dict[str, Vector]
    zmp: Vector
    heading: Vector
    ground: Vector | float = 0.0
    standing: Mapping[str, npt.NDArray[np.bool_]] = field(default_factory=dict)

    def stands(self, foot: str) -> npt.NDArray[np.bool_]:
        """Whether a foot stands at each sample, shape (m,)."""
        return self.standing[foot] if self.standing else self.feet[foot][:, 2] <= 0


def gait_plan(feet: Mapping[str, Vector], zmp: Vector, phases: Sequence[Phase]) -> GaitPlan:
    """Put phases one after the other, and sample them. The trunk is not turned at the start.

    Args:
        feet: foothold (3,) of every foot at the start, by the foot's name.
        zmp: zero-moment point at the start, shape (2,) [m].
        phases: the phases, at least one. They swing no other feet than those of `feet`.

    Raises:
        InvalidParameter: there is no phase, or the phases take longer than the longest plan.
    """
    if not phases:
        raise InvalidParameter(
            message("programs.count_of_phases", "count of phases"),
            0,
            message("programs.at_least_one", "at least one"),
        )
    ends = np.cumsum([phase.duration for phase in phases])  # time at which each phase ends [s]
    times = samples(float(ends[-1]))
    count = len(times)
    paths = {}
    for name, foothold in feet.items():
        pose = [*foothold[:2], 0.0, foothold[2]]  # x, y, height 0, turn
        paths[name] = np.tile(pose, (count, 1))
    zmps = np.tile(zmp, (count, 1))
    headings = np.zeros(count)
    for phase, end in zip(phases, ends, strict=True):
        # Each phase changes all samples after its start, not only its own: the next phase continues where it ended.
        elapsed = times - (end - phase.duration)
        later = elapsed > 0
        elapsed = elapsed[later]
        # Every value moves from where it is to its goal: v + share (goal - v), where the share grows from 0 to 1.
        transferred = _linear_share(elapsed, phase.transfer)[:, np.newaxis]
        zmps[later] += transferred * (phase.zmp - zmps[later])
        turned = smooth(_linear_share(elapsed, phase.duration))
        headings[later] += turned * (phase.heading - headings[later])
        for name, landing in phase.swing.items():
            paths[name][later] = _swing_path(paths[name][later], elapsed, landing, phase)
    return GaitPlan(times, paths, zmps, headings)


def _swing_path(path: Vector, elapsed: Vector, landing: Vector, phase: Phase) -> Vector:
    """Compute the path of a foot that swings in a phase, and of the time after that phase.

    Args:
        path: path of the foot without this swing, shape (k, 4): x, y, height [m] and turn [rad].
        elapsed: times since the start of the phase, shape (k,) [s].
        landing: foothold on which the foot lands, shape (3,).
        phase: the phase.

    Returns:
        The path with the swing, shape (k, 4). After the phase the foot stays at its landing.
    """
    swing_time = phase.duration - phase.delay - phase.rest
    share = _linear_share(elapsed - phase.delay, swing_time)
    level = [0, 1, 3]  # indices of x, y and turn
    result = path.copy()
    result[:, level] += smooth(share)[:, np.newaxis] * (landing - result[:, level])
    result[:, 2] = phase.lift * _swing_height(share * swing_time, swing_time, phase.hold)
    return result


def _swing_height(elapsed: Vector, swing_time: float, hold: float) -> Vector:
    """Compute the height of a swinging foot as a part of its largest height: from 0 to 1 and back to 0.

    Before the lift-off and after the touchdown it is 0.

    Args:
        elapsed: times since the lift-off, shape (k,) [s].
        swing_time: time from the lift-off to the touchdown [s].
        hold: time that the height stays 1 [s].
    """
    if hold > 0:
        rise_time = (swing_time - hold) / 2  # as long as the foot takes to sink
        risen = smooth(np.clip(elapsed / rise_time, 0, 1))
        sunk = smooth(np.clip((elapsed - rise_time - hold) / rise_time, 0, 1))
        return risen - sunk
    # 64 s³ (1 - s)³ is 1 at s = 1/2. Its velocity and acceleration are zero at both ends, so a touchdown is soft.
    share = np.clip(elapsed / swing_time, 0, 1)
    return np.asarray(64.0 * (share * (1.0 - share)) ** 3)


def _linear_share(elapsed: Vector, duration: float) -> Vector:
    """Part of a duration [s] that has elapsed at times (k,) since its begin [s], from 0 to 1, shape (k,).

    Before the begin it is 0. A duration of 0 has elapsed at the time 0.
    """
    if duration > 0:
        return np.clip(elapsed / duration, 0.0, 1.0)
    return np.asarray(elapsed >= 0, dtype=float)


def samples(duration: float) -> Vector:
    """Times of the samples of a plan, from 0 on in equal steps, shape (m,) [s].

    Args:
        duration: duration of the plan [s]. It is rounded to whole steps.

    Raises:
        InvalidParameter: the duration is not positive, or longer than the longest plan.
    """
    if not 0 < duration <= _LONGEST:
        raise InvalidParameter(
            "gait",
            message("programs.seconds_long", "{duration:.6g} s long", duration=duration),
            message(
                "programs.at_most_long",
                "at most {longest:g} s long; take fewer steps",
                longest=_LONGEST,
            ),
        )
    return np.arange(round(duration / SAMPLE) + 1, dtype=float) * SAMPLE


def check_steps(steps: int) -> None:
    """Check the count of steps of a gait.

    Raises:
        InvalidParameter: the count is no integer, less than 1, or more than one plan may have.
    """
    whole(steps, "steps", 1, _MOST_STEPS)


def pose_after(pose: Vector, ahead: float = 0.0, left: float = 0.0, turn: float = 0.0) -> Vector:
    """Compute the pose after a move that is given in the frame of the pose before.

    Args:
        pose: pose before the move, shape (3,): x [m], y [m] and turn to the left [rad].
        ahead: how far the move goes ahead [m].
        left: how far the move goes to the left [m].
        turn: how far the move turns to the left [rad].
    """
    cosine = np.cos(pose[2])
    sine = np.sin(pose[2])
    # The move ahead and to the left is turned by the turn of the pose before.
    move = np.array([cosine * ahead - sine * left, sine * ahead + cosine * left, turn])
    return np.asarray(pose + move)


def ramp_shares(steps: int, ramp_steps: int) -> Vector:
    """Length of each step of a walk as a part of the full step length.

    The step length grows at the start and shrinks at the end; the last step has the length 0 and brings the feet side
    by side. The walk goes as far as `steps` full steps. For this, one step is added for each step of the first ramp
    (none for those of the second), and one that brings the feet together.

    Args:
        steps: count of full steps that would go as far.
        ramp_steps: count of steps in which the step length grows. It is at most `steps`; a larger one is reduced.

    Returns:
        Shares between 0 and 1, shape (steps + ramp + 1,). Their sum is `steps`.
    """
    ramp = min(ramp_steps, steps)
    number = np.arange(steps + ramp + 1, dtype=float)
    # Steps from the start and to the end. In a ramp of r steps, step i has the share i / (r + 1).
    from_start = number + 1
    to_end = steps + ramp - number
    return np.asarray(np.minimum(1.0, np.minimum(from_start, to_end) / (ramp + 1)))
