"""The march of the thesis: six sub-moves of one second, joined by straight lines, with the gains 100 and 100."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.sequences import march
from simrob_drake.results.record.walks import locomotion


def run(steps: int = 3, amplitude: float = 1.0) -> SimulationResult:
    """March some steps and return the run; eleven take 37 seconds."""
    motion = march("humanoid", steps, amplitude=amplitude)
    return simulate(motion.station(), reference=motion.trajectory())


def main() -> None:
    """Print how far the march went, and where its files are."""
    result = run()
    found = locomotion(result)
    print(
        f"{found.ahead:.2f} m in {result.stop_time:.1f} s, tilted by {np.rad2deg(found.tilt):.1f} deg at most"
    )
    print("files in", result.save())


if __name__ == "__main__":
    main()
