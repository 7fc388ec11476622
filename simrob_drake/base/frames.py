"""Poses in all forms that users write, conversions between these forms, and errors of poses.

Inside the package, a pose is a :class:`pydrake.math.RigidTransform`, and k poses are homogeneous matrices, shape
(k, 4, 4). Users may also write *pose vectors* [x y z Rz Ry Rx], the convention of SimRob: metres and radians, with the
rotation R = Rz(rz) Ry(ry) Rx(rx). Ports and recorded signals have the form [x y z qw qx qy qz], with a unit quaternion.
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
"""Count of the numbers of a pose vector."""

XYZ_QUATERNION_NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Names of the components of a pose in ports and signals."""

VELOCITY_NAMES = ("vx", "vy", "vz", "wx", "wy", "wz")
"""Names of the components of a spatial velocity in ports and signals [m/s, rad/s]."""

Vector = np.ndarray[Any, np.dtype[np.float64]]
"""An array of floats of any shape; the shape is in the docstrings."""

Flags = np.ndarray[Any, np.dtype[np.bool_]]
"""An array of booleans of any shape."""

Indices = np.ndarray[Any, np.dtype[np.intp]]
"""An array of indices of another array."""


PoseLike: TypeAlias = RigidTransform | npt.ArrayLike
"""A pose in any form: a RigidTransform, a pose vector (6,), or a homogeneous matrix (4, 4)."""

_RIGID = 1e-6
"""Tolerance for the entries of R R^T - I of a rotation matrix R: rounded numbers pass, a scaled matrix does not."""

_APART = 1e-9
"""Points that are closer to each other, or to a line through others, define no frame [m]."""


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
    # It is a pose vector, or has a shape that this function refuses.
    if matrix.shape != (4, 4):
        return transform_from_pose(pose)
    if not np.isfinite(matrix).all() or not _are_rigid(matrix[np.newaxis])[0]:
        raise InvalidParameter("pose", matrix.tolist(), _A_TRANSFORM)
    # Drake asserts that rotations are exact, which rounded ones are not.
    rotation = RotationMatrix.ProjectToRotationMatrix(matrix[:3, :3])
    return RigidTransform(rotation, matrix[:3, 3])


_A_TRANSFORM = message(
    "base.a_transform_matrix",
    "a homogeneous matrix: a rotation, a position, and the last row 0 0 0 1",
)
"""Expected form of a matrix, for errors."""


def _are_rigid(matrices: Vector) -> Flags:
    """Whether finite matrices (k, 4, 4) are rigid motions: an orthogonal matrix R with det R > 0, last row 0 0 0 1."""
    rotations = matrices[:, :3, :3]
    deviations = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    # A mirror image fulfils R R^T = I, too: its determinant is -1.
    is_right_handed = np.linalg.det(rotations) > 0
    has_last_row = (matrices[:, 3] == [0, 0, 0, 1]).all(axis=1)
    return np.asarray((deviations < _RIGID) & is_right_handed & has_last_row)


def three_point_frame(x1: npt.ArrayLike, x2: npt.ArrayLike, y1: npt.ArrayLike) -> RigidTransform:
    r"""Compute the frame of three points, as robot controllers teach it: x from x1 to x2, y towards y1.

    The origin is the foot of the perpendicular from y1 to the line through x1 and x2:
    :math:`p_0 = x_1 + \frac{(y_1 - x_1)\cdot d}{d \cdot d} d` with :math:`d = x_2 - x_1`. (SimRob's
    ``Prod(x1, x2, y1)`` searches for the same point.) The x axis points from there to x2, the y axis to y1.

    Args:
        x1: a point on the x axis, shape (3,) [m].
        x2: a second point on the x axis, beyond the origin, shape (3,) [m].
        y1: a point on the y axis, shape (3,) [m].

    Raises:
        InvalidParameter: a point is not three finite numbers, x1 and x2 are equal, the points are on one line, or x2 is
            the origin of the frame.
    """
    first = point(x1, "x1")
    second = point(x2, "x2")
    third = point(y1, "y1")
    along = second - first  # d in the equation above
    # Without this check, the quotient below would divide by zero.
    if np.linalg.norm(along) < _APART:
        raise InvalidParameter(
            "x2",
            second.tolist(),
            message(
                "base.other_point_than_x1", "a point different from x1 {x1}", x1=first.tolist()
            ),
        )
    origin = first + (third - first) @ along / (along @ along) * along
    to_x2 = second - origin
    to_y1 = third - origin
    # The foot of the perpendicular is y1 itself: the three points are on one line.
    if np.linalg.norm(to_y1) < _APART:
        raise InvalidParameter(
            "y1",
            third.tolist(),
            message(
                "base.off_the_line",
                "off the line through x1 and x2: three collinear points do not define a frame",
            ),
        )
    # The x axis needs a second point beyond the origin.
    if np.linalg.norm(to_x2) < _APART:
        raise InvalidParameter(
            "x2",
            second.tolist(),
            message(
                "base.away_from_foot",
                "different from the origin, which is the foot of the perpendicular from y1",
            ),
        )
    x_axis = to_x2 / np.linalg.norm(to_x2)
    y_axis = to_y1 / np.linalg.norm(to_y1)
    # The x and y axes are at right angles by the choice of the origin, so this one has the length 1.
    z_axis = np.cross(x_axis, y_axis)
    return RigidTransform(RotationMatrix(np.column_stack([x_axis, y_axis, z_axis])), origin)


def point(values: npt.ArrayLike, name: str = "point") -> Vector:
    """Convert a point to an array (3,) [m].

    Args:
        values: the coordinates.
        name: name of the parameter, for the error.

    Raises:
        InvalidParameter: they are not three finite numbers.
    """
    place = finite(values)
    if place.shape != (3,):
        raise InvalidParameter(
            name, values, message("base.a_place", "three finite numbers [x y z] in m")
        )
    return place


def transform_from_pose(pose: npt.ArrayLike) -> RigidTransform:
    """Convert a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad], to a transform.

    Raises:
        InvalidParameter: it has not six finite numbers.
    """
    values = finite(pose)
    if values.shape != (POSE_SIZE,):
        raise InvalidParameter(
            "pose", pose, message("base.a_pose", "six finite numbers [x y z Rz Ry Rx] in m and rad")
        )
    # Drake's RollPitchYaw takes the same angles in the other order: Rx, Ry, Rz.
    roll_pitch_yaw = values[:2:-1]
    return RigidTransform(RollPitchYaw(roll_pitch_yaw), values[:3])


def pose_from_transform(transform: RigidTransform) -> Vector:
    """Convert a transform to a pose vector [x y z Rz Ry Rx], shape (6,) [m, rad], with Ry within ±π/2.

    If the x axis points along ±z (Ry = ±π/2), Rz and Rx are rotations about the same axis, and only their sum or
    difference is defined. Rz is then computed from rounding errors, and Rx so that the pose vector gives the same
    rotation, up to rounding.
    """
    return poses_from_matrices(transform.GetAsMatrix4())


def poses_from_matrices(matrices: Vector) -> Vector:
    """Convert homogeneous matrices (..., 4, 4) to pose vectors (..., 6), as :func:`pose_from_transform` does."""
    rotations = matrices[..., :3, :3]
    x_axes = rotations[..., 0]
    y_axes = rotations[..., 1]
    z_axes = rotations[..., 2]

    # R = Rz Ry Rx has the x axis (cz cy, sz cy, -sy), with c and s for the cosines and sines of the angles.
    rz = np.arctan2(x_axes[..., 1], x_axes[..., 0])
    ry = np.arctan2(-x_axes[..., 2], np.hypot(x_axes[..., 0], x_axes[..., 1]))

    # Rz^T R = Ry Rx has the second row (0, cx, -sx): it defines Rx even if the x axis points along z.
    cosine = np.cos(rz)
    sine = np.sin(rz)
    sine_x = sine * z_axes[..., 0] - cosine * z_axes[..., 1]
    cosine_x = cosine * y_axes[..., 1] - sine * y_axes[..., 0]
    rx = np.arctan2(sine_x, cosine_x)
    angles = np.stack([rz, ry, rx], axis=-1)
    return np.concatenate([matrices[..., :3, 3], angles], axis=-1)


def xyz_quaternion_from_transform(transform: RigidTransform) -> Vector:
    """Convert a transform to [x y z qw qx qy qz], shape (7,), the form of the pose ports, with qw not negative."""
    wxyz = transform.rotation().ToQuaternion().wxyz()
    # q and -q are the same rotation. One of the two is chosen, so that equal poses have equal numbers.
    if wxyz[0] < 0:
        wxyz = -wxyz
    return np.concatenate([transform.translation(), wxyz])


def transform_from_xyz_quaternion(values: npt.ArrayLike) -> RigidTransform:
    """Convert [x y z qw qx qy qz], shape (7,), to a transform. The quaternion may have any length but zero.

    Raises:
        InvalidParameter: it has not seven finite numbers, or the quaternion is zero.
    """
    xyz_wxyz = finite(values)
    has_size = xyz_wxyz.shape == (len(XYZ_QUATERNION_NAMES),)
    if not has_size or not xyz_wxyz[3:].any():
        raise InvalidParameter(
            "pose",
            values,
            message(
                "base.a_quaternion_pose",
                "seven finite numbers [x y z qw qx qy qz], the last four not all zero",
            ),
        )
    return RigidTransform(rotation_of(xyz_wxyz[3:]), xyz_wxyz[:3])


WRONG_NORM = 1e-3
"""Deviation of a quaternion's norm from 1 that no rounding explains: files write at least three decimals."""


def has_wrong_norm(quaternion: Vector) -> bool:
    """Whether the norm of a quaternion (4,) of a file differs from 1 by more than rounding; it may be all zero."""
    return abs(float(np.linalg.norm(quaternion)) - 1.0) > WRONG_NORM


def rotation_of(quaternion: Vector) -> RotationMatrix:
    """Convert a quaternion (4,) qw qx qy qz to a rotation. It may have any length but zero."""
    return RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))


def matrices_from_xyz_quaternions(values: Vector) -> Vector:
    """Convert [x y z qw qx qy qz] with unit quaternions, shape (..., 7), to homogeneous matrices (..., 4, 4)."""
    # With the quaternion (w, u) and the matrix C of the cross product, C v = u x v: R = I + 2 (w C + C C).
    scalar = values[..., 3, np.newaxis, np.newaxis]
    # Row k is u x e_k, which is column k of C.
    columns = np.cross(values[..., np.newaxis, 4:], np.eye(3))
    cross_matrix = np.swapaxes(columns, -1, -2)
    rotations = np.eye(3) + 2 * (scalar * cross_matrix + cross_matrix @ cross_matrix)
    matrices = np.zeros((*values.shape[:-1], 4, 4))
    matrices[..., :3, :3] = rotations
    matrices[..., :3, 3] = values[..., :3]
    matrices[..., 3, 3] = 1.0
    return matrices


def numbers(values: Any) -> Vector:
    """Convert values to an array of floats. Returns an empty array if they are no real numbers.

    Entries that a masked array hides become NaN.
    """
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(float), np.nan)
        # NumPy would drop the imaginary parts with a warning only.
        return np.zeros(0) if np.iscomplexobj(values) else np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(0)


def finite(values: Any) -> Vector:
    """Convert values to an array of floats. Returns an empty array if they are not all finite numbers."""
    found = numbers(values)
    return found if np.isfinite(found).all() else np.zeros(0)


def vertical(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """Compute the world's upward direction in the axes of a body: the last row of its rotation matrix.

    The result has plain numbers, since this is called at each step of a run, where small arrays are slow.

    Args:
        qw: scalar part of the unit quaternion of the body's orientation.
        qx: x entry of the vector part.
        qy: y entry of the vector part.
        qz: z entry of the vector part.
    """
    x = 2 * (qx * qz - qw * qy)
    y = 2 * (qy * qz + qw * qx)
    z = 1 - 2 * (qx * qx + qy * qy)
    return x, y, z


def lean(up: list[float], qw: float, qx: float, qy: float, qz: float) -> float:
    """Compute the angle between a direction of a body and the world's upward direction [rad].

    It has plain numbers, as :func:`vertical`. Returns NaN or infinity if the orientation has such entries.

    Args:
        up: unit vector in the axes of the body, shape (3,): its upward direction when it stands upright.
        qw: scalar part of the unit quaternion of the body's orientation.
        qx: x entry of the vector part.
        qy: y entry of the vector part.
        qz: z entry of the vector part.
    """
    # Scalar product of the upward direction of the world and that of the body, both in the axes of the body.
    cosine: float = sum(map(operator.mul, vertical(qw, qx, qy, qz), up))
    if not math.isfinite(cosine):
        return cosine
    # Rounding may bring the cosine of an upright body slightly beyond 1, where acos fails.
    return math.acos(min(max(cosine, -1.0), 1.0))


Targets: TypeAlias = npt.ArrayLike | RigidTransform | Sequence[RigidTransform]
"""One pose or many: pose vectors [x y z Rz Ry Rx], matrices (4, 4), or RigidTransforms."""

_EXPECTED = message(
    "base.poses",
    "pose vectors [x y z Rz Ry Rx] (6,) or (k, 6), matrices (4, 4) or (k, 4, 4), or RigidTransforms",
)
"""Expected forms of poses, for errors."""

_HALF_TURN = -0.99
"""Cosine of the angle of a rotation below which the difference R - R^T is too small to give the axis accurately."""

# A matrix S so that r S = (a sin(angle), trace R), for the entries r of a rotation matrix R, row by row, with axis a.
# The entries of a sin(angle) are half the differences R[2, 1] - R[1, 2], R[0, 2] - R[2, 0] and R[1, 0] - R[0, 1].
_SINE_AND_TRACE = np.zeros((9, 4))
_SINE_AND_TRACE[[7, 5, 2, 6, 3, 1], [0, 0, 1, 1, 2, 2]] = [0.5, -0.5, 0.5, -0.5, 0.5, -0.5]
_SINE_AND_TRACE[[0, 4, 8], 3] = 1.0

_SMALLEST_SINE = 1e-12
"""Sine of an angle below which sine and angle are equal to rounding."""


def pose_matrices(targets: Targets, name: str = "targets") -> Vector:
    """Convert one pose or several to homogeneous matrices, shape (k, 4, 4), with k = 1 for one pose.

    Args:
        targets: the poses.
        name: name of the parameter, for the error.

    Raises:
        InvalidParameter: there is no pose, the poses are not all of one form or have another shape, or they contain
            numbers that are not finite or a matrix that is no rigid motion.
    """
    if isinstance(targets, RigidTransform):
        return np.array([targets.GetAsMatrix4()])
    if isinstance(targets, Sequence) and any(
        isinstance(target, RigidTransform) for target in targets
    ):
        if not all(isinstance(target, RigidTransform) for target in targets):
            raise InvalidParameter(
                name,
                targets,
                message(
                    "base.all_of_one_form", "{expected}, all of the same form", expected=_EXPECTED
                ),
            )
        return np.array(
            [target.GetAsMatrix4() for target in targets if isinstance(target, RigidTransform)]
        )
    values = numbers(targets)
    if not values.size:
        raise InvalidParameter(name, targets, _EXPECTED)
    if not np.isfinite(values).all():
        # The first bad entry is named: an array of many poses would be too long to show.
        index = np.argwhere(~np.isfinite(values))[0].tolist()
        value = values[tuple(index)]
        raise InvalidParameter(
            name,
            message(
                "base.array_with_value",
                "an array with {value} at {index}",
                value=value,
                index=index,
            ),
            message("base.finite_numbers", "finite numbers"),
        )
    # The last dimensions tell the two forms apart: a pose vector has six numbers, a matrix four rows of four.
    if values.ndim in (1, 2) and values.shape[-1] == POSE_SIZE:
        return _matrices_from_vectors(np.atleast_2d(values))
    if values.ndim in (2, 3) and values.shape[-2:] == (4, 4):
        matrices = values.reshape(-1, 4, 4)
        _check_matrices(matrices, name)
        return matrices
    raise InvalidParameter(
        name,
        message("base.array_of_shape", "an array of shape {shape}", shape=values.shape),
        _EXPECTED,
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
    """Compute the rotation vectors (axis times angle, at most π) of rotation matrices (k, 3, 3), shape (k, 3) [rad]."""
    sines_and_traces = turns.reshape(-1, 9) @ _SINE_AND_TRACE
    # One product with S gives all four numbers of each rotation, which is faster than indexing the nine entries.
    axes_times_sine = sines_and_traces[:, :3]
    sine = np.sqrt((axes_times_sine * axes_times_sine).sum(axis=1))
    cosine = 0.5 * (sines_and_traces[:, 3] - 1.0)  # trace R = 1 + 2 cos(angle)
    angle = np.arctan2(sine, cosine)
    # The quotient is 1 in the limit of small angles, where the division would fail.
    scale = np.where(sine > _SMALLEST_SINE, angle / np.maximum(sine, _SMALLEST_SINE), 1.0)
    vectors = scale[:, np.newaxis] * axes_times_sine
    # SciPy computes these few through a quaternion, which is accurate near a half turn.
    is_half_turn = cosine < _HALF_TURN
    if is_half_turn.any():
        from scipy.spatial.transform import Rotation  # imported here, since it takes long to load

        vectors[is_half_turn] = Rotation.from_matrix(turns[is_half_turn]).as_rotvec()
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
    # R_error = R_target R_actual^T
    turns = targets[:, :3, :3] @ actual[:, :3, :3].transpose(0, 2, 1)
    distances = targets[:, :3, 3] - actual[:, :3, 3]
    return np.concatenate([distances, rotation_vectors(turns)], axis=1)


def within(errors: Vector, weights: Vector, tolerance: Vector) -> Flags:
    """Whether errors are within a tolerance.

    Args:
        errors: errors of position and rotation, shape (k, 6) [m, rad].
        weights: weights of the errors, shape (6,). Errors without a weight do not count.
        tolerance: largest distance and angle, shape (2,) [m, rad].

    Returns:
        a boolean for each pose, shape (k,).
    """
    # Squares are compared, which saves the roots.
    # The weights only decide which errors count. A tolerance is a distance or an angle as the user measures it.
    squares = errors * errors * (weights > 0)
    is_near = squares[:, :3].sum(axis=1) <= tolerance[0] ** 2
    is_aligned = squares[:, 3:].sum(axis=1) <= tolerance[1] ** 2
    return np.asarray(is_near & is_aligned)


def _matrices_from_vectors(vectors: Vector) -> Vector:
    """Convert pose vectors [x y z Rz Ry Rx], shape (k, 6), to matrices (k, 4, 4): R = Rz(z) Ry(y) Rx(x)."""
    # Cosines and sines of the angles about z, y and x.
    cz, cy, cx = np.cos(vectors[:, 3:].T)
    sz, sy, sx = np.sin(vectors[:, 3:].T)
    matrices = np.zeros((len(vectors), 4, 4))
    matrices[:, 0, 0] = cz * cy
    matrices[:, 0, 1] = cz * sy * sx - sz * cx
    matrices[:, 0, 2] = cz * sy * cx + sz * sx
    matrices[:, 1, 0] = sz * cy
    matrices[:, 1, 1] = sz * sy * sx + cz * cx
    matrices[:, 1, 2] = sz * sy * cx - cz * sx
    matrices[:, 2, 0] = -sy
    matrices[:, 2, 1] = cy * sx
    matrices[:, 2, 2] = cy * cx
    matrices[:, :3, 3] = vectors[:, :3]
    matrices[:, 3, 3] = 1.0
    return matrices


def _check_matrices(matrices: Vector, name: str) -> None:
    """Check homogeneous matrices.

    Args:
        matrices: finite matrices, shape (k, 4, 4).
        name: name of the parameter, for the error.

    Raises:
        InvalidParameter: a matrix is no rigid motion. The error names the first such matrix.
    """
    is_rigid = _are_rigid(matrices)
    if not is_rigid.all():
        # The index of the first False, which is less than True.
        bad = int(np.argmin(is_rigid))
        raise InvalidParameter(f"{name}[{bad}]", matrices[bad].tolist(), _A_TRANSFORM)


def rotate_vectors(quaternions: Vector, vectors: Vector, sense: float = 1.0) -> Vector:
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
