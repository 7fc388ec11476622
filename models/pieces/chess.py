"""The chess figures, on feet 45 mm wide that stand 5 mm below the origin; their profiles are drawn in millimetres."""

from __future__ import annotations

import numpy as np
from solids import Solid, ball, block, curve, lathe, plate, prism, together

MM = 1e-3

Profile = list[tuple[float, ...]]
FOOT: Profile = [
    (0, -5),
    (21.5, -5),
    (22.5, -4),
    (22.5, -1.5),
    (21.5, 0),
    (20, 0.6),
    (19.6, 2),
    (18, 4.2),
    (15.5, 5.6),
]


def turned(*parts: Profile) -> Solid:
    """Turn a chess profile [mm] on its foot."""
    profile = [*FOOT, *(point for part in parts for point in part)]
    return lathe([(radius * MM, height * MM) for radius, height in profile])


def collar(radius: float, height: float) -> Profile:
    """Return a thin round collar [mm]."""
    return [
        (radius - 1.2, height),
        (radius, height + 0.9),
        (radius - 0.2, height + 1.9),
        (radius - 2, height + 2.6),
    ]


def pawn() -> Solid:
    """Ball on a short neck."""
    neck = curve([(14, 6.6), (9.5, 13), (7.4, 21), (7.8, 25.5)])
    return turned(neck, collar(12, 26), ball(8.5, 36.5, -60.0))


def rook() -> Solid:
    """Tower with six battlements."""
    neck = curve([(15, 7), (12.8, 14), (11.4, 27), (12, 36)])
    tower = curve([(13, 41.2), (14.4, 44), (15.6, 48)])
    top: Profile = [(15.6, 49), (10.5, 49), (10.2, 46.5), (0, 46.5)]
    battlements = []
    for turn in np.radians(60.0 * np.arange(6)):
        across = turn + np.radians(np.linspace(-19.0, 19.0, 5))
        arcs = [
            radius * MM * np.stack([np.cos(t), np.sin(t)], axis=1)
            for radius, t in ((15.6, across), (10.5, across[::-1]))
        ]
        battlements.append(prism(np.concatenate(arcs), 48.5 * MM, 55 * MM))
    return together([turned(neck, collar(15.2, 37.4), tower, top), *battlements])


def knight() -> Solid:
    """Horse's head, its muzzle along x."""
    chest: Profile = [
        (10.6, 8),
        (13.2, 15),
        (11.4, 22),
        (8.2, 29),
        (6.4, 33),
        (6.2, 35),
        (7, 36.4),
        (8.4, 36.9),
    ]
    chin: Profile = [(10, 36.8), (12.4, 36), (15.2, 35.2), (18.4, 36.4)]
    mane: Profile = [
        (-10.8, 8),
        (-14, 14),
        (-16, 23),
        (-16.6, 33),
        (-14.6, 43),
        (-10.4, 51.5),
        (-4, 58),
        (2.6, 61),
    ]
    face: Profile = [(6.4, 66), (9, 58.4), (14, 51), (19.2, 45.2)]
    neck: Profile = [
        (0, 10),
        (-1, 15),
        (-2.2, 23),
        (-3.2, 32),
        (-2.8, 40),
        (-0.5, 46),
        (2.2, 50),
        (5, 52),
    ]
    head: Profile = [(7.5, 50.5), (10.5, 47), (13.5, 43.5), (16, 41)]
    right, left, bone = (
        np.array(curve(line, 3)) for line in ([*chest, *chin], [*mane, *face], [*neck, *head])
    )
    outline, spine = (
        np.concatenate([right, [(20.6, 41)], left[::-1]]),
        np.concatenate([bone, bone[-1:], bone[::-1]]),
    )
    along = np.concatenate(
        [np.linspace(0.0, 1.0, len(bone)), [1.0], np.linspace(1.0, 0.0, len(bone))]
    )
    width = np.interp(along, [0.0, 0.1, 0.3, 0.6, 1.0], [9.0, 10.8, 10.5, 9.0, 6.5])
    base = turned([(15, 7), (14.4, 8.4), (15.2, 10), (14.6, 11.4), (0, 11.6)])
    return together([base, plate(outline * MM, spine * MM, width * MM, 3.0 * MM)])


def bishop() -> Solid:
    """Mitre with a ball on it."""
    neck = curve([(14.5, 6.8), (9.4, 15), (7, 28), (7.4, 36)])
    mitre = curve([(8.2, 41.4), (10.8, 46.5), (10.9, 51.5), (8.4, 58.5), (4.6, 64), (2.4, 65.6)])
    return turned(neck, collar(12.6, 37), mitre, ball(3, 68, -45.0))


def queen() -> Solid:
    """Coronet with eight points, and a ball in it."""
    neck = curve([(15, 7), (9.8, 17), (7.6, 33), (8, 43)])
    bell = curve([(9, 49), (10, 55), (12.4, 61.5), (15, 66.4)])
    crown: Profile = [
        (15.4, 67.4),
        (13.2, 67.8),
        (11, 65),
        *curve([(8.6, 67), (6, 69.4), (3, 70.8)]),
        *ball(3.5, 74.34, -60.0),
    ]
    solid = turned(neck, collar(14, 44.4), bell, crown)
    radius, height = np.hypot(solid.points[:, 0], solid.points[:, 1]), solid.points[:, 2]
    rim = (radius > 12 * MM) & (height > 66 * MM)
    points = solid.points.copy()
    points[rim, 2] += 1.6 * MM * np.cos(8 * np.arctan2(points[rim, 1], points[rim, 0]))
    return Solid(points, solid.faces)


def king() -> Solid:
    """Crown with a cross."""
    neck = curve([(15.5, 7.2), (10.4, 18), (8.2, 36), (8.6, 48)])
    bell = curve([(9.8, 54.2), (10.6, 60), (12.4, 66), (13.6, 69)])
    crown: Profile = [(14, 70), (13.4, 71.4), *curve([(11, 72.2), (7, 74.4), (3, 75.8), (0, 76)])]
    upright = block([-1.7 * MM, -1.7 * MM, 74.5 * MM], [1.7 * MM, 1.7 * MM, 87 * MM])
    beam = block([-5 * MM, -1.6 * MM, 80 * MM], [5 * MM, 1.6 * MM, 83.2 * MM])
    return together([turned(neck, collar(14.4, 49.4), bell, crown), upright, beam])


FIGURES = (pawn, rook, knight, bishop, queen, king)
