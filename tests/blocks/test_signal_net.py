"""Blocks of a signal flow against their equations, and a net of them against scipy and closed forms."""

import math
from graphlib import CycleError
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import TypeAdapter
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, Sine
from scipy import signal

from simrob_drake.blocks.signal_net import SignalNet, signal_net
from simrob_drake.blocks.written_net import WiredBlock
from simrob_drake.parts.controllers.signal_flow import FlowBlockConfig

ONE = 0
TIME = 1
U = 2
FIRST = 3
"""Index of the first block's output among the values."""
PHASE = 0.3
"""Phase of the measured sine [rad]."""


def block(kind, **keys):
    """The section of a block of a kind, which reads u."""
    return TypeAdapter(FlowBlockConfig).validate_python({"kind": kind, "of": "u", **keys})


class Run(NamedTuple):
    """Record of a net that measures a sine.

    Attributes:
        times: shape (m,) [s].
        u: the measured sine, shape (m,).
        outputs: outputs of all blocks, element by element, shape (elements, m).
    """

    times: np.ndarray
    u: np.ndarray
    outputs: np.ndarray


def run(blocks, *, duration=2.0, frequency=3.0, amplitude=1.0, rows=201):
    """Simulate a net that measures a sine. Returns a `Run`.

    A net of expressions is compared with the same net of written source, too.

    Args:
        blocks: section of each block and its inputs, by name.
        duration: duration of the run [s].
        frequency: angular frequency of the sine [rad/s].
        amplitude: amplitude of the sine.
        rows: count of recorded times.
    """
    wired = {name: WiredBlock(section.law, *inputs) for name, (section, *inputs) in blocks.items()}
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(amplitude=amplitude, frequency=frequency, phase=PHASE, size=1))
    net = builder.AddSystem(signal_net(wired, 1))
    builder.Connect(source.get_output_port(0), net.get_input_port())
    log = LogVectorOutput(net.get_output_port(), builder, duration / (rows - 1))
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-8)
    simulator.AdvanceTo(duration)

    if not isinstance(net, SignalNet):
        start = [state for wired_block in wired.values() for state in wired_block.block.start]
        assert_same_as_written(net, SignalNet(wired, 1), start)
    times = np.linspace(0, duration, rows)
    record = log.FindLog(simulator.get_context())
    return Run(times, amplitude * np.sin(frequency * times + PHASE), record.data()[:, :rows])


def evaluate(net, *, time, measured, state):
    """Outputs of a net, and the derivatives of its states (None without states), at a time with a measured value."""
    context = net.CreateDefaultContext()
    context.SetTime(time)
    net.get_input_port().FixValue(context, [measured])
    if not len(state):
        return net.get_output_port().Eval(context), None
    context.SetContinuousState(state)
    rates = net.EvalTimeDerivatives(context).get_vector().CopyToVector()
    return net.get_output_port().Eval(context), rates


def assert_same_as_written(net, written, start):
    """Check that a net of expressions computes what the blocks' own equations do, in other states than the start, too.

    Args:
        net: the net of expressions, whose states are differences from the start.
        written: the same net as written source.
        start: states at the start.
    """
    random = np.random.default_rng(1)
    for _ in range(20):
        state = random.uniform(-1, 1, len(start))
        measured, time = random.uniform(-1, 1, 2)

        outputs, rates = evaluate(net, time=time, measured=measured, state=state - np.array(start))
        expected_outputs, expected_rates = evaluate(
            written, time=time, measured=measured, state=state
        )

        np.testing.assert_allclose(outputs, expected_outputs, atol=1e-12)
        if start:
            np.testing.assert_allclose(rates, expected_rates, atol=1e-9)


def test_a_transfer_function_is_that_of_scipy():
    figures = {"numerator": [0.5, 2.0, 1.0], "denominator": [0.01, 0.2, 1.0]}
    dense = np.linspace(0, 2, 20001)
    _, wanted, _ = signal.lsim(tuple(figures.values()), np.sin(3 * dense + 0.3), dense)

    _, _, (y,) = run({"G": (block("transfer_function", **figures), [[(U, 1.0)]])})

    # of 15; what Drake's accuracy of 1e-8 leaves
    np.testing.assert_allclose(y, wanted[::100], rtol=1e-5, atol=1e-5)


def test_a_state_space_of_two_inputs_with_a_start_is_that_of_scipy():
    a = [[0, 1], [-4, -1]]
    b = [[0, 1], [1, 0]]
    c = [[1, 0], [0, 1], [1, 1]]
    d = [[0, 0], [0, 0], [1, 0]]
    dense = np.linspace(0, 2, 20001)
    inputs = np.column_stack([np.sin(3 * dense + 0.3), dense])
    _, wanted, _ = signal.lsim(
        [np.array(part, dtype=float) for part in (a, b, c, d)], inputs, dense, X0=[0.2, -0.1]
    )
    given = block("state_space", A=a, B=b, C=c, D=d, initial=[0.2, -0.1], of=["u", "time"])

    _, _, y = run({"S": (given, [[(U, 1.0)], [(TIME, 1.0)]])})

    np.testing.assert_allclose(y.T, wanted[::100], atol=1e-6)


def test_a_sampled_transfer_function_behind_another_is_that_of_scipy():
    """Both sample together: the second takes what the first gives at that very time, and all is held in between."""
    first_numerator = [0.3, 0.1]
    first_denominator = [1.0, -0.5]
    second_numerator = [1.0, 0.2]
    second_denominator = [1.0, 0.1, 0.2]
    first = block(
        "transfer_function", numerator=first_numerator, denominator=first_denominator, period=0.02
    )
    second = block(
        "transfer_function", numerator=second_numerator, denominator=second_denominator, period=0.02
    )
    slow = block("delay", period=0.06, initial=7.0)
    first_output = FIRST + 1  # index of its value: it is the second block of the net
    blocks = {  # not in the order of computation
        "second": (second, [[(first_output, 1.0)]]),
        "first": (first, [[(U, 1.0)]]),
        "slow": (slow, [[(first_output, 2.0)]]),
    }

    record = run(blocks, rows=101)

    # A value that is logged at t is from before the sample at t, so records are one sample late.
    of_second, of_first, of_slow = record.outputs[:, 1:]
    filtered = signal.lfilter(first_numerator, first_denominator, record.u)
    np.testing.assert_allclose(of_first, filtered[:-1], atol=1e-12)
    filtered_twice = signal.lfilter([0.0, *second_numerator], second_denominator, filtered)
    np.testing.assert_allclose(of_second, filtered_twice[:-1], atol=1e-12)
    # Every third sample, doubled, one slow period late.
    held = np.repeat([7.0, *2 * filtered[::3]], 3)[: len(of_slow)]
    np.testing.assert_allclose(of_slow, held, atol=1e-12)


def test_an_integrator_waits_at_its_bounds():
    given = block("integrator", initial=0.1, lower=-0.2, upper=0.3)
    times, _, (y,) = run({"I": (given, [[(U, 1.0)]])})
    dense = np.linspace(0, 2, 200001)
    wanted = np.empty_like(dense)
    value = 0.1

    for place, rate in enumerate(np.sin(3 * dense + 0.3)):
        wanted[place] = value
        value = min(max(value + 1e-5 * rate, -0.2), 0.3)

    np.testing.assert_allclose(y, np.interp(times, dense, wanted), atol=2e-4)
    assert y.max() == 0.3


def test_a_sampled_integrator_adds_up():
    _, u, (y,) = run({"I": (block("integrator", initial=0.5, period=0.01), [[(U, 3.0)]])})
    np.testing.assert_allclose(
        y[1:], 0.5 + 0.03 * np.concatenate([[0], np.cumsum(u)[:-2]]), atol=1e-12
    )


def test_a_rate_limiter_follows_within_its_slopes():
    """A sampled limiter goes on by at most slope times period; a continuous one is late by its lag."""
    rising = 1.0  # [1/s]
    falling = 2.0  # [1/s]
    start = 0.2
    lag = 1e-3  # [s]
    period = 1e-3  # [s]
    continuous = block("rate_limiter", rising=rising, falling=falling, lag=lag, initial=start)
    sampled = block("rate_limiter", rising=rising, falling=falling, period=period, initial=start)

    record = run(
        {"continuous": (continuous, [[(U, 1.0)]]), "sampled": (sampled, [[(U, 1.0)]])}, rows=2001
    )

    limited = []
    value = start
    for u in record.u:
        value = min(max(u, value - falling * period), value + rising * period)
        limited.append(value)
    of_continuous, of_sampled = record.outputs
    np.testing.assert_allclose(of_sampled[1:], limited[:-1], atol=1e-12)
    largest_difference = falling * lag + falling * period  # in the lag, and in a sample
    np.testing.assert_allclose(of_continuous, limited, atol=largest_difference)


@pytest.mark.parametrize(
    ("given", "equation"),
    [
        (block("saturation", lower=-0.5, upper=0.2), lambda u, t: np.clip(u, -0.5, 0.2)),
        (block("saturation", upper=0.2), lambda u, t: np.minimum(u, 0.2)),
        (block("dead_zone", lower=-0.5, upper=0.2), lambda u, t: np.where(u > 0.2, u - 0.2, np.minimum(u + 0.5, 0))),
        (block("lookup", points=[-0.5, 0, 0.5], values=[1, 0, 2]), lambda u, t: np.where(u < 0, -2 * u, 4 * u)),
        (block("lookup", points=[-0.5, 0, 0.5], values=[1, 0, 2], clip=True),
         lambda u, t: np.interp(u, [-0.5, 0, 0.5], [1, 0, 2])),
        (block("compare", operator="<=", threshold=0.1), lambda u, t: u <= 0.1),
        (block("function", function="abs"), lambda u, t: np.abs(u)),
        (block("function", function="sign"), lambda u, t: np.sign(u)),
        (block("function", function="atan2", of=["u", "time"]), np.arctan2),
        (block("product", of=["u", "time", "u"], divides=[2]), lambda u, t: t),
        (block("switch", of=["u", "time", "u"], threshold=0.7), lambda u, t: u),
        (block("switch", of=["time", "u", "u"], operator=">", threshold=0.7), lambda u, t: np.where(u > 0.7, t, u)),
        (block("logic", operator="and", of=["u", "time"]), lambda u, t: (u != 0) & (t != 0)),
        (block("logic", operator="xor", of=["u", "time"]), lambda u, t: (u != 0) ^ (t != 0)),
        (block("step", of=[], time=0.995, before=-1, after=2), lambda u, t: np.where(t > 0.995, 2, -1)),
        (block("sum", of=["u"]), lambda u, t: u),
    ],
)  # fmt: skip
def test_a_block_without_states_is_its_equation(given, equation):
    inputs = [[(TIME if name == "time" else U, 1.0)] for name in given.inputs]
    times, u, (y,) = run({"B": (given, inputs)})
    np.testing.assert_allclose(y, equation(u, times), atol=1e-9)


@pytest.mark.parametrize("count", [40, 3000])
def test_a_long_table_is_looked_up_in(count):
    points = np.cumsum(np.random.default_rng(3).uniform(0.1, 1.0, count))
    points, values = 3 * points / points[-1] - 1.5, np.sin(20 * points)

    _, u, (y,) = run(
        {"T": (block("lookup", points=points.tolist(), values=values.tolist()), [[(U, 1.0)]])}
    )

    np.testing.assert_allclose(y, np.interp(u, points, values), atol=1e-12)


@pytest.mark.parametrize("given", [block("product", of=["zero"], divides=[0]),
                                   block("function", function="pow", of=["zero", "minus"])])  # fmt: skip
@pytest.mark.parametrize("sampled", [False, True])  # by Drake's expressions, and by numbers
def test_what_is_divided_by_zero_is_infinite(given, sampled):
    beside = {"Delay": (block("delay", period=0.01), [[(U, 1.0)]])} if sampled else {}
    inputs = [[(U, 0.0)], [(ONE, -1.0)]][: len(given.inputs)]

    _, _, (y, *_) = run({"B": (given, inputs), **beside})

    assert np.all(y == np.inf)


def test_a_loop_through_an_integrator_is_none_and_one_through_a_gain_is():
    loop = {
        "I": (block("integrator", initial=1.0), [[(4, -2.0)]]),
        "K": (block("sum"), [[(FIRST, 1.0)]]),
    }
    times, _, (y, _) = run(loop)

    np.testing.assert_allclose(y, np.exp(-2 * times), atol=1e-6)
    with pytest.raises(CycleError):
        run({"J": (block("sum"), [[(4, -2.0)]]), "K": (block("sum"), [[(FIRST, 1.0)]])})
    with pytest.raises(ValueError, match=r"the periods 0\.02, 0\.0200002 s have no common step"):
        run(
            {
                name: (block("hold", period=float(name)), [[(U, 1.0)]])
                for name in ("0.02", "0.0200002")
            }
        )


def test_periods_share_a_common_step():
    blocks = {name: (block("hold", period=float(name)), [[(U, 1.0)]]) for name in ("0.02", "0.03")}
    _, u, (fast, slow) = run(blocks)
    for held, every in ((fast, 2), (slow, 3)):
        np.testing.assert_allclose(held[1:], np.repeat(u[::every], every)[:200], atol=1e-12)


def test_a_fast_block_takes_what_a_slow_one_holds():
    """And not what the slow one would give if it took a sample then."""
    slow = block("hold", period=0.06)
    fast = block("hold", period=0.02)

    _, u, (held, taken) = run(
        {"slow": (slow, [[(U, 1.0)]]), "fast": (fast, [[(FIRST, 1.0)]])}, rows=101
    )

    np.testing.assert_allclose(held[1:], np.repeat(u[::3], 3)[:100], atol=1e-12)
    np.testing.assert_array_equal(taken, held)


def test_a_delay_of_several_steps_is_as_late():
    _, u, (y,) = run({"D": (block("delay", period=0.01, steps=5, initial=9.0), [[(U, 1.0)]])})
    np.testing.assert_allclose(y[1:], [*[9.0] * 5, *u[:195]], atol=1e-12)


def test_a_net_whose_blocks_read_each_other_often_is_not_written_out():
    """Each block doubles what it reads: 2 to the power of 30 terms as one expression."""
    blocks = {
        f"B{k}": WiredBlock(block("product", of=["u", "u"]), [[(FIRST + k - 1, 1.0)]] * 2)
        for k in range(1, 31)
    }
    net = signal_net({"B0": WiredBlock(block("sum"), [[(ONE, 1.0)]]), **blocks}, 1)
    assert isinstance(net, SignalNet)


@pytest.mark.parametrize("filtering", [3.0, 40.0])
def test_a_pid_is_a_sum_of_its_parts(filtering):
    given = block("pid", p=2, i=3, d=0.5, filter=filtering, integration_initial=0.2, of=["u"])
    numerator = [2 + 0.5 * filtering, 2 * filtering + 3, 3 * filtering]
    dense = np.linspace(0, 2, 20001)
    _, wanted, _ = signal.lsim((numerator, [1, filtering, 0]), np.sin(3 * dense + 0.3), dense)

    _, _, (y,) = run({"C": (given, [[(U, 1.0)]])})

    np.testing.assert_allclose(y, wanted[::100] + 0.2, atol=2e-5)


def test_a_pid_of_three_errors_acts_on_each():
    given = block("pid", p=2, i=3, d=0.5, filter=40.0, of=["a", "b", "c"])
    _, _, (y, own) = run({
        "C": (given, [[(U, 0.5)], [(U, 1.0)], [(TIME, -1.0)]]),
        "S": (block("state_space", A=[[0, 0], [0, -40]], B=[[0, 3, 0], [0, 0, 1]], C=[[1, -0.5 * 1600]], D=[[2, 0, 20]],
                    of=["a", "b", "c"]), [[(U, 0.5)], [(U, 1.0)], [(TIME, -1.0)]]),
    })  # fmt: skip
    np.testing.assert_allclose(y, own, atol=1e-6)


@pytest.mark.parametrize("mode", ["none", "clamping", "back_calculation"])
def test_a_pid_stops_integrating_at_its_bounds(mode):
    """The output is that of the controller's own equation in steps of 10 µs."""
    integral_gain = 8
    lower = -1.0
    upper = 0.6
    back_calculation = 5.0
    step = 1e-5  # [s]
    given = block(
        "pid",
        p=1,
        i=integral_gain,
        lower=lower,
        upper=upper,
        anti_windup=mode,
        back_calculation=back_calculation,
    )

    record = run({"C": (given, [[(U, 1.0)]])})

    limited = []
    integral = 0.0
    for error in np.sin(3 * np.arange(0, 2.00001, step) + PHASE):
        free = error + integral
        output = min(max(free, lower), upper)
        limited.append(output)
        excess = free - output
        rate = integral_gain * error
        if mode == "clamping" and excess * rate > 0:
            rate = 0.0
        if mode == "back_calculation":
            rate -= back_calculation * excess
        integral += step * rate
    np.testing.assert_allclose(record.outputs[0], limited[::1000], atol=2e-3)


@pytest.mark.parametrize(
    ("weight", "upper", "lower"),
    [(0, [0, 1], [1, -1]), (1, [1, 0], [1, -1]), (0.5, [1, 1], [2, -2])],
)
def test_a_sampled_pid_integrates_by_its_method(weight, upper, lower):
    """1/s is T/(z-1), T z/(z-1) or T/2 (z+1)/(z-1), in the integral and in the filter of the derivative alike."""
    p = 0.5
    i = 2
    d = 0.1
    filter_rate = 20.0  # [1/s]
    period = 0.01  # [s]
    given = block(
        "pid",
        p=p,
        i=i,
        d=d,
        filter=filter_rate,
        period=period,
        integration_weight=weight,
        filtering_weight=weight,
    )

    record = run({"C": (given, [[(U, 1.0)]])})

    # 1/s = numerator / denominator in z, and the filtered derivative N / (1 + N / s).
    numerator = period * np.array(upper, dtype=float)
    denominator = np.array(lower, dtype=float)
    integral = signal.lfilter(numerator, denominator, record.u)
    derivative = signal.lfilter(
        filter_rate * denominator, denominator + filter_rate * numerator, record.u
    )
    expected = p * record.u + i * integral + d * derivative
    np.testing.assert_allclose(record.outputs[0, 1:], expected[:-1], atol=1e-9)


def test_sums_take_the_time_and_constants():
    times, u, (y,) = run({"Sum": (block("sum"), [[(U, 2.0), (TIME, -1.0), (ONE, math.pi)]])})
    np.testing.assert_allclose(y, 2 * u - times + math.pi, atol=1e-12)
