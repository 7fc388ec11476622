"""Height map of the ground: footholds move to even places nearby, out of gaps, and to the height of the ground."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.station import build_station
from simrob_drake.walking.height_map import CELL, HeightMap
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Landing
from tests.benchmarks.trot import GROUNDS, UNEVEN
from tests.walking.test_planner import COMMAND, OMEGA, TWO_FEET, at_rest, estimate_of, make_planner

FOOT = 0.02  # m, half the side of a foot


def step(points):
    """Heights of a step of 40 mm up at x = 0.5 m [m]."""
    return np.where(points[:, 0] > 0.495, 0.04, 0.0)


def gap(points):
    """Heights of a gap from x = 0.5 m to 0.56 m [m]."""
    return np.where(abs(points[:, 0] - 0.53) < 0.03, -0.1, 0.0)


def allow_all(shifts):
    """Allow every shift."""
    return np.ones(shifts.shape, bool)


def allow_none(shifts):
    """Allow no shift."""
    return np.zeros(shifts.shape, bool)


def find_shift(ground, *feet, chosen=0j, allowed=allow_all, rise=0.06):
    """Best shift of feet that step from a height of 0 m [m]."""
    return HeightMap(ground, FOOT).shift(feet, chosen, allowed, 0.0, rise)


def planner_with_map(ground):
    """Planner of a robot with two feet and a map of the ground."""
    planner = make_planner()
    return WalkPlanner(planner._parameters, TWO_FEET, planner._period, HeightMap(ground, FOOT))


def test_heights_are_those_of_the_ground():
    places = [0.3 + 1j, 0.5 - 2j, -7.0 + 0j]

    heights = HeightMap(step, FOOT).heights(places)

    assert heights == [0.0, 0.04, 0.0]


@pytest.mark.parametrize(
    ("feet", "expected"),
    [
        ([0.4 + 0.1j], 0.0),
        ([0.51 + 0.1j], 0.01),  # to the upper side, which is nearer
        ([0.48 + 0.1j], -0.01),  # to the lower side
        ([0.51 + 0.1j, 0.48 - 0.1j], -0.04),  # both feet of a pair to the lower side
    ],
)
def test_feet_land_next_to_an_edge(feet, expected):
    assert find_shift(step, *feet) == pytest.approx(expected)


def test_a_foot_lands_next_to_a_gap_whose_bottom_is_too_deep():
    shift = find_shift(gap, 0.53 + 0j)

    assert abs(shift) == pytest.approx(0.05, abs=CELL / 2 + 1e-9)


def test_a_foot_lands_in_a_gap_whose_bottom_is_within_its_rise():
    assert find_shift(gap, 0.53 + 0j, rise=0.2) == 0


@pytest.mark.parametrize("last_shift", [0.05, -0.05])
def test_a_foot_stays_on_the_side_of_its_last_shift(last_shift):
    shift = find_shift(gap, 0.53 + 0j, chosen=complex(last_shift))

    assert np.sign(shift.real) == np.sign(last_shift)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_shift_is_one_that_the_legs_can_reach(sign):
    shift = find_shift(gap, 0.53 + 0j, allowed=lambda shifts: sign * shifts.real >= 0)

    assert sign * shift.real == pytest.approx(0.05, abs=CELL / 2 + 1e-9)


def test_without_an_allowed_shift_the_foothold_stays():
    assert find_shift(gap, 0.53 + 0j, allowed=allow_none) == 0


@pytest.mark.parametrize("height", [0.04, -0.04])
def test_a_foot_goes_up_early_and_down_late_in_its_swing(height):
    planner = planner_with_map(lambda points: np.where(points[:, 0] > 0.005, height, 0.0))
    without_map = make_planner()
    stride = at_rest(without_map)

    # The first step, of the right foot. A foot is late from the first repeated share on, and searches for the ground.
    heights = dict[float, float]()
    while not heights or stride.swing.share > 0:
        now, _, stride = planner.sample(stride, COMMAND, estimate_of(without_map, stride), OMEGA)
        if now.swing.share > 0:
            heights.setdefault(now.swing.share, now.ground.height)

    values = [*heights.values()]
    height_at_half = np.interp(0.5, [*heights], values)
    assert values[-1] == pytest.approx(height, abs=1e-9)
    assert height_at_half == pytest.approx(max(height, 0.0), abs=1e-3)


def test_a_landing_on_an_edge_is_shifted():
    planner = planner_with_map(step)
    without_map = make_planner()
    stride = at_rest(without_map)
    for _ in range(45):  # to the swing of the first step
        _, _, stride = planner.sample(stride, COMMAND, estimate_of(without_map, stride), OMEGA)
    on_edge = estimate_of(without_map, stride)._replace(origin=0.5 - stride.landing.place.real + 0j)

    now, _, _ = planner.sample(stride, COMMAND, on_edge, OMEGA)

    place = now.landing.place
    x = on_edge.in_world(place).real
    heel, toe = step(np.array([[x - 0.015, 0.0, 0.0], [x + 0.015, 0.0, 0.0]]))
    assert abs(place - stride.landing.place) > 0.5 * CELL
    assert heel == toe


def test_a_landing_without_feedback_is_not_shifted():
    planner = planner_with_map(step)
    landing = Landing(0.1, 0.5 + 0.2j)

    assert planner._shift_to_even_ground(at_rest(planner), None, landing) == landing


def test_a_map_without_feedback_is_refused():
    settings = {"controllers.walk.height_map": True, "controllers.walk.gait": {"feedback": None}}

    with pytest.raises(
        SimrobError, match=r"walk.height_map is True; it must be false without gait.feedback"
    ):
        build_station(load_station("yobotics_walking", settings))


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_gaps_are_only_crossed_with_a_map(known):
    settings = {
        "floor.terrain": {"kind": "gaps", **GROUNDS["gaps"]},
        "robot.base": [0.01, 0.01, 0.3, 0, 0, 0],
        **UNEVEN,
        "controllers.walk.height_map": known,
    }

    result = simulate(load_station("yobotics_walking", settings), progress=False)

    assert (result.stopped_by is None) == known
