"""Steps end where events say so, and nothing else changes."""

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LinearSystem

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.monitor import EventTimes, SteadySteps


def step_ends(
    *blocks: LeafSystem, scheme: str = "runge_kutta3", duration: float = 2.0
) -> list[float]:
    """Ends of the steps that a slow first-order system takes in one diagram with the blocks."""
    builder = DiagramBuilder()
    decay = LinearSystem(A=-0.1 * np.eye(1), B=np.zeros((1, 0)), C=np.eye(1), D=np.zeros((1, 0)))
    for block in (decay, *blocks):
        builder.AddSystem(block)
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme=scheme, max_step_size=0.5, accuracy=1e-2), simulator
    )
    simulator.get_mutable_context().SetContinuousState([1.0])
    ends: list[float] = []
    simulator.set_monitor(lambda context: ends.append(context.get_time()))
    simulator.AdvanceTo(duration)
    return ends


@pytest.mark.parametrize("scheme", ["runge_kutta3", "radau3", "implicit_euler", "explicit_euler"])
def test_steps_end_at_the_times(scheme: str) -> None:
    times = [0.123, 0.1230001, 1.7]
    assert set(times) <= set(step_ends(EventTimes(times), scheme=scheme))


def test_without_events_no_step_ends_there() -> None:
    assert 0.123 not in step_ends()


def test_a_time_happens_once() -> None:
    assert set(step_ends(EventTimes([0.123]))).isdisjoint({0.246, 0.369})


@pytest.mark.parametrize("times", [[], [0.0], [2.0], [5.0]])
def test_times_at_the_ends_or_outside_are_harmless(times: list[float]) -> None:
    assert step_ends(EventTimes(times))[-1] == 2.0


@pytest.mark.parametrize("time", [-1e-9, np.nan, np.inf])
def test_a_time_is_finite_and_not_negative(time: float) -> None:
    with pytest.raises(InvalidParameter, match=r"^times is "):
        EventTimes([0.5, time])


def test_steady_steps_are_at_most_the_period() -> None:
    ends = step_ends(SteadySteps(0.01), duration=0.5)
    assert np.diff(ends).max() <= 0.01 + 1e-12
    assert len(ends) >= 50


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_a_period_is_positive(period: float) -> None:
    with pytest.raises(InvalidParameter, match=r"^period is "):
        SteadySteps(period)
