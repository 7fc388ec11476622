"""The one interface of all solvers of inverse kinematics."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.poses import Targets, pose_matrices
from simrob_drake.kinematics.solutions import Solutions


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
