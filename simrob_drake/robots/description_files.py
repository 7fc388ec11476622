"""The YAML files that describe robots: how to recognise such a file, and what to write into it."""

from os.path import isfile
from pathlib import Path

from simrob_drake.base.folders import is_cached
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import is_yaml_name, read_yaml
from simrob_drake.robots.catalog import RobotModel

_DESCRIPTION_KEYS = frozenset(("dh", "urdf", "axes"))
"""Keys of the description of a robot, none of which a station's file has at its top level."""


def is_description_file(text: str) -> bool:
    """Whether a text is the path of a YAML file that describes a robot, and not of one that describes a station.

    Raises:
        InvalidConfig: the file cannot be read.
    """
    # The text may be the name of a robot or of a station, or the path of a URDF. Only a YAML file is read.
    file = Path(text)
    if not is_yaml_name(file) or not isfile(file):
        return False
    return not _DESCRIPTION_KEYS.isdisjoint(read_yaml(file))


def gripper_advice(robot: RobotModel) -> str:
    """Write an advice for a robot without fingers, for error messages: how to declare its last joint as a jaw.

    A robot with a description file of its own gets a line for this file. Files of imported robots are in a cache, where
    users should not write; such a robot gets an option of the import, as does one without a description file.

    Args:
        robot: a robot without fingers.
    """
    # The best guess for a jaw is the last axis, since axes are listed from the base outward.
    jaw_axis = list(robot.axes)[-1]
    joint = robot.axes[jaw_axis].joint
    file = robot.description_file
    is_users_file = isfile(file) and not is_cached(file)
    if not is_users_file:
        entry = f"import_options: {{gripper: {joint}}}"
        return message(
            "robots.gripper_option",
            "if {joint} moves a jaw, write `{entry}` below urdf in the station, or import with --gripper {joint}",
            joint=joint,
            entry=entry,
        )
    # The limits of the last axis, in degrees or metres: a jaw is usually closed at one and open at the other.
    unit_size = robot.user_units[-1]
    lower, upper = robot.axis_limits
    lower_text = f"{float(lower[-1] / unit_size):.4g}"
    upper_text = f"{float(upper[-1] / unit_size):.4g}"
    entry = f"gripper: {{axes: {{{jaw_axis}: [{lower_text}, {upper_text}]}}}}"
    unit = robot.unit_names[-1]
    return message(
        "robots.gripper_entry",
        "if {axis} moves a jaw, write `{entry}`, its closed and open position [{unit}], into {file}",
        axis=jaw_axis,
        entry=entry,
        file=file,
        unit=unit,
    )
