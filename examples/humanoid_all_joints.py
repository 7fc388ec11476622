"""Move all joints of the humanoid by 30 degrees, held by its trunk; the torques are computed (thesis p. 64)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from simrob_drake import LeggedRobot, SimulationResult

SIDES = {"right": "#1f6fb4", "left": "#e08214", "neck": "#1b7837"}


def run() -> SimulationResult:
    """Go to 30 degrees on all joints in a second, and stay there for half of one."""
    robot = LeggedRobot("humanoid_fixed")
    robot.add_move(dict.fromkeys(robot.axes, 30.0), 1.0)
    robot.add_move(dict.fromkeys(robot.axes, 30.0), 0.5)
    return robot.simulate()


def main() -> None:
    """Save a plot of angles and torques, and print who works hardest."""
    result = run()
    robot = result.plant.robots["robot"]
    figure, (angles, torques) = plt.subplots(2, 1, figsize=(7, 7), sharex=True)
    for axis in robot.axes:
        colour = SIDES[axis.split("_")[0]]
        angles.plot(result.times, np.rad2deg(result[f"q.{axis}"]), color=colour)
        torques.plot(result.times, result[f"tau.{axis}"], color=colour)
    for side, colour in SIDES.items():
        torques.plot([], [], color=colour, label=side)
    angles.set(ylabel="position [deg]", title="all joints to 30 degrees, held by the trunk")
    torques.set(xlabel="time [s]", ylabel="torque [N·m]")
    torques.legend()
    figure.tight_layout()
    figure.savefig("humanoid_all_joints.png", dpi=120)
    plt.close(figure)
    peaks = np.abs(result.axes("tau")).max(axis=0)
    for index in np.argsort(-peaks)[:4]:
        print(
            f"{robot.axes[index]:20} {peaks[index]:.3f} N·m at most, {result.axes('tau')[-1, index]:+.3f} N·m to stay"
        )
    print("plot in humanoid_all_joints.png")


if __name__ == "__main__":
    main()
