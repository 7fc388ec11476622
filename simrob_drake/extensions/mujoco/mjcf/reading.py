"""Read an MJCF file: put in what it includes, leave out what no robot here uses, and let MuJoCo compile the rest."""

import io
import xml.etree.ElementTree as ET
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import shorten
from simrob_drake.base.extras import lacking
from simrob_drake.base.files import content_of
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import OutsideBorder
from simrob_drake.extensions.mujoco.mjcf.bodies import robot_from_model
from simrob_drake.importer.meshes.checks import LARGEST_FILE, UnreadableMesh
from simrob_drake.importer.meshes.parts import decode_texture, mean_colour
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces
from simrob_drake.importer.meshes.reading import mesh_content
from simrob_drake.importer.reading.child import ChildFailed, in_child
from simrob_drake.importer.reading.xml_file import read_included, xml_element
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import MOST_TAGS, format_numbers
from simrob_drake.robots.urdf_check import numbers_in

TIME_LIMIT = 120.0  # of a compilation [s]
_MOST_FILES = 100  # that a model may include
_MOST_COPIES = 1000
"""Largest count of elements that all ``replicate`` elements of a model make; MuJoCo copies the content of each."""
_SOFT = {
    "deformable": message("mujoco.soft_not_simulated", "what is soft is not simulated"),
    "flexcomp": message("mujoco.soft_not_simulated", "what is soft is not simulated"),
    "composite": message(
        "mujoco.soft_or_many_bodies", "what is soft, or made of many bodies, is not simulated"
    ),
}
_LEFT_OUT = _SOFT | {
    "sensor": message("mujoco.own_sensors", "a station has sensors of its own"),
    "contact": message(
        "mujoco.parts_pass_through",
        "parts of a robot pass through each other unless contact.self_collision is set",
    ),
    "skin": message("mujoco.rigid_shapes_only", "only rigid shapes are shown"),
    "extension": message("mujoco.plugins_not_loaded", "plugins are never loaded"),
    "plugin": message("mujoco.plugins_not_loaded", "plugins are never loaded"),
}  # what is left out, and why
_UNUSED = ("visual", "statistic", "custom", "size", "option", "camera", "light", "texture", "layer")
_COMPILER = (
    *(
        "angle",
        "eulerseq",
        "autolimits",
        "alignfree",
        "inertiafromgeom",
        "inertiagrouprange",
        "balanceinertia",
    ),
    *("boundmass", "boundinertia", "settotalmass"),
)  # settings of the compiler that make a difference to a robot
_GRAVITY = (0, 0, -9.81)
_FLUID = ("density", "viscosity", "wind")


def read_mjcf(
    root: ET.Element, path: Path, options: ImportOptions, report: ImportReport
) -> ET.Element:
    """Return the ``robot`` element that a ``mujoco`` element stands for, as MuJoCo understands it.

    The element of the file, whose path is absolute, is changed. Raises InvalidModel: MuJoCo is not installed or refuses
    it, or it holds no robot.
    """
    if find_spec("mujoco") is None:
        raise report.refusal(
            "", lacking(message("mujoco.is_mjcf", "is an MJCF file, which"), "mujoco")
        )
    source = _Source(root, MeshPlaces(path, options.mesh_path, options.package_folders), report)
    source.put_in_includes(root)
    if root.find(".//attach") is not None or root.find("asset/model") is not None:
        raise report.refusal(
            "<attach>",
            message(
                "mujoco.puts_other_model_in",
                "puts another model in; let MuJoCo save all as one file (mj_saveLastXML)",
            ),
        )
    files = source.take_file_names()
    _leave_out(root, report)
    _check_replicates(root, report)
    try:
        fields = in_child(
            "simrob_drake.extensions.mujoco.mjcf.compiling",
            {"xml": ET.tostring(root, encoding="unicode"), "meshes": files},
            source.mesh,
            report,
            seconds=TIME_LIMIT,
        )
    except ChildFailed as problem:
        raise report.refusal(
            "", message("mujoco.cannot_read", "MuJoCo cannot read it: {problem}", problem=problem)
        ) from problem
    for name in fields["mesh_missing"]:
        report.add(
            "lost",
            message("mujoco.mesh_called", "mesh '{name}'", name=name),
            message(
                "mujoco.mesh_unread",
                "cannot be read, and masses are made of it: they lack its part",
            ),
        )
    arrays = {
        key: np.array(value) if isinstance(value, list) else value for key, value in fields.items()
    }
    return robot_from_model(
        SimpleNamespace(**arrays), root.get("model") or path.stem, options.model, report
    )


@dataclass
class _Source:
    """An MJCF file with all that it names."""

    root: ET.Element
    places: MeshPlaces
    report: ImportReport

    def put_in_includes(self, element: ET.Element) -> None:
        """Put files in the place of ``include`` elements; raises InvalidModel: none there, not to be read, too many."""
        for _ in range(_MOST_FILES + 1):
            found = next(
                (
                    (owner, child)
                    for owner in element.iter()
                    for child in owner
                    if child.tag == "include"
                ),
                None,
            )
            if found is None:
                return
            owner, include = found
            place = list(owner).index(include)
            owner[place : place + 1] = list(self._included(include.get("file", "")))
            if sum(1 for _ in element.iter()) > MOST_TAGS:
                raise self.report.refusal(
                    "<include>",
                    message(
                        "mujoco.too_many_tags",
                        "more than {most} tags with all that is included",
                        most=MOST_TAGS,
                    ),
                )
        raise self.report.refusal(
            "<include>",
            message(
                "mujoco.too_many_files",
                "more than {most} files, or a file in itself",
                most=_MOST_FILES,
            ),
        )

    def _included(self, name: str) -> ET.Element:
        where = f"<include> '{shorten(name)}'"
        try:
            path = self.places.find(name).path
        except (MeshMissing, OutsideBorder) as problem:
            raise self.report.refusal(where, str(problem)) from problem
        return read_included(xml_element, path, self.report)

    def take_file_names(self) -> dict[str, str]:
        """Take the names of all files out of the text, and return those of meshes by the meshes' names."""
        found: dict[str, str] = {}
        for mesh in self.root.iterfind("asset/mesh[@file]"):
            file = mesh.attrib.pop("file")
            name = mesh.attrib.setdefault("name", PurePosixPath(file.replace("\\", "/")).stem)
            found[name] = self._path(file, "meshdir")
        for hills in self.root.iterfind("asset/hfield[@file]"):
            hills.attrib |= {"nrow": "2", "ncol": "2"}
            del hills.attrib["file"]
        self._colour_materials()
        return found

    def _path(self, file: str, key: str) -> str:
        """Return a file's name relative to the MJCF file, as the compiler's settings have it."""
        folder = self._settings.get(key, self._settings.get("assetdir", ""))
        name = PurePosixPath(file.replace("\\", "/"))
        return str(
            PurePosixPath(folder)
            / (name.name if self._settings.get("strippath") == "true" else name)
        )

    @cached_property
    def _settings(self) -> dict[str, str]:
        return {
            key: value
            for element in self.root.iterfind("compiler")
            for key, value in element.attrib.items()
        }

    def _colour_materials(self) -> None:
        """Let materials with a texture have its mean colour, since only colours are shown."""
        textures = {
            texture.get("name", PurePosixPath(texture.get("file", "")).stem): texture.get(
                "file", ""
            )
            for texture in self.root.iterfind("asset/texture")
        }
        for material in [
            element for element in self.root.iter("material") if element.get("texture")
        ]:
            name = textures.get(material.attrib.pop("texture"), "")
            mean = self._mean(self._path(name, "texturedir")) if name else None
            if mean is None:
                continue
            own = numbers_in(material.get("rgba", "1 1 1 1")) or mean
            material.set("rgba", format_numbers(a * b for a, b in zip(own, mean, strict=False)))
            self.report.add(
                "repaired",
                message("mujoco.material_called", "material '{name}'", name=material.get("name")),
                message("mujoco.mean_colour", "its texture '{name}' is its mean colour", name=name),
            )

    def _mean(self, name: str) -> tuple[float, ...] | None:
        from PIL import Image

        try:
            image = decode_texture(
                Image.open(io.BytesIO(content_of(self.places.find(name).path, LARGEST_FILE)))
            )
        except (MeshMissing, OutsideBorder, OSError, ValueError):
            return None
        return None if image is None else mean_colour(image)

    def mesh(self, _: str, file: str) -> str | None:
        """Return the content of a mesh file, for the compiler, in Base64; None if it cannot be had."""
        try:
            return b64encode(mesh_content(self.places.find(file).path)).decode()
        except (MeshMissing, OutsideBorder, UnreadableMesh):
            return None


def _leave_out(root: ET.Element, report: ImportReport) -> None:
    """Leave out what no robot here uses; what a user may miss is told."""
    for option in root.iterfind("option"):
        _report_physics(option.attrib, report)
    left_out: Counter[str] = Counter()
    for owner in list(root.iter()):
        for child in list(owner):
            if child.tag in _LEFT_OUT:
                left_out[child.tag] += max(1, len(child))
            if child.tag in _LEFT_OUT or child.tag in _UNUSED:
                owner.remove(child)
    for tag, count in left_out.items():
        report.add(
            "lost" if tag in _SOFT else "dropped",
            f"<{tag}>",
            compound("{count} ×: {left_out}", count=count, left_out=_LEFT_OUT[tag]),
        )
    for compiler in root.iterfind("compiler"):
        compiler.attrib = {key: value for key, value in compiler.attrib.items() if key in _COMPILER}
    for key in root.iterfind("keyframe/key"):
        key.attrib = {name: value for name, value in key.attrib.items() if name in ("name", "qpos")}


def _check_replicates(root: ET.Element, report: ImportReport) -> None:
    """Check how many elements the ``replicate`` elements of a model make, nested ones too.

    Raises:
        InvalidModel: they make more than can be imported in a few seconds.
    """
    # Count of all copies of replicated elements visited so far. Elements that are not replicated do not count.
    total = 0
    elements_left = [_CopiedElement(root, 1)]
    while elements_left:
        element, own_copies = elements_left.pop()
        if own_copies > 1:
            total += own_copies
        is_replicate = element.tag == "replicate"
        child_copies = own_copies * _copies_by(element) if is_replicate else own_copies
        # The copies of the content are checked before the content is visited, so that the message names the replicate,
        # and an empty one is refused, too.
        if total > _MOST_COPIES or child_copies > _MOST_COPIES:
            where = (
                f"<replicate count='{shorten(element.get('count', ''))}'>" if is_replicate else ""
            )
            raise report.refusal(
                where,
                message(
                    "mujoco.too_many_copies",
                    "more than {most} elements with all that is replicated",
                    most=_MOST_COPIES,
                ),
            )
        elements_left += [_CopiedElement(child, child_copies) for child in element]


class _CopiedElement(NamedTuple):
    """An element of a model, and the count of its copies that the ``replicate`` elements around it make."""

    element: ET.Element
    copies: int


def _copies_by(replicate: ET.Element) -> int:
    """Count of copies that a ``replicate`` element makes of its content.

    It is 1 if the element has no valid count, or a count below 1: MuJoCo refuses these later.
    """
    numbers = numbers_in(replicate.get("count", "")) or ()
    if len(numbers) != 1 or not np.isfinite(numbers[0]):
        return 1
    return max(1, int(numbers[0]))


def _report_physics(option: Mapping[str, str], report: ImportReport) -> None:
    """Say what of a model's physics no station has."""
    gravity = numbers_in(option.get("gravity", "")) or _GRAVITY
    if len(gravity) != len(_GRAVITY) or not np.allclose(gravity, _GRAVITY, atol=0.02):
        text = message(
            "mujoco.other_gravity",
            "gravity {gravity}: a station has 9.81 m/s² downwards",
            gravity=shorten(option["gravity"]),
        )
        report.add(
            "lost",
            "<option>",
            message(
                "mujoco.units_not_converted",
                "{text}; where centimetres or grams were meant, figures are not converted",
                text=text,
            ),
        )
    for key in [key for key in _FLUID if any(numbers_in(option.get(key, "")) or ())]:
        report.add(
            "lost",
            "<option>",
            message(
                "mujoco.air_not_simulated",
                "{key} {value}: air and water are not simulated",
                key=key,
                value=shorten(option[key]),
            ),
        )
