"""The controller `walk` of a robot with four legs: estimates of diagonal pairs on ball feet, and whole runs."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import simulate
from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.stations.load import load_station
from simrob_drake.stations.station import add_station
from simrob_drake.walking.body import BodyState
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Ground, Step, Stride

STATION = "yobotics_walking"
LINKS = {
    "front_right": "FR_foot",
    "rear_left": "RL_foot",
    "front_left": "FL_foot",
    "rear_right": "RR_foot",
}
FEET = {f"{place}_foot": f"force.{place}" for place in LINKS}
SENSORS = {f"sensors.{place}": {"kind": "force", "body": link} for place, link in LINKS.items()}
WITH_SENSORS = {**SENSORS, "controllers.walk.reads": FEET}


@pytest.fixture(scope="module")
def loop() -> WalkingLoop:
    """Walking loop of the station."""
    builder = DiagramBuilder()
    add_station(builder, load_station(STATION))
    return next(block for block in builder.GetSystems() if isinstance(block, WalkingLoop))


@pytest.fixture
def posture(loop: WalkingLoop) -> np.ndarray:
    """Posture in which the robot stands, shape (n,) [rad]."""
    return loop.engine.stand(loop.start)[1]


def observe_moving(loop: WalkingLoop, posture: np.ndarray, yaw: float) -> BodyState:
    """State of a robot that is turned by a yaw [rad], somewhere, and moves ahead at 0.5 m/s."""
    place = [0.7, -0.4, 0.3]
    quaternion = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
    velocity = [0.5 * math.cos(yaw), 0.5 * math.sin(yaw), 0.0]
    measured = [posture, 0 * posture, place, quaternion, velocity, np.zeros(3)]
    return loop.engine.body.observe(np.concatenate(measured))


def estimate_moving(
    loop: WalkingLoop, posture: np.ndarray, yaw: float, forces: list[float] | None = None
) -> Estimate:
    """Estimate of a moving robot on its left pair, with forces on the feet [N]."""
    return loop.engine.estimator.estimate(Stride(), observe_moving(loop, posture, yaw), forces)


def observe_at_rest(loop: WalkingLoop, posture: np.ndarray, turn: RollPitchYaw) -> BodyState:
    """State of a robot at rest whose trunk is turned."""
    height = loop.engine.planner._parameters.bearing.height
    base = [0.0, 0.0, height, *turn.ToQuaternion().wxyz()]
    return loop.engine.body.observe(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))


class TestEstimates:
    """Estimates from the state of the robot and from the forces on its feet."""

    def bend_legs(self, posture: np.ndarray) -> np.ndarray:
        """Posture with bent legs, which turn their balls."""
        return posture + 0.1 * np.sin(np.arange(len(posture)))

    @pytest.mark.parametrize("yaw", [0.8, -2.0])
    def test_an_estimate_is_the_same_from_each_heading(
        self, loop: WalkingLoop, posture: np.ndarray, yaw: float
    ) -> None:
        ahead = estimate_moving(loop, self.bend_legs(posture), 0.0)
        turned_robot = estimate_moving(loop, self.bend_legs(posture), yaw)

        assert turned_robot.com == pytest.approx(ahead.com, abs=1e-12)
        assert turned_robot.xi == pytest.approx(ahead.xi, abs=1e-12)
        assert turned_robot.heading - ahead.heading == pytest.approx(yaw)

    def test_the_stance_frame_is_that_of_the_line_between_the_feet(
        self, loop: WalkingLoop, posture: np.ndarray
    ) -> None:
        estimate = estimate_moving(loop, self.bend_legs(posture), 0.0)

        state = observe_at_rest(loop, self.bend_legs(posture), RollPitchYaw(0, 0, 0))
        front, rear = (np.array(state.feet[foot])[:2, 3] for foot in (2, 3))  # the left pair
        line = complex(*(front - rear))
        com = complex(*(state.com[:2] - (front + rear) / 2))
        home_line = complex(*(loop.engine.body.homes[2] - loop.engine.body.homes[3])[:2])
        expected = com / (line / abs(line)) * (home_line / abs(home_line))
        assert estimate.com == pytest.approx(expected, abs=1e-9)

    def test_the_divergent_component_is_that_of_a_robot_on_balls(
        self, loop: WalkingLoop, posture: np.ndarray
    ) -> None:
        """A ball of radius r under a hip at h: speed and omega² are less by the factor h / (h - r)."""
        state = observe_moving(loop, posture, 0.0)
        radius = loop.engine.body.ball_radius
        hip = loop.engine.planner._parameters.bearing.height
        factor = hip / (hip - radius)

        estimate = loop.engine.estimator.estimate(Stride(), state)

        com_height = state.com[2] - min(state.lowest)
        omega = math.sqrt(STANDARD_GRAVITY / (com_height * factor))
        assert factor > 1.05
        assert abs(estimate.xi - estimate.com) == pytest.approx(0.5 / factor / omega)

    @pytest.mark.parametrize(
        ("forces", "touches"),
        [
            ([20.0, 0.0, 90.0, 90.0], False),
            ([0.0, 20.0, 90.0, 90.0], False),
            ([20.0, 11.0, 0.0, 0.0], True),
        ],
    )
    def test_a_pair_touches_if_both_of_its_feet_touch(
        self, loop: WalkingLoop, posture: np.ndarray, forces: list[float], touches: bool
    ) -> None:
        estimate = estimate_moving(loop, posture, 0.0, forces)

        assert estimate.touches == touches
        assert estimate.down == (forces[0] > 10, forces[1] > 10)
        assert estimate.hangs == (forces[2] < 10, forces[3] < 10)

    @pytest.mark.parametrize(
        ("distance", "touches"), [(0.0, True), (0.0008, True), (0.0012, False)]
    )
    def test_without_forces_a_foot_touches_within_a_millimetre(
        self, loop: WalkingLoop, posture: np.ndarray, distance: float, touches: bool
    ) -> None:
        state = observe_at_rest(loop, posture, RollPitchYaw(0, 0, 0))
        heights = [distance, distance, 0.0, 0.0]  # the left pair stands

        estimate = loop.engine.estimator.estimate(Stride(), state._replace(lowest=heights))

        assert estimate.touches == touches
        assert estimate.down == ()

    @pytest.mark.parametrize("lower_foot", [0, 1])
    def test_without_forces_the_lower_foot_of_a_pair_decides(
        self, loop: WalkingLoop, posture: np.ndarray, lower_foot: int
    ) -> None:
        state = observe_at_rest(loop, posture, RollPitchYaw(0, 0, 0))
        heights = [0.02, 0.02, 0.0, 0.0]  # the left pair stands
        heights[lower_foot] = 0.0

        estimate = loop.engine.estimator.estimate(Stride(), state._replace(lowest=heights))

        assert estimate.touches


class TestSlopes:
    """A trunk that is turned on a slope: the feet stand on the plane of the trunk."""

    turn = RollPitchYaw(0.04, -0.1, 0.0)

    @property
    def slope(self) -> complex:
        """Slope of the plane with the trunk's vertical axis as its normal."""
        normal = self.turn.ToRotationMatrix().matrix()[:, 2]
        return -complex(normal[0], normal[1]) / normal[2]

    def test_both_pairs_show_the_whole_slope(self, loop: WalkingLoop, posture: np.ndarray) -> None:
        state = observe_at_rest(loop, posture, self.turn)

        assert loop.engine.estimator.slope(state) == pytest.approx(self.slope, abs=1e-3)

    @pytest.mark.parametrize("standing", [0, 1])
    def test_a_pair_shows_the_slope_along_its_line(
        self, loop: WalkingLoop, posture: np.ndarray, standing: int
    ) -> None:
        state = observe_at_rest(loop, posture, self.turn)

        estimate = loop.engine.estimator.estimate(Stride(Step(standing)), state)

        line = loop.engine.stance.offsets[standing][0]
        along = (estimate.slope * line.conjugate()).real
        across = (estimate.slope * line.conjugate()).imag
        assert along == pytest.approx((self.slope * line.conjugate()).real, abs=1e-3)
        assert across == pytest.approx(0.0, abs=1e-12)

    @pytest.mark.parametrize("standing", [0, 1])
    def test_feet_touch_on_a_slope_that_is_known(
        self, loop: WalkingLoop, posture: np.ndarray, standing: int
    ) -> None:
        state = observe_at_rest(loop, posture, self.turn)
        stance_feet = loop.engine.stance.groups[standing]
        raised = [
            height + (0.0 if foot in stance_feet else 0.005)
            for foot, height in enumerate(state.lowest)
        ]
        stride = Stride(Step(standing), ground=Ground(slope=self.slope))
        estimator = loop.engine.estimator

        assert estimator.estimate(stride, state).touches
        assert not estimator.estimate(stride, state._replace(lowest=raised)).touches


@pytest.mark.parametrize("first_has_contact", [False, True])
def test_a_foot_with_contact_stays_while_the_other_one_comes_down(
    loop: WalkingLoop, posture: np.ndarray, first_has_contact: bool
) -> None:
    engine = loop.engine
    stride, _ = engine.stand(loop.start)

    def estimate_of(stride: Stride, down: tuple[bool, bool]) -> Estimate:
        """Estimate of a robot that follows its references."""
        com = stride.trunk.com
        return Estimate(com, com, 0.0, 0.0, 0.0, 0j, touches=False, down=down)

    while stride.swing.share < 0.7:
        stride, posture = engine.sample(
            stride, posture, Command(0.2 + 0j), estimate_of(stride, (False, False))
        )
    before = observe_at_rest(loop, posture, RollPitchYaw(0, 0, 0)).lowest
    first, second = engine.stance.groups[1 - int(stride.step.standing)]
    for _ in range(4):
        down = (first_has_contact, False)
        stride, posture = engine.sample(
            stride, posture, Command(0.2 + 0j), estimate_of(stride, down)
        )

    after = observe_at_rest(loop, posture, RollPitchYaw(0, 0, 0)).lowest
    descent_of_first = before[first] - after[first]
    descent_of_second = before[second] - after[second]
    assert descent_of_second > 0.01
    expected = 0.0 if first_has_contact else descent_of_second
    assert descent_of_first == pytest.approx(expected, abs=1e-3)


def test_a_first_step_takes_its_time_after_any_time_of_standing(
    loop: WalkingLoop, posture: np.ndarray
) -> None:
    engine = loop.engine
    stride, _ = engine.stand(loop.start)
    for _ in range(50):
        stride, posture = engine.sample(stride, posture, Command(), None)

    stride, _ = engine.sample(stride, posture, Command(0.2 + 0j), None)

    parameters = engine.planner._parameters
    assert stride.step.time == pytest.approx(0.01)
    assert stride.landing.time == pytest.approx(parameters.settle + parameters.step_time)


def test_force_sensors_of_some_feet_only_are_refused() -> None:
    reads = {"front_right_foot": FEET["front_right_foot"]}

    with pytest.raises(
        InvalidConfig, match="a force sensor for each of front_right_foot, rear_left_foot"
    ):
        load_station(STATION, {"controllers.walk.reads": reads})


def run(settings: dict[str, Any]) -> Any:
    """Run the station with settings."""
    return simulate(load_station(STATION, settings), progress=False)


@pytest.mark.long
@pytest.mark.parametrize(("gait", "stays_up"), [({}, True), ({"feedback": None}, False)])
def test_only_feedback_answers_a_push(gait: dict[str, Any], stays_up: bool) -> None:
    push = {"kind": "push", "start": 2.0, "force": [0.0, 200.0, 0.0]}  # for 0.1 s: 2.1 N·s/kg
    settings = {
        "forces.push": push,
        "duration": 3.6,
        "sample_rate": 50,
        "controllers.walk.gait": gait,
    }

    result = run(settings)

    x_at_push = result["base.x"][np.searchsorted(result.times, 2.0)]
    assert (result.stopped_by is None) == stays_up
    assert x_at_push > 0.25  # it walks


@pytest.mark.long
@pytest.mark.parametrize("sensors", [{}, WITH_SENSORS])
def test_the_speed_is_that_of_the_command(sensors: dict[str, Any]) -> None:
    """The command is 0.5 m/s. Without the roll factor, balls make it 9 % faster."""
    result = run({**sensors, "duration": 3.5})

    first, last = np.searchsorted(result.times, [2.5, 3.5 - 1e-6])
    speed = result["base.x"][last] - result["base.x"][first]
    assert speed == pytest.approx(0.5, rel=0.06)


@pytest.mark.long
@pytest.mark.parametrize("direction_deg", [0, 90, 180])
def test_the_trunk_is_level_on_a_slope_of_six_degrees(direction_deg: int) -> None:
    settings = {
        "floor.incline_deg": 6,
        "floor.heading_deg": direction_deg,
        "duration": 4.0,
        "controllers.walk.commands": [{"ahead": 0.3}],
    }

    result = run(settings)

    cosine = 1 - 2 * (result["base.qx"] ** 2 + result["base.qy"] ** 2)
    lean_deg = np.rad2deg(np.arccos(cosine[result.times > 2.0]))
    assert lean_deg.max() < 3.0
    assert result["base.x"][-1] == pytest.approx(1.0, abs=0.2)
    assert abs(result["base.y"][-1]) < 0.1


@pytest.mark.long
def test_a_commanded_quarter_turn_is_a_quarter_turn() -> None:
    result = run({"controllers.walk.commands": [{"turn_deg": 45}, {"time": 2.0}], "duration": 4.5})

    yaw = 2 * np.arctan2(result["base.qz"][-1], result["base.qw"][-1])
    assert np.rad2deg(yaw) == pytest.approx(90, abs=2)


@pytest.mark.long
def test_feet_with_sensors_cross_steps_of_forty_millimetres() -> None:
    gait = {
        "lift": 0.14,
        "lift_exponent": 1.5,
        "feedback": {"late_touchdown": 0.04, "search_speed": 0.1, "level_rate": 20},
    }
    settings = {
        **WITH_SENSORS,
        "floor.terrain": {"kind": "steps", "height": 0.04, "length": 0.6, "seed": 1},
        "controllers.walk.gait": gait,
        "controllers.walk.commands": [{"ahead": 0.2}],
        "duration": 8.0,
    }

    result = run(settings)

    assert result.stopped_by is None
    assert result["base.x"][-1] > 1.0
