"""The YAML files that describe robots: which files they are, and what to write into them."""

from os.path import isfile
from pathlib import Path

from simrob_drake.folders import is_cached
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.yaml_files import YAML_SUFFIXES, read_yaml

_DESCRIPTION_KEYS = frozenset(("dh", "urdf", "axes"))  # of robots, which no station has at its top


def is_description_file(text: str) -> bool:
    """Whether a text is the path of a YAML file that describes a robot, not a station.

    Raises:
        InvalidConfig: the file cannot be read.
    """
    file = Path(text)
    if file.suffix.lower() not in YAML_SUFFIXES or not isfile(file):
        return False
    return not _DESCRIPTION_KEYS.isdisjoint(read_yaml(file))


def gripper_advice(robot: RobotModel) -> str:
    """What to write, and where, so that a robot without fingers has some; for error messages."""
    last = list(robot.axes)[-1]
    joint = robot.axes[last].joint
    lower, upper = (float(limit[-1] / robot.user_units[-1]) for limit in robot.axis_limits)
    file = robot.description_file
    if isfile(file) and not is_cached(file):
        line = f"gripper: {{axes: {{{last}: [{lower:.4g}, {upper:.4g}]}}}}"
        return f"for a moving jaw {last} write `{line}` into {file}: closed and open [{robot.unit_names[-1]}]"
    line = f"import_options: {{gripper: {joint}}}"
    return f"for a moving jaw {joint} write `{line}` below urdf in the station, or import with --gripper {joint}"
