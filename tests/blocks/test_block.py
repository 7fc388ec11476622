"""Blocks in Python beside C++ blocks with continuous state."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator, LinearSystem

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock


class Forgetful(Block):
    """It has continuous state, and says nothing of it."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareContinuousState(1)


def test_a_block_has_no_part_in_what_is_integrated() -> None:
    builder = DiagramBuilder()
    builder.AddSystem(Block())
    builder.AddSystem(LinearSystem(A=[[-1.0]]))
    builder.AddSystem(Block())
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    context.SetContinuousState([1.0])
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)
    simulator.AdvanceTo(1.0)
    np.testing.assert_allclose(context.get_continuous_state_vector().CopyToVector(), [np.exp(-1)], rtol=1e-6)


def test_a_block_with_continuous_state_must_say_its_derivatives() -> None:
    block = Forgetful()
    with pytest.raises((AssertionError, SystemExit), match=r"Forgetful has|derivatives->size"):  # Drake 1.58, 1.51
        block.EvalTimeDerivatives(block.CreateDefaultContext())


class Keeper(SampledBlock):
    """It counts, and keeps all that it saw."""

    def __init__(self) -> None:
        super().__init__(
            period=0.1, reads={"level": 1}, memory={"shown": np.zeros(1), "hidden": np.zeros(1)}, gives=("shown",)
        )
        self.kept: list[list[np.ndarray]] = []

    def sample(self, memory: Named, read: Named) -> Changes:
        self.kept.append([memory["shown"], memory["hidden"], read["level"]])
        return {"shown": memory["shown"] + 1.0, "hidden": memory["hidden"] + 2.0}


def test_what_a_block_saw_stays_as_it_was() -> None:
    """A view of a context would show what came after, and what is anywhere in memory once the run is gone."""
    builder = DiagramBuilder()
    block, level = builder.AddSystem(Keeper()), builder.AddSystem(Integrator(1))
    one = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(one.get_output_port(), level.get_input_port())
    builder.Connect(level.get_output_port(), block.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.35)
    del simulator
    np.testing.assert_allclose(np.ravel(block.kept).reshape(-1, 3)[:4], [[n, 2 * n, 0.1 * n] for n in range(4)])
    assert all(type(root(array)) is np.ndarray for row in block.kept for array in row)


def root(array: np.ndarray) -> object:
    """Return what owns the figures of an array."""
    return array if getattr(array, "base", None) is None else root(array.base)
