"""The command that lists the stations, robots and pieces of the package and of its extensions.

It only reads the names and descriptions in their files. No robot is loaded, which would take long.
"""

from collections.abc import Callable, Mapping
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
    _list_files("station", message("cli.station", "station"), station_files())
    console.print()
    _list_files("robot", message("cli.robot", "robot"), robot_files())
    console.print()
    _list_files("piece", message("cli.piece", "piece"), piece_files())


def _list_files(kind: str, heading: Message, files: Mapping[str, Path]) -> None:
    """Show a table of names and descriptions.

    Args:
        kind: "station", "robot" or "piece". It is a part of the ids of the translated descriptions.
        heading: heading of the names.
        files: file of each station, robot or piece, by name.
    """
    rows = [(name, _description(kind, name, file)) for name, file in files.items()]
    headings = (heading, message("cli.description", "description"))
    # The table translates the descriptions, which are messages.
    console.print(table(headings, *rows, numbers=False))


def _description(kind: str, name: str, file: Path) -> Message:
    """Read the description of a station, robot or piece from its file. Returns an empty message if it has none.

    Args:
        kind: "station", "robot" or "piece".
        name: name of the station, robot or piece. Its translations are found by kind and name.
        file: its YAML file.
    """
    # Only the file is read. Making a station of it would load its robots.
    english = str(read_yaml(file).get("description", ""))
    return description_message(kind, name, english)


COMMANDS: dict[str, Callable[..., Any]] = {"list": list_all}
