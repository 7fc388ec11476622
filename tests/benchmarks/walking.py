"""How far the robots walk in a minute, at two solver settings: the table of docs/walking.md.

Run it with ``python -m tests.benchmarks.walking [NAME]...``; it takes some minutes.
"""

import sys
from collections.abc import Callable

from simrob_drake import simulate
from simrob_drake.programs.gaits.measures import Journey, journey
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, crawl, three_legs, trot
from simrob_drake.programs.gaits.sequences import march
from simrob_drake.programs.gaits.walk import walk


def steps_within(seconds: float, robot: str, name: str) -> int:
    """Return how many steps of a walk end, with standing still, within a time [s]."""
    figures = load_gaits(robot).walks[name]
    return int((seconds - 2 * figures.settle - figures.rest) / figures.step_time)


def biped(robot: str, name: str) -> Callable[[], JointMotion]:
    return lambda: walk(robot, steps_within(60.0, robot, name), name)


WALKS: dict[str, Callable[[], JointMotion]] = {
    "humanoid walk": biped("humanoid", "walk"),
    "humanoid real_sole": biped("humanoid", "real_sole"),
    "humanoid march": lambda: march("humanoid", 12),
    "roid1 walk": biped("roid1", "walk"),
    "zjudancer walk": biped("zjudancer", "walk"),
    "yobotics trot": lambda: trot("yobotics", 111),
    "yobotics fast": lambda: trot("yobotics", 111, "fast"),
    "yobotics crawl": lambda: crawl("yobotics", 54),
    **{f"yobotics {foot}": (lambda foot=foot: three_legs("yobotics", foot=foot)) for foot in CRAWL_ORDER},
}
CENIC = {
    "cenic 10 ms": {"solver.max_step": 0.01, "solver.accuracy": 1e-3},
    "cenic 5 ms": {"solver.max_step": 0.005, "solver.accuracy": 5e-4},
}
SETTINGS = {
    **dict.fromkeys(WALKS, CENIC),
    "yobotics fast": {
        "cenic 5 ms": CENIC["cenic 5 ms"],
        "cenic 2.5 ms": {"solver.max_step": 0.0025, "solver.accuracy": 2.5e-4},
    },
}
SAP = {"solver": {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}, "duration": 12.0}
"""For torques: it sees a moving reference at every millisecond."""


def line(walked: Journey, rate: float) -> str:
    state = "upright" if walked.upright else f"fell at {walked.fell_at:.1f} s"
    return (
        f"{walked.seconds:5.1f} s | {walked.ahead:6.2f} m | {walked.left:6.2f} m | {walked.yaw_deg:6.1f}° | "
        f"{walked.tilt_deg:4.1f}° | {state} | {walked.torque_share:4.0%}, {walked.saturated:4.1%} at it | {rate:4.1f} ×"
    )


def main(names: list[str]) -> None:
    """Walk and print."""
    for name in names or WALKS:
        motion = WALKS[name]()
        facing = load_gaits(motion.model).facing_deg
        for setting, overrides in {**SETTINGS[name], "SAP 1 ms": SAP}.items():
            result = simulate(motion.station(overrides), reference=motion.trajectory(), progress=False)
            print(f"{name} | {setting} | {line(journey(result, facing), result.realtime_rate)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
