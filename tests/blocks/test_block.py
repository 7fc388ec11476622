"""Blocks in Python beside C++ blocks with continuous state."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator, LinearSystem

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock


class Forgetful(Block):
    """A block with continuous state, but without a method for its derivatives."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareContinuousState(1)


def test_a_block_has_no_part_in_what_is_integrated() -> None:
    """Blocks without continuous state do not disturb the integration of dx/dt = -x between them."""
    builder = DiagramBuilder()
    builder.AddSystem(Block())
    builder.AddSystem(LinearSystem(A=[[-1.0]]))
    builder.AddSystem(Block())
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    context.SetContinuousState([1.0])
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)

    simulator.AdvanceTo(1.0)

    np.testing.assert_allclose(
        context.get_continuous_state_vector().CopyToVector(), [np.exp(-1)], rtol=1e-6
    )


def test_a_block_with_continuous_state_must_say_its_derivatives() -> None:
    """A forgotten method is an error, and not a derivative of zero."""
    block = Forgetful()
    with pytest.raises(
        (AssertionError, SystemExit), match=r"Forgetful has|derivatives->size"
    ):  # Drake 1.58, 1.51
        block.EvalTimeDerivatives(block.CreateDefaultContext())


class Keeper(SampledBlock):
    """A block that counts samples, and keeps the vectors of its memory and its input at each of them."""

    def __init__(self) -> None:
        super().__init__(
            period=0.1,
            reads={"level": 1},
            memory={"shown": np.zeros(1), "hidden": np.zeros(1)},
            gives=("shown",),
        )
        self.kept: list[list[np.ndarray]] = []

    def sample(self, memory: Named, read: Named) -> Changes:
        self.kept.append([memory["shown"], memory["hidden"], read["level"]])
        return {"shown": memory["shown"] + 1.0, "hidden": memory["hidden"] + 2.0}


def test_what_a_block_saw_stays_as_it_was() -> None:
    """Vectors of former samples are copies, which neither later samples nor the end of the run change.

    A view of a context would show later values, and any memory once the context is gone.
    """
    builder = DiagramBuilder()
    block = builder.AddSystem(Keeper())
    level = builder.AddSystem(Integrator(1))
    one = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(one.get_output_port(), level.get_input_port())
    builder.Connect(level.get_output_port(), block.get_input_port())
    simulator = Simulator(builder.Build())

    simulator.AdvanceTo(0.35)
    del simulator

    # At sample n: shown n, hidden 2 n, and the level, which is the time of the sample.
    expected = [[n, 2 * n, 0.1 * n] for n in range(4)]
    np.testing.assert_allclose(np.ravel(block.kept).reshape(-1, 3)[:4], expected)
    for vectors in block.kept:
        assert all(type(owner_of(vector)) is np.ndarray for vector in vectors)


def owner_of(array: np.ndarray) -> object:
    """Object that owns the memory of an array: the array itself, or the one of which it is a view."""
    base = getattr(array, "base", None)
    return array if base is None else owner_of(base)
