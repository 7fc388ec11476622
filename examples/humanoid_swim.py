"""Swim: the humanoid held by its trunk, face down, strokes its arms and kicks (thesis p. 115)."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.programs.gaits.sequences import posing

FACE_DOWN = [0, 0, 0.3, 0, 0, np.pi / 2]  # turned about x: it looks down, and its head points to -y


def run() -> SimulationResult:
    """Swim four strokes and return the run."""
    motion = posing("humanoid", "swim")
    held = {"robot.base": FACE_DOWN, "inputs": [], "duration": motion.duration}
    return simulate(motion.station(held, name="humanoid_fixed"), reference=motion.trajectory())


def main() -> None:
    """Print what it takes, and where the files are."""
    result = run()
    print(f"largest torque {np.abs(result.axes('tau')).max():.2f} N·m of 3")
    print("files in", result.save())


if __name__ == "__main__":
    main()
