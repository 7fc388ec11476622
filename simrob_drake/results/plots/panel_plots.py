"""Plots of what pieces, sensors and blocks tell, as the parts that give the signals declare it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle, product

from matplotlib.figure import Figure

from simrob_drake.results.plots.grid import COLOURS, Curve, Plot, Stack, grid_figure
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.signals import Panel

_LOOKS = [(colour, line) for line, colour in product(("-", "--", ":"), COLOURS)]
_WIDTH, _HEIGHT = 9.0, 1.8  # inches, of a figure and of a frame
_ENTRY, _HANDLE, _CHARACTER = 0.18, 0.45, 0.065  # inches: height of a legend's entry, width of its line and letters


def panel_figures(result: RecordedRun) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a run's panels with their names, such as ``piece_<piece>`` and ``sensors``."""
    for name in dict.fromkeys(panel.figure for panel in result.panels):
        panels = [panel for panel in result.panels if panel.figure == name]
        stacks = [_stack(result, panel) for panel in panels]
        explained = [_part(column) for panel in panels if len(panel.columns) > 1 for column in panel.columns]
        beside = _HANDLE + _CHARACTER * max(map(len, explained), default=0)
        yield name, grid_figure(result, panels[0].heading, stacks, columns=1, width=_WIDTH, beside=beside)


def _stack(result: RecordedRun, panel: Panel) -> Stack:
    first = (
        1.4 if len(panel.columns) > 1 else 1.0
    )  # weight of a line; later ones are thinner: equal curves are all seen
    curves = [
        Curve(result[column], _part(column), colour, max(first - 0.3 * place, 0.8), line)
        for place, (column, (colour, line)) in enumerate(zip(panel.columns, cycle(_LOOKS), strict=False))
    ]
    return Stack(panel.title, [Plot(panel.label, curves, max(_HEIGHT, _ENTRY * len(curves)))])


def _part(column: str) -> str:
    """Return what a column is of its signal: "x", "joint_1"."""
    return column.rpartition(".")[2]
