"""Rewrite the shapes of a robot so that a simulator accepts them: primitives are checked, meshes become OBJ files.

Colours are as in RViz: a mesh with colours of its own keeps them, and the URDF's material colours the other meshes.
Each colour of a mesh becomes a ``<visual>`` of its own. A texture stays with its mesh.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path, PurePath
from typing import NamedTuple

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
"""Attribute of a mesh whose own colours and textures are not displayed: the material of the visual colours it."""

_UNSCALED = (1.0, 1.0, 1.0)
"""Scale of a mesh whose element gives none, along x, y and z."""

_LEAST_SCALE = 1e-12
"""Smaller absolute scales would make a mesh a point. They are errors of the file."""

_LARGEST_SCALE = 1e12
"""Larger absolute scales are errors of the file."""

_LONGEST_STEM = 80
"""Largest count of characters that a file name takes from a link's name. File systems allow about 255 in all."""


class _VisualFile(NamedTuple):
    """File of a part of a mesh that is displayed.

    Attributes:
        name: path of the file, relative to the folder of the import.
        rgba: colour that the mesh itself gives this part, or None if it gives none.
        has_texture: whether the mesh gives this part a texture.
    """

    name: str
    rgba: Rgba | None
    has_texture: bool

    @property
    def has_look(self) -> bool:
        """Whether the mesh itself gives this part a colour or a texture."""
        return self.rgba is not None or self.has_texture


class _VisualMesh(NamedTuple):
    """A mesh that is displayed, and its files, one for each colour or texture."""

    mesh: Mesh
    files: list[_VisualFile]


class _CollisionMesh(NamedTuple):
    """A mesh that collides.

    Attributes:
        mesh: the mesh.
        file: path of the file with its convex hull, relative to the folder of the import.
        change: what was done to the mesh, in words; empty if it is a hull already.
    """

    mesh: Mesh
    file: str
    change: str


class _CollisionBox(NamedTuple):
    """A box in place of a mesh: its name, and its size and thickness, in words."""

    name: str
    change: str


class _LabelledShape(NamedTuple):
    """A ``<visual>`` or ``<collision>``, and its place in words, such as "link 'arm' <visual> 2"."""

    where: str
    element: ET.Element


class _UnreadableShape(NamedTuple):
    """A collision shape whose mesh cannot be read, its place in words, and the reason."""

    where: str
    element: ET.Element
    reason: str


class _LinkVisuals(NamedTuple):
    """A link, and copies of its visuals as the URDF gave them."""

    link: ET.Element
    visuals: Sequence[ET.Element]


def import_shapes(
    robot: ET.Element,
    *,
    source: Path,
    folder: Path | None,
    options: ImportOptions,
    report: ImportReport,
) -> None:
    """Rewrite every ``<visual>`` and ``<collision>`` of a robot, in place, and write its meshes.

    Args:
        robot: the ``robot`` element. Its names are unique, and the numbers of its origins are repaired.
        source: file of the robot. Relative names of meshes start at its folder.
        folder: folder of the import, in which ``meshes/`` is written. If it is None, nothing is written.
        options: options of the import.
        report: report of the import.

    Raises:
        InvalidModel: a mesh is outside of the folders from which files may be read.
    """
    places = MeshPlaces(source, options.mesh_path, options.package_folders)
    shapes = _Shapes(robot, MeshLibrary(places), MeshWriter(folder), options, report)
    for link in robot.iterfind("link"):
        for tag in ("visual", "collision"):
            for where, element in _shapes_of(link, tag):
                # Elements without a usable shape are removed first, so that the following steps find one in each.
                problem = _check_geometry(element, where, report)
                if problem:
                    _drop(link, element, where, problem, report)
        # Copied before they are rewritten: collision shapes are made from the visuals of the URDF, in which a mesh is
        # whole, and not from the files of its single colours.
        visuals = [deepcopy(element) for element in link.iterfind("visual")]
        try:
            shapes.rewrite_visuals(link)
            shapes.rewrite_collisions(link, visuals)
        except OutsideBorder as problem:
            # Unlike a missing mesh, this is an error: the user can allow the folder.
            raise report.refusal(
                message("robots.link_called", "link '{link}'", link=name_of(link)), str(problem)
            ) from problem
    shapes.finish()


class _Shapes:
    """Rewrites the shapes of one robot, link by link. A mesh that several links use is written once.

    Files and materials have the names of links. Files of the source may have equal names in different folders.
    """

    def __init__(
        self,
        robot: ET.Element,
        library: MeshLibrary,
        writer: MeshWriter,
        options: ImportOptions,
        report: ImportReport,
    ) -> None:
        """Prepare the rewriting of a robot's shapes, without a change of the robot.

        Args:
            robot: the ``robot`` element.
            library: reads the meshes.
            writer: writes the meshes of the import.
            options: options of the import.
            report: report of the import.
        """
        self._robot = robot
        self._library = library
        self._writer = writer
        self._report = report
        self._collision = options.collision

        # Names of files: their beginnings by the name of the link, and how many there are for each link and role.
        self._stems = dict[str, str]()
        self._free_stems = FreeNames()
        self._counts = Counter[tuple[str, str]]()
        self._free_materials = FreeNames(name_of(element) for element in robot.iter("material"))

        # Meshes that are written already. The visuals' keys contain whether the mesh is PLAIN.
        self._visual_meshes = dict[tuple[Path, Scale, bool], _VisualMesh]()
        self._collision_meshes = dict[tuple[Path, Scale], _CollisionMesh]()
        self._visuals_of_links = list[_LinkVisuals]()

    def _next_stem(self, link: ET.Element, role: str) -> str:
        """Make the name of a link's next mesh file, without extension, such as ``upper_arm_visual_1``.

        Args:
            link: the link.
            role: ``visual`` or ``collision``.
        """
        name = name_of(link)
        if name not in self._stems:
            # Other characters are not allowed in names of files everywhere, and a slash would lead into another folder.
            clean = re.sub(r"[^A-Za-z0-9_]", "_", name)[:_LONGEST_STEM] or "link"
            # Some disks do not distinguish A from a, so the names must differ in lower case. What `take` appends to a
            # name that is taken, such as _2, is appended to the name with its own capital letters.
            free = self._free_stems.take(clean.lower())
            self._stems[name] = clean + free[len(clean) :]
        self._counts[name, role] += 1
        return f"{self._stems[name]}_{role}_{self._counts[name, role]}"

    def rewrite_visuals(self, link: ET.Element) -> None:
        """Rewrite the visuals of a link that are meshes, and remove those that cannot be read."""
        for where, element in _shapes_of(link, "visual"):
            mesh = element.find("geometry/mesh")
            # Primitives, such as boxes, need no change.
            if mesh is None:
                continue
            try:
                self._rewrite_visual(link, element, mesh, where)
            except UnreadableMesh as problem:
                text = compound("{mesh} {problem}", mesh=_mesh_name(mesh), problem=problem)
                _drop(link, element, where, text, self._report)

    def _rewrite_visual(
        self, link: ET.Element, element: ET.Element, mesh: ET.Element, where: str
    ) -> None:
        """Replace a visual by one for each colour or texture of its mesh, in place.

        Args:
            link: the link.
            element: its ``<visual>``.
            mesh: the ``<mesh>`` in the visual.
            where: place of the visual in words, for the report.

        Raises:
            UnreadableMesh: the mesh cannot be read.
        """
        uri = mesh.get("filename", "")
        scale = _scale_of(mesh, where, self._report)
        loaded, files = self._visual_mesh(link, uri, scale, is_plain=PLAIN in mesh.attrib)
        # The note is empty unless the file was found under another name or in another folder.
        changes = [self._library.places.find(uri).note]
        if len(files) > 1:
            changes.append(
                message(
                    "importer.visual_for_each_colour",
                    "divided into {count} visuals, one for each colour or texture",
                    count=len(files),
                )
            )
        elif files[0].rgba:
            changes.append(message("importer.own_colour_kept", "its own colour is kept"))
        has_look = any(file.has_look for file in files)
        if has_look and element.find("material") is not None:
            changes.append(
                message(
                    "importer.own_look", "its own colours replace the URDF's material, as in RViz"
                )
            )
        _report_mesh(self._report, where, mesh, loaded, [file.name for file in files], changes)

        # The new visuals take the position of the old one, so that the order of the link's visuals stays.
        index = list(link).index(element)
        link.remove(element)
        for number, file in enumerate(files):
            link.insert(index + number, self._visual(link, element, file))

    def _visual_mesh(
        self, link: ET.Element, uri: str, scale: Scale, *, is_plain: bool
    ) -> _VisualMesh:
        """Read a mesh for a visual and write its files, unless an equal visual was written before.

        Args:
            link: the link, whose name the files get.
            uri: name of the mesh in the URDF.
            scale: scale of the mesh.
            is_plain: whether the mesh's own colours and textures are not displayed.

        Raises:
            UnreadableMesh: the mesh cannot be read.
        """
        key = (self._library.path_of(uri), scale, is_plain)
        if key in self._visual_meshes:
            visual = self._visual_meshes[key]
            # The numbers of the files are used up: a file has the same name whether or not an earlier one is shared.
            for _ in visual.files:
                self._next_stem(link, "visual")
            return visual
        loaded = self._library.load(uri, scale)
        parts = [combine_without_look(loaded.parts)] if is_plain else loaded.parts
        files = [self._write_visual(link, loaded, part) for part in parts]
        # Kept without triangles: a robot with hundreds of meshes would fill the memory.
        self._visual_meshes[key] = _VisualMesh(loaded.without_content(), files)
        return _VisualMesh(loaded, files)

    def _write_visual(self, link: ET.Element, loaded: Mesh, part: MeshPart) -> _VisualFile:
        """Write the file of a part of a mesh that is displayed."""
        stem = self._next_stem(link, "visual")
        name = self._writer.write(part, role="visual", stem=stem, original=loaded.original)
        return _VisualFile(name, part.rgba, has_texture=part.image is not None)

    def _visual(self, link: ET.Element, element: ET.Element, file: _VisualFile) -> ET.Element:
        """Make the visual for one file of a mesh.

        The URDF's material stays if the mesh gives the file neither a colour nor a texture.

        Args:
            link: the link, which has the visuals for the other files already.
            element: the ``<visual>`` of the URDF.
            file: the file.
        """
        visual = deepcopy(element)
        # The visuals of one mesh cannot all have the name of the old visual.
        if name_of(visual):
            visuals = link.iterfind("visual")
            visual.set("name", free_name(name_of(visual), map(name_of, visuals)))
        _set_shape(visual, ET.Element("mesh", filename=file.name))
        if file.has_look:
            for material in visual.findall("material"):
                visual.remove(material)
        # As the other visuals of the mesh may have other colours, the new material has the name of the file.
        if file.rgba:
            material_name = self._free_materials.take(Path(file.name).stem)
            add_colour(visual, material_name, file.rgba)
        return visual

    def rewrite_collisions(self, link: ET.Element, visuals: Sequence[ET.Element]) -> None:
        """Rewrite the collision shapes of a link.

        Args:
            link: the link.
            visuals: its visuals as the URDF gave them. They replace collision meshes that cannot be read.
        """
        # Kept for `finish`, which makes collision shapes from the visuals if no link has any.
        self._visuals_of_links.append(_LinkVisuals(link, visuals))
        if self._collision == "none":
            # All collision shapes are removed at the end, so their meshes need not be read.
            return
        # All shapes are tried before one is replaced: what replaces them depends on whether it is the first.
        unreadable = []
        for where, element in _shapes_of(link, "collision"):
            try:
                self._rewrite_collision(link, element, where, self._report)
            except UnreadableMesh as problem:
                mesh_name = _mesh_name(element.find("geometry/mesh"))
                reason = compound("{mesh} {problem}", mesh=mesh_name, problem=problem)
                unreadable.append(_UnreadableShape(where, element, reason))
        if not unreadable:
            return
        # All visuals together replace the first unreadable shape. The others are only removed: with the visuals again
        # in their place the link would have the same shape twice.
        first, *others = unreadable
        for shape in others:
            _drop(link, shape.element, shape.where, shape.reason, self._report)
        if self._add_collisions_of_visuals(link, visuals):
            link.remove(first.element)
            self._report.add(
                "repaired",
                first.where,
                message(
                    "importer.shape_of_visuals",
                    "{why}; the link's visuals are used instead",
                    why=first.reason,
                ),
            )
        else:
            _drop(link, first.element, first.where, first.reason, self._report)

    def finish(self) -> None:
        """Remove all collision shapes if the option `collision` is none. Otherwise make some if the robot has none.

        The new shapes are made from the visuals. This step comes after all links: a robot in which only some links have
        collision shapes keeps these, as its author chose what can touch.
        """
        count = len(self._robot.findall("link/collision"))
        if self._collision == "none":
            drop_collision(self._robot)
            if count:
                self._report.add(
                    "dropped",
                    "",
                    message(
                        "importer.no_collision_asked",
                        "{count} collision shapes are left out by `collision: none`; the robot touches nothing",
                        count=count,
                    ),
                )
            return
        if count:
            return
        made = 0
        # Without any collision shape the robot would touch nothing, not even the floor.
        for link, visuals in self._visuals_of_links:
            made += self._add_collisions_of_visuals(link, visuals)
        if made:
            self._report.add(
                "defaulted",
                "",
                message(
                    "importer.collision_of_visuals",
                    "no link has a collision shape; {made} are made from the visuals",
                    made=made,
                ),
            )

    def _add_collisions_of_visuals(self, link: ET.Element, visuals: Sequence[ET.Element]) -> int:
        """Add a collision shape to a link for each of its visuals that can be read. Returns the count of shapes.

        They replace collision meshes that cannot be read, or are the first ones of a robot without collision shapes.

        Args:
            link: the link, changed in place.
            visuals: its visuals as the URDF gave them.
        """
        # The caller reports the shapes in one entry. Those of each mesh would repeat what its visual had.
        unused_report = ImportReport(self._report.source)
        made = 0
        for visual in visuals:
            collision = ET.SubElement(link, "collision")
            children = [child for child in visual if child.tag in ("origin", "geometry")]
            collision.extend(deepcopy(child) for child in children)
            try:
                self._rewrite_collision(link, collision, "", unused_report)
                made += 1
            except UnreadableMesh:
                link.remove(collision)
        return made

    def _rewrite_collision(
        self, link: ET.Element, element: ET.Element, where: str, report: ImportReport
    ) -> None:
        """Replace the mesh of a collision shape by its convex hull, or by a box, in place. Primitives stay.

        Args:
            link: the link, whose name the file of the hull gets.
            element: its ``<collision>``.
            where: place of the collision shape in words, for the report.
            report: report of the import.

        Raises:
            UnreadableMesh: the mesh cannot be read, or is too small for a hull or a box.
        """
        mesh = element.find("geometry/mesh")
        if mesh is None:
            return
        uri = mesh.get("filename", "")
        scale = _scale_of(mesh, where, report)
        if self._collision == "box":
            loaded = self._library.load(uri, scale)
            box = _replace_by_box(element, loaded)
            replacement = box.name
            change = box.change
        else:
            hull = self._collision_mesh(link, uri, scale)
            loaded = hull.mesh
            replacement = hull.file
            change = hull.change
            shape = ET.Element("mesh", filename=hull.file)
            # With this mark Drake reads the mesh as a convex solid, which can also be pressed into other shapes in
            # hydroelastic contact, and does not touch at points only.
            ET.SubElement(shape, f"{DRAKE}declare_convex")
            _set_shape(element, shape)
        changes = [self._library.places.find(uri).note, change]
        _report_mesh(report, where, mesh, loaded, [replacement], changes)

    def _collision_mesh(self, link: ET.Element, uri: str, scale: Scale) -> _CollisionMesh:
        """Compute the convex hull of a mesh and write it, unless this was done before.

        A mesh that is a convex hull already is kept as it is, so that a second import changes nothing.

        Args:
            link: the link, whose name the file gets.
            uri: name of the mesh in the URDF.
            scale: scale of the mesh.

        Raises:
            UnreadableMesh: the mesh cannot be read, or is too small for a hull.
        """
        key = (self._library.path_of(uri), scale)
        if key in self._collision_meshes:
            # The number of the file is used up, as for visuals.
            self._next_stem(link, "collision")
            return self._collision_meshes[key]
        loaded = self._library.load(uri, scale)
        if len(loaded.parts) == 1 and is_hull(loaded.parts[0]):
            # A collision shape is not displayed, so it needs no texture.
            part = replace(loaded.parts[0], image=None)
            original = loaded.original
            change = ""
        else:
            # The parts of a mesh differ in colour only, so they have one hull together.
            hull = hull_of(points_of(loaded.parts))
            part = hull.part
            original = None
            change = message(
                "importer.convex_hull_of",
                "its convex hull of {faces} faces, out of which the mesh protrudes by at most {gap:.2g} mm",
                faces=len(part.faces),
                gap=hull.gap * 1e3,
            )
            change += _thickness_text(hull.thickened)
        # The number is taken only now that nothing can fail. An import of the result, without the shapes that failed,
        # then counts the same.
        stem = self._next_stem(link, "collision")
        name = self._writer.write(part, role="collision", stem=stem, original=original)
        self._collision_meshes[key] = _CollisionMesh(loaded.without_content(), name, change)
        return _CollisionMesh(loaded, name, change)


def _check_geometry(element: ET.Element, where: str, report: ImportReport) -> str:
    """Keep the first shape of a ``<visual>`` or ``<collision>``, and remove further ones, in place.

    Args:
        element: the element.
        where: its place in words, for the report.
        report: report of the import.

    Returns:
        the defect of the element if it has no usable shape; else an empty text.
    """
    geometry = element.find("geometry")
    if geometry is None:
        return message("importer.without_geometry", "has no <geometry>")
    shapes = [child for child in geometry if child.tag in SHAPE_SIZES or child.tag == "mesh"]
    if not shapes:
        tags = ", ".join(f"<{_plain_tag(child)}>" for child in geometry)
        if not tags:
            return message("importer.empty_geometry", "its <geometry> is empty")
        return message("importer.no_known_shape", "{tags} is not a known shape", tags=tags)
    shape = shapes[0]
    for child in [child for child in geometry if child is not shape]:
        geometry.remove(child)
        report.add(
            "dropped",
            where,
            message(
                "importer.one_shape_each",
                "<{tag}> is left out: a <geometry> has one shape, here <{kept}>",
                tag=child.tag,
                kept=shape.tag,
            ),
        )
    # A mesh is checked when it is read.
    defect = "" if shape.tag == "mesh" else shape_defect(shape)
    if not defect:
        return ""
    return compound("<{shape}> {defect}", shape=_plain_tag(shape), defect=defect)


def _plain_tag(element: ET.Element) -> str:
    """Tag of an element, without the name space of Drake's own elements."""
    return element.tag.rpartition("}")[2]


def _replace_by_box(element: ET.Element, loaded: Mesh) -> _CollisionBox:
    """Replace the mesh of a collision element by the tightest box around it, in place."""
    box = box_of(points_of(loaded.parts))
    _set_shape(element, ET.Element("box", size=format_numbers(box.size)))
    # A <box> is centred on its origin, so the pose of the box in the mesh's frame is added to the origin.
    place(element, pose_of(element) @ box.pose)
    size = message("importer.size_of_box", "with the size {size} m", size=format_numbers(box.size))
    return _CollisionBox(
        name=message("importer.a_box", "a box"), change=size + _thickness_text(box.thickened)
    )


def _thickness_text(thickness: float) -> str:
    """Describe the thickness [m] that a flat mesh was given. The text is empty for 0, a solid mesh."""
    if not thickness:
        return ""
    return message(
        "importer.made_thick", ", thickened to {thickness:.2g} mm", thickness=thickness * 1e3
    )


def _drop(
    link: ET.Element, element: ET.Element, where: str, problem: str, report: ImportReport
) -> None:
    """Remove a visual or a collision shape from its link, in place, and report the problem and the effect."""
    link.remove(element)
    if element.tag == "visual":
        effect = message("importer.not_shown", "this visual is left out")
    elif link.find("collision") is None:
        effect = message(
            "importer.touches_nothing_with_it",
            "the link has no other collision shape and touches nothing",
        )
    else:
        effect = message("importer.other_shapes_stay", "the link keeps its other collision shapes")
    report.add("dropped", where, compound("{problem}; {effect}", problem=problem, effect=effect))


def _shapes_of(link: ET.Element, tag: str) -> list[_LabelledShape]:
    """List the shapes of a link with their places in words. Several shapes are numbered, a single one is not.

    Args:
        link: the link.
        tag: ``visual`` or ``collision``.
    """
    elements = link.findall(tag)
    label = message("robots.tag_of_link", "link '{link}' <{tag}>", link=name_of(link), tag=tag)
    if len(elements) == 1:
        return [_LabelledShape(label, elements[0])]
    shapes = []
    for number, element in enumerate(elements, start=1):
        where = compound("{name} {number}", name=label, number=number)
        shapes.append(_LabelledShape(where, element))
    return shapes


def _set_shape(element: ET.Element, shape: ET.Element) -> None:
    """Replace the shape of a ``<visual>`` or ``<collision>``, in place."""
    for geometry in element.iterfind("geometry"):
        geometry[:] = [shape]


def _mesh_name(mesh: ET.Element | None) -> str:
    """Name of a mesh in the URDF, in words, for the report."""
    uri = "" if mesh is None else mesh.get("filename", "")
    return message("robots.mesh_called", "mesh '{uri}'", uri=shorten(uri))


def _report_mesh(
    report: ImportReport,
    where: str,
    mesh: ET.Element,
    loaded: Mesh,
    replacements: list[str],
    changes: list[str],
) -> None:
    """Report what replaces a mesh. The entry is ``read`` if only the name of the file is new, else ``repaired``.

    Args:
        report: report of the import.
        where: place of the visual or collision shape in words.
        mesh: the ``<mesh>`` of the URDF.
        loaded: the mesh that was read.
        replacements: names of the files that replace it, or the words for a box.
        changes: what was done to the mesh, in words; empty texts are left out.
    """
    scale = mesh.get("scale")
    notes = [*loaded.changes, *filter(None, changes)]
    if scale is not None:
        notes.append(message("importer.scaled_by", "scaled by {scale}", scale=scale))
    mesh_text = message(
        "importer.mesh_with_faces",
        "mesh '{name}' ({faces} faces)",
        name=PurePath(mesh.get("filename", "")).name,
        faces=loaded.faces,
    )
    files = replacements[0]
    if len(replacements) > 1:
        files = message(
            "importer.first_to_last",
            "{first} to {last}",
            first=replacements[0],
            last=Path(replacements[-1]).name,
        )
    # The file was copied, and only its name is new.
    if loaded.original is not None and not notes:
        report.add(
            "read",
            where,
            message(
                "importer.is_as_it_was",
                "{mesh} is copied unchanged as {files}",
                mesh=mesh_text,
                files=files,
            ),
        )
    else:
        new_file = message("importer.is_now", "{mesh} becomes {files}", mesh=mesh_text, files=files)
        report.add("repaired", where, join_texts([new_file, *notes], "; "))
    # Remarks are about the mesh itself, so each is an entry of its own.
    for remark in loaded.remarks:
        report.add("read", where, compound("{mesh} {remark}", mesh=_mesh_name(mesh), remark=remark))


def _scale_of(mesh: ET.Element, where: str, report: ImportReport) -> Scale:
    """Read the scale of a mesh along x, y and z. An unusable scale counts as 1, and is reported.

    Args:
        mesh: the ``<mesh>``.
        where: place of the visual or collision shape in words, for the report.
        report: report of the import.
    """
    text = mesh.get("scale")
    if text is None:
        return _UNSCALED
    # Some files have commas between the numbers.
    numbers = numbers_in(text) or numbers_in(text.replace(",", " ")) or []
    # Some programs write one number for all three directions.
    if len(numbers) == 1:
        numbers = numbers * 3
    # Negative scales are kept: they mirror a mesh, as many files do with the left and right parts of a robot.
    are_usable = all(_LEAST_SCALE < abs(number) < _LARGEST_SCALE for number in numbers)
    if len(numbers) != 3 or not are_usable:
        report.add(
            "repaired",
            where,
            message(
                "importer.no_scale",
                'scale="{text}" is not one or three numbers other than 0; 1 is used',
                text=shorten(text),
            ),
        )
        return _UNSCALED
    return numbers[0], numbers[1], numbers[2]
