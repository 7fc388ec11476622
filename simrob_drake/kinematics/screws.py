"""What the joints of a robot carry, by the product of exponentials of their screws; many postures at once."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector, numbers

Indices = np.ndarray[Any, np.dtype[np.intp]]

IDENTITY = np.eye(4)
_CROSS = np.zeros((3, 9))  # row i: the matrix of eᵢ ×
_CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Screws:
    """Revolute and prismatic joints of a tree, each given by its screw at zero posture in one base frame.

    What a joint carries moves by the product exp(S₁q₁) ... exp(Sᵢqᵢ) of the screws from the base to it, given by axis
    and point (Lynch & Park, Modern Robotics, 2017, §4.1). Positions have shape (k, n) or (n,), in rad, or m for
    prismatic joints.

    Attributes:
        axes: unit axis of every joint at zero in the base frame, shape (n, 3).
        points: a point on every axis at zero [m], shape (n, 3).
        revolute: whether each joint is revolute, shape (n,).
        order: the axes that are followed, from the base outward.
        after: what each of these stands on: 0 the base, i what the i-th of them carries; in a row unless given.
    """

    axes: Vector
    points: Vector
    revolute: np.ndarray[Any, np.dtype[np.bool_]]
    order: tuple[int, ...]
    after: tuple[int, ...] | None = None

    @property
    def size(self) -> int:
        """How many axes there are, n."""
        return len(self.axes)

    def postures(self, positions: npt.ArrayLike, name: str = "positions") -> Vector:
        """Return postures as an array of shape (k, n).

        Raises:
            InvalidParameter: another shape than (n,) or (k, n), or numbers that are not finite.
        """
        expected = f"{self.size} finite numbers, or rows of as many, one an axis"
        rows = numbers(positions)
        if not rows.size:
            raise InvalidParameter(name, positions, expected)
        if rows.ndim not in (1, 2) or rows.shape[-1] != self.size:
            raise InvalidParameter(name, f"an array of shape {rows.shape}", expected)
        if not np.isfinite(rows).all():
            raise InvalidParameter(name, rows.tolist(), expected)
        return np.atleast_2d(rows)

    def frames(self, postures: Vector, base: Vector = IDENTITY) -> Vector:
        """Return the motion of the base, and of what each of the m followed axes carries, shape (m + 1, k, 4, 4).

        Args:
            postures: shape (k, n), checked.
            base: its pose, shape (4, 4) or (k, 4, 4).
        """
        values = postures.T[self._moving]
        terms = np.empty((*values.shape, 3))
        terms[..., 0] = 1.0
        terms[..., 1] = np.sin(values)
        terms[..., 2] = 1.0 - np.cos(values)
        terms[self._prismatic, :, 1] = values[self._prismatic]
        motions = (terms @ self._exponentials).reshape(len(values), len(postures), 4, 4)
        frames = np.empty((len(values) + 1, len(postures), 4, 4))
        frames[0] = base
        for index, motion in enumerate(motions):
            np.matmul(frames[self.after[index] if self.after else index], motion, out=frames[index + 1])
        return frames

    @cached_property
    def _moving(self) -> Indices:
        return np.array(self.order, dtype=np.intp)

    @cached_property
    def _prismatic(self) -> Indices:
        """Which of the followed axes are prismatic."""
        return np.flatnonzero(~self.revolute[self._moving])

    @cached_property
    def _exponentials(self) -> Vector:
        """Matrices A, B, C (m, 3, 16) of exp(Sq) = A + sin(q)·B + (1 - cos(q))·C, or A + q·B if prismatic."""
        terms = np.zeros((len(self.order), 3, 4, 4))
        terms[:, 0] = IDENTITY
        for term, axis in zip(terms, self.order, strict=True):
            if self.revolute[axis]:
                spin = skew(self.axes[axis])
                term[1, :3] = np.column_stack([spin, -spin @ self.points[axis]])
                term[2, :3] = np.column_stack([spin @ spin, -spin @ spin @ self.points[axis]])
            else:
                term[1, :3, 3] = self.axes[axis]
        return terms.reshape(-1, 3, 16)


def skew(vectors: Vector) -> Vector:
    """Return the matrices (..., 3, 3) whose product with a vector is the cross product of ``vectors`` (..., 3)."""
    matrices: Vector = (vectors @ _CROSS).reshape(*vectors.shape[:-1], 3, 3)
    return matrices
