"""Solution of exercise 4 of the course, a floor from a bounce, with a figure of a bounce and of what was found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, least_squares

from simrob_drake import load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

Vector = NDArray[np.float64]
MASS, GRAVITY = 0.9048, 9.80665  # kg, m/s^2
DROP = 0.1  # m
FLOOR = (1400.0, 0.09)  # N/m, s/m, of the figure
NOISE = 5e-4  # m


def bounced(times: Vector, k: float, d: float) -> Vector:
    """Return the heights [m] of the ball's lowest point after it is let go."""

    def rates(_: float, state: Vector) -> list[float]:
        height, speed = state
        pressed = max(-height, 0.0)
        return [speed, max(k * pressed * (1 - d * speed), 0.0) / MASS - GRAVITY]

    found = solve_ivp(
        rates, (0, times[-1]), [DROP, 0], t_eval=times, max_step=0.002, rtol=1e-6, atol=1e-8
    )
    return np.asarray(found.y[0])


def sink(k: float) -> float:
    """Return where the spring carries the weight."""
    return MASS * GRAVITY / k


def contact_time(k: float) -> float:
    """Return the time below zero of a mass on a spring that comes with the speed of its fall.

    It swings by the amplitude a around its rest, which lies s lower: half a period, and twice the arc asin(s / a).
    """
    rest, frequency = sink(k), np.sqrt(k / MASS)
    speed = np.sqrt(2 * GRAVITY * DROP)
    return float((np.pi + 2 * np.arctan2(rest * frequency, speed)) / frequency)


def identify(times: Vector, heights: Vector) -> tuple[float, float]:
    """Return the figures with the least squares of heights; the deepest point says where to begin."""
    deepest = -heights.min()
    k = 2 * MASS * GRAVITY * (DROP + deepest) / deepest**2  # all energy in the spring
    fits = [
        least_squares(
            lambda x: bounced(times, *np.exp(x)) - heights,
            np.log([k * part, d]),
            diff_step=1e-4,
            x_scale=[0.1, 1],
        )
        for part in (0.7, 1.0)
        for d in (0.05, 0.3)
    ]
    k, d = np.exp(min(fits, key=lambda fit: fit.cost).x)
    return float(k), float(d)


def dissipation_for(height: float) -> float:
    """Return the dissipation whose first rise is as high as asked."""
    times = np.arange(0, 0.5, 1e-3)

    def too_high(d: float) -> float:
        heights = bounced(times, 4000.0, d)
        return float(heights[np.argmax(heights < 0) :].max() - height)

    return float(brentq(too_high, 1e-3, 2.0, xtol=1e-4))


def measured() -> tuple[Vector, Vector]:
    """Return times and heights of a run of the station, with noise."""
    contact = {"model": "point", "stiffness": FLOOR[0], "dissipation": FLOOR[1]}
    result = simulate(
        load_station("bouncing_ball", {"contact": contact, "sample_rate": 250}), duration=0.6
    )
    return result.times, result["distance.gap"] + np.random.default_rng(0).normal(
        0, NOISE, len(result.times)
    )


def picture(file: Path, times: Vector, heights: Vector, k: float, d: float) -> Path:
    """Draw what was measured and what was found."""
    figure, ((axes,),) = panels("A bounce, and the floor that was found from it", size=(7, 3.5))
    axes.plot(times, 1e3 * heights, ".", markersize=4, label="measured")
    axes.plot(times, 1e3 * bounced(times, k, d), label=f"k = {k:.0f} N/m, d = {d:.3f} s/m")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("height [mm]")
    return save_figure(figure, file)


def main() -> None:
    """Print what is found, and draw."""
    times, heights = measured()
    k, d = identify(times, heights)
    print(f"found {k:.0f} N/m and {d:.4f} s/m, the floor's are {FLOOR[0]:.0f} and {FLOOR[1]}")
    print(
        f"at rest it sinks by {1e3 * sink(k):.1f} mm; it touches for {1e3 * contact_time(k):.0f} ms"
    )
    print(f"to rise to 50 mm: {dissipation_for(0.05):.3f} s/m")
    print(picture(Path("runs/course/contact_identification.png"), times, heights, k, d))


if __name__ == "__main__":
    main()
