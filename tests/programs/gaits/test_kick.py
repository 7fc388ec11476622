"""A kick: where its foot swings through and how fast, and what a ball does then by contact alone."""

import re

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.programs.gaits.biped import Kick
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.walker import Walker, facing_rotation
from simrob_drake.programs.moves.kick import KickMove

RADIUS, HOLLOW = 0.0335, 2 / 3  # of the ball [m]; its moment of inertia over m r²
SOLES = {"robot.feet": "soles", "contact.model": "hydroelastic_with_fallback"}
SURFACE = {"model": "point", "stiffness": 1.0e4, "dissipation": 0.5}
QUICK = {"settle": 0.6, "raising": 0.4, "rest": 0.1}


def ball(ahead, left, **others):
    """Return a ball before a robot that looks along y."""
    pose = [-left, ahead, RADIUS, 0, 0, 0]
    return {"model": "tennis_ball", "free": True, "pose": pose, "contact": SURFACE, **others}


@pytest.mark.parametrize(
    ("name", "speed", "ahead"), [("zjudancer", 0.7, 0.15), ("roid1", 0.4, 0.09)]
)
def test_the_tip_of_the_foot_goes_through_the_point_at_the_speed(name, speed, ahead):
    walker, turn = Walker.of(name), np.deg2rad(10.0)
    feet = {foot.name: foot for foot in walker.feet()}
    left = feet["left_foot"].home[1]
    motion = Kick.plan_by_name(
        name, 0, foot="left_foot", speed=speed, toward_deg=10.0, point=(ahead, left), rest=0.0
    )
    facing = facing_rotation(walker.gaits.facing_deg)
    roots = stack_poses(motion.root[:, :3, 3] @ facing.T, facing @ motion.root[:, :3, :3])
    kicking, standing = (
        feet[side].poses(motion.positions, roots) for side in ("left_foot", "right_foot")
    )
    origin = standing[0, :2, 3] - [0.0, feet["right_foot"].home[1]]
    toward = np.array([np.cos(turn), np.sin(turn)])
    tip = kicking[:, :2, 3] + feet["left_foot"].half[0] * toward - origin
    speeds = np.gradient(tip @ toward, motion.times)

    nearest = int(np.linalg.norm(tip - [ahead, left], axis=1)[speeds > 0.9 * speed].argmin())

    at = np.flatnonzero(speeds > 0.9 * speed)[nearest]
    assert np.linalg.norm(tip[at] - [ahead, left]) < speed * 0.5 * 0.01 + 1e-3  # half a sample
    assert speeds[at] == pytest.approx(speed, rel=0.02)
    assert speeds.max() < 1.01 * speed
    np.testing.assert_allclose(standing, np.broadcast_to(standing[0], standing.shape), atol=1e-6)
    np.testing.assert_allclose(kicking[-1], kicking[0], atol=1e-6)

    lift = walker.gaits.section("kicks")["kick"]["lift"]
    assert kicking[at, 2, 3] - kicking[0, 2, 3] == pytest.approx(lift, abs=1e-6)


@pytest.mark.long
def test_a_ball_flies_as_it_is_hit_and_rolls_as_a_hollow_one_does():
    """Sliding until it rolls, it keeps its angular momentum about the points that it touches, m (v + 2/3 r w)."""
    away = np.deg2rad(12.0)
    way = np.array([-np.sin(away), np.cos(away)])  # the robot looks along y
    station = {**SOLES, "servo.motor": "mx_106", "pieces.ball": ball(0.175, 0.06)}
    robot = LeggedRobot(load_station("zjudancer_dynamic", station))
    goal = (robot.cell.frame("ball").translation()[:2] + 2.0 * way).tolist()

    kick = robot.do({"kick": {"ball": "ball", "speed": 0.7, "toward": goal, **QUICK}})

    assert kick.stopped_by is None

    motion, place = kick.piece_velocity("ball"), kick.piece_pose("ball")[:, :2]
    fastest = int(np.linalg.norm(motion[:, :2], axis=1).argmax())

    assert not motion[: fastest - 15].round(2).any()  # it lay still until then
    assert 0.7 * 0.9 < np.linalg.norm(motion[fastest, :2]) < 0.7 * 1.9
    flown = place[-1] - place[0]
    assert np.linalg.norm(flown) > 0.3
    assert abs(np.arctan2(flown[0] * way[1] - flown[1] * way[0], flown @ way)) < np.deg2rad(2.0)
    speed, spin = (
        motion[:, :2] @ way,
        np.cross([0.0, 0.0, 1.0], np.append(way, 0.0)) @ motion[:, 3:].T,
    )
    kept = speed[fastest + 8 :] + HOLLOW * RADIUS * spin[fastest + 8 :]
    np.testing.assert_allclose(kept, kept[-1], rtol=0.05)
    assert speed[-1] == pytest.approx(RADIUS * spin[-1], rel=0.03)  # it rolls
    assert robot.base_pose.translation()[2] == pytest.approx(0.5, abs=0.01)  # and the robot stands


@pytest.mark.parametrize(
    ("move", "changes", "message"),
    [
        (
            {"ball": "ball", "speed": 1.5},
            {},
            r"speed of the kick is 1\.5 m/s.*would turn at .* beyond its limit of 5\.76",
        ),
        ({"ball": "bal"}, {}, "piece 'bal'; did you mean 'ball'"),
        (
            {"ball": "box"},
            {"pieces.box": {"model": "cube", "free": True, "pose": [1, 1, 0.1, 0, 0, 0]}},
            "a sphere",
        ),
        ({"gait": "punt"}, {}, "act of zjudancer 'punt'"),
        ({"foot": "third_foot"}, {}, "'third_foot'"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_cannot_be_kicked_is_refused_before_anything_moves(move, changes, message):
    station = {"servo.motor": "mx_106", "pieces.ball": ball(0.175, 0.06), **changes}
    robot = LeggedRobot(load_station("zjudancer_dynamic", station))

    with pytest.raises(SimrobError, match=message):
        robot.do({"kick": move})
    assert robot.runs == []


def test_a_kick_that_is_too_fast_is_told_the_largest_speed_that_works():
    robot = LeggedRobot(load_station("zjudancer_dynamic", {"servo.motor": "mx_106"}))

    station = robot.cell.config
    with pytest.raises(SimrobError, match=r"it must be at most [\d.]+ m/s: ") as refused:
        KickMove(speed=1.5).swing(robot, station, {})

    largest = float(re.search(r"at most ([\d.]+) m/s", str(refused.value))[1])
    assert 0.3 < largest < 1.5
    assert KickMove(speed=largest).swing(robot, station, {}).duration > 0
    with pytest.raises(SimrobError, match=f"at most {largest:g} m/s"):
        KickMove(speed=round(largest + 0.01, 2)).swing(robot, station, {})


def test_a_ball_out_of_reach_is_refused():
    robot = LeggedRobot(load_station("zjudancer_dynamic", {"pieces.ball": ball(0.6, 0.06)}))
    with pytest.raises(OutOfReach, match=r"the leg of left_foot is \d+ mm too short"):
        robot.do({"kick": {"ball": "ball"}})


def test_legs_that_do_not_turn_kick_ahead_alone():
    walker = Walker.of("humanoid")
    kick = Kick.of(walker, "kick", {})
    motion = kick.plan(walker)

    foot = {foot.name: foot for foot in walker.feet()}["right_foot"]

    assert np.ptp(motion.positions[:, list(foot.axes)], axis=0).max() > 0.2
    with pytest.raises(
        InvalidParameter, match=r"toward_deg is 5\.0; it must be 0, because the legs of humanoid"
    ):
        kick.with_changes({"toward_deg": 5}, 1.0, "kick").plan(walker)


def test_a_robot_on_four_legs_does_not_kick():
    with pytest.raises(InvalidParameter, match="a robot with 4 feet"):
        Kick(bearing={"height": 0.3}).plan(Walker.of("yobotics"))
