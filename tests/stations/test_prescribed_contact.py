"""Torques of prescribed joints that carry or push what only touches them, against hand calculations."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.results.result import SimulationResult

GRAVITY = 9.80665  # m/s²
CARRIAGE = 20.0  # kg
CRATE = 2.0  # kg
TURN_INERTIA = 1.0  # kg m², of the carriage, and so of the turntable, about each axis
CRATE_INERTIA = 0.01  # kg m²

SAP = {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}
LAGGED = {**SAP, "scheme": "lagged"}
SIMILAR = {**SAP, "scheme": "similar"}
CENIC = {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-3, "max_step": 2e-3}
RADAU3 = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-4, "max_step": 1e-2}
ALL = [SAP, LAGGED, SIMILAR, CENIC, RADAU3]
DISCRETE = [SAP, LAGGED, SIMILAR]

URDF = """<robot name="carrier">
  <link name="base"/>
  <link name="carriage"><inertial><mass value="20"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="4 4 0.1"/></geometry></collision></link>
  <joint name="belt" type="{kind}"><parent link="base"/><child link="carriage"/>
    <origin rpy="0 {pitch} 0"/><axis xyz="{axis}"/>
    <limit lower="-50" upper="50" effort="1000" velocity="100"/>{dynamics}</joint>
  <transmission name="drive"><type>transmission_interface/SimpleTransmission</type><joint name="belt">
    <hardwareInterface>EffortJointInterface</hardwareInterface></joint><actuator name="motor"/></transmission>
</robot>
"""
FOOT = 0.02  # m, radius of the spheres under the crate's corners
CORNERS = [(0.13, 0.08), (0.13, -0.08), (-0.13, 0.08), (-0.13, -0.08)]


# A swing about 0 that begins at its amplitude [m, which is a "deg" of a joint that slides].
AMPLITUDE = 0.03
SWING = {"kind": "sine", "amplitude_deg": AMPLITUDE, "frequency": 1.0, "phase_deg": 90.0}


def swing_acceleration(times: np.ndarray, amplitude: float = AMPLITUDE) -> np.ndarray:
    """Acceleration of the swing, -a w² cos(w t), at times (m,) [s]."""
    rate = 2 * np.pi * SWING["frequency"]
    return np.asarray(-amplitude * rate**2 * np.cos(rate * times))


def by_scheme(solver: dict[str, Any]) -> str:
    """Name of a case by its solver."""
    return str(solver["scheme"])


def carried(
    folder: Path,
    solver: dict[str, Any],
    motion: dict[str, Any],
    *,
    friction: float,
    place: tuple[float, float, float] = (0.0, 0.0, 0.15),
    kind: str = "prismatic",
    axis: str = "1 0 0",
    pitch: float = 0.0,
    dynamics: str = "",
    **more: Any,
) -> SimulationResult:
    """Run a crate that stands on its four feet on a carriage of a given motion.

    ``place`` is the crate's centre in the carriage's axes [m]; a positive ``pitch`` [rad]
    turns the carriage's x downwards.
    """
    urdf = URDF.format(kind=kind, axis=axis, pitch=pitch, dynamics=dynamics)
    (folder / "carrier.urdf").write_text(urdf)
    turned = np.array(
        [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    )
    feet = [{"sphere": FOOT, "pose": [x, y, FOOT - 0.1, 0, 0, 0]} for x, y in CORNERS]
    crate = {
        "mass": CRATE,
        "inertia": [CRATE_INERTIA] * 3,
        "shapes": [{"box": [0.3, 0.2, 0.2], "collides": False}, *feet],
        "free": True,
        "pose": [*(turned @ place).tolist(), 0, pitch, 0],
    }
    station = {
        "robot": {"urdf": "carrier.urdf"},
        "servo": {"kp": 0, "kd": 0},
        "prescribed": {"belt": motion},
        "floor": None,
        "contact": {"model": "point", "friction": {"static": friction, "dynamic": friction}},
        "pieces": {"crate": crate},
        "solver": solver,
        "duration": 0.5,
        **more,
    }
    file = folder / "station.yaml"
    file.write_text(yaml.safe_dump(station))
    return simulate(load_station(file), progress=False)


def at_constant_speed(folder: Path, speed: float) -> dict[str, Any]:
    """Write a table of a motion at constant speed [m/s], and return its reference."""
    times = np.linspace(0, 2, 11)
    rows = "\n".join(f"{time:.3f},{speed * time:.6f}" for time in times)
    (folder / "table.csv").write_text(f"time,belt\n{rows}\n")
    return {"kind": "table", "file": "table.csv"}


@pytest.mark.parametrize("solver", ALL, ids=by_scheme)
def test_a_crate_that_rides_along_takes_no_force(tmp_path: Path, solver: dict[str, Any]) -> None:
    """Friction brings the crate to the carriage's speed; then nothing accelerates."""
    speed = 0.5  # [m/s]
    friction = 0.5

    run = carried(
        tmp_path, solver, at_constant_speed(tmp_path, speed), friction=friction, sample_rate=1000.0
    )

    force = run["tau.belt"]
    riding = run.times > 0.2  # 0.102 s are needed, more where the crate hops at first
    weight = CRATE * GRAVITY
    assert np.abs(force[riding]).max() < 0.025 * weight
    # Discrete solvers report the force of the step that begins.
    catching_up = ~riding[:-1]
    impulse = np.sum((force[:-1] * np.diff(run.times))[catching_up])
    assert impulse == pytest.approx(CRATE * speed, abs=0.06)

    duration = 0.5  # [s]
    lag = speed**2 / (2 * friction * GRAVITY)  # while the crate slips
    assert run["piece.crate.x"][-1] == pytest.approx(speed * duration - lag, abs=2e-3)
    assert not [warning for warning in run.warnings if "belt needed" in warning]


@pytest.mark.parametrize("solver", [LAGGED, CENIC, RADAU3], ids=by_scheme)
def test_a_crate_that_slips_takes_its_friction(tmp_path: Path, solver: dict[str, Any]) -> None:
    """Coulomb's friction pulls at the carriage until the crate has its speed."""
    run = carried(tmp_path, solver, at_constant_speed(tmp_path, 0.5), friction=0.5)
    slipping = (run.times > 0.01) & (run.times < 0.09)
    np.testing.assert_allclose(run["tau.belt"][slipping], 0.5 * CRATE * GRAVITY, rtol=0.01)


@pytest.mark.parametrize("solver", DISCRETE, ids=by_scheme)
def test_under_discrete_solvers_the_force_is_that_of_the_momenta(
    tmp_path: Path, solver: dict[str, Any]
) -> None:
    """Step by step, with slip and with hops: what the crate gains in momentum comes from the carriage."""
    # m: deg of a joint that slides
    swing = {
        "kind": "sine",
        "amplitude_deg": 0.3,
        "frequency": 1.0,
    }
    run = carried(tmp_path, solver, swing, friction=0.2, sample_rate=1000.0, duration=0.4)

    step = 1e-3

    # Velocities at step ends: positions advance with the velocity of the step's end.
    crate_speed = np.diff(run["piece.crate.x"]) / step
    on_crate = CRATE * np.diff(crate_speed) / step
    rate = 2 * np.pi
    # What is reported is the force that the reference's acceleration takes.
    wanted = -CARRIAGE * 0.3 * rate**2 * np.sin(rate * run.times[1:-1])
    difference = run["tau.belt"][1:-1] - wanted - on_crate
    assert np.abs(difference).max() < 0.02 * np.abs(wanted).max()


@pytest.mark.parametrize("solver", [SAP, LAGGED, SIMILAR, RADAU3], ids=by_scheme)
def test_a_crate_that_sticks_is_accelerated_like_the_carriage(
    tmp_path: Path, solver: dict[str, Any]
) -> None:
    """The motor accelerates carriage and crate, (M + m) a; the 2 kg of the crate are 2.4 N of it."""
    run = carried(tmp_path, solver, SWING, friction=1.0)

    force = (CARRIAGE + CRATE) * swing_acceleration(run.times)
    settled = run.times > 0.2
    np.testing.assert_allclose(run["tau.belt"][settled], force[settled], atol=0.15)


@pytest.mark.parametrize("solver", [SAP, LAGGED, SIMILAR, RADAU3], ids=by_scheme)
def test_a_crate_is_carried_up_a_slope(tmp_path: Path, solver: dict[str, Any]) -> None:
    """The motor lifts carriage and crate, (M + m) g sin(20°), and accelerates them."""
    slope = float(np.deg2rad(20.0))
    crate_position = (AMPLITUDE, 0.0, 0.15)  # where the carriage begins

    run = carried(tmp_path, solver, SWING, friction=1.0, pitch=-slope, place=crate_position)

    mass = CARRIAGE + CRATE
    weight = mass * GRAVITY * np.sin(slope)
    force = weight + mass * swing_acceleration(run.times)
    settled = run.times > 0.25
    np.testing.assert_allclose(run["tau.belt"][settled], force[settled], atol=0.02 * weight)


@pytest.mark.parametrize("solver", [SAP, LAGGED, SIMILAR, RADAU3], ids=by_scheme)
def test_a_turntable_turns_what_stands_on_it(tmp_path: Path, solver: dict[str, Any]) -> None:
    """About an upright axis, the motor gives (I + I_crate + m r²) times the angular acceleration."""
    radius = 1.0  # [m]
    amplitude_deg = 3.0
    swing = {**SWING, "amplitude_deg": amplitude_deg}
    amplitude = np.deg2rad(amplitude_deg)
    # The swing begins at its amplitude, and the crate stands on the turntable there.
    place = (radius * np.cos(amplitude), radius * np.sin(amplitude), 0.15)

    run = carried(tmp_path, solver, swing, friction=1.0, kind="revolute", axis="0 0 1", place=place)

    inertia = TURN_INERTIA + CRATE_INERTIA + CRATE * radius**2
    torque = inertia * swing_acceleration(run.times, amplitude)
    settled = run.times > 0.25
    np.testing.assert_allclose(run["tau.belt"][settled], torque[settled], atol=0.15)


@pytest.mark.parametrize("solver", [SAP, LAGGED, SIMILAR, RADAU3], ids=by_scheme)
def test_a_crate_on_a_lever_is_lifted(tmp_path: Path, solver: dict[str, Any]) -> None:
    """About a level axis: at rest the crate's weight has the lever r, and the arm is balanced."""
    run = carried(
        tmp_path,
        solver,
        {"kind": "hold"},
        friction=1.0,
        kind="revolute",
        axis="0 -1 0",
        place=(0.8, 0.0, 0.15),
    )
    late = run.times > 0.25
    np.testing.assert_allclose(run["tau.belt"][late], CRATE * GRAVITY * 0.8, rtol=0.02)


@pytest.mark.parametrize("solver", ALL, ids=by_scheme)
def test_the_motor_overcomes_what_rubs_in_the_joint(tmp_path: Path, solver: dict[str, Any]) -> None:
    """Damping 7 N·s/m and Coulomb friction of 3 N in the joint, at 0.5 m/s, below a crate that rides along."""
    dynamics = '<dynamics damping="7" friction="3"/>'
    run = carried(
        tmp_path, solver, at_constant_speed(tmp_path, 0.5), friction=0.5, dynamics=dynamics
    )

    late = run.times > 0.25
    np.testing.assert_allclose(run["tau.belt"][late], 7 * 0.5 + 3, atol=0.5)


@pytest.mark.parametrize("solver", DISCRETE, ids=by_scheme)
def test_of_couplings_with_contact_the_run_warns(tmp_path: Path, solver: dict[str, Any]) -> None:
    """Drake's forces in joints are without those of constraints."""
    strut = {
        "kind": "weld",
        "body": "crate",
        "other": "carriage",
        "other_pose": [0, 0, 0.15, 0, 0, 0],
    }
    run = carried(
        tmp_path, solver, {"kind": "hold"}, friction=0.5, couplings={"strut": strut}, duration=0.02
    )
    assert any(
        "prescribed joints belt" in warning and "strut" in warning for warning in run.warnings
    )


def test_of_loads_that_stick_the_run_warns_under_cenic(tmp_path: Path) -> None:
    """Drake computes the friction of a recorded state by another law than cenic steps with."""
    run = carried(tmp_path, CENIC, {"kind": "hold"}, friction=0.5, duration=0.02)

    assert any(
        "prescribed joints belt" in warning and "cenic" in warning for warning in run.warnings
    )

    without = carried(tmp_path, RADAU3, {"kind": "hold"}, friction=0.5, duration=0.02)
    assert not [warning for warning in without.warnings if "prescribed" in warning]
