"""Walk the humanoid of MATLAB on two areas of contact: the large one, and its real sole, over which it leans."""

from __future__ import annotations

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.measures import journey
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.walk import walk


def run(name: str, steps: int = 12) -> SimulationResult:
    """Walk some steps and return the run."""
    motion = walk("humanoid", steps, name)
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the walks went, and where their files are."""
    for name in ("walk", "real_sole"):
        result = run(name)
        found = journey(result, load_gaits("humanoid").facing_deg)
        end = "upright" if found.upright else f"fell at {found.fell_at:.1f} s"
        print(f"{name}: {found.ahead:.2f} m in {found.seconds:.1f} s, turned by {found.yaw_deg:.1f} deg, {end}")
        print("files in", result.save())


if __name__ == "__main__":
    main()
