"""The command that lists what comes with the package, which takes no more than reading its files."""

from collections.abc import Callable
from typing import Any

from simrob_drake.base.files import piece_files, robot_files, station_files
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.cli.screen import console, table


def list_all() -> None:
    """List the stations, robots and pieces that come with the package."""
    kinds = {"station": station_files(), "robot": robot_files(), "piece": piece_files()}
    for number, (kind, files) in enumerate(kinds.items()):
        rows = [(name, str(read_yaml(file).get("description", ""))) for name, file in files.items()]
        if number:
            console.print()
        console.print(table((kind, "description"), *rows, numbers=False))


COMMANDS: dict[str, Callable[..., Any]] = {"list": list_all}
