"""Make the meshes of the IRB 120's visuals: ``python models/irb120/make_meshes.py``.

Every link is a few closed solids that run into each other: plates with rounded edges, lofts and convex hulls of
spheres. Dimensions are in metres in the link frames of ``irb120.urdf``; one file holds the parts of one colour.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

Array = npt.NDArray[np.float64]
Part = trimesh.Trimesh

CREASE = np.cos(np.radians(38.0))  # faces that meet at a sharper edge than this are shaded apart
FILLET = np.radians(np.linspace(0.0, 90.0, 4))
SPHERE: Array = np.asarray(trimesh.creation.icosphere(subdivisions=2).vertices, dtype=float)


def skin(rings: Array) -> Part:
    """Close a stack of rings, shape (m, n, 3), whose first and last ring are collapsed, into a solid."""
    count, size = rings.shape[:2]
    index = np.arange(count * size).reshape(count, size)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    solid = trimesh.Trimesh(rings.reshape(-1, 3), faces)
    solid.update_faces(solid.nondegenerate_faces())
    if solid.volume < 0:
        solid.invert()
    return solid


def arc(
    radius: float, degrees: tuple[float, float], count: int, at: npt.ArrayLike = (0.0, 0.0)
) -> Array:
    """Put points on a circular arc around a centre, shape (count, 2)."""
    turn = np.radians(np.linspace(*degrees, count))
    return np.asarray(at, dtype=float) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def plate(
    shape: tuple[Array, Array],
    span: tuple[float, float | Array],
    fillets: tuple[float, float],
    axes: str,
) -> Part:
    """Extrude an outline between two heights and round both edges.

    Args:
        shape: closed curve in the plane of the first two axes, and for each of its points the point inside towards
            which it shrinks [m], both of shape (n, 2).
        span: height of the lower and of the upper face [m]; the upper one may differ from point to point.
        fillets: radius of the lower and of the upper edge [m].
        axes: the two axes of the outline and the axis of the height, such as "xzy".
    """
    (outline, spine), (lower, upper) = shape, fillets
    reach = np.linalg.norm(outline - spine, axis=1)
    low, high = (np.broadcast_to(height, reach.shape) for height in span)
    steps: list[tuple[npt.ArrayLike, npt.ArrayLike]] = [(reach, low)]
    steps += [(lower * (1.0 - np.sin(t)), low + lower * (1.0 - np.cos(t))) for t in FILLET]
    steps += [(upper * (1.0 - np.cos(t)), high - upper * (1.0 - np.sin(t))) for t in FILLET]
    steps += [(reach, high)]
    rings = np.zeros((len(steps), len(outline), 3))
    for ring, (inset, height) in zip(rings, steps, strict=True):
        share = (1.0 - np.asarray(inset) / reach)[:, None]
        ring[:, ["xyz".index(axis) for axis in axes[:2]]] = spine + share * (outline - spine)
        ring[:, "xyz".index(axes[2])] = height
    return skin(rings)


def drum(
    radius: float,
    span: tuple[float, float],
    axes: str = "xyz",
    at: npt.ArrayLike = (0.0, 0.0),
    fillet: float = 0.003,
) -> Part:
    """Make a cylinder with rounded edges along the last of the axes, its centre line through a point of the others."""
    sides = max(16, int(56 * min(1.0, radius / 0.06)))
    circle = arc(radius, (0.0, 360.0), sides + 1, at)[:-1]
    return plate((circle, np.repeat([at], sides, axis=0)), span, (fillet, fillet), axes)


def hull(points: npt.ArrayLike, radius: float) -> Part:
    """Make the convex hull of spheres of one radius around points, shape (k, 3)."""
    cloud = np.asarray(points, dtype=float)[:, None] + radius * SPHERE
    solid: Part = trimesh.convex.convex_hull(cloud.reshape(-1, 3))
    return solid


def block(low: Sequence[float], high: Sequence[float], radius: float) -> Part:
    """Make a box with rounded edges between two corners."""
    corners = np.array(
        np.meshgrid(*np.stack([np.add(low, radius), np.subtract(high, radius)], axis=1))
    )
    return hull(corners.reshape(3, -1).T, radius)


def slab(outline: Sequence[tuple[float, float]], width: float, radius: float) -> Part:
    """Make a rounded body from a convex x-z outline, symmetric in y, of a given half width."""
    inner = np.array([(x, side * (width - radius), z) for x, z in outline for side in (-1, 1)])
    return hull(inner, radius)


def loft(sections: Iterable[tuple[float, float, float, float]]) -> Part:
    """Stack super-ellipses (z, half width in x, half width in y, exponent) and close the ends."""
    wave = arc(1.0, (0.0, 360.0), 57)[:-1]
    bent = [
        (z, np.sign(wave) * np.abs(wave) ** (2.0 / power) * (a, b)) for z, a, b, power in sections
    ]
    rings = [np.column_stack([outline, np.full(len(outline), z)]) for z, outline in bent]
    return skin(np.array([rings[0] * (0, 0, 1), *rings, rings[-1] * (0, 0, 1)]))


def mirrored(part: Part) -> list[Part]:
    """Return a part and its mirror image in the x-z plane."""
    return [part, part.copy().apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))]


def lever(low: float, high: float) -> tuple[Array, Array]:
    """Draw the upper arm's outline and spine in x-z: two discs, joined by sides that narrow above the lower one."""
    start, end = 28.0, 4.0
    foot, head = np.array([0.0, 0.0]), np.array([0.0, 0.27])
    lower, upper = arc(low, (-90.0, start), 14, foot), arc(high, (end, 90.0), 12, head)
    t = np.linspace(0.0, 1.0, 14)[1:-1, None]
    leave, arrive = arc(0.16, (90.0 + start, 0.0), 1)[0], arc(0.25, (90.0 + end, 0.0), 1)[0]
    side = (1 + 2 * t) * (1 - t) ** 2 * lower[-1] + t**2 * (3 - 2 * t) * upper[0]
    side += t * (1 - t) ** 2 * leave - t**2 * (1 - t) * arrive
    right = np.concatenate([lower, side, upper])
    spine = np.concatenate(
        [np.repeat([foot], 14, 0), foot + t * (head - foot), np.repeat([head], 12, 0)]
    )
    left = slice(-2, 0, -1)
    return np.concatenate([right, right[left] * (-1, 1)]), np.concatenate([spine, spine[left]])


def base_link() -> dict[str, list[Part]]:
    """Foot plate, column and the connector box behind it."""
    bolts = [
        drum(0.007, (0.013, 0.019), at=(x, y), fillet=0.001)
        for x in (-0.076, 0.076)
        for y in (-0.076, 0.076)
    ]
    sockets = [
        drum(0.0095, (-0.2112, -0.19), "yzx", (y, 0.098), 0.001)
        for y in (-0.036, -0.012, 0.012, 0.036)
    ]
    sockets += [drum(0.008, (-0.2112, -0.19), "yzx", (0.036, z), 0.001) for z in (0.037, 0.063)]
    body = [
        block((-0.09, -0.09, 0.0), (0.09, 0.09, 0.014), 0.004),
        drum(0.083, (0.002, 0.1663)),
        block((-0.2055, -0.058, 0.012), (-0.03, 0.058, 0.118), 0.005),
        slab([(-0.192, 0.10), (-0.185, 0.127), (-0.05, 0.127), (-0.04, 0.05)], 0.046, 0.006),
    ]
    cover = [
        block((-0.2075, -0.05, 0.022), (-0.19, 0.05, 0.112), 0.0015),
        drum(0.0855, (0.1495, 0.158), fillet=0.002),
    ]
    plug = block((-0.2112, -0.046, 0.030), (-0.19, 0.014, 0.070), 0.002)
    return {"body": body, "cover": [*cover, *bolts], "metal": [plug, *sockets]}


def link_1() -> dict[str, list[Part]]:
    """Turning skirt, neck and the hub of joint 2, which lies at z = 0.29."""
    rise = np.linspace(0.0, 1.0, 9)
    ease = rise**2 * (3 - 2 * rise)
    bell = zip(
        0.187 + 0.048 * rise,
        0.094 - 0.032 * ease,
        0.090 - 0.046 * ease,
        2 + 1.6 * ease,
        strict=True,
    )
    rim = [
        (0.157, 0.100),
        (0.159, 0.105),
        (0.162, 0.1072),
        (0.178, 0.1072),
        (0.1815, 0.1062),
        (0.184, 0.1033),
    ]
    skirt = [(z, radius, radius, 2.0) for z, radius in [*rim, (0.1855, 0.098)]]
    body = [
        loft([*skirt, *bell, (0.29, 0.062, 0.044, 3.6)]),
        drum(0.063, (-0.049, 0.049), "xzy", (0, 0.29)),
    ]
    return {"body": body, "cover": [drum(0.0615, (-0.0545, 0.0545), "xzy", (0, 0.29), 0.001)]}


def link_2() -> dict[str, list[Part]]:
    """Two levers from joint 2 to joint 3, joined by a bar."""
    outline, spine = lever(0.072, 0.048)
    rise = np.clip((spine[:, 1] - 0.01) / 0.25, 0.0, 1.0)
    outside = 0.1095 - 0.0195 * rise**2 * (3 - 2 * rise)
    side = plate((outline, spine), (0.053, outside), (0.003, 0.02), "xzy")
    bar = block((-0.031, -0.07, 0.095), (0.031, 0.07, 0.151), 0.012)
    shoes = mirrored(block((-0.037, 0.046, 0.088), (0.037, 0.07, 0.158), 0.006))
    bolts = [
        drum(0.0035, (0.0435, 0.05), "xzy", (x, z), 0.0005)
        for x in (-0.0325, 0.0325)
        for z in (0.0925, 0.1535)
    ]
    return {
        "body": [*mirrored(side), bar, *shoes],
        "cover": [twin for bolt in bolts for twin in mirrored(bolt)],
    }


def link_3() -> dict[str, list[Part]]:
    """Elbow: hub of joint 3, housing of the wrist drives and the barrel of joint 4, which lies at z = 0.07."""
    top = slab(
        [(-0.067, 0.048), (-0.070, 0.116), (-0.062, 0.1235), (0.081, 0.1235), (0.089, 0.115)],
        0.053,
        0.016,
    )
    chin = [
        (-0.074, 0.040),
        (-0.070, 0.030),
        (-0.038, -0.008),
        (0.04, 0.030),
        (0.094, 0.034),
        (0.094, 0.112),
    ]
    low = slab(chin, 0.050, 0.013)
    body = [
        top,
        low,
        drum(0.0485, (-0.049, 0.049), "xzy"),
        drum(0.047, (0.06, 0.147), "yzx", (0, 0.07), 0.004),
    ]
    seals = [
        drum(0.047, (-0.0545, 0.0545), "xzy", fillet=0.001),
        drum(0.0445, (0.14, 0.1546), "yzx", (0, 0.07), 0.001),
    ]
    return {"body": body, "cover": seals}


def link_4() -> dict[str, list[Part]]:
    """Fork of the wrist: two tines that hold joint 5 at x = 0.302."""
    nose, corner = (
        arc(0.040, (-90.0, 90.0), 20, (0.302, 0.0)),
        arc(0.014, (90.0, 180.0), 6, (0.1665, 0.030)),
    )
    outline = np.concatenate([nose, corner, corner[::-1] * (1, -1)])
    spine = np.stack([np.clip(outline[:, 0], 0.19, 0.302), 0.0 * outline[:, 1]], axis=1)
    tine = plate((outline, spine), (0.0335, 0.0632), (0.003, 0.013), "xzy")
    body = [*mirrored(tine), block((0.1525, -0.045, -0.0425), (0.2375, 0.045, 0.0425), 0.008)]
    valve = [drum(0.0065, (0.03, 0.0595), at=(x, -0.012), fillet=0.0015) for x in (0.19, 0.208)]
    collar = drum(0.042, (0.1486, 0.158), "yzx", fillet=0.002)
    return {
        "body": body,
        "cover": [collar, block((0.178, -0.024, 0.03), (0.220, 0.010, 0.048), 0.003)],
        "metal": valve,
    }


def link_5() -> dict[str, list[Part]]:
    """Wrist: hub of joint 5 and the drive of the flange."""
    hub = [
        (0.037 * c, y, 0.037 * s) for c, s in arc(1.0, (0.0, 345.0), 24) for y in (-0.0295, 0.0295)
    ]
    shell = hull([*hub, *((0.043, y, z) for y, z in arc(0.0305, (0.0, 345.0), 24))], 0.003)
    rear = slab([(-0.048, -0.020), (-0.048, 0.020), (0.01, 0.026), (0.01, -0.026)], 0.031, 0.009)
    body = [shell, rear, drum(0.0345, (0.01, 0.057), "yzx", fillet=0.002)]
    ring = drum(0.0325, (0.05, 0.066), "yzx", fillet=0.002)
    bolts = [
        drum(0.0032, (0.05, 0.0675), "yzx", place, 0.0008)
        for place in arc(0.0262, (30.0, 330.0), 6)
    ]
    return {
        "body": body,
        "cover": [ring, drum(0.0385, (-0.0348, 0.0348), "xzy", fillet=0.0005)],
        "metal": bolts,
    }


def link_6() -> dict[str, list[Part]]:
    """Flange with four screw holes and a centring bore, drawn as dark discs."""
    holes = [
        drum(0.0026, (-0.004, 0.0001), "yzx", place, 0.0)
        for place in arc(0.01575, (45.0, 315.0), 4)
    ]
    bore = drum(0.01, (-0.004, 0.0001), "yzx", fillet=0.0)
    return {"metal": [drum(0.02, (-0.013, 0.0), "yzx", fillet=0.001)], "cover": [bore, *holes]}


def corner_normals(solid: Part) -> Array:
    """Mean the normals around every face corner by area, across soft edges only; shape (faces, 3, 3)."""
    normals, weights = np.asarray(solid.face_normals), np.asarray(solid.area_faces)
    corners: Array = np.zeros((len(solid.faces), 3, 3))
    for face, vertices in enumerate(solid.faces):
        for place, vertex in enumerate(vertices):
            around = np.array([other for other in solid.vertex_faces[vertex] if other >= 0])
            soft = around[normals[around] @ normals[face] >= CREASE]
            corners[face, place] = weights[soft] @ normals[soft]
    corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    return corners


def numbered(rows: Sequence[Array], digits: int) -> tuple[Array, npt.NDArray[np.intp]]:
    """Round the rows (each of shape (faces, 3, 3)), list the different ones and number every face's three."""
    rounded = np.round(np.concatenate(rows), digits).reshape(-1, 3) + 0.0  # + 0.0 turns -0 into 0
    different, number = np.unique(rounded, axis=0, return_inverse=True)
    return different, number.reshape(-1, 3) + 1


def write_obj(path: Path, parts: Sequence[Part]) -> None:
    """Write parts as one OBJ file: coordinates to 0.1 mm, normals to 1e-3."""
    points, corners = numbered([np.asarray(part.triangles) for part in parts], 4)
    normals, turns = numbered([corner_normals(part) for part in parts], 3)
    lines = ["# made by make_meshes.py"]
    lines += ["v " + " ".join(f"{value:.4f}" for value in point) for point in points]
    lines += ["vn " + " ".join(f"{value:.3f}" for value in normal) for normal in normals]
    corner = "{}//{}".format
    faces = (
        map(corner, *face) for face in zip(corners, turns, strict=True) if len(set(face[0])) == 3
    )
    # those that the rounding shrinks to a line are left out
    lines += ["f " + " ".join(face) for face in faces]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def main() -> None:
    """Write the meshes of all links."""
    folder = Path(__file__).parent / "meshes"
    folder.mkdir(exist_ok=True)
    for link in (base_link, link_1, link_2, link_3, link_4, link_5, link_6):
        for colour, parts in link().items():
            write_obj(folder / f"{link.__name__}_{colour}.obj", parts)


if __name__ == "__main__":
    main()
