"""The stations acrobot and cart_pole end balanced upright, also from other starts and with other masses."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.systems.controllers import LinearQuadraticRegulator

from simrob_drake import SimulationResult, linearize, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.blocks.swing_up import nearest_error
from simrob_drake.stations.station import build_station


class Case(NamedTuple):
    """A station, and what is known of it.

    Attributes:
        name: name of the station.
        passive: name of the passive axis, which is balanced at 180 degrees.
        driven: name of the driven axis, which is balanced at 0.
        limit: torque limit of its motor [N·m or N].
        height: height of the tool when the robot is upright [m].
        link: link that gets another mass.
    """

    name: str
    passive: str
    driven: str
    limit: float
    height: float
    link: str


ACROBOT = Case(
    name="acrobot",
    passive="shoulder",
    driven="elbow",
    limit=40.0,
    height=3.5 + 3.0,
    link="lower_link",
)
CART_POLE = Case(
    name="cart_pole", passive="pivot", driven="slide", limit=100.0, height=1.0 + 0.5, link="pole"
)
CASES = pytest.mark.parametrize("case", [ACROBOT, CART_POLE], ids=lambda case: case.name)


def assert_balanced(case: Case, result: SimulationResult) -> None:
    """The robot stands upright at the end, at rest, and has been balanced for the last second or longer."""
    assert result.ending == "completed"
    is_last_second = result.times > result.times[-1] - 1.0
    assert result["swing_up.balancing"][is_last_second].all()
    # Several turns do not count.
    angle = np.array([result[f"q.{case.passive}"][-1] - np.pi])
    error = nearest_error(angle, np.array([True]))[0]
    assert np.abs(error) < np.deg2rad(0.5)
    assert abs(result[f"v.{case.passive}"][-1]) < 0.02
    assert abs(result[f"v.{case.driven}"][-1]) < 0.02
    assert result["tcp.z"][-1] == pytest.approx(case.height, abs=1e-3)
    assert np.abs(result[f"tau.{case.driven}"]).max() <= case.limit
    assert not result[f"tau.{case.passive}"].any()


@CASES
def test_it_swings_up_and_stays_upright(case: Case) -> None:
    result = simulate(case.name, progress=False)

    # The robot hangs at the start.
    assert result["tcp.z"][0] < case.height - 0.9
    assert_balanced(case, result)
    assert result["swing_up.energy"][-1] == pytest.approx(0.0, abs=0.01)
    assert result.verdict.warnings == []
    (remark,) = result.summary()["remarks"]
    assert "swing_up balances the robot" in remark


@CASES
def test_it_is_balanced_at_once_near_the_upright_posture(case: Case) -> None:
    changes = {"robot.initial_deg": {case.passive: 177.0}, "duration": 6.0}

    result = simulate(load_station(case.name, changes), progress=False)

    assert result["swing_up.balancing"][1:].all()
    assert_balanced(case, result)


STARTS = [30.0, -60.0, 90.0, -150.0]
"""Positions of the passive axis at the start [deg]."""


@pytest.mark.long
@pytest.mark.parametrize("start", STARTS)
@CASES
def test_it_is_balanced_from_any_start(case: Case, start: float) -> None:
    changes = {"robot.initial_deg": {case.passive: start}, "duration": 20.0}

    result = simulate(load_station(case.name, changes), progress=False)

    assert_balanced(case, result)


@pytest.mark.parametrize("factor", [0.8, 1.2])
@CASES
def test_it_balances_another_mass(case: Case, factor: float) -> None:
    changes = {"robot.mass_factors": {case.link: factor}}

    result = simulate(load_station(case.name, changes), progress=False)

    assert_balanced(case, result)


@pytest.mark.long
@CASES
def test_mujoco_and_a_discrete_solver_balance_it_alike(case: Case) -> None:
    def run(kind: str) -> SimulationResult:
        solver = {"solver": {"kind": kind, "time_step": 0.001}}
        return simulate(load_station(case.name, solver), progress=False)

    mujoco = run("mujoco")
    drake = run("discrete")

    assert_balanced(case, mujoco)
    assert_balanced(case, drake)
    # Later the swing has magnified the differences.
    is_early = mujoco.times < 1.0
    axis = f"q.{case.passive}"
    np.testing.assert_allclose(mujoco[axis][is_early], drake[axis][is_early], atol=0.02)


@CASES
def test_its_gain_is_that_of_the_linearised_station(case: Case) -> None:
    """The linear model of the station is Drake's Taylor expansion of the diagram, without the controller."""
    config = load_station(case.name)
    section = config.controllers["swing_up"]

    regulator = build_station(config).GetSubsystemByName("controller.swing_up").regulator

    axes = [case.passive, case.driven] if case is ACROBOT else [case.driven, case.passive]
    upright = [np.pi if axis == case.passive else 0.0 for axis in axes]
    open_loop = config.model_copy(update={"controllers": {}, "inputs": ("feedforward",)})
    model = linearize(open_loop, upright).part(inputs=[f"feedforward.{case.driven}"])
    # The regulator has the positions of the axes, then their velocities.
    states = [f"{letter}.{axis}" for letter in "qv" for axis in axes]
    order = [model.states.index(name) for name in states]
    state_weights = np.diag([section.position_weight] * 2 + [section.velocity_weight] * 2)
    torque_weights = np.array([[section.torque_weight]])
    gain, cost = LinearQuadraticRegulator(
        model.A[np.ix_(order, order)], model.B[order], state_weights, torque_weights
    )
    np.testing.assert_allclose(regulator.gain, gain, rtol=1e-5)
    np.testing.assert_allclose(regulator.cost, cost, rtol=1e-5, atol=1e-5 * np.abs(cost).max())


def test_a_run_that_ends_before_the_robot_is_balanced_has_a_warning() -> None:
    result = simulate(load_station("acrobot", {"duration": 1.5}), progress=False)

    (warning,) = result.verdict.warnings
    assert "from its target position" in str(warning)
    errors = result.verdict["final_error"]
    assert {entry.subject for entry in errors.entries} == {"shoulder", "elbow"}
    assert not errors.left_out


REFUSED = [
    pytest.param(
        {"servo.kp": {"elbow": 3.0}},
        r"servo\.kp is 3; it must be 0, since controllers\.swing_up",
        id="kp",
    ),
    pytest.param(
        {"servo": {"passive": [], "torque_limit": {"shoulder": 9.0}, "kp": 0, "kd": 0}},
        r"controllers\.swing_up: robot does not have a fixed base, exactly one passive axis",
        id="no passive axis",
    ),
    pytest.param(
        {"controllers.swing_up.posture_deg": {"sholder": 180}},
        r"did you mean 'shoulder'",
        id="unknown axis",
    ),
    pytest.param(
        {"controllers.swing_up.posture_deg": {"shoulder": 90}},
        r"controllers\.swing_up\.posture_deg is .*an equilibrium of the passive axis",
        id="no equilibrium",
    ),
    pytest.param(
        {"controllers.swing_up.torque_weight": 0}, r"torque_weight.*positive", id="free torque"
    ),
    pytest.param({"mode": "kinematic"}, r"controllers\.swing_up", id="kinematic"),
]


@pytest.mark.parametrize(("changes", "words"), REFUSED)
def test_what_it_cannot_do_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SimrobError, match=words) as problem:
        simulate(load_station("acrobot", {**changes, "duration": 0.1}), progress=False)
    assert "\n" not in str(problem.value)


def test_a_posture_beyond_the_rail_is_refused() -> None:
    posture = {"controllers.swing_up.posture_deg": {"pivot": 180, "slide": 2.0}}
    with pytest.raises(SimrobError, match=r"posture_deg is 2 m; it must be within -1\.5 to 1\.5 m"):
        simulate(load_station("cart_pole", posture), progress=False)


@pytest.mark.long
def test_a_pendubot_is_balanced_too() -> None:
    """The same robot with the motor at the shoulder: its elbow hangs free, and is balanced above a still upper link."""
    changes = {
        "servo": {"passive": ["elbow"], "torque_limit": {"shoulder": 80.0}, "kp": 0, "kd": 0},
        "controllers.swing_up": {
            "kind": "swing_up",
            "posture_deg": {"shoulder": 180},
            "energy_gain": 0.5,
        },
        "robot.initial_deg": {"shoulder": 170, "elbow": 20},
    }
    result = simulate(load_station("acrobot", changes), progress=False)

    assert result["swing_up.balancing"][-100:].all()
    assert result["tcp.z"][-1] == pytest.approx(ACROBOT.height, abs=1e-3)
    assert not result["tau.elbow"].any()
