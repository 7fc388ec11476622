"""Read an SDF file: insert the models that it includes, and choose the model that is the robot."""

import os
import xml.etree.ElementTree as ET
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass
from os.path import isdir
from pathlib import Path
from typing import NamedTuple

from simrob_drake.base.errors import one_of, shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import MODEL_MANIFEST, OutsideBorder
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces
from simrob_drake.importer.reading.xml_file import read_included, xml_element
from simrob_drake.importer.sdf.frames import MODEL, version_of
from simrob_drake.importer.sdf.robot import RobotWriter, moves, text_at
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import MOST_TAGS, name_of

# Gazebo uses this name, too.
_MAIN_FILE = "model.sdf"
"""Name of the SDF file in a model's folder that has no manifest."""

_MOST_LEVELS = 20
"""Largest count of includes that are within each other. Models that include each other would never end."""

_OVERRIDES = ("static", "pose")
"""Elements of an ``include`` that replace those of the included model."""

_MERGED_TAGS = ("link", "joint", "frame", "model", "sensor", "plugin")
"""Elements of an included model that a merge moves into the including model."""

_LOST = {
    "sensor": message("importer.own_sensors", "sensors are part of a station (section `sensors`)"),
    "plugin": message("importer.plugins_not_loaded", "plugins are never loaded"),
    "actor": message("importer.people_not_simulated", "people are not simulated"),
    "light": message("importer.own_light", "a station has its own lights"),
    "surface": message(
        "importer.own_contact", "contact parameters are part of a station (section `contact`)"
    ),
}
"""Elements that are not imported, wherever they are in the model, with the reasons."""


def read_sdf(
    root: ET.Element, path: Path, options: ImportOptions, report: ImportReport
) -> ET.Element:
    """Convert a model in an ``sdf`` element to a ``robot`` element.

    Args:
        root: the ``sdf`` element, which is changed: the models that it includes are inserted.
        path: absolute path of the file.
        options: options of the import: the folders that may be read, and the name of the model if the user chooses it.
        report: gets an entry for each change and each loss.

    Raises:
        InvalidModel: the file has a defect that leaves its meaning open, or holds no robot.
        UnknownName: there is no model of the name in the options.
    """
    includes = _Includes(MeshPlaces(path, options.mesh_path, options.package_folders), report)
    # A list, because the tree changes while its includes are replaced.
    owners = [element for element in root.iter() if element.tag in ("world", "model", "sdf")]
    for owner in owners:
        includes.insert_models(owner)
    # Only after all includes: the robot may be in one of them.
    model = _choose_model(root, options.model, report)
    _report_losses(model, report)
    return RobotWriter(model, version_of(root), report).write()


def _report_losses(model: ET.Element, report: ImportReport) -> None:
    """Report the elements of a model that are not imported, with one entry for each tag, and links without gravity."""
    counts = Counter(element.tag for element in model.iter() if element.tag in _LOST)
    for tag, count in counts.items():
        # Contact parameters change the motion. Nothing else of the list does.
        report.add(
            "lost" if tag == "surface" else "dropped",
            f"<{tag}>",
            compound("{count} ×: {lost}", count=count, lost=_LOST[tag]),
        )
    for link in model.iter("link"):
        # Arms in files of Gazebo often have no gravity, in place of a controller that compensates it.
        if (link.findtext("gravity") or "1").strip() in ("0", "false"):
            report.add(
                "lost",
                message("robots.link_called", "link '{link}'", link=name_of(link)),
                message(
                    "importer.feels_no_gravity",
                    "is without gravity in the file; here gravity acts on all links",
                ),
            )


def _choose_model(root: ET.Element, name: str, report: ImportReport) -> ET.Element:
    """Choose the model that is the robot. Unless the user names it, the other models are reported as left out.

    Args:
        root: the ``sdf`` element.
        name: name of the model that the user chooses. If it is empty, the robot is the only model with a joint that
            moves, or the only model of the file.
        report: report of the import.

    Raises:
        InvalidModel: the file has no model, or several robots, and the user has not chosen one.
        UnknownName: there is no model of the name.
    """
    # A file may contain a model without a world, or a world with models.
    models = root.findall("model")
    for world in root.iterfind("world"):
        models += world.findall("model")
    if name:
        names = [name_of(model) for model in models]
        what = message("importer.model_option", "model (for --model)")
        # one_of() lists the names if the chosen one is not among them.
        return models[names.index(one_of(what, name, names))]
    # A file of one model that does not move is a robot without joints, which is refused later with the reason.
    robots = [model for model in models if moves(model)] or models
    if not robots:
        raise report.refusal("", message("importer.holds_no_model", "contains no model"))
    if len(robots) > 1:
        raise report.refusal(
            "",
            message(
                "importer.several_robots",
                "contains {count} robots ({names}); choose one with --model NAME",
                count=len(robots),
                names=", ".join(name_of(model) for model in robots),
            ),
        )
    robot = robots[0]
    for model in models:
        if model is not robot:
            report.add(
                "dropped",
                message("importer.model_called", "model '{name}'", name=name_of(model)),
                message(
                    "importer.piece_beside_robot",
                    "is not part of the robot; a station can contain it as a piece (section `pieces`)",
                ),
            )
    return robot


class _ModelFile(NamedTuple):
    """An SDF file that another SDF file includes.

    Attributes:
        path: the file.
        base: path or URI of the file's folder, as the including file has to write it.
    """

    path: Path
    base: str


@dataclass
class _Includes:
    """Replaces ``include`` elements by the models that they include.

    Attributes:
        places: finds files in the folders that may be read.
        report: gets an entry for each model that is missing, and for repairs of the included files.
        budget: count of elements that may still be added.
    """

    places: MeshPlaces
    report: ImportReport
    budget: int = MOST_TAGS

    def insert_models(self, owner: ET.Element, depth: int = 0) -> None:
        """Replace the ``include`` elements of a model or world by the models, in place.

        An ``include`` whose model is missing is removed, with an entry in the report.

        Args:
            owner: the model or world.
            depth: count of includes that have led to it.

        Raises:
            InvalidModel: a model may not be read or is no XML, includes never end, or the model becomes too large.
        """
        for include in owner.findall("include"):
            # The order of models and links decides which link is the canonical one.
            index = list(owner).index(include)
            owner.remove(include)
            uri = text_at(include, "uri")
            where = compound("<include> '{uri}'", uri=shorten(uri))
            if depth > _MOST_LEVELS:
                raise self.report.refusal(
                    where,
                    message("importer.endless_includes", "models include each other without end"),
                )
            try:
                model = self._model(uri)
            except MeshMissing as problem:
                # The rest of the robot may be complete: a world often includes a sun from the network.
                self.report.add("lost", where, str(problem))
                continue
            except OutsideBorder as problem:
                raise self.report.refusal(where, str(problem)) from problem
            for inner_owner in list(model.iter("model")):
                self.insert_models(inner_owner, depth + 1)
            # Twenty levels of ten includes each would fill the memory: the sizes are added up.
            self.budget -= sum(1 for _ in model.iter())
            if self.budget < 0:
                raise self.report.refusal(
                    where,
                    message(
                        "importer.too_many_included",
                        "has more than {most} tags, including those of the included models",
                        most=MOST_TAGS,
                    ),
                )
            # Each part is inserted before those after it, so that they keep their order.
            for part in reversed(_parts_of_include(model, include)):
                owner.insert(index, part)

    def _model(self, uri: str) -> ET.Element:
        """Read the model at a URI. Names of its meshes are rewritten to be relative to the main file.

        Raises:
            MeshMissing: there is no such file, or it contains no model.
            OutsideBorder: the file may not be read.
            InvalidModel: the file, or the manifest of its folder, is no XML.
        """
        file = self._find_file(uri)
        model = read_included(xml_element, file.path, self.report).find("model")
        if model is None:
            raise MeshMissing(
                message(
                    "importer.file_without_model", "{path} contains no model", path=file.path.name
                )
            )
        # Meshes are looked for from the folder of the main file, and not from that of the included one.
        for name in model.iter("uri"):
            text = (name.text or "").strip()
            # URIs with a scheme and absolute paths mean the same in all files.
            if text and "://" not in text and not text.startswith("/"):
                name.text = f"{file.base}/{text}"
        return model

    def _find_file(self, uri: str) -> _ModelFile:
        """Find the SDF file at a URI, or the main SDF file of the model's folder there.

        Raises:
            MeshMissing: there is no such file or folder, or the folder has no SDF file.
            OutsideBorder: the file may not be read.
            InvalidModel: the manifest of the folder is no XML.
        """
        border = self.places.border
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("model", "package"):
            # Gazebo and ROS have different schemes for packages. Both are found in the same folders.
            package, _, path_in_package = rest.partition("/")
            package_folder = border.package(package)
            if package_folder is None:
                raise MeshMissing(
                    message(
                        "importer.no_readable_package",
                        "there is no package {package} in the folders that may be read",
                        package=package,
                    )
                )
            found = border.readable(package_folder / path_in_package)
            # The base keeps the package, so that the names of meshes stay independent of folders of this machine.
            base = uri.rstrip("/")
        else:
            main_folder = self.places.source.parent
            try:
                path = main_folder / (rest if scheme == "file" else uri)
                # The search of meshes finds files only, also by the end of a wrong path.
                found = border.readable(path) if isdir(path) else self.places.find(uri).path
            except ValueError as problem:  # for example a null character
                raise MeshMissing(
                    message("importer.no_name_of_file", "is not a possible name of a file")
                ) from problem
            base = os.path.relpath(found, main_folder)
        # A URI names the folder of a model, or its SDF file itself.
        if isdir(found):
            return _ModelFile(self._main_file(found), base)
        return _ModelFile(found, os.path.dirname(base))

    def _main_file(self, folder: Path) -> Path:
        """Find the SDF file of a model's folder: the last one in its manifest that exists, else ``model.sdf``.

        Manifests list the files by rising versions of SDF.

        Raises:
            MeshMissing: neither a file of the manifest nor ``model.sdf`` exists.
            OutsideBorder: the file may not be read.
            InvalidModel: the manifest is no XML.
        """
        manifest = folder / MODEL_MANIFEST
        names = [_MAIN_FILE]
        if manifest.is_file():
            content = xml_element(manifest, ImportReport(manifest))
            names += [(sdf.text or "").strip() for sdf in content.iter("sdf")]
        # Backwards from the newest file to the usual name, which is the last resort.
        for name in reversed(names):
            if name and (folder / name).is_file():
                return self.places.border.readable(folder / name)
        raise MeshMissing(
            message(
                "importer.no_main_file",
                "there is no {main} in {folder}",
                main=_MAIN_FILE,
                folder=folder,
            )
        )


def _parts_of_include(model: ET.Element, include: ET.Element) -> list[ET.Element]:
    """List the elements that replace an ``include``: the model or, if it is to be merged, the elements in it.

    Args:
        model: the included model, which gets the name, pose and other values that the ``include`` gives.
        include: the ``include`` element.
    """
    name = text_at(include, "name")
    # One model may be included twice, under different names.
    if include.findtext("name"):
        model.set("name", name)
    for tag in _OVERRIDES:
        override = include.find(tag)
        if override is not None:
            for element in model.findall(tag):
                model.remove(element)
            model.append(deepcopy(override))
    placement_frame = include.findtext("placement_frame")
    if placement_frame:
        model.set("placement_frame", placement_frame.strip())
    return _merged_parts(model) if include.get("merge") == "true" else [model]


def _merged_parts(model: ET.Element) -> list[ET.Element]:
    """Elements of a model that is merged into another one, where they replace the ``include``.

    The merged model has no frame of its own any more. A new frame takes its place: it has the model's pose, and all
    elements that refer to the model's own frame refer to the new frame.

    Args:
        model: the included model, which is changed.
    """
    # Names that begin with an underscore are unusual, so that no link has this one.
    frame_name = f"_merged_{name_of(model)}"
    frame = ET.Element("frame", name=frame_name)
    # The pose of the include counts here, as it has replaced that of the model.
    frame.extend(model.findall("pose"))
    parts = [part for part in model if part.tag in _MERGED_TAGS]
    for part in parts:
        # The model's own frame is the default of many references. They are written first, and then renamed.
        if part.tag == "frame" and not part.get("attached_to"):
            part.set("attached_to", MODEL)
        is_in_model_frame = part.tag in ("link", "model") or part.get("attached_to") == MODEL
        pose = part.find("pose")
        if is_in_model_frame and (pose is None or not pose.get("relative_to")):
            if pose is None:
                pose = ET.SubElement(part, "pose")
            pose.set("relative_to", MODEL)
        # Within a nested model, the same name means the frame of that model. Only its pose is given outside.
        elements = part.findall("pose") if part.tag == "model" else list(part.iter())
        for element in elements:
            for key, value in element.items():
                if value == MODEL:
                    element.set(key, frame_name)
    return [frame, *parts]
