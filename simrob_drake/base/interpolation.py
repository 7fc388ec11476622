"""Between poses: straight lines, arcs through two points, turns about one axis, whole poses.

Every function takes the part of the way, 0 at the start and 1 at the end, as a number or as an array of k of them.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import PoseLike, Vector, as_transform, point
from simrob_drake.base.messages import message

_STRAIGHT = 1e-6  # sine of the angle between two chords below which three points count as collinear
_APART = 1e-6  # points of an arc nearer to each other count as one [m]


def line(start: npt.ArrayLike, end: npt.ArrayLike, part: npt.ArrayLike) -> Vector:
    """Return the points (k, 3) [m] at the parts (k,) of the straight line between two points (3,)."""
    first, last = point(start, "start"), point(end, "end")
    return first + np.atleast_1d(np.asarray(part, dtype=float))[:, np.newaxis] * (last - first)


def turn(start: npt.ArrayLike, end: npt.ArrayLike, part: npt.ArrayLike) -> Vector:
    """Return rotation matrices (k, 3, 3) between two of them (3, 3): at even speed about one fixed axis (slerp)."""
    first = Rotation.from_matrix(np.asarray(start, dtype=float))
    way = (first.inv() * Rotation.from_matrix(np.asarray(end, dtype=float))).as_rotvec()
    parts = np.atleast_1d(np.asarray(part, dtype=float))
    return np.asarray((first * Rotation.from_rotvec(np.outer(parts, way))).as_matrix())


def turned_by(start: npt.ArrayLike, end: npt.ArrayLike) -> float:
    """Return the angle between two rotation matrices (3, 3) [rad]."""
    between = np.asarray(start, dtype=float).T @ np.asarray(end, dtype=float)
    return float(Rotation.from_matrix(between).magnitude())


def poses(start: PoseLike, end: PoseLike, part: npt.ArrayLike) -> Vector:
    """Return the poses (k, 4, 4) between two: straight in position, about one axis in orientation."""
    first, last = as_transform(start), as_transform(end)
    places = line(first.translation(), last.translation(), part)
    return stacked(places, turn(first.rotation().matrix(), last.rotation().matrix(), part))


def stacked(places: Vector, turns: Vector) -> Vector:
    """Put points (k, 3) and rotation matrices (k, 3, 3) together into homogeneous matrices (k, 4, 4)."""
    matrices = np.zeros((len(places), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = turns, places, 1.0
    return matrices


@dataclass(frozen=True)
class Arc:
    """A part of a circle, from a first point through a second one to a third."""

    centre: Vector  # of the circle, shape (3,) [m]
    first: Vector  # from the centre to the first point, shape (3,) [m]
    across: Vector  # at a right angle to it in the plane of the circle, towards the motion, as long, shape (3,) [m]
    angle: float  # of the whole arc, more than 0 and less than 2π [rad]

    @classmethod
    def through(
        cls,
        start: npt.ArrayLike,
        middle: npt.ArrayLike,
        end: npt.ArrayLike,
        name: str = message("base.the_arc", "the arc"),
    ) -> "Arc":
        """Return the arc through three points (3,) [m]; raises InvalidParameter, with ``name``: on one line."""
        a, b, c = point(start, "start"), point(middle, "middle"), point(end, "end")
        to_b, to_c = b - a, c - a
        normal = np.cross(to_b, to_c)
        sides = [float(np.linalg.norm(side)) for side in (to_b, to_c, c - b)]
        if min(sides) < _APART or np.linalg.norm(normal) < _STRAIGHT * sides[0] * sides[1]:
            found = ", ".join("[" + ", ".join(f"{value:.4g}" for value in place) + "]" for place in (a, b, c))
            expected = message(
                "base.three_points_off_a_line",
                "through three points that are not on one line, unlike {found} m",
                found=found,
            )
            raise InvalidParameter(name, "straight", expected)
        first = np.cross((to_c @ to_c) * to_b - (to_b @ to_b) * to_c, normal) / (2 * normal @ normal)
        centre, axis = a - first, normal / np.linalg.norm(normal)
        across = np.cross(axis, first)
        last = c - centre
        angle = np.arctan2(last @ across, last @ first) % (2 * np.pi)
        return cls(centre, first, across, float(angle))

    @property
    def radius(self) -> float:
        """Of the circle [m]."""
        return float(np.linalg.norm(self.first))

    @property
    def length(self) -> float:
        """Of the arc [m]."""
        return self.radius * self.angle

    def points(self, part: npt.ArrayLike) -> Vector:
        """Return the points (k, 3) [m] at the parts (k,) of the arc."""
        angles = self.angle * np.atleast_1d(np.asarray(part, dtype=float))[:, np.newaxis]
        return self.centre + np.cos(angles) * self.first + np.sin(angles) * self.across
