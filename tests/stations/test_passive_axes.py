"""Axes without a motor move freely and have no torque, and no part of the package treats them as driven."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pydrake
import pytest
import yaml
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import JointActuatorIndex, PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import Arm, linearize, load_station, simulate
from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.learning.policy import Policy
from simrob_drake.importer.importing import import_robot
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.results.result import table_of
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.resolve import resolve

EXAMPLES = Path(pydrake.getDrakePath()) / "examples"
ACROBOT = EXAMPLES / "acrobot/Acrobot.urdf"
CART_POLE = EXAMPLES / "multibody/cart_pole/cart_pole.sdf"
LINK = (
    '<link name="{name}"><inertial><origin xyz="0 0 {com}"/><mass value="1"/>'
    '<inertia ixx="0.08" ixy="0" ixz="0" iyy="0.08" iyz="0" izz="0.01"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="0 0 {at}"/><axis xyz="0 1 0"/>{limit}<dynamics damping="0.1"/></joint>'
)
MOTOR = (
    '<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>'
    '<joint name="elbow"/><actuator name="motor"/></transmission>'
)
LIMIT = '<limit effort="20" velocity="10"/>'
"""A double pendulum with one motor: two rods of 1 m and 1 kg, which hang at zero; the motor is at the elbow."""
PENDULUM = "".join(
    (
        '<robot name="pendulum"><link name="base"/>',
        LINK.format(name="upper", com=-0.5),
        LINK.format(name="lower", com=-0.5),
        JOINT.format(name="shoulder", parent="base", child="upper", at=0, limit=""),
        JOINT.format(name="elbow", parent="upper", child="lower", at=-1, limit=LIMIT),
        MOTOR,
        "</robot>",
    )
)
STEP = 1e-3  # s
SAP = {"kind": "discrete", "scheme": "sap", "time_step": STEP}
START = np.deg2rad([40.0, -20.0])
KP, KD = 200.0, 20.0

WriteStation = Callable[..., Path]


@pytest.fixture
def pendulum(tmp_path: Path) -> WriteStation:
    """Return a function that writes a station of the double pendulum, with changes of its sections."""

    def write(urdf: Path | None = None, **changes: Any) -> Path:
        robot = tmp_path / "robot.urdf"
        robot.write_text(PENDULUM if urdf is None else urdf.read_text())
        content: dict[str, Any] = {
            "robot": {"urdf": str(robot), "initial_deg": np.rad2deg(START).tolist()},
            "servo": {"realization": "implicit", "kp": {"elbow": KP}, "kd": {"elbow": KD}},
            "reference": {"kind": "hold"},
            "solver": SAP,
            "duration": 1.0,
        }
        for key, value in changes.items():
            content[key] = (
                {**content.get(key, {}), **value}
                if isinstance(value, dict) and key != "solver"
                else value
            )
        file = tmp_path / "station.yaml"
        file.write_text(yaml.safe_dump(content))
        return file

    return write


def drake_positions(
    model: Path, times: np.ndarray, *, kp: float, kd: float, limit: float
) -> np.ndarray:
    """Simulate a model in plain Drake, with a servo in the elbow's actuator.

    Args:
        model: the robot's file.
        times: times at which the positions are wanted, shape (m,) [s].
        kp: gain of the elbow's servo [N·m/rad].
        kd: damping of the elbow's servo [N·m·s/rad].
        limit: torque limit of the elbow's motor [N·m].

    Returns:
        positions of shoulder and elbow, shape (m, 2) [rad].
    """
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=STEP, discrete_contact_approximation="sap")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -STANDARD_GRAVITY])
    Parser(plant).AddModels(str(model))
    if not plant.HasBodyNamed(
        "base_link"
    ):  # Drake's Acrobot is welded to the world by its own file
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    actuator = plant.get_joint_actuator(JointActuatorIndex(0))
    assert actuator.joint().name() == "elbow"
    actuator.set_effort_limit(limit)
    actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))
    plant.Finalize()
    assert plant.num_actuators() == 1
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, START)
    instance = actuator.model_instance()
    plant.get_desired_state_input_port(instance).FixValue(context, [START[1], 0.0])
    positions = [plant.GetPositions(context)]
    for time in times[1:]:
        simulator.AdvanceTo(time)
        positions.append(plant.GetPositions(context))
    return np.array(positions)


@pytest.mark.parametrize(("kp", "kd"), [(0.0, 0.0), (KP, KD)], ids=["free swing", "elbow held"])
@pytest.mark.parametrize("robot", [None, ACROBOT], ids=["pendulum", "Acrobot of Drake"])
def test_it_moves_as_in_plain_drake(
    pendulum: WriteStation, robot: Path | None, kp: float, kd: float
) -> None:
    if robot is not None and not robot.exists():
        pytest.skip("this Drake has no example files")
    servo = {"kp": {"elbow": kp}, "kd": {"elbow": kd}, "torque_limit": {"elbow": 20.0}}
    station = pendulum(robot, servo=servo)
    result = simulate(station)

    expected = drake_positions(
        station.parent / "robot.urdf", result.times, kp=kp, kd=kd, limit=20.0
    )

    found = np.column_stack([result["q.shoulder"], result["q.elbow"]])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.ptp(found[:, 0]) > 0.5  # the shoulder swings


@pytest.mark.parametrize("realization", ["implicit", "per_joint", "vector"])
@pytest.mark.parametrize("feedforward", ["gravity", "inverse_dynamics"])
def test_its_torque_is_zero_with_feedforward(
    pendulum: WriteStation, realization: str, feedforward: str
) -> None:
    servo = {"realization": realization, "feedforward": feedforward}
    solver = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-3, "max_step": 0.01}

    result = simulate(
        pendulum(servo=servo, solver=SAP if realization == "implicit" else solver, duration=0.3)
    )

    assert not result["tau.shoulder"].any()
    assert np.abs(result["tau.elbow"]).max() > 1.0
    assert np.ptp(result["q.shoulder"]) > 0.1


def test_friction_slows_it_and_is_no_torque_of_a_motor(pendulum: WriteStation) -> None:
    smooth = simulate(pendulum())
    rough = simulate(pendulum(robot={"drives": {"friction": 0.5}}))

    assert not rough["tau.shoulder"].any()
    assert np.ptp(rough["q.shoulder"]) < np.ptp(smooth["q.shoulder"])


def test_a_robot_without_any_motor_swings(pendulum: WriteStation) -> None:
    free = {"passive": ["shoulder", "elbow"], "kp": {}, "kd": {}}
    result = simulate(pendulum(servo=free))
    still = {"kp": {"elbow": 0.0}, "kd": {"elbow": 0.0}}

    motor_without_gains = simulate(pendulum(servo=still))

    np.testing.assert_allclose(result["q.shoulder"], motor_without_gains["q.shoulder"], atol=1e-12)
    np.testing.assert_allclose(result["q.elbow"], motor_without_gains["q.elbow"], atol=1e-12)


def test_a_station_gives_it_a_motor_that_holds(pendulum: WriteStation) -> None:
    servo = {
        "passive": [],
        "kp": 2000.0,
        "kd": 200.0,
        "torque_limit": {"shoulder": 50.0},
        "feedforward": "gravity",
    }
    result = simulate(pendulum(servo=servo))

    np.testing.assert_allclose(result["q.shoulder"], START[0], atol=1e-6)
    # At rest the shoulder carries both rods: g (0.5 sin a + 1.0 sin a + 0.5 sin(a + b)), each of 1 kg.
    shoulder, elbow = START
    weight = STANDARD_GRAVITY * (1.5 * np.sin(shoulder) + 0.5 * np.sin(shoulder + elbow))
    assert result["tau.shoulder"][-1] == pytest.approx(weight, rel=1e-5)


REFUSED = [
    pytest.param(
        {"servo": {"law": "cascade", "realization": "vector"}},
        r"servo\.law: .*shoulder",
        id="cascade",
    ),
    pytest.param(
        {"servo": {"law": "computed_torque", "realization": "vector", "kp": 100.0, "kd": 20.0}},
        r"servo\.law: computed_torque needs a motor on every axis; passive: shoulder",
        id="computed torque",
    ),
    pytest.param(
        {"servo": {"admittance_gain": 1.0, "realization": "vector"}},
        r"servo\.admittance_gain: ",
        id="admittance",
    ),
    pytest.param(
        {"servo": {"kp": {"shoulder": 3.0}}}, r"servo\.kp\.shoulder: shoulder is passive", id="gain"
    ),
    pytest.param(
        {"servo": {"torque_limit": {"shoulder": 3.0}}},
        r"servo\.torque_limit\.shoulder: ",
        id="limit",
    ),
    pytest.param(
        {"servo": {"torque_limit": {"shoulder": 0.0}}}, r"servo\.passive lists axes", id="limit 0"
    ),
    pytest.param(
        {"servo": {"motor": {"shoulder": {"stall_torque": 3.0, "no_load_speed": 4.0}}}},
        r"servo\.motor\.shoulder: shoulder is passive",
        id="motor",
    ),
    pytest.param(
        {"servo": {"passive": []}},
        r"servo\.torque_limit: servo\.passive leaves out shoulder, so that shoulder has a motor",
        id="motor without limit",
    ),
    pytest.param(
        {"servo": {"passive": ["sholder"]}},
        r"under servo\.passive.*did you mean 'shoulder'",
        id="typo",
    ),
    pytest.param(
        {"robot": {"drives": {"rotor_inertia": {"shoulder": 0.1}}}},
        r"drives\.rotor_inertia\.shoulder: ",
        id="rotor",
    ),
    pytest.param(
        {"reference": {"kind": "move", "target_deg": {"shoulder": 10.0}, "duration": 1.0}},
        r"reference\.target_deg\.shoulder: shoulder is passive",
        id="target",
    ),
    pytest.param(
        {"servo": {"realization": "vector"}, "prescribed": {"shoulder": {"kind": "hold"}}},
        r"prescribed\.shoulder: shoulder is passive",
        id="prescribed",
    ),
]


@pytest.mark.parametrize(("changes", "words"), REFUSED)
def test_a_key_that_needs_its_motor_is_refused(
    pendulum: WriteStation, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(SimrobError, match=words) as problem:
        simulate(pendulum(**changes))
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("none", ["none", {"model": "none"}], ids=["text", "section"])
def test_a_station_may_say_that_a_passive_axis_has_no_motor(
    pendulum: WriteStation, none: object
) -> None:
    config = pendulum(servo={"motor": {"shoulder": none}})

    robot = resolve(load_station(config)).robots["robot"]

    assert robot.motors[robot.axes.index("shoulder")] is None


def test_values_for_all_axes_are_meant_for_those_with_motors(pendulum: WriteStation) -> None:
    target = {"kind": "move", "target_deg": [10.0, 20.0], "duration": 0.5}
    servo = {"kp": KP, "kd": [KD, KD], "torque_limit": 20.0}

    gains = resolve(load_station(pendulum(reference=target, servo=servo))).robots["robot"].gains

    assert gains.kp.tolist() == [0.0, KP]
    assert gains.kd.tolist() == [0.0, KD]
    assert gains.torque_limit.tolist() == [0.0, 20.0]


def test_nothing_judges_it_by_its_reference(pendulum: WriteStation) -> None:
    result = simulate(pendulum(duration=0.6))

    assert abs(result["q.shoulder"][-1] - START[0]) > np.deg2rad(20)  # far from its reference
    assert result.verdict.warnings == []
    assert "shoulder" in result.verdict["final_error"].left_out
    assert not [entry for entry in result.verdict.warnings if "shoulder" in str(entry)]

    row = next(row for row in table_of(result) if row[0] == "shoulder")
    assert row[6] == "–"  # no limit of torque


def test_check_says_that_no_motor_holds_it(pendulum: WriteStation) -> None:
    findings = check_station(load_station(pendulum()))
    finding = next(found for found in findings if "shoulder" in found.subject)

    assert finding.level == "note"
    assert "passive: no motor drives it" in finding.text
    assert not [found for found in findings if found.level == "warning"]


def test_the_block_picture_shows_it_without_a_motor(pendulum: WriteStation) -> None:
    assert "shoulder: no motor" in station_dot(
        load_station(pendulum(servo={"realization": "per_joint"}))
    )
    assert "no motor: shoulder" in station_dot(
        load_station(pendulum(servo={"realization": "vector"}))
    )
    assert "no motor: shoulder" in station_dot(load_station(pendulum()))


def test_a_first_station_names_it_and_runs(pendulum: WriteStation, tmp_path: Path) -> None:
    pendulum()
    text = draft_station(tmp_path / "robot.urdf")

    assert "these axes have no motor: shoulder" in text
    content = yaml.safe_load(text)
    assert set(content["servo"]["kp"]) == set(content["servo"]["torque_limit"]) == {"elbow"}
    assert "shoulder" not in str(content["reference"])

    (file := tmp_path / "first.yaml").write_text(text)
    result = simulate(file)

    assert result.stopped_by is None
    assert not result["tau.shoulder"].any()


GRAVITY_TERM = (
    0.5 * STANDARD_GRAVITY
)  # of a rod: mass times distance of its centre of mass times g [N·m]


def test_its_linear_model_is_the_closed_form(pendulum: WriteStation) -> None:
    """Upright, M q'' = -H q - d q' + (0, 1) u, with the mass matrix M and the second derivatives H of the potential."""
    servo = {
        "realization": "vector",
        "kp": {"elbow": 0.0},
        "kd": {"elbow": 0.0},
        "torque_limit": {"elbow": 20.0},
    }
    config = load_station(pendulum(servo=servo, inputs=["feedforward"]))

    model = linearize(config, [np.pi, 0.0])

    # Two equal rods of 1 kg in one line.
    inertia = 0.08  # about the centre of mass [kg m²]
    half = 0.5  # from a joint to the centre of mass [m]
    whole = 1.0  # [m]
    about_end = inertia + half**2
    coupling = about_end + whole * half
    both = about_end + about_end + whole**2 + 2 * whole * half
    mass = np.array([[both, coupling], [coupling, about_end]])
    hessian = -GRAVITY_TERM * np.array([[4.0, 1.0], [1.0, 1.0]])
    damping = 0.1 * np.eye(2)
    inverse = np.linalg.inv(mass)
    expected = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ hessian, -inverse @ damping]])
    np.testing.assert_allclose(model.A, expected, atol=1e-6)
    columns = [model.inputs.index(f"feedforward.{axis}") for axis in ("shoulder", "elbow")]
    np.testing.assert_allclose(model.B[2:, columns], inverse @ np.diag([0.0, 1.0]), atol=1e-6)
    assert (np.linalg.eigvals(model.A).real > 1.0).any()  # it falls


def test_it_cannot_be_linearised_where_it_does_not_rest(pendulum: WriteStation) -> None:
    with pytest.raises(
        SimrobError,
        match=r"does not rest there: shoulder has no motor, and would take \d+\.\d+ N·m",
    ):
        linearize(load_station(pendulum()), [0.5, 0.0])


def test_mujoco_moves_it_as_drake_does(pendulum: WriteStation) -> None:
    drake = simulate(pendulum())
    mujoco = simulate(pendulum(solver={"kind": "mujoco", "time_step": STEP}))

    np.testing.assert_allclose(mujoco["q.shoulder"], drake["q.shoulder"], atol=5e-3)
    assert not mujoco["tau.shoulder"].any()


def test_it_is_passive_again_after_a_way_through_mjcf(
    pendulum: WriteStation, tmp_path: Path
) -> None:
    mjcf = tmp_path / "mjcf" / "pendulum.xml"

    assert run_command(["export", str(pendulum()), "--mjcf", str(mjcf)]) == 0

    model = import_robot(mjcf, tmp_path / "again", isolated=False, apart=False).model
    assert model.passive_axes == ["shoulder"]
    assert model.efforts[1] == 20.0


def test_a_program_cannot_move_it(
    pendulum: WriteStation, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    program = {"moves": [{"target_deg": {"shoulder": 10.0}, "duration": 0.5}]}
    assert run_command(["run", str(pendulum(program=program)), "--out", str(tmp_path / "out")]) == 2
    assert "target_deg.shoulder: shoulder is passive: no motor moves it" in " ".join(
        capsys.readouterr().err.split()
    )


def test_a_monitor_of_torques_does_not_watch_it(pendulum: WriteStation) -> None:
    result = simulate(pendulum(monitors={"torque_limit": {"hold": 0.0}}, duration=0.2))
    assert result.stopped_by is None


def test_a_move_is_judged_by_the_driven_axes(pendulum: WriteStation) -> None:
    """The tool is the origin of the lower link, at the elbow, so that the shoulder alone moves it."""
    arm = Arm(load_station(pendulum(duration=0.5)))
    result = arm.move_abs_j([START[0], START[1] + 0.3], duration=0.5)

    assert abs(result["q.shoulder"][-1] - START[0]) > 0.2
    (move,) = result.verdict.moves
    assert move.reached
    assert move.position_error < 1e-9
    assert move.following_error < 1e-9


def test_a_policy_does_not_move_it(pendulum: WriteStation) -> None:
    robot = resolve(load_station(pendulum())).robots["robot"]
    policy = Policy(kind="policy", observes=["position"], moves_deg=10.0)

    assert policy.axes(robot) == ["elbow"]
    with pytest.raises(SimrobError, match=r"moves_deg\.shoulder: shoulder is passive"):
        policy.model_copy(update={"moves_deg": {"shoulder": 10.0}}).reach(robot)
