"""An arm builds a tower of five steel cubes, which its fingers hold by friction alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import Arm, Workcell

DOWN = [0.0, 0.0, np.pi]  # Rz Ry Rx: the fingers point down
SIDE = 0.04  # m, of a cube
ABOVE, PLACE = 0.26, (0.45, 0.0)  # m: height over the floor on the way, and where the tower stands
FORCE = 60.0  # N of each finger
CUBES = 5


def put(arm: Arm, cube: str, level: int) -> None:
    """Take a cube from where it is, and put it on a level of the tower."""
    x, y, z = arm.cell.frame(cube).translation()
    arm.move_j([x, y, 0.12, *DOWN], duration=0.8)
    arm.move_l([x, y, z], speed=0.2)
    arm.grip(force=FORCE)
    arm.move_l([x, y, ABOVE], speed=0.4)
    arm.move_l([*PLACE, ABOVE], speed=0.4)
    arm.move_l([*PLACE, (level + 0.5) * SIDE + 0.001], speed=0.2)
    arm.open()
    arm.move_l([*PLACE, ABOVE], speed=0.4)


def run(cubes: int = CUBES) -> Workcell:
    """Build the tower of some cubes, watch it for a second, and return the station."""
    cell = Workcell("irb120_gripper")
    cell.record()
    arm = cell.arm()
    for level in range(cubes):
        put(arm, f"cube_{level + 1}", level)
    cell.wait(1.0)
    return cell


def main(folder: Path | None = None) -> None:
    """Build the tower, and say where its cubes are."""
    cell = run()
    for number in range(CUBES):
        x, y, z = 1e3 * cell.frame(f"cube_{number + 1}").translation()
        print(f"cube_{number + 1} at {x:.1f}, {y:.1f}, {z:.1f} mm")
    print("files in", cell.save(folder))


if __name__ == "__main__":
    main()
