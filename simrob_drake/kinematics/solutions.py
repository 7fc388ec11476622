"""What a solver of inverse kinematics gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.kinematics.errors import Unreachable

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
