"""The controller `walk` of robots with two legs: kinematics, feedback, and whole runs."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.station import add_station
from simrob_drake.walking.body import Body, BodyState, Rows
from simrob_drake.walking.engine import WalkingEngine
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Stride

HUMANOIDS = ("zjudancer", "roid1", "humanoid")
OMEGA = 5.2  # 1/s
UNTURNED = (1.0, 0.0, 0.0, 0.0)  # quaternion w x y z


class Robot(NamedTuple):
    """Walking robot of a station.

    Attributes:
        engine: its walking engine.
        start: posture near which its legs are found, shape (n,) [rad].
        builder: builder of the station, which keeps the plant alive.
    """

    engine: WalkingEngine
    start: np.ndarray
    builder: DiagramBuilder


def make_robot(station: str, gait: dict[str, Any]) -> Robot:
    """Make the walking robot of a station with changed parameters of its gait."""
    builder = DiagramBuilder()
    add_station(builder, load_station(station, {"controllers.walk.gait": gait}))
    loop = next(block for block in builder.GetSystems() if isinstance(block, WalkingLoop))
    return Robot(loop.engine, loop.start, builder)


@pytest.fixture(scope="module")
def zjudancer() -> Iterator[Robot]:
    robot = make_robot("zjudancer_walking", {})
    yield robot
    assert robot.builder is not None


def observe_at_rest(
    body: Body, posture: np.ndarray, height: float, quaternion: Any = UNTURNED
) -> BodyState:
    """State of a robot at rest whose root is above the origin, at a height [m]."""
    base = [0.0, 0.0, height, *quaternion]
    return body.observe(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))


def pose_of(rows: Rows) -> RigidTransform:
    """Convert a matrix of shape (3, 4) to a pose."""
    return RigidTransform(np.array([*rows, [0, 0, 0, 1]]))


class TestKinematics:
    """A robot that stands, and a foot that is moved."""

    @pytest.mark.parametrize("name", HUMANOIDS)
    def test_soles_stand_side_by_side_with_the_centre_of_mass_over_their_middle(
        self, name: str
    ) -> None:
        robot = make_robot(f"{name}_walking", {})
        body = robot.engine.body
        steps = robot.engine.planner.steps

        _, posture = robot.engine.stand(robot.start)

        state = observe_at_rest(body, posture, 1.0)
        right, left = (pose_of(foot) for foot in state.feet)
        between = right.inverse() @ left
        assert between.translation() == pytest.approx(
            [0, steps.standing_places[1].imag, 0], abs=2e-6
        )
        assert between.rotation().IsNearlyIdentity(2e-6)
        assert state.lowest[0] == pytest.approx(state.lowest[1], abs=2e-6)

        # Seen in a frame whose x axis is ahead.
        middle = body.facing @ ((right.translation() + left.translation()) / 2)
        com = body.facing @ np.array(state.com)
        assert com[0] == pytest.approx(middle[0] + steps.rest_points[0].real, abs=1e-5)
        assert com[1] == pytest.approx(middle[1], abs=1e-5)

    @pytest.mark.parametrize("name", HUMANOIDS)
    def test_a_foot_goes_ahead_and_up_as_desired(self, name: str) -> None:
        robot = make_robot(f"{name}_walking", {})
        body = robot.engine.body
        _, posture = robot.engine.stand(robot.start)
        feet = [pose_of(foot) for foot in observe_at_rest(body, posture, 1.0).feet]
        targets = [RigidTransform(body.facing @ (foot.translation() * [1, 1, 0])) for foot in feet]
        targets[0] = RigidTransform([0.03, 0, 0.02]) @ targets[0]
        root = RigidTransform([0.0, 0.0, 1.0 - feet[0].translation()[2]])

        body.set_posture(posture)
        from_root = np.array([(root.inverse() @ target).GetAsMatrix34() for target in targets])
        solved = body.solve_posture(np.eye(3), from_root, 30)

        right, left = (pose_of(foot) for foot in observe_at_rest(body, solved, 1.0).feet)
        step = body.facing @ (right.translation() - left.translation())
        assert step[[0, 2]] == pytest.approx([0.03, 0.02], abs=1e-5)

    def test_the_posture_has_the_height_pitch_and_width_of_its_parameters(self) -> None:
        bearing = {
            "height": 0.49,
            "pitch_deg": 6,
            "posture_deg": {"RodD": 40, "RodI": 40, "left_elbow": 30},
        }
        robot = make_robot("zjudancer_walking", {"bearing": bearing, "widen": 0.03})
        body = robot.engine.body
        half_width = robot.engine.stance.half_width

        _, posture = robot.engine.stand(robot.start)

        # The robot looks along its root's -y axis, so the root is turned by 90 deg, pitched, and turned back.
        pitch = RotationMatrix.MakeYRotation(np.deg2rad(6))
        turn = (
            RotationMatrix.MakeZRotation(np.pi / 2)
            @ pitch
            @ RotationMatrix.MakeZRotation(-np.pi / 2)
        )
        state = observe_at_rest(body, posture, 0.49, turn.ToQuaternion().wxyz())
        distance = abs(state.feet[0][0][3] - state.feet[1][0][3])
        upright = [foot[2][2] for foot in state.feet]
        elbow = list(load_robot("zjudancer").axes).index("left_elbow")
        assert state.lowest == pytest.approx([0.0, 0.0], abs=1e-4)
        assert upright == pytest.approx([1.0, 1.0], abs=1e-5)
        assert distance == pytest.approx(2 * half_width, abs=1e-5)
        assert half_width == pytest.approx(abs(body.homes[0][1]) + 0.03, abs=1e-6)
        assert np.rad2deg(posture[elbow]) == pytest.approx(30.0)

    def test_a_negative_widen_brings_the_feet_nearer_to_each_other(self) -> None:
        robot = make_robot("zjudancer_walking", {"widen": -0.004})
        body = robot.engine.body
        half_width = robot.engine.stance.half_width
        assert half_width == pytest.approx(abs(body.homes[0][1]) - 0.004, abs=1e-6)

    @pytest.mark.parametrize("correction", [0.05 + 0j, 0.05j, -0.04 + 0.03j])
    def test_the_trunk_leans_by_its_correction(self, zjudancer: Robot, correction: complex) -> None:
        """The real part leans to the right, the imaginary part ahead: the feet show it from a root that is upright."""
        engine = zjudancer.engine
        stride, posture = engine.stand(zjudancer.start)
        leaning = stride._replace(corrections=stride.corrections._replace(lean_integral=correction))

        for _ in range(30):
            engine.body.set_posture(posture)
            posture = engine._posture(leaning, engine.body.com_from_root(), 0.0)

        upright = observe_at_rest(engine.body, posture, 0.5)
        forward = pose_of(upright.feet[1]).rotation().matrix()[:, 2]
        # A trunk that leans by a rotation R sees flat soles turned by its inverse.
        in_facing = engine.body.facing.matrix() @ forward
        pitch = np.deg2rad(engine._bearing.pitch_deg)
        assert np.arctan2(in_facing[1], in_facing[2]) == pytest.approx(correction.real, abs=2e-3)
        assert -np.arcsin(in_facing[0]) == pytest.approx(pitch + correction.imag, abs=2e-3)


@pytest.mark.parametrize("name", HUMANOIDS)
def test_without_feedback_a_walk_is_like_the_planned_one(name: str) -> None:
    """The planned walk corrects the zero-moment point by the whole body, the engine is a pendulum.

    The difference is 1.6 deg rms, most of it in knees that swing or are nearly straight.
    """
    gait = load_gaits(name).walks["walk"]
    planned = walk(name, 6)
    speed = gait.step_length / gait.step_time
    same = gait.model_dump(
        include={
            "step_time",
            "double_support",
            "lift",
            "zmp_inward",
            "zmp_ahead",
            "settle",
            "widen",
        }
    )
    other = {
        "feedback": None,
        "lift_exponent": 3,
        "max_speed_change": [speed / 4, 0.1, 20],
        "bearing": {"height": gait.bearing.height},
    }
    robot = make_robot(f"{name}_walking", {**same, **other})

    stride, posture = robot.engine.stand(robot.start)
    postures = [posture]
    for _ in range(round(100 * (gait.settle + 5 * gait.step_time))):
        stride, posture = robot.engine.sample(stride, posture, Command(complex(speed)), None)
        postures.append(posture)

    errors = np.rad2deg(np.array(postures) - planned.positions[: len(postures)])
    assert np.abs(errors).max() < 14.0
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 1.7


class TestErrorsThatLast:
    """An error that is measured again and again is learnt and removed."""

    def walk_with(self, robot: Robot, com_error: complex = 0j, **measured: Any) -> Stride:
        """State after 8 samples of a swing in which something is measured off its reference."""
        engine = robot.engine
        stride, posture = engine.stand(robot.start)
        exact = Estimate(stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, 0.0, 0j, touches=False)
        for _ in range(60):
            trunk = stride.trunk
            xi = trunk.com if stride.step.active else trunk.zmp
            stride, posture = engine.sample(
                stride, posture, Command(), exact._replace(com=trunk.com, xi=xi)
            )
        standing = exact._replace(com=stride.trunk.com, xi=xi)
        stride, posture = engine.sample(stride, posture, Command(0.1), standing)

        # Go to the swing of the first step at once.
        step = stride.step._replace(transfer=0.0, nominal=0.28, time=0.0)
        stride = stride._replace(step=step, landing=stride.landing._replace(time=0.28))
        for _ in range(8):
            _, xi = engine.planner._plan_step(stride, Command(0.1), OMEGA, None)
            offset = stride.corrections.com_offset
            references = exact._replace(com=stride.trunk.com + offset, xi=xi + offset)
            estimate = references._replace(**measured)
            estimate = estimate._replace(com=estimate.com + com_error)
            stride, posture = engine.sample(stride, posture, Command(0.1), estimate)
        return stride

    def test_without_an_error_nothing_is_learnt(self, zjudancer: Robot) -> None:
        stride = self.walk_with(zjudancer)

        assert abs(stride.corrections.com_offset) < 1e-3
        assert stride.corrections.lean_integral == 0j
        assert stride.corrections.turn_back == 0.0
        assert abs(stride.ground.slope) == 0.0

    def test_the_trunk_leans_against_a_measured_lean(self, zjudancer: Robot) -> None:
        stride = self.walk_with(zjudancer, lean=0.02, pitch=-0.03)

        assert stride.corrections.lean_integral.real < 0
        assert stride.corrections.lean_integral.imag > 0

    def test_the_soles_follow_a_slope(self, zjudancer: Robot) -> None:
        stride = self.walk_with(zjudancer, slope=0.1 - 0.05j)

        assert stride.ground.slope.real > 0
        assert stride.ground.slope.imag < 0

    def test_an_answer_to_an_error_reduces_the_rate_to_a_tenth(self, zjudancer: Robot) -> None:
        calm = self.walk_with(zjudancer, slope=0.1 + 0j).ground.slope.real
        pushed = self.walk_with(zjudancer, slope=0.1 + 0j, xi=0.2 + 0j).ground.slope.real

        assert 0.05 * calm < pushed < 0.2 * calm

    def test_an_offset_of_the_centre_of_mass_is_learnt(self, zjudancer: Robot) -> None:
        stride = self.walk_with(zjudancer, com_error=-0.01 + 0j)

        assert stride.corrections.com_offset.real < -1e-4

    @pytest.mark.parametrize("heading", [0.1, -0.1])
    def test_the_robot_turns_back_to_its_heading(self, zjudancer: Robot, heading: float) -> None:
        stride = self.walk_with(zjudancer, heading=heading)

        assert np.sign(stride.corrections.turn_back) == -np.sign(heading)

    def test_a_standing_robot_learns_the_slope_at_its_rate(self, zjudancer: Robot) -> None:
        """The parameter `slope_rate` is 1/s, so a second brings 1 - 1/e of the slope."""
        engine = zjudancer.engine
        stride, posture = engine.stand(zjudancer.start)
        measured = Estimate(
            stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, 0.0, 0.1 + 0j, touches=False
        )

        for _ in range(100):
            stride, posture = engine.sample(stride, posture, Command(), measured)

        assert not stride.step.active
        assert stride.ground.slope == pytest.approx(0.1 * (1 - np.exp(-1)), rel=1e-6)


def test_soles_show_the_slope_under_them(zjudancer: Robot) -> None:
    engine = zjudancer.engine
    _, posture = engine.stand(zjudancer.start)
    slope = RotationMatrix.MakeYRotation(-np.arctan(0.1)) @ RotationMatrix.MakeXRotation(0.05)
    # Turned by any heading; the robot looks along its root's -y axis.
    turn = RotationMatrix.MakeZRotation(0.7) @ slope @ RotationMatrix.MakeZRotation(-np.pi / 2)

    state = observe_at_rest(engine.body, posture, 0.5, turn.ToQuaternion().wxyz())
    estimate = engine.estimator.estimate(Stride(), state)

    assert estimate.slope == pytest.approx(0.1 + 0.05j, abs=1e-3)


def test_the_first_weight_transfer_takes_its_time_after_any_time_of_standing(
    zjudancer: Robot,
) -> None:
    engine = zjudancer.engine
    stride, posture = engine.stand(zjudancer.start)
    for _ in range(120):
        stride, posture = engine.sample(stride, posture, Command(), None)

    shares = []
    for _ in range(62):
        stride, posture = engine.sample(stride, posture, Command(0.1), None)
        shares.append(stride.swing.share)

    assert stride.step.standing == 1.0
    assert shares[58] == 0  # the parameter `settle` is 0.6 s
    assert shares[61] > 1e-3


def distance_ahead(result: Any, facing: tuple[float, float]) -> float:
    """Distance that a base has gone in the direction in which its robot looks [m]."""
    x = result["base.x"]
    y = result["base.y"]
    return float((x[-1] - x[0]) * facing[0] + (y[-1] - y[0]) * facing[1])


@pytest.mark.long
def test_a_robot_starts_walks_and_stops_by_commands() -> None:
    commands = [{"time": 0.2, "ahead": 0.15}, {"time": 2.5}]

    result = simulate(
        load_station("zjudancer_walking", {"controllers.walk.commands": commands}), duration=5.0
    )

    at_end = result.times > 4.5
    speeds = [result[name][at_end] for name in result.names if name.startswith("v.")]
    assert result.stopped_by is None
    assert 0.15 < distance_ahead(result, (0, 1)) < 0.4
    assert np.abs(speeds).max() < 0.2


@pytest.mark.long
@pytest.mark.parametrize(("gait", "ending"), [({}, None), ({"feedback": None}, "fall")])
def test_only_feedback_answers_a_push(gait: dict[str, Any], ending: str | None) -> None:
    push = {"kind": "push", "start": 2.1, "force": [10.0, 17.3, 0]}  # N, ahead and to the right
    settings = {"forces.push": push, "duration": 4.5, "controllers.walk.gait": gait}

    result = simulate(load_station("zjudancer_walking", settings))

    assert result.stopped_by == ending


# To the left of a robot that looks along -y, in the swing of a foot that cannot step aside [N].
SIDE_PUSH = {"kind": "push", "start": 2.1 + 0.5 * 5 / 8, "force": [20.0, 0, 0]}


@pytest.mark.long
def test_a_robot_that_cannot_step_aside_stops_on_both_feet_and_walks_on() -> None:
    result = simulate(load_station("humanoid_walking", {"forces.push": SIDE_PUSH, "duration": 5.0}))

    feet = result["walk.foot"]
    step_times = result.times[1:][np.diff(feet) != 0]
    y = result["base.y"]
    y_at_four = y[result.times < 4.0][-1]
    assert result.stopped_by is None
    assert np.diff(step_times[step_times > 1.5]).max() > 0.4  # a usual step takes 0.25 s
    assert step_times[-1] > 4.7
    assert y[-1] < y_at_four - 0.05


@pytest.mark.long
def test_a_robot_that_cannot_step_aside_falls_without_bracing() -> None:
    gait = {"feedback": {"brace_threshold": None}}
    settings = {"forces.push": SIDE_PUSH, "duration": 5.0, "controllers.walk.gait": gait}

    result = simulate(load_station("humanoid_walking", settings))

    assert result.stopped_by == "fall"


@pytest.mark.long
def test_a_robot_in_the_air_at_the_end_of_a_push_does_not_diverge() -> None:
    """The solver's steps are short in flight. They stay short in the diagram without the push."""
    push = {"kind": "push", "start": 2.2, "force": [-24.0, 0, 0]}

    result = simulate(load_station("zjudancer_walking", {"forces.push": push, "duration": 3.2}))

    assert result.stopped_by in (None, "fall")


@pytest.mark.long
def test_a_resumed_walk_is_equal_to_the_last_bit() -> None:
    settings = {
        "solver": {"kind": "discrete", "time_step": 0.002},
        "controllers.walk.commands": [{"ahead": 0.2}],
    }
    config = load_station("zjudancer_walking", settings)

    whole = simulate(config, duration=1.6)
    first = simulate(config, duration=0.8)
    second = simulate(config, duration=0.8, start=first.final_state)

    for name in ("q.left_knee", "q_ref.right_hip_roll", "base.x"):
        np.testing.assert_array_equal(whole[name][-1], second[name][-1])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"controllers.walk.commands": [{"time": 2}, {"time": 1}]}, "must not decrease"),
        ({"controllers.walk.gait": {"step_tyme": 0.3}}, "step_time"),
        ({"controllers.walk.gait": {"foothold": {"inner": 0.3}}}, "larger than foothold.inner"),
        ({"controllers.walk.gait": {"groups": [["right_foot"], ["left_fot"]]}}, "left_foot"),
        (
            {
                "robot.model": "irb120",
                "robot.base": [0] * 6,
                "robot.initial_deg": 0,
                "servo.motor": None,
            },
            "stands on its own feet",
        ),
    ],
)
def test_an_invalid_setting_is_refused_with_its_cause(
    settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(SimrobError, match=message):
        simulate(load_station("zjudancer_walking", settings), duration=0.1)
