"""The command that lists what comes with the package, which takes no more than reading its files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from simrob_drake.base.files import description_message, piece_files, robot_files, station_files
from simrob_drake.base.messages import Message, message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.cli.language import with_output_language
from simrob_drake.cli.screen import console, table


@with_output_language
def list_all() -> None:
    """List the stations, robots and pieces that come with the package."""
    kinds = {
        "station": (message("cli.station", "station"), station_files()),
        "robot": (message("cli.robot", "robot"), robot_files()),
        "piece": (message("cli.piece", "piece"), piece_files()),
    }
    for index, (kind, (title, files)) in enumerate(kinds.items()):
        if index:
            console.print()
        rows = [(name, _description(kind, name, file)) for name, file in files.items()]
        console.print(table((title, message("cli.description", "description")), *rows, numbers=False))


def _description(kind: str, name: str, file: Path) -> Message:
    """Description of a station, robot or piece, from its file. Other languages have it by kind and name."""
    return description_message(kind, name, str(read_yaml(file).get("description", "")))


COMMANDS: dict[str, Callable[..., Any]] = {"list": list_all}
