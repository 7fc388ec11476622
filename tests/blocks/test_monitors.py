"""Monitors end a run when they must, and only then, whatever the solver."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
    SimulatorStatus,
)
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake import add_station, load_station
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.blocks.monitor import Condition, Monitor, SteadySteps
from simrob_drake.parts.monitors.monitor import MonitorSection
from simrob_drake.parts.resolved import StationContents
from simrob_drake.stations.resolve import resolve

AddPendulum = Callable[..., MultibodyPlant]

STEP = 0.01  # s
STOPPED = SimulatorStatus.ReturnReason.kReachedTerminationCondition
DONE = SimulatorStatus.ReturnReason.kReachedBoundaryTime


def section_of(
    kind: str, station: str = "double_pendulum", servo: dict[str, Any] | None = None, **keys: Any
) -> tuple[MonitorSection, StationContents]:
    """Return a monitor's section of a station, and the station."""
    config = load_station(
        station, {"monitors": {"watch": {"kind": kind, **keys}}, "servo": servo or {}}
    )
    return config.monitors["watch"], resolve(config)


def condition(kind: str, *options: Any, **keys: Any) -> Condition:
    section, station = section_of(kind, *options, **keys)
    return section.condition("watch", station)


def monitor(kind: str, *options: Any, **keys: Any) -> Monitor:
    """Return the block that such a section makes."""
    section, station = section_of(kind, *options, **keys)
    return Monitor(section.condition("watch", station), hold=section.hold, after=section.after)


def watched(
    block: Monitor, duration: float = 2.0, **signals: Trajectory
) -> tuple[bool, float, str]:
    """Play signals to a monitor in steps of 10 ms. Returns whether it ended the run, when and why."""
    builder = DiagramBuilder()
    builder.AddNamedSystem("monitor", block)
    builder.AddSystem(SteadySteps(STEP))
    for name, trajectory in signals.items():
        source = builder.AddSystem(TrajectorySource(trajectory))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
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


def joint_limit(before: float = 1380.0) -> Monitor:
    """Watch two joints that turn by 1440 deg to both sides, from 60 deg on unless said otherwise."""
    return monitor("joint_limit", margin_deg=before)


def speed_monitor(**times: float) -> Monitor:
    """Watch one speed, up to 10 rad/s."""
    above = Condition(
        {"velocity": 1},
        lambda velocity: abs(float(velocity[0])) - 10.0,
        lambda velocity: f"{velocity[0]:g} rad/s",
    )
    return Monitor(above, **times)


@pytest.mark.parametrize(
    ("target", "when", "why"),
    [
        ((240, 0), 0.5, "joint_1 reached its upper limit of 60.0 deg"),
        ((-240, 0), 0.5, "joint_1 reached its lower limit of -60.0 deg"),
        ((0, 120), 1.0, "joint_2 reached its upper limit of 60.0 deg"),
        ((0, -120), 1.0, "joint_2 reached its lower limit of -60.0 deg"),
    ],
)
def test_the_first_joint_at_its_limit_ends_the_run(
    target: tuple[float, float], when: float, why: str
) -> None:
    stopped, time, message = watched(
        joint_limit(), position=line((0, 0, 0), (2, *np.deg2rad(target)))
    )

    assert stopped
    assert when - 1e-9 <= time <= when + STEP + 1e-9
    assert why in message


def test_joints_inside_of_their_limits_end_nothing() -> None:
    stopped, time, _ = watched(
        joint_limit(0.0), position=line((0, -25.13, 25.13), (2, 25.13, -25.13))
    )
    assert not stopped
    assert time == 2.0


def test_a_margin_stops_before_the_limit_and_a_negative_one_beyond() -> None:
    told = "joint_1 reached its upper limit of {:.1f} deg".format
    for margin, limit in ((0.0, 1440.0), (1410.0, 30.0), (-60.0, 1500.0)):
        path = line((0, 0, 0), (2, 4 * np.deg2rad(limit), 0))
        stopped, time, message = watched(joint_limit(margin), position=path)
        assert stopped
        assert time == pytest.approx(0.5, abs=STEP)
        assert told(limit) in message


def test_the_worst_joint_is_the_one_that_is_named() -> None:
    _, time, message = watched(joint_limit(), position=line((0, 1.1, -2.5), (2, 1.1, -2.5)))
    assert time == 0.0
    assert "joint_2 reached its lower limit" in message


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_counts_as_a_violation(bad: float) -> None:
    for kind in ("joint_limit", "divergence", "torque_limit"):
        assert condition(kind).excess(np.array([0.0, bad])) == np.inf
    fast = condition("divergence")
    assert (
        fast.why(np.array([bad, 0.0]))
        == "joint_1 diverged: its speed is inf rad/s, above 100 rad/s"
    )


def test_a_robot_whose_speed_is_no_number_does_not_stand_still() -> None:
    assert not condition("settled").excess(np.array([0.0, np.nan])) >= 0


def test_the_excess_port_tells_by_how_much() -> None:
    block = joint_limit()
    context = block.CreateDefaultContext()

    block.GetInputPort("position").FixValue(context, [0.7, -2.2])

    assert block.GetOutputPort("excess").Eval(context)[0] == pytest.approx(2.2 - np.deg2rad(60))


def test_what_slides_is_told_in_metres_and_newtons() -> None:
    belt = "irb120_on_belt"
    still = np.zeros(6)

    limits = condition("joint_limit", belt, margin_m=0.1)

    position = np.array([1.45, *still])
    assert limits.excess(position) == pytest.approx(0.05)
    assert limits.why(position) == "belt reached its upper limit of 1.4 m"

    torque = condition("torque_limit", belt, {"torque_limit": {"belt": 500}}, hold=0.1)
    assert (
        torque.why(np.array([500.0, *still]))
        == "belt stayed at its torque limit of 500 N for 0.1 s"
    )

    fast = condition("divergence", belt, speed_limit=10)
    assert fast.why(np.array([20.0, *still])) == "belt diverged: its speed is 20 m/s, above 10 m/s"


@pytest.mark.parametrize(
    ("velocity", "settled"), [((0.0009, 5.7), True), ((0.0011, 0), False), ((0, 5.9), False)]
)
def test_axes_that_turn_and_slide_have_bounds_of_their_own(
    velocity: tuple[float, float], settled: bool
) -> None:
    still = condition("settled", "irb120_on_belt", speed_deg=5.8, hold=0.2)

    values = np.array([velocity[0], np.deg2rad(velocity[1]), 0, 0, 0, 0, 0])
    assert (still.excess(values) >= 0) is settled
    assert (
        still.why(values) == "the robot has stood still (below 0.001 m/s and 5.8 deg/s) for 0.2 s"
    )


def torque_limit(hold: float) -> Monitor:
    return monitor(
        "torque_limit",
        "double_pendulum",
        {"torque_limit": {"joint_1": 10, "joint_2": 4}},
        hold=hold,
    )


def test_a_servo_that_stays_saturated_ends_the_run() -> None:
    torque = PiecewisePolynomial.ZeroOrderHold([0, 0.3, 9], [[0, 9.0, 0], [0, -4.0, 0]])
    stopped, time, message = watched(torque_limit(0.5), torque=torque)

    assert stopped
    assert time == pytest.approx(0.8, abs=STEP + 1e-9)
    assert "joint_2 stayed at its torque limit of 4 N·m for 0.5 s" in message


def test_a_torque_limit_may_be_the_monitor_s_own() -> None:
    own = condition("torque_limit", "irb120_dynamic", limit={"joint_2": 20}, hold=0.1)

    torque = np.array([0, -21.0, 0, 0, 0, 0])
    assert own.excess(torque) == pytest.approx(0.05, abs=1e-5)
    assert own.why(torque) == "joint_2 stayed at the limit of 20 N·m for 0.1 s"
    with pytest.raises(SimrobError, match=r"monitors\.watched\.limit.*positive"):
        load_station("irb120_dynamic", {"monitors.watched": {"kind": "torque_limit", "limit": -1}})


@pytest.mark.parametrize("part", [0.99, 0.9999])
def test_a_servo_below_its_limit_ends_nothing(part: float) -> None:
    assert not watched(
        torque_limit(0.0), torque=line((0, 10 * part, 4 * part), (9, 10 * part, 4 * part))
    )[0]


def test_a_limit_may_be_missing_by_the_solver_s_rounding() -> None:
    torque = line((0, 10 * (1 - 1e-7), 0), (9, 10 * (1 - 1e-7), 0))
    assert watched(torque_limit(0.1), torque=torque)[0]


def test_a_robot_that_slows_down_is_settled() -> None:
    block = monitor("settled", speed_deg=np.rad2deg(0.1), hold=0.2)
    stopped, time, message = watched(block, velocity=line((0, 1, -1), (1, 0, 0), (9, 0, 0)))

    assert stopped
    assert time == pytest.approx(0.9 + 0.2, abs=2 * STEP)
    assert "the robot has stood still (below 5.72958 deg/s) for 0.2 s" in message


def test_a_robot_that_moves_slowly_in_one_joint_is_not_settled() -> None:
    block = monitor("settled", speed_deg=np.rad2deg(0.1), hold=0.0)
    assert not watched(block, velocity=line((0, 0, -0.11), (9, 0, -0.11)))[0]


@pytest.mark.parametrize(
    ("error", "settled"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)]
)
def test_a_robot_at_rest_is_settled_only_near_its_reference(error: float, settled: bool) -> None:
    block = monitor("settled", error_deg=1.0, hold=0.2)
    off = 1 + np.deg2rad(error)

    still = {"velocity": line((0, 0, 0), (9, 0, 0)), "position": line((0, 1, 1), (9, 1, 1))}

    assert watched(block, **still, reference=line((0, 1, off), (9, 1, off)))[0] is settled


@pytest.mark.parametrize("direction", [1, -1])
def test_a_joint_that_runs_away_ends_the_run(direction: int) -> None:
    block = monitor("divergence", speed_limit=10)
    stopped, time, message = watched(block, velocity=line((0, 0, 0), (2, 0, 20 * direction)))

    assert stopped
    assert time == pytest.approx(1.0, abs=STEP + 1e-9)
    assert "joint_2 diverged: its speed is 10" in message
    assert "above 10 rad/s" in message


def test_a_fast_joint_below_the_bound_ends_nothing() -> None:
    assert not watched(
        monitor("divergence", speed_limit=10), velocity=line((0, 9.99, 0), (9, -9.99, 0))
    )[0]


@pytest.mark.parametrize(("hold", "stopped"), [(0.0, True), (0.1, True), (0.3, False)])
def test_a_condition_counts_once_it_has_lasted(hold: float, stopped: bool) -> None:
    found, time, _ = watched(speed_monitor(hold=hold), velocity=pulse(0.5, 0.7, 20.0))
    assert found is stopped
    assert time == pytest.approx(0.5 + hold if stopped else 2.0, abs=2 * STEP)


def test_pulses_that_are_apart_do_not_add_up() -> None:
    # on for 0.2 s, off for 0.1 s, on again
    trajectory = PiecewisePolynomial.ZeroOrderHold(
        [0, 0.5, 0.7, 0.8, 1.0, 9], [[0, 20, 0, 20, 0, 0]]
    )
    assert not watched(speed_monitor(hold=0.25), velocity=trajectory)[0]


@pytest.mark.parametrize(
    ("after", "stopped", "when"),
    [(0.3, True, 0.5), (0.6, True, 0.6), (0.8, False, 2.0), (5.0, False, 2.0)],
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
    assert "20 rad/s" in message


def test_a_violation_at_the_start_that_must_last_is_counted_from_there() -> None:
    stopped, time, _ = watched(speed_monitor(hold=0.5), velocity=line((0, 20), (9, 20)))
    assert stopped
    assert time == pytest.approx(0.5, abs=STEP + 1e-9)


def flying(
    add_pendulum: AddPendulum,
    *,
    scheme: str | None,
    time_step: float,
    limit: float,
    monitored: bool = True,
) -> tuple[SimulatorStatus, Simulator]:
    """Turn a pendulum without gravity at 2 rad/s towards a monitored limit; position is 2 t."""
    builder = DiagramBuilder()
    plant = add_pendulum(builder, time_step=time_step, gravity=0.0)
    plant.Finalize()
    if monitored:
        beyond = Condition(
            {"position": 1},
            lambda position: float(position[0]) - limit,
            lambda _: f"the hinge is beyond {limit:g} rad",
        )
        block = builder.AddNamedSystem("monitor", Monitor(beyond))
        pick = builder.AddSystem(MatrixGain(np.array([[1.0, 0.0]])))
        builder.Connect(plant.get_state_output_port(), pick.get_input_port())
        builder.Connect(pick.get_output_port(), block.GetInputPort("position"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    if scheme:
        ApplySimulatorConfig(
            SimulatorConfig(integration_scheme=scheme, max_step_size=STEP), simulator
        )
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
    assert "the hinge is beyond 1 rad" in status.FormatMessage()
    assert 0.5 - 1e-6 <= simulator.get_context().get_time() <= 0.5 + STEP + 1e-9


@pytest.mark.parametrize(("scheme", "time_step"), SOLVERS)
def test_a_monitor_that_does_not_fire_leaves_the_motion_as_it_is(
    add_pendulum: AddPendulum, scheme: str | None, time_step: float
) -> None:
    ends = []
    for monitored in (True, False):
        status, simulator = flying(
            add_pendulum, scheme=scheme, time_step=time_step, limit=5.0, monitored=monitored
        )
        assert status.reason() == DONE
        plant = simulator.get_system().GetSubsystemByName("plant")
        ends.append(
            plant.get_state_output_port().Eval(plant.GetMyContextFromRoot(simulator.get_context()))
        )

    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_allclose(ends[0], [2.0, 2.0], atol=1e-6)


def test_a_station_s_monitor_reads_its_outputs_under_their_names() -> None:
    """The inputs of a monitor's block have the names and sizes of the station's outputs that it watches."""
    hold = 0.3
    after = 0.1
    section = {"kind": "settled", "robot": "left", "error_deg": 1, "hold": hold, "after": after}
    builder = DiagramBuilder()

    ports = add_station(builder, load_station("two_irb120", {"monitors": {"slow": section}}))

    (block,) = [system for system in builder.GetSystems() if isinstance(system, Monitor)]
    inputs = [block.get_input_port(index) for index in range(block.num_input_ports())]
    assert block.get_name() == "monitor.slow"
    assert [port.get_name() for port in inputs] == [
        "left.velocity",
        "left.position",
        "left.reference",
    ]
    assert all(ports.outputs[port.get_name()].size() == port.size() for port in inputs)
    trigger = ports.outputs.monitors["slow"]
    assert trigger.hold == hold
    assert trigger.after == after


@pytest.mark.parametrize("name", ["hold", "after"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_a_time_is_finite_and_not_negative(name: str, value: float) -> None:
    with pytest.raises(InvalidParameter, match=f"^{name} is "):
        speed_monitor(**{name: value})
    with pytest.raises(SimrobError, match=rf"monitors\.watch\.{name}: "):
        section_of("divergence", **{name: value})


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
@pytest.mark.parametrize(
    ("kind", "key"),
    [
        ("divergence", "speed_limit"),
        ("settled", "speed_deg"),
        ("settled", "speed_m"),
        ("settled", "error_deg"),
        ("settled", "error_m"),
    ],
)
def test_a_bound_is_positive(kind: str, key: str, bad: float) -> None:
    with pytest.raises(SimrobError, match=rf"monitors\.watch\.{key}: "):
        section_of(kind, **{key: bad})


@pytest.mark.parametrize(
    "kind", ["joint_limit", "torque_limit", "settled", "divergence", "fall", "workspace"]
)
def test_whom_it_watches_is_known_or_the_only_one(kind: str) -> None:
    bounds: dict[str, dict[str, Any]] = {
        "fall": {"height": 1},
        "workspace": {"lower": [0, 0, 0], "upper": [1, 1, 1]},
    }
    keys = bounds.get(kind, {})

    assert condition(kind, "two_irb120", robot="right", **keys).watched.keys() <= {
        f"right.{output}" for output in ("position", "velocity", "torque", "base_pose", "tcp_pose")
    }
    with pytest.raises(
        SimrobError, match=r"no robot for monitors\.watch 'rihgt'; did you mean 'right'"
    ):
        section_of(kind, "two_irb120", robot="rihgt", **keys)
    with pytest.raises(
        SimrobError, match=r"monitors\.watch\.robot is None; it must be one of left, right"
    ):
        section_of(kind, "two_irb120", **keys)
