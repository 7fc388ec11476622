r"""The bodies of a robot as arrays: poses and mass points of many postures at once.

Every rigid body is held as six mass points that have its mass, its centre of mass and its tensor of inertia, so that
sums over points give the exact momentum. With the second moments :math:`s_k = (\mathrm{tr} J / 2 - J_k) / m` along the
principal axes the points lie at :math:`\pm\sqrt{3 s_k}` on them, each with a sixth of the mass.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, RigidBody
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain, Screws, axes_and_points, joints_between
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel, load_robot
from simrob_drake.robots.parse import held_robot


@dataclass(frozen=True, eq=False, kw_only=True)
class Skeleton(Screws):
    """A robot whose n joints are all axes and revolute; its n + 1 bodies are those of :meth:`frames`."""

    model: RobotModel  # the robot
    masses: Vector  # of the bodies, shape (n + 1,) [kg]
    mass_points_at_zero: Vector  # homogeneous, shape (n + 1, 4, 6) [m]
    links: dict[str, tuple[int, Vector]]  # body and pose at zero (4, 4) of every named frame
    plant: MultibodyPlant  # the robot alone

    @property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        return float(self.masses.sum())

    @property
    def point_masses(self) -> Vector:
        """Of the mass points, shape (6 (n + 1),) [kg]."""
        return np.repeat(self.masses / 6, 6)

    def mass_points(self, frames: Vector) -> Vector:
        """Return where the mass points are, shape (k, 6 (n + 1), 3) [m], from :meth:`frames`."""
        points = frames[..., :3, :] @ self.mass_points_at_zero[:, np.newaxis]  # (n + 1, k, 3, 6)
        return np.asarray(points.transpose(1, 0, 3, 2).reshape(frames.shape[1], -1, 3))

    def link_poses(self, link: str, frames: Vector) -> Vector:
        """Return the poses of a named frame, shape (k, 4, 4), from :meth:`frames`."""
        body, pose = self.links[link]
        return np.asarray(frames[body] @ pose)

    def limb(self, link: str, tool: Vector) -> tuple[tuple[int, ...], Chain]:
        """Return the axes from the root to a named frame, and their chain to a pose (4, 4) in it, without limits."""
        root, end = (self.plant.GetFrameByName(name) for name in (self.model.root, link))
        joints = [joint for joint, _ in joints_between(self.plant, root, end)]
        places = {axis.joint: place for place, axis in enumerate(self.model.axes.values())}
        axes = tuple(places[joint.name()] for joint in joints)
        signs = [list(self.model.axes.values())[place].sign for place in axes]
        chain = Chain.of_plant(self.plant, joints=joints, base=root, tool=end, signs=signs).with_tool(tool)
        free = np.full(len(axes), np.inf)
        return axes, replace(chain, lower=-free, upper=free)


def skeleton_of(robot: str | RobotModel, element: Element | None = None) -> Skeleton:
    """Return the skeleton of a robot of the package by its name, or of any other's model.

    ``element`` is its URDF with what it carries, mesh names absolute; its own unless given.

    Raises:
        InvalidParameter: a robot with a joint that is no axis, or prismatic.
    """
    return _of_package(robot) if isinstance(robot, str) else _of_model(robot, element)


@lru_cache(maxsize=8)
def _of_package(robot: str) -> Skeleton:
    return _of_model(load_robot(robot))


def _of_model(model: RobotModel, element: Element | None = None) -> Skeleton:
    plant, root = held_robot(model, element)
    joints = [plant.GetJointByName(axis.joint) for axis in model.axes.values()]
    names = [joint.name() for joint in joints]
    moving = [joint for joint in map(plant.get_joint, plant.GetJointIndices()) if joint.num_velocities()]
    odd = [joint.name() for joint in moving if not isinstance(joint, RevoluteJoint) or joint.name() not in names]
    if odd:
        expected = message("kinematics.robot_of_revolute_axes", "one whose joints are all axes and revolute")
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message("kinematics.with_joints", "with the joints {joints}", joints=", ".join(odd)),
            expected,
        )
    paths = [[names.index(on.name()) for on, _ in joints_between(plant, root, j.frame_on_child())] for j in joints]
    order = sorted(range(len(joints)), key=lambda axis: len(paths[axis]))
    own = AxisMap.of_joints(plant, joints, [axis.sign for axis in model.axes.values()])
    context = plant.CreateDefaultContext()
    own.set_positions(plant, context, np.zeros(len(joints)))
    axes, points = axes_and_points(context, joints, root)
    bodies = [root.body(), *(joints[axis].child_body() for axis in order)]
    place = {body.index(): number for number, body in enumerate(bodies)}
    frames = [plant.get_frame(index) for index in plant.GetFrameIndices(root.model_instance())]
    return Skeleton(
        model=model,
        axes=own.signs[:, np.newaxis] * axes,
        points=points,
        revolute=np.ones(len(joints), dtype=bool),
        order=tuple(order),
        after=tuple(order.index(paths[axis][-2]) + 1 if len(paths[axis]) > 1 else 0 for axis in order),
        masses=np.array([body.default_mass() for body in bodies]),
        mass_points_at_zero=np.array([_at_zero(body, context) for body in bodies]),
        links={
            frame.name(): (place[frame.body().index()], frame.CalcPoseInWorld(context).GetAsMatrix4())
            for frame in frames
            if frame.body().index() in place
        },
        plant=plant,
    )


def _at_zero(body: RigidBody, context: Context) -> Vector:
    """Return the six homogeneous points, shape (4, 6) [m], that stand for a body, where it is in a context."""
    inertia = body.default_spatial_inertia()
    centre = inertia.get_com()
    about_centre = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    moments, axes = np.linalg.eigh(about_centre)
    spread = np.maximum(moments.sum() / 2 - moments, 0.0) / max(inertia.get_mass(), 1e-12)
    arms = axes * np.sqrt(3.0 * spread)
    points = np.vstack([centre[:, np.newaxis] + np.hstack([arms, -arms]), np.ones(6)])
    return np.asarray(body.body_frame().CalcPoseInWorld(context).GetAsMatrix4() @ points)
