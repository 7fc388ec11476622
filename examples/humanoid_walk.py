"""Walk the humanoid of MATLAB on its real sole, over which it leans, or on the large area C (the walk "walk")."""

from __future__ import annotations

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.measures import journey
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.walk import walk


def run(name: str = "real_sole", steps: int = 8) -> SimulationResult:
    """Walk some steps and return the run."""
    motion = walk("humanoid", steps, name)
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the walk went, and where its files are."""
    result = run()
    found = journey(result, load_gaits("humanoid").facing_deg)
    end = "upright" if found.upright else f"fell at {found.fell_at:.1f} s"
    print(f"{found.ahead:.2f} m in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg, {end}")
    print("files in", result.save())


if __name__ == "__main__":
    main()
