"""Formats of the files to which plots are written."""

from typing import Any, Literal, get_args

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import message

PlotFormat = Literal["png", "svg", "pdf"]
"""Format of a plot: pixels, or lines that stay sharp at any size, for browsers (svg) and for papers (pdf)."""

UNDATED: dict[str, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Metadata of a file by its format. They leave out the date, so that the same run gives the same files."""


def plot_format(name: Any) -> str:
    """Check the name of a format, and return it.

    Raises:
        UnknownName: plots have no format of this name.
    """
    return one_of(message("results.format_of_plots", "format of plots"), name, get_args(PlotFormat))
