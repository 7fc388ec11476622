"""Names of ports and attributes that do not exist: the error proposes the nearest name, or says how to get the port."""

import inspect
import pickle
import re
from typing import get_args

import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import (
    SimulationResult,
    StationPorts,
    add_station,
    build_station,
    linearize,
    simulate,
)
from simrob_drake.base.errors import SimrobError, UnknownName
from simrob_drake.parts.inputs import LISTABLE
from simrob_drake.stations.config import Input


@pytest.fixture(scope="module")
def ports():
    return build_station("irb120_dynamic").ports


@pytest.fixture(scope="module")
def result():
    return simulate("bouncing_ball", duration=0.1, progress=False)


def message_of(error):
    return str(error.value)


@pytest.mark.parametrize("name", ["feedforward", "external_force"])
def test_an_input_that_may_be_listed(ports, name):
    with pytest.raises(KeyError) as error:
        ports.inputs[name]
    assert isinstance(error.value, UnknownName)
    assert f'overrides={{"inputs": ["{name}"]}}' in message_of(error)
    # The remedy works.
    assert (
        name in add_station(DiagramBuilder(), "irb120_dynamic", overrides={"inputs": [name]}).inputs
    )


def test_the_nearest_input_that_may_be_listed(ports):
    with pytest.raises(
        KeyError, match="there is no input 'velocity'; the input 'reference_velocity' exists if"
    ):
        ports.inputs["velocity"]


def test_the_nearest_input(ports):
    with pytest.raises(KeyError, match="there is no input 'refrence'; did you mean 'reference'"):
        ports.inputs["refrence"]
    with pytest.raises(KeyError, match="there is no input 'xyz'; known: reference"):
        ports.inputs["xyz"]


def test_inputs_of_several_robots():
    inputs = build_station("two_arms", overrides={"mode": "dynamic"}).ports.inputs

    with pytest.raises(KeyError) as error:
        inputs["left.feedforward"]
    assert 'overrides={"inputs": ["feedforward"]}' in message_of(error)
    assert (
        "left.feedforward"
        in build_station(
            "two_arms", overrides={"mode": "dynamic", "inputs": ["feedforward"]}
        ).ports.inputs
    )


def test_a_kinematic_station_lists_nothing():
    inputs = build_station("irb120_kinematic").ports.inputs
    with pytest.raises(KeyError) as error:
        inputs["feedforward"]
    assert "overrides" not in message_of(error)


def test_outputs(ports):
    with pytest.raises(KeyError, match="there is no output 'tcp'"):
        ports.outputs["tcp"]
    with pytest.raises(KeyError, match="did you mean 'tcp_pose'"):
        ports.outputs["tcp_pos"]


def test_the_mappings_are_ordinary_ones(ports):
    assert "tcp" not in ports.outputs
    assert ports.outputs.get("tcp") is None
    assert "feedforward" not in ports.inputs
    assert ports.inputs.get("feedforward") is None
    assert list(ports.inputs) == ["reference"]


def test_the_error_can_be_pickled(ports):
    with pytest.raises(KeyError) as error:
        ports.outputs["tcp"]

    again = pickle.loads(pickle.dumps(error.value))
    assert type(again) is type(error.value)
    assert str(again) == message_of(error)


def test_the_inputs_that_may_be_listed_are_those_of_the_configuration():
    assert set(LISTABLE) == set(get_args(Input))


@pytest.mark.parametrize(
    ("name", "known"),
    [("columns", "names"), ("time", "times"), ("final_stat", "final_state"), ("verdct", "verdict")],
)
def test_an_attribute_that_a_result_does_not_have(result, name, known):
    with pytest.raises(
        AttributeError, match=f"a result has no attribute '{name}'; did you mean '{known}'"
    ):
        getattr(result, name)
    assert getattr(result, "_repr_png_", None) is None


@pytest.mark.parametrize("kind", [SimulationResult, StationPorts])
def test_help_lists_attributes_that_exist(kind, ports, result):
    listed = re.findall(
        r"^    (\w+): ", inspect.getdoc(kind).partition("Attributes:")[2], flags=re.MULTILINE
    )

    assert len(listed) > 10
    subject = result if kind is SimulationResult else ports
    for name in listed:
        assert hasattr(subject, name)


def test_linearize_takes_ports():
    ports = add_station(DiagramBuilder(), "irb120_dynamic", overrides={"servo.kd": 30})
    model = linearize(ports)

    same = linearize("irb120_dynamic", overrides={"servo.kd": 30})

    assert (model.A == same.A).all()
    assert model.inputs == same.inputs


def test_linearize_names_the_ports_for_a_diagram():
    builder = DiagramBuilder()
    add_station(builder, "bouncing_ball")
    with pytest.raises(SimrobError, match=r"it is a Diagram.*linearize\(ports\)"):
        linearize(builder.Build())
