"""MJCF files: they move as MuJoCo moves them, and what a tree of motored joints cannot say is told or refused."""

import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.multibody.plant import MultibodyPlant
from typer.testing import CliRunner

from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import app
from simrob_drake.extensions.mujoco.mjcf import reading
from simrob_drake.importer import importing
from simrob_drake.importer.importing import ImportedRobot, import_robot
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.reading.child import ChildFailed
from simrob_drake.importer.reading.source import read_source
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import mass_of, name_of
from simrob_drake.stations.load import load_station

mujoco = pytest.importorskip("mujoco")

BODY = (
    '<inertial pos="{0} 0.02 0.1" mass="{1}" diaginertia="0.02 0.03 0.04" quat="0.9 0.1 0.2 0.3"/>'
)
ARM = f"""<mujoco model="arm">
  <compiler angle="degree" meshdir="parts"/>
  <option><flag energy="enable"/></option>
  <default><joint damping="0.5" armature="0.01"/><default class="drive"><position kp="200" kv="10"/></default></default>
  <asset>
    <mesh name="wedge" file="wedge.stl" scale="0.01 0.01 0.01" refpos="1 2 3" refquat="0.7 0.1 0.2 0.3"/>
    <mesh name="long" file="wedge.stl" scale="0.01 0.03 -0.02" refpos="1 2 3"/>
    <material name="red" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body name="base" pos="0.1 0.2 0.3" quat="0.9 0.1 0.3 0.2">
      <geom type="box" size="0.1 0.1 0.05"/>
      <body name="upper" pos="0 0.1 0.2" euler="20 30 40">
        <joint name="pan" axis="0 0.6 0.8" pos="0.05 0.02 0.01" range="-100 120" ref="15"/>
        <joint name="tilt" axis="1 0 0" pos="0 0.03 0.02"/>
        {BODY.format(0.1, 2)}
        <geom type="mesh" mesh="wedge" pos="0.1 0.2 0.3" quat="0.5 0.1 0.2 0.9" material="red" group="2"/>
        <geom name="hull" type="mesh" mesh="long" contype="0" conaffinity="0"/>
        <body name="slider" pos="0.2 0 0.1" quat="0.8 0.2 0.1 0.4">
          <joint name="stroke" type="slide" axis="0 0 1" ref="0.05" range="-0.1 0.2" armature="0.3"/>
          {BODY.format(0.02, 0.5)}
          <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.2" group="3"/>
          <site name="attachment_site" pos="0 0 0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="drive" joint="pan" forcerange="-40 50"/>
    <motor joint="tilt" gear="5" ctrlrange="-3 2"/>
    <general joint="stroke" gaintype="fixed" gainprm="3"/>
  </actuator>
  <sensor><jointpos joint="pan"/></sensor>
  <keyframe><key name="rest" qpos="0 0 0"/><key name="home" qpos="0.5 -0.25 0.1"/></keyframe>
</mujoco>"""


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let MuJoCo compile, and Drake probe, in this process, which is quicker."""
    from simrob_drake.extensions.mujoco.mjcf import compiling

    def compiled(_: str, job, answer, __, *, seconds: float):
        monkeypatch.setattr(compiling, "ask", answer)
        try:
            return {**compiling.compiled(job), "unconfined": []}
        except ValueError as problem:  # as the process says it
            raise ChildFailed(" ".join(str(problem).split())) from problem

    monkeypatch.setattr(reading, "in_child", compiled)
    monkeypatch.setattr(importing, "probe", lambda file, report: None)


def put(folder: Path, text: str = ARM) -> Path:
    (folder / "in" / "parts").mkdir(parents=True, exist_ok=True)
    wedge = trimesh.Trimesh(
        [[1, 0, 0], [4, 0, 0], [1, 3, 0], [1, 0, 5]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    )
    (folder / "in" / "parts" / "wedge.stl").write_bytes(wedge.export(file_type="stl"))
    file = folder / "in" / "arm.xml"
    file.write_text(text)
    return file


def imported(folder: Path, text: str = ARM, **options) -> ImportedRobot:
    return import_robot(
        put(folder, text), folder / "out", ImportOptions(**options), isolated=False, force=True
    )


def told(robot: ImportedRobot, kind: str) -> str:
    return "\n".join(
        f"{entry.element}: {entry.text}" for entry in robot.report.entries if entry.kind == kind
    )


def plant_of(robot: ImportedRobot) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0, 0, -9.81]))
    add_urdf(plant, robot.model.element, name="robot", where="test", collision=False)
    if robot.model.base == "fixed":
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(robot.model.root))
    plant.Finalize()
    return plant


def both(robot: ImportedRobot, file: Path, postures: int = 5):
    """Yield MuJoCo's model and data, and Drake's plant and context, at random postures of the robot's axes."""
    plant, model = plant_of(robot), mujoco.MjModel.from_xml_path(str(file))
    data, context = mujoco.MjData(model), plant.CreateDefaultContext()
    random = np.random.default_rng(0)
    for _ in range(postures):
        for axis in robot.model.axes:
            place = model.joint(axis).qposadr[0]
            data.qpos[place] = random.uniform(-0.1, 0.2)
            joint = plant.GetJointByName(axis)
            (joint.set_angle if hasattr(joint, "set_angle") else joint.set_translation)(
                context, data.qpos[place]
            )
        mujoco.mj_forward(model, data)
        yield model, data, plant, context


def gravity(model, data):
    """Return the generalized forces of gravity, by Jacobians of the centres of mass."""
    forces = np.zeros(model.nv)
    for body in range(1, model.nbody):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
        forces += jacobian.T @ [0, 0, -9.81 * model.body_mass[body]]
    return forces


def test_an_arm_moves_as_in_mujoco(tmp_path, here):
    """Two joints a body, off its origin and with other zeros, a slide, rotors: masses and torques are MuJoCo's own."""
    robot = imported(tmp_path)

    assert list(robot.model.axes) == ["pan", "tilt", "stroke"]
    for model, data, plant, context in both(robot, tmp_path / "in" / "arm.xml"):
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        np.testing.assert_allclose(plant.CalcMassMatrix(context), mass, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            plant.CalcGravityGeneralizedForces(context), gravity(model, data), rtol=1e-6
        )
        com = model.body_mass @ data.xipos / model.body_mass.sum()
        np.testing.assert_allclose(plant.CalcCenterOfMassPositionInWorld(context), com, atol=1e-9)
        tool = (
            plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("slider"))
            @ plant.GetFrameByName("attachment_site").GetFixedPoseInBodyFrame().translation()
        )
        np.testing.assert_allclose(tool, data.site("attachment_site").xpos, atol=1e-12)
    assert plant.CalcTotalMass(context) == pytest.approx(model.body_mass.sum(), rel=1e-8)


def test_limits_motors_gains_and_home_are_those_of_the_file(tmp_path, here):
    robot = imported(tmp_path)

    model = robot.model
    lower, upper = model.axis_limits
    np.testing.assert_allclose(np.rad2deg([lower[0], upper[0]]), [-100, 120])
    assert (lower[2], upper[2]) == (-0.1, 0.2)
    assert np.isinf(upper[1])
    assert model.efforts[:2].tolist() == [50, 15]
    assert (model.servo.kp["pan"], model.servo.kd["pan"]) == (200, 10)
    assert model.home_deg == pytest.approx(
        {"pan": 28.6479, "tilt": -14.3239, "stroke": 0.1}, abs=1e-4
    )
    assert model.tools == {"attachment_site": "attachment_site"}
    assert "keyframe 'home': is the posture at the start" in told(robot, "read")
    assert "servo gains of 1 axis are those of the file's actuators" in told(robot, "read")

    dropped = told(robot, "dropped")
    assert "<sensor>: 1 ×" in dropped
    assert "1 planes: a station has a floor of its own" in dropped
    assert "moves by 2 joints (pan, tilt)" in told(robot, "repaired")


def test_meshes_stand_where_mujoco_puts_them(tmp_path, here):
    """MuJoCo moves each mesh into the frame of its inertia; here it stays in that of its file."""
    robot = imported(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "in" / "arm.xml"))

    link = robot.model.element.find("link[@name='upper']")

    assert link is not None
    assert (
        next(visual.find("material/color").get("rgba") for visual in link.iterfind("visual"))
        == "1 0 0 1"
    )

    shift = model.joint("tilt").pos  # the link's frame lies on its last joint
    for geom, visual in enumerate(link.iterfind("visual"), start=2):
        origin, file = visual.find("origin"), visual.find("geometry/mesh").get("filename")
        turn = trimesh.transformations.euler_matrix(*map(float, origin.get("rpy").split()))[:3, :3]
        shown = trimesh.load(robot.model.folder / file, process=False).vertices @ turn.T
        shown = shown + [float(word) for word in origin.get("xyz").split()] + shift
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        corners = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
        corners = corners @ matrix.reshape(3, 3).T + model.geom_pos[geom]
        distances = np.linalg.norm(shown[:, np.newaxis] - corners, axis=-1)
        assert distances.min(axis=1).max() < 1e-7
    # the second touches nothing
    assert [len(link.findall(tag)) for tag in ("visual", "collision")] == [
        2,
        1,
    ]

    slider = robot.model.element.find("link[@name='slider']")
    # its group is hidden
    assert [len(slider.findall(tag)) for tag in ("visual", "collision")] == [
        0,
        1,
    ]


def test_a_robot_that_floats_has_no_world(tmp_path, here):
    text = """<mujoco><worldbody><geom type="box" size="1 1 1" pos="0 0 -1"/>
      <body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/>
        <body name="leg" pos="0 0.1 0"><joint name="hip" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.3"/></body>
      </body>
      <body name="ball" pos="1 0 0"><freejoint/><geom type="sphere" size="0.1"/></body>
      <body name="table" pos="2 0 0"><geom type="box" size="0.1 0.1 0.1"/></body>
      <body name="hand" mocap="true"><geom type="sphere" size="0.1"/></body>
    </worldbody></mujoco>"""
    robot = imported(tmp_path, text)

    assert (robot.model.base, robot.model.root, list(robot.model.axes)) == (
        "floating",
        "trunk",
        ["hip"],
    )

    dropped = told(robot, "dropped")
    for words in (
        "'ball': is loose",
        "'table': stands in the world",
        "'hand': is moved by hand",
        "1 shapes of the world",
    ):
        assert words in dropped

    plant = plant_of(robot)
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(
        1000 * (0.2**3 + 4 / 3 * np.pi * 0.05**3)
    )


TWO = """<mujoco><worldbody>
  <body name="left" pos="1 0 0">{0}<joint name="a"/><geom size="0.1"/></body>
  <body name="right"><freejoint/><geom size="0.1"/>
    <body name="tip"><joint name="b"/><geom size="0.1" pos="1 0 0"/></body></body>
</worldbody></mujoco>"""


def test_one_of_several_robots_is_chosen_by_name(tmp_path, here):
    with pytest.raises(
        SimrobError, match=r"holds several robots \(left, right\); choose one with --model NAME"
    ):
        imported(tmp_path, TWO.format(""))
    assert list(imported(tmp_path, TWO.format(""), model="left").model.axes) == ["a"]
    with pytest.raises(SimrobError, match="did you mean 'right'"):
        imported(tmp_path, TWO.format(""), model="rigth")


def test_a_ball_is_three_joints(tmp_path, here):
    text = """<mujoco><worldbody><body name="b" pos="0 0 1"><joint name="ball" type="ball" pos="0 0 0.1"/>
      <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 -0.3"/></body></worldbody></mujoco>"""
    robot = imported(tmp_path, text)

    assert list(robot.model.axes) == ["ball_x", "ball_y", "ball_z"]
    assert "is a ball; three joints x, y, z" in told(robot, "approximated")

    plant, model = plant_of(robot), mujoco.MjModel.from_xml_path(str(tmp_path / "in" / "arm.xml"))
    context, data = plant.CreateDefaultContext(), mujoco.MjData(model)
    angles = [0.3, -0.5, 0.7]
    plant.SetPositions(context, angles)
    mujoco.mju_euler2Quat(data.qpos, angles, "xyz")

    mujoco.mj_forward(model, data)

    np.testing.assert_allclose(
        plant.CalcCenterOfMassPositionInWorld(context), data.xipos[1], atol=1e-9
    )


LOST = """<mujoco><worldbody><body name="a"><joint name="one" stiffness="3"/><geom size="0.1"/>
    <body name="b"><joint name="two"/><geom size="0.1" pos="1 0 0"/><site name="s"/><site name="t" pos="1 0 0"/></body>
    <body name="c" gravcomp="1"><joint name="three"/><geom size="0.1" pos="1 0 0"/></body></body></worldbody>
  <tendon><fixed name="pair"><joint joint="one" coef="1"/><joint joint="two" coef="-2"/></fixed>
    <spatial name="string"><site site="s"/><site site="t"/></spatial></tendon>
  <equality><joint joint1="two" joint2="one"/>{loop}<tendon name="held" tendon1="pair"/></equality>
  <actuator><motor name="puller" tendon="pair" forcerange="-3 3"/><motor name="thruster" site="s"/></actuator>
  <contact><exclude body1="b" body2="c"/></contact>
</mujoco>"""


def test_what_no_tree_of_motored_joints_can_say_is_told(tmp_path, here):
    robot = imported(tmp_path, LOST.format(loop=""))
    lost = told(robot, "lost")

    for words in (
        "joint 'one': a spring of 3",
        "tendon 'string': tendons are not simulated",
        "constraint 'held': is not simulated",
        "actuator 'thruster': drives no joint",
        "body 'c': gravcomp 1",
    ):
        assert words in lost
    assert "joint 'two': mimics 'one'" in told(robot, "read")
    assert "<contact>: 1 ×" in told(robot, "dropped")
    assert (
        "actuator 'puller': pulls at several joints by a tendon; each gets a motor: one, two"
        in told(robot, "approximated")
    )
    assert "joints 'three': passive: the file gives motors to other joints" in told(robot, "read")
    assert robot.model.efforts[:2].tolist() == [3, 6]


def test_a_closed_loop_is_refused_or_left_out(tmp_path, here):
    text = LOST.format(loop='<connect name="rod" body1="b" body2="c" anchor="0 0 0"/>')
    with pytest.raises(
        SimrobError, match=r"'rod of 'b' and 'c'': does not fit into a robot, .* --drop-loops"
    ):
        imported(tmp_path, text)
    assert "'rod of 'b' and 'c''" in told(imported(tmp_path, text, drop_loops=True), "lost")


def test_includes_are_put_in(tmp_path, here):
    whole = ET.fromstring(ARM)
    head, body = ET.Element("mujocoinclude"), ET.Element("mujocoinclude")
    head.extend([element for element in whole if element.tag in ("default", "asset", "compiler")])
    body.extend(list(whole.find("worldbody")))
    main = put(tmp_path, ARM)
    (main.parent / "common").mkdir()
    (main.parent / "common" / "head.xml").write_text(ET.tostring(head, encoding="unicode"))
    (main.parent / "common" / "body.xml").write_text(ET.tostring(body, encoding="unicode"))
    for element in [
        element for element in whole if element.tag in ("default", "asset", "compiler")
    ]:
        whole.remove(element)
    world = whole.find("worldbody")
    world[:] = [ET.Element("include", file="common/body.xml")]
    whole.insert(0, ET.Element("include", file="common/head.xml"))
    first = imported(tmp_path)
    main.write_text(ET.tostring(whole, encoding="unicode"))

    second = import_robot(main, tmp_path / "again", isolated=False)

    assert ET.tostring(first.model.element) == ET.tostring(second.model.element)


OUT = '<mujoco>{0}<worldbody><body name="a"><joint/><geom size="0.1"/></body></worldbody></mujoco>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (OUT.format('<include file="../secret.xml"/>'), "is outside the allowed folders"),
        (OUT.format('<include file="/etc/hostname"/>'), "is outside the allowed folders"),
        (OUT.format('<include file="arm.xml"/>'), "more than 100 files, or a file in itself"),
        (OUT.format('<include file="none.xml"/>'), "there is no such file"),
        ("<!DOCTYPE m [<!ENTITY a 'b'>]><mujoco/>", "declares a document type or entities"),
        (
            "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>",
            "MuJoCo cannot read it: .*mass",
        ),
        ("<mujoco><worldbody><geom/></worldbody></mujoco>", "MuJoCo cannot read it"),
        (
            '<mujoco><worldbody><body><geom size="1"/></body></worldbody></mujoco>',
            "has no joint that moves",
        ),
        ("<mujocoinclude/>", "a part of an MJCF file"),
        (
            '<mujoco><asset><model name="m" file="/etc/hostname"/></asset></mujoco>',
            "puts another model in",
        ),
    ],
)
def test_what_may_not_or_cannot_be_read_is_refused(tmp_path, here, text, words):
    (tmp_path / "secret.xml").write_text("<mujocoinclude/>")
    with pytest.raises(SimrobError, match=words) as problem:
        imported(tmp_path, text)
    assert "\n" not in str(problem.value)


def test_plugins_are_never_loaded_and_files_of_others_never_read(tmp_path, here):
    head = """<extension><plugin plugin="mujoco.pid"><instance name="p"/></plugin></extension>
      <asset><mesh name="m" file="../secret.stl"/><hfield name="h" file="/etc/hostname" size="1 1 1 1"/>
      <texture name="t" type="2d" file="/etc/hostname"/><material name="red" texture="t"/></asset>"""
    text = OUT.format(head).replace('<geom size="0.1"/>', '<geom size="0.1" material="red"/>')
    text = text.replace(
        "</worldbody>",
        '</worldbody><actuator><plugin plugin="mujoco.pid" instance="p"/></actuator>',
    )

    robot = imported(tmp_path, text)

    assert "plugins are never loaded" in told(robot, "dropped")

    (tmp_path / "secret.stl").write_bytes((tmp_path / "in" / "parts" / "wedge.stl").read_bytes())
    shown = text.replace(
        'material="red"/>', 'material="red"/><geom type="mesh" mesh="m" mass="0"/>'
    )

    with pytest.raises(SimrobError, match=r"secret.stl.* is outside the allowed folders"):
        import_robot(put(tmp_path, shown), tmp_path / "other", isolated=False)


def test_masses_are_made_of_meshes_where_the_file_has_none(tmp_path, here):
    body = '<body name="a"><joint name="j"/><geom type="mesh" mesh="wedge"/></body>'
    asset = '<asset><mesh name="wedge" file="parts/wedge.stl" scale="0.1 0.1 0.1"/></asset>'
    text = f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>"

    robot = imported(tmp_path, text)

    for model, data, plant, context in both(robot, tmp_path / "in" / "arm.xml", 2):
        np.testing.assert_allclose(plant.CalcTotalMass(context), 1000 * 7.5 * 0.1**3, rtol=1e-6)
        np.testing.assert_allclose(
            plant.CalcGravityGeneralizedForces(context), gravity(model, data), rtol=1e-6
        )

    robot = import_robot(
        put(tmp_path, text.replace("wedge.stl", "none.stl")), tmp_path / "without", isolated=False
    )
    assert "mesh 'wedge': cannot be read, and masses are made of it" in told(robot, "lost")


def test_includes_of_a_large_file_are_found_at_once(tmp_path):
    """Each element was looked at once for each other: a minute for 6000 bodies."""
    root = ET.fromstring(f"<mujoco>{'<body><geom/><geom/></body>' * 6000}</mujoco>")
    start = time.monotonic()

    reading._Source(root, MeshPlaces(tmp_path / "a.xml"), ImportReport(tmp_path)).put_in_includes(
        root
    )

    assert time.monotonic() - start < 5


def test_faces_with_four_corners_weigh_what_mujoco_makes_of_them(tmp_path, here):
    """Those that are not flat are parted along one diagonal or the other, which makes other bodies of them."""
    corners = [
        (x + 0.3 * y * z, y, z - 0.2 * x * y) for z in (0, 1) for y in (0, 1) for x in (0, 1)
    ]
    faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"]
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), *(f"f {face}" for face in faces)]
    body = '<body name="a"><joint name="j"/><geom type="mesh" mesh="brick"/></body>'
    asset = '<asset><mesh name="brick" file="parts/brick.OBJ" scale="0.1 0.1 0.1"/></asset>'
    file = put(tmp_path, f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>")

    (tmp_path / "in" / "parts" / "brick.OBJ").write_text("\n".join(lines))

    for model, data, plant, context in both(
        import_robot(file, tmp_path / "out", isolated=False), file, 1
    ):
        np.testing.assert_allclose(plant.CalcTotalMass(context), model.body_mass.sum(), rtol=1e-12)
        np.testing.assert_allclose(
            plant.CalcGravityGeneralizedForces(context), gravity(model, data), rtol=1e-12
        )


def test_what_makes_another_motion_is_told(tmp_path, here):
    lost = told(imported(tmp_path), "lost")

    assert not any(words in lost for words in ("gravity", "density", "sliding friction"))

    option = '<option gravity="0 0 -981" density="1.2" viscosity="0" wind="0 0 1"/>'
    muscle = '<muscle name="biceps" joint="pan" lengthrange="0 1"/></actuator>'
    shape = '<geom type="sphere" size="0.01" friction="0.6"/><joint name="pan"'

    text = ARM.replace("<worldbody>", f"{option}<worldbody>", 1).replace("</actuator>", muscle, 1)

    assert shape.partition("/>")[2] in text

    robot = imported(tmp_path, text.replace(shape.partition("/>")[2], shape, 1))
    lost = told(robot, "lost")

    assert "gravity 0 0 -981: a station has 9.81 m/s² downwards" in lost
    assert "density 1.2: air and water" in lost
    assert "wind 0 0 1: air and water" in lost
    assert "viscosity" not in lost
    assert "sliding friction of the shapes, 0.6 to 1: a station has its own" in lost
    assert "actuator 'biceps': has a force of its own law" in told(robot, "approximated")


def test_without_mujoco_the_way_to_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "find_spec", lambda _: None)
    with pytest.raises(SimrobError, match=r'needs the extra mujoco: pip install "mujoco'):
        imported(tmp_path)


def test_a_model_that_does_not_end_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "TIME_LIMIT", 0.05)
    file = put(tmp_path)
    with pytest.raises(
        SimrobError, match=r"MuJoCo cannot read it: the process does not end within 0.05 s"
    ):
        read_source(file, ImportReport(file))


def test_the_confined_process_says_the_same(tmp_path, here, monkeypatch):
    robot, report = imported(tmp_path).model.element, ImportReport(tmp_path)
    monkeypatch.undo()

    read = read_source(tmp_path / "in" / "arm.xml", report)

    assert [name_of(joint) for joint in read.iterfind("joint")] == [
        name_of(joint) for joint in robot.iterfind("joint")
    ]
    assert [mass_of(link) for link in read.iterfind("link")] == [
        mass_of(link) for link in robot.iterfind("link")
    ]
    if sys.platform == "linux":
        assert not any("without the protection" in entry.text for entry in report.entries)


def test_every_command_takes_it(tmp_path, here, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    file = put(tmp_path, OUT.format(""))

    shown = CliRunner().invoke(app, ["station", str(file), "--out", "arm.yaml"])

    assert shown.exit_code == 0, shown.output

    station = load_station("arm.yaml")
    assert station.robots["robot"].urdf == file

    shown = CliRunner().invoke(app, ["check", "arm.yaml"])
    assert shown.exit_code == 0, shown.output


@pytest.mark.parametrize(
    "counts",
    [["1000000000"], ["1000", "1000", "1000"], ["1e9"]],
    ids=["one", "nested", "with an exponent"],
)
def test_copies_without_measure_are_refused_before_they_are_made(tmp_path, counts):
    inner = '<geom type="sphere" size="0.1"/>'
    for count in counts:
        inner = f'<replicate count="{count}" euler="0 0 1">{inner}</replicate>'
    hinge = '<joint name="pan" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    body = f'<body name="base"><body name="arm">{hinge}{inner}</body></body>'
    file = tmp_path / "arm.xml"
    file.write_text(f'<mujoco model="arm"><worldbody>{body}</worldbody></mujoco>')

    began = time.process_time()

    with pytest.raises(
        SimrobError, match=f"more than {reading._MOST_COPIES} elements with all that is replicated"
    ):
        read_source(file, ImportReport(file), ImportOptions())
    assert time.process_time() - began < 2
