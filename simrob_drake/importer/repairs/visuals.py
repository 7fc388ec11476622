"""What a robot looks like: each mesh becomes OBJ files, one for each colour or texture."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary, Scale
from simrob_drake.importer.meshes.parts import Part, Rgba
from simrob_drake.importer.meshes.writing import MeshWriter
from simrob_drake.importer.repairs.names import free_name
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
from simrob_drake.robots.urdf import name_of


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
    _done: dict[tuple[Path, Scale], tuple[Mesh, list[_Drawn]]] = field(default_factory=dict, init=False)

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
        loaded, drawn = self._written(link, uri, scale)
        note = self.library.places.find(uri).note
        tell_mesh(self.report, where, mesh, loaded, [file.name for file in drawn], [note, *_colours(element, drawn)])
        place = list(link).index(element)
        link.remove(element)
        for index, file in enumerate(drawn):
            link.insert(place + index, self._element(link, element, file))

    def _written(self, link: ET.Element, uri: str, scale: Scale) -> tuple[Mesh, list[_Drawn]]:
        """Return what a mesh has become; a mesh that several links show is written once, named by the first."""
        key = self.library.path_of(uri), scale
        if key in self._done:
            for _ in self._done[key][1]:
                self.names.next(link, "visual")  # names count what is shown, whether it is shared or not
            return self._done[key]
        loaded = self.library.load(uri, scale)
        drawn = [self._file(link, loaded, part) for part in loaded.parts]
        self._done[key] = loaded.remembered(), drawn
        return loaded, drawn

    def _file(self, link: ET.Element, loaded: Mesh, part: Part) -> _Drawn:
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
            material = ET.SubElement(visual, "material", name=self.names.material(Path(file.name).stem))
            ET.SubElement(material, "color", rgba=" ".join(f"{value:g}" for value in file.rgba))
        return visual


def _colours(element: ET.Element, drawn: list[_Drawn]) -> list[str]:
    """Say which colours are shown where the mesh brings its own."""
    own = [file for file in drawn if file.rgba or file.textured]
    told = [f"{len(drawn)} colours, a <visual> for each"] if len(drawn) > 1 else []
    told += ["its own colour is kept"] if len(drawn) == 1 and drawn[0].rgba else []
    if own and element.find("material") is not None:
        told.append("the URDF's material gives way to its own look, as in RViz")
    return told
