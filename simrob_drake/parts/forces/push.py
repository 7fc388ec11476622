"""A constant force for a while."""

from typing import Literal

import numpy as np
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.parts.forces.force import ForceSection
from simrob_drake.sections import Duration, Instant, Triple

_JUST_BEFORE = 1e-11  # [s]


class Push(ForceSection):
    """A constant force for a while."""

    kind: Literal["push"]
    start: Instant = 0.0
    """When it begins [s]."""
    duration: Duration = 0.1
    """How long it lasts [s]."""
    force: Triple
    """Along x, y and z of what is pushed [N]."""

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.start + self.duration

    @property
    def edges(self) -> tuple[float, ...]:
        """When it begins and ends, and just before [s]; no step goes across.

        A scheme that freezes its inputs would miss a part of it, and one with a stage at a step's end finds there what
        comes after the edge: that step is as short as can be.
        """
        edges = self.start - _JUST_BEFORE, self.start, self.end - _JUST_BEFORE, self.end
        return tuple(edge for edge in edges if edge >= 0)

    def trajectory(self) -> Trajectory:
        """Return the force over time, shape (3, 1) [N]."""
        force, nothing = np.array(self.force), np.zeros(3)
        times, values = [0.0, self.start, self.end, self.end + 1.0], [nothing, force, nothing, nothing]  # a hold ends
        known = slice(self.start == 0, None)
        return PiecewisePolynomial.ZeroOrderHold(times[known], np.array(values[known]).T)

    def source(self) -> TrajectorySource:
        """Return the block that gives the force (3) [N]."""
        return TrajectorySource(self.trajectory())

    def caption(self) -> str:
        """Return it in words."""
        return f"{float(np.linalg.norm(self.force)):.3g} N at {self.start:g} s"
