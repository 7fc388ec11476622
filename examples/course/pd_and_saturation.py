"""Solution of exercise 2 of the course, PD servos and their saturation, with a figure of limits that are too low."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

HOLDING = 20.8  # N·m that joint 2 gives at 30 degrees; it changes by 1 % with what the arm sags


def run(**settings: object) -> SimulationResult:
    """Run the move with settings of the servos."""
    station = load_station(
        "irb120_dynamic", {f"servo.{key}": value for key, value in settings.items()}
    )
    return simulate(station, duration=3.0, progress=False)


def sag(kp: float) -> float:
    """Return the error [deg] with which a spring of kp [N·m/rad] gives the holding torque."""
    return float(np.rad2deg(HOLDING / kp))


def gains() -> tuple[float, float]:
    """Return gains: 20.8 N·m over 0.4 degrees asks for 3000 N·m/rad; damping until the overshoot is small enough."""
    return 3500.0, 80.0


def torque_limit() -> float:
    """Return a limit above 22.9 N·m, which fails: more than holding takes, as the arm has to be braked."""
    return 23.2


def disturbed() -> str:
    """Return the joint that hangs on joint 2 and is heavy: what happens to one acts on the other."""
    return "joint_3"


def picture(file: Path) -> Path:
    """Draw joint 2 and its torque with four limits."""
    figure, ((angle,), (torque,)) = panels(
        "Joint 2 with limits of its torque", 2, size=(7, 5), sharex=True
    )
    for limit in (30.0, 23.0, 22.0, 10.0):
        result = run(torque_limit={"joint_2": limit})
        angle.plot(result.times, np.rad2deg(result["q.joint_2"]), label=f"{limit:g} N·m")
        torque.plot(result.times, result["tau.joint_2"], label=f"{limit:g} N·m")
    angle.set_ylabel("position [°]")
    torque.set_ylabel("torque [N·m]")
    torque.set_xlabel("time [s]")
    return save_figure(figure, file)


def main() -> None:
    """Print what the gains give, and draw."""
    kp, kd = gains()
    result = run(kp=kp, kd=kd)
    print(
        f"joint 2 ends {np.rad2deg(result['q.joint_2'][-1]) - 30:.3f} degrees beyond; foreseen {sag(kp):.3f}"
    )
    print(f"and gives up to {np.abs(result['tau.joint_2']).max():.1f} N·m")
    print(picture(Path("runs/course/pd_and_saturation.png")))


if __name__ == "__main__":
    main()
