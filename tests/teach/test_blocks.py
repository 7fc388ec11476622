"""What the blocks of the picture stand for: keys that are there, and columns that the station has."""

import re

import pytest
import yaml

from simrob_drake.paths import diagrams_root
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.resolve import resolve
from simrob_drake.teach.blocks import Told, told_by

_NODE = re.compile(r'^    "([^"]+)" \[label', re.MULTILINE)


def told(name) -> dict[str, Told]:
    """What each block of a shipped picture stands for."""
    config = load_station(name)
    content = yaml.safe_load(station_yaml(config))
    names = [column for signal in closed_station(resolve(config)).ports.signals for column in signal.names]
    blocks = _NODE.findall((diagrams_root() / f"{name}.dot").read_text())
    return {block: told_by(block, content, names) for block in blocks}


@pytest.mark.parametrize(
    "name", ["irb120_dynamic", "two_irb120", "humanoid_balance", "irb120_force_control", "box_on_floor", "belt_pick"]
)
def test_every_block_stands_for_something_of_its_station(name):
    content = yaml.safe_load(station_yaml(load_station(name)))
    for block, (keys, signals) in {block: (one.keys, one.signals) for block, one in told(name).items()}.items():
        assert keys or signals or re.search(r"tcp_pose\.|velocity|felt|capture_point|\.com", block), block
        for key in keys:
            section = content
            for part in key.split(".")[:-1]:  # the last may be one that the file leaves out
                section = section[part]


def test_a_joint_has_its_servo_and_its_three_curves():
    blocks = told("irb120_dynamic")
    assert blocks["joint_2.pd"] == Told(("servo",), ("q_ref.joint_2", "q.joint_2", "tau.joint_2"))
    assert blocks["joint_2.saturation"] == blocks["joint_2.pd"]
    assert blocks["stops"] == Told(("joint_stops",), ())
    assert blocks["reference_source"].keys == ("reference",)
    assert blocks["output torque"].signals == tuple(f"tau.joint_{axis}" for axis in range(1, 7))
    assert blocks["plant"].keys == ("robot", "pieces", "gravity")
    assert blocks["joint_2.pd"].holds("servo.kp")
    assert not blocks["joint_2.pd"].holds("servos")


def test_of_several_robots_each_has_its_own():
    blocks = told("two_irb120")
    assert blocks["left.servo.pd"].signals == tuple(f"left.tau.joint_{axis}" for axis in range(1, 7))
    assert blocks["right.poses"].keys[0] == "robots.right.base"
    assert blocks["left.reference_source"].keys == ("robots.left.reference",)
    assert told("belt_pick")["arm.reference_source"].keys == ("reference",)  # it has none of its own
    assert blocks["output right.position"].signals[0] == "right.q.joint_1"


def test_parts_have_the_columns_they_declare():
    blocks = told("irb120_force_control")
    assert blocks["sensor.touch"].keys == ("sensors.touch",)
    assert blocks["sensor.touch"].signals[0] == "force.touch.x"
    assert len(blocks["sensor.touch"].signals) == 6
    assert blocks["output press.pressing"].signals == ("press.pressing",)
    assert blocks["controller.press"].keys == ("controllers.press",)
    balance = told("humanoid_balance")
    height = told("humanoid_height")
    assert height["controller.height to  sensor"] == height["controller.height"]
    assert balance["force.push.source"] == balance["force.push"]
    assert balance["force.push"].signals == tuple(f"applied_force.push.{axis}" for axis in "xyz")
    assert balance["plant"].holds("servo.kp")  # implicit: the servos are in the plant
