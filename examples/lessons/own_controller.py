"""Lesson 2, a controller of your own: the integral that the servos of an arm lack."""

from __future__ import annotations

from typing import Any

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock


class Integral(SampledBlock):
    """Adds to the servos what a lasting error asks for.

    Ports, wired by their names: in ``reference``, ``position`` (6) [rad]; out ``feedforward`` (6) [N·m].
    """

    def __init__(self, *, gain: float = 2000.0) -> None:
        """Integrate 100 times a second; ``gain`` [N·m/(rad·s)] says how fast."""
        super().__init__(
            period=0.01,
            reads={"reference": 6, "position": 6},
            memory={"feedforward": np.zeros(6)},
            gives=("feedforward",),
        )
        self.parameters = {"gain": gain}

    def sample(self, memory: Any, read: Any) -> dict[str, Any]:
        """Return what changes in the memory."""
        error = read["reference"] - read["position"]
        return {
            "feedforward": memory["feedforward"] + self.period * self.parameters["gain"] * error
        }


def main() -> None:
    """Run the arm without and with the controller, and keep the second run."""
    station = load_station("irb120_dynamic", {"servo.kd": 50})
    for name, blocks in {"servos alone": [], "with the integral": [Integral()]}.items():
        result = simulate(station, blocks=blocks, duration=4.0, progress=False)
        error = np.rad2deg(np.abs(result.axes("q")[-1] - result.axes("q_ref")[-1]).max())
        print(f"{name}: {error:.3f} degrees off at the end")
    result.save("runs/lesson_2", force=True)


if __name__ == "__main__":
    main()
