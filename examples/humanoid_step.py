"""Take the step of the thesis on the humanoid's own feet: a second a posture, in SimRob's names of the joints."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate

STEP = [
    {"time": 1, "target_deg": {"CadIF": 60, "RodI": 60}},  # lift the left leg: hip and knee
    # bend the right knee: the body comes down and forward
    {
        "time": 2,
        "target_deg": {"RodD": 30, "TobD": -30},
    },
    {"time": 3, "target_deg": {"CadIF": 0, "RodI": 0}},  # put the left leg down
    {"time": 4, "target_deg": {"RodD": 0, "TobD": 0}},  # stand up
]


def run() -> SimulationResult:
    """Take the step and return the run."""
    station = load_station("humanoid_dynamic", {"reference": {"kind": "sequence", "targets": STEP}})
    return simulate(station, duration=6.0)


def main() -> None:
    """Print how far the step went, and where its files are."""
    result = run()
    x, y, z = 1e3 * (result.pose("base")[-1, :3] - result.pose("base")[0, :3])
    print(result.message)
    print(f"forward {-y:.1f} mm, to the left {x:.1f} mm, {-z:.1f} mm lower")
    print(f"largest torque {np.abs(result.axes('tau')).max():.2f} N·m of 3")
    print("files in", result.save())


if __name__ == "__main__":
    main()
