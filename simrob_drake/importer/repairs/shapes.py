"""Rewrite the shapes of a robot so that a simulator takes them: primitives checked, meshes as OBJ files.

Colours are as in RViz: a mesh that brings its own keeps them, and the URDF's material colours the others. Every colour
of a mesh becomes a ``<visual>`` of its own; a texture stays with its mesh.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path, PurePath

from simrob_drake.base.errors import shorten
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.packages import OutsideBorder
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import box_of, hull_of, is_hull
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary, MeshWriter, Scale
from simrob_drake.importer.meshes.parts import MeshPart, Rgba, combine_without_look, points_of
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.repairs.names import FreeNames, free_name
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    add_colour,
    drop_collision,
    format_numbers,
    name_of,
    place,
    pose_of,
)
from simrob_drake.robots.urdf_check import SHAPE_SIZES, numbers_in, shape_defect

PLAIN = "simrob_plain"
"""Attribute of a mesh whose own colours and textures are not shown; that of a visual's material is."""
_UNSCALED = 1.0, 1.0, 1.0
_Drawn = tuple[str, Rgba | None, bool]
"""A file of a mesh, the colour that the mesh itself gives it, and whether it has a texture."""


def import_shapes(
    robot: ET.Element,
    *,
    source: Path,
    folder: Path | None,
    options: ImportOptions,
    report: ImportReport,
) -> None:
    """Rewrite every ``<visual>`` and ``<collision>`` of a robot, in place, and write its meshes.

    The robot has unique names, and origins that are numbers; relative names of meshes start at the folder of
    ``source``; ``folder`` takes ``meshes/``, None nothing. Raises InvalidModel: a mesh lies outside of what may be
    read.
    """
    shapes = _Shapes(
        robot,
        MeshLibrary(MeshPlaces(source, options.mesh_path, options.package_folders)),
        MeshWriter(folder),
        options,
        report,
    )
    for link in robot.iterfind("link"):
        for tag in ("visual", "collision"):
            for where, element in _shapes_of(link, tag):
                problem = _check_geometry(element, where, report)
                if problem:
                    _drop(link, element, where, problem, report)
        drawn = [deepcopy(element) for element in link.iterfind("visual")]
        try:
            shapes.rewrite_visuals(link)
            shapes.rewrite_collisions(link, drawn)
        except OutsideBorder as problem:
            raise report.refusal(
                message("robots.link_called", "link '{link}'", link=name_of(link)), str(problem)
            ) from problem
    shapes.finish()


class _Shapes:
    """Rewrites the shapes of one robot, link by link; what several links show or touch with is written once.

    Files and materials are named after links, never after a file.
    """

    def __init__(
        self,
        robot: ET.Element,
        library: MeshLibrary,
        writer: MeshWriter,
        options: ImportOptions,
        report: ImportReport,
    ) -> None:
        self._robot, self._library, self._writer, self._report = robot, library, writer, report
        self._kind = options.collision
        self._stems, self._free, self._counts = (
            dict[str, str](),
            FreeNames(),
            Counter[tuple[str, str]](),
        )
        self._materials = FreeNames(name_of(element) for element in robot.iter("material"))
        self._shown = dict[tuple[Path, Scale, bool], tuple[Mesh, list[_Drawn]]]()
        self._hulls = dict[tuple[Path, Scale], tuple[Mesh, str, str]]()
        self._drawn: list[tuple[ET.Element, Sequence[ET.Element]]] = []

    def _next(self, link: ET.Element, role: str) -> str:
        """Return the name of a link's next mesh in a role, as in ``upper_arm_visual_1``, shared or not."""
        name = name_of(link)
        if name not in self._stems:
            clean = re.sub(r"[^A-Za-z0-9_]", "_", name)[:80] or "link"
            free = self._free.take(clean.lower())  # some disks do not tell A from a
            self._stems[name] = clean + free[len(clean) :]
        self._counts[name, role] += 1
        return f"{self._stems[name]}_{role}_{self._counts[name, role]}"

    def rewrite_visuals(self, link: ET.Element) -> None:
        """Rewrite the visuals of a link that are meshes; drop those that cannot be read."""
        for where, element in _shapes_of(link, "visual"):
            mesh = element.find("geometry/mesh")
            if mesh is not None:
                try:
                    self._rewrite_visual(link, element, mesh, where)
                except UnreadableMesh as problem:
                    _drop(
                        link,
                        element,
                        where,
                        compound("{mesh} {problem}", mesh=_mesh_name(mesh), problem=problem),
                        self._report,
                    )

    def _rewrite_visual(
        self, link: ET.Element, element: ET.Element, mesh: ET.Element, where: str
    ) -> None:
        uri, scale, bare = (
            mesh.get("filename", ""),
            _scale_of(mesh, where, self._report),
            PLAIN in mesh.attrib,
        )
        key = self._library.path_of(uri), scale, bare
        if key in self._shown:
            loaded, drawn = self._shown[key]
            for _ in drawn:
                self._next(link, "visual")
        else:
            loaded = self._library.load(uri, scale)
            drawn = [
                self._file(link, loaded, part)
                for part in ([combine_without_look(loaded.parts)] if bare else loaded.parts)
            ]
            self._shown[key] = loaded.without_content(), drawn
        note = self._library.places.find(uri).note
        notes = (
            [
                message(
                    "importer.visual_for_each_colour",
                    "{count} colours, a <visual> for each",
                    count=len(drawn),
                )
            ]
            if len(drawn) > 1
            else []
        )
        notes += (
            [message("importer.own_colour_kept", "its own colour is kept")]
            if len(drawn) == 1 and drawn[0][1]
            else []
        )
        if (
            any(rgba or textured for _, rgba, textured in drawn)
            and element.find("material") is not None
        ):
            notes.append(
                message(
                    "importer.own_look", "the URDF's material gives way to its own look, as in RViz"
                )
            )
        _report_mesh(
            self._report, where, mesh, loaded, [name for name, _, _ in drawn], [note, *notes]
        )
        index = list(link).index(element)
        link.remove(element)
        for number, file in enumerate(drawn):
            link.insert(index + number, self._visual(link, element, file))

    def _file(self, link: ET.Element, loaded: Mesh, part: MeshPart) -> _Drawn:
        name = self._writer.write(
            part, role="visual", stem=self._next(link, "visual"), original=loaded.original
        )
        return name, part.rgba, part.image is not None

    def _visual(self, link: ET.Element, element: ET.Element, file: _Drawn) -> ET.Element:
        """Return the visual of one file of a mesh; where the mesh gives it no look the URDF's material stays."""
        visual, (name, rgba, textured) = deepcopy(element), file
        if name_of(visual):
            visual.set("name", free_name(name_of(visual), map(name_of, link.iterfind("visual"))))
        _set_shape(visual, ET.Element("mesh", filename=name))
        for material in visual.findall("material") if rgba or textured else ():
            visual.remove(material)
        if rgba:
            add_colour(visual, self._materials.take(Path(name).stem), rgba)
        return visual

    def rewrite_collisions(self, link: ET.Element, drawn: Sequence[ET.Element]) -> None:
        """Rewrite the collision shapes of a link.

        ``drawn`` are its visuals as the URDF gave them: they take the place of collision meshes that cannot be read.
        """
        self._drawn.append((link, drawn))
        failed = []
        for where, element in _shapes_of(link, "collision") if self._kind != "none" else ():
            try:
                self._rewrite_collision(link, element, where, self._report)
            except UnreadableMesh as problem:
                failed.append(
                    (
                        where,
                        element,
                        compound(
                            "{mesh} {problem}",
                            mesh=_mesh_name(element.find("geometry/mesh")),
                            problem=problem,
                        ),
                    )
                )
        for where, element, why in failed[1:]:
            _drop(link, element, where, why, self._report)
        for where, element, why in failed[:1]:
            if self._touch_by_visuals(link, drawn):
                link.remove(element)
                self._report.add(
                    "repaired",
                    where,
                    message(
                        "importer.shape_of_visuals",
                        "{why}; the shape of the link's visuals is taken",
                        why=why,
                    ),
                )
            else:
                _drop(link, element, where, why, self._report)

    def finish(self) -> None:
        """Make collision shapes of the visuals of a robot that has no others, or drop all if none are wanted."""
        count = len(self._robot.findall("link/collision"))
        if self._kind == "none":
            drop_collision(self._robot)
            if count:
                self._report.add(
                    "dropped",
                    "",
                    message(
                        "importer.no_collision_asked",
                        "{count} collision shapes: none were asked for; nothing is touched",
                        count=count,
                    ),
                )
        elif not count and (
            made := sum(self._touch_by_visuals(link, drawn) for link, drawn in self._drawn)
        ):
            self._report.add(
                "defaulted",
                "",
                message(
                    "importer.collision_of_visuals",
                    "no link has a collision shape; {made} are made of the visuals",
                    made=made,
                ),
            )

    def _touch_by_visuals(self, link: ET.Element, drawn: Sequence[ET.Element]) -> int:
        """Add a collision shape for each visual of a link that can be read; return how many."""
        quiet, made = ImportReport(self._report.source), 0
        for visual in drawn:
            collision = ET.SubElement(link, "collision")
            collision.extend(
                deepcopy(child) for child in visual if child.tag in ("origin", "geometry")
            )
            try:
                self._rewrite_collision(link, collision, "", quiet)
                made += 1
            except UnreadableMesh:
                link.remove(collision)
        return made

    def _rewrite_collision(
        self, link: ET.Element, element: ET.Element, where: str, report: ImportReport
    ) -> None:
        """Rewrite a collision shape if it is a mesh; raises UnreadableMesh: it can't be had."""
        mesh = element.find("geometry/mesh")
        if mesh is None:
            return
        uri, scale = mesh.get("filename", ""), _scale_of(mesh, where, report)
        if self._kind == "box":
            loaded = self._library.load(uri, scale)
            become, change = _box(element, loaded)
        else:
            loaded, become, change = self._hull(link, uri, scale)
            shape = ET.Element("mesh", filename=become)
            # then Drake can press it into others, not just touch points
            ET.SubElement(shape, f"{DRAKE}declare_convex")
            _set_shape(element, shape)
        _report_mesh(
            report, where, mesh, loaded, [become], [self._library.places.find(uri).note, change]
        )

    def _hull(self, link: ET.Element, uri: str, scale: Scale) -> tuple[Mesh, str, str]:
        """Return a mesh, the file of its hull, and what was done, in words."""
        key = self._library.path_of(uri), scale
        if key in self._hulls:
            self._next(link, "collision")
            return self._hulls[key]
        loaded = self._library.load(uri, scale)
        if len(loaded.parts) == 1 and is_hull(loaded.parts[0]):
            part, original, change = replace(loaded.parts[0], image=None), loaded.original, ""
        else:
            hull = hull_of(points_of(loaded.parts))
            part, original = hull.part, None
            change = message(
                "importer.convex_hull_of",
                "its convex hull of {faces} faces, {gap:.2g} mm inside at most",
                faces=len(part.faces),
                gap=hull.gap * 1e3,
            )
            change += (
                message(
                    "importer.made_thick",
                    ", made {thickness:.2g} mm thick",
                    thickness=hull.thickened * 1e3,
                )
                if hull.thickened
                else ""
            )
        # only now that nothing can fail: the next import counts the same
        stem = self._next(link, "collision")
        name = self._writer.write(part, role="collision", stem=stem, original=original)
        self._hulls[key] = loaded.without_content(), name, change
        return loaded, name, change


def _check_geometry(element: ET.Element, where: str, report: ImportReport) -> str:
    """Leave one shape in a ``<visual>`` or ``<collision>``; return what is wrong if it has none that can be used."""
    geometry = element.find("geometry")
    if geometry is None:
        return message("importer.without_geometry", "has no <geometry>")
    shapes = [child for child in geometry if child.tag in SHAPE_SIZES or child.tag == "mesh"]
    if not shapes:
        tags = ", ".join(f"<{child.tag.rpartition('}')[2]}>" for child in geometry)
        return (
            message("importer.no_known_shape", "{tags} is no shape that is known", tags=tags)
            if tags
            else message("importer.empty_geometry", "its <geometry> is empty")
        )
    for child in [child for child in geometry if child is not shapes[0]]:
        geometry.remove(child)
        report.add(
            "dropped",
            where,
            message(
                "importer.one_shape_each",
                "<{tag}>: a <geometry> holds one shape; <{kept}> stays",
                tag=child.tag,
                kept=shapes[0].tag,
            ),
        )
    defect = "" if shapes[0].tag == "mesh" else shape_defect(shapes[0])
    return (
        compound("<{shape}> {defect}", shape=shapes[0].tag.rpartition("}")[2], defect=defect)
        if defect
        else ""
    )


def _box(element: ET.Element, loaded: Mesh) -> tuple[str, str]:
    """Give a collision element the tightest box around its mesh; return what it is, in words."""
    size, pose, thickened = box_of(points_of(loaded.parts))
    _set_shape(element, ET.Element("box", size=format_numbers(size)))
    place(element, pose_of(element) @ pose)
    return message("importer.a_box", "a box"), message(
        "importer.size_of_box", "{size} m large", size=format_numbers(size)
    ) + (
        message("importer.made_thick", ", made {thickness:.2g} mm thick", thickness=thickened * 1e3)
        if thickened
        else ""
    )


def _drop(
    link: ET.Element, element: ET.Element, where: str, problem: str, report: ImportReport
) -> None:
    link.remove(element)
    if element.tag == "visual":
        effect = message("importer.not_shown", "it is not shown")
    elif link.find("collision") is None:
        effect = message("importer.touches_nothing_with_it", "the link touches nothing with it")
    else:
        effect = message("importer.other_shapes_stay", "the link's other collision shapes stay")
    report.add("dropped", where, compound("{problem}; {effect}", problem=problem, effect=effect))


def _shapes_of(link: ET.Element, tag: str) -> list[tuple[str, ET.Element]]:
    """Return the shapes of a link, each with the words that a message names it by."""
    elements, name = (
        link.findall(tag),
        message("robots.tag_of_link", "link '{link}' <{tag}>", link=name_of(link), tag=tag),
    )
    if len(elements) == 1:
        return [(name, elements[0])]
    return [
        (compound("{name} {number}", name=name, number=number), element)
        for number, element in enumerate(elements, start=1)
    ]


def _set_shape(element: ET.Element, shape: ET.Element) -> None:
    for geometry in element.iterfind("geometry"):
        geometry[:] = [shape]


def _mesh_name(mesh: ET.Element | None) -> str:
    return message(
        "robots.mesh_called",
        "mesh '{uri}'",
        uri=shorten("" if mesh is None else mesh.get("filename", "")),
    )


def _report_mesh(
    report: ImportReport,
    where: str,
    mesh: ET.Element,
    loaded: Mesh,
    become: list[str],
    changes: list[str],
) -> None:
    """Note what a mesh has become: ``read`` if nothing but its name is new."""
    scale = mesh.get("scale")
    notes = [
        *loaded.changes,
        *filter(None, changes),
        *(
            [message("importer.scaled_by", "scaled by {scale}", scale=scale)]
            if scale is not None
            else []
        ),
    ]
    faces = message(
        "importer.mesh_with_faces",
        "mesh '{name}' ({faces} faces)",
        name=PurePath(mesh.get("filename", "")).name,
        faces=loaded.faces,
    )
    files = (
        become[0]
        if len(become) == 1
        else message(
            "importer.first_to_last",
            "{first} to {last}",
            first=become[0],
            last=Path(become[-1]).name,
        )
    )
    if loaded.original is not None and not notes:
        report.add(
            "read",
            where,
            message(
                "importer.is_as_it_was", "{mesh} is {files} as it was", mesh=faces, files=files
            ),
        )
    else:
        report.add(
            "repaired",
            where,
            join_texts(
                [
                    message("importer.is_now", "{mesh} is now {files}", mesh=faces, files=files),
                    *notes,
                ],
                "; ",
            ),
        )
    for remark in loaded.remarks:
        report.add("read", where, compound("{mesh} {remark}", mesh=_mesh_name(mesh), remark=remark))


def _scale_of(mesh: ET.Element, where: str, report: ImportReport) -> Scale:
    """Return a mesh's scale; one that is none counts as 1, which is told."""
    text = mesh.get("scale")
    if text is None:
        return _UNSCALED
    numbers = numbers_in(text) or numbers_in(text.replace(",", " ")) or []
    numbers = numbers * 3 if len(numbers) == 1 else numbers
    if len(numbers) != 3 or not all(1e-12 < abs(number) < 1e12 for number in numbers):
        report.add(
            "repaired",
            where,
            message(
                "importer.no_scale", 'scale="{text}" is no scale; 1 is taken', text=shorten(text)
            ),
        )
        return _UNSCALED
    return numbers[0], numbers[1], numbers[2]
