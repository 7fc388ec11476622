"""Two arms in one station, each with a reference of its own, given in Python."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate


def run(*, duration: float = 3.0) -> SimulationResult:
    """Let the left arm wave and the right one bow."""
    times = np.linspace(0.0, duration, 61)
    wave = np.outer(np.sin(2.0 * times) ** 2, [0.8, 0.0, -0.4, 0.0, 0.6, 0.0])
    bow = np.outer(np.minimum(times / duration, 1.0), [0.0, 0.5, 0.2, 0.0, 0.6, 0.0])
    return simulate(
        load_station("two_irb120"),
        reference={"left": (times, wave), "right": (times, bow)},
        duration=duration,
    )


def main() -> None:
    """Print where both ended."""
    result = run()
    for robot in ("left", "right"):
        print(robot, "ends at", np.rad2deg(result.axes("q", robot)[-1]).round(1), "deg")


if __name__ == "__main__":
    main()
