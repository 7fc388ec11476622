"""Former names of attributes, functions and classes work, with a warning that states the present name."""

import importlib
import warnings

import numpy as np
import pytest

from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Corrections, Stride


class Box:
    """A class whose attribute `size` was called `extent`, and whose method `grow` was called `enlarge`."""

    def __init__(self, size):
        self.size = size

    def grow(self, amount):
        return Box(self.size + amount)


keep_former_attributes(Box, extent="size", enlarge="grow")


def test_a_former_attribute_gives_the_value_of_the_present_one():
    box = Box(2)

    with pytest.warns(
        DeprecationWarning, match=r"^Box\.extent is now Box\.size; .* until simrob_drake 0\.2$"
    ):
        value = box.extent

    assert value == 2


def test_a_former_method_is_called_on_its_object():
    with pytest.warns(DeprecationWarning, match=r"Box\.enlarge is now Box\.grow"):
        larger = Box(2).enlarge(3)

    assert larger.size == 5


def test_the_warning_points_at_the_line_that_uses_the_former_name():
    with pytest.warns(DeprecationWarning, match="extent") as warned:
        Box(2).extent  # noqa: B018

    assert warned[0].filename == __file__


def test_a_former_name_of_a_module_is_found_and_others_are_not():
    find = former_names_of("simrob_drake.walking.stride", {"Learnt": "Corrections"})

    with pytest.warns(DeprecationWarning, match=r"stride\.Learnt is now .*stride\.Corrections"):
        assert find("Learnt") is Corrections
    with pytest.raises(
        AttributeError, match=r"'simrob_drake\.walking\.stride' has no attribute 'Learned'"
    ):
        find("Learned")


@pytest.mark.parametrize(
    ("module", "former", "present"),
    [
        ("stride", "Learnt", "Corrections"),
        ("stride", "eased", "smoothstep"),
        ("stride", "gone", "progress_since"),
        ("steps", "Divergent", "DivergentComponent"),
        ("steps", "within", "clamp"),
        ("body", "Seen", "BodyState"),
        ("body", "uphill", "height_on_slope"),
        ("body", "planes", "slope_weights_of"),
        ("body", "sloped", "slope_through"),
        ("engine", "turned", "rotation_matrix"),
        ("commands", "clipped", "clip_command"),
        ("commands", "beyond", "find_excess"),
    ],
)
def test_former_names_of_the_walking_package_are_the_present_objects(module, former, present):
    owner = importlib.import_module(f"simrob_drake.walking.{module}")

    with pytest.warns(DeprecationWarning, match=f"{former} is now .*{present}"):
        found = getattr(owner, former)

    assert found is getattr(owner, present)


@pytest.mark.parametrize(
    ("module", "former", "present"),
    [
        ("resolved", "Surroundings", "StationContents"),
        ("resolved", "named", "name_or_only"),
        ("monitors.monitor", "of_axes", "axis_outputs"),
        ("monitors.monitor", "worst", "condition_on_largest"),
        ("controllers.loop", "Wired", "LoopPorts"),
        ("controllers.loop", "of_state", "add_output_of_state"),
    ],
)
def test_former_names_of_parts_are_the_present_objects(module, former, present):
    owner = importlib.import_module(f"simrob_drake.parts.{module}")

    with pytest.warns(DeprecationWarning, match=f"{former} is now .*{present}"):
        found = getattr(owner, former)

    assert found is getattr(owner, present)


@pytest.mark.parametrize(
    ("module", "owner", "former", "present"),
    [
        ("station_plant", "StationPlant", "stepped", "plant_block"),
        ("station_plant", "StationPlant", "place", "set_positions"),
        ("sensors.sensor", "Sensor", "stepped", "samples_while_stepping"),
        ("monitors.monitor", "MonitorSection", "lasting", "hold_text"),
        ("controllers.loop", "LoopSection", "named", "read_names"),
        ("controllers.loop", "LoopSection", "layered", "target_axes"),
    ],
)
def test_former_attributes_of_parts_are_the_present_ones(module, owner, former, present):
    described = getattr(importlib.import_module(f"simrob_drake.parts.{module}"), owner)

    with pytest.warns(DeprecationWarning, match=rf"{owner}\.{former} is now {owner}\.{present}"):
        found = getattr(described, former)

    assert found is getattr(described, present)


def test_former_fields_of_a_stride_are_the_present_ones():
    corrections = Corrections(lean_integral=0.1j, com_offset=0.02, speed_trim=0.03 - 0.01j)
    stride = Stride(corrections=corrections)

    with pytest.warns(DeprecationWarning, match="is now (Corrections|Stride|Step)"):
        former = (stride.learnt.counter, stride.learnt.sag, stride.learnt.trim, stride.step.braced)

    assert former == (0.1j, 0.02, 0.03 - 0.01j, 0.0)


def test_present_names_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Stride().corrections.com_offset == 0
        assert Command(0.1).approach(Command(0.3), (0.05, 0.1, 10.0)).speed == pytest.approx(0.15)
        assert np.isfinite(Stride().numbers()).all()
