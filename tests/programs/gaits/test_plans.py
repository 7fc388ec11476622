"""Planned gaits: the feet follow their plan, the zero-moment point stays over them, and wrong parameters are refused.

Positions are in the frame of the plan: x ahead, y to the left, z up.
"""

from typing import NamedTuple

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.biped import BipedWalk, planned_walk, walk
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.phases import SAMPLE, Phase, gait_plan
from simrob_drake.programs.gaits.quadruped import (
    CRAWL_ORDER,
    crawl,
    nearest_inside,
    three_legs,
    trot,
)
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.gaits.walker import (
    Foot,
    Walker,
    facing_rotation,
    feet_of,
    rolled_distances,
    rotations_about,
)
from simrob_drake.programs.gaits.zmp import whole_body_zmp
from simrob_drake.stations.clearance import standing
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

WALKS = [("humanoid", "walk"), ("humanoid", "real_sole"), ("roid1", "walk"), ("zjudancer", "walk")]


ON_FLOOR = 1e-6  # height below which a foot stands [m]


class FeetInPlan(NamedTuple):
    """Feet of a motion of m samples.

    Attributes:
        feet: the feet.
        positions: middle of each sole, by foot, shape (m, 3) [m].
        rotations: rotation of each foot from flat and ahead, shape (m, 3, 3).
        zmp: zero-moment point, shape (m, 2) [m].
    """

    feet: list[Foot]
    positions: dict[str, np.ndarray]
    rotations: dict[str, np.ndarray]
    zmp: np.ndarray


def feet_in_plan(motion):
    """Compute the feet of a motion, turned back from the direction in which the robot looks."""
    skeleton = skeleton_of(motion.model)
    facing_deg = load_gaits(motion.model).facing_deg
    to_plan = np.eye(4)
    to_plan[:3, :3] = facing_rotation(facing_deg)
    root = to_plan @ motion.root
    feet = feet_of(skeleton, facing_deg, motion.feet)
    poses = {foot.name: foot.poses(motion.positions, root) for foot in feet}
    return FeetInPlan(
        feet=feet,
        positions={foot.name: poses[foot.name][:, :3, 3] - [0, 0, foot.over] for foot in feet},
        rotations={name: pose[:, :3, :3] for name, pose in poses.items()},
        zmp=whole_body_zmp(skeleton, root, motion.positions, SAMPLE),
    )


def margin(corners, point):
    """Distance of a point from the border of the convex hull of corners; negative outside."""
    sides = ConvexHull(corners).equations
    return -(sides[:, :2] @ point + sides[:, 2]).max()


def standing_corners(plan, row):
    """Corners of the soles of all feet that stand at a sample, shape (k, 2) [m]."""
    corners = []
    for foot in plan.feet:
        position = plan.positions[foot.name][row]
        if position[2] < ON_FLOOR:
            corners += [
                position[:2] + foot.half * sign for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
    return np.array(corners)


@pytest.mark.long
@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_soles_stay_flat_and_rest_while_they_stand(robot, name):
    """The soles stay level, do not sink into the floor, do not slide, and rise as high as the gait demands."""
    lift = load_gaits(robot).walks[name].lift

    plan = feet_in_plan(walk(robot, 6, name))

    for foot in plan.feet:
        positions = plan.positions[foot.name]
        rotations = plan.rotations[foot.name]
        is_standing = positions[:, 2] < ON_FLOOR
        stays_down = is_standing[1:] & is_standing[:-1]
        np.testing.assert_allclose(
            rotations, np.broadcast_to(np.eye(3), rotations.shape), atol=1e-4
        )
        assert positions[:, 2].min() > -1e-5
        assert positions[:, 2].max() == pytest.approx(lift, abs=1e-3)
        assert np.abs(np.diff(positions[:, 0])[stays_down]).max() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_the_zero_moment_point_of_a_walk_stays_over_the_standing_soles(robot, name):
    """At every third sample it is at least 5 mm inside the area that the standing soles span."""
    motion = walk(robot, 6, name)

    plan = feet_in_plan(motion)

    for row in range(0, len(plan.zmp), 3):
        assert margin(standing_corners(plan, row), plan.zmp[row]) > 0.005, (
            f"at {motion.times[row]:.2f} s"
        )


@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_the_zero_moment_point_of_a_walk_is_the_desired_one(robot, name):
    """A few rounds of the preview reduce its error to less than 0.5 mm."""
    walk_parameters = load_gaits(robot).walks[name]

    plan = planned_walk(Walker.of(robot), 6, walk_parameters)

    assert np.abs(plan.desired_zmp - plan.zmp).max() < 5e-4


@pytest.mark.parametrize("ramp_steps", [0, 1, 3, 9])
def test_a_walk_goes_as_far_as_its_full_steps(ramp_steps):
    """Steps of the ramps make a walk longer in time, but not in distance."""
    steps = 7
    step_length = 0.04  # [m]
    step_time = 0.3  # of roid1 [s]
    settle = 0.6  # [s]
    rest = 1.0  # [s]
    # One step is added for each step of a ramp, which has at most all steps, and one that brings the feet together.
    touchdowns = steps + min(ramp_steps, steps) + 1

    motion = walk("roid1", steps, step_length=step_length, ramp_steps=ramp_steps)

    end = motion.root[-1, :3, 3]
    assert end[0] == pytest.approx(steps * step_length, abs=1e-3)
    assert end[1] == pytest.approx(0, abs=1e-3)
    assert motion.duration == pytest.approx(2 * settle + step_time * touchdowns + rest)
    assert np.abs(motion.velocities[[0, -1]]).max() == 0


def test_a_turning_walk_turns_by_its_full_steps():
    """Nine steps of 6 degrees turn the trunk by 54 degrees."""
    motion = walk("zjudancer", 9, "turn", turn_deg=6)

    trunk = motion.root[-1]
    heading = np.arctan2(trunk[1, 0], trunk[0, 0])
    assert np.rad2deg(heading) == pytest.approx(9 * 6, abs=1e-6)


def test_the_humanoid_walks_to_where_it_looks():
    """The humanoid of MATLAB looks along -y while its root is not turned."""
    motion = walk("humanoid", 6)

    assert motion.root[-1, 1, 3] < -0.2


def test_the_zero_moment_point_of_a_crawl_stays_inside_the_standing_feet():
    """It is at least 20 mm inside the triangle or quadrangle of the feet that stand."""
    motion = crawl("yobotics", 4)

    plan = feet_in_plan(motion)

    for row in range(0, len(plan.zmp), 3):
        corners = [
            position[row, :2] for position in plan.positions.values() if position[row, 2] < ON_FLOOR
        ]
        assert margin(np.array(corners), plan.zmp[row]) > 0.02, f"at {motion.times[row]:.2f} s"


@pytest.mark.parametrize("foot", CRAWL_ORDER)
def test_a_foot_is_raised_to_its_height_for_its_time(foot):
    """The raised foot stays at 35 mm for two seconds, and the other three stay on the floor."""
    height = 0.035
    seconds = 2.0

    plan = feet_in_plan(three_legs("yobotics", foot=foot, height=height, seconds=seconds))

    time_at_height = (plan.positions[foot][:, 2] > height - 1e-4).sum() * SAMPLE
    others = [position for name, position in plan.positions.items() if name != foot]
    assert time_at_height >= seconds
    assert all(position[:, 2].max() < 1e-5 for position in others)


def test_a_ball_rolls_by_its_radius_times_its_angle():
    """A ball of 25 mm that turns by 0.4 rad about y rolls 10 mm ahead."""
    radius = 0.025
    angles = np.linspace(0, 0.4, 41)
    rotations = rotations_about(np.array([0.0, 1.0, 0.0]), angles)

    distances = rolled_distances(rotations, np.ones(41, dtype=bool), radius)

    np.testing.assert_allclose(distances[-1], [radius * 0.4, 0], rtol=1e-4)


def test_a_ball_lands_where_it_is_planned_and_rolls_from_there():
    """In the air the rolled distance returns to zero; afterwards only the angle since the touchdown counts."""
    radius = 0.025
    angles = np.linspace(0, 0.4, 41)
    rotations = rotations_about(np.array([0.0, 1.0, 0.0]), angles)
    standing = np.ones(41, dtype=bool)
    standing[20:30] = False

    distances = rolled_distances(rotations, standing, radius)

    np.testing.assert_allclose(distances[30], 0, atol=1e-9)
    np.testing.assert_allclose(distances[-1], [radius * 0.1, 0], rtol=1e-4)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ([0.3, 0.3], [0.3, 0.3]),  # inside already
        ([0.3, -2.0], [0.3, 0.1]),  # the nearest position is on a side
        ([-1.0, -1.0], [0.1, 0.1]),  # the nearest position is a corner
    ],
)
@pytest.mark.parametrize("sense", [1, -1], ids=["counterclockwise", "clockwise"])
def test_the_nearest_position_inside_a_triangle(point, expected, sense):
    """It is at least the margin away from all sides, whatever the order of the corners."""
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])[::sense]

    position = nearest_inside(np.array(point), triangle, margin=0.1)

    np.testing.assert_allclose(position, expected)


def test_a_triangle_that_is_too_small_for_the_margin_is_refused():
    """No position of a triangle with sides of 1 m is 0.5 m away from all of them."""
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

    with pytest.raises(InvalidParameter, match="inside"):
        nearest_inside(np.zeros(2), triangle, margin=0.5)


def test_a_swing_rises_and_lands_on_its_foothold():
    """Half-way a foot is at its largest height; the zero-moment point moves at a constant speed."""
    landing = np.array([0.2, 0.0, 0.3])  # ahead, left, turn
    phase = Phase(
        duration=1.0,
        zmp=np.array([0.0, 0.1]),
        transfer=0.5,
        swing={"foot": landing},
        lift=0.05,
        delay=0.2,
        rest=0.2,
    )

    plan = gait_plan({"foot": np.zeros(3)}, np.zeros(2), [phase])

    at_liftoff, half_way, at_touchdown = plan.feet["foot"][[20, 50, 80]]
    np.testing.assert_allclose(at_liftoff, [0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(half_way, [0.1, 0, 0.05, 0.15], atol=1e-12)
    np.testing.assert_allclose(at_touchdown, [0.2, 0, 0, 0.3], atol=1e-12)
    np.testing.assert_allclose(plan.zmp[[0, 25, 50, 100], 1], [0, 0.05, 0.1, 0.1])


@pytest.mark.parametrize(
    ("plan", "error", "says"),
    [
        (
            lambda: walk("roid1", 10, step_length=0.2),
            OutOfReach,
            r"_foot is \d+ mm too short",
        ),
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
        (
            lambda: walk("humanoide", 10),
            UnknownName,
            "there is no robot 'humanoide'; did you mean 'humanoid'",
        ),
        (lambda: trot("yobotics", 0), InvalidParameter, "steps"),
        (
            lambda: crawl("yobotics", 0),
            InvalidParameter,
            "steps is 0; it must be a whole number, 1 to",
        ),
        (
            lambda: three_legs("yobotics", foot="rear_left_foot", seconds=-1),
            InvalidConfig,
            "seconds",
        ),
        (lambda: three_legs("yobotics", foot="left_foot"), UnknownName, "left_foot"),
        (
            lambda: three_legs("yobotics", foot="rear_left_foot", height=0.5),
            OutOfReach,
            "rear_left",
        ),
    ],
)
def test_wrong_parameters_are_refused(plan, error, says):
    """The error names the parameter, the gait or the foot."""
    with pytest.raises(error, match=says):
        plan()


def test_changes_keep_the_other_parameters():
    """A change of the lift leaves the time of a step as the robot's file has it."""
    changed = BipedWalk.of(Walker.of("roid1"), "walk", {"lift": 0.01})

    assert changed.lift == 0.01
    assert changed.step_time == load_gaits("roid1").walks["walk"].step_time


@pytest.mark.parametrize(("robot", "name"), WALKS)
def test_a_walk_begins_in_balance_with_its_soles_on_the_floor(robot, name):
    """The station of a walk has its feet, its duration, and the posture in which it begins."""
    motion = walk(robot, 4, name)

    config = motion.station()

    plant = add_plant(DiagramBuilder(), resolve(config))
    stance = standing(plant, plant.robots["robot"])
    assert stance.gap == pytest.approx(0, abs=1e-5)
    assert stance.margin > 0.01
    assert config.inputs == ("reference_velocity",)
    assert config.robots["robot"].feet == motion.feet
    assert config.duration == motion.duration
    np.testing.assert_allclose(
        motion.trajectory().value(0)[:, 0], plant.robots["robot"].initial, atol=1e-12
    )


@pytest.mark.parametrize(("robot", "plan_gait"), [("zjudancer", walk), ("yobotics", trot)])
def test_widened_feet_stand_further_out_on_both_sides(robot, plan_gait):
    narrow = feet_in_plan(plan_gait(robot, 2, widen=0.0))

    wide = feet_in_plan(plan_gait(robot, 2, widen=0.012))

    for foot in narrow.feet:
        outwards = np.sign(foot.home[1])
        moved = wide.positions[foot.name][0] - narrow.positions[foot.name][0]
        assert outwards * moved[1] == pytest.approx(0.012, abs=1e-6)
