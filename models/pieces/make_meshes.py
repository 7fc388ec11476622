"""Make the meshes of all pieces: ``python models/pieces/make_meshes.py``.

Sizes and origins are those of the meshes of the SimRob library, for which the pieces stand; shapes are our own, and so
are the places of the holes. Lengths are in metres.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from chess import FIGURES
from solids import (
    Array,
    Solid,
    block,
    circle,
    curve,
    lathe,
    pierced,
    prism,
    rounded_cube,
    sheet,
    together,
    write_obj,
)

SQUARE = 0.05  # of the chess board
SHELL = 0.006  # thickness of sphere and cylinder
HOLE = 0.0155  # radius: the collar of the pencil's holder has 14 mm
SPHERE_RADIUS = 0.15
CYLINDER_RADIUS, CYLINDER_HALF_LENGTH = 0.125, 0.15
CELL_STEPS = 6  # edges along each side of the cell of a hole


def pencil_point() -> Solid:
    """Return a cone of the pencil's wood, on the x-y plane."""
    return lathe([(0, 0), (0.006, 0), (0, 0.024)], 32)


def die(side: float) -> dict[str, Solid]:
    """Return a cube on the x-y plane, and its pips as thin discs; opposite faces add up to seven."""
    half, third = side / 2, side / 4
    spots = {1: [(0, 0)], 2: [(-1, -1), (1, 1)], 4: [(x, y) for x in (-1, 1) for y in (-1, 1)]}
    spots |= {3: spots[1] + spots[2], 5: spots[1] + spots[4], 6: [*spots[4], (-1, 0), (1, 0)]}
    ups = {1: (0, 0, 1), 6: (0, 0, -1), 2: (1, 0, 0), 5: (-1, 0, 0), 3: (0, 1, 0), 4: (0, -1, 0)}
    disc = lathe(
        [
            (0, -0.01 * side),
            (0.085 * side, -0.01 * side),
            (0.085 * side, 0.001 * side),
            (0, 0.001 * side),
        ],
        14,
    )
    pips = []
    for number, up in ups.items():
        side_axis = np.roll(up, 1)
        turn = np.stack([side_axis, np.cross(up, side_axis), up], axis=1)
        pips += [
            disc.moved((third * x, third * y, half)).moved(turn=turn) for x, y in spots[number]
        ]
    up_half = (0, 0, half)
    return {
        "body": rounded_cube(side, side / 9).moved(up_half),
        "pips": together(pips).moved(up_half),
    }


def squares(colour: int) -> Solid:
    """Return the dark (0) or light (1) squares of the chess board."""
    places = [(i, j) for i in range(8) for j in range(8) if (i + j) % 2 == colour]
    corners = [np.array([i, j, 0.0]) * SQUARE for i, j in places]
    return together([block(corner, np.add(corner, (SQUARE, SQUARE, 0.002))) for corner in corners])


def table(upper: float, lower: float) -> Solid:
    """Return a layer of the inclined table, between two depths under its surface [m].

    The table is a wedge of 15 degrees with a right angle at its upper edge, 0.1 m high and 0.5 m wide.
    """
    slope, yaw = np.radians(15.0), np.radians(-120.0)
    # the floor meets a layer at start times its depth
    reach, start = (
        0.1 / np.sin(slope),
        1 / np.tan(slope),
    )
    section = np.array(
        [(start * lower, -lower), (reach, -lower), (reach, -upper), (start * upper, -upper)]
    )
    solid = prism(
        section @ [[np.cos(slope), np.sin(slope)], [-np.sin(slope), np.cos(slope)]], 0.0, 0.5
    )
    return Solid(solid.points[:, [2, 0, 1]], solid.faces).moved((0.4, 0.133, 0.0), about_z(yaw))


def about_z(turn: float) -> Array:
    """Return the matrix of a rotation about z [rad]."""
    return np.array(
        [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    )


def about_y(turn: float) -> Array:
    """Return the matrix of a rotation about y [rad]."""
    return np.array(
        [[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]]
    )


def around(low: tuple[float, float], high: tuple[float, float]) -> Array:
    """Walk counterclockwise round a rectangle, CELL_STEPS steps a side; shape (4 CELL_STEPS, 2)."""
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    part = np.arange(CELL_STEPS)[:, None] / CELL_STEPS
    return np.concatenate([a + part * (b - a) for a, b in pairwise(corners)])


def cell(outer: Array, inner: Array, surface: Callable[[Array, float], Array]) -> Solid:
    """Return both faces of a shell around a hole along z, and the hole's wall.

    Args:
        outer: rim of the outer face, in the plane across the hole, shape (n, 2) [m].
        inner: rim of the inner face, likewise.
        surface: heights of points of that plane on the outer face (depth 0) or the inner face (depth SHELL).
    """
    outside = pierced(outer, HOLE, lambda flat: surface(flat, 0.0), 2)[::-1]
    return sheet(
        np.concatenate([outside, pierced(inner, HOLE, lambda flat: surface(flat, SHELL), 1)])
    )


def half_sphere() -> Solid:
    """Return a dome with a hole at the top and eight each at 30 and 60 degrees from it."""

    def surface(flat: Array, depth: float) -> Array:
        return np.asarray(np.sqrt((SPHERE_RADIUS - depth) ** 2 - (flat**2).sum(axis=1)))

    def on_sphere(tilt: Array, turn: Array) -> Array:
        return np.stack(
            [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1
        )

    inner = SPHERE_RADIUS - SHELL
    edge = on_sphere(
        np.full(8 * CELL_STEPS, np.radians(15.0)),
        2 * np.pi * np.arange(8 * CELL_STEPS) / 8 / CELL_STEPS,
    )
    parts = [cell(SPHERE_RADIUS * edge[:, :2], inner * edge[:, :2], surface)]
    for tilt in np.radians((30.0, 60.0)):
        corner = np.radians((15.0, 22.5))
        rim = on_sphere(*np.add(around(tuple(-corner), tuple(corner)), (tilt, 0.0)).T) @ about_y(
            tilt
        )
        dome = cell(SPHERE_RADIUS * rim[:, :2], inner * rim[:, :2], surface)
        parts += [
            dome.moved(turn=about_z(turn) @ about_y(tilt))
            for turn in np.radians(45.0 * np.arange(8))
        ]
    tilts = np.radians((75.0, 82.5, 90.0))
    profile = [(inner, t) for t in tilts] + [(SPHERE_RADIUS, t) for t in tilts[::-1]]
    parts.append(
        sheet(np.array([circle(r * np.sin(t), 8 * CELL_STEPS, r * np.cos(t)) for r, t in profile]))
    )
    return together(parts)


def cylinder() -> Solid:
    """Return a tube along z with three rows of eight holes."""

    def surface(flat: Array, depth: float) -> Array:
        return np.asarray(np.sqrt((CYLINDER_RADIUS - depth) ** 2 - flat[:, 1] ** 2))

    corner = np.array([0.045, np.radians(22.5)])
    rim = around(tuple(-corner), tuple(corner))
    rims = [
        np.stack([rim[:, 0], radius * np.sin(rim[:, 1])], axis=1)
        for radius in (CYLINDER_RADIUS, CYLINDER_RADIUS - SHELL)
    ]
    wall = cell(rims[0], rims[1], surface).moved(turn=about_y(np.pi / 2))
    turns = np.radians(45.0 * np.arange(8))
    parts = [
        wall.moved((0, 0, height), about_z(turn)) for turn in turns for height in (-0.09, 0.0, 0.09)
    ]
    radii = CYLINDER_RADIUS - SHELL, CYLINDER_RADIUS
    for inside, outside in (((0.135, 0.15), 1), ((-0.135, -0.15), -1)):
        profile = [
            (radii[0], inside[0]),
            (radii[0], inside[1]),
            (radii[1], inside[1]),
            (radii[1], inside[0]),
        ]
        rings = [circle(radius, 8 * CELL_STEPS, height) for radius, height in profile]
        parts.append(sheet(np.array(rings[::-outside])))
    return together(parts)


def holder_top() -> Solid:
    """Return the pencil holder's top: a plate with two rows of six holes."""
    size, low, high = np.array([0.082, 0.09]), 0.134, 0.144
    rim = around(tuple(-size / 2), tuple(size / 2))
    faces = [pierced(rim, HOLE, lambda flat, z=z: np.full(len(flat), z), 1) for z in (high, low)]
    hole = sheet(np.concatenate([faces[0][::-1], faces[1]]))
    centres = [(x * size[0], y * size[1], 0.0) for x in np.arange(6) - 2.5 for y in (-0.5, 0.5)]
    corners = size * (6, 2) / 2
    part = [np.arange(count * CELL_STEPS) / CELL_STEPS / count for count in (6, 2, 6, 2)]
    walk = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * corners
    edge = np.concatenate(
        [a + t[:, None] * (b - a) for a, b, t in zip(walk, walk[1:], part, strict=False)]
    )
    side = sheet(np.array([np.column_stack([edge, np.full(len(edge), z)]) for z in (low, high)]))
    return together([*(hole.moved(centre) for centre in centres), side])


def bottle() -> dict[str, Solid]:
    """Return a bottle along y, its label and its cap."""
    body = [(0, 0.004), (0.030, 0), (0.0395, 0.001), (0.0433, 0.006), (0.0433, 0.17)]
    body += curve(
        [(0.0433, 0.17), (0.0405, 0.196), (0.029, 0.222), (0.0175, 0.243), (0.0142, 0.262)], 5
    )
    body += [(0.0162, 0.263), (0.0162, 0.267), (0.013, 0.268), (0, 0.268)]
    label = [(0.0425, 0.05), (0.0435, 0.0502), (0.0435, 0.13), (0.0425, 0.1302), (0.0425, 0.05)]
    cap = [
        (0, 0.2665),
        (0.0148, 0.2665),
        (0.0155, 0.268),
        (0.0155, 0.2945),
        (0.0142, 0.2958),
        (0, 0.2958),
    ]
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    rings = {"body": body, "label": label, "cap": cap}
    return {
        key: lathe(profile, 40).moved((0.046, 0.0198, 0.0452), upright)
        for key, profile in rings.items()
    }


def suction_cup() -> Solid:
    """Return bellows of rubber under a fitting."""
    folds = [(0, 0.014), (0.012, 0.014), (0.0125, 0.0185)]
    for height in (0.0205, 0.0265, 0.0325):
        folds += [
            (0.0245, height),
            (0.0262, height + 0.0012),
            (0.0245, height + 0.0024),
            (0.0195, height + 0.0042),
        ]
    lip = [(0.0295, 0.0412), (0.0308, 0.0426), (0.0288, 0.0426), (0.0185, 0.0385), (0, 0.0385)]
    return lathe([*folds, *lip], 40)


def meshes() -> dict[str, dict[str, Solid]]:
    """Return all meshes, by folder and file."""
    return {
        **{figure.__name__: {"figure": figure()} for figure in FIGURES},
        "bottle": bottle(),
        "chess_board": {"dark": squares(0), "light": squares(1)},
        "cylinder": {"shell": cylinder()},
        "die": die(0.056),
        "half_die": die(0.028),
        "half_sphere": {"shell": half_sphere()},
        "inclined_table": {
            "body": table(0.0015, 0.4 * float(np.sin(np.radians(15.0)))),
            "sheet": table(0.0, 0.0015),
        },
        "pencil": {"point": pencil_point()},
        "pencil_holder": {"top": holder_top()},
        "vacuum_cup": {"cup": suction_cup()},
    }


def main() -> None:
    """Write the meshes into the folders of their pieces, beside this script or in another folder."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for piece, solids in meshes().items():
        (folder / piece).mkdir(parents=True, exist_ok=True)
        for name, solid in solids.items():
            write_obj(folder / piece / f"{name}.obj", solid)


if __name__ == "__main__":
    main()
