"""Walk a humanoid: ``python examples/humanoids_walk.py [ROBOT] [GAIT]``; all three unless one is named.

The humanoid of MATLAB walks on its real sole, over which it leans, roid1 straight ahead, and ZJUDancer on a circle to
the left. Other walks: ``walk`` (of the humanoid on the large area C), ``turn`` and ``sideways`` (of the other two).
"""

from __future__ import annotations

import sys

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.results.record.walks import locomotion

WALKS = {"humanoid": "real_sole", "roid1": "walk", "zjudancer": "turn"}


def run(robot: str, gait: str | None = None, steps: int = 4) -> SimulationResult:
    """Walk some steps and return the run."""
    motion = walk(robot, steps, gait or WALKS.get(robot, "walk"))
    return simulate(motion.station(), reference=motion.trajectory())


def main(robot: str | None = None, gait: str | None = None) -> None:
    """Print how far each walk went, and where its files are."""
    for name in [robot] if robot else WALKS:
        result = run(name, gait)
        found = locomotion(result)
        way = f"{found.ahead:.2f} m ahead, {found.drift:.2f} m to the left in {result.stop_time:.1f} s"
        end = "upright" if found.upright else f"fell at {found.fall_time:.1f} s"
        print(
            f"{name}: {way}, turned by {np.rad2deg(found.yaw):.1f} deg, {end}; files in {result.save()}"
        )


if __name__ == "__main__":
    main(*sys.argv[1:3])
