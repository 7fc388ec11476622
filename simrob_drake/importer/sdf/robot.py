"""Convert an SDF model to a robot: a tree of links in which each joint turns about one axis, or slides along it.

In SDF the frame of a link may be anywhere, joints may lead in either direction, and they may close loops. In a URDF the
frame of a link is the frame of the joint that leads to it. So shapes and inertias of each link get new poses here.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.importer.repairs.materials import DEFAULT_RGBA
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.importer.repairs.shapes import PLAIN
from simrob_drake.importer.repairs.structure import number
from simrob_drake.importer.sdf.frames import MODEL, SCOPE, WORLD, Frames, full_name, own_pose
from simrob_drake.importer.trees import ROOT, add_between
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    MOMENTS,
    add_colour,
    add_frame,
    add_joint,
    add_motor,
    format_number,
    format_numbers,
    name_of,
    place,
    transmissions_of,
)
from simrob_drake.robots.urdf_check import SHAPE_SIZES, numbers_in

_TRUE = ("1", "true")
"""Texts of the boolean true in SDF."""

_MOVING_TYPES = (
    "revolute",
    "continuous",
    "prismatic",
    "ball",
    "universal",
    "revolute2",
    "screw",
)
"""Types of SDF joints that move."""

# Each of the three joints turns about one axis of the ball, one after the other, as roll, pitch and yaw do.
_BALL_AXES = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}
"""Axes of the three joints that take the place of a ball joint, in its frame, by the ends of their names."""

_AXES_OF_TYPE = {
    "universal": ("axis", "axis2"),
    "revolute2": ("axis", "axis2"),
    "ball": tuple(_BALL_AXES),
}
"""Axes of SDF joints with several, from the parent to the child. Other joints have one ``axis``."""

_LAST_WITH_MODEL_AXES = (1, 4)
"""Last version of SDF in which the axes of joints are given in the model's frame. Later it is the joint's frame."""

_MIMIC_DEFAULTS = {"multiplier": "1", "offset": "0", "reference": "0"}
"""Values of a ``<mimic>`` that the file leaves out, as the SDF format defines them."""

_DEFAULT_MASS = "1"
"""Mass of a link without ``<mass>`` [kg], as the SDF format defines it."""

_DEFAULT_INERTIA = {"ixx": "1", "iyy": "1", "izz": "1"}
"""Moments of inertia of a link without ``<inertia>`` [kg m²], as the SDF format defines them."""

# Files write infinity as a large number, such as 1e16 or 1e18.
_UNLIMITED = 1e15
"""A limit of this size or more is none [rad, m, N·m ...]. SDF's own defaults are 1e16."""

_GEAR_TAGS = ("rotor_inertia", "gear_ratio")
"""Elements of Drake in an SDF joint that describe its motor. Their names have Drake's prefix."""


def is_static(model: ET.Element) -> bool:
    """Whether a model is fixed to the world as a whole."""
    return text_at(model, "static") in _TRUE


def moves(model: ET.Element) -> bool:
    """Whether a joint of a model moves. Joints of a static model do not, whatever their type."""
    if is_static(model):
        return False
    # Joints of nested models count, too: an arm may be included in a model that has no joint of its own.
    return any(joint.get("type") in _MOVING_TYPES for joint in model.iter("joint"))


class _Edge(NamedTuple):
    """A joint between two links, as an edge of the graph of links.

    Attributes:
        name: full name of the joint's frame.
        prefix: prefix of the full names in the joint's model.
        element: the SDF ``joint``.
        parent: full name of the parent link.
        child: full name of the child link.
    """

    name: str
    prefix: str
    element: ET.Element
    parent: str
    child: str


class _AxisName(NamedTuple):
    """One axis of an SDF joint.

    Attributes:
        joint: full name of the joint's frame.
        axis: tag of the axis, such as ``axis2``.
    """

    joint: str
    axis: str


class _Mimic(NamedTuple):
    """A statement that a joint follows another one.

    Attributes:
        prefix: scope in which the name of the other joint counts.
        follower: joint of the URDF that follows.
        element: the ``<mimic>`` of the SDF, with the name of the other joint.
    """

    prefix: str
    follower: ET.Element
    element: ET.Element


@dataclass
class RobotWriter:
    """Converts a ``model`` element of an SDF file to the ``robot`` element of a URDF.

    Attributes:
        model: the model. Models that it includes are in it already.
        version: version of the SDF format, such as (1, 9).
        report: gets an entry for each change.
        robot: the ``robot`` element, which :meth:`write` fills.
    """

    model: ET.Element
    version: tuple[int, ...]
    report: ImportReport
    robot: ET.Element = field(init=False)

    def __post_init__(self) -> None:
        where = message("importer.model_called", "model '{name}'", name=name_of(self.model))
        # The pose of the model in the world only counts if the model is static, or a joint connects it with the world.
        # The place of a loose robot is given by the station.
        place_in_world = own_pose(self.model, self.report, where)
        self.robot = ET.Element("robot", name=name_of(self.model))
        self._frames = Frames(self.report, place_in_world)
        self._frames.add_model(self.model)
        # Edges are removed as their links are added to the robot. Those that remain close loops.
        self._edges = self._find_edges()
        self._names = self._choose_names()
        self._free_names = FreeNames(self._names.values())
        # Poses of the URDF's link frames in the model, by the full name of the link.
        self._origins: dict[str, RigidTransform] = {}
        # Joints of the URDF, by the axis of the SDF joint that each stands for: each axis becomes a joint.
        self._joint_of_axis: dict[_AxisName, ET.Element] = {}
        self._mimics: list[_Mimic] = []

    def write(self) -> ET.Element:
        """Fill the ``robot`` element, and return it.

        Raises:
            InvalidModel: an element refers to a frame that does not exist, a pose is no pose, or an axis has no
                direction.
        """
        has_world_joint = any(WORLD in (edge.parent, edge.child) for edge in self._edges)
        # Everything grows from the world, if the file connects it with a link: the robot is then fixed there.
        if is_static(self.model) or has_world_joint:
            self._names[WORLD] = self._free_names.take(ROOT)
            self._add_link(WORLD, RigidTransform())
        if is_static(self.model):
            self._fix_first_link()
        self._grow()
        # The order matters from here: mimics and loops need all joints, frames need all links.
        self._add_further_trees()
        self._write_mimics()
        self._write_loop_joints()
        self._write_frames()
        _add_described_motors(self.robot)
        return self.robot

    def _find_edges(self) -> list[_Edge]:
        """Find the links that each joint of the model connects. Gearboxes connect joints, and are left out.

        Raises:
            InvalidModel: a joint names a frame that does not exist.
        """
        edges = []
        for name, (prefix, joint) in self._frames.joints.items():
            # A gearbox names two links as well, but does not hold them: as an edge it would be taken for a joint of the
            # tree.
            if joint.get("type") == "gearbox":
                self.report.add(
                    "lost",
                    message("robots.joint_called", "joint '{joint}'", joint=name),
                    message(
                        "importer.couples_nothing",
                        "is a gearbox that couples two joints; here both joints move independently",
                    ),
                )
                continue
            # The ends may be any frames: a joint holds the links with which these frames move.
            parent = self._frames.link_of(full_name(prefix, text_at(joint, "parent")))
            child = self._frames.link_of(full_name(prefix, text_at(joint, "child")))
            edges.append(_Edge(name, prefix, joint, parent, child))
        return edges

    def _choose_names(self) -> dict[str, str]:
        """Choose the names in the URDF of all links and joints, by their full names.

        A URDF has no scopes. A name that is unique without its scope is shortened, others keep the scope: the link
        ``hand::finger`` becomes ``finger`` or, if another model has a link or joint of that name, ``hand_finger``.
        """
        # Links come first, so that a joint gets another name if both have the same.
        full_names = [*self._frames.links, *self._frames.joints]
        short_names = [name.rsplit(SCOPE, 1)[-1] for name in full_names]
        counts = Counter(short_names)
        free_names = FreeNames()
        chosen = {}
        for name, short_name in zip(full_names, short_names, strict=True):
            is_unique = counts[short_name] == 1
            chosen[name] = free_names.take(short_name if is_unique else name.replace(SCOPE, "_"))
        return chosen

    def _grow(self) -> None:
        """Add all links to which joints lead from links that the robot has already.

        Joints that lead from their parent to their child come first. Only if none is left, a joint is turned round.
        Joints whose two links are in the robot already close a loop, and stay in the list of edges.
        """
        while True:
            edge = self._next_edge(is_forward=True)
            if edge is not None:
                self._join(edge, is_forward=True)
                self._edges.remove(edge)
                continue
            # Nothing is reached from parents any more. A link that is only reached from its child is next.
            edge = self._next_edge(is_forward=False)
            if edge is None:
                return
            self._join(edge, is_forward=False)
            self._edges.remove(edge)
            self.report.add(
                "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=edge.name),
                message(
                    "importer.turned_round",
                    "leads towards the root; its links are exchanged and its axis is reversed, so that "
                    "its positions keep their meaning",
                ),
            )

    def _next_edge(self, *, is_forward: bool) -> _Edge | None:
        """Find the first joint of which the robot has one link only. Returns None if no joint is of this kind.

        Args:
            is_forward: whether this link is the joint's parent. Otherwise it is the child.
        """
        for edge in self._edges:
            present, absent = _ends(edge, is_forward=is_forward)
            # A joint with both links in the robot would make a loop of the tree.
            if present in self._origins and absent not in self._origins:
                return edge
        return None

    def _add_further_trees(self) -> None:
        """Add the links that no joint connects with the robot. A later stage of the import keeps one tree of them."""
        while True:
            missing = [link for link in self._frames.links if link not in self._origins]
            if not missing:
                return
            # A tree begins at a link that is no joint's child. In a loop every link is a child: begin at the first.
            children = {edge.child for edge in self._edges}
            root = next((link for link in missing if link not in children), missing[0])
            self._add_link(root, self._frames.pose(root))
            self._grow()

    def _join(self, edge: _Edge, *, is_forward: bool) -> None:
        """Add the link at the other end of a joint, and a URDF joint for each axis of the joint.

        Between several joints are links of almost no mass.

        Args:
            edge: the joint.
            is_forward: whether the robot has the joint's parent already. Otherwise it has the child, and the joint is
                turned round: the order of its axes and their directions are reversed.
        """
        joint = edge.element
        kind = joint.get("type", "")
        axis_tags = _AXES_OF_TYPE.get(kind, ("axis",))
        # From the child back to the parent, the axes are met in the reverse order.
        if not is_forward:
            axis_tags = axis_tags[::-1]
        # The child that turns about +z against its parent sees the parent turn about -z.
        sense = 1.0 if is_forward else -1.0
        parent, child = _ends(edge, is_forward=is_forward)
        joint_pose = self._frames.pose(edge.name)
        # In a URDF the frame of a link is that of the joint that leads to it.
        self._add_link(child, joint_pose)

        carrier = self._names[parent]
        pose_in_carrier = self._origins[parent].inverse() @ joint_pose
        has_one_axis = len(axis_tags) == 1
        for tag in axis_tags:
            # A URDF joint has one axis. Each further axis needs a joint, and a link between the joints.
            name = self._names[edge.name]
            if not has_one_axis:
                name = self._free_names.take(f"{name}_{tag}")
            carried = self._names[child]
            if tag != axis_tags[-1]:
                carried = add_between(self.robot, self._free_names, carried)
            urdf_joint = add_joint(
                self.robot, name, parent=carrier, child=carried, pose=pose_in_carrier, kind=kind
            )
            if kind != "fixed":
                # Drake's elements of a motor do not name an axis. They are lost if there are several.
                motor_source = joint if has_one_axis else None
                self._write_axis(edge, tag, urdf_joint, sense, motor_source)
            # All axes of an SDF joint pass through the origin of its frame: the further joints are at the same place.
            carrier = carried
            pose_in_carrier = RigidTransform()
        if not has_one_axis:
            # Two joints move exactly as a universal joint does. The three of a ball lose a freedom where the middle one
            # is at 90 deg, because the axes of the other two are then parallel.
            self.report.add(
                "approximated" if kind == "ball" else "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=edge.name),
                message(
                    "importer.several_joints",
                    "its type is {kind}; replaced by {count} joints with links of almost no mass between them",
                    kind=kind,
                    count=len(axis_tags),
                ),
            )

    def _write_axis(
        self,
        edge: _Edge,
        tag: str,
        urdf_joint: ET.Element,
        sense: float,
        motor_source: ET.Element | None,
    ) -> None:
        """Write direction, limits and drive of an axis of an SDF joint into the URDF joint that replaces it.

        Args:
            edge: the SDF joint.
            tag: tag of the axis, such as ``axis2``.
            urdf_joint: the joint of the URDF.
            sense: 1.0, or -1.0 if the joint is turned round.
            motor_source: joint of the SDF with Drake's elements of its motor, or None if it has several axes.
        """
        axis = edge.element.find(tag)
        # A ball joint of SDF has no elements for its axes.
        is_ball = edge.element.get("type") == "ball"
        direction = _BALL_AXES[tag] if is_ball else self._direction(edge, axis)
        ET.SubElement(urdf_joint, "axis", xyz=format_numbers(sense * direction))
        write_limits(urdf_joint, axis)
        write_drive(self.robot, urdf_joint, axis, motor_source, self.report)
        # Joints that follow this axis may be anywhere in the file: they are written at the end.
        self._joint_of_axis[_AxisName(edge.name, tag)] = urdf_joint
        if axis is not None:
            for mimic in axis.findall("mimic"):
                self._mimics.append(_Mimic(edge.prefix, urdf_joint, mimic))

    def _write_mimics(self) -> None:
        """Write the ``mimic`` of every follower, after all joints: its leader may be later in the file.

        The position of a follower is multiplier * (leader - reference) + offset in SDF, without the reference in a
        URDF. A leader that does not exist is written by its name, which a later stage of the import reports.
        """
        for mimic in self._mimics:
            leader_name = full_name(mimic.prefix, mimic.element.get("joint", ""))
            axis_tag = mimic.element.get("axis", "axis")
            # Without such a joint, the next stages see a name that no joint has, and report it.
            leader = self._joint_of_axis.get(_AxisName(leader_name, axis_tag))
            values = {
                key: float(_number_at(mimic.element, key) or default)
                for key, default in _MIMIC_DEFAULTS.items()
            }
            multiplier = values["multiplier"]
            offset = values["offset"] - multiplier * values["reference"]
            ET.SubElement(
                mimic.follower,
                "mimic",
                joint=leader_name if leader is None else name_of(leader),
                multiplier=format_number(multiplier),
                offset=format_number(offset),
            )

    def _write_loop_joints(self) -> None:
        """Write the joints that close a loop as ``loop_joint``, which no URDF has: a later stage reports or drops them.

        Nothing but the name of such an element is used, in quotes. So the name contains the links, too.
        """
        for edge in self._edges:
            quoted_names = f"{edge.name}' between '{edge.parent}' and '{edge.child}"
            ET.SubElement(self.robot, "loop_joint", name=quoted_names)

    def _write_frames(self) -> None:
        """Write the ``frame`` elements of the model, which may be tools of the robot. Nested models' are left out."""
        taken_names = FreeNames(name_of(link) for link in self.robot.iterfind("link"))
        for frame in self.model.iterfind("frame"):
            link = self._frames.link_of(name_of(frame))
            if link not in self._origins:
                # Only the world can be missing: the robot has it as a link if it is fixed to the world.
                self.report.add(
                    "dropped",
                    message("importer.frame_called", "frame '{name}'", name=name_of(frame)),
                    message(
                        "importer.frame_of_world",
                        "is attached to the world, to which this robot is not fixed",
                    ),
                )
                continue
            pose = self._origins[link].inverse() @ self._frames.pose(name_of(frame))
            add_frame(self.robot, taken_names.take(name_of(frame)), self._names[link], pose)

    def _direction(self, edge: _Edge, axis: ET.Element | None) -> Vector:
        """Direction of an axis in the frame of its joint, shape (3,).

        Args:
            edge: the joint.
            axis: the ``axis`` or ``axis2`` of the joint, or None if the file has none: then it is z.

        Raises:
            InvalidModel: the direction is not three numbers, or all of them are 0.
        """
        xyz = None if axis is None else axis.find("xyz")
        numbers = numbers_in("0 0 1" if xyz is None else xyz.text or "") or []
        if len(numbers) != len("xyz") or not any(numbers):
            raise self.report.refusal(
                message("importer.axis_of_joint", "joint '{joint}' <axis>", joint=edge.name),
                message("importer.is_no_direction", "must be three numbers that are not all zero"),
            )
        # The direction need not have the length 1: a later stage of the import normalises it.
        direction = np.array(numbers)

        # Versions have different frames for axes: the joint's frame, the model's, or a frame that the axis names.
        frame = None if xyz is None else xyz.get("expressed_in")
        uses_model_frame = axis is not None and text_at(axis, "use_parent_model_frame") in _TRUE
        if self.version <= _LAST_WITH_MODEL_AXES or uses_model_frame:
            frame = MODEL
        if not frame:
            return direction
        # A URDF gives the axis in the frame of the joint: turn it from its own frame to the model, and from there back.
        joint_rotation = self._frames.pose(edge.name).rotation()
        frame_rotation = self._frames.pose(full_name(edge.prefix, frame)).rotation()
        in_joint: Vector = joint_rotation.inverse() @ frame_rotation @ direction
        return in_joint

    def _fix_first_link(self) -> None:
        """Fix the first link to the world, for a static model. A model without links is not changed."""
        link = next(iter(self._frames.links), "")
        if not link:
            return
        # The root of this URDF is the world, so the joint has the pose of the link in the world: the pose of the model
        # in the world (`place`), and then the pose of the link in the model.
        pose = self._frames.place @ self._frames.pose(link)
        name = self._free_names.take(f"{self._names[link]}_fixed")
        add_joint(self.robot, name, parent=self._names[WORLD], child=self._names[link], pose=pose)
        self._add_link(link, self._frames.pose(link))

    def _add_link(self, name: str, origin: RigidTransform) -> None:
        """Add a link with its inertia and its shapes, or the empty link of the world.

        Args:
            name: full name of the link, or ``world``.
            origin: pose of the link's frame in the model, as the URDF has it: that of the joint that leads to the link.
                It does not count for the world, whose pose is known.
        """
        link = ET.SubElement(self.robot, "link", name=self._names[name])
        if name == WORLD:
            self._origins[WORLD] = self._frames.place.inverse()
            return
        self._origins[name] = origin
        element = self._frames.links[name]
        # The SDF gives poses of shapes and of the inertia in its own frame of the link.
        pose = origin.inverse() @ self._frames.pose(name)
        _add_inertia(link, element, pose, self.report)
        for tag in ("visual", "collision"):
            for shape in element.iterfind(tag):
                _add_shape(link, shape, pose, self.report)


def _ends(edge: _Edge, *, is_forward: bool) -> tuple[str, str]:
    """Full names of the links at the start and at the end of a joint that is passed in one of both directions."""
    return (edge.parent, edge.child) if is_forward else (edge.child, edge.parent)


def write_limits(joint: ET.Element, axis: ET.Element | None) -> None:
    """Write the limits of an SDF axis into a joint of a URDF.

    A joint becomes revolute if it has both limits of its position, otherwise continuous; a prismatic or screw joint
    keeps its type. A value of the SDF counts only if its text is one finite number. Positions, efforts and velocities
    of 1e15 or more, and negative efforts and velocities, are no limits.

    Args:
        joint: the joint of the URDF.
        axis: the axis of the SDF, or None if the file has none.
    """
    # Texts are copied, so that a limit keeps the digits of the file.
    limit = ET.SubElement(joint, "limit")
    ends = {}
    for key in ("lower", "upper"):
        value = _number_at(axis, f"limit/{key}")
        if value and abs(float(value)) < _UNLIMITED:
            ends[key] = value
    limit.attrib |= ends
    if joint.get("type") not in ("prismatic", "screw"):
        # A joint with one limit only becomes continuous as well, since the type revolute needs both.
        joint.set("type", "revolute" if len(ends) == 2 else "continuous")
    for key in ("effort", "velocity"):
        value = _number_at(axis, f"limit/{key}")
        # Negative values, such as SDF's default -1, are no limit.
        if value and 0 <= float(value) < _UNLIMITED:
            limit.set(key, value)
    # Drake reads this element of its own in both formats.
    acceleration = _number_at(axis, f"limit/{DRAKE}acceleration")
    if acceleration:
        limit.set(f"{DRAKE}acceleration", acceleration)


def write_drive(
    robot: ET.Element,
    joint: ET.Element,
    axis: ET.Element | None,
    source: ET.Element | None,
    report: ImportReport,
) -> None:
    """Write the friction of an SDF axis into a joint of a URDF, and the motor that Drake's elements describe.

    Args:
        robot: the ``robot`` element, which gets the motor.
        joint: the joint of the URDF.
        axis: the axis of the SDF, or None if the file has none.
        source: joint of the SDF with Drake's elements of its motor, or None if the motor belongs to no single axis.
        report: gets an entry if the axis has a spring, which a URDF cannot describe.
    """
    dynamics = {}
    for key in ("damping", "friction"):
        value = _number_at(axis, f"dynamics/{key}")
        if value and float(value):
            dynamics[key] = value
    ET.SubElement(joint, "dynamics", dynamics)
    # Damping and friction have elements in a URDF, a spring has none.
    if float(_number_at(axis, "dynamics/spring_stiffness") or 0):
        report.add(
            "lost",
            message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
            message("importer.has_spring", "has a spring; springs at joints are not simulated"),
        )
    # Elements of Drake: an SDF has no others for the motor of a joint.
    gear_values = {}
    for key in _GEAR_TAGS:
        value = _number_at(source, f"{DRAKE}{key}")
        if value:
            gear_values[key] = value
    if gear_values:
        motor = add_motor(robot, name_of(joint), drive=f"{name_of(joint)}_drive")
        for key, value in gear_values.items():
            ET.SubElement(motor, f"{DRAKE}{key}", value=value)


def _add_described_motors(robot: ET.Element) -> None:
    """Add the motors of a file that describes motors: one for each joint whose effort is not 0, in place.

    A joint without an effort has a motor without a limit in SDF. Files in which no joint has the effort 0 and no joint
    has Drake's elements of a motor do not describe motors, and get no motors here.
    """
    # As in Drake, an effort of 0 means a joint without a motor. A file with such a joint
    # describes which joints have motors.
    joints = [joint for joint in robot.iterfind("joint") if joint.get("type") != "fixed"]
    without_effort = [joint for joint in joints if number(joint.find("limit"), "effort") == 0]
    driven = transmissions_of(robot)
    if not (without_effort or driven):
        return
    for joint in joints:
        if joint not in without_effort and name_of(joint) not in driven:
            add_motor(robot, name_of(joint), drive=f"{name_of(joint)}_drive")


def text_at(element: ET.Element, path: str) -> str:
    """Text of the element at a path below another one. It is empty if there is no such element."""
    return (element.findtext(path) or "").strip()


def _number_at(element: ET.Element | None, path: str) -> str:
    """Text of the finite number at a path below an element. It is empty if there is no such number.

    The text, and not the number, is returned, so that the URDF has the same digits as the file.
    """
    text = "" if element is None else text_at(element, path)
    return text if len(numbers_in(text) or []) == 1 else ""


def _add_inertia(
    link: ET.Element, element: ET.Element, pose: RigidTransform, report: ImportReport
) -> None:
    """Add the inertia of an SDF link to a link of the URDF.

    Args:
        link: the link of the URDF.
        element: the link of the SDF.
        pose: pose of the SDF link's frame in the URDF link's frame.
        report: gets an entry for each value that the file leaves out.

    Raises:
        InvalidModel: the pose of the inertia is no pose.
    """
    where = message("robots.link_called", "link '{link}'", link=name_of(link))
    inertial = element.find("inertial")
    if inertial is not None and inertial.get("auto") == "true":
        # Without an inertia here, a later stage of the import estimates it if the options ask for that.
        report.add(
            "dropped",
            where,
            message(
                "importer.inertia_of_shapes",
                'its inertia is to be computed from its shapes (auto="true"); use --estimate-inertia',
            ),
        )
        return
    urdf_inertial = ET.SubElement(link, "inertial")
    place(urdf_inertial, pose @ own_pose(inertial, report, where))
    # Mass and inertia may be missing independently of each other.
    mass = None if inertial is None else inertial.findtext("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    ET.SubElement(urdf_inertial, "mass", value=(mass or _DEFAULT_MASS).strip())
    moments = {}
    if inertia is not None:
        moments = {key: (inertia.findtext(key) or "0").strip() for key in MOMENTS}
    ET.SubElement(urdf_inertial, "inertia", moments or _DEFAULT_INERTIA)

    defaults = []
    if mass is None:
        defaults.append("1 kg")
    if not moments:
        defaults.append("1 kg m²")
    if defaults:
        report.add(
            "defaulted",
            where,
            message(
                "importer.inertia_not_told",
                "has no complete inertia; the defaults of SDF apply: {defaults}",
                defaults=join_texts(defaults, message("base.and", " and ")),
            ),
        )


def _add_shape(
    link: ET.Element, shape: ET.Element, pose: RigidTransform, report: ImportReport
) -> None:
    """Add a visual or collision shape of an SDF link to a link of the URDF, or report why that is not possible.

    Args:
        link: the link of the URDF.
        shape: the ``visual`` or ``collision`` of the SDF.
        pose: pose of the SDF link's frame in the URDF link's frame.
        report: gets an entry if the shape is left out.

    Raises:
        InvalidModel: the pose of the shape is no pose.
    """
    where = message(
        "importer.shape_of_link",
        "link '{link}' <{tag}> '{shape}'",
        link=name_of(link),
        tag=shape.tag,
        shape=name_of(shape),
    )
    geometry = shape.find("geometry/*")
    problem = _problem_of_geometry(geometry)
    if geometry is None or problem:
        report.add("dropped", where, problem)
        return
    urdf_shape = ET.SubElement(link, shape.tag, name=name_of(shape))
    place(urdf_shape, pose @ own_pose(shape, report, where))
    urdf_geometry = _convert_geometry(geometry)
    ET.SubElement(urdf_shape, "geometry").append(urdf_geometry)
    if shape.tag == "visual":
        _add_colour_of_visual(urdf_shape, urdf_geometry, shape)


def _problem_of_geometry(geometry: ET.Element | None) -> str:
    """Reason why a shape of an SDF link cannot be imported. It is empty if the shape can be imported.

    Args:
        geometry: element of the shape, such as ``box``, or None if the file has none.
    """
    if geometry is None:
        return message("importer.has_no_shape", "has no shape")
    if geometry.tag == "mesh":
        if geometry.find("submesh") is None:
            return ""
        return message(
            "importer.part_of_mesh",
            "is a part of the mesh '{uri}'; only whole files are imported",
            uri=text_at(geometry, "uri"),
        )
    if geometry.tag == "ellipsoid" or _urdf_tag(geometry) in SHAPE_SIZES:
        return ""
    ground = ""
    if geometry.tag in ("plane", "heightmap"):
        ground = message(
            "importer.own_ground", "; the section `floor` of a station describes the ground"
        )
    return message(
        "importer.no_shape_of_robot",
        "<{tag}> is no shape of a robot{ground}",
        tag=geometry.tag,
        ground=ground,
    )


def _urdf_tag(geometry: ET.Element) -> str:
    """Tag in a URDF of a shape that is neither a mesh nor an ellipsoid."""
    return f"{DRAKE}capsule" if geometry.tag == "capsule" else geometry.tag


def _convert_geometry(geometry: ET.Element) -> ET.Element:
    """Convert a shape that can be imported to the shape of a URDF."""
    if geometry.tag == "mesh":
        mesh = ET.Element("mesh", filename=text_at(geometry, "uri"))
        scale = text_at(geometry, "scale")
        # 1 1 1 is the default of both formats.
        if scale and not np.array_equal(numbers_in(scale) or [], [1, 1, 1]):
            mesh.set("scale", scale)
        return mesh
    if geometry.tag == "ellipsoid":
        # Missing radii are found by the check of the URDF.
        radii = (geometry.findtext("radii") or "").split()
        return ET.Element(f"{DRAKE}ellipsoid", dict(zip("abc", radii, strict=False)))
    # The other shapes have the same names of sizes in both formats.
    tag = _urdf_tag(geometry)
    return ET.Element(tag, {key: text_at(geometry, key) for key in SHAPE_SIZES[tag]})


def _add_colour_of_visual(visual: ET.Element, geometry: ET.Element, shape: ET.Element) -> None:
    """Add the colour of an SDF visual to a visual of the URDF.

    A mesh without a colour in the SDF keeps the materials of its file.

    Args:
        visual: the visual of the URDF.
        geometry: its shape. A mesh is marked if the SDF has a colour for it, which replaces those of its file.
        shape: the visual of the SDF.
    """
    material = shape.find("material")
    # Without a material, the visual gets the default of a later stage.
    if material is None:
        return
    text = material.findtext("diffuse") or material.findtext("ambient") or ""
    diffuse = numbers_in(text) or []
    named_colour = None
    if len(diffuse) < len("rgb"):
        # Scripts of Gazebo define colours by name, such as Gazebo/Red.
        script = (material.findtext("script/name") or "").rpartition("/")[2].lower()
        gazebo_colours = read_yaml(Path(__file__).with_name("colours.yaml"))
        named_colour = gazebo_colours.get(script)
    rgba = list(DEFAULT_RGBA)
    if named_colour:
        rgba = [float(word) for word in named_colour.split()]
    elif diffuse:
        # A colour may have no opacity: it is 1 then.
        rgba = [*diffuse, 1.0][:4]
    if geometry.tag == "mesh":
        # A material without a usable colour must not hide the colours of the mesh file.
        if not (named_colour or diffuse):
            return
        geometry.set(PLAIN, "true")
    add_colour(visual, format_numbers(rgba), rgba)
