"""Random damage: a robot comes out that Drake loads and that needs no more repair, or one line says why not."""

import xml.etree.ElementTree as ET
from copy import deepcopy

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from repair_stages import END, INERTIA, Repaired, joint, with_defect

from simrob_drake.base.errors import InvalidModel
from simrob_drake.robots.imports import ImportOptions

HAND = f'<link name="hand"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
SLIDE = joint(
    "slide",
    "tip",
    "hand",
    "prismatic",
    '<axis xyz="1 0 0"/><limit lower="0" upper="1" effort="9"/>',
)
SEED = with_defect(END, f'{HAND}{SLIDE}<frame name="tcp" link="tip"/>{END}')
"""Its shapes are sound and stay so: they are the matter of another stage."""

WORDS = [
    "",
    "0",
    "0 0 0",
    "nan",
    "-inf",
    "-1",
    "1,5",
    "1.0f",
    "1e400",
    "1e-320",
    "1e29",
    "abc",
    "0 0 0 0",
    "1 2",
    "  ",
]
NAMES = [
    "world",
    "base",
    "upper",
    "tip",
    "shoulder",
    "revolute",
    "continuous",
    "fixed",
    "floating",
    "prismatic",
    "é",
]
TAGS = [
    "link",
    "joint",
    "inertial",
    "mimic",
    "limit",
    "axis",
    "origin",
    "frame",
    "transmission",
    "material",
    "gazebo",
]


def damage(robot: ET.Element, draw) -> None:
    """Do one random harm to a robot, but to none of its shapes."""
    shapes = {
        id(part)
        for shape in robot.iter()
        if shape.tag in ("visual", "collision")
        for part in shape.iter()
    }
    places = [
        (parent, child) for parent in robot.iter() for child in parent if id(child) not in shapes
    ]
    if not places:
        return
    parent, element = places[draw(st.integers(0, len(places) - 1))]
    value = draw(st.sampled_from(WORDS + NAMES))
    keys = sorted(element.attrib) or ["name"]
    match draw(st.integers(0, 5)):
        case 0:
            element.attrib.pop(draw(st.sampled_from(keys)), None)
        case 1:
            element.set(draw(st.sampled_from(keys)), value)
        case 2:
            parent.remove(element)
        case 3:
            other = deepcopy(element)
            other.set(draw(st.sampled_from(keys)), value)
            parent.append(other)
        case 4:
            element.tag = draw(st.sampled_from(TAGS))
        case _:
            ET.SubElement(
                element,
                draw(st.sampled_from(TAGS)),
                {draw(st.sampled_from(["name", "xyz", "value"])): value},
            )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


def refusal_of(text: str, folder, options: ImportOptions) -> str:
    """Return why a text is refused; empty if it is repaired."""
    try:
        Repaired(text, folder, options)
    except InvalidModel as problem:
        return str(problem)
    return ""


@pytest.mark.long
@settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(data=st.data())
def test_random_damage_is_repaired_or_refused(folder, data):
    robot = ET.fromstring(SEED)
    for _ in range(data.draw(st.integers(1, 6))):
        damage(robot, data.draw)
    options = ImportOptions(
        estimate_inertia=data.draw(st.booleans()), friction_as_damping=data.draw(st.booleans())
    )
    text = ET.tostring(robot, encoding="unicode")

    refusal = refusal_of(text, folder, options)

    assert "\n" not in refusal
    assert "Drake cannot read this file" not in refusal
