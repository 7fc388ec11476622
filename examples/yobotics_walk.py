"""Trot with the quadruped, crawl, and stand on three legs."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.quadruped import crawl, three_legs, trot
from simrob_drake.results.record.walks import locomotion


def run(motion: JointMotion) -> SimulationResult:
    """Move as planned and return the run."""
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the quadruped went, and where the files of the trot are."""
    motions = {
        "trot": trot("yobotics", steps=7),
        "crawl": crawl("yobotics", legs=4),
        "three legs": three_legs("yobotics", foot="front_left_foot", seconds=1.0),
    }
    results = {name: run(motion) for name, motion in motions.items()}
    for name, result in results.items():
        found = locomotion(result)
        print(
            f"{name}: {found.ahead:.2f} m in {result.stop_time:.1f} s, turned by {np.rad2deg(found.yaw):.1f} deg"
        )
    print("files in", results["trot"].save())


if __name__ == "__main__":
    main()
