"""What can be taught: a station, a robot of the package on its usual station, or a robot of which there is a file."""

from itertools import count
from pathlib import Path

import yaml

from simrob_drake.errors import InvalidConfig, UnknownName
from simrob_drake.folders import written_at_once
from simrob_drake.programs.arm_program import ARM_ONLY
from simrob_drake.programs.program import Program
from simrob_drake.robots.catalog import RobotModel, load_robot, robot_names
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import station_names
from simrob_drake.yaml_files import YAML_SUFFIXES, parse_yaml, read_yaml

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml")
_PROGRAM = {"moves", "references"}
_USUAL = "{}_dynamic"


def station_for(subject: str | Path, folder: Path) -> tuple[str, str]:
    """Return what a subject is called, and its station: a name, or a file.

    A first station is drafted for a robot that has none, into ``folder``; there it stays, to be changed by its owner.

    Args:
        subject: a station's or a robot's name, or the file of a station or a robot.
        folder: for what is taught; what is of this subject is in a folder of its own there.

    Raises:
        UnknownName: nothing is called so; proposes the nearest.
        InvalidConfig: no such file.
        InvalidModel: a robot's file that cannot be imported.
    """
    name, file = str(subject), Path(subject)
    if name in station_names():
        return name, name
    if name in robot_names():
        usual = _USUAL.format(name)
        return (usual, usual) if usual in station_names() else (name, _drafted(load_robot(name), name, folder))
    suffix = file.suffix.lower()
    if suffix not in (*YAML_SUFFIXES, *ROBOT_SUFFIXES):
        raise UnknownName("station or robot", name, [*station_names(), *robot_names()])
    if not file.is_file():
        raise InvalidConfig(file, "", "there is no such file")
    if suffix in YAML_SUFFIXES:
        return file.stem, str(file.resolve())
    return _drafted_for(file, folder)


def program_of(subject: str | Path) -> tuple[Path, str] | None:
    """Return the file of a program that a subject is, and its station; None of any other subject.

    Raises:
        InvalidConfig: a damaged file, or a program that names no station.
    """
    file = Path(subject)
    if file.suffix.lower() not in YAML_SUFFIXES or not file.is_file() or _PROGRAM.isdisjoint(read_yaml(file)):
        return None
    station = Program.load(file).station
    if station is None:
        raise InvalidConfig(file, "station", "missing: the name or the file of the station that it is to run on")
    beside = file.parent / station
    return file, str(beside) if beside.is_file() else station


def goes_on_legs(model: RobotModel, program: Program) -> bool:
    """Tell whether a program is done by a :class:`~simrob_drake.LeggedRobot`, and not by the arms of a workcell."""
    legless = model.base == "fixed" and model.feet is None and bool(model.tools)
    return not legless and not any(isinstance(move, ARM_ONLY) for move in program.moves)


def _drafted_for(file: Path, folder: Path) -> tuple[str, str]:
    """Return what the station of a robot's file is called, and its file; robots of other files keep theirs."""
    for number in count(1):
        name = file.stem if number == 1 else f"{file.stem}-{number}"
        target = folder / name / f"{name}.yaml"
        if not target.is_file():
            written_at_once(target, draft_station(file, folder=target.absolute().parent))
        urdf = read_yaml(target).get("robot", {}).get("urdf", "")
        if (target.parent / urdf).resolve() == file.resolve():
            return name, str(target.resolve())
    raise AssertionError("numbers do not end")


def _drafted(model: RobotModel, name: str, folder: Path) -> str:
    target = folder / name / f"{name}.yaml"
    if not target.is_file():
        content = parse_yaml(draft_station(model.urdf_path), name)
        content["robot"] = {"model": name}  # which brings its gains, and where it stands at first
        del content["servo"]
        content |= {"description": model.description, "reference": {"kind": "hold"}}
        written_at_once(target, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120))
    return str(target.resolve())
