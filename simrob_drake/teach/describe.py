"""What the pendant is told of a station: robots with their axes and what they can do, pieces, bodies, signals."""

from typing import Any

from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.site import StationRobot
from simrob_drake.parts.targets import frame_names
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.workcell import Workcell
from simrob_drake.signals import Signal
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import build_station


def description(cell: Workcell) -> dict[str, Any]:
    """Return what a station is, as plain data."""
    config, station = cell.config, resolve(cell.config)
    shown = build_station(config).ports.signals
    return {
        "station": config.name,
        "mode": config.mode,
        "robots": {name: _robot(cell, config, name) for name in config.robots},
        "pieces": list(config.pieces),
        "bodies": [name for name in (*config.robots, *frame_names(station)) if name != "world"],
        "loops": list(loops_of(config.controllers)),
        "monitors": list(config.monitors),
        "floor": config.floor is not None,
        "signals": [
            {"name": signal.output, "unit": signal.units[0], "title": _title(signal), "columns": list(signal.names)}
            for signal in shown
            if signal.output and signal.compute is None and signal.entries is None
        ],
    }


def _title(signal: Signal) -> str:
    return signal.panel.title if signal.panel else signal.output.replace("_", " ").replace(".", ": ")


def kind_of(robot: StationRobot) -> str:
    """Return what a robot is taught as: legs, arm, or other."""
    if robot.model.feet is not None:
        return "legs"
    return "arm" if robot.model.tools and robot.model.base == "fixed" else "other"


def _robot(cell: Workcell, config: StationConfig, name: str) -> dict[str, Any]:
    robot = cell.robot(name)
    model = robot.model
    lower, upper = (limit / model.user_units for limit in model.axis_limits)
    now = cell.position(name) / model.user_units
    axes = [
        {
            "name": axis,
            "aliases": list(model.axes[axis].aliases),
            "unit": unit,
            "low": float(lower[place]),
            "high": float(upper[place]),
            "now": float(now[place]),
        }
        for place, (axis, unit) in enumerate(zip(model.axes, model.unit_names, strict=True))
    ]
    legged = model.feet is not None
    return {
        "model": model.name,
        "kind": kind_of(robot),
        "axes": axes,
        "tools": list(model.tools),
        "links": cell.model.links(name),
        "tcp": robot.tcp,
        "gaits": list(gaits_of(model, steps=True)) if legged else [],
        "acts": list(gaits_of(model, steps=False)) if legged else [],
        "pieces": [piece for piece, one in resolve(config).pieces.items() if one.carrier == name],
    }
