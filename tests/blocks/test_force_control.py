"""The loop that presses, alone: its PI law, that it does not wind up, and where the joints put the tool."""

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake import load_station
from simrob_drake.parts.controllers.efforts import ForceControl, PressingTool
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve
from tests.blocks.test_loop import Driven

POSTURE = np.deg2rad([-10, 35.058, 9.284, 20, 45.658, 30])


@pytest.fixture(scope="module")
def arm():
    """Return the arm that holds a pencil with a tip."""
    ports = closed_station(resolve(load_station("irb120_force_control", {"controllers": {}}))).ports
    return ports.plant


def pressing(arm, *, sensor=None, **changed):
    (robot,) = arm.robots.values()
    section = ForceControl.model_validate({"kind": "force_control", "force": 10.0, "ki": 0.006, **changed})
    frame = arm.plant.world_frame() if sensor is None else robot.tools[sensor]
    return PressingTool(section, arm.plant, robot.axis_map, robot.tools[robot.tcp], frame)


def pose(arm, joints):
    (robot,) = arm.robots.values()
    plant: MultibodyPlant = arm.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, joints)
    return robot.tools[robot.tcp].CalcPoseInWorld(context)


def test_its_speed_is_a_pi_law_whose_integral_acts_near_the_force_alone(arm):
    loop, path, drift = pressing(arm), 0.0, 0.0
    for force in (3.0, 7.9, 8.1, 9.5, 11.0, 12.1):
        error = 10 - force
        wanted = path + 0.01 * (0.003 * error + drift)
        gained = 0.006 * 0.01 * error if abs(error) < 2 else 0.0
        path, after = loop.next_path(path, drift, force)
        assert (path, after) == pytest.approx((wanted, drift + gained))
        drift = after
    assert drift > 0


def test_it_is_slow_until_it_touches_fast_afterwards_and_does_not_wind_up_at_its_speed_or_reach(arm):
    loop = pressing(arm, kp=0.02, ki=0.1)
    assert loop.next_path(0.0, 0.0, 0.0) == (pytest.approx(1e-4), 0.0)
    assert loop.next_path(0.0, 0.0, 0.1) == (pytest.approx(5e-4), 0.0)
    assert loop.next_path(0.0, 0.2, 9.0) == (pytest.approx(5e-4), 0.2)  # near, but at its speed
    assert loop.next_path(0.04999, 0.0, 0.0)[0] == 0.05


def test_the_tool_goes_along_the_direction_and_nowhere_else(arm):
    driven = Driven(pressing(arm))
    begin = pose(arm, POSTURE)
    for k in range(1, 101):
        given = driven.sample(force=np.zeros(3), asked=POSTURE)
        assert given["path"] == pytest.approx(1e-4 * k)
    end = pose(arm, POSTURE + given["offset"])
    assert end.translation() - begin.translation() == pytest.approx([0, 0, -0.01], abs=2e-6)
    assert (begin.rotation().inverse() @ end.rotation()).ToAngleAxis().angle() < 1e-5


def test_the_direction_is_one_of_the_sensor_s_axes_and_the_reference_moves_on_below(arm):
    """The path of a tool that the reference turns and moves goes along its own axis as it is then."""
    driven, direction = Driven(pressing(arm, sensor="pencil", direction=[0, 0.6, 0.8])), [0, 0.6, 0.8]
    for k in range(100):
        asked = POSTURE + 0.005 * k
        given = driven.sample(force=[0, -2.4, -3.2], asked=asked)  # 4 N against the direction
    assert given["pressing"] == pytest.approx(4.0)
    wanted, now = pose(arm, asked), pose(arm, asked + given["offset"])
    turned = RotationMatrix(wanted.rotation()) @ np.array(direction)
    assert now.translation() - wanted.translation() == pytest.approx(given["path"][0] * turned, abs=3e-4)
    assert (wanted.rotation().inverse() @ now.rotation()).ToAngleAxis().angle() < 1e-4


def test_a_joint_offset_stays_small_at_a_singular_posture(arm):
    driven = Driven(pressing(arm))
    straight = np.zeros(6)
    for _ in range(100):
        given = driven.sample(force=np.zeros(3), asked=straight)
    assert abs(given["offset"]).max() < 0.2
