"""A constant force for a while."""

from typing import Literal

import numpy as np
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.parts.forces.force import ForceSection
from simrob_drake.quantities import Duration, Instant, Triple


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
    def edges(self) -> tuple[float, float]:
        """When it begins and ends [s]; no step goes across: a scheme that freezes its inputs would miss a part."""
        return self.start, self.start + self.duration

    def course(self) -> Trajectory:
        """Return the force over time, shape (3, 1) [N]."""
        force, nothing = np.array(self.force), np.zeros(3)
        begin, end = self.edges
        times, values = [0.0, begin, end, end + 1.0], [nothing, force, nothing, nothing]  # a hold needs an end
        return PiecewisePolynomial.ZeroOrderHold(times[begin == 0 :], np.array(values[begin == 0 :]).T)

    def source(self) -> TrajectorySource:
        """Return the block that gives the force (3) [N]."""
        return TrajectorySource(self.course())

    def caption(self) -> str:
        """Return it in words."""
        return f"{float(np.linalg.norm(self.force)):.3g} N at {self.start:g} s"
