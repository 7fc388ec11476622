"""Diagrams with blocks in Python: they go when nobody holds them, not before, and their callbacks work until then."""

import gc
import weakref
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.base import lifetime
from simrob_drake.base.lifetime import build_diagram, weakly

PERIOD = 0.1


class Counter(LeafSystem):
    """Every kind of callback that a block can have."""

    def __init__(self) -> None:
        super().__init__()
        self.published = 0
        self._input = self.DeclareVectorInputPort("u", 1)
        self._count = self.DeclareDiscreteState([0.0])
        self.DeclareVectorOutputPort("sum", 1, weakly(self._calc))
        self.DeclareAbstractOutputPort("what", Value[object], weakly(self._tell))
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self.DeclarePerStepPublishEvent(self._publish)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_discrete_state_vector()[0] + self._input.Eval(context)[0])

    def _tell(self, context: Context, output: AbstractValue) -> None:
        output.set_value(f"at {context.get_time():.1f}")

    def _update(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(np.array([context.get_discrete_state_vector()[0] + 1]))

    def _publish(self, context: Context) -> None:
        self.published += 1


def parts(builder: DiagramBuilder) -> tuple[MultibodyPlant, Counter]:
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    plant.Finalize()
    block = builder.AddNamedSystem("counter", Counter())
    one = builder.AddNamedSystem("one", ConstantVectorSource([1.0]))
    builder.Connect(one.get_output_port(), block.get_input_port())
    return plant, block


def stepped(diagram: Diagram) -> Context:
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.95)
    return simulator.get_context().Clone()


@pytest.fixture
def remnants() -> list[weakref.ref[object]]:
    return []


@pytest.mark.parametrize("steps", [False, True])
def test_a_diagram_goes_with_all_its_parts(
    remnants: list[weakref.ref[object]], steps: bool
) -> None:
    builder = DiagramBuilder()
    held = [builder, *parts(builder)]
    held.append(build_diagram(builder))
    if steps:
        stepped(held[-1])
    remnants += map(weakref.ref, held)
    del builder, held

    gc.collect()

    assert [part() for part in remnants] == [None] * 4


def test_callbacks_work_as_long_as_the_diagram_is_held() -> None:
    builder = DiagramBuilder()
    parts(builder)
    diagram = build_diagram(builder)
    del builder
    gc.collect()
    context = stepped(diagram)
    gc.collect()
    block = diagram.GetSubsystemByName("counter")

    own = block.GetMyContextFromRoot(context)

    assert block.published > 9
    assert block.GetOutputPort("sum").Eval(own) == 11  # ten updates, from 0 to 0.9 s, and the input
    assert block.GetOutputPort("what").Eval(own) == "at 0.9"


@pytest.mark.parametrize("name", ["plant", "one"])
def test_a_block_of_drakes_keeps_its_diagram(name: str) -> None:
    def alone() -> tuple[LeafSystem, weakref.ref[Diagram]]:
        builder = DiagramBuilder()
        parts(builder)
        diagram = build_diagram(builder)
        return diagram.GetSubsystemByName(name), weakref.ref(diagram)

    block, diagram = alone()
    gc.collect()
    assert diagram() is not None
    assert block.get_name() == name


def test_what_a_user_noted_in_a_block_stays() -> None:
    def run() -> Counter:
        builder = DiagramBuilder()
        _, block = parts(builder)
        stepped(build_diagram(builder))
        return block

    block = run()
    gc.collect()
    assert block.published > 9


def test_diagrams_that_nobody_holds_do_not_pile_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifetime, "_PAUSE", 0)
    monkeypatch.setattr(lifetime, "_COLLECTOR", lifetime._Collector())

    def build() -> weakref.ref[Diagram]:
        builder = DiagramBuilder()
        parts(builder)
        return weakref.ref(build_diagram(builder))

    gc.collect()
    diagrams = [build() for _ in range(20)]
    assert sum(diagram() is not None for diagram in diagrams) < 10


def test_a_callback_is_called_with_all_that_it_is_given() -> None:
    class Adder:
        def add(self, first: int, second: int, *, third: int) -> int:
            return first + second + third

    adder = Adder()
    call: Callable[..., int] = weakly(adder.add)
    assert call(1, 2, third=3) == 6
    gone = weakref.ref(adder)
    del adder
    assert gone() is None
