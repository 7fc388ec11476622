"""Attaching and releasing pieces: from how far a tool takes a piece, and which released pieces fall."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake import Arm, LeggedRobot, load_station
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.programs.grasps import _Box, _distance
from tests.programs.conftest import BARE

CONTACT = {"contact": {"model": "point"}, "floor": {"size": 2}, "solver.max_step": 0.01}
WEIGHT = {"model": "box_on_corners", "parent": "robot", "pose": [0, 0, 0.15, 0, 0, 0]}


def held(**changes):
    """An arm with a bare flange that holds a box."""
    station = {
        "robot.model": "irb120",
        "robot.initial_deg": {"joint_5": 90},
        "pieces": {"weight": WEIGHT},
    }
    return Arm(load_station("irb120_dynamic", {**station, **CONTACT, **changes}))


def cube_at(x, y=0.0, z=0.0, *, turn=0.0):
    """A cube with sides of 1 m around a point, turned about its vertical axis [rad]."""
    return _Box(
        RigidTransform(RotationMatrix.MakeZRotation(turn), np.array([x, y, z])), np.full(3, 0.5)
    )


def test_the_distance_of_boxes_is_that_of_their_nearest_points():
    """Two cubes with parallel or turned sides, corner to corner, and one in the other."""
    cube = cube_at(0.0)

    edge_to_face = _distance(cube, cube_at(2.0, turn=np.pi / 4))
    corner_to_corner = _distance(cube, cube_at(1.5, 1.5, 1.5))
    overlapping = _distance(cube, cube_at(0.9))

    assert edge_to_face == pytest.approx(1.5 - np.sqrt(0.5), abs=1e-6)
    assert corner_to_corner == pytest.approx(np.sqrt(3) * 0.5, abs=1e-6)
    assert overlapping == pytest.approx(0, abs=1e-6)


@pytest.mark.long
def test_a_released_piece_falls_and_lies_on_the_floor():
    """It falls by the law of free fall, comes to rest on the floor, and the cell has its pose there."""
    arm = held()
    arm.wait(0.3)
    height = arm.cell.frame("weight").translation()[2]
    vertical_speed = arm.cell.model.motion("weight", arm.cell.state).velocity[5]

    arm.release("weight")
    is_free = arm.cell.config.pieces["weight"].free
    fall = arm.wait(0.1)
    arm.wait(1.5)
    resting_position = arm.cell.frame("weight").translation()
    rest = arm.wait(0.2)

    assert is_free
    expected_height = height + 0.1 * vertical_speed - 0.5 * 9.80665 * 0.1**2
    assert fall["piece.weight.z"][-1] == pytest.approx(expected_height, abs=2e-4)
    assert resting_position[2] < 0.1
    assert np.abs([rest[f"piece.weight.v{axis}"][-1] for axis in "xyz"]).max() < 0.02
    np.testing.assert_allclose(arm.cell.frame("weight").translation(), resting_position, atol=0.01)


def test_a_piece_released_in_motion_flies_on():
    """Its velocity at the start of the flight is that with which the arm carried it."""
    arm = held()
    target = arm.reference + np.array([0.6, 0, 0, 0, 0, 0])
    arm.cell.follow({arm.name: (np.array([0.0, 0.3]), np.array([arm.reference, target]))}, 0.2)
    position = arm.cell.frame("weight").translation()
    turning_speed = arm.velocity[0]
    assert turning_speed > 0.5
    expected = arm.cell.model.motion("weight", arm.cell.state)

    arm.release("weight")
    flight = arm.wait(0.02)

    columns = ("vx", "vy", "vz", "wx", "wy", "wz")
    start = np.array([flight[f"piece.weight.{column}"][0] for column in columns])
    np.testing.assert_allclose(start, [*expected.velocity[3:], *expected.velocity[:3]], atol=1e-9)
    # Joint 1 turns about the world's z axis. The other joints hardly move.
    carried = np.cross([0, 0, turning_speed], position)
    np.testing.assert_allclose(start[:2], carried[:2], atol=0.05 * np.linalg.norm(carried))


def test_a_piece_released_as_fixed_stays_where_it_is():
    """With `fixed` the piece hangs in the air."""
    arm = held()
    position = arm.cell.frame("weight").translation()

    arm.release("weight", fixed=True)
    arm.wait(0.1)

    np.testing.assert_allclose(arm.cell.frame("weight").translation(), position, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"contact": None}, "the station has no contact"),
        ({"floor": None}, "no floor and no fixed box is below it"),
        (
            {"pieces": {"weight": {**WEIGHT, "mass": 0.5, "inertia": [0, 0, 0]}}},
            "without mass and inertia",
        ),
    ],
)
def test_a_piece_that_would_fall_forever_is_not_released(changes, message):
    """The message has the reason. With `fixed`, the release is possible."""
    arm = held(**changes)

    with pytest.raises(InvalidParameter, match=message):
        arm.release("weight")
    arm.release("weight", fixed=True)


def test_a_free_piece_is_taken_where_it_lies_now():
    piece = {
        "model": "box_on_corners",
        "parent": "world",
        "free": True,
        "pose": [0.5, 0, 0.5, 0, 0, 0],
    }
    arm = Arm(load_station("irb120_dynamic", {**CONTACT, "pieces": {"weight": piece}}))
    arm.wait(0.2)

    fallen = arm.cell.frame("weight").translation()

    assert fallen[2] == pytest.approx(0.5 - 0.5 * 9.80665 * 0.2**2, abs=5e-3)

    arm.cell.attach("weight")  # to the world
    assert not arm.cell.config.pieces["weight"].free
    np.testing.assert_allclose(arm.cell.frame("weight").translation(), fallen, atol=1e-9)


class TestOnLinks:
    def test_a_backpack_hangs_on_the_trunk_and_the_hand_stays_the_tool(self):
        pack = {"model": "parcel", "parent": "world", "pose": [0, 0.06, 0.46, 0, 0, 0]}
        robot = LeggedRobot(load_station("humanoid_dynamic", {"pieces.pack": pack}))
        tool = robot.cell.robot("robot").tcp

        robot.attach("pack", "trunk")

        assert robot.cell.robot("robot").tcp == tool

        in_trunk = robot.base_pose.inverse() @ robot.cell.frame("pack")
        robot.test_move({"HomDF": 30}, 0.2)

        seen = robot.base_pose.inverse() @ robot.cell.frame("pack")

        np.testing.assert_allclose(seen.GetAsMatrix4(), in_trunk.GetAsMatrix4(), atol=1e-9)

    def test_a_station_file_names_the_link(self):
        pack = {
            "model": "parcel",
            "parent": "robot",
            "frame": "trunk",
            "pose": [0, 0.09, 0.0, 0, 0, 0],
        }
        station = load_station("humanoid_dynamic", {"pieces.pack": pack})

        robot = LeggedRobot(station)

        assert robot.cell.robot("robot").tcp == "right_hand"
        np.testing.assert_allclose(
            robot.cell.frame("pack").translation(), [0, 0.09, 0.446], atol=1e-9
        )
        with pytest.raises(UnknownName, match="did you mean 'trunk'"):
            robot.attach("pack", "trnk")

    @pytest.mark.parametrize("tool", ["right_hand", "bottle"])
    def test_what_is_put_into_a_backpack_is_no_tool(self, tool):
        """Nor is the backpack the tool of a robot whose tool was taken out of it."""
        pack = {
            "model": "parcel",
            "parent": "robot",
            "frame": "trunk",
            "pose": [0, 0.09, 0, 0, 0, 0],
        }
        bottle = {"model": "parcel", "parent": "world", "pose": [0, 0.09, 0.6, 0, 0, 0]}
        robot = LeggedRobot(
            load_station("humanoid_dynamic", {"pieces.pack": pack, "pieces.bottle": bottle})
        )

        robot.cell.attach("bottle", "pack", pose=[0, 0, 0.1, 0, 0, 0])

        assert robot.cell.robot("robot").tcp == "right_hand"

        robot.cell.tool("robot", tool)
        robot.cell.attach("bottle", "world")

        assert robot.cell.robot("robot").tcp == "right_hand"

    def test_a_quadruped_carries_on_its_trunk(self):
        robot = LeggedRobot(
            load_station(
                "yobotics_dynamic",
                {"pieces.parcel": {"parent": "robot", "pose": [0, 0, 0.1, 0, 0, 0]}},
            )
        )
        place = robot.base_pose.inverse() @ robot.cell.frame("parcel")
        np.testing.assert_allclose(place.translation(), [0, 0, 0.1], atol=1e-9)


def test_a_tool_near_enough_takes_a_piece_and_one_further_away_does_not():
    arm = Arm(load_station("irb120_kinematic", BARE))
    size = 0.03  # REACH
    top = arm.cell.frame("weight").translation() + np.array([0, 0, 0.2])

    for away in (0.02, 0.06):
        arm.cell.attach("weight", "world", pose=[*top, 0, 0, 0])
        arm.move_j([0, 0, -away, 0, 0, np.pi], wobj="weight", check=None)  # under it
        if away < size:
            arm.attach("weight")
            arm.release("weight")
        else:
            with pytest.raises(InvalidParameter, match="48 mm away from load"):
                arm.attach("weight")


def test_the_tool_in_use_takes_a_piece_where_it_is_moved_to():
    arm = Arm(load_station("irb120_kinematic", BARE))
    arm.tool([0, 0, 0.1, 0, 0, 0])  # a tip 10 cm further out
    arm.move_j([0, 0, 0.01, 0, 0, np.pi], wobj="weight")

    arm.attach("weight")

    assert arm.cell.config.pieces["weight"].parent == "load"


@pytest.mark.parametrize("station", ["irb120_kinematic", "irb120_dynamic"])
def test_what_nobody_holds_is_not_let_go(station):
    arm = Arm(load_station(station, BARE))
    with pytest.raises(
        InvalidParameter, match="weight: it is attached to no robot and to no piece"
    ):
        arm.release("weight")
