"""A ball on floors of many kinds: a soft one gives way, one that dissipates little lets it bounce for long."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

STIFFNESSES = (300.0, 1e3, 1e4, 1e5)  # N/m
DISSIPATIONS = (0.0, 0.05, 0.2, 1.0)  # s/m
UNITS = {"stiffness": "N/m", "dissipation": "s/m"}


def run(
    key: str, values: Sequence[float], *, duration: float = 1.5
) -> dict[float, SimulationResult]:
    """Let the ball fall with each value of ``contact.stiffness`` or ``contact.dissipation``."""
    stations = {value: load_station("bouncing_ball", {f"contact.{key}": value}) for value in values}
    return {
        value: simulate(station, duration=duration, progress=False)
        for value, station in stations.items()
    }


def picture(sweeps: dict[str, dict[float, SimulationResult]], file: Path) -> Path:
    """Draw the height of the ball's lowest point, a panel for each sweep."""
    titles = [f"{key} [{UNITS[key]}]" for key in sweeps]
    title = "a ball on floors of many kinds"
    figure, (row,) = panels(title, 1, len(sweeps), size=(11, 4), titles=titles, sharey=True)
    for axes, (key, results) in zip(row, sweeps.items(), strict=True):
        for value, result in results.items():
            axes.plot(result.times, 1e3 * result["distance.gap"], label=f"{value:g} {UNITS[key]}")
        axes.axhline(0, color="0.4", linewidth=0.8)
        axes.set_xlabel("time [s]")
    figure.axes[0].set_ylabel("lowest point of the ball over the floor [mm]")
    return save_figure(figure, file, beside=True)


def main() -> None:
    """Print how deep the ball goes in and how high it comes back, and draw it."""
    sweeps = {
        "stiffness": run("stiffness", STIFFNESSES),
        "dissipation": run("dissipation", DISSIPATIONS),
    }
    for key, results in sweeps.items():
        for value, result in results.items():
            gap, speed = result["distance.gap"], result["piece.ball.vz"]
            back = gap[(result.times > result.times[gap.argmin()]) & (speed > -0.2)].max(
                initial=0.0
            )
            print(
                f"{key} {value:8g}: {-1e3 * gap.min():5.1f} mm deep, comes back to {1e3 * back:5.1f} mm"
            )
    print(picture(sweeps, Path("runs/bouncing_ball_sweep.png")))


if __name__ == "__main__":
    main()
