"""Weighted numeric inverse kinematics for any chain (W in SimRob): least squares within limits, many targets at once.

``scipy.optimize.least_squares`` does the same for one target at a time; along a path of the irb120 its bounded methods
take 1.6 times as long, and they cannot take targets, or starts for one target, side by side.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import POSE_SIZE, Vector, finite, pose_errors, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import IDENTITY, Chain, Indices, skew
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

_FIRST_DAMPING = 0.01  # times the cost, so that it fades near the target, where the plain Newton step is best
_EASED, _RAISED = 0.5, 8.0  # damping after a step that helped, and after one that did not
_LEAST_DAMPING = 1e-12
_SMALLEST_STEP = 1e-12  # rad or m: below it nothing changes any more
COARSE = 1e-2  # share of the cost that a step must take away, to look for a posture where another one can be tried
FINE = 1e-12  # likewise, to find the best compromise: below, a step only chases rounding


Flags = np.ndarray[Any, np.dtype[np.bool_]]
Counts = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class Fit:
    """Postures (k, n), the errors left (k, 6), the sums of weighted squares (k,) and the steps taken (k,)."""

    postures: Vector
    errors: Vector
    costs: Vector
    iterations: Counts

    def rows(self, places: Indices) -> "Fit":
        """Return some of the rows."""
        return Fit(self.postures[places], self.errors[places], self.costs[places], self.iterations[places])

    def replace(self, places: Indices, other: "Fit", iterations: Counts | None = None) -> None:
        """Put the rows of another fit in these places where they cost less; count its steps."""
        self.iterations[places] += other.iterations if iterations is None else iterations
        better = other.costs < self.costs[places]
        rows = places[better]
        self.postures[rows], self.errors[rows] = other.postures[better], other.errors[better]
        self.costs[rows] = other.costs[better]


def fit_postures(
    chain: Chain,
    targets: Vector,
    starts: Vector,
    *,
    weights: Vector,
    tolerance: Vector,
    iterations: int,
    flat: float = FINE,
    rivals: int = 1,
    base: Vector = IDENTITY[np.newaxis],
    room: float = 0.0,
) -> Fit:
    """Minimise the sum of w·e² over postures within the joint limits, by Levenberg and Marquardt's damped steps.

    A joint that stands at a limit and is pressed against it takes no part in the step; all others move freely and are
    clipped to their limits (projected Newton step, Bertsekas 1982).

    Args:
        chain: whose limits are kept.
        targets: shape (k, 4, 4).
        starts: shape (k, n), clipped to the limits.
        weights: of the errors [x y z] and about [x y z], shape (6,), not negative.
        tolerance: a target is done when every weighted position and rotation error is below (2,) [m, rad].
        iterations: most steps for a target.
        flat: share of the cost that a step must take away; a target that gets less ends there.
        rivals: how many rows in turn are of one target; all of them end when one reaches it.
        base: poses of the base (1, 4, 4) or (k, 4, 4), where targets are given in another frame, whose axes then count.
        room: to be kept to the joint limits [rad or m], by joints that have it at the start and four times the range.
    """
    kept = np.where(chain.upper - chain.lower > 4 * room, room, 0.0)
    starts = np.clip(starts, chain.lower, chain.upper)
    lower, upper = np.minimum(chain.lower + kept, starts), np.maximum(chain.upper - kept, starts)
    result = Fit(
        starts.copy(), np.empty((len(starts), 6)), np.empty(len(starts)), np.zeros(len(starts), dtype=np.int64)
    )
    rows = np.arange(len(starts))
    unit = np.eye(chain.size)
    postures = starts
    errors, jacobians = _linearised(chain, postures, targets, base)
    costs = errors**2 @ weights
    damping = np.full(len(rows), _FIRST_DAMPING)
    answered = np.zeros(len(rows) // rivals, dtype=bool)
    done = within(errors, weights, tolerance)
    for step in range(iterations + 1):
        if step == iterations:
            done[:] = True
        if done.any():
            finished = rows[done]
            result.postures[finished], result.errors[finished] = postures[done], errors[done]
            result.costs[finished], result.iterations[finished] = costs[done], step
            if done.all():
                break
            left = ~done
            rows, postures, errors, jacobians = rows[left], postures[left], errors[left], jacobians[left]
            costs, damping, targets = costs[left], damping[left], targets[left]
            lower, upper = lower[left], upper[left]
            base = base[left] if len(base) > 1 else base
        damped = (damping * costs + _LEAST_DAMPING)[:, np.newaxis, np.newaxis] * unit
        moves = _steps((postures <= lower, postures >= upper), jacobians, errors, weights, damped)
        trial = np.clip(postures + moves, lower, upper)
        trial_errors, trial_jacobians = _linearised(chain, trial, targets, base)
        trial_costs = trial_errors**2 @ weights
        gain = costs - trial_costs
        better = gain > 0.0
        still = better & (gain < flat * costs)
        damping *= np.where(better, _EASED, _RAISED)
        if better.all():
            postures, errors, jacobians, costs = trial, trial_errors, trial_jacobians, trial_costs
        else:
            still |= ~better & (np.abs(trial - postures) < _SMALLEST_STEP).all(axis=1)
            postures[better], errors[better] = trial[better], trial_errors[better]
            jacobians[better], costs[better] = trial_jacobians[better], trial_costs[better]
        near = within(errors, weights, tolerance)
        answered[rows[near] // rivals] = True
        done = still | answered[rows // rivals]
    return result


def _steps(
    at_limits: tuple[Flags, Flags], jacobians: Vector, errors: Vector, weights: Vector, damped: Vector
) -> Vector:
    weighted = jacobians.transpose(0, 2, 1) * weights
    push = (weighted @ errors[..., np.newaxis])[..., 0]
    hessian: Vector = weighted @ jacobians
    low, high = at_limits
    if low.any() or high.any():
        held = (low & (push < 0)) | (high & (push > 0))
        push[held] = 0.0
        hessian *= (~held)[:, :, np.newaxis] & ~held[:, np.newaxis, :]
    moves = np.linalg.solve(hessian + damped, push[..., np.newaxis])[..., 0]
    return np.asarray(moves, dtype=float)


def _linearised(chain: Chain, postures: Vector, targets: Vector, base: Vector) -> tuple[Vector, Vector]:
    """Return the errors (k, 6) and minus their derivative by the positions (k, 6, n).

    The rotation vector e of a rotation error changes by -Jr⁻¹(e)·ω as the tool turns with ω, where Jr⁻¹(e) is
    I + [e]/2 + (1/θ² - (1 + cos θ)/(2θ sin θ))·[e]² (Solà et al., A micro Lie theory, 2018, eq. 144).
    """
    frames = chain.frames(postures, base)
    poses = chain.tool_poses(frames)
    errors = pose_errors(targets, poses)
    jacobians = chain.jacobian_at(frames, poses[:, :3, 3])
    turn = errors[:, 3:]
    square = (turn * turn).sum(axis=1)
    half = np.sqrt(0.25 * np.maximum(square, 1e-6))  # below 1e-3 rad the factor is 1/12 to seven digits
    factor = (0.25 - 0.25 * half / np.tan(half)) / (half * half)
    spin = skew(turn)
    change = IDENTITY[:3, :3] + 0.5 * spin + factor[:, np.newaxis, np.newaxis] * (spin @ spin)
    jacobians[:, 3:] = change @ jacobians[:, 3:]
    return errors, jacobians


_SETTLING = 30  # largest count of steps from a posture at a limit to a target that lies a little beyond


def fit_beyond_limits(chain: Chain, targets: Vector, starts: Vector, *, weights: Vector, tolerance: Vector) -> Fit:
    """Search postures that reach targets, with limits of the axes that are widened by the tolerance for rounding.

    Manufacturers round limits: with a limit of pi - 1e-5 rad, for instance, a target at half a turn would be out of
    reach.

    Args:
        chain: the axes, with their limits.
        targets: poses of the tool, shape (k, 4, 4).
        starts: the best postures within the limits, shape (k, n) [rad or m].
        weights: weights of the errors, shape (6,).
        tolerance: errors at which a target counts as reached, shape (2,) [m, rad].

    Returns:
        the best postures, which may be beyond the limits by the tolerance for rounding, and their errors.
    """
    slack = chain.limits.tolerances  # shape (n,) [rad or m]
    widened = replace(chain, lower=chain.lower - slack, upper=chain.upper + slack)
    return fit_postures(widened, targets, starts, weights=weights, tolerance=tolerance, iterations=_SETTLING)


def settle_at_limits(
    chain: Chain, targets: Vector, postures: Vector, errors: Vector, *, weights: Vector, tolerance: Vector
) -> Flags:
    """Accept targets that are out of reach only because limits are rounded. Changes ``postures`` and ``errors``.

    A target is accepted if a posture reaches it that is beyond the limits by at most the tolerance for rounding. The
    posture is then clamped to the limits, so that the tool misses the target slightly.

    Args:
        chain: the axes, with their limits.
        targets: poses of the tool that no posture within the limits reaches, shape (k, 4, 4).
        postures: the best postures within the limits, shape (k, n) [rad or m]. Those of accepted targets are replaced
            by the clamped postures.
        errors: errors of the postures, shape (k, 6) [m, rad]. Those of accepted targets are replaced.
        weights: weights of the errors, shape (6,).
        tolerance: errors at which a target counts as reached, shape (2,) [m, rad].

    Returns:
        whether each target is accepted, shape (k,).
    """
    fit = fit_beyond_limits(chain, targets, postures, weights=weights, tolerance=tolerance)
    is_accepted = np.asarray(within(fit.errors, weights, tolerance))
    if is_accepted.any():
        # The clamping names "inverse kinematics" in its warning that an axis was beyond its limit.
        clamped = chain.limits.clamp(
            fit.postures[is_accepted], message("kinematics.inverse_kinematics", "inverse kinematics")
        )
        postures[is_accepted] = clamped
        errors[is_accepted] = pose_errors(targets[is_accepted], chain.forward(clamped))
    return is_accepted


_AT_ONCE = 8  # postures that one round of restarts tries side by side
_FAR = 1e6  # ranks every posture that reaches the target before all that do not
_ROOM = 0.05  # rad or m
_FROM_POSE_ORDER = [0, 1, 2, 5, 4, 3]


class NumericSolver(Solver):
    """Minimises Σ w·e² over the postures within the joint limits (SimRob's W, the default there).

    e is the way to the target along x, y, z of the base [m] and the rotation vector to it about x, y, z of the base
    [rad]. Where the search from the start ends away from the target, it begins again from random postures, always the
    same; of those that reach the target first the nearest to the start is taken. An arm of more axes than a pose has
    keeps some room to its joint limits where it can, so that it can go on from there.
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
            raise InvalidParameter("restarts", restarts, message("kinematics.zero_or_more", "0 or more"))
        tolerances = {"position_tolerance": position_tolerance, "rotation_tolerance": rotation_tolerance}
        self._iterations, self._tolerance = iterations, check_search(iterations, tolerances)
        self._seeds = random_postures(chain, restarts, seed)

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Search a posture for each of k targets independently.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures from which the searches start, shape (k, n) [rad or m].
        """
        # First search from the start. A redundant arm keeps some room to its limits, if a target can be reached so.
        is_redundant = len(self.chain.order) > POSE_SIZE
        fit = self._fit(targets, starts, flat=COARSE, room=_ROOM if is_redundant else 0.0)
        missing = np.flatnonzero(~self._within(fit))  # indices of the targets that are not reached
        if is_redundant and missing.size:
            fit.replace(missing, self._fit(targets[missing], starts[missing], flat=COARSE))
            missing = np.flatnonzero(~self._within(fit))

        # Then from random postures, some at a time, for targets that are not out of reach by rounded limits alone.
        is_accepted = self._accept_at_limits(fit, missing, targets)
        missing = np.flatnonzero(~(self._within(fit) | is_accepted))
        for first in range(0, len(self._seeds), _AT_ONCE):
            if not missing.size:
                break
            self._restart(fit, missing, self._seeds[first : first + _AT_ONCE], targets, starts)
            missing = np.flatnonzero(~(self._within(fit) | is_accepted))

        # The others get the best compromise.
        if missing.size:
            fit.replace(missing, self._fit(targets[missing], fit.postures[missing], flat=FINE))
            is_accepted |= self._accept_at_limits(fit, missing, targets)
        # Errors without weight do not count, and are reported as 0.
        errors = np.where(self._weights > 0, fit.errors, 0.0)

        def why(row: int) -> str:
            """Reason why a target is not reached, in words."""
            return why_unreached(self.chain, targets[row], fit.postures[row], errors[row], self._weights)

        return Solutions.found(fit.postures, errors, self._within(fit) | is_accepted, fit.iterations, why)

    def _accept_at_limits(self, fit: Fit, missing: Indices, targets: Vector) -> Flags:
        """Accept targets that are out of reach only because limits are rounded, see :func:`settle_at_limits`.

        Args:
            fit: the best postures so far, k rows. The rows of accepted targets are changed.
            missing: indices of the targets that are not reached. Only those with an axis at a limit are examined: wider
                limits cannot help the others.
            targets: all targets, shape (k, 4, 4).

        Returns:
            whether each of the k targets is accepted; False for targets that are reached anyway.
        """
        is_accepted = np.zeros(len(targets), dtype=bool)
        is_at_limit = (fit.postures <= self.chain.lower) | (fit.postures >= self.chain.upper)
        rows = missing[is_at_limit[missing].any(axis=1)]
        if rows.size:
            # Indexing by rows copies, so the changed postures and errors are written back.
            postures = fit.postures[rows]
            errors = fit.errors[rows]
            is_accepted[rows] = settle_at_limits(
                self.chain, targets[rows], postures, errors, weights=self._weights, tolerance=self._tolerance
            )
            fit.postures[rows] = postures
            fit.errors[rows] = errors
        return is_accepted

    def _fit(self, targets: Vector, starts: Vector, *, flat: float, rivals: int = 1, room: float = 0.0) -> Fit:
        return fit_postures(
            self.chain,
            targets,
            starts,
            weights=self._weights,
            tolerance=self._tolerance,
            iterations=self._iterations,
            flat=flat,
            rivals=rivals,
            room=room,
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
    expected = message(
        "kinematics.six_weights", "six numbers in pose order [x y z Rz Ry Rx], none negative and not all zero"
    )
    values = finite(weights)
    if values.shape != (POSE_SIZE,) or (values < 0).any() or not values.any():
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
