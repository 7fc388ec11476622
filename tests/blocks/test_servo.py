"""Servos against their law: PD, integral part with its clamp, and saturation."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, PassThrough, Sine, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.integrate import solve_ivp

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.monitor import EventTimes
from simrob_drake.blocks.servo import CLAMP_TIME, ServoGains, ServoSignals, add_servos

NAMES = ("a", "b", "c")
COUNT = len(NAMES)
GAINS = ServoGains(
    kp=np.array([100.0, 30.0, 7.0]),
    ki=np.array([0.0, 50.0, 20.0]),
    kd=np.array([5.0, 0.0, 1.0]),
    torque_limit=np.array([40.0, 20.0, np.inf]),
    integral_limit=np.array([1.0, 6.0, 3.0]),
)
INPUTS = {"reference": COUNT, "state": 2 * COUNT, "reference_velocity": COUNT, "feedforward": COUNT}


def servo_diagram(gains: ServoGains, *, per_joint: bool, optional: tuple[str, ...] = ()) -> Diagram:
    """Build servos whose inputs are the diagram's."""
    builder = DiagramBuilder()
    ports = {}
    for name, size in INPUTS.items():
        if name in ("reference", "state", *optional):
            through = builder.AddNamedSystem(f"{name}_in", PassThrough(size))
            builder.ExportInput(through.get_input_port(), name)
            ports[name] = through.get_output_port()
    torque = add_servos(builder, ServoSignals(**ports), gains, names=NAMES, per_joint=per_joint)
    builder.ExportOutput(torque, "torque")
    return builder.Build()


def fixed(diagram: Diagram, values: dict[str, np.ndarray]) -> Context:
    context = diagram.CreateDefaultContext()
    for name, value in values.items():
        if diagram.HasInputPort(name):
            diagram.GetInputPort(name).FixValue(context, value)
    return context


def law(
    gains: ServoGains,
    values: dict[str, np.ndarray],
    integral: np.ndarray,
    optional: tuple[str, ...],
) -> np.ndarray:
    nothing = np.zeros(COUNT)
    velocity = values["reference_velocity"] if "reference_velocity" in optional else nothing
    feedforward = values["feedforward"] if "feedforward" in optional else nothing
    q = values["state"][:COUNT]
    v = values["state"][COUNT:]
    command = gains.kp * (values["reference"] - q) - gains.kd * (v - velocity) + feedforward
    command += np.clip(integral, -gains.integral_limit, gains.integral_limit)
    return np.clip(command, -gains.torque_limit, gains.torque_limit)


@pytest.mark.parametrize("per_joint", [True, False])
@pytest.mark.parametrize(
    "optional",
    [(), ("feedforward",), ("reference_velocity",), ("reference_velocity", "feedforward")],
)
def test_the_torque_is_that_of_the_law(per_joint: bool, optional: tuple[str, ...]) -> None:
    random = np.random.default_rng(3)
    diagram = servo_diagram(GAINS, per_joint=per_joint, optional=optional)
    saturated = 0

    for _ in range(50):
        values = {name: random.normal(size=size) for name, size in INPUTS.items()}
        context = fixed(diagram, values)
        integral = random.normal(scale=5.0, size=COUNT)
        integral[GAINS.ki == 0] = 0.0
        states = integral if context.num_continuous_states() == COUNT else integral[GAINS.ki > 0]
        context.SetContinuousState(states)
        expected = law(GAINS, values, integral, optional)
        np.testing.assert_allclose(
            diagram.GetOutputPort("torque").Eval(context), expected, atol=1e-12
        )
        saturated += int((np.abs(expected) == GAINS.torque_limit).sum())

    assert 10 < saturated < 90  # of 100: both sides of the saturation were met


def test_each_joint_has_its_own_blocks_and_an_integrator_only_where_ki_is_positive() -> None:
    diagram = servo_diagram(GAINS, per_joint=True)
    names = {system.get_name() for system in diagram.GetSystems()}

    assert {f"{name}.{block}" for name in NAMES for block in ("pd", "saturation")} <= names
    assert {name for name in names if name.endswith(".integrator")} == {
        "b.integrator",
        "c.integrator",
    }
    assert diagram.num_continuous_states() == 2


def test_a_vector_is_one_group_of_blocks() -> None:
    names = [system.get_name() for system in servo_diagram(GAINS, per_joint=False).GetSystems()]
    assert (
        names.count("servo.pd")
        == names.count("servo.saturation")
        == names.count("servo.integrator")
        == 1
    )
    assert not any(name.startswith(("a.", "b.", "c.")) for name in names)


@pytest.mark.parametrize("per_joint", [True, False])
def test_without_integral_gains_there_is_no_state(per_joint: bool) -> None:
    diagram = servo_diagram(replace(GAINS, ki=np.zeros(COUNT)), per_joint=per_joint)
    assert diagram.CreateDefaultContext().num_total_states() == 0


@pytest.mark.parametrize("per_joint", [True, False])
def test_no_python_runs_in_a_servo(per_joint: bool) -> None:
    systems = servo_diagram(GAINS, per_joint=per_joint).GetSystems()
    assert not [system for system in systems if type(system).__module__.startswith("simrob_drake")]


CASCADE = replace(
    GAINS,
    kd=np.array([5.0, 2.0, 1.0]),
    torque_limit=np.full(COUNT, np.inf),
    speed_limit=np.array([0.5, 9.0, np.inf]),
)


def cascade_speed_error(values: dict[str, np.ndarray], optional: tuple[str, ...]) -> np.ndarray:
    """Error of the speeds of a cascade, clip(kp / kd (q_r - q) + v_r) - v, shape (n,) [rad/s]."""
    position, velocity = np.hsplit(values["state"], 2)
    reference_velocity = values["reference_velocity"] if "reference_velocity" in optional else 0.0
    wanted = CASCADE.kp / CASCADE.kd * (values["reference"] - position) + reference_velocity
    return np.clip(wanted, -CASCADE.speed_limit, CASCADE.speed_limit) - velocity


def cascade_law(
    values: dict[str, np.ndarray], integral: np.ndarray, optional: tuple[str, ...]
) -> np.ndarray:
    """Torques of a cascade, kd (v_c - v) + clip(x) + feedforward, shape (n,) [N·m]."""
    clipped = np.clip(integral, -CASCADE.integral_limit, CASCADE.integral_limit)
    torque = CASCADE.kd * cascade_speed_error(values, optional) + clipped
    return torque + (values["feedforward"] if "feedforward" in optional else 0.0)


@pytest.mark.parametrize("per_joint", [True, False])
@pytest.mark.parametrize("optional", [(), ("feedforward",), ("reference_velocity", "feedforward")])
def test_a_cascade_asks_for_a_speed_and_limits_it(
    per_joint: bool, optional: tuple[str, ...]
) -> None:
    """Torques and rates of the integral parts, x' = ki kd / kp (v_c - v) + (clip(x) - x) / T, are those of the law."""
    random = np.random.default_rng(6)
    diagram = servo_diagram(CASCADE, per_joint=per_joint, optional=optional)
    has_state = CASCADE.ki > 0 if per_joint else np.full(COUNT, True)
    limited_count = 0

    for _ in range(20):
        values = {name: random.normal(size=size) for name, size in INPUTS.items()}
        context = fixed(diagram, values)
        integral = np.where(CASCADE.ki > 0, random.normal(scale=5.0, size=COUNT), 0.0)
        context.SetContinuousState(integral[has_state])

        torque = diagram.GetOutputPort("torque").Eval(context)
        rate = diagram.EvalTimeDerivatives(context).CopyToVector()

        np.testing.assert_allclose(torque, cascade_law(values, integral, optional), atol=1e-12)
        driven = CASCADE.kd / CASCADE.kp * cascade_speed_error(values, optional)
        clipped = np.clip(integral, -CASCADE.integral_limit, CASCADE.integral_limit)
        leak = (clipped - integral) / CLAMP_TIME
        np.testing.assert_allclose(rate, (CASCADE.ki * driven + leak)[has_state], atol=1e-10)
        error = values["reference"] - values["state"][:COUNT]
        commanded_speeds = CASCADE.kp / CASCADE.kd * error
        limited_count += abs(commanded_speeds[0]) > CASCADE.speed_limit[0]

    assert limited_count > 5


def test_a_cascade_without_limit_and_integral_is_the_single_loop() -> None:
    plain = replace(CASCADE, ki=np.zeros(COUNT), speed_limit=None)
    cascade = replace(plain, speed_limit=np.full(COUNT, np.inf))
    random = np.random.default_rng(7)
    values = {name: random.normal(size=size) for name, size in INPUTS.items()}
    torques = []

    for gains in (plain, cascade):
        diagram = servo_diagram(
            gains, per_joint=True, optional=("reference_velocity", "feedforward")
        )
        torques.append(diagram.GetOutputPort("torque").Eval(fixed(diagram, values)))

    np.testing.assert_allclose(*torques, atol=1e-12)


def integral_simulator(gains: ServoGains, source: LeafSystem, *, events: list[float]) -> Simulator:
    """Simulate one pure integral servo that holds at zero, with its reference from a source."""
    builder = DiagramBuilder()
    builder.AddSystem(source)
    builder.AddSystem(EventTimes(events))
    still = builder.AddSystem(ConstantVectorSource(np.zeros(2)))
    signals = ServoSignals(source.get_output_port(0), still.get_output_port())
    builder.ExportOutput(add_servos(builder, signals, gains, names=("a",)), "torque")
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(integration_scheme="runge_kutta3", accuracy=1e-8, max_step_size=0.01)
    ApplySimulatorConfig(config, simulator)
    return simulator


def integral_gains(ki: float, limit: float) -> ServoGains:
    return ServoGains(
        np.zeros(1), np.array([ki]), np.zeros(1), np.array([np.inf]), np.array([limit])
    )


def torque_at(simulator: Simulator, time: float) -> float:
    simulator.AdvanceTo(time)
    return float(simulator.get_system().GetOutputPort("torque").Eval(simulator.get_context())[0])


def test_the_integral_is_that_of_scipy() -> None:
    ki = 40.0
    limit = 2.0
    amplitude = 0.5
    frequency = 3.0
    sine = Sine(amplitude=amplitude, frequency=frequency, phase=0.0, size=1)
    simulator = integral_simulator(integral_gains(ki, limit), sine, events=[])

    def rate(time: float, x: np.ndarray) -> np.ndarray:
        return (
            ki * amplitude * np.sin(frequency * time) + (np.clip(x, -limit, limit) - x) / CLAMP_TIME
        )

    times = np.linspace(0.1, 4.0, 40)
    solution = solve_ivp(rate, (0, 4), [0.0], t_eval=times, rtol=1e-9, atol=1e-10, max_step=1e-3).y[
        0
    ]
    assert (np.abs(solution) > limit).any()  # the clamp was reached
    found = [torque_at(simulator, time) for time in times]
    np.testing.assert_allclose(found, np.clip(solution, -limit, limit), atol=1e-6)


def test_the_integral_part_stays_at_its_limit_and_unwinds_at_once() -> None:
    """Held against an error e, the state settles at limit + ki e T, and comes back T ln 2 after e has changed sign."""
    ki = 100.0
    limit = 5.0
    error = 1.0
    turn = 1.0  # time at which the error changes its sign [s]
    steps = PiecewisePolynomial.ZeroOrderHold([0.0, turn, 3.0], [[error, -error, -error]])
    simulator = integral_simulator(
        integral_gains(ki, limit), TrajectorySource(steps), events=[turn]
    )

    assert torque_at(simulator, turn / 2) == limit
    assert torque_at(simulator, turn) == limit
    state = simulator.get_context().get_continuous_state_vector()[0]
    assert state == pytest.approx(limit + ki * error * CLAMP_TIME)

    # x - limit = ki e T (2 exp(-t / T) - 1) is zero at t = T ln 2; from there x falls at ki e.
    leaving = turn + CLAMP_TIME * np.log(2)
    falling_time = 0.03  # [s]
    assert torque_at(simulator, leaving - 1e-4) == limit
    fallen = limit - ki * error * falling_time
    assert torque_at(simulator, leaving + falling_time) == pytest.approx(fallen, abs=1e-4)
    assert torque_at(simulator, turn + 1) == -limit


@pytest.mark.parametrize("name", ["kp", "ki", "kd"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_a_gain_is_finite_and_not_negative(name: str, value: float) -> None:
    with pytest.raises(InvalidParameter, match=f"^{name} is "):
        replace(GAINS, **{name: np.array([1.0, value, 1.0])})


@pytest.mark.parametrize("name", ["torque_limit", "integral_limit", "speed_limit"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_limit_is_positive(name: str, value: float) -> None:
    with pytest.raises(InvalidParameter, match=f"^{name} is "):
        replace(GAINS, **{name: np.array([1.0, value, 1.0])})


def test_an_axis_without_a_motor_has_no_torque_and_no_share() -> None:
    without = np.array([1.0, 0.0, 1.0])
    gains = replace(
        GAINS,
        kp=without * GAINS.kp,
        ki=without * GAINS.ki,
        kd=without * GAINS.kd,
        torque_limit=without * [40.0, 1.0, 30.0],
        integral_limit=without * GAINS.integral_limit,
    )

    assert gains.passive.tolist() == [False, True, False]
    torque = np.array([-20.0, 5.0, 15.0])
    np.testing.assert_allclose(gains.torque_shares(torque, np.zeros(COUNT)), [0.5, 0.0, 0.5])
    assert gains.holding_shares(torque).tolist() == [0.5, np.inf, 0.5]
    assert gains.holding_shares(np.zeros(COUNT)).tolist() == [0.0, 0.0, 0.0]
    for per_joint in (True, False):
        diagram = servo_diagram(gains, per_joint=per_joint, optional=("feedforward",))
        values = {
            "reference": np.ones(COUNT),
            "state": np.zeros(2 * COUNT),
            "feedforward": np.array([0.0, 9.0, 0.0]),
        }
        assert diagram.GetOutputPort("torque").Eval(fixed(diagram, values))[1] == 0.0


@pytest.mark.parametrize("name", ["kp", "kd"])
def test_a_cascade_needs_both_gains(name: str) -> None:
    with pytest.raises(InvalidParameter, match=f"^the smallest {name} is 0"):
        replace(CASCADE, **{name: np.array([1.0, 0.0, 1.0])})
