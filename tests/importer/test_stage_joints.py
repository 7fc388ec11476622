"""Joints with one defect each: what Drake moves afterwards is what the file means, and every change is told."""

import numpy as np
import pytest
from repair_stages import ARM, DRIVE, END, LIMIT, TIP, Repaired, joint, with_defect

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.messages import in_language
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.urdf import root_link

REVOLUTE = 'type="revolute"'
DYNAMICS = '<dynamics damping="0.1"/>'
INF = np.inf


def limit(lower: object, upper: object) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="10" velocity="3"/>'


RANGES = [
    pytest.param("revolute", LIMIT, (-1, 2), None, "", id="clean"),
    pytest.param(
        "revolute",
        "",
        (-INF, INF),
        "defaulted",
        "no limits; without a range the joint becomes continuous",
        id="no limit",
    ),
    pytest.param(
        "revolute",
        '<limit effort="10" velocity="3"/>',
        (-INF, INF),
        "defaulted",
        "without a range the joint becomes continuous",
        id="no range",
    ),
    pytest.param(
        "revolute",
        limit(0, 0),
        (-INF, INF),
        "defaulted",
        "lower 0, upper 0; without a range",
        id="both zero",
    ),
    pytest.param(
        "revolute", limit("-inf", "inf"), (-INF, INF), "defaulted", "no limits", id="infinite"
    ),
    pytest.param(
        "revolute", limit("nan", 2), (0, 2), "defaulted", "has no lower; 0 is used", id="nan"
    ),
    pytest.param(
        "revolute",
        limit(2, -1),
        (-1, 2),
        "repaired",
        "lower 2 is above upper -1; exchanged",
        id="swapped",
    ),
    pytest.param(
        "revolute",
        limit("-3,14", "3,14"),
        (-3.14, 3.14),
        "repaired",
        'written as "-3.14"',
        id="commas",
    ),
    pytest.param(
        "revolute",
        limit(-1e16, 1e16),
        (-INF, INF),
        "repaired",
        "do not restrict the motion; the joint becomes continuous",
        id="endless",
    ),
    pytest.param(
        "revolute", limit(-170, 170), (-170, 170), "read", "were degrees meant?", id="degrees"
    ),
    pytest.param(
        "continuous",
        '<limit effort="9"/>',
        (-INF, INF),
        "defaulted",
        "3.142 rad/s",
        id="continuous",
    ),
    pytest.param(
        "continuous", limit(-1, 2), (-1, 2), "read", "of this continuous joint apply", id="both"
    ),
    pytest.param(
        "continuous",
        limit(0, 0),
        (-INF, INF),
        "dropped",
        "is not a range; a continuous",
        id="continuous zero",
    ),
    pytest.param(
        "continuous",
        '<limit upper="1"/>',
        (-INF, INF),
        "dropped",
        "lower missing, upper 1",
        id="half",
    ),
    pytest.param(
        "prismatic",
        limit(0, 0),
        (-1, 1),
        "defaulted",
        "set to ±1 m, as a prismatic joint needs a range",
        id="slide",
    ),
    pytest.param("prismatic", limit(0, 500), (0, 500), None, "", id="long slide"),
]


@pytest.mark.parametrize(("kind", "text", "expected", "told", "words"), RANGES)
def test_the_range_of_a_joint_is_what_the_file_means(tmp_path, kind, text, expected, told, words):
    done = Repaired(with_defect(LIMIT, text).replace(REVOLUTE, f'type="{kind}"'), tmp_path)
    moved = done.plant.GetJointByName("shoulder")

    assert (moved.position_lower_limits()[0], moved.position_upper_limits()[0]) == expected
    if told is None:
        assert not done.report.has_changes
    else:
        assert any(words in line for line in done.told(told)), done.report.entries


@pytest.mark.parametrize(("height", "suspected"), [(2.5, False), (250, True)])
def test_a_robot_in_millimetres_is_told(tmp_path, height, suspected):
    elbow = joint("elbow", "tip", "hand", "fixed", f'<origin xyz="0 0 {height}"/>')
    done = Repaired(with_defect(END, f'<link name="hand"/>{elbow}{END}'), tmp_path)
    assert (
        any(
            "is 250 m from the joint before it; were millimetres" in line
            for line in done.told("read")
        )
        is suspected
    )


@pytest.mark.parametrize(
    ("kind", "axis"), [("revolute", "0 1 0"), ("revolute", "1 2 3"), ("prismatic", "0 0 2")]
)
def test_a_joint_of_equal_limits_is_fixed_there(tmp_path, kind, axis):
    elbow = joint(
        "elbow",
        "tip",
        "hand",
        kind,
        f'<origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/>{{}}',
    )
    text = with_defect(END, f'<link name="hand"/>{elbow}{END}')
    free, held = (Repaired(text.format(limit(*ends)), tmp_path) for ends in ((-1, 1), (0.5, 0.5)))
    context = free.plant.CreateDefaultContext()
    positions = free.plant.GetPositions(context)
    positions[free.plant.GetJointByName("elbow").position_start()] = 0.5
    free.plant.SetPositions(context, positions)

    expected, found = (
        done.plant.CalcRelativeTransform(
            place, done.plant.GetFrameByName("base"), done.plant.GetFrameByName("hand")
        )
        for done, place in ((free, context), (held, held.plant.CreateDefaultContext()))
    )

    assert found.IsNearlyEqualTo(expected, 1e-12)
    assert not held.plant.HasJointNamed("elbow")
    assert any("are both 0.5, so the joint cannot move" in line for line in held.told("repaired"))


@pytest.mark.parametrize(
    ("good", "bad", "kind", "words"),
    [
        pytest.param(
            REVOLUTE,
            'type="Revolute "',
            "repaired",
            "has the type 'Revolute '; revolute is used",
            id="capital",
        ),
        pytest.param(
            REVOLUTE,
            'type="continous"',
            "repaired",
            "has the type 'continous'; continuous is used",
            id="typo",
        ),
        pytest.param(
            '<axis xyz="0 1 0"/>',
            "",
            "defaulted",
            "has no axis; 1 0 0 is used, the format's default",
            id="no axis",
        ),
        pytest.param('xyz="0 1 0"', "", "defaulted", "has no axis; 1 0 0", id="axis without xyz"),
        pytest.param(
            'xyz="0 1 0"',
            'xyz="1 1 0"',
            "repaired",
            '"1 1 0" has the length 1.414; normalized to "0.70710678',
            id="not unit",
        ),
        pytest.param(
            '"0.1"',
            '"-0.1"',
            "repaired",
            "<dynamics>: damping -0.1 is negative; set to 0",
            id="damping",
        ),
        pytest.param(
            '"0.1"',
            '"0.1" friction="-2"',
            "repaired",
            "friction -2 is negative; set to 0",
            id="friction",
        ),
        pytest.param(
            '"0.1"', '"0.1" friction="2"', "lost", "friction 2 is not imported", id="lost"
        ),
        pytest.param(
            LIMIT,
            f'{LIMIT}<mimic joint="x"/>',
            "lost",
            "mimics 'x', which is no joint; known: ",
            id="mimic",
        ),
        pytest.param(
            '<child link="tip"/>',
            '<child link="tip"/><mimic joint="x"/>',
            "dropped",
            "mimics 'x', but is fixed",
            id="mimic of a fixed joint",
        ),
        pytest.param(
            'velocity="3"',
            'velocity="3" drake:acceleration="0"',
            "dropped",
            "acceleration 0 is not positive",
            id="acceleration",
        ),
    ],
)
def test_a_defect_of_a_joint_is_mended_and_told(tmp_path, good, bad, kind, words):
    done = Repaired(with_defect(good, bad), tmp_path)
    assert any(words in line for line in done.told(kind)), done.report.entries
    assert done.plant.num_actuators() == 1


def test_rounded_axes_stay_as_they_are(tmp_path):
    done = Repaired(with_defect('xyz="0 1 0"', 'xyz="0.7071 0.7071 0"'), tmp_path)
    assert not done.report.has_changes
    np.testing.assert_allclose(
        done.plant.GetJointByName("shoulder").revolute_axis(), [0.5**0.5, 0.5**0.5, 0]
    )


def test_friction_becomes_damping_where_chosen(tmp_path):
    text = with_defect(DYNAMICS, '<dynamics damping="0.1" friction="0.25"/>')
    done = Repaired(text, tmp_path, ImportOptions(friction_as_damping=True))

    assert done.plant.GetJointByName("shoulder").default_damping() == pytest.approx(0.35)
    assert any(
        "friction 0.25 is added to damping 0.1, which becomes 0.35" in line
        for line in done.told("repaired")
    )


def test_a_mimic_joint_gets_a_motor_of_its_own(tmp_path):
    finger = joint(
        "finger", "tip", "hand", "revolute", f'<axis xyz="0 1 0"/>{LIMIT}<mimic joint="shoulder"/>'
    )
    done = Repaired(with_defect(END, f'<link name="hand"/>{finger}{END}'), tmp_path)

    assert done.plant.num_actuators() == 2
    assert any(
        "mimics 'shoulder' with a multiplier of 1 and an offset of 0; stations couple" in line
        for line in done.told("read")
    )


@pytest.mark.parametrize(
    "mimic", ['<mimic joint="shoulder" multiplier="0"/>', '<mimic joint="clamp"/>']
)
def test_a_joint_that_follows_nothing_that_moves_is_fixed_and_not_coupled(tmp_path, mimic):
    clamp = '<link name="plate"/>' + joint("clamp", "tip", "plate", "fixed")
    finger = joint("finger", "tip", "hand", "revolute", f'<axis xyz="0 1 0"/>{LIMIT}{mimic}')

    done = Repaired(with_defect(END, f'{clamp}<link name="hand"/>{finger}{END}'), tmp_path)

    assert done.plant.num_actuators() == 1
    assert any("joint 'finger'" in line and "fixed at 0" in line for line in done.told("repaired"))
    assert not any("couple" in line for line in done.told("read"))


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            REVOLUTE,
            'type="ball"',
            "joint 'shoulder': has the type 'ball'; the joints of a robot have",
        ),
        (REVOLUTE, 'type="revolute2"', "has the type 'revolute2'"),
        (REVOLUTE, "", "joint 'shoulder': has no type"),
        (
            REVOLUTE,
            'type="planar"',
            "has the type planar, which no motor can drive; write two prismatic joints",
        ),
        (
            REVOLUTE,
            'type="floating"',
            "has the type floating, which no motor can drive; only the root",
        ),
        ('xyz="0 1 0"', 'xyz="0 0 0"', "joint 'shoulder' <axis>: xyz=\"0 0 0\" has no direction"),
        (LIMIT, limit(1, 1), "has no joint that moves"),
    ],
)
def test_what_no_motor_can_drive_is_refused(tmp_path, good, bad, words):
    with pytest.raises(InvalidModel) as problem:
        Repaired(with_defect(good, bad), tmp_path)
    assert words in str(problem.value)


def test_a_floating_joint_at_an_empty_root_is_a_floating_base(tmp_path):
    text = with_defect(
        END, '<link name="odom"/>' + joint("float", "odom", "base", "floating") + END
    )
    done = Repaired(text, tmp_path)

    assert done.base == "floating"
    assert root_link(done.robot) == "base"
    assert any("floats at the empty root 'odom'" in line for line in done.told("repaired"))
    assert any(
        "floating base: the file has a floating joint at the root; if this is wrong, choose --base fixed"
        in line
        for line in done.told("read")
    )
    assert list(done.robot.attrib) == ["name"]


def test_a_floating_joint_elsewhere_is_refused(tmp_path):
    text = with_defect(TIP, f'{TIP}<link name="ball"/>')
    with pytest.raises(InvalidModel, match="joint 'float': has the type floating"):
        Repaired(with_defect(END, joint("float", "tip", "ball", "floating") + END, text), tmp_path)


def test_the_drive_stays_where_the_joint_does(tmp_path):
    done = Repaired(ARM, tmp_path)
    assert [drive.get("name") for drive in done.robot.iterfind("transmission")] == ["drive"]
    assert DRIVE in ARM


def test_a_missing_limit_is_described_in_each_language(tmp_path):
    text = with_defect(LIMIT, '<limit effort="9" upper="1"/>').replace(
        REVOLUTE, 'type="continuous"'
    )

    done = Repaired(text, tmp_path)

    [entry] = done.report.of("dropped")
    assert entry.text.startswith("lower missing, upper 1 is not a range")
    assert in_language(entry.text, "es").startswith("mínimo ausente, máximo 1 no es un recorrido")
