"""What can be taught: a station, a robot on its usual one, or one of which there is a file."""

from itertools import count
from os.path import isfile  # which is false for names that no file can have
from pathlib import Path

import yaml

from simrob_drake.base.errors import InvalidConfig, UnknownName
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import is_yaml_name, parse_yaml, read_yaml
from simrob_drake.importer.robot_files import is_robot_file, robot_file
from simrob_drake.programs.program import Program
from simrob_drake.programs.program_files import is_program_file
from simrob_drake.robots.catalog import RobotModel, load_robot, robot_names
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.file_paths import station_with_absolute_path
from simrob_drake.stations.load import station_names

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
        return (
            (usual, usual)
            if usual in station_names()
            else (name, _drafted(load_robot(name), name, folder))
        )
    is_yaml = is_yaml_name(file)
    if is_yaml and isfile(file):
        return file.stem, str(file.resolve())
    if not is_yaml and not is_robot_file(name):
        raise UnknownName(
            message("pendant.station_or_robot", "station or robot"),
            name,
            [*station_names(), *robot_names()],
        )
    if is_yaml or not isfile(robot_file(file, "subject")):
        raise InvalidConfig(file, "", message("pendant.no_such_file", "there is no such file"))
    return _drafted_for(robot_file(file, "subject"), folder)


def program_of(subject: str | Path) -> tuple[Path, str] | None:
    """Return the file of a program that a subject is, and its station; None of any other subject.

    Raises InvalidConfig: a damaged file, or a program that names no station.
    """
    file = Path(subject)
    if not is_program_file(file):
        return None
    station = Program.load(file).station
    if station is None:
        raise InvalidConfig(
            file,
            "station",
            message(
                "pendant.missing_station",
                "missing: the name or the file of the station that it is to run on",
            ),
        )
    return file, station_with_absolute_path(station, file)


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
        start = {
            key: value for key, value in content["robot"].items() if key in ("base", "initial_deg")
        }
        content["robot"] = {"model": name, **start}  # which brings its gains
        if servo := content.pop("servo", None):
            content["servo"] = {"realization": servo["realization"]}
        content |= {"description": model.description, "reference": {"kind": "hold"}}
        written_at_once(
            target, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
        )
    return str(target.resolve())
