"""Blocks of a signal flow against their equations, and a net of them against scipy and closed forms."""

import math
from graphlib import CycleError

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

ONE, TIME, U = 0, 1, 2
FIRST = 3
"""The place of the first block's output among the values."""


def block(kind, **figures):
    return TypeAdapter(FlowBlockConfig).validate_python({"kind": kind, "of": "u", **figures})


def run(blocks, *, duration=2.0, frequency=3.0, amplitude=1.0, rows=201):
    """Return times, the sine that is measured, and the outputs of blocks (name: (block, inputs)) by element."""
    wired = {name: WiredBlock(own.law, *inputs) for name, (own, *inputs) in blocks.items()}
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(amplitude=amplitude, frequency=frequency, phase=0.3, size=1))
    net = builder.AddSystem(signal_net(wired, 1))
    builder.Connect(source.get_output_port(0), net.get_input_port())
    times = np.linspace(0, duration, rows)
    log = LogVectorOutput(net.get_output_port(), builder, duration / (rows - 1))
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-8)
    simulator.AdvanceTo(duration)
    if not isinstance(net, SignalNet):
        same_as_written(net, SignalNet(wired, 1), [x for one in wired.values() for x in one.block.start])
    found = log.FindLog(simulator.get_context())
    return times, amplitude * np.sin(frequency * times + 0.3), found.data()[:, :rows]


def same_as_written(net, written, start):
    """A net of expressions gives what the blocks' own equations give, in other states than the start as well."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        contexts = net.CreateDefaultContext(), written.CreateDefaultContext()
        state, (given, when) = rng.uniform(-1, 1, len(start)), rng.uniform(-1, 1, 2)
        for system, context, origin in zip((net, written), contexts, (np.array(start), 0.0), strict=True):
            context.SetTime(when)
            system.get_input_port().FixValue(context, [given])
            if start:
                context.SetContinuousState(state - origin)
        outputs = [one.get_output_port().Eval(context) for one, context in zip((net, written), contexts, strict=True)]
        np.testing.assert_allclose(*outputs, atol=1e-12)
        if start:
            rates = [one.EvalTimeDerivatives(context) for one, context in zip((net, written), contexts, strict=True)]
            np.testing.assert_allclose(*(rate.get_vector().CopyToVector() for rate in rates), atol=1e-9)


def test_a_transfer_function_is_that_of_scipy():
    figures = {"numerator": [0.5, 2.0, 1.0], "denominator": [0.01, 0.2, 1.0]}
    dense = np.linspace(0, 2, 20001)
    _, wanted, _ = signal.lsim(tuple(figures.values()), np.sin(3 * dense + 0.3), dense)
    _, _, (y,) = run({"G": (block("transfer_function", **figures), [[(U, 1.0)]])})
    np.testing.assert_allclose(y, wanted[::100], rtol=1e-5, atol=1e-5)  # of 15; what Drake's accuracy of 1e-8 leaves


def test_a_state_space_of_two_inputs_with_a_start_is_that_of_scipy():
    a, b, c, d = [[0, 1], [-4, -1]], [[0, 1], [1, 0]], [[1, 0], [0, 1], [1, 1]], [[0, 0], [0, 0], [1, 0]]
    dense = np.linspace(0, 2, 20001)
    inputs = np.column_stack([np.sin(3 * dense + 0.3), dense])
    _, wanted, _ = signal.lsim([np.array(part, dtype=float) for part in (a, b, c, d)], inputs, dense, X0=[0.2, -0.1])
    given = block("state_space", A=a, B=b, C=c, D=d, initial=[0.2, -0.1], of=["u", "time"])
    _, _, y = run({"S": (given, [[(U, 1.0)], [(TIME, 1.0)]])})
    np.testing.assert_allclose(y.T, wanted[::100], atol=1e-6)


def test_a_sampled_transfer_function_behind_another_is_that_of_scipy():
    """Both sample together: the second takes what the first gives at that very time, and all is held in between."""
    first, second = ([0.3, 0.1], [1.0, -0.5]), ([1.0, 0.2], [1.0, 0.1, 0.2])
    blocks = {  # not in the order of computation
        "G": (block("transfer_function", numerator=second[0], denominator=second[1], period=0.02), [[(4, 1.0)]]),
        "F": (block("transfer_function", numerator=first[0], denominator=first[1], period=0.02), [[(U, 1.0)]]),
        "slow": (block("delay", period=0.06, initial=7.0), [[(4, 2.0)]]),
    }
    times, u, (g, f, slow) = run(blocks, rows=101)
    after = lambda y: y[1:]  # noqa: E731 - what a log sees at t is from before the sample at t
    wanted = signal.lfilter(*first, u)
    np.testing.assert_allclose(after(f), wanted[:-1], atol=1e-12)
    np.testing.assert_allclose(after(g), signal.lfilter([0.0, *second[0]], second[1], wanted)[:-1], atol=1e-12)
    held = np.repeat([7.0, *2 * wanted[::3]], 3)[: len(times) - 1]
    np.testing.assert_allclose(after(slow), held, atol=1e-12)


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
    np.testing.assert_allclose(y[1:], 0.5 + 0.03 * np.concatenate([[0], np.cumsum(u)[:-2]]), atol=1e-12)


def test_a_rate_limiter_follows_within_its_slopes():
    limiter = block("rate_limiter", rising=1.0, falling=2.0, lag=1e-3, initial=0.2)
    sampled = block("rate_limiter", rising=1.0, falling=2.0, period=0.001, initial=0.2)
    _, _, (y, held) = run({"R": (limiter, [[(U, 1.0)]]), "S": (sampled, [[(U, 1.0)]])}, rows=2001)
    value, wanted = 0.2, []
    for given in np.sin(3 * np.linspace(0, 2, 2001) + 0.3):
        value = min(max(given, value - 2e-3), value + 1e-3)
        wanted.append(value)
    np.testing.assert_allclose(held[1:], wanted[:-1], atol=1e-12)
    np.testing.assert_allclose(y, wanted, atol=2.0 * 1e-3 + 2e-3)  # the largest slope times the lag, and a sample


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
    _, u, (y,) = run({"T": (block("lookup", points=points.tolist(), values=values.tolist()), [[(U, 1.0)]])})
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
    loop = {"I": (block("integrator", initial=1.0), [[(4, -2.0)]]), "K": (block("sum"), [[(FIRST, 1.0)]])}
    times, _, (y, _) = run(loop)
    np.testing.assert_allclose(y, np.exp(-2 * times), atol=1e-6)
    with pytest.raises(CycleError):
        run({"J": (block("sum"), [[(4, -2.0)]]), "K": (block("sum"), [[(FIRST, 1.0)]])})
    with pytest.raises(ValueError, match=r"periods of 0\.02, 0\.0200002 s"):
        run({name: (block("hold", period=float(name)), [[(U, 1.0)]]) for name in ("0.02", "0.0200002")})


def test_periods_share_a_common_step():
    blocks = {name: (block("hold", period=float(name)), [[(U, 1.0)]]) for name in ("0.02", "0.03")}
    _, u, (fast, slow) = run(blocks)
    for held, every in ((fast, 2), (slow, 3)):
        np.testing.assert_allclose(held[1:], np.repeat(u[::every], every)[:200], atol=1e-12)


def test_a_fast_block_takes_what_a_slow_one_holds():
    """And not what the slow one would give if it took a sample then."""
    slow, fast = block("hold", period=0.06), block("hold", period=0.02)
    _, u, (held, taken) = run({"slow": (slow, [[(U, 1.0)]]), "fast": (fast, [[(FIRST, 1.0)]])}, rows=101)
    np.testing.assert_allclose(held[1:], np.repeat(u[::3], 3)[:100], atol=1e-12)
    np.testing.assert_array_equal(taken, held)


def test_a_delay_of_several_steps_is_as_late():
    _, u, (y,) = run({"D": (block("delay", period=0.01, steps=5, initial=9.0), [[(U, 1.0)]])})
    np.testing.assert_allclose(y[1:], [*[9.0] * 5, *u[:195]], atol=1e-12)


def test_a_net_whose_blocks_read_each_other_often_is_not_written_out():
    """Each block doubles what it reads: 2 to the power of 30 terms as one expression."""
    blocks = {f"B{k}": WiredBlock(block("product", of=["u", "u"]), [[(FIRST + k - 1, 1.0)]] * 2) for k in range(1, 31)}
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
    """Against the controller's own equation in steps of 10 µs."""
    given = block("pid", p=1, i=8, lower=-1.0, upper=0.6, anti_windup=mode, back_calculation=5.0)
    _, _, (y,) = run({"C": (given, [[(U, 1.0)]])})
    integral, wanted = 0.0, []
    for error in np.sin(3 * np.arange(0, 2.00001, 1e-5) + 0.3):
        free = error + integral
        wanted.append(min(max(free, -1.0), 0.6))
        rate = 8 * error
        if mode == "clamping" and (free - wanted[-1]) * rate > 0:
            rate = 0.0
        integral += 1e-5 * (rate - (5.0 * (free - wanted[-1]) if mode == "back_calculation" else 0.0))
    np.testing.assert_allclose(y, wanted[::1000], atol=2e-3)


@pytest.mark.parametrize(
    ("weight", "upper", "lower"), [(0, [0, 1], [1, -1]), (1, [1, 0], [1, -1]), (0.5, [1, 1], [2, -2])]
)
def test_a_sampled_pid_integrates_by_its_method(weight, upper, lower):
    """1/s is T/(z-1), T z/(z-1) or T/2 (z+1)/(z-1), in the integral and in the filter of the derivative alike."""
    given = block(
        "pid", p=0.5, i=2, d=0.1, filter=20.0, period=0.01, integration_weight=weight, filtering_weight=weight
    )
    _, u, (y,) = run({"C": (given, [[(U, 1.0)]])})
    upper, lower = 0.01 * np.array(upper, dtype=float), np.array(lower, dtype=float)
    integral = signal.lfilter(upper, lower, u)
    derivative = signal.lfilter(20 * lower, lower + 20 * upper, u)
    np.testing.assert_allclose(y[1:], (0.5 * u + 2 * integral + 0.1 * derivative)[:-1], atol=1e-9)


def test_sums_take_the_time_and_constants():
    times, u, (y,) = run({"Sum": (block("sum"), [[(U, 2.0), (TIME, -1.0), (ONE, math.pi)]])})
    np.testing.assert_allclose(y, 2 * u - times + math.pi, atol=1e-12)
