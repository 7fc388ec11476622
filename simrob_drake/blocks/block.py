"""Base class of blocks that are written in Python, and functions that wire small Drake blocks into a diagram."""

from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.framework import (
    Context,
    ContinuousState,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    System,
)
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from simrob_drake.base.drake_versions import SEARCH_FOR_DERIVATIVES
from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import former_names_of


class Block(LeafSystem):
    """Base class of blocks in Python without continuous state: it spares a continuous solver time.

    A solver asks every block for its time derivatives at each evaluation. Since version 1.56, Drake first looks for the
    method in the block's Python class. A missing method costs a C++ exception, 3.4 µs; a method that is there costs
    0.5 µs. In Drake 1.51 a missing method costs 0.2 µs.
    """

    def _no_derivatives(self, context: Context, derivatives: ContinuousState) -> None:
        """Do nothing: the block has no continuous state, and so no derivatives."""
        assert derivatives.size() == 0, (
            f"{type(self).__name__} has continuous state, but no method for its derivatives"
        )

    # Only where Drake searches: in an older version, the call of this method costs more than its absence.
    if SEARCH_FOR_DERIVATIVES.is_there:
        DoCalcTimeDerivatives = _no_derivatives


def add_and_connect(
    builder: DiagramBuilder,
    name: str,
    block: System,
    *ports: OutputPort,
) -> OutputPort:
    """Add a block to a diagram and connect ports to its inputs, in their order.

    Args:
        builder: builder of the diagram.
        name: name of the block.
        block: the block.
        *ports: output ports of other blocks, one for each of the first inputs.

    Returns:
        The first output port of the block.
    """
    builder.AddNamedSystem(name, block)
    for index, port in enumerate(ports):
        builder.Connect(port, block.get_input_port(index))
    return block.get_output_port(0)


def add_multiplexer(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Add a block that stacks ports into one vector, in their order, and return its output port.

    A single port is returned itself, without a block.

    Args:
        builder: builder of the diagram.
        name: name of the block.
        *ports: output ports of other blocks.
    """
    # A solver evaluates every block at every stage of a step, so a block that only copies is left out.
    if len(ports) == 1:
        return ports[0]
    sizes = [port.size() for port in ports]
    return add_and_connect(builder, name, Multiplexer(sizes), *ports)


def add_sum(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Add a block that sums ports of equal size, and return its output port. A single port is returned itself."""
    if len(ports) == 1:
        return ports[0]
    return add_and_connect(builder, name, Adder(len(ports), ports[0].size()), *ports)


def add_matrix_gain(
    builder: DiagramBuilder,
    name: str,
    matrix: Vector,
    port: OutputPort,
) -> OutputPort:
    """Add a block that multiplies a port of size n by a matrix (m, n), and return its output port, of size m.

    For the identity, the port is returned itself, without a block.
    """
    # The comparison is exact: a matrix that differs from the identity by rounding changes the last bits.
    is_square = matrix.shape[0] == matrix.shape[1]
    if is_square and (matrix == np.eye(len(matrix))).all():
        return port
    return add_and_connect(builder, name, MatrixGain(matrix), port)


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(
        __name__,
        {
            "fed": "add_and_connect",
            "joined": "add_multiplexer",
            "summed": "add_sum",
            "mapped": "add_matrix_gain",
        },
    )
