"""Gaits are planned with what a robot carries, on the slope that it stands on, and on boxes."""

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.programs.gaits.biped import BipedWalk, planned_walk
from simrob_drake.programs.gaits.walker import Walker, upright_rotation
from simrob_drake.programs.gaits.zmp import LEVEL, whole_body_zmp
from simrob_drake.programs.legged_gait import _walker, planned_gait
from simrob_drake.stations.resolve import resolve

LOAD = {"pieces.parcel": {"parent": "robot", "pose": [0.0, 0.0, -0.05, 0.0, 0.0, 0.0], "mass": 2.0}}


def test_the_planner_s_robot_weighs_as_much_as_the_station_s():
    """Mass and centre of mass of robot and load together, against Drake's plant of the station."""
    robot = LeggedRobot(load_station("zjudancer_dynamic", LOAD))
    skeleton = _walker(robot, resolve(robot.cell.config)).skeleton
    plant, own = robot.cell.model.plant, robot.cell.robot("robot")
    context = plant.CreateDefaultContext()
    own.axis_map.set_positions(plant, context, robot.position)

    points = skeleton.mass_points(
        skeleton.frames(robot.position[np.newaxis], robot.base_pose.GetAsMatrix4()[None])
    )[0]

    assert skeleton.mass == pytest.approx(plant.CalcTotalMass(context, [own.instance]))

    exact = plant.CalcCenterOfMassPositionInWorld(context, [own.instance])
    np.testing.assert_allclose(
        np.average(points, axis=0, weights=skeleton.point_masses), exact, atol=1e-12
    )


@pytest.mark.long
def test_a_load_changes_the_plan_and_the_walk_stays_straight():
    """With 2 kg in the right hand zjudancer fell after 4.7 s when its gait did not know of them."""
    bare, laden = (LeggedRobot(load_station("zjudancer_dynamic", load)) for load in ({}, LOAD))
    plans = [planned_gait(robot, "walk", {}, steps=6) for robot in (bare, laden)]

    # the hips are to the left of the feet
    assert np.abs(plans[1].positions[0] - plans[0].positions[0]).max() > 0.05

    result = laden.walk(6)
    assert result.ending == "completed"
    assert result.summary()["locomotion"]["yaw"] == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("slope", [(0.1, 0.0), (0.0, 0.1)])
def test_on_a_slope_the_zero_moment_point_is_where_the_line_of_weight_meets_the_ground(slope):
    """At rest: straight below the centre of mass along gravity, which the ground's frame sees tilted."""
    gravity = LEVEL + [-9.80665 * slope[0], -9.80665 * slope[1], 0.0]  # noqa: RUF005
    walker = Walker(Walker.of("zjudancer").skeleton, Walker.of("zjudancer").gaits, gravity)
    gait = BipedWalk.of(walker, "walk", {"sideways": 0.0})

    motion, wanted, planned = planned_walk(walker, 4, gait)

    assert np.abs(wanted - planned).max() < 1e-3

    skeleton, root = walker.skeleton, np.tile(np.eye(4), (3, 1, 1))
    root[:, 2, 3] = 0.5
    angles = np.tile(motion.positions[0], (3, 1))

    com = np.average(
        skeleton.mass_points(skeleton.frames(angles, root))[0],
        axis=0,
        weights=skeleton.point_masses,
    )

    expected = com[:2] + com[2] * gravity[:2] / 9.80665
    np.testing.assert_allclose(
        whole_body_zmp(skeleton, root, angles, 0.01, gravity)[1], expected, atol=1e-12
    )
    np.testing.assert_allclose(
        upright_rotation(gravity) @ [0, 0, 1], -gravity / np.linalg.norm(gravity), atol=1e-12
    )


@pytest.mark.long
@pytest.mark.parametrize("uphill", [True, False])
def test_the_humanoid_walks_up_and_down_a_slope(uphill):
    heading = -90 if uphill else 90  # it looks to -y
    robot = LeggedRobot(
        load_station("humanoid_dynamic", {"floor.incline_deg": 5, "floor.heading_deg": heading})
    )

    seen = _walker(robot, resolve(robot.cell.config)).gravity / 9.80665

    np.testing.assert_allclose(
        seen, [np.sin(np.deg2rad(-5 if uphill else 5)), 0, -np.cos(np.deg2rad(5))], atol=1e-9
    )

    result = robot.walk(6)
    assert result.ending == "completed"

    start, end = result.pose("base")[[0, -1], :3]
    assert -0.7 < end[1] - start[1] < -0.5  # six steps of 0.1 m
    risen = np.tan(np.deg2rad(5)) * (abs(end[1]) if uphill else end[1])
    # the hips come down by up to a tenth of their height
    assert -0.045 < end[2] - start[2] - risen < 0.005


@pytest.mark.long
def test_a_walk_on_a_fixed_box_needs_no_floor():
    box = {"model": "board", "parent": "world"}
    station = load_station("roid1_dynamic", {"pieces.plate": box})
    top = max(
        float(pose.translation()[2] + half[2]) for pose, half in resolve(station).ground.boxes
    )
    lifted = {"pieces.plate": {**box, "pose": [-0.1, -0.2, 1.0 - top, 0, 0, 0]}, "floor": None}
    base = [*station.robots["robot"].base[:2], station.robots["robot"].base[2] + 1.0, 0, 0, 0]
    robot = LeggedRobot(load_station("roid1_dynamic", {**lifted, "robot.base": base}))

    result = robot.walk(2)

    assert result.ending == "completed"
    assert 0.2 < result.summary()["locomotion"]["smallest_height"] < 0.3

    away = LeggedRobot(load_station("roid1_dynamic", {**lifted, "robot.base": [5.0, *base[1:]]}))
    with pytest.raises(InvalidParameter, match=r"a floor or a fixed box under the feet of roid1"):
        away.walk(2)
