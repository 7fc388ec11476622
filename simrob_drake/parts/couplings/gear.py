r"""Joints that turn or slide together: gears, racks, screws, belts.

.. math:: \sum_i r_i q_i = c

of axes with position :math:`q_i` and ratios :math:`r_i`. Two gears of radii 1 and 2 that mesh have the ratios 1 and 2;
a planetary gear couples three axes; a rack slides by its pinion's radius a radian.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.blocks.wiring import fed, joined, mapped
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.couplings.coupling import RELAXES, STIFFNESS, CouplingSection
from simrob_drake.parts.site import Site, StationPlant, StationRobot, Surroundings
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
        if len(self.ratios) > 2 and station.time_step and not hasattr(MultibodyPlant, "AddTendonConstraint"):
            raise InvalidParameter(
                f"{key}.ratios", f"of {len(self.ratios)} axes", "of two: older Drake couples no more"
            )

    def _counts(self, robot: StationRobot) -> Vector:
        """Return how much each axis of a robot counts, shape (n,)."""
        return np.array([self.ratios.get(f"{robot.prefix}{axis}", 0.0) for axis in robot.axes])

    def _kept(self, plant: StationPlant) -> float:
        initial = sum(float(self._counts(robot) @ robot.initial) for robot in plant.robots.values())
        return initial if self.total is None else self.total

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized, and discrete."""
        if not plant.plant.time_step():
            return
        joints, ratios, kept = [], [], self._kept(plant)
        for robot in plant.robots.values():
            for joint, axis, ratio in zip(robot.joints, robot.model.axes.values(), self._counts(robot), strict=True):
                if ratio:
                    joints.append(joint.index())
                    ratios.append(ratio * axis.sign)
        if len(joints) == 2:
            driven, driver = (plant.plant.get_joint(joint) for joint in joints)
            plant.plant.AddCouplerConstraint(driven, driver, -ratios[1] / ratios[0], kept / ratios[0])
        else:
            plant.plant.AddTendonConstraint(joints, ratios, -kept, 0.0, 0.0)

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add the stiff spring that couples the axes under a continuous scheme."""
        plant, robots = site.plant.plant, site.plant.robots.values()
        if plant.time_step():
            return
        each = [(robot.axis_map, self._counts(robot)) for robot in robots]
        place = sum(counts @ axes.state_matrix[: len(counts)] for axes, counts in each)
        speed = sum(counts @ axes.state_matrix[len(counts) :] for axes, counts in each)
        spread = sum(counts @ axes.velocity_matrix for axes, counts in each)
        mobility = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
        stiffness = STIFFNESS / (spread @ mobility @ spread)
        law = stiffness * np.append(-place - RELAXES * speed, self._kept(site.plant))
        one = fed(builder, f"{key}.one", ConstantVectorSource([1.0]))
        bus = joined(builder, f"{key}.bus", site.state, one)
        site.generalized_forces.append(mapped(builder, f"{key}.force", np.outer(spread, law), bus))
        site.draw_nothing(f"{key}.one", f"{key}.bus")
        site.draw(f"{key}.force", "force", f"What couples\n{', '.join(self.ratios)}")

    def caption(self) -> str:
        """Return it in words."""
        return "a gear: " + " + ".join(f"{ratio:g} {axis}" for axis, ratio in self.ratios.items()) + " stays as it is"
