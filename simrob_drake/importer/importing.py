"""Import a robot: from any published URDF to a folder that a station can name, or to a cache, keyed by content."""

import hashlib
import json
import math
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.base.arguments import as_path
from simrob_drake.base.constants import LARGEST_GAIN, STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError, list_names
from simrob_drake.base.files import ROBOT_FILE, open_regular, text_of
from simrob_drake.base.folders import cache_entry, filled_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.packages import MANIFEST, package_root
from simrob_drake.base.yaml_files import read_yaml
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
    HOME_STATE,
    NOTHING,
    Semantics,
    add_filters,
    described_by,
    read_semantics,
    srdf_of,
)
from simrob_drake.importer.trees import HOME, KD, KP, Notes, take_notes
from simrob_drake.robots.catalog import RobotModel, described_robot, load_robot_from_urdf
from simrob_drake.robots.grasps import GRASP, grasp_frame
from simrob_drake.robots.imports import REPORT_FILE, ImportOptions, ImportReport, read_report
from simrob_drake.robots.parse import lone_robot
from simrob_drake.robots.urdf import add_frame, name_of, with_absolute_meshes
from simrob_drake.robots.urdf_check import check_urdf

_HEADER = """\
# Draft of an import; edit it freely.
# axes: the joints in the order of every vector; rename an axis as `elbow: {joint: joint_3, sign: -1}`.
# gripper: where its fingers are closed and open, in deg, or m of those that slide.
# tools: frames of the URDF whose pose a station can follow; the first is where pieces are attached.
"""


_FINGERS = (
    message(
        "importer.is_moving_jaw",
        "is the moving jaw of a hand, closed where it is nearest to the fixed one",
    ),
    message("importer.are_fingers", "are fingers, closed where they are nearest to each other"),
)
_LONGEST = 100  # letters of a robot's name that its file keeps


@dataclass(frozen=True)
class ImportedRobot:
    """What an import made."""

    model: RobotModel  # the robot, in its new folder
    report: ImportReport  # all that was done to it


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

    The source is a URDF or xacro file, or a name of ``robot_descriptions``. The folder appears at once, when everything
    is in it, and nothing is written elsewhere; ``force`` replaces an import that is there, ``apart`` refuses a folder
    within the source, as a cache may well lie below the same home; ``isolated`` lets Drake read the result in a process
    of its own first. Raises InvalidModel: a defect that can't be repaired; nothing is written; OutputError: the folder
    cannot be written, exists, or lies within the source.
    """
    source, folder = robot_file(source, "source"), as_path(folder, "folder")
    if apart and source.exists():
        _check_apart(source, folder)
    report = ImportReport(source)
    with filled_at_once(folder, marker=REPORT_FILE, force=force) as work:
        made = write_robot(source, work, options or ImportOptions(), report, isolated=isolated)
    return ImportedRobot(load_robot_from_urdf(folder / made.urdf_path.name), report)


def examine_robot(source: Path | str, options: ImportOptions | None = None) -> ImportedRobot:
    """Do all that an import does, leaving nothing but figures; raises InvalidModel: a defect that can't be repaired."""
    with tempfile.TemporaryDirectory(prefix="simrob-") as work:
        made = import_robot(source, Path(work) / "robot", options, apart=False)
        made.model.element  # noqa: B018  # read while the file is there
    return made


def write_robot(
    source: Path, work: Path, options: ImportOptions, report: ImportReport, *, isolated: bool = True
) -> RobotModel:
    """Fill a folder with the clean robot as :func:`import_robot` does; raises InvalidModel: what can't be repaired."""
    robot = _repaired(source, work, options, report)
    described = described_robot(source) if options.hand is None else None
    if described is not None and options.base == "auto":
        options = options.model_copy(update={"base": described.base})
    if options.hand is not None:
        add_hand(robot, _repaired, work, options, report)
    if options.gripper:
        mark_jaw(robot, options.gripper, report)
    semantics = read_semantics(source, robot, options, report) if described is None else NOTHING
    add_filters(robot, semantics)
    base = choose_base(robot, options, report)
    notes = take_notes(robot)
    loops = {closing.name: closing.entry for closing in take_closings(robot)}
    check_urdf(robot, source)
    file = work / (
        source.name if described is not None else f"{_plain(robot.get('name') or source.stem)}.urdf"
    )
    _write(robot, file)
    if isolated:
        probe(file, report)
    if described is None:
        _add_grasp(robot, file, report)
    (work / ROBOT_FILE).write_text(
        _description(described, file, base, notes, semantics, loops, report), encoding="utf-8"
    )
    (work / REPORT_FILE).write_text(
        json.dumps(report.as_json(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    try:
        return load_robot_from_urdf(file)
    except (
        InvalidConfig
    ) as problem:  # figures that nothing has, such as gains for masses of 1e30 kg
        raise report.refusal(
            compound("{robot_file} {key}", robot_file=ROBOT_FILE, key=problem.key), problem.problem
        ) from problem


def _write(robot: ET.Element, file: Path) -> None:
    ET.indent(robot)
    ET.ElementTree(robot).write(file, encoding="utf-8", xml_declaration=True)


def _add_grasp(robot: ET.Element, file: Path, report: ImportReport) -> None:
    """Add the frame in which the fingers of a robot, written already, grasp, unless it has one of that name."""
    found = grasp_frame(load_robot_from_urdf(file))
    if found is None or GRASP in map(name_of, (*robot.iterfind("link"), *robot.iterfind("frame"))):
        return
    palm, pose = found
    add_frame(robot, GRASP, palm, pose)
    _write(robot, file)
    coordinates = [compound("{value:.4g}", value=value) for value in pose.translation()]
    report.add(
        "read",
        message("importer.frame_called", "frame '{name}'", name=GRASP),
        message(
            "importer.where_fingers_meet",
            "where the fingers meet, at {place} m of '{palm}'; they close along its y",
            place=join_texts(coordinates, " "),
            palm=palm,
        ),
    )


def _repaired(source: Path, work: Path, options: ImportOptions, report: ImportReport) -> ET.Element:
    """Return the robot of a file after all repairs, in the order in which they stand on each other; meshes are written.

    Raises InvalidModel: a defect that can't be repaired.
    """
    robot = read_source(source, report, options)
    repair_structure(robot, options, report)
    repair_materials(robot, report)
    repair_joints(robot, options, report)
    import_shapes(robot, source=source, folder=work, options=options, report=report)
    repair_inertias(robot, work, options, report)
    repair_drives(robot, options, report)
    return robot


def default_folder(source: Path) -> Path:
    """Return where an import is written unless its user says so: here, or beside the source where this lies in it."""
    folder, root = Path(f"{source.stem}_imported"), _source_root(source)
    return root.parent / folder if folder.resolve().is_relative_to(root) else folder


def _source_root(source: Path) -> Path:
    """Return the folder that an import leaves alone: the package of a file, or at least its own."""
    package = package_root(source.resolve())
    return package if (package / MANIFEST).is_file() else source.resolve().parent


def _check_apart(source: Path, folder: Path) -> None:
    root, target = _source_root(source), folder.resolve()
    if target.is_relative_to(root) or root.is_relative_to(target):
        example = root.parent / f"{source.stem}_imported"
        raise OutputError(
            message(
                "importer.folder_within_source",
                "{folder} lies within the source {root}; choose a folder outside of it, such as {example}",
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
    """Text of the robot.yaml of an imported robot: its own if it has one, else a draft with the loops found."""
    if described is None:
        robot = load_robot_from_urdf(file).model_copy(update={"base": base, "loops": loops})
        return draft(robot, notes, report, semantics)
    if described.base == base:
        return text_of(described.folder / ROBOT_FILE)
    report.add(
        "repaired",
        ROBOT_FILE,
        message(
            "importer.base_as_asked",
            "base: {base} instead of {file_base}, as asked",
            base=base,
            file_base=described.base,
        ),
    )
    content = described.model_copy(update={"base": base}).model_dump(
        mode="json", exclude={"folder"}, exclude_none=True
    )
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def _plain(name: str) -> str:
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:_LONGEST] or "robot"


def draft(
    robot: RobotModel, notes: Notes, report: ImportReport, semantics: Semantics = NOTHING
) -> str:
    """Return the text of a ``robot.yaml`` for an imported robot; its home posture and gains are added to the report."""
    units = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
    home = {
        axis: float(f"{value / units[axis]:.6g}")
        for axis, value in notes.get(HOME, {}).items()
        if value
    }
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
    if home:
        content["home_deg"] = home
    elif isinstance(robot.home_deg, dict) and HOME_STATE not in semantics.states:
        content["home_deg"] = robot.home_deg
        midway = ", ".join(
            axis for axis in robot.home_deg if not robot.gripper or axis not in robot.gripper.axes
        )
        if midway:
            report.add(
                "defaulted",
                "robot.yaml",
                message(
                    "importer.start_midway",
                    "zero is outside of the limits of {axes}: they start midway",
                    axes=midway,
                ),
            )
    if robot.gripper is not None:
        content["gripper"] = robot.gripper.model_dump(mode="json", exclude_none=True)
        names = ", ".join(robot.gripper.axes)
        report.add(
            "read",
            "robot.yaml",
            message(
                "importer.fingers_open_at_start",
                "{names} {fingers}, open at the start",
                names=names,
                fingers=_FINGERS[len(robot.gripper.axes) > 1],
            ),
        )
    if robot.loops:
        content["loops"] = {name: dict(entry) for name, entry in robot.loops.items()}
    content |= described_by(semantics, robot, report)
    if not robot.links_without_inertia:
        gains = vars(first_gains(robot)).items()
        made = {key: dict(zip(robot.axes, values.tolist(), strict=True)) for key, values in gains}
        own = {key: dict(notes.get(note, {})) for key, note in (("kp", KP), ("kd", KD))}
        content["servo"] = {key: values | own[key] for key, values in made.items()}
        if own["kp"]:
            report.add(
                "read",
                "robot.yaml",
                message(
                    "importer.gains_of_actuators",
                    "servo gains of {count} axes are those of the file's actuators",
                    count=len(own["kp"]),
                ),
            )
        if len(own["kp"]) < np.count_nonzero(~robot.passive):
            report.add(
                "defaulted",
                "robot.yaml",
                message("importer.gains_of_mass_matrix", "servo gains from the mass matrix"),
            )
        _report_stiff_joints(robot, made["kp"], report)
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
    )
    return _HEADER + text


def _report_stiff_joints(robot: RobotModel, kp: Mapping[str, float], report: ImportReport) -> None:
    """Report the axes whose joints are so heavily damped that no servo moves them.

    Args:
        robot: the imported robot.
        kp: proportional gain that the import has chosen for each axis, by name. It grows with the damping of the joint,
            up to LARGEST_GAIN.
        report: report of the import.
    """
    held = [axis for axis in robot.axes if kp[axis] >= LARGEST_GAIN]
    if held:
        text = message(
            "importer.no_servo_moves",
            "no servo moves {held}: the damping of the joint is too large. Make the joint fixed",
            held=list_names(held),
        )
        report.add(
            "approximated",
            "robot.yaml",
            message("importer.if_not_to_move", "{text} if it is not to move", text=text),
        )


_CODE = [Path(__file__).parents[1] / room for room in ("importer", "robots")]


def robot_from_file(path: Path | str, options: ImportOptions | None = None) -> RobotModel:
    """Return the robot of any URDF: read as it is if it is clean, imported once if it is not, or if options ask for it.

    One with fingers or an SRDF is imported, too, unless it is described: where they grasp, and what it says, counts.
    Raises InvalidModel: a defect that no import can repair; OutputError: the cache cannot be written.
    """
    path = robot_file(path, "path")
    if options is None or options == ImportOptions(
        mesh_path=options.mesh_path, packages=options.packages
    ):
        try:
            robot = load_robot_from_urdf(path)
            with_absolute_meshes(robot.element, robot.folder)
        except SimrobError:
            pass
        else:
            if described_robot(path) is not None or (
                robot.gripper is None and srdf_of(path) is None
            ):
                return robot
    return _imported_once(path, options or ImportOptions())


def import_summary(robot: RobotModel) -> str:
    """Return what an import did to a robot, in one line; empty if it was not imported."""
    return _summary(robot.folder)


def _summary(folder: Path) -> str:
    """The summary of the import in a folder; empty if there is none."""
    report = read_report(folder)
    return "" if report is None else report.summary()


def _imported_once(source: Path, options: ImportOptions) -> RobotModel:
    folder = cache_entry("robots", made_of=_dependencies(source, options), made_by=_CODE)
    if not _summary(folder):
        try:
            import_robot(
                source, folder, options, force=(folder / REPORT_FILE).exists(), apart=False
            )
        except OutputError:
            if not _summary(folder):  # else another process was quicker
                raise
    urdf = str(read_yaml(folder / ROBOT_FILE)["urdf"])
    return load_robot_from_urdf(folder / urdf)


def _dependencies(source: Path, options: ImportOptions) -> Iterator[bytes]:
    """Yield all that the result depends on, but for our code; the file's own name is no part of it."""
    yield options.model_dump_json().encode()
    semantic = options.srdf or srdf_of(source)
    own_files = [
        file
        for file in (source, source.parent / ROBOT_FILE, semantic)
        if file is not None and isfile(file)
    ]
    robot = read_source(source, ImportReport(source), options)
    yield ET.tostring(robot)  # of a xacro with all that it includes
    for file in (*own_files, *mesh_files(robot, source=source, options=options)):
        with open_regular(file) as content:  # meshes may be larger than what is read of them
            yield hashlib.file_digest(content, "sha256").digest()
    if options.hand is not None:
        yield from _dependencies(options.hand, of_hand(options))


_FREQUENCY = 30.0  # rad/s; an arm of 0.8 kg m² gets the 700 N·m/rad that are usual for it
_SAG = (
    math.radians(1.0),
    1e-3,
)  # what an axis may give way under gravity [rad], and one that slides [m]
_OFF = math.radians(30.0)  # where axes that carry fingers give all they have
_PRESSES = 0.1  # part of their way from which fingers press with all they have
_LIGHTEST = (
    1e-9  # a milligram at an arm of 30 mm: what files say below that was rounded [kg m² or kg]
)
_POSTURES = 20


@dataclass(frozen=True)
class FirstGains:
    """Proportional [N·m/rad] and derivative [N·m·s/rad] gain of every axis, each of shape (n,)."""

    kp: Vector
    kd: Vector


def gains_of(robot: RobotModel) -> FirstGains:
    """Return the gains that a robot brings along if it does, else first ones."""
    kp, kd = robot.servo.kp, robot.servo.kd
    if kp is None or kd is None:
        return first_gains(robot)
    return FirstGains(robot.axis_vector(kp, "servo.kp"), robot.axis_vector(kd, "servo.kd"))


def first_gains(robot: RobotModel) -> FirstGains:
    """Return gains that hold a robot up and move it without overshoot; every link of it that moves has an inertia.

    With m the largest inertia that an axis meets over some postures, all others at rest, τ the largest torque of
    gravity and b the damping of its joint, kp = max(ω² m, ω b, τ / sag) with ω = 30 rad/s and a sag of 1 deg or 1 mm.
    Axes pull at each other: where all had the same kp / m, the modes of the mass matrix M would be those of
    diag(m)^-½ M diag(m)^-½, and the largest of its eigenvalues λ the one that swings most. kd = 2 √(λ kp m) damps it
    critically.

    A robot that is not fixed stands on some of its joints, so that each may feel the whole mass at half of the robot's
    height. Fingers press with all that their motors have from a tenth of their way before they are closed, and axes of
    an arm with fingers, which will carry more than itself, give all they have 30 deg off. Gains of passive axes are 0.
    """
    load = _load(robot)
    stiffness = load.torques / np.where(robot.prismatic, _SAG[1], _SAG[0])
    if robot.fingers:
        stiffness = np.where(
            robot.prismatic, stiffness, np.maximum(stiffness, robot.efforts / _OFF)
        )
    for place, ends in robot.fingers.items():
        stiffness[place] = max(
            stiffness[place], robot.efforts[place] / (_PRESSES * abs(ends[1] - ends[0]))
        )
    # Some files hold a joint by an immense damping, such as 1e11 N·s/m: a servo does not move it with any gain.
    for_damping = np.minimum(_FREQUENCY * load.dampings, LARGEST_GAIN)
    kp = np.maximum(stiffness, np.maximum(_FREQUENCY * (_FREQUENCY * load.inertias), for_damping))
    kd = 2 * np.sqrt(load.coupling * kp * load.inertias)
    return FirstGains(
        kp=np.where(robot.passive, 0.0, _rounded(kp)),
        kd=np.where(robot.passive, 0.0, _rounded(kd)),
    )


@dataclass(frozen=True)
class _Load:
    """What n axes have to move and to hold, each of shape (n,): the largest of some postures."""

    inertias: Vector  # all other axes at rest [kg m² or kg], positive
    torques: Vector  # of gravity [N·m or N]
    dampings: Vector  # of the joints themselves [N·m·s/rad or N·s/m]
    coupling: float  # the largest eigenvalue of the mass matrix, scaled by the inertias; 1 where nothing is coupled


def _load(robot: RobotModel) -> _Load:
    lone = lone_robot(robot, floating=robot.base == "floating", collision=False)
    plant, context, places = (
        lone.plant,
        lone.plant.CreateDefaultContext(),
        lone.axes.velocity_places,
    )
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in robot.axis_limits)
    random = np.random.default_rng(0)
    masses, torques = [], np.zeros(len(lone.joints))
    for posture in (robot.home, *random.uniform(lower, upper, (_POSTURES, len(lone.joints)))):
        lone.axes.set_positions(plant, context, posture)
        masses.append(plant.CalcMassMatrix(context)[np.ix_(places, places)])
        torques = np.maximum(
            torques, np.abs(lone.axes.efforts(plant.CalcGravityGeneralizedForces(context)))
        )
    inertias = np.maximum(np.max([np.diag(mass) for mass in masses], axis=0), _LIGHTEST)
    if robot.base == "floating":
        mass, half = plant.CalcTotalMass(context), lone.size / 2
        inertias, torques = (
            np.maximum(inertias, mass * half**2),
            np.maximum(torques, mass * STANDARD_GRAVITY * half),
        )
    scale = np.sqrt(np.outer(inertias, inertias))
    coupling = max(float(np.linalg.eigvalsh(mass / scale)[-1]) for mass in masses)
    dampings = np.array([joint.default_damping_vector()[0] for joint in lone.joints])
    return _Load(inertias, torques, dampings, max(coupling, 1.0))


def _rounded(values: Vector) -> Vector:
    return np.array([float(f"{value:.2g}") for value in values])
