"""Motors of servos: a joint against the closed form of a motor on a voltage, in every realization and both engines."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from simrob_drake.base.errors import SimrobError
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.results.record.summary import summary_of
from simrob_drake.results.result import table_of
from simrob_drake.robots.motors import CommandBusConfig, known_motors
from simrob_drake.simulation import simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve

INERTIA = 0.14  # [kg m²]
STALL = 10.0  # [N·m]
FASTEST = 5.76  # speed without load [rad/s]
RATED = 2.0  # [N·m]
KP = 150.0  # [N·m/rad]
KD = 4.0  # [N·m·s/rad]
TARGET = np.deg2rad(230)
RAMP_TIME = 1e-3  # [s]
DURATION = 1.2  # [s]
SAMPLE = 2e-3  # [s]
JOINT = """
dh:
  convention: classical
  rows:
    - {a: 0.3, limit_deg: [-720, 720], effort: 1000, mass: 1, inertia: [0.05, 0.05, 0.05], com: [0, 0, 0], damping: 0}
"""
STATION = f"""
robot: {{model: robot.yaml, base: [0, 0, 1, 0, 0, 0]}}
gravity: 0
servo: {{kp: {KP}, kd: {KD}}}
reference: {{kind: ramp, target_deg: 230, duration: 1.0e-3}}
duration: 1.2
sample_rate: 500
"""
RADAU = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-5}
FIGURES = {"stall_torque": STALL, "no_load_speed": FASTEST, "rated_torque": RATED}
MOTOR = {"servo.motor": FIGURES}
PEAK_TORQUE = 6.0  # [N·m]
PEAK = {"servo.motor": {**FIGURES, "peak_torque": PEAK_TORQUE}}


@pytest.fixture
def joint(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(JOINT)
    (tmp_path / "joint.yaml").write_text(STATION)
    return tmp_path / "joint.yaml"


def cenic(step: float) -> dict[str, Any]:
    return {"kind": "continuous", "scheme": "cenic", "max_step": step}


def discrete(step: float, kind: str = "discrete") -> dict[str, Any]:
    return {"kind": kind, "time_step": step}


def angles_by_hand(limit: float, step: float = 2e-5) -> np.ndarray:
    """Integrate the law of the motor by small steps. Returns the angle of the joint at each sample, shape (m,) [rad].

    The servo asks for kp (q_r - q) - kd v; the motor gives at most its line, tau_s - D v, and its limit.

    Args:
        limit: torque that the current allows [N·m].
        step: length of a step [s].
    """
    angle = 0.0
    speed = 0.0
    slope = STALL / FASTEST
    angles = [angle]
    for number in range(round(DURATION / step)):
        reference = TARGET * min(1.0, number * step / RAMP_TIME)
        torque = KP * (reference - angle) - KD * speed
        lower = max(-STALL - slope * speed, -limit)
        upper = min(STALL - slope * speed, limit)
        speed += step * min(max(torque, lower), upper) / INERTIA
        angle += step * speed
        is_sample = (number + 1) % round(SAMPLE / step) == 0
        if is_sample:
            angles.append(angle)
    return np.array(angles)


def needs_mujoco(solver: dict[str, Any]) -> None:
    """Skip a test of MuJoCo where it is not installed."""
    if solver["kind"] == "mujoco":
        pytest.importorskip("mujoco")


@pytest.mark.parametrize(
    ("solver", "realization", "tolerance"),
    [
        (RADAU, "per_joint", 2e-3),
        (RADAU, "vector", 2e-3),
        (discrete(1e-3), "per_joint", 3e-3),
        (discrete(1e-3), "implicit", 8e-3),
        (discrete(1e-2), "implicit", 7e-2),
        (cenic(1e-3), "implicit", 5e-3),
        (cenic(1e-2), "implicit", 3e-2),
        (cenic(1e-3), "per_joint", 5e-3),
        (discrete(1e-3, "mujoco"), "implicit", 8e-3),
        (discrete(1e-2, "mujoco"), "implicit", 7e-2),
        (discrete(1e-3, "mujoco"), "per_joint", 3e-3),
    ],
)
def test_a_joint_goes_as_its_motor_can(
    joint: Path, solver: dict[str, Any], realization: str, tolerance: float
) -> None:
    """The joint reaches the no-load speed and no more, with the motor at its torque line for many samples.

    Tolerances are the errors of first order of the steps [rad].
    """
    needs_mujoco(solver)
    config = load_station(joint, {**MOTOR, "solver": solver, "servo.realization": realization})

    result = simulate(config)

    (robot,) = result.plant.robots.values()
    angles = result.axes("q", robot.name)
    speeds = result.axes("v", robot.name)
    torques = result.axes("tau", robot.name)
    expected = angles_by_hand(np.inf)[: len(angles)]
    assert np.abs(angles[:, 0] - expected).max() < tolerance
    assert 0.98 * FASTEST < speeds.max() <= FASTEST + 1e-3
    shares = robot.gains.line.share(torques, speeds, robot.gains.torque_limit)
    assert shares.max() < 1 + 1e-6
    assert (shares > 1 - 1e-6).sum() > 20


@pytest.mark.parametrize(
    ("solver", "realization", "tolerance"),
    [
        (RADAU, "per_joint", 2e-3),
        (discrete(1e-3), "vector", 3e-3),
        (discrete(1e-3, "mujoco"), "implicit", 1.5e-2),
    ],
)
def test_a_current_bounds_it_at_low_speed(
    joint: Path, solver: dict[str, Any], realization: str, tolerance: float
) -> None:
    """The peak torque of the motor limits its torque where the line allows more."""
    needs_mujoco(solver)
    config = load_station(joint, {"solver": solver, "servo.realization": realization, **PEAK})

    result = simulate(config)

    (robot,) = result.plant.robots
    angles = result.axes("q", robot)
    torques = result.axes("tau", robot)
    expected = angles_by_hand(PEAK_TORQUE)[: len(angles)]
    assert np.abs(angles[:, 0] - expected).max() < tolerance
    assert np.abs(torques).max() == pytest.approx(PEAK_TORQUE)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"servo.motor": "mx_107"}, "mx_106"),
        ({"servo.motor": {"joint_7": "mx_28"}}, "joint_1"),
        ({"servo.motor": {"stall_torque": 3}}, "servo.motor.no_load_speed"),
        ({"servo.motor": {"stall_torque": 3, "no_load_speed": 5, "supply": 11}}, "voltage"),
        ({"servo.motor": {"stall": 3, "no_load_speed": 5}}, "stall_torque"),
        ({"servo.motor": "urdf"}, "effort and velocity"),
        (
            {"servo.realization": "implicit", "solver": cenic(1e-3), **PEAK},
            "peak_torque.*joint_1 is 6.*10 or more",
        ),
        (
            {**MOTOR, "servo.realization": "implicit", "solver": cenic(1e-3), "servo.kd": 1},
            "servo.kd of joint_1 is 1.*1.74",
        ),
        ({**MOTOR, "servo.admittance_gain": 1}, "cannot be combined with motor"),
    ],
)
def test_what_no_motor_can_be_is_told(joint: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SimrobError, match=message):
        resolve(load_station(joint, changes))


def test_keys_of_the_station_win_over_the_motor(joint: Path) -> None:
    motor = {"servo.motor": {"model": "mx_106", "supply": 7.4}}
    robot = resolve(load_station(joint, motor)).robots["robot"]

    assert robot.gains.torque_limit.tolist() == robot.gains.line.stall.tolist() == [5.0]
    assert robot.speed_limits == pytest.approx([2.88])
    assert robot.model.friction.tolist() == [0.104]
    assert robot.model.drives.gear_ratio == {"joint_1": 225.0}

    own = {**motor, "robot.drives": {"friction": 0.0, "gear_ratio": 100}, "servo.torque_limit": 4.0}
    robot = resolve(load_station(joint, own)).robots["robot"]

    assert robot.model.friction.tolist() == [0.0]
    assert robot.model.drives.gear_ratio == 100
    assert robot.gains.torque_limit.tolist() == [4.0]
    assert resolve(load_station(joint, {"servo.motor": "none"})).robots["robot"].gains.line is None


def test_a_ratio_without_an_inertia_leaves_that_of_the_urdf_as_it_is(joint: Path) -> None:
    """Behind the 193 turns of an MX-28's gear, the URDF's 0.004 kg m² would be 149 kg m² at the joint."""

    def drives(**changes: Any) -> tuple[Any, Any]:
        found = resolve(load_station(joint, changes)).robots["robot"].model.drives
        return found.rotor_inertia, found.gear_ratio

    assert drives(**{"servo.motor": "mx_28"}) == (None, None)
    assert drives(**{"servo.motor": {"model": "mx_28", "rotor_inertia": 1e-7}}) == (
        {"joint_1": 1e-7},
        {"joint_1": 193},
    )
    own = {"robot.drives": {"rotor_inertia": 2e-7}, "servo.motor": "mx_28"}
    assert drives(**own) == (2e-7, {"joint_1": 193})


def test_encoders_are_as_fine_as_those_of_motors(joint: Path) -> None:
    changes = {"servo.motor": "mx_28", "sensors.encoders": {"rate": 100}, "duration": 0.2}
    told = simulate(load_station(joint, changes))["position.encoders.joint_1"]

    assert told.any()
    np.testing.assert_allclose(
        told / np.deg2rad(0.088), np.round(told / np.deg2rad(0.088)), atol=1e-9
    )


def test_peaks_and_heat_are_told(joint: Path) -> None:
    """While the torque is τ_s - D v, with the time constant T = J v_0 / τ_s, the integral of τ² is τ_s² T / 2."""
    duration = 0.4  # [s]
    warming_time = 30.0  # default time constant of a motor's heat [s]
    result = simulate(load_station(joint, {**MOTOR, "solver": RADAU, "duration": duration}))

    summary = summary_of(result, result.verdict)

    motor = summary["motors"]["joint_1"]
    assert motor["peak_speed"] == pytest.approx(FASTEST, rel=0.02)
    assert motor["stall_torque"] == STALL
    values = {name: figure["value"] for name, figure in summary["verdict"]["figures"].items()}
    assert values["torque_share"] == pytest.approx(1.0, abs=1e-6)
    time_constant = INERTIA * FASTEST / STALL
    heat = STALL**2 * time_constant / 2 / RATED**2 / warming_time
    assert values["heat"] == pytest.approx(heat, rel=0.05)
    # The torque τ_s exp(-t / T) falls to the rated one at t = T ln(τ_s / τ_r).
    time_above_rated = time_constant * np.log(STALL / RATED)
    assert values["rated_time"] == pytest.approx(time_above_rated / duration, rel=0.05)


def test_a_motor_cools_as_well_as_it_warms(joint: Path) -> None:
    """The heat is the convolution of (τ / τ_r)² with exp(-t / T) / T; here T is as short as the motion."""
    warming_time = 0.2  # T [s]
    motor = {**FIGURES, "thermal_time": warming_time}
    result = simulate(load_station(joint, {"servo.motor": motor, "solver": RADAU}))
    load = (result.axes("tau")[:, 0] / RATED) ** 2
    heat = np.array(
        [
            np.trapezoid(
                load[: row + 1] * np.exp((result.times[: row + 1] - now) / warming_time),
                result.times[: row + 1],
            )
            / warming_time
            for row, now in enumerate(result.times)
        ]
    )

    figures = summary_of(result, result.verdict)["verdict"]["figures"]

    assert figures["heat"]["value"] == pytest.approx(heat.max(), rel=0.02)


def test_check_tells_motors_and_what_warms_them(joint: Path) -> None:
    config = load_station(
        joint, {"gravity": 9.8, "robot.base": [0, 0, 1, 0, 0, 1.5707963], "servo.motor": "mx_28"}
    )
    found = "\n".join(f"{finding.subject}: {finding.text}" for finding in check_station(config))

    assert (
        "motors of robot: joint_1: 3.1 N·m at rest, 7.02 rad/s without load, 0.62 N·m continuously ("
        in found
    )
    assert "the motor overheats, since its continuous torque is 0.62 N·m" in found


@pytest.mark.parametrize(
    ("realization", "solver"),
    [("per_joint", RADAU), ("per_joint", cenic(1e-3)), ("implicit", cenic(1e-3))],
)
def test_motors_are_drawn(joint: Path, realization: str, solver: dict[str, Any]) -> None:
    drawn = station_dot(
        load_station(joint, {**MOTOR, "servo.realization": realization, "solver": solver})
    )

    assert "applied_and_state" not in drawn
    assert "drives" not in drawn
    assert ("at rest" in drawn) == (realization == "per_joint")


def test_each_motor_is_whole_and_has_a_source() -> None:
    for name, motor in known_motors().items():
        stall, speed = motor.line
        assert motor.source, name
        assert stall > 0
        assert speed > 0
        assert yaml.safe_load(yaml.safe_dump(motor.model_dump(mode="json", exclude_unset=True)))


def test_an_observer_knows_the_dampers_of_motors(joint: Path) -> None:
    """Nothing pushes the joint, so that the observer reports only its own lag."""
    changes = {**MOTOR, "servo.realization": "implicit", "solver": cenic(1e-3), "duration": 0.5}
    felt = simulate(load_station(joint, {**changes, "sensors.external_torque": {"rate": 1000}}))
    assert np.abs(felt["external_torque.external_torque.joint_1"]).max() < 0.5


WAYS = [
    (RADAU, "per_joint"),
    (RADAU, "vector"),
    (discrete(1e-3), "implicit"),
    (cenic(1e-3), "implicit"),
    (discrete(1e-3, "mujoco"), "implicit"),
]


@pytest.mark.parametrize(("solver", "realization"), WAYS)
def test_a_supply_falls_with_the_current(
    joint: Path, solver: dict[str, Any], realization: str
) -> None:
    """U - R I on a winding of U / I_s gives the stall torque of a winding of R + U / I_s; the no-load speed stays."""
    needs_mujoco(solver)
    voltage = 12.0  # [V]
    stall_current = 4.0  # [A]
    supply_resistance = 0.75  # [ohm]
    gear_efficiency = 0.8
    on_weak_supply = {
        **FIGURES,
        "voltage": voltage,
        "stall_current": stall_current,
        "supply_resistance": supply_resistance,
        "gear_efficiency": gear_efficiency,
    }
    winding = voltage / stall_current  # [ohm]
    weak_stall = gear_efficiency * STALL * winding / (winding + supply_resistance)
    weak_motor = {**FIGURES, "stall_torque": weak_stall}
    changes = {"solver": solver, "servo.realization": realization, "duration": 0.6}

    found = simulate(load_station(joint, {**changes, "servo.motor": on_weak_supply}))
    same = simulate(load_station(joint, {**changes, "servo.motor": weak_motor}))

    np.testing.assert_allclose(found.axes("q"), same.axes("q"), atol=1e-9)
    # The motor brakes with at most its stall torque and D times the no-load speed: twice its stall torque.
    assert np.abs(found.axes("tau")).max() < 2 * 0.65 * STALL


def test_a_supply_that_falls_needs_the_current(joint: Path) -> None:
    with pytest.raises(
        SimrobError, match=r"servo\.motor\.supply_resistance is 0\.5.*voltage and stall_current"
    ):
        resolve(load_station(joint, {"servo.motor": {**FIGURES, "supply_resistance": 0.5}}))


@pytest.mark.parametrize(("solver", "realization"), WAYS)
def test_a_bus_is_late_and_rounds(joint: Path, solver: dict[str, Any], realization: str) -> None:
    """A jump at a sample arrives later by the delay of the bus, and is rounded to the nearest step of commands."""
    needs_mujoco(solver)
    latency = 0.05  # [s]
    target_deg = 7.3
    jump = {"kind": "ramp", "start": 0.1, "duration": 1e-3, "target_deg": target_deg}
    changes = {
        "solver": solver,
        "servo.realization": realization,
        "reference": jump,
        "duration": 1.4,
        **MOTOR,
    }
    buses = {"late": {"latency": latency}, "quick": {}, "coarse": {"resolution_deg": 3}}

    runs = {}
    for name, bus in buses.items():
        runs[name] = simulate(load_station(joint, {**changes, "servo.bus": {"rate": 100, **bus}}))

    angles = {name: run.axes("q")[:, 0] for name, run in runs.items()}
    shift = round(latency / SAMPLE)
    tolerance = 1e-6 if "time_step" in solver else 1e-3
    np.testing.assert_allclose(angles["late"][shift:], angles["quick"][:-shift], atol=tolerance)
    assert np.abs(angles["quick"][:56]).max() < 1e-9  # until the bus's sample after the jump
    assert angles["quick"][-1] == pytest.approx(np.deg2rad(target_deg), abs=1e-3)
    assert angles["coarse"][-1] == pytest.approx(np.deg2rad(6.0), abs=1e-3)
    # The reference in the results is the one before the bus.
    assert runs["late"].axes("q_ref")[60, 0] == pytest.approx(np.deg2rad(target_deg))


def test_a_bus_takes_the_resolution_of_the_motors_and_no_accelerations(joint: Path) -> None:
    rounds = {"servo.bus": {}, "servo.motor": {**FIGURES, "resolution_deg": 2.0}, "gravity": 0}
    result = simulate(load_station(joint, {**rounds, "reference.target_deg": 7.3, "solver": RADAU}))

    assert result.axes("q")[-1, 0] == pytest.approx(np.deg2rad(8.0), abs=1e-3)
    with pytest.raises(
        SimrobError, match=r"servo\.bus: a bus transmits only .*, not reference_acceleration"
    ):
        simulate(
            load_station(
                joint, {"servo.bus": {}, "servo.feedforward": "inverse_dynamics", "solver": RADAU}
            )
        )


@pytest.mark.parametrize(
    ("latency", "samples"),
    [(0.0, 0), (0.004, 0), (0.006, 1), (0.014, 1), (0.29, 29), (0.57, 57), (1.0, 100)],
)
def test_a_latency_is_rounded_to_the_nearest_sample(latency: float, samples: int) -> None:
    """In float64, 0.29 s and 0.57 s at 100 Hz are slightly less than 29 and 57 samples."""
    bus = CommandBusConfig(rate=100.0, latency=latency)

    assert bus.delay == samples


@pytest.mark.parametrize("latency", [-0.01, 1.01])
def test_a_latency_is_neither_negative_nor_longer_than_a_second(latency: float) -> None:
    with pytest.raises(ValueError, match="latency"):
        CommandBusConfig(latency=latency)


def test_a_bus_is_drawn(joint: Path) -> None:
    station = load_station(joint, {"servo.bus": {"latency": 0.02}, "servo.realization": "implicit"})
    assert "delay 20 ms" in station_dot(station)


def test_beside_a_peak_stands_what_the_motor_could_give_then(joint: Path) -> None:
    """Braking, a motor gives more than its stall torque: beside that limit the peak looked like a fault."""
    result = simulate(load_station(joint, {**MOTOR, "servo.kp": 15000.0, "servo.kd": 400.0}))
    tau, speed = result.axes("tau")[:, 0], result.axes("v")[:, 0]
    row = int(np.argmax(np.abs(tau)))
    slope = STALL / FASTEST

    peak, limit = (float(cell) for cell in table_of(result)[1][5:7])

    assert abs(peak) > STALL
    assert limit == pytest.approx(STALL + slope * abs(speed[row]), rel=1e-3)
    assert abs(peak) <= limit * 1.001
