"""The plots of what parts declare, one figure a question.

What has a value for each axis is shown joint by joint, right and left together; the rest panel below panel. What a
controller leaves constant, and axes that hardly move beside the others, are left out and named.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.colours import COLOURS, looks
from simrob_drake.results.plots.grid import Curve, Plot, Stack, smallest
from simrob_drake.results.plots.joint_plots import SideGroup, side_groups
from simrob_drake.results.record.run import RecordedRun

PAPER = 7.16  # the width of a page's text [inches]

_FEW = 4  # columns that share a panel whatever they are
_LITTLE = 0.02  # of the largest change: an axis that moves less is left out
_JUMP = 0.25  # of the whole change: a step from zero right at the start is a loop's first sample
_HEIGHT = 1.8  # inches, of a frame
_ENTRY, _HANDLE, _CHARACTER = 0.18, 0.45, 0.065  # inches: height of a legend's entry, width of its line and letters
_IN_DEGREES = {"rad": ("deg", float(np.rad2deg(1.0)))}  # units that are read in others, and how many one is


@dataclass(frozen=True)
class Sheet:
    """A figure to be drawn: the stem of its file, its title and stacks, and how they are laid out."""

    name: str
    title: str
    stacks: Sequence[Stack]
    layout: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A column of a panel as it is read."""

    name: str  # of the curve
    values: Vector
    unit: str
    needed: bool  # though it is constant

    @property
    def change(self) -> float:
        """From its least to its largest value."""
        return float(np.ptp(_finite(self.values)))

    @property
    def varies(self) -> bool:
        """Whether it is no constant."""
        return self.change > max(smallest(f"[{self.unit}]"), 1e-6 * float(np.abs(_finite(self.values)).max()))

    @property
    def value(self) -> str:
        """Its last value with the unit."""
        value = float(self.values[-1])
        if self.unit == "1":
            return compound("{value:.4g}", value=value)
        return compound("{value:.4g} {unit}", value=value, unit=self.unit)


_Panels = Mapping[Panel, Sequence[_Quantity]]


def panel_sheets(result: RecordedRun) -> Iterator[Sheet]:
    """Yield the figures of a run's panels, such as ``piece_<piece>``, ``sensors`` and ``controller_<name>``.

    Where a figure has panels of both kinds, those by axes are in ``controller_<name>_axes``.
    """
    found = {signal.panel: _quantities(result, signal) for signal in result.signals if signal.panel in result.panels}
    for name in dict.fromkeys(panel.figure for panel in found if panel):
        panels = {panel: ones for panel, ones in found.items() if panel and panel.figure == name}
        title = join_texts(dict.fromkeys(panel.heading for panel in panels))
        by_axis = {panel: robot for panel in panels if (robot := _robot_of(panel, result)) is not None}
        if few := {panel: ones for panel, ones in panels.items() if panel not in by_axis}:
            yield _few_sheet(name, title, few)
        for place, robot in enumerate({robot.name: robot for robot in by_axis.values()}.values()):
            wide = {panel: panels[panel] for panel, of in by_axis.items() if of is robot}
            parts = [name, "axes" if few or place else "", robot.name if place else ""]
            yield _axes_sheet("_".join(filter(None, parts)), title, wide, robot)


def _quantities(result: RecordedRun, signal: Signal) -> list[_Quantity]:
    """Return what the panel of a signal shows; of a loop not what it tells before its first sample."""
    panel, units = signal.panel, dict(zip(signal.names, signal.units, strict=True))
    assert panel is not None
    found = []
    for column, name in zip(panel.columns, panel.components or map(_part, panel.columns), strict=True):
        unit, scale = _IN_DEGREES.get(units[column], (units[column], 1.0))
        values, own = scale * result[column], signal.role == "own"
        if own and len(values) > 1 and values[0] == 0 and abs(values[1]) > _JUMP * np.ptp(_finite(values)):
            values[0] = np.nan
        found.append(
            _Quantity(
                compound("{title} {name}", title=panel.title, name=name) if name.isdecimal() else name,
                values,
                unit,
                not own,
            )
        )
    return found


def _robot_of(panel: Panel, result: RecordedRun) -> StationRobot | None:
    """Return the robot whose axes a panel of many curves tells."""
    parts = {_part(column) for column in panel.columns}
    robots = result.plant.robots.values() if len(parts) > _FEW else ()
    return next((robot for robot in robots if parts <= set(robot.axes)), None)


def _few_sheet(name: str, title: str, panels: _Panels) -> Sheet:
    """Return the figure of panels below each other; what a controller leaves constant stands above in words."""
    varying = {panel: [one for one in ones if one.needed or one.varies] for panel, ones in panels.items()}
    shown = {panel: ones for panel, ones in varying.items() if ones} or panels
    constant = [
        join_texts([panel.title, one.name, one.value] if len(ones) > 1 else [panel.title, one.value], " ")
        for panel, ones in panels.items()
        for one in ones
        if one not in shown.get(panel, ())
    ]
    names = [one.name for ones in shown.values() if len(ones) > 1 for one in ones]
    legend = _HANDLE + _CHARACTER * max(map(len, names), default=0)
    remark = ""
    if constant:
        remark = message(
            "results.left_out_constant", "left out, as it does not change: {values}", values=join_texts(constant)
        )
    stacks = [_stack(panel, ones) for panel, ones in shown.items()]
    return Sheet(name, title, stacks, {"columns": 1, "width": PAPER, "legend": legend, "remark": remark})


def _stack(panel: Panel, ones: Sequence[_Quantity]) -> Stack:
    """Return a panel, with a plot for each unit."""
    first = 1.4 if len(ones) > 1 else 1.0  # weight of a line; later ones are thinner: equal ones are all seen
    curves = [
        Curve(one.values, one.name, colour, max(first - 0.3 * place, 0.8), line)
        for place, (one, (colour, line)) in enumerate(zip(ones, looks(len(ones)), strict=True))
    ]
    plots = []
    for unit in dict.fromkeys(one.unit for one in ones):
        drawn = [curve for curve, one in zip(curves, ones, strict=True) if one.unit == unit]
        plots.append(Plot(_label(panel, unit), drawn, max(_HEIGHT, _ENTRY * len(drawn))))
    return Stack(panel.title, plots)


def _axes_sheet(name: str, title: str, panels: _Panels, robot: StationRobot) -> Sheet:
    """Return the figure of a robot's axes, right and left together, with a plot for each panel."""
    changing = {panel: ones for panel, ones in panels.items() if any(one.varies for one in ones)} or panels
    moved = set[str]()
    for ones in changing.values():
        least = _LITTLE * max(one.change for one in ones)
        moved |= {one.name for one in ones if one.varies and one.change > least}
    named = {one.name for ones in panels.values() for one in ones}
    groups = {group: {robot.axes[place] for place in group.places.values()} for group in side_groups(robot)}
    groups = {group: axes for group, axes in groups.items() if axes & named}
    moving = [group for group, axes in groups.items() if axes & moved] or list(groups)
    still: list[str] = [group.name for group in groups if group not in moving]
    still += [
        message("results.of_every_axis", "{title} of every axis", title=panel.title)
        for panel in panels
        if panel not in changing
    ]
    remark = ""
    if still:
        remark = message("results.left_out_still", "left out, as they hardly change: {names}", names=join_texts(still))
    stacks = [Stack(group.name, _axis_plots(group, robot, changing)) for group in moving]
    return Sheet(name, title, stacks, {"columns": min(2, len(stacks)), "width": PAPER, "remark": remark})


def _axis_plots(group: SideGroup, robot: StationRobot, panels: _Panels) -> list[Plot]:
    """Return a plot of a group's axes for each panel, also of one that has none of them: rows of stacks are even."""
    plots = []
    for (panel, ones), colour in zip(panels.items(), cycle(COLOURS), strict=False):
        values = np.full((len(ones[0].values), len(robot.axes)), np.nan)
        unit = ones[0].unit
        for one in ones:
            place = robot.axes.index(one.name)
            values[:, place] = one.values
            unit = one.unit if place == group.first else unit
        plots.append(Plot(_label(panel, unit), group.curves(values, panel.title, colour)))
    return plots


def _label(panel: Panel, unit: str) -> str:
    """Label of the upright axis, with the unit, such as "force [N]"."""
    if isinstance(panel.label, Message):
        return panel.label if unit == "1" else compound("{quantity} [{unit}]", quantity=panel.label, unit=unit)
    # A plain text shows by its brackets whether it takes a unit.
    quantity, bracket, _ = panel.label.partition(" [")
    return f"{quantity}{bracket}{unit}]" if bracket and unit != "1" else quantity


def _part(column: str) -> str:
    """Return what a column is of its signal: "x", "joint_1"."""
    return column.rpartition(".")[2]


def _finite(values: Vector) -> Vector:
    """Return the finite ones of values; 0 where there are none."""
    found = values[np.isfinite(values)]
    return found if found.size else np.zeros(1)
