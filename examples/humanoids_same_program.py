"""Run one program on three humanoids side by side: left arm and right leg ahead, in SimRob's names of the joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import LeggedRobot, Program, SimulationResult, Workcell
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure

PROGRAM = Program.model_validate(
    {
        "description": "left arm and right leg ahead",
        "moves": [{"target_deg": {"HomIF": 30, "CadDF": 30}, "duration": 1}],
    }
)


def run() -> tuple[SimulationResult, list[LeggedRobot]]:
    """Return the run of all three at once, and the robots."""
    cell = Workcell("three_humanoids")
    robots = [LeggedRobot(cell, name) for name in cell.config.robots]
    planned = {robot.name: robot.reference_of(PROGRAM) for robot in robots}
    duration = max(time for _, time in planned.values())
    return cell.follow(
        {name: reference for name, (reference, _) in planned.items()}, duration
    ), robots


def ways(result: SimulationResult, robot: LeggedRobot, tool: str) -> np.ndarray:
    """Return how far a tool went ahead and up over time, shape (m, 2) [m]; all three face the world's -y."""
    places = (
        robot.pose(tool, result.axes("q", robot.name))[:, :3]
        - robot.pose(tool, np.zeros(len(robot.axes)))[:3]
    )
    return np.column_stack([-places[:, 1], places[:, 2]])


def main() -> None:
    """Save plots of the hands' and feet's ways and of the torques, and the run."""
    result, robots = run()
    names = [robot.name for robot in robots]
    title = "one program on three humanoids"
    figure, frames = panels(title, 2, 3, size=(11, 6), titles=names, sharex=True, sharey="row")
    for (way_panel, torque_panel), robot in zip(frames.T, robots, strict=True):
        for tool, colour in zip(("left_hand", "right_foot"), COLOURS, strict=False):
            ahead, up = 1e3 * ways(result, robot, tool).T
            way_panel.plot(result.times, ahead, color=colour, label=f"{tool}, ahead")
            way_panel.plot(result.times, up, "--", color=colour, label=f"{tool}, up")
            print(f"{robot.name:10} {tool:10} {ahead[-1]:4.0f} mm ahead, {up[-1]:3.0f} mm up")
        for axis, colour in zip(
            ("left_shoulder_pitch", "right_hip_pitch"), COLOURS[2:], strict=False
        ):
            torque_panel.plot(
                result.times,
                result[f"{robot.name}.tau.{axis}"],
                color=colour,
                label=f"{axis}, torque",
            )
        torque_panel.set_xlabel("time [s]")
    frames[0, 0].set_ylabel("way [mm]")
    frames[1, 0].set_ylabel("torque [N·m]")
    file = save_figure(figure, Path("runs/humanoids_same_program.png"))
    print(f"plot in {file}, files in {result.save()}")


if __name__ == "__main__":
    main()
