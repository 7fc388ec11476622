"""From MuJoCo's figures to links, joints and shapes: a tree in which every joint turns about one axis, or slides."""

import xml.etree.ElementTree as ET
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector, rotation_of
from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.mujoco.mjcf.drives import DriveWriter, UrdfJoint
from simrob_drake.importer.repairs.base import FLOATING_MARK
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.importer.repairs.shapes import PLAIN
from simrob_drake.importer.trees import ROOT, add_between
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    add_colour,
    add_frame,
    add_joint,
    format_number,
    format_numbers,
    place,
    set_inertia,
)

_FREE, _BALL, _SLIDE = range(3)  # mjtJoint
_PLANE, _HILLS, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(8)  # mjtGeom
_FRICTION = 1.0  # of a geom that does not tell it
_SHOWN = 3  # groups of geoms from here on are hidden in MuJoCo's viewer
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # a geom with another colour than this covers its material's
_LOST = {
    _PLANE: message("mujoco.planes_lost", "planes: a station has a floor of its own (floor:)"),
    _HILLS: message(
        "mujoco.height_fields_lost",
        "height fields: a station has terrain of its own (floor.terrain:)",
    ),
}


class _Motion(NamedTuple):
    """One freedom of a joint, as a joint of a URDF has it."""

    name: str
    joint: int  # the one of MuJoCo that it belongs to
    kind: str
    axis: Vector  # in its own frame
    back: RigidTransform  # from MuJoCo's zero to that of the URDF
    part: int = 0  # which of the joint's freedoms it is


def robot_from_model(model: Any, name: str, chosen: str, report: ImportReport) -> ET.Element:
    """Return the ``robot`` element of a compiled model.

    ``model`` has its figures as arrays, under MuJoCo's names; ``chosen`` is the body that is the robot, or empty.
    Raises InvalidModel: there are several robots, and none is chosen; UnknownName: the chosen one is none of them.
    """
    tops = _tops(model, chosen, report)
    writer = _Writer(model, name, report)
    floats = len(tops) == 1 and _is_free(model, tops[0])
    writer.add_bodies(tops, floats=floats)
    DriveWriter(writer.robot, model, writer.joints, writer.links, report).write()
    return writer.robot


def _tops(model: Any, name: str, report: ImportReport) -> list[int]:
    tops = [body for body in range(1, len(model.body_parentid)) if model.body_parentid[body] == 0]
    names = {body: body_name(model, body) for body in tops}
    if name:
        one_of(message("mujoco.body_option", "body (for --model)"), name, names.values())
        return [body for body in tops if names[body] == name]
    left = {
        body: message("mujoco.moved_by_hand", "is moved by hand in MuJoCo (mocap)")
        for body in tops
        if model.body_mocapid[body] >= 0
    }
    moving = [body for body in tops if body not in left and _moves(model, body)]
    floating = [body for body in moving if _is_free(model, body)]
    if floating and len(moving) > 1:
        listed = ", ".join(names[body] for body in moving)
        raise report.refusal(
            "",
            message(
                "mujoco.several_robots",
                "holds several robots ({names}); choose one with --model NAME",
                names=listed,
            ),
        )
    rest = [body for body in tops if body not in (*left, *moving)]
    loose = [body for body in rest if _is_free(model, body)]
    if not moving and loose == rest:
        kept = rest[:1]
    else:
        text = message(
            "mujoco.loose_body",
            "is loose and has no joints; a piece of a station can take its place (pieces:, free: true)",
        )
        left |= dict.fromkeys(loose if moving else (), text)
        kept = floating or [body for body in tops if body not in (*left, *loose)]
    if floating:
        text = message(
            "mujoco.stands_beside_robot",
            "stands in the world beside a robot that floats; a piece of a station can take its place",
        )
        left |= dict.fromkeys([body for body in rest if body not in loose], text)
    for body, why in left.items():
        report.add("dropped", message("mujoco.body_called", "body '{name}'", name=names[body]), why)
    return kept


def _moves(model: Any, top: int) -> bool:
    inside = {top}
    for body in range(top, len(model.body_parentid)):
        if model.body_parentid[body] in inside:
            inside.add(body)
    joints = zip(model.jnt_bodyid, model.jnt_type, strict=True)
    return any(kind != _FREE and body in inside for body, kind in joints)


def body_name(model: Any, body: int) -> str:
    """Return what a body is called; those without a name by their number."""
    return str(model.body_name[body]) or f"body_{body}"


def _is_free(model: Any, body: int) -> bool:
    first = model.body_jntadr[body]
    return bool(first >= 0 and model.jnt_type[first] == _FREE)


@dataclass
class _Writer:
    """Writes one robot; the frame of a link lies on the axis of the last joint that moves it, else at its body's."""

    model: Any
    name: str
    report: ImportReport
    robot: ET.Element = field(init=False)
    links: dict[int, ET.Element] = field(default_factory=dict, init=False)
    joints: list[UrdfJoint] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.robot = ET.Element("robot", name=self.name)
        self._shifts = {0: np.zeros(3)}  # of the links' frames in their bodies
        self._names = FreeNames(map(str, self.model.body_name))
        self._joint_names = FreeNames(map(str, self.model.jnt_name))
        self._lost, self._frictions = Counter[str](), set[float]()  # of the shapes
        self._colours: dict[tuple[float, ...], str] = {}

    def add_bodies(self, tops: list[int], *, floats: bool) -> None:
        """Add the trees that begin at bodies, and what is fixed in the world unless they float."""
        model = self.model
        if floats:
            self.robot.set(FLOATING_MARK, "floating")
        else:
            self.links[0] = ET.SubElement(self.robot, "link", name=self._names.take(ROOT))
        for body in range(1, len(model.body_parentid)):
            if body in tops or (
                model.body_parentid[body] in self.links and model.body_parentid[body] != 0
            ):
                self._add_body(body)
        for body in self.links:
            self._add_shapes(body)
        self._finish_shapes(outside=floats)
        frames = FreeNames(link.get("name", "") for link in self.robot.iterfind("link"))
        for site, body in enumerate(model.site_bodyid):
            if body in self.links:
                name = frames.take(str(model.site_name[site]) or f"site_{site}")
                place = RigidTransform(-self._shifts[body]) @ pose_in(model, "site", site)
                add_frame(self.robot, name, self.links[body].get("name", ""), place)

    def _add_body(self, body: int) -> None:
        model, name = self.model, body_name(self.model, body)
        parent = int(model.body_parentid[body])
        first = max(int(model.body_jntadr[body]), 0)
        mine = [
            joint
            for joint in range(first, first + int(model.body_jntnum[body]))
            if model.jnt_type[joint] != _FREE
        ]
        motions = [motion for joint in mine for motion in self._motions(joint, name)]
        link = ET.Element("link", name=name)
        shift = np.array(model.jnt_pos[mine[-1]]) if mine else np.zeros(3)
        self.links[body], self._shifts[body] = link, shift
        mass = float(self.model.body_mass[body])
        if mass > 0:
            place = RigidTransform(-shift) @ frame(
                self.model.body_ipos[body], self.model.body_iquat[body]
            )
            set_inertia(link, mass=mass, moments=self.model.body_inertia[body].tolist(), pose=place)
        if parent in self.links:
            self._connect(link, body, motions, parent)
        self.robot.append(link)
        if model.body_gravcomp[body]:
            self.report.add(
                "lost",
                message("mujoco.body_called", "body '{name}'", name=name),
                message(
                    "mujoco.gravcomp",
                    "gravcomp {value:g}: all has its weight",
                    value=model.body_gravcomp[body],
                ),
            )

    def _connect(self, link: ET.Element, body: int, motions: list[_Motion], parent: int) -> None:
        """Hang a link on its parent by its joints, one link between each two."""
        name, carrier = link.get("name", ""), self.links[parent].get("name", "")
        place, shift = (
            RigidTransform(-self._shifts[parent]) @ pose_in(self.model, "body", body),
            np.zeros(3),
        )
        for index, motion in enumerate(motions):
            anchor = np.array(self.model.jnt_pos[motion.joint])
            mass, moment = (
                float(self.model.body_mass[body]),
                float(np.max(self.model.body_inertia[body])),
            )
            last = index == len(motions) - 1
            child = name if last else add_between(self.robot, self._names, name, mass, moment)
            pose = place @ RigidTransform(anchor - shift) @ motion.back
            joint = add_joint(
                self.robot, motion.name, parent=carrier, child=child, pose=pose, kind=motion.kind
            )
            ET.SubElement(joint, "axis", xyz=format_numbers(motion.axis))
            self.joints.append(UrdfJoint(joint, motion.joint, motion.part))
            carrier, place, shift = child, RigidTransform(), anchor
        if not motions:
            add_joint(
                self.robot,
                self._joint_names.take(f"{name}_fixed"),
                parent=carrier,
                child=name,
                pose=place,
            )
        if len(motions) > 1:
            listed = ", ".join(motion.name for motion in motions)
            sentence = message(
                "mujoco.several_joints",
                "moves by {count} joints ({names}), between which are links of a billionth of its mass",
                count=len(motions),
                names=listed,
            )
            self.report.add(
                "repaired", message("mujoco.body_called", "body '{name}'", name=name), sentence
            )

    def _motions(self, joint: int, body: str) -> list[_Motion]:
        model, kind = self.model, self.model.jnt_type[joint]
        name = str(model.jnt_name[joint]) or self._joint_names.take(f"{body}_joint")
        turning = "revolute" if model.jnt_limited[joint] else "continuous"
        if kind == _BALL:
            text = message(
                "mujoco.ball_joint",
                "is a ball; three joints x, y, z, which lose one freedom where y is at 90 deg",
            )
            self.report.add(
                "approximated", message("mujoco.joint_called", "joint '{name}'", name=name), text
            )
            axes = zip("xyz", np.eye(3), strict=True)
            return [
                _Motion(
                    self._joint_names.take(f"{name}_{letter}"),
                    joint,
                    turning,
                    axis,
                    RigidTransform(),
                    part,
                )
                for part, (letter, axis) in enumerate(axes)
            ]
        axis, zero = np.array(model.jnt_axis[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
        if kind == _SLIDE:
            return [_Motion(name, joint, "prismatic", axis, RigidTransform(-zero * axis))]
        back = RigidTransform(RotationMatrix(AngleAxis(angle=-zero, axis=axis)), np.zeros(3))
        return [_Motion(name, joint, turning, axis, back)]

    def _add_shapes(self, body: int) -> None:
        model, link, shift = self.model, self.links[body], self._shifts[body]
        for geom in map(int, np.flatnonzero(model.geom_bodyid == body)):
            shape, own = self._shape(geom)
            if shape is None:
                continue
            pose = RigidTransform(-shift) @ pose_in(model, "geom", geom) @ own
            if model.geom_group[geom] < _SHOWN and model.geom_rgba[geom][3] > 0:
                visual = self._element(link, "visual", geom, shape, pose)
                material, rgba = int(self.model.geom_matid[geom]), self.model.geom_rgba[geom]
                name = ""
                if material >= 0 and np.allclose(rgba, _DEFAULT_RGBA):
                    name, rgba = str(self.model.mat_name[material]), self.model.mat_rgba[material]
                colour = tuple(np.asarray(rgba, dtype=float).round(6).tolist())
                name = self._colours.setdefault(colour, name or f"colour_{len(self._colours) + 1}")
                add_colour(visual, name, colour)
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                self._element(link, "collision", geom, shape, pose)
                self._frictions.add(float(model.geom_friction[geom][0]))

    def _finish_shapes(self, *, outside: bool) -> None:
        """Say what was lost; ``outside``: the shapes of the world are no part of the robot."""
        if self.robot.find("link/visual") is None:
            for link in self.robot.iterfind("link"):
                for collision in link.findall("collision"):
                    ET.SubElement(link, "visual").extend(deepcopy(list(collision)))
        still = int(
            np.count_nonzero((self.model.geom_bodyid == 0) & (self.model.geom_type != _PLANE))
        )
        if outside and still:
            self._lost[
                message(
                    "mujoco.world_shapes_lost",
                    "shapes of the world: pieces of a station can take their place (pieces:)",
                )
            ] = still
        for what, count in self._lost.items():
            self.report.add("dropped", "", compound("{count} {what}", count=count, what=what))
        if self._frictions - {_FRICTION}:
            interval = message(
                "mujoco.interval",
                "{least:g} to {most:g}",
                least=min(self._frictions),
                most=max(self._frictions),
            )
            self.report.add(
                "lost",
                "",
                message(
                    "mujoco.sliding_friction",
                    "sliding friction of the shapes, {interval}: a station has its own (contact:)",
                    interval=interval,
                ),
            )

    def _shape(self, geom: int) -> tuple[ET.Element | None, RigidTransform]:
        """Return the element of a geom's shape, None where it has none, and the shape's pose in the geom."""
        kind, size = int(self.model.geom_type[geom]), self.model.geom_size[geom]
        if kind == _MESH:
            return self._mesh(int(self.model.geom_dataid[geom]))
        shape: ET.Element | None = None
        if kind == _SPHERE:
            shape = ET.Element("sphere", radius=format_number(size[0]))
        elif kind == _BOX:
            shape = ET.Element("box", size=format_numbers(2 * size))
        elif kind in (_CAPSULE, _CYLINDER):
            tag = "cylinder" if kind == _CYLINDER else f"{DRAKE}capsule"
            shape = ET.Element(
                tag, radius=format_number(size[0]), length=format_number(2 * size[1])
            )
        elif kind == _ELLIPSOID:
            shape = ET.Element(
                f"{DRAKE}ellipsoid", dict(zip("abc", map(format_number, size), strict=True))
            )
        else:
            self._lost[_LOST.get(kind, "shapes that are given by a function")] += 1
        return shape, RigidTransform()

    def _mesh(self, mesh: int) -> tuple[ET.Element | None, RigidTransform]:
        """Return the element of a mesh's file, and its pose in the geom.

        MuJoCo takes a corner v of the file to S Rᵀ (v - p), with the scale S and the mesh's own ``refquat`` R and
        ``refpos`` p, and then into the frame of its inertia.
        """
        model = self.model
        file, scale = str(model.mesh_file[mesh]), model.mesh_scale[mesh]
        turn = frame(np.zeros(3), model.mesh_refquat[mesh]).rotation().inverse()
        if not file:
            self._lost[
                message("mujoco.written_meshes_lost", "meshes that are written in the file itself")
            ] += 1
            return None, RigidTransform()
        if not turn.IsNearlyIdentity(1e-9) and np.ptp(scale) > 1e-9 * np.max(np.abs(scale)):
            self._lost[
                message(
                    "mujoco.scaled_meshes_lost",
                    "meshes that are turned and then scaled by other factors along x, y and z",
                )
            ] += 1
            return None, RigidTransform()
        own = pose_in(model, "mesh", mesh).inverse()
        moved = RigidTransform(turn, -scale * (turn @ model.mesh_refpos[mesh]))
        # MuJoCo heeds no colours of mesh files
        shape = ET.Element("mesh", {"filename": file, PLAIN: "true"})
        if not np.array_equal(scale, np.ones(3)):
            shape.set("scale", format_numbers(scale))
        return shape, own @ moved

    def _element(
        self, link: ET.Element, tag: str, geom: int, shape: ET.Element, pose: RigidTransform
    ) -> ET.Element:
        name = str(self.model.geom_name[geom])
        element = ET.SubElement(link, tag, {"name": name} if name else {})
        place(element, pose)
        ET.SubElement(element, "geometry").append(shape)
        return element


def pose_in(model: Any, kind: str, index: int) -> RigidTransform:
    """Return the pose that MuJoCo's figures give to a body, geom, site or mesh."""
    return frame(getattr(model, f"{kind}_pos")[index], getattr(model, f"{kind}_quat")[index])


def frame(position: Vector, quaternion: Vector) -> RigidTransform:
    """Return a pose of a position [m] and a quaternion w x y z of any length."""
    return RigidTransform(rotation_of(quaternion), position)
