"""Interpolation between points, orientations and poses: lines, arcs, and rotations about one axis.

Every function takes the *part* of the motion at which it is evaluated, 0 at the start and 1 at the end, as a number or
as an array of k numbers. Results have k rows in both cases.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import PoseLike, Vector, as_transform, point
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of

_STRAIGHT = 1e-6
"""Sine of the angle between two chords below which three points count as collinear."""

_APART = 1e-6
"""Points of an arc that are closer together than this count as equal [m]."""


def line(start: npt.ArrayLike, end: npt.ArrayLike, part: npt.ArrayLike) -> Vector:
    """Points on the straight line between two points.

    Args:
        start: first point, shape (3,) [m].
        end: last point, shape (3,) [m].
        part: parts of the line, shape (k,).

    Returns:
        the points, shape (k, 3) [m].

    Raises:
        InvalidParameter: a point is not three finite numbers.
    """
    first = point(start, "start")
    last = point(end, "end")
    parts = _parts(part)
    # Keep this form: the result at the part 0 is exactly the start.
    return first + parts[:, np.newaxis] * (last - first)


def turn(start: npt.ArrayLike, end: npt.ArrayLike, part: npt.ArrayLike) -> Vector:
    """Rotation matrices between two orientations: a rotation about one fixed axis at constant speed (slerp).

    Args:
        start: first rotation matrix, shape (3, 3).
        end: last rotation matrix, shape (3, 3).
        part: parts of the rotation, shape (k,).

    Returns:
        the rotation matrices, shape (k, 3, 3).
    """
    first = Rotation.from_matrix(np.asarray(start, dtype=float))
    last = Rotation.from_matrix(np.asarray(end, dtype=float))
    # Rotation vector of the whole rotation, in the axes of the first orientation [rad].
    whole = (first.inv() * last).as_rotvec()
    rotations = first * Rotation.from_rotvec(np.outer(_parts(part), whole))
    return np.asarray(rotations.as_matrix())


def _parts(part: npt.ArrayLike) -> Vector:
    """Convert a number or an array to an array of parts, shape (k,)."""
    return np.atleast_1d(np.asarray(part, dtype=float))


def turned_by(start: npt.ArrayLike, end: npt.ArrayLike) -> float:
    """Angle between two rotation matrices (3, 3) [rad]."""
    between = np.asarray(start, dtype=float).T @ np.asarray(end, dtype=float)
    return float(Rotation.from_matrix(between).magnitude())


def poses(start: PoseLike, end: PoseLike, part: npt.ArrayLike) -> Vector:
    """Poses between two poses: on a straight line in position, about one axis in orientation.

    Args:
        start: first pose.
        end: last pose.
        part: parts of the motion, shape (k,).

    Returns:
        the poses, shape (k, 4, 4).
    """
    first = as_transform(start)
    last = as_transform(end)
    positions = line(first.translation(), last.translation(), part)
    return stack_poses(positions, turn(first.rotation().matrix(), last.rotation().matrix(), part))


def stack_poses(places: Vector, turns: Vector) -> Vector:
    """Combine positions (k, 3) and rotation matrices (k, 3, 3) to homogeneous matrices (k, 4, 4)."""
    matrices = np.zeros((len(places), 4, 4))
    matrices[:, :3, :3] = turns
    matrices[:, :3, 3] = places
    matrices[:, 3, 3] = 1.0
    return matrices


@dataclass(frozen=True)
class Arc:
    r"""Arc of a circle. Its point at the angle :math:`\varphi` is :math:`c + a \cos\varphi + b \sin\varphi`.

    Attributes:
        centre: centre c of the circle, shape (3,) [m].
        first: vector a from the centre to the first point, shape (3,) [m].
        across: vector b in the plane of the circle, at a right angle to a, as long as a, in the direction of the
            motion, shape (3,) [m].
        angle: angle of the whole arc, more than 0 and less than 2 pi [rad].
    """

    centre: Vector
    first: Vector
    across: Vector
    angle: float

    @classmethod
    def through(
        cls,
        start: npt.ArrayLike,
        middle: npt.ArrayLike,
        end: npt.ArrayLike,
        name: str = message("base.the_arc", "the arc"),
    ) -> "Arc":
        r"""Compute the arc through three points.

        With the points p, q and r, let :math:`u = q - p`, :math:`v = r - p` and :math:`n = u \times v`. The centre is

        .. math:: c = p - a, \quad a = \frac{(|v|^2 u - |u|^2 v) \times n}{2 |n|^2}.

        Args:
            start: first point p, shape (3,) [m].
            middle: a point q between the others, shape (3,) [m].
            end: last point r, shape (3,) [m].
            name: name of the arc, for the error.

        Raises:
            InvalidParameter: a point is not three finite numbers, the points are collinear, or two of them are equal.
        """
        p = point(start, "start")
        q = point(middle, "middle")
        r = point(end, "end")
        u = q - p
        v = r - p
        # The normal of the plane through the three points. It vanishes if they are collinear.
        normal = np.cross(u, v)
        sides = [float(np.linalg.norm(side)) for side in (u, v, r - q)]
        # |n| = |u| |v| sin(angle)
        is_straight = bool(np.linalg.norm(normal) < _STRAIGHT * sides[0] * sides[1])
        # Equal points have no direction, so their sine alone would not show that they are collinear.
        if min(sides) < _APART or is_straight:
            points = ", ".join(_short_point(place) for place in (p, q, r))
            expected = message(
                "base.three_points_off_a_line",
                "through three points that are not collinear, unlike {found} m",
                found=points,
            )
            raise InvalidParameter(name, "straight", expected)
        # The equations of the docstring; `first` is their vector a.
        first = np.cross((v @ v) * u - (u @ u) * v, normal) / (2 * normal @ normal)
        centre = p - first
        axis = normal / np.linalg.norm(normal)
        # The axis is a unit vector at a right angle to a, so b is as long as a.
        across = np.cross(axis, first)
        # Angle of the last point in the basis (a, b), from 0 to 2 pi: the arc may be longer than half a circle.
        last = r - centre
        angle = np.arctan2(last @ across, last @ first) % (2 * np.pi)
        return cls(centre, first, across, float(angle))

    @property
    def radius(self) -> float:
        """Radius of the circle [m]."""
        return float(np.linalg.norm(self.first))

    @property
    def length(self) -> float:
        """Length of the arc [m]."""
        return self.radius * self.angle

    def points(self, part: npt.ArrayLike) -> Vector:
        """Points of the arc (k, 3) [m] at parts (k,) of it."""
        angles = self.angle * _parts(part)[:, np.newaxis]
        # One row for each angle: the angles are a column, and the vectors are rows.
        return self.centre + np.cos(angles) * self.first + np.sin(angles) * self.across


def _short_point(place: Vector) -> str:
    """Format a point with four significant digits, such as ``[0.1, 0, 1.25]``."""
    return "[" + ", ".join(f"{value:.4g}" for value in place) + "]"


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"stacked": "stack_poses"})
