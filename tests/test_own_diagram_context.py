"""Contexts, logs, starts and signals of runs in a diagram of a user's own, as people who know Drake use them."""

import pickle

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from simrob_drake import (
    Runner,
    add_station,
    build_station,
    load_station,
    simulate,
    simulate_diagram,
)
from simrob_drake.base.errors import InvalidParameter, SimrobError

pytestmark = pytest.mark.usefixtures("no_plots")

AXES = 6
PERIOD = 0.01  # of the logs [s]


class Wave(LeafSystem):
    """A target that swings, with a state of its own: the count of its samples."""

    def __init__(self):
        super().__init__()
        self.units = {"target": "rad"}
        self.DeclareVectorOutputPort("target", AXES, self._calc_target)
        count = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.05, 0.0, self._sample)
        self.DeclareStateOutputPort("count", count)

    def _calc_target(self, context, output):
        output.SetFromVector(np.full(AXES, 0.2 * np.sin(3.0 * context.get_time())))

    def _sample(self, context, state):
        state.set_value(context.get_discrete_state_vector().value() + 1.0)


class Cell:
    """An arm in a diagram of one's own, with a target block and a logger."""

    def __init__(self, **overrides):
        discrete = {
            "solver": {"kind": "discrete", "time_step": 1e-3},
            "servo.realization": "implicit",
        }
        config = load_station("irb120_dynamic", overrides or discrete)
        builder = DiagramBuilder()
        self.ports = add_station(builder, config)
        self.wave = builder.AddNamedSystem("wave", Wave())
        builder.Connect(self.wave.GetOutputPort("target"), self.ports.inputs["reference"])
        self.sink = LogVectorOutput(self.ports.outputs["position"], builder, PERIOD)
        self.diagram = builder.Build()

    def run(self, duration, **options):
        return simulate_diagram(
            self.diagram, self.ports, duration=duration, progress=False, **options
        )


@pytest.fixture(scope="module")
def cell():
    return Cell()


@pytest.fixture(scope="module")
def whole(cell):
    """The run from 0 to 0.2 s."""
    return cell.run(0.2)


def test_the_given_context_is_advanced_and_has_the_logs(cell):
    context = cell.diagram.CreateDefaultContext()
    result = cell.run(0.1, context=context)

    assert context.get_time() == pytest.approx(0.1)

    log = cell.sink.FindLog(context)
    np.testing.assert_allclose(log.sample_times(), np.arange(0.0, 0.105, PERIOD), atol=1e-9)
    np.testing.assert_array_equal(log.data()[:, -1], result.axes("q")[-1])


def test_a_run_without_a_context_has_its_logs_too(cell, whole):
    log = cell.sink.FindLog(whole.context())
    assert log.num_samples() == 21
    np.testing.assert_array_equal(log.data()[:, -1], whole.axes("q")[-1])


def test_each_context_is_a_new_one_at_the_end_of_the_run(whole):
    first, second = whole.context(), whole.context()
    first.SetTime(7.0)

    assert second.get_time() == whole.context().get_time() == pytest.approx(0.2)

    plant = whole.plant.plant
    positions = plant.GetPositions(plant.GetMyContextFromRoot(second))

    np.testing.assert_array_equal(positions, whole.positions_at(np.array([whole.stop_time]))[0])


def test_the_context_of_simulate_is_at_the_end_of_the_run():
    result = simulate("bouncing_ball", duration=0.5, progress=False)
    context = result.context()

    assert context.get_time() == pytest.approx(0.5)

    plant = result.plant.plant
    pose = plant.GetBodyByName("ball").EvalPoseInWorld(plant.GetMyContextFromRoot(context))

    np.testing.assert_allclose(pose.translation(), result.piece_pose("ball")[-1, :3], atol=1e-12)


def test_a_monitor_ends_the_context_where_the_result_ends():
    cell = Cell(**{"servo.torque_limit": 5, "monitors.torque_limit.hold": 0.05})
    context = cell.diagram.CreateDefaultContext()

    result = cell.run(1.0, context=context)

    assert result.ending == "monitor"
    assert context.get_time() == result.context().get_time() == result.stop_time


def test_parameters_of_the_context_act_on_motion_and_signals():
    builder = DiagramBuilder()
    discrete = {"solver": {"kind": "discrete"}, "servo.realization": "implicit"}
    ports = add_station(builder, "irb120_dynamic", overrides=discrete)
    target = builder.AddNamedSystem("target", ConstantVectorSource(np.zeros(AXES)))
    builder.Connect(target.get_output_port(), ports.inputs["reference"])
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    target.get_mutable_source_value(target.GetMyContextFromRoot(context)).set_value(
        np.full(AXES, 0.1)
    )

    result = simulate_diagram(diagram, ports, duration=0.3, context=context, progress=False)

    np.testing.assert_array_equal(result.axes("q_ref"), 0.1)
    assert result["q.joint_1"][-1] > 0.05


def test_a_fixed_step_run_goes_on_from_its_context_to_the_last_bit(cell, whole):
    first = cell.run(0.1)
    rest = cell.run(0.1, context=first.context())

    assert (rest.start_time, rest.stop_time) == pytest.approx((0.1, 0.2))
    np.testing.assert_array_equal(rest.values[-1], whole.values[-1])


def test_a_sensor_has_a_sample_in_a_run_between_two_of_its_samples():
    """A sensor at 20 Hz samples at 0 and 50 ms; the run goes from 10 to 30 ms, and its sample is that of its start."""
    discrete = {"solver": {"kind": "discrete", "time_step": 1e-3}, "servo.realization": "implicit"}
    cell = Cell(**discrete, **{"sensors.enc": {"kind": "encoders", "rate": 20}})
    context = cell.diagram.CreateDefaultContext()
    cell.run(0.01, context=context)

    result = cell.run(0.02, context=context)

    measured = result["position.enc.joint_1"]
    assert measured == pytest.approx(np.full(len(measured), result["q.joint_1"][0]))


def test_a_run_with_error_control_goes_on_within_its_accuracy():
    cell = Cell(duration=1.0)  # radau3
    whole = cell.run(0.1)

    rest = cell.run(0.05, context=cell.run(0.05).context())

    np.testing.assert_allclose(rest.axes("q")[-1], whole.axes("q")[-1], atol=1e-4)


def test_a_pickled_result_is_continued_by_its_final_state(cell, whole):
    first = pickle.loads(pickle.dumps(cell.run(0.1)))
    rest = cell.run(0.1, start=first.final_state, start_time="keep")

    assert rest.start_time == pytest.approx(0.1)
    np.testing.assert_array_equal(rest.values[-1], whole.values[-1])

    # The target block's own state goes along.
    anew = Cell()
    elsewhere = anew.run(
        0.1,
        start=first.final_state,
        start_time="keep",
        signals={"wave.n": anew.wave.get_output_port(1)},
    )

    assert elsewhere["wave.n"][-1] == pytest.approx(4)  # sampled at 0, 0.05, 0.1 and 0.15 s


def test_a_start_without_its_time_begins_at_zero(cell, whole):
    result = cell.run(0.05, start=whole.final_state)
    assert result.start_time == 0.0
    np.testing.assert_array_equal(result.axes("q")[0], whole.axes("q")[-1])


def test_a_pickled_result_names_the_way_instead_of_a_context(cell, whole):
    there = pickle.loads(pickle.dumps(whole))
    with pytest.raises(
        SimrobError, match=r"simulate_diagram\(diagram, ports, start=result.final_state"
    ):
        there.context()
    with pytest.raises(InvalidParameter, match=r"context is .*; it must be .*result\.context\(\)"):
        cell.run(0.1, context=there.context)


def test_a_pickled_result_of_a_station_has_context_and_contacts():
    result = simulate("bouncing_ball", duration=0.5, progress=False)
    there = pickle.loads(pickle.dumps(result))

    assert there.onsets == result.onsets != []

    context = there.context()
    assert context.get_time() == result.stop_time

    plant = there.plant.plant
    positions = plant.GetPositions(plant.GetMyContextFromRoot(context))

    np.testing.assert_allclose(
        positions, result.positions_at(np.array([result.stop_time]))[0], atol=1e-12
    )


def test_resume_names_the_call_that_continues(whole):
    with pytest.raises(InvalidParameter, match=r"context=result\.context\(\)"):
        Runner("irb120_dynamic").resume(whole, until=1.0)


def test_outputs_of_own_blocks_are_columns(cell):
    signals = {
        "planner.goal": cell.wave.GetOutputPort("target"),
        "planner.n": cell.wave.GetOutputPort("count"),
    }
    result = cell.run(0.1, signals=signals)

    expected = 0.2 * np.sin(3.0 * result.times)
    np.testing.assert_allclose(result["planner.goal.joint_3"], expected, atol=1e-12)
    assert result.units["planner.goal.joint_1"] == "rad"  # as the block says of its port, target
    assert result.units["planner.n"] == "1"
    assert result["planner.n"][-1] == pytest.approx(2)
    assert "planner.n" not in cell.run(0.01).names  # the ports of the station are unchanged
    assert "planner.n" in pickle.loads(pickle.dumps(result)).names


@pytest.mark.parametrize(
    ("signals", "text"),
    [
        ({"goal": "target"}, "<block>.<output>"),
        ({"planner.goal": None}, "signals: planner.goal is None"),
        (["planner.goal"], "signals is"),
    ],
)
def test_signals_that_cannot_be(cell, signals, text):
    if isinstance(signals, dict):
        signals = {name: port and cell.wave.GetOutputPort(port) for name, port in signals.items()}
    with pytest.raises(InvalidParameter, match=text):
        cell.run(0.01, signals=signals)


def test_signals_of_another_diagram(cell):
    other = Cell()
    with pytest.raises(InvalidParameter, match="a system in the diagram"):
        cell.run(0.01, signals={"planner.goal": other.wave.GetOutputPort("target")})
    with pytest.raises(InvalidParameter, match="the name of another output"):
        cell.run(0.01, signals={"tcp_pose.tool0": cell.wave.GetOutputPort("target")})


def test_ports_and_contexts_of_another_diagram(cell):
    other = Cell()

    with pytest.raises(
        InvalidParameter, match="ports is the ports of a station in another diagram"
    ):
        simulate_diagram(other.diagram, cell.ports, duration=0.1, progress=False)
    with pytest.raises(InvalidParameter, match="context is the context of another system"):
        cell.run(0.1, context=other.diagram.CreateDefaultContext())

    box = build_station("irb120_dynamic")
    with pytest.raises(
        InvalidParameter, match="ports is the ports of a station in another diagram"
    ):
        simulate_diagram(cell.diagram, box.ports, duration=0.1, progress=False)


def test_starts_that_cannot_be(cell, whole):
    with pytest.raises(InvalidParameter, match="together with a context"):
        cell.run(0.1, start=whole.final_state, context=cell.diagram.CreateDefaultContext())
    with pytest.raises(InvalidParameter, match="start_time is 'keep'"):
        cell.run(0.1, start_time="keep")
    with pytest.raises(SimrobError, match="start_time"):
        cell.run(0.1, start=whole.final_state, start_time="later")


def test_on_step_gets_each_time_once(cell):
    seen = []
    result = cell.run(0.05, on_step=lambda time, positions: seen.append(time))

    assert seen == result.step_times.tolist()

    alone = []
    push = {
        "forces": {
            "push": {
                "kind": "push",
                "at": "load",
                "start": 0.02,
                "duration": 0.01,
                "force": [1, 0, 0],
            }
        }
    }

    result = simulate(
        "irb120_dynamic",
        overrides=push,
        duration=0.05,
        progress=False,
        on_step=lambda t, q: alone.append(t),
    )

    assert alone == sorted(set(alone))
    assert alone == result.step_times.tolist()
