"""Joints without a motor in files of every format: they come out without a motor, and the report names them."""

from pathlib import Path

import numpy as np
import pydrake
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.importer.importing import import_robot
from simrob_drake.robots.parse import lone_robot

EXAMPLES = Path(pydrake.getDrakePath()) / "examples"
FILES = [  # files of Drake, which come with it, and the axes that have no motor there
    pytest.param("acrobot/Acrobot.urdf", ["shoulder"], id="acrobot"),
    pytest.param("multibody/cart_pole/cart_pole.sdf", ["PolePin"], id="cart-pole"),
]
LINK = (
    '<link name="{0}"><pose>0 0 {1} 0 0 0</pose>'
    "<inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial></link>"
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent>{1}</parent><child>{2}</child>'
    "<axis><xyz>0 1 0</xyz>{3}</axis>{4}</joint>"
)
NO_MOTOR = "<limit><effort>0</effort></limit>"
ROTOR = '<drake:rotor_inertia xmlns:drake="http://drake.mit.edu">0.01</drake:rotor_inertia>'
MJCF = """<mujoco><worldbody><body><joint name="one" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/>
  <body pos="0.5 0 0"><joint name="two" axis="0 1 0" armature="0.02"/><geom size="0.1" pos="0.1 0 0"/></body>
  </body></worldbody>{0}</mujoco>"""


def put(folder: Path, name: str, text: str) -> Path:
    """Write a robot's file into a folder of its own, and return the file."""
    (folder / "in").mkdir(exist_ok=True)
    (file := folder / "in" / name).write_text(text)
    return file


def sdf(first: str, second: str, gears: str = "") -> str:
    """Write an arm of two joints, with limits of each axis, and Drake's elements of the first joint's motor."""
    links = LINK.format("a", 0.5) + LINK.format("b", 1.0)
    joints = JOINT.format("one", "world", "a", first, gears) + JOINT.format(
        "two", "a", "b", second, ""
    )
    return f'<sdf version="1.7"><model name="arm">{links}{joints}</model></sdf>'


def passive_axes(file: Path, folder: Path) -> list[str]:
    """Import a file, and check that model, plant and report agree on which axes have no motor. Returns their names."""
    imported = import_robot(file, folder / "out", isolated=False, force=True)
    model = imported.model
    plant = lone_robot(model, floating=False).plant
    driven = {
        plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()
    }
    passive = [axis for axis, entry in model.axes.items() if entry.joint not in driven]
    assert model.passive_axes == passive
    assert ((model.efforts > 0) == ~model.passive).all()
    gains = model.axis_vector(model.servo.kp, "servo.kp")
    assert ((gains > 0) == ~model.passive).all()
    told = [
        entry.element for entry in imported.report.entries if entry.text.startswith("passive: ")
    ]
    # one line, of the one joint that these files have
    assert told == [f"joints '{axis}'" for axis in passive]
    return passive


@pytest.mark.parametrize(("name", "expected"), FILES)
def test_examples_of_drake(tmp_path, name, expected):
    file = EXAMPLES / name
    if not file.exists():
        pytest.skip("this Drake has no example files")

    assert passive_axes(file, tmp_path) == expected

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(file))
    plant.Finalize()

    driven = [
        plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()
    ]

    assert len(driven) == 1
    assert driven != expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        pytest.param(sdf("", NO_MOTOR), ["two"], id="effort 0 of one"),
        pytest.param(sdf(NO_MOTOR, ""), ["one"], id="effort 0 of the other"),
        pytest.param(sdf(NO_MOTOR, NO_MOTOR), [], id="all efforts 0"),
        pytest.param(sdf("", ""), [], id="no effort"),
        pytest.param(sdf("", "", ROTOR), [], id="a rotor of one, no effort"),
        pytest.param(sdf("", NO_MOTOR, ROTOR), ["two"], id="a rotor of one, effort 0 of the other"),
    ],
)
def test_sdf(tmp_path, text, expected):
    file = put(tmp_path, "arm.sdf", text)
    assert passive_axes(file, tmp_path) == expected


MOTOR_OF_ONE = '<actuator><motor joint="one" ctrllimited="true" ctrlrange="-5 5"/></actuator>'
EQUALITY = '<equality><joint joint1="two" joint2="one"/></equality>'
WITHOUT_FORCE = (
    '<actuator><motor joint="one" ctrllimited="true" ctrlrange="-5 5"/>'
    '<general joint="two" gainprm="0"/></actuator>'
)


@pytest.mark.parametrize(
    ("sections", "expected"),
    [
        pytest.param(MOTOR_OF_ONE, ["two"], id="one actuator"),
        pytest.param("", [], id="no actuator"),
        pytest.param(MOTOR_OF_ONE + EQUALITY, [], id="a follower"),
        pytest.param(WITHOUT_FORCE, ["two"], id="an actuator without force"),
    ],
)
def test_mjcf(tmp_path, sections, expected):
    file = put(tmp_path, "arm.xml", MJCF.format(sections))
    assert passive_axes(file, tmp_path) == expected


def test_an_armature_without_a_motor_is_lost_in_the_open(tmp_path):
    file = put(tmp_path, "arm.xml", MJCF.format(MOTOR_OF_ONE))
    report = import_robot(file, tmp_path / "out", isolated=False).report
    assert any("armature (0.02)" in entry.text for entry in report.of("lost"))


def test_an_imported_robot_keeps_its_passive_axes(tmp_path):
    file = put(tmp_path, "arm.sdf", sdf("", NO_MOTOR))
    first = import_robot(file, tmp_path / "first", isolated=False)

    again = import_robot(first.model.urdf_path, tmp_path / "again", isolated=False)

    assert not again.report.has_changes
    assert again.model.passive_axes == first.model.passive_axes == ["two"]
    np.testing.assert_array_equal(again.model.efforts, first.model.efforts)
