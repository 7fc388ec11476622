r"""The bodies of a robot as arrays: poses and mass points of many postures at once.

Each rigid body is represented by six mass points that have its mass, its centre of mass and its inertia tensor. So sums
over points give the exact momentum. With the principal moments of inertia :math:`J_k` about the centre of mass, the
points lie on the principal axes, at the distances

.. math:: \pm\sqrt{3 s_k}, \qquad s_k = (\mathrm{tr} J / 2 - J_k) / m

and each has a sixth of the mass m.

"At zero" is with all axes at 0. The motion of a body is the pose (4, 4) by which it has moved since then, in the frame
of the root link.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, RevoluteJoint, RigidBody
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain, Screws, axes_and_points, joints_between
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel, load_robot
from simrob_drake.robots.parse import held_robot

_LEAST_MASS = 1e-12
"""Mass that bodies without mass get, so that nothing is divided by 0 [kg]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Skeleton(Screws):
    """A robot whose n joints are all axes and revolute. Its n + 1 bodies are in the order of :meth:`frames`.

    Attributes:
        model: the robot.
        masses: masses of the bodies, shape (n + 1,) [kg].
        mass_points_at_zero: homogeneous coordinates of the mass points of each body at zero, shape (n + 1, 4, 6) [m].
        links: for each named frame, the index of its body and its pose at zero, shape (4, 4).
        plant: a plant of the robot alone.
    """

    model: RobotModel
    masses: Vector
    mass_points_at_zero: Vector
    links: dict[str, tuple[int, Vector]]
    plant: MultibodyPlant

    @property
    def mass(self) -> float:
        """Mass of the robot [kg]."""
        return float(self.masses.sum())

    @property
    def point_masses(self) -> Vector:
        """Masses of the mass points, shape (6 (n + 1),) [kg]."""
        return np.repeat(self.masses / 6, 6)

    def mass_points(self, frames: Vector) -> Vector:
        """Positions of the mass points, shape (k, 6 (n + 1), 3) [m], body by body.

        Args:
            frames: motions of the bodies in k postures, shape (n + 1, k, 4, 4), from :meth:`frames`.
        """
        # Shape (n + 1, k, 3, 6): the points of all bodies at once, for all postures.
        points = frames[..., :3, :] @ self.mass_points_at_zero[:, np.newaxis]
        return np.asarray(points.transpose(1, 0, 3, 2).reshape(frames.shape[1], -1, 3))

    def link_poses(self, link: str, frames: Vector) -> Vector:
        """Poses of a named frame, shape (k, 4, 4).

        Args:
            link: name of the frame, one of :attr:`links`.
            frames: motions of the bodies in k postures, shape (n + 1, k, 4, 4), from :meth:`frames`.
        """
        body, pose = self.links[link]
        return np.asarray(frames[body] @ pose)

    def limb(self, link: str, tool: Vector) -> tuple[tuple[int, ...], Chain]:
        """Extract the chain from the root to a tool in a named frame.

        Args:
            link: name of the frame.
            tool: pose of the tool in the frame, shape (4, 4).

        Returns:
            the indices of the axes from the root to the frame, and their chain, without joint limits.
        """
        # The root is the base of every path here, so that all joints lead outward and their senses are 1.
        root = self.plant.GetFrameByName(self.model.root)
        end = self.plant.GetFrameByName(link)
        joints = [joint for joint, _ in joints_between(self.plant, root, end)]

        # The chain needs the signs of its own axes only, in its own order.
        own_axes = list(self.model.axes.values())
        index_of_joint = {axis.joint: index for index, axis in enumerate(own_axes)}
        indices = tuple(index_of_joint[joint.name()] for joint in joints)
        signs = [own_axes[index].sign for index in indices]
        chain_to_frame = Chain.of_plant(self.plant, joints=joints, base=root, tool=end, signs=signs)
        chain = chain_to_frame.with_tool(tool)

        # A planned walk must not be bent by a limit: whether it exceeds one is checked, and reported, afterwards.
        unlimited = np.full(len(indices), np.inf)
        return indices, replace(chain, lower=-unlimited, upper=unlimited)


def skeleton_of(robot: str | RobotModel, element: Element | None = None) -> Skeleton:
    """Make the skeleton of a robot.

    Args:
        robot: name of a robot of the package or of an extension, or the model of any robot.
        element: URDF of the robot with the pieces that it carries, with absolute names of meshes; the robot's own URDF
            unless given. It counts only if ``robot`` is a model.

    Raises:
        UnknownName: there is no robot of this name.
        InvalidParameter: the robot has a moving joint that is not an axis, or that is not revolute.
    """
    return _of_package(robot) if isinstance(robot, str) else _of_model(robot, element)


@lru_cache(maxsize=8)
def _of_package(robot: str) -> Skeleton:
    """Make the skeleton of a robot by its name, once. Files of installed robots do not change while Python runs."""
    return _of_model(load_robot(robot))


def _of_model(model: RobotModel, element: Element | None = None) -> Skeleton:
    """Make the skeleton of a model.

    Args:
        model: the robot.
        element: URDF of the robot with the pieces that it carries; the robot's own URDF unless given.

    Raises:
        InvalidParameter: the robot has a joint that is not an axis, or a prismatic joint.
    """
    plant, root = held_robot(model, element)
    joints = [plant.GetJointByName(axis.joint) for axis in model.axes.values()]
    _check_joints(model, plant, joints)

    # The axes from the root to the body that each axis carries, this axis included.
    axis_of_joint = {joint.name(): axis for axis, joint in enumerate(joints)}
    paths = []
    for joint in joints:
        path = joints_between(plant, root, joint.frame_on_child())
        paths.append([axis_of_joint[other.name()] for other, _ in path])

    # A carrier has a shorter path than the axes on it, so that sorting by length puts it before them.
    outward = sorted(range(len(joints)), key=lambda axis: len(paths[axis]))
    # The body on which each axis stands: 0 is the root, i is carried by the i-th axis.
    carriers = []
    for axis in outward:
        if len(paths[axis]) == 1:
            carriers.append(0)
            continue
        axis_before = paths[axis][-2]
        carriers.append(outward.index(axis_before) + 1)

    # Masses and frames are taken at zero posture, as the screws are; motions then multiply them.
    axis_map = AxisMap.of_joints(plant, joints, [axis.sign for axis in model.axes.values()])
    context = plant.CreateDefaultContext()
    axis_map.set_positions(plant, context, np.zeros(len(joints)))
    axes, points = axes_and_points(context, joints, root)
    bodies = [root.body(), *(joints[axis].child_body() for axis in outward)]
    return Skeleton(
        model=model,
        axes=axis_map.signs[:, np.newaxis] * axes,
        points=points,
        revolute=np.ones(len(joints), dtype=bool),
        order=tuple(outward),
        after=tuple(carriers),
        masses=np.array([body.default_mass() for body in bodies]),
        mass_points_at_zero=np.array([_mass_points(body, context) for body in bodies]),
        links=_links(plant, root, bodies, context),
        plant=plant,
    )


def _check_joints(model: RobotModel, plant: MultibodyPlant, joints: Sequence[Joint]) -> None:
    """Check that all moving joints of a plant are revolute axes of the robot.

    Raises:
        InvalidParameter: a moving joint is not an axis, or is not revolute.
    """
    # Welds have no velocities.
    axis_joints = [joint.name() for joint in joints]
    moving = [
        joint for joint in map(plant.get_joint, plant.GetJointIndices()) if joint.num_velocities()
    ]
    unsuitable = [
        joint.name()
        for joint in moving
        if not isinstance(joint, RevoluteJoint) or joint.name() not in axis_joints
    ]
    if unsuitable:
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message(
                "kinematics.with_joints", "with the joints {joints}", joints=", ".join(unsuitable)
            ),
            message(
                "kinematics.robot_of_revolute_axes", "a robot whose joints are all revolute axes"
            ),
        )


def _links(
    plant: MultibodyPlant, root: Frame, bodies: Sequence[RigidBody], context: Context
) -> dict[str, tuple[int, Vector]]:
    """Find the body and the pose at zero of each named frame of a robot.

    Args:
        plant: the plant of the robot, whose root is welded to the world's origin.
        root: frame of the root link.
        bodies: bodies of the skeleton, in its order.
        context: a context in which all axes are at zero.

    Returns:
        for each name of a frame, the index of its body in ``bodies`` and its pose in the world, shape (4, 4). Frames on
        other bodies are left out.
    """
    index_of_body = {body.index(): index for index, body in enumerate(bodies)}
    frames = [plant.get_frame(index) for index in plant.GetFrameIndices(root.model_instance())]
    return {
        frame.name(): (
            index_of_body[frame.body().index()],
            frame.CalcPoseInWorld(context).GetAsMatrix4(),
        )
        for frame in frames
        if frame.body().index() in index_of_body
    }


def _mass_points(body: RigidBody, context: Context) -> Vector:
    """Compute the six mass points of a body in the world, by the equation of the module.

    Args:
        body: the body.
        context: context of its plant, with the pose of the body.

    Returns:
        homogeneous coordinates of the points, one a column, shape (4, 6) [m].
    """
    # Drake gives inertias about the body's origin. The eigenvectors of that about the centre of mass are the principal
    # axes, the columns of `axes`.
    inertia = body.default_spatial_inertia()
    centre = inertia.get_com()
    about_centre = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    moments, axes = np.linalg.eigh(about_centre)

    # s_k = (tr J / 2 - J_k) / m. It is not negative for a physical body, except by rounding.
    mass = max(inertia.get_mass(), _LEAST_MASS)
    spread = np.maximum(moments.sum() / 2 - moments, 0.0) / mass
    # Two points on each principal axis, at ±sqrt(3 s_k). The fourth coordinate of all points is 1.
    arms = axes * np.sqrt(3.0 * spread)
    places = centre[:, np.newaxis] + np.hstack([arms, -arms])
    points = np.vstack([places, np.ones(6)])
    pose = body.body_frame().CalcPoseInWorld(context).GetAsMatrix4()
    return np.asarray(pose @ points)
