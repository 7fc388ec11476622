"""Backlash between motors and links: the position of the link within its play, and its lag behind a reversing motor."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.simulation import simulate
from simrob_drake.stations.load import load_station

PLAY, LENGTH = 2.0, 0.5  # deg, m
ROD = f"""
dh:
  convention: classical
  base: [0, 0, 1, 0, 0, 1.5707963267948966]
  rows:
    - {{a: {LENGTH}, limit_deg: [-180, 180], effort: 100, mass: 2, com: [-0.25, 0, 0], inertia: [1.0e-3, 0.04, 0.04]}}
drives: {{rotor_inertia: 1.0e-4, gear_ratio: 100, backlash_deg: {PLAY}}}
"""
STATION = """
robot: {model: robot.yaml}
servo: {kp: 20000, kd: 500}
reference: {kind: move, target_deg: 150, duration: 2}
solver: {kind: continuous, scheme: radau3, accuracy: 1.0e-4}
duration: 2.5
"""


@pytest.fixture
def rod(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(ROD)
    (tmp_path / "rod.yaml").write_text(STATION)
    return tmp_path / "rod.yaml"


def link_and_motor(rod: Path, changes: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Angles of the link and its motor while the rod is lifted over the top [deg]."""
    result = simulate(load_station(rod, changes), progress=False)
    link = np.arctan2(result["tcp.z"] - 1, result["tcp.x"])
    return np.rad2deg(link), np.rad2deg(result["q.joint_1"])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"solver": {"kind": "continuous", "scheme": "cenic", "max_step": 2e-3}},
        {"solver": {"kind": "discrete", "time_step": 1e-3}, "servo.realization": "implicit"},
        {"robot.drives.friction": 2.0},
    ],
)
def test_the_link_lies_on_the_lower_side_of_its_play(rod: Path, changes: dict[str, Any]) -> None:
    """While the rod is lifted, the link is half of the play behind its motor, and half ahead of it beyond the top."""
    link, motor = link_and_motor(rod, changes)

    up, over = (motor > 10) & (motor < 60), motor > 130
    np.testing.assert_allclose((link - motor)[up], -PLAY / 2, atol=0.02)
    np.testing.assert_allclose((link - motor)[over], PLAY / 2, atol=0.02)


def test_without_play_the_link_is_where_its_motor_is(rod: Path) -> None:
    for changes in ({"robot.drives.backlash_deg": 0}, {"mode": "kinematic"}):
        link, motor = link_and_motor(rod, changes)
        np.testing.assert_allclose(link, motor, atol=1e-9)


def test_a_motor_without_a_rotor_cannot_have_play(rod: Path) -> None:
    with pytest.raises(InvalidParameter, match="joint_1 must have a rotor_inertia"):
        simulate(load_station(rod, {"robot.drives.rotor_inertia": 0}))
