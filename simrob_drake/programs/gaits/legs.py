"""Angles of a leg that put its foot where it shall be, for many postures at once.

What a leg is asked for depends on its joints: six keep the foot's place and rotation; four (a humanoid without ankle
roll and hip yaw) keep it ahead, at height and flat, and it goes sideways with the trunk; three (a quadruped) keep the
place.
"""

import numpy as np

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.kinematics.numeric import fit_postures
from simrob_drake.programs.gaits.walker import Foot
from simrob_drake.robots.catalog import RobotModel

ROWS = {6: [0, 1, 2, 3, 4, 5], 4: [0, 2, 3, 4], 3: [0, 1, 2]}
"""Which of [ahead, left, up, roll, pitch, yaw] a leg of so many joints is asked for."""

_STEPS = 300  # most of the search
_CLOSE = np.array([1e-9, 1e-9])  # when it stops [m, rad]
_FLATNESS = 3.0  # metres that a radian counts for where a foot cannot get to its place
_WRONG = 1e-4  # what counts as out of reach [m, rad]


class OutOfReach(SimrobError):
    """A leg that cannot get where its foot shall be."""


def leg_angles(
    model: RobotModel, foot: Foot, target: Vector, root: Vector, start: Vector, times: Vector | None = None
) -> Vector:
    """Return the robot's angles (m, n) [rad] with those of one leg solved.

    The poses of the foot's point, turned from flat and ahead, and of the root are (m, 4, 4); ``start`` are the angles
    of all axes to begin with (m, n) [rad]; the times (m,) [s] are for messages. Raises OutOfReach: names the leg, by
    how much it is too short, and when; InvalidParameter: a leg that has neither three, four nor six joints.
    """
    axes = list(foot.axes)
    if len(axes) not in ROWS:
        raise InvalidParameter(f"leg of {foot.name}", f"{len(axes)} joints", "three, four or six joints")
    rows = ROWS[len(axes)]
    weights = np.zeros(6)
    weights[rows] = [1.0 if row < 3 else _FLATNESS**2 for row in rows]
    fit = fit_postures(
        foot.leg, target, start[:, axes], weights=weights, tolerance=_CLOSE, iterations=_STEPS, base=root
    )
    angles = start.copy()
    angles[:, axes] = fit.postures
    when = np.arange(len(angles), dtype=float) if times is None else times
    if np.abs(fit.errors[:, rows]).max() > _WRONG:
        short = np.linalg.norm(fit.errors[:, [row for row in rows if row < 3]], axis=1)
        worst = int(short.argmax())
        raise OutOfReach(
            f"the leg of {foot.name} is out of reach by {_digits(1e3 * short[worst])} mm at {when[worst]:.2f} s;"
            " take shorter or lower steps, or let the hips come down"
        )
    _check_limits(model, foot, angles, when)
    return angles


def _digits(value: float) -> str:
    """Return a number that is never shown as zero: at least two digits that count."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _check_limits(model: RobotModel, foot: Foot, angles: Vector, when: Vector) -> None:
    """Check that every joint of a leg stays within its limits in postures (m, n) [rad] at times (m,) [s].

    Raises:
        OutOfReach: a joint is beyond a limit; the message names the posture that is furthest beyond.
    """
    excess = model.limits.excess(angles)
    for axis in foot.axes:
        row = int(excess[:, axis].argmax())
        violation = model.limits.of_axes([axis]).find_violation(angles[row : row + 1, [axis]])
        if violation is not None:
            name = list(model.axes)[axis]
            raise OutOfReach(
                f"{name} would need {violation.value} deg at {when[row]:.2f} s, {violation.excess} deg beyond its"
                f" limits of {violation.limits}"
            )
