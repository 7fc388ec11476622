"""Signals of several saved results in one figure, as ``hold on`` of MATLAB draws them over each other."""

import fnmatch
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName, one_of
from simrob_drake.base.files import NotRead, column_names, read_columns, text_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message, translate
from simrob_drake.base.yaml_files import parse_json
from simrob_drake.parts.references import TIME_COLUMN
from simrob_drake.results.colours import looks
from simrob_drake.results.files import SIGNALS, SUMMARY
from simrob_drake.results.plots.differences import differing_settings
from simrob_drake.results.plots.grid import TIME_LABEL
from simrob_drake.results.plots.joint_plots import QUANTITIES
from simrob_drake.results.plots.own import NotebookFigure, panels
from simrob_drake.results.record.servos import servo_in_words

_OF_JOINTS = re.compile(r"(?:[^.]+\.)?(q|tau)\.[^.]+")
"""Columns that are drawn unless the user names others: positions and torques of joints, of any robot."""

_USER_UNITS = {"rad": ("deg", 180.0 / np.pi), "rad/s": ("deg/s", 180.0 / np.pi)}
"""By unit of a column, the unit that is shown, and the factor."""

_STILL = 1e-3
"""A joint that moves by less than this in all results is left out [rad or m]."""

_MOST = 48
"""Most frames of a figure. More would be too small to read."""

_FRAME = (4.6, 1.7)
"""Width and height of a frame [inches]."""


@dataclass(frozen=True)
class SavedSignals:
    """Signals of a result, as a figure of several results needs them: read from a folder, or taken from a run.

    Attributes:
        name: name in the legend, such as the folder with the gains of the first robot, or with the settings in which
            the result differs from the others.
        times: times of the samples, shape (m,) [s].
        columns: the signals by name, shape (m,) each.
        units: units of the signals by name.
    """

    name: str
    times: Vector
    columns: dict[str, Vector]
    units: dict[str, str]

    def __getitem__(self, name: str) -> Vector:
        """Signal by the name of its column, such as ``q.joint_2``, shape (m,).

        Raises:
            UnknownName: there is no such column.
        """
        return self.columns[one_of(message("results.signal", "signal"), name, self.columns)]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the signals."""
        return iter(self.columns)

    def __contains__(self, name: object) -> bool:
        """Whether there is a signal of this name."""
        return name in self.columns

    def keys(self) -> list[str]:
        """Names of the signals, so that ``dict(result)`` has all signals by name."""
        return list(self.columns)


def read_results(folders: Sequence[Path]) -> list[SavedSignals]:
    """Read the signals of results. The name of each has the keys in which it differs from the other results.

    A single result has the gains of its first robot in its name instead.

    Args:
        folders: folders of the results.

    Raises:
        InvalidConfig: a folder holds no result, or the files of one that cannot be read, see :func:`read_signals`.
    """
    results = [read_signals(folder) for folder in folders]
    # A single result differs from no other; `read_signals` has put its gains into its name.
    if len(results) == 1:
        return results
    names = [
        join_texts([str(folder), difference] if difference else [str(folder)], ": ")
        for folder, difference in zip(folders, differing_settings(folders), strict=True)
    ]
    return [replace(result, name=name) for result, name in zip(results, names, strict=True)]


def read_signals(folder: Path) -> SavedSignals:
    """Read the signals of a result from its folder. Its name has the gains of its first robot.

    Raises:
        InvalidConfig: there is no table of signals; the table or the summary cannot be read; the table has no column of
            times; or ``servos`` or ``units`` of the summary is no mapping.
    """
    table = folder / SIGNALS
    if not table.is_file():
        problem = message(
            "results.no_result_folder",
            "must be the folder of a result, which contains {signals}",
            signals=SIGNALS,
        )
        raise InvalidConfig(folder, "", problem)
    # Units are not in the table of signals itself, whose first line has names only.
    summary = read_summary(folder)
    signals = [name for name in column_names(table) if name != TIME_COLUMN]
    # The column of times is named even if the table lacks it, so that it is missed with its name.
    values, _ = read_columns(table, [TIME_COLUMN, *signals])
    columns = {name: values[:, index] for index, name in enumerate(signals, 1)}
    # Older results have no gains in their summary.
    servos = _mapping_of_summary(summary, "servos", folder)
    gains_of_robots = [servo_in_words(servo) for servo in servos.values()]
    name = join_texts([str(folder), *gains_of_robots[:1]], ": ")
    units = _mapping_of_summary(summary, "units", folder)
    return SavedSignals(name, values[:, 0], columns, units=units)


def _mapping_of_summary(summary: dict[str, Any], key: str, folder: Path) -> dict[str, Any]:
    """Value of a key of a result's summary, which must be a mapping. It is empty if the summary lacks the key.

    Raises:
        InvalidConfig: the value is no mapping.
    """
    content = summary.get(key, {})
    if not isinstance(content, dict):
        raise InvalidConfig(
            folder / SUMMARY,
            key,
            message("base.no_mapping", "must contain a mapping of keys to values"),
        )
    return content


def read_summary(folder: Path) -> dict[str, Any]:
    """Read the summary of a result from its folder, the content of ``summary.json``.

    Raises:
        InvalidConfig: the file is missing, cannot be read, or contains no mapping.
    """
    file = folder / SUMMARY
    try:
        content = parse_json(text_of(file), file)
    except NotRead as problem:
        raise InvalidConfig(
            file, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    if not isinstance(content, dict):
        raise InvalidConfig(
            file, "", message("base.no_mapping", "must contain a mapping of keys to values")
        )
    return content


def overlay_figure(
    results: Sequence[SavedSignals],
    patterns: Sequence[str] = (),
    argument: str = "--signal",
) -> NotebookFigure:
    """Draw signals of several results over each other: a frame for each signal, a curve for each result.

    Args:
        results: the results.
        patterns: names of signals, with ``*`` for any part. If there are none, positions and torques of all joints that
            move in one of the results are drawn.
        argument: name of the option or argument with the patterns, for errors.

    Raises:
        UnknownName: a pattern is the name of no signal.
        InvalidParameter: nothing is left to draw, or there are too many signals.
    """
    names = _named_signals(results, patterns) if patterns else _signals_of_moving_joints(results)
    if not 0 < len(names) <= _MOST:
        expected = message(
            "results.count_of_plots",
            "1 to {most} signals; a pattern such as q.joint_2 selects fewer",
            most=_MOST,
        )
        raise InvalidParameter(argument, len(names), expected)
    column_count = 1 if len(names) == 1 else 2
    row_count = ceil(len(names) / column_count)
    width, height = _FRAME
    title = (
        results[0].name if len(results) == 1 else message("results.overlaid", "overlaid results")
    )
    figure, frames = panels(
        title,
        row_count,
        column_count,
        size=(column_count * width, row_count * height + 0.9),
        titles=names,
        sharex=True,
    )
    # Not strict, since there may be one frame more than signals.
    for axes, name in zip(frames.flat, names, strict=False):
        _draw_signal(axes, name, results)
    # The frames share their axis of time: only the lowest of each column has its label.
    lowest_of_columns = frames.flat[max(len(names) - column_count, 0) : len(names)]
    for axes in lowest_of_columns:
        axes.set_xlabel(translate(TIME_LABEL))
        axes.tick_params(labelbottom=True)
    # An odd count of signals leaves the last frame empty.
    for axes in frames.flat[len(names) :]:
        axes.set_visible(False)
    return figure


def _draw_signal(axes: Axes, name: str, results: Sequence[SavedSignals]) -> None:
    """Draw a signal of several results over each other into an empty frame.

    Args:
        axes: the frame.
        name: name of the signal.
        results: the results. Those without this signal have no curve.
    """
    # Results of older versions may lack units; one result that has them is enough.
    units = [result.units[name] for result in results if name in result.units]
    unit = units[0] if units else "1"
    shown_unit, factor = _USER_UNITS.get(unit, (unit, 1.0))
    for result, (colour, line) in zip(results, looks(len(results)), strict=True):
        if name in result.columns:
            values = factor * result.columns[name]
            label = translate(result.name)
            axes.plot(
                result.times, values, label=label, color=colour, linestyle=line, linewidth=1.4
            )
    # The unit of a joint's signal shows what it is, such as a torque. Other signals have their unit alone as label.
    quantity = QUANTITIES.get(shown_unit) if _OF_JOINTS.fullmatch(name) else None
    label_of_axis = f"[{shown_unit}]"
    if quantity is not None:
        label_of_axis = f"{translate(quantity)} [{shown_unit}]"
    axes.set_ylabel(label_of_axis, fontsize=9)


def _named_signals(results: Sequence[SavedSignals], patterns: Sequence[str]) -> list[str]:
    """Names of the signals of all results that patterns match, in the order of the patterns, each once.

    Raises:
        UnknownName: a pattern matches no signal.
    """
    known = list(dict.fromkeys(name for result in results for name in result.columns))
    found = dict[str, None]()
    for pattern in patterns:
        matching = fnmatch.filter(known, pattern)
        if not matching:
            raise UnknownName(message("results.signal", "signal"), pattern, known)
        found.update(dict.fromkeys(matching))
    return list(found)


def _signals_of_moving_joints(results: Sequence[SavedSignals]) -> list[str]:
    """Names of the positions and torques of the joints that move in at least one of the results.

    Each position is followed by the torque of the same joint. If no joint moves, the signals of all joints are named.
    Results without joints have all of their signals, up to the largest count of frames.
    """
    names = list(dict.fromkeys(name for result in results for name in result.columns))
    positions = [name for name in names if _is_position(name)]
    moving = [name for name in positions if any(_moves(result, name) for result in results)]
    known = set(names)
    found: list[str] = []
    for name in moving or positions:
        # The first "q" that is a whole part of the name is replaced: "left.q.joint_1" becomes "left.tau.joint_1".
        torque = re.sub(r"(^|\.)q\.", r"\1tau.", name, count=1)
        found.append(name)
        if torque in known:
            found.append(torque)
    return found or names[:_MOST]


def _is_position(name: str) -> bool:
    """Whether a signal is the position of a joint."""
    match = _OF_JOINTS.fullmatch(name)
    return match is not None and match[1] == "q"


def _moves(result: SavedSignals, name: str) -> bool:
    """Whether a result has a position of this name, and it changes by more than 1e-3 (rad or m)."""
    return name in result.columns and bool(np.ptp(result.columns[name]) > _STILL)
