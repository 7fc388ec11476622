"""Monitors end a run when they must, and only then, whatever the solver."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig, SimulatorStatus
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory
from simrob_drake.blocks.monitors import DivergenceMonitor, JointLimitMonitor, SettledMonitor, TorqueLimitMonitor

from simrob_drake.blocks.events import SteadySteps
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.robots.units import PRISMATIC, REVOLUTE

AddPendulum = Callable[..., MultibodyPlant]

STEP = 0.01  # s
STOPPED = SimulatorStatus.ReturnReason.kReachedTerminationCondition
DONE = SimulatorStatus.ReturnReason.kReachedBoundaryTime


def watched(monitor: Monitor, duration: float = 2.0, **signals: Trajectory) -> tuple[bool, float, str]:
    """Play signals to a monitor in steps of 10 ms; tell whether it ended the run, when and why."""
    builder = DiagramBuilder()
    builder.AddNamedSystem("monitor", monitor)
    builder.AddSystem(SteadySteps(STEP))
    for name, trajectory in signals.items():
        source = builder.AddSystem(TrajectorySource(trajectory))
        builder.Connect(source.get_output_port(), monitor.GetInputPort(name))
    simulator = Simulator(builder.Build())
    status = simulator.Initialize()
    if status.reason() != STOPPED:
        status = simulator.AdvanceTo(duration)
    return status.reason() == STOPPED, simulator.get_context().get_time(), status.FormatMessage()


def line(*points: tuple[float, ...]) -> Trajectory:
    """Go straight through (time, value, value, ...)."""
    rows = np.array(points)
    return PiecewisePolynomial.FirstOrderHold(rows[:, 0], rows[:, 1:].T)


def pulse(start: float, end: float, high: float, low: float = 0.0) -> Trajectory:
    return PiecewisePolynomial.ZeroOrderHold([0.0, start, end, 100.0], [[low, high, low, low]])


def joint_limit(**options: float) -> JointLimitMonitor:
    limits = {"lower": np.array([-1.0, -2.0]), "upper": np.array([1.0, 2.0])}
    return JointLimitMonitor(axes=["elbow", "wrist"], **limits, **options)


def speed_monitor(**options: float) -> DivergenceMonitor:
    return DivergenceMonitor(axes=["elbow"], speed_limit=10.0, **options)


@pytest.mark.parametrize(
    ("target", "when", "why"),
    [
        ((4.0, 0.0), 0.5, "elbow reached its upper limit of 57.3 deg"),
        ((-4.0, 0.0), 0.5, "elbow reached its lower limit of -57.3 deg"),
        ((0.0, 4.0), 1.0, "wrist reached its upper limit of 114.6 deg"),
        ((0.0, -4.0), 1.0, "wrist reached its lower limit of -114.6 deg"),
    ],
)
def test_the_first_joint_at_its_limit_ends_the_run(target: tuple[float, float], when: float, why: str) -> None:
    stopped, time, message = watched(joint_limit(), position=line((0, 0, 0), (2, *target)))
    assert stopped
    assert when - 1e-9 <= time <= when + STEP + 1e-9
    assert why in message


def test_joints_inside_of_their_limits_end_nothing() -> None:
    stopped, time, _ = watched(joint_limit(), position=line((0, -0.999, 1.999), (2, 0.999, -1.999)))
    assert not stopped
    assert time == 2.0


def test_a_margin_stops_before_the_limit() -> None:
    stopped, time, message = watched(joint_limit(margin=0.5), position=line((0, 0, 0), (2, 2, 0)))
    assert stopped
    assert time == pytest.approx(0.5, abs=STEP)
    assert "elbow reached its upper limit of 28.6 deg" in message


def test_the_worst_joint_is_the_one_that_is_named() -> None:
    _, time, message = watched(joint_limit(), position=line((0, 1.1, -2.5), (2, 1.1, -2.5)))
    assert time == 0.0
    assert "wrist reached its lower limit" in message


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_counts_as_a_violation(bad: float) -> None:
    limits, speeds = joint_limit(), speed_monitor()
    for monitor, port, value in ((limits, "position", [0.0, bad]), (speeds, "velocity", [bad])):
        context = monitor.CreateDefaultContext()
        monitor.GetInputPort(port).FixValue(context, value)
        assert monitor.holds(context)
        assert monitor.excess_port.Eval(context)[0] == np.inf
    assert "elbow ran away: inf rad/s" in speeds.why(context)


def test_the_excess_port_tells_by_how_much() -> None:
    monitor = joint_limit()
    context = monitor.CreateDefaultContext()
    monitor.GetInputPort("position").FixValue(context, [0.7, -2.2])
    assert monitor.excess_port.Eval(context)[0] == pytest.approx(0.2)


def test_what_slides_is_told_in_metres_and_newtons() -> None:
    both = {"axes": ["belt", "elbow"], "units": [PRISMATIC, REVOLUTE]}
    limits = JointLimitMonitor(lower=np.zeros(2), upper=np.ones(2), margin=np.array([0.1, 0.0]), **both)
    assert "belt reached its upper limit of 0.9 m" in watched(limits, position=line((0, 0.5, 0.5), (2, 2, 0.5)))[2]
    torque = TorqueLimitMonitor(limit=np.array([500.0, 10.0]), hold=0.1, **both)
    assert (
        "belt stayed at its torque limit of 500 N for 0.1 s"
        in watched(torque, torque=line((0, 500, 0), (9, 500, 0)))[2]
    )
    fast = DivergenceMonitor(speed_limit=10.0, **both)
    assert "belt ran away: 20 m/s, above 10 m/s" in watched(fast, velocity=line((0, 20, 0), (9, 20, 0)))[2]


@pytest.mark.parametrize(("velocity", "settled"), [((0.0009, 0.09), True), ((0.0011, 0), False), ((0, 0.11), False)])
def test_each_joint_may_have_its_own_bounds(velocity: tuple[float, float], settled: bool) -> None:
    monitor = SettledMonitor(size=2, speed=np.array([1e-3, 0.1]), units=[PRISMATIC, REVOLUTE], hold=0.2)
    found, _, message = watched(monitor, velocity=line((0, *velocity), (9, *velocity)))
    assert found is settled
    assert not settled or "below 0.001 m/s and 5.72958 deg/s" in message


def torque_limit(hold: float) -> TorqueLimitMonitor:
    return TorqueLimitMonitor(axes=["elbow", "wrist"], limit=np.array([10.0, 4.0]), hold=hold)


def test_a_servo_that_stays_saturated_ends_the_run() -> None:
    torque = PiecewisePolynomial.ZeroOrderHold([0, 0.3, 9], [[0, 9.0, 0], [0, -4.0, 0]])
    stopped, time, message = watched(torque_limit(0.5), torque=torque)
    assert stopped
    assert time == pytest.approx(0.8, abs=STEP + 1e-9)
    assert "wrist stayed at its torque limit of 4 N·m for 0.5 s" in message


@pytest.mark.parametrize("part", [0.99, 0.9999])
def test_a_servo_below_its_limit_ends_nothing(part: float) -> None:
    assert not watched(torque_limit(0.0), torque=line((0, 10 * part, 4 * part), (9, 10 * part, 4 * part)))[0]


def test_a_limit_may_be_missing_by_the_solver_s_rounding() -> None:
    torque = line((0, 10 * (1 - 1e-7), 0), (9, 10 * (1 - 1e-7), 0))
    assert watched(torque_limit(0.1), torque=torque)[0]


def test_a_robot_that_slows_down_is_settled() -> None:
    monitor = SettledMonitor(size=2, speed=0.1, hold=0.2)
    stopped, time, message = watched(monitor, velocity=line((0, 1, -1), (1, 0, 0), (9, 0, 0)))
    assert stopped
    assert time == pytest.approx(0.9 + 0.2, abs=2 * STEP)
    assert "the robot has stood still (below 5.72958 deg/s) for 0.2 s" in message


def test_a_robot_that_moves_slowly_in_one_joint_is_not_settled() -> None:
    assert not watched(SettledMonitor(size=2, speed=0.1, hold=0.0), velocity=line((0, 0, -0.11), (9, 0, -0.11)))[0]


@pytest.mark.parametrize(("error", "settled"), [(0.04, True), (-0.04, True), (0.06, False), (-0.06, False)])
def test_a_robot_at_rest_is_settled_only_near_its_reference(error: float, settled: bool) -> None:
    monitor = SettledMonitor(size=1, speed=0.1, error=0.05, hold=0.2)
    still = {"velocity": line((0, 0), (9, 0)), "position": line((0, 1), (9, 1))}
    assert watched(monitor, **still, reference=line((0, 1 + error), (9, 1 + error)))[0] is settled


@pytest.mark.parametrize("direction", [1, -1])
def test_a_joint_that_runs_away_ends_the_run(direction: int) -> None:
    stopped, time, message = watched(speed_monitor(), velocity=line((0, 0), (2, 20 * direction)))
    assert stopped
    assert time == pytest.approx(1.0, abs=STEP + 1e-9)
    assert "elbow ran away: 10" in message
    assert "above 10 rad/s" in message


def test_a_fast_joint_below_the_bound_ends_nothing() -> None:
    assert not watched(speed_monitor(), velocity=line((0, 9.99), (9, -9.99)))[0]


@pytest.mark.parametrize(("hold", "stopped"), [(0.0, True), (0.1, True), (0.3, False)])
def test_a_condition_counts_once_it_has_lasted(hold: float, stopped: bool) -> None:
    found, time, _ = watched(speed_monitor(hold=hold), velocity=pulse(0.5, 0.7, 20.0))
    assert found is stopped
    assert time == pytest.approx(0.5 + hold if stopped else 2.0, abs=2 * STEP)


def test_pulses_that_are_apart_do_not_add_up() -> None:
    # on for 0.2 s, off for 0.1 s, on again
    trajectory = PiecewisePolynomial.ZeroOrderHold([0, 0.5, 0.7, 0.8, 1.0, 9], [[0, 20, 0, 20, 0, 0]])
    assert not watched(speed_monitor(hold=0.25), velocity=trajectory)[0]


@pytest.mark.parametrize(
    ("after", "stopped", "when"), [(0.3, True, 0.5), (0.6, True, 0.6), (0.8, False, 2.0), (5.0, False, 2.0)]
)
def test_watching_begins_after_its_time(after: float, stopped: bool, when: float) -> None:
    found, time, _ = watched(speed_monitor(after=after), velocity=pulse(0.5, 0.7, 20.0))
    assert found is stopped
    assert time == pytest.approx(when, abs=STEP + 1e-9)


def test_the_time_before_watching_does_not_count_as_held() -> None:
    _, time, _ = watched(speed_monitor(after=0.5, hold=0.4), velocity=line((0, 20), (9, 20)))
    assert time == pytest.approx(0.9, abs=2 * STEP)


def test_a_violation_at_the_start_ends_the_run_at_time_zero() -> None:
    stopped, time, message = watched(speed_monitor(), velocity=line((0, 20), (9, 0)))
    assert stopped
    assert time == 0.0
    assert "elbow ran away: 20 rad/s" in message


def test_a_violation_at_the_start_that_must_last_is_counted_from_there() -> None:
    stopped, time, _ = watched(speed_monitor(hold=0.5), velocity=line((0, 20), (9, 20)))
    assert stopped
    assert time == pytest.approx(0.5, abs=STEP + 1e-9)


def flying(
    add_pendulum: AddPendulum, *, scheme: str | None, time_step: float, limit: float, monitored: bool = True
) -> tuple[SimulatorStatus, Simulator]:
    """Turn a pendulum without gravity at 2 rad/s towards a monitored limit; position is 2 t."""
    builder = DiagramBuilder()
    plant = add_pendulum(builder, time_step=time_step, gravity=0.0)
    plant.Finalize()
    if monitored:
        monitor = JointLimitMonitor(axes=["hinge"], lower=np.array([-9.0]), upper=np.array([limit]))
        builder.AddNamedSystem("monitor", monitor)
        pick = builder.AddSystem(MatrixGain(np.array([[1.0, 0.0]])))
        builder.Connect(plant.get_state_output_port(), pick.get_input_port())
        builder.Connect(pick.get_output_port(), monitor.GetInputPort("position"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    if scheme:
        ApplySimulatorConfig(SimulatorConfig(integration_scheme=scheme, max_step_size=STEP), simulator)
    plant.SetVelocities(plant.GetMyContextFromRoot(simulator.get_mutable_context()), [2.0])
    simulator.Initialize()
    return simulator.AdvanceTo(1.0), simulator


SOLVERS = [("runge_kutta3", 0.0), ("radau3", 0.0), ("cenic", 0.0), (None, 1e-3), (None, STEP)]


@pytest.mark.parametrize(("scheme", "time_step"), SOLVERS)
def test_a_monitor_ends_continuous_and_discrete_plants_at_the_step_that_crosses(
    add_pendulum: AddPendulum, scheme: str | None, time_step: float
) -> None:
    status, simulator = flying(add_pendulum, scheme=scheme, time_step=time_step, limit=1.0)
    assert status.reason() == STOPPED
    assert "hinge reached its upper limit of 57.3 deg" in status.FormatMessage()
    assert 0.5 - 1e-6 <= simulator.get_context().get_time() <= 0.5 + STEP + 1e-9


@pytest.mark.parametrize(("scheme", "time_step"), SOLVERS)
def test_a_monitor_that_does_not_fire_leaves_the_motion_as_it_is(
    add_pendulum: AddPendulum, scheme: str | None, time_step: float
) -> None:
    ends = []
    for monitored in (True, False):
        status, simulator = flying(add_pendulum, scheme=scheme, time_step=time_step, limit=5.0, monitored=monitored)
        assert status.reason() == DONE
        plant = simulator.get_system().GetSubsystemByName("plant")
        ends.append(plant.get_state_output_port().Eval(plant.GetMyContextFromRoot(simulator.get_context())))
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_allclose(ends[0], [2.0, 2.0], atol=1e-6)


@pytest.mark.parametrize("name", ["hold", "after"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_a_time_is_finite_and_not_negative(name: str, value: float) -> None:
    with pytest.raises(InvalidParameter, match=f"^{name} is "):
        speed_monitor(**{name: value})


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_bound_is_positive(bad: float) -> None:
    with pytest.raises(InvalidParameter, match=r"^speed_limit is "):
        DivergenceMonitor(axes=["elbow"], speed_limit=bad)
    with pytest.raises(InvalidParameter, match=r"^limit is "):
        TorqueLimitMonitor(axes=["elbow"], limit=np.array([bad]))
    with pytest.raises(InvalidParameter, match=r"^speed is "):
        SettledMonitor(size=1, speed=bad)
    with pytest.raises(InvalidParameter, match=r"^error is "):
        SettledMonitor(size=1, speed=1.0, error=bad)
