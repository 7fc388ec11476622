"""Random figures and random structure, whole imports: every file becomes a robot or is refused in one line."""

import random
import shutil
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simrob_drake.base.errors import InvalidModel
from simrob_drake.importer.importing import import_robot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.parse import lone_robot

FILES = 200
"""Of each kind."""

SEED = """<robot name="seed">
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base">
    <visual><geometry><box size="0.2 0.2 0.1"/></geometry><material name="blue"/></visual>
    <collision><geometry><mesh filename="wedge.obj" scale="1 1 1"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><origin xyz="0 0 0.2" rpy="0 0 0"/><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0.001" izz="0.003"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.04" length="0.4"/></geometry></collision>
  </link>
  <link name="slide">
    <inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="tcp"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1" rpy="0 0 0.1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="40" velocity="3"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="push" type="prismatic"><parent link="arm"/><child link="slide"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.5" effort="90" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="slide"/><child link="tcp"/></joint>
  <transmission name="drive"><type>transmission_interface/SimpleTransmission</type><joint name="turn"/>
    <actuator name="motor"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>
  <gazebo reference="arm"/>
</robot>
"""
WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"

NUMERIC = {
    *(
        "xyz",
        "rpy",
        "size",
        "radius",
        "length",
        "scale",
        "rgba",
        "value",
        "lower",
        "upper",
        "effort",
        "velocity",
    ),
    *("damping", "friction", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
}
ODD_NUMBERS = [
    *(
        "",
        " ",
        "-",
        "0",
        "-0",
        "1,5",
        "1e400",
        "-1e400",
        "1e-320",
        "1e29",
        "9e29",
        "1e-29",
        "0x10",
        "1_0",
        "٣",
        "1 2",
    ),
    *(
        "inf",
        "-Inf",
        "NAN",
        "${pi}",
        "1e",
        ".",
        "1.",
        "+.5",
        "--1",
        "0 0 0",
        "1e-9 1e-9 1e-9",
        "1e12 1e12 1e12",
    ),
]
TAGS = sorted(
    {element.tag for element in ET.fromstring(SEED).iter()}
    | {"mimic", "frame", "capsule", "texture"}
)

figures = st.floats(allow_nan=True, allow_infinity=True).map(repr)
small = st.floats(-10, 10).map(lambda value: f"{value:.4g}")
several = st.lists(small | figures, min_size=2, max_size=4).map(" ".join)
numbers = st.one_of(small, figures, several, st.sampled_from(ODD_NUMBERS), st.text(max_size=6))
everywhere = settings(
    max_examples=FILES,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


def tried(robot: ET.Element, folder: Path, options: ImportOptions) -> None:
    """Import a robot in this very process: Drake builds what comes out, or one line says why nothing does."""
    source, out = folder / "seed" / "robot.urdf", folder / "out"
    shutil.rmtree(out, ignore_errors=True)  # of a case that failed
    source.parent.mkdir(exist_ok=True)
    (source.parent / "wedge.obj").write_text(WEDGE)
    source.write_bytes(ET.tostring(robot, encoding="utf-8"))
    model, refusal = imported(source, out, options)
    if model is None:
        assert refusal.startswith(f"{source}: ")
        assert "\n" not in refusal
        assert [path.name for path in folder.iterdir()] == ["seed"]
        return
    lone = lone_robot(model, floating=model.base == "floating")
    assert len(model.axes) > 0
    assert lone.plant.num_actuators() == len(model.axes) - len(model.passive_axes)
    shutil.rmtree(out)


def imported(source: Path, out: Path, options: ImportOptions) -> tuple[RobotModel | None, str]:
    """Return the imported robot, or why there is none."""
    try:
        return import_robot(source, out, options, isolated=False).model, ""
    except InvalidModel as problem:
        return None, str(problem)


options = st.builds(
    ImportOptions,
    estimate_inertia=st.booleans(),
    friction_as_damping=st.booleans(),
    collision=st.sampled_from(["hull", "box", "none"]),
)


def numeric_places(robot: ET.Element) -> list[tuple[ET.Element, str]]:
    return [(element, key) for element in robot.iter() for key in element.attrib if key in NUMERIC]


@pytest.mark.long
@everywhere
@given(
    options=options,
    changes=st.lists(st.tuples(st.integers(0, 999), numbers), min_size=1, max_size=4),
)
def test_any_figures(folder, options, changes):
    robot = ET.fromstring(SEED)
    places = numeric_places(robot)
    for place, value in changes:
        element, key = places[place % len(places)]
        words = element.attrib[key].split()
        if len(words) > 1 and place % 2:  # only one of several figures
            words[place % len(words)] = value
            value = " ".join(words)  # noqa: PLW2901
        element.set(key, printable(value))

    tried(robot, folder, options)


def printable(text: str) -> str:
    """Return a text without what no XML can hold."""
    return "".join(letter for letter in text if letter.isprintable() or letter in "\t\n")


def damage(robot: ET.Element, kind: str, dice: random.Random) -> None:
    """Do one harm to the structure of a robot."""
    owners = [(owner, child) for owner in robot.iter() for child in owner]
    if not owners:
        return
    owner, element = dice.choice(owners)
    inside = set(element.iter())
    homes = [home for home in robot.iter() if home not in inside]
    match kind:
        case "delete":
            owner.remove(element)
        case "duplicate":
            owner.insert(dice.randrange(len(owner) + 1), deepcopy(element))
        case "move":
            owner.remove(element)
            home = dice.choice(homes)
            home.insert(dice.randrange(len(home) + 1), element)
        case "rename":
            element.tag = dice.choice(TAGS)
        case "forget":
            for key in dice.sample(sorted(element.attrib), min(1, len(element.attrib))):
                del element.attrib[key]
        case "swap":
            (one, a), (two, b) = (
                dice.choice([(e, k) for e in robot.iter() for k in e.attrib]) for _ in "ab"
            )
            one.attrib[a], two.attrib[b] = two.attrib[b], one.attrib[a]
        case "exchange":
            alike = [
                (e, k)
                for e in robot.iter()
                for k in e.attrib
                if k in ("name", "link", "joint", "type")
            ]
            (one, a), (two, b) = (dice.choice(alike) for _ in "ab")
            one.attrib[a], two.attrib[b] = two.attrib[b], one.attrib[a]


harms = st.sampled_from(["delete", "duplicate", "move", "rename", "forget", "swap", "exchange"])


@pytest.mark.long
@everywhere
@given(options=options, kinds=st.lists(harms, min_size=1, max_size=4), dice=st.integers(0, 2**32))
def test_any_structure(folder, options, kinds, dice):
    robot, rolled = ET.fromstring(SEED), random.Random(dice)
    for kind in kinds:
        damage(robot, kind, rolled)
    tried(robot, folder, options)
