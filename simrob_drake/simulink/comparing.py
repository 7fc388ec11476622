"""Hold logged signals of the original against ours: differences in numbers and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simrob_drake import simulate
from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter
from simrob_drake.folders import filled_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.colours import RED
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulink.logs import LoggedSignal
from simrob_drake.simulink.values.units import UnknownUnit, factor, plain_unit
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

NUMBERS = "differences.csv"
"""The file that every folder of a comparison holds."""


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
    result = simulate(config, duration=float(end), reference=_reference(config, logged), progress=progress)
    known = {name: signal for name, signal in logged.items() if name in result.names}
    if not known:
        found = ", ".join(list(logged)[:5])
        raise InvalidParameter("--with", found, "signals such as q.<axis>; rename them with --map THEIRS=OURS")
    return result, [_difference(name, signal, result) for name, signal in known.items()]


def _difference(name: str, logged: LoggedSignal, result: SimulationResult) -> SignalDifference:
    inside = logged.times <= result.times[-1]
    if not inside.any():
        end = f"{result.stop_time:g} s, where the run ended ({result.message})"
        raise InvalidParameter("--with", f"a log from {logged.times[0]:g} s on", f"one that begins before {end}")
    times, values, unit = logged.times[inside], _in_si(name, logged, result.units[name])[inside], result.units[name]
    return SignalDifference(name, times, values, np.interp(times, result.times, result[name]), unit)


def _in_si(name: str, logged: LoggedSignal, unit: str) -> Vector:
    """Return the values of a logged signal in the unit that it has here."""
    if not np.all(np.isfinite(logged.values)):
        at = logged.times[~np.isfinite(logged.values)][0]
        raise InvalidParameter("--with", f"{name} without a number at {at:g} s", "finite numbers")
    try:
        return logged.values * (factor(logged.unit, plain_unit(unit)) if logged.unit else 1.0)
    except UnknownUnit as problem:
        raise InvalidParameter("--map", f"{name}:{logged.unit}", f"of a unit like {unit} ({problem})") from problem


def _reference(config: StationConfig, logged: Mapping[str, LoggedSignal]) -> Vector | None:
    if config.only_robot is None:
        return None
    model = resolve(config).robots[config.only_robot].model
    names = {f"q_ref.{axis}": unit.si for axis, unit in zip(model.axes, model.units, strict=True)}
    if not all(name in logged for name in names):
        return None
    times = logged[next(iter(names))].times
    columns = [np.interp(times, logged[name].times, _in_si(name, logged[name], unit)) for name, unit in names.items()]
    return np.column_stack([times, *columns])


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
