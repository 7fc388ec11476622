"""From a URDF to a model instance of a plant, with Drake's complaints as errors that name the file."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from simrob_drake.errors import InvalidModel
from simrob_drake.robots.bodies import merge_fixed_links
from simrob_drake.robots.urdf import drop_collision


def add_urdf(
    plant: MultibodyPlant, robot: ET.Element, *, name: str, where: Path | str, collision: bool = True
) -> ModelInstanceIndex:
    """Add a robot to a plant, links that are rigidly joined as one body; each keeps a frame of its name.

    Args:
        plant: the plant, not finalized.
        robot: the ``robot`` element, checked, with absolute mesh names; it is not changed.
        name: what stands before the model's own name.
        where: the file, for messages.
        collision: keep the collision geometry.

    Returns:
        the model instance of the robot.

    Raises:
        InvalidModel: Drake cannot read the robot.
    """
    reduced = deepcopy(robot)
    if not collision:
        drop_collision(reduced)
    for actuator in reduced.iterfind("transmission/actuator"):
        for gear in actuator.findall("mechanicalReduction"):  # Drake does not heed it, and says so of each
            actuator.remove(gear)
    merge_fixed_links(reduced)
    parser = Parser(plant, model_name_prefix=name)
    try:
        return parser.AddModelsFromString(ET.tostring(reduced, encoding="unicode"), "urdf")[0]
    except (RuntimeError, ValueError, SystemExit) as problem:  # failed assertions come as SystemExit
        said = re.sub(r"<literal-string>\S*:\d+: (error: )?", "", " ".join(str(problem).split()))
        raise InvalidModel(where, "", f"Drake cannot read it: {said}") from problem
