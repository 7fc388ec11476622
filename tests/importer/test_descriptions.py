"""Robots by their names in `robot_descriptions`: what it downloaded is found, and nothing is downloaded."""

import sys
from pathlib import Path

import pytest
from repair_stages import ARM
from typer.testing import CliRunner

from simrob_drake.base.errors import InvalidModel, UnknownName
from simrob_drake.cli.app import app
from simrob_drake.importer.importing import examine_robot
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.importer.robot_files import is_robot_file, robot_file

MODULE = """
from os import path
from ._cache import clone_to_cache
PACKAGE_PATH = path.join(clone_to_cache("arms"), "red")
URDF_PATH = path.join(PACKAGE_PATH, "arm.urdf")
"""
PACKAGE = {
    "__init__.py": "",
    "_cache.py": "def clone_to_cache(name, commit=None):\n    raise AssertionError('this would be a download')",
    "_descriptions.py": "DESCRIPTIONS = {'red_description': None}",
    "_repositories.py": "from types import SimpleNamespace as R\nREPOSITORIES = {'arms': R(cache_path='arms')}",
    "red_description.py": MODULE,
}


@pytest.fixture
def downloaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with the interface of `robot_descriptions`, and the robot in its cache."""
    for name, text in PACKAGE.items():
        file = tmp_path / "site" / "robot_descriptions" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    urdf = tmp_path / "cache" / "arms" / "red" / "arm.urdf"
    urdf.parent.mkdir(parents=True)
    urdf.write_text(ARM)
    return urdf


def test_a_robot_that_was_downloaded_is_found_by_its_name(downloaded):
    assert is_robot_file("red_description")
    assert robot_file("red_description", "source") == downloaded
    assert list(examine_robot("red_description").model.axes) == ["shoulder"]
    assert list(read_robot("red_description").axes) == ["shoulder"]

    shown = CliRunner().invoke(app, ["station", "red_description", "--out", "red.yaml"])
    assert shown.exit_code == 0, shown.output
    assert "urdf: cache/arms/red/arm.urdf" in Path("red.yaml").read_text()


def test_a_name_with_an_ending_is_a_file_and_no_robot_of_the_package():
    with pytest.raises(InvalidModel, match=r"arm\.foo.*"):
        read_robot("arm.foo")


def test_nothing_is_downloaded(downloaded):
    downloaded.unlink()
    for folder in (downloaded.parent, downloaded.parent.parent):
        folder.rmdir()
    with pytest.raises(
        InvalidModel,
        match=r"is not in .*arms; `robot_descriptions pull red_description` downloads it",
    ):
        robot_file("red_description", "source")


def test_a_name_that_is_none_is_told(downloaded, monkeypatch):
    with pytest.raises(UnknownName, match="did you mean 'red_description'"):
        robot_file("rad_description", "source")
    assert robot_file("red.urdf", "source") == Path("red.urdf").resolve()

    monkeypatch.setitem(sys.modules, "robot_descriptions._cache", None)
    with pytest.raises(InvalidModel, match=r"is not a file; .* `pip install robot_descriptions"):
        robot_file("rad_description", "source")


def test_only_the_last_part_of_a_path_is_a_name_and_a_folder_of_this_name_is_none(
    downloaded, tmp_path
):
    """A station's file gives paths from its own folder; packages of ROS have such names, too."""
    assert is_robot_file("stations/red_description")
    assert robot_file("stations/red_description", "source") == downloaded

    folder = tmp_path / "red_description"
    folder.mkdir()

    assert not is_robot_file("red_description")
    assert robot_file("red_description", "source") == folder
