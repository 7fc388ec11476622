"""Bode plots of linear models."""

from collections.abc import Sequence
from itertools import cycle, product

import numpy as np
from matplotlib.figure import Figure

from simrob_drake.linear.model import LinearModel
from simrob_drake.results.plots.grid import COLOURS, style

_POINTS = 600
_BEYOND = 10.0
"""How many times slower and faster than the slowest and the fastest motion the frequencies go."""
_LOOKS = [(colour, line) for line, colour in product(("-", "--", ":"), COLOURS)]


def bode_figure(model: LinearModel, pairs: Sequence[tuple[str, str]] | None = None) -> Figure:
    """Draw magnitude [dB] and phase [deg] over frequency [Hz].

    Args:
        model: whose.
        pairs: of an input and an output each; every axis from its reference to its position unless given.

    Raises:
        UnknownName: no such input or output.
    """
    chosen = list(_own_pairs(model) if pairs is None else pairs)
    sizes = np.abs(model.poles[model.poles != 0]) / (2 * np.pi)
    slowest, fastest = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    frequencies = np.geomspace(slowest / _BEYOND, fastest * _BEYOND, _POINTS)
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    style(magnitude, f"{model.name}: Bode plot")
    style(phase, "")
    for (given, told), (colour, line) in zip(chosen, cycle(_LOOKS), strict=False):
        response = model.part(inputs=[given], outputs=[told]).response(frequencies)[:, 0, 0]
        size = 20 * np.log10(np.maximum(np.abs(response), 1e-30))
        magnitude.semilogx(frequencies, size, line, color=colour, label=f"{given} → {told}")
        phase.semilogx(frequencies, np.rad2deg(np.unwrap(np.angle(response))), line, color=colour)
    magnitude.set_ylabel("magnitude [dB]")
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return figure


def _own_pairs(model: LinearModel) -> list[tuple[str, str]]:
    return [(name, name.replace("reference.", "q.")) for name in model.inputs if "reference." in name]
