"""Lesson 1, an arm moves: all joints by 30 degrees, with a load, and with motors that are too weak."""

from __future__ import annotations

import numpy as np

from simrob_drake import load_station, simulate

CASES = {
    "as it is": {},
    "with 5 kg": {"pieces.load.mass": 5},
    "with 10 N·m": {"servo.torque_limit": 10},
}


def main() -> None:
    """Run the station three times, and keep the first run with its recording."""
    for name, changes in CASES.items():
        result = simulate(load_station("irb120_dynamic", changes), duration=2.0, progress=False)
        end, torque = np.rad2deg(result["q.joint_2"][-1]), np.abs(result["tau.joint_2"]).max()
        print(f"{name}: joint 2 ends at {end:.1f} degrees, its motor gave up to {torque:.1f} N·m")
        if not changes:
            result.save("runs/lesson_1", force=True)
    print("look at runs/lesson_1/recording.html")


if __name__ == "__main__":
    main()
