"""Lesson 5, tune it: what gains do, on a grid and by a search, and whether it holds with another load."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from simrob_drake import Runner, load_station

BOUND = 45.0  # N·m that joint 2 may give


def cost(kp: float, kd: float, load: float = 1.0) -> tuple[float, float]:
    """Return the rms error of all joints [deg], and the largest torque of joint 2 [N·m]."""
    changes = {"servo.kp": kp, "servo.kd": kd, "pieces.load.mass": load}
    result = Runner(load_station("irb120_dynamic", changes)).run(duration=2.0, progress=False)
    error = np.rad2deg(result.axes("q") - result.axes("q_ref"))
    return float(np.sqrt(np.mean(error**2))), float(np.abs(result["tau.joint_2"]).max())


def total(logs: np.ndarray) -> float:
    """Return what a search makes small: the error, and what passes the bound."""
    error, torque = cost(*10**logs)
    return error + max(torque - BOUND, 0.0)


def main() -> None:
    """Try a grid, search from the start, and prove what was found."""
    for kp in (500, 2000, 8000):
        row = ", ".join(f"{cost(kp, kd)[0]:.2f}" for kd in (10, 40, 160))
        print(f"kp {kp}, kd 10, 40, 160: errors of {row} degrees")
    found = minimize(total, np.log10([1000, 10]), method="Nelder-Mead", options={"maxfev": 40})
    kp, kd = 10**found.x
    error, torque = cost(kp, kd)
    print(f"found kp {kp:.0f}, kd {kd:.0f}: {error:.2f} degrees with {torque:.1f} N·m")
    error, torque = cost(kp, kd, load=3.0)
    print(f"with 3 kg instead of one: {error:.2f} degrees with {torque:.1f} N·m")


if __name__ == "__main__":
    main()
