"""What can go wrong in kinematics, as named exceptions."""

from __future__ import annotations

from simrob_drake.errors import SimrobError
from simrob_drake.frames import Vector


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
        near = f"the best solution comes within {position_error:.3g} m and {rotation_error:.3g} rad"
        super().__init__(f"{target} cannot be reached: {reason}; {near}")
        self.index = index
        self.reason = reason
        self.positions = positions
        self.position_error = position_error
        self.rotation_error = rotation_error


class NoClosedForm(SimrobError):
    """A robot whose geometry the analytic solver does not cover."""

    def __init__(self, problem: str) -> None:
        """Say what the geometry lacks, and which solver takes any robot."""
        super().__init__(f"there is no closed form for this arm: {problem}; the numeric solver takes any robot")


class UnsupportedChain(SimrobError):
    """Frames of a plant that joints other than the given ones move against each other."""
