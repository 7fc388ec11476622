"""Smooth and quick paths near free ones: splines whose shape and duration an optimisation finds (SNOPT).

Drake's KinematicTrajectoryOptimization keeps all shapes apart at some places of the path. Where a denser look finds a
collision, a place is added, and the optimisation goes on from where it was.
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

_ORDER, _A_CORNER, _LEAST, _MOST = 6, 2, 10, 20  # of the spline: order, and control points: a corner, and in all
_APART, _NEAR = 0.004, 0.03  # m: how far shapes stay apart, and from where on that counts
_EVERY, _ROUNDS, _ITERATIONS = 0.04, 3, 40  # m of the way between places where that holds at first; and how often
_LOOKS = 200  # at a way, and one for each step that another one is looked at
_SHORTEST, _LONGEST = 0.01, 100.0  # s that a way takes
_LENGTH = 0.2  # what a radian of the way counts, where a second counts 1
_NONE = 1e4  # what limits nothing


def shortened(
    search: Search, rows: Vector, corners: int, limits: tuple[Vector, Vector]
) -> tuple[Vector, Vector] | None:
    """Return a smooth way near a free one (k, n) with corners, as :meth:`Search.rounded` does; None: there is none.

    It is one that axes go quickly within limits of speed and acceleration. In cells that Drake's distances do not know,
    such as those with robots on their own feet, there is none, nor where the optimisation ends in a hit.
    """
    model = search.space.model
    try:
        station = PosedStation(model.frozen())
    except SimrobError:  # of links without mass, which a way does not mind
        return None
    if station.plant.num_positions() != sum(len(robot.axes) for robot in station.station.robots.values()):
        return None
    now = model.plant.GetPositions(model.context)
    station.place_robots({name: robot.axis_map.positions(now) for name, robot in model.robots.items()})
    for end in (rows[-1], rows[0]):  # what is near there may be so all the way
        station.place_robots(search.space.parts(end))
        station.ignore_nearer_than(_APART)
    problem = _Problem(search, station, rows, _A_CORNER * corners, limits)
    for _ in range(_ROUNDS):
        found = problem.solved()
        hits = np.array([bool(search.space.collisions(row, SEARCHED)) for row in found])
        if not hits.any():
            return search.gone(found), found
        problem.keep_apart(hits)
    return None


class _Problem:
    """The optimisation of one way; positions (nq,) are those of the station's plant."""

    def __init__(
        self, search: Search, station: PosedStation, rows: Vector, control: int, limits: tuple[Vector, Vector]
    ) -> None:
        """Set it up around a way (k, n) that is free."""
        self._search, self._station = search, station
        self._at_rest = station.plant.GetPositions(station.context)
        way = self._spread(rows)
        parts = search.gone(rows)
        knots = KinematicTrajectoryOptimization(way.shape[1], int(np.clip(control, _LEAST, _MOST)), _ORDER).basis()
        fitted = make_lsq_spline(parts, way, np.array(knots.knots()), k=_ORDER - 1)
        self._optimisation = KinematicTrajectoryOptimization(BsplineTrajectory(knots, list(fitted.c[:, :, np.newaxis])))
        self._limit(np.sort([self._spread(search.lower), self._spread(search.upper)], axis=0), limits)
        rest = np.zeros(way.shape[1])
        for end, part in ((way[0], 0.0), (way[-1], 1.0)):
            self._optimisation.AddPathPositionConstraint(end, end, part)
            self._optimisation.AddPathVelocityConstraint(rest, rest, part)
        self._apart = MinimumDistanceLowerBoundConstraint(station.plant, _APART, station.context, None, _NEAR)
        for part in np.linspace(0.0, 1.0, int(search.length(rows) / _EVERY) + 2)[1:-1]:
            self._optimisation.AddPathPositionConstraint(self._apart, part)

    def _limit(self, ends: Vector, limits: tuple[Vector, Vector]) -> None:
        speeds, pushes = (np.minimum(np.abs(self._spread(limit, still=_NONE)), _NONE) for limit in limits)
        self._optimisation.AddPositionBounds(*ends)
        self._optimisation.AddVelocityBounds(-speeds, speeds)
        self._optimisation.AddAccelerationBounds(-pushes, pushes)
        self._optimisation.AddDurationConstraint(_SHORTEST, _LONGEST)
        self._optimisation.AddDurationCost(1.0)
        self._optimisation.AddPathLengthCost(_LENGTH)

    def _spread(self, rows: Vector, still: float | None = None) -> Vector:
        """Return what is of axes that move (..., n) as of the plant (..., nq); others stay, or are ``still``."""
        base = self._at_rest if still is None else np.full_like(self._at_rest, still)
        spread = np.broadcast_to(base, (*rows.shape[:-1], len(base)))
        for robot, own in self._search.space.parts(rows).items():
            spread = self._station.station.robots[robot].axis_map.spread_positions(own, spread)
        return np.array(spread)

    def solved(self) -> Vector:
        """Return the way that is found from where it was, postures (k, n) at even steps, each as finely as it needs."""
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major iterations limit", _ITERATIONS)
        program = self._optimisation.prog()
        found = self._optimisation.ReconstructTrajectory(SnoptSolver().Solve(program, program.initial_guess(), options))
        self._optimisation.SetInitialGuess(found)
        whole = found.end_time()
        times = np.linspace(0.0, whole, _LOOKS)
        looks = int(self._search.length(self._rows(found, times)) / CLOSE_LOOK) + _LOOKS
        times = np.linspace(0.0, whole, looks)
        self._parts = (
            np.interp(np.linspace(0.0, 1.0, looks), self._search.gone(self._rows(found, times)), times) / whole
        )
        return self._rows(found, self._parts * whole)

    def _rows(self, trajectory: BsplineTrajectory, times: Vector) -> Vector:
        """Return the postures (k, n) at times (k,) [s]."""
        whole, robots = np.array(trajectory.vector_values(times.tolist())).T, self._station.station.robots
        return np.hstack([robots[robot].axis_map.positions(whole) for robot in self._search.space.start])

    def keep_apart(self, hits: Vector) -> None:
        """Keep shapes apart in the middle of each part of the way, looked at (k,), in which they hit, too."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], hits, [False]])))
        for middle in edges.reshape(-1, 2).mean(axis=1).astype(int):
            self._optimisation.AddPathPositionConstraint(self._apart, float(self._parts[middle]))
