"""Poses at the borders of the package: the pose vector [x y z Rz Ry Rx] and the quaternion form of the ports.

Inside the package a pose is a :class:`pydrake.math.RigidTransform`. The pose vector is the convention of SimRob:
metres and radians, with the rotation R = Rz(rz) Ry(ry) Rx(rx).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.errors import InvalidParameter

POSE_SIZE = 6
POSE_NAMES = ("x", "y", "z", "Rz", "Ry", "Rx")
XYZ_QUATERNION_NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")

Vector = np.ndarray[Any, np.dtype[np.float64]]
"""An array of floats of any shape; the shape is in the docstrings."""


def transform_from_pose(pose: npt.ArrayLike) -> RigidTransform:
    """Turn a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad], into a transform.

    Raises:
        InvalidParameter: the pose has not six finite numbers.
    """
    try:
        values = np.asarray(pose, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (POSE_SIZE,) or not np.isfinite(values).all():
        raise InvalidParameter("pose", pose, "six finite numbers [x y z Rz Ry Rx] in m and rad")
    return RigidTransform(RollPitchYaw(values[:2:-1]), values[:3])


def pose_from_transform(transform: RigidTransform) -> Vector:
    """Turn a transform into a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad]."""
    angles = RollPitchYaw(transform.rotation()).vector()
    return np.concatenate([transform.translation(), angles[::-1]])


def xyz_quaternion_from_transform(transform: RigidTransform) -> Vector:
    """Turn a transform into [x y z qw qx qy qz], shape (7,), the form of the pose ports; qw is not negative."""
    wxyz = transform.rotation().ToQuaternion().wxyz()
    return np.concatenate([transform.translation(), wxyz if wxyz[0] >= 0 else -wxyz])


def transform_from_xyz_quaternion(values: npt.ArrayLike) -> RigidTransform:
    """Turn [x y z qw qx qy qz], shape (7,), into a transform; the quaternion need not be normalised."""
    xyz_wxyz = np.asarray(values, dtype=float)
    if xyz_wxyz.shape != (len(XYZ_QUATERNION_NAMES),) or not np.isfinite(xyz_wxyz).all() or not xyz_wxyz[3:].any():
        raise InvalidParameter("pose", values, "seven finite numbers [x y z qw qx qy qz], the last four not all zero")
    wxyz = xyz_wxyz[3:] / np.linalg.norm(xyz_wxyz[3:])
    return RigidTransform(Quaternion(wxyz), xyz_wxyz[:3])
