"""The picture of a push map: how much is withstood in each direction, and at each moment of the steps."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from simrob_drake.folders import replaced_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.colours import COLOURS
from simrob_drake.tuning.push_map import PushMap, push_of
from simrob_drake.tuning.trial import COMPLETED, Row

_DPI, _SIDE = 110, 4.2  # and inches of a frame
_FILLED, _WIDEST = 0.6, 8  # the part of a direction that its bars fill, and how many there are at least
_NAMED, _BETWEEN = 12, 0.5  # directions that all have their number; where the lengths stand between the first two
_IMPULSE, _SHARE = "impulse over mass [N·s/kg]", "part of the pushes withstood"


def save_push_picture(spec: PushMap, rows: Sequence[Row], file: Path) -> None:
    """Draw all directions around the robot, ahead upward, and for each of the settings a map over the moments.

    A bar in each direction is the weakest of all moments and draws, a stroke over it their median; nothing stands
    between directions, where nothing was tried. Maps tell the weakest of all draws. Of pushes of one force all tell
    which part of them is withstood.

    Raises:
        OutputError: the disk does not take it.
    """
    names = list(spec.settings)
    values = {name: _values(spec, [row for row in rows if row["settings"] == name]) for name in names}
    highest = max(float(each.max()) for each in values.values()) or 1.0
    figure = Figure(figsize=(_SIDE * (1 + len(names)), _SIDE), layout="constrained")
    title = f"{Path(spec.station).stem}: pushes of {f'{spec.force:g} N for ' if spec.force else ''}{spec.duration:g} s"
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    around: Any = figure.add_subplot(1, 1 + len(names), 1, projection="polar")
    around.set_theta_zero_location("N")
    around.set_thetagrids(spec.turns if len(spec.turns) <= _NAMED else spec.turns[:: len(spec.turns) // 4])
    around.set_rlabel_position(_BETWEEN * spec.turns[1] if len(spec.turns) > 1 else 90.0)
    around.set_axisbelow("line")  # circles and lengths over the bars
    around.yaxis.set_major_locator(MaxNLocator(4))
    around.tick_params(axis="y", labelsize=8)
    what = _SHARE if spec.force else _IMPULSE
    around.set_title(what, fontsize=9)
    for place, (name, colour) in enumerate(zip(names, cycle(COLOURS), strict=False)):
        _draw_around(around, spec, values[name], name, colour, (place, len(names)))
        axes = figure.add_subplot(1, 1 + len(names), 2 + place)
        _draw_map(axes, spec, values[name], rows, name, highest, what)
    around.set_ylim(0.0, highest)
    around.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    with replaced_at_once(file) as work:
        figure.savefig(work, dpi=_DPI, format="png")


def _values(spec: PushMap, rows: Sequence[Row]) -> Vector:
    """Return what is drawn of each push, shape (draws, moments, directions)."""
    found = [float(row["ended"] == COMPLETED) if spec.force else push_of(row, "impulse_per_mass") for row in rows]
    return np.array(found).reshape(-1, spec.phases, spec.directions)


def _draw_around(axes: Axes, spec: PushMap, values: Vector, name: str, colour: str, place: tuple[int, int]) -> None:
    """Draw the bars of settings that are the first of so many by their ``place``."""
    number, count = place
    width = _FILLED * 2 * np.pi / max(len(spec.turns), _WIDEST) / count
    angles = np.deg2rad(spec.turns) - (number - (count - 1) / 2) * width  # to the left is counted up
    lengths = values.mean(axis=(0, 1)) if spec.force else values.min(axis=(0, 1))
    axes.bar(angles, lengths, width, color=colour, label=name if spec.force else f"{name}: weakest")
    if not spec.force:
        medians = np.median(values, axis=(0, 1))
        axes.hlines(medians, angles - width / 2, angles + width / 2, color=colour, label=f"{name}: median")


def _draw_map(
    axes: Axes, spec: PushMap, values: Vector, rows: Sequence[Row], name: str, highest: float, what: str
) -> None:
    cells = (values.mean if spec.force else values.min)(axis=0)
    image = axes.imshow(cells.T, aspect="auto", vmin=0.0, vmax=highest, cmap="viridis")
    moments = [row["moment"] for row in rows[: cells.size : spec.directions]]
    axes.set_xticks(range(spec.phases), [f"{moment:.4g}" for moment in moments], rotation=45, ha="right", fontsize=8)
    axes.set_yticks(range(spec.directions), [f"{turn:.4g}" for turn in spec.turns], fontsize=8)
    axes.set_xlabel("moment of the push [s]")
    axes.set_ylabel("direction, from ahead to the left [deg]")
    axes.set_title(name, fontsize=9)
    figure = axes.get_figure()
    assert figure is not None  # it was made with one
    figure.colorbar(image, ax=axes, label=what)
