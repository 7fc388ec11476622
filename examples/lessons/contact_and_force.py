"""Lesson 3, contact and force: a ball that bounces, and an arm that stops when it touches."""

from __future__ import annotations

import numpy as np

from simrob_drake import load_station, simulate


def main() -> None:
    """Drop the ball on three floors, and let the arm stop in two ways."""
    for stiffness in (1000, 10_000, 100_000):
        station = load_station(
            "bouncing_ball", {"contact.stiffness": stiffness, "sample_rate": 1000}
        )
        ball = simulate(station, duration=0.3, progress=False)
        force, depth = ball["force.floor.z"].max(), -1e3 * ball["distance.gap"].min()
        print(
            f"{stiffness} N/m: the ball sinks by {depth:.1f} mm, and the floor gives up to {force:.0f} N"
        )
    for monitor in ({"kind": "contact"}, {"kind": "force_limit", "limit": 40}):
        arm = simulate(
            load_station("irb120_force_stop", {"monitors.stop": monitor}), progress=False
        )
        pressed = np.linalg.norm(arm.vector("force.touch")[-1])
        print(f"{arm.message}: {pressed:.1f} N")
    arm.save("runs/lesson_3", force=True)


if __name__ == "__main__":
    main()
