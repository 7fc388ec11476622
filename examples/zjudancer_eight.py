"""ZJUDancer walks an eight, 2 m long, by where its base is: ``python examples/zjudancer_eight.py [LENGTH]`` [m].

The path is made of waypoints under ``controllers.walk.path``; how far the robot gets from it is printed.
"""

from __future__ import annotations

import sys
from math import ceil

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.walking.commands import Path, Waypoints

SPEED = 0.2  # m/s


def waypoints(length: float = 2.0) -> Waypoints:
    """Return an eight that begins at its crossing, half as wide as it is long [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    points = length * np.column_stack([0.25 * np.sin(2.0 * angles), 0.5 * np.sin(angles)])
    return Waypoints.model_validate({"points": points.tolist(), "laps": 1, "speed": SPEED})


def run(length: float = 2.0) -> tuple[SimulationResult, float]:
    """Walk round it once; return the run, and how far the base was from the path at most [m]."""
    way = waypoints(length)
    path = Path(way.corners, way.rounding)
    walk = {"controllers.walk.commands": [], "controllers.walk.path": way.model_dump()}
    duration = ceil(path.length / SPEED + 6.0)
    result = simulate(load_station("zjudancer_walking", walk), duration=duration, progress=False)
    curve = np.array([path.at(along).place for along in np.linspace(0.0, path.length, 2000)])
    x, y = result.pose("base")[::10, :2].T
    return result, float(np.abs((x + 1j * y)[:, np.newaxis] - curve).min(axis=1).max())


def main(length: str = "2") -> None:
    """Print how the walk went, and where its files are."""
    result, off = run(float(length))
    print(f"{result.message}; at most {off:.3f} m beside the path; files in {result.save()}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
