"""Move all joints of the humanoid by 30 degrees, held by its trunk; the torques are computed (thesis p. 64)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from simrob_drake import LeggedRobot, SimulationResult

LOOKS = {"right": ("-", "#1f6fb4", 2.5), "left": ("--", "#e08214", 1.5), "neck": ("-", "0.35", 2.0)}


def run() -> SimulationResult:
    """Go to 30 degrees on all joints in a second, and stay there for half of one."""
    robot = LeggedRobot("humanoid_fixed")
    robot.add_move(dict.fromkeys(robot.axes, 30.0), 1.0)
    robot.add_move(dict.fromkeys(robot.axes, 30.0), 0.5)
    return robot.simulate()


def picture(result: SimulationResult, file: Path) -> Path:
    """Draw the torques, a panel for each joint: the left one dashed over the right one."""
    axes = result.plant.robots["robot"].axes
    joints = list(dict.fromkeys(axis.removeprefix("right_").removeprefix("left_") for axis in axes))
    figure = Figure(figsize=(13, 5.5), layout="constrained")
    panels = dict(zip(joints, figure.subplots(2, 5, sharex=True).flat, strict=True))
    lines = {}
    for axis in axes:
        side, _, joint = axis.partition("_")
        style, colour, width = LOOKS[side]
        panel = panels[joint if side in ("right", "left") else axis]
        (lines[side],) = panel.plot(result.times, result[f"tau.{axis}"], style, color=colour, linewidth=width)
    for joint, panel in panels.items():
        panel.set_title(joint, fontsize=10)
        panel.grid(color="0.9")
    figure.suptitle("Torques of the humanoid, held by its trunk, while all 18 joints go to 30 degrees in a second")
    figure.supxlabel("time [s]", fontsize=10)
    figure.supylabel("torque [N·m]", fontsize=10)
    figure.legend(lines.values(), lines.keys(), loc="outside lower right", ncols=3)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    return file


def main() -> None:
    """Print who works hardest, and draw the torques of all joints."""
    result = run()
    robot = result.plant.robots["robot"]
    peaks = np.abs(result.axes("tau")).max(axis=0)
    for index in np.argsort(-peaks)[:4]:
        print(
            f"{robot.axes[index]:20} {peaks[index]:.3f} N·m at most, {result.axes('tau')[-1, index]:+.3f} N·m to stay"
        )
    print(picture(result, Path("runs/humanoid_all_joints.png")))


if __name__ == "__main__":
    main()
