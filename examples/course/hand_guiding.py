"""Solution of exercise 6 of the course, guided by hand, with a figure of pushes at several gains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simrob_drake import Arm, SimulationResult, as_transform, load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

Vector = NDArray[np.float64]
STATION = "irb120_cobot"
HOME = np.deg2rad([0, 0, 0, 0, 90, 0])
FINE = {"solver.accuracy": 1e-3, "solver.max_step": 0.02}
STIFFNESS = 1000.0  # N·m/rad

arm = Arm(load_station(STATION))
axes = as_transform(arm.pose(HOME)).rotation().matrix()
jacobian = arm.jacobian(HOME)[:3]


def run(gain: float, force: list[float], seconds: float, kd: float = 10) -> SimulationResult:
    """Push the tool with a force [N] for so many seconds from 0.5 s on, and wait for two more."""
    push = {"kind": "push", "start": 0.5, "duration": seconds, "force": force}
    servo = {"servo.admittance_gain": gain, "servo.kd": kd}
    station = load_station(STATION, {**FINE, **servo, "forces": {"hand": push}})
    return simulate(station, duration=seconds + 2.5, progress=False)


def hand_force(q: Vector, torque: Vector) -> Vector:
    """Return the force that explains what the motors give besides gravity: J' f = gravity - torque."""
    unexplained = arm.dynamics.gravity(q) - torque
    force = np.linalg.lstsq(arm.jacobian(q)[:3].T, unexplained, rcond=None)[0]
    return np.asarray(as_transform(arm.pose(q)).rotation().matrix().T @ force)


def speed(gain: float, force: Vector) -> Vector:
    """Return J J' f gain / kp: below the gain the servo is a damper of kp / gain in every joint."""
    return jacobian @ jacobian.T @ axes @ np.asarray(force) * gain / STIFFNESS


def gain_for(asked: float) -> float:
    """Return the gain; the speed is linear in it."""
    return asked / float(speed(1.0, np.array([0, 3.0, 0]))[0])


def stiffest() -> Vector:
    """Return the eigenvector of J J' that belongs to the smallest eigenvalue."""
    return np.asarray(axes.T @ np.linalg.eigh(jacobian @ jacobian.T).eigenvectors[:, 0])


def settings() -> tuple[float, float]:
    """Return a gain that is just enough: the more it yields, the longer the arm's own mass coasts."""
    return 320.0, 10.0


def picture(file: Path) -> Path:
    """Draw where a push takes the tool."""
    figure, ((way,),) = panels("2 N along y for half a second", size=(7, 3.5))
    for gain in (0.0, 100.0, 320.0, 1000.0):
        result = run(gain, [0, 2.0, 0], 0.5)
        tool = result.pose("tcp")[:, :3]
        late = result.times >= 0.5
        moved = 1e3 * np.linalg.norm(tool[late] - tool[late][0], axis=1)
        way.plot(result.times[late], moved, label=f"gain {gain:g} 1/s")
    way.axvspan(0.5, 1.0, color="#dddddd")
    way.set_xlabel("time [s], the push in grey")
    way.set_ylabel("way of the tool [mm]")
    return save_figure(figure, file)


def main() -> None:
    """Print what the functions give, and draw."""
    result = run(0.0, [0, 2.0, 0], 2.0)
    at = round(2.4 * result.config.sample_rate)
    print("felt:", np.round(hand_force(result.axes("q")[at], result.axes("tau")[at]), 2), "N")
    print("gain 300: 2 N along y give", np.round(speed(300.0, np.array([0, 2.0, 0])), 3), "m/s")
    print(
        f"0.1 m/s under 3 N: gain {gain_for(0.1):.0f}; stiffest along {np.round(stiffest(), 3)} of the tool"
    )
    print(picture(Path("runs/course/hand_guiding.png")))


if __name__ == "__main__":
    main()
