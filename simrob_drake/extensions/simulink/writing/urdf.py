"""Trees of bodies as URDFs, bodies without joints as pieces, under plain names."""

import re
import unicodedata
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.math import RigidTransform

from simrob_drake.base.files import PIECE_FILE
from simrob_drake.base.frames import pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import PUSH, RigidPart
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.mechanics.shapes import load_mesh, write_obj
from simrob_drake.extensions.simulink.mechanics.solids import (
    SolidBody,
    moved,
    possible_moments,
    together,
)
from simrob_drake.extensions.simulink.mechanics.trees import BodyOnJoint, Tree
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.parts import MeshPart
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import (
    add_colour,
    add_joint,
    add_motor,
    format_numbers,
    place,
    set_inertia,
    six_moments,
)


class UniqueNames(FreeNames):
    """Gives names, and never the same twice."""

    def give(self, path: str) -> str:
        """Return a name for a path: its last part, with the parts before it where that is taken."""
        parts = [plain(part) for part in path.split("/")]
        names = ["_".join(parts[-count:]) for count in range(1, len(parts) + 1)]
        return self.take(next(filter(self.is_free, names), names[-1]))


def plain(text: str) -> str:
    """Return a text as a name."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", ascii_text).strip("_")[:60]
    return name if name and not name[0].isdigit() else f"_{name}" if name else "block"


ROOT = "base"
AMPLE = 1e6  # effort of a motor that the model does not limit [N·m or N]
_FAR = 1e3  # m or rad: the limit of a joint that has none, or one only
_TINY = 1e-9
_SIZES = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
}  # attributes of a URDF


@dataclass
class RobotFile:
    """A robot being written."""

    tree: Tree  # what it is
    element: ET.Element  # its URDF
    # names of its joints by degree of freedom
    axes: dict[Freedom, str] = field(default_factory=dict)
    links: dict[RigidPart, str] = field(default_factory=dict)  # names of its links by body
    frames: dict[RigidPart, RigidTransform] = field(default_factory=dict)
    """Pose of each link's frame in its body's first frame."""
    tools: dict[str, str] = field(default_factory=dict)  # names of frames on it
    pushed: str = ""  # the tool at which an external force acts; empty without
    weightless: dict[RigidPart, str] = field(default_factory=dict)
    """Links that move, and with what hangs on them have no mass, by body."""
    mass: float = 0.0  # of all that moves [kg]


class UrdfWriter:
    """Writes what is seen and weighed of one robot or piece, meshes into a folder of its own."""

    def __init__(self, folder: Path, report: ImportReport, names: UniqueNames) -> None:
        folder.mkdir(exist_ok=True)
        self._folder, self._report, self._names = folder, report, names
        self._meshes = UniqueNames()
        self._copied: dict[tuple[Path | None, float], tuple[str, str] | None] = {}

    def robot(self, name: str, tree: Tree, base_solids: list[SolidBody]) -> RobotFile:
        """Return a tree as a robot; ``base_solids`` of the world are seen as parts of its base."""
        robot = RobotFile(tree, ET.Element("robot", name=name))
        floating = not tree.root.grounded
        root_name = self._names.give(f"{name}_{ROOT}")
        robot.links[tree.root], robot.frames[tree.root] = root_name, tree.frame
        root = ET.SubElement(robot.element, "link", name=root_name)
        if floating:
            self._link(robot, root, tree.root, tree.frame)
        else:
            for solid in base_solids:
                self._visual(root, solid, tree.frame.inverse() @ solid.pose)
        for branch in tree.branches:
            self._branch(robot, branch)
        for freedom in tree.freedoms:
            add_motor(robot.element, robot.axes[freedom], drive=f"{robot.axes[freedom]}_drive")
        self._add_tools(robot)
        return robot

    def _branch(self, robot: RobotFile, branch: BodyOnJoint) -> None:
        """Add the joints of a branch, each degree of freedom its own, and its link behind the last one."""
        parent = robot.links[branch.parent]
        origin = robot.frames[branch.parent].inverse() @ branch.in_parent
        robot.frames[branch.body] = branch.in_body
        for number, freedom in enumerate(branch.freedoms):
            last = number == len(branch.freedoms) - 1
            robot.axes[freedom] = self._names.give(freedom.name)
            child = self._names.give(f"{robot.axes[freedom]}_link")
            self._joint(
                robot.element, robot.axes[freedom], freedom, branch.sign, (parent, child, origin)
            )
            link = ET.SubElement(robot.element, "link", name=child)
            if last:
                robot.links[branch.body] = child
                self._link(robot, link, branch.body, branch.in_body)
            else:
                set_inertia(link, mass=_TINY, moments=[_TINY] * 3, pose=RigidTransform())
            parent, origin = child, RigidTransform()

    def _joint(
        self,
        robot: ET.Element,
        name: str,
        freedom: Freedom,
        sign: float,
        ends: tuple[str, str, RigidTransform],
    ) -> None:
        bounds = {"lower": freedom.lower, "upper": freedom.upper}
        kind = (
            ("revolute" if any(map(isfinite, bounds.values())) else "continuous")
            if freedom.turns
            else "prismatic"
        )
        parent, child, origin = ends
        joint = add_joint(robot, name, parent=parent, child=child, pose=origin, kind=kind)
        ET.SubElement(joint, "axis", xyz=format_numbers((sign * freedom.axis).tolist()))
        limit = ET.SubElement(joint, "limit", effort=format_numbers([AMPLE]), velocity="1000")
        for end, bound in bounds.items() if kind != "continuous" else ():
            limit.set(end, format_numbers([bound if isfinite(bound) else np.sign(bound) * _FAR]))
        ET.SubElement(joint, "dynamics", damping=format_numbers([freedom.damping]))

    def _link(
        self, robot: RobotFile, link: ET.Element, body: RigidPart, frame: RigidTransform
    ) -> None:
        inverse = frame.inverse()
        weight = together([moved(solid.weight, inverse @ solid.pose) for solid in body.solids])
        robot.mass += weight.mass
        name = link.get("name", "")
        if weight.mass > 0:
            moments = possible_moments(name, weight, self._report)
            set_inertia(link, mass=weight.mass, moments=moments, pose=RigidTransform(weight.com))
        else:
            set_inertia(link, mass=_TINY, moments=[_TINY] * 3, pose=RigidTransform())
            if not any(
                solid.weight.mass > 0
                for behind in robot.tree.behind(body)
                for solid in behind.solids
            ):
                robot.weightless[body] = name
        for solid in body.solids:
            self._visual(link, solid, inverse @ solid.pose)

    def _visual(self, link: ET.Element, solid: SolidBody, pose: RigidTransform) -> None:
        if not solid.visible or (look := self._look(solid)) is None:
            return
        visual = ET.SubElement(link, "visual")
        place(visual, pose)
        shape, size = look
        keys = _SIZES.get(shape, ("filename",))
        texts = (
            [size] if shape == "mesh" else map(format_numbers, np.split(np.array(size), len(keys)))
        )
        ET.SubElement(ET.SubElement(visual, "geometry"), shape, dict(zip(keys, texts, strict=True)))
        add_colour(visual, f"{link.get('name')}_{len(link)}", solid.colour)

    def _look(self, solid: SolidBody) -> tuple[str, Any] | None:
        """Return shape and size of a solid, or ``mesh`` and its file, in metres; None where its mesh cannot be read."""
        shape, key = solid.shape, (solid.file, solid.scale)
        if shape is not None and shape.mesh is None:
            return shape.kind, [float(value) for value in shape.size]
        if shape is not None and shape.mesh is not None:
            return "mesh", self._write(solid.node.path, shape.mesh)
        if solid.file is not None and key not in self._copied:  # each file once
            try:
                mesh = load_mesh(solid.file).transform(np.diag([*[solid.scale] * 3, 1.0]))
                self._copied[key] = "mesh", self._write(solid.file.stem, mesh)
            except UnreadableMesh as problem:
                solid.node.note(
                    "dropped",
                    message(
                        "simulink.mesh_with_problem",
                        "the mesh {file} {problem}",
                        file=solid.file.name,
                        problem=problem,
                    ),
                )
                self._copied[key] = None
        return self._copied.get(key)

    def _write(self, path: str, mesh: MeshPart) -> str:
        name = f"meshes/{self._meshes.give(path)}.obj"
        (self._folder / name).parent.mkdir(exist_ok=True)
        write_obj(mesh, self._folder / name)
        return name

    def _add_tools(self, robot: RobotFile) -> None:
        """Add the Reference Frames of the outermost level as tools, first what lies farthest out."""
        order = [robot.tree.root, *(branch.body for branch in robot.tree.branches)]
        found = [
            (
                node.path.count("/"),
                -order.index(body),
                node,
                robot.frames[body].inverse() @ pose,
                robot.links[body],
            )
            for body in order
            if not body.grounded
            for node, pose in body.marks
        ]
        outermost = min((depth for depth, _, node, *_ in found if node.kind != PUSH), default=0)
        for depth, _, node, pose, link in sorted(found, key=lambda entry: entry[:2]):
            if depth > outermost and node.kind != PUSH:
                continue
            name = self._names.give(node.path)
            add_joint(robot.element, f"{name}_mount", parent=link, child=name, pose=pose)
            ET.SubElement(robot.element, "link", name=name)
            robot.tools[name] = name
            if node.kind == PUSH:
                robot.pushed = robot.pushed or name

    def piece(
        self, name: str, solids: list[SolidBody], colliding: set[Node], *, weighs: bool
    ) -> bool:
        """Write a piece's file of solids with their poses in its frame, and tell whether there is anything to it.

        Those in ``colliding`` take part in contact; what stands fixed has no mass, and does not weigh.
        """
        shapes = [
            entry
            for solid in solids
            if (entry := self._shape(solid, solid.node in colliding)) is not None
        ]
        weight = together([moved(solid.weight, solid.pose) for solid in solids])
        if not shapes and weight.mass <= 0:
            self._folder.rmdir()
            return False
        content: dict[str, Any] = {"description": f"{name}, of a Simulink model"}
        if weighs and weight.mass > 0:
            inertia = possible_moments(name, weight, self._report)
            moments = six_moments(inertia)
            moments = moments if np.abs(moments[3:]).max() > 1e-9 * inertia.max() else moments[:3]
            content |= {
                "mass": float(weight.mass),
                "com": weight.com.tolist(),
                "inertia": moments.tolist(),
            }
        (self._folder / PIECE_FILE).write_text(
            as_yaml({**content, "shapes": shapes}), encoding="utf-8"
        )
        return True

    def _shape(self, solid: SolidBody, collides: bool) -> dict[str, Any] | None:
        if not (solid.visible or collides) or (look := self._look(solid)) is None:
            return None
        shape, size = look
        entry = {shape: size[0] if shape == "sphere" else size, "pose": pose_list(solid.pose)}
        entry["colour"] = [round(value, 4) for value in solid.colour]
        return entry | {
            key: False for key, on in (("collides", collides), ("visible", solid.visible)) if not on
        }


def as_yaml(content: dict[str, Any]) -> str:
    """Return a file of a station, robot or piece."""
    return str(
        yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
        )
    )


def pose_list(pose: RigidTransform) -> list[float]:
    """Return a pose as files have it, [x y z Rz Ry Rx]."""
    return [float(f"{value:.15g}") + 0.0 for value in pose_from_transform(pose)]
