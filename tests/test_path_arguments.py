"""Where a file or a folder is asked for, a text does as well as a path; anything else is told in one line."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from simrob_drake.base.files import models_root
from simrob_drake.importer.importing import examine_robot, import_robot, robot_from_file
from simrob_drake.robots.catalog import load_robot_file, load_robot_from_urdf
from simrob_drake.stations.draft import draft_station
from tests.path_arguments import check_refusal

ROBOT = models_root() / "double_pendulum"
URDF = str(ROBOT / "double_pendulum.urdf")
GIVEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "load_robot_file": (load_robot_file, str(ROBOT / "robot.yaml")),
    "load_robot_from_urdf": (load_robot_from_urdf, URDF),
    "robot_from_file": (robot_from_file, URDF),
    "import_robot": (partial(import_robot, folder="imported", isolated=False), URDF),
    "import_robot to": (partial(import_robot, URDF, isolated=False), "imported"),
    "draft_station": (draft_station, URDF),
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_text_is_a_path(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, text = GIVEN[name]
    call(text)


@pytest.mark.parametrize("name", [*GIVEN, "examine_robot"])
def test_what_is_no_path_is_told(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refusal(examine_robot if name == "examine_robot" else GIVEN[name][0])
