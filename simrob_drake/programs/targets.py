"""What users give as targets of moves, as poses in the world."""

from collections.abc import Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import (
    POSE_SIZE,
    PoseLike,
    Vector,
    as_transform,
    finite,
    pose_from_transform,
    poses_from_matrices,
)
from simrob_drake.interpolation import stacked
from simrob_drake.kinematics.poses import Targets, pose_matrices


@runtime_checkable
class HasTool(Protocol):
    """A robot in whose tool's frame targets may be, such as an :class:`~simrob_drake.Arm`."""

    def tool_pose(self) -> RigidTransform:
        """Return where its tool centre point is now, in the world."""


WorkObject: TypeAlias = str | PoseLike | HasTool | None
"""In whose frame targets are: a piece's name (its tool centre point) or one of its frames as ``piece.frame``, a robot's
name or an arm (its tool centre point), a pose in any form, or None for the world."""
PoseTargets: TypeAlias = Targets
"""One pose or many, in any form, or places (3,) or (k, 3) that keep the tool's orientation."""


def world_poses(targets: PoseTargets, wobj: RigidTransform, turn: Vector, name: str = "targets") -> Vector:
    """Return targets in a work object's frame as poses in the world, shape (k, 4, 4).

    Args:
        targets: poses in any form, or places (3,) or (k, 3).
        wobj: pose of the work object's frame.
        turn: the orientation that places go with, in the world, shape (3, 3).
        name: what the user calls them.

    Raises:
        InvalidParameter: another shape, or numbers that are not finite.
    """
    if is_place(targets):
        points = places(targets, wobj, name)
        return stacked(points, np.broadcast_to(turn, (len(points), 3, 3)))
    matrices: Vector = wobj.GetAsMatrix4() @ pose_matrices(targets, name)
    return matrices


def places(points: npt.ArrayLike | PoseTargets, wobj: RigidTransform, name: str) -> Vector:
    """Return places (3,) or (k, 3) in a work object's frame, or those of poses, in the world, shape (k, 3) [m].

    Raises:
        InvalidParameter: another shape, or numbers that are not finite.
    """
    if not is_place(points):
        return np.asarray((wobj.GetAsMatrix4() @ pose_matrices(points, name))[:, :3, 3])
    rows = np.atleast_2d(finite(points))
    if not rows.size:
        raise InvalidParameter(name, points, "places of three finite numbers [m]")
    return np.asarray(rows @ wobj.rotation().matrix().T + wobj.translation())


def is_place(targets: npt.ArrayLike | PoseTargets) -> bool:
    """Tell whether targets are places [x y z], not poses."""
    if isinstance(targets, RigidTransform):
        return False
    if isinstance(targets, Sequence) and any(isinstance(target, RigidTransform) for target in targets):
        return False
    try:
        shape = np.shape(targets)
    except ValueError:  # ragged
        return False
    return len(shape) in (1, 2) and shape[-1] == 3


def is_single(targets: PoseTargets) -> bool:
    """Tell whether targets are one pose or place, not rows of them."""
    return isinstance(targets, RigidTransform) or np.shape(targets) in ((3,), (6,), (4, 4))


def pose_numbers(pose: PoseLike) -> list[float]:
    """Return a pose as a file has it, [x y z Rz Ry Rx]; numbers that it was given by are kept to the last bit."""
    if not isinstance(pose, RigidTransform) and np.shape(pose) == (POSE_SIZE,):
        return [float(value) for value in np.asarray(pose)]
    return [float(value) for value in pose_from_transform(as_transform(pose))]


def row_numbers(targets: Any) -> Any:
    """Return targets as numbers: those that were given, or pose vectors in place of matrices and transforms."""
    if is_place(targets):
        return np.asarray(targets, dtype=float).tolist()
    try:
        values: Vector = np.asarray(targets, dtype=float)
    except (TypeError, ValueError):  # transforms
        values = np.zeros((4, 4))
    return values.tolist() if values.shape[-2:] != (4, 4) else poses_from_matrices(pose_matrices(targets, "")).tolist()
