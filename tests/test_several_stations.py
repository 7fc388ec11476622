"""Several stations in one diagram, and a station beside a plant of the user's own."""

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import add_station, build_station, load_station, simulate, simulate_diagram
from simrob_drake.base.errors import SimrobError

TARGET = np.full(6, 0.1)  # rad


def hold(builder, ports):
    """Connect constant references to all robots of a station."""
    for name, port in ports.inputs.items():
        if name.endswith("reference"):
            source = builder.AddSystem(ConstantVectorSource(np.full(port.size(), 0.1)))
            builder.Connect(source.get_output_port(), port)


def arm(**overrides):
    return load_station(
        "irb120_dynamic",
        {"solver": {"kind": "discrete"}, "servo.realization": "implicit", **overrides},
    )


def alone(config, duration):
    return simulate(
        config, reference=([0.0, 1.0], np.tile(TARGET, (2, 1))), duration=duration, progress=False
    )


def test_two_stations_in_one_builder_move_as_each_alone():
    builder = DiagramBuilder()
    first_config, second_config = arm(), arm(gravity=1.6)
    first = add_station(builder, first_config, name="earth")
    second = add_station(builder, second_config, name="moon")
    hold(builder, first)
    hold(builder, second)

    diagram = builder.Build()

    assert diagram.HasSubsystemNamed("earth.plant")
    assert diagram.HasSubsystemNamed("moon.plant")
    for ports, config in ((first, first_config), (second, second_config)):
        together = simulate_diagram(diagram, ports, duration=0.3, progress=False)
        by_itself = alone(config, 0.3)
        assert together.names == by_itself.names
        np.testing.assert_allclose(together.values, by_itself.values, atol=1e-9)


def test_sensors_read_the_contacts_of_their_own_station():
    """Blocks that stations share within themselves, such as readers of contacts, are not shared between stations."""
    builder = DiagramBuilder()
    config = load_station("bouncing_ball", {"duration": 0.3})
    # it does not reach the floor
    low = load_station("bouncing_ball", {"duration": 0.3, "gravity": 0.5})
    falls = add_station(builder, config)
    floats = add_station(builder, low, name="low")

    diagram = builder.Build()

    for ports, own in ((falls, config), (floats, low)):
        result = simulate_diagram(diagram, ports, duration=0.3, progress=False)
        forces = [name for name in result.names if name.startswith("force.")]
        touched = any(np.abs(result[name]).max() > 0 for name in forces)
        assert touched == any(
            np.abs(simulate(own, progress=False)[name]).max() > 0 for name in forces
        )


def test_a_state_goes_from_a_named_station_to_one_without_a_name():
    builder = DiagramBuilder()
    ports = add_station(builder, arm(**{"servo.ki": 100}), name="left")
    hold(builder, ports)

    result = simulate_diagram(builder.Build(), ports, duration=0.2, progress=False)

    assert not any(name.startswith("left.") for name in result.final_state.blocks)

    goes_on = simulate(
        arm(**{"servo.ki": 100}), start=result.final_state, duration=0.01, progress=False
    )
    np.testing.assert_array_equal(goes_on.axes("q")[0], result.axes("q")[-1])


def test_a_station_beside_a_plant_of_ones_own():
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    plant.Finalize()
    ports = add_station(builder, arm(), name="arm")
    hold(builder, ports)

    result = simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)

    np.testing.assert_allclose(result.axes("q"), alone(arm(), 0.1).axes("q"), atol=1e-9)


@pytest.mark.parametrize("name", ["", "arm"])
def test_a_clash_is_refused_at_the_call(name):
    builder = DiagramBuilder()
    add_station(builder, arm(), name=name)

    names = [system.get_name() for system in builder.GetSystems()]

    expected = "arm.plant, arm.scene_graph" if name else "plant, scene_graph"
    with pytest.raises(SimrobError, match=rf"already has systems named {expected}; .*name="):
        add_station(builder, arm(), name=name)
    assert [system.get_name() for system in builder.GetSystems()] == names  # nothing was added


def test_a_clash_with_a_plant_of_ones_own():
    builder = DiagramBuilder()
    AddMultibodyPlantSceneGraph(builder, 0.0)
    with pytest.raises(SimrobError, match="already has systems named plant, scene_graph"):
        add_station(builder, "irb120_dynamic")


def test_a_clash_with_another_block():
    builder = DiagramBuilder()
    builder.AddNamedSystem("reference", ConstantVectorSource(TARGET))
    with pytest.raises(SimrobError, match="already has a system named reference"):
        add_station(builder, "irb120_dynamic")


@pytest.mark.parametrize("name", ["two words", "a.b", 3, None])
def test_a_name_that_is_none(name):
    with pytest.raises(SimrobError, match="name is"):
        add_station(DiagramBuilder(), "irb120_dynamic", name=name)


def test_cenic_needs_its_plant_alone():
    config = load_station("humanoid_dynamic")
    expected = r"needs a single plant in the simulated diagram, named plant"

    builder = DiagramBuilder()
    ports = add_station(builder, config, name="left")
    hold(builder, ports)
    with pytest.raises(SimrobError, match=expected + r".*the diagram has: left.plant"):
        simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)

    builder = DiagramBuilder()
    ports = add_station(builder, config)
    hold(builder, ports)
    hold(builder, add_station(builder, config, name="right"))
    with pytest.raises(SimrobError, match=expected + r".*the diagram has: plant, right.plant"):
        simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)

    builder = DiagramBuilder()
    box = builder.AddNamedSystem("box", build_station(config))
    source = builder.AddSystem(ConstantVectorSource(np.zeros(18)))
    builder.Connect(source.get_output_port(), box.GetInputPort("reference"))
    with pytest.raises(SimrobError, match=expected + r".*the diagram has: box/plant"):
        simulate_diagram(builder.Build(), box.ports, duration=0.1, progress=False)
