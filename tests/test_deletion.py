"""The core works without extensions, and each extension without the others: they are deleted from a copy."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
EXTENSIONS = sorted(
    folder.parent.name for folder in TOP.glob("simrob_drake/extensions/*/extension.py")
)
FOLDERS = ("simrob_drake", "tests", "models", "diagrams", "course", "examples")
CORE_TESTS = (
    "test_folders.py",
    "test_runner.py",
    "test_cli_programs.py",
    "test_path_arguments.py",
    "blocks/test_servo.py",
    "importer/test_hands.py",
    "kinematics/test_analytic_solver.py",
    "parts/test_part_kinds.py",
    "programs/test_program.py",
    "results/test_verdict.py",
    "robots/test_catalog.py",
    "stations/test_load.py",
    "walking/test_planner.py",
)
"""Tests of every package of the core, which need no extension."""
QUICK_TESTS = {
    "comparison": "test_comparison_paths.py",
    "course": "test_exercises.py::test_the_command_alone_shows_its_help",
    "drake_scenes": "test_scene_problems.py::test_a_scenario_is_recognised",
    "learning": "test_registration.py::test_check_says_that_a_task_is_no_station",
    "legged": "test_legged.py::test_limbs_of_a_quadruped_are_told_by_geometry",
    "linear": "test_linearize.py::test_a_rod_is_its_closed_form",
    "mujoco": "test_motors_in_mjcf.py::test_a_bus_is_not_exported",
    "pendant": "test_form.py::test_sections_that_may_be_missing_come_and_go",
    "rapid": "test_rapid_language.py::test_expressions_are_worked_out",
    "simulink": "test_values.py::test_expressions",
    "tuning": "test_tuning_paths.py",
}
"""A quick test of each extension, below ``tests/extensions/<name>``."""
IMPORT_AND_TEST = """
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest

for name in sys.argv[1].split(","):
    package = import_module(f"simrob_drake.extensions.{name}")
    for module in walk_packages(package.__path__, f"{package.__name__}."):
        # Programs of processes are no modules to import, nor is what needs another extension.
        if module.name not in sys.argv[2].split(","):
            import_module(module.name)
print("imported", len([name for name in sys.modules if name.startswith("simrob_drake.extensions.")]))
sys.exit(pytest.main(["-q", "-p", "no:xdist", "-p", "no:cacheprovider", *sys.argv[3:]]))
"""


class Copy:
    """A copy of the package with its tests and its entry points, as if it were installed in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.extensions = folder / "simrob_drake" / "extensions"
        without_caches = shutil.ignore_patterns("__pycache__")
        for name in FOLDERS:
            shutil.copytree(TOP / name, folder / name, ignore=without_caches)
        shutil.copy(TOP / "pyproject.toml", folder)
        information = folder / "simrob_drake-0.1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: simrob-drake\nVersion: 0.1.0\n"
        )
        groups = tomllib.loads((TOP / "pyproject.toml").read_text())["project"]["entry-points"]
        lines = [f"{name} = {value}" for name, value in groups["simrob_drake.extensions"].items()]
        (information / "entry_points.txt").write_text(
            "\n".join(["[simrob_drake.extensions]", *lines])
        )

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Python in the folder."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": ""}
        command = [sys.executable, *arguments]
        return subprocess.run(
            command,
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=500,
        )

    def simrob(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command of the copy."""
        return self.run("-m", "simrob_drake.cli", *arguments)


@pytest.fixture(scope="module")
def whole_copy(tmp_path_factory):
    return Copy(tmp_path_factory.mktemp("copy"))


@pytest.fixture
def without(whole_copy, tmp_path):
    """Delete folders of the package until the test is over, by their names below it."""
    deleted = []

    def delete(name):
        place = whole_copy.folder / "simrob_drake" / name
        deleted.append((place, tmp_path / place.name))
        place.rename(tmp_path / place.name)
        return whole_copy

    yield delete
    for place, kept in deleted:
        shutil.rmtree(place, ignore_errors=True)  # compiled files of tests
        kept.rename(place)


@pytest.mark.long
def test_the_core_works_without_extensions(without):
    copy = without("extensions")
    listed = copy.simrob("extensions")
    assert listed.returncode == 0
    text = " ".join(listed.stdout.split())  # a long reason goes on in the next lines
    for name in EXTENSIONS:
        reason = f"left out: its module simrob_drake.extensions.{name}.extension is not installed"
        assert f"{name} simrob-drake 0.1.0 {reason}" in text

    shown = copy.simrob("--help").stdout
    assert "diagram" in shown
    assert "sweep" not in shown
    unknown = copy.simrob("sweep", "irb120_dynamic")
    assert (unknown.returncode, unknown.stderr.count("\n")) == (2, 1)
    assert "Extensions that are left out: comparison, course, " in unknown.stderr

    assert copy.simrob("demo").returncode == 0
    done = copy.simrob("run", "irb120_dynamic", "--no-recording", "--out", "result")
    assert done.returncode == 0, done.stderr
    assert (copy.folder / "runs" / "demo" / "recording.html").is_file()
    assert (copy.folder / "result" / "signals.csv").is_file()

    tests = [f"tests/{name}" for name in CORE_TESTS]
    tested = copy.run("-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", *tests)
    assert tested.returncode == 0, tested.stdout[-5000:]


NEEDS = {
    "mujoco": ["simrob_drake.extensions.learning.vector"],
    "tuning": ["simrob_drake.extensions.legged.tuning"],
}
"""Modules of other extensions that need an extension, by its name. Only functions import them, with a message."""


@pytest.mark.long
@pytest.mark.parametrize("name", EXTENSIONS)
def test_each_extension_works_without_another_one(without, name):
    copy = without(f"extensions/{name}")
    others = [other for other in EXTENSIONS if other != name]
    programs = [
        "simrob_drake.extensions.course.child",
        "simrob_drake.extensions.course.answer_process",
    ]
    not_imported = ",".join(programs + NEEDS.get(name, []))
    tests = [f"tests/extensions/{other}/{QUICK_TESTS[other]}" for other in others]

    tested = copy.run("-c", IMPORT_AND_TEST, ",".join(others), not_imported, *tests)

    assert tested.returncode == 0, (tested.stdout + tested.stderr)[-5000:]
    assert "imported " in tested.stdout
