"""How far the robots walk in a minute, with two lengths of steps: the table of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.walking [NAME]...``; it takes some minutes.
"""

import sys
from collections.abc import Callable

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, crawl, three_legs, trot
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.gaits.sequences import march
from simrob_drake.results.record.walks import locomotion


def steps_within(seconds: float, robot: str, name: str) -> int:
    """Return how many steps of a walk end, with standing still, within a time [s]."""
    figures = load_gaits(robot).walks[name]
    return (
        int((seconds - 2 * figures.settle - figures.rest) / figures.step_time)
        - figures.ramp_steps
        - 1
    )


def biped(robot: str, name: str) -> Callable[[], JointMotion]:
    return lambda: walk(robot, steps_within(60.0, robot, name), name)


WALKS: dict[str, Callable[[], JointMotion]] = {
    "humanoid walk": biped("humanoid", "walk"),
    "humanoid real_sole": biped("humanoid", "real_sole"),
    "humanoid march": lambda: march("humanoid", 11),
    "roid1 walk": biped("roid1", "walk"),
    "zjudancer walk": biped("zjudancer", "walk"),
    "yobotics trot": lambda: trot("yobotics", 106),
    "yobotics fast": lambda: trot("yobotics", 106, "fast"),
    "yobotics crawl": lambda: crawl("yobotics", 54),
    **{
        f"yobotics {foot}": (lambda foot=foot: three_legs("yobotics", foot=foot))
        for foot in CRAWL_ORDER
    },
}
STEPS: dict[str, dict[str, object]] = {
    "its own steps of 5 ms": {},
    "steps of 2.5 ms": {"solver.max_step": 0.0025},
}
SAP = {"solver": {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}, "duration": 12.0}
"""For torques: it sees a moving reference at every millisecond."""


def line(result: SimulationResult) -> str:
    found = locomotion(result)
    state = "upright" if found.upright else f"fell at {found.fall_time:.1f} s"
    torque = f"{found.peak_torque['ratio']:4.0%}, {found.saturated:4.1%} at it"
    return (
        f"{result.stop_time:5.1f} s | {found.ahead:6.2f} m | {found.drift:6.2f} m | {np.rad2deg(found.yaw):6.1f}° | "
        f"{np.rad2deg(found.tilt):4.1f}° | {state} | {torque} | {result.realtime_rate:4.1f} ×"
    )


def main(names: list[str]) -> None:
    """Walk and print."""
    for name in names or WALKS:
        motion = WALKS[name]()
        for setting, overrides in {**STEPS, "SAP 1 ms": SAP}.items():
            result = simulate(
                motion.station(overrides), reference=motion.trajectory(), progress=False
            )
            print(f"{name} | {setting} | {line(result)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
