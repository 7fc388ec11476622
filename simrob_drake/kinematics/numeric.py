"""Weighted numeric inverse kinematics for any chain (W in SimRob)."""

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import POSE_SIZE, Vector, within
from simrob_drake.kinematics.chain import Chain, Indices
from simrob_drake.kinematics.least_squares import COARSE, FINE, Fit, Flags, fit_postures
from simrob_drake.kinematics.solver import (
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    TURN,
    Solutions,
    Solver,
    check_search,
    nearest_turns,
    why_unreached,
)

_AT_ONCE = 8  # postures that one round of restarts tries side by side
_FAR = 1e6  # ranks every posture that reaches the target before all that do not
_FROM_POSE_ORDER = [0, 1, 2, 5, 4, 3]


class NumericSolver(Solver):
    """Minimises Σ w·e² over the postures within the joint limits (SimRob's W, the default there).

    e is the way to the target along x, y, z of the base [m] and the rotation vector to it about x, y, z of the base
    [rad]. Where the search from the start ends away from the target, it begins again from random postures, always the
    same; of those that reach the target first the nearest to the start is taken.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        weights: npt.ArrayLike = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        restarts: int = 40,
        iterations: int = 60,
        seed: int = 0,
        position_tolerance: float = POSITION_TOLERANCE,
        rotation_tolerance: float = ROTATION_TOLERANCE,
    ) -> None:
        """Make the solver.

        Args:
            chain: whose axes it moves.
            weights: of the errors in pose order [x y z Rz Ry Rx], not negative; [1 1 1 0 0 0] asks for the position
                only. A target is reached when the errors with weight are within the tolerances.
            restarts: how many random postures are tried where the start does not lead to the target.
            iterations: most steps from one posture.
            seed: of the random postures.
            position_tolerance: distance at which a target counts as reached [m].
            rotation_tolerance: angle at which it does [rad].

        Raises:
            InvalidParameter: a setting that makes no sense.
        """
        super().__init__(chain)
        self._weights = _checked_weights(weights)
        if restarts < 0:
            raise InvalidParameter("restarts", restarts, "0 or more")
        tolerances = {"position_tolerance": position_tolerance, "rotation_tolerance": rotation_tolerance}
        self._iterations, self._tolerance = iterations, check_search(iterations, tolerances)
        self._seeds = random_postures(chain, restarts, seed)

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        fit = self._fit(targets, starts, flat=COARSE)
        missing = np.flatnonzero(~self._within(fit))
        for first in range(0, len(self._seeds), _AT_ONCE):
            if not missing.size:
                break
            self._restart(fit, missing, self._seeds[first : first + _AT_ONCE], targets, starts)
            missing = np.flatnonzero(~self._within(fit))
        if missing.size:  # the best compromise
            fit.replace(missing, self._fit(targets[missing], fit.postures[missing], flat=FINE))
        errors = np.where(self._weights > 0, fit.errors, 0.0)

        def why(row: int) -> str:
            return why_unreached(self.chain, targets[row], fit.postures[row], errors[row], self._weights)

        return Solutions.found(fit.postures, errors, self._within(fit), fit.iterations, why)

    def _fit(self, targets: Vector, starts: Vector, *, flat: float, rivals: int = 1) -> Fit:
        return fit_postures(
            self.chain,
            targets,
            starts,
            weights=self._weights,
            tolerance=self._tolerance,
            iterations=self._iterations,
            flat=flat,
            rivals=rivals,
        )

    def _within(self, fit: Fit) -> Flags:
        return within(fit.errors, self._weights, self._tolerance)

    def _restart(self, fit: Fit, missing: Indices, seeds: Vector, targets: Vector, starts: Vector) -> None:
        """Try every missing target from every seed, and put the best into ``fit`` where it is better."""
        count = len(seeds)
        targets = np.repeat(targets[missing], count, axis=0)
        again = self._fit(targets, np.tile(seeds, (len(missing), 1)), flat=COARSE, rivals=count)
        origins = np.repeat(starts[missing], count, axis=0)
        again.postures[:], _ = nearest_turns(self.chain, again.postures, origins)
        away = np.square(again.postures - origins).sum(axis=1)
        rank = np.where(self._within(again), away, _FAR + again.costs).reshape(-1, count)
        best = np.arange(len(missing)) * count + np.argmin(rank, axis=1)
        fit.replace(missing, again.rows(best), again.iterations.reshape(-1, count).sum(axis=1))


def _checked_weights(weights: npt.ArrayLike) -> Vector:
    """Return six weights of errors along and about x, y, z from weights in pose order [x y z Rz Ry Rx]."""
    expected = "six numbers in pose order [x y z Rz Ry Rx], none negative and not all zero"
    try:
        values = np.asarray(weights, dtype=float)
    except (TypeError, ValueError) as problem:
        raise InvalidParameter("weights", weights, expected) from problem
    if values.shape != (POSE_SIZE,) or not np.isfinite(values).all() or (values < 0).any() or not values.any():
        raise InvalidParameter("weights", weights, expected)
    return values[_FROM_POSE_ORDER]


def random_postures(chain: Chain, count: int, seed: int) -> Vector:
    """Return postures (count, n) spread over the limits; joints without limits over a turn, or a metre each way."""
    free = np.where(chain.revolute, TURN / 2, 1.0)
    lower = np.where(np.isfinite(chain.lower), chain.lower, -free)
    upper = np.where(np.isfinite(chain.upper), chain.upper, free)
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    postures: Vector = np.random.default_rng(seed).uniform(lower, upper, (count, chain.size))
    return postures
