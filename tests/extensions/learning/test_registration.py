"""Environments are registered with Gymnasium whichever of the two packages is imported first."""

import subprocess
import sys

import pytest

from simrob_drake.base.files import models_root
from simrob_drake.cli.app import run_command

pytest.importorskip("gymnasium")

SHOW = "; print(sorted(name for name in gymnasium.registry if name.startswith('simrob/')))"
IDS = "['simrob/Balance-v0', 'simrob/HandGuide-v0', 'simrob/Reach-v0', 'simrob/Walk-v0']\n"


def printed_by(code):
    """Run Python code in a process of its own and return what it prints."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.parametrize(
    "imports",
    [
        "import gymnasium; import simrob_drake.extensions.learning",
        "import simrob_drake.extensions.learning; import gymnasium",
        "from simrob_drake.base.extension import installed_extensions; installed_extensions(); import gymnasium",
    ],
)
def test_environments_are_registered(imports):
    assert printed_by(imports + SHOW) == IDS


def test_gymnasium_has_its_own_loader_afterwards():
    code = "import simrob_drake.extensions.learning, gymnasium; print(type(gymnasium.__spec__.loader).__name__)"
    assert printed_by(code) == "SourceFileLoader\n"


def test_a_search_for_extensions_does_not_load_gymnasium():
    code = (
        "import sys; from simrob_drake.base.extension import installed_extensions; "
        "print([found.problem for found in installed_extensions() if found.name == 'learning'], "
        "'simrob_drake.extensions.learning' in sys.modules, 'gymnasium' in sys.modules)"
    )
    assert printed_by(code) == "[''] True False\n"


def test_check_says_that_a_task_is_no_station(capsys):
    assert run_command(["check", str(models_root() / "tasks" / "reach.yaml")]) == 2
    assert "is not a station, but a task to learn" in capsys.readouterr().err
