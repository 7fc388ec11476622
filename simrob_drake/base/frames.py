"""Poses in every form that users write, one or many: vectors, matrices, the quaternion form of the ports; their errors.

Inside the package a pose is a :class:`pydrake.math.RigidTransform`, a batch of them an array of homogeneous matrices of
shape (k, 4, 4). The pose vector [x y z Rz Ry Rx] is the convention
of SimRob: metres and radians, with the rotation R = Rz(rz) Ry(ry) Rx(rx).
"""

import math
import operator
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message

POSE_SIZE = 6
XYZ_QUATERNION_NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")
VELOCITY_NAMES = ("vx", "vy", "vz", "wx", "wy", "wz")

Vector = np.ndarray[Any, np.dtype[np.float64]]
"""An array of floats of any shape; the shape is in the docstrings."""

Flags = np.ndarray[Any, np.dtype[np.bool_]]
"""An array of booleans of any shape."""

Indices = np.ndarray[Any, np.dtype[np.intp]]
"""An array of indices of another array."""


PoseLike: TypeAlias = RigidTransform | npt.ArrayLike
"""A pose in any form: a RigidTransform, a pose vector (6,), or a homogeneous matrix (4, 4)."""

_RIGID = 1e-6  # by how much a matrix may miss a rotation: printed figures pass, a scaled matrix does not
_APART = 1e-9  # points nearer to each other, or to a line through others, define no frame [m]


def as_transform(pose: PoseLike) -> RigidTransform:
    """Turn a pose in any form into a transform.

    Args:
        pose: a pose vector [x y z Rz Ry Rx] (6,) [m, rad], a matrix (4, 4), or a transform.

    Raises:
        InvalidParameter: another shape, numbers that are not finite, or a matrix that is no rigid motion.
    """
    if isinstance(pose, RigidTransform):
        return pose
    matrix = numbers(pose)
    if matrix.shape != (4, 4):
        return transform_from_pose(pose)
    turn = matrix[:3, :3]
    rigid = np.isfinite(matrix).all() and (matrix[3] == [0, 0, 0, 1]).all()
    if not rigid or np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0:
        raise InvalidParameter(
            "pose", matrix.tolist(), message("base.a_transform_matrix", "a rotation, a place, and a last row 0 0 0 1")
        )
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(turn), matrix[:3, 3])


def three_point_frame(x1: npt.ArrayLike, x2: npt.ArrayLike, y1: npt.ArrayLike) -> RigidTransform:
    r"""Return the frame of three points, as robot controllers teach it: x from x1 to x2, y towards y1.

    The origin is the foot of the perpendicular from y1 to the line through x1 and x2:
    :math:`p_0 = x_1 + \frac{(y_1 - x_1)\cdot d}{d \cdot d} d` with :math:`d = x_2 - x_1`. (SimRob's
    ``Prod(x1, x2, y1)`` searches for the same point.) The x axis points from there to x2, y to y1, z is their product.

    Args:
        x1: on the x axis, shape (3,) [m].
        x2: further on the x axis, beyond the origin, shape (3,) [m].
        y1: on the y axis, shape (3,) [m].

    Raises:
        InvalidParameter: points that lie on one line, or x2 at the origin of the frame.
    """
    first, second, third = (point(values, name) for values, name in ((x1, "x1"), (x2, "x2"), (y1, "y1")))
    along = second - first
    if np.linalg.norm(along) < _APART:
        raise InvalidParameter(
            "x2", second.tolist(), message("base.other_point_than_x1", "another point than x1 {x1}", x1=first.tolist())
        )
    origin = first + (third - first) @ along / (along @ along) * along
    n, o = second - origin, third - origin
    if np.linalg.norm(o) < _APART:
        raise InvalidParameter(
            "y1",
            third.tolist(),
            message("base.off_the_line", "off the line through x1 and x2: three collinear points fix no frame"),
        )
    if np.linalg.norm(n) < _APART:
        raise InvalidParameter(
            "x2",
            second.tolist(),
            message("base.away_from_foot", "away from the foot of the perpendicular from y1, the origin"),
        )
    n, o = n / np.linalg.norm(n), o / np.linalg.norm(o)
    return RigidTransform(RotationMatrix(np.column_stack([n, o, np.cross(n, o)])), origin)


def point(values: npt.ArrayLike, name: str = "point") -> Vector:
    """Return three finite numbers as an array (3,) [m]; raises InvalidParameter: anything else, called ``name``."""
    place = finite(values)
    if place.shape != (3,):
        raise InvalidParameter(name, values, message("base.a_place", "three finite numbers [x y z] in m"))
    return place


def transform_from_pose(pose: npt.ArrayLike) -> RigidTransform:
    """Turn a pose [x y z Rz Ry Rx], shape (6,) [m, rad], into a transform; raises InvalidParameter: not six numbers."""
    values = finite(pose)
    if values.shape != (POSE_SIZE,):
        raise InvalidParameter("pose", pose, message("base.a_pose", "six finite numbers [x y z Rz Ry Rx] in m and rad"))
    return RigidTransform(RollPitchYaw(values[:2:-1]), values[:3])


def pose_from_transform(transform: RigidTransform) -> Vector:
    """Turn a transform into a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad]; Ry is within ±π/2.

    Where x points along ±z, Rz and Rx turn about the same axis, and only together they mean something: Rx is what Rz
    leaves over, so that the pose vector gives the same rotation back to rounding even there.
    """
    return poses_from_matrices(transform.GetAsMatrix4())


def poses_from_matrices(matrices: Vector) -> Vector:
    """Turn homogeneous matrices (..., 4, 4) into pose vectors (..., 6), as :func:`pose_from_transform` does."""
    turn = matrices[..., :3, :3]
    about_z = np.arctan2(turn[..., 1, 0], turn[..., 0, 0])
    cosine, sine = np.cos(about_z), np.sin(about_z)
    about_y = np.arctan2(-turn[..., 2, 0], np.hypot(turn[..., 0, 0], turn[..., 1, 0]))
    about_x = np.arctan2(
        sine * turn[..., 0, 2] - cosine * turn[..., 1, 2], cosine * turn[..., 1, 1] - sine * turn[..., 0, 1]
    )
    return np.concatenate([matrices[..., :3, 3], np.stack([about_z, about_y, about_x], axis=-1)], axis=-1)


def xyz_quaternion_from_transform(transform: RigidTransform) -> Vector:
    """Turn a transform into [x y z qw qx qy qz], shape (7,), the form of the pose ports; qw is not negative."""
    wxyz = transform.rotation().ToQuaternion().wxyz()
    return np.concatenate([transform.translation(), wxyz if wxyz[0] >= 0 else -wxyz])


def transform_from_xyz_quaternion(values: npt.ArrayLike) -> RigidTransform:
    """Turn [x y z qw qx qy qz], shape (7,), into a transform; the quaternion need not be normalised.

    Raises:
        InvalidParameter: not seven finite numbers, or no quaternion.
    """
    xyz_wxyz = finite(values)
    if xyz_wxyz.shape != (len(XYZ_QUATERNION_NAMES),) or not xyz_wxyz[3:].any():
        raise InvalidParameter(
            "pose",
            values,
            message("base.a_quaternion_pose", "seven finite numbers [x y z qw qx qy qz], the last four not all zero"),
        )
    return RigidTransform(rotation_of(xyz_wxyz[3:]), xyz_wxyz[:3])


WRONG_NORM = 1e-3
"""Deviation of a quaternion's norm from 1 that no rounding explains: files write at least three decimals."""


def has_wrong_norm(quaternion: Vector) -> bool:
    """Whether the norm of a quaternion (4,) of a file differs from 1 by more than rounding; it may be all zero."""
    return abs(float(np.linalg.norm(quaternion)) - 1.0) > WRONG_NORM


def rotation_of(quaternion: Vector) -> RotationMatrix:
    """Return the rotation of a quaternion (4,) qw qx qy qz that may have any length."""
    return RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))


def matrices_from_xyz_quaternions(values: Vector) -> Vector:
    """Turn [x y z qw qx qy qz] with unit quaternions, shape (..., 7), into homogeneous matrices (..., 4, 4)."""
    crossed = np.swapaxes(np.cross(values[..., np.newaxis, 4:], np.eye(3)), -1, -2)  # of (qx qy qz), as a matrix
    matrices = np.zeros((*values.shape[:-1], 4, 4))
    matrices[..., :3, :3] = np.eye(3) + 2 * (values[..., 3, np.newaxis, np.newaxis] * crossed + crossed @ crossed)
    matrices[..., :3, 3], matrices[..., 3, 3] = values[..., :3], 1.0
    return matrices


def numbers(values: Any) -> Vector:
    """Return values as an array of floats, NaN where a masked array hides one; an empty array if they are none."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(float), np.nan)
        return np.zeros(0) if np.iscomplexobj(values) else np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(0)


def finite(values: Any) -> Vector:
    """Return values as an array of floats if all of them are finite; an empty array if they are anything else."""
    found = numbers(values)
    return found if np.isfinite(found).all() else np.zeros(0)


def vertical(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """Return the world's upward direction in the axes of a body of an orientation, of plain numbers."""
    return 2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx * qx + qy * qy)


def lean(up: list[float], qw: float, qx: float, qy: float, qz: float) -> float:
    """Return the angle [rad] from a body's ``up`` (3,) to the world's, in plain numbers: each step and sample asks."""
    upward = sum(map(operator.mul, vertical(qw, qx, qy, qz), up))
    return math.acos(min(max(upward, -1.0), 1.0)) if math.isfinite(upward) else upward


Targets: TypeAlias = npt.ArrayLike | RigidTransform | Sequence[RigidTransform]
"""One pose or many: pose vectors [x y z Rz Ry Rx], matrices (4, 4), or RigidTransforms."""

_EXPECTED = message(
    "base.poses", "pose vectors [x y z Rz Ry Rx] (6,) or (k, 6), matrices (4, 4) or (k, 4, 4), or RigidTransforms"
)
_HALF_TURN = -0.99  # cosine below which the antisymmetric part of a rotation tells the axis too roughly
_SINE_AND_TRACE = np.zeros((9, 4))  # of a rotation matrix row by row: sine times axis, and trace
_SINE_AND_TRACE[[7, 5, 2, 6, 3, 1], [0, 0, 1, 1, 2, 2]] = [0.5, -0.5, 0.5, -0.5, 0.5, -0.5]
_SINE_AND_TRACE[[0, 4, 8], 3] = 1.0


def pose_matrices(targets: Targets, name: str = "targets") -> Vector:
    """Turn one pose or many, in any form of :data:`Targets`, into matrices, shape (k, 4, 4); one pose gives k = 1.

    Raises InvalidParameter, which calls them ``name``: another shape, numbers that are not finite, or a matrix that is
    no rigid motion.
    """
    if isinstance(targets, RigidTransform):
        return np.array([targets.GetAsMatrix4()])
    if isinstance(targets, Sequence) and any(isinstance(target, RigidTransform) for target in targets):
        if not all(isinstance(target, RigidTransform) for target in targets):
            raise InvalidParameter(
                name, targets, message("base.all_of_one_form", "{expected}, all of one form", expected=_EXPECTED)
            )
        return np.array([target.GetAsMatrix4() for target in targets if isinstance(target, RigidTransform)])
    values = numbers(targets)
    if not values.size:
        raise InvalidParameter(name, targets, _EXPECTED)
    if not np.isfinite(values).all():
        index = np.argwhere(~np.isfinite(values))[0].tolist()
        raise InvalidParameter(
            name,
            message(
                "base.array_with_value", "an array with {value} at {index}", value=values[tuple(index)], index=index
            ),
            message("base.finite_numbers", "finite numbers"),
        )
    if values.ndim in (1, 2) and values.shape[-1] == POSE_SIZE:
        return _matrices_from_vectors(np.atleast_2d(values))
    if values.ndim in (2, 3) and values.shape[-2:] == (4, 4):
        return _checked_matrices(values.reshape(-1, 4, 4), name)
    raise InvalidParameter(
        name, message("base.array_of_shape", "an array of shape {shape}", shape=values.shape), _EXPECTED
    )


def one_pose(target: Targets, name: str) -> Vector:
    """Convert one pose in any form to a matrix (4, 4).

    Raises:
        InvalidParameter: the pose has a wrong shape or is no pose, see :func:`pose_matrices`; or there are several.
    """
    matrices = pose_matrices(target, name)
    if len(matrices) != 1:
        raise InvalidParameter(
            name,
            message("base.count_of_poses", "{poses} poses", poses=len(matrices)),
            message("base.one_pose", "one pose"),
        )
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
        from scipy.spatial.transform import Rotation  # which takes its time to load

        rows = cosine < _HALF_TURN
        vectors[rows] = Rotation.from_matrix(turns[rows]).as_rotvec()
    return vectors


def pose_errors(targets: Vector, actual: Vector) -> Vector:
    """Compute the errors of poses.

    Args:
        targets: desired poses, shape (k, 4, 4).
        actual: actual poses, shape (k, 4, 4).

    Returns:
        the difference of the positions [m], then the rotation vector from the actual to the desired pose [rad], shape
        (k, 6).
    """
    turns = targets[:, :3, :3] @ actual[:, :3, :3].transpose(0, 2, 1)
    return np.concatenate([targets[:, :3, 3] - actual[:, :3, 3], rotation_vectors(turns)], axis=1)


def within(errors: Vector, weights: Vector, tolerance: Vector) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Whether errors are within a tolerance.

    Args:
        errors: errors of position and rotation, shape (k, 6) [m, rad].
        weights: weights of the errors, shape (6,). Errors without a weight do not count.
        tolerance: largest distance and angle, shape (2,) [m, rad].

    Returns:
        a boolean for each pose, shape (k,).
    """
    squares = errors * errors * (weights > 0)
    near: np.ndarray[Any, np.dtype[np.bool_]] = squares[:, :3].sum(axis=1) <= tolerance[0] ** 2
    near &= squares[:, 3:].sum(axis=1) <= tolerance[1] ** 2
    return near


def _matrices_from_vectors(vectors: Vector) -> Vector:
    """Convert pose vectors [x y z Rz Ry Rx], shape (k, 6), to matrices (k, 4, 4): R = Rz(z) Ry(y) Rx(x)."""
    cz, cy, cx = np.cos(vectors[:, 3:].T)
    sz, sy, sx = np.sin(vectors[:, 3:].T)
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
        raise InvalidParameter(
            f"{name}[{bad}]",
            matrices[bad].tolist(),
            message("base.a_transform_matrix", "a rotation, a place, and a last row 0 0 0 1"),
        )
    return matrices


def rotated(quaternions: Vector, vectors: Vector, sense: float = 1.0) -> Vector:
    r"""Rotate m vectors by unit quaternions: :math:`v + 2 w (u \times v) + 2 u \times (u \times v)`.

    Args:
        quaternions: w x y z of each rotation, shape (m, 4); u is the vector part.
        vectors: vectors v, shape (m, 3).
        sense: 1 for the rotations, -1 for their inverses.
    """
    scalar = quaternions[:, :1]
    axis = sense * quaternions[:, 1:]
    # Keep the order of the arithmetic: results are compared to the last bit.
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + scalar * twice + np.cross(axis, twice))
