"""Read an SDF file: put in the models that it includes, and choose the one that is the robot."""

import os
import xml.etree.ElementTree as ET
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass
from os.path import isdir
from pathlib import Path

from simrob_drake.base.errors import one_of, shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import MODEL_MANIFEST, OutsideBorder
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces
from simrob_drake.importer.reading.xml_file import read_included, xml_element
from simrob_drake.importer.sdf.frames import MODEL, version_of
from simrob_drake.importer.sdf.robot import RobotWriter, moves
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import MOST_TAGS, name_of

_MAIN = "model.sdf"
_DEEPEST = 20  # includes in includes
_OVERRIDES = ("static", "pose")
_LOST = {
    "sensor": message("importer.own_sensors", "a station has sensors of its own"),
    "plugin": message("importer.plugins_not_loaded", "plugins are never loaded"),
    "actor": message("importer.people_not_simulated", "people are not simulated"),
    "light": message("importer.own_light", "a station has light of its own"),
    "surface": message(
        "importer.own_contact", "a station has contact figures of its own (contact:)"
    ),
}


def read_sdf(
    root: ET.Element, path: Path, options: ImportOptions, report: ImportReport
) -> ET.Element:
    """Return the ``robot`` element of a model in an ``sdf`` element.

    Parameters are those of :meth:`simrob_drake.importer.importer.RobotImporter.robot_element`.

    Raises:
        InvalidModel: the file has a defect that leaves its meaning open, or holds no robot.
    """
    includes = _Includes(MeshPlaces(path, options.mesh_path, options.package_folders), report)
    for owner in [element for element in root.iter() if element.tag in ("world", "model", "sdf")]:
        includes.put_in(owner)
    model = _chosen(root, options.model, report)
    for tag, count in Counter(
        element.tag for element in model.iter() if element.tag in _LOST
    ).items():
        report.add(
            "lost" if tag == "surface" else "dropped",
            f"<{tag}>",
            compound("{count} ×: {lost}", count=count, lost=_LOST[tag]),
        )
    for link in model.iter("link"):
        if (link.findtext("gravity") or "1").strip() in ("0", "false"):
            report.add(
                "lost",
                message("robots.link_called", "link '{link}'", link=name_of(link)),
                message("importer.feels_no_gravity", "feels no gravity: all has its weight"),
            )
    return RobotWriter(model, version_of(root), report).written()


def _chosen(root: ET.Element, name: str, report: ImportReport) -> ET.Element:
    """Return the model that is the robot; the others are told of."""
    models = [
        model for owner in (root, *root.iterfind("world")) for model in owner.iterfind("model")
    ]
    names = [name_of(model) for model in models]
    if name:
        return models[
            names.index(
                one_of(message("importer.model_option", "model (for --model)"), name, names)
            )
        ]
    robots = [model for model in models if moves(model)] or models
    if len(robots) != 1:
        listed = ", ".join(name_of(model) for model in robots)
        raise report.refusal(
            "",
            message(
                "importer.several_robots",
                "holds {count} robots ({names}); choose one with --model NAME",
                count=len(robots),
                names=listed,
            )
            if robots
            else (message("importer.holds_no_model", "holds no model")),
        )
    for model in models:
        if model is not robots[0]:
            kind = (
                "stands"
                if (model.findtext("static") or "").strip() in ("1", "true")
                else message("importer.is_loose", "is loose")
            )
            text = message(
                "importer.piece_beside_robot",
                "{kind} in the world beside the robot; a piece of a station can take its place (pieces:)",
                kind=kind,
            )
            report.add(
                "dropped",
                message("importer.model_called", "model '{name}'", name=name_of(model)),
                text,
            )
    return robots[0]


@dataclass
class _Includes:
    """Puts models in the place of ``include`` elements."""

    places: MeshPlaces
    report: ImportReport
    budget: int = MOST_TAGS

    def put_in(self, owner: ET.Element, depth: int = 0) -> None:
        """Put models in the place of ``include`` elements; raises InvalidModel: they may not be read, or never end."""
        for include in owner.findall("include"):
            place = list(owner).index(include)
            owner.remove(include)
            uri = (include.findtext("uri") or "").strip()
            where = compound("<include> '{uri}'", uri=shorten(uri))
            if depth > _DEEPEST:
                raise self.report.refusal(
                    where,
                    message(
                        "importer.endless_includes", "models include each other without an end"
                    ),
                )
            try:
                model = self._model(uri)
            except MeshMissing as problem:
                self.report.add("lost", where, str(problem))
                continue
            except OutsideBorder as problem:
                raise self.report.refusal(where, str(problem)) from problem
            self.put_in(model, depth + 1)
            for nested in model.iter("model"):
                if nested is not model:
                    self.put_in(nested, depth + 1)
            self.budget -= sum(1 for _ in model.iter())
            if self.budget < 0:
                raise self.report.refusal(
                    where,
                    message(
                        "importer.too_many_included",
                        "more than {most} tags with all that is included",
                        most=MOST_TAGS,
                    ),
                )
            for new in reversed(_placed(model, include)):
                owner.insert(place, new)

    def _model(self, uri: str) -> ET.Element:
        """Return the model at a URI, whose meshes are named as the main file has to."""
        path, base = self._file(uri)
        model = read_included(xml_element, path, self.report).find("model")
        if model is None:
            raise MeshMissing(
                message("importer.file_without_model", "{path} holds no model", path=path.name)
            )
        for name in model.iter("uri"):
            text = (name.text or "").strip()
            if text and "://" not in text and not text.startswith("/"):
                name.text = f"{base}/{text}"
        return model

    def _file(self, uri: str) -> tuple[Path, str]:
        """Return the SDF file at a URI, and how names that are relative to it begin in the main file."""
        border, (scheme, means, rest) = self.places.border, uri.partition("://")
        if means and scheme in ("model", "package"):
            package, _, inner = rest.partition("/")
            known = border.package(package)
            if known is None:
                raise MeshMissing(
                    message(
                        "importer.no_readable_package",
                        "there is no package {package} that may be read",
                        package=package,
                    )
                )
            folder = border.readable(known / inner)
            base = uri.rstrip("/")
        else:
            try:
                found = self.places.source.parent / (rest if scheme == "file" else uri)
                folder = border.readable(found) if isdir(found) else self.places.find(uri).path
            except ValueError as problem:
                raise MeshMissing(
                    message("importer.no_name_of_file", "is no name that a file can have")
                ) from problem
            base = os.path.relpath(folder, self.places.source.parent)
        if isdir(folder):
            return self._main(folder), base
        return folder, os.path.dirname(base)

    def _main(self, folder: Path) -> Path:
        """Return the SDF file of a model's folder: the last that its manifest names, which is of the newest version."""
        manifest = folder / MODEL_MANIFEST
        names = [_MAIN]
        if manifest.is_file():
            names += [
                (sdf.text or "").strip()
                for sdf in xml_element(manifest, ImportReport(manifest)).iter("sdf")
            ]
        for name in reversed(names):
            if name and (folder / name).is_file():
                return self.places.border.readable(folder / name)
        raise MeshMissing(
            message(
                "importer.no_main_file", "there is no {main} in {folder}", main=_MAIN, folder=folder
            )
        )


def _placed(model: ET.Element, include: ET.Element) -> list[ET.Element]:
    """Return what stands in the place of an ``include``: the model, or all that is in it if it is to be merged."""
    if include.findtext("name"):
        model.set("name", (include.findtext("name") or "").strip())
    for tag in _OVERRIDES:
        if include.find(tag) is not None:
            for old in model.findall(tag):
                model.remove(old)
            model.append(deepcopy(include.find(tag)))  # type: ignore[arg-type]
    placement = include.findtext("placement_frame")
    if placement:
        model.set("placement_frame", placement.strip())
    return _merged(model) if include.get("merge") == "true" else [model]


def _merged(model: ET.Element) -> list[ET.Element]:
    own = f"_merged_{name_of(model)}"
    frame = ET.Element("frame", name=own)
    frame.extend(model.findall("pose"))
    parts = [
        part
        for part in model
        if part.tag in ("link", "joint", "frame", "model", "sensor", "plugin")
    ]
    for part in parts:
        if part.tag == "frame" and not part.get("attached_to"):
            part.set("attached_to", MODEL)
        pose = part.find("pose")
        in_model = part.tag in ("link", "model") or part.get("attached_to") == MODEL
        if in_model and (pose is None or not pose.get("relative_to")):
            (ET.SubElement(part, "pose") if pose is None else pose).set("relative_to", MODEL)
        for element in part.findall("pose") if part.tag == "model" else part.iter():
            element.attrib |= {key: own for key, value in element.attrib.items() if value == MODEL}
    return [frame, *parts]
