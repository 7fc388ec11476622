"""Every gait of every robot has one name, and a planner behind it."""

import pytest

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
        short, long = (gait.with_changes({"rest": rest}, 1.0, name).plan(walker, 0, 1.0) for rest in (0.5, 3.0))
        assert long.duration > short.duration + 2.4


def test_a_robot_without_gaits_is_told():
    with pytest.raises(InvalidParameter, match="one without gaits"):
        gaits_of("irb120", steps=True)
