"""What blocks written in Python have in common, and small pieces of wiring that several blocks share."""

import numpy as np
from pydrake.systems.framework import Context, ContinuousState, DiagramBuilder, LeafSystem, OutputPort, System
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from simrob_drake.base.drake_versions import SEARCH_FOR_DERIVATIVES
from simrob_drake.base.frames import Vector


class Block(LeafSystem):
    """A block in Python, without continuous state, that costs a continuous solver next to nothing.

    A solver asks every block for its time derivatives at each evaluation. Since 1.56, Drake first looks for the answer
    in the block's Python class; finding none costs it a C++ exception, 3.4 µs, and finding one 0.5 µs. Drake 1.51 takes
    0.2 µs to find none.
    """

    def _no_derivatives(self, context: Context, derivatives: ContinuousState) -> None:
        assert derivatives.size() == 0, f"{type(self).__name__} has continuous state, but says no derivatives of it"

    if SEARCH_FOR_DERIVATIVES.is_there:
        DoCalcTimeDerivatives = _no_derivatives


def fed(builder: DiagramBuilder, name: str, block: System, *ports: OutputPort) -> OutputPort:
    """Add a block, connect ports to its inputs in order, and return its first output."""
    builder.AddNamedSystem(name, block)
    for index, port in enumerate(ports):
        builder.Connect(port, block.get_input_port(index))
    return block.get_output_port(0)


def joined(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Stack ports into one vector; a single port needs no block."""
    return ports[0] if len(ports) == 1 else fed(builder, name, Multiplexer([port.size() for port in ports]), *ports)


def summed(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Add ports of equal size; a single port needs no block."""
    return ports[0] if len(ports) == 1 else fed(builder, name, Adder(len(ports), ports[0].size()), *ports)


def mapped(builder: DiagramBuilder, name: str, matrix: Vector, port: OutputPort) -> OutputPort:
    """Multiply a port by a matrix; the identity needs no block."""
    if matrix.shape[0] == matrix.shape[1] and (matrix == np.eye(len(matrix))).all():
        return port
    return fed(builder, name, MatrixGain(matrix), port)
