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
    """The plant with the arm that holds a pencil with a tip."""
    ports = closed_station(resolve(load_station("irb120_force_control", {"controllers": {}}))).ports
    return ports.plant


def pressing(arm, *, sensor=None, **changed):
    """A loop that presses with 10 N, measured in the axes of a tool or of the world, with changed keys."""
    (robot,) = arm.robots.values()
    section = ForceControl.model_validate({"kind": "force_control", "force": 10.0, "ki": 0.006, **changed})
    frame = arm.plant.world_frame() if sensor is None else robot.tools[sensor]
    return PressingTool(section, arm.plant, robot.axis_map, robot.tools[robot.tcp], frame)


def turn_between(pose, other):
    """Angle between two rotations [rad]."""
    return (pose.rotation().inverse() @ other.rotation()).ToAngleAxis().angle()


def pose(arm, joints):
    """Pose of the tool centre point in the world at axis positions (6,) [rad]."""
    (robot,) = arm.robots.values()
    plant: MultibodyPlant = arm.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, joints)
    return robot.tools[robot.tcp].CalcPoseInWorld(context)


def test_its_speed_is_a_pi_law_whose_integral_acts_near_the_force_alone(arm):
    """The path grows by T (kp e + drift), and the drift by ki T e as long as the error e is below 2 N."""
    period = 0.01  # [s]
    kp = 0.003  # [m/(s·N)]
    ki = 0.006  # [m/(s²·N)]
    loop = pressing(arm)
    path = 0.0
    drift = 0.0

    for force in (3.0, 7.9, 8.1, 9.5, 11.0, 12.1):
        error = 10 - force
        next_path = path + period * (kp * error + drift)
        next_drift = drift + (ki * period * error if abs(error) < 2 else 0.0)

        path, drift = loop.next_path(path, drift, force)

        assert (path, drift) == pytest.approx((next_path, next_drift))
    assert drift > 0


def test_it_is_slow_until_it_touches_fast_afterwards_and_does_not_wind_up_at_its_speed_or_reach(arm):
    loop = pressing(arm, kp=0.02, ki=0.1)
    assert loop.next_path(0.0, 0.0, 0.0) == (pytest.approx(1e-4), 0.0)
    assert loop.next_path(0.0, 0.0, 0.1) == (pytest.approx(5e-4), 0.0)
    assert loop.next_path(0.0, 0.2, 9.0) == (pytest.approx(5e-4), 0.2)  # near, but at its speed
    assert loop.next_path(0.04999, 0.0, 0.0)[0] == 0.05


def test_the_tool_goes_along_the_direction_and_nowhere_else(arm):
    """Without contact the tool goes down by 0.1 mm a sample, and neither aside nor turned."""
    driven = Driven(pressing(arm))

    for k in range(1, 101):
        outputs = driven.sample(force=np.zeros(3), asked=POSTURE)
        assert outputs["path"] == pytest.approx(1e-4 * k)

    begin = pose(arm, POSTURE)
    end = pose(arm, POSTURE + outputs["offset"])
    assert end.translation() - begin.translation() == pytest.approx([0, 0, -0.01], abs=2e-6)
    assert turn_between(begin, end) < 1e-5


def test_the_direction_is_one_of_the_sensor_s_axes_and_the_reference_moves_on_below(arm):
    """While the reference moves and turns the tool, the path goes along the direction in the tool's present axes."""
    direction = np.array([0, 0.6, 0.8])
    press = 4.0  # [N]
    driven = Driven(pressing(arm, sensor="pencil", direction=direction.tolist()))

    for k in range(100):
        reference = POSTURE + 0.005 * k
        outputs = driven.sample(force=-press * direction, asked=reference)

    assert outputs["pressing"] == pytest.approx(press)
    desired = pose(arm, reference)
    present = pose(arm, reference + outputs["offset"])
    shift = present.translation() - desired.translation()
    turned_direction = RotationMatrix(desired.rotation()) @ direction
    assert shift == pytest.approx(outputs["path"][0] * turned_direction, abs=3e-4)
    assert turn_between(desired, present) < 1e-4


def test_a_joint_offset_stays_small_at_a_singular_posture(arm):
    driven = Driven(pressing(arm))
    straight = np.zeros(6)
    for _ in range(100):
        given = driven.sample(force=np.zeros(3), asked=straight)
    assert abs(given["offset"]).max() < 0.2
