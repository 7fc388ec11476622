"""Let the double pendulum swing freely: what it loses in energy is what its joints' damping takes."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate


def run(*, duration: float = 5.0) -> SimulationResult:
    """Let the pendulum go from 40 and 30 degrees without any servo."""
    free = {"servo.kp": 0, "servo.kd": 0, "reference.kind": "hold", "solver.accuracy": 1e-4}
    return simulate(load_station("double_pendulum", free), duration=duration)


def main() -> None:
    """Print how the swing dies down."""
    result = run()
    for second in range(int(result.stop_time) + 1):
        angles = np.rad2deg(result.axes("q")[np.searchsorted(result.times, second)])
        print(f"{second} s: joints at {angles[0]:6.1f} and {angles[1]:6.1f} deg")


if __name__ == "__main__":
    main()
