"""Where a file or a folder is asked for, a text does as well as a path; anything else is told in one line."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import models_root
from simrob_drake.extensions.comparison.engines import save_comparison
from simrob_drake.extensions.simulink.fmi.unit import write_fmu
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.logs import read_log, save_differences
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder
from simrob_drake.extensions.tuning.sweep_folder import SweepFolder
from simrob_drake.importer.importing import examine_robot, import_robot, robot_from_file
from simrob_drake.robots.catalog import load_robot_file, load_robot_from_urdf
from simrob_drake.stations.draft import draft_station

ROBOT = models_root() / "double_pendulum"
URDF = str(ROBOT / "double_pendulum.urdf")
STUDY = Path(__file__).parents[1] / "examples" / "studies" / "irb120_gains.yaml"
GIVEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "load_robot_file": (load_robot_file, str(ROBOT / "robot.yaml")),
    "load_robot_from_urdf": (load_robot_from_urdf, URDF),
    "robot_from_file": (robot_from_file, URDF),
    "import_robot": (partial(import_robot, folder="imported", isolated=False), URDF),
    "import_robot to": (partial(import_robot, URDF, isolated=False), "imported"),
    "draft_station": (draft_station, URDF),
    "write_fmu": (partial(write_fmu, load_station("double_pendulum")), "pendulum.fmu"),
    "read_log": (partial(read_log, names={}), "log.csv"),
    "save_differences": (partial(save_differences, []), "differences"),
    "save_comparison": (partial(save_comparison, [], []), "comparison"),
    "Study.read": (Study.read, str(STUDY)),
}
ASKED: dict[str, Callable[[Any], Any]] = {
    "examine_robot": examine_robot,
    "import_simulink": partial(import_simulink, folder="imported"),
    "import_simulink to": partial(import_simulink, "model.slx"),
    "StudyFolder": partial(StudyFolder, study=Study.read(STUDY)),
    "StudyFolder.there": StudyFolder.there,
    "SweepFolder.there": SweepFolder.there,
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_text_is_a_path(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("time,q\n0,0\n1,1\n")
    call, text = GIVEN[name]
    call(text)


@pytest.mark.parametrize("name", [*GIVEN, *ASKED])
def test_what_is_no_path_is_told(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call = ASKED[name] if name in ASKED else GIVEN[name][0]
    for value in (5, ["a.urdf"]):
        with pytest.raises(InvalidParameter, match=r"^(file|path|urdf|folder|source|target) is .*; it must be a path"):
            call(value)
