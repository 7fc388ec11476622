"""What happens when the motors are too weak: the arm with less and less torque (thesis, p. 49)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate


def run(
    *, limits: Sequence[float] = (150.0, 22.0, 10.0), duration: float = 3.0
) -> dict[float, SimulationResult]:
    """Run the 30 degree move with each torque limit [N·m]."""
    stations = {
        limit: load_station("irb120_dynamic", {"servo.torque_limit": limit}) for limit in limits
    }
    return {limit: simulate(station, duration=duration) for limit, station in stations.items()}


def main() -> None:
    """Print where joint 2 ends under every limit."""
    for limit, result in run().items():
        angle, torque = np.rad2deg(result["q.joint_2"][-1]), result["tau.joint_2"][-1]
        print(
            f"limit {limit:5.0f} N·m: joint 2 ends at {angle:6.1f} deg, its motor gives {torque:6.1f} N·m"
        )


if __name__ == "__main__":
    main()
