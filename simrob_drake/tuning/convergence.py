"""The plot of searches for the same thing: what the best so far costs, over the trials."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from simrob_drake.folders import writing
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.grid import style

_SIZE, _DPI = (7.0, 4.0), 110  # inches


def save_convergence(file: Path, title: str, searches: Mapping[str, Sequence[float]]) -> None:
    """Write a plot of the least cost up to each trial, a curve each search; logarithmic where costs are positive.

    Args:
        file: where to.
        title: what is searched for.
        searches: the costs of the trials in order, by the search's name.

    Raises:
        OutputError: the disk does not take it.
    """
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.add_subplot()
    style(axes, title)
    for (name, costs), colour in zip(searches.items(), cycle(COLOURS), strict=False):
        least = np.minimum.accumulate(costs)
        axes.step(np.arange(1, len(least) + 1), least, where="post", color=colour, label=f"{name}, {least[-1]:.4g}")
    if all(min(costs) > 0 for costs in searches.values()):
        axes.set_yscale("log")
    axes.set_xlabel("trials")
    axes.set_ylabel("least cost so far")
    axes.legend(fontsize=9, frameon=False)
    with writing(file):
        figure.savefig(file, dpi=_DPI)
