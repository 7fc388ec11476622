"""SDF files: models move as Drake's own reader of SDF has them, and what no tree of motored joints can say is told."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.errors import SimrobError
from simrob_drake.importer.importing import ImportedRobot, import_robot
from simrob_drake.importer.reading.source import read_source
from simrob_drake.importer.sdf.robot import write_limits
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.parse import add_urdf

INERTIA = """<inertial><pose>0.1 0.02 0.05 0.1 0.2 0.3</pose><mass>{0}</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy>
  <izz>0.04</izz><ixy>0.001</ixy><ixz>0.002</ixz><iyz>0</iyz></inertia></inertial>"""
AXIS = "<axis><xyz{1}>{0}</xyz><limit><lower>-1</lower><upper>2</upper><effort>7</effort></limit>{2}</axis>"
ARM = f"""<sdf version="{{version}}"><model name="arm">
  <pose>0.3 0.2 0.1 0.1 0 0.4</pose>
  <link name="base">{INERTIA.format(3)}</link>
  <link name="upper"><pose>0.1 0.2 0.5 0.3 0.1 0.2</pose>{INERTIA.format(2)}
    <visual name="v"><geometry><box><size>0.1 0.2 0.3</size></box></geometry>
      <material><script><uri>file://x</uri><name>Gazebo/Red</name></script></material></visual>
    <visual name="ground"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>
    <sensor name="s" type="imu"/></link>
  <link name="lower"><pose>0.4 0 0.6 0 0.5 0</pose>{INERTIA.format(1)}</link>
  <link name="rod"><pose>0 0.5 0.4 0 0 0.2</pose>{INERTIA.format(0.5)}</link>
  <joint name="held" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="shoulder" type="revolute"><pose>0.05 0 0.02 0 0.3 0</pose><parent>base</parent><child>upper</child>
    {AXIS.format("0 0.6 0.8", "", "")}</joint>
  <joint name="elbow" type="prismatic"><parent>upper</parent><child>lower</child>
    {AXIS.format("1 2 0", "", "{old}<dynamics><damping>0.5</damping></dynamics>")}</joint>
  <joint name="back" type="revolute"><pose>0.1 0 0 0.2 0 0</pose><parent>rod</parent><child>upper</child>
    {AXIS.format("0 1 0", "", "")}</joint>
</model></sdf>"""
INNER = f"""<sdf version="1.9"><model name="inner"><link name="body">{INERTIA.format(1)}</link>
  <link name="tip"><pose degrees="true">0.2 0 0.1 20 30 40</pose>{INERTIA.format(0.4)}</link>
  <joint name="wrist" type="revolute"><parent>body</parent><child>tip</child>
    <axis><xyz expressed_in="__model__">0 0 1</xyz></axis></joint>
  <frame name="mount" attached_to="tip"><pose relative_to="body">0.3 0.1 0 0 0 0.5</pose></frame>
</model></sdf>"""
NEW = f"""<sdf version="1.9"><model name="new" canonical_link="trunk">
  <frame name="hip" attached_to="trunk"><pose rotation_format="quat_xyzw">0.1 0.2 0.3 0.1 0.5 0.5 0.7</pose></frame>
  <link name="trunk"><pose>0 0 0.2 0.1 0 0</pose>{INERTIA.format(3)}</link>
  <link name="leg"><pose relative_to="hip">0 0.1 -0.2 0 0.3 0</pose>{INERTIA.format(1)}</link>
  <joint name="knee" type="universal"><pose relative_to="hip"/><parent>trunk</parent><child>leg</child>
    <axis><xyz expressed_in="hip">1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>
  <include><uri>model://inner/model.sdf</uri><name>hand</name><placement_frame>mount</placement_frame>
    <pose relative_to="leg">0 0 -0.3 0 0 1</pose></include>
  <joint name="grip" type="fixed"><parent>hip</parent><child>hand::body</child></joint>
</model></sdf>"""


def put(folder: Path, text: str) -> Path:
    for name, content in (("robot", text), ("inner", INNER)):
        (folder / "models" / name).mkdir(parents=True, exist_ok=True)
        (folder / "models" / name / "model.sdf").write_text(content)
        manifest = '<model><name>m</name><sdf version="1.9">model.sdf</sdf></model>'
        (folder / "models" / name / "model.config").write_text(manifest)
    return folder / "models" / "robot" / "model.sdf"


def imported(folder: Path, text: str, **options) -> ImportedRobot:
    return import_robot(
        put(folder, text), folder / "out", ImportOptions(**options), isolated=False, force=True
    )


def told(robot: ImportedRobot, kind: str) -> str:
    return "\n".join(
        f"{entry.element}: {entry.text}" for entry in robot.report.entries if entry.kind == kind
    )


def finished(plant: MultibodyPlant) -> MultibodyPlant:
    plant.mutable_gravity_field().set_gravity_vector(np.array([0, 0, -9.81]))
    plant.Finalize()
    return plant


def both(robot: ImportedRobot, file: Path) -> list[MultibodyPlant]:
    """Return the plant of the imported robot, and of the same file as Drake reads it."""
    ours, drakes = MultibodyPlant(0.0), MultibodyPlant(0.0)
    add_urdf(ours, robot.model.element, name="robot", where="test", collision=False)
    if robot.model.base == "fixed":
        ours.WeldFrames(ours.world_frame(), ours.GetFrameByName(robot.model.root))
    parser = Parser(drakes)
    parser.package_map().Add("inner", str(file.parents[1] / "inner"))
    parser.AddModels(str(file))
    return [finished(ours), finished(drakes)]


def figures(plant: MultibodyPlant, axes: dict[str, float], free: str = "") -> list[np.ndarray]:
    """Return mass matrix and gravity torques of axes, and the centre of mass, at a posture."""
    context = plant.CreateDefaultContext()
    joints = [plant.GetJointByName(name) for name in axes]
    for joint, value in zip(joints, axes.values(), strict=True):
        (joint.set_angle if hasattr(joint, "set_angle") else joint.set_translation)(context, value)
    if free:
        pose = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1, 2, 3])
        plant.SetFreeBodyPoseInWorldFrame(context, plant.GetBodyByName(free), pose) if hasattr(
            plant, "SetFreeBodyPoseInWorldFrame"
        ) else plant.SetFreeBodyPose(context, plant.GetBodyByName(free), pose)
    places = [joint.velocity_start() for joint in joints]
    return [
        plant.CalcMassMatrix(context)[np.ix_(places, places)],
        plant.CalcGravityGeneralizedForces(context)[places],
        plant.CalcCenterOfMassPositionInWorld(context),
        np.array([plant.CalcTotalMass(context)]),
    ]


@pytest.mark.parametrize(
    ("version", "old"), [("1.4", ""), ("1.6", ""), ("1.6", "true"), ("1.9", "")]
)
def test_an_arm_moves_as_drake_reads_it(tmp_path, version, old):
    """Axes in the joint's frame or the model's, by version; frames anywhere; a joint that leads back to the root."""
    element = f"<use_parent_model_frame>{old}</use_parent_model_frame>" if old else ""
    text = ARM.format(version=version, old=element)
    robot = imported(tmp_path, text)

    ours, drakes = both(robot, put(tmp_path, text))

    for posture in np.random.default_rng(0).uniform(-0.9, 1.9, (5, 3)):
        axes = dict(zip(("shoulder", "elbow", "back"), posture.tolist(), strict=True))
        for mine, theirs in zip(figures(ours, axes), figures(drakes, axes), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-9)
    assert "joint 'back': leads towards the root; its links are exchanged" in told(
        robot, "repaired"
    )
    assert robot.model.efforts.tolist() == [7, 7, 7]


def test_frames_and_included_models_are_where_drake_has_them(tmp_path):
    robot = imported(tmp_path, NEW, base="floating")

    assert list(robot.model.axes) == ["knee_axis", "knee_axis2", "wrist"]

    ours, drakes = both(robot, put(tmp_path, NEW))
    for angle in (0.0, 0.7, -1.2):
        mine, theirs = (figures(plant, {"wrist": angle}, "trunk") for plant in (ours, drakes))
        for one, other in zip(mine, theirs, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)
    assert "joint 'knee': its type is universal; replaced by 2 joints" in told(robot, "repaired")


def test_a_model_that_is_merged_is_where_drake_has_it(tmp_path):
    """Its own frame, which it calls ``__model__``, is that of the ``include``."""
    merged = NEW.replace("<include>", '<include merge="true">').replace("<name>hand</name>", "")
    merged = merged.replace("<placement_frame>mount</placement_frame>", "").replace(
        "hand::body", "body"
    )
    robot = imported(tmp_path, merged, base="floating")

    ours, drakes = both(robot, put(tmp_path, merged))

    for angle in (0.0, 0.7, -1.2):
        mine, theirs = (figures(plant, {"wrist": angle}, "trunk") for plant in (ours, drakes))
        for one, other in zip(mine, theirs, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)


def test_a_model_that_is_merged_keeps_the_order_of_its_joints(tmp_path):
    """The axes of the robot have the order of the file, those of the merged model in the place of its ``include``."""
    joints = "".join(
        f'<link name="{name}_link">{INERTIA.format(1)}</link>'
        f'<joint name="{name}" type="revolute"><parent>body</parent><child>{name}_link</child>'
        f"{AXIS.format('0 0 1', '', '')}</joint>"
        for name in ("second", "third")
    )
    inner = f'<sdf version="1.9"><model name="inner">{joints}</model></sdf>'
    outer = f"""<sdf version="1.9"><model name="outer">
      <link name="body">{INERTIA.format(3)}</link>
      <link name="first_link">{INERTIA.format(1)}</link>
      <joint name="first" type="revolute"><parent>body</parent><child>first_link</child>
        {AXIS.format("0 0 1", "", "")}</joint>
      <include merge="true"><uri>model://inner/model.sdf</uri></include>
      <link name="fourth_link">{INERTIA.format(1)}</link>
      <joint name="fourth" type="revolute"><parent>body</parent><child>fourth_link</child>
        {AXIS.format("0 0 1", "", "")}</joint>
    </model></sdf>"""
    file = put(tmp_path, outer)
    (tmp_path / "models" / "inner" / "model.sdf").write_text(inner)

    robot = import_robot(file, tmp_path / "out", ImportOptions(base="fixed"), isolated=False)

    assert list(robot.model.axes) == ["first", "second", "third", "fourth"]


def test_colours_and_what_is_lost(tmp_path):
    robot = imported(tmp_path, ARM.format(version="1.6", old=""))
    upper = robot.model.element.find("link[@name='upper']")

    assert [visual.find("material/color").get("rgba") for visual in upper.iterfind("visual")] == [
        "1 0 0 1"
    ]
    assert "<plane> is no shape of a robot" in told(robot, "dropped")
    assert "<sensor>: 1 ×" in told(robot, "dropped")
    assert (robot.model.base, robot.model.root) == ("fixed", "robot_world")
    assert not told(robot, "lost")

    text = ARM.format(version="1.6", old="").replace(
        "<visual", "<gravity>false</gravity><visual", 1
    )
    text = text.replace(
        "</link>", "<collision><surface><friction/></surface></collision></link>", 1
    )

    assert text.count("<friction/>") == text.count("<gravity>") == 1

    lost = told(imported(tmp_path, text), "lost")
    assert "<surface>: 1 ×: contact parameters are part of a station" in lost
    assert "is without gravity in the file" in lost


def test_a_frame_of_the_world_is_left_out_unless_the_robot_is_fixed_to_the_world(tmp_path):
    frame = '<frame name="marker" attached_to="world"/>'

    arm = ARM.format(version="1.9", old="").replace("</model>", f"{frame}</model>")
    fixed = imported(tmp_path / "fixed", arm)
    loose = imported(
        tmp_path / "loose", NEW.replace("<include>", f"{frame}<include>"), base="floating"
    )

    assert fixed.model.element.find("frame[@name='marker']").get("link") == "robot_world"
    assert loose.model.element.find("frame[@name='marker']") is None
    assert "frame 'marker': is attached to the world" in told(loose, "dropped")


def test_a_closed_loop_is_refused_or_left_out(tmp_path):
    ends = "<parent>base</parent><child>lower</child>"
    loop = f'<joint name="rope" type="revolute">{ends}<axis><xyz>1 0 0</xyz></axis></joint>'

    text = ARM.format(version="1.6", old="").replace("</model>", f"{loop}</model>")

    with pytest.raises(SimrobError, match=r"rope.* --drop-loops"):
        imported(tmp_path, text)

    robot = imported(tmp_path, text, drop_loops=True)
    assert len(robot.model.axes) == 3


def model(name: str, joint: str = "revolute", inside: str = "") -> str:
    links = "".join(f'<link name="{link}">{INERTIA.format(1)}</link>' for link in "ab")
    return f"""<model name="{name}">{inside}{links}
      <joint name="j" type="{joint}"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint></model>"""


def world(*models: str) -> str:
    return f'<sdf version="1.6"><world name="w">{"".join(models)}</world></sdf>'


def test_the_robot_of_a_world_is_found_or_chosen(tmp_path):
    table = model("table", "fixed", "<static>true</static>")
    robot = imported(tmp_path, world(table, model("left")))

    assert robot.model.name == "left"
    assert "model 'table': is not part of the robot" in told(robot, "dropped")

    two = world(model("left"), model("right"))
    with pytest.raises(
        SimrobError, match=r"contains 2 robots \(left, right\); choose one with --model NAME"
    ):
        imported(tmp_path, two)
    assert imported(tmp_path, two, model="right").model.name == "right"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<include><uri>../../secret.sdf</uri></include>', "is outside the allowed folders"),
        (model("a").replace("<link", "<pose>1 2</pose><link", 1), "is no pose"),
        (model("a").replace("<parent>a", "<parent>c"), "there is no link, joint or frame 'c'"),
        (model("a", "screw"), "has the type 'screw'"),
        ("", "contains no model"),
        (model("a").replace("<link name=\"a\">", '<link name="a"><pose relative_to="f"/>').replace(
            "<joint", '<frame name="f"><pose relative_to="a"/></frame><joint'), "<pose> depends on this frame"),
    ],
)  # fmt: skip
def test_what_may_not_or_cannot_be_read_is_refused(tmp_path, text, words):
    (tmp_path / "secret.sdf").write_text(INNER)
    with pytest.raises(SimrobError, match=words) as problem:
        imported(tmp_path, world(text))
    assert "\n" not in str(problem.value)


def test_models_that_include_each_other_are_refused(tmp_path):
    text = '<sdf version="1.9"><model name="m"><include><uri>model://robot</uri></include></model></sdf>'
    with pytest.raises(SimrobError, match="models include each other without end"):
        imported(tmp_path, text)


def test_nothing_is_read_from_the_network(tmp_path):
    fuel = "<include><uri>https://fuel.example.org/models/sun</uri></include>"
    file = put(tmp_path, world(fuel, model("left")))

    read_source(file, report := ImportReport(file))

    assert any(entry.kind == "lost" and "network" in entry.text for entry in report.entries)


@pytest.mark.parametrize(
    ("limit", "kind", "written"),
    [
        ("<lower>-1.5</lower><upper>2</upper>", "revolute", {"lower": "-1.5", "upper": "2"}),
        ("<lower>-1.5</lower>", "continuous", {"lower": "-1.5"}),
        ("<lower>-1e16</lower><upper>1e16</upper>", "continuous", {}),
        ("<effort>-1</effort><velocity>3</velocity>", "continuous", {"velocity": "3"}),
    ],
)
def test_a_joint_with_both_limits_is_revolute_and_others_are_continuous(
    limit: str, kind: str, written: dict[str, str]
) -> None:
    joint = ET.fromstring('<joint type="revolute"/>')
    axis = ET.fromstring(f"<axis><limit>{limit}</limit></axis>")

    write_limits(joint, axis)

    assert joint.get("type") == kind
    assert joint.find("limit").attrib == written
