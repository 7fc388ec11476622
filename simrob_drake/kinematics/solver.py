"""Base class and results of the solvers of inverse kinematics, and the reasons why a target is not reached."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter, SimrobError, angle
from simrob_drake.base.frames import Targets, Vector, pose_matrices
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.kinematics.chain import Chain

POSITION_TOLERANCE = 1e-6
"""Distance up to which a target counts as reached [m]. It is a tenth of the repeatability of a small arm."""

ROTATION_TOLERANCE = 1e-5
"""Angle up to which a target counts as reached [rad]."""

TURN = 2.0 * np.pi
"""A whole turn [rad]."""

_ROUNDING_BEYOND_LIMIT = 1e-9
"""Distance beyond a limit that is rounding, and is clipped [rad or m]."""

_AT_LIMIT = 1e-9
"""Distance from a limit at which a joint counts as being there [rad or m]."""

_SINGULAR = 0.02
"""Smallest singular value of the Jacobian below which a posture counts as singular [m or 1]. The incremental solver
begins its damping there."""

_PUSH = 1e-3
"""Share of the error that must press a joint against its limit, so that the limit counts as the reason."""


class Unreachable(SimrobError):
    """Raised if the solver finds no posture that reaches a target pose.

    Attributes:
        index: index of the target in its batch, counted from 0.
        reason: why the target is not reached, in words.
        positions: the best posture that was found, shape (n,) [rad or m].
        position_error: distance of this posture's tool from the target [m].
        rotation_error: angle of this posture's tool from the target [rad].
    """

    def __init__(
        self,
        target: str,
        reason: str,
        *,
        index: int,
        positions: Vector,
        position_error: float,
        rotation_error: float,
    ) -> None:
        """Write the message: the target, the reason, and the errors of the best posture.

        Args:
            target: name of the target in the message, such as ``targets[3]``.
            reason: why the target is not reached, in words.
            index: index of the target in its batch, counted from 0.
            positions: the best posture that was found, shape (n,) [rad or m].
            position_error: distance of this posture's tool from the target [m].
            rotation_error: angle of this posture's tool from the target [rad].
        """
        errors = message(
            "kinematics.best_solution",
            "the error of the best solution is {distance:.3g} m and {angle}",
            distance=position_error,
            angle=angle(rotation_error),
        )
        super().__init__(
            message(
                "kinematics.cannot_be_reached",
                "{target} cannot be reached: {reason}; {near}",
                target=target,
                reason=reason,
                near=errors,
            )
        )
        self.index = index
        self.reason = reason
        self.positions = positions
        self.position_error = position_error
        self.rotation_error = rotation_error


@dataclass(frozen=True, eq=False)
class Solutions:
    """Postures for a batch of k targets, and their errors.

    Attributes:
        positions: positions of the axes, shape (k, n) [rad or m]. If a target is not reached, these are the best that
            were found.
        reached: whether each target is reached, shape (k,).
        position_error: distance from each target, shape (k,) [m]. Directions that do not count for the solver are
            left out.
        rotation_error: angle from each target, shape (k,) [rad]. Directions that do not count are left out.
        iterations: count of steps for each target, shape (k,); 0 for closed forms, and the count of programs for the
            constrained solver.
        reasons: why each target is not reached, in words; empty if the target is reached.
    """

    positions: Vector
    reached: np.ndarray[Any, np.dtype[np.bool_]]
    position_error: Vector
    rotation_error: Vector
    iterations: np.ndarray[Any, np.dtype[np.int64]]
    reasons: tuple[str, ...]

    @classmethod
    def from_errors(
        cls,
        positions: Vector,
        errors: Vector,
        reached: np.ndarray[Any, np.dtype[np.bool_]],
        iterations: np.ndarray[Any, np.dtype[np.int64]],
        why: Callable[[int], str],
    ) -> "Solutions":
        """Make solutions from the errors of postures.

        Args:
            positions: the postures, shape (k, n) [rad or m].
            errors: their errors along and about x, y, z, shape (k, 6) [m, rad].
            reached: whether each target is reached, shape (k,).
            iterations: counts of the steps, shape (k,).
            why: function that writes, for the index of a target that is not reached, the reason.
        """
        # A reason takes a Jacobian and a singular value decomposition, so it is written only where one is needed.
        reasons = tuple("" if good else why(row) for row, good in enumerate(reached.tolist()))
        return cls(
            positions=positions,
            reached=reached,
            position_error=np.linalg.norm(errors[:, :3], axis=1),
            rotation_error=np.linalg.norm(errors[:, 3:], axis=1),
            iterations=iterations,
            reasons=reasons,
        )

    @classmethod
    def concatenate(cls, parts: "Sequence[Solutions]") -> "Solutions":
        """Join the solutions of parts of a batch, in order."""
        # All fields are arrays except the last one, the tuple of reasons.
        arrays = [field.name for field in fields(cls)[:-1]]
        whole: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays
        }
        reasons = tuple(reason for part in parts for reason in part.reasons)
        return cls(**whole, reasons=reasons)

    @property
    def first_missed(self) -> int:
        """Index of the first target that is not reached. At least one target must be missed."""
        # The smallest value is False, and argmin returns its first index.
        return int(np.argmin(self.reached))

    def unreachable(self, row: int, target: str, *, index: int | None = None) -> Unreachable:
        """Make the error of a target that is not reached.

        Args:
            row: index of the target in this batch.
            target: name of the target in the message.
            index: index of the target in the error, if it is another one for the user, as this batch may be a part of a
                larger one; ``row`` unless given.
        """
        return Unreachable(
            target,
            self.reasons[row],
            index=row if index is None else index,
            positions=self.positions[row],
            position_error=float(self.position_error[row]),
            rotation_error=float(self.rotation_error[row]),
        )


keep_former_attributes(Solutions, found="from_errors", joined="concatenate")


def require(solutions: Solutions, name: str = "targets") -> Vector:
    """Return the positions (k, n) of solutions, if every target is reached.

    Args:
        solutions: solutions of a solver.
        name: name of the targets in the message, in the plural. The message names the first target that is not reached
            as ``name[index]``. A single target is named without the s.

    Raises:
        Unreachable: a target is not reached; the error is about the first one.
    """
    if solutions.reached.all():
        return solutions.positions
    # One target needs no index, which would be 0 in every message.
    row = solutions.first_missed
    is_batch = len(solutions.reached) > 1
    target = f"{name}[{row}]" if is_batch else f"the {name.removesuffix('s')}"
    raise solutions.unreachable(row, target)


def check_search(iterations: int, tolerances: dict[str, float]) -> Vector:
    """Check the settings of a search.

    Args:
        iterations: count of steps.
        tolerances: tolerances by their names.

    Returns:
        the tolerances as an array, in order.

    Raises:
        InvalidParameter: there is no step, or a tolerance is not positive.
    """
    if iterations < 1:
        raise InvalidParameter(
            "iterations", iterations, message("kinematics.one_or_more", "1 or more")
        )
    for name, value in tolerances.items():
        # Also true for NaN.
        if not value > 0:
            raise InvalidParameter(name, value, message("kinematics.more_than_zero", "more than 0"))
    return np.array(list(tolerances.values()))


class Solver(ABC):
    """Finds postures of a chain in which the tool has given poses.

    Attributes:
        chain: the axes.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain

    def solve(self, targets: Targets, start: npt.ArrayLike) -> Solutions:
        """Find a posture for each of k targets.

        Args:
            targets: poses of the tool in the base: vectors [x y z Rz Ry Rx], matrices, or RigidTransforms.
            start: one posture (n,) or k postures (k, n) [rad or m]. With one posture, the targets are solved in order,
                each from the solution before. With k postures, each target is solved from its own, all at once if the
                solver can do that.

        Returns:
            the postures within the joint limits: those that reach the targets, or the best that were found.
            :func:`require` raises an error if a target is not reached.

        Raises:
            InvalidParameter: targets or a start of wrong shape, or not finite.
        """
        matrices = pose_matrices(targets)
        starts = self.chain.postures(start, "start")
        # The dimension decides, not the count: one row (1, n) is a batch of one, which gives the same result.
        if np.ndim(start) == 1:
            return self._solve_in_order(matrices, starts[0])
        if len(starts) != len(matrices):
            raise InvalidParameter(
                "start",
                message("kinematics.count_of_postures", "{count} postures", count=len(starts)),
                message(
                    "kinematics.one_posture_a_target",
                    "one posture, or {count} postures, one for each target",
                    count=len(matrices),
                ),
            )
        return self._solve_each(matrices, starts)

    def _solve_in_order(self, targets: Vector, start: Vector) -> Solutions:
        """Solve targets (k, 4, 4) one after the other: the first from ``start`` (n,), each other from the one before.

        The posture of a target that is not reached, the best that was found, is the start for the next one.
        """
        parts: list[Solutions] = []
        for index in range(len(targets)):
            last = parts[-1].positions if parts else start[np.newaxis]
            parts.append(self._solve_each(targets[index : index + 1], last))
        return Solutions.concatenate(parts)

    @abstractmethod
    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Solve targets (k, 4, 4), each from its own start (k, n)."""


def nearest_turns(chain: Chain, positions: Vector, reference: Vector) -> tuple[Vector, Vector]:
    """Turn revolute joints by whole turns into their limits, as close to a reference as the limits allow.

    Args:
        chain: the axes.
        positions: positions, shape (..., n) [rad or m].
        reference: positions of the reference, shape (..., n) [rad or m].

    Returns:
        the positions, and the distance of each beyond its limits (0 if it is within them), both of shape (..., n). If
        no whole turn leads into the limits, a position is as close to them as whole turns come, or the one closest to
        the reference if that is beyond by no more than the tolerance for rounding.
    """
    lower = chain.lower - _ROUNDING_BEYOND_LIMIT
    upper = chain.upper + _ROUNDING_BEYOND_LIMIT
    # Prismatic axes have no turns; a turn of zero leaves their positions as they are.
    turns = np.where(chain.revolute, TURN, 0.0)
    # First the position closest to the reference. Then as many whole turns back as it is beyond its upper limit, or
    # forward as it is beyond its lower one.
    closest = positions - turns * np.round((positions - reference) / TURN)
    turned_down = closest - turns * np.ceil(np.maximum(closest - upper, 0.0) / TURN)
    turned_up = closest + turns * np.ceil(np.maximum(lower - closest, 0.0) / TURN)

    # If the limits are less than a turn apart, a whole turn may lead past the opposite limit. Then the turn that stays
    # on the first side may be closer.
    is_above = closest > upper
    best = np.where(is_above, turned_down, turned_up)
    other = np.where(is_above, closest, turned_down)
    beyond = _distance_beyond(chain, best)
    other_beyond = _distance_beyond(chain, other)
    is_other_closer = other_beyond < beyond
    best = np.where(is_other_closer, other, best)
    beyond = np.where(is_other_closer, other_beyond, beyond)

    # Two turns may both be a little beyond opposite limits, as half a turn is for limits of pi - 1e-5 rad. The one
    # closest to the reference is taken.
    closest_beyond = _distance_beyond(chain, closest)
    is_rounded = (beyond > 0.0) & (closest_beyond <= chain.limits.tolerances)
    best = np.where(is_rounded, closest, best)
    beyond = np.where(is_rounded, closest_beyond, beyond)
    # Positions within the limits up to rounding are clipped to them, and positions beyond a limit are not: the caller
    # decides whether the distance is acceptable.
    return np.where(beyond > 0.0, best, np.clip(best, chain.lower, chain.upper)), beyond


def _distance_beyond(chain: Chain, positions: Vector) -> Vector:
    """Distance of positions (..., n) beyond the limits of a chain, shape (..., n) [rad or m]; 0 within them."""
    distance = np.maximum(positions - chain.upper, chain.lower - positions)
    return np.where(distance > _ROUNDING_BEYOND_LIMIT, distance, 0.0)


def why_unreached(
    chain: Chain, target: Vector, posture: Vector, error: Vector, weights: Vector
) -> str:
    """Write why no step from the best posture leads closer to a target.

    Args:
        chain: the axes.
        target: pose of the tool, shape (4, 4).
        posture: the best posture, shape (n,) [rad or m].
        error: error of the posture along and about x, y, z of the base, shape (6,) [m, rad]; 0 for directions that do
            not count.
        weights: weights of the errors, shape (6,); 0 for directions that do not count.

    Returns:
        the reason, in words: the target is too far away, an axis is at a limit, the posture is singular, or none of
        these.
    """
    # The most certain reason first: no posture reaches a point that is farther away than the arm is long. This needs
    # neither the limits nor the posture.
    if chain.order and error[:3].any():
        first = chain.order[0]
        distance = float(np.linalg.norm(target[:3, 3] - chain.points[first]))
        if distance > chain.reach:
            return message(
                "kinematics.out_of_reach",
                "out of reach: the target is {distance:.3g} m from {axis}, and the arm is {reach:.3g} m long",
                distance=distance,
                axis=chain.names[first],
                reach=chain.reach,
            )

    # The search moves joints along Jᵀ W e, the negative gradient of half the cost. A joint at a limit is the reason if
    # this would move it beyond the limit, and not by a negligible part of the error.
    jacobian = chain.jacobian(posture)[0]
    push = jacobian.T @ (weights * error)
    is_strong = np.abs(push) > _PUSH * np.linalg.norm(weights * error)
    is_held_below = (posture <= chain.lower + _AT_LIMIT) & (push < 0) & is_strong
    is_held_above = (posture >= chain.upper - _AT_LIMIT) & (push > 0) & is_strong
    for is_held, limits, side in (
        (is_held_below, chain.lower, message("base.lower", "lower")),
        (is_held_above, chain.upper, message("base.upper", "upper")),
    ):
        if is_held.any():
            # The first of several axes at limits. A prismatic one has its limit in metres.
            axis = int(np.argmax(is_held))
            value = limits[axis]
            limit = (
                angle(value) if chain.revolute[axis] else compound("{limits:.4g} m", limits=value)
            )
            return message(
                "kinematics.at_joint_limit",
                "joint limit: {axis} is at its {side} limit of {limit}",
                axis=chain.names[axis],
                side=side,
                limit=limit,
            )

    # Only the directions that count and the axes that move the tool: columns of zeros would make every posture look
    # singular. Singular values come in descending order, the smallest one last.
    rows = jacobian[weights > 0][:, list(chain.order)]
    if rows.size and np.linalg.svd(rows, compute_uv=False)[-1] < _SINGULAR:
        return message(
            "kinematics.singular_posture",
            "singular posture: the arm is stretched or folded and cannot move in the direction of the remaining error",
        )
    return message(
        "kinematics.no_solution_from_start", "no solution found from this initial posture"
    )
