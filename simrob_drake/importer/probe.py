"""Parse an imported robot in Drake for the first time, in a process of its own.

Some defects of a file make Drake end the process. Here this ends a child process only, and becomes an error. Repairs
and checks come before, so the probe finds the defects that they do not know. ``python -m simrob_drake.importer.probe
FILE`` builds the robot and exits with 0, or prints what Drake says and exits with 1.
"""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path
from typing import NamedTuple

from simrob_drake.base.errors import SimrobError, shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.robots.imports import ImportReport

_SUSPECTS = ("visual", "collision", "inertial", "limit", "dynamics", "axis")
"""Tags of the elements, of links and joints, that may be the cause if Drake cannot build a robot."""

_TIMEOUT = 120.0
"""Time after which the child process is ended [s]. A robot with hundreds of meshes needs less."""


class _Place(NamedTuple):
    """Place of an element in a robot.

    Attributes:
        owner: index of the link or joint in the ``robot`` element.
        part: index of the element in the link or joint.
    """

    owner: int
    part: int


def probe(file: Path, report: ImportReport) -> None:
    """Build a robot in Drake, in a child process.

    Args:
        file: the URDF.
        report: report of the import, whose file the error names.

    Raises:
        InvalidModel: Drake refuses the robot, or ends the process. The error names the element that is the cause, if a
            single element is.
    """
    drake_error = _drake_error(file)
    if drake_error is None:
        return
    raise report.refusal(
        _culprit(file),
        message(
            "importer.drake_cannot_build",
            "Drake cannot build the robot: {complaint}",
            complaint=drake_error,
        ),
    )


def _drake_error(file: Path) -> str | None:
    """Return the reason why a robot cannot be built, or None if Drake can build it.

    The reason is an error of Drake or of the reader of robots, or that the process ends or takes too long.
    """
    # With -P, modules in the user's folder do not take the place of others.
    command = [sys.executable, "-P", "-m", "simrob_drake.importer.probe", str(file)]
    try:
        child = subprocess.run(
            command, capture_output=True, text=True, timeout=_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return message(
            "importer.takes_longer",
            "the process takes longer than {patience:g} s",
            patience=_TIMEOUT,
        )
    if child.returncode == 0:
        return None
    # An error that Python catches is on the standard output. One with which Drake ends the process is in its log.
    lines = (child.stdout.strip() or child.stderr.strip()).splitlines()
    if not lines:
        return message(
            "importer.ended_with_code", "the process ended with code {code}", code=child.returncode
        )
    # The last line is the error, after warnings. The file's name is removed, since the error of the import names it.
    return shorten(lines[-1].removeprefix(f"{file}: "), 300)


def _culprit(file: Path) -> str:
    """Find the element that is the cause: without it, Drake can build the robot. The search halves the suspects.

    Returns:
        the element in words, such as ``link 'arm' <inertial>``; empty if no single element is the cause.
    """
    robot = ET.parse(file).getroot()
    suspects = []
    for owner_index, owner in enumerate(robot):
        for part_index, part in enumerate(owner):
            if part.tag in _SUSPECTS:
                suspects.append(_Place(owner_index, part_index))
    # If Drake cannot build the robot without all suspects either, the cause is somewhere else.
    if not suspects or not _can_build_without(file, robot, suspects):
        return ""
    # Halving: a robot of a thousand elements needs about twenty builds at most.
    while len(suspects) > 1:
        middle = len(suspects) // 2
        first_half = suspects[:middle]
        second_half = suspects[middle:]
        if _can_build_without(file, robot, first_half):
            suspects = first_half
        elif _can_build_without(file, robot, second_half):
            suspects = second_half
        else:
            # Each half has a cause.
            return ""
    owner = robot[suspects[0].owner]
    part = owner[suspects[0].part]
    return compound("{tag} '{get}' <{tag_2}>", tag=owner.tag, get=owner.get("name"), tag_2=part.tag)


def _can_build_without(file: Path, robot: ET.Element, places: list[_Place]) -> bool:
    """Whether Drake can build a robot without some elements.

    Args:
        file: the URDF. A changed copy is written next to it for a moment, since paths of meshes start from its folder.
        robot: the ``robot`` element of the file.
        places: places of the elements.
    """
    rest = deepcopy(robot)
    # From the last one backwards, so that the indices of the others stay right.
    for place in sorted(places, reverse=True):
        rest[place.owner].remove(rest[place.owner][place.part])
    with tempfile.NamedTemporaryFile(dir=file.parent, prefix=".probe-", suffix=".urdf") as trial:
        ET.ElementTree(rest).write(trial.name)
        return _drake_error(Path(trial.name)) is None


def _build(file: Path) -> None:
    """Build the robot of a URDF in Drake.

    Raises:
        SimrobError: the URDF has a defect that the reader of robots finds.
        RuntimeError: Drake refuses the robot.
    """
    from pydrake.geometry import SceneGraph
    from pydrake.multibody.plant import MultibodyPlant

    from simrob_drake.robots.parse import add_urdf
    from simrob_drake.robots.urdf import read_urdf, with_absolute_meshes

    plant = MultibodyPlant(0.0)
    scene_graph = SceneGraph()
    # With a scene graph, Drake reads the meshes, too, whose defects can end the process as well.
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_urdf(plant, with_absolute_meshes(read_urdf(file), file.parent), name="robot", where=file)
    plant.Finalize()
    plant.CreateDefaultContext()


if __name__ == "__main__":
    try:
        _build(Path(sys.argv[1]))
    except (SimrobError, RuntimeError) as problem:
        print(problem)
        sys.exit(1)
