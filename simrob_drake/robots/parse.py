"""From a URDF to a model instance of a plant, with Drake's complaints as errors that name the file.

The plant is a station's, or one of the robot alone: for what can be said or shown of it without any station.
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
from simrob_drake.robots.urdf import copied, drop_collision, with_absolute_meshes


def add_urdf(
    plant: MultibodyPlant, robot: ET.Element, *, name: str, where: Path | str, collision: bool = True
) -> ModelInstanceIndex:
    """Add a robot to a plant, links that are rigidly joined as one body; each keeps a frame of its name.

    The plant is not finalized; the ``robot`` element is checked, its mesh names absolute, and it is not changed.
    ``name`` stands before the model's own, ``collision`` keeps its shapes. Raises InvalidModel, called ``where``: Drake
    cannot read it.
    """
    reduced = copied(robot)
    if not collision:
        drop_collision(reduced)
    for actuator in reduced.iterfind("transmission/actuator"):
        for gear in actuator.findall("mechanicalReduction"):  # Drake does not heed it, and says so of each
            actuator.remove(gear)
    for dynamics in reduced.iterfind("joint/dynamics"):
        dynamics.attrib.pop("friction", None)  # nor this, which RobotModel.friction tells
    merge_fixed_links(reduced)
    parser = Parser(plant, model_name_prefix=name)
    try:
        return parser.AddModelsFromString(ET.tostring(reduced, encoding="unicode"), "urdf")[0]
    except (RuntimeError, ValueError, SystemExit) as problem:  # failed assertions come as SystemExit
        text = re.sub(r"<literal-string>\S*:\d+: (error: )?", "", " ".join(str(problem).split()))
        raise InvalidModel(
            where, "", message("robots.drake_cannot_read", "Drake cannot read it: {problem}", problem=text)
        ) from problem


def held_robot(model: RobotModel, element: ET.Element | None = None) -> tuple[MultibodyPlant, Frame]:
    """Return a plant of a robot alone, and its root, which stands at the world's origin.

    It has no shapes, so no mesh is looked for. ``element`` is its URDF with what it carries; its own unless given.
    Raises InvalidModel: a URDF that Drake cannot read.
    """
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
    """A robot's finalized plant, in a diagram that is still open."""

    builder: DiagramBuilder  # owns plant and scene graph; keep it as long as them
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    joints: list[Joint]  # of the axes, in order
    axes: AxisMap  # where they stand in the plant, and their senses

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
    """Build a robot alone, at home by default, held unless ``floating``; raises InvalidModel: Drake cannot build it."""
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
