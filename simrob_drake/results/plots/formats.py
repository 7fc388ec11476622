"""The kinds of file that plots are written as."""

from typing import Any, Literal, get_args

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import message

PlotFormat = Literal["png", "svg", "pdf"]  # pixels, or lines that stay sharp at any size: for browsers and for papers

UNDATED: dict[str, dict[str, Any]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""What a file says of itself: not when it was made, so that the same run gives the same files."""


def plot_format(name: Any) -> str:
    """Return the name of a kind of file; raises UnknownName: plots are not written as that."""
    return one_of(message("results.format_of_plots", "format of plots"), name, get_args(PlotFormat))
