"""Run one program on the kinematic and on the dynamic station, and plot both ways of the tool together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import Arm, SimulationResult, load_station
from simrob_drake.results.plots.own import panels, save_figure

DOWN = [0.0, 0.0, np.pi]
TABLE = "inclined_table"


def program(arm: Arm) -> list[SimulationResult]:
    """Go to the table, along two sides of a square, and back on an arc, 20 mm above the table."""
    arm.move_j([0.1, 0.1, 0.02, *DOWN], wobj=TABLE)
    arm.wait(0.5)
    return [
        arm.move_l([[0.2, 0.1, 0.02], [0.2, 0.2, 0.02]], wobj=TABLE, speed=0.2),
        arm.move_c([0.1293, 0.1707, 0.02], [0.1, 0.1, 0.02], wobj=TABLE, duration=1.5),
    ]


def run() -> dict[str, np.ndarray]:
    """Return the way of the pencil's tip on the table by mode of the station, shape (k, 3) [m], sampled alike."""
    ways = {}
    for mode in ("kinematic", "dynamic"):
        arm = Arm(load_station("irb120_workcell", {"mode": mode}), tool="pencil")
        table = arm.cell.frame(TABLE).inverse()
        ways[mode] = np.vstack([(table @ move.pose("tcp")[:, :3].T).T for move in program(arm)])
    return ways


def main() -> None:
    """Save the picture, and print how far the dynamic arm strays."""
    ways = run()
    deviation = np.linalg.norm(ways["dynamic"] - ways["kinematic"], axis=1)
    title = "one drawing, by two stations"
    figure, ((top,), (side,)) = panels(title, 2, size=(7, 7), height_ratios=[3, 1])
    for mode, way in ways.items():
        top.plot(*(1e3 * way[:, :2].T), label=mode)
        side.plot(1e3 * way[:, 2], label=mode)
    top.set(xlabel="x on the table [mm]", ylabel="y [mm]", aspect="equal")
    side.set(xlabel="sample", ylabel="height [mm]")
    file = save_figure(figure, Path("runs/irb120_same_program.png"))
    print(f"the dynamic arm is {1e3 * deviation.mean():.1f} mm off on average, {1e3 * deviation.max():.1f} mm at most:")
    print(f"its servos know neither weight nor speed; both ways in {file}")


if __name__ == "__main__":
    main()
