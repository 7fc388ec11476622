"""The walking engine on four legs: a trot of diagonal pairs that answers pushes."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import simulate
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.stations.load import load_station
from simrob_drake.stations.station import add_station
from simrob_drake.walking.body import Seen
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Ground, Step, Stride

STATION = "yobotics_walking"
PUSH = {"kind": "push", "start": 2.0, "force": [0.0, 200.0, 0.0]}  # 0.1 s, 2.1 N·s/kg
OPEN = {"controllers.walk.gait": {"feedback": None}}
LINKS = {"front_right": "FR_foot", "rear_left": "RL_foot", "front_left": "FL_foot", "rear_right": "RR_foot"}
FEET = {f"{place}_foot": f"force.{place}" for place in LINKS}
SENSORS = {f"sensors.{place}": {"kind": "force", "body": link} for place, link in LINKS.items()}
FELT = {**SENSORS, "controllers.walk.reads": FEET}


def measured(loop: WalkingLoop, posture: np.ndarray, yaw: float, forces: list[float] | None = None) -> Estimate:
    """Return what the engine makes of a robot that is turned by a yaw, somewhere, its left pair standing."""
    base = np.array([0.7, -0.4, 0.3, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    motion = np.array([0.5 * math.cos(yaw), 0.5 * math.sin(yaw), 0.0, 0.0, 0.0, 0.0])
    return loop.engine.estimator.estimate(
        Stride(), loop.engine.body.seen(np.concatenate([posture, 0 * posture, base, motion])), forces
    )


@pytest.fixture(scope="module")
def loop() -> WalkingLoop:
    """Return the loop of the station, with sensors of force on the feet."""
    builder = DiagramBuilder()
    add_station(builder, load_station(STATION))
    return next(block for block in builder.GetSystems() if isinstance(block, WalkingLoop))


def test_the_line_between_the_feet_of_a_pair_tells_its_heading(loop: WalkingLoop) -> None:
    _, posture = loop.engine.standing(loop.start)
    posture = posture + 0.1 * np.sin(np.arange(len(posture)))  # legs that turn their balls
    level, turned = measured(loop, posture, 0.0), measured(loop, posture, 0.8)
    assert turned.com == pytest.approx(level.com, abs=1e-12)
    assert turned.xi == pytest.approx(level.xi, abs=1e-12)
    assert turned.heading - level.heading == pytest.approx(0.8)
    seen = loop.engine.body.seen(np.concatenate([posture, 0 * posture, [0, 0, 0.3, 1, 0, 0, 0], np.zeros(6)]))
    front, rear = (np.array(seen.feet[foot])[:2, 3] for foot in (2, 3))  # of the left pair
    flat = complex(*(front - rear))
    place = complex(*(seen.com[:2] - (front + rear) / 2)) / flat * abs(flat)
    stood = complex(*(loop.engine.body.homes[2] - loop.engine.body.homes[3])[:2])
    assert level.com == pytest.approx(place * stood / abs(stood), abs=1e-9)


def test_a_pair_touches_when_both_of_its_feet_do(loop: WalkingLoop) -> None:
    _, posture = loop.engine.standing(loop.start)
    assert not measured(loop, posture, 0.0, [20.0, 0.0, 90.0, 90.0]).touches
    assert measured(loop, posture, 0.0, [20.0, 11.0, 0.0, 0.0]).touches


def test_forces_of_some_feet_alone_are_refused() -> None:
    reads = {"front_right_foot": FEET["front_right_foot"]}
    with pytest.raises(InvalidConfig, match="a force sensor for each of front_right_foot, rear_left_foot"):
        add_station(DiagramBuilder(), load_station(STATION, {"controllers.walk.reads": reads}))


@pytest.mark.long
@pytest.mark.parametrize(("changes", "stays"), [({}, True), (OPEN, False)])
def test_a_push_of_200_newtons_is_answered_by_feedback_alone(changes: dict[str, Any], stays: bool) -> None:
    told = {"forces.push": PUSH, "duration": 3.6, "sample_rate": 50, **changes}
    result = simulate(load_station(STATION, told), progress=False)
    assert (result.stopped_by is None) == stays
    assert result["base.x"][np.searchsorted(result.times, 2.0)] > 0.25  # it was on its way


@pytest.mark.long
def test_feet_that_feel_the_floor_trot_as_by_heights() -> None:
    for told in ({}, FELT):
        run = simulate(load_station(STATION, {**told, "duration": 3.5}), progress=False)
        speed = np.diff(run["base.x"][np.searchsorted(run.times, [2.5, 3.5 - 1e-6])])
        assert speed == pytest.approx(0.5, rel=0.06)  # m/s, as commanded; balls that roll would make it 9 % more


def seen(loop: WalkingLoop, posture: np.ndarray, turned: RollPitchYaw) -> Seen:
    """Return what the kinematics make of a robot at rest whose trunk is turned."""
    base = [0.0, 0.0, loop.engine.planner._parameters.bearing.height, *turned.ToQuaternion().wxyz()]
    return loop.engine.body.seen(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))


def test_two_pairs_tell_a_slope_and_each_the_part_along_its_line(loop: WalkingLoop) -> None:
    _, posture = loop.engine.standing(loop.start)
    turned = RollPitchYaw(0.04, -0.1, 0.0)
    up = turned.ToRotationMatrix().matrix()[:, 2]
    slope = -complex(up[0], up[1]) / up[2]  # of the plane that the feet stand on
    tilted = seen(loop, posture, turned)
    assert loop.engine.estimator.slope(tilted) == pytest.approx(slope, abs=1e-3)
    for standing in (0, 1):
        line = loop.engine.stance.about[standing][0]
        told = loop.engine.estimator.estimate(Stride(Step(standing)), tilted).slope
        assert (told * line.conjugate()).real == pytest.approx((slope * line.conjugate()).real, abs=1e-3)
        assert (told * line.conjugate()).imag == pytest.approx(0.0, abs=1e-12)
        over = [0.0 if foot in loop.engine.stance.groups[standing] else 0.005 for foot in range(4)]  # that swing [m]
        raised = tilted._replace(lowest=[sum(pair) for pair in zip(tilted.lowest, over, strict=True)])
        known = Stride(Step(standing), ground=Ground(slope=slope))
        assert loop.engine.estimator.estimate(known, tilted).touches
        assert not loop.engine.estimator.estimate(known, raised).touches


def test_a_foot_that_feels_the_ground_stays_while_the_other_one_comes_down(loop: WalkingLoop) -> None:
    engine = loop.engine
    stride, posture = engine.standing(loop.start)
    while stride.swing.share < 0.7:
        asked = Estimate(stride.trunk.com, stride.trunk.com, 0.0, 0.0, 0.0, 0j, touches=False, down=(False, False))
        stride, posture = engine.sample(stride, posture, Command(0.2 + 0j), asked)
    first, second = engine.stance.groups[1 - int(stride.step.standing)]
    ways = {}
    for down in ((False, False), (True, False)):
        now, after = stride, posture
        for _ in range(4):
            asked = Estimate(now.trunk.com, now.trunk.com, 0.0, 0.0, 0.0, 0j, touches=False, down=down)
            now, after = engine.sample(now, after, Command(0.2 + 0j), asked)
        before, later = (seen(loop, each, RollPitchYaw(0, 0, 0)).lowest for each in (posture, after))
        ways[down] = later[first] - before[first], later[second] - before[second]
    assert ways[False, False] == pytest.approx((ways[False, False][0],) * 2, abs=1e-3)
    assert ways[True, False] == pytest.approx((0.0, ways[False, False][1]), abs=1e-3)
    assert ways[False, False][0] < -0.01


def test_a_first_step_takes_its_time_however_long_it_stood(loop: WalkingLoop) -> None:
    engine = loop.engine
    stride, posture = engine.standing(loop.start)
    for _ in range(50):
        stride, posture = engine.sample(stride, posture, Command(), None)
    stride, _ = engine.sample(stride, posture, Command(0.2 + 0j), None)
    assert stride.step.time == pytest.approx(0.01)
    assert stride.landing.time == pytest.approx(
        engine.planner._parameters.settle + engine.planner._parameters.step_time
    )


@pytest.mark.long
@pytest.mark.parametrize("way", [0, 90, 180])
def test_it_walks_level_on_a_slope_of_six_degrees(way: int) -> None:
    told = {
        "floor.incline_deg": 6,
        "floor.heading_deg": way,
        "duration": 4.0,
        "controllers.walk.commands": [{"ahead": 0.3}],
    }
    run = simulate(load_station(STATION, told), progress=False)
    upright = 1 - 2 * (run["base.qx"] ** 2 + run["base.qy"] ** 2)
    assert np.rad2deg(np.arccos(upright[run.times > 2.0])).max() < 3.0
    assert run["base.x"][-1] == pytest.approx(1.0, abs=0.2)
    assert abs(run["base.y"][-1]) < 0.1


@pytest.mark.long
def test_a_quarter_turn_is_one() -> None:
    told = {"controllers.walk.commands": [{"turn_deg": 45}, {"time": 2.0}], "duration": 4.5}
    run = simulate(load_station(STATION, told), progress=False)
    yaw = np.rad2deg(2 * np.arctan2(run["base.qz"][-1], run["base.qw"][-1]))
    assert yaw == pytest.approx(90, abs=2)


@pytest.mark.long
def test_it_crosses_steps_of_forty_millimetres_by_its_feet() -> None:
    gait = {
        "lift": 0.14,
        "lift_exponent": 1.5,
        "feedback": {"late_touchdown": 0.04, "search_speed": 0.1, "level_rate": 20},
    }
    field = {"kind": "steps", "height": 0.04, "length": 0.6, "seed": 1}
    told = {
        **FELT,
        "floor.terrain": field,
        "controllers.walk.gait": gait,
        "controllers.walk.commands": [{"ahead": 0.2}],
    }
    run = simulate(load_station(STATION, {**told, "duration": 8.0}), progress=False)
    assert run.stopped_by is None
    assert run["base.x"][-1] > 1.0
