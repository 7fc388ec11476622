"""Plots of free pieces and of sensors: where pieces were, what forces and distances were measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from simrob_drake.results.record.run import RecordedRun
from simrob_drake.stations.names import named
from simrob_drake.stations.sensor_config import Distance, ExternalTorque, Force
from simrob_drake.stations.sensors import tangential_source

_COLOURS = ("#1f6fb4", "#e08214", "#4d9221")
_STOP = "#d7301f"
_WIDTH, _PANEL_HEIGHT = 8.0, 2.2  # inches

Panel = tuple[str, str, Sequence[str]]
"""Title, label of the axis, and the signals that are drawn."""


def sensor_figures(result: RecordedRun) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a run with their names: ``piece_<piece>`` for each free piece, and ``sensors``."""
    for piece in result.config.free_pieces:
        own = f"piece.{piece}"
        panels: list[Panel] = [
            ("position", "[m]", [f"{own}.{axis}" for axis in "xyz"]),
            ("velocity", "[m/s]", [f"{own}.v{axis}" for axis in "xyz"]),
        ]
        yield f"piece_{piece}", _figure(result, f"the piece '{piece}' in the world", panels)
    measured = list(_sensor_panels(result))
    if measured:
        yield "sensors", _figure(result, "sensors", measured)


def _sensor_panels(result: RecordedRun) -> Iterator[Panel]:
    for name, sensor in result.config.sensors.items():
        match sensor:
            case Force():
                source = tangential_source(result.plant, result.config, sensor)
                across = "" if source == "contact" else f" (along the surface: {source})"
                yield f"contact force '{name}'{across}", "[N]", [f"force.{name}.{axis}" for axis in "xyz"]
            case Distance():
                yield f"distance '{name}'", "[m]", [f"distance.{name}"]
            case ExternalTorque() if f"external_force.{name}.x" in result.names:
                text = f"force at the tool, estimated by '{name}', in its axes"
                yield text, "[N]", [f"external_force.{name}.{axis}" for axis in "xyz"]
            case _:
                signals = [column for column in result.names if column.startswith(f"{sensor.kind}.{name}.")]
                robot = named(getattr(sensor, "robot", None), list(result.plant.robots))
                units = dict.fromkeys(result.plant.robots[robot].model.effort_units)
                yield f"{sensor.kind.replace('_', ' ')} '{name}'", f"[{', '.join(units)}]", signals


def _figure(result: RecordedRun, title: str, panels: Sequence[Panel]) -> Figure:
    figure = Figure(figsize=(_WIDTH, _PANEL_HEIGHT * len(panels) + 0.8), layout="constrained")
    figure.suptitle(f"{result.config.name}: {title}", fontsize=12, fontweight="bold")
    for axes, (name, unit, signals) in zip(figure.subplots(len(panels), squeeze=False)[:, 0], panels, strict=True):
        for place, signal in enumerate(signals):
            colour = _COLOURS[place % len(_COLOURS)]
            axes.plot(result.times, result[signal], color=colour, linewidth=1.5, label=signal.rpartition(".")[2])
        if result.stopped_by:
            axes.axvline(result.stop_time, color=_STOP, linewidth=1.4, linestyle=":", label="stop")
        axes.set_title(name, loc="left", fontsize=10)
        axes.set_ylabel(unit)
        axes.grid(color="0.9")
        axes.spines[["top", "right"]].set_visible(False)
        if len(axes.get_lines()) > 1:
            axes.legend(fontsize=8, loc="upper right", ncols=len(axes.get_lines()))
    axes.set_xlabel("time [s]")
    return figure
