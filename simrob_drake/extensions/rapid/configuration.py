"""Which of its postures an arm takes for a pose, as RAPID's ``confdata`` tells: quadrants of axes, and the sides."""

from collections.abc import Sequence

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.every_branch import branches

_SIX = 6
_QUADRANTS = (0, 3, 5)  # axes 1, 4 and 6
_BORDER = 1e-4  # quadrants that an axis may lie beyond a border, or that a pose was rounded by
_COMPLIANT = (
    1.5  # quadrants from the middle of the one that is asked for: its neighbours count, too
)


def has_configuration(chain: Chain) -> bool:
    """Tell whether confdata means something for an arm: six turning axes, the last three through one point."""
    if chain.size != _SIX or not chain.revolute.all() or len(chain.order) != _SIX:
        return False
    centre = _wrist(chain)
    offsets = np.cross(centre - chain.points[3:], chain.axes[3:])
    return bool(np.abs(offsets).max() < 1e-6)  # m


def configuration(chain: Chain, posture: Vector) -> tuple[int, int, int, int]:
    """Return the confdata cf1, cf4, cf6 and cfx of a posture (6,) [rad]."""
    first, fourth, sixth = (
        int(np.floor(posture[axis] / (np.pi / 2) + _BORDER)) for axis in _QUADRANTS
    )
    return first, fourth, sixth, _sides(chain, posture)


def _sides(chain: Chain, posture: Vector) -> int:
    """Return cfx: 4 if the wrist is behind axis 1, 2 if it is behind the lower arm, 1 if axis 5 is negative; summed."""
    behind = np.sign(_leans(chain, posture)) != np.sign(_leans(chain, np.zeros(_SIX)))
    return int(4 * behind[0] + 2 * behind[1] + (posture[4] < 0))


def _leans(chain: Chain, posture: Vector) -> tuple[float, float]:
    """Return how far the wrist is before axis 1, and before the line through axes 2 and 3, as signed measures."""
    frames = chain.frames(posture[np.newaxis])[:, 0]
    second, third = chain.points[1], _foot(chain, 2)
    shoulder, elbow, wrist = (
        (frames[index] @ np.append(point, 1.0))[:3]
        for index, point in ((1, second), (2, third), (4, _wrist(chain)))
    )
    column, across = chain.axes[0], frames[1, :3, :3] @ chain.axes[1]
    forward = np.cross(across, column)
    ahead = (wrist - chain.points[0]) @ forward
    return float(ahead), float(np.cross(elbow - shoulder, wrist - shoulder) @ across)


def _foot(chain: Chain, axis: int) -> Vector:
    """Return the point of an axis that is nearest to that of axis 2, all at zero posture."""
    way = chain.points[1] - chain.points[axis]
    along = chain.axes[axis]
    return np.asarray(chain.points[axis] + (way @ along) * along)


def _wrist(chain: Chain) -> Vector:
    """Return where axes 4 and 5 meet, or come nearest, at zero posture, on axis 5."""
    one, other = chain.axes[3], chain.axes[4]
    way, cosine = chain.points[3] - chain.points[4], one @ other
    along = (way @ other - (way @ one) * cosine) / max(1.0 - cosine**2, 1e-12)
    return np.asarray(chain.points[4] + along * other)


def postures_like(
    chain: Chain, pose: Vector, start: Vector, desired: Sequence[float]
) -> tuple[Vector, list[str]]:
    """Return the postures (k, 6) for a pose (4, 4) that have a configuration, and the configurations of the others.

    The best is first; as for ABB's controllers a quadrant may differ by one, but cfx must be equal
    (ABB.Robotics.RobotStudio.Stations, ConfigurationMode: Compliant). Whole turns of axes are made where the quadrants
    ask for them and the limits allow.
    """
    *quadrants, cfx = (int(value) for value in desired)
    fit, others = [], []
    for posture in branches(chain, pose[np.newaxis], start)[0]:
        turned = posture.copy()
        middles, axes = (np.array(quadrants) + 0.5) * np.pi / 2, list(_QUADRANTS)
        turned[axes] += 2 * np.pi * np.round((middles - turned[axes]) / (2 * np.pi))
        away = np.abs(turned[axes] - middles).max() / (np.pi / 2)
        allowed = chain.limits.are_within(turned)
        if away <= _COMPLIANT + _BORDER and allowed and _sides(chain, turned) == cfx:
            fit.append((away, *np.clip(turned, chain.lower, chain.upper)))
        elif chain.limits.are_within(posture):
            others.append(str(list(configuration(chain, posture))))
    return np.reshape(sorted(fit), (-1, 1 + _SIX))[:, 1:], others
