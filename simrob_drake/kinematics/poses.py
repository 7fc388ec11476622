"""Batches of poses in every form that users write, and the errors between them.

Inside this package a batch of poses is an array of homogeneous matrices of shape (k, 4, 4).
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import POSE_SIZE, Vector, numbers

Targets: TypeAlias = npt.ArrayLike | RigidTransform | Sequence[RigidTransform]
"""One pose or many: pose vectors [x y z Rz Ry Rx], matrices (4, 4), or RigidTransforms."""

_EXPECTED = "pose vectors [x y z Rz Ry Rx] (6,) or (k, 6), matrices (4, 4) or (k, 4, 4), or RigidTransforms"
_RIGID = 1e-6  # what a rotation matrix may miss orthogonality by: printed figures pass, a scaled matrix does not
_HALF_TURN = -0.99  # cosine below which the antisymmetric part of a rotation tells the axis too roughly
_SINE_AND_TRACE = np.zeros((9, 4))  # of a rotation matrix row by row: sine times axis, and trace
_SINE_AND_TRACE[[7, 5, 2, 6, 3, 1], [0, 0, 1, 1, 2, 2]] = [0.5, -0.5, 0.5, -0.5, 0.5, -0.5]
_SINE_AND_TRACE[[0, 4, 8], 3] = 1.0


def pose_matrices(targets: Targets, name: str = "targets") -> Vector:
    """Turn one pose or many, in any form, into matrices.

    Args:
        targets: see :data:`Targets`.
        name: what to call them in messages.

    Returns:
        shape (k, 4, 4); one pose gives k = 1.

    Raises:
        InvalidParameter: another shape, numbers that are not finite, or a matrix that is no rigid motion.
    """
    if isinstance(targets, RigidTransform):
        return np.array([targets.GetAsMatrix4()])
    if isinstance(targets, Sequence) and any(isinstance(target, RigidTransform) for target in targets):
        if not all(isinstance(target, RigidTransform) for target in targets):
            raise InvalidParameter(name, targets, f"{_EXPECTED}, all of one form")
        return np.array([target.GetAsMatrix4() for target in targets if isinstance(target, RigidTransform)])
    values = numbers(targets)
    if not values.size:
        raise InvalidParameter(name, targets, _EXPECTED)
    if not np.isfinite(values).all():
        index = np.argwhere(~np.isfinite(values))[0].tolist()
        raise InvalidParameter(name, f"an array with {values[tuple(index)]} at {index}", "finite numbers")
    if values.ndim in (1, 2) and values.shape[-1] == POSE_SIZE:
        return _matrices_from_vectors(np.atleast_2d(values))
    if values.ndim in (2, 3) and values.shape[-2:] == (4, 4):
        return _checked_matrices(values.reshape(-1, 4, 4), name)
    raise InvalidParameter(name, f"an array of shape {values.shape}", _EXPECTED)


def one_pose(target: Targets, name: str) -> Vector:
    """Return one pose in any form as a matrix (4, 4); errors are those of :func:`pose_matrices`, or tell of several."""
    matrices = pose_matrices(target, name)
    if len(matrices) != 1:
        raise InvalidParameter(name, f"{len(matrices)} poses", "one pose")
    return np.asarray(matrices[0])


def rotation_vectors(turns: Vector) -> Vector:
    """Return the rotation vectors (axis times angle, at most π) of rotation matrices (k, 3, 3), shape (k, 3) [rad]."""
    parts = turns.reshape(-1, 9) @ _SINE_AND_TRACE
    sine = np.sqrt((parts[:, :3] * parts[:, :3]).sum(axis=1))
    cosine = 0.5 * (parts[:, 3] - 1.0)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)
    vectors = scale[:, np.newaxis] * parts[:, :3]
    if (cosine < _HALF_TURN).any():
        rows = cosine < _HALF_TURN
        vectors[rows] = Rotation.from_matrix(turns[rows]).as_rotvec()
    return vectors


def pose_errors(targets: Vector, actual: Vector) -> Vector:
    """Return what leads from ``actual`` to ``targets``, both (k, 4, 4), in the axes of the base.

    Returns:
        shape (k, 6): the way [x y z] [m], then the rotation vector about [x y z] [rad].
    """
    turns = targets[:, :3, :3] @ actual[:, :3, :3].transpose(0, 2, 1)
    return np.concatenate([targets[:, :3, 3] - actual[:, :3, 3], rotation_vectors(turns)], axis=1)


def _matrices_from_vectors(vectors: Vector) -> Vector:
    (cz, cy, cx), (sz, sy, sx) = np.cos(vectors[:, 3:].T), np.sin(vectors[:, 3:].T)
    matrices = np.zeros((len(vectors), 4, 4))
    matrices[:, 0, :3] = np.stack([cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx], axis=1)
    matrices[:, 1, :3] = np.stack([sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx], axis=1)
    matrices[:, 2, :3] = np.stack([-sy, cy * sx, cy * cx], axis=1)
    matrices[:, :3, 3] = vectors[:, :3]
    matrices[:, 3, 3] = 1.0
    return matrices


def _checked_matrices(matrices: Vector, name: str) -> Vector:
    turns = matrices[:, :3, :3]
    square = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < _RIGID
    rigid = square & (np.linalg.det(turns) > 0) & (matrices[:, 3] == [0, 0, 0, 1]).all(axis=1)
    if not rigid.all():
        bad = int(np.argmin(rigid))
        raise InvalidParameter(f"{name}[{bad}]", matrices[bad].tolist(), "a rotation, a place, and a last row 0 0 0 1")
    return matrices
