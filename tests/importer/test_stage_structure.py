"""Structure with one defect each: mended and told, or refused with the names of what is wrong."""

import xml.etree.ElementTree as ET

import pytest
from repair_stages import ARM, END, FLANGE, INERTIA, LIMIT, TIP, Repaired, joint, with_defect

from simrob_drake.base.errors import InvalidModel
from simrob_drake.importer.repairs.structure import repair_numbers
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import movable_joints, name_of, root_link

SHOULDER = '<joint name="shoulder" type="revolute">'
CONTROL = '<ros2_control name="c"><joint name="shoulder"/></ros2_control>'
BUSHING = "".join(
    f'<drake:bushing_{part} value="1 1 1"/>'
    for part in ("torque_stiffness", "torque_damping", "force_stiffness", "force_damping")
)


def test_a_clean_robot_is_left_as_it_is(tmp_path):
    done = Repaired(ARM, tmp_path)

    assert not done.report.has_changes
    assert [entry.kind for entry in done.report.entries] == ["read"]
    assert ET.tostring(done.robot) == ET.tostring(ET.fromstring(ARM))


MENDED = [
    pytest.param(
        '<robot name="arm">',
        "<robot>",
        "repaired",
        "named 'arm' after its file",
        id="robot without name",
    ),
    pytest.param(
        SHOULDER,
        SHOULDER.replace("shoulder", ""),
        "repaired",
        "joint 'base_to_upper'",
        id="joint no name",
    ),
    pytest.param(
        TIP,
        "<link/>",
        "repaired",
        "link 'tip': has no name in the file; joints refer",
        id="link without name",
    ),
    pytest.param(
        'link="tip"',
        'link=" tip "',
        "repaired",
        "link=' tip ' has blanks at its ends; written as 'tip'",
        id="blanks",
    ),
    pytest.param(
        'link="tip"',
        'link="Tip"',
        "repaired",
        "'Tip' is not a link; 'tip' is used, which differs in case only",
        id="case",
    ),
    pytest.param(TIP, TIP * 2, "dropped", "link 'tip': is defined twice", id="link twice"),
    pytest.param(
        TIP,
        f'{TIP}<link name="upper"/>',
        "dropped",
        "link 'upper': is defined twice",
        id="empty second link",
    ),
    pytest.param(
        FLANGE,
        FLANGE * 2,
        "dropped",
        "joint 'flange': is defined twice with the same content",
        id="joint twice",
    ),
    pytest.param(
        END,
        '<link name="t"/>' + joint("flange", "tip", "t") + END,
        "repaired",
        "joint 'flange_2': was a second",
        id="joints of one name",
    ),
    pytest.param(
        END,
        joint("more", "tip", "none") + END,
        "dropped",
        "joint 'more': its <child> 'none' is not a link",
        id="dangling child",
    ),
    pytest.param(
        FLANGE,
        "",
        "dropped",
        "link 'tip': no joint connects this link with the robot; left out",
        id="lone link",
    ),
    pytest.param(
        FLANGE,
        '<link name="b"/>' + joint("j", "tip", "b"),
        "dropped",
        "link 'tip': no joint connects this link with the robot; left out with b",
        id="lone tree that does not move",
    ),
    pytest.param(
        TIP,
        f'<link name="tip">{FLANGE}</link>',
        "repaired",
        "joint 'flange': was in a <link>; moved into <robot>",
        id="joint in a link",
    ),
    pytest.param(
        END,
        "<gazebo><plugin/></gazebo><gazebo/><ros2_control><joint name='shoulder'/></ros2_control>"
        + END,
        "dropped",
        "<gazebo> in <robot>: 2 ×",
        id="gazebo",
    ),
    pytest.param(
        LIMIT,
        LIMIT + "<safety_controller k_velocity='3'/>",
        "dropped",
        "<safety_controller> in",
        id="safety",
    ),
    pytest.param(
        LIMIT, LIMIT * 2, "dropped", "joint 'shoulder': a second <limit>", id="second limit"
    ),
    pytest.param(
        END, '<frame name="f" link="none"/>' + END, "dropped", "frame 'f'", id="frame of no link"
    ),
    pytest.param(
        END,
        '<frame name="tip" link="upper"/>' + END,
        "dropped",
        "frame 'tip'",
        id="frame named as a link",
    ),
    pytest.param(
        END,
        '<drake:collision_filter_group name="g"><drake:member link="tip"/></drake:collision_filter_group>'
        + END,
        "dropped",
        "collision filter group 'g'",
        id="group of a welded link",
    ),
    pytest.param(
        "<link ",
        "<drake:nothing/><link ",
        "dropped",
        "<drake:nothing> in <robot>",
        id="unknown of Drake",
    ),
]


@pytest.mark.parametrize(("good", "bad", "kind", "words"), MENDED)
def test_a_defect_is_mended_and_told(tmp_path, good, bad, kind, words):
    done = Repaired(with_defect(good, bad), tmp_path)
    assert any(words in text for text in done.told(kind)), done.report.entries
    assert done.plant.num_actuators() == 1


REFUSED = [
    pytest.param(
        '<parent link="base"/>',
        "",
        "joint 'shoulder': has no <parent>; without this joint",
        id="no parent",
    ),
    pytest.param(
        '<parent link="base"/>',
        '<parent link="bse"/>',
        "joint 'shoulder': its <parent> 'bse' is not a link; did you mean 'base'?; "
        "without this joint the links are not connected",
        id="unknown parent",
    ),
    pytest.param(
        END,
        joint("back", "tip", "base") + END,
        "has a kinematic loop: base - upper - tip - base",
        id="loop",
    ),
    pytest.param(
        END,
        joint("b", "base", "tip") + END,
        "is the child of two joints, 'flange' and 'b'",
        id="two parents",
    ),
    pytest.param(
        END,
        joint("self", "tip", "tip") + END,
        "joint 'self': connects link 'tip' to itself",
        id="self",
    ),
    pytest.param(
        END,
        '<link name="upper"><visual/></link>' + END,
        "link 'upper': is defined twice",
        id="different links",
    ),
    pytest.param(
        END,
        joint("shoulder", "base", "upper") + END,
        "joint 'shoulder': is defined twice with different",
        id="joints",
    ),
    pytest.param(
        END,
        '<link name="a"/><link name="b"/>' + joint("c", "a", "b", "continuous") + END,
        "has 2 root links (base, a)",
        id="two robots",
    ),
    pytest.param(
        END,
        '<loop_joint name="l"/>' + END,
        "<loop_joint> 'l': does not fit into a robot",
        id="loop joint",
    ),
    pytest.param(
        'name="tip"', 'name="${tip}"', 'name="${tip}" is an expression of xacro', id="leftover"
    ),
    pytest.param(
        'xyz="0 1 0"',
        'xyz="0 one 0"',
        "joint 'shoulder' <axis>: xyz=\"0 one 0\" is not 3",
        id="axis",
    ),
]


@pytest.mark.parametrize(("good", "bad", "words"), REFUSED)
def test_what_cannot_be_guessed_is_refused_in_one_line(tmp_path, good, bad, words):
    with pytest.raises(InvalidModel) as problem:
        Repaired(with_defect(good, bad), tmp_path)
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_robot_needs_a_link_and_a_joint_that_moves(tmp_path):
    with pytest.raises(InvalidModel, match="has no link"):
        Repaired("<robot name='a'/>", tmp_path)
    with pytest.raises(InvalidModel, match="has no joint that moves"):
        Repaired("<robot name='a'><link name='b'/></robot>", tmp_path)


def test_elements_of_drake_stay(tmp_path):
    group = (
        '<drake:collision_filter_group name="g"><drake:member link="upper"/>'
        '<drake:ignored_collision_filter_group name="g"/></drake:collision_filter_group>'
    )
    ends = '<drake:bushing_frameA name="tip"/><drake:bushing_frameC name="base"/>'
    bushing = f"<drake:linear_bushing_rpy>{ends}{BUSHING}</drake:linear_bushing_rpy>"

    done = Repaired(
        with_defect(END, f'<frame name="f" link="tip"/>{group}{bushing}{END}'), tmp_path
    )

    assert not done.report.has_changes
    assert done.plant.HasFrameNamed("f")
    assert done.plant.num_force_elements() == 2  # gravity is the other


def test_a_dropped_frame_leaves_its_name_to_another_one(tmp_path):
    done = Repaired(
        with_defect(END, f'<frame name="f" link="none"/><frame name="f" link="tip"/>{END}'),
        tmp_path,
    )
    assert len(done.told("dropped")) == 1
    assert done.plant.HasFrameNamed("f")


def test_a_world_link_becomes_a_root_of_another_name(tmp_path):
    text = with_defect(
        END,
        '<link name="world"/>'
        + joint("stand", "world", "base", inside='<origin xyz="1 2 3"/>')
        + END,
    )
    done = Repaired(text, tmp_path)

    assert root_link(done.robot) == "robot_world"
    assert any("had the name 'world'" in entry for entry in done.told("repaired"))
    assert done.base == "fixed"

    pose = done.plant.GetFrameByName("base").GetFixedPoseInBodyFrame()
    assert pose.translation().tolist() == [1, 2, 3]


def test_a_joint_from_drakes_world_gets_a_link_to_start_at(tmp_path):
    done = Repaired(with_defect(END, joint("stand", "world", "base") + END), tmp_path)

    assert root_link(done.robot) == "robot_world"
    assert any("a joint starts at 'world'" in entry for entry in done.told("repaired"))
    assert done.base == "fixed"


def test_a_link_called_world_in_the_middle_is_only_renamed(tmp_path):
    done = Repaired(ARM.replace('"upper"', '"world"'), tmp_path)
    assert [name_of(link) for link in done.robot.iterfind("link")] == ["base", "robot_world", "tip"]
    assert movable_joints(done.robot) == ["shoulder"]


@pytest.mark.parametrize("name", ["two words", "a/b", "a::b", "cañón", "1", "$", "a.b"])
def test_names_that_drake_takes_stay(tmp_path, name):
    done = Repaired(
        ARM.replace('"upper"', f'"{name}"').replace('"shoulder"', f'"{name}"'), tmp_path
    )
    assert not done.report.has_changes
    assert done.plant.HasJointNamed(name)


NUMBERS = [
    ('<origin xyz="1,5 0 0"/>', "1.5 0 0", "repaired"),
    ('<origin xyz="1, 2, 3"/>', "1 2 3", "repaired"),
    ('<origin xyz="1,2,3"/>', "1 2 3", "repaired"),
    ('<origin xyz="1,5; 2,5; 3"/>', "1.5 2.5 3", "repaired"),
    ('<origin xyz="[1 2 3]"/>', "1 2 3", "repaired"),
    ('<origin xyz="1.0f 2F 3"/>', "1.0 2 3", "repaired"),
    ('<origin xyz="1m 2m 3m"/>', "1 2 3", "repaired"),
    ('<origin xyz="\N{MINUS SIGN}1 0 0"/>', "-1 0 0", "repaired"),
    ('<origin xyz="1\N{NO-BREAK SPACE}0 0"/>', "1 0 0", "repaired"),
    ('<origin xyz="1e-40 0 0"/>', "0 0 0", "repaired"),
    ('<origin xyz="1 2"/>', "0 0 0", "defaulted"),
    ('<origin xyz="1 2 3 4"/>', "0 0 0", "defaulted"),
    ('<origin xyz=""/>', "0 0 0", "defaulted"),
    ('<origin xyz="0 nan 0"/>', "0 0 0", "defaulted"),
    ('<origin xyz="0 1e31 0"/>', "0 0 0", "defaulted"),
    ('<origin xyz="0 1_0 0"/>', "0 0 0", "defaulted"),
    ('<origin xyz="0 ٣ 0"/>', "0 0 0", "defaulted"),
    ('<dynamics damping="soft"/>', "0", "defaulted"),
    ('<limit lower="-inf"/>', None, "dropped"),
    ('<limit effort="strong"/>', None, "dropped"),
    ('<mass value="1.5kg"/>', "1.5", "repaired"),
    ('<mass value="heavy"/>', None, "dropped"),
    ('<mesh scale="0,001 0,001 0,001"/>', "0.001 0.001 0.001", "repaired"),
    ('<mesh scale="1,5"/>', "1.5", "repaired"),
    ('<color rgba="red"/>', None, "dropped"),
    ('<origin xyz=" 0  1e-3\n .5 "/>', " 0  1e-3  .5 ", None),
    ('<axis xyz="+1 -0. 1E2"/>', "+1 -0. 1E2", None),
    ('<color rgba="1 1 1"/>', "1 1 1", None),
]


@pytest.mark.parametrize(("text", "right", "kind"), NUMBERS)
def test_numbers_are_understood_or_counted_as_missing(tmp_path, text, right, kind):
    robot = ET.fromstring(f"<robot><link name='l'>{text}</link></robot>")
    report = ImportReport(tmp_path / "a.urdf")

    repair_numbers(robot, report)

    values = list(robot[0][0].attrib.values())
    assert values == ([] if right is None else [right])
    assert [entry.kind for entry in report.entries] == ([] if kind is None else [kind])


def test_one_unreadable_moment_makes_all_of_them_missing(tmp_path):
    robot = ET.fromstring(f"<robot><link name='l'>{INERTIA.replace('0.01', 'x', 1)}</link></robot>")
    report = ImportReport(tmp_path / "a.urdf")

    repair_numbers(robot, report)

    assert robot[0][0].attrib == {}
    assert [entry.text for entry in report.entries] == [
        'ixx="x" is not a finite number; the moments count as missing'
    ]


def test_a_closing_joint_is_left_out_where_that_is_asked_for(tmp_path):
    text = with_defect(END, '<loop_joint name="l"/>' + END)
    done = Repaired(text, tmp_path, ImportOptions(drop_loops=True))

    assert any("<loop_joint> 'l'" in line and "left out" in line for line in done.told("lost"))
    with pytest.raises(InvalidModel, match="--drop-loops"):
        Repaired(text, tmp_path)
