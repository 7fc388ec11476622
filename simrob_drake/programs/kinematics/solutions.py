"""What a solver of inverse kinematics gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.programs.kinematics.errors import Unreachable

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


def require(solutions: Solutions, name: str = "targets") -> Vector:
    """Return the positions (k, n) of a batch in which every target is reached.

    Args:
        solutions: what a solver gave.
        name: what the user calls the targets; the message names the first bad one as ``name[index]``.

    Raises:
        Unreachable: the first target that is not reached, why, and how near the best solution comes.
    """
    if solutions.reached.all():
        return solutions.positions
    index = int(np.argmin(solutions.reached))
    raise Unreachable(
        f"{name}[{index}]" if len(solutions.reached) > 1 else f"the pose in {name}",
        solutions.reasons[index],
        index=index,
        positions=solutions.positions[index],
        position_error=float(solutions.position_error[index]),
        rotation_error=float(solutions.rotation_error[index]),
    )
