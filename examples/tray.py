"""An arm empties a tray, in which ten cubes lie at places and turns of chance, and puts them in two rows.

Its fingers hold them by friction alone. Another seed puts them elsewhere: ``python examples/tray.py 7``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from simrob_drake import Arm, Workcell

STATION = Path(__file__).parent / "stations" / "tray.yaml"
PARTS, ROW = 10, 5
LEVEL = 0.02  # m: of a cube's middle on the floor
ABOVE = 0.12  # m: on the way
FORCE = 60.0  # N of each finger


def target(number: int) -> tuple[float, float]:
    """Return x and y of a place in the rows [m]."""
    row, column = divmod(number, ROW)
    return 0.28 + 0.06 * column, 0.17 + 0.07 * row


def put(arm: Arm, part: str, number: int) -> None:
    """Take a part from where it lies, square on its sides, and put it in its place."""
    pose = arm.cell.frame(part)
    (x, y, z), turn = pose.translation(), pose.rotation().ToRollPitchYaw().yaw_angle()
    # a cube is the same after a quarter of a turn
    down = [
        (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4,
        0.0,
        np.pi,
    ]
    arm.move_j([x, y, ABOVE, *down], duration=0.8)
    arm.move_l([x, y, z, *down], speed=0.2)
    arm.grip(force=FORCE)
    arm.move_l([x, y, ABOVE, *down], speed=0.4)
    across, along = target(number)
    arm.move_j([across, along, ABOVE, 0.0, 0.0, np.pi], duration=1.0)
    arm.move_l([across, along, LEVEL + 0.001, 0.0, 0.0, np.pi], speed=0.2)
    arm.open()
    arm.move_l([across, along, ABOVE, 0.0, 0.0, np.pi], speed=0.4)


def run(seed: int = 0, parts: int = PARTS) -> Workcell:
    """Let the parts fall, put some of them in rows, and return the station."""
    cell = Workcell(STATION, {"pieces.part.scatter.seed": seed})
    cell.record()
    cell.wait(0.5)
    for number in range(parts):
        put(cell.arm(), f"part_{number + 1}", number)
    cell.wait(1.0)
    return cell


def off_place(cell: Workcell, number: int) -> float:
    """Return how far a part is from its place [m]."""
    middle = cell.frame(f"part_{number + 1}").translation()
    return float(np.linalg.norm(middle - [*target(number), LEVEL]))


def main(folder: Path | None = None) -> None:
    """Empty the tray, and say how far the parts are from their places."""
    cell = run(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    print(
        "mm beside their places:",
        ", ".join(f"{1e3 * off_place(cell, number):.1f}" for number in range(PARTS)),
    )
    print("files in", cell.save(folder))


if __name__ == "__main__":
    main()
