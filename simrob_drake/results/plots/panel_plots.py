"""Plots of the signals that parts of a station declare: sensors, pieces, controllers and other blocks.

A part declares a *panel* for each signal that is to be plotted: a title, a label and the columns of the result. Panels
with the same figure name are drawn in one file. There are two forms. Panels of a few quantities are drawn below each
other. A panel with a value for each axis of a robot is drawn joint by joint, with right and left axes together.
Outputs of controllers that are constant, and in the second form axes and panels that hardly change, are left out and
named in a sentence.

A *sheet* describes such a file. A *quantity* is a column of a panel. A *stack* is a title with plots below each other,
and a *group* is an axis, or the right and the left axis that share a plot.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.colours import COLOURS, looks
from simrob_drake.results.plots.grid import Curve, Plot, Stack, smallest
from simrob_drake.results.plots.joint_plots import SideGroup, side_groups
from simrob_drake.results.record.run import RecordedRun

PAPER = 7.16
"""Width of the text of a page [inches]."""

_FEW = 4
"""Most columns of a panel that are always drawn in one frame, even if they belong to axes."""

_LITTLE = 0.02
"""An axis is left out if it moves less than this part of what the axis that moves most does."""

_JUMP = 0.25
"""A first change from zero by more than this part of all change is the first sample of a controller."""

_CONSTANT = 1e-6
"""Relative change up to which a quantity counts as constant: it is an error of the arithmetic."""

_HEIGHT = 1.8
"""Height of a frame [inches]."""

# Sizes in a legend [inches].
_ENTRY = 0.18  # height of an entry
_HANDLE = 0.45  # width of the line of an entry
_CHARACTER = 0.065  # width of a letter


class _UserUnit(NamedTuple):
    """Unit in which a quantity is shown, and the factor from the unit of the result."""

    name: str
    factor: float


_USER_UNITS = {"rad": _UserUnit("deg", float(np.rad2deg(1.0)))}
"""Units that are shown in others, by the unit of the result."""


@dataclass(frozen=True)
class Sheet:
    """Description of a plot file: its name, its title and its stacks.

    Attributes:
        name: name of the file without suffix.
        title: title of the figure.
        stacks: plots of the figure: see :mod:`simrob_drake.results.plots.grid`.
        layout: further arguments of :func:`simrob_drake.results.plots.grid.grid_figure`.
    """

    name: str
    title: str
    stacks: Sequence[Stack]
    layout: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A column of a panel.

    Attributes:
        name: name of the curve.
        values: values in the shown unit, shape (m,). They may have NaN.
        unit: the shown unit; "1" for a number without unit.
        is_required: whether the quantity is drawn even if it is constant. It is False for the outputs of controllers.
    """

    name: str
    values: Vector
    unit: str
    is_required: bool

    @property
    def change(self) -> float:
        """Difference of the largest and the smallest value. NaN and infinite values are ignored."""
        return float(np.ptp(_finite(self.values)))

    @property
    def varies(self) -> bool:
        """Whether the quantity changes by more than noise."""
        largest = float(np.abs(_finite(self.values)).max())
        return self.change > max(smallest(f"[{self.unit}]"), _CONSTANT * largest)

    @property
    def last_value(self) -> str:
        """The last value in words, with its unit."""
        value = float(self.values[-1])
        if self.unit == "1":
            return compound("{value:.4g}", value=value)
        return compound("{value:.4g} {unit}", value=value, unit=self.unit)


_Panels = Mapping[Panel, Sequence[_Quantity]]
"""Quantities of panels: one for each column of the panel, in their order."""


def panel_sheets(result: RecordedRun) -> Iterator[Sheet]:
    """Yield the sheets of a run's panels, such as ``piece_<piece>``, ``sensors`` and ``controller_<name>``.

    If a figure has panels of both forms, those with a value for each axis are in ``controller_<name>_axes``. If several
    robots have such panels, those of the second robot and later ones are in sheets ``controller_<name>_axes_<robot>``.
    """
    panels: dict[Panel, list[_Quantity]] = {}
    for signal in result.signals:
        # A program has only the columns that all of its runs have: a panel without its columns cannot be drawn.
        if signal.panel is not None and signal.panel in result.panels:
            panels[signal.panel] = _quantities_of(signal, signal.panel, result)
    for figure in dict.fromkeys(panel.figure for panel in panels):
        own_panels = {
            panel: quantities for panel, quantities in panels.items() if panel.figure == figure
        }
        yield from _sheets_of_figure(figure, own_panels, result)


def _sheets_of_figure(figure: str, panels: _Panels, result: RecordedRun) -> Iterator[Sheet]:
    """Yield a sheet for the panels of a few quantities, and one for each robot with panels of its axes.

    Args:
        figure: common name of the figure of the panels.
        panels: the panels.
        result: the run.
    """
    # Panels of one file often have the same heading, which is written once.
    title = join_texts(dict.fromkeys(panel.heading for panel in panels))
    few: dict[Panel, Sequence[_Quantity]] = {}
    panels_of_robots: dict[str, dict[Panel, Sequence[_Quantity]]] = {}
    for panel, quantities in panels.items():
        robot = _robot_of(panel, result)
        if robot is None:
            few[panel] = quantities
        else:
            panels_of_robots.setdefault(robot.name, {})[panel] = quantities
    if few:
        yield _few_sheet(figure, title, few)
    for index, (robot_name, panels_of_axes) in enumerate(panels_of_robots.items()):
        # The first sheet has the name of the figure itself, so that the usual file has the short name.
        name = figure
        if few or index > 0:
            name += "_axes"
        if index > 0:
            name += f"_{robot_name}"
        yield _axes_sheet(name, title, panels_of_axes, result.plant.robots[robot_name])


def _quantities_of(signal: Signal, panel: Panel, result: RecordedRun) -> list[_Quantity]:
    """Read the quantities of a signal for its panel, in the units of users.

    A controller has the output zero before its first sample. If the output jumps from there, the first value is
    replaced by NaN, which is not drawn.

    Args:
        signal: declaration of the columns, with their units.
        panel: the panel of the signal.
        result: the run.
    """
    is_of_controller = signal.role == "own"
    units = dict(zip(signal.names, signal.units, strict=True))
    names = panel.components or [_component(column) for column in panel.columns]
    quantities = []
    for column, name in zip(panel.columns, names, strict=True):
        user_unit = _USER_UNITS.get(units[column], _UserUnit(units[column], 1.0))
        values = user_unit.factor * result[column]
        if is_of_controller and len(values) > 1 and values[0] == 0:
            change = np.ptp(_finite(values))
            # A curve that begins near zero is left as it is: there the first value may be real.
            if abs(values[1]) > _JUMP * change:
                values[0] = np.nan
        # A number alone would mean nothing in a legend.
        label = (
            compound("{title} {name}", title=panel.title, name=name) if name.isdecimal() else name
        )
        quantities.append(
            _Quantity(label, values, user_unit.name, is_required=not is_of_controller)
        )
    return quantities


def _robot_of(panel: Panel, result: RecordedRun) -> StationRobot | None:
    """Find the robot to whose axes the columns of a panel belong, by the last parts of their names.

    Returns None if there is no such robot, or if the panel has at most four columns: these are drawn in one frame.
    """
    components = {_component(column) for column in panel.columns}
    if len(components) <= _FEW:
        return None
    for robot in result.plant.robots.values():
        if components <= set(robot.axes):
            return robot
    return None


def _few_sheet(name: str, title: str, panels: _Panels) -> Sheet:
    """Make the sheet of panels below each other.

    Quantities of controllers that are constant are left out. A sentence has their values. If nothing is left to draw,
    all quantities are drawn.

    Args:
        name: name of the file without suffix.
        title: title of the figure.
        panels: the panels.
    """
    shown = {}
    for panel, quantities in panels.items():
        drawn = [quantity for quantity in quantities if quantity.is_required or quantity.varies]
        if drawn:
            shown[panel] = drawn
    constants = _constants_in_words(panels, shown) if shown else []
    remark = ""
    if constants:
        remark = message(
            "results.left_out_constant",
            "constant, not plotted: {values}",
            values=join_texts(constants),
        )
    drawn_panels: _Panels = shown or panels
    # A single curve needs no legend.
    names = [
        one.name
        for quantities in drawn_panels.values()
        if len(quantities) > 1
        for one in quantities
    ]
    # width of the legend [inches]: a short line, and the longest name
    legend = _HANDLE + _CHARACTER * max(map(len, names), default=0)
    stacks = [_stack(panel, quantities) for panel, quantities in drawn_panels.items()]
    return Sheet(
        name, title, stacks, {"columns": 1, "width": PAPER, "legend": legend, "remark": remark}
    )


def _constants_in_words(panels: _Panels, shown: _Panels) -> list[str]:
    """Write the last values of the quantities of panels that are not shown, such as "gain kp 3 N·m".

    Args:
        panels: all panels.
        shown: the panels that are drawn, each with its quantities that are drawn.
    """
    texts: list[str] = []
    for panel, quantities in panels.items():
        drawn = shown.get(panel, ())
        for quantity in quantities:
            if quantity not in drawn:
                words = [panel.title, quantity.name, quantity.last_value]
                if len(quantities) == 1:
                    words = [panel.title, quantity.last_value]
                texts.append(join_texts(words, " "))
    return texts


def _stack(panel: Panel, quantities: Sequence[_Quantity]) -> Stack:
    """Make the plots of a panel: one for each unit of its quantities, below each other.

    Args:
        panel: the panel, with the title and the label of the plots.
        quantities: the quantities that are drawn.
    """
    # Widths of the lines, relative to the usual one. Later lines are thinner, so that equal curves are all visible.
    first_weight = 1.4 if len(quantities) > 1 else 1.0
    curves = []
    for index, (colour, line) in enumerate(looks(len(quantities))):
        quantity = quantities[index]
        weight = max(first_weight - 0.3 * index, 0.8)
        curves.append(Curve(quantity.values, quantity.name, colour, weight, line))
    plots = []
    # A frame has one upright axis, so that values of different units need their own frames.
    for unit in dict.fromkeys(quantity.unit for quantity in quantities):
        drawn = [
            curve
            for curve, quantity in zip(curves, quantities, strict=True)
            if quantity.unit == unit
        ]
        height_of_legend = _ENTRY * len(drawn)
        plots.append(Plot(_label(panel, unit), drawn, max(_HEIGHT, height_of_legend)))
    return Stack(panel.title, plots)


def _axes_sheet(name: str, title: str, panels: _Panels, robot: StationRobot) -> Sheet:
    """Make the sheet of a robot's axes: a stack for each axis, or pair of axes, with a plot for each panel.

    Panels without any change, and axes that hardly change in any panel, are left out. A sentence names them. If no
    panel, or no axis, would be left, none is left out.

    Args:
        name: name of the file without suffix.
        title: title of the figure.
        panels: panels whose quantities have the names of axes.
        robot: the robot.
    """
    # A panel in which nothing changes would be drawn for each axis: that is a sentence, not a picture.
    changing = {
        panel: quantities
        for panel, quantities in panels.items()
        if any(one.varies for one in quantities)
    }
    if not changing:
        changing = dict(panels)
    moved_axes = _moved_axes(changing)
    named_axes = {quantity.name for quantities in panels.values() for quantity in quantities}

    moving: list[SideGroup] = []
    still: list[SideGroup] = []
    for group in side_groups(robot):
        axes = {robot.axes[index] for index in group.axes.values()}
        if axes & moved_axes:
            moving.append(group)
        # Axes without any quantity are not left out: there is nothing that could be drawn of them.
        elif axes & named_axes:
            still.append(group)
    # If no axis moves, all are drawn: an empty picture would look like an error.
    if not moving:
        moving = still
        still = []

    left_out: list[str] = [group.name for group in still]
    left_out += [
        message("results.of_every_axis", "{title} of every axis", title=panel.title)
        for panel in panels
        if panel not in changing
    ]
    remark = ""
    if left_out:
        names = join_texts(left_out)
        remark = message(
            "results.left_out_still", "almost constant, not plotted: {names}", names=names
        )
    stacks = [Stack(group.name, _axis_plots(group, robot, changing)) for group in moving]
    return Sheet(
        name, title, stacks, {"columns": min(2, len(stacks)), "width": PAPER, "remark": remark}
    )


def _moved_axes(panels: _Panels) -> set[str]:
    """Names of the axes that change in one of the panels, by more than 2 % of the largest change in this panel."""
    names = set[str]()
    for quantities in panels.values():
        # Relative to the axis that moves most: under servos, every axis trembles a little.
        least_change = _LITTLE * max(quantity.change for quantity in quantities)
        for quantity in quantities:
            if quantity.varies and quantity.change > least_change:
                names.add(quantity.name)
    return names


def _axis_plots(group: SideGroup, robot: StationRobot, panels: _Panels) -> list[Plot]:
    """Make a plot of the axes of a group for each panel.

    A panel without these axes has a plot without visible curves, so that all stacks have the same count of plots.

    Args:
        group: the axes.
        robot: the robot.
        panels: panels whose quantities have the names of axes.
    """
    plots = []
    for (panel, quantities), colour in zip(panels.items(), cycle(COLOURS), strict=False):
        sample_count = len(quantities[0].values)
        # Values of all axes of the robot, shape (m, n). Axes without a quantity stay NaN, which is not drawn.
        values = np.full((sample_count, len(robot.axes)), np.nan)
        unit = quantities[0].unit
        for quantity in quantities:
            axis = robot.axes.index(quantity.name)
            values[:, axis] = quantity.values
            # The axes of a group have the same unit, see `_pair_of`.
            if axis == group.first_axis:
                unit = quantity.unit
        plots.append(Plot(_label(panel, unit), group.curves(values, panel.title, colour)))
    return plots


def _label(panel: Panel, unit: str) -> str:
    """Label of the upright axis, with the unit, such as "force [N]". The unit "1" is not written.

    Args:
        panel: the panel. If its label is a plain text such as "force [N]", the unit in brackets is replaced; without
            brackets the label has no unit.
        unit: the unit that is shown.
    """
    if isinstance(panel.label, Message):
        return (
            panel.label
            if unit == "1"
            else compound("{quantity} [{unit}]", quantity=panel.label, unit=unit)
        )
    # A plain text shows by its brackets whether it takes a unit.
    quantity, bracket, _ = panel.label.partition(" [")
    return f"{quantity}{bracket}{unit}]" if bracket and unit != "1" else quantity


def _component(column: str) -> str:
    """Last part of the name of a column, such as "x" of ``force.wrist.x`` or "joint_1" of ``q.joint_1``."""
    return column.rpartition(".")[2]


def _finite(values: Vector) -> Vector:
    """Finite values of a signal, shape (k,). If no value is finite, the result is a single 0."""
    found = values[np.isfinite(values)]
    return found if found.size else np.zeros(1)
