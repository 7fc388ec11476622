"""Walk roid1 and ZJUDancer straight ahead, and ZJUDancer on a circle: the same planner with other figures."""

from __future__ import annotations

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.measures import journey
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.walk import walk

WALKS = (("roid1", "walk"), ("zjudancer", "walk"), ("zjudancer", "turn"))


def run(robot: str, name: str = "walk", steps: int = 12) -> SimulationResult:
    """Walk some steps and return the run."""
    motion = walk(robot, steps, name)
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the walks went, and where their files are."""
    for robot, name in WALKS:
        result = run(robot, name)
        found = journey(result, load_gaits(robot).facing_deg)
        way = f"{found.ahead:.2f} m ahead, {found.left:.2f} m to the left"
        print(f"{robot}, {name}: {way} in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg")
        print("files in", result.save())


if __name__ == "__main__":
    main()
