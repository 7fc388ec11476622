"""Results for notebooks and scripts: saved results are read again, and results are drawn over each other."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidParameter, quote_value
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.results.plots.overlay import (
    SavedSignals,
    overlay_figure,
    read_signals,
    read_summary,
)
from simrob_drake.results.plots.own import NotebookFigure, complete_figure
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.servos import servo_in_words, servos_of


@dataclass(frozen=True)
class SavedResult(SavedSignals):
    """A result that was read from its folder: its signals, and the content of its summary.

    For example, ``result["q.joint_2"]`` is a column (m,), and ``dict(result)`` has all columns by name.

    Attributes:
        folder: the folder.
        summary: content of ``summary.json``: how the run ended, its verdict, and the largest torques.
    """

    folder: Path = Path()
    summary: dict[str, Any] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """End of the run, in words."""
        return str(self.summary.get("message", ""))

    def __repr__(self) -> str:
        """Describe the result in two lines: how the run ended, and how much was recorded."""
        size = f"{len(self.times)} samples of {len(self.columns)} columns"
        return f"{self.folder}: {self.message}\n{size}"

    def plot(self, *signals: str) -> NotebookFigure:
        """Draw signals of the result, see :func:`plot_results`."""
        return plot_results(self, signals=signals)


AnyResult: TypeAlias = RecordedRun | SavedSignals | Path | str
"""A result of a run, one that was read by :func:`load_result`, or the folder of one."""


def load_result(folder: Path | str) -> SavedResult:
    """Read a result that was saved to a folder by ``simrob run`` or ``result.save()``.

    Args:
        folder: the folder.

    Raises:
        InvalidConfig: the folder holds no result, or its signals or its summary cannot be read.
    """
    # The signals come from signals.csv; the summary has everything that is not a signal.
    path = as_path(folder, "folder")
    signals = read_signals(path)
    summary = read_summary(path)
    return SavedResult(
        name=signals.name,
        times=signals.times,
        columns=signals.columns,
        units=signals.units,
        folder=path,
        summary=summary,
    )


def plot_results(
    *results: AnyResult, signals: Sequence[str] = (), labels: Sequence[str] = ()
) -> NotebookFigure:
    """Draw signals of results over each other: a frame for each signal, a curve for each result.

    A notebook shows the returned figure; ``figure.savefig("file.png")`` writes it.

    Args:
        results: results of runs, results that were loaded, or their folders.
        signals: names of signals, with ``*`` for any part, such as ``q.joint_2`` or ``tau.*``. If there are none,
            positions and torques of all joints that move in one of the results are drawn.
        labels: names of the results in the legend, in their order. By default they are the names of the results, with a
            number if several have the same name.

    Returns:
        the figure.

    Raises:
        InvalidConfig: a folder holds no result, or one that cannot be read.
        InvalidParameter: there is no result, one of another type, another count of labels than of results, or nothing
            to draw.
        UnknownName: no result has a signal of this name.
    """
    if not results:
        expected = message("results.at_least_one_result", "at least one result, or its folder")
        raise InvalidParameter("results", quote_value(""), expected)
    if labels and len(labels) != len(results):
        expected = message(
            "results.label_of_each", "one label for each of {count} results", count=len(results)
        )
        raise InvalidParameter("labels", list(labels), expected)
    names = [signals] if isinstance(signals, str) else list(signals)
    of_results = [_signals_of(result) for result in results]
    legend = list(labels) or _different_names([own.name for own in of_results])
    labelled = [replace(own, name=label) for own, label in zip(of_results, legend, strict=True)]
    figure = overlay_figure(labelled, names, "signals")
    # Notebooks and savefig() show the figure without going through save_figure(), which would complete it.
    complete_figure(figure)
    return figure


def _different_names(names: Sequence[str]) -> list[str]:
    """Number those names that occur several times, such as "arm (2)", so that a legend tells them apart."""
    numbers = Counter[str]()
    different = []
    for name in names:
        numbers[name] += 1
        is_repeated = names.count(name) > 1
        different.append(
            compound("{name} ({number})", name=name, number=numbers[name]) if is_repeated else name
        )
    return different


def _signals_of(result: AnyResult) -> SavedSignals:
    """Signals of a result in any of its forms, with the name that the legend of a figure shows.

    The name of a run has the gains of its first robot, since runs of the same station would have equal names.

    Raises:
        InvalidConfig: the folder holds no result, or one that cannot be read.
        InvalidParameter: the value is no result.
    """
    if isinstance(result, SavedSignals):
        return result
    if isinstance(result, Path | str):
        return load_result(result)
    if not isinstance(result, RecordedRun):
        expected = message(
            "results.a_result", "a result of simulate(), of load_result(), or the folder of one"
        )
        raise InvalidParameter("results", quote_value(result), expected)
    gains = [servo_in_words(servo) for servo in servos_of(result).values()]
    columns = {name: result[name] for name in result}
    return SavedSignals(
        name=join_texts([result.config.name, *gains[:1]], ": "),
        times=result.times,
        columns=columns,
        units=dict(result.units),
    )
