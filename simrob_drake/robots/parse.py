"""Add a URDF to a plant. Problems that Drake finds become errors that name the file.

The plant is that of a station, or a plant of the robot alone, which serves kinematics, checks and pictures of robots.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, Joint, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.bodies import merge_fixed_links
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.urdf import copy_of, drop_collision, with_absolute_meshes


def add_urdf(
    plant: MultibodyPlant,
    robot: ET.Element,
    *,
    name: str,
    where: Path | str,
    collision: bool = True,
) -> ModelInstanceIndex:
    """Add a robot to a plant. Links that are fixed to each other become one body; each keeps a frame of its name.

    Args:
        plant: the plant, not finalized.
        robot: a checked URDF with absolute names of meshes. It is not changed.
        name: prefix of the model instance's name.
        where: file of the robot, for messages.
        collision: whether the robot gets its collision shapes.

    Returns:
        the new model instance.

    Raises:
        InvalidModel: Drake cannot read the robot.
    """
    # A copy, since the caller's element still needs its fixed links and friction.
    reduced = copy_of(robot)
    if not collision:
        drop_collision(reduced)
    for actuator in reduced.iterfind("transmission/actuator"):
        # Drake ignores this element, and warns of each one.
        for gear in actuator.findall("mechanicalReduction"):
            actuator.remove(gear)
    for dynamics in reduced.iterfind("joint/dynamics"):
        # Drake ignores friction as well, and warns of it. A station adds friction by a block of its own.
        dynamics.attrib.pop("friction", None)
    # Fewer bodies make each evaluation of the plant faster.
    merge_fixed_links(reduced)
    parser = Parser(plant, model_name_prefix=name)
    try:
        return parser.AddModelsFromString(ET.tostring(reduced, encoding="unicode"), "urdf")[0]
    # Failed assertions of Drake come as SystemExit.
    except (RuntimeError, ValueError, SystemExit) as problem:
        # Drake names the line of the text that it was given, which the user has never seen. It is removed.
        one_line = " ".join(str(problem).split())
        text = re.sub(r"<literal-string>\S*:\d+: (error: )?", "", one_line)
        raise InvalidModel(
            where,
            "",
            message(
                "robots.drake_cannot_read",
                "Drake cannot read this file: {problem}",
                problem=text,
            ),
        ) from problem


def held_robot(
    model: RobotModel, element: ET.Element | None = None
) -> tuple[MultibodyPlant, Frame]:
    """Make a plant of a robot alone, whose root is fixed to the world at its origin.

    The plant has standard gravity along -z. It has no shapes, so that files of meshes are not read.

    Args:
        model: the robot.
        element: URDF of the robot with the pieces that it carries; the robot's own URDF unless given.

    Returns:
        the finalized plant, and the frame of the robot's root.

    Raises:
        InvalidModel: Drake cannot read the URDF.
    """
    # A time step of 0 makes a continuous plant. Kinematics and inverse dynamics need no steps.
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    robot = model.element if element is None else element
    add_urdf(plant, robot, name=model.name, where=model.urdf_path, collision=False)
    root = plant.GetFrameByName(model.root)
    plant.WeldFrames(plant.world_frame(), root)
    plant.Finalize()
    return plant, root


@dataclass(frozen=True)
class LoneRobot:
    """The finalized plant of a robot alone, in a diagram that is not built yet.

    Attributes:
        builder: builder of the diagram. It owns the plant and the scene graph, so keep it as long as these.
        plant: the plant.
        scene_graph: the scene graph.
        instance: model instance of the robot.
        joints: joints of the axes, in order.
        axes: indices of the axes in the plant, and their senses.
    """

    builder: DiagramBuilder
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    joints: list[Joint]
    axes: AxisMap

    def origins(self) -> Vector:
        """Compute the origins of the m bodies at the default posture, shape (m, 3) [m], without that of the world."""
        # Body 0 is the world, whose origin says nothing about the robot.
        context = self.plant.CreateDefaultContext()
        bodies = [
            self.plant.get_body(BodyIndex(index)) for index in range(1, self.plant.num_bodies())
        ]
        return np.array(
            [self.plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies]
        )

    @property
    def size(self) -> float:
        """Largest extent of the bodies' origins along x, y or z at the default posture [m]."""
        return float(np.max(np.ptp(self.origins(), axis=0)))


def lone_robot(robot: RobotModel, *, floating: bool = False, collision: bool = True) -> LoneRobot:
    """Build the plant of a robot alone. Its default posture is its home posture.

    Args:
        robot: the robot.
        floating: whether the root moves freely. Otherwise it is fixed to the world.
        collision: whether the robot gets its collision shapes.

    Raises:
        InvalidModel: Drake cannot read the robot; or a mesh is missing, is outside the robot's folder, or has a format
            that Drake does not read.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    # Drake parses a text, which has no folder to which names of meshes could be relative.
    element = with_absolute_meshes(robot.element, robot.folder)
    instance = add_urdf(plant, element, name=robot.name, where=robot.urdf_path, collision=collision)
    if not floating:
        root = plant.GetFrameByName(robot.root, instance)
        plant.WeldFrames(plant.world_frame(), root)
    plant.Finalize()

    joints = [plant.GetJointByName(axis.joint, instance) for axis in robot.axes.values()]
    axes = AxisMap.of_joints(plant, joints, robot.signs)
    # Positions of joints have the senses of the joints, those of the home posture the senses of the axes.
    joint_positions = axes.signs * robot.home
    for joint, position in zip(joints, joint_positions, strict=True):
        joint.set_default_positions(np.array([position]))
    return LoneRobot(
        builder=builder,
        plant=plant,
        scene_graph=scene_graph,
        instance=instance,
        joints=joints,
        axes=axes,
    )
