"""The plot of a walk: how the base of a robot went, tilted and turned, and its path seen from above."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.grid import Curve, Plot, Stack, grid_figure, style, trusted
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.walks import headings, tilts

_WIDTH, _LEFT, _RIGHT = 11.0, 0.95, 5.2  # inches: of the figure, and where the path begins and ends beside the curves
_X, _Y, _Z, _FACING, _TILT, *_ = COLOURS
_PATH = "0.35"
_NARROWEST = 0.1  # m: a robot that stands is not shown trembling
_ARROWS = 8  # along the path
_ARROW = 0.07  # of the picture's width


def base_figure(result: RecordedRun, robot: StationRobot, title: str) -> Figure:
    """Draw x, y and z of a robot's base [m], its tilt and yaw [deg], and its path seen from above.

    The tilt is the angle of the root's z axis from the vertical, and the yaw how far it turned to the left.
    """
    pose = result.pose("base", robot.name)
    heading = headings(result.plant, robot, pose)
    yaw = np.rad2deg(heading - heading[0])
    plots = [
        Plot("x, y [m]", [Curve(pose[:, 0], "x", _X), Curve(pose[:, 1], "y", _Y)]),
        Plot("height z [m]", [Curve(pose[:, 2], "z", _Z)]),
        Plot("tilt [deg]", [Curve(np.rad2deg(tilts(pose)), "tilt", _TILT)]),
        Plot("yaw [deg]", [Curve(yaw, "yaw", _FACING)]),
    ]
    figure = grid_figure(result, title, [Stack("over time", plots)], width=_WIDTH, legend=_RIGHT + 0.2)
    first, last = (figure.axes[place].get_position() for place in (0, -1))
    inch = 1 / figure.get_size_inches()[0]
    area = first.x1 + _LEFT * inch, last.y0, (_RIGHT - _LEFT) * inch, first.y1 - last.y0
    _draw_path(figure.add_axes(area), trusted(result, pose[:, :2].T), heading)
    return figure


def _draw_path(axes: Axes, path: Vector, heading: Vector) -> None:
    """Draw the path (2, m) [m] with arrows that show where the robot faced."""
    style(axes, "seen from above")
    frame = axes.get_window_extent()
    low, high = path.min(axis=1), path.max(axis=1)
    size = np.array([frame.width, frame.height]) / frame.width
    span = max(1.25 * float(((high - low) / size).max()), _NARROWEST)  # m, across the picture
    left_bottom, right_top = (low + high - span * size) / 2, (low + high + span * size) / 2
    axes.set(xlim=(left_bottom[0], right_top[0]), ylim=(left_bottom[1], right_top[1]), aspect="equal")
    axes.plot(*path, color=_PATH, linewidth=1.4)
    shown = np.unique(np.linspace(0, path.shape[1] - 1, _ARROWS).astype(int))
    arrows = _ARROW * span * np.array([np.cos(heading[shown]), np.sin(heading[shown])])
    looks: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.005}
    axes.quiver(*path[:, shown], *arrows, color=_FACING, **looks)
    axes.plot(*path[:, :1], "o", color=_PATH, markerfacecolor="white", label="start")
    axes.plot(*path[:, -1:], "s", color=_PATH, label="end")
    axes.plot([], [], marker=">", markersize=7, linestyle="", color=_FACING, label="faces")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=8, borderaxespad=0.0)
