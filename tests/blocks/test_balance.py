"""Balance of a robot on its feet: kinematics against sums over its bodies, strategies and steps against equations."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station
from simrob_drake.base.frames import Vector
from simrob_drake.parts.controllers.balance import (
    Answer,
    CaptureStep,
    StandingBalance,
    StepChooser,
    Stepping,
    Strategy,
)
from simrob_drake.parts.controllers.support import BalanceState, Support
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import compose

FACING = {"humanoid": -90, "roid1": 0, "zjudancer": 90}
G = 9.80665
FLAT = np.zeros(2)  # no foot is lifted


class Standing(NamedTuple):
    """A robot in its plant, whose posture at the start has all axes at 0.

    Attributes:
        plant: the plant.
        robot: the robot.
        facing: direction in which the robot looks, from the world's x axis [rad].
        support: kinematics that are tested.
    """

    plant: MultibodyPlant
    robot: StationRobot
    facing: float
    support: Support

    @property
    def zeros(self) -> Vector:
        """Zero for each axis, shape (n,)."""
        return np.zeros(len(self.robot.axes))

    def bodies(self, position: Vector, rotation: RotationMatrix) -> "Bodies":
        """Compute the robot body by body, for positions of its axes (n,) [rad] and a rotation of its root."""
        plant = self.plant
        robot = self.robot
        context = plant.CreateDefaultContext()
        positions = robot.axis_map.spread_positions(position, plant.GetPositions(context))
        start = robot.root.body().floating_positions_start()
        positions[start : start + 7] = [*rotation.ToQuaternion().wxyz(), 0.0, 0.0, 0.0]
        plant.SetPositions(context, positions)

        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
        masses = np.array([body.default_mass() for body in bodies])
        centres = np.array([body.EvalPoseInWorld(context) @ body.default_com() for body in bodies])
        soles = []
        for link in robot.feet.links:
            pose = plant.GetBodyByName(link, robot.instance).EvalPoseInWorld(context)
            soles.append((pose @ robot.feet.support_points(link).T).T)
        return Bodies(com=masses @ centres / masses.sum(), soles=soles)


class Bodies(NamedTuple):
    """Centre of mass and feet of a robot whose root link is at the world's origin.

    Attributes:
        com: centre of mass, shape (3,) [m].
        soles: contact points of each foot, shape (k, 3) each [m].
    """

    com: Vector
    soles: list[Vector]

    @property
    def points(self) -> Vector:
        """Contact points of all feet, shape (k, 3) [m]."""
        return np.vstack(self.soles)

    @property
    def floor(self) -> float:
        """Height of the lowest contact point [m]."""
        return float(self.points[:, 2].min())


@pytest.fixture(params=FACING, name="standing")
def _standing(request):
    ports = compose(DiagramBuilder(), resolve(load_station(f"{request.param}_dynamic")))
    robot = ports.plant.robots["robot"]
    facing = math.radians(FACING[request.param])
    return Standing(
        plant=ports.plant.plant, robot=robot, facing=facing, support=Support(robot, facing)
    )


def to_heading(facing):
    """Rotation of level vectors from the world's axes to ahead and left, shape (2, 2)."""
    cos = math.cos(facing)
    sin = math.sin(facing)
    return np.array([[cos, sin], [-sin, cos]])


def posture_with_moved_arms(robot):
    """Positions of the axes (n,) [rad]: random for the arms, 0 for the legs."""
    is_leg = [any(part in axis for part in ("hip", "knee", "ankle")) for axis in robot.axes]
    random = np.random.default_rng(1)
    return np.where(is_leg, 0.0, 0.5 * random.normal(size=len(robot.axes)))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_the_centre_of_mass_is_that_of_all_bodies(standing, yaw):
    """The directions ahead and left turn with the robot."""
    position = posture_with_moved_arms(standing.robot)
    rotation = RotationMatrix.MakeZRotation(yaw)

    state = standing.support.observe(position, standing.zeros, rotation, np.zeros(3))

    start = standing.bodies(standing.zeros, RotationMatrix())
    bodies = standing.bodies(position, rotation)
    expected = to_heading(standing.facing + yaw) @ (bodies.com - rotation @ start.com)[:2]
    assert np.linalg.norm(expected) > 1e-3
    np.testing.assert_allclose(state.com, expected, atol=1e-9)
    # At rest the capture point is at the centre of mass.
    np.testing.assert_allclose(state.capture_point, expected, atol=1e-9)
    assert state.omega == pytest.approx(math.sqrt(G / (bodies.com[2] - bodies.floor)))


@pytest.mark.parametrize(("ahead", "left"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_robot_that_tips_turns_about_the_edge_on_which_it_stands(standing, ahead, left):
    """A robot that leans by 0.2 rad in a direction and turns further at 1.5 rad/s."""
    rate = 1.5
    facing = to_heading(standing.facing)
    direction = facing.T @ np.array([ahead, left])
    turn_axis = np.array([-direction[1], direction[0], 0.0])
    rotation = RotationMatrix(AngleAxis(0.2, turn_axis))

    state = standing.support.observe(standing.zeros, standing.zeros, rotation, rate * turn_axis)

    start = standing.bodies(standing.zeros, RotationMatrix())
    below_com = np.array([*start.com[:2], start.floor])
    expected = facing @ (rotation @ (start.com - below_com))[:2]
    np.testing.assert_allclose(state.com, expected, atol=1e-6)
    # The foremost points of the feet in the direction are the edge.
    edge = start.points[np.argmax(start.points[:, :2] @ direction)]
    velocity = rate * np.cross(turn_axis, rotation @ (start.com - edge))[:2]
    # Other points, a little higher than the edge, have a small weight.
    assert state.speed @ [ahead, left] == pytest.approx(velocity @ direction, abs=3e-3)
    assert state.speed @ [-left, ahead] == pytest.approx(0, abs=1e-6)


def test_the_speed_is_that_of_the_centre_of_mass_as_joints_move(standing):
    position = posture_with_moved_arms(standing.robot)
    rates = 3 * position

    state = standing.support.observe(position, rates, RotationMatrix(), np.zeros(3))

    step = 1e-5  # s
    after = standing.bodies(position + step * rates, RotationMatrix()).com
    before = standing.bodies(position - step * rates, RotationMatrix()).com
    velocity = (after - before) / (2 * step)
    expected = to_heading(standing.facing) @ velocity[:2]
    np.testing.assert_allclose(state.speed, expected, atol=1e-7)


def test_a_foot_that_is_lifted_is_as_high_as_its_lowest_point(standing):
    robot = standing.robot
    bent = standing.zeros
    for axis, angle in {
        "right_hip_pitch": 0.4,
        "right_knee": 0.8,
        "right_ankle_pitch": -0.4,
    }.items():
        bent[robot.axes.index(axis)] = angle

    state = standing.support.observe(bent, standing.zeros, RotationMatrix(), np.zeros(3))

    soles = standing.bodies(bent, RotationMatrix()).soles
    lowest = np.array([sole[:, 2].min() for sole in soles])
    np.testing.assert_allclose(state.lifted, lowest - lowest.min(), atol=1e-9)
    is_lifted = state.lifted > 2e-3
    lifted_feet = [link for link, lifted in zip(robot.feet.links, is_lifted, strict=True) if lifted]
    assert len(lifted_feet) == 1
    assert lifted_feet[0].startswith("r")


OMEGA = 5.0  # 1/s: the capture point is ahead of the centre of mass by its speed over OMEGA
PERIOD = 0.01  # s between samples


def answer(*, moves=(0.5, -1.0), **changed):
    """A strategy of two axes that answers errors of 0.02 to 0.06 m ahead, but for keys that are changed."""
    section = {"measures": "forward", "moves_deg": {"axis": 1.0}, "beyond": 0.02, "full": 0.06}
    times = {"rise": 0.05, "release": 0.2}
    return Answer(Strategy(**{**section, **times, **changed}), np.array(moves))


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
def test_a_strategy_answers_its_own_direction_between_threshold_and_full(
    changed, com, speed, expected
):
    state = BalanceState(np.array(com), np.array(speed), OMEGA, FLAT)

    assert answer(**changed).part(state) == pytest.approx(expected)


class FakeSupport:
    """Kinematics of a robot without a model.

    Its two axes are the coordinates of its centre of mass, their velocities the heights of its feet, and its angular
    velocity is the speed of its centre of mass.
    """

    def observe(self, position, velocity, rotation, spin):
        return BalanceState(position, spin[:2], OMEGA, velocity)


class FakeRobot:
    """A loop that is sampled with the centre of mass of a `FakeSupport`."""

    def __init__(self, **loop):
        self.loop = StandingBalance(period=PERIOD, support=FakeSupport(), size=2, **loop)
        self.context = self.loop.CreateDefaultContext()

    def sample(self, com, spin=(0.0, 0.0, 0.0), wxyz=(1.0, 0.0, 0.0, 0.0)):
        """Sample once, and return the offsets."""
        read = {"position": com, "velocity": [0, 0], "orientation": wxyz, "angular_velocity": spin}
        for name, value in read.items():
            self.loop.GetInputPort(name).FixValue(self.context, np.array(value, dtype=float))
        update = self.loop.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.get_mutable_discrete_state().SetFrom(update)
        return self.output("offset")

    def output(self, name):
        return self.loop.GetOutputPort(name).Eval(self.context)


def test_offsets_grow_and_go_back_no_faster_than_they_may_and_add_up():
    """One strategy rises within 0.05 s and releases within 0.2 s; the other one, to the left, acts at once."""
    to_the_left = answer(measures="lateral", moves=[0.0, 0.2], rise=0.0, release=0.0)
    robot = FakeRobot(answers=[answer(), to_the_left])

    for part in (0.2, 0.4, 0.6, 0.8, 1.0, 1.0):
        np.testing.assert_allclose(robot.sample([0.1, 0.04]), [0.5 * part, -part + 0.1])
    for part in (0.95, 0.9):
        np.testing.assert_allclose(robot.sample([0.0, 0.0]), [0.5 * part, -part], atol=1e-15)


def test_a_gyroscope_turns_with_the_robot():
    """Turned by 90° about the vertical, it feels about its x axis what is a turn about the world's y axis."""
    robot = FakeRobot(answers=[answer()], gyroscope=True)
    half = math.sqrt(0.5)

    robot.sample([0.0, 0.0], spin=[0.3, 0.0, 0.0], wxyz=[half, 0, 0, half])

    np.testing.assert_allclose(robot.output("capture_point"), [0.0, 0.3 / OMEGA], atol=1e-12)


def stepping(*, lift=(0.3, 0.0), reach=(0.4, -0.6), **changed):
    """A step of the second foot for errors ahead beyond 0.05 m, of two axes: one lifts the foot, one stands."""
    section = {"measures": "forward", "foot": "second", "beyond": 0.05, "full": 0.1, "least": 0.2}
    times = {"duration": 0.1, "settle": 0.05, "stance": 0.5}
    moves = {"lift_deg": {"axis": 1.0}, "reach_deg": {"axis": 1.0}}
    return Stepping(
        CaptureStep(**{**section, **times, **moves, **changed}), 1, np.array(lift), np.array(reach)
    )


def stands(error, lifted=0.02):
    """A robot whose centre of mass is ahead by an error [m], and whose second foot is lifted [m]."""
    return BalanceState(np.array([error, 0.0]), np.zeros(2), OMEGA, np.array([0.0, lifted]))


class Walker:
    """The state and the offsets of capture steps, from sample to sample."""

    def __init__(self, *steps):
        self.chooser = StepChooser(steps, PERIOD)
        self.state = np.zeros(3)
        self.offset = np.zeros(2)

    def sample(self, balance):
        self.state, self.offset = self.chooser.next(self.state, self.offset, balance)


def test_a_step_begins_beyond_its_threshold_and_reaches_as_far_as_the_error_grew():
    """Errors of 0.06 and 0.08 m call for parts of 0.6 and 0.8 of the reach; a smaller one does not draw it back."""
    robot = Walker(stepping(measures="backward"), stepping())

    for error in (0.04, -0.04, 0.05):
        robot.sample(stands(error))
        assert not robot.state.any()
        assert not robot.offset.any()

    for number, (error, part) in enumerate([(0.06, 0.6), (0.08, 0.8), (0.03, 0.8)], 1):
        robot.sample(stands(error))
        np.testing.assert_allclose(robot.state, [2, 0.1 * number, part])
    reach_time = 0.3 / 0.7  # the foot is as far as it goes after 0.7 of the time
    reach = 0.8 * reach_time**2 * (3 - 2 * reach_time)
    of_foot = 0.3 * math.sin(0.3 * math.pi) + 0.4 * reach
    of_standing_leg = -0.5 * 0.6 * reach
    np.testing.assert_allclose(robot.offset, [of_foot, of_standing_leg])

    for _ in range(7):  # until the end of the step
        robot.sample(stands(0.03))
    np.testing.assert_allclose(robot.state, [2, 1, 0.8])
    np.testing.assert_allclose(robot.offset, [0.8 * 0.4, 0.5 * 0.8 * -0.6], atol=1e-12)

    for _ in range(40):  # it settles, and takes no other step
        robot.sample(stands(-0.2))
    np.testing.assert_allclose(robot.offset, [0.8 * 0.4, 0.8 * -0.6], atol=1e-4)


def test_a_foot_that_touches_after_half_of_the_step_is_down():
    """A touch in the first half of a step is none; then the foot settles by a fifth in 0.01 of 0.05 s."""
    robot = Walker(stepping())
    for time in (0.1, 0.2, 0.3, 0.4, 0.5, 1.0):
        robot.sample(stands(0.2, lifted=0.001))
        assert robot.state[1] == pytest.approx(time)
    offset_at_touch = robot.offset[0]

    robot.sample(stands(0.2))

    reach_time = 0.6 / 0.7
    reach = reach_time**2 * (3 - 2 * reach_time)
    assert offset_at_touch == pytest.approx(0.3 * math.sin(0.6 * math.pi) + 0.4 * reach)
    assert robot.offset[0] == pytest.approx(offset_at_touch + 0.2 * (0.4 - offset_at_touch))


def test_strategies_rest_once_the_robot_steps():
    """The robot steps beyond 0.05 m. Then the strategy, which acts at once, gives no offset any more."""
    still_step = stepping(lift=[0.0, 0.0], reach=[0.0, 0.0])
    robot = FakeRobot(answers=[answer(rise=0, release=0)], steps=[still_step])

    offsets = [robot.sample([error, 0.0])[0] for error in (0.04, 0.06, 0.04, 0.06)]

    assert offsets == pytest.approx([0.25, 0.5, 0.0, 0.0])
