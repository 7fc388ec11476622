r"""Angles of a leg that put its foot where it shall be, for many postures at once.

Gauss and Newton's method, damped, on all postures together: :math:`\Delta q = (J^T J + \lambda I)^{-1} J^T e`. What a
leg is asked for depends on its joints: six keep the foot's place and rotation; four (a humanoid without ankle roll and
hip yaw) keep it ahead, at height and flat, and it goes sideways with the trunk; three (a quadruped) keep the place.
"""

from __future__ import annotations

import numpy as np

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
_HEAVY_DAMPING = 0.02  # more than a stretched leg's curvature, what is missing times a leg's length [m²]
_FLATNESS = 3.0  # metres that a radian counts for where a foot cannot get to its place
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
    angles = start.copy()
    error = np.full((len(angles), len(rows)), np.inf)
    for _ in range(_ROUNDS):
        error, jacobian = (part[:, rows] for part in _error_and_jacobian(skeleton, foot, target, root, angles))
        if np.abs(error).max() < _CLOSE:
            break
        square = jacobian.transpose(0, 2, 1) @ jacobian + _DAMPING * np.eye(len(axes))
        move = np.linalg.solve(square, jacobian.transpose(0, 2, 1) @ error[..., np.newaxis])[..., 0]
        angles[:, axes] += np.clip(move, -_LARGEST_MOVE, _LARGEST_MOVE)
    wrong = np.abs(error).max(axis=1)
    when = np.arange(len(angles), dtype=float) if times is None else times
    if wrong.max() > _WRONG:
        row = slice(int(wrong.argmax()), int(wrong.argmax()) + 1)
        one = (target[0][row], target[1][row]), (root[0][row], root[1][row]), start[row]
        short = _shortfall(skeleton, foot, *one, rows)
        raise OutOfReach(
            f"the leg of {foot.name} is out of reach by {1e3 * short:.0f} mm at {when[row][0]:.2f} s;"
            " take shorter or lower steps, or let the hips come down"
        )
    _check_limits(skeleton, foot, angles, when)
    return angles


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


def _shortfall(
    skeleton: Skeleton,
    foot: Foot,
    target: tuple[Vector, Vector],
    root: tuple[Vector, Vector],
    start: Vector,
    rows: list[int],
) -> float:
    """Return how near one foot, flat, comes to a place [m]: heavily damped, so that it settles."""
    angles, axes = start.copy(), list(foot.axes)
    weight = np.where(np.array(rows) < 3, 1.0, _FLATNESS)
    error = np.zeros((1, 6))
    for _ in range(10 * _ROUNDS):
        error, jacobian = _error_and_jacobian(skeleton, foot, target, root, angles)
        part = weight[:, np.newaxis] * jacobian[0][rows]
        angles[0, axes] += np.linalg.solve(
            part.T @ part + _HEAVY_DAMPING * np.eye(len(axes)), part.T @ (weight * error[0, rows])
        )
    return float(np.linalg.norm(error[0, [row for row in rows if row < 3]]))


def _check_limits(skeleton: Skeleton, foot: Foot, angles: Vector, when: Vector) -> None:
    """Check that every joint of a leg stays within its limits."""
    lower, upper = skeleton.model.axis_limits
    for axis in foot.axes:
        beyond = np.maximum(lower[axis] - angles[:, axis], angles[:, axis] - upper[axis])
        row = int(beyond.argmax())
        if beyond[row] > 0:
            name, value = list(skeleton.model.axes)[axis], np.rad2deg(angles[row, axis])
            raise OutOfReach(
                f"{name} would need {value:.1f} deg at {when[row]:.2f} s, {np.rad2deg(beyond[row]):.1f} deg beyond"
                f" its limits of {np.rad2deg(lower[axis]):.0f} to {np.rad2deg(upper[axis]):.0f} deg"
            )
