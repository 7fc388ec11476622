"""What solvers of inverse kinematics have in common: how they are asked, what they give back, and why there is none."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter, SimrobError, angle
from simrob_drake.base.frames import Targets, Vector, pose_matrices
from simrob_drake.base.messages import compound, message
from simrob_drake.kinematics.chain import Chain

POSITION_TOLERANCE = 1e-6  # m: a tenth of the repeatability of a small arm, and fine enough for smooth paths
ROTATION_TOLERANCE = 1e-5  # rad
TURN = 2.0 * np.pi
_SLACK = 1e-9  # rad beyond a limit that is rounding, and clipped
_AT_LIMIT = 1e-9  # rad or m
_SINGULAR = 0.02  # smallest singular value of the Jacobian [m, rad], as where damping begins
_PUSH = 1e-3  # share of the error that must press a joint against its limit to count


class Unreachable(SimrobError):
    """A target pose that no posture of the robot reaches, as far as the solver found.

    Attributes:
        index: which target of the batch, counted from 0.
        reason: why, in words.
        positions: the best posture found, shape (n,) [rad or m].
        position_error: how near it comes [m].
        rotation_error: how near it comes [rad].
    """

    def __init__(
        self, target: str, reason: str, *, index: int, positions: Vector, position_error: float, rotation_error: float
    ) -> None:
        """Say that ``target`` (such as "targets[3]") cannot be reached, why, and how near the best posture comes."""
        near = message(
            "kinematics.best_solution",
            "the best solution comes within {distance:.3g} m and {angle}",
            distance=position_error,
            angle=angle(rotation_error),
        )
        super().__init__(
            message(
                "kinematics.cannot_be_reached",
                "{target} cannot be reached: {reason}; {near}",
                target=target,
                reason=reason,
                near=near,
            )
        )
        self.index = index
        self.reason = reason
        self.positions = positions
        self.position_error = position_error
        self.rotation_error = rotation_error


@dataclass(frozen=True, eq=False)
class Solutions:
    """Postures for a batch of k targets, and how near they come.

    Attributes:
        positions: of the axes, shape (k, n) [rad or m]; the best found where the target is not reached.
        reached: whether each target is reached, shape (k,).
        position_error: distance from each target [m], shape (k,), over what the solver was asked for.
        rotation_error: angle from each target [rad], shape (k,), likewise.
        iterations: steps that each target took, shape (k,); 0 for closed forms.
        reasons: why each target is not reached; empty where it is.
    """

    positions: Vector
    reached: np.ndarray[Any, np.dtype[np.bool_]]
    position_error: Vector
    rotation_error: Vector
    iterations: np.ndarray[Any, np.dtype[np.int64]]
    reasons: tuple[str, ...]

    @classmethod
    def found(
        cls,
        positions: Vector,
        errors: Vector,
        reached: np.ndarray[Any, np.dtype[np.bool_]],
        iterations: np.ndarray[Any, np.dtype[np.int64]],
        why: Callable[[int], str],
    ) -> "Solutions":
        """Return solutions with these errors (k, 6); ``why`` tells of a row that is not reached what is in the way."""
        return cls(
            positions=positions,
            reached=reached,
            position_error=np.linalg.norm(errors[:, :3], axis=1),
            rotation_error=np.linalg.norm(errors[:, 3:], axis=1),
            iterations=iterations,
            reasons=tuple("" if good else why(row) for row, good in enumerate(reached.tolist())),
        )

    @classmethod
    def joined(cls, parts: "Sequence[Solutions]") -> "Solutions":
        """Return the solutions of one batch from those of its pieces, in order."""
        arrays = [field.name for field in fields(cls)[:-1]]
        whole: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
        return cls(**whole, reasons=tuple(reason for part in parts for reason in part.reasons))

    @property
    def first_missed(self) -> int:
        """The place of the first target that is not reached; there is one."""
        return int(np.argmin(self.reached))

    def unreachable(self, row: int, target: str, *, index: int | None = None) -> Unreachable:
        """Return the error that says why the target of a row is not reached.

        ``target`` is what the user calls it, ``index`` its number there, if that is not ``row``.
        """
        return Unreachable(
            target,
            self.reasons[row],
            index=row if index is None else index,
            positions=self.positions[row],
            position_error=float(self.position_error[row]),
            rotation_error=float(self.rotation_error[row]),
        )


def require(solutions: Solutions, name: str = "targets") -> Vector:
    """Return the positions (k, n) of a batch in which every target is reached.

    Args:
        solutions: what a solver gave.
        name: what the user calls the targets; the message names the first bad one as ``name[index]``,
            and a single one without the s.

    Raises:
        Unreachable: the first target that is not reached, why, and how near the best solution comes.
    """
    if solutions.reached.all():
        return solutions.positions
    row = solutions.first_missed
    raise solutions.unreachable(
        row, f"{name}[{row}]" if len(solutions.reached) > 1 else f"the {name.removesuffix('s')}"
    )


def check_search(iterations: int, tolerances: dict[str, float]) -> Vector:
    """Check a search's settings, return its tolerances; raises InvalidParameter: no step, or none that is positive."""
    if iterations < 1:
        raise InvalidParameter("iterations", iterations, message("kinematics.one_or_more", "1 or more"))
    for name, value in tolerances.items():
        if not value > 0:
            raise InvalidParameter(name, value, message("kinematics.more_than_zero", "more than 0"))
    return np.array(list(tolerances.values()))


class Solver(ABC):
    """Finds postures of a chain whose tool has given poses.

    Attributes:
        chain: whose axes it moves.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain

    def solve(self, targets: Targets, start: npt.ArrayLike) -> Solutions:
        """Find a posture for each of k targets.

        Args:
            targets: poses of the tool in the base: vectors [x y z Rz Ry Rx], matrices, or RigidTransforms.
            start: one posture (n,): the targets are solved in order, each from the last solution. Or k postures
                (k, n): each target from its own, all at once where the solver can.

        Returns:
            the postures within the joint limits, reached or as near as found; :func:`require` raises where one is
            not reached.

        Raises:
            InvalidParameter: targets or a start of wrong shape, or not finite.
        """
        matrices = pose_matrices(targets)
        starts = self.chain.postures(start, "start")
        if np.ndim(start) == 1:
            return self._solve_in_order(matrices, starts[0])
        if len(starts) != len(matrices):
            raise InvalidParameter(
                "start",
                message("kinematics.count_of_postures", "{count} postures", count=len(starts)),
                message(
                    "kinematics.one_posture_a_target", "one posture, or {count}, one a target", count=len(matrices)
                ),
            )
        return self._solve_each(matrices, starts)

    def _solve_in_order(self, targets: Vector, start: Vector) -> Solutions:
        """Solve targets (k, 4, 4), the first from ``start`` (n,), the others from the last solution."""
        parts: list[Solutions] = []
        for index in range(len(targets)):
            last = parts[-1].positions if parts else start[np.newaxis]
            parts.append(self._solve_each(targets[index : index + 1], last))
        return Solutions.joined(parts)

    @abstractmethod
    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Solve targets (k, 4, 4), each from its own start (k, n)."""


def nearest_turns(chain: Chain, positions: Vector, reference: Vector) -> tuple[Vector, Vector]:
    """Turn revolute joints (..., n) by whole turns, into limits and as near to a reference (..., n) as these allow.

    Returns the positions, within the limits or as near to them as whole turns come, and how far each then lies beyond a
    limit (0 within), both of shape (..., n).
    """
    lower, upper = chain.lower - _SLACK, chain.upper + _SLACK
    turns = np.where(chain.revolute, TURN, 0.0)
    near = positions - turns * np.round((positions - reference) / TURN)
    down = near - turns * np.ceil(np.maximum(near - upper, 0.0) / TURN)
    up = near + turns * np.ceil(np.maximum(lower - near, 0.0) / TURN)
    best = np.where(near > upper, down, up)
    other = np.where(near > upper, near, down)  # the last turn on the far side, for limits less than a turn apart
    beyond, other_beyond = _beyond(chain, best), _beyond(chain, other)
    swap = other_beyond < beyond
    best = np.where(swap, other, best)
    beyond = np.where(swap, other_beyond, beyond)
    # Of two turns a little beyond opposite limits, as half a turn is for limits of pi - 1e-5 rad, the nearer one.
    near_beyond = _beyond(chain, near)
    is_rounded = (beyond > 0.0) & (near_beyond <= chain.limits.tolerances)
    best = np.where(is_rounded, near, best)
    beyond = np.where(is_rounded, near_beyond, beyond)
    return np.where(beyond > 0.0, best, np.clip(best, chain.lower, chain.upper)), beyond


def _beyond(chain: Chain, positions: Vector) -> Vector:
    over = np.maximum(positions - chain.upper, chain.lower - positions)
    return np.where(over > _SLACK, over, 0.0)


def why_unreached(chain: Chain, target: Vector, posture: Vector, error: Vector, weights: Vector) -> str:
    """Tell in words why no step from the best posture (n,) leads nearer to a target (4, 4).

    The error from there is (6,) [m, rad] about x, y, z of the base, 0 where nothing is asked, and has weights (6,).
    """
    if chain.order and error[:3].any():
        first = chain.order[0]
        away = float(np.linalg.norm(target[:3, 3] - chain.points[first]))
        if away > chain.reach:
            return message(
                "kinematics.out_of_reach",
                "out of reach: it lies {distance:.3g} m from {axis}, and the arm is {reach:.3g} m long",
                distance=away,
                axis=chain.names[first],
                reach=chain.reach,
            )
    jacobian = chain.jacobian(posture)[0]
    push = jacobian.T @ (weights * error)
    strong = np.abs(push) > _PUSH * np.linalg.norm(weights * error)
    for held, limits, side in (
        ((posture <= chain.lower + _AT_LIMIT) & (push < 0) & strong, chain.lower, message("base.lower", "lower")),
        ((posture >= chain.upper - _AT_LIMIT) & (push > 0) & strong, chain.upper, message("base.upper", "upper")),
    ):
        for axis in np.flatnonzero(held):
            limit = angle(limits[axis]) if chain.revolute[axis] else compound("{limits:.4g} m", limits=limits[axis])
            return message(
                "kinematics.at_joint_limit",
                "joint limit: {axis} stands at its {side} limit of {limit}",
                axis=chain.names[axis],
                side=side,
                limit=limit,
            )
    rows = jacobian[weights > 0][:, list(chain.order)]
    if rows.size and np.linalg.svd(rows, compute_uv=False)[-1] < _SINGULAR:
        return message(
            "kinematics.singular_posture",
            "singular posture: the arm is stretched or folded there and cannot move the way that is left",
        )
    return message("kinematics.no_solution_from_start", "no solution found from this start")
