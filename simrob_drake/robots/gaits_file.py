"""The file `gaits.yaml` of a robot, with the parameters of its gaits: one section for each kind of gait.

The file is in the same folder as the robot's `robot.yaml`. This module reads it and leaves the content of the sections
to the modules that use them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.files import robot_files
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, validate_section
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.catalog import RobotModel, robot_names

GAITS_FILE = "gaits.yaml"
"""Name of the file."""


class _Head(BaseModel):
    """The keys that all gaits of a robot share. Sections of single gaits are ignored."""

    model_config = ConfigDict(extra="ignore")

    facing_deg: Number


@dataclass(frozen=True)
class GaitsFile:
    """The content of a robot's file of gaits. Its sections are not checked yet.

    Attributes:
        file: path of the file.
        facing_deg: direction in which the robot looks while its root is not turned, counterclockwise from the world's
            x axis [deg].
        content: the whole content.
    """

    file: Path
    facing_deg: float
    content: Mapping[str, Any]

    @property
    def sections(self) -> list[str]:
        """Names of the sections: the keys of the file whose values are mappings."""
        return [name for name, value in self.content.items() if isinstance(value, Mapping)]

    def section(self, name: str) -> Mapping[str, Any]:
        """Return the content of a section. It is empty if the file has no such section."""
        found = self.content.get(name)
        return found if isinstance(found, Mapping) else {}


def gaits_file(robot: str | RobotModel) -> GaitsFile:
    """Read the file of gaits of a robot.

    Args:
        robot: name of a robot of the package or of an extension, or the model of any robot.

    Raises:
        UnknownName: there is no robot of this name.
        InvalidParameter: the robot has no file of gaits.
        InvalidConfig: the file cannot be read, or ``facing_deg`` is missing or wrong.
    """
    # A name needs only the folder: the model itself, with its meshes and checks, is not loaded.
    if isinstance(robot, str):
        name = one_of(message("base.robot", "robot"), robot, robot_names())
        folder = robot_files()[name].parent
    else:
        name = robot.name
        folder = robot.folder
    file = folder / GAITS_FILE
    if not file.is_file():
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=name),
            message("robots.robot_without_gaits", "a robot without gaits"),
            message("robots.robot_with_gaits_file", "a robot with a file {file}", file=GAITS_FILE),
        )
    # The sections are checked by the modules that use them, each by its own model.
    content = read_yaml(file)
    head = validate_section(_Head, content, file)
    return GaitsFile(file=file, facing_deg=head.facing_deg, content=content)
