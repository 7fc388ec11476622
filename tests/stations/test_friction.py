"""Rotors and Coulomb friction of joints in stations, against closed forms under every kind of solver."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import find_peaks

from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.simulation import simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.load import load_station

MASS, ROTOR, GEAR, STIFFNESS, FRICTION = 1.0, 0.01, 10.0, 200.0, 10.0  # kg, kg, 1, N/m, N
SLED = f"""
dh:
  convention: classical
  rows: [{{type: prismatic, limit: [-2, 2], effort: 1000, mass: {MASS}, damping: 0}}]
drives: {{rotor_inertia: {ROTOR}, gear_ratio: {GEAR}, friction: {FRICTION}, friction_speed: 0.002}}
"""
STATION = f"""
robot: {{model: robot.yaml, base: [0, 0, 1, 0, 1.5707963267948966, 0]}}   # level: no weight along it
servo: {{kp: {STIFFNESS}, kd: 0}}
reference: {{kind: ramp, target_deg: 0.5, duration: 1.0e-3}}
duration: 1.8
sample_rate: 1000
"""
RADAU = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-4}
CENIC = {"kind": "continuous", "scheme": "cenic", "max_step": 2e-4}
DISCRETE = {"kind": "discrete", "time_step": 2e-4}


@pytest.fixture
def sled(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(SLED)
    (tmp_path / "sled.yaml").write_text(STATION)
    return tmp_path / "sled.yaml"


@pytest.mark.parametrize(
    ("solver", "realization", "tolerance"),
    [
        (RADAU, "per_joint", 2e-4),
        (RADAU, "implicit", 2e-4),
        ({"kind": "continuous", "scheme": "runge_kutta3", "accuracy": 1e-4}, "per_joint", 2e-4),
        # of first order: a part of omega h / 2 of the way is lost at each
        (
            CENIC,
            "per_joint",
            5e-3,
        ),
        pytest.param(CENIC, "implicit", 5e-3, marks=pytest.mark.long),
        (DISCRETE, "implicit", 5e-3),
        pytest.param({**DISCRETE, "scheme": "lagged"}, "per_joint", 5e-3, marks=pytest.mark.long),
    ],
)
def test_a_sled_on_a_spring_loses_the_same_at_every_turn(
    sled: Path, solver: dict[str, Any], realization: str, tolerance: float
) -> None:
    """The sled turns at x0 - 2 i c/k on either side, every pi sqrt((m + G² J) / k), and stops where c holds it.

    What the law loses less for its v_s is a hundredth of that; in the end the sled creeps back, slower than v_s.
    """
    config = load_station(sled, {"solver": solver, "servo.realization": realization})

    result = simulate(config, progress=False)

    distance = result["q.joint_1"] - 0.5
    turns = np.sort(np.concatenate([find_peaks(distance)[0], find_peaks(-distance)[0]]))[:4]
    numbers = np.arange(1, 5)
    amplitudes = 0.5 - 2 * FRICTION / STIFFNESS * numbers  # 0.4, 0.3, 0.2, 0.1
    np.testing.assert_allclose(np.abs(distance[turns]), amplitudes, rtol=0, atol=tolerance)
    half_period = np.pi * np.sqrt((MASS + GEAR**2 * ROTOR) / STIFFNESS)
    np.testing.assert_allclose(result.times[turns], half_period * numbers, rtol=0, atol=3e-3)
    assert abs(result["v.joint_1"][-1]) <= 0.002
    # The motor's torque is that of its servo alone, without friction.
    is_first_swing = (result.times > 0.01) & (result.times < half_period)
    spring = STIFFNESS * (result["q_ref.joint_1"] - result["q.joint_1"])
    np.testing.assert_allclose(
        result["tau.joint_1"][is_first_swing], spring[is_first_swing], rtol=0, atol=0.5
    )
    assert station_dot(config)  # every block has its place in the picture
    assert not [finding for finding in check_station(config) if finding.level == "warning"]


def test_a_kinematic_station_tells_what_motors_give_against_it(sled: Path) -> None:
    """The reported force is (m + G² J) a + c sat(v / v_s) along a sine."""
    amplitude = 0.3  # [m]
    friction_speed = 0.5  # [m/s]
    changes = {
        "mode": "kinematic",
        "reference": {"kind": "sine", "amplitude_deg": amplitude, "frequency": 0.5},
        "robot.drives": {"friction_speed": friction_speed},
    }

    result = simulate(load_station(sled, changes), progress=False)

    rate = np.pi  # 2 pi times the frequency [rad/s]
    speed = amplitude * rate * np.cos(rate * result.times)
    acceleration = -amplitude * rate**2 * np.sin(rate * result.times)
    friction = FRICTION * np.clip(speed / friction_speed, -1, 1)
    expected = (MASS + GEAR**2 * ROTOR) * acceleration + friction
    np.testing.assert_allclose(result["tau.joint_1"], expected, rtol=0, atol=1e-9)


def test_a_station_changes_friction(sled: Path) -> None:
    """A sled without friction goes on swinging to the same place."""
    result = simulate(
        load_station(sled, {"robot.drives.friction": 0, "solver": RADAU}), progress=False
    )
    way = result["q.joint_1"] - 0.5
    assert np.abs(way[find_peaks(way)[0]]) == pytest.approx(0.5, abs=1e-3)


def test_long_steps_of_cenic_do_not_let_it_chatter(sled: Path) -> None:
    """Steps in which friction could reverse the motion, c h / M = 0.1 m/s, leave a sled at rest in the end."""
    config = load_station(sled, {"solver": {**CENIC, "max_step": 0.02, "error_control": False}})
    speed = simulate(config, duration=4, progress=False)["v.joint_1"][-500:]
    assert np.ptp(speed) < 0.005
