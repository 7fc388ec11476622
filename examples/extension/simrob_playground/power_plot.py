"""Plot of the mechanical power of each joint over time, for every run of a robot with motors."""

import numpy as np
from matplotlib.figure import Figure

from simrob_drake.results.plots.own import panels
from simrob_drake.results.record.run import RecordedRun


def power_plot(run: RecordedRun) -> Figure | None:
    """Draw the power of the joints of each robot [W], one frame for each robot.

    Returns None if the station has no robot, or a kinematic one, whose joints have no motors.
    """
    robots = run.plant.robots
    if not robots or run.config.mode == "kinematic":
        return None
    titles = [f"power of the joints of {name} [W]" for name in robots]
    figure, frames = panels(
        "mechanical power", rows=len(robots), size=(7.2, 2.6 * len(robots)), titles=titles
    )
    for frame, (name, robot) in zip(frames[:, 0], robots.items(), strict=True):
        power = np.multiply(run.axes("tau", name), run.axes("v", name))
        for column, axis in zip(power.T, robot.axes, strict=True):
            frame.plot(run.times, column, label=axis)
        frame.set_xlabel("time [s]")
    return figure
