"""Robots by path: clean URDFs as they are, all others imported into a cache that is keyed by content."""

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from os.path import isfile
from pathlib import Path

from simrob_drake.errors import OutputError, SimrobError
from simrob_drake.files import NotRead, text_of
from simrob_drake.folders import cache_entry
from simrob_drake.given import as_path
from simrob_drake.importer.importing import REPORT_FILE, import_robot
from simrob_drake.importer.meshes.places import mesh_files
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.reading.source import read_source
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.catalog import ROBOT_FILE, RobotModel, load_robot_from_urdf
from simrob_drake.robots.urdf import LARGEST_URDF, with_absolute_meshes
from simrob_drake.yaml_files import read_yaml

_CODE = [Path(__file__).parents[1] / room for room in ("importer", "robots")]


def robot_from_file(path: Path | str, options: ImportOptions | None = None) -> RobotModel:
    """Return the robot of any URDF: read as it is if it is clean, imported once if it is not, or if options are given.

    Raises:
        InvalidModel: a defect that no import can repair.
        OutputError: the cache cannot be written.
    """
    path = as_path(path, "path")
    if options is None:
        try:
            robot = load_robot_from_urdf(path)
            with_absolute_meshes(robot.element, robot.folder)
        except SimrobError:
            pass
        else:
            return robot
    return _imported_once(path.resolve(), options or ImportOptions())


def import_summary(robot: RobotModel) -> str:
    """Return what an import did to a robot, in one line; empty if it was not imported."""
    return _summary(robot.folder)


def _summary(folder: Path) -> str:
    """Return the summary of an import's report; empty without one that is whole."""
    try:
        return str(json.loads(text_of(folder / REPORT_FILE, LARGEST_URDF))["summary"])
    except (NotRead, ValueError, LookupError, TypeError):
        return ""


def _imported_once(source: Path, options: ImportOptions) -> RobotModel:
    folder = cache_entry("robots", made_of=_dependencies(source, options), made_by=_CODE)
    if not _summary(folder):
        try:
            import_robot(source, folder, options, force=(folder / REPORT_FILE).exists(), apart=False)
        except OutputError:
            if not _summary(folder):  # else another process was quicker
                raise
    urdf = str(read_yaml(folder / ROBOT_FILE)["urdf"])
    return load_robot_from_urdf(folder / urdf)


def _dependencies(source: Path, options: ImportOptions) -> Iterator[bytes]:
    """Yield all that the result depends on, but for our code; the file's own name is no part of it."""
    yield options.model_dump_json().encode()
    robot = read_source(source, ImportReport(source), options)
    yield ET.tostring(robot)  # of a xacro with all that it includes
    beside = [file for file in (source, source.parent / ROBOT_FILE) if isfile(file)]
    for file in (*beside, *mesh_files(robot, source=source, options=options)):
        with file.open("rb") as content:  # meshes may be larger than what is read of them
            yield hashlib.file_digest(content, "sha256").digest()
