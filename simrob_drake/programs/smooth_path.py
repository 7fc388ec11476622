"""Smooth and fast paths near paths without collisions: an optimisation (SNOPT) shapes a spline and its duration.

The path around obstacles that a search has found is the initial guess. The optimisation works on a copy of the station
in which only the robots can move (a `PosedStation`: a plant that is set to positions and never simulated).

Drake's KinematicTrajectoryOptimization keeps all shapes apart at some points of the path. Then the path is checked at
many more points. If a collision is found there, a point is added, and the optimisation continues from its last result.
"""

from typing import NamedTuple

import numpy as np
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.trajectories import BsplineTrajectory
from scipy.interpolate import make_lsq_spline

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.programs.free_path import CLOSE_LOOK, SEARCHED, Search, TimelessPath
from simrob_drake.stations.posed import PosedStation

_ORDER = 6  # order of the spline: its degree plus one
_POINTS_PER_CORNER = 2  # control points of the spline for each corner of the path
_LEAST_POINTS = 10  # smallest count of control points
_MOST_POINTS = 20  # largest count of control points
_APART = 0.004  # least distance between shapes [m]
# The optimisation takes distances into account that exceed _APART by less than this [m].
_NEAR = 0.03
_EVERY = 0.04  # distance along the path between the points where shapes are kept apart at first [m]
_ROUNDS = 3  # how often the optimisation is run, with additional points in each further round
_ITERATIONS = 40  # largest count of SNOPT's major iterations in each round
_LEAST_LOOKS = 200  # least count of postures at which a path is checked for collisions
_SHORTEST = 0.01  # lower bound of a path's duration [s]
_LONGEST = 100.0  # upper bound of a path's duration [s]
# Cost of the path's length, per radian; the cost of its duration is 1 per second.
_LENGTH_COST = 0.2
_UNLIMITED = 1e4  # replaces an infinite limit [rad/s, rad/s², m/s, m/s²]


class RateLimits(NamedTuple):
    """Largest speeds and accelerations of axes.

    Attributes:
        speeds: largest speeds, shape (n,) [rad/s or m/s].
        accelerations: largest accelerations, shape (n,) [rad/s² or m/s²].
    """

    speeds: Vector
    accelerations: Vector


def find_faster_path(
    search: Search, postures: Vector, corner_count: int, limits: RateLimits
) -> TimelessPath | None:
    """Optimise a path without collisions: find a smooth path nearby that should take less time.

    Whether it does take less is not checked: the caller compares the durations.

    Args:
        search: the search that found the path.
        postures: postures along the path, the axes of one robot after those of the other, shape (k, n) [rad or m].
        corner_count: count of corners of the path.
        limits: limits of all axes that move.

    Returns:
        the path. It is None if the optimised path still collides after the last round, or if the station cannot be
        optimised: a link without mass, or a robot without a fixed base.
    """
    model = search.space.model
    try:
        station = PosedStation(model.frozen_station())
    except SimrobError:
        # A link without mass cannot be moved by forces, which this station assumes.
        return None
    # Positions that belong to no axis are those of bases that are not fixed.
    axis_count = sum(len(robot.axes) for robot in station.station.robots.values())
    if station.plant.num_positions() != axis_count:
        return None
    # Robots that do not move are placed as in the model of the search.
    now = model.plant.GetPositions(model.context)
    station.place_robots(
        {name: robot.axis_map.positions(now) for name, robot in model.robots.items()}
    )
    # Shapes that nearly touch at an end of the path could never satisfy the least distance.
    # Afterwards the station is in the start posture.
    for end in (postures[-1], postures[0]):
        station.place_robots(search.space.split_by_robot(end))
        station.ignore_nearer_than(_APART)
    problem = _Problem(search, station, postures, _POINTS_PER_CORNER * corner_count, limits)
    for _ in range(_ROUNDS):
        path = problem.solve()
        collides = np.array([bool(search.space.collisions(posture, SEARCHED)) for posture in path])
        if not collides.any():
            return TimelessPath(search.length_fractions(path), path)
        problem.keep_apart(collides)
    return None


class _Problem:
    """The optimisation of one path, in the positions (nq,) of the station's plant.

    The plant has more positions than the robots that move have axes: those of the other robots stay as they are.
    """

    def __init__(
        self,
        search: Search,
        station: PosedStation,
        postures: Vector,
        point_count: int,
        limits: RateLimits,
    ) -> None:
        """Set up the optimisation.

        Args:
            search: the search that found the path.
            station: the station, with the robots at the start of the path.
            postures: postures along a path without collisions, the initial guess, shape (k, n) [rad or m].
            point_count: wanted count of control points of the spline.
            limits: limits of all axes that move.
        """
        self._search = search
        self._station = station
        self._start_positions = station.plant.GetPositions(station.context)
        path = self._plant_values(postures, others=self._start_positions)
        self._optimisation = self._make_optimisation(
            path, search.length_fractions(postures), point_count
        )
        self._add_limits_and_costs(limits)
        # The path begins and ends at rest, exactly in the given postures.
        rest = np.zeros(path.shape[1])  # the velocities
        for end, fraction in ((path[0], 0.0), (path[-1], 1.0)):
            self._optimisation.AddPathPositionConstraint(end, end, fraction)
            self._optimisation.AddPathVelocityConstraint(rest, rest, fraction)
        self._shapes_apart = MinimumDistanceLowerBoundConstraint(
            station.plant, _APART, station.context, None, _NEAR
        )
        # Evenly spaced points of the path, without both ends: shapes that are close there must not count.
        for fraction in np.linspace(0.0, 1.0, int(search.length(postures) / _EVERY) + 2)[1:-1]:
            self._optimisation.AddPathPositionConstraint(self._shapes_apart, fraction)

    @staticmethod
    def _make_optimisation(
        path: Vector, fractions: Vector, point_count: int
    ) -> KinematicTrajectoryOptimization:
        """Make an optimisation whose initial guess is a spline near a path, at constant speed.

        Args:
            path: positions of the plant along the path, shape (k, nq).
            fractions: fraction of the path's length at each of them, shape (k,).
            point_count: wanted count of control points. It is limited to a range.
        """
        # Only the knots of a first optimisation are used: the initial guess is a least-squares
        # spline with these knots.
        control_points = int(np.clip(point_count, _LEAST_POINTS, _MOST_POINTS))
        basis = KinematicTrajectoryOptimization(path.shape[1], control_points, _ORDER).basis()
        fitted_spline = make_lsq_spline(fractions, path, np.array(basis.knots()), k=_ORDER - 1)
        initial_guess = BsplineTrajectory(basis, list(fitted_spline.c[:, :, np.newaxis]))
        return KinematicTrajectoryOptimization(initial_guess)

    def _add_limits_and_costs(self, limits: RateLimits) -> None:
        """Add the limits of positions, speeds, accelerations and duration, and the costs.

        Args:
            limits: limits of all axes that move.
        """
        # Lower and upper limits of all positions of the plant, shape (2, nq). Robots that do not move stay.
        position_limits = [
            self._plant_values(limit, others=self._start_positions)
            for limit in (self._search.lower, self._search.upper)
        ]
        # A joint that turns opposite to its axis exchanges its limits, hence the sort.
        lower, upper = np.sort(position_limits, axis=0)
        self._optimisation.AddPositionBounds(lower, upper)
        speeds = self._rate_limits(limits.speeds)
        self._optimisation.AddVelocityBounds(-speeds, speeds)
        accelerations = self._rate_limits(limits.accelerations)
        self._optimisation.AddAccelerationBounds(-accelerations, accelerations)
        self._optimisation.AddDurationConstraint(_SHORTEST, _LONGEST)
        self._optimisation.AddDurationCost(1.0)
        self._optimisation.AddPathLengthCost(_LENGTH_COST)

    def _rate_limits(self, limits: Vector) -> Vector:
        """Limits (nq,) of all positions of the plant, finite, for limits (n,) of speed or acceleration of the axes."""
        others = np.full_like(self._start_positions, _UNLIMITED)
        # A joint of the plant may turn opposite to its axis, hence the absolute value.
        return np.asarray(np.minimum(np.abs(self._plant_values(limits, others)), _UNLIMITED))

    def _plant_values(self, axis_values: Vector, others: Vector) -> Vector:
        """Convert values of the axes that move (..., n) to values of the plant's positions (..., nq).

        Args:
            axis_values: values of the axes, such as postures or speed limits.
            others: values of all positions, shape (nq,); those of the axes that move are replaced.
        """
        values = np.broadcast_to(others, (*axis_values.shape[:-1], len(others)))
        for robot, own_values in self._search.space.split_by_robot(axis_values).items():
            values = self._station.station.robots[robot].axis_map.spread_positions(
                own_values, values
            )
        return np.array(values)

    def solve(self) -> Vector:
        """Run the optimisation from its last result; its new result is the start of the next call.

        Also stored are the times of the returned postures, which :meth:`keep_apart` needs.

        Returns postures along the path, shape (k, n) [rad or m], evenly spaced by length and
        less than about CLOSE_LOOK apart. They may collide, because shapes are kept apart at some points only.
        """
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major iterations limit", _ITERATIONS)
        program = self._optimisation.prog()
        result = SnoptSolver().Solve(program, program.initial_guess(), options)
        trajectory = self._optimisation.ReconstructTrajectory(result)
        self._optimisation.SetInitialGuess(trajectory)
        duration = trajectory.end_time()
        # A coarse sampling gives the length, from which follows the count of postures.
        coarse_times = np.linspace(0.0, duration, _LEAST_LOOKS)
        length = self._search.length(self._postures(trajectory, coarse_times))
        count = int(length / CLOSE_LOOK) + _LEAST_LOOKS
        times = np.linspace(0.0, duration, count)

        # Times of evenly spaced postures, as fractions of the duration: the inverse of the
        # length as a function of time.
        length_fractions = self._search.length_fractions(self._postures(trajectory, times))
        self._time_fractions = (
            np.interp(np.linspace(0.0, 1.0, count), length_fractions, times) / duration
        )
        return self._postures(trajectory, self._time_fractions * duration)

    def _postures(self, trajectory: BsplineTrajectory, times: Vector) -> Vector:
        """Postures (k, n) of the robots that move, at times (k,) [s] of a trajectory of the plant."""
        # Positions of the whole plant, shape (k, nq), of which only those of the moving robots are needed.
        positions = np.array(trajectory.vector_values(times.tolist())).T
        robots = self._station.station.robots
        return np.hstack(
            [robots[robot].axis_map.positions(positions) for robot in self._search.space.start]
        )

    def keep_apart(self, collides: Vector) -> None:
        """Keep shapes apart at more points, from the next :meth:`solve` on: one for each section that collides.

        The point is in the middle of the section.

        Args:
            collides: whether each posture of the last result of `solve` collides, shape (k,).
        """
        # Each section of consecutive collisions gives two edges: its first index, and the
        # index after its last.
        edges = np.flatnonzero(np.diff(np.concatenate([[False], collides, [False]])))
        for middle in edges.reshape(-1, 2).mean(axis=1).astype(int):
            self._optimisation.AddPathPositionConstraint(
                self._shapes_apart, float(self._time_fractions[middle])
            )
