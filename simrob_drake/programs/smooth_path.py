"""Smooth and fast paths near paths without collisions: an optimisation (SNOPT) shapes a spline and its duration.

Drake's KinematicTrajectoryOptimization keeps all shapes apart at some points of the path. Then the path is checked at
many more points. If a collision is found there, a point is added, and the optimisation continues from its last result.
"""

import numpy as np
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.trajectories import BsplineTrajectory
from scipy.interpolate import make_lsq_spline

from simrob_drake.errors import SimrobError
from simrob_drake.frames import Vector
from simrob_drake.programs.free_path import CLOSE_LOOK, SEARCHED, Search
from simrob_drake.stations.posed import PosedStation

_ORDER = 6  # order of the spline: its degree plus one
_A_CORNER = 2  # control points of the spline for each corner of the path
_LEAST, _MOST = 10, 20  # smallest and largest count of control points
_APART = 0.004  # least distance between shapes [m]
_NEAR = 0.03  # the optimisation takes distances into account that exceed _APART by less than this [m]
_EVERY = 0.04  # distance along the path between the points where shapes are kept apart at first [m]
_ROUNDS = 3  # how often the optimisation is repeated with additional points
_ITERATIONS = 40  # largest count of SNOPT's major iterations in each round
_LOOKS = 200  # least count of postures at which a path is checked for collisions
_SHORTEST, _LONGEST = 0.01, 100.0  # bounds of a path's duration [s]
_LENGTH = 0.2  # cost of the path's length, per radian; the cost of its duration is 1 per second
_NONE = 1e4  # replaces an infinite limit [rad/s, rad/s², m/s, m/s²]


def shortened(
    search: Search, rows: Vector, corners: int, limits: tuple[Vector, Vector]
) -> tuple[Vector, Vector] | None:
    """Find a smooth path near a path without collisions that takes less time.

    Args:
        search: the search that found the path.
        rows: postures along the path, shape (k, n) [rad or m].
        corners: count of corners of the path.
        limits: largest speeds and accelerations of the axes, each (n,).

    Returns:
        fractions of the length and postures, as :meth:`Search.rounded` does. It is None if
        the optimised path collides, or if the station cannot be optimised: a link without
        mass, or a robot without a fixed base.
    """
    model = search.space.model
    try:
        station = PosedStation(model.frozen())
    except SimrobError:  # a link without mass cannot be moved by forces, which this station assumes
        return None
    # Positions that belong to no axis are those of bases that are not fixed.
    if station.plant.num_positions() != sum(len(robot.axes) for robot in station.station.robots.values()):
        return None
    now = model.plant.GetPositions(model.context)
    station.place_robots({name: robot.axis_map.positions(now) for name, robot in model.robots.items()})
    # Shapes that nearly touch at an end of the path could never satisfy the least distance.
    # Afterwards the station is in the start posture.
    for end in (rows[-1], rows[0]):
        station.place_robots(search.space.parts(end))
        station.ignore_nearer_than(_APART)
    problem = _Problem(search, station, rows, _A_CORNER * corners, limits)
    for _ in range(_ROUNDS):
        path = problem.solved()
        collides = np.array([bool(search.space.collisions(posture, SEARCHED)) for posture in path])
        if not collides.any():
            return search.gone(path), path
        problem.keep_apart(collides)
    return None


class _Problem:
    """The optimisation of one path, in the positions (nq,) of the station's plant."""

    def __init__(
        self, search: Search, station: PosedStation, rows: Vector, control: int, limits: tuple[Vector, Vector]
    ) -> None:
        """Set up the optimisation.

        Args:
            search: the search that found the path.
            station: the station, with the robots at the start of the path.
            rows: postures along a path without collisions, the initial guess, shape (k, n).
            control: wanted count of control points.
            limits: largest speeds and accelerations of the axes, each (n,).
        """
        self._search, self._station = search, station
        self._at_rest = station.plant.GetPositions(station.context)
        path = self._spread(rows)
        fractions = search.gone(rows)  # of the path's length, and of its duration in the initial guess
        # Only the knots of a first optimisation are used: the initial guess is a least-squares
        # spline with these knots.
        control_points = int(np.clip(control, _LEAST, _MOST))
        knots = KinematicTrajectoryOptimization(path.shape[1], control_points, _ORDER).basis()
        fitted = make_lsq_spline(fractions, path, np.array(knots.knots()), k=_ORDER - 1)
        self._optimisation = KinematicTrajectoryOptimization(BsplineTrajectory(knots, list(fitted.c[:, :, np.newaxis])))
        # A joint that turns opposite to its axis exchanges its limits, hence the sort.
        position_limits = np.sort([self._spread(search.lower), self._spread(search.upper)], axis=0)
        self._add_limits_and_costs(position_limits, limits)
        # The path begins and ends at rest, exactly in the given postures.
        rest = np.zeros(path.shape[1])
        for end, part in ((path[0], 0.0), (path[-1], 1.0)):
            self._optimisation.AddPathPositionConstraint(end, end, part)
            self._optimisation.AddPathVelocityConstraint(rest, rest, part)
        self._apart = MinimumDistanceLowerBoundConstraint(station.plant, _APART, station.context, None, _NEAR)
        for part in np.linspace(0.0, 1.0, int(search.length(rows) / _EVERY) + 2)[1:-1]:
            self._optimisation.AddPathPositionConstraint(self._apart, part)

    def _add_limits_and_costs(self, position_limits: Vector, limits: tuple[Vector, Vector]) -> None:
        """Add the limits of positions (2, nq), of speed and acceleration (n,) and of duration, and the costs."""
        # A joint of the plant may turn opposite to its axis, hence the absolute value.
        speeds, accelerations = (np.minimum(np.abs(self._spread(limit, still=_NONE)), _NONE) for limit in limits)
        lower, upper = position_limits
        self._optimisation.AddPositionBounds(lower, upper)
        self._optimisation.AddVelocityBounds(-speeds, speeds)
        self._optimisation.AddAccelerationBounds(-accelerations, accelerations)
        self._optimisation.AddDurationConstraint(_SHORTEST, _LONGEST)
        self._optimisation.AddDurationCost(1.0)
        self._optimisation.AddPathLengthCost(_LENGTH)

    def _spread(self, rows: Vector, still: float | None = None) -> Vector:
        """Convert values of the axes that move (..., n) to values of the plant's positions (..., nq).

        Args:
            rows: values of the axes, such as postures or speed limits.
            still: value of all other positions. If it is None, they keep their positions in
                the start posture.
        """
        base = self._at_rest if still is None else np.full_like(self._at_rest, still)
        spread = np.broadcast_to(base, (*rows.shape[:-1], len(base)))
        for robot, own in self._search.space.parts(rows).items():
            spread = self._station.station.robots[robot].axis_map.spread_positions(own, spread)
        return np.array(spread)

    def solved(self) -> Vector:
        """Run the optimisation from its last result.

        Returns postures along the path, shape (k, n) [rad or m], evenly spaced by length and
        less than about CLOSE_LOOK apart.
        """
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major iterations limit", _ITERATIONS)
        program = self._optimisation.prog()
        found = self._optimisation.ReconstructTrajectory(SnoptSolver().Solve(program, program.initial_guess(), options))
        self._optimisation.SetInitialGuess(found)
        whole = found.end_time()
        # A coarse sampling gives the length, from which follows the count of postures.
        times = np.linspace(0.0, whole, _LOOKS)
        looks = int(self._search.length(self._rows(found, times)) / CLOSE_LOOK) + _LOOKS
        times = np.linspace(0.0, whole, looks)

        # Times of evenly spaced postures, as fractions of the duration: the inverse of the
        # length as a function of time.
        lengths = self._search.gone(self._rows(found, times))
        self._time_fractions = np.interp(np.linspace(0.0, 1.0, looks), lengths, times) / whole
        return self._rows(found, self._time_fractions * whole)

    def _rows(self, trajectory: BsplineTrajectory, times: Vector) -> Vector:
        """Postures (k, n) of the robots that move, at times (k,) [s] of a trajectory of the plant."""
        positions = np.array(trajectory.vector_values(times.tolist())).T  # of the whole plant, (k, nq)
        robots = self._station.station.robots
        return np.hstack([robots[robot].axis_map.positions(positions) for robot in self._search.space.start])

    def keep_apart(self, hits: Vector) -> None:
        """Keep shapes apart at more points: in the middle of each section of the path that collides.

        Args:
            hits: whether each posture of the last result collides, shape (k,).
        """
        # Each section of consecutive collisions gives two edges: its first index, and the
        # index after its last.
        edges = np.flatnonzero(np.diff(np.concatenate([[False], hits, [False]])))
        for middle in edges.reshape(-1, 2).mean(axis=1).astype(int):
            self._optimisation.AddPathPositionConstraint(self._apart, float(self._time_fractions[middle]))
