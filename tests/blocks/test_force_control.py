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
PERIOD = 0.01  # s between samples
FORCE = 10.0  # N, desired
KP = 0.003  # m/(s·N)
KI = 0.006  # m/(s²·N)


@pytest.fixture(scope="module")
def arm():
    """The plant of an arm that holds a pencil with a tip."""
    ports = closed_station(resolve(load_station("irb120_force_control", {"controllers": {}}))).ports
    return ports.plant


def pressing(arm, *, sensor=None, **changed):
    """A loop that presses with the arm's tool; ``sensor`` is the tool that has the sensor's axes, else the world."""
    (robot,) = arm.robots.values()
    section = ForceControl.model_validate(
        {"kind": "force_control", "force": FORCE, "kp": KP, "ki": KI, **changed}
    )
    frame = arm.plant.world_frame() if sensor is None else robot.tools[sensor]
    return PressingTool(section, arm.plant, robot.axis_map, robot.tools[robot.tcp], frame)


def tool_pose(arm, joints):
    """Pose of the tool in the world for joint positions (6,) [rad]."""
    (robot,) = arm.robots.values()
    plant: MultibodyPlant = arm.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, joints)
    return robot.tools[robot.tcp].CalcPoseInWorld(context)


def angle_between(first, second):
    """Angle between the orientations of two poses [rad]."""
    return (first.rotation().inverse() @ second.rotation()).ToAngleAxis().angle()


def test_its_speed_is_a_pi_law_whose_integral_acts_near_the_force_alone(arm):
    """The integral part only grows while the error is below 2 N, a fifth of the desired force."""
    loop = pressing(arm)
    path = 0.0

    drift = 0.0

    for force in (3.0, 7.9, 8.1, 9.5, 11.0, 12.1):
        error = FORCE - force
        expected_path = path + PERIOD * (KP * error + drift)
        expected_drift = drift + (KI * PERIOD * error if abs(error) < 2 else 0.0)

        path, drift = loop.next_path(path, drift, force)

        assert path == pytest.approx(expected_path)
        assert drift == pytest.approx(expected_drift)
    assert drift > 0


def test_it_is_slow_until_it_touches_fast_afterwards_and_does_not_wind_up_at_its_speed_or_reach(
    arm,
):
    """The speeds are 0.01 m/s without a touch and 0.05 m/s with one, the reach is 0.05 m."""
    loop = pressing(arm, kp=0.02, ki=0.1)

    without_touch = loop.next_path(0.0, 0.0, 0.0)
    with_touch = loop.next_path(0.0, 0.0, 0.1)
    near_force_at_largest_speed = loop.next_path(0.0, 0.2, 9.0)
    at_reach = loop.next_path(0.04999, 0.0, 0.0)

    assert without_touch == (pytest.approx(0.01 * PERIOD), 0.0)
    assert with_touch == (pytest.approx(0.05 * PERIOD), 0.0)
    assert near_force_at_largest_speed == (pytest.approx(0.05 * PERIOD), 0.2)
    assert at_reach.path == 0.05


def test_the_tool_goes_along_the_direction_and_nowhere_else(arm):
    """The tool moves down by 0.1 mm in each sample without a force, and does not turn."""
    driven = Driven(pressing(arm))
    begin = tool_pose(arm, POSTURE)
    for number in range(1, 101):
        outputs = driven.sample(force=np.zeros(3), asked=POSTURE)
        assert outputs["path"] == pytest.approx(1e-4 * number)

    end = tool_pose(arm, POSTURE + outputs["offset"])

    assert end.translation() - begin.translation() == pytest.approx([0, 0, -0.01], abs=2e-6)
    assert angle_between(begin, end) < 1e-5


def test_the_direction_is_one_of_the_sensor_s_axes_and_the_reference_moves_on_below(arm):
    """The path of a tool that the reference turns and moves goes along its own axis as it is then."""
    direction = [0, 0.6, 0.8]
    driven = Driven(pressing(arm, sensor="pencil", direction=direction))
    for number in range(100):
        asked = POSTURE + 0.005 * number
        outputs = driven.sample(force=[0, -2.4, -3.2], asked=asked)  # 4 N against the direction

    reference_pose = tool_pose(arm, asked)
    pose = tool_pose(arm, asked + outputs["offset"])

    direction_in_world = RotationMatrix(reference_pose.rotation()) @ np.array(direction)
    distance = pose.translation() - reference_pose.translation()
    assert outputs["pressing"] == pytest.approx(4.0)
    assert distance == pytest.approx(outputs["path"][0] * direction_in_world, abs=3e-4)
    assert angle_between(reference_pose, pose) < 1e-4


def test_a_joint_offset_stays_small_at_a_singular_posture(arm):
    """With all joints at zero the wrist is straight, where an undamped step would be infinite."""
    driven = Driven(pressing(arm))
    straight = np.zeros(6)

    for _ in range(100):
        outputs = driven.sample(force=np.zeros(3), asked=straight)

    assert abs(outputs["offset"]).max() < 0.2


@pytest.mark.parametrize("source", ["touch", "force.touch"])
def test_its_axes_are_those_of_the_sensor_whether_the_sensor_or_its_output_is_named(source):
    """The direction is given in the axes of the sensor's frame, here those of the pencil."""
    changes = {"controllers.press.reads.force": source, "sensors.touch.frame": "pencil"}

    closed = closed_station(resolve(load_station("irb120_force_control", changes)))

    block = closed.diagram.GetSubsystemByName("controller.press")
    (robot,) = closed.ports.plant.robots.values()
    assert block._sensor == robot.tools["pencil"].index()
