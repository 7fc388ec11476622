"""Solution of exercise 7 of the course, standing on two feet, with a figure of pushes that fell a humanoid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake.results.plots.own import panels, save_figure

MASS, GRAVITY = 2.292, 9.80665  # kg, m/s^2
COM_HEIGHT, PUSH_HEIGHT, ANKLE_HEIGHT = 0.228, 0.319, 0.030  # m
INERTIA = 0.037  # kg m^2
TOES = {"spheres_B": 0.079, "spheres_C": 0.132}  # m
HEELS = {"spheres_B": 0.030, "spheres_C": 0.049}
STEP = 1e-3  # s
MEASURED = {
    "spheres_B": {0.1: 4.7, 0.2: 2.9, 2.0: 1.8},
    "spheres_C": {0.1: 8.1, 0.2: 5.2, 2.0: 3.3},
}  # N, back


def steady_push(ahead: bool, feet: str) -> float:
    """Return the force whose moment about the edge is that of the weight."""
    return MASS * GRAVITY * (TOES if ahead else HEELS)[feet] / PUSH_HEIGHT


def tips(force: float, seconds: float, edge: float) -> bool:
    """Tell whether a rigid body tips over an edge [m] away after a push."""
    inertia = INERTIA + MASS * (edge**2 + COM_HEIGHT**2)
    angle = speed = 0.0
    for step in range(2000):
        lever = edge * np.cos(angle) - COM_HEIGHT * np.sin(angle)  # of the weight, against tipping
        pushed = force * PUSH_HEIGHT * np.cos(angle) if step * STEP < seconds else 0.0
        speed += STEP * (pushed - MASS * GRAVITY * lever) / inertia
        angle += STEP * speed
        if angle < 0:
            angle = speed = 0.0  # the floor holds it
        if lever < 0 and speed > 0:  # past the top, and going on
            return True
    return False


def short_push(seconds: float, feet: str) -> float:
    """Return by bisection the force that just tips it back."""
    low, high = 0.0, 50.0
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if tips(middle, seconds, HEELS[feet]) else (middle, high)
    return high


def lean() -> float:
    """Return the angle that brings the centre of mass over the middle of the feet: ahead, which is negative."""
    ahead = (TOES["spheres_B"] - HEELS["spheres_B"]) / 2
    return float(-np.rad2deg(np.arcsin(ahead / (COM_HEIGHT - ANKLE_HEIGHT))))


def picture(file: Path) -> Path:
    """Draw the forces that tip it over their duration, and some that runs have shown."""
    figure, ((axes,),) = panels("Pushes back that fell the humanoid", size=(7, 3.5))
    times = np.geomspace(0.05, 2, 16)
    for feet, found in MEASURED.items():
        (line,) = axes.plot(
            times, [short_push(time, feet) for time in times], label=f"a rigid body on {feet}"
        )
        axes.plot(list(found), list(found.values()), "o", color=line.get_color(), label="runs")
    axes.set_xscale("log")
    axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2], ["0.05", "0.1", "0.2", "0.5", "1", "2"])
    axes.set_xlabel("duration [s]")
    axes.set_ylabel("force [N]")
    return save_figure(figure, file)


def main() -> None:
    """Print what the functions give, and draw."""
    for feet in TOES:
        print(
            f"{feet}: steady {steady_push(True, feet):.2f} N ahead, {steady_push(False, feet):.2f} N back;",
            end=" ",
        )
        print(f"0.1 s {short_push(0.1, feet):.2f} N back")
    print(f"even on both sides with ankles at {lean():.1f} degrees")
    print(picture(Path("runs/course/standing.png")))


if __name__ == "__main__":
    main()
