"""Where feet land on a ground that is known: even places near, no holes, and as high as the ground is."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.station import build_station
from simrob_drake.walking.height_map import CELL, HeightMap
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Landing
from tests.benchmarks.trot import GROUNDS, UNEVEN
from tests.walking.test_planner import COMMAND, OMEGA, TWO_FEET, at_rest, planner, seen

FOOT = 0.02


def step(points):
    """Return heights of a step of 40 mm up at x = 0.5 m."""
    return np.where(points[:, 0] > 0.495, 0.04, 0.0)


def gap(points):
    """Return heights of a gap from 0.5 m to 0.56 m."""
    return np.where(abs(points[:, 0] - 0.53) < 0.03, -0.1, 0.0)


def anywhere(shifts):
    """Allow every shift."""
    return np.ones(shifts.shape, bool)


def shift(ground, *feet, chosen=0j, allowed=anywhere, rise=0.06):
    """Return the shift of feet that step from 0 m."""
    return HeightMap(ground, FOOT).shift(feet, chosen, allowed, 0.0, rise)


def test_heights_are_those_of_the_ground():
    assert HeightMap(step, FOOT).heights([0.3 + 1j, 0.5 - 2j, -7.0 + 0j]) == [0.0, 0.04, 0.0]


def test_feet_land_beside_an_edge_and_out_of_a_gap():
    assert shift(step, 0.4 + 0.1j) == 0
    assert shift(step, 0.51 + 0.1j) == pytest.approx(0.01)  # the nearer side
    assert shift(step, 0.48 + 0.1j) == pytest.approx(-0.01)
    assert shift(step, 0.51 + 0.1j, 0.48 - 0.1j) == pytest.approx(-0.04)  # both of a pair
    assert abs(shift(gap, 0.53 + 0j)) == pytest.approx(0.05, abs=CELL / 2 + 1e-9)  # its bottom is even, and too deep
    assert shift(gap, 0.53 + 0j, rise=0.2) == 0


def test_a_foot_does_not_change_its_mind_and_goes_where_it_may():
    middle = 0.53 + 0j
    sides = {np.sign(shift(gap, middle, chosen=chosen).real) for chosen in (-0.05 + 0j, 0.05 + 0j)}
    assert sides == {-1.0, 1.0}
    ahead = shift(gap, middle, allowed=lambda shifts: shifts.real >= 0)
    assert ahead.real == pytest.approx(0.05, abs=CELL / 2 + 1e-9)
    assert shift(gap, middle, allowed=lambda shifts: np.zeros(shifts.shape, bool)) == 0


def knowing(ground):
    """Return the planner of two feet, with a map."""
    made = planner()
    return WalkPlanner(made._parameters, TWO_FEET, made._period, HeightMap(ground, FOOT))


@pytest.mark.parametrize("height", [0.04, -0.04])
def test_a_foot_comes_to_the_height_of_its_place_up_early_and_down_late(height):
    made = knowing(lambda points: np.where(points[:, 0] > 0.005, height, 0.0))
    blind, stride, heights = planner(), at_rest(planner()), dict[float, float]()
    while not heights or stride.swing.share > 0:  # the first step, of the right foot
        estimate = seen(blind, stride)
        now, _, stride = made.sample(stride, COMMAND, estimate, OMEGA)
        if now.swing.share > 0:
            heights.setdefault(now.swing.share, now.ground.height)  # a late foot seeks the ground from there
    shares, found = np.array([*heights]), np.array([*heights.values()])
    half = np.interp(0.5, shares, found)
    assert found[-1] == pytest.approx(height, abs=1e-9)
    assert half == pytest.approx(max(height, 0.0), abs=1e-3)


def test_a_landing_beside_an_edge_is_planned_for():
    made, blind, stride = knowing(step), planner(), at_rest(planner())
    for _ in range(45):  # it swings
        stride = made.sample(stride, COMMAND, seen(blind, stride), OMEGA)[2]
    where = seen(blind, stride)._replace(origin=0.5 - stride.landing.place.real + 0j)  # it would land on the edge
    place = made.sample(stride, COMMAND, where, OMEGA)[0].landing.place
    assert abs(place - stride.landing.place) > 0.5 * CELL
    heights = step(np.array([[where.in_world(place).real + side, 0.0, 0.0] for side in (-0.015, 0.015)]))
    assert heights[0] == heights[1]
    assert made._shift_to_even_ground(stride, None, Landing(0.1, 0.2j)) == Landing(0.1, 0.2j)


def test_a_map_without_feedback_is_refused():
    told = {"controllers.walk.height_map": True, "controllers.walk.gait": {"feedback": None}}
    with pytest.raises(SimrobError, match=r"walk.height_map is True; it must be false without gait.feedback"):
        build_station(load_station("yobotics_walking", told))


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_gaps_are_crossed_by_who_knows_of_them(known):
    told = {"floor.terrain": {"kind": "gaps", **GROUNDS["gaps"]}, "robot.base": [0.01, 0.01, 0.3, 0, 0, 0]}
    told |= {**UNEVEN, "controllers.walk.height_map": known}
    result = simulate(load_station("yobotics_walking", told), progress=False)
    assert (result.stopped_by is None) == known
