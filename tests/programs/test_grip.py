"""Fingers: found in robots' files, closed by force, and what friction holds; against Coulomb's law."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yaml

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import models_root
from simrob_drake.cli.app import run_command
from simrob_drake.robots.fingers import Gripper, fingers_of

DOWN = [0.0, 0.0, np.pi]
ALONE = {f"pieces.cube_{number}": None for number in (1, 2, 4, 5)}
FINGER = """<link name="{name}"><inertial><origin xyz="0 {y} 0.03"/><mass value="0.05"/>
  <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="0 {at} 0.05"/>
  <axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="20" velocity="1"/>{more}</joint>"""
HAND = """<robot name="hand"><link name="base"/><link name="hand"/>
<joint name="wrist" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>{fingers}</robot>"""


def hand(*fingers):
    usual = {
        "parent": "hand",
        "y": 0,
        "at": 0,
        "low": 0,
        "high": 0.04,
        "kind": "prismatic",
        "more": "",
    }
    return ET.fromstring(
        HAND.format(fingers="".join(FINGER.format(**{**usual, **finger}) for finger in fingers))
    )


LEFT, RIGHT = {"name": "left", "axis": "0 1 0"}, {"name": "right", "axis": "0 -1 0"}


def test_fingers_that_slide_side_by_side_are_found_with_their_closed_end():
    found, palm = fingers_of(hand(LEFT, RIGHT))

    assert palm == "hand"
    assert found == {"left": (0.0, 0.04), "right": (0.0, 0.04)}

    inward, _ = fingers_of(
        hand({**LEFT, "axis": "0 -1 0", "at": 0.05}, {**RIGHT, "axis": "0 1 0", "at": -0.05})
    )
    assert inward == {"left": (0.04, 0.0), "right": (0.04, 0.0)}

    alike, _ = fingers_of(
        hand({**LEFT, "low": -0.04, "high": 0, "at": 0.05}, {**RIGHT, "axis": "0 1 0", "at": -0.05})
    )
    assert alike == {"left": (-0.04, 0.0), "right": (0.04, 0.0)}  # both joints slide to the left


def test_the_length_of_an_axis_vector_does_not_matter():
    found, _ = fingers_of(
        hand({**LEFT, "axis": "0 -10 0", "at": 0.05}, {**RIGHT, "axis": "0 10 0", "at": -0.05})
    )
    assert found == {"left": (0.04, 0.0), "right": (0.04, 0.0)}


def test_fingers_that_turn_and_follow_each_other_are_found():
    turns = {"kind": "revolute", "high": 0.8}
    follows = '<follows joint="left" multiplier="-1"/>'
    left = {**LEFT, **turns, "axis": "1 0 0", "at": 0.05}
    right = {
        **RIGHT,
        **turns,
        "axis": "1 0 0",
        "at": -0.05,
        "low": -0.8,
        "high": 0,
        "more": follows,
    }

    found, palm = fingers_of(hand(left, right))

    assert palm == "hand"
    assert found == {"left": (0.8, 0.0), "right": (-0.8, 0.0)}


@pytest.mark.parametrize(
    "fingers",
    [
        (LEFT,),  # one alone
        (LEFT, {**RIGHT, "axis": "0 1 0"}),  # both go the same way
        # and something else moves there
        (
            LEFT,
            RIGHT,
            {**RIGHT, "name": "third", "kind": "revolute"},
        ),
        # a chain
        (
            {**LEFT, "kind": "revolute"},
            {**RIGHT, "parent": "left", "more": '<follows joint="left"/>'},
        ),
        (  # one that stands
            {**LEFT, "kind": "revolute"},
            {**RIGHT, "kind": "revolute", "more": '<follows joint="left" multiplier="0"/>'},
        ),
    ],
)
def test_what_is_no_hand_has_no_fingers(fingers):
    assert fingers_of(hand(*fingers)) is None


def test_a_finger_that_is_open_where_it_is_closed_is_refused():
    with pytest.raises(ValueError, match="left must have different closed and open positions"):
        Gripper.model_validate({"axes": {"left": [0.02, 0.02], "right": [0, 0.02]}})


def test_an_arm_from_its_urdf_alone_has_its_hand_as_the_tool(tmp_path):
    source = models_root() / "irb120_gripper" / "irb120_gripper.urdf"
    text = source.read_text().replace("../irb120/", f"{models_root()}/irb120/")
    (tmp_path / "arm.urdf").write_text(text)
    station = tmp_path / "station.yaml"
    station.write_text(
        yaml.safe_dump({"robot": {"urdf": "arm.urdf"}, "mode": "kinematic", "servo": {"kp": 1}})
    )

    arm = Arm(load_station(station, mesh_path=[models_root()]))

    assert arm.tools[0] == "grasp"
    assert list(arm.cell.robot("robot").model.gripper.axes) == ["left_finger", "right_finger"]
    assert arm.chain.order == (0, 1, 2, 3, 4, 5)


def test_a_kinematic_gripper_opens_and_closes():
    arm = Arm(
        load_station(
            "irb120_gripper", {"mode": "kinematic", "monitors": {}, "couplings": {}, "pieces": {}}
        )
    )
    arm.grip()

    np.testing.assert_allclose(arm.position[6:], 0.0, atol=1e-9)

    run = arm.open(width=0.03)
    np.testing.assert_allclose(arm.position[6:], 0.015, atol=1e-9)
    assert run.stop_time == pytest.approx(0.5)

    arm.move_abs_j([0, 0.1, 0, 0, 1.5, 0])  # without the fingers, which stay
    np.testing.assert_allclose(arm.position, [0, 0.1, 0, 0, 1.5, 0, 0.015, 0.015], atol=1e-9)
    with pytest.raises(
        SimrobError,
        match=r"width is 0\.06; it must be at most 0\.05 m, the largest opening of irb120_gripper",
    ):
        arm.open(width=0.06)
    with pytest.raises(
        SimrobError, match=r"force: a kinematic station has no forces; leave it out"
    ):
        arm.grip(force=5)
    np.testing.assert_allclose(arm.position[6:], 0.015, atol=1e-9)


@pytest.mark.parametrize(
    "move",
    [
        {"move_abs_j": {"targets_deg": [0, 2, 0, 0, 80, 0]}},
        {"move_free": {"joints_deg": [0, 2, 0, 0, 80, 0]}},
    ],
)
def test_degrees_of_a_posture_without_fingers_are_degrees(move):
    arm = Arm(
        load_station(
            "irb120_gripper", {"mode": "kinematic", "monitors": {}, "couplings": {}, "pieces": {}}
        )
    )
    fingers = arm.position[6:]

    arm.do(move)

    np.testing.assert_allclose(np.rad2deg(arm.position[:6]), [0, 2, 0, 0, 80, 0], atol=1e-6)
    np.testing.assert_allclose(arm.position[6:], fingers, rtol=0, atol=1e-12)


def test_what_fingers_cannot_do_is_said():
    arm = Arm(load_station("irb120_gripper", ALONE))

    with pytest.raises(SimrobError, match=r"force is 200\.0; it must be at most 130"):
        arm.grip(force=200)
    with pytest.raises(SimrobError, match=r"a robot with a gripper in its robot\.yaml"):
        Arm("irb120_dynamic").grip()
    with pytest.raises(SimrobError, match="a robot with a gripper"):
        load_station("irb120_dynamic", {"monitors": {"dropped": {"kind": "empty_grip"}}})


def test_a_force_that_soft_servos_cannot_press_with_is_refused():
    soft = {"servo.kp": {"left_finger": 1000.0, "right_finger": 1000.0}}
    arm = Workcell(load_station("irb120_gripper", soft)).arm()

    with pytest.raises(
        SimrobError,
        match=r"force is 60\.0; it must be at most 25 N, the force that servo\.kp of left_finger",
    ):
        arm.grip(force=60)

    arm.grip(force=20)


def lifted(force, **overrides):
    """Return how far a block of 1 kg goes up when the fingers that hold it go up by 30 mm, and the runs."""
    cell = Workcell(
        load_station(
            "irb120_gripper", {**ALONE, "pieces.cube_3.mass": 1.0, "monitors": {}, **overrides}
        )
    )
    arm = cell.arm()
    arm.move_j([0.35, 0, 0.02, *DOWN], duration=1.0)
    gripped = arm.grip(force=force)
    before = cell.frame("cube_3").translation()[2]
    raised = arm.move_l([0.35, 0, 0.05], duration=1.5)
    return cell.frame("cube_3").translation()[2] - before, gripped, raised


@pytest.mark.long
def test_friction_holds_what_coulomb_says():
    """m g = 2 mu F for F = 9.81 N: some more holds, some less slips."""
    critical = 1.0 * 9.80665 / (2 * 0.5)
    held, gripped, raised = lifted(1.05 * critical)

    assert 0.03 > held > 0.02  # it creeps, see below
    np.testing.assert_allclose(gripped.axes("tau")[-1, 6:], -1.05 * critical, rtol=1e-6)
    assert not raised.warnings

    slipped, _, _ = lifted(0.95 * critical)
    assert slipped == pytest.approx(0.0, abs=1e-3)


@pytest.mark.long
def test_what_is_held_creeps_as_the_smoothed_friction_says():
    """F_t = mu N v / sqrt(v² + s²), with s the stiction_speed: v = s r / sqrt(1 - r²) where r = F_t / (mu N)."""
    cell = Workcell(
        load_station("irb120_gripper", {**ALONE, "pieces.cube_3.mass": 1.0, "monitors": {}})
    )
    arm = cell.arm()
    arm.move_j([0.35, 0, 0.02, *DOWN], duration=1.0)
    arm.grip(force=1.2 * 9.80665)
    arm.move_l([0.35, 0, 0.05], duration=1.0)
    before = cell.frame("cube_3").translation()[2]
    arm.wait(1.0)

    slid = before - cell.frame("cube_3").translation()[2]

    assert slid == pytest.approx(1e-3 / 1.2 / np.sqrt(1 - 1 / 1.2**2), rel=0.03)


@pytest.mark.parametrize(("height", "is_empty"), [(0.02, False), (0.12, True)])
def test_a_grip_that_holds_no_piece_is_noted(height, is_empty):
    """Without the monitor of the station, a program went on with empty fingers and was all within bounds."""
    cell = Workcell("irb120_gripper", {"monitors.dropped": None})
    arm = cell.arm()
    arm.move_j([0.35, 0, height, *DOWN], duration=1.0)

    verdict = arm.grip(force=60).verdict

    texts = [str(remark.text) for remark in verdict.remarks if remark.severity == "note"]
    assert texts == (["the move (grip): the fingers hold no piece at its end"] if is_empty else [])


def test_fingers_that_close_on_nothing_end_the_run():
    arm = Arm(load_station("irb120_gripper", ALONE))
    run = arm.grip()

    assert run.stopped_by == "dropped"
    assert run.message.startswith("the fingers of robot closed with nothing between them")


@pytest.mark.long
@pytest.mark.usefixtures("no_plots")
def test_the_program_of_the_station_puts_a_cube_on_another(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    assert run_command(["run", "irb120_gripper", "--no-recording", "--out", "r", "--strict"]) == 0

    names, *_, last = (tmp_path / "r" / "signals.csv").read_text().splitlines()
    end = dict(zip(names.split(","), map(float, last.split(",")), strict=True))

    place = [end[f"piece.cube_3.{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(place, [0.35, 0.1, 0.06], atol=2e-3)
    again = (tmp_path / "r" / "program.yaml").read_text()
    assert "grip: {force: 60.0}" in again
    assert "open: {}" in again


@pytest.mark.long
def test_a_tower_of_five_stands_and_ten_cycles_drop_nothing():
    from examples import stack

    cell = stack.run()
    before = [cell.frame(f"cube_{number}").translation() for number in range(1, 6)]
    cell.wait(10.0)
    for number, place in enumerate(before):
        now = cell.frame(f"cube_{number + 1}").translation()
        np.testing.assert_allclose(now, place, atol=1e-3)
        np.testing.assert_allclose(now, [0.45, 0, 0.02 + 0.04 * number], atol=4e-3)
    arm = cell.arm()
    for turn in range(10):
        side = 0.1 if turn % 2 else -0.1
        x, y, z = cell.frame("cube_5").translation()
        arm.move_l([x, y, 0.26], speed=0.4)
        arm.move_l([x, y, z], speed=0.2)
        assert arm.grip(force=60).ending == "completed"
        arm.move_l([x, y, 0.26], speed=0.4)
        arm.move_l([0.40, side, 0.26], speed=0.4)
        assert arm.move_l([0.40, side, 0.021], speed=0.2).ending == "completed"
        arm.open()
    np.testing.assert_allclose(cell.frame("cube_5").translation(), [0.40, side, 0.02], atol=5e-3)
