"""Paths against their closed forms, and the follower with the motion of a point that obeys its commands."""

from cmath import exp, phase
from itertools import pairwise
from math import pi, radians, sqrt, tan
from typing import NamedTuple

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.walking.commands import Follower, Path, Spot, Waypoints
from simrob_drake.walking.parameters import MaxSpeed

MAX_SPEED = MaxSpeed(ahead=0.3, backward=0.2, sideways=0.1, turn_deg=40)
PERIOD = 0.01  # s


class Walk(NamedTuple):
    """Motion of a point that obeys a follower.

    Attributes:
        places: positions at each sample, as complex numbers [m].
        turns: turning speed of each command [rad/s].
        heading: heading at the end [rad].
        progress: distance on the path at the end [m].
        path: the path.
    """

    places: np.ndarray
    turns: np.ndarray
    heading: float
    progress: float
    path: Path


def root_pose(place, heading):
    """Pose x y z qw qx qy qz of a root over the floor, shape (7,)."""
    return np.array([place.real, place.imag, 0.5, np.cos(heading / 2), 0, 0, np.sin(heading / 2)])


def follow(waypoints, place, heading, facing=0.0, duration=60.0):
    """Move a point by the commands of a follower for a duration [s].

    Args:
        waypoints: points of the path.
        place: initial position as a complex number [m].
        heading: initial heading in the world [rad].
        facing: direction in which the robot looks if its root is not turned [rad].
        duration: duration of the motion [s].
    """
    follower = Follower(waypoints, MAX_SPEED, facing)
    progress = 0.0
    places = [place]
    turns = []
    for _ in range(round(duration / PERIOD)):
        command, progress = follower.now(root_pose(place, heading - facing), progress)
        place += PERIOD * command.speed * exp(1j * heading)
        heading += PERIOD * command.turn
        places.append(place)
        turns.append(command.turn)
    return Walk(np.array(places), np.array(turns), heading, progress, follower.path)


def sample_path(path, count):
    """Positions at equal distances along a path, as complex numbers, shape (count,) [m]."""
    return np.array([path.at(distance).place for distance in np.linspace(0, path.length, count)])


def distances_to(curve, places):
    """Distance of each position to the nearest point of a curve [m]."""
    return np.abs(places[:, np.newaxis] - curve).min(axis=1)


class TestPath:
    """Lines, and arcs at the corners."""

    corner = 2 + 0j
    rounding = 0.3  # m
    radius = rounding / tan(pi / 4)  # m, of the arc in a right angle

    @pytest.fixture
    def right_angle(self):
        return Path([0j, self.corner, 2 + 1j], self.rounding)

    def test_its_length_is_that_of_the_lines_and_of_the_arc(self, right_angle):
        assert right_angle.length == pytest.approx(1.7 + self.radius * pi / 2 + 0.7)
        assert right_angle.at(right_angle.length).place == pytest.approx(2 + 1j)

    @pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
    def test_a_corner_is_an_arc_of_a_circle(self, right_angle, share):
        spot = right_angle.at(1.7 + share * self.radius * pi / 2)

        direction = exp(1j * share * pi / 2)
        centre = 1.7 + 1j * self.radius
        assert spot.place == pytest.approx(centre - 1j * self.radius * direction)
        assert spot.direction == pytest.approx(direction)
        assert spot.curvature == pytest.approx(1 / self.radius)

    def test_an_arc_passes_its_corner_at_the_known_distance(self, right_angle):
        nearest = np.abs(sample_path(right_angle, 2001) - self.corner).min()

        assert nearest == pytest.approx(self.radius * (sqrt(2) - 1), abs=1e-6)

    @pytest.mark.parametrize("rounding", [0.0, 0.05, 1.0])
    def test_a_path_has_no_gaps_and_passes_the_middle_of_each_line(self, rounding):
        # One corner is straight on, and one turns back.
        corners = [0j, 1 + 0j, 2 + 0j, 2 + 1j, 1.5 + 1j, 1.5 + 2j, 1.5 + 1j, -1 - 1j]
        path = Path(corners, rounding)

        places = sample_path(path, 20001)

        spacing = path.length / 20000
        steps = np.abs(np.diff(places))
        assert steps.max() <= spacing * (1 + 1e-9)
        assert steps.sum() == pytest.approx(path.length, rel=1e-4)
        for start, end in pairwise(corners):
            assert np.abs(places - (start + end) / 2).min() < spacing

    @pytest.mark.parametrize("curvature", [2.0, -2.0])
    def test_a_point_of_an_arc_is_on_its_circle(self, curvature):
        spot = Spot(0.3 + 0.1j, exp(0.4j), curvature)

        later = spot.at_distance(0.25)

        centre = spot.place + 1j * spot.direction / curvature
        assert abs(later.place - centre) == pytest.approx(1 / abs(curvature))
        assert later.direction == pytest.approx(exp(1j * (0.4 + 0.25 * curvature)))

    @pytest.mark.parametrize("points", [((0, 0),), ((0, 0), (0, 0)), ((0, 0), (1, float("nan")))])
    def test_points_without_a_path_are_refused(self, points):
        with pytest.raises(InvalidConfig):
            Waypoints(points=points)


@pytest.fixture(scope="module")
def eight():
    """A walk on a path like an eight, from a place next to it."""
    angles = np.linspace(0, 2 * pi, 40, endpoint=False)
    points = tuple(zip(0.5 * np.sin(2 * angles), np.sin(angles), strict=True))
    waypoints = Waypoints(points=points, laps=1, speed=0.15)
    return follow(waypoints, -0.1 + 0.1j, radians(90), facing=radians(90))


@pytest.fixture(scope="module")
def sharp():
    """A walk around a corner without an arc, with a heading at the end."""
    waypoints = Waypoints(points=((0, 0), (1, 0), (1, 1)), rounding=0, speed=0.2, heading_deg=-150)
    return follow(waypoints, 0j, 0.0)


class TestFollower:
    """A point that obeys the commands follows the path, and stops at its end."""

    def test_it_returns_to_the_path(self, eight):
        curve = sample_path(eight.path, 3000)

        distances = distances_to(curve, eight.places[::20])

        after_six_seconds = distances[30:]
        assert after_six_seconds.max() < 0.05

    def test_it_walks_the_whole_path(self, eight):
        curve = sample_path(eight.path, 3000)

        distances = distances_to(eight.places[::20], curve[200:])

        assert distances.max() < 0.05

    def test_it_stops_at_the_end(self, eight):
        assert eight.progress > eight.path.length
        assert abs(eight.places[-1]) < 0.05
        assert (eight.places[-1] == eight.places[-50:]).all()

    def test_it_brakes_before_the_end(self):
        """The speed is 0.7/s times the remaining distance, and at least 0.03 m/s."""
        follower = Follower(Waypoints(points=((0, 0), (1, 0)), speed=0.2), MAX_SPEED, 0.0)

        speeds = []
        for x in (0.5, 0.85, 0.97):
            command, _ = follower.now(root_pose(complex(x), 0.0), x)
            speeds.append(command.speed)

        assert speeds == pytest.approx([0.2, 0.7 * 0.15 + 0.03, 0.7 * 0.03 + 0.03])

    def test_it_slows_down_in_a_bend_for_its_turning_speed(self):
        """An arc of radius r takes the turning speed v / r, of which the path may take 80 % of the largest."""
        radius = 0.1 / tan(pi / 4)
        waypoints = Waypoints(points=((0, 0), (1, 0), (1, 1)), rounding=0.1, speed=0.3)
        follower = Follower(waypoints, MAX_SPEED, 0.0)
        in_bend = 0.9 + radius * pi / 4
        spot = follower.path.at(in_bend)

        command, _ = follower.now(root_pose(spot.place, phase(spot.direction)), in_bend)

        assert abs(command.speed) <= 0.8 * radians(40) * radius + 1e-9

    def test_it_turns_on_the_spot_at_a_sharp_corner(self, sharp):
        curve = sample_path(sharp.path, 2001)

        # It begins to turn a little before the corner.
        assert distances_to(curve, sharp.places).max() < 0.1
        assert np.abs(sharp.turns).max() == pytest.approx(radians(40))

    def test_it_turns_to_the_heading_at_the_end(self, sharp):
        assert abs(phase(exp(1j * (sharp.heading - radians(-150))))) < 0.06
        assert abs(sharp.places[-1] - (1 + 1j)) < 0.03

    @pytest.mark.parametrize("heading_deg", [100, -100, 180])
    def test_a_robot_that_looks_away_only_turns(self, heading_deg):
        follower = Follower(Waypoints(points=((0, 0), (1, 0))), MAX_SPEED, 0.0)

        command, _ = follower.now(root_pose(0.3 + 0j, radians(heading_deg)), 0.3)

        assert command.speed == 0
        assert abs(command.turn) == pytest.approx(radians(40))

    @pytest.mark.parametrize("index", [0, 1, 3, 4, 5, 6])
    def test_a_pose_that_is_not_finite_gives_no_command(self, index):
        """The height, index 2, does not matter."""
        follower = Follower(Waypoints(points=((0, 0), (1, 0))), MAX_SPEED, 0.0)
        base = root_pose(0j, 0.0)
        base[index] = np.nan

        assert follower.now(base, 0.25) == (None, 0.25)
