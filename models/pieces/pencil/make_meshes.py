"""Make the pencil's point, a cone on the x-y plane: ``python models/pieces/pencil/make_meshes.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RADIUS = 0.006  # of the shaft [m]
LENGTH = 0.024  # from the shaft's end to the tip [m]
SIDES = 32


def ring(tilt: float, shift: float = 0.0) -> Array:
    """Return unit vectors at equal angles that rise by an angle [rad], turned by a part of a side; shape (SIDES, 3)."""
    turn = 2.0 * np.pi * (np.arange(SIDES) + shift) / SIDES
    return np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.full(SIDES, np.sin(tilt))], axis=1)


def cone() -> str:
    """Write the cone as OBJ text: normals along the rim, at the tip one per side, and one for the base."""
    points = np.concatenate([RADIUS * ring(0.0), [[0.0, 0.0, LENGTH], [0.0, 0.0, 0.0]]])
    slope = float(np.arctan2(RADIUS, LENGTH))
    normals = np.concatenate([ring(slope), ring(slope, 0.5), [[0.0, 0.0, -1.0]]])
    lines = ["# made by make_meshes.py"]
    lines += ["v {:.5f} {:.5f} {:.5f}".format(*point) for point in np.round(points, 5) + 0.0]
    lines += ["vn {:.4f} {:.4f} {:.4f}".format(*normal) for normal in np.round(normals, 4) + 0.0]
    tip, centre, down = SIDES + 1, SIDES + 2, 2 * SIDES + 1
    for side in range(1, SIDES + 1):
        after = side % SIDES + 1
        lines.append(f"f {side}//{side} {after}//{after} {tip}//{SIDES + side}")
        lines.append(f"f {after}//{down} {side}//{down} {centre}//{down}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the mesh beside this script."""
    Path(__file__).with_name("point.obj").write_text(cone(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
