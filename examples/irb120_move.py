"""Move an IRB120 by joint torque, and save signals, plots and a recording."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate


def run(*, target_deg: float = 30.0, duration: float = 3.0) -> SimulationResult:
    """Move all joints to ``target_deg`` [deg] and return the run."""
    station = load_station("irb120_dynamic", {"reference.target_deg": target_deg})
    return simulate(station, duration=duration)


def main() -> None:
    """Print where the arm ended and where its files are."""
    result = run()
    print(result.message)
    print(
        "joint 2 sags by",
        np.rad2deg(result["q.joint_2"][-1] - result["q_ref.joint_2"][-1]).round(2),
        "deg",
    )
    print("files in", result.save())


if __name__ == "__main__":
    main()
