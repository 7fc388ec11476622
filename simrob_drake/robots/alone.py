"""A robot alone in a plant: for what can be said or shown of it without any station."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.frames import Vector
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes


@dataclass(frozen=True)
class LoneRobot:
    """A robot's finalized plant, in a diagram that is still open.

    Attributes:
        builder: owns plant and scene graph; keep it as long as them.
        joints: of the axes, in order.
        axes: where they stand in the plant, and their senses.
    """

    builder: DiagramBuilder
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    joints: list[Joint]
    axes: AxisMap

    def set_axes(self, context: Context, positions: Vector) -> None:
        """Put the axes to positions, shape (n,) [rad or m], in a context of the plant."""
        self.axes.set_positions(self.plant, context, positions)

    def origins(self) -> Vector:
        """Return where the links are at the default posture, shape (m, 3) [m]."""
        context = self.plant.CreateDefaultContext()
        bodies = [self.plant.get_body(BodyIndex(index)) for index in range(1, self.plant.num_bodies())]
        return np.array([self.plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies])

    @property
    def size(self) -> float:
        """The largest extent of the links' origins at the default posture [m]."""
        return float(np.max(np.ptp(self.origins(), axis=0)))


def lone_robot(robot: RobotModel, *, floating: bool = False, collision: bool = True) -> LoneRobot:
    """Build a robot alone, at its home posture by default.

    Args:
        robot: what to build.
        floating: leave its base free; else its root link is fixed to the world's origin.
        collision: keep its collision geometry.

    Raises:
        InvalidModel: Drake cannot build it.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    element = with_absolute_meshes(robot.element, robot.folder)
    instance = add_urdf(plant, element, name=robot.name, where=robot.urdf_path, collision=collision)
    if not floating:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(robot.root, instance))
    plant.Finalize()
    joints = [plant.GetJointByName(axis.joint, instance) for axis in robot.axes.values()]
    axes = AxisMap.of_joints(plant, joints, robot.signs)
    for joint, position in zip(joints, axes.signs * robot.home, strict=True):
        joint.set_default_positions(np.array([position]))
    return LoneRobot(builder, plant, scene_graph, instance, joints, axes)
