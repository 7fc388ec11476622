"""Every gait of every robot has one name, and a planner behind it."""

import pytest

from simrob_drake.errors import InvalidParameter
from simrob_drake.paths import models_root
from simrob_drake.programs.gaits.parameters import GAITS_FILE, Gaits, load_gaits
from simrob_drake.programs.gaits.registry import SECTIONS, gaits_of

ROBOTS = sorted(file.parent.name for file in models_root().glob(f"*/{GAITS_FILE}"))


def test_every_section_of_gaits_has_a_planner():
    assert set(SECTIONS) == set(Gaits.model_fields) - {"facing_deg"}


@pytest.mark.parametrize("robot", ROBOTS)
def test_names_are_told_apart(robot):
    names = [name for section in SECTIONS for name in getattr(load_gaits(robot), section)]
    assert len(names) == len(set(names))
    assert {*gaits_of(robot, steps=True), *gaits_of(robot, steps=False)} == set(names)


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_gait_is_planned_by_its_name(robot):
    for name, (kind, _) in gaits_of(robot, steps=True).items():
        assert kind.plan(robot, 2, name).duration < kind.plan(robot, 3, name, amplitude=0.5).duration
    for name, (kind, _) in gaits_of(robot, steps=False).items():
        assert kind.plan(robot, name, rest=3.0).duration > kind.plan(robot, name, rest=0.5).duration + 2.4


def test_a_robot_without_gaits_is_told():
    with pytest.raises(InvalidParameter, match="one without gaits"):
        gaits_of("irb120", steps=True)
