"""Signals that the original logged (CSV, Parquet, MATLAB's `.mat`), held against ours: numbers and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import simulate
from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.files import LARGEST_TABLE, NotRead, column_names, content_of, read_columns
from simrob_drake.base.folders import filled_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.mat import contents_of_mat
from simrob_drake.extensions.simulink.values.units import UnknownUnit, factor, plain_unit
from simrob_drake.results.colours import RED
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

TIMES = ("time", "tout", "t")  # what the column of times may be called, with capitals or without
_CARRIERS = (
    "signals",
    "values",
    "data",
)  # fields of structures that add nothing to a signal's name
_EXPORTS = {
    "timeseries": "tout = {name}.Time; yout = squeeze({name}.Data); save -v7 log.mat tout yout",
    "timetable": "tout = seconds({name}.Properties.RowTimes); yout = {name}.Variables; save -v7 log.mat tout yout",
    "Dataset": "s = {name}{{1}}.Values; tout = s.Time; yout = squeeze(s.Data); save -v7 log.mat tout yout",
    "SimulationOutput": "tout = {name}.tout; yout = {name}.yout{{1}}.Values.Data; save -v7 log.mat tout yout",
}
"""What to type in MATLAB for an object, by the last part of its class."""


@dataclass(frozen=True)
class LoggedSignal:
    """A signal of a log."""

    times: Vector  # shape (m,) [s]; they rise from 0 or later
    values: Vector  # shape (m,)
    unit: str = ""  # of the values; that of the station's signal where it is empty


def read_log(file: Path | str, names: Mapping[str, str]) -> dict[str, LoggedSignal]:
    """Return the signals of a log, by our names.

    Args:
        file: `.csv` with a header, of commas or semicolons, `.parquet` or `.mat`. In a `.mat` file signals are vectors,
            or the columns of a matrix as ``yout.1``, beside a vector of times; matrices whose first row (To File) or
            column is the times; and structures with time (To Workspace), by label or name.
        names: ours by theirs, for those that are called otherwise; ``q.joint_1:deg`` is in degrees there.

    Raises:
        InvalidParameter: a file that cannot be read, without times that rise, or with objects that only MATLAB reads.
        UnknownName: a name that the log does not have.
    """
    file = as_path(file, "file")
    objects: dict[str, str] = {}
    if file.suffix.lower() == ".mat":
        variables = contents_of_mat(file, "--with")
        found = dict(_in_structure("", variables, None, objects))
    else:
        columns = _columns(file)
        clock = next((name for name in columns if name.lower() in TIMES), "")
        signals = columns.items() if clock else ()
        found = {
            name: LoggedSignal(columns[clock], values) for name, values in signals if name != clock
        }
    asked = [
        name
        for name in objects
        if not found or any(f"{theirs}.".startswith(f"{name}.") for theirs in names)
    ]
    expected = (
        ""
        if found
        else message(
            "simulink.log_with_column",
            "a log with a column {times}, and signals of its length",
            times=", ".join(TIMES),
        )
    )
    if asked:
        kind = objects[asked[0]]
        lines = _EXPORTS.get(kind.rpartition(".")[2], _EXPORTS["timeseries"]).format(name=asked[0])
        expected = message(
            "simulink.log_of_numbers",
            "of numbers, and {asked} is a {kind}, which only MATLAB reads: {lines}",
            asked=asked[0],
            kind=kind,
            lines=lines,
        )
    if expected:
        raise InvalidParameter("--with", str(file), expected)
    for theirs in names:
        if theirs not in found:
            raise UnknownName(message("simulink.signal_of_log", "signal of the log"), theirs, found)
    checked = {name: _checked(signal, file) for name, signal in found.items()}
    known = {name: signal for name, signal in checked.items() if name not in names}
    for theirs, ours in names.items():
        name, _, unit = ours.partition(":")
        known[name] = replace(checked[theirs], unit=unit)
    return known


def _checked(signal: LoggedSignal, file: Path) -> LoggedSignal:
    """Return a signal whose times rise: of samples at the same time, as those of a jump, the last one counts."""
    times = signal.times
    steps = np.diff(times)
    if not np.all(np.isfinite(times)) or np.any(steps < 0) or not np.any(steps > 0) or times[0] < 0:
        raise InvalidParameter(
            "--with",
            str(file),
            message(
                "simulink.log_of_moments",
                "a log of two moments or more, whose times rise from 0 or later",
            ),
        )
    last = np.append(steps > 0, True)
    return LoggedSignal(times[last], signal.values[last])


def _columns(file: Path) -> dict[str, Vector]:
    if file.suffix.lower() != ".parquet":
        header = column_names(file)
        return dict(zip(header, read_columns(file, header)[0].T, strict=True))
    with importing_extra(
        message("simulink.log_such_as", "a log such as {file}", file=file.name), "parquet"
    ):
        from pyarrow import BufferReader, parquet
    try:
        table = parquet.read_table(BufferReader(content_of(file, LARGEST_TABLE)))
        return {name: table[name].to_numpy().astype(float) for name in table.column_names}
    except (NotRead, ValueError, TypeError) as problem:  # errors of pyarrow are ValueErrors
        raise InvalidParameter(
            "--with",
            str(file),
            message("simulink.table_of_numbers", "a table of numbers: {problem}", problem=problem),
        ) from problem


def _in_structure(
    name: str, fields: Mapping[str, Any], clock: Vector | None, objects: dict[str, str]
) -> Iterator[tuple[str, LoggedSignal]]:
    """Yield the signals in variables, or in the fields of a structure, which may have times of its own."""
    own = next(
        (
            field
            for field in fields
            if field.lower() in TIMES and _vector(fields[field]) is not None
        ),
        None,
    )
    clock = _vector(fields[own]) if own is not None else clock
    label = "".join(map(str, np.ravel(fields.get("label", "")))) if name else ""
    for field, value in fields.items():
        if field != own:
            whole = (
                (label or name)
                if name and field.lower() in _CARRIERS
                else f"{name}.{field}".lstrip(".")
            )
            yield from _in_value(whole, value, clock, objects)


def _in_value(
    name: str, value: Any, clock: Vector | None, objects: dict[str, str]
) -> Iterator[tuple[str, LoggedSignal]]:
    """Yield the signals in a matrix, in structures, or in the parts of a cell array; note an object by its class."""
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque):
        entry = value.reshape(-1)[0]
        # older versions of SciPy have s0 to s2: name, system, class
        known = "_Class" in (value.dtype.names or ())
        objects[name if known else str(entry["s0"])] = str(entry["_Class" if known else "s2"])
    elif not isinstance(value, np.ndarray):
        return
    elif value.dtype.names or value.dtype == object:
        parts = value.reshape(-1)
        for place, part in enumerate(parts):
            own = f"{name}.{place + 1}" if len(parts) > 1 else name
            if value.dtype.names:
                yield from _in_structure(
                    own, {field: part[field] for field in value.dtype.names}, clock, objects
                )
            else:
                yield from _in_value(own, part, clock, objects)
    elif value.dtype.kind in "fiub" and value.size > 1:
        yield from _in_matrix(name, value.astype(float), clock)


def _in_matrix(
    name: str, value: Vector, clock: Vector | None
) -> Iterator[tuple[str, LoggedSignal]]:
    """Yield the columns of a matrix beside its times, or of one that holds them; of another length they are none."""
    rows = value.reshape(-1, value.shape[-1])  # of n x 1 x m, one sample a page
    if clock is not None and len(clock) not in rows.shape:
        clock = None
    if clock is None:
        rows = rows if rows.shape[0] < rows.shape[1] else rows.T
        rising = rows.shape[0] > 1 and rows[0, 0] >= 0 and bool(np.all(np.diff(rows[0]) > 0))
        if not rising:
            return
        clock, rows = rows[0], rows[1:]
    elif len(clock) == rows.shape[0]:
        rows = rows.T
    for place, row in enumerate(rows):
        yield (name if len(rows) == 1 else f"{name}.{place + 1}"), LoggedSignal(clock, row)


def _vector(value: Any) -> Vector | None:
    plain = isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size > 1
    return value.astype(float).reshape(-1) if plain and value.size == max(value.shape) else None


NUMBERS = "differences.csv"  # the file that every folder of a comparison holds


@dataclass(frozen=True)
class SignalDifference:
    """How one signal differs."""

    signal: str  # its name in ours
    times: Vector  # of the log, shape (m,) [s]
    logged: Vector  # shape (m,)
    ours: Vector  # shape (m,)
    unit: str  # of the signal

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


def compare(
    config: StationConfig, logged: Mapping[str, LoggedSignal], *, progress: bool = False
) -> tuple[SimulationResult, list[SignalDifference]]:
    """Run a station and hold its signals against logged ones, each at the times of its own.

    Columns ``q_ref.<axis>``, if there is one for every axis of the only robot, become its reference.

    Args:
        config: the station.
        logged: signals by our names.
        progress: show a bar on a terminal.

    Raises:
        InvalidParameter: none of the signals is one of the station's, one has another unit or holds what is no number,
            or the run ended before the log begins.
    """
    end = max(signal.times[-1] for signal in logged.values())
    result = simulate(
        config, duration=float(end), reference=_reference(config, logged), progress=progress
    )
    known = {name: signal for name, signal in logged.items() if name in result.names}
    if not known:
        found = ", ".join(list(logged)[:5])
        raise InvalidParameter(
            "--with",
            found,
            message(
                "simulink.signals_with_names",
                "signals such as q.<axis>; rename them with --map THEIRS=OURS",
            ),
        )
    return result, [_difference(name, signal, result) for name, signal in known.items()]


def _difference(name: str, logged: LoggedSignal, result: SimulationResult) -> SignalDifference:
    """Compare a logged signal, until the end of a run, with the run's signal at the same times.

    Raises:
        InvalidParameter: the log begins after the run ended, or has values that are no numbers.
    """
    inside = logged.times <= result.times[-1]
    if not inside.any():
        end = message(
            "simulink.where_run_ended",
            "{time:g} s, where the run ended ({ending})",
            time=result.stop_time,
            ending=result.message,
        )
        raise InvalidParameter(
            "--with",
            message("simulink.log_from", "a log from {time:g} s on", time=logged.times[0]),
            message("simulink.begins_before", "one that begins before {end}", end=end),
        )
    times, values, unit = (
        logged.times[inside],
        _in_si(name, logged, result.units[name])[inside],
        result.units[name],
    )
    return SignalDifference(name, times, values, np.interp(times, result.times, result[name]), unit)


def _in_si(name: str, logged: LoggedSignal, unit: str) -> Vector:
    if not np.all(np.isfinite(logged.values)):
        at = logged.times[~np.isfinite(logged.values)][0]
        raise InvalidParameter(
            "--with",
            message(
                "simulink.without_a_number", "{name} without a number at {at:g} s", name=name, at=at
            ),
            message("base.finite_numbers", "finite numbers"),
        )
    try:
        return logged.values * (factor(logged.unit, plain_unit(unit)) if logged.unit else 1.0)
    except UnknownUnit as problem:
        raise InvalidParameter(
            "--map",
            f"{name}:{logged.unit}",
            message(
                "simulink.unit_like",
                "of a unit like {unit} ({problem})",
                unit=unit,
                problem=problem,
            ),
        ) from problem


def _reference(config: StationConfig, logged: Mapping[str, LoggedSignal]) -> Vector | None:
    if config.only_robot is None:
        return None
    model = resolve(config).robots[config.only_robot].model
    names = {f"q_ref.{axis}": unit.si for axis, unit in zip(model.axes, model.units, strict=True)}
    if not all(name in logged for name in names):
        return None
    times = logged[next(iter(names))].times
    columns = [
        np.interp(times, logged[name].times, _in_si(name, logged[name], unit))
        for name, unit in names.items()
    ]
    return np.column_stack([times, *columns])


def save_differences(
    differences: list[SignalDifference], folder: Path | str, *, force: bool = False
) -> None:
    """Write the numbers, and a picture of each signal with its log and their difference below.

    Raises OutputError: the folder cannot be written, or is there and not to be replaced.
    """
    with filled_at_once(as_path(folder, "folder"), marker=NUMBERS, force=force) as work:
        rows = [
            f"{found.signal},{found.largest:.9g},{found.at:.9g},{found.rms:.9g}\n"
            for found in differences
        ]
        (work / NUMBERS).write_text("".join(["signal,largest,at,rms\n", *rows]), encoding="utf-8")
        for found in differences:
            _save_picture(found, work / f"{found.signal}.png")


def _save_picture(found: SignalDifference, file: Path) -> None:
    from simrob_drake.results.plots.own import panels, save_figure

    figure, ((upper,), (lower,)) = panels(
        found.signal, 2, size=(8, 5), sharex=True, height_ratios=(2, 1)
    )
    upper.plot(found.times, found.logged, label="logged")
    upper.plot(found.times, found.ours, "--", label="ours")
    lower.plot(found.times, found.ours - found.logged, color=RED)
    upper.set_ylabel(f"{found.signal} [{found.unit}]")
    lower.set_ylabel(f"ours - logged [{found.unit}]")
    lower.set_xlabel("time [s]")
    save_figure(figure, file)
