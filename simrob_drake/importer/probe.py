"""The first parse of an imported robot, in a process of its own: where Drake ends a process, only that one ends.

Repairs and checks come first, so this finds what they did not know of. ``python -m simrob_drake.importer.probe FILE``
builds the robot and exits with 0, or prints what Drake says and exits with 1.
"""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

from simrob_drake.base.errors import SimrobError, shortened
from simrob_drake.base.messages import compound, message
from simrob_drake.robots.imports import ImportReport

_SUSPECTS = ("visual", "collision", "inertial", "limit", "dynamics", "axis")
_PATIENCE = 120.0  # s, for a robot of hundreds of meshes


def probe(file: Path, report: ImportReport) -> None:
    """Let a child process build a robot in Drake; raises InvalidModel: refused or died, of an element that is named."""
    complaint = _complaint(file)
    if complaint is None:
        return
    raise report.refusal(
        _culprit(file),
        message("importer.drake_cannot_build", "Drake cannot build it: {complaint}", complaint=complaint),
    )


def _complaint(file: Path) -> str | None:
    """Return what Drake says against a robot, None if it can build it."""
    command = [sys.executable, "-P", "-m", "simrob_drake.importer.probe", str(file)]  # -P: none of the user's modules
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return message("importer.takes_longer", "it takes longer than {patience:g} s", patience=_PATIENCE)
    if child.returncode == 0:
        return None
    text = (child.stdout.strip() or child.stderr.strip()).splitlines()
    return (
        shortened(text[-1].removeprefix(f"{file}: "), 300)
        if text
        else message("importer.ended_with_code", "the process ended with code {code}", code=child.returncode)
    )


def _culprit(file: Path) -> str:
    """Return the element without which Drake builds the robot; empty if no single one makes the difference."""
    robot = ET.parse(file).getroot()
    places = [(o, p) for o, owner in enumerate(robot) for p, part in enumerate(owner) if part.tag in _SUSPECTS]
    if not places or not _built_without(file, robot, places):
        return ""
    while len(places) > 1:
        half = places[: len(places) // 2]
        if not _built_without(file, robot, half):
            half = places[len(places) // 2 :]
            if not _built_without(file, robot, half):
                return ""  # two culprits, one in each half
        places = half
    owner = robot[places[0][0]]
    return compound("{tag} '{get}' <{tag_2}>", tag=owner.tag, get=owner.get("name"), tag_2=owner[places[0][1]].tag)


def _built_without(file: Path, robot: ET.Element, places: list[tuple[int, int]]) -> bool:
    rest = deepcopy(robot)
    for owner, part in sorted(places, reverse=True):
        rest[owner].remove(rest[owner][part])
    with tempfile.NamedTemporaryFile(dir=file.parent, prefix=".probe-", suffix=".urdf") as trial:
        ET.ElementTree(rest).write(trial.name)
        return _complaint(Path(trial.name)) is None


def _build(file: Path) -> None:
    from pydrake.geometry import SceneGraph
    from pydrake.multibody.plant import MultibodyPlant

    from simrob_drake.robots.parse import add_urdf
    from simrob_drake.robots.urdf import read_urdf, with_absolute_meshes

    plant = MultibodyPlant(0.0)
    scene_graph = SceneGraph()
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
