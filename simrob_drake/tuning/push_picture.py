"""The picture of a push map: how much is withstood in each direction, and at each moment of the steps."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from simrob_drake.folders import replaced_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.colours import COLOURS
from simrob_drake.tuning.push_map import PushMap, push_of
from simrob_drake.tuning.trial import COMPLETED, Row

_DPI, _SIDE = 110, 4.2  # and inches of a frame
_IMPULSE, _SHARE = "impulse over mass [N·s/kg]", "part of the pushes withstood"


def save_push_picture(spec: PushMap, rows: Sequence[Row], file: Path) -> None:
    """Draw all directions around the robot, ahead upward, and for each of the settings a map over the moments.

    Lines are the weakest of all moments and draws, dotted ones their median; maps tell the weakest of all draws. Of
    pushes of one force all tell which part of them is withstood.

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
    around.set_title(_SHARE if spec.force else _IMPULSE, fontsize=9)
    for place, (name, colour) in enumerate(zip(names, COLOURS, strict=False), start=2):
        _draw_around(around, spec, values[name], name, colour)
        _draw_map(figure.add_subplot(1, 1 + len(names), place), spec, values[name], rows, name, highest)
    around.set_ylim(0.0, highest)
    around.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    with replaced_at_once(file) as work:
        figure.savefig(work, dpi=_DPI, format="png")


def _values(spec: PushMap, rows: Sequence[Row]) -> Vector:
    """Return what is drawn of each push, shape (draws, moments, directions)."""
    found = [float(row["ended"] == COMPLETED) if spec.force else push_of(row, "impulse_per_mass") for row in rows]
    return np.array(found).reshape(-1, spec.phases, spec.directions)


def _draw_around(axes: Axes, spec: PushMap, values: Vector, name: str, colour: str) -> None:
    angles = np.deg2rad([*spec.turns, 360.0])

    def line(how: Callable[..., Vector], looks: str, label: str) -> None:
        ends = how(values, axis=(0, 1))
        axes.plot(angles, [*ends, ends[0]], looks, color=colour, label=label, markersize=3)

    if spec.force:
        line(np.mean, "o-", name)
    else:
        line(np.min, "o-", f"{name}: weakest")
        line(np.median, "o:", f"{name}: median")


def _draw_map(axes: Axes, spec: PushMap, values: Vector, rows: Sequence[Row], name: str, highest: float) -> None:
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
    figure.colorbar(image, ax=axes)
