"""Areas inside outlines: their integrals, and triangles that fill them."""

from collections.abc import Callable

import numpy as np

from simrob_drake.frames import Vector

_A, _B = 0.445948490915965, 0.091576213509771
_WEIGHT_A, _WEIGHT_B = 0.223381589678011, 0.109951743655322
_POINTS = np.array(
    [
        [_A, _A, 1 - 2 * _A],
        [_A, 1 - 2 * _A, _A],
        [1 - 2 * _A, _A, _A],
        [_B, _B, 1 - 2 * _B],
        [_B, 1 - 2 * _B, _B],
        [1 - 2 * _B, _B, _B],
    ]
)
_WEIGHTS = np.array([_WEIGHT_A] * 3 + [_WEIGHT_B] * 3)
"""Quadrature over a triangle that is exact to degree four (Dunavant 1985)."""


def integral(outline: Vector, function: Callable[[Vector, Vector], Vector]) -> float:
    """Return the integral of a polynomial of degree at most four over the area inside an outline.

    Args:
        outline: corners in order, shape (n, 2) [m]; counterclockwise counts as positive.
        function: of x and y.
    """
    following = np.roll(outline, -1, axis=0)
    doubled = outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]
    corners = np.stack([np.zeros_like(outline), outline, following], axis=1)  # triangles from the origin, signed
    points = np.einsum("qc,tcd->tqd", _POINTS, corners)
    values = function(points[..., 0], points[..., 1])
    return float((doubled / 2) @ (values @ _WEIGHTS))


def area(outline: Vector) -> float:
    """Return the area inside an outline [m²]; negative if its corners run clockwise."""
    return integral(outline, lambda x, y: np.ones_like(x))


def triangles(outline: Vector) -> Vector:
    """Return triangles that fill an outline, as indices of its corners, shape (m, 3).

    For pictures: an outline that a Delaunay net does not follow is filled roughly.
    """
    from scipy.spatial import Delaunay, QhullError

    try:
        net = Delaunay(outline).simplices
    except (QhullError, ValueError):
        return np.zeros((0, 3), dtype=int)
    middles = outline[net].mean(axis=1)
    return np.asarray(net[_inside(outline, middles)])


def _inside(outline: Vector, points: Vector) -> Vector:
    """Tell which points lie inside an outline, by how often a ray to the right crosses it."""
    start, stop = outline, np.roll(outline, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    between = (start[:, 1] > y) != (stop[:, 1] > y)
    rise = stop[:, 1] - start[:, 1]
    crossing = start[:, 0] + (y - start[:, 1]) * (stop[:, 0] - start[:, 0]) / np.where(rise == 0, 1.0, rise)
    return np.asarray((between & (x < crossing)).sum(axis=1) % 2 == 1)
