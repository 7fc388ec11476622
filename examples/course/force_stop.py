"""Solution of exercise 5 of the course, stop at a force, with a figure of forces after touching."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import Arm, SimulationResult, load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

STATION = "irb120_force_stop"
STRONG = {
    "servo.torque_limit": 500,
    "servo.kd": 50,
    "contact.friction": {"static": 0, "dynamic": 0},
}
FLOOR, DISSIPATION = 1e5, 1.0  # N/m, s/m
HOME = np.deg2rad([0, 0, 26.1, 0, 63.9, 0])
RADIUS = 0.01  # m, of the ball
WAY = 0.25  # m that the tip goes down, to 60 mm below the floor
BEFORE = 0.19  # m of it above the floor

arm = Arm(load_station(STATION))


def below(deep: float) -> list[float]:
    """Return the joint angles [deg] for a depth [m]."""
    pose = arm.pose(HOME).copy()
    pose[2] = RADIUS - deep
    return [float(angle) for angle in np.rad2deg(arm.joint(pose))]


def run(deep: float, seconds: float = 2.0, **changes: Any) -> SimulationResult:
    """Let the reference go down to a depth [m] in so many seconds, and wait a second."""
    moves = {"reference.target_deg": below(deep), "reference.duration": seconds}
    station = load_station(STATION, {**moves, "monitors": {}, **changes})
    return simulate(station, duration=seconds + 1, progress=False)


def stiffness(kp: float) -> float:
    """Return springs in a row: the servos, seen from the tip along z, and the floor."""
    upwards = arm.jacobian(np.deg2rad(below(0.0)))[2]
    return 1 / (upwards @ upwards / kp + 1 / FLOOR)


def depth(force: float) -> float:
    """Return the depth from one measured force, which holds what gravity adds, and the stiffness."""
    known = 0.005
    return known + (force - float(run(known, **STRONG)["force.touch.z"][-1])) / stiffness(1000.0)


def monitors(limit: float) -> dict[str, Any]:
    """Return a monitor of the station's force sensor."""
    return {"stop": {"kind": "force_limit", "limit": limit}}


def force_after(speed: float, delay: float) -> float:
    """Return what the floor gives while the tip goes on as before: k x (1 + d x')."""
    return FLOOR * speed * delay * (1 + DISSIPATION * speed)


def shortest(limit: float) -> float:
    """Return the time of the fifth-order move whose speed at the floor is just allowed."""
    delay = 0.004
    speed = (np.sqrt(1 + 4 * DISSIPATION * limit / (FLOOR * delay)) - 1) / (2 * DISSIPATION)
    s = np.linspace(0, 1, 10001)
    done, rate = 10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 - 60 * s**3 + 30 * s**4
    return float(WAY * np.interp(BEFORE / WAY, done, rate) / speed)


def picture(file: Path) -> Path:
    """Draw forces after touching for three durations."""
    figure, ((axes,),) = panels("The force on the tip after it touches the floor", size=(7, 3.5))
    fine = {"sample_rate": 5000, "solver.accuracy": 1e-4, "solver.max_step": 0.01}
    for seconds in (1.0, shortest(140.0), 3.0):
        result = run(0.06, seconds, **fine)
        force = result["force.touch.z"]
        first = int(np.argmax(force > 0))
        axes.plot(1e3 * (result.times[first : first + 41] - result.times[first]), force[first : first + 41],
                  label=f"down in {seconds:.2f} s")  # fmt: skip
    axes.axhline(140, color="#777777", linestyle="--", label="140 N, a hand's limit")
    axes.set_xlabel("time after touching [ms]")
    axes.set_ylabel("force [N]")
    return save_figure(figure, file)


def main() -> None:
    """Print what the functions give, and draw."""
    print(f"stiffness at the tip, kp 1000: {stiffness(1000):.0f} N/m")
    print(f"to press with 40 N: {1e3 * depth(40):.2f} mm, with 90 N: {1e3 * depth(90):.2f} mm")
    print(f"3 ms after touching at 0.3 m/s: {force_after(0.3, 0.003):.0f} N")
    print(f"140 N at most after 4 ms: {shortest(140.0):.2f} s")
    print(picture(Path("runs/course/force_stop.png")))


if __name__ == "__main__":
    main()
