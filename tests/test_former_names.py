"""Modules that moved can still be imported by their former names, with a warning."""

import importlib
import subprocess
import sys

import pytest

from simrob_drake import former_names
from simrob_drake.base.errors import SimrobError


@pytest.fixture
def forget():
    """Forget modules that were imported by a former name."""
    known = set(sys.modules)
    yield
    for name in set(sys.modules) - known:
        if former_names._present_name(name):
            del sys.modules[name]


@pytest.mark.usefixtures("forget")
@pytest.mark.parametrize(
    ("former", "present"),
    [
        ("simrob_drake.errors", "simrob_drake.base.errors"),
        ("simrob_drake.frames", "simrob_drake.base.frames"),
        ("simrob_drake.linear", "simrob_drake.extensions.linear"),
        ("simrob_drake.linear.model", "simrob_drake.extensions.linear.model"),
        ("simrob_drake.tuning.study", "simrob_drake.extensions.tuning.study"),
        ("simrob_drake.mujoco.runner", "simrob_drake.extensions.mujoco.runner"),
        ("simrob_drake.learning.task", "simrob_drake.extensions.learning.task"),
        ("simrob_drake.stations.mujoco.coordinates", "simrob_drake.extensions.mujoco.coordinates"),
        ("simrob_drake.importer.mjcf.reading", "simrob_drake.extensions.mujoco.mjcf.reading"),
        ("simrob_drake.teach.session", "simrob_drake.extensions.pendant.session"),
        ("simrob_drake.parts.controllers.policy", "simrob_drake.extensions.learning.policy"),
    ],
)
def test_a_former_name_is_the_module_itself(former, present):
    with pytest.warns(
        DeprecationWarning, match=f"{former} is now {present}; the former name works until"
    ):
        module = importlib.import_module(former)
    assert module is importlib.import_module(present)
    assert module.__name__ == module.__spec__.name == present


@pytest.mark.usefixtures("forget")
def test_an_error_is_caught_by_its_former_name():
    with pytest.warns(DeprecationWarning, match="simrob_drake.errors is now"):
        from simrob_drake.errors import SimrobError as Former
    assert Former is SimrobError


def test_every_former_name_is_a_module_of_today():
    for name in former_names._NEW_NAMES.values():
        assert importlib.util.find_spec(f"simrob_drake.{name}") is not None


def test_other_names_are_left_to_python():
    for name in (
        "simrob_drake.programs",
        "simrob_drake.base.errors",
        "numpy",
        "simrob_drake.nothing",
        "simrob_drake.stations.config",
    ):
        assert former_names._present_name(name) is None
    with pytest.raises(ModuleNotFoundError, match=r"simrob_drake\.nothing"):
        importlib.import_module("simrob_drake.nothing")


def test_the_warning_names_the_line_of_the_import(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("\n\nfrom simrob_drake.errors import SimrobError\n")
    command = [sys.executable, "-W", "always", str(script)]

    shown = subprocess.run(command, capture_output=True, text=True, check=True).stderr

    assert (
        "script.py:3: DeprecationWarning: simrob_drake.errors is now simrob_drake.base.errors"
        in shown
    )


@pytest.mark.parametrize(
    ("module", "former", "present"),
    [
        ("errors", "shown", "format_value"),
        ("extras", "needed", "importing_extra"),
        ("files", "opened", "open_regular"),
        ("interpolation", "stacked", "stack_poses"),
        ("lifetime", "built", "build_diagram"),
        ("packages", "resolved", "resolve_path"),
        ("sampling", "seeded", "choose_seeds"),
        ("sections", "validated", "validate_section"),
    ],
)
def test_a_function_of_the_base_has_its_former_name_with_a_warning(module, former, present):
    found = importlib.import_module(f"simrob_drake.base.{module}")

    with pytest.warns(DeprecationWarning, match=f"{former} is now .*{present}"):
        function = getattr(found, former)

    assert function is getattr(found, present)
