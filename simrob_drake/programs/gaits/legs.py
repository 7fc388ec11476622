"""Inverse kinematics of a leg: the angles that bring its foot to desired poses, for many postures at once.

The count of its joints determines which coordinates of the foot a leg can reach. Six joints reach a position and a
rotation. Four (a humanoid without ankle roll and hip yaw) reach the position ahead, the height and a flat foot, while
the foot moves sideways with the trunk. Three (a quadruped) reach a position.
"""

import numpy as np

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.numeric import fit_postures
from simrob_drake.programs.gaits.walker import Foot
from simrob_drake.robots.catalog import RobotModel

ROWS = {6: [0, 1, 2, 3, 4, 5], 4: [0, 2, 3, 4], 3: [0, 1, 2]}
"""Indices of the coordinates [ahead, left, up, roll, pitch, yaw] that a leg can reach, by the count of its joints."""

_POSITION_ROWS = 3  # the first three coordinates are those of the position
_MOST_ITERATIONS = 300  # largest count of iterations of the inverse kinematics
# Errors of position [m] and rotation [rad] at which the iteration stops.
_TOLERANCE = np.array([1e-9, 1e-9])
# Weight of a rotation error. For targets that the leg cannot reach, it is so large that the foot stays nearly flat.
_METRES_PER_RADIAN = 3.0
_LARGEST_ERROR = 1e-4  # a target with a larger error of a coordinate is out of reach [m or rad]


class OutOfReach(SimrobError):
    """Raised when a leg cannot bring its foot to a pose, or only beyond a limit of a joint."""


def leg_angles(
    model: RobotModel,
    foot: Foot,
    target: Vector,
    root: Vector,
    start: Vector,
    times: Vector | None = None,
) -> Vector:
    """Compute the angles of one leg for m poses of its foot.

    Args:
        model: the robot.
        foot: the foot, with the leg that carries it.
        target: desired poses of the foot's point, the middle of its contact, shape (m, 4, 4); with an identity rotation
            the foot is flat and looks ahead. They are in any frame, such as the world.
        root: poses of the robot's root link in the same frame, shape (m, 4, 4).
        start: angles of all n axes from which the search begins, shape (m, n) [rad].
        times: times of the poses, shape (m,) [s], for messages. If it is None, their indices are used.

    Returns:
        the angles `start` with those of the leg's axes replaced, shape (m, n) [rad].

    Raises:
        OutOfReach: the leg is too short for a pose, or a joint is beyond a limit; the message has the time and the
            excess.
        InvalidParameter: the leg has neither three, four nor six joints.
    """
    axes = list(foot.axes)  # indices of the leg's axes
    if len(axes) not in ROWS:
        raise InvalidParameter(
            message("programs.leg_of", "count of joints in the leg of {foot}", foot=foot.name),
            len(axes),
            message("programs.joints_of_leg", "three, four or six"),
        )
    rows = ROWS[len(axes)]
    # Weights of squared errors. A coordinate that the leg cannot reach has the weight 0: its error does not count.
    weights = np.zeros(6)
    weights[rows] = [1.0 if row < _POSITION_ROWS else _METRES_PER_RADIAN**2 for row in rows]
    fit = fit_postures(
        foot.leg,
        target,
        start[:, axes],
        weights=weights,
        tolerance=_TOLERANCE,
        iterations=_MOST_ITERATIONS,
        base=root,
    )
    angles = start.copy()
    angles[:, axes] = fit.postures
    message_times = np.arange(len(angles), dtype=float) if times is None else times
    # Only coordinates that such a leg can reach count. The message has the largest error of the position.
    if np.abs(fit.errors[:, rows]).max() > _LARGEST_ERROR:
        position_rows = [row for row in rows if row < _POSITION_ROWS]
        distances = np.linalg.norm(fit.errors[:, position_rows], axis=1)
        worst = int(distances.argmax())
        distance = _two_digits(1e3 * distances[worst])
        raise OutOfReach(
            message(
                "programs.leg_out_of_reach",
                "the leg of {foot} is {distance} mm too short at {time:.2f} s; take shorter or lower steps, or lower "
                "the hips",
                foot=foot.name,
                distance=distance,
                time=message_times[worst],
            )
        )
    _check_limits(model, foot, angles, message_times)
    return angles


def _two_digits(value: float) -> str:
    """Write a positive number with two significant digits, or as an integer from 10 on: 0.123 is 0.12, 123.4 is 123."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _check_limits(model: RobotModel, foot: Foot, angles: Vector, times: Vector) -> None:
    """Check that every joint of a leg stays within its limits.

    Args:
        model: the robot.
        foot: the foot, with the axes of its leg.
        angles: angles of all n axes of the robot in m postures, shape (m, n) [rad].
        times: times of the postures for the message, shape (m,) [s].

    Raises:
        OutOfReach: a joint is beyond a limit; the message has the time at which it is furthest beyond. Of several such
            joints the first one of the leg is named.
    """
    excess = model.limits.excess(angles)
    for axis in foot.axes:
        row = int(excess[:, axis].argmax())
        worst_angle = angles[row : row + 1, [axis]]  # shape (1, 1)
        violation = model.limits.of_axes([axis]).find_violation(worst_angle)
        if violation is not None:
            name = list(model.axes)[axis]
            raise OutOfReach(
                message(
                    "programs.axis_beyond_limits",
                    "{name} would need {position} deg at {time:.2f} s, {excess} deg beyond its limits of {limits}",
                    name=name,
                    position=violation.value,
                    time=times[row],
                    excess=violation.excess,
                    limits=violation.limits,
                )
            )
