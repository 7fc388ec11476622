"""The rules of the house: imports point one way, modules stay small, and nothing heavy is imported on the way."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import simrob_drake

PACKAGE = Path(simrob_drake.__file__).parent
ROAD = [
    "base",
    "robots",
    "importer",
    "dynamics",
    "blocks",
    "walking",
    "parts",
    "stations",
    "results",
    "simulation",
    "mujoco",
    "comparison",
    "identification",
    "linear",
    "kinematics",
    "programs",
    "tuning",
    "learning",
    "simulink",
    "teach",
    "cli",
]
BASE = {
    "beside",
    "errors",
    "extras",
    "files",
    "constants",
    "paths",
    "folders",
    "frames",
    "given",
    "lifetime",
    "interpolation",
    "interrupts",
    "yaml_files",
    "csv_files",
    "progress",
    "quantities",
    "signals",
    "rows",
}
MODULES = sorted(file for file in PACKAGE.rglob("*.py") if file.name != "__init__.py")


def place(module: str) -> int:
    """Return how far along the road a module of the package lies."""
    room = module.split(".")[1] if "." in module else "base"
    return ROAD.index("base" if room in BASE else room)


def imported(file: Path) -> set[str]:
    tree = ast.parse(file.read_text())
    froms = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    plain = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return froms | plain


@pytest.mark.parametrize("file", MODULES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_point_to_the_left(file):
    name = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
    for other in imported(file):
        if other.startswith("simrob_drake."):
            assert place(other) <= place(name), f"{name} imports {other}, which lies to its right"
        assert other != "pydrake.all", "it shadows builtins and loads everything"


def needed(file: Path) -> set[str]:
    """Return the modules of the package that must be loaded before a module can be."""
    body = [node for node in ast.parse(file.read_text()).body if isinstance(node, ast.ImportFrom)]
    return {node.module for node in body if node.module and node.module.startswith("simrob_drake.")}


def test_no_module_waits_for_another_that_waits_for_it():
    waits = {".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts): needed(file) for file in MODULES}
    try:
        TopologicalSorter(waits).prepare()
    except CycleError as problem:
        pytest.fail(" -> ".join(problem.args[1]))


def test_modules_hold_one_concept_each():
    long = {str(file): count for file in MODULES if (count := len(file.read_text().splitlines())) > 400}
    assert long == {}


def test_the_package_loads_nothing_heavy():
    """What draws, solves and reads meshes is loaded where it is first used: `Arm` too."""
    script = (
        "import sys; from simrob_drake import add_station, load_station, simulate; "
        "print([name for name in ('scipy', 'matplotlib', 'trimesh') if name in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    assert shown.strip() == "[]"
    assert {"Arm", "Workcell"} <= set(dir(simrob_drake))
    assert simrob_drake.Arm.__module__ == "simrob_drake.programs.arm"
    with pytest.raises(AttributeError, match="attribute Amr"):
        _ = simrob_drake.Amr


def test_python_blocks_share_a_base():
    """A solver asks each block for derivatives; Drake's own base makes that dear, see Block."""
    bare = [str(file) for file in MODULES if "(LeafSystem)" in file.read_text() and file.name != "block.py"]
    assert bare == []
