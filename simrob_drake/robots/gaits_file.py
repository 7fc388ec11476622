"""The file `gaits.yaml` beside a robot's `robot.yaml`: all by which it walks, a section for each kind of gait."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.files import robot_files
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, validated
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.catalog import RobotModel, robot_names

GAITS_FILE = "gaits.yaml"


class _Head(BaseModel):
    """What all gaits of a robot have in common."""

    model_config = ConfigDict(extra="ignore")

    facing_deg: Number


@dataclass(frozen=True)
class GaitsFile:
    """A robot's gaits as their file has them; each section is checked by those who know it."""

    file: Path  # where they stand
    facing_deg: float  # where the robot looks while its root is not turned, counterclockwise from the world's x [deg]
    content: Mapping[str, Any]  # all of the file

    @property
    def sections(self) -> list[str]:
        """The names of its sections."""
        return [name for name, value in self.content.items() if isinstance(value, Mapping)]

    def section(self, name: str) -> Mapping[str, Any]:
        """Return a section, empty where the file has none."""
        found = self.content.get(name)
        return found if isinstance(found, Mapping) else {}


def gaits_file(robot: str | RobotModel) -> GaitsFile:
    """Return the gaits beside the ``robot.yaml`` of a robot of the package by name, or of any other's model.

    Raises UnknownName: no such robot, proposes the nearest; InvalidParameter: one without gaits; InvalidConfig: a file
    that cannot be read.
    """
    name = one_of(message("base.robot", "robot"), robot, robot_names()) if isinstance(robot, str) else robot.name
    folder = robot_files()[name].parent if isinstance(robot, str) else robot.folder
    file = folder / GAITS_FILE
    if not file.is_file():
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=name),
            message("robots.robot_without_gaits", "one without gaits"),
            message("robots.robot_with_gaits_file", "one with a file {file}", file=GAITS_FILE),
        )
    content = read_yaml(file)
    return GaitsFile(file, validated(_Head, content, file).facing_deg, content)
