"""How far leg odometry errs while robots walk, on sensors good and worn: for docs/results/walking.md.

Run it with ``python -m tests.benchmarks.odometry [NAME]...``; it takes some minutes.
"""

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from simrob_drake import simulate
from simrob_drake.base.frames import Vector
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.quadruped import trot

RATE = 200
GOOD: dict[str, dict[str, Any]] = {"imu": {}, "encoders": {}}
WORN: dict[str, dict[str, Any]] = {
    "imu": {
        "gyroscope_noise": 0.02,
        "gyroscope_bias": 0.005,
        "accelerometer_noise": 0.1,
        "accelerometer_bias": 0.05,
        "delay": 0.01,
    },
    "encoders": {"resolution_deg": 0.088, "noise_deg": 0.02, "smoothing": 0.01, "delay": 0.01},
}
SEEDS = 5
MOTIONS: dict[str, tuple[Callable[[], JointMotion], str | None]] = {
    "zjudancer walk": (lambda: walk("zjudancer", 140), None),
    "roid1 walk": (lambda: walk("roid1", 190), None),
    "yobotics trot": (lambda: trot("yobotics", 55), None),
    "yobotics over steps": (lambda: trot("yobotics", 60, step_length=0.08), "yobotics_terrain"),
}


def sensors(motion: JointMotion) -> dict[str, dict[str, Any]]:
    """Return good sensors and worn ones of several seeds, and two estimates on each: without forces and with them."""
    assert motion.model.feet is not None
    feet = {link: f"at_{link}" for link in motion.model.feet.kind(motion.feet).links}
    found: dict[str, dict[str, Any]] = {
        name: {"kind": "force", "body": link} for link, name in feet.items()
    }
    found["true"] = {"kind": "frame", "frame": motion.model.root}
    for name, kinds in {"good": GOOD, **{f"worn_{seed}": WORN for seed in range(SEEDS)}}.items():
        seed = int(name.rpartition("_")[2]) if name != "good" else 0
        reads = {kind: f"{name}_{kind}" for kind in kinds}
        found |= {
            reads[kind]: {"kind": kind, "seed": seed, **errors} for kind, errors in kinds.items()
        }
        found[name] = {"kind": "leg_odometry", "reads": reads}
        found[f"{name}_forces"] = {"kind": "leg_odometry", "reads": {**reads, **feet}}
    return found


def errors(result: Mapping[str, Vector], name: str, late: int) -> list[float]:
    """Return how an estimate errs.

    Returns:
        the velocity against that of the moment of the samples, and against the moment at which a loop
        reads it, rms [mm/s]; the place at the end, of
        the way [%]; the height at most [mm].
    """

    def columns(start: str, ends: str = "xyz") -> Vector:
        return np.column_stack([result[f"{start}{end}"] for end in ends])

    def rms(off: Vector) -> float:
        return float(1e3 * np.sqrt((off**2).sum(axis=1).mean()))

    place, speed, told = (
        columns("base."),
        columns("frame.true.v"),
        columns(f"base_velocity.{name}.v"),
    )
    off = columns(f"base_pose.{name}.") - place
    way = np.linalg.norm(np.diff(place[:: RATE // 2, :2], axis=0), axis=1).sum()
    drift = 100 * np.linalg.norm(off[-1, :2]) / way
    return [
        rms(told[late:] - speed[:-late]),
        rms(told[:-1] - speed[1:]),
        float(drift),
        float(1e3 * np.abs(off[:, 2]).max()),
    ]


def main(names: list[str]) -> None:
    """Walk and print."""
    for name in names or MOTIONS:
        plan, station = MOTIONS[name]
        motion = plan()
        own = {f"sensors.{sensor}": section for sensor, section in sensors(motion).items()}
        result = simulate(
            motion.station({**own, "sample_rate": RATE}, name=station),
            reference=motion.trajectory(),
            progress=False,
        )
        print(
            name,
            f"{result.times[-1]:.0f} s, {result['base.x'][-1]:.2f} {result['base.y'][-1]:.2f} m",
        )
        for forces in ("", "_forces"):
            good = errors(result, f"good{forces}", 1)
            worn = np.array([errors(result, f"worn_{seed}{forces}", 3) for seed in range(SEEDS)])
            shown = [f"{one:.2f}" for one in good], [f"{one:.2f}" for one in worn.mean(axis=0)]
            print(f"  {forces}", *shown, "worst", worn.max(axis=0).round(2), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
