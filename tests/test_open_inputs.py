"""A diagram with a forgotten input is refused before it is run, with the names of all open inputs."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Gain

from simrob_drake import (
    Runner,
    add_station,
    apply_solver,
    build_station,
    load_station,
    simulate_diagram,
)
from simrob_drake.base.errors import SimrobError


def run(builder, ports):
    return simulate_diagram(builder.Build(), ports, duration=0.01, progress=False)


def connect_all(builder, ports):
    for port in ports.inputs.values():
        source = builder.AddSystem(ConstantVectorSource(np.zeros(port.size())))
        builder.Connect(source.get_output_port(), port)


def test_a_forgotten_reference_is_named_with_what_to_do():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")

    expected = (
        r'reference; before.*builder.Connect\(output, ports.inputs\["reference"\]\).*ExportInput.*'
    )

    with pytest.raises(SimrobError, match=expected):
        run(builder, ports)


def test_all_open_inputs_are_named():
    builder = DiagramBuilder()
    ports = add_station(builder, "two_irb120")
    builder.AddNamedSystem("gain", Gain(2.0, 3))

    # the root diagram: nothing outside can feed it
    builder.ExportInput(ports.inputs["left.reference"], "left")

    with pytest.raises(
        SimrobError, match=r"3 inputs are not connected: left.reference, right.reference, gain.u0;"
    ):
        run(builder, ports)


def test_inputs_of_a_box_and_within_a_box_are_named():
    builder = DiagramBuilder()
    box = builder.AddSystem(build_station("irb120_dynamic"))
    inner = DiagramBuilder()
    inner.AddNamedSystem("gain", Gain(2.0, 3))

    builder.AddSystem(inner.Build()).set_name("inner")

    with pytest.raises(
        SimrobError, match=r"2 inputs are not connected: irb120_dynamic.reference, gain.u0;"
    ):
        run(builder, box.ports)


class Optional(LeafSystem):
    """A block with an input that may be open."""

    optional_inputs = ("extra",)

    def __init__(self, *others):
        super().__init__()
        for name in ("extra", *others):
            self.DeclareVectorInputPort(name, 1)


def test_a_block_names_its_optional_inputs():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")
    connect_all(builder, ports)
    builder.AddNamedSystem("block", Optional())
    assert run(builder, ports).ending == "completed"

    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")
    connect_all(builder, ports)
    builder.AddNamedSystem("block", Optional("needed"))
    with pytest.raises(SimrobError, match=r"1 input is not connected: block.needed;"):
        run(builder, ports)


def test_apply_solver_accepts_exported_inputs_only():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")
    with pytest.raises(SimrobError, match=r"1 input is not connected: reference.u;"):
        apply_solver(Simulator(builder.Build()), "irb120_dynamic")

    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")
    builder.ExportInput(ports.inputs["reference"], "reference")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    apply_solver(simulator, load_station("irb120_dynamic"))
    diagram.get_input_port().FixValue(simulator.get_mutable_context(), np.full(6, 0.1))
    simulator.AdvanceTo(0.05)


def test_a_runner_names_an_input_that_nothing_feeds():
    block = Optional("position")  # of one value, and "extra" is no output of the station
    with pytest.raises(SimrobError, match=r"extra"):
        Runner("irb120_dynamic", blocks=[block]).run(duration=0.01)


@pytest.mark.parametrize(
    "station", ["irb120_kinematic", "humanoid_dynamic", "irb120_gripper", "bouncing_ball"]
)
def test_a_station_with_connected_inputs_has_no_open_ones(station):
    builder = DiagramBuilder()
    ports = add_station(builder, station)

    connect_all(builder, ports)

    assert simulate_diagram(builder.Build(), ports, duration=0.002, progress=False).times[-1] > 0
