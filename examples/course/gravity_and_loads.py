"""Solution of exercise 3 of the course, gravity and loads, with a figure of what an arm can carry and where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from simrob_drake.results.plots.own import panels, save_figure

GRAVITY = 9.80665  # m/s^2
UPPER_ARM = (3.909, 0.00078, 0.10124)
FOREARM = [
    (2.944, 0.02281, 0.05791),
    (1.328, 0.2247, 0.07041),
    (0.546, 0.30091, 0.07006),
    (0.137, 0.36694, 0.07),
]
FLANGE = (0.374, 0.07)
LENGTH = 0.270  # m, of the upper arm
BEFORE = 0.05  # m, of the load before the flange
STIFFNESS = 1000.0  # N·m/rad, of the servos under the feedforward


def ahead(x: float, z: float, angle: float) -> float:
    """Return how far ahead a point is after a turn about y."""
    return x * np.cos(angle) + z * np.sin(angle)


def gravity(q2: float, q3: float, load: float) -> tuple[float, float]:
    """Return the torques against the weights: minus each weight times how far ahead of the joint it is."""
    parts = [*FOREARM, (load, FLANGE[0] + BEFORE, FLANGE[1])]
    elbow = -GRAVITY * sum(mass * ahead(x, z, q2 + q3) for mass, x, z in parts)
    carried = sum(mass for mass, _, _ in parts) * ahead(0, LENGTH, q2)
    mass, x, z = UPPER_ARM
    return elbow - GRAVITY * (carried + mass * ahead(x, z, q2)), elbow


def aware(load: float) -> float:
    """Return the load less what half a degree of the servo's spring gives at this posture."""
    q2, q3 = np.deg2rad([40.5, -20.0])
    for_one = gravity(q2, q3, 1.0)[0] - gravity(q2, q3, 0.0)[0]
    return load - STIFFNESS * np.deg2rad(0.5) / abs(for_one)


def weakest(load: float) -> tuple[float, float]:
    """Return where the torque of joint 2 is largest: all of the arm on a level line."""
    found = minimize(
        lambda q: gravity(q[0], q[1], load)[0], [1.5, -1.2], bounds=[(-1.9, 1.9), (-1.9, 1.2)]
    )
    return float(found.x[0]), float(found.x[1])


def payload(limit: float) -> float:
    """Return the load that takes what the arm leaves; the torque is linear in it."""
    q2, q3 = np.deg2rad([90.0, -70.0])
    empty, one = abs(gravity(q2, q3, 0.0)[0]), abs(gravity(q2, q3, 1.0)[0])
    return (limit - empty) / (one - empty)


def picture(file: Path) -> Path:
    """Draw the torque of joint 2 over its angle, with the forearm stretched, and the payload over the limit."""
    figure, ((torque, carried),) = panels(
        "What the shoulder of an IRB120 carries", 1, 2, size=(8, 3.5)
    )
    angles = np.linspace(-90, 100, 100)
    for load in (0, 2, 4):
        stretched = [gravity(q2, np.deg2rad(-70), load)[0] for q2 in np.deg2rad(angles)]
        torque.plot(angles, stretched, label=f"{load} kg")
    torque.set_xlabel("joint 2 [°], joint 3 at -70°")
    torque.set_ylabel("torque of joint 2 [N·m]")
    limits = np.linspace(24, 80, 50)
    carried.plot(limits, [payload(limit) for limit in limits], color="#4b4b4b")
    carried.set_xlabel("limit of joint 2 [N·m]")
    carried.set_ylabel("payload, stretched out [kg]")
    return save_figure(figure, file)


def main() -> None:
    """Print what the functions give, and draw."""
    print("at 30 degrees:", np.round(gravity(np.deg2rad(30), 0, 0), 2), "N·m")
    q2, q3 = weakest(2.0)
    print(
        f"weakest with 2 kg at {np.rad2deg([q2, q3]).round(1)} degrees: {gravity(q2, q3, 2.0)[0]:.2f} N·m"
    )
    print(
        f"payload at 30 N·m {payload(30):.2f} kg, at 60 N·m {payload(60):.2f} kg; belief {aware(3.0):.2f} kg"
    )
    print(picture(Path("runs/course/gravity_and_loads.png")))


if __name__ == "__main__":
    main()
