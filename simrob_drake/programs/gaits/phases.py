"""Phases of a gait: who swings where, and where the zero-moment point goes meanwhile; and the steps of all walks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from simrob_drake.base.arguments import whole
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import smooth

SAMPLE = 0.01  # time between the samples of a plan [s]
_LONGEST, _MOST_STEPS = 1000.0, 10_000  # of a plan [s], which takes 50 ms of the processor for a second of it


@dataclass(frozen=True)
class Phase:
    """A stretch of time in which the same feet stand."""

    duration: float  # of the phase [s]
    zmp: Vector  # where the zero-moment point rests at the end, shape (2,) [m]
    transfer: float  # time that it takes to get there, from the start of the phase on [s]
    # feet in the air, with where each lands: ahead, left and turn, shape (3,) [m, rad]
    swing: Mapping[str, Vector] = field(default_factory=dict)
    lift: float = 0.0  # height of the swinging feet half-way [m]
    delay: float = 0.0  # time before the feet lift [s]
    rest: float = 0.0  # time that they stand before the phase ends [s]
    heading: float = 0.0  # of the trunk at the end [rad]
    # how long a foot stays up at its full height, within the swing [s]; it then rises and sinks in the rest
    hold: float = 0.0

    def __post_init__(self) -> None:
        """Check the times; raises InvalidParameter: a phase without duration, or with more in it than it lasts."""
        if not self.duration > 0:
            raise InvalidParameter(
                message("programs.duration_of_phase", "duration of a phase"),
                self.duration,
                message("programs.positive_time", "positive [s]"),
            )
        if self.transfer > self.duration + 1e-9 or self.delay + self.rest + self.hold >= self.duration:
            raise InvalidParameter(
                "phase",
                repr(self),
                message("programs.phase_longer_than_parts", "one whose parts are no longer than itself"),
            )


@dataclass(frozen=True)
class GaitPlan:
    """What feet, trunk and zero-moment point do, at m equal steps of time."""

    times: Vector  # shape (m,) [s]
    feet: dict[str, Vector]  # places of the soles by foot, ahead, left, up and turn, shape (m, 4) [m, rad]
    zmp: Vector  # shape (m, 2) [m]
    heading: Vector  # of the trunk, shape (m,) [rad]
    ground: Vector | float = 0.0  # height over which the trunk is carried, shape (m,) [m]
    # when feet stand, by foot, shape (m,); where they are at the height 0, unless it is given
    standing: Mapping[str, npt.NDArray[np.bool_]] = field(default_factory=dict)

    def stands(self, foot: str) -> npt.NDArray[np.bool_]:
        """Return when a foot stands, shape (m,)."""
        return self.standing[foot] if self.standing else self.feet[foot][:, 2] <= 0


def gait_plan(feet: Mapping[str, Vector], zmp: Vector, phases: Sequence[Phase]) -> GaitPlan:
    """Lay phases end to end, from where feet (3,) [m, m, rad] and zero-moment point (2,) [m] are at the start.

    Raises UnknownName: a phase swings a foot that is none; InvalidParameter: no phase at all.
    """
    if not phases:
        raise InvalidParameter("phases", "empty", message("programs.at_least_one", "at least one"))
    ends = np.cumsum([phase.duration for phase in phases])
    times = samples(float(ends[-1]))
    paths = {name: np.tile([*place[:2], 0.0, place[2]], (len(times), 1)) for name, place in feet.items()}
    point, heading = np.tile(zmp, (len(times), 1)), np.zeros(len(times))
    for phase, end in zip(phases, ends, strict=True):
        since = times - (end - phase.duration)
        later = since > 0
        reached = _ratio(since[later], phase.transfer)[:, np.newaxis]
        point[later] = point[later] + reached * (phase.zmp - point[later])
        heading[later] += smooth(_ratio(since[later], phase.duration)) * (phase.heading - heading[later])
        length = phase.duration - phase.delay - phase.rest
        for name, place in phase.swing.items():
            share = _ratio(since[later] - phase.delay, length)
            path = paths[name][later]
            path[:, [0, 1, 3]] += smooth(share)[:, np.newaxis] * (place - path[:, [0, 1, 3]])
            path[:, 2] = phase.lift * _bump(share * length, length, phase.hold)
            paths[name][later] = path
    return GaitPlan(times, paths, point, heading)


def _bump(since: Vector, length: float, hold: float) -> Vector:
    """Return a swing's height, from 0 to 1 and back to 0, with level stretches of ``hold`` at the top."""
    rise = (length - hold) / 2
    if hold > 0:
        return smooth(np.clip(since / rise, 0, 1)) - smooth(np.clip((since - rise - hold) / rise, 0, 1))
    share = np.clip(since / length, 0, 1)
    return np.asarray(64.0 * (share * (1.0 - share)) ** 3)


def _ratio(part: Vector, whole: float) -> Vector:
    return np.clip(part / whole, 0.0, 1.0) if whole > 0 else np.asarray(part >= 0, dtype=float)


def samples(duration: float) -> Vector:
    """Return times of a plan's samples (m,) [s]; raises InvalidParameter: no time, or more than is planned at once."""
    if not 0 < duration <= _LONGEST:
        raise InvalidParameter(
            "gait",
            message("programs.seconds_long", "{duration:.6g} s long", duration=duration),
            message("programs.at_most_long", "at most {longest:g} s long; take fewer steps", longest=_LONGEST),
        )
    return np.arange(round(duration / SAMPLE) + 1, dtype=float) * SAMPLE


def check_steps(steps: int) -> None:
    """Check that a gait goes some steps; raises InvalidParameter: it does not, or more than are planned at once."""
    whole(steps, "steps", 1, _MOST_STEPS)


def on_path(pose: Vector, ahead: float = 0.0, left: float = 0.0, turn: float = 0.0) -> Vector:
    """Return the pose (x, y, turn) that is ahead, to the left and turned from another, shape (3,) [m, rad]."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(pose + np.array([cosine * ahead - sine * left, sine * ahead + cosine * left, turn]))


def ramp_shares(steps: int, ramp_steps: int) -> Vector:
    """Return how much of the full step each footfall goes ahead: rising, level, falling, the last one 0.

    All together they go as far as so many full steps: one footfall is added for each step of a ramp, which is no longer
    than the way, and one that brings the feet together.
    """
    ramp = min(ramp_steps, steps)
    number = np.arange(steps + ramp + 1, dtype=float)
    return np.asarray(np.minimum(1.0, np.minimum(number + 1, steps + ramp - number) / (ramp + 1)))
