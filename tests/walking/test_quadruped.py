"""The walking engine on four legs: a trot of diagonal pairs that answers pushes."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import simulate
from simrob_drake.errors import InvalidConfig
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.stations.load import load_station
from simrob_drake.stations.station import add_station
from simrob_drake.walking.engine import Measured
from simrob_drake.walking.stride import Stride

STATION = "yobotics_walking"
PUSH = {"kind": "push", "start": 2.0, "force": [0.0, 130.0, 0.0]}  # 0.1 s, 1.38 N·s/kg
OPEN = {"controllers.walk.gait": {"feedback": None}}
FEET = {f"{place}_foot": f"force.{place}" for place in ("front_right", "rear_left", "front_left", "rear_right")}


def measured(loop: WalkingLoop, posture: np.ndarray, yaw: float, forces: list[float] | None = None) -> Measured:
    """Return what the engine makes of a robot that is turned by a yaw, somewhere, its left pair standing."""
    base = np.array([0.7, -0.4, 0.3, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    motion = np.array([0.5 * math.cos(yaw), 0.5 * math.sin(yaw), 0.0, 0.0, 0.0, 0.0])
    return loop.engine.measured(
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
    front, rear = (np.array(seen.feet[foot].translation()[:2]) for foot in (2, 3))  # of the left pair
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


@pytest.mark.parametrize(("changes", "stays"), [({}, True), (OPEN, False)])
def test_a_push_of_130_newtons_is_answered_by_feedback_alone(changes: dict[str, Any], stays: bool) -> None:
    told = {"forces.push": PUSH, "duration": 3.6, "sample_rate": 50, **changes}
    result = simulate(load_station(STATION, told), progress=False)
    assert (result.stopped_by is None) == stays
    assert result["base.x"][np.searchsorted(result.times, 2.0)] > 0.25  # it was on its way


def test_feet_that_feel_the_floor_trot_as_by_heights() -> None:
    sensors = {
        f"sensors.{place}": {"kind": "force", "body": link}
        for place, link in (
            ("front_right", "FR_foot"),
            ("rear_left", "RL_foot"),
            ("front_left", "FL_foot"),
            ("rear_right", "RR_foot"),
        )
    }
    told = {**sensors, "controllers.walk.reads": FEET}
    runs = [simulate(load_station(STATION, {**over, "duration": 2.5}), progress=False) for over in ({}, told)]
    by_heights, by_forces = (run["base.x"][-1] for run in runs)
    assert by_forces == pytest.approx(by_heights, rel=0.1)
    assert by_forces > 0.5
