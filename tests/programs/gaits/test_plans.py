"""Plans: feet where they were meant to be, the zero-moment point over them, and bad figures refused."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.biped import BipedWalk, planned_walk, walk
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.phases import SAMPLE, Phase, gait_plan
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, crawl, nearest_inside, three_legs, trot
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.gaits.walker import Walker, facing_rotation, feet_of, rolled_distances, rotations_about
from simrob_drake.programs.gaits.zmp import whole_body_zmp
from simrob_drake.stations.clearance import standing
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

WALKS = [("humanoid", "walk"), ("humanoid", "real_sole"), ("roid1", "walk"), ("zjudancer", "walk")]


def feet_in_walking_direction(motion):
    """Return the feet, the place of each (m, 3) and its rotation from flat and ahead (m, 3, 3)."""
    skeleton, facing = skeleton_of(motion.model), load_gaits(motion.model).facing_deg
    back = np.eye(4)
    back[:3, :3] = facing_rotation(facing)
    root, feet = back @ motion.root, feet_of(skeleton, facing, motion.feet)
    poses = {foot.name: foot.poses(motion.positions, root) for foot in feet}
    places = {foot.name: poses[foot.name][:, :3, 3] - [0, 0, foot.over] for foot in feet}
    flat = {name: pose[:, :3, :3] for name, pose in poses.items()}
    return feet, places, flat, whole_body_zmp(skeleton, root, motion.positions, SAMPLE)


def margin(corners, point):
    sides = ConvexHull(corners).equations
    return -(sides[:, :2] @ point + sides[:, 2]).max()


@pytest.mark.long
@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_soles_stay_flat_and_the_zero_moment_point_over_those_that_stand(robot, name):
    motion = walk(robot, 6, name)
    feet, places, flat, zmp = feet_in_walking_direction(motion)
    for foot in feet:
        assert places[foot.name][:, 2].min() > -1e-5
        np.testing.assert_allclose(flat[foot.name], np.broadcast_to(np.eye(3), flat[foot.name].shape), atol=1e-4)
        standing = places[foot.name][:, 2] < 1e-6
        still = standing[1:] & standing[:-1]
        assert np.abs(np.diff(places[foot.name][:, 0])[still]).max() < 1e-5  # no foot is dragged along
        assert places[foot.name][:, 2].max() == pytest.approx(load_gaits(robot).walks[name].lift, abs=1e-3)
    for row in range(0, len(zmp), 3):
        corners = [
            places[foot.name][row, :2] + foot.half * sign
            for foot in feet
            if places[foot.name][row, 2] < 1e-6
            for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
        assert margin(np.array(corners), zmp[row]) > 0.005, f"at {motion.times[row]:.2f} s"


@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_the_zero_moment_point_is_where_it_was_asked_for(robot, name):
    _, wanted, planned = planned_walk(Walker.of(robot), 6, load_gaits(robot).walks[name])
    assert np.abs(wanted - planned).max() < 5e-4


@pytest.mark.parametrize("ramp_steps", [0, 1, 3, 9])
def test_a_walk_goes_as_far_as_its_steps_say(ramp_steps):
    motion = walk("roid1", 7, step_length=0.04, ramp_steps=ramp_steps)
    assert motion.root[-1, 0, 3] == pytest.approx(7 * 0.04, abs=1e-3)
    footfalls = 7 + min(ramp_steps, 7) + 1  # the last step brings the feet together
    assert motion.duration == pytest.approx(2 * 0.6 + 0.3 * footfalls + 1.0)
    assert motion.root[-1, 1, 3] == pytest.approx(0, abs=1e-3)
    assert np.abs(motion.velocities[[0, -1]]).max() == 0


def test_a_turning_walk_turns():
    motion = walk("zjudancer", 9, "turn", turn_deg=6)
    heading = np.arctan2(motion.root[-1, 1, 0], motion.root[-1, 0, 0])
    assert np.rad2deg(heading) == pytest.approx(9 * 6, abs=1e-6)


def test_the_humanoid_walks_to_where_it_looks():
    assert walk("humanoid", 6).root[-1, 1, 3] < -0.2


def test_feet_of_a_crawl_roll_and_its_zero_moment_point_stays_inside():
    motion = crawl("yobotics", 4)
    _, places, _, zmp = feet_in_walking_direction(motion)
    for row in range(0, len(zmp), 3):
        corners = [place[row, :2] for place in places.values() if place[row, 2] < 1e-6]
        assert margin(np.array(corners), zmp[row]) > 0.02, f"at {motion.times[row]:.2f} s"


@pytest.mark.parametrize("foot", CRAWL_ORDER)
def test_a_foot_is_lifted_as_high_and_as_long_as_asked(foot):
    motion = three_legs("yobotics", foot=foot, height=0.035, seconds=2.0)
    _, places, _, _ = feet_in_walking_direction(motion)
    assert (places[foot][:, 2] > 0.0349).sum() * SAMPLE >= 2.0
    assert all(place[:, 2].max() < 1e-5 for name, place in places.items() if name != foot)


def test_a_ball_rolls_by_its_radius_times_the_angle():
    angle = np.linspace(0, 0.4, 41)
    standing = np.ones(41, dtype=bool)
    rotation = rotations_about(np.array([0.0, 1.0, 0.0]), angle)
    np.testing.assert_allclose(rolled_distances(rotation, standing, 0.025)[-1], [0.025 * 0.4, 0], rtol=1e-4)
    standing[20:30] = False
    again = rolled_distances(rotation, standing, 0.025)
    np.testing.assert_allclose(again[30], 0, atol=1e-9)  # it lands where it was meant to
    np.testing.assert_allclose(again[-1], [0.025 * 0.1, 0], rtol=1e-4)


def test_nearest_inside_goes_to_the_nearest_place():
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(nearest_inside(np.array([0.3, 0.3]), triangle, 0.1), [0.3, 0.3])
    np.testing.assert_allclose(nearest_inside(np.array([0.3, -2.0]), triangle, 0.1), [0.3, 0.1])
    np.testing.assert_allclose(nearest_inside(np.array([-1.0, -1.0]), triangle[::-1], 0.1), [0.1, 0.1])
    with pytest.raises(InvalidParameter, match="inside"):
        nearest_inside(np.zeros(2), triangle, 0.5)


def test_a_swing_rises_and_lands():
    phase = Phase(1.0, np.array([0.0, 0.1]), 0.5, {"foot": np.array([0.2, 0.0, 0.3])}, lift=0.05, delay=0.2, rest=0.2)
    way = gait_plan({"foot": np.zeros(3)}, np.zeros(2), [phase])
    np.testing.assert_allclose(way.feet["foot"][[20, 50, 80]], [[0, 0, 0, 0], [0.1, 0, 0.05, 0.15], [0.2, 0, 0, 0.3]],
                               atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(way.zmp[[0, 25, 50, 100], 1], [0, 0.05, 0.1, 0.1])


@pytest.mark.parametrize(
    ("plan", "error", "says"),
    [
        (lambda: walk("roid1", 10, step_length=0.2), OutOfReach, r"_foot is out of reach by \d+ mm"),
        (lambda: walk("humanoid", 10, height=1), InvalidConfig, "height"),
        (lambda: walk("humanoid", 10, turn_deg=5), InvalidParameter, "turn"),
        (lambda: walk("humanoid", 0), InvalidParameter, "steps"),
        (lambda: walk("humanoid", 10, step_time=0), InvalidConfig, "step_time"),
        (lambda: walk("humanoid", 10, double_support=1.5), InvalidParameter, "double_support"),
        (lambda: walk("humanoid", 10, "run"), UnknownName, "run"),
        (lambda: walk("irb120", 10), InvalidParameter, "without gaits"),
        (
            lambda: walk("yobotics", 10),
            UnknownName,
            r"gait of yobotics under walks 'walk'; known: .*crawl \(crawls\), fast",
        ),
        (lambda: walk("humanoide", 10), UnknownName, "there is no robot 'humanoide'; did you mean 'humanoid'"),
        (lambda: trot("yobotics", 0), InvalidParameter, "steps"),
        (lambda: crawl("yobotics", 0), InvalidParameter, "steps is 0; it must be a whole number, 1 to"),
        (lambda: three_legs("yobotics", foot="rear_left_foot", seconds=-1), InvalidConfig, "seconds"),
        (lambda: three_legs("yobotics", foot="left_foot"), UnknownName, "left_foot"),
        (lambda: three_legs("yobotics", foot="rear_left_foot", height=0.5), OutOfReach, "rear_left"),
    ],
)
def test_what_cannot_be_is_refused(plan, error, says):
    with pytest.raises(error, match=says):
        plan()


def test_changes_keep_the_other_figures():
    figures = BipedWalk.of(Walker.of("roid1"), "walk", {"lift": 0.01})
    assert figures.lift == 0.01
    assert figures.step_time == load_gaits("roid1").walks["walk"].step_time


@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_a_walk_begins_in_balance_with_its_soles_on_the_floor(robot, name):
    motion = walk(robot, 4, name)
    config = motion.station()
    plant = add_plant(DiagramBuilder(), resolve(config))
    found = standing(plant, plant.robots["robot"])
    assert found.gap == pytest.approx(0, abs=1e-5)
    assert found.margin > 0.01
    assert config.inputs == ("reference_velocity",)
    assert config.robots["robot"].feet == motion.feet
    assert config.duration == motion.duration
    np.testing.assert_allclose(motion.trajectory().value(0)[:, 0], plant.robots["robot"].initial, atol=1e-12)
