r"""Angles of a leg that put its foot where it shall be, for many postures at once.

Gauss and Newton's method, damped, on all postures together: :math:`\Delta q = (J^T J + \lambda I)^{-1} J^T e`. What a
leg is asked for depends on its joints: six keep the foot's place and rotation; four (a humanoid without ankle roll and
hip yaw) keep it ahead, at height and flat, and it goes sideways with the trunk; three (a quadruped) keep the place.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.feet import Foot
from simrob_drake.programs.gaits.skeleton import Poses, Skeleton

ROWS = {6: [0, 1, 2, 3, 4, 5], 4: [0, 2, 3, 4], 3: [0, 1, 2]}
"""Which of [ahead, left, up, roll, pitch, yaw] a leg of so many joints is asked for."""

_ROUNDS = 30
_DAMPING = 1e-9
_LARGEST_MOVE = 0.4  # of a joint in a round [rad]
_CLOSE = 1e-6  # when to stop [m, rad]
_LEG = 0.5  # more than a leg that bends [m]: times what is missing, more than the curvature of a stretched one
_FLATNESS = 3.0  # metres that a radian counts for where a foot cannot get to its place
_ROUNDING = 1e-9  # rad
_LOOKS = 100  # postures that tell by how much a leg is too short
_WRONG = 1e-4  # what counts as out of reach [m, rad]


class OutOfReach(SimrobError):
    """A leg that cannot get where its foot shall be."""


def leg_angles(
    skeleton: Skeleton,
    foot: Foot,
    target: tuple[Vector, Vector],
    root: tuple[Vector, Vector],
    start: Vector,
    times: Vector | None = None,
) -> Vector:
    """Return the robot's angles with those of one leg solved.

    Args:
        skeleton: of the robot.
        foot: whose leg to solve.
        target: rotation of the foot, relative to flat and ahead, (m, 3, 3), and place of its point (m, 3) [m].
        root: rotation (m, 3, 3) and position (m, 3) of the root [m].
        start: angles of all axes to begin with, shape (m, n) [rad]; not changed.
        times: of the postures (m,) [s], for messages.

    Returns:
        angles of all axes, shape (m, n) [rad].

    Raises:
        OutOfReach: names the leg, by how much it is too short, and when.
        InvalidParameter: a leg that has neither three, four nor six joints.
    """
    axes = list(foot.axes)
    if len(axes) not in ROWS:
        raise InvalidParameter(f"leg of {foot.name}", f"{len(axes)} joints", "three, four or six joints")
    rows = ROWS[len(axes)]
    angles, best = start.copy(), start.copy()
    least = np.full(len(angles), np.inf)
    for _ in range(_ROUNDS):
        error, jacobian = (part[:, rows] for part in _error_and_jacobian(skeleton, foot, target, root, angles))
        left = np.abs(error).max(axis=1)
        best[left < least], least = angles[left < least], np.minimum(left, least)
        if left.max() < _CLOSE:
            break
        square = jacobian.transpose(0, 2, 1) @ jacobian + _DAMPING * np.eye(len(axes))
        move = np.linalg.solve(square, jacobian.transpose(0, 2, 1) @ error[..., np.newaxis])[..., 0]
        angles[:, axes] += np.clip(move, -_LARGEST_MOVE, _LARGEST_MOVE)
    when = np.arange(len(angles), dtype=float) if times is None else times
    wrong = np.flatnonzero(least > _CLOSE)
    for some in (wrong[:: 1 + len(wrong) // _LOOKS], wrong) if wrong.size else ():  # what cannot be shows in some
        best[some], missing = _nearest(skeleton, foot, _at(target, some), _at(root, some), start[some])
        _check_reach(foot, missing, when[some])
    _check_limits(skeleton, foot, best, when)
    return best


def foot_point(skeleton: Skeleton, foot: Foot, poses: Poses) -> Vector:
    """Return where the point of a foot is, shape (m, 3) [m]."""
    body, rotation, position = skeleton.frames[foot.link]
    return np.asarray(poses.position[body] + poses.rotation[body] @ (position + rotation @ foot.point))


def _error_and_jacobian(
    skeleton: Skeleton, foot: Foot, target: tuple[Vector, Vector], root: tuple[Vector, Vector], angles: Vector
) -> tuple[Vector, Vector]:
    """Return what is missing (m, 6) [m, rad] and how the leg's axes change it (m, 6, k)."""
    poses = skeleton.poses(root, angles, list(foot.axes))
    body, rotation, _ = skeleton.frames[foot.link]
    point = foot_point(skeleton, foot, poses)
    missing = target[0] @ foot.upright @ (poses.rotation[body] @ rotation).transpose(0, 2, 1)
    turn = np.stack([missing[:, 2, 1] - missing[:, 1, 2], missing[:, 0, 2] - missing[:, 2, 0],
                     missing[:, 1, 0] - missing[:, 0, 1]], axis=1) / 2  # fmt: skip
    error = np.concatenate([target[1] - point, turn], axis=1)
    jacobian = np.empty((len(angles), 6, len(foot.axes)))
    for column, axis in enumerate(foot.axes):
        parent = skeleton.parents[axis]
        at = poses.position[parent] + poses.rotation[parent] @ skeleton.before[1][axis]
        direction = poses.rotation[parent] @ (skeleton.before[0][axis] @ skeleton.directions[axis])
        jacobian[:, :3, column] = np.cross(direction, point - at)
        jacobian[:, 3:, column] = direction
    return error, jacobian


def _nearest(
    skeleton: Skeleton, foot: Foot, target: tuple[Vector, Vector], root: tuple[Vector, Vector], start: Vector
) -> tuple[Vector, Vector]:
    """Return how near a foot, flat, comes: angles (m, n), and what is missing (m, 6) [m, rad].

    Stretched legs, where Gauss and Newton's steps jump to and fro, settle with a damping as large as what is missing.
    """
    angles, axes = start.copy(), list(foot.axes)
    rows = ROWS[len(axes)]
    weight = np.where(np.array(rows) < 3, 1.0, _FLATNESS)
    error = np.zeros((len(angles), 6))
    for number in range(10 * _ROUNDS + 1):
        error, jacobian = _error_and_jacobian(skeleton, foot, target, root, angles)
        if number == 10 * _ROUNDS or np.abs(error[:, rows]).max() < _CLOSE:
            break
        part, left = weight[:, np.newaxis] * jacobian[:, rows], weight * error[:, rows]
        damping = _DAMPING + _LEG * np.linalg.norm(left, axis=1)
        square = part.transpose(0, 2, 1) @ part + damping[:, np.newaxis, np.newaxis] * np.eye(len(axes))
        angles[:, axes] += np.linalg.solve(square, part.transpose(0, 2, 1) @ left[..., np.newaxis])[..., 0]
    return angles, error


def _check_reach(foot: Foot, missing: Vector, when: Vector) -> None:
    """Check that of place and rotation (m, 6) [m, rad] nothing is missing where the leg is asked for it."""
    rows = ROWS[len(foot.axes)]
    if np.abs(missing[:, rows]).max() > _WRONG:
        short = np.linalg.norm(missing[:, [row for row in rows if row < 3]], axis=1)
        worst = int(short.argmax())
        raise OutOfReach(
            f"the leg of {foot.name} is out of reach by {_digits(1e3 * short[worst])} mm at {when[worst]:.2f} s;"
            " take shorter or lower steps, or let the hips come down"
        )


def _digits(value: float) -> str:
    """Return a figure that is never shown as zero: at least two digits that count."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _at(pose: tuple[Vector, Vector], rows: npt.NDArray[np.intp]) -> tuple[Vector, Vector]:
    return pose[0][rows], pose[1][rows]


def _check_limits(skeleton: Skeleton, foot: Foot, angles: Vector, when: Vector) -> None:
    """Check that every joint of a leg stays within its limits."""
    lower, upper = skeleton.model.axis_limits
    for axis in foot.axes:
        beyond = np.maximum(lower[axis] - angles[:, axis], angles[:, axis] - upper[axis])
        row = int(beyond.argmax())
        if beyond[row] > _ROUNDING:
            name, value = list(skeleton.model.axes)[axis], np.rad2deg(angles[row, axis])
            raise OutOfReach(
                f"{name} would need {value:.1f} deg at {when[row]:.2f} s, {_digits(np.rad2deg(beyond[row]))} deg beyond"
                f" its limits of {np.rad2deg(lower[axis]):.0f} to {np.rad2deg(upper[axis]):.0f} deg"
            )
