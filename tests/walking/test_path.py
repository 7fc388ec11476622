"""Paths against their closed forms, and the follower against the motion of a point."""

from cmath import exp, phase
from itertools import pairwise
from math import pi, radians, sqrt, tan

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.walking.commands import Follower, Path, Waypoints
from simrob_drake.walking.parameters import MaxSpeed

MAX_SPEED = MaxSpeed(ahead=0.3, backward=0.2, sideways=0.1, turn_deg=40)


def pose(place, heading):
    """Return a pose x y z qw qx qy qz on the floor."""
    return np.array([place.real, place.imag, 0.5, np.cos(heading / 2), 0, 0, np.sin(heading / 2)])


def test_a_corner_is_an_arc_that_touches_both_lines():
    path = Path([0j, 2 + 0j, 2 + 1j], 0.3)
    radius = 0.3 / tan(pi / 4)
    assert path.length == pytest.approx(1.7 + radius * pi / 2 + 0.7)
    centre = 1.7 + 1j * radius
    for share in (0.0, 0.3, 0.8):
        spot = path.at(1.7 + share * radius * pi / 2)
        assert spot.place == pytest.approx(centre - 1j * radius * exp(1j * share * pi / 2))
        assert spot.direction == pytest.approx(exp(1j * share * pi / 2))
        assert spot.curvature == pytest.approx(1 / radius)
    assert path.at(path.length).place == pytest.approx(2 + 1j)
    nearest = min(abs(path.at(along).place - 2) for along in np.linspace(0, path.length, 2001))
    assert nearest == pytest.approx(radius * (sqrt(2) - 1), abs=1e-6)


@pytest.mark.parametrize("rounding", [0.0, 0.05, 1.0])
def test_a_path_has_no_gaps_and_its_arcs_end_at_the_middles_of_lines_at_most(rounding):
    corners = [0j, 1 + 0j, 2 + 0j, 2 + 1j, 1.5 + 1j, 1.5 + 2j, 1.5 + 1j, -1 - 1j]  # straight on, and back
    path = Path(corners, rounding)
    alongs = np.linspace(0, path.length, 20001)
    places = np.array([path.at(along).place for along in alongs])
    assert np.abs(np.diff(places)).max() <= alongs[1] * (1 + 1e-9)
    assert np.abs(np.diff(places)).sum() == pytest.approx(path.length, rel=1e-4)
    for first, second in pairwise(corners):
        assert np.abs(places - (first + second) / 2).min() < alongs[1]


def walked(waypoints, place, heading, facing=0.0, duration=60.0):
    """Return where a point comes that does what the follower says, every 10 ms, and how far it is on its path."""
    follower, progress, places = Follower(waypoints, MAX_SPEED, facing), 0.0, [place]
    for _ in range(round(100 * duration)):
        command, progress = follower.now(pose(place, heading - facing), progress)
        place += 0.01 * command.speed * exp(1j * heading)
        heading += 0.01 * command.turn
        places.append(place)
    return np.array(places), heading, progress, follower


def test_a_point_comes_back_to_an_eight_from_beside_it_and_stops_where_it_began():
    turns = np.linspace(0, 2 * pi, 40, endpoint=False)
    eight = Waypoints(points=tuple(zip(0.5 * np.sin(2 * turns), np.sin(turns), strict=True)), laps=1, speed=0.15)
    places, _, progress, follower = walked(eight, -0.1 + 0.1j, radians(90), facing=radians(90))
    curve = np.array([follower.path.at(along).place for along in np.linspace(0, follower.path.length, 3000)])
    off = np.abs(places[::20, np.newaxis] - curve).min(axis=1)
    assert off[30:].max() < 0.05  # a third of what a robot may, whose steps add their sway
    assert abs(places[-1]) < 0.05
    assert progress > follower.path.length
    assert np.abs(curve[200:, np.newaxis] - places[::20]).min(axis=1).max() < 0.05  # all of it was walked
    assert (places[-1] == places[-50:]).all()


def test_it_turns_on_the_spot_where_corners_are_sharp_and_looks_where_it_shall_at_the_end():
    way = Waypoints(points=((0, 0), (1, 0), (1, 1)), rounding=0, speed=0.2, heading_deg=-150)
    places, heading, _, follower = walked(way, 0j, 0.0)
    curve = np.array([follower.path.at(along).place for along in np.linspace(0, 2, 2001)])
    assert np.abs(places[:, np.newaxis] - curve).min(axis=1).max() < 0.1  # it begins to turn a little before the corner
    assert abs(phase(exp(1j * (heading - radians(-150))))) < 0.06
    assert abs(places[-1] - (1 + 1j)) < 0.03


def test_a_pose_that_is_not_a_number_says_nothing():
    way = Follower(Waypoints(points=((0, 0), (1, 0))), MAX_SPEED, 0.0)
    for place in range(7):
        base = pose(0j, 0.0)
        base[place] = np.nan
        if place != 2:  # the height does not matter
            assert way.now(base, 0.25) == (None, 0.25)


def test_points_that_make_no_path_are_refused():
    for points in (((0, 0),), ((0, 0), (0, 0)), ((0, 0), (1, float("nan")))):
        with pytest.raises(InvalidConfig):
            Waypoints(points=points)
