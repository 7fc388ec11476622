r"""A spring with a damper between points of two bodies, under any solver.

.. math:: f = k (l - l_0) + d\,\dot l

pulls them together, of their distance :math:`l`.
"""

from typing import ClassVar, Literal

from pydrake.multibody.tree import LinearSpringDamper

from simrob_drake.parts.couplings.coupling import BetweenPoints
from simrob_drake.parts.site import StationPlant
from simrob_drake.sections import NotNegative

_SHORTEST = 1e-9  # m: Drake wants a length, though it need not have one


class Spring(BetweenPoints):
    """A spring with a damper between two points."""

    constrains: ClassVar[bool] = False
    kind: Literal["spring"]
    length: NotNegative = 0.0
    """At which it is slack [m]."""
    stiffness: NotNegative
    """[N/m]."""
    damping: NotNegative = 0.0
    """[N·s/m]."""

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = self.ends(plant)
        points = one.pose.translation(), other.pose.translation()
        length = max(self.length, _SHORTEST)
        spring = LinearSpringDamper(one.body, points[0], other.body, points[1], length, self.stiffness, self.damping)
        plant.plant.AddForceElement(spring)

    def caption(self) -> str:
        """Return it in words."""
        return f"a spring of {self.stiffness:g} N/m from {self.body} to {self.other}"
