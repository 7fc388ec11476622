r"""Joints that turn or slide together: gears, racks, screws, belts.

.. math:: \sum_i r_i q_i = c

of axes with position :math:`q_i` and ratios :math:`r_i`. Two gears of radii 1 and 2 that mesh have the ratios 1 and 2;
a planetary gear couples three axes; a rack slides by its pinion's radius a radian.
"""

from typing import Annotated, Literal

from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.parts.couplings.coupling import CouplingSection
from simrob_drake.parts.site import StationPlant, Surroundings
from simrob_drake.sections import Number


class Gear(CouplingSection):
    """Axes of which a sum of positions stays as it is."""

    kind: Literal["gear"]
    ratios: Annotated[dict[str, Number], Field(min_length=2)]
    """How much each axis counts, by name (<robot>.<axis> where there are several robots): {sun: 1, planet: 2}."""
    total: Number | None = None
    """What the sum of positions [rad or m] times ratios stays; that of the initial posture unless given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station has the axes, and a solver that holds them."""
        super().check(key, station)
        known = [f"{robot.prefix}{axis}" for robot in station.robots.values() for axis in robot.axes]
        for name in self.ratios:
            if name not in known:
                raise UnknownName(f"axis for {key}.ratios", name, known)
        if len(self.ratios) > 2 and not hasattr(MultibodyPlant, "AddTendonConstraint"):
            raise InvalidParameter(
                f"{key}.ratios", f"of {len(self.ratios)} axes", "of two: older Drake couples no more"
            )

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        joints, ratios, total = [], [], 0.0
        for robot in plant.robots.values():
            for place, axis in enumerate(robot.model.axes.values()):
                ratio = self.ratios.get(f"{robot.prefix}{robot.axes[place]}", 0.0)
                if ratio:
                    joints.append(robot.joints[place].index())
                    ratios.append(ratio * axis.sign)
                    total += ratio * robot.initial[place]
        kept = total if self.total is None else self.total
        if len(joints) == 2:
            driven, driver = (plant.plant.get_joint(joint) for joint in joints)
            plant.plant.AddCouplerConstraint(driven, driver, -ratios[1] / ratios[0], kept / ratios[0])
        else:
            plant.plant.AddTendonConstraint(joints, ratios, -kept, 0.0, 0.0)

    def caption(self) -> str:
        """Return it in words."""
        return "a gear: " + " + ".join(f"{ratio:g} {axis}" for axis, ratio in self.ratios.items()) + " stays as it is"
