"""A robot on its feet, against bodies that are summed up by hand, and the balance loop that moves its axes."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station
from simrob_drake.parts.controllers.balance import Answer, CaptureStep, StandingBalance, StepChooser, Stepping, Strategy
from simrob_drake.parts.controllers.support import BalanceState, Support
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import compose

# Direction in which each robot looks at the start, from the world's x axis [deg].
FACING = {"humanoid": -90, "roid1": 0, "zjudancer": 90}
G = 9.80665  # [m/s²]
OMEGA = 5.0  # natural frequency of tipping of the robots without a plant [1/s]
FLAT = np.zeros(2)  # no foot is lifted
NO_SPIN = np.zeros(3)  # angular velocity of a base at rest [rad/s]
UPRIGHT = RotationMatrix()


class Stood(NamedTuple):
    """A robot with feet in a plant, and the block under test.

    Attributes:
        plant: the plant.
        robot: the robot in it.
        facing: direction in which the robot looks at the start, from the world's x axis [rad].
        support: kinematics of the robot on its feet.
    """

    plant: MultibodyPlant
    robot: StationRobot
    facing: float
    support: Support


@pytest.fixture(params=FACING, name="stood")
def _stood(request):
    """A robot of the package in its dynamic station."""
    ports = compose(DiagramBuilder(), resolve(load_station(f"{request.param}_dynamic")))
    robot = ports.plant.robots["robot"]
    facing = math.radians(FACING[request.param])
    return Stood(ports.plant.plant, robot, facing, Support(robot, facing))


class Posture(NamedTuple):
    """A robot in a posture, summed up body by body, in the world.

    Attributes:
        com: centre of mass, shape (3,) [m].
        feet: contact points of each foot, shape (points of the foot, 3) [m].
    """

    com: np.ndarray
    feet: list[np.ndarray]

    @property
    def points(self) -> np.ndarray:
        """Contact points of all feet, shape (k, 3) [m]."""
        return np.vstack(self.feet)


def posture_by_hand(stood, position, rotation=UPRIGHT):
    """Sum up the bodies of a robot at axis positions (n,) [rad], its base at the origin with a rotation."""
    plant = stood.plant
    robot = stood.robot
    context = plant.CreateDefaultContext()
    positions = robot.axis_map.spread_positions(position, plant.GetPositions(context))
    start = robot.root.body().floating_positions_start()
    origin = (0.0, 0.0, 0.0)
    positions[start : start + 7] = [*rotation.ToQuaternion().wxyz(), *origin]
    plant.SetPositions(context, positions)

    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
    masses = np.array([body.default_mass() for body in bodies])
    centres = np.array([body.EvalPoseInWorld(context) @ body.default_com() for body in bodies])
    feet = []
    for link in robot.feet.links:
        pose = plant.GetBodyByName(link, robot.instance).EvalPoseInWorld(context)
        feet.append((pose @ robot.feet.support_points(link).T).T)
    return Posture(com=masses @ centres / masses.sum(), feet=feet)


def to_robot(facing):
    """Matrix from x and y of the world to ahead and left of a robot that looks in a direction [rad]."""
    ahead = [math.cos(facing), math.sin(facing)]
    left = [-math.sin(facing), math.cos(facing)]
    return np.array([ahead, left])


def arms_moved(robot):
    """A posture (n,) [rad] whose legs are as at the start, with the other axes at random."""
    is_leg = [any(part in axis for part in ("hip", "knee", "ankle")) for axis in robot.axes]
    return np.where(is_leg, 0.0, 0.5 * np.random.default_rng(1).normal(size=len(robot.axes)))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_the_centre_of_mass_lies_where_the_bodies_put_it(stood, yaw):
    """The deviation of the centre of mass is that of the summed bodies, in the robot's own directions."""
    at_rest = np.zeros(len(stood.robot.axes))
    position = arms_moved(stood.robot)
    rotation = RotationMatrix.MakeZRotation(yaw)
    start = posture_by_hand(stood, at_rest)
    present = posture_by_hand(stood, position, rotation)

    found = stood.support.observe(position, at_rest, rotation, NO_SPIN)

    # The robot's own directions, and its point below the centre of mass, turn with it.
    shift = present.com - rotation @ start.com
    expected = to_robot(stood.facing + yaw) @ shift[:2]
    height = present.com[2] - present.points[:, 2].min()
    assert np.linalg.norm(expected) > 1e-3
    np.testing.assert_allclose(found.com, expected, atol=1e-9)
    np.testing.assert_allclose(found.capture_point, expected, atol=1e-9)
    assert found.omega == pytest.approx(math.sqrt(G / height))


@pytest.mark.parametrize(("ahead", "left"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_robot_that_tips_turns_about_the_edge_it_stands_on(stood, ahead, left):
    """A base that is tipped, and goes on tipping, moves the centre of mass on a circle about the edge of the feet."""
    angle = 0.2  # [rad]
    rate = 1.5  # [rad/s]
    at_rest = np.zeros(len(stood.robot.axes))
    start = posture_by_hand(stood, at_rest)
    below_com = np.array([*start.com[:2], start.points[:, 2].min()])
    fall = to_robot(stood.facing).T @ np.array([ahead, left])  # direction in which the robot falls, in the world
    axis = np.array([-fall[1], fall[0], 0.0])
    rotation = RotationMatrix(AngleAxis(angle, axis))

    found = stood.support.observe(at_rest, at_rest, rotation, rate * axis)

    expected = to_robot(stood.facing) @ (rotation @ (start.com - below_com))[:2]
    np.testing.assert_allclose(found.com, expected, atol=1e-6)
    # v = omega x r, with the arm r from the edge of the feet that is farthest in the direction of the fall.
    edge = start.points[np.argmax(start.points[:, :2] @ fall)]
    velocity = rate * np.cross(axis, rotation @ (start.com - edge))
    assert found.speed @ [ahead, left] == pytest.approx(velocity[:2] @ fall, abs=3e-3)  # the next row counts a little
    assert found.speed @ [-left, ahead] == pytest.approx(0, abs=1e-6)


def test_the_speed_is_that_of_the_centre_of_mass_as_joints_move(stood):
    """The speed that joints give the centre of mass is the central difference of its positions."""
    step = 1e-5  # [s]
    position = arms_moved(stood.robot)
    rates = 3 * position
    after = posture_by_hand(stood, position + step * rates).com
    before = posture_by_hand(stood, position - step * rates).com

    found = stood.support.observe(position, rates, UPRIGHT, NO_SPIN)

    velocity = (after - before) / (2 * step)
    np.testing.assert_allclose(found.speed, to_robot(stood.facing) @ velocity[:2], atol=1e-7)


def test_a_foot_that_is_lifted_is_as_high_as_its_lowest_point(stood):
    """A bent right leg lifts the right foot: each height is that of the foot's lowest point over the lower foot."""
    robot = stood.robot
    at_rest = np.zeros(len(robot.axes))
    bent = np.zeros(len(robot.axes))
    for axis, angle in {"right_hip_pitch": 0.4, "right_knee": 0.8, "right_ankle_pitch": -0.4}.items():
        bent[robot.axes.index(axis)] = angle

    found = stood.support.observe(bent, at_rest, UPRIGHT, NO_SPIN).lifted

    lowest = np.array([foot[:, 2].min() for foot in posture_by_hand(stood, bent).feet])
    np.testing.assert_allclose(found, lowest - lowest.min(), atol=1e-9)
    lifted = [link for link, height in zip(robot.feet.links, found, strict=True) if height > 2e-3]
    assert [link[0] for link in lifted] == ["r"]


def answer(moves=(0.5, -1.0), **changed):
    """A strategy of a robot with two axes, with largest offsets [rad] and changed keys of its section."""
    section = {
        "measures": "forward",
        "moves_deg": {"axis": 1.0},
        "beyond": 0.02,
        "full": 0.06,
        "rise": 0.05,
        "release": 0.2,
        **changed,
    }
    return Answer(Strategy(**section), np.array(moves))


@pytest.mark.parametrize(
    ("changed", "com", "speed", "expected"),
    [
        ({}, (0.02, 0.1), (0.0, 0.0), 0.0),  # at the threshold
        ({}, (0.0, 0.0), (0.2, 0.0), 0.5),  # the capture point is 0.2 / 5 = 0.04 m ahead
        ({}, (0.05, 0.0), (1.0, 0.0), 1.0),
        ({}, (-0.3, 0.0), (0.0, 0.0), 0.0),  # behind: not its side
        ({"measures": "backward"}, (-0.04, 0.0), (0.0, 0.0), 0.5),
        ({"measures": "sagittal"}, (-0.04, 0.0), (0.0, 0.0), -0.5),
        ({"measures": "lateral"}, (0.0, -0.05), (0.0, 0.0), -0.75),
        ({"measures": "left"}, (0.3, 0.03), (0.0, 0.0), 0.25),
        ({"measures": "right", "lead": 0.1}, (0.0, 0.0), (0.0, -0.4), 0.5),
    ],
)
def test_a_strategy_answers_its_own_direction_between_threshold_and_full(changed, com, speed, expected):
    """The part of the offsets is 0 up to an error of 0.02 m, and grows to 1 at 0.06 m."""
    state = BalanceState(np.array(com), np.array(speed), OMEGA, FLAT)

    part = answer(**changed).part(state)

    assert part == pytest.approx(expected)


class GivenState:
    """A support whose results are given: positions are the centre of mass, velocities the heights of the feet."""

    def observe(self, position, velocity, rotation, spin):
        """Put a state together of the two axes, and of the first two components of the angular velocity."""
        return BalanceState(com=position, speed=spin[:2], omega=OMEGA, lifted=velocity)


class Loop:
    """A balance loop whose inputs are fixed, and which is sampled by hand."""

    def __init__(self, block):
        self.block = block
        self.context = block.CreateDefaultContext()

    def sample(self, com, spin=(0.0, 0.0, 0.0), wxyz=(1.0, 0.0, 0.0, 0.0)):
        """Take a sample with a centre of mass (2,) [m], and a reading of the gyroscope. Returns the offsets (2,)."""
        feet_on_floor = [0.0, 0.0]
        inputs = {"position": com, "velocity": feet_on_floor, "orientation": wxyz, "angular_velocity": spin}
        for name, value in inputs.items():
            self.block.GetInputPort(name).FixValue(self.context, np.array(value, dtype=float))
        new_state = self.block.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.get_mutable_discrete_state().SetFrom(new_state)
        return self.output("offset")

    def output(self, name):
        """Value of an output port."""
        return self.block.GetOutputPort(name).Eval(self.context)


def test_offsets_grow_and_go_back_no_faster_than_they_may_and_add_up():
    """One strategy takes 0.05 s to its largest offsets and 0.2 s back; the offsets of another one are added."""
    slow = answer()
    at_once = answer(measures="lateral", moves=(0.0, 0.2), rise=0.0, release=0.0)
    block = StandingBalance(period=0.01, support=GivenState(), answers=[slow, at_once], size=2, gyroscope=True)
    loop = Loop(block)
    twice_one = (2.0, 0.0, 0.0, 0.0)  # a quaternion need not be of length one

    for part in (0.2, 0.4, 0.6, 0.8, 1.0, 1.0):  # 0.01 s are a fifth of 0.05 s
        offset = loop.sample([0.1, 0.04], wxyz=twice_one)
        np.testing.assert_allclose(offset, [0.5 * part, -part + 0.1])
    for part in (0.95, 0.9):  # and a twentieth of 0.2 s
        offset = loop.sample([0.0, 0.0], wxyz=twice_one)
        np.testing.assert_allclose(offset, [0.5 * part, -part], atol=1e-15)


def test_the_gyroscope_measures_in_its_own_axes():
    """A gyroscope that is turned by 90° about z measures about its x what is a turn about the world's y."""
    block = StandingBalance(period=0.01, support=GivenState(), answers=[answer()], size=2, gyroscope=True)
    loop = Loop(block)
    half = math.sqrt(0.5)

    loop.sample([0.0, 0.0], spin=[0.3, 0.0, 0.0], wxyz=[half, 0, 0, half])

    # The given state takes the spin for a speed: the capture point is 0.3 / omega to the left.
    np.testing.assert_allclose(loop.output("capture_point"), [0.0, 0.3 / OMEGA], atol=1e-12)


# Offsets of the two axes of a step [rad]: in its middle, and once the foot is down.
LIFT = (0.3, 0.0)
REACH = (0.4, -0.6)
LEAST_PART = 0.2
STANCE = 0.5


def stepping(lift=LIFT, reach=REACH, **changed):
    """A capture step with the second foot, of ten samples of 0.01 s, with changed keys of its section."""
    section = {
        "measures": "forward",
        "foot": "second",
        "beyond": 0.05,
        "full": 0.1,
        "least": LEAST_PART,
        "duration": 0.1,
        "settle": 0.05,
        "stance": STANCE,
        "lift_deg": {"axis": 1.0},
        "reach_deg": {"axis": 1.0},
        **changed,
    }
    return Stepping(CaptureStep(**section), foot=1, lift=np.array(lift), reach=np.array(reach))


def erring(error, lifted=0.02):
    """A robot that errs ahead [m], with its second foot lifted [m]."""
    return BalanceState(np.array([error, 0.0]), np.zeros(2), OMEGA, np.array([0.0, lifted]))


def smooth_part(time):
    """Part of the way from 0 to 1 at a part of the time: the cubic with speed 0 at both ends."""
    return time**2 * (3 - 2 * time)


class Chooser:
    """A chooser of steps with its state, for a robot with two axes."""

    def __init__(self, *steps):
        self.chooser = StepChooser(steps, 0.01)
        self.state = np.zeros(3)  # number of the step, part of its time, part of its reach
        self.offset = np.zeros(2)

    def sample(self, balance):
        """Take a sample of 0.01 s."""
        self.state, self.offset = self.chooser.next(self.state, self.offset, balance)


def test_a_step_begins_only_beyond_its_threshold():
    """Errors up to the threshold of 0.05 m to either side move nothing."""
    chooser = Chooser(stepping(measures="backward"), stepping())

    for error in (0.04, -0.04, 0.05):
        chooser.sample(erring(error))

        assert not chooser.state.any()
        assert not chooser.offset.any()


def test_a_step_reaches_as_far_as_the_error_grew():
    """A step goes on for its duration, reaches as far as its largest error, settles, and no other step follows."""
    chooser = Chooser(stepping(measures="backward"), stepping())
    largest_part = 0.08 / 0.1  # the largest error over `full`

    for number, (error, part) in enumerate([(0.06, 0.6), (0.08, largest_part), (0.03, largest_part)], start=1):
        chooser.sample(erring(error))
        np.testing.assert_allclose(chooser.state, [2, 0.1 * number, part])

    # After 0.3 of the time; the foot is as far as it goes after 0.7 of it.
    part = largest_part * smooth_part(0.3 / 0.7)
    lift = LIFT[0] * math.sin(0.3 * math.pi)
    np.testing.assert_allclose(chooser.offset, [lift + REACH[0] * part, STANCE * REACH[1] * part])

    for _ in range(7):
        chooser.sample(erring(0.03))
    np.testing.assert_allclose(chooser.state, [2, 1, largest_part])
    in_air = [largest_part * REACH[0], STANCE * largest_part * REACH[1]]
    np.testing.assert_allclose(chooser.offset, in_air, atol=1e-12)

    for _ in range(40):  # 0.4 s, in which the robot errs enough for the other step
        chooser.sample(erring(-0.2))
    np.testing.assert_allclose(chooser.offset, largest_part * np.array(REACH), atol=1e-4)


def test_a_foot_that_touches_after_half_of_the_step_is_down():
    """Before half of the time a foot on the floor does not count; after it the step is over, and the legs settle."""
    on_floor = 0.001  # [m]
    chooser = Chooser(stepping())

    for number in range(1, 7):
        chooser.sample(erring(0.2, lifted=on_floor))
        expected_time = 0.1 * number if number < 6 else 1
        assert chooser.state[1] == pytest.approx(expected_time)

    touching = chooser.offset[0]
    lift = LIFT[0] * math.sin(0.6 * math.pi)
    assert touching == pytest.approx(lift + REACH[0] * smooth_part(0.6 / 0.7))

    chooser.sample(erring(0.2))
    settled_share = 0.01 / 0.05
    assert chooser.offset[0] == pytest.approx(touching + settled_share * (REACH[0] - touching))


def test_strategies_rest_once_the_robot_steps():
    """A strategy follows the error at once, until the error exceeds the 0.05 m of the step; from then on it rests."""
    at_once = answer(rise=0, release=0)
    step = stepping(lift=(0.0, 0.0), reach=(0.0, 0.0))
    loop = Loop(StandingBalance(period=0.01, support=GivenState(), answers=[at_once], steps=[step], size=2))

    offsets = [loop.sample([error, 0.0])[0] for error in (0.04, 0.06, 0.04, 0.06)]

    assert offsets == pytest.approx([0.25, 0.5, 0.0, 0.0])
