r"""The bodies of a robot as arrays: poses and mass points of many postures at once.

Every rigid body is held as six mass points that have its mass, its centre of mass and its tensor of inertia, so that
sums over points give the exact momentum. With the second moments :math:`s_k = (\mathrm{tr} J / 2 - J_k) / m` along the
principal axes the points lie at :math:`\pm\sqrt{3 s_k}` on them, each with a sixth of the mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, RigidBody

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.robots.alone import lone_robot
from simrob_drake.robots.catalog import RobotModel, load_robot

ROOT = 0
"""Place of the root among the bodies; axis ``i`` moves body ``i + 1``."""


@dataclass(frozen=True)
class Poses:
    """Poses of b bodies in m postures: ``rotation`` (b, m, 3, 3) and ``position`` (b, m, 3) [m]."""

    rotation: Vector
    position: Vector


@dataclass(frozen=True)
class Skeleton:
    """A robot with n axes and n + 1 bodies.

    Attributes:
        model: the robot.
        parents: body that each axis hangs on, by axis.
        order: axes, each after those it hangs on.
        before: pose of each joint in its parent body at zero, rotation (n, 3, 3) and position (n, 3) [m].
        directions: axes in the joints' frames, positive in the robot's sense, shape (n, 3).
        after: pose of each moved body in its joint's moving frame.
        points: mass points in their bodies, shape (n + 1, 3, 6) [m].
        masses: of the bodies, shape (n + 1,) [kg].
        frames: body, rotation and position of every named frame.
    """

    model: RobotModel
    parents: tuple[int, ...]
    order: tuple[int, ...]
    before: tuple[Vector, Vector]
    directions: Vector
    after: tuple[Vector, Vector]
    points: Vector
    masses: Vector
    frames: dict[str, tuple[int, Vector, Vector]]

    @property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        return float(self.masses.sum())

    def path(self, frame: str) -> list[int]:
        """Return the axes between the root and a named frame, the root's side first."""
        body, axes = self.frames[frame][0], []
        while body != ROOT:
            axes.append(body - 1)
            body = self.parents[body - 1]
        return axes[::-1]

    def poses(self, root: tuple[Vector, Vector], angles: Vector, axes: list[int] | None = None) -> Poses:
        """Return the poses of all bodies, or of the root and those that some axes move.

        Args:
            root: rotation (m, 3, 3) and position (m, 3) of the root [m].
            angles: of all axes, shape (m, n) [rad].
            axes: which to follow, each after those it hangs on; all of them unless given.
        """
        count = len(angles)
        rotation = np.empty((len(self.parents) + 1, count, 3, 3))
        position = np.empty((len(self.parents) + 1, count, 3))
        rotation[ROOT], position[ROOT] = root
        for axis in self.order if axes is None else axes:
            parent, (fixed, across) = self.parents[axis], (self.before, self.after)
            # before * turn * after as one sum of constant matrices: a product of many small ones less
            turn = _turn_parts(self.directions[axis])
            parts = fixed[0][axis] @ turn @ across[0][axis]
            sine, versine = np.sin(angles[:, axis, None, None]), 1.0 - np.cos(angles[:, axis, None, None])
            rotation[axis + 1] = rotation[parent] @ (parts[0] + sine * parts[1] + versine * parts[2])
            offset = fixed[1][axis]
            if across[1][axis].any():
                arms = fixed[0][axis] @ turn @ across[1][axis]
                offset = (offset + arms[0] + sine[:, 0] * arms[1] + versine[:, 0] * arms[2])[..., np.newaxis]
                position[axis + 1] = position[parent] + (rotation[parent] @ offset)[..., 0]
            else:
                position[axis + 1] = position[parent] + rotation[parent] @ offset
        return Poses(rotation, position)

    def mass_points(self, poses: Poses) -> Vector:
        """Return where the mass points are, shape (m, 6 (n + 1), 3) [m]."""
        points = poses.position[..., np.newaxis] + poses.rotation @ self.points[:, np.newaxis]  # (b, m, 3, 6)
        count = points.shape[1]
        return np.asarray(points.transpose(1, 0, 3, 2).reshape(count, -1, 3))

    @property
    def point_masses(self) -> Vector:
        """Of the mass points, shape (6 (n + 1),) [kg]."""
        return np.repeat(self.masses / 6, 6)


def rotations_about(direction: Vector, angles: Vector) -> Vector:
    """Return rotations about one unit vector (3,) by many angles (m,), shape (m, 3, 3)."""
    parts = _turn_parts(direction)
    sine, versine = np.sin(angles)[:, np.newaxis, np.newaxis], 1.0 - np.cos(angles)[:, np.newaxis, np.newaxis]
    return np.asarray(parts[0] + sine * parts[1] + versine * parts[2])


def _turn_parts(direction: Vector) -> Vector:
    """Return the constant parts of 1 + sin(a) K + (1 - cos(a)) K² (Rodrigues' formula), shape (3, 3, 3)."""
    x, y, z = direction
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.array([np.eye(3), cross, cross @ cross])


def skeleton_of(robot: str | RobotModel) -> Skeleton:
    """Return the skeleton of a robot of the package by its name, or of any other's model; see :func:`skeleton`."""
    return _of_package(robot) if isinstance(robot, str) else skeleton(robot)


@lru_cache(maxsize=8)
def _of_package(robot: str) -> Skeleton:
    return skeleton(load_robot(robot))


def skeleton(model: RobotModel) -> Skeleton:
    """Return the skeleton of a robot whose joints are all axes and turn.

    Raises:
        InvalidParameter: a robot with a joint that is no axis, or that slides.
    """
    alone = lone_robot(model, floating=True, collision=False)
    plant, instance, joints = alone.plant, alone.instance, alone.joints
    moving = [joint for joint in map(plant.get_joint, plant.GetJointIndices(instance)) if joint.num_velocities() == 1]
    odd = [joint.name() for joint in moving if joint.type_name() != "revolute" or joint.name() not in _names(joints)]
    if odd:
        raise InvalidParameter(f"robot {model.name}", f"with the joints {', '.join(odd)}", "one whose axes all turn")
    bodies = [plant.GetFrameByName(model.root, instance).body(), *(joint.child_body() for joint in joints)]
    index = {body.index(): place for place, body in enumerate(bodies)}
    parents = tuple(index[joint.parent_body().index()] for joint in joints)
    before = [joint.frame_on_parent().GetFixedPoseInBodyFrame() for joint in joints]
    after = [joint.frame_on_child().GetFixedPoseInBodyFrame().inverse() for joint in joints]
    return Skeleton(
        model=model,
        parents=parents,
        order=_outward(parents),
        before=(_stack([x.rotation().matrix() for x in before]), _stack([x.translation() for x in before])),
        directions=alone.axes.signs[:, np.newaxis] * _stack([joint.revolute_axis() for joint in joints]),
        after=(_stack([x.rotation().matrix() for x in after]), _stack([x.translation() for x in after])),
        points=_stack([_points(body) for body in bodies]),
        masses=np.array([body.default_mass() for body in bodies]),
        frames=_named_frames(plant, instance, index),
    )


def _names(joints: list[Joint]) -> list[str]:
    return [joint.name() for joint in joints]


def _stack(rows: list[Vector]) -> Vector:
    return np.array(rows, dtype=float)


def _outward(parents: tuple[int, ...]) -> tuple[int, ...]:
    """Return the axes, each after the one that moves the body it hangs on."""
    ordered: list[int] = []
    while len(ordered) < len(parents):
        placed = {ROOT, *(axis + 1 for axis in ordered)}
        ordered += [axis for axis, parent in enumerate(parents) if parent in placed and axis not in ordered]
    return tuple(ordered)


def _points(body: RigidBody) -> Vector:
    """Return the six points, shape (3, 6) [m], that stand for a body."""
    inertia = body.default_spatial_inertia()
    centre = inertia.get_com()
    about_centre = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    moments, axes = np.linalg.eigh(about_centre)
    spread = np.maximum(moments.sum() / 2 - moments, 0.0) / max(inertia.get_mass(), 1e-12)
    arms = axes * np.sqrt(3.0 * spread)
    return np.asarray(centre[:, np.newaxis] + np.hstack([arms, -arms]))


def _named_frames(
    plant: MultibodyPlant, instance: ModelInstanceIndex, index: dict[object, int]
) -> dict[str, tuple[int, Vector, Vector]]:
    frames = {}
    for number in plant.GetFrameIndices(instance):
        frame = plant.get_frame(number)
        if frame.body().index() in index:
            pose = frame.GetFixedPoseInBodyFrame()
            frames[frame.name()] = (index[frame.body().index()], pose.rotation().matrix(), pose.translation())
    return frames
