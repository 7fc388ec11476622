"""Poses at the borders of the package: pose vectors, homogeneous matrices, the quaternion form of the ports, points.

Inside the package a pose is a :class:`pydrake.math.RigidTransform`. The pose vector [x y z Rz Ry Rx] is the convention
of SimRob: metres and radians, with the rotation R = Rz(rz) Ry(ry) Rx(rx).
"""

import math
import operator
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.errors import InvalidParameter

POSE_SIZE = 6
XYZ_QUATERNION_NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")

Vector = np.ndarray[Any, np.dtype[np.float64]]
"""An array of floats of any shape; the shape is in the docstrings."""


PoseLike: TypeAlias = RigidTransform | npt.ArrayLike
"""A pose in any form: a RigidTransform, a pose vector (6,), or a homogeneous matrix (4, 4)."""

_RIGID = 1e-6
"""By how much a matrix may miss a rotation: printed figures pass, a scaled matrix does not."""
_APART = 1e-9
"""Points nearer to each other, or to a line through others, define no frame [m]."""


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
        raise InvalidParameter("pose", matrix.tolist(), "a rotation, a place, and a last row 0 0 0 1")
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
        raise InvalidParameter("x2", second.tolist(), f"another point than x1 {first.tolist()}")
    origin = first + (third - first) @ along / (along @ along) * along
    n, o = second - origin, third - origin
    if np.linalg.norm(o) < _APART:
        raise InvalidParameter(
            "y1", third.tolist(), "off the line through x1 and x2: three collinear points fix no frame"
        )
    if np.linalg.norm(n) < _APART:
        raise InvalidParameter("x2", second.tolist(), "away from the foot of the perpendicular from y1, the origin")
    n, o = n / np.linalg.norm(n), o / np.linalg.norm(o)
    return RigidTransform(RotationMatrix(np.column_stack([n, o, np.cross(n, o)])), origin)


def point(values: npt.ArrayLike, name: str = "point") -> Vector:
    """Return three finite numbers as an array (3,) [m].

    Raises:
        InvalidParameter: anything else; the message calls it ``name``.
    """
    place = finite(values)
    if place.shape != (3,):
        raise InvalidParameter(name, values, "three finite numbers [x y z] in m")
    return place


def transform_from_pose(pose: npt.ArrayLike) -> RigidTransform:
    """Turn a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad], into a transform.

    Raises:
        InvalidParameter: the pose has not six finite numbers.
    """
    values = finite(pose)
    if values.shape != (POSE_SIZE,):
        raise InvalidParameter("pose", pose, "six finite numbers [x y z Rz Ry Rx] in m and rad")
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
        raise InvalidParameter("pose", values, "seven finite numbers [x y z qw qx qy qz], the last four not all zero")
    wxyz = xyz_wxyz[3:] / np.linalg.norm(xyz_wxyz[3:])
    return RigidTransform(Quaternion(wxyz), xyz_wxyz[:3])


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
    """Return the angle between a body's direction ``up`` (3,) and the world's, at an orientation [rad].

    Of plain numbers, because a run asks after every step and at every sample.
    """
    upward = sum(map(operator.mul, vertical(qw, qx, qy, qz), up))
    return math.acos(min(max(upward, -1.0), 1.0)) if math.isfinite(upward) else upward
