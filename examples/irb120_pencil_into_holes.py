"""Put the pencil into holes of the half sphere and the cylinder, each straight along its axis."""

from __future__ import annotations

import numpy as np

from simrob_drake import Arm, SimrobError, SimulationResult

HOME = [0, 0, 0, 0, np.pi / 2, 0]  # rad
HOLES = (
    "half_sphere.hole_top",
    "half_sphere.hole_30_0",
    "half_sphere.hole_60_0",
    "cylinder.hole_1_7",
)
TOO_NEAR = "half_sphere.hole_30_2"  # on the side of the sphere that the arm's own foot is on
APPROACH, DEPTH = 0.06, 0.04  # m before the mouth of a hole, and into it
INWARDS = [0.0, 0.0, np.pi]  # holes have z outwards, the tip of the pencil points along its z


def run() -> dict[str, SimulationResult]:
    """Put the pencil into the holes, and return the way into each."""
    arm = Arm("irb120_workcell", tool="pencil")
    ways = {}
    for hole in HOLES:
        arm.move_j([0, 0, APPROACH, *INWARDS], wobj=hole)
        # meshes are filled
        ways[hole] = arm.move_l([0, 0, -DEPTH], wobj=hole, speed=0.2, check=None)
        arm.move_l([0, 0, APPROACH], wobj=hole, speed=0.3)
        arm.move_abs_j(HOME)
    return ways


def off_axis(hole: str, way: SimulationResult) -> float:
    """Return how far the tip strayed from the axis of its hole [m]."""
    mouth = Arm(way.config).cell.frame(hole).inverse()
    return float(np.linalg.norm((mouth @ way.pose("tcp")[:, :3].T)[:2], axis=0).max())


def main() -> None:
    """Print how well the pencil kept to the axes of the holes, and why one cannot be reached."""
    for hole, way in run().items():
        print(
            f"{hole}: {way.stop_time:.2f} s, at most {1e6 * off_axis(hole, way):.2f} µm off its axis"
        )
    try:
        Arm("irb120_workcell", tool="pencil").move_j(
            [0, 0, -DEPTH, *INWARDS], wobj=TOO_NEAR, check=None
        )
    except SimrobError as problem:
        print(f"{TOO_NEAR}: {problem}")


if __name__ == "__main__":
    main()
