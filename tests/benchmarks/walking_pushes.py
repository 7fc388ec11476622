"""The largest push of 0.1 s that each robot withstands while it walks: a table of docs/walking.md.

Run it with ``python -m tests.benchmarks.walking_pushes [NAME]...``; it takes some minutes.
"""

import sys

import numpy as np

from simrob_drake import simulate
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.feet import facing_rotation
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import crawl, trot

STARTS = (3.0, 3.1, 3.2, 3.3)
"""Moments of the push, some in each phase of a step [s]; the weakest counts."""
SIDES = {"forward": (1, 0), "backward": (-1, 0), "left": (0, 1), "right": (0, -1)}
STEPS = {"solver.max_step": 0.01, "solver.error_control": True}
CLOSE = 0.12  # of the force: where the bisection ends


def survives(motion: JointMotion, facing: float, side: tuple[int, int], force: float) -> bool:
    """Return whether a robot stays on its feet, pushed at any of the moments."""
    along = facing_rotation(-facing) @ np.array([*side, 0.0])
    for start in STARTS:
        push = {"kind": "push", "start": start, "force": [float(part) for part in force * along]}
        config = motion.station({"forces.push": push, "duration": 5.0, **STEPS})
        if simulate(config, reference=motion.trajectory(), progress=False).stopped_by is not None:
            return False
    return True


def largest(motion: JointMotion, facing: float, side: tuple[int, int], guess: float) -> float:
    """Return the largest push by bisection [N]."""
    low, high = 0.0, guess
    while survives(motion, facing, side, high):
        low, high = high, 2 * high
    while high - low > CLOSE * high:
        middle = (low + high) / 2
        low, high = (middle, high) if survives(motion, facing, side, middle) else (low, middle)
    return low


def main(names: list[str]) -> None:
    """Push and print."""
    motions = {
        "humanoid walk": (walk("humanoid", 16), 8.0),
        "humanoid real_sole": (walk("humanoid", 16, "real_sole"), 6.0),
        "roid1 walk": (walk("roid1", 26), 4.0),
        "zjudancer walk": (walk("zjudancer", 16), 16.0),
        "yobotics trot": (trot("yobotics", 25), 80.0),
        "yobotics crawl": (crawl("yobotics", 14), 80.0),
    }
    for name in names or motions:
        motion, guess = motions[name]
        facing = load_gaits(motion.model).facing_deg
        found = [f"{largest(motion, facing, side, guess):.1f} N" for side in SIDES.values()]
        print(name, *found, sep=" | ", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
