"""Trot with the quadruped, crawl, and stand on three legs."""

from __future__ import annotations

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.measures import journey
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import crawl, three_legs, trot


def run(motion: JointMotion) -> SimulationResult:
    """Move as planned and return the run."""
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the quadruped went, and where the files of the trot are."""
    motions = {
        "trot": trot("yobotics", steps=12),
        "crawl": crawl("yobotics", legs=4),
        "three legs": three_legs("yobotics", foot="front_left_foot", seconds=1.0),
    }
    results = {name: run(motion) for name, motion in motions.items()}
    for name, result in results.items():
        found = journey(result, load_gaits("yobotics").facing_deg)
        print(f"{name}: {found.ahead:.2f} m in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg")
    print("files in", results["trot"].save())


if __name__ == "__main__":
    main()
