"""Signal flows in stations: a law that moves as a servo, exact continuation, what ends a run and what is refused."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from simrob_drake import add_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import in_language
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

AXIS_GAINS = {"kp": 1000.0, "kd": 20.0}  # N·m/rad and N·m·s/rad
TORQUE_LIMIT = 150  # N·m
LAW = {
    "kind": "signal_flow",
    "blocks": {
        "Error": {"kind": "sum", "of": {"q_ref.joint_1": 1, "q.joint_1": -1}},
        "Limit": {
            "kind": "saturation",
            "lower": -TORQUE_LIMIT,
            "upper": TORQUE_LIMIT,
            "of": {"Error": AXIS_GAINS["kp"], "v.joint_1": -AXIS_GAINS["kd"]},
        },
    },
    "torque": {"joint_1": "Limit"},
}
"""A PD servo of the first joint as a signal flow."""
OFF = {"servo.kp": {"joint_1": 0}, "servo.kd": {"joint_1": 0}}
"""No servo for the first joint."""
MOVE = {"reference": {"kind": "hold", "target_deg": {"joint_1": 30}}, "pieces": {}, "floor": None}
SERVO = {
    "servo.torque_limit": {"joint_1": TORQUE_LIMIT},
    **{f"servo.{key}": gain for key, gain in AXIS_GAINS.items()},
}
"""The same PD servo for all joints."""


def servo_of_others():
    """Servos as `SERVO` for all joints but the first one."""
    changes = dict(SERVO)
    for key, gain in AXIS_GAINS.items():
        changes[f"servo.{key}"] = {
            f"joint_{number}": gain if number > 1 else 0.0 for number in range(1, 7)
        }
    return changes


def arm(law=None, **changed):
    """An arm that moves its first joint by 30 degrees, with a signal flow unless it is None."""
    controllers = {} if law is None else {"controllers": {"law": law}}
    return load_station("irb120_dynamic", {**MOVE, **changed, **controllers})


def law_with(blocks=None, **changed):
    """`LAW` with more blocks, and with other keys changed."""
    return {**LAW, "blocks": {**LAW["blocks"], **(blocks or {})}, **changed}


def test_a_law_that_is_a_servo_moves_as_one():
    """A PD law of blocks moves the joint as a servo with the same gains and the same limit does."""
    accuracy = {"solver.accuracy": 1e-5}

    servo = simulate(arm(**SERVO, **accuracy), duration=0.6, progress=False)
    flow = simulate(arm(LAW, **servo_of_others(), **accuracy), duration=0.6, progress=False)

    times = np.linspace(0, 0.6, 61)
    of_servo, of_flow = (
        np.interp(times, result.times, result["q.joint_1"]) for result in (servo, flow)
    )
    assert np.ptp(servo["q.joint_1"]) > 0.4
    np.testing.assert_allclose(of_flow, of_servo, atol=1e-6)
    assert abs(flow["law.Limit"]).max() == TORQUE_LIMIT


def test_a_run_goes_on_where_it_ended():
    """Two runs, the second from the end of the first, end as one of the same duration: states of blocks are kept."""
    blocks = {
        "Filter": {
            "kind": "transfer_function",
            "numerator": [1],
            "denominator": [0.05, 1],
            "of": "Error",
        },
        "Held": {"kind": "delay", "period": 0.01, "of": "v.joint_1"},
        "Slow": {"kind": "integrator", "period": 0.03, "of": "Error"},
    }
    law = law_with(blocks, torque={"joint_1": {"Limit": 0.1, "Filter": 50, "Held": -1, "Slow": 20}})
    config = arm(law, **OFF, solver={"kind": "discrete", "time_step": 1e-3})

    whole = simulate(config, duration=0.4, progress=False)
    first = simulate(config, duration=0.17, progress=False)
    second = simulate(config, duration=0.23, start=first.final_state, progress=False)

    # What is integrated with error control begins anew with a short step.
    assert second["q.joint_1"][-1] == pytest.approx(whole["q.joint_1"][-1], abs=1e-6)
    assert second["law.Slow"][-1] == pytest.approx(whole["law.Slow"][-1], abs=1e-6)


class Grows(LeafSystem):
    """A block of the user's own with a continuous state."""

    def __init__(self):
        super().__init__()
        self.DeclareContinuousState(1)

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([2.0])


def test_a_law_without_states_costs_a_discrete_station_no_integration_unless_something_is_integrated():
    """Drake fails if expressions without states are asked for their rates, so they get a state if it may ask."""
    config = arm(LAW, **OFF, solver={"kind": "discrete", "time_step": 1e-3})
    open_builder = DiagramBuilder()
    add_station(open_builder, config)  # to which its user may add whatever is integrated

    alone = simulate(config, duration=0.1, progress=False)
    with_integration = simulate(config, duration=0.1, blocks={"grows": Grows()}, progress=False)
    closed_context = closed_station(resolve(config)).diagram.CreateDefaultContext()
    open_context = open_builder.Build().CreateDefaultContext()

    np.testing.assert_array_equal(alone["q.joint_1"], with_integration["q.joint_1"])
    assert closed_context.num_continuous_states() == 0
    assert open_context.num_continuous_states() > 0


def test_a_stop_ends_the_run():
    """The run ends at the step in which the joint passes the threshold of 0.1 rad."""
    far = {"kind": "compare", "operator": ">", "threshold": 0.1, "of": "q.joint_1"}
    law = law_with({"Far": far}, stops={"Enough": "Far"})

    result = simulate(arm(law, **OFF), duration=2, progress=False)

    assert result.ending == "monitor"
    assert result.message.startswith("the stop Enough is active")
    assert 0.1 < result["q.joint_1"][-1] < 0.2


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"torque": {"joint_9": "Limit"}}, "axis of .* for controllers.law.torque"),
        ({"torque": {"joint_1": "Limits"}}, "controllers.law.blocks.torque.of .*Limit"),
        ({"torque": {"joint_1": "tau.joint_1"}}, "measured during the run"),
        ({"torque": {"joint_1": "Limit.1"}}, "Limit"),
        ({"blocks": {"A": {"kind": "sum", "of": "B"}, "B": {"kind": "sum", "of": "A"}}, "torque": {}}, "algebraic"),
        ({"blocks": {"A": {"kind": "switch", "of": ["one"]}}, "torque": {}}, r"blocks\.A\.of is 1; it must be 3"),
        ({"blocks": {"one": {"kind": "sum", "of": "time"}}, "torque": {}}, "another name"),
        ({"blocks": {"A": {"kind": "saturation", "lower": 1, "upper": 0, "of": "one"}}}, "it must be at most upper, 0"),
        ({"blocks": {"A": {"kind": "transfer_function", "numerator": [1, 0], "denominator": [1], "of": "one"}}},
         "higher degree"),
        ({"blocks": {"A": {"kind": "state_space", "A": [[0]], "B": [[1, 1]], "C": [[1]], "D": [[0]], "of": "one"}}},
         "must be 1 × 1, for 1 input, 1 state and 1 output"),
        ({"blocks": {"A": {"kind": "lookup", "points": [1, 0], "values": [1, 0], "of": "one"}}},
         "points must increase"),
        ({"blocks": {name: {"kind": "delay", "period": period, "of": "one"}
                     for name, period in (("A", 0.02), ("B", 0.020002))}, "torque": {}}, "multiples of a common step"),
        ({"blocks": {"A": {"kind": "pid", "d": 1, "of": "time"}}, "torque": {}}, "blocks.A.filter .*cut-off"),
        ({"blocks": {"A": {"kind": "pid", "of": ["time", "one"]}}, "torque": {}}, "1, or 3"),
        ({"signals": ["Limits"]}, "block for controllers.law.signals"),
    ],
)  # fmt: skip
def test_a_wrong_law_is_refused_with_the_reason(changed, reason):
    with pytest.raises(SimrobError, match=reason):
        simulate(arm(LAW | changed), duration=0.01, progress=False)


def test_the_reason_is_translated_with_all_of_its_parts():
    blocks = {
        name: {"kind": "delay", "period": period, "of": "one"}
        for name, period in (("A", 0.02), ("B", 0.020002))
    }

    with pytest.raises(SimrobError) as raised:
        simulate(arm(LAW | {"blocks": blocks, "torque": {}}), duration=0.01, progress=False)

    spanish = in_language(raised.value.message, "es")
    assert "los periodos 0.02, 0.020002 s no tienen un paso común" in spanish


def test_a_block_that_cannot_compute_fails_the_run():
    """The block computes the root of a negative number from 0.05 s on."""
    root = {"kind": "function", "function": "sqrt", "of": {"one": 0.05, "time": -1}}
    law = {"kind": "signal_flow", "blocks": {"Root": root}, "torque": {"joint_1": "Root"}}

    result = simulate(arm(law), duration=0.2, progress=False)

    assert result.ending == "diverged"
    assert "sqrt" in result.message


class Brain(LeafSystem):
    """A block of the user's own that samples the block ``Limit`` of a law, and drives its input ``Brain``."""

    def __init__(self):
        super().__init__()
        self.read = self.DeclareVectorInputPort("law.Limit", 1)
        held = self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("law.Brain", held)
        self.DeclarePeriodicDiscreteUpdateEvent(1e-3, 0.0, self.sample)

    def sample(self, context, state):
        state.set_value(self.read.Eval(context))


def test_an_open_input_is_driven_by_a_block_of_the_users_own():
    """A block of the user's own in the middle of a law moves the joint as the law itself does."""
    law = law_with({"Brain": {"kind": "input"}}, torque={"joint_1": "Brain"})
    servos = servo_of_others()

    at_rest = simulate(arm(law, **servos), duration=0.1, progress=False)
    driven = simulate(arm(law, **servos), duration=0.6, blocks=[Brain()], progress=False)
    direct = simulate(arm(LAW, **servos), duration=0.6, progress=False)

    assert abs(at_rest["q.joint_1"]).max() < 1e-3  # nothing drives it, and nothing pulls at it
    # late by a millisecond
    np.testing.assert_allclose(driven["q.joint_1"], direct["q.joint_1"], atol=0.02)
    assert np.ptp(direct["q.joint_1"]) > 0.4


class Source(LeafSystem):
    """A block of the user's own that gives the input ``inputs.Extra`` of a station the value 0.25."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorOutputPort(
            "inputs.Extra", 1, lambda _, output: output.SetAtIndex(0, 0.25)
        )


def test_a_flow_of_inputs_alone_gives_them_to_the_station():
    """The flow computes nothing, but a block of the user's own drives its input, and another flow reads it."""
    inputs = {"kind": "signal_flow", "blocks": {"Extra": {"kind": "input"}}}
    reader = {"kind": "signal_flow", "blocks": {"Sum": {"kind": "sum", "of": {"inputs.Extra": 2}}}}
    config = load_station("irb120_dynamic", {"controllers": {"inputs": inputs, "reader": reader}})

    ports = add_station(DiagramBuilder(), config)
    result = simulate(config, duration=0.01, blocks=[Source()], progress=False)

    assert "inputs.Extra" in ports.inputs
    assert result.notes["inputs"] == {"kind": "signal_flow"}
    np.testing.assert_array_equal(result["inputs.Extra"], 0.25)
    np.testing.assert_array_equal(result["reader.Sum"], 0.5)
    with pytest.raises(
        SimrobError, match=r"input inputs.Extra: the blocks one and two both drive it"
    ):
        simulate(config, duration=0.01, blocks={"one": Source(), "two": Source()}, progress=False)


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        (
            {"S": {"kind": "function", "function": "sqrt", "of": {"time": 1, "one": -1}}},
            "diverged at 0 s: sqrt(-1)",
        ),
        (
            {
                "I": {"kind": "delay", "of": "one", "period": 0.01},
                "S": {
                    "kind": "function",
                    "function": "sqrt",
                    "of": {"I": 1, "one": -1},
                    "period": 0.01,
                },
            },
            "the block S cannot be computed from [-1.0]",
        ),
    ],
)
def test_what_cannot_be_computed_at_the_start_ends_the_run_in_one_line(blocks, message):
    """The first sample and the first step fail alike, and the message does not blame the solver."""
    law = {"kind": "signal_flow", "blocks": blocks, "torque": {"joint_1": {"S": 0.1}}}
    config = load_station("irb120_dynamic", {"controllers": {"law": law}, "duration": 0.1})

    run = simulate(config, progress=False)

    assert run.ending == "diverged"
    assert message in run.message
    assert "stiff" not in run.message
    assert run.stop_time == 0.0


def test_a_force_of_no_signals_is_none():
    """A force without signals acts on nothing, and its flow adds no system."""
    law = {"kind": "signal_flow", "forces": {"nothing": {"at": "lower_link"}}}

    result = simulate(
        load_station("double_pendulum", {"controllers": {"law": law}}),
        duration=0.05,
        progress=False,
    )

    assert result.ending == "completed"


def test_a_block_may_have_the_name_of_an_output_of_the_station():
    """A block ``position`` reads the column ``q.joint_1`` of the station's output ``position``, and not itself."""
    law = {"kind": "signal_flow", "blocks": {"position": {"kind": "sum", "of": {"q.joint_1": 2}}}}

    result = simulate(arm(law), duration=0.3, progress=False)

    assert np.ptp(result["q.joint_1"]) > 0.01
    np.testing.assert_allclose(result["law.position"], 2 * result["q.joint_1"], atol=1e-12)


def test_terms_that_name_the_same_number_add_up():
    """``Half`` and ``Half.0`` are two names of one number."""
    blocks = {
        "Half": {"kind": "sum", "of": {"one": 0.5}},
        "Total": {"kind": "sum", "of": {"Half": 1, "Half.0": 1}},
    }

    result = simulate(arm({"kind": "signal_flow", "blocks": blocks}), duration=0.01, progress=False)

    np.testing.assert_array_equal(result["law.Total"], 1.0)


@pytest.mark.parametrize("denominator", [[2.0], [1.0, 1.0], [1.0, 3.0, 2.0]])
def test_a_transfer_function_of_zero_gives_zero(denominator):
    """A numerator of zeros alone has no highest power, and is allowed."""
    zero = {
        "kind": "transfer_function",
        "numerator": [0.0],
        "denominator": denominator,
        "of": "one",
    }

    result = simulate(
        arm({"kind": "signal_flow", "blocks": {"Zero": zero}}), duration=0.01, progress=False
    )

    np.testing.assert_array_equal(result["law.Zero"], 0.0)
