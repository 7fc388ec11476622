"""Import a robot: from any published URDF to a folder that a station can name."""

import json
import re
import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from simrob_drake.errors import OutputError
from simrob_drake.folders import filled_at_once
from simrob_drake.given import as_path
from simrob_drake.importer.gains import first_gains
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.packages import MANIFEST, package_root
from simrob_drake.importer.probe import probe
from simrob_drake.importer.reading.source import read_source
from simrob_drake.importer.repairs.base import Base, choose_base
from simrob_drake.importer.repairs.drives import repair_drives
from simrob_drake.importer.repairs.inertias import repair_inertias
from simrob_drake.importer.repairs.joints import repair_joints
from simrob_drake.importer.repairs.materials import repair_materials
from simrob_drake.importer.repairs.shapes import import_shapes
from simrob_drake.importer.repairs.structure import repair_structure
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.catalog import ROBOT_FILE, RobotModel, described_robot, load_robot_from_urdf
from simrob_drake.robots.urdf_check import check_urdf

_HEADER = """\
# Draft of an import; edit it freely.
# axes: the joints in the order of every vector; rename an axis as `elbow: {joint: joint_3, sign: -1}`.
# tools: frames of the URDF whose pose a station can follow; the first is where pieces are attached.
"""


REPORT_FILE = "report.json"
_LONGEST = 100  # letters of a robot's name that its file keeps


@dataclass(frozen=True)
class ImportedRobot:
    """What an import made.

    Attributes:
        model: the robot, in its new folder.
        report: all that was done to it.
    """

    model: RobotModel
    report: ImportReport


def import_robot(
    source: Path | str,
    folder: Path | str,
    options: ImportOptions | None = None,
    *,
    force: bool = False,
    apart: bool = True,
    isolated: bool = True,
) -> ImportedRobot:
    """Write a clean copy of a robot: URDF, OBJ meshes, a draft of its ``robot.yaml``, and a report as JSON.

    Args:
        source: a URDF or xacro file.
        folder: where to; it appears at once, when everything is in it, and nothing is written elsewhere.
        options: choices; the defaults suit most robots.
        force: replace an import that is there.
        apart: refuse a folder within the source; a cache may well lie below the same home.
        isolated: let Drake read the result in a process of its own first.

    Raises:
        InvalidModel: a defect that can't be repaired; nothing is written.
        OutputError: the folder cannot be written, exists, or lies within the source.
    """
    source, folder = as_path(source, "source").resolve(), as_path(folder, "folder")
    if apart and source.exists():
        _check_apart(source, folder)
    report = ImportReport(source)
    with filled_at_once(folder, marker=REPORT_FILE, force=force) as work:
        file = _write(source, work, options or ImportOptions(), report, isolated)
    return ImportedRobot(load_robot_from_urdf(folder / file), report)


def examine_robot(source: Path | str, options: ImportOptions | None = None) -> ImportedRobot:
    """Do all that an import does, but leave nothing behind; the model's files are gone, its figures are there.

    Raises:
        InvalidModel: a defect that can't be repaired.
    """
    source = as_path(source, "source").resolve()
    report = ImportReport(source)
    with tempfile.TemporaryDirectory(prefix="simrob-") as work:
        file = _write(source, Path(work), options or ImportOptions(), report, isolated=True)
        model = load_robot_from_urdf(Path(work) / file)
        model.element  # noqa: B018  # read while the file is there
    return ImportedRobot(model, report)


def _write(source: Path, work: Path, options: ImportOptions, report: ImportReport, isolated: bool) -> str:
    """Fill a folder with the clean robot, and return the name of its URDF."""
    robot = read_source(source, report, options)
    described = described_robot(source)
    if described is not None and options.base == "auto":
        options = options.model_copy(update={"base": described.base})
    base = _repair(robot, source, work, options, report)
    check_urdf(robot, source)
    file = work / (source.name if described is not None else f"{_plain(robot.get('name') or source.stem)}.urdf")
    ET.indent(robot)
    ET.ElementTree(robot).write(file, encoding="utf-8", xml_declaration=True)
    if isolated:
        probe(file, report)
    (work / ROBOT_FILE).write_text(_description(described, file, base, report), encoding="utf-8")
    (work / REPORT_FILE).write_text(json.dumps(report.as_json(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return file.name


def _repair(robot: ET.Element, source: Path, work: Path, options: ImportOptions, report: ImportReport) -> Base:
    """Do all repairs in the order in which they stand on each other, and return how the base is held."""
    repair_structure(robot, options, report)
    repair_materials(robot, report)
    repair_joints(robot, options, report)
    import_shapes(robot, source=source, folder=work, options=options, report=report)
    repair_inertias(robot, work, options, report)
    repair_drives(robot, options, report)
    return choose_base(robot, options, report)


def _check_apart(source: Path, folder: Path) -> None:
    """Check that nothing is written into the source: its package, or at least its folder."""
    package, target = package_root(source), folder.resolve()
    root = package if (package / MANIFEST).is_file() else source.parent
    if target.is_relative_to(root) or root.is_relative_to(target):
        example = root.parent / f"{source.stem}_imported"
        raise OutputError(f"{folder} lies within the source {root}; choose a folder outside of it, such as {example}")


def _description(described: RobotModel | None, file: Path, base: Base, report: ImportReport) -> str:
    """Return the ``robot.yaml``: the source's own, or a draft."""
    if described is None:
        return draft(load_robot_from_urdf(file).model_copy(update={"base": base}), report)
    if described.base == base:
        return (described.folder / ROBOT_FILE).read_text(encoding="utf-8")
    report.add("repaired", ROBOT_FILE, f"base: {base} instead of {described.base}, as asked")
    content = described.model_copy(update={"base": base}).model_dump(mode="json", exclude={"folder"}, exclude_none=True)
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def _plain(name: str) -> str:
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:_LONGEST] or "robot"


def draft(robot: RobotModel, report: ImportReport) -> str:
    """Return the text of a ``robot.yaml`` for an imported robot; its home posture and gains are added to the report."""
    content: dict[str, Any] = {
        "name": robot.name,
        "description": f"{robot.name}, imported",
        "source": report.source.name,
        "urdf": robot.urdf,
        "base": robot.base,
        "root": robot.root,
        "axes": list(robot.axes),
        "tools": robot.tools,
    }
    if isinstance(robot.home_deg, dict):
        content["home_deg"] = robot.home_deg
        midway = ", ".join(robot.home_deg)
        report.add("defaulted", "robot.yaml", f"zero is outside of the limits of {midway}: they start midway")
    if not robot.links_without_inertia:
        gains = vars(first_gains(robot)).items()
        content["servo"] = {key: dict(zip(robot.axes, values.tolist(), strict=True)) for key, values in gains}
        report.add("defaulted", "robot.yaml", "servo gains from the mass matrix")
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    return _HEADER + text
