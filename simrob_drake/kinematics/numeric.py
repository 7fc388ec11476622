"""Weighted numeric inverse kinematics for any chain (W in SimRob): least squares within limits, many targets at once.

An error is a vector of six numbers: the distances to the target along x, y, z [m], and the rotation vector to it about
x, y, z [rad]. The cost of a posture is the weighted sum of their squares. A search goes from a start to a minimum of
the cost in steps, and searches for many targets go side by side.

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

_FIRST_DAMPING = 0.01
"""Damping of the first step, as a share of the cost. So it vanishes close to the target, where Newton's own step is
best."""

_DAMPING_AFTER_SUCCESS = 0.5
"""Factor of the damping after a step that lowers the cost."""

_DAMPING_AFTER_FAILURE = 8.0
"""Factor of the damping after a step that does not."""

_LEAST_DAMPING = 1e-12
"""Damping that is always added, so that the equations of a singular posture can be solved."""

_SMALLEST_STEP = 1e-12
"""A search has stopped moving if no axis moves by this much in a step [rad or m]."""

COARSE = 1e-2
"""Share of the cost that a step must take away, for a search whose failure is followed by another one."""

FINE = 1e-12
"""Share of the cost that a step must take away, for the best compromise. Smaller steps only follow rounding errors."""

_SMALLEST_ANGLE_SQUARED = 1e-6
"""Square of the smallest angle with which a factor of the derivatives is computed [rad²]. At zero the factor is 0/0; at
this angle of 1e-3 rad it equals its limit 1/12 to seven digits."""


Flags = np.ndarray[Any, np.dtype[np.bool_]]
Counts = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class Fit:
    """Results of k searches.

    Attributes:
        postures: the postures, shape (k, n) [rad or m].
        errors: errors that are left, shape (k, 6) [m, rad].
        costs: sums of the weighted squares of the errors, shape (k,).
        iterations: counts of the steps, shape (k,).
    """

    postures: Vector
    errors: Vector
    costs: Vector
    iterations: Counts

    def rows(self, indices: Indices) -> "Fit":
        """Return copies of the results of the searches with the given indices."""
        return Fit(
            self.postures[indices],
            self.errors[indices],
            self.costs[indices],
            self.iterations[indices],
        )

    def replace(self, indices: Indices, other: "Fit", iterations: Counts | None = None) -> None:
        """Replace results by those of other searches of the same targets, where these cost less.

        Args:
            indices: indices of the results, one for each search of ``other``.
            other: the other searches.
            iterations: counts of steps that are added, whether or not a result is replaced; those of ``other`` unless
                given.
        """
        self.iterations[indices] += other.iterations if iterations is None else iterations
        # Not "<=": at equal costs, the posture that was found first stays, so that results do not depend on restarts.
        is_better = other.costs < self.costs[indices]
        replaced = indices[is_better]
        self.postures[replaced] = other.postures[is_better]
        self.errors[replaced] = other.errors[is_better]
        self.costs[replaced] = other.costs[is_better]


@dataclass(eq=False)
class _Searches:
    """The k searches that have not ended yet.

    Attributes:
        numbers: index of each search among all searches, shape (k,).
        targets: poses of the tool, shape (k, 4, 4).
        base: poses of the base, shape (k, 4, 4), or (1, 4, 4) if it is the same for all.
        lower: lower bounds of the axes, shape (k, n) [rad or m].
        upper: upper bounds of the axes, shape (k, n).
        postures: the present postures, shape (k, n).
        errors: their errors, shape (k, 6) [m, rad].
        jacobians: minus the derivatives of the errors by the positions, shape (k, 6, n).
        costs: their costs, shape (k,).
        damping: damping of the next steps, as shares of the costs, shape (k,).
    """

    numbers: Indices
    targets: Vector
    base: Vector
    lower: Vector
    upper: Vector
    postures: Vector
    errors: Vector
    jacobians: Vector
    costs: Vector
    damping: Vector

    def keep(self, is_kept: Flags) -> None:
        """End all searches except the marked ones.

        Args:
            is_kept: whether each search goes on, shape (k,).
        """
        self.numbers = self.numbers[is_kept]
        self.targets = self.targets[is_kept]
        # One base for all searches has a single row, which stays.
        if len(self.base) > 1:
            self.base = self.base[is_kept]
        self.lower = self.lower[is_kept]
        self.upper = self.upper[is_kept]
        self.postures = self.postures[is_kept]
        self.errors = self.errors[is_kept]
        self.jacobians = self.jacobians[is_kept]
        self.costs = self.costs[is_kept]
        self.damping = self.damping[is_kept]

    def accept(
        self, is_better: Flags, postures: Vector, errors: Vector, jacobians: Vector, costs: Vector
    ) -> None:
        """Replace the postures of the searches in which the new ones are better, with their errors and derivatives.

        Args:
            is_better: whether the new posture of each search is better, shape (k,).
            postures: the new postures, shape (k, n) [rad or m].
            errors: their errors, shape (k, 6) [m, rad].
            jacobians: minus the derivatives of the errors, shape (k, 6, n).
            costs: their costs, shape (k,).
        """
        # The usual case needs no copies.
        if is_better.all():
            self.postures = postures
            self.errors = errors
            self.jacobians = jacobians
            self.costs = costs
            return
        self.postures[is_better] = postures[is_better]
        self.errors[is_better] = errors[is_better]
        self.jacobians[is_better] = jacobians[is_better]
        self.costs[is_better] = costs[is_better]


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
    r"""Minimise the weighted errors of postures within the joint limits, for many targets at once.

    The cost of a posture with the errors e (6) is

    .. math:: c = \sum_i w_i e_i^2

    and a step is that of Levenberg and Marquardt. An axis that is at a limit and is pressed against it takes no part in
    the step; all other axes move freely and are clipped to their limits (projected Newton step, Bertsekas 1982).

    Args:
        chain: the axes, with the limits that are kept.
        targets: poses of the tool, shape (k, 4, 4).
        starts: postures from which the searches start, clipped to the limits, shape (k, n) [rad or m].
        weights: weights of the errors along x, y, z and about x, y, z, not negative, shape (6,).
        tolerance: a search ends if the distance and the angle from its target are within this, shape (2,) [m, rad].
            Errors without a weight are no parts of them.
        iterations: largest count of steps of each search.
        flat: a search ends if a step takes away less than this share of the cost.
        rivals: count of searches in a row that have the same target. All of them end if one reaches it.
        base: poses of the base in the frame of the targets, shape (1, 4, 4) or (k, 4, 4). The errors are along and
            about the axes of that frame.
        room: distance that axes keep to their limits [rad or m]. Only axes keep it whose range is more than four times
            this distance, and which have it at the start.

    Returns:
        the postures at which the searches end, whether or not they reach their targets.
    """
    # An axis with a small range would hardly move if it kept the distance on both sides.
    kept_distance = np.where(chain.upper - chain.lower > 4 * room, room, 0.0)
    starts = np.clip(starts, chain.lower, chain.upper)
    count = len(starts)
    result = Fit(
        postures=starts.copy(),
        errors=np.empty((count, 6)),
        costs=np.empty(count),
        iterations=np.zeros(count, dtype=np.int64),
    )
    errors, jacobians = _linearise(chain, starts, targets, base)
    searches = _Searches(
        numbers=np.arange(count),
        targets=targets,
        base=base,
        # A start nearer to a limit than the distance sets the bound: the search must not begin outside its bounds.
        lower=np.minimum(chain.lower + kept_distance, starts),
        upper=np.maximum(chain.upper - kept_distance, starts),
        postures=starts,
        errors=errors,
        jacobians=jacobians,
        costs=errors**2 @ weights,
        damping=np.full(count, _FIRST_DAMPING),
    )
    # Rivals are in a row, so search i has the target i // rivals.
    is_target_reached = np.zeros(count // rivals, dtype=bool)
    is_done = within(errors, weights, tolerance)
    # All searches do their steps side by side, as rows of arrays. Results are written as searches end, and the rest
    # goes on. The last pass does no step: it only ends what is left.
    for step in range(iterations + 1):
        if step == iterations:
            is_done[:] = True
        if is_done.any():
            finished = searches.numbers[is_done]
            result.postures[finished] = searches.postures[is_done]
            result.errors[finished] = searches.errors[is_done]
            result.costs[finished] = searches.costs[is_done]
            result.iterations[finished] = step
            if is_done.all():
                break
            searches.keep(~is_done)

        has_stopped = _do_step(chain, searches, weights=weights, flat=flat)

        # A search ends with the first of its rivals that reaches the target.
        is_near = within(searches.errors, weights, tolerance)
        target_numbers = searches.numbers // rivals
        is_target_reached[target_numbers[is_near]] = True
        is_done = has_stopped | is_target_reached[target_numbers]
    return result


def _do_step(chain: Chain, searches: _Searches, *, weights: Vector, flat: float) -> Flags:
    """Do a step of each search, and accept it if it lowers the cost.

    Args:
        chain: the axes.
        searches: the searches, which are changed.
        weights: weights of the errors, shape (6,).
        flat: share of the cost that a step must take away.

    Returns:
        whether each search has stopped: its accepted step takes away too little, or its rejected step moves nothing.
        After any other rejected step it goes on with more damping.
    """
    # Projected step: axes that would leave their bounds stop there.
    unbounded = searches.postures + _steps(searches, weights)
    trial = np.clip(unbounded, searches.lower, searches.upper)
    errors, jacobians = _linearise(chain, trial, searches.targets, searches.base)
    costs = errors**2 @ weights
    gain = searches.costs - costs
    is_better = gain > 0.0
    has_stopped: Flags = is_better & (gain < flat * searches.costs)
    if not is_better.all():
        # More damping makes the next step shorter. It cannot help if this one was too short to move anything.
        has_moved = (np.abs(trial - searches.postures) >= _SMALLEST_STEP).any(axis=1)
        has_stopped |= ~is_better & ~has_moved
    # Little damping means Newton's step, which converges fast near the target; much damping means a short step down the
    # gradient, which lowers the cost even where the linearisation is poor.
    searches.damping *= np.where(is_better, _DAMPING_AFTER_SUCCESS, _DAMPING_AFTER_FAILURE)
    searches.accept(is_better, trial, errors, jacobians, costs)
    return has_stopped


def _steps(searches: _Searches, weights: Vector) -> Vector:
    r"""Compute the damped steps of searches, shape (k, n) [rad or m].

    With the derivative -J of the errors by the positions, the step d solves

    .. math:: (J^T W J + \lambda I) \, d = J^T W e

    in which the damping :math:`\lambda` is a share of the cost. Rows and columns of axes that are pressed against a
    limit are removed.

    Args:
        searches: the k searches, with postures, errors e and derivatives.
        weights: weights of the errors, the diagonal of W, shape (6,).
    """
    # Right side Jᵀ W e, the negative gradient of half the cost, and Gauss and Newton's approximation Jᵀ W J of the
    # Hessian matrix.
    weighted = searches.jacobians.transpose(0, 2, 1) * weights
    push = (weighted @ searches.errors[..., np.newaxis])[..., 0]
    hessian: Vector = weighted @ searches.jacobians

    # An axis at a limit that would move beyond it is held. If it stayed in the equations, the steps of the other axes
    # would presuppose its motion, and the clipped step might not lower the cost.
    is_at_lower = searches.postures <= searches.lower
    is_at_upper = searches.postures >= searches.upper
    if is_at_lower.any() or is_at_upper.any():
        is_held = (is_at_lower & (push < 0)) | (is_at_upper & (push > 0))
        push[is_held] = 0.0
        is_free = ~is_held
        hessian *= is_free[:, :, np.newaxis] & is_free[:, np.newaxis, :]

    # The damping keeps the matrix regular, too: held axes have left zero rows in it.
    damping = searches.damping * searches.costs + _LEAST_DAMPING
    identity = np.eye(push.shape[1])
    damped_hessian = hessian + damping[:, np.newaxis, np.newaxis] * identity
    steps = np.linalg.solve(damped_hessian, push[..., np.newaxis])[..., 0]
    return np.asarray(steps, dtype=float)


def _linearise(
    chain: Chain, postures: Vector, targets: Vector, base: Vector
) -> tuple[Vector, Vector]:
    """Compute the errors of postures, and how they change.

    The rotation vector e of a rotation error changes by -Jr⁻¹(e)·ω as the tool turns with ω, where Jr⁻¹(e) is
    I + [e]/2 + (1/θ² - (1 + cos θ)/(2θ sin θ))·[e]² (Solà et al., A micro Lie theory, 2018, eq. 144).

    Args:
        chain: the axes.
        postures: the postures, shape (k, n) [rad or m].
        targets: poses of the tool, shape (k, 4, 4).
        base: poses of the base, shape (1, 4, 4) or (k, 4, 4).

    Returns:
        the errors, shape (k, 6) [m, rad], and minus their derivatives by the positions, shape (k, 6, n).
    """
    frames = chain.frames(postures, base)
    poses = chain.tool_poses(frames)
    errors = pose_errors(targets, poses)
    # The position errors change by minus the velocity of the tool, so that the first three rows stay as they are.
    jacobians = chain.jacobian_at(frames, poses[:, :3, 3])

    # The rotation errors change by -Jr⁻¹(e) ω. Without this factor the derivative is right for small errors only.
    rotation_errors = errors[:, 3:]
    angle_squared = (rotation_errors * rotation_errors).sum(axis=1)
    # With the half angle h: 1/θ² - (1 + cos θ)/(2θ sin θ) = (1/4 - h/(4 tan h)) / h²
    half_angle = np.sqrt(0.25 * np.maximum(angle_squared, _SMALLEST_ANGLE_SQUARED))
    factor = (0.25 - 0.25 * half_angle / np.tan(half_angle)) / (half_angle * half_angle)
    cross = skew(rotation_errors)
    second_order = factor[:, np.newaxis, np.newaxis] * (cross @ cross)
    change = IDENTITY[:3, :3] + 0.5 * cross + second_order
    jacobians[:, 3:] = change @ jacobians[:, 3:]
    return errors, jacobians


_SETTLING = 30
"""Largest count of steps from a posture at a limit to a target a little beyond what the limits allow."""


def fit_beyond_limits(
    chain: Chain, targets: Vector, starts: Vector, *, weights: Vector, tolerance: Vector
) -> Fit:
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
    # The tolerances have the shape (n,) [rad or m].
    slack = chain.limits.tolerances
    widened = replace(chain, lower=chain.lower - slack, upper=chain.upper + slack)
    return fit_postures(
        widened, targets, starts, weights=weights, tolerance=tolerance, iterations=_SETTLING
    )


def settle_at_limits(
    chain: Chain,
    targets: Vector,
    postures: Vector,
    errors: Vector,
    *,
    weights: Vector,
    tolerance: Vector,
) -> Flags:
    """Accept targets that are out of reach only because limits are rounded. Changes ``postures`` and ``errors``.

    A target is accepted if a posture reaches it that is beyond the limits by at most the tolerance for rounding. The
    posture is then clamped to the limits, so that the tool misses the target slightly. A warning (``ClampedPosition``)
    names the axes that were beyond their limits by more than arithmetic rounding.

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
        # The second argument names the positions in the warning.
        clamped = chain.limits.clamp(
            fit.postures[is_accepted],
            message("kinematics.inverse_kinematics", "inverse kinematics"),
        )
        postures[is_accepted] = clamped
        errors[is_accepted] = pose_errors(targets[is_accepted], chain.forward(clamped))
    return is_accepted


_SEEDS_PER_ROUND = 8
"""Count of random postures from which one round of restarts searches side by side."""

_RANK_OF_UNREACHED = 1e6
"""Rank that is added to postures that do not reach the target, so that all others come first. The square of a distance
between postures [rad² or m²] is never as large."""

_ROOM = 0.05
"""Distance that redundant arms keep to their limits if they can [rad or m]."""

_FROM_POSE_ORDER = [0, 1, 2, 5, 4, 3]
"""Indices in the pose order [x y z Rz Ry Rx] of the errors along and about x, y, z."""


class NumericSolver(Solver):
    """Minimises Σ w·e² over the postures within the joint limits (SimRob's W, the default there).

    The errors e are the distances to the target along x, y, z of the base [m] and the rotation vector to the target
    about x, y, z of the base [rad]. If the search from the start does not reach the target, searches from random
    postures follow, which are the same in every call. Of the first round with postures that reach the target, the
    posture closest to the start is taken.

    An arm with more than six axes keeps some distance to its joint limits if it can, so that it can move on.
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
            chain: the axes.
            weights: weights of the errors in pose order [x y z Rz Ry Rx], not negative, shape (6,). With [1 1 1 0 0 0]
                only the position counts. A target is reached if the errors with a weight are within the tolerances.
            restarts: count of random postures that are tried if the start does not lead to the target.
            iterations: largest count of steps from one posture.
            seed: seed of the random postures.
            position_tolerance: distance at which a target counts as reached [m].
            rotation_tolerance: angle at which a target counts as reached [rad].

        Raises:
            InvalidParameter: weights of wrong shape or sign, a negative count, or a tolerance that is not positive.
        """
        super().__init__(chain)
        self._weights = _read_weights(weights)
        if restarts < 0:
            raise InvalidParameter(
                "restarts", restarts, message("kinematics.zero_or_more", "0 or more")
            )
        tolerances = {
            "position_tolerance": position_tolerance,
            "rotation_tolerance": rotation_tolerance,
        }
        self._iterations = iterations
        self._tolerance = check_search(iterations, tolerances)
        self._seeds = random_postures(chain, restarts, seed)

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Search a posture for each of k targets independently.

        The attempts follow each other, each for the targets that are not reached so far: from the start, with rounded
        limits widened, from random postures; and last, the best compromise for the rest.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures from which the searches start, shape (k, n) [rad or m].
        """
        # First search from the start. A redundant arm, of more than six axes that move the tool, keeps some room to its
        # limits, if a target can be reached so.
        is_redundant = len(self.chain.order) > POSE_SIZE
        fit = self._fit(targets, starts, flat=COARSE, room=_ROOM if is_redundant else 0.0)
        # Indices of the targets that are not reached.
        missing = np.flatnonzero(~self._within(fit))
        if is_redundant and missing.size:
            # Some targets can be reached only close to a limit. This counts more than room for the next move.
            fit.replace(missing, self._fit(targets[missing], starts[missing], flat=COARSE))
            missing = np.flatnonzero(~self._within(fit))

        # Then from random postures, some at a time, for targets that are not out of reach by rounded limits alone.
        is_accepted = self._accept_at_limits(fit, missing, targets)
        missing = np.flatnonzero(~(self._within(fit) | is_accepted))
        for first in range(0, len(self._seeds), _SEEDS_PER_ROUND):
            if not missing.size:
                break
            seeds_of_round = self._seeds[first : first + _SEEDS_PER_ROUND]
            self._restart(fit, missing, seeds_of_round, targets, starts)
            missing = np.flatnonzero(~(self._within(fit) | is_accepted))

        # The others get the best compromise: the searches so far have ended early, as soon as progress was slow.
        if missing.size:
            fit.replace(missing, self._fit(targets[missing], fit.postures[missing], flat=FINE))
            is_accepted |= self._accept_at_limits(fit, missing, targets)
        # Errors without weight do not count, and are reported as 0.
        errors = np.where(self._weights > 0, fit.errors, 0.0)

        def why(row: int) -> str:
            """Reason why a target is not reached, in words."""
            return why_unreached(
                self.chain, targets[row], fit.postures[row], errors[row], self._weights
            )

        return Solutions.from_errors(
            fit.postures, errors, self._within(fit) | is_accepted, fit.iterations, why
        )

    def _accept_at_limits(self, fit: Fit, missing: Indices, targets: Vector) -> Flags:
        """Accept targets that are out of reach only because limits are rounded, with a warning.

        A posture that is beyond the limits by at most the tolerance for rounding reaches such a target. This posture,
        clamped to the limits, becomes the result.

        Args:
            fit: the best postures so far for the k targets. Those of accepted targets are changed.
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
                self.chain,
                targets[rows],
                postures,
                errors,
                weights=self._weights,
                tolerance=self._tolerance,
            )
            fit.postures[rows] = postures
            fit.errors[rows] = errors
        return is_accepted

    def _fit(
        self, targets: Vector, starts: Vector, *, flat: float, rivals: int = 1, room: float = 0.0
    ) -> Fit:
        """Search with the weights, tolerance and count of steps of this solver, by :func:`fit_postures`.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures from which the searches start, shape (k, n) [rad or m].
            flat: a search ends if a step takes away less than this share of the cost.
            rivals: count of searches in a row that have the same target. All of them end if one reaches it.
            room: distance that axes keep to their limits, if they can [rad or m].

        Returns:
            the postures at which the searches end.
        """
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
        """Whether each posture reaches its target, shape (k,)."""
        return within(fit.errors, self._weights, self._tolerance)

    def _restart(
        self, fit: Fit, missing: Indices, seeds: Vector, targets: Vector, starts: Vector
    ) -> None:
        """Search each missing target from random postures, and take the best result if it costs less. Changes ``fit``.

        Args:
            fit: the best postures so far. Those of missing targets are replaced if a search finds a cheaper one.
            missing: indices of the targets that are not reached.
            seeds: the random postures, shape (r, n) [rad or m].
            targets: all targets, shape (k, 4, 4).
            starts: the starts of all targets, shape (k, n) [rad or m].
        """
        seed_count = len(seeds)
        repeated_targets = np.repeat(targets[missing], seed_count, axis=0)
        repeated_seeds = np.tile(seeds, (len(missing), 1))
        again = self._fit(repeated_targets, repeated_seeds, flat=COARSE, rivals=seed_count)

        # A search from a random posture may end whole turns away from the start, which would make it look far away.
        origins = np.repeat(starts[missing], seed_count, axis=0)
        again.postures[:], _ = nearest_turns(self.chain, again.postures, origins)

        # Of the postures that reach a target the closest to its start is the best; of the others the cheapest.
        squared_distance = np.square(again.postures - origins).sum(axis=1)
        rank = np.where(self._within(again), squared_distance, _RANK_OF_UNREACHED + again.costs)
        best_seed = np.argmin(rank.reshape(-1, seed_count), axis=1)
        # The searches of target i are in the rows i * seed_count and following.
        best = np.arange(len(missing)) * seed_count + best_seed
        # A target is charged for the steps of all of its searches, not only for those of the best one.
        steps_of_target = again.iterations.reshape(-1, seed_count).sum(axis=1)
        fit.replace(missing, again.rows(best), steps_of_target)


def _read_weights(weights: npt.ArrayLike) -> Vector:
    """Convert weights in pose order [x y z Rz Ry Rx] to weights of the errors along and about x, y, z.

    Raises:
        InvalidParameter: these are not six finite numbers, one is negative, or all are zero.
    """
    expected = message(
        "kinematics.six_weights",
        "six numbers in pose order [x y z Rz Ry Rx], none negative and not all zero",
    )
    values = finite(weights)  # empty if they are not finite numbers
    if values.shape != (POSE_SIZE,) or (values < 0).any() or not values.any():
        raise InvalidParameter("weights", weights, expected)
    # Users order angles Rz Ry Rx, as in a pose; rotation vectors have the order x, y, z.
    return values[_FROM_POSE_ORDER]


def random_postures(chain: Chain, count: int, seed: int) -> Vector:
    """Draw postures that are evenly distributed between the limits of a chain.

    An axis without a limit is drawn up to half a turn, or a metre, to that side of zero. The same seed gives the same
    postures.

    Args:
        chain: the axes.
        count: count of the postures.
        seed: seed of the random numbers.

    Returns:
        the postures, shape (count, n) [rad or m].
    """
    # Half a turn to both sides covers every direction of a revolute axis.
    range_without_limit = np.where(chain.revolute, TURN / 2, 1.0)
    lower = np.where(np.isfinite(chain.lower), chain.lower, -range_without_limit)
    upper = np.where(np.isfinite(chain.upper), chain.upper, range_without_limit)
    # With one limit alone, the other end may be on the wrong side of it.
    least = np.minimum(lower, upper)
    most = np.maximum(lower, upper)
    postures: Vector = np.random.default_rng(seed).uniform(least, most, (count, chain.size))
    return postures
