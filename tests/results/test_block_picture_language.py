"""Labels of the block picture in Spanish: references, groups, controllers, forces and couplings."""

import re
from collections.abc import Iterator

import pytest

from simrob_drake.base.files import station_files
from simrob_drake.base.messages import in_language, set_output_language
from simrob_drake.parts.couplings import Gear, Rod, Spring
from simrob_drake.results.block_diagram.picture import station_dot, station_svg
from simrob_drake.stations.load import load_station

ENGLISH = re.compile(
    r"\b(hold|to|from|in|at|the|of|and|with|axes|joints|sequence|table|drag|reference|servos and|sensors|outputs|outer|"
    r"loops|forces|scene|own|Estimator|Planner|Touch|Phase|Guard|Height|Heat|Stage|Cell|limits|blocks|rest)\b"
)
NAMES = re.compile(
    r"\\n(?:[\w.]+ = )*[\w.]+(?=\\n|$)"  # a line of one name, such as a port, a piece or a tool
    r"|^[\w.]+(?: = [\w.]+)*(?=\\n|$)"
    r"|(?:con|Poses|Poses de|axes)\\?n?[ \\n]*[\w, \\]+$"  # lists of pieces and tools
    r"|humanoid of\\?n? ?MATLAB"  # what a robot's own file calls it
    r"|\w+: |'\w+'"
)


@pytest.fixture(autouse=True)
def _english_afterwards() -> Iterator[None]:
    yield
    set_output_language("en")


def labels_of(name: str) -> list[str]:
    """Labels of blocks and groups of a station's picture."""
    return re.findall(r'label="((?:[^"\\]|\\.)*)"', station_dot(load_station(name)))


@pytest.mark.parametrize("name", station_files())
def test_a_picture_in_spanish_has_no_english_words(name):
    set_output_language("es")
    labels = [label for label in labels_of(name) if not label.startswith(" ")]

    assert any("sensores y salidas" in label for label in labels)

    found = {label: ENGLISH.findall(NAMES.sub(" ", label)) for label in labels}
    assert {label: words for label, words in found.items() if words} == {}


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("irb120_dynamic", "ramp a 30 deg en 1 s"),
        ("irb120_force_control", r"ramp a joint_1 9,5 deg en\n3 s, desde 2,5 s"),
        ("irb120_workcell", "postura inicial"),
        ("humanoid_balance", r"Fuerza 'push'\n30 N a los 1 s\nen robot"),
        (
            "irb120_motor_protection",
            r"protection\nprotección de motores, 100 Hz\n↓ Calor de los motores",
        ),
        ("belt_pick", r"belt: belt, 1 eje\narm: ABB IRB 120, 6 ejes"),
        ("zjudancer_walking", "±3,1 a 10 N·m"),
    ],
)
def test_a_label_is_in_spanish(name, label):
    set_output_language("es")
    assert any(label in own for own in labels_of(name))


def test_the_title_of_a_folded_subsystem_is_in_spanish():
    set_output_language("es")
    station = load_station("zjudancer_walking")

    picture = station_svg(station, folded=["controller.walk"])

    assert "lazos externos (2)" in picture
    assert "outer loops" not in picture


def test_the_next_picture_is_english_again():
    set_output_language("es")

    assert "referencia" in station_svg(load_station("double_pendulum"))

    set_output_language("en")
    assert "referencia" not in station_svg(load_station("double_pendulum"))


def test_the_description_of_an_own_station_stays(tmp_path):
    """A station may have the name of one of the package, with a description of its own."""
    set_output_language("es")
    own = load_station("double_pendulum", {"description": "My own pendulum"})
    assert "My own pendulum" in station_svg(own)


def test_couplings_are_described_in_spanish():
    ends = {"body": "left", "other": "right"}
    rod = Rod(kind="rod", length=0.25, **ends)
    spring = Spring(kind="spring", stiffness=1.5, **ends)

    gear = Gear(kind="gear", ratios={"a": 1.0, "b": -0.5})

    assert rod.caption() == "a rod of 0.25 m from left to right"
    assert in_language(rod.caption(), "es") == "una varilla de 0,25 m de left a right"
    assert in_language(spring.caption(), "es") == "un muelle de 1,5 N/m de left a right"
    assert gear.caption() == "a gear: 1 a + -0.5 b is constant"
    assert in_language(gear.caption(), "es") == "un engranaje: 1 a + -0,5 b es constante"
