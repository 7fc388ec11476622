"""Every gait of every robot has one name, and a planner behind it."""

import shutil

import pytest
import yaml

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import models_root
from simrob_drake.programs.gaits.registry import gait_kinds, gaits_model, gaits_of, load_gaits
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.robots.gaits_file import GAITS_FILE

ROBOTS = sorted(file.parent.name for file in models_root().glob(f"*/{GAITS_FILE}"))


def test_every_section_of_gaits_has_a_planner():
    assert {kind.section for kind in gait_kinds()} == set(gaits_model().model_fields) - {
        "facing_deg",
        "reacting",
        "get_up",
    }


@pytest.mark.parametrize("robot", ROBOTS)
def test_names_are_told_apart(robot):
    names = [name for kind in gait_kinds() for name in getattr(load_gaits(robot), kind.section)]
    assert len(names) == len(set(names))
    assert {*gaits_of(robot, steps=True), *gaits_of(robot, steps=False)} == set(names)


@pytest.mark.long
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_gait_is_planned_by_its_name(robot):
    walker = Walker.of(robot)
    for name, gait in gaits_of(robot, steps=True).items():
        half = gait.with_changes({}, 0.5, name)
        assert gait.plan(walker, 2, 1.0).duration < half.plan(walker, 3, 0.5).duration
    for name, gait in gaits_of(robot, steps=False).items():
        short, long = (
            gait.with_changes({"rest": rest}, 1.0, name).plan(walker, 0, 1.0) for rest in (0.5, 3.0)
        )
        assert long.duration > short.duration + 2.4


def test_a_robot_without_gaits_is_told():
    with pytest.raises(InvalidParameter, match="a robot without gaits"):
        gaits_of("irb120", steps=True)


def walker_by_commands(folder):
    """Copy a robot into a folder, without its planned walks; return its folder."""
    own = folder / "mine"
    shutil.copytree(models_root() / "zjudancer", own)
    gaits = yaml.safe_load((own / GAITS_FILE).read_text())
    (own / GAITS_FILE).write_text(
        yaml.safe_dump({key: gaits[key] for key in ("facing_deg", "reacting")})
    )
    return own


def test_a_robot_that_walks_by_commands_says_so_when_asked_for_a_planned_walk(
    tmp_path, monkeypatch
):
    own = walker_by_commands(tmp_path)
    station = load_station("zjudancer_dynamic", {"robot.model": str(own / "robot.yaml")})

    said = r"robot mine: it has no planned walk: it walks by commands; "

    with pytest.raises(InvalidParameter, match=said + r"use \{go: \{ahead: 0\.1\}\} in a program$"):
        LeggedRobot(station).walk(3)

    (own / "walking.yaml").touch()
    monkeypatch.chdir(tmp_path)

    with pytest.raises(
        InvalidParameter, match=said + r"run `simrob run mine/walking\.yaml`, or use \{go: "
    ):
        LeggedRobot(station).walk(3)


def test_a_robot_without_any_walk_says_so(tmp_path):
    own = walker_by_commands(tmp_path)
    (own / GAITS_FILE).write_text("facing_deg: 90\n")

    station = load_station("zjudancer_dynamic", {"robot.model": str(own / "robot.yaml")})

    with pytest.raises(
        InvalidParameter, match=r"its file of gaits has no gait with steps; .*gaits\.yaml"
    ):
        LeggedRobot(station).walk(3)
