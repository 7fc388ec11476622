"""The site of a station: its registry of outputs, its labels of the picture, and its former names."""

import dataclasses
import importlib
import warnings

import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import add_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import in_language, message
from simrob_drake.base.signals import Signal
from simrob_drake.parts.outputs import OutputRegistry
from simrob_drake.parts.picture import PictureLabels
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.parts.site import Site


@pytest.fixture(scope="module")
def site():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_kinematic")
    return builder, ports


def test_a_site_itself_only_wires(site):
    fields = {field.name for field in dataclasses.fields(Site)}
    registry = {"signals", "of_state", "later", "images", "monitors", "notes", "lean", "idle"}

    assert not fields & (registry | {"drawn"})
    assert len(fields) <= 10
    _, ports = site
    assert isinstance(ports.outputs, OutputRegistry)
    assert isinstance(ports.picture, PictureLabels)


def test_outputs_are_a_mapping_of_ports(site):
    _, ports = site

    assert {"position", "velocity", "tcp_pose"} <= set(ports.outputs)
    assert ports.outputs["position"].size() == 6
    assert len(ports.outputs) == len(list(ports.outputs))
    with pytest.raises(KeyError):
        ports.outputs["no_such_output"]


def test_an_output_without_columns_is_no_signal(site):
    _, ports = site
    registry = OutputRegistry(ports.state, ports.plant.plant)
    registry.add("nothing", ports.outputs["position"], Signal((), (), "own", "nothing"))

    registry.add("one", ports.outputs["position"], Signal(("one",), ("1",), "own", "one"))

    assert list(registry) == ["nothing", "one"]
    assert [signal.output for signal in registry.signals] == ["one"]


@pytest.mark.parametrize(
    ("name", "owner"),
    [
        ("signals", "outputs"),
        ("of_state", "outputs"),
        ("monitors", "outputs"),
        ("drawn", "picture"),
        ("add", "outputs"),
    ],
)
def test_a_former_attribute_works_and_names_the_new_one(site, name, owner):
    _, ports = site
    with pytest.warns(DeprecationWarning, match=rf"Site\.{name} is now Site\.{owner}\.{name}"):
        former = getattr(ports, name)
    assert former == getattr(getattr(ports, owner), name)


def test_an_unknown_attribute_is_an_error(site):
    _, ports = site
    with pytest.raises(AttributeError, match="no attribute 'sigals'"):
        _ = ports.sigals


@pytest.mark.parametrize(
    ("name", "module"),
    [("WORLD", "resolved"), ("ResolvedRobot", "resolved"), ("FromState", "outputs")],
)
def test_a_former_name_of_the_module_works_with_a_warning(name, module):
    former = importlib.import_module("simrob_drake.parts.site")

    with pytest.warns(DeprecationWarning, match=f"simrob_drake.parts.{module}.{name}"):
        found = getattr(former, name)
    assert found is getattr(importlib.import_module(f"simrob_drake.parts.{module}"), name)
    with pytest.raises(AttributeError):
        _ = former.NoSuchName


def test_a_part_of_another_package_in_the_former_way_still_works(site):
    """The calls of a sensor that was written before: add, port, draw and robot of the site."""
    builder, ports = site
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        robot = ports.robot(None)
        port = ports.port(builder, "position")
        ports.outputs.add("again", port, Signal(("again.x",), ("rad",), "own", "again"))
        ports.picture.draw("sensor.again", "sensor", "Again", robot)

    assert ports.outputs["again"] is port
    assert ports.picture.drawn["sensor.again"].label == "Again"


def test_the_error_that_there_is_nothing_to_choose_is_translated():
    kind = message("parts.sensor_for", "{kind} sensor for {key}", kind="force", key="monitors.stop")

    with pytest.raises(InvalidParameter) as raised:
        name_or_only(None, [], kind=kind, key="monitors.stop.sensor")

    english = "monitors.stop.sensor: there is no force sensor for monitors.stop; add one"
    assert raised.value.message == english
    spanish = in_language(raised.value.message, "es")
    assert spanish == "monitors.stop.sensor: no hay sensor force para monitors.stop; añada uno"
