"""A humanoid that lies gets up, on its own motors and by contact alone, and a walk that fell goes on."""

from types import SimpleNamespace

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.base.errors import InvalidParameter, SimrobError, UnknownName
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.blocks.sampled import RunEnds
from simrob_drake.parts.controllers.get_up import Rising, RisingGoal
from simrob_drake.parts.ground import Ground
from simrob_drake.robots.catalog import load_robot
from simrob_drake.walking.getting_up import RisingPosture, load_getting_up, postures

LYING = {"zjudancer": [0.0, 0.0, 0.06, 0.0, 0.0, -1.5], "roid1": [0.0, 0.0, 0.1, 0.0, -1.5, 0.0]}
"""Belly down, and on its back."""


@pytest.mark.long
@pytest.mark.parametrize("name", LYING)
def test_a_humanoid_gets_up_by_contact_alone(name):
    robot = LeggedRobot(load_station(f"{name}_dynamic", {"robot.base": LYING[name]}))
    result = robot.get_up()

    assert result.ending == "completed"
    assert f"{name} stands: it got up at attempt 1" in result.message
    up = 1 - 2 * (result["base.qx"] ** 2 + result["base.qy"] ** 2)
    stood = result.times > result.times[-1] - 0.9
    assert up[0] < 0.1
    assert up[stood].min() > np.cos(np.deg2rad(5))
    assert result["base.z"][stood].min() > load_getting_up(load_robot(name)).height

    again = robot.get_up()
    assert "it has not fallen" in again.message
    assert again.times[-1] == 0


@pytest.mark.long
@pytest.mark.parametrize("friction", [0.6, 1.2])
def test_zjudancer_gets_off_its_belly_on_its_motors_whether_hands_and_feet_slide_or_stick(friction):
    surface = {"static": friction, "dynamic": friction}
    changes = {"robot.base": LYING["zjudancer"], "contact.friction": surface, "monitors": {}}
    assert (
        "it got up at attempt 1"
        in LeggedRobot(load_station("zjudancer_walking", changes)).get_up().message
    )


@pytest.mark.long
def test_a_walk_that_fell_gets_up_and_goes_on():
    push = {"kind": "push", "start": 0.6, "force": [50.0, 0.0, 0.0]}
    changes = {**read_yaml("examples/loops/get_up.yaml"), "forces.push": push, "duration": 15.0}

    result = simulate(load_station("roid1_walking", changes), progress=False)

    assert result.ending == "completed"

    rises = result["get_up.active"] > 0
    stands = int(np.flatnonzero(rises)[-1]) + 1

    assert result["curl.active"][rises].any()
    assert not result["curl.active"][stands:].any()
    way = np.hypot(*(result[f"base.{axis}"][-1] - result[f"base.{axis}"][stands] for axis in "xy"))
    assert way > 0.3 * (result.times[-1] - result.times[stands]) * 0.15
    assert result["base.z"][stands:].min() > 0.25


def rising(attempts=2, *, ends=True):
    """Return a loop of one axis with two postures, after the first of which the trunk is to lean 80 to 100 degrees."""
    first = RisingGoal(RisingPosture(time=0.1, lean_deg=(80.0, 100.0)), np.array([0.5]))
    last = RisingGoal(RisingPosture(time=0.1), np.array([0.9]))
    sequence = [first, last]
    section = SimpleNamespace(attempts=attempts, ends=ends, rate=100.0)
    return Rising(section, [sequence] * 2, height=0.4, facing=0.0, ground=Ground(), name="nobody")


def pose(lean_deg, height):
    """Return the pose of a trunk that leans ahead, to x."""
    half = np.deg2rad(lean_deg) / 2
    return np.array([0.0, 0.0, height, np.cos(half), 0.0, np.sin(half), 0.0])


class Life:
    """The memory of a loop from sample to sample."""

    def __init__(self, block):
        self.block, self.context = block, block.CreateDefaultContext()

    def sample(self, lean_deg, height, speed=0.0):
        memory, _ = self.block.now(self.context)
        read = {
            "base_pose": pose(lean_deg, height),
            "base_velocity": np.full(6, speed),
            "asked": np.zeros(1),
        }
        self.block.remember(self.context, self.block.sample(memory, read))
        return self.block.now(self.context)[0]

    def until(self, condition, *read):
        for count in range(1000):
            if condition(self.sample(*read)):
                return count / 100
        raise AssertionError


def test_it_waits_until_it_lies_still_and_goes_by_the_trunk():
    life = Life(rising())

    assert life.sample(90.0, 0.1, 1.0)["active"][0] == 1
    assert all(life.sample(90.0, 0.1, 1.0)["attempt"][0] == 0 for _ in range(100))
    assert life.until(lambda memory: memory["attempt"][0] == 1, 90.0, 0.1) == pytest.approx(
        0.3, abs=0.02
    )
    assert life.until(lambda memory: memory["target"][0] == 0.9, 90.0, 0.1) == pytest.approx(
        0.2, abs=0.02
    )
    with pytest.raises(RunEnds, match="nobody stands: it got up at attempt 1"):
        life.until(lambda memory: False, 5.0, 0.45)


@pytest.mark.parametrize(
    ("lean", "after"),
    [(90.0, (20.0, 0.45)), (90.0, (0.0, 0.39)), (120.0, (120.0, 0.1)), (-90.0, (-90.0, 0.1))],
)
def test_it_begins_anew_where_the_trunk_is_not_as_it_should_be_and_gives_up(lean, after):
    life = Life(rising())
    life.until(lambda memory: memory["attempt"][0] == 1, lean, 0.1)

    assert life.sample(lean, 0.1)["sequence"][0] == (lean < 0)

    if lean == 90.0:
        life.until(lambda memory: memory["target"][0] == 0.9, lean, 0.1)
    life.until(lambda memory: memory["attempt"][0] == 2, *after)

    assert life.sample(*after)["sequence"][0] == (after[0] < 0)
    assert (life.sample(*after)["target"][0] > 0.5) == (lean == 90.0)
    with pytest.raises(RunEnds, match="nobody did not get up in 2 attempts"):
        life.until(lambda memory: False, *after)


def test_a_robot_that_does_not_stay_up_in_its_last_attempt_ends_the_run():
    life = Life(rising(attempts=1))
    life.until(lambda memory: memory["target"][0] == 0.9, 90.0, 0.1)
    with pytest.raises(RunEnds, match=r"nobody did not get up in 1 attempt$"):
        life.until(lambda memory: False, 20.0, 0.45)


def test_beside_others_it_lets_go_once_it_has_stood_for_a_second():
    life = Life(rising(ends=False))

    assert life.sample(0.0, 0.45)["active"][0] == 0

    life.until(lambda memory: memory["target"][0] == 0.9, 90.0, 0.1)
    assert life.until(lambda memory: memory["active"][0] == 0, 0.0, 0.45) == pytest.approx(
        1.0, abs=0.05
    )


def test_what_cannot_get_up_is_refused():
    with pytest.raises(InvalidParameter, match=r"robot humanoid: .*no section get_up"):
        LeggedRobot("humanoid_dynamic").get_up()
    with pytest.raises(SimrobError, match="dynamic"):
        LeggedRobot("humanoid_kinematic").get_up()
    with pytest.raises(InvalidParameter, match="attempts"):
        LeggedRobot("roid1_dynamic").get_up(attempts=0)


def test_postures_are_of_axes_and_of_pairs_within_their_limits():
    model = load_robot("roid1")
    names = list(model.axes)

    def of(**targets):
        return postures(model, [RisingPosture(time=1.0, target_deg=targets)])[0]

    angles = np.rad2deg(of(knee=100.0, left_elbow=20.0))
    moved = {names[place]: angles[place] for place in np.flatnonzero(angles)}
    assert moved == pytest.approx({"right_knee": 100.0, "left_knee": 100.0, "left_elbow": 20.0})
    with pytest.raises(UnknownName, match="kne"):
        of(kne=1.0)
    with pytest.raises(InvalidParameter, match=r"get_up: knee of posture 0 .*-5 to 130 deg"):
        of(knee=140.0)
