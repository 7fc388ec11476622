"""What a robot collides with: each mesh becomes its convex hull, or the tightest box around it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import box_of, hull_of, is_hull
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary, Scale
from simrob_drake.importer.meshes.parts import points_of
from simrob_drake.importer.meshes.writing import MeshWriter
from simrob_drake.importer.repairs.shape_elements import (
    ShapeNames,
    drop,
    mesh_name,
    mesh_of,
    scale_of,
    set_shape,
    shapes_of,
    tell_mesh,
)
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE, drop_collision
from simrob_drake.robots.urdf_elements import place, pose_of


@dataclass
class Collisions:
    """Rewrites the collision shapes of one robot, link by link."""

    library: MeshLibrary
    writer: MeshWriter
    names: ShapeNames
    report: ImportReport
    kind: Literal["hull", "box", "none"]
    _drawn: list[tuple[ET.Element, list[ET.Element]]] = field(default_factory=list, init=False)
    _hulls: dict[tuple[Path, Scale], tuple[Mesh, str, str]] = field(default_factory=dict, init=False)

    def rewrite(self, link: ET.Element, drawn: Sequence[ET.Element]) -> None:
        """Rewrite the collision shapes of a link.

        Args:
            link: the ``link`` element.
            drawn: its visuals as the URDF gave them: they take the place of collision meshes that cannot be read.
        """
        self._drawn.append((link, list(drawn)))
        if self.kind == "none":
            return
        failed = []
        for where, element in shapes_of(link, "collision"):
            try:
                self._rewrite(link, element, where, self.report)
            except UnreadableMesh as problem:
                failed.append((where, element, f"{mesh_name(mesh_of(element))} {problem}"))
        if failed:
            self._fall_back(link, drawn, failed)

    def finish(self, robot: ET.Element) -> None:
        """Make collision shapes of the visuals of a robot that has no others, or drop all if none are wanted."""
        count = len(robot.findall("link/collision"))
        if self.kind == "none":
            drop_collision(robot)
            if count:
                self.report.add("dropped", "", f"{count} collision shapes: none were asked for; nothing is touched")
        elif not count:
            made = sum(self._of_visuals(link, drawn) for link, drawn in self._drawn)
            if made:
                self.report.add("defaulted", "", f"no link has a collision shape; {made} are made of the visuals")

    def _fall_back(
        self, link: ET.Element, drawn: Sequence[ET.Element], failed: list[tuple[str, ET.Element, str]]
    ) -> None:
        """Put the shapes that a link shows in the place of the meshes that it should collide with."""
        for where, element, problem in failed[1:]:
            drop(link, element, where, problem, self.report)
        where, element, problem = failed[0]
        made = self._of_visuals(link, drawn)
        if made:
            link.remove(element)
            self.report.add("repaired", where, f"{problem}; the shape of the link's visuals is taken")
        else:
            drop(link, element, where, problem, self.report)

    def _of_visuals(self, link: ET.Element, drawn: Sequence[ET.Element]) -> int:
        """Add a collision shape for each visual of a link that can be read; return how many."""
        quiet, made = ImportReport(self.report.source), 0
        for visual in drawn:
            collision = ET.SubElement(link, "collision")
            collision.extend(deepcopy(child) for child in visual if child.tag in ("origin", "geometry"))
            try:
                self._rewrite(link, collision, "", quiet)
                made += 1
            except UnreadableMesh:
                link.remove(collision)
        return made

    def _rewrite(self, link: ET.Element, element: ET.Element, where: str, report: ImportReport) -> None:
        """Rewrite a collision shape if it is a mesh.

        Raises:
            UnreadableMesh: it can't be had.
        """
        mesh = mesh_of(element)
        if mesh is None:
            return
        uri, scale = mesh.get("filename", ""), scale_of(mesh, where, report)
        if self.kind == "box":
            loaded = self.library.load(uri, scale)
            become, change = _box(element, loaded)
        else:
            loaded, become, change = self._hull(link, uri, scale)
            shape = ET.Element("mesh", filename=become)
            ET.SubElement(shape, f"{DRAKE}declare_convex")  # then Drake can press it into others, not just touch points
            set_shape(element, shape)
        tell_mesh(report, where, mesh, loaded, [become], [self.library.places.find(uri).note, change])

    def _hull(self, link: ET.Element, uri: str, scale: Scale) -> tuple[Mesh, str, str]:
        """Return a mesh, the file of its hull, and what was done, in words; what several links share is made once."""
        key = self.library.path_of(uri), scale
        if key in self._hulls:
            self.names.next(link, "collision")  # names count the shapes, whether they are shared or not
            return self._hulls[key]
        loaded = self.library.load(uri, scale)
        if len(loaded.parts) == 1 and is_hull(loaded.parts[0]):
            part, original, change = replace(loaded.parts[0], image=None), loaded.original, ""
        else:
            hull = hull_of(points_of(loaded.parts))
            part, original = hull.part, None
            change = f"its convex hull of {len(part.faces)} faces, {hull.gap * 1e3:.2g} mm inside at most"
            change += f", made {hull.thickened * 1e3:.2g} mm thick" if hull.thickened else ""
        stem = self.names.next(link, "collision")  # only now that nothing can fail: the next import counts the same
        name = self.writer.write(part, role="collision", stem=stem, original=original)
        self._hulls[key] = loaded.remembered(), name, change
        return loaded, name, change


def _box(element: ET.Element, loaded: Mesh) -> tuple[str, str]:
    """Give a collision element the tightest box around its mesh; return what it is, in words."""
    size, pose, thickened = box_of(points_of(loaded.parts))
    text = " ".join(repr(value) for value in size.tolist())
    set_shape(element, ET.Element("box", size=text))
    place(element, pose_of(element) @ pose)
    return "a box", f"{text} m large" + (f", made {thickened * 1e3:.2g} mm thick" if thickened else "")
