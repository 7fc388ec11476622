"""Run one program by motion and by torque, without and with a feedforward, and plot the ways of the tool together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import Arm, SimulationResult, load_station
from simrob_drake.results.plots.own import panels, save_figure

DOWN = [0.0, 0.0, np.pi]
TABLE = "inclined_table"
STATIONS = {
    "kinematic": {"mode": "kinematic"},
    "dynamic": {"mode": "dynamic", "servo.feedforward": "none"},
    "dynamic, with feedforward": {"mode": "dynamic", "servo.feedforward": "inverse_dynamics"},
}


def program(arm: Arm) -> list[SimulationResult]:
    """Go to the table, along two sides of a square, and back on an arc, 20 mm above the table."""
    arm.move_j([0.1, 0.1, 0.02, *DOWN], wobj=TABLE)
    arm.wait(0.5)
    return [
        arm.move_l([[0.2, 0.1, 0.02], [0.2, 0.2, 0.02]], wobj=TABLE, speed=0.2),
        arm.move_c([0.1293, 0.1707, 0.02], [0.1, 0.1, 0.02], wobj=TABLE, duration=1.5),
    ]


def run() -> dict[str, np.ndarray]:
    """Return the way of the pencil's tip on the table in each station, shape (k, 3) [m], sampled alike."""
    ways = {}
    for name, changes in STATIONS.items():
        arm = Arm(load_station("irb120_workcell", changes), tool="pencil")
        table = arm.cell.frame(TABLE).inverse()
        ways[name] = np.vstack([(table @ move.pose("tcp")[:, :3].T).T for move in program(arm)])
    return ways


def main() -> None:
    """Save the picture, and print how far each dynamic arm strays."""
    ways = run()
    figure, ((top,), (side,)) = panels(
        "one drawing, by three stations", 2, size=(7, 7), height_ratios=[3, 1]
    )
    for name, way in ways.items():
        top.plot(*(1e3 * way[:, :2].T), label=name)
        side.plot(1e3 * way[:, 2], label=name)
    top.set(xlabel="x on the table [mm]", ylabel="y [mm]", aspect="equal")
    side.set(xlabel="sample", ylabel="height [mm]")
    file = save_figure(figure, Path("runs/irb120_same_program.png"))
    for name, way in list(ways.items())[1:]:
        off = 1e3 * np.linalg.norm(way - ways["kinematic"], axis=1)
        print(f"{name}: {off.mean():.2f} mm off on average, {off.max():.2f} mm at most")
    print(f"plain servos know neither weight nor speed; all ways in {file}")


if __name__ == "__main__":
    main()
