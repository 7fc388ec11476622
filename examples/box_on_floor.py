"""A box on the floor by four kinds of contact, at rest and tipping: the choice to be made for every robot with feet.

A single point contact holds the deepest point of a shape. A box that lies flat has no such point, so it stands on one
that jumps about. By default a flat body therefore also touches at its corners; one can model balls there oneself; and a
hydroelastic surface spreads the load.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate

WEIGHT = 2.0 * 9.80665  # N
HALF_WIDTH, HALF_HEIGHT = 0.05, 0.1  # m
CORNERS = {
    f"corner_{number}": {"kind": "force", "body": f"box.corner_{number}"} for number in range(1, 5)
}
CONTACTS: dict[str, dict[str, Any]] = {
    "bare shape, one point": {"pieces.box.model": "box", "contact.corners": False},
    "bare shape, corners": {"pieces.box.model": "box"},
    "corner balls, point": {"sensors": CORNERS},
    "bare shape, hydroelastic": {
        "pieces.box.model": "box",
        "contact.model": "hydroelastic",
        "contact.hydroelastic_modulus": 1e6,
    },
}
STILL = 0.01  # m/s and rad/s: slower than this is at rest


class Row(NamedTuple):
    """What one kind of contact does."""

    contact: str
    case: str
    load: float  # part of the weight that the floor carries at the end
    shares: list[float]  # of the four corners, where they can be told apart
    depth: float  # how deep the box is in the floor at the end [m]
    still_after: float  # when it has come to rest [s]; inf if it has not
    speed: float  # simulated over wall-clock time of stepping


def run(*, lean_deg: float = 20.0, duration: float = 1.5) -> Iterator[tuple[Row, SimulationResult]]:
    """Put the box down upright, then leaning, with each kind of contact."""
    lean = np.deg2rad(lean_deg)
    height = HALF_WIDTH * np.sin(lean) + HALF_HEIGHT * np.cos(lean)
    poses = {
        "at rest": [0, 0, HALF_HEIGHT, 0, 0, 0],
        "tipping": [0, 0, float(height), 0, float(lean), 0],
    }
    for contact, overrides in CONTACTS.items():
        for case, pose in poses.items():
            result = simulate(
                load_station("box_on_floor", {**overrides, "pieces.box.pose": pose}),
                duration=duration,
                progress=False,
            )
            yield _row(contact, case, result), result


def _row(contact: str, case: str, result: SimulationResult) -> Row:
    moving = np.flatnonzero(np.abs(result.piece_velocity("box")).max(axis=1) > STILL)
    after = 0.0 if len(moving) == 0 else float(result.times[moving[-1]])
    corners = [sensor for sensor in CORNERS if f"force.{sensor}.z" in result.names]
    return Row(
        contact=contact,
        case=case,
        load=float(result["force.floor.z"][-1]) / WEIGHT,
        shares=[float(result[f"force.{sensor}.z"][-1]) / WEIGHT for sensor in corners],
        depth=-float(result["distance.gap"][-1]),
        still_after=np.inf if after == result.stop_time else after,
        speed=result.stop_time / result.stepping_time,
    )


def main() -> None:
    """Print the table."""
    print(
        f"{'contact':25} {'case':8} {'load':>6} {'depth':>9} {'still after':>12} {'speed':>7}  load of the corners"
    )
    for row, _ in run():
        shares = " ".join(f"{share:.3f}" for share in row.shares) or "–"
        still = f"{row.still_after:.2f} s" if np.isfinite(row.still_after) else "not yet"
        figures = f"{row.load:6.3f} {1e6 * row.depth:6.0f} µm {still:>12} {row.speed:5.0f} ×"
        print(f"{row.contact:25} {row.case:8} {figures}  {shares}")


if __name__ == "__main__":
    main()
