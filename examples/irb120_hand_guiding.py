"""Guide an arm by hand: push it, it follows; let go, it stays. The force felt is that applied."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure

PUSHES = {
    "aside": {"kind": "push", "start": 0.5, "duration": 0.5, "force": [0, 2, 0]},
    "back": {"kind": "push", "start": 3.0, "duration": 0.5, "force": [-2, 0, 0]},
}  # N, along the tool's axes
FINE = {
    "solver.accuracy": 1e-3,
    "solver.max_step": 0.02,
}  # the estimate is as true as the steps are fine


def run(*, admittance_gain: float = 1000.0, duration: float = 6.0) -> SimulationResult:
    """Push the collaborative arm twice; ``admittance_gain`` 0 makes it stiff."""
    overrides = {
        **FINE,
        "servo.admittance_gain": admittance_gain,
        "forces": {},  # the station's own, taken away
        **{f"forces.{name}": push for name, push in PUSHES.items()},
        "sensors": {"hand": {"kind": "external_torque"}},
    }
    return simulate(load_station("irb120_cobot", overrides), duration=duration, progress=False)


def picture(result: SimulationResult, file: Path) -> Path:
    """Draw the force felt against the force applied, and where the tool went."""
    figure, ((force,), (path,)) = panels(
        "an arm that is guided by hand", 2, size=(10, 7), sharex=True
    )
    felt, tool = result.vector("external_force.hand"), result.pose("tcp")
    applied = result.vector("applied_force.aside") + result.vector("applied_force.back")
    for axis, colour in enumerate(COLOURS[:3]):
        force.plot(
            result.times, applied[:, axis], "--", color=colour, label=f"applied {'xyz'[axis]}"
        )
        force.plot(result.times, felt[:, axis], color=colour, label=f"felt {'xyz'[axis]}")
        path.plot(
            result.times, 1e3 * (tool[:, axis] - tool[0, axis]), color=colour, label="xyz"[axis]
        )
    force.set_ylabel("force at the tool, in its axes [N]")
    path.set_ylabel("way of the tool [mm]")
    path.set_xlabel("time [s]")
    return save_figure(figure, file, beside=True)


def main() -> None:
    """Print how far each push moved the arm, stiff and with admittance, and draw the second."""
    for gain in (0.0, 1000.0):
        result = run(admittance_gain=gain)
        tool = result.pose("tcp")[:, :3]
        at = [round(time * result.config.sample_rate) for time in (0.5, 3.0, 6.0)]
        ways = [1e3 * float(np.linalg.norm(tool[end] - tool[start])) for start, end in pairwise(at)]
        print(
            f"gain {gain:4.0f} 1/s: the pushes moved the tool by {ways[0]:.0f} and {ways[1]:.0f} mm"
        )
    print(picture(result, Path("runs/irb120_hand_guiding.png")))


if __name__ == "__main__":
    main()
