"""The geoms of MuJoCo as visuals and collision shapes."""

import xml.etree.ElementTree as ET
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportReport
from simrob_drake.importer.repairs.shape_elements import PLAIN
from simrob_drake.robots.urdf import DRAKE, add_colour, place, text, written

_PLANE, _HILLS, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(8)  # mjtGeom
_FRICTION = 1.0  # of a geom that does not tell it
_SHOWN = 3  # groups of geoms from here on are hidden in MuJoCo's viewer
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # a geom with another colour than this covers its material's
_LOST = {
    _PLANE: "planes: a station has a floor of its own (floor:)",
    _HILLS: "height fields: a station has terrain of its own (floor.terrain:)",
}


def pose_in(model: Any, kind: str, index: int) -> RigidTransform:
    """Return the pose that MuJoCo's figures give to a body, geom, site or mesh."""
    return frame(getattr(model, f"{kind}_pos")[index], getattr(model, f"{kind}_quat")[index])


def frame(position: Vector, quaternion: Vector) -> RigidTransform:
    """Return a pose of a position [m] and a quaternion w x y z of any length."""
    return RigidTransform(Quaternion(quaternion / np.linalg.norm(quaternion)), position)


@dataclass
class ShapeWriter:
    """Writes the geoms of one robot, link by link."""

    robot: ET.Element
    model: Any
    report: ImportReport
    _lost: Counter[str] = field(default_factory=Counter, init=False)
    _frictions: set[float] = field(default_factory=set, init=False)
    _colours: dict[tuple[float, ...], str] = field(default_factory=dict, init=False)

    def add(self, body: int, link: ET.Element, shift: Vector) -> None:
        """Add the geoms of a body to its link, whose frame lies at ``shift`` in the body."""
        model = self.model
        for geom in map(int, np.flatnonzero(model.geom_bodyid == body)):
            shape, own = self._shape(geom)
            if shape is None:
                continue
            pose = RigidTransform(-shift) @ pose_in(model, "geom", geom) @ own
            if model.geom_group[geom] < _SHOWN and model.geom_rgba[geom][3] > 0:
                visual = self._element(link, "visual", geom, shape, pose)
                self._add_colour(visual, geom)
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                self._element(link, "collision", geom, shape, pose)
                self._frictions.add(float(model.geom_friction[geom][0]))

    def finish(self, *, outside: bool) -> None:
        """Say what was lost; ``outside``: the shapes of the world are no part of the robot."""
        if self.robot.find("link/visual") is None:
            for link in self.robot.iterfind("link"):
                for collision in link.findall("collision"):
                    ET.SubElement(link, "visual").extend(deepcopy(list(collision)))
        still = int(np.count_nonzero((self.model.geom_bodyid == 0) & (self.model.geom_type != _PLANE)))
        if outside and still:
            self._lost["shapes of the world: pieces of a station can take their place (pieces:)"] = still
        for what, count in self._lost.items():
            self.report.add("dropped", "", f"{count} {what}")
        if self._frictions - {_FRICTION}:
            interval = f"{min(self._frictions):g} to {max(self._frictions):g}"
            self.report.add("lost", "", f"sliding friction of the shapes, {interval}: a station has its own (contact:)")

    def _shape(self, geom: int) -> tuple[ET.Element | None, RigidTransform]:
        """Return the element of a geom's shape, None where it has none, and the shape's pose in the geom."""
        kind, size = int(self.model.geom_type[geom]), self.model.geom_size[geom]
        if kind == _MESH:
            return self._mesh(int(self.model.geom_dataid[geom]))
        shape: ET.Element | None = None
        if kind == _SPHERE:
            shape = ET.Element("sphere", radius=written(size[0]))
        elif kind == _BOX:
            shape = ET.Element("box", size=text(2 * size))
        elif kind in (_CAPSULE, _CYLINDER):
            tag = "cylinder" if kind == _CYLINDER else f"{DRAKE}capsule"
            shape = ET.Element(tag, radius=written(size[0]), length=written(2 * size[1]))
        elif kind == _ELLIPSOID:
            shape = ET.Element(f"{DRAKE}ellipsoid", dict(zip("abc", map(written, size), strict=True)))
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
            self._lost["meshes that are written in the file itself"] += 1
            return None, RigidTransform()
        if not turn.IsNearlyIdentity(1e-9) and np.ptp(scale) > 1e-9 * np.max(np.abs(scale)):
            self._lost["meshes that are turned and then scaled by other factors along x, y and z"] += 1
            return None, RigidTransform()
        own = pose_in(model, "mesh", mesh).inverse()
        moved = RigidTransform(turn, -scale * (turn @ model.mesh_refpos[mesh]))
        shape = ET.Element("mesh", {"filename": file, PLAIN: "true"})  # MuJoCo heeds no colours of mesh files
        if not np.array_equal(scale, np.ones(3)):
            shape.set("scale", text(scale))
        return shape, own @ moved

    def _element(self, link: ET.Element, tag: str, geom: int, shape: ET.Element, pose: RigidTransform) -> ET.Element:
        name = str(self.model.geom_name[geom])
        element = ET.SubElement(link, tag, {"name": name} if name else {})
        place(element, pose)
        ET.SubElement(element, "geometry").append(shape)
        return element

    def _add_colour(self, visual: ET.Element, geom: int) -> None:
        material, rgba = int(self.model.geom_matid[geom]), self.model.geom_rgba[geom]
        name = ""
        if material >= 0 and np.allclose(rgba, _DEFAULT_RGBA):
            name, rgba = str(self.model.mat_name[material]), self.model.mat_rgba[material]
        colour = tuple(np.asarray(rgba, dtype=float).round(6).tolist())
        name = self._colours.setdefault(colour, name or f"colour_{len(self._colours) + 1}")
        add_colour(visual, name, colour)
