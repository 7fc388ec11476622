"""The first station of an arm with fingers grips with the force that its file gives, and carries the piece."""

import numpy as np
import pytest
import yaml

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from tests.robots.hands import box, gantry, joint, link

CUBE = {"pieces.cube": {"model": "cube", "free": True, "pose": [0, 0, 0.02, 0, 0, 0]}}
DOWN = (
    0.4 - 0.07 - 0.02
)  # m: from the carriage to where the middle of a cube of 40 mm on the floor is between the pads


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gantry")
    (folder / "gantry.urdf").write_text(gantry())
    text = draft_station(folder / "gantry.urdf", folder=folder)
    (folder / "station.yaml").write_text(text)
    return folder / "station.yaml"


def test_it_says_what_holds_by_friction_and_check_agrees(station):
    text = station.read_text()

    assert (
        "# Couplings move the fingers (left_slide, right_slide) together, as one motor does" in text
    )
    content = yaml.safe_load(text)
    assert content["solver"]["scheme"] == "lagged"
    assert content["contact"]["model"] == "hydroelastic"
    assert content["robot"]["initial_deg"]["left_slide"] == 0.04
    assert content["couplings"] == {
        "right_slide_follows": {
            "kind": "gear",
            "ratios": {"right_slide": 1.0, "left_slide": -1.0},
            "total": 0.0,
        }
    }

    found = check_station(load_station(station, CUBE))
    assert [finding for finding in found if "gripper" in finding.subject] == []


@pytest.fixture(scope="module")
def holding(station):
    cell = Workcell(load_station(station, CUBE))
    arm = cell.arm()
    arm.move_abs_j([0, DOWN])
    gripped = arm.grip()
    arm.move_abs_j([0, DOWN - 0.1])
    return cell, arm, gripped


@pytest.mark.long
def test_it_grips_with_all_the_force_that_its_file_gives(holding):
    cell, arm, gripped = holding

    assert arm.tools[0] == "grasp"
    np.testing.assert_allclose(gripped.axes("tau")[-1, 2:], -20.0, rtol=1e-6)
    np.testing.assert_allclose(arm.position[2:], 0.02, atol=1e-3)
    # it creeps by a millimetre a second
    np.testing.assert_allclose(cell.frame("cube").translation(), [0, 0, 0.12], atol=2e-3)
    np.testing.assert_allclose(arm.pose()[:3], [0, 0, 0.12], atol=1e-3)


def test_what_it_holds_goes_around_obstacles_with_its_fingers_where_they_are(holding):
    """The references of the fingers are 20 mm inside the cube; collisions are checked at their actual positions."""
    cell, arm, _ = holding
    arm.move_free(joints=[0.25, DOWN - 0.1, 0, 0])

    np.testing.assert_allclose(cell.frame("cube").translation(), [0.25, 0, 0.12], atol=2e-3)

    model = cell.collision_model
    deep = max(pair.depth for pair in model.query().ComputePointPairPenetration())

    assert deep < 1e-3


def test_links_that_are_in_each_other_all_the_way_are_not_in_the_way(tmp_path):
    """Hulls of closed fingers overlap by 4 mm, although half of the tolerance of one robot is 2.5 mm."""
    sides = []
    for name, sign in (("left", 1), ("right", -1)):
        sides.append(
            link(name, box("0.02 0.01 0.02", f"0 {sign * 0.003} 0.07"), com=f"0 {sign * 0.01} 0.03")
        )
        sides.append(joint(name, "palm", name, axis=f"0 {sign} 0", low=0, high=0.04))
    (tmp_path / "gantry.urdf").write_text(gantry(*sides))
    (tmp_path / "s.yaml").write_text("{robot: {urdf: gantry.urdf}, mode: kinematic}")
    arm = Arm(load_station(tmp_path / "s.yaml"))

    arm.move_free(joints=[0.2, 0.1, 0, 0])

    np.testing.assert_allclose(arm.position, [0.2, 0.1, 0, 0], atol=1e-9)


def test_fingers_stay_open_where_it_does_not_begin_at_home(tmp_path):
    """At home the arm is in the floor. The search turns axes of the arm out of it, but no finger."""
    (tmp_path / "gantry.urdf").write_text(gantry().replace("0 0 0.4", "0 0 0.1"))
    content = yaml.safe_load(draft_station(tmp_path / "gantry.urdf"))

    begin = content["robot"]["initial_deg"]
    assert begin["lift"] < 0
    arm_move, *finger_moves = content["program"]["moves"]
    for posture in (begin, finger_moves[-1]["target_deg"]):
        assert posture["left_slide"] == 0.04  # the right one follows it
        assert "right_slide" not in posture
    assert not {"left_slide", "right_slide"} & arm_move["target_deg"].keys()
