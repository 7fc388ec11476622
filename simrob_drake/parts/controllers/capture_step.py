"""A step that catches a robot which its feet, where they stand, can no longer stop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.support import Balanced, Direction
from simrob_drake.sections import NotNegative, Number, Positive, Strict

_TOUCHES = 0.003
"""How high above the lowest foot another still touches the floor, since servos and contacts give way [m]."""
_REACHED = 0.7
"""Part of a step after which the foot is as far as it goes, and only comes down."""


class CaptureStep(Strict):
    """Set a foot where the robot falls, once its capture point leaves the feet, and stand there."""

    measures: Direction
    """Where the error counts, as in a strategy: ahead, behind, or to one side."""
    foot: str
    """Link of the foot that is lifted."""
    beyond: Positive
    """The error from which on it steps [m]."""
    full: Positive
    """The error for which it reaches as far as ``reach_deg``; for less by so much less [m]."""
    least: NotNegative = 0.0
    """The least part of that that it reaches."""
    lead: NotNegative | None = None
    """What the velocity counts for [s]; 1/ω unless given, which makes the error that of the capture point."""
    duration: Positive
    """How long the foot is in the air [s]."""
    settle: Positive = 0.3
    """How long the legs then take to their new posture [s]."""
    stance: Annotated[Number, Field(ge=0, le=1)] = 1.0
    """Part of its reach that the leg which stands takes while the foot is in the air; the rest as they settle."""
    lift_deg: dict[str, Number] = Field(min_length=1)
    """How far axes are moved in the middle of the step, to lift the foot, by name [deg]."""
    reach_deg: dict[str, Number] = Field(min_length=1)
    """How far axes are moved once the foot is down, by name [deg]."""


@dataclass(frozen=True)
class Stepping:
    """A step in figures: as :class:`CaptureStep`, with moves in radians, shape (n,), and the number of the foot."""

    measures: Direction
    foot: int
    beyond: float
    full: float
    least: float
    lead: float | None
    duration: float
    settle: float
    stance: float
    lift: Vector
    reach: Vector

    def part(self, balanced: Balanced) -> float:
        """Return what part of its reach is called for."""
        return min(max(balanced.error(self.measures, self.lead) / self.full, self.least), 1.0)

    def swung(self, time: float, part: float) -> Vector:
        """Return how far the axes are moved at a time of the step, of which it takes one."""
        ahead = min(time / _REACHED, 1.0)
        return (
            math.sin(math.pi * time) * self.lift
            + part * ahead * ahead * (3 - 2 * ahead) * np.where(self.lift, 1.0, self.stance) * self.reach
        )


class StepChooser:
    """Which of several steps a robot takes: one, and it stays there."""

    def __init__(self, steps: Sequence[Stepping], period: float) -> None:
        """Take the steps that it may take, and the time between samples [s]."""
        self._steps, self._period = steps, period

    def next(self, state: Vector, moved: Vector, balanced: Balanced) -> tuple[Vector, Vector]:
        """Return what follows of a step's state and of how far axes are moved.

        Args:
            state: which step it is (from 1, 0 for none), its time (1 once the foot is down) and its part, shape (3,).
            moved: shape (n,) [rad].
            balanced: how the robot stands.
        """
        which, time, part = int(state[0]), float(state[1]), float(state[2])
        if not which:
            errors = (balanced.error(step.measures, step.lead) > step.beyond for step in self._steps)
            which = next((number for number, far in enumerate(errors, 1) if far), 0)
            if not which:
                return state, moved
        step = self._steps[which - 1]
        if time < 1:
            time, part = min(time + self._period / step.duration, 1.0), max(part, step.part(balanced))
            moved = step.swung(time, part)
            if time > 0.5 and balanced.lifted[step.foot] < _TOUCHES:
                time = 1.0  # what is lifted still is let down slowly, or the leg would kick
        else:
            moved = moved + min(self._period / step.settle, 1.0) * (part * step.reach - moved)
        return np.array([which, time, part]), moved
