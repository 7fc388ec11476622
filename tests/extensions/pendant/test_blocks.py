"""What the blocks of the picture stand for: keys that are there, and outputs that the station has."""

import re

import numpy as np
import pytest
import yaml

from simrob_drake.base.files import diagrams_root
from simrob_drake.extensions.pendant.describe import (
    BlockMeaning,
    axis_setting,
    axis_value,
    block_meaning,
)
from simrob_drake.stations.change_of_kind import settings_with
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.load import load_station, station_content, station_yaml
from simrob_drake.stations.resolve import resolve

_NODE = re.compile(r'<g class="node"><title>(.*?)</title>')


def told(name) -> dict[str, BlockMeaning]:
    """What each block of a shipped picture stands for."""
    config = load_station(name)
    content = yaml.safe_load(station_yaml(config))
    names = list(closed_station(resolve(config)).ports.outputs)
    blocks = _NODE.findall((diagrams_root() / f"{name}.svg").read_text())
    return {block: block_meaning(block, content, names) for block in blocks}


@pytest.mark.parametrize(
    "name",
    [
        "irb120_dynamic",
        "two_irb120",
        "humanoid_balance",
        "irb120_force_control",
        "box_on_floor",
        "belt_pick",
    ],
)
def test_every_block_stands_for_something_of_its_station(name):
    content = yaml.safe_load(station_yaml(load_station(name)))
    for block, one in told(name).items():
        assert one.keys or one.signals, block
        assert not block.startswith("output ") or one.signals == (block.removeprefix("output "),)
        for key in one.keys:
            section = content
            for part in key.split(".")[:-1]:  # the last may be one that the file leaves out
                section = section[part]


def test_a_joint_has_its_servo_and_its_curves():
    blocks = told("irb120_dynamic")
    assert blocks["joint_2.pd"] == BlockMeaning(("servo",), ("position", "torque"), "joint_2")
    assert blocks["joint_2.saturation"] == blocks["joint_2.pd"]
    assert blocks["stops"] == BlockMeaning(("joint_stops",), ())
    assert blocks["reference_source"] == BlockMeaning(("reference",), ("reference",))
    assert blocks["output torque"] == BlockMeaning((), ("torque",))
    assert blocks["torque"] == blocks["joint_signals"] == BlockMeaning(("servo",), ("torque",))
    assert blocks["plant"] == BlockMeaning(("robot", "pieces", "gravity"), ("position",))
    assert blocks["poses"].signals == ("base_pose", "tcp_pose")
    assert blocks["joint_2.pd"].holds("servo.kp")
    assert not blocks["joint_2.pd"].holds("servos")


def test_of_several_robots_each_has_its_own():
    blocks = told("two_irb120")
    assert blocks["left.servo.pd"] == BlockMeaning(("servo",), ("left.torque",), robot="left")
    assert blocks["right.poses"].keys[0] == "robots.right.base"
    assert blocks["left.reference_source"].keys == ("robots.left.reference",)
    # it has none of its own
    assert told("belt_pick")["arm.reference_source"].keys == ("reference",)
    assert blocks["plant"].signals == ("left.position", "right.position")


def test_parts_have_the_outputs_they_declare():
    blocks = told("irb120_force_control")
    assert blocks["sensor.touch"] == BlockMeaning(
        ("sensors.touch",), ("force.touch", "moment.touch")
    )
    assert blocks["controller.press"].signals == ("press.offset", "press.pressing", "press.path")
    height = told("humanoid_height")
    assert height["layers"] == BlockMeaning(("controllers",), ("reference",))
    balance = told("humanoid_balance")
    assert balance["force.push"] == BlockMeaning(("forces.push",), ("applied_force.push",))
    assert balance["servo"] == BlockMeaning(("servo",), ("torque",))


def test_a_block_of_a_signal_flow_has_its_own_output():
    meaning = block_meaning(
        "controller.law.error", {"controllers": {"law": {}}}, ["law.error", "law.limit"]
    )
    assert meaning == BlockMeaning(("controllers.law",), ("law.error",))
    whole = block_meaning(
        "controller.law.torque", {"controllers": {"law": {}}}, ["law.error", "law.limit"]
    )
    assert whole.signals == ("law.error", "law.limit")


AXES = [f"joint_{number}" for number in range(1, 7)]


def test_a_gain_of_one_joint_leaves_the_other_joints_theirs():
    """The slider of a joint's block changed all joints."""
    content = station_content(load_station("irb120_dynamic"))
    meaning = block_meaning("joint_2.pd", content, ["position", "torque"])
    key, value = axis_setting(meaning, "servo.kp", 1120.0, content, AXES)
    assert (key, value) == ("servo.kp.joint_2", 1120.0)
    gains = resolve(load_station("irb120_dynamic", {key: value})).robots["robot"].gains.kp
    assert gains.tolist() == [1000, 1120, 1000, 1000, 1000, 1000]


@pytest.mark.parametrize("earlier", [1500.0, {"joint_1": 1500.0}, [1500.0] * 6])
def test_a_gain_of_one_joint_follows_an_earlier_change_of_all(earlier):
    settings = {"servo.kp": earlier}
    content = station_content(load_station("irb120_dynamic", settings))
    meaning = block_meaning("joint_2.pd", content, ["position", "torque"])
    key, value = axis_setting(meaning, "servo.kp", 1120.0, content, AXES)
    later = settings_with(settings, {key: value})
    gains = resolve(load_station("irb120_dynamic", later)).robots["robot"].gains.kp
    assert gains[:2].tolist() == [1500, 1120]
    back = settings_with(later, {"servo.kp": 900.0})
    assert (resolve(load_station("irb120_dynamic", back)).robots["robot"].gains.kp == 900).all()


def test_a_gain_of_one_joint_leaves_the_other_robot_its_own():
    config = load_station("two_irb120", {"servo.realization": "per_joint"})
    content = station_content(config)
    meaning = block_meaning("left.joint_2.pd", content, ["left.position"])
    assert (meaning.robot, meaning.axis) == ("left", "joint_2")
    before = resolve(config).robots
    key, value = axis_setting(meaning, "servo.kp", 1120.0, content, AXES)
    after = resolve(
        load_station("two_irb120", {"servo.realization": "per_joint", key: value})
    ).robots
    changed = [
        AXES[place] for place in np.flatnonzero(after["left"].gains.kp != before["left"].gains.kp)
    ]
    assert changed == ["joint_2"]
    assert (after["right"].gains.kp == before["right"].gains.kp).all()
    assert (after["left"].gains.kd == before["left"].gains.kd).all()


def test_a_value_of_an_axis_is_found_in_each_form():
    for value in (7.0, {"joint_2": 7.0}, [1, 7, 1, 1, 1, 1]):
        assert axis_value(value, "joint_2", AXES) == 7.0
    assert axis_value({"joint_2": 7.0}, "joint_1", AXES) is None
    assert axis_value(None, "joint_2", AXES) is None
