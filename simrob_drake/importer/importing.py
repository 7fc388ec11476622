"""Import a robot from any published file, into a folder that a station can name or into a cache.

An import reads the source, repairs it, and writes a folder with a clean URDF, its meshes, the robot's description
``robot.yaml`` and a report. The name of a robot in the cache is a digest of everything that the result depends on.
"""

import hashlib
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os.path import isfile
from pathlib import Path
from typing import Any

import yaml

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError
from simrob_drake.base.files import ROBOT_FILE, open_regular, text_of
from simrob_drake.base.folders import cache_entry, filled_at_once
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.packages import MANIFEST, package_root
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.importer.description import draft
from simrob_drake.importer.hands import add_hand, mark_jaw, of_hand
from simrob_drake.importer.loops import take_closings
from simrob_drake.importer.meshes.places import mesh_files
from simrob_drake.importer.probe import probe
from simrob_drake.importer.reading.source import read_source
from simrob_drake.importer.repairs.base import Base, choose_base
from simrob_drake.importer.repairs.drives import repair_drives
from simrob_drake.importer.repairs.inertias import repair_inertias
from simrob_drake.importer.repairs.joints import repair_joints
from simrob_drake.importer.repairs.materials import repair_materials
from simrob_drake.importer.repairs.shapes import import_shapes
from simrob_drake.importer.repairs.structure import repair_structure
from simrob_drake.importer.robot_files import robot_file
from simrob_drake.importer.semantics import (
    NOTHING,
    Semantics,
    add_filters,
    read_semantics,
    srdf_of,
)
from simrob_drake.importer.trees import Notes, take_notes
from simrob_drake.robots.catalog import RobotModel, described_robot, load_robot_from_urdf
from simrob_drake.robots.grasps import GRASP, grasp_frame
from simrob_drake.robots.imports import REPORT_FILE, ImportOptions, ImportReport, read_report
from simrob_drake.robots.urdf import add_frame, name_of, with_absolute_meshes
from simrob_drake.robots.urdf_check import check_urdf

_LONGEST_NAME = 100
"""Largest count of characters of a robot's name in the name of its file. File systems refuse more than 255 bytes."""

_CODE = [Path(__file__).parents[1] / package for package in ("importer", "robots")]
"""Packages whose code decides the result of an import. A change of it imports the robots of the cache again."""


@dataclass(frozen=True)
class ImportedRobot:
    """Result of an import.

    Attributes:
        model: the robot, in its new folder.
        report: report of everything that was changed.
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

    The folder appears when all of its files are written. Nothing is written elsewhere.

    Args:
        source: a URDF or xacro file, another file that an importer reads, or a name of ``robot_descriptions``.
        folder: folder for the result.
        options: options of the import. If they are None, the defaults apply.
        force: whether to replace a former import in the folder.
        apart: whether to refuse a folder that overlaps the source's package. The cache is not checked: it is in the
            home folder, and the source may be there, too.
        isolated: whether Drake reads the result in a process of its own first. A defect that makes Drake end its
            process is then an error.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired. Nothing is written.
        InvalidParameter: the source or the folder is no path.
        UnknownName: ``robot_descriptions`` has no robot of the source's name, or the options name a joint, a link or a
            model that the robot does not have. Nothing is written.
        OutputError: the folder cannot be written or overlaps the source, or it exists and is not a former import that
            `force` allows to replace.
    """
    source = robot_file(source, "source")
    folder = as_path(folder, "folder")
    if apart and source.exists():
        _check_apart(source, folder)
    report = ImportReport(source)
    with filled_at_once(folder, marker=REPORT_FILE, force=force) as work:
        written = write_robot(source, work, options or ImportOptions(), report, isolated=isolated)
    # The model that was written has the path of the temporary folder, which has got its final name now.
    return ImportedRobot(load_robot_from_urdf(folder / written.urdf_path.name), report)


def examine_robot(source: Path | str, options: ImportOptions | None = None) -> ImportedRobot:
    """Import a robot into a temporary folder, which is deleted: the model and the report stay in memory.

    Args:
        source: file of the robot, see :func:`import_robot`.
        options: options of the import. If they are None, the defaults apply.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired.
        InvalidParameter: the source is no path.
        UnknownName: see :func:`import_robot`.
    """
    with tempfile.TemporaryDirectory(prefix="simrob-") as work:
        # No check for an overlap: the source may be in the folder that contains all temporary folders.
        examined = import_robot(source, Path(work) / "robot", options, apart=False)
        # The model reads its URDF at the first use, and keeps it. Afterwards the file would be gone.
        examined.model.element  # noqa: B018
    return examined


def write_robot(
    source: Path, work: Path, options: ImportOptions, report: ImportReport, *, isolated: bool = True
) -> RobotModel:
    """Fill a folder with the clean copy of a robot, see :func:`import_robot`.

    Args:
        source: file of the robot.
        work: the folder, which exists.
        options: options of the import.
        report: gets an entry for everything that is changed.
        isolated: whether Drake reads the result in a process of its own first.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired.
        UnknownName: the options name a joint, a link or a model that the robot does not have.
    """
    robot = _read_and_repair(source, work, options, report)
    # A robot.yaml of the source names the axes of the arm alone. With a hand, it does not describe the result.
    described = described_robot(source) if options.hand is None else None
    if described is not None and options.base == "auto":
        options = options.model_copy(update={"base": described.base})
    if options.hand is not None:
        add_hand(robot, _read_and_repair, work, options, report)
    if options.gripper:
        mark_jaw(robot, options.gripper, report)
    # The robot.yaml of a described robot contains the postures that an SRDF could add.
    semantics = read_semantics(source, robot, options, report) if described is None else NOTHING
    add_filters(robot, semantics)
    base = choose_base(robot, options, report)

    # Notes and loops are passed on in the robot, in attributes and elements that no URDF has: take them out first.
    notes = take_notes(robot)
    loops = {closing.name: closing.entry for closing in take_closings(robot)}
    check_urdf(robot, source)
    # A robot.yaml names its URDF, so the file of a described robot keeps its name.
    name = f"{_file_stem(robot.get('name') or source.stem)}.urdf"
    file = work / (name if described is None else source.name)
    _write_urdf(robot, file)
    # The probe comes before all that reads the robot into Drake here: some defects make Drake end the process.
    if isolated:
        probe(file, report)
    if described is None:
        _add_grasp_frame(robot, file, report)
    description = _description(described, file, base, notes, semantics, loops, report)
    (work / ROBOT_FILE).write_text(description, encoding="utf-8")
    # The report comes last, since the description adds entries to it.
    report_text = json.dumps(report.as_json(), indent=2, ensure_ascii=False) + "\n"
    (work / REPORT_FILE).write_text(report_text, encoding="utf-8")
    try:
        return load_robot_from_urdf(file)
    except InvalidConfig as problem:
        # Masses of 1e30 kg are a valid URDF, but the gains for them are above the largest that a servo accepts.
        where = compound("{robot_file} {key}", robot_file=ROBOT_FILE, key=problem.key)
        raise report.refusal(where, problem.problem) from problem


def _write_urdf(robot: ET.Element, file: Path) -> None:
    """Write a robot to a URDF file, with one element on a line."""
    ET.indent(robot)
    ET.ElementTree(robot).write(file, encoding="utf-8", xml_declaration=True)


def _add_grasp_frame(robot: ET.Element, file: Path, report: ImportReport) -> None:
    """Add the frame in which the fingers of a robot grasp, in place, and write the robot's file again.

    A robot stays as it is if it has no fingers, if no two of its fingers have shapes that close on each other, or if it
    has a link or frame of that name already.

    Args:
        robot: the robot.
        file: its URDF, which is written already: the shapes of the fingers are read from there.
        report: gets an entry for the frame.
    """
    found = grasp_frame(load_robot_from_urdf(file))
    names = map(name_of, (*robot.iterfind("link"), *robot.iterfind("frame")))
    if found is None or GRASP in names:
        return
    palm, pose = found
    add_frame(robot, GRASP, palm, pose)
    _write_urdf(robot, file)
    coordinates = [compound("{value:.4g}", value=value) for value in pose.translation()]
    report.add(
        "read",
        message("importer.frame_called", "frame '{name}'", name=GRASP),
        message(
            "importer.where_fingers_meet",
            "added where the fingers meet, at [{place}] m in '{palm}'. The fingers close along the y axis "
            "of the frame",
            place=join_texts(coordinates, " "),
            palm=palm,
        ),
    )


def _read_and_repair(
    source: Path, work: Path, options: ImportOptions, report: ImportReport
) -> ET.Element:
    """Read the robot of a file and repair it. Its meshes are written.

    Args:
        source: file of the robot.
        work: folder for the meshes.
        options: options of the import.
        report: gets an entry for each repair.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired.
        UnknownName: the options name a joint, a link or a model that the robot does not have.
    """
    robot = read_source(source, report, options)
    # The order matters: each repair relies on those before. Links and joints must form a tree before joints can be
    # repaired, inertias are estimated from the shapes, and efforts of drives follow from the masses.
    repair_structure(robot, options, report)
    repair_materials(robot, report)
    repair_joints(robot, options, report)
    import_shapes(robot, source=source, folder=work, options=options, report=report)
    repair_inertias(robot, work, options, report)
    repair_drives(robot, options, report)
    return robot


def default_folder(source: Path) -> Path:
    """Folder for an import whose user names none: in the working folder, with the name of the source.

    If the working folder is within the ROS package of the source (within the source's own folder if the source is in no
    package), it is next to that folder instead.
    """
    folder = Path(f"{source.stem}_imported")
    root = _source_root(source)
    return root.parent / folder if folder.resolve().is_relative_to(root) else folder


def _source_root(source: Path) -> Path:
    """Folder in which an import writes nothing: the ROS package of the source, or else the source's own folder."""
    package = package_root(source.resolve())
    return package if (package / MANIFEST).is_file() else source.resolve().parent


def _check_apart(source: Path, folder: Path) -> None:
    """Check that the folder of an import and the source's package do not contain each other.

    Raises:
        OutputError: one contains the other.
    """
    root = _source_root(source)
    target = folder.resolve()
    if target.is_relative_to(root) or root.is_relative_to(target):
        example = root.parent / f"{source.stem}_imported"
        raise OutputError(
            message(
                "importer.folder_within_source",
                "{folder} overlaps the source {root}; choose a folder outside of the source, such as {example}",
                folder=folder,
                root=root,
                example=example,
            )
        )


def _description(
    described: RobotModel | None,
    file: Path,
    base: Base,
    notes: Notes,
    semantics: Semantics,
    loops: Mapping[str, Mapping[str, Any]],
    report: ImportReport,
) -> str:
    """Text of the ``robot.yaml`` of an imported robot: that of the source, or else a draft.

    Args:
        described: robot of the source's ``robot.yaml``. None if the source has no such file.
        file: the URDF of the import.
        base: how the root is held.
        notes: home posture and servo gains that the source contains, for a draft.
        semantics: content of the SRDF, for a draft.
        loops: couplings that close loops of the robot, for a draft: entries by name.
        report: gets an entry for each value that a draft chooses, and for a base that the options change.
    """
    if described is None:
        robot = load_robot_from_urdf(file).model_copy(update={"base": base, "loops": loops})
        return draft(robot, notes, report, semantics)
    if described.base == base:
        # Unchanged, with the comments of its author.
        return text_of(described.folder / ROBOT_FILE)
    report.add(
        "repaired",
        ROBOT_FILE,
        message(
            "importer.base_as_asked",
            "base: {base}, as requested, instead of {file_base}",
            base=base,
            file_base=described.base,
        ),
    )
    content = described.model_copy(update={"base": base}).model_dump(
        mode="json", exclude={"folder"}, exclude_none=True
    )
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def _file_stem(name: str) -> str:
    """Name of a file, without suffix, for a robot of any name, such as ``../x y``."""
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:_LONGEST_NAME] or "robot"


def robot_from_file(path: Path | str, options: ImportOptions | None = None) -> RobotModel:
    """Load the robot of any file. A clean URDF is read where it is, other files are imported once, into the cache.

    A clean URDF is imported, too, if it needs more than a URDF can state: if it has fingers or an SRDF and no
    ``robot.yaml``. It is also imported if any option differs from its default, but those that only allow to read
    further folders.

    Args:
        path: the file, see :func:`import_robot`.
        options: options of the import. If they are None, the defaults apply.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired.
        InvalidParameter: the path is no path.
        UnknownName: see :func:`import_robot`.
        OutputError: the cache cannot be written.
    """
    path = robot_file(path, "path")
    # Options that only permit to read further folders change nothing of a clean URDF.
    if options is None or options == ImportOptions(
        mesh_path=options.mesh_path, packages=options.packages
    ):
        robot = _load_clean_robot(path)
        if robot is not None:
            return robot
    return _import_once(path, options or ImportOptions())


def _load_clean_robot(path: Path) -> RobotModel | None:
    """Load the robot of a file that needs no import. Returns None if an import has something to repair or to add."""
    try:
        robot = load_robot_from_urdf(path)
        # Drake reads fewer formats of meshes than the import. This checks them, the result is not needed.
        with_absolute_meshes(robot.element, robot.folder)
    except SimrobError:
        return None
    if described_robot(path) is not None:
        return robot
    # An import adds the frame in which fingers grasp, and what the SRDF states.
    has_more = robot.gripper is not None or srdf_of(path) is not None
    return None if has_more else robot


def import_summary(robot: RobotModel) -> str:
    """Counts of the changes that an import made to a robot, in one line. It is empty if the robot was not imported."""
    report = read_report(robot.folder)
    return "" if report is None else report.summary()


def _import_once(source: Path, options: ImportOptions) -> RobotModel:
    """Load an imported robot from the cache. If it is not there yet, the robot is imported now.

    Raises:
        InvalidModel: the robot has a defect that cannot be repaired.
        UnknownName: the options name a joint, a link or a model that the robot does not have.
        OutputError: the cache cannot be written.
    """
    folder = cache_entry("robots", made_of=_dependencies(source, options), made_by=_CODE)
    if read_report(folder) is None:
        # A report that exists and cannot be read is damaged: the entry is then replaced.
        is_damaged = (folder / REPORT_FILE).exists()
        try:
            import_robot(source, folder, options, force=is_damaged, apart=False)
        except OutputError:
            # Another process may have imported the same robot meanwhile. Its result is as good.
            if read_report(folder) is None:
                raise
    urdf = str(read_yaml(folder / ROBOT_FILE)["urdf"])
    return load_robot_from_urdf(folder / urdf)


def _dependencies(source: Path, options: ImportOptions) -> Iterator[bytes]:
    """Yield the contents on which the result of an import depends, or digests of them, apart from the program's code.

    The name of the source is not among them, so that equal files of different names share one entry of the cache. A
    robot without a name, which is named after its file, then has the name of the file that was imported first. Files
    that do not exist, and meshes that may not be read, are left out.
    """
    yield options.model_dump_json().encode()
    semantic = options.srdf or srdf_of(source)
    own_files = [
        file
        for file in (source, source.parent / ROBOT_FILE, semantic)
        if file is not None and isfile(file)
    ]
    # The robot as it is read contains what a xacro or SDF file includes: a change of an included file counts.
    robot = read_source(source, ImportReport(source), options)
    yield ET.tostring(robot)
    for file in (*own_files, *mesh_files(robot, source=source, options=options)):
        # A digest, and not the content: a mesh may be larger than the limit for files that are read at once.
        with open_regular(file) as content:
            yield hashlib.file_digest(content, "sha256").digest()
    if options.hand is not None:
        yield from _dependencies(options.hand, of_hand(options))
