"""Hold logged signals of the original against ours: differences in numbers and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import simulate
from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.files import column_names, read_columns
from simrob_drake.folders import filled_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.colours import RED
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulink.values.evaluate import matrix
from simrob_drake.simulink.values.workspace import variables_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

TIMES = ("time", "tout", "t")
"""What the column of times may be called."""
NUMBERS = "differences.csv"
"""The file that every folder of a comparison holds."""


@dataclass(frozen=True)
class SignalDifference:
    """How one signal differs.

    Attributes:
        signal: its name in ours.
        times, logged, ours: of the log, shape (m,) each.
        unit: of the signal.
    """

    signal: str
    times: Vector
    logged: Vector
    ours: Vector
    unit: str

    @property
    def largest(self) -> float:
        """The largest difference."""
        return float(np.abs(self.logged - self.ours).max())

    @property
    def rms(self) -> float:
        """The root mean square difference."""
        return float(np.sqrt(np.mean((self.logged - self.ours) ** 2)))

    @property
    def at(self) -> float:
        """When the difference is largest [s]."""
        return float(self.times[np.argmax(np.abs(self.logged - self.ours))])


def read_log(file: Path | str, names: Mapping[str, str]) -> tuple[Vector, dict[str, Vector]]:
    """Return the times (m,) [s] and the signals of a log, by our names.

    Args:
        file: `.csv` with a header, of commas or semicolons, or `.mat`; of a matrix, ``yout.1`` is the first column;
            a structure with time, of To Workspace, goes by its label or its own name; variables of another length than
            the times are no signals.
        names: ours by theirs, for those that are called otherwise.

    Raises:
        InvalidParameter: a file that cannot be read, or without times that rise.
        UnknownName: a name that the log does not have.
    """
    file = as_path(file, "file")
    if file.suffix.lower() == ".mat":
        columns = _of_mat(file)
    else:
        header = column_names(file)
        columns = dict(zip(header, read_columns(file, header)[0].T, strict=True))
    clock = next((name for name in TIMES if name in columns), None)
    if clock is None:
        expected = f"a log with a column {', '.join(TIMES)}"
        if file.suffix.lower() == ".mat":
            expected += "; of a timeseries, in MATLAB: tout = simout.Time; yout = simout.Data; save log.mat tout yout"
        raise InvalidParameter("--with", str(file), expected)
    times = columns.pop(clock)
    if len(times) < 2 or not np.all(np.isfinite(times)) or times[0] < 0 or np.any(np.diff(times) <= 0):
        raise InvalidParameter("--with", str(file), "a log of two moments or more, whose times rise from 0 or later")
    for theirs in names:
        if theirs not in columns:
            raise UnknownName("signal of the log", theirs, columns)
    return times, {names.get(name, name): values for name, values in columns.items() if len(values) == len(times)}


def _of_mat(file: Path) -> dict[str, Vector]:
    columns: dict[str, Vector] = {}
    for name, value in variables_of({}, [file]).items():
        signals = value.get("signals") if isinstance(value, dict) else None
        if isinstance(signals, dict) and "values" in signals:  # a structure of To Workspace
            label = signals.get("label")
            columns |= _columns(label if isinstance(label, str) and label else name, signals["values"])
            if np.size(value.get("time", ())):
                columns.setdefault(TIMES[0], matrix(value["time"]).reshape(-1))
        elif not isinstance(value, str | dict):
            columns |= _columns(name, value)
    return columns


def _columns(name: str, value: Any) -> dict[str, Vector]:
    """Return a vector by its name, and the columns of a matrix by numbers behind it."""
    array = matrix(value)
    if 1 in array.shape:
        return {name: array.reshape(-1)}
    return {f"{name}.{index + 1}": column for index, column in enumerate(array.T)}


def compare(
    config: StationConfig, times: Vector, logged: Mapping[str, Vector], *, progress: bool = False
) -> tuple[SimulationResult, list[SignalDifference]]:
    """Run a station and hold its signals against logged ones.

    Columns ``q_ref.<axis>``, if there is one for every axis of the only robot, become its reference.

    Args:
        config: the station.
        times: of the log, shape (m,) [s].
        logged: signals by our names, shape (m,) each.
        progress: show a bar on a terminal.

    Raises:
        InvalidParameter: none of the signals is one of the station's, or the run ended before the log begins.
    """
    reference = _reference(config, times, logged)
    result = simulate(config, duration=float(times[-1]), reference=reference, progress=progress)
    known = [name for name in logged if name in result.names]
    if not known:
        found = ", ".join(list(logged)[:5]) or "a log of nothing but times"
        raise InvalidParameter("--with", found, "signals such as q.<axis>; rename them with --map THEIRS=OURS")
    inside = times <= result.times[-1]
    if not inside.any():
        end = f"{result.stop_time:g} s, where the run ended ({result.message})"
        raise InvalidParameter("--with", f"a log from {times[0]:g} s on", f"one that begins before {end}")
    at = times[inside]
    return result, [
        SignalDifference(name, at, logged[name][inside], np.interp(at, result.times, result[name]), result.units[name])
        for name in known
    ]


def _reference(config: StationConfig, times: Vector, logged: Mapping[str, Vector]) -> Vector | None:
    if config.only_robot is None:
        return None
    names = [f"q_ref.{axis}" for axis in resolve(config).robots[config.only_robot].model.axes]
    if not all(name in logged for name in names):
        return None
    return np.column_stack([times, *(logged[name] for name in names)])


def save_differences(differences: list[SignalDifference], folder: Path | str, *, force: bool = False) -> None:
    """Write the numbers, and a picture of each signal with its log and their difference below.

    Raises:
        OutputError: the folder cannot be written, or is there and not to be replaced.
    """
    with filled_at_once(as_path(folder, "folder"), marker=NUMBERS, force=force) as work:
        rows = [f"{found.signal},{found.largest:.9g},{found.at:.9g},{found.rms:.9g}\n" for found in differences]
        (work / NUMBERS).write_text("".join(["signal,largest,at,rms\n", *rows]), encoding="utf-8")
        for found in differences:
            _save_picture(found, work / f"{found.signal}.png")


def _save_picture(found: SignalDifference, file: Path) -> None:
    from simrob_drake.results.plots.own import panels, save_figure

    figure, ((upper,), (lower,)) = panels(found.signal, 2, size=(8, 5), sharex=True, height_ratios=(2, 1))
    upper.plot(found.times, found.logged, label="logged")
    upper.plot(found.times, found.ours, "--", label="ours")
    lower.plot(found.times, found.ours - found.logged, color=RED)
    upper.set_ylabel(f"{found.signal} [{found.unit}]")
    lower.set_ylabel(f"ours - logged [{found.unit}]")
    lower.set_xlabel("time [s]")
    save_figure(figure, file)
