"""The height of the ground under each foot, found by touch: a foot that touches early stays, one that is late seeks it.

Heights are of the feet over the plane that the trunk keeps its own height to, beyond the lift of those that swing.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp

from simrob_drake.frames import Vector
from simrob_drake.walking.figures import Feedback
from simrob_drake.walking.stride import Stride, eased

_HALFWAY = 0.5  # of a swing, before which no foot touches: it has just lifted


class Ground:
    """How feet find the ground."""

    def __init__(self, groups: Sequence[Sequence[int]], period: float) -> None:
        """Prepare for groups of feet that stand and swing together, and a period between samples [s]."""
        self._groups, self._period = groups, period

    def coming_down(self, stride: Stride) -> Sequence[int]:
        """Return the feet that may touch: looking at a force takes time."""
        return self._groups[1 - int(stride.standing)] if stride.steps and stride.share > _HALFWAY else ()

    def found(
        self, heights: Vector, before: Stride, after: Stride, sinks: float, felt: Sequence[bool], told: Feedback
    ) -> Vector:
        """Return the heights (feet,) a sample later [m].

        Args:
            heights: that were.
            before: the stride that was.
            after: the stride with its feet further on their way.
            sinks: by how much the lift of those that swing grows less [m].
            felt: which feet touch.
            told: how the robot answers.
        """
        standing, swinging = self._groups[int(after.standing)], self._groups[1 - int(after.standing)]
        heights = heights.copy()
        follows = 1.0 - exp(-told.ground_follow * self._period)
        heights -= follows * sum(heights[foot] for foot in standing) / len(standing)
        if not after.steps:
            return heights
        rest = (1.0 - eased(after.share)) / max(1.0 - eased(before.share), 1e-3)
        for foot in swinging:
            if felt[foot]:
                heights[foot] += sinks
            elif after.share < 1.0:
                heights[foot] *= rest
            else:
                heights[foot] = max(heights[foot] - told.search * self._period, -told.depth)
        return heights
