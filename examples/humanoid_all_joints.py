"""Move all joints of the humanoid by 30 degrees, held by its trunk; the torques are computed (thesis p. 64)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import LeggedRobot, SimulationResult
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure

LOOKS = {
    "right": ("-", COLOURS[0], 2.5),
    "left": ("--", COLOURS[1], 1.5),
    "neck": ("-", COLOURS[2], 2.0),
}


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
    title = "torques of the humanoid, held by its trunk, while all 18 joints go to 30 degrees in a second"
    figure, frames = panels(title, 2, 5, size=(13, 5.5), titles=joints, sharex=True)
    by_joint = dict(zip(joints, frames.flat, strict=True))
    for axis in axes:
        side, _, joint = axis.partition("_")
        style, colour, width = LOOKS[side]
        panel = by_joint[joint if side in ("right", "left") else axis]
        panel.plot(
            result.times, result[f"tau.{axis}"], style, color=colour, linewidth=width, label=side
        )
    figure.supxlabel("time [s]", fontsize=10)
    figure.supylabel("torque [N·m]", fontsize=10)
    return save_figure(figure, file)


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
