"""Shorten the first-order steps of `cenic` while something flies: there nothing else bounds their error."""

import weakref
from collections.abc import Iterator

from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from simrob_drake.stations.solve import bound_steps
from simrob_drake.stations.solver_config import ContinuousSolver

_IN_FLIGHT = (1e-3, 1e-3)
"""Longest step [s] and coarsest accuracy: a humanoid that moves its legs then keeps its momentum within 0.1 %."""
_LOOK_EVERY = 5  # steps: to look whether something flies takes a tenth of the time of a step


class Flight:
    """Looks whether a robot or a free piece touches nothing but itself, and sets the length of steps by that."""

    def __init__(self, plant: MultibodyPlant, solver: ContinuousSolver, simulator: Simulator) -> None:
        """Look after all floating bodies of a plant that a simulator steps by ``cenic``."""
        self._plant, self._solver = plant, solver
        self._simulator = weakref.ref(simulator)  # whose monitor holds this
        self._bodies = list(_shapes_of_floating_bodies(plant))
        self._steps, self._flies = 0, False

    def look(self, root: Context) -> None:
        """Look at the state that a step has reached, now and then; to be called at the start and after each step."""
        self._steps += 1
        if self._steps % _LOOK_EVERY != 1 or not self._bodies:
            return
        flies = self._is_one_free(root)
        if flies != self._flies and (simulator := self._simulator()) is not None:
            self._flies = flies
            bound_steps(simulator, self._solver, *(_IN_FLIGHT if flies else ()))

    def _is_one_free(self, root: Context) -> bool:
        plant = self._plant
        if not plant.num_collision_geometries():
            return True
        query = plant.get_geometry_query_input_port().Eval(plant.GetMyContextFromRoot(root))
        pairs = query.ComputePointPairPenetration() if query.HasCollisions() else []
        touched = [(pair.id_A, pair.id_B) for pair in pairs]
        return any(all((a in shapes) == (b in shapes) for a, b in touched) for shapes in self._bodies)


def _shapes_of_floating_bodies(plant: MultibodyPlant) -> Iterator[set[GeometryId]]:
    """Yield the collision shapes of each floating body and of all that hangs on it."""
    for index in plant.GetJointIndices():
        if plant.get_joint(index).type_name() == "quaternion_floating":
            bodies = plant.GetBodiesKinematicallyAffectedBy([index])
            yield {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(plant.get_body(body))}
