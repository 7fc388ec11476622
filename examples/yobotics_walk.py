"""Trot and crawl with the quadruped, and stand on three legs."""

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
    """Print how far the quadruped went, and where the files are."""
    motions = {
        "trot": trot("yobotics", steps=20),
        "crawl": crawl("yobotics", legs=8),
        "three legs": three_legs("yobotics", "front_left_foot", seconds=2.0),
    }
    for name, motion in motions.items():
        result = run(motion)
        found = journey(result, load_gaits("yobotics").facing_deg)
        print(f"{name}: {found.ahead:.2f} m in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg")
        print("files in", result.save())


if __name__ == "__main__":
    main()
