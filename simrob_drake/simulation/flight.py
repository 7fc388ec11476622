"""Shorten the first-order steps of `cenic` while something flies: there nothing else bounds their error."""

import weakref

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.steps import bound_steps

_IN_FLIGHT = (1e-3, 1e-3)
"""Longest step [s] and coarsest accuracy: a humanoid that moves its legs then keeps its momentum within 0.1 %."""
_LOOK_EVERY = 5  # steps
_JUST_OVER = 1e-3  # m
_FALLS = 0.3
"""Part of gravity by which a body must gain speed downward before that is done."""


class Flight:
    """Looks whether a robot or a free piece touches nothing but itself, and sets the length of steps by that."""

    def __init__(self, plant: MultibodyPlant, solver: ContinuousSolver, simulator: Simulator) -> None:
        """Look after all floating bodies of a plant that a simulator steps by ``cenic``."""
        self._plant, self._solver = plant, solver
        self._simulator = weakref.ref(simulator)  # whose monitor holds this
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        floating = [joint for joint in joints if joint.type_name() == "quaternion_floating"]
        self._bodies = [_shapes(plant, joint) for joint in floating]
        self._upward = [joint.velocity_start() + 5 for joint in floating]  # after the angular part
        self._heights = [joint.position_start() + 6 for joint in floating]  # after the quaternion
        self._gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector()))
        self._steps, self._flies = 0, False
        self._time, self._speeds = -np.inf, np.zeros(len(floating))

    def look(self, root: Context) -> None:
        """Look at the state that a step has reached, now and then; to be called at the start and after each step."""
        self._steps += 1
        if self._steps % _LOOK_EVERY != 1 or not self._bodies:
            return
        flies = self._is_suspect(root) and self._is_one_free(root)
        if flies != self._flies and (simulator := self._simulator()) is not None:
            self._flies = flies
            bound_steps(simulator, self._solver, *(_IN_FLIGHT if flies else ()))

    def _is_suspect(self, root: Context) -> bool:
        """Tell whether something may fly: it did, or falls ever faster; to look at all shapes takes much longer."""
        time, before = root.get_time(), self._time
        speeds = self._plant.GetVelocities(self._plant.GetMyContextFromRoot(root))[self._upward]
        faster = (self._speeds - speeds).max()
        self._time, self._speeds = time, speeds
        return bool(self._flies or np.isinf(before) or faster >= _FALLS * self._gravity * (time - before))

    def _is_one_free(self, root: Context) -> bool:
        """Tell whether one touches nothing but itself; at the start, what stands just over something touches it."""
        plant, context = self._plant, self._plant.GetMyMutableContextFromRoot(root)
        if not plant.num_collision_geometries():
            return True
        if self._steps > 1:
            return self._is_apart(context)
        positions = plant.GetPositions(context)
        lower = positions.copy()
        lower[self._heights] -= _JUST_OVER
        plant.SetPositions(context, lower)
        free = self._is_apart(context)
        plant.SetPositions(context, positions)
        return free

    def _is_apart(self, context: Context) -> bool:
        query = self._plant.get_geometry_query_input_port().Eval(context)
        pairs = query.ComputePointPairPenetration() if query.HasCollisions() else []
        touched = [(pair.id_A, pair.id_B) for pair in pairs]
        return any(all((a in shapes) == (b in shapes) for a, b in touched) for shapes in self._bodies)


def _shapes(plant: MultibodyPlant, joint: Joint) -> set[GeometryId]:
    """Return the collision shapes of a joint's body and of all that hangs on it."""
    bodies = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    return {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(plant.get_body(body))}
