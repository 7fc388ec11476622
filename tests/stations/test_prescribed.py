"""Joints whose motion is given while all else moves by forces, against equations of their own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

MASS, LENGTH, MIDDLE, INERTIA, GRAVITY = 1.0, 1.0, 0.5, 0.1, 9.80665
SWING, RATE = np.deg2rad(40.0), 2 * np.pi * 0.5
URDF = """<robot name="two">
  <link name="base"/>
  {links}
</robot>
"""
LINK = """<link name="rod_{n}"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint_{n}" type="continuous"><parent link="{parent}"/><child link="rod_{n}"/><origin xyz="{x} 0 0"/>
    <axis xyz="0 -1 0"/><limit effort="1000" velocity="100"/></joint>
  <transmission name="drive_{n}"><type>transmission_interface/SimpleTransmission</type><joint name="joint_{n}">
    <hardwareInterface>EffortJointInterface</hardwareInterface></joint><actuator name="motor_{n}"/></transmission>
"""


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    links = LINK.format(n=1, parent="base", x=0) + LINK.format(n=2, parent="rod_1", x=1)
    (folder / "two.urdf").write_text(URDF.format(links=links))
    file = folder / "two.yaml"
    file.write_text(
        f"""robot: {{urdf: two.urdf, initial_deg: {{joint_2: {np.rad2deg(-1.0)}}}}}
servo: {{kp: 0, kd: 0}}
prescribed: {{joint_1: {{kind: sine, amplitude_deg: 40, frequency: 0.5}}}}
solver: {{kind: continuous, scheme: runge_kutta3, accuracy: 1.0e-7, max_step: 0.01}}
duration: 2
"""
    )
    return file


def first(time):
    """Angle of the first rod from the horizontal, its speed and acceleration."""
    wave = [np.sin(RATE * time), RATE * np.cos(RATE * time), -(RATE**2) * np.sin(RATE * time)]
    return SWING * np.array(wave)


def second(time, state):
    """Equation of the second rod's angle from the horizontal, by Lagrange."""
    (angle, speed, push), (own, rate) = first(time), state
    bent = own - angle
    moment = (
        MASS
        * MIDDLE
        * (LENGTH * (push * np.cos(bent) + speed**2 * np.sin(bent)) + GRAVITY * np.cos(own))
    )
    return [rate, -moment / (INERTIA + MASS * MIDDLE**2)]


def torque(time, state):
    """Torque of the first joint, by Lagrange [N·m]."""
    (angle, _, push), (own, rate) = first(time), state
    bent, turned = own - angle, second(time, state)[1]
    inertia = INERTIA + MASS * (MIDDLE**2 + LENGTH**2)
    coupling = MASS * LENGTH * MIDDLE * (turned * np.cos(bent) - rate**2 * np.sin(bent))
    weight = MASS * (MIDDLE + LENGTH) * GRAVITY * np.cos(angle)
    return inertia * push + coupling + weight


@pytest.fixture(scope="module")
def exact():
    start = [-1.0, SWING * RATE]  # the second joint begins at rest
    return solve_ivp(second, (0, 2), start, rtol=1e-10, atol=1e-11, dense_output=True).sol


def errors(result, exact):
    """Return the largest errors of the given joint, of the free one [rad] and of the torque [N·m]."""
    own = exact(result.times)
    given = np.abs(result["q.joint_1"] - first(result.times)[0])
    free = np.abs(result["q.joint_1"] + result["q.joint_2"] - own[0])
    taken = np.array([torque(time, state) for time, state in zip(result.times, own.T, strict=True)])
    return given.max(), free.max(), np.abs(result["tau.joint_1"] - taken)[1:].max()


@pytest.mark.parametrize(
    ("solver", "bounds"),
    [
        ({}, (1e-8, 1e-8, 5e-4)),
        ({"solver.scheme": "radau3", "solver.accuracy": 1e-6}, (1e-7, 1e-5, 5e-3)),
        ({"solver": {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}}, (1e-3, 2e-3, 0.05)),
        (
            {"solver.scheme": "cenic", "solver.accuracy": 1e-3, "solver.max_step": 2e-3},
            (8e-3, 4e-2, 0.4),
        ),
    ],
    ids=["runge_kutta3", "radau3", "sap", "cenic"],
)
def test_a_prescribed_joint_moves_as_it_is_told_and_its_torque_is_what_that_takes(
    station, exact, solver, bounds
):
    """Torques reach 29 N·m. The accuracy bounds the errors of continuous schemes, the step those of the others."""
    result = simulate(load_station(station, solver), progress=False)
    found = errors(result, exact)
    assert all(error < bound for error, bound in zip(found, bounds, strict=True)), found


def test_a_servo_moves_its_joint_while_another_is_prescribed(station):
    """The servo holds the elbow's angle under gravity while the shoulder follows its prescribed motion."""
    result = simulate(
        load_station(station, {"servo.kp": 4000, "servo.kd": 200}), duration=1.0, progress=False
    )

    np.testing.assert_allclose(result["q.joint_1"], first(result.times)[0], atol=1e-7)
    assert np.abs(result["q.joint_2"] + 1.0).max() < 0.01
    assert result["q_ref.joint_1"].tolist() == pytest.approx(
        first(result.times)[0].tolist(), abs=1e-12
    )


def test_a_run_begins_on_the_course(station):
    """A sine of a phase begins away from the initial posture, and at its speed; so does a run that goes on."""
    config = load_station(
        station, {"prescribed.joint_1": {"kind": "sine", "frequency": 0.5, "phase_deg": 45}}
    )
    result = simulate(config, duration=0.1, progress=False)

    again = simulate(config, duration=0.1, start=result.final_state, progress=False)

    for run in (result, again):
        assert run["q.joint_1"][0] == pytest.approx(SWING * np.sqrt(0.5))
        assert run["v.joint_1"][0] == pytest.approx(SWING * RATE * np.sqrt(0.5))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"prescribed": {"joint_9": {"kind": "hold"}}}, "no axis of two.*joint_9"),
        ({"mode": "kinematic"}, "prescribed.*the reference of a kinematic station moves all"),
        (
            {"servo": {"realization": "implicit", "kp": 1}},
            "servo.realization.*a prescribed joint has no servo",
        ),
        ({"servo.feedforward": "gravity"}, "uses the robot's model"),
        ({"prescribed.joint_1": {"kind": "sine", "amplitude_deg": {"joint_2": 3}}}, "joint_2"),
        (
            {
                "solver": {"kind": "continuous", "max_step": 0.1},
                "prescribed": {"joint_1": {"kind": "spin"}},
            },
            "spin",
        ),
    ],
)
def test_what_cannot_be_prescribed(station, changes, message):
    with pytest.raises(SimrobError, match=f"(?s){message}"):
        simulate(load_station(station, changes), duration=0.01, progress=False)
