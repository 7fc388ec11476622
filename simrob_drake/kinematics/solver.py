"""What all solvers of inverse kinematics have in common: how they are asked, and what they give back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.errors import Unreachable
from simrob_drake.kinematics.poses import Targets, pose_matrices

POSITION_TOLERANCE = 1e-6  # m: a tenth of the repeatability of a small arm, and fine enough for smooth paths
ROTATION_TOLERANCE = 1e-5  # rad


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
    ) -> Solutions:
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
    def joined(cls, parts: Sequence[Solutions]) -> Solutions:
        """Return the solutions of one batch from those of its pieces, in order."""
        return cls(
            positions=np.concatenate([part.positions for part in parts]),
            reached=np.concatenate([part.reached for part in parts]),
            position_error=np.concatenate([part.position_error for part in parts]),
            rotation_error=np.concatenate([part.rotation_error for part in parts]),
            iterations=np.concatenate([part.iterations for part in parts]),
            reasons=tuple(reason for part in parts for reason in part.reasons),
        )

    @property
    def first_missed(self) -> int:
        """The place of the first target that is not reached; there is one."""
        return int(np.argmin(self.reached))

    def unreachable(self, row: int, target: str, *, index: int | None = None) -> Unreachable:
        """Return the error that says why a target is not reached.

        Args:
            row: of the target, in this batch.
            target: what the user calls it.
            index: its number among the user's targets, if that is not ``row``.
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
    """Check the settings of a search, and return its tolerances as an array.

    Raises:
        InvalidParameter: no step at all, or a tolerance that is not positive.
    """
    if iterations < 1:
        raise InvalidParameter("iterations", iterations, "1 or more")
    for name, value in tolerances.items():
        if not value > 0:
            raise InvalidParameter(name, value, "more than 0")
    return np.array(list(tolerances.values()))


class Solver(ABC):
    """Finds postures of a chain whose tool has given poses.

    Attributes:
        chain: whose axes it moves.
    """

    def __init__(self, chain: Chain) -> None:
        """Make a solver for ``chain``."""
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
            raise InvalidParameter("start", f"{len(starts)} postures", f"one posture, or {len(matrices)}, one a target")
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
