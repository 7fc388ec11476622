"""From an SDF model to a tree of links, in which every joint turns about one axis, or slides along it.

In SDF frames lie anywhere, joints lead either way and may close loops. In a URDF the frame of a link is that of the
joint that leads to it, so the shapes of each link move along.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.importer.repairs.materials import DEFAULT_RGBA
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.importer.repairs.shapes import PLAIN
from simrob_drake.importer.repairs.structure import number
from simrob_drake.importer.sdf.frames import MODEL, SCOPE, WORLD, Frames, named, own_pose
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

_MOVING = ("revolute", "continuous", "prismatic", "ball", "universal", "revolute2", "screw")
_AXES = {"universal": ("axis", "axis2"), "revolute2": ("axis", "axis2"), "ball": ("x", "y", "z")}
_IN_MODEL_FRAME = (1, 4)  # the last version in which axes were in the model's frame
_MIMIC_DEFAULTS = {"multiplier": "1", "offset": "0", "reference": "0"}  # of the SDF format
_DEFAULT_INERTIA = {"ixx": "1", "iyy": "1", "izz": "1"}


def moves(model: ET.Element) -> bool:
    """Return whether anything in a model moves by a joint."""
    held = text_at(model, "static") in ("1", "true")
    return not held and any(joint.get("type") in _MOVING for joint in model.iter("joint"))


class _Edge(NamedTuple):
    """A joint between two links, each by its full name."""

    name: str
    prefix: str
    element: ET.Element
    parent: str
    child: str


class _AxisName(NamedTuple):
    """Full name of an SDF joint, and tag of one of its axes, such as ``axis2``."""

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
    """Writes a ``model`` element of a file of a version as a robot."""

    model: ET.Element
    version: tuple[int, ...]
    report: ImportReport
    robot: ET.Element = field(init=False)

    def __post_init__(self) -> None:
        place = own_pose(
            self.model,
            self.report,
            message("importer.model_called", "model '{name}'", name=name_of(self.model)),
        )
        self.robot = ET.Element("robot", name=name_of(self.model))
        self._frames = Frames(self.report, place)
        self._frames.add_model(self.model)
        self._edges = [edge for edge in map(self._edge, self._frames.joints) if edge is not None]
        names = [*self._frames.links, *self._frames.joints]
        ends = [name.rsplit(SCOPE, 1)[-1] for name in names]
        free, counts = FreeNames(), {end: ends.count(end) for end in ends}
        self._names = {
            name: free.take(end if counts[end] == 1 else name.replace(SCOPE, "_"))
            for name, end in zip(names, ends, strict=True)
        }
        self._free = FreeNames(self._names.values())
        self._origins: dict[str, RigidTransform] = {}  # of the links of the URDF in the model
        # Joints of the URDF, by the axis of the SDF joint that each stands for: each axis becomes a joint.
        self._joint_of_axis: dict[_AxisName, ET.Element] = {}
        self._mimics: list[_Mimic] = []

    def written(self) -> ET.Element:
        """Return the ``robot`` element; raises InvalidModel: frames that name none, or a joint that is none."""
        static = text_at(self.model, "static") in ("1", "true")
        held = static or any(WORLD in (edge.parent, edge.child) for edge in self._edges)
        if held:
            self._names[WORLD] = self._free.take(ROOT)
            self._add_link(WORLD, RigidTransform())
        if static:
            self._fix(next(iter(self._frames.links), ""))
        self._grow()
        while rest := [link for link in self._frames.links if link not in self._origins]:
            reached = {edge.child for edge in self._edges}
            root = next((link for link in rest if link not in reached), rest[0])
            self._add_link(root, self._frames.pose(root))
            self._grow()
        self._write_mimics()
        for edge in self._edges:
            where = f"{edge.name}' between '{edge.parent}' and '{edge.child}"
            ET.SubElement(self.robot, "loop_joint", name=where)
        taken = FreeNames(name_of(link) for link in self.robot.iterfind("link"))
        for frame in self.model.iterfind("frame"):
            link = self._frames.link_of(name_of(frame))
            pose = self._origins[link].inverse() @ self._frames.pose(name_of(frame))
            add_frame(self.robot, taken.take(name_of(frame)), self._names[link], pose)
        _add_described_motors(self.robot)
        return self.robot

    def _edge(self, full: str) -> _Edge | None:
        prefix, joint = self._frames.joints[full]
        ends = [named(prefix, text_at(joint, end)) for end in ("parent", "child")]
        if joint.get("type") == "gearbox":
            text = message(
                "importer.couples_nothing",
                "couples two joints, each of which moves on its own here",
            )
            self.report.add(
                "lost", message("robots.joint_called", "joint '{joint}'", joint=full), text
            )
            return None
        parent, child = (self._frames.link_of(end) for end in ends)
        return _Edge(full, prefix, joint, parent, child)

    def _grow(self) -> None:
        """Add all links that joints lead to from those that are there; joints that lead back are turned round."""
        while True:
            forward = (
                edge
                for edge in self._edges
                if edge.parent in self._origins and edge.child not in self._origins
            )
            back = (
                edge
                for edge in self._edges
                if edge.child in self._origins and edge.parent not in self._origins
            )
            if (edge := next(forward, None)) is not None:
                self._join(edge, edge.parent, edge.child, 1.0)
            elif (edge := next(back, None)) is not None:
                self._join(edge, edge.child, edge.parent, -1.0)
                text = message(
                    "importer.turned_round",
                    "leads towards the root; turned round, its axis too, so that its position means the same",
                )
                self.report.add(
                    "repaired",
                    message("robots.joint_called", "joint '{joint}'", joint=edge.name),
                    text,
                )
            else:
                return
            self._edges.remove(edge)

    def _join(self, edge: _Edge, parent: str, child: str, sense: float) -> None:
        joint, kind = edge.element, edge.element.get("type", "")
        place, carrier = self._frames.pose(edge.name), self._names[parent]
        start = self._origins[parent].inverse() @ place
        parts = _AXES.get(kind, ("axis",))[:: int(sense)]
        self._add_link(child, place)
        for index, part in enumerate(parts):
            last = index == len(parts) - 1
            name = (
                self._names[edge.name]
                if len(parts) == 1
                else self._free.take(f"{self._names[edge.name]}_{part}")
            )
            to = (
                self._names[child]
                if last
                else add_between(self.robot, self._free, self._names[child])
            )
            element = add_joint(self.robot, name, parent=carrier, child=to, pose=start, kind=kind)
            if kind != "fixed":
                axis = joint.find(part)
                direction = (
                    np.eye(3)["xyz".index(part)]
                    if part in "xyz"
                    else self._direction(edge, axis, place)
                )
                ET.SubElement(element, "axis", xyz=format_numbers(sense * direction))
                write_limits(element, axis)
                write_drive(
                    self.robot, element, axis, joint if len(parts) == 1 else None, self.report
                )
                self._joint_of_axis[_AxisName(edge.name, part)] = element
                if axis is not None:
                    self._mimics += [
                        _Mimic(edge.prefix, element, mimic) for mimic in axis.findall("mimic")
                    ]
            carrier, start = to, RigidTransform()
        if len(parts) > 1:
            sentence = message(
                "importer.several_joints",
                "is {kind}; {count} joints, between which are links of next to no mass",
                kind=kind,
                count=len(parts),
            )
            self.report.add(
                "approximated" if kind == "ball" else "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=edge.name),
                sentence,
            )

    def _write_mimics(self) -> None:
        """Write the ``mimic`` of every follower, after all joints: its leader may be later in the file.

        The position of a follower is multiplier * (leader - reference) + offset in SDF, without the reference in a
        URDF. A leader that does not exist is written by its name, which a later stage of the import reports.
        """
        for mimic in self._mimics:
            leader_name = named(mimic.prefix, mimic.element.get("joint", ""))
            leader = self._joint_of_axis.get(
                _AxisName(leader_name, mimic.element.get("axis", "axis"))
            )
            values = {
                key: float(_figure(mimic.element, key) or text)
                for key, text in _MIMIC_DEFAULTS.items()
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

    def _direction(self, edge: _Edge, axis: ET.Element | None, place: RigidTransform) -> Vector:
        xyz = None if axis is None else axis.find("xyz")
        numbers = numbers_in((xyz.text or "") if xyz is not None else "0 0 1") or []
        if len(numbers) != len("xyz") or not any(numbers):
            raise self.report.refusal(
                message("importer.axis_of_joint", "joint '{joint}' <axis>", joint=edge.name),
                message("importer.is_no_direction", "is no direction"),
            )
        base = xyz.get("expressed_in") if xyz is not None else None
        old = axis is not None and text_at(axis, "use_parent_model_frame") in ("1", "true")
        if self.version <= _IN_MODEL_FRAME or old:
            base = MODEL
        direction = np.array(numbers)
        if not base:
            return direction
        turned: Vector = (
            place.rotation().inverse()
            @ self._frames.pose(named(edge.prefix, base)).rotation()
            @ direction
        )
        return turned

    def _fix(self, link: str) -> None:
        if link:
            pose = self._frames.place @ self._frames.pose(link)
            name = self._free.take(f"{self._names[link]}_fixed")
            add_joint(
                self.robot, name, parent=self._names[WORLD], child=self._names[link], pose=pose
            )
            self._add_link(link, self._frames.pose(link))

    def _add_link(self, full: str, origin: RigidTransform) -> None:
        self._origins[full] = self._frames.place.inverse() if full == WORLD else origin
        link = ET.SubElement(self.robot, "link", name=self._names[full])
        if full == WORLD:
            return
        element, pose = self._frames.links[full], origin.inverse() @ self._frames.pose(full)
        _add_inertia(link, element, pose, self.report)
        for tag in ("visual", "collision"):
            for shape in element.iterfind(tag):
                where = message(
                    "importer.shape_of_link",
                    "link '{link}' <{tag}> '{shape}'",
                    link=name_of(link),
                    tag=tag,
                    shape=name_of(shape),
                )
                geometry, problem = _geometry(shape)
                if geometry is None:
                    self.report.add("dropped", where, problem)
                    continue
                new = ET.SubElement(link, tag, name=name_of(shape))
                place(new, pose @ own_pose(shape, self.report, where))
                ET.SubElement(new, "geometry").append(geometry)
                if tag == "visual":
                    _add_colour(new, geometry, shape)


_ENDLESS = 1e15  # SDF's own default limits are 1e16
_ENDS = ("lower", "upper")
_LARGEST = ("effort", "velocity")
_GEARS = ("rotor_inertia", "gear_ratio")  # of Drake


def write_limits(joint: ET.Element, axis: ET.Element | None) -> None:
    """Write the limits of an SDF axis into a joint of a URDF; one that turns and has none is continuous."""
    limit = ET.SubElement(joint, "limit")
    ends = {
        key: value
        for key in _ENDS
        if (value := _figure(axis, f"limit/{key}")) and abs(float(value)) < _ENDLESS
    }
    limit.attrib |= ends
    if joint.get("type") not in ("prismatic", "screw"):
        joint.set("type", "revolute" if len(ends) == len(_ENDS) else "continuous")
    for key in _LARGEST:
        value = _figure(axis, f"limit/{key}")
        if value and 0 <= float(value) < _ENDLESS:  # -1 is none
            limit.set(key, value)
    acceleration = _figure(axis, f"limit/{DRAKE}acceleration")
    if acceleration:
        limit.set(f"{DRAKE}acceleration", acceleration)


def write_drive(
    robot: ET.Element,
    joint: ET.Element,
    axis: ET.Element | None,
    source: ET.Element | None,
    report: ImportReport,
) -> None:
    """Write the friction of an SDF axis into a joint of a URDF, and the motor that Drake's elements give it.

    ``source`` is the SDF joint, unless several of the URDF stand for it.
    """
    friction = {
        key: value for key in ("damping", "friction") if (value := _figure(axis, f"dynamics/{key}"))
    }
    ET.SubElement(
        joint, "dynamics", {key: value for key, value in friction.items() if float(value)}
    )
    if float(_figure(axis, "dynamics/spring_stiffness") or 0):
        report.add(
            "lost",
            message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
            message("importer.has_spring", "has a spring, and springs at joints are not simulated"),
        )
    gears = {key: value for key in _GEARS if (value := _figure(source, f"{DRAKE}{key}"))}
    if gears:
        motor = add_motor(robot, name_of(joint), drive=f"{name_of(joint)}_drive")
        for key, value in gears.items():
            ET.SubElement(motor, f"{DRAKE}{key}", value=value)


def _add_described_motors(robot: ET.Element) -> None:
    """Add the motors of a file that describes motors: one for each joint whose effort is not 0, in place.

    A joint without an effort has a motor without a limit in SDF. Files in which no joint has the effort 0 and no joint
    has Drake's elements of a motor do not describe motors, and get no motors here.
    """
    joints = [joint for joint in robot.iterfind("joint") if joint.get("type") != "fixed"]
    without_effort = [joint for joint in joints if number(joint.find("limit"), "effort") == 0]
    driven = transmissions_of(robot)
    if not (without_effort or driven):
        return
    for joint in joints:
        if joint not in without_effort and name_of(joint) not in driven:
            add_motor(robot, name_of(joint), drive=f"{name_of(joint)}_drive")


def text_at(element: ET.Element, path: str) -> str:
    """Return the text of the element at a path; empty where there is none."""
    return (element.findtext(path) or "").strip()


def _figure(element: ET.Element | None, path: str) -> str:
    """Return the finite number at a path, as it is written; empty where there is none."""
    text = "" if element is None else text_at(element, path)
    return text if len(numbers_in(text) or []) == 1 else ""


def _add_inertia(
    link: ET.Element, element: ET.Element, pose: RigidTransform, report: ImportReport
) -> None:
    """Add the inertia of an SDF link, whose frame has a pose in the link; SDF's own default is 1 kg and 1 kg m²."""
    where, inertial = (
        message("robots.link_called", "link '{link}'", link=name_of(link)),
        element.find("inertial"),
    )
    if inertial is not None and inertial.get("auto") == "true":
        report.add(
            "dropped",
            where,
            message(
                "importer.inertia_of_shapes",
                "its inertia is to be made of its shapes; --estimate-inertia does that",
            ),
        )
        return
    new = ET.SubElement(link, "inertial")
    place(new, pose @ own_pose(inertial, report, where))
    mass = None if inertial is None else inertial.findtext("mass")
    moments = None if inertial is None else inertial.find("inertia")
    ET.SubElement(new, "mass", value=(mass or "1").strip())
    values = (
        {} if moments is None else {key: (moments.findtext(key) or "0").strip() for key in MOMENTS}
    )
    ET.SubElement(new, "inertia", values or _DEFAULT_INERTIA)
    if mass is None or not values:
        defaults = " and ".join(["1 kg"] * (mass is None) + ["1 kg m²"] * (not values))
        report.add(
            "defaulted",
            where,
            message(
                "importer.inertia_not_told",
                "does not tell its inertia: {defaults}, as the format has it",
                defaults=defaults,
            ),
        )


def _geometry(shape: ET.Element) -> tuple[ET.Element | None, str]:
    geometry = shape.find("geometry/*")
    if geometry is None:
        return None, message("importer.has_no_shape", "has no shape")
    if geometry.tag == "mesh":
        if geometry.find("submesh") is not None:
            return None, message(
                "importer.part_of_mesh",
                "a part of the mesh '{uri}'; only whole files are read",
                uri=text_at(geometry, "uri"),
            )
        mesh = ET.Element("mesh", filename=text_at(geometry, "uri"))
        scale = text_at(geometry, "scale")
        if scale and not np.array_equal(numbers_in(scale) or [], [1, 1, 1]):
            mesh.set("scale", scale)
        return mesh, ""
    if geometry.tag == "ellipsoid":
        radii = (geometry.findtext("radii") or "").split()
        return ET.Element(f"{DRAKE}ellipsoid", dict(zip("abc", radii, strict=False))), ""
    tag = f"{DRAKE}capsule" if geometry.tag == "capsule" else geometry.tag
    if tag not in SHAPE_SIZES:
        is_ground = geometry.tag in ("plane", "heightmap")
        ground = (
            message(
                "importer.own_ground", "; a station has a floor and terrain of its own (floor:)"
            )
            if is_ground
            else ""
        )
        return None, message(
            "importer.no_shape_of_robot",
            "<{tag}> is no shape of a robot{ground}",
            tag=geometry.tag,
            ground=ground,
        )
    return ET.Element(tag, {key: text_at(geometry, key) for key in SHAPE_SIZES[tag]}), ""


def _add_colour(visual: ET.Element, geometry: ET.Element, shape: ET.Element) -> None:
    """Add the colour of a visual; a mesh has its own look unless there is one."""
    material = shape.find("material")
    if material is None:
        return
    diffuse = numbers_in(material.findtext("diffuse") or material.findtext("ambient") or "") or []
    script = (material.findtext("script/name") or "").rpartition("/")[2].lower()
    of_gazebo = (
        read_yaml(Path(__file__).with_name("colours.yaml")) if len(diffuse) < len("rgb") else {}
    )
    named = of_gazebo.get(script)
    rgba = (
        [float(word) for word in named.split()]
        if named
        else [*diffuse, 1.0][:4]
        if diffuse
        else DEFAULT_RGBA
    )
    if geometry.tag == "mesh":
        if not (named or diffuse):
            return
        geometry.set(PLAIN, "true")
    add_colour(visual, format_numbers(rgba), rgba)
