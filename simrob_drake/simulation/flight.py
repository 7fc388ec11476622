"""Keep the momentum of what flies, of which the first-order steps of `cenic` lose a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import Context

from simrob_drake.frames import Vector

_LOOK_EVERY = 5  # steps, while all stand: to look whether they fly takes a tenth of the time of a step


class Flight:
    """Corrects the steps at whose start and end a robot or a free piece touches nothing but itself.

    Whatever its servos do, its momentum then grows by its weight's impulse, its angular momentum about the centre of
    mass stays, and the centre of mass goes along a parabola. What is off is given to the velocity and the place of its
    floating body. Steps with a force wired to the plant stay as they are.
    """

    def __init__(self, plant: MultibodyPlant) -> None:
        """Look after all floating bodies of a plant in continuous time."""
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        self._plant, self._time, self._steps = plant, 0.0, -1
        self._trees = [_Tree(plant, joint) for joint in joints if joint.type_name() == "quaternion_floating"]
        self._flying: dict[_Tree, _Motion] = {}

    def correct(self, root: Context) -> None:
        """Correct the step that ended in a context of the diagram; the first call tells where the first step starts."""
        before, length = self._flying, root.get_time() - self._time
        self._time, self._steps, self._flying = root.get_time(), self._steps + 1, {}
        if not before and self._steps % _LOOK_EVERY:
            return
        context = self._plant.GetMyMutableContextFromRoot(root)
        context.get_mutable_continuous_state()  # after steps of one length Drake 1.51 holds figures of their starts
        for tree in self._free(context):
            motion = tree.motion(context)
            corrects = tree in before and length > 0
            self._flying[tree] = tree.carry_on(context, before[tree], motion, length) if corrects else motion

    def _free(self, context: Context) -> list[_Tree]:
        plant = self._plant
        forces = plant.get_applied_generalized_force_input_port(), plant.get_applied_spatial_force_input_port()
        if not self._trees or any(port.HasValue(context) for port in forces):
            return []
        if not plant.num_collision_geometries():
            return self._trees
        query = plant.get_geometry_query_input_port().Eval(context)
        if not query.HasCollisions():
            return self._trees
        pairs = query.ComputePointPairPenetration()
        return [tree for tree in self._trees if not any(tree.is_touched(pair.id_A, pair.id_B) for pair in pairs)]


@dataclass(frozen=True)
class _Motion:
    """Of a floating body with all that hangs on it, in the world."""

    inertia: Vector  # about the body's origin, shape (6, 6), rotation first
    centre: Vector  # of mass [m]
    linear: Vector  # momentum [N s]
    angular: Vector  # momentum about the centre of mass [N m s]


class _Tree:
    """A floating body with all that hangs on it."""

    def __init__(self, plant: MultibodyPlant, joint: Joint) -> None:
        self._plant = plant
        self._rates = slice(joint.velocity_start(), joint.velocity_start() + 6)
        self._place = slice(joint.position_start() + 4, joint.position_start() + 7)
        bodies = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
        self._shapes = {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(plant.get_body(body))}

    def is_touched(self, first: GeometryId, second: GeometryId) -> bool:
        """Tell whether one of two shapes belongs to it, and the other one does not."""
        return (first in self._shapes) != (second in self._shapes)

    def motion(self, context: Context) -> _Motion:
        """Return its motion, which the rows of the mass matrix that belong to the floating body tell."""
        rows = self._plant.CalcMassMatrix(context)[self._rates]
        inertia, momentum = rows[:, self._rates], rows @ self._plant.GetVelocities(context)
        lever = _lever(inertia)
        centre = self._plant.GetPositions(context)[self._place] + lever[[2, 0, 1], [1, 2, 0]]
        return _Motion(inertia, centre, momentum[3:], momentum[:3] - lever @ momentum[3:])

    def carry_on(self, context: Context, before: _Motion, now: _Motion, length: float) -> _Motion:
        """Set velocity and place of the floating body so that nothing but gravity acted since; return its motion."""
        mass = now.inertia[3, 3]
        linear = before.linear + length * mass * self._plant.gravity_field().gravity_vector()
        centre = before.centre + length / mass * (before.linear + linear) / 2
        change = linear - now.linear
        missing = np.append(before.angular - now.angular + _lever(now.inertia) @ change, change)
        positions, velocities = self._plant.GetPositions(context), self._plant.GetVelocities(context)
        positions[self._place] += centre - now.centre
        velocities[self._rates] += np.linalg.solve(now.inertia, missing)
        self._plant.SetPositions(context, positions)
        self._plant.SetVelocities(context, velocities)
        return _Motion(now.inertia, centre, linear, before.angular)


def _lever(inertia: Vector) -> Vector:
    """Return the matrix of the cross product with the way from a body's origin to the centre of mass, shape (3, 3)."""
    return np.asarray(inertia[:3, 3:] / inertia[3, 3])
