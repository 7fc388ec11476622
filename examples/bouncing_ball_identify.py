"""Find stiffness and dissipation of a floor from a measured bounce: ``python bouncing_ball_identify.py [TRACE.csv]``.

The file has the columns ``time`` [s] and ``height`` [m] of the ball's lowest point. Without one, a run of the station
with 1 mm of noise on it stands for a measurement.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.identification.bounces import BounceTrace, Identified, identify_bounces, read_bounces
from simrob_drake.results.plots.own import panels, save_figure

BALL = 0.9048  # kg
NOISE = 1e-3  # m


def measurement(*, stiffness: float = 4e3, dissipation: float = 0.08, duration: float = 1.2) -> BounceTrace:
    """Return what a camera of 250 pictures a second would have seen of the station's ball."""
    contact = {"contact.stiffness": stiffness, "contact.dissipation": dissipation}
    station = load_station("bouncing_ball", {**contact, "sample_rate": 250, "solver.accuracy": 1e-5})
    result = simulate(station, duration=duration, progress=False)
    noise = np.random.default_rng(seed=5).normal(0.0, NOISE, len(result.times))
    return BounceTrace(result.times, result["distance.gap"] + noise)


def picture(trace: BounceTrace, found: Identified, file: Path) -> Path:
    """Draw measured and computed heights."""
    figure, ((axes,),) = panels("a ball that bounces, measured and computed", size=(9, 4))
    axes.plot(trace.times, 1e3 * trace.heights, ".", markersize=3, color="0.6", label="measured")
    text = f"computed with {found.stiffness:.4g} N/m and {found.dissipation:.3g} s/m"
    axes.plot(trace.times, 1e3 * found.heights, color="#1f6fb4", label=text)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("lowest point of the ball over the floor [mm]")
    return save_figure(figure, file)


def run(file: Path | None = None) -> tuple[BounceTrace, Identified]:
    """Read a trace, or make one, and find the floor's figures."""
    trace = measurement() if file is None else read_bounces(file)
    return trace, identify_bounces(trace, mass=BALL)


def main(file: Path | None = None) -> None:
    """Print the figures with their intervals, and draw both curves."""
    trace, found = run(file)
    for name, unit in (("stiffness", "N/m"), ("dissipation", "s/m")):
        low, high = getattr(found, f"{name}_interval")
        print(f"{name} {getattr(found, name):.4g} {unit}, with 95 % confidence from {low:.4g} to {high:.4g}")
    print(f"what is left: {1e3 * found.residual:.2f} mm rms over {len(trace.times)} samples")
    print(picture(trace, found, Path("runs/bouncing_ball_identify.png")))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
