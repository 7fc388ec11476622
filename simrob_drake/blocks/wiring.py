"""Small pieces of wiring that several blocks share."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from simrob_drake.frames import Vector


def joined(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Stack ports into one vector; a single port needs no block."""
    if len(ports) == 1:
        return ports[0]
    joiner = builder.AddNamedSystem(name, Multiplexer([port.size() for port in ports]))
    for index, port in enumerate(ports):
        builder.Connect(port, joiner.get_input_port(index))
    return joiner.get_output_port()


def summed(builder: DiagramBuilder, name: str, *ports: OutputPort) -> OutputPort:
    """Add ports of equal size; a single port needs no block."""
    if len(ports) == 1:
        return ports[0]
    adder = builder.AddNamedSystem(name, Adder(len(ports), ports[0].size()))
    for index, port in enumerate(ports):
        builder.Connect(port, adder.get_input_port(index))
    return adder.get_output_port()


def mapped(builder: DiagramBuilder, name: str, matrix: Vector, port: OutputPort) -> OutputPort:
    """Multiply a port by a matrix; the identity needs no block."""
    if matrix.shape[0] == matrix.shape[1] and (matrix == np.eye(len(matrix))).all():
        return port
    gain = builder.AddNamedSystem(name, MatrixGain(matrix))
    builder.Connect(port, gain.get_input_port())
    return gain.get_output_port()
