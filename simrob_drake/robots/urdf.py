"""Read a URDF safely and find its defects before Drake does, where a failed assertion could end the process."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import RotationalInertia

from simrob_drake.errors import InvalidModel, UnknownName

MOVABLE_JOINTS = ("revolute", "continuous", "prismatic")
LIMITED_JOINTS = ("revolute", "prismatic")
DRAKE = "{http://drake.mit.edu}"
"""What stands before the names of Drake's own elements, such as acceleration limits."""

ET.register_namespace("drake", DRAKE.strip("{}"))
MESH_FORMATS = (".obj", ".gltf", ".vtk")


def read_urdf(path: Path) -> ET.Element:
    """Return the ``robot`` element of a URDF file.

    Raises:
        InvalidModel: the file is missing, not readable, a xacro, not XML, declares entities, or holds no robot.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as problem:
        raise InvalidModel(path, "", f"cannot be read as a text file ({problem})") from problem
    if path.suffix == ".xacro" or "xmlns:xacro" in text:
        raise InvalidModel(path, "", "is a xacro file; expand it first: xacro FILE.xacro > FILE.urdf")
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise InvalidModel(path, "", "declares entities or a document type, which a URDF never needs")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as problem:
        raise InvalidModel(path, "", f"is not XML: {problem}") from problem
    if root.tag != "robot":
        raise InvalidModel(path, f"<{root.tag}>", "the outermost element of a URDF is <robot>")
    return root


def movable_joints(root: ET.Element) -> list[str]:
    """Return the names of the joints that move, in file order."""
    return [_name(j) for j in root.iterfind("joint") if j.get("type") in MOVABLE_JOINTS]


def joint_limits(root: ET.Element, joint: str) -> tuple[float, float]:
    """Return a joint's lower and upper limit [rad or m]; continuous joints have none: -inf, inf."""
    element = _joint(root, joint)
    limit = element.find("limit")
    if limit is None or element.get("type") not in LIMITED_JOINTS:
        return -math.inf, math.inf
    return float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))


def joint_effort(root: ET.Element, joint: str) -> float:
    """Return the largest torque of a joint's motor [N·m or N]; 0 where the URDF gives none."""
    limit = _joint(root, joint).find("limit")
    return 0.0 if limit is None else float(limit.get("effort", 0.0))


def root_link(root: ET.Element) -> str:
    """Return the link that is no joint's child."""
    children = {_link_of(j, "child") for j in root.iterfind("joint")}
    return next(_name(link) for link in root.iterfind("link") if _name(link) not in children)


def last_link(root: ET.Element) -> str:
    """Return the first link, in file order, at the end of a chain: where an arm carries its tool."""
    parents = {_link_of(j, "parent") for j in root.iterfind("joint")}
    return next(_name(link) for link in root.iterfind("link") if _name(link) not in parents)


def check_urdf(root: ET.Element, path: Path) -> None:
    """Check all that Drake would refuse with an assertion or accept in silence.

    Raises:
        InvalidModel: names the file, the element and what would be right.
    """
    _check_tree(root, path)
    for joint in root.iterfind("joint"):
        _check_joint(joint, path)
    for link in root.iterfind("link"):
        _check_inertial(link, path)
        for shape in link.iterfind("*/geometry/*"):
            _check_shape(shape, f"link '{_name(link)}'", path)
    _check_actuators(root, path)


def links_without_inertia(root: ET.Element) -> list[str]:
    """Return the moving links that have no mass, nor anything with mass rigidly attached: no dynamics for them."""
    weightless = {_name(link) for link in root.iterfind("link") if _mass(link) == 0}
    fixed = {_link_of(j, "child"): _link_of(j, "parent") for j in root.iterfind("joint") if j.get("type") == "fixed"}

    def carrier(link: str) -> str:
        while link in fixed:
            link = fixed[link]
        return link

    links = [_name(link) for link in root.iterfind("link")]
    heavy = {carrier(link) for link in links if link not in weightless}
    moved = [_link_of(j, "child") for j in root.iterfind("joint") if j.get("type") in MOVABLE_JOINTS]
    return [link for link in moved if carrier(link) not in heavy]


def with_absolute_meshes(root: ET.Element, folder: Path) -> ET.Element:
    """Return a copy of a robot that can be parsed from memory: its mesh names are absolute.

    Args:
        root: the ``robot`` element.
        folder: the folder of the file, which relative mesh names start from.

    Raises:
        InvalidModel: a mesh is missing, outside the folder, or in a format that Drake does not read.
    """
    robot = deepcopy(root)
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"file://{_mesh_file(mesh.get('filename', ''), folder)}")  # Drake decodes no %20
    return robot


def drop_collision(robot: ET.Element) -> None:
    """Take a robot's collision geometry away: a plant without any never asks the scene graph for contacts."""
    for link in robot.iterfind("link"):
        for element in link.findall("collision"):
            link.remove(element)


def _mesh_file(uri: str, folder: Path) -> Path:
    path = (folder / uri.removeprefix("file://")).resolve()
    if "://" in uri.removeprefix("file://"):
        raise InvalidModel(
            folder, f"mesh '{uri}'", "packages are not resolved here; name the mesh relative to the URDF"
        )
    if not path.is_relative_to(folder.resolve()):
        raise InvalidModel(folder, f"mesh '{uri}'", "lies outside the robot's folder; copy it there")
    if not path.is_file():
        raise InvalidModel(folder, f"mesh '{uri}'", f"there is no file {path}")
    if path.suffix.lower() not in MESH_FORMATS:
        raise InvalidModel(folder, f"mesh '{uri}'", f"Drake reads {', '.join(MESH_FORMATS)}; convert the mesh")
    return path


def _check_tree(root: ET.Element, path: Path) -> None:
    for tag in ("link", "joint"):
        names = [_name(element) for element in root.iterfind(tag)]
        for index, name in enumerate(names):
            if not name:
                raise InvalidModel(path, f"<{tag}> number {index + 1}", "has no name")
            if name in names[:index]:
                raise InvalidModel(path, f"{tag} '{name}'", "stands twice; names are unique")
    links = {_name(link) for link in root.iterfind("link")}
    children: set[str] = set()
    for joint in root.iterfind("joint"):
        for end in ("parent", "child"):
            if _link_of(joint, end) not in links:
                raise InvalidModel(path, f"joint '{_name(joint)}'", f"its {end} '{_link_of(joint, end)}' is no link")
        child = _link_of(joint, "child")
        if child in children:
            raise InvalidModel(path, f"link '{child}'", "is the child of two joints; a URDF is a tree")
        children.add(child)
    if len(links - children) != 1:
        raise InvalidModel(path, "", f"has {len(links - children)} root links; a URDF is a tree with one root")


def _check_joint(joint: ET.Element, path: Path) -> None:
    where = f"joint '{_name(joint)}'"
    for element in joint.iter():
        for value in _vectors(element, "xyz", "rpy", "lower", "upper", "effort", "velocity", "damping"):
            _require_finite(value, f"{where} <{element.tag}>", path)
    limit = joint.find("limit")
    if joint.get("type") in LIMITED_JOINTS:
        if limit is None:
            raise InvalidModel(path, where, "a revolute or prismatic joint needs a <limit>")
        lower, upper = float(limit.get("lower", 0)), float(limit.get("upper", 0))
        if lower >= upper:
            raise InvalidModel(path, f"{where} <limit>", f"lower {lower:g} is not below upper {upper:g}")
    damping = joint.find("dynamics")
    if damping is not None and float(damping.get("damping", 0)) < 0:
        raise InvalidModel(path, f"{where} <dynamics>", "damping is negative")


def _check_inertial(link: ET.Element, path: Path) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"link '{_name(link)}' <inertial>"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise InvalidModel(path, where, "needs <mass> and <inertia>")
    for element in inertial.iter():
        for value in _vectors(element, "xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            _require_finite(value, where, path)
    if _mass(link) < 0:
        raise InvalidModel(path, where, f"mass {mass.get('value')} kg is negative")
    xx, yy, zz, xy, xz, yz = (float(inertia.get(k, 0)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    if _mass(link) == 0 and any((xx, yy, zz)):
        raise InvalidModel(path, where, "has moments of inertia but no mass; Drake would give it 1 kg in silence")
    if not RotationalInertia(xx, yy, zz, xy, xz, yz).CouldBePhysicallyValid():  # Drake would put a sphere's in silence
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        listed = ", ".join(f"{moment:.9g}" for moment in moments)
        raise InvalidModel(
            path,
            where,
            f"no body has the principal moments {listed} kg m²: none is negative, none exceeds the others' sum",
        )


def _check_shape(shape: ET.Element, where: str, path: Path) -> None:
    for value in _vectors(shape, "size", "radius", "length", "scale"):
        _require_finite(value, f"{where} <{shape.tag}>", path)
        if shape.tag != "mesh" and not all(number > 0 for number in _numbers(value)):
            raise InvalidModel(path, f"{where} <{shape.tag}>", f"size '{value}' is not positive")


def _check_actuators(root: ET.Element, path: Path) -> None:
    actuated = {_name(joint) for joint in root.iterfind("transmission/joint")}
    for joint in root.iterfind("joint"):
        if joint.get("type") not in MOVABLE_JOINTS:
            continue
        where = f"joint '{_name(joint)}'"
        if _name(joint) not in actuated:
            raise InvalidModel(path, where, "has no <transmission>, so no motor can move it; add one")
        limit = joint.find("limit")
        if limit is None or float(limit.get("effort", 0)) <= 0:
            raise InvalidModel(path, f"{where} <limit>", "effort is not positive [N·m], so its motor could not move it")


def _require_finite(text: str, where: str, path: Path) -> None:
    try:
        numbers = _numbers(text)
    except ValueError as problem:
        raise InvalidModel(path, where, f"'{text}' is not a number") from problem
    if not all(math.isfinite(number) for number in numbers):
        raise InvalidModel(path, where, f"'{text}' is not finite")


def _vectors(element: ET.Element, *keys: str) -> Iterator[str]:
    return (element.attrib[key] for key in keys if key in element.attrib)


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]


def _joint(root: ET.Element, name: str) -> ET.Element:
    found = next((joint for joint in root.iterfind("joint") if joint.get("name") == name), None)
    if found is None:
        raise UnknownName("joint", name, movable_joints(root))
    return found


def _mass(link: ET.Element) -> float:
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else float(mass.get("value", 0))


def _name(element: ET.Element) -> str:
    return element.get("name", "")


def _link_of(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
