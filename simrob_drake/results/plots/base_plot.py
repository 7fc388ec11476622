"""The plot of a walk: how the base of a robot went, tilted and turned, and its path seen from above."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.panels import fit, head_height, mark_stop, style, trusted, write_head
from simrob_drake.results.record.locomotion import headings
from simrob_drake.results.record.run import RecordedRun

_SIZE = 10.5, 6.0  # inches, without the head
_COLOURS = {"x": "#1f6fb4", "y": "#e08214", "z": "#4d9221", "tilt": "#8c2d7a", "yaw": "#01665e", "path": "0.35"}
_NARROWEST = 0.1  # m: a robot that stands is not shown trembling
_ARROWS = 8  # along the path
_ARROW = 0.07  # of the picture's width


def base_figure(result: RecordedRun, robot: StationRobot, title: str) -> Figure:
    """Draw x, y and z of a robot's base [m], its tilt and yaw [deg], and its path seen from above.

    The tilt is the angle of the root's z axis from the vertical, and the yaw how far it turned to the left.
    """
    pose = result.pose("base", robot.name)
    heading = headings(result.plant, robot, pose)
    tilt = np.rad2deg(np.arccos(np.clip(1.0 - 2.0 * (pose[:, 4] ** 2 + pose[:, 5] ** 2), -1.0, 1.0)))
    figure = Figure(figsize=(_SIZE[0], _SIZE[1] + head_height(result)))
    top = _SIZE[1] / (_SIZE[1] + head_height(result))
    over_time = figure.add_gridspec(4, 1, left=0.075, right=0.5, bottom=0.08, top=top, hspace=0.15)
    rows = [
        ("x, y [m]", 0.01, {"x": pose[:, 0], "y": pose[:, 1]}),
        ("height z [m]", 0.01, {"z": pose[:, 2]}),
        ("tilt [deg]", 1.0, {"tilt": tilt}),
        ("yaw [deg]", 1.0, {"yaw": np.rad2deg(heading - heading[0])}),
    ]
    lines = {}
    for place, (label, smallest, curves) in enumerate(rows):
        axes = figure.add_subplot(over_time[place, 0])
        for name, values in curves.items():
            (lines[name],) = axes.plot(result.times, values, color=_COLOURS[name], linewidth=1.3, label=name)
        style(axes)
        fit(axes, trusted(result, np.array(list(curves.values()))), smallest)
        axes.set_xlim(0.0, 1.04 * result.stop_time or 1.0)
        axes.tick_params(labelbottom=place == len(rows) - 1)
        axes.set_ylabel(label)
        axes.yaxis.set_label_coords(-0.13, 0.5)
        mark_stop(axes, result)
    axes.set_xlabel("time [s]")
    beside = figure.add_gridspec(1, 1, left=0.58, right=0.98, bottom=0.08, top=top)
    lines |= _draw_path(figure.add_subplot(beside[0, 0]), trusted(result, pose[:, :2].T), heading)
    write_head(figure, result, title, lines)
    return figure


def _draw_path(axes: Axes, path: Vector, heading: Vector) -> dict[str, Any]:
    """Draw the path (2, m) [m] with arrows that show where the robot faced; return what the legend explains."""
    style(axes)
    frame = axes.get_window_extent()
    low, high = path.min(axis=1), path.max(axis=1)
    size = np.array([frame.width, frame.height]) / frame.width
    span = max(1.25 * float(((high - low) / size).max()), _NARROWEST)  # m, across the picture
    left_bottom, right_top = (low + high - span * size) / 2, (low + high + span * size) / 2
    axes.set(xlim=(left_bottom[0], right_top[0]), ylim=(left_bottom[1], right_top[1]), aspect="equal")
    (line,) = axes.plot(*path, color=_COLOURS["path"], linewidth=1.4)
    shown = np.unique(np.linspace(0, path.shape[1] - 1, _ARROWS).astype(int))
    arrows = _ARROW * span * np.array([np.cos(heading[shown]), np.sin(heading[shown])])
    looks: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.005}
    axes.quiver(*path[:, shown], *arrows, color=_COLOURS["yaw"], **looks)
    (start,) = axes.plot(*path[:, :1], "o", color=_COLOURS["path"], markerfacecolor="white")
    (end,) = axes.plot(*path[:, -1:], "s", color=_COLOURS["path"])
    (facing,) = axes.plot([], [], marker=r"$\rightarrow$", markersize=12, linestyle="", color=_COLOURS["yaw"])
    axes.set(xlabel="x [m]", ylabel="y [m]")
    return {"path from above": line, "start": start, "end": end, "faces": facing}
