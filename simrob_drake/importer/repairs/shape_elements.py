"""The elements around the shapes of a URDF: geometry, material, and the names of what is made of them."""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from simrob_drake.errors import shortened
from simrob_drake.importer.meshes.library import Mesh, Scale
from simrob_drake.importer.options import ImportReport
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.urdf import name_of
from simrob_drake.robots.urdf_check import SHAPE_SIZES, numbers_in, shape_defect

PLAIN = "simrob_plain"
"""Attribute of a mesh whose own colours and textures are not shown; that of a visual's material is."""


@dataclass
class ShapeNames:
    """Gives the names of files and materials: made of the link's name, never of a file's.

    Attributes:
        robot: the ``robot`` element, whose names are taken.
    """

    robot: ET.Element
    _stems: dict[str, str] = field(default_factory=dict, init=False)
    _free: FreeNames = field(default_factory=FreeNames, init=False)
    _materials: FreeNames = field(init=False)
    _counts: dict[tuple[str, str], int] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Know the materials that are there."""
        self._materials = FreeNames(name_of(element) for element in self.robot.iter("material"))

    def next(self, link: ET.Element, role: str) -> str:
        """Return the name of a link's next mesh in a role, as in ``upper_arm_visual_1``."""
        stem = self._stem(name_of(link))
        count = self._counts[stem, role] = self._counts.get((stem, role), 0) + 1
        return f"{stem}_{role}_{count}"

    def material(self, name: str) -> str:
        """Return a name like this one that no material has."""
        return self._materials.take(name)

    def _stem(self, link: str) -> str:
        if link not in self._stems:
            clean = re.sub(r"[^A-Za-z0-9_]", "_", link)[:80] or "link"
            free = self._free.take(clean.lower())  # some disks do not tell A from a
            self._stems[link] = clean + free[len(clean) :]
        return self._stems[link]


def check_geometry(element: ET.Element, where: str, report: ImportReport) -> str:
    """Leave one shape in a ``<visual>`` or ``<collision>``; return what is wrong if it has none that can be used."""
    geometry = element.find("geometry")
    if geometry is None:
        return "has no <geometry>"
    shapes = [child for child in geometry if child.tag in SHAPE_SIZES or child.tag == "mesh"]
    if not shapes:
        tags = ", ".join(f"<{child.tag.rpartition('}')[2]}>" for child in geometry)
        return f"{tags} is no shape that is known" if tags else "its <geometry> is empty"
    for child in [child for child in geometry if child is not shapes[0]]:
        geometry.remove(child)
        report.add("dropped", where, f"<{child.tag}>: a <geometry> holds one shape; <{shapes[0].tag}> stays")
    defect = "" if shapes[0].tag == "mesh" else shape_defect(shapes[0])
    return f"<{shapes[0].tag.rpartition('}')[2]}> {defect}" if defect else ""


def drop(link: ET.Element, element: ET.Element, where: str, problem: str, report: ImportReport) -> None:
    """Take a shape away and say what follows from that."""
    link.remove(element)
    if element.tag == "visual":
        effect = "it is not shown"
    elif link.find("collision") is None:
        effect = "the link touches nothing with it"
    else:
        effect = "the link's other collision shapes stay"
    report.add("dropped", where, f"{problem}; {effect}")


def shapes_of(link: ET.Element, tag: str) -> list[tuple[str, ET.Element]]:
    """Return the shapes of a link, each with the words that a message names it by."""
    elements, name = link.findall(tag), f"link '{name_of(link)}' <{tag}>"
    if len(elements) == 1:
        return [(name, elements[0])]
    return [(f"{name} {number}", element) for number, element in enumerate(elements, start=1)]


def set_shape(element: ET.Element, shape: ET.Element) -> None:
    """Put a shape in the place of the one that a ``<visual>`` or ``<collision>`` has."""
    geometry = element.find("geometry")
    assert geometry is not None  # checked before
    geometry[:] = [shape]


def mesh_name(mesh: ET.Element | None) -> str:
    """Return the words that a message names a mesh by."""
    return f"mesh '{shortened('' if mesh is None else mesh.get('filename', ''))}'"


def report_mesh(
    report: ImportReport, where: str, mesh: ET.Element, loaded: Mesh, become: list[str], changes: list[str]
) -> None:
    """Note what a mesh has become: ``read`` if nothing but its name is new."""
    scale = mesh.get("scale")
    notes = [*loaded.changes, *(change for change in changes if change)]
    notes += [f"scaled by {scale}"] if scale is not None else []
    faces = f"mesh '{PurePath(mesh.get('filename', '')).name}' ({loaded.faces} faces)"
    files = become[0] if len(become) == 1 else f"{become[0]} to {Path(become[-1]).name}"
    if loaded.original is not None and not notes:
        report.add("read", where, f"{faces} is {files} as it was")
    else:
        report.add("repaired", where, "; ".join([f"{faces} is now {files}", *notes]))
    for remark in loaded.remarks:
        report.add("read", where, f"{mesh_name(mesh)} {remark}")


def mesh_of(element: ET.Element) -> ET.Element | None:
    """Return the mesh of a ``<visual>`` or ``<collision>``; None for a primitive."""
    return element.find("geometry/mesh")


def scale_of(mesh: ET.Element, where: str, report: ImportReport) -> Scale:
    """Return a mesh's scale; one that is none counts as 1, which is told."""
    text = mesh.get("scale")
    if text is None:
        return 1.0, 1.0, 1.0
    numbers = numbers_in(text) or numbers_in(text.replace(",", " ")) or []
    if len(numbers) == 1:
        numbers = numbers * 3
    if len(numbers) != 3 or not all(1e-12 < abs(number) < 1e12 for number in numbers):
        report.add("repaired", where, f'scale="{shortened(text)}" is no scale; 1 is taken')
        return 1.0, 1.0, 1.0
    return numbers[0], numbers[1], numbers[2]
