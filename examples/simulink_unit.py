"""Step a station from outside, as a block of Simulink does with its FMU: inputs held over a step, states put back."""

from __future__ import annotations

import numpy as np

from simrob_drake.extensions.simulink.stepping.station import SteppedStation

STEP = 2e-3  # s


def run(duration: float = 0.5) -> tuple[SteppedStation, np.ndarray]:
    """Swing one joint of a double pendulum by a loop of one's own, and return the angles [rad], shape (m,)."""
    station = SteppedStation("double_pendulum")
    start, angles = station.get("position.joint_1"), []
    for step in range(round(duration / STEP)):
        station.set("reference.joint_1", start + 0.3 * np.sin(2 * np.pi * step * STEP))
        station.advance((step + 1) * STEP)
        angles.append(station.get("position.joint_1"))
    return station, np.array(angles)


def main() -> None:
    """Print how far the joint swings, and that the same steps from the same state are the same."""
    station, angles = run()
    print(
        f"joint 1 swings by {np.rad2deg(np.ptp(angles)):.2f} deg in {len(angles)} steps of {1e3 * STEP:g} ms"
    )
    kept, end = station.state(), station.time
    ends = []
    for _ in range(2):
        station.put(kept)
        station.advance(end + 0.1)
        ends.append(station.get("position.joint_1"))
    print(
        f"0.1 s later it is at {np.rad2deg(ends[0]):.3f} deg, and again at {np.rad2deg(ends[1]):.3f} deg"
    )


if __name__ == "__main__":
    main()
