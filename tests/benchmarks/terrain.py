"""How a trot crosses seeded fields of steps and a soft patch, with touchdown and without: for docs/results/walking.md.

Run it with ``python -m tests.benchmarks.terrain [FIELDS] [SETTING]...``; twenty fields take some minutes a setting.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from simrob_drake import simulate
from simrob_drake.programs.gaits.quadruped import trot
from simrob_drake.results.record.walks import Locomotion, locomotion

STATION = "yobotics_terrain"
SECONDS, FAR, ASIDE = 20.0, 1.0, 0.5
"""How long it walks [s]; how far ahead it must come, and how little to the side, to have stayed on course [m]."""
FINE = {"solver.max_step": 0.0025}
BLIND: dict[str, Any] = {"controllers": {}}
HIGH = {"floor.terrain.height": 0.03}
_FEET = ("rear_left", "front_left", "rear_right", "front_right")
_ERRORS = {"rate": 200, "noise": 1.0, "resolution": 0.5, "delay": 0.01}  # N, N, s
MEASURED = {
    f"sensors.{foot}.{key}": value
    for seed, foot in enumerate(_FEET)
    for key, value in {**_ERRORS, "seed": seed}.items()
}
SETTINGS: dict[str, Mapping[str, Any]] = {
    "touchdown": {},
    "blind": BLIND,
    "touchdown, steps of 2.5 ms": FINE,
    "blind, steps of 2.5 ms": {**BLIND, **FINE},
    "touchdown at 50 Hz": {"controllers.touchdown.rate": 50},
    "touchdown at 200 Hz": {"controllers.touchdown.rate": 200},
    "touchdown on noisy forces, 10 ms late": MEASURED,
    "touchdown of torques": {"controllers.touchdown.holds": "torques"},
    "touchdown, 30 mm": HIGH,
    "blind, 30 mm": {**BLIND, **HIGH},
}


def crossed(seed: int, changes: Mapping[str, Any], seconds: float = SECONDS) -> Locomotion:
    """Return how the robot went over the field of a seed."""
    motion = trot("yobotics", 60, step_length=0.08)  # 20 s
    overrides = {"floor.terrain.seed": seed, "duration": seconds, "sample_rate": 50, **changes}
    result = simulate(
        motion.station(overrides, name=STATION), reference=motion.trajectory(), progress=False
    )
    return locomotion(result)


def main(fields: int, names: list[str]) -> None:
    """Cross and print."""
    for name in names or SETTINGS:
        found = [crossed(seed, SETTINGS[name]) for seed in range(fields)]
        good = sum(each.upright and each.ahead >= FAR for each in found)
        ahead, sideways = (
            np.array([getattr(each, key) for each in found]) for key in ("ahead", "drift")
        )
        yaw, tilt = (np.rad2deg([getattr(each, key) for each in found]) for key in ("yaw", "tilt"))
        upright = sum(each.upright for each in found)
        straight = sum(
            each.upright and each.ahead >= FAR and abs(each.drift) <= ASIDE for each in found
        )
        print(
            f"{name} | {straight} of {fields}, {good} far, {upright} upright | "
            f"{ahead.mean():.2f} m ({ahead.min():.2f}) | {abs(sideways).mean():.2f} m ({abs(sideways).max():.2f}) | "
            f"{abs(yaw).mean():.1f}° ({abs(yaw).max():.0f}°) | {tilt.mean():.1f}° ({tilt.max():.1f}°)",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2:])
