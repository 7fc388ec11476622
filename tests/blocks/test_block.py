"""Blocks in Python beside C++ blocks with continuous state."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from simrob_drake.blocks.block import Block


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
