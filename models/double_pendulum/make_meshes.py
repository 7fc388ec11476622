"""Make the pendulum's wall plate, a hexagonal prism along y: ``python models/double_pendulum/make_meshes.py``."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

RADIUS = 0.06  # from the centre to a corner [m]
THICKNESS = 0.005  # [m]


def prism() -> str:
    """Write the prism as OBJ text, one normal per face."""
    turn = np.radians(60.0 * np.arange(6))
    rim = np.stack([np.cos(turn), np.zeros(6), np.sin(turn)], axis=1)
    half = np.array([0.0, THICKNESS / 2, 0.0])
    points = np.round(np.concatenate([RADIUS * rim - half, RADIUS * rim + half]), 5) + 0.0
    normals = (
        np.round(
            np.concatenate([rim + np.roll(rim, -1, axis=0), [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]]), 4
        )
        + 0.0
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lines = ["# made by make_meshes.py"]
    lines += ["v {:.5f} {:.5f} {:.5f}".format(*point) for point in points]
    lines += ["vn {:.4f} {:.4f} {:.4f}".format(*normal) for normal in normals]
    faces: list[tuple[tuple[int, ...], int]] = [((1, 2, 3, 4, 5, 6), 7), ((12, 11, 10, 9, 8, 7), 8)]
    faces += [((side, side + 6, side % 6 + 7, side % 6 + 1), side) for side in range(1, 7)]
    for corners, normal in faces:
        for second, third in pairwise(corners[1:]):
            lines.append(
                "f " + " ".join(f"{corner}//{normal}" for corner in (corners[0], second, third))
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the mesh beside this script."""
    Path(__file__).with_name("base.obj").write_text(prism(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
