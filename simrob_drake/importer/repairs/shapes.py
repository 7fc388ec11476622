"""Rewrite the shapes of a robot so that a simulator takes them: primitives checked, meshes as OBJ files.

Colours are as in RViz: a mesh that brings its own keeps them, and the URDF's material colours the others. Every colour
of a mesh becomes a ``<visual>`` of its own; a texture stays with its mesh.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import box_of, hull_of, is_hull
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary, MeshWriter, Scale
from simrob_drake.importer.meshes.parts import MeshPart, Rgba, plain, points_of
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.packages import OutsideBorder
from simrob_drake.importer.repairs.names import free_name
from simrob_drake.importer.repairs.shape_elements import (
    PLAIN,
    ShapeNames,
    check_geometry,
    drop,
    mesh_name,
    mesh_of,
    report_mesh,
    scale_of,
    set_shape,
    shapes_of,
)
from simrob_drake.robots.urdf import DRAKE, add_colour, drop_collision, name_of, place, pose_of, text


def import_shapes(
    robot: ET.Element, *, source: Path, folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Rewrite every ``<visual>`` and ``<collision>`` of a robot, in place, and write its meshes.

    Args:
        robot: the ``robot`` element with unique names and origins that are numbers.
        source: the URDF, an absolute path; relative mesh names start at its folder.
        folder: where ``meshes/`` is written; None writes nothing.
        options: where meshes may lie, and what collisions become.
        report: takes a note of everything that is done.

    Raises:
        InvalidModel: a mesh, or a file that it names, lies outside of the folders that may be read.
    """
    library = MeshLibrary(MeshPlaces(source, options.mesh_path))
    writer, names = MeshWriter(folder), ShapeNames(robot)
    visuals = Visuals(library, writer, names, report)
    collisions = Collisions(library, writer, names, report, options.collision)
    for link in robot.iterfind("link"):
        _check_shapes(link, report)
        drawn = [deepcopy(element) for element in link.iterfind("visual")]
        try:
            visuals.rewrite(link)
            collisions.rewrite(link, drawn)
        except OutsideBorder as problem:
            raise report.refusal(f"link '{name_of(link)}'", str(problem)) from problem
    collisions.finish(robot)


def _check_shapes(link: ET.Element, report: ImportReport) -> None:
    """Drop what is no shape."""
    for tag in ("visual", "collision"):
        for where, element in shapes_of(link, tag):
            problem = check_geometry(element, where, report)
            if problem:
                drop(link, element, where, problem, report)


@dataclass(frozen=True)
class _Drawn:
    """A file of a mesh, with the look that the mesh itself gives it."""

    name: str
    rgba: Rgba | None
    textured: bool


@dataclass
class Visuals:
    """Rewrites the visuals of one robot, link by link."""

    library: MeshLibrary
    writer: MeshWriter
    names: ShapeNames
    report: ImportReport
    _done: dict[tuple[Path, Scale, bool], tuple[Mesh, list[_Drawn]]] = field(default_factory=dict, init=False)

    def rewrite(self, link: ET.Element) -> None:
        """Rewrite the visuals of a link that are meshes; drop those that cannot be read."""
        for where, element in shapes_of(link, "visual"):
            mesh = mesh_of(element)
            if mesh is None:
                continue
            try:
                self._rewrite_mesh(link, element, mesh, where)
            except UnreadableMesh as problem:
                drop(link, element, where, f"{mesh_name(mesh)} {problem}", self.report)

    def _rewrite_mesh(self, link: ET.Element, element: ET.Element, mesh: ET.Element, where: str) -> None:
        uri, scale = mesh.get("filename", ""), scale_of(mesh, where, self.report)
        loaded, drawn = self._written(link, uri, scale, PLAIN in mesh.attrib)
        note = self.library.places.find(uri).note
        report_mesh(self.report, where, mesh, loaded, [file.name for file in drawn], [note, *_colours(element, drawn)])
        place = list(link).index(element)
        link.remove(element)
        for index, file in enumerate(drawn):
            link.insert(place + index, self._element(link, element, file))

    def _written(self, link: ET.Element, uri: str, scale: Scale, bare: bool) -> tuple[Mesh, list[_Drawn]]:
        """Return what a mesh has become; a mesh that several links show is written once, named by the first."""
        key = self.library.path_of(uri), scale, bare
        if key in self._done:
            for _ in self._done[key][1]:
                self.names.next(link, "visual")  # names count what is shown, whether it is shared or not
            return self._done[key]
        loaded = self.library.load(uri, scale)
        drawn = [self._file(link, loaded, part) for part in ([plain(loaded.parts)] if bare else loaded.parts)]
        self._done[key] = loaded.remembered(), drawn
        return loaded, drawn

    def _file(self, link: ET.Element, loaded: Mesh, part: MeshPart) -> _Drawn:
        name = self.writer.write(part, role="visual", stem=self.names.next(link, "visual"), original=loaded.original)
        return _Drawn(name, part.rgba, part.image is not None)

    def _element(self, link: ET.Element, element: ET.Element, file: _Drawn) -> ET.Element:
        """Return the visual of one file of a mesh; where the mesh gives it no look the URDF's material stays."""
        visual = deepcopy(element)
        if name_of(visual):
            visual.set("name", free_name(name_of(visual), map(name_of, link.iterfind("visual"))))
        set_shape(visual, ET.Element("mesh", filename=file.name))
        if file.rgba or file.textured:
            for material in visual.findall("material"):
                visual.remove(material)
        if file.rgba:
            add_colour(visual, self.names.material(Path(file.name).stem), file.rgba)
        return visual


def _colours(element: ET.Element, drawn: list[_Drawn]) -> list[str]:
    """Say which colours are shown where the mesh brings its own."""
    own = [file for file in drawn if file.rgba or file.textured]
    notes = [f"{len(drawn)} colours, a <visual> for each"] if len(drawn) > 1 else []
    notes += ["its own colour is kept"] if len(drawn) == 1 and drawn[0].rgba else []
    if own and element.find("material") is not None:
        notes.append("the URDF's material gives way to its own look, as in RViz")
    return notes


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
        report_mesh(report, where, mesh, loaded, [become], [self.library.places.find(uri).note, change])

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
    set_shape(element, ET.Element("box", size=text(size)))
    place(element, pose_of(element) @ pose)
    return "a box", f"{text(size)} m large" + (f", made {thickened * 1e3:.2g} mm thick" if thickened else "")
