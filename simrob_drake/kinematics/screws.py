"""Forward kinematics and Jacobian of joints in a row, by the product of exponentials of their screws."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

Indices = np.ndarray[Any, np.dtype[np.intp]]

_IDENTITY = np.eye(4)
_CROSS = np.zeros((3, 9))  # row i: the matrix of eᵢ ×
_CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Screws:
    """Revolute and prismatic joints in a row, from a base frame to a tool frame.

    The pose of the tool in the base is the product exp(S₁q₁) ... exp(Sₙqₙ)·home, with the screws S given by axis and
    point at zero posture (Lynch & Park, Modern Robotics, 2017, §4.1). Positions have shape (k, n) or (n,), in rad, or
    m for prismatic joints.

    Attributes:
        axes: unit axis of every joint at zero in the base frame, shape (n, 3).
        points: a point on every axis at zero [m], shape (n, 3).
        revolute: whether each axis turns, shape (n,).
        order: the axes that move the tool, from the base outward.
        home: pose of the tool at zero, shape (4, 4).
    """

    axes: Vector
    points: Vector
    revolute: np.ndarray[Any, np.dtype[np.bool_]]
    order: tuple[int, ...]
    home: Vector

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
        try:
            rows = np.asarray(positions, dtype=float)
        except (TypeError, ValueError) as problem:
            raise InvalidParameter(name, positions, expected) from problem
        if rows.ndim not in (1, 2) or rows.shape[-1] != self.size or not rows.size:
            raise InvalidParameter(name, f"an array of shape {rows.shape}", expected)
        if not np.isfinite(rows).all():
            raise InvalidParameter(name, rows.tolist(), expected)
        return np.atleast_2d(rows)

    def forward(self, positions: npt.ArrayLike) -> Vector:
        """Return the poses of the tool in the base, shape (k, 4, 4); one posture (n,) gives k = 1."""
        return self.tool_poses(self.frames(self.postures(positions)))

    def jacobian(self, positions: npt.ArrayLike) -> Vector:
        """Return the geometric Jacobian, shape (k, 6, n): what the axes' speeds give of the tool's.

        Rows: velocity of the tool centre point along x, y, z of the base [m/s], then angular velocity about
        x, y, z. (SimRob orders the last three z, y, x: ``jacobian[:, [0, 1, 2, 5, 4, 3]]``.)
        """
        frames = self.frames(self.postures(positions))
        return self.jacobian_at(frames, self.tool_poses(frames)[:, :3, 3])

    def frames(self, postures: Vector) -> Vector:
        """Return the motion (m + 1, k, 4, 4) that the first 0 ... m moving axes give to what they carry.

        Args:
            postures: shape (k, n), checked.
        """
        values = postures.T[self._moving]
        terms = np.empty((*values.shape, 3))
        terms[..., 0] = 1.0
        terms[..., 1] = np.sin(values)
        terms[..., 2] = 1.0 - np.cos(values)
        terms[self._slides, :, 1] = values[self._slides]
        motions = (terms @ self._exponentials).reshape(len(values), -1, 4, 4)
        frames = np.empty((len(values) + 1, len(postures), 4, 4))
        frames[0] = _IDENTITY
        for index, motion in enumerate(motions):
            np.matmul(frames[index], motion, out=frames[index + 1])
        return frames

    def tool_poses(self, frames: Vector) -> Vector:
        """Return the poses of the tool (k, 4, 4) from :meth:`frames`."""
        poses: Vector = frames[-1] @ self.home
        return poses

    def jacobian_at(self, frames: Vector, places: Vector) -> Vector:
        """Return the Jacobian (k, 6, n) from :meth:`frames` and the places (k, 3) of the tool centre point."""
        carried = frames[:-1] @ self._axes_and_points  # (m, k, 4, 2)
        axes, arms = carried[..., :3, 0], places - carried[..., :3, 1]
        columns = np.empty((*axes.shape[:2], 6))
        columns[..., :3] = (skew(axes) @ arms[..., np.newaxis])[..., 0]
        columns[..., 3:] = axes
        columns[self._slides, :, :3] = axes[self._slides]
        columns[self._slides, :, 3:] = 0.0
        jacobian = np.zeros((len(places), 6, self.size))
        jacobian[:, :, self._moving] = columns.transpose(1, 2, 0)
        return jacobian

    @cached_property
    def identity(self) -> Vector:
        """The unit matrix (n, n)."""
        return np.eye(self.size)

    @cached_property
    def _moving(self) -> Indices:
        return np.array(self.order, dtype=np.intp)

    @cached_property
    def _slides(self) -> Indices:
        """Which of the moving axes are prismatic."""
        return np.flatnonzero(~self.revolute[self._moving])

    @cached_property
    def _axes_and_points(self) -> Vector:
        """Homogeneous axis and point of the moving axes, shape (m, 1, 4, 2)."""
        columns = np.zeros((len(self.order), 1, 4, 2))
        columns[:, 0, :3, 0] = self.axes[self._moving]
        columns[:, 0, :3, 1] = self.points[self._moving]
        columns[:, 0, 3, 1] = 1.0
        return columns

    @cached_property
    def _exponentials(self) -> Vector:
        """Matrices A, B, C (m, 3, 16) of exp(Sq) = A + sin(q)·B + (1 - cos(q))·C, or A + q·B if prismatic."""
        terms = np.zeros((len(self.order), 3, 4, 4))
        terms[:, 0] = _IDENTITY
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
