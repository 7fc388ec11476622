"""Walk roid1 straight ahead, or with another of its walks: turn, sideways."""

from __future__ import annotations

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.measures import journey
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.walk import walk


def run(name: str = "walk", steps: int = 8) -> SimulationResult:
    """Walk some steps and return the run."""
    motion = walk("roid1", steps, name)
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the walk went, and where its files are."""
    result = run()
    found = journey(result, load_gaits("roid1").facing_deg)
    way = f"{found.ahead:.2f} m ahead, {found.left:.2f} m to the left"
    print(f"{way} in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg")
    print("files in", result.save())


if __name__ == "__main__":
    main()
