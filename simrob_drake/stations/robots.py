"""Put the robots of a station into its plant, with the pieces that they carry."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame

from simrob_drake.blocks.actuator_servo import set_actuators
from simrob_drake.errors import InvalidModel
from simrob_drake.frames import transform_from_pose
from simrob_drake.parts.site import ResolvedRobot, StationRobot
from simrob_drake.robots.feet import put_on_feet
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.piece_urdf import add_piece
from simrob_drake.robots.pieces import TCP
from simrob_drake.robots.urdf import with_absolute_meshes
from simrob_drake.stations.resolve import ResolvedStation


def add_robot(
    plant: MultibodyPlant, station: ResolvedStation, robot: ResolvedRobot, *, collision: bool
) -> StationRobot:
    """Add one of a station's robots to its plant, with the pieces that it carries.

    Args:
        plant: not finalized, registered with a scene graph.
        station: with the robot.
        robot: which.
        collision: keep collision geometry.

    Raises:
        InvalidModel: a robot that cannot be simulated in the station's mode.
    """
    model = robot.model
    if station.mode == "dynamic" and model.links_without_inertia:
        listed = ", ".join(model.links_without_inertia)
        remedy = "take mode: kinematic, or estimate them with robot.import_options.estimate_inertia: true"
        where = station.config.robots[robot.name].urdf or model.urdf_path
        raise InvalidModel(where, "", f"the moving links {listed} have no inertia; {remedy}")
    urdf = _with_pieces(station, robot)
    instance = add_urdf(plant, urdf, name=robot.name, where=model.urdf_path, collision=collision)
    root = plant.GetFrameByName(model.root, instance)
    if robot.floats:
        plant.SetDefaultFloatingBaseBodyPose(root.body(), robot.base)
    else:
        plant.WeldFrames(plant.world_frame(), root, robot.base)
    tools = {tool: plant.GetFrameByName(frame, instance) for tool, frame in robot.tool_frames.items()}
    tcp = robot.tcp
    if robot.tcp_offset is not None and tcp:
        pose = transform_from_pose(robot.tcp_offset)
        offset = FixedOffsetFrame(f"{robot.name}_tcp_offset", tools[tcp], pose, instance)
        tcp, tools[TCP] = TCP, plant.AddFrame(offset)
    joints = [plant.GetJointByName(axis.joint, instance) for axis in model.axes.values()]
    if station.mode == "dynamic":
        implicit = station.config.servo_of(robot.name).realization == "implicit"
        if implicit or station.scheme == "cenic":
            set_actuators(plant, [joint.index() for joint in joints], robot.gains, with_servos=implicit)
    own = {**vars(robot), "tcp": tcp}
    return StationRobot(**own, plant=plant, instance=instance, joints=joints, root=root, tools=tools)


def _with_pieces(station: ResolvedStation, robot: ResolvedRobot) -> Element:
    """Return a robot's URDF with the pieces that it carries."""
    element = with_absolute_meshes(robot.model.element, robot.model.folder)
    if robot.feet is not None:
        put_on_feet(element, robot.feet)
    for name in robot.carried:
        piece = station.pieces[name]
        add_piece(element, name=name, piece=piece.model, parent=piece.mount, pose=piece.pose)
    return element
