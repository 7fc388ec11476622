"""Every movable joint has one motor, strong and fast enough to move what hangs on it."""

import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from repair_stages import ARM, DRIVE, END, INERTIA, LIMIT, Repaired, joint, with_defect

from simrob_drake.importer.repairs.drives import _loads
from simrob_drake.robots.imports import ImportOptions

HAND = f'<link name="hand"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>{INERTIA}</inertial></link>'
ELBOW = joint(
    "elbow", "tip", "hand", "revolute", f'<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>{LIMIT}'
)
TWO = with_defect(END, f"{HAND}{ELBOW}{END}")  # tip lies 0.3 m above the shoulder
G = 9.80665


def drive(
    *joints: str, kind: str = "<type>SimpleTransmission</type>", name: str = "d", gears: str = ""
) -> str:
    inside = "".join(
        f'<joint name="{joint}"/><actuator name="{joint}_m">{gears}</actuator>' for joint in joints
    )
    return f'<transmission name="{name}">{kind}{inside}</transmission>'


DRIVEN = TWO.replace(END, f"{drive('elbow')}{END}")  # both joints have a motor

ROS2 = "<plugin>transmission_interface/SimpleTransmission</plugin>"
DRIVES = [
    pytest.param(
        "",
        "defaulted",
        "joints 'shoulder', 'elbow': no transmission drives these joints",
        id="none",
    ),
    pytest.param(
        drive("shoulder", "elbow"),
        "repaired",
        "drives 2 joints; each gets a motor of its own",
        id="both",
    ),
    pytest.param(
        DRIVE * 2 + drive("elbow"),
        "dropped",
        "'drive': 'shoulder': another transmission drives this already",
        id="twice",
    ),
    pytest.param(
        DRIVE + drive("elbow", kind=ROS2),
        "repaired",
        "does not have the form that Drake reads; replaced by Simple",
        id="ROS 2",
    ),
    pytest.param(DRIVE + drive("elbow", kind=""), "repaired", "has no type", id="no type"),
    pytest.param(
        DRIVE + drive("elbow", kind="<type>FourBarLinkageTransmission</type>"),
        "repaired",
        "has the type 'FourBarLinkageTransmission', which Drake does not simulate; replaced by Simple",
        id="four bars",
    ),
    pytest.param(
        drive("shoulder", "elbow", kind="<type>DifferentialTransmission</type>"),
        "repaired",
        "drives 2 joints; each gets a motor of its own: SimpleTransmission of 'shoulder', 'elbow'",
        id="differential",
    ),
    pytest.param(
        DRIVE + drive("elbow") + drive("flange"),
        "dropped",
        "'flange': this is not a joint that moves",
        id="fixed joint",
    ),
    pytest.param(
        DRIVE + drive("elbow") + drive("none"),
        "dropped",
        "'none': this is not a joint",
        id="no such joint",
    ),
    pytest.param(DRIVE + drive("elbow") + drive(), "dropped", "drives no joint", id="no joint"),
    pytest.param(
        DRIVE + drive("elbow").replace("elbow_m", "motor"),
        "repaired",
        "a second motor has the name 'motor'",
        id="motors",
    ),
    pytest.param(
        DRIVE + drive("elbow").replace("elbow_m", ""),
        "repaired",
        "the form that Drake reads",
        id="nameless",
    ),
    pytest.param(
        DRIVE + drive("elbow", gears='<drake:gear_ratio value="0"/>'),
        "dropped",
        "its <gear_ratio> is not a number",
        id="gear 0",
    ),
    pytest.param(
        DRIVE + drive("elbow", gears="<mechanicalReduction>?</mechanicalReduction>"),
        "dropped",
        "its <mechanicalReduction> is not a number",
        id="reduction",
    ),
]


@pytest.mark.parametrize(("drives", "kind", "words"), DRIVES)
def test_every_joint_gets_one_motor(tmp_path, drives, kind, words):
    done = Repaired(with_defect(DRIVE, drives, TWO), tmp_path)

    assert any(words in line for line in done.told(kind)), done.report.entries

    motors = [
        done.plant.get_joint_actuator(index) for index in done.plant.GetJointActuatorIndices()
    ]
    assert sorted(motor.joint().name() for motor in motors) == ["elbow", "shoulder"]


def test_gears_stay(tmp_path):
    gears = (
        '<drake:gear_ratio value="100"/><drake:rotor_inertia value="1e-4"/>'
        "<mechanicalReduction>1</mechanicalReduction>"
    )
    for kind, changed in (("<type>SimpleTransmission</type>", False), ("", True)):
        text = with_defect(DRIVE, drive("shoulder", kind=kind, gears=gears))
        done = Repaired(text, tmp_path)
        motor = done.plant.GetJointActuatorByName("shoulder_m")
        assert motor.default_gear_ratio() == 100
        assert motor.default_rotor_inertia() == 1e-4
        assert done.report.has_changes is changed


def effort(done: Repaired, name: str) -> float:
    motors = [
        done.plant.get_joint_actuator(index) for index in done.plant.GetJointActuatorIndices()
    ]
    return next(motor.effort_limit() for motor in motors if motor.joint().name() == name)


@pytest.mark.parametrize("bad", ['effort="0"', "", 'effort="-5"', 'effort="nan"'])
def test_a_missing_effort_holds_three_times_what_hangs_on_the_joint(tmp_path, bad):
    done = Repaired(DRIVEN.replace('effort="10"', bad), tmp_path)

    shoulder = 3 * G * (1 * 0.1 + 2 * (0.3 + 0.1 + 0.2))  # by hand: both masses, stretched out
    assert effort(done, "shoulder") == pytest.approx(39)
    assert shoulder == pytest.approx(38.2, abs=0.1)
    assert effort(done, "elbow") == 12  # 3 · g · 2 kg · 0.2 m = 11.8 N·m
    assert any(
        "<limit>: " in line and "; set to 39 N·m, estimated from its load" in line
        for line in done.told("defaulted")
    )


def test_a_light_wrist_is_not_a_toy_beside_a_strong_shoulder(tmp_path):
    text = with_defect('effort="10"', 'effort="500"', DRIVEN).replace(
        ELBOW, ELBOW.replace('effort="10"', "")
    )
    done = Repaired(text, tmp_path)

    assert effort(done, "shoulder") == 500
    assert effort(done, "elbow") == 50

    limitless = Repaired(text.replace('effort="500"', 'effort="1e9"'), tmp_path)
    assert effort(limitless, "shoulder") == 1e9
    assert effort(limitless, "elbow") == 12


def test_the_least_efforts_and_those_without_masses(tmp_path):
    light = (
        DRIVEN.replace('"10"', '"0"')
        .replace('mass value="2"', 'mass value="1e-6"')
        .replace('"1"/>', '"1e-6"/>')
    )
    light = light.replace('"0.01"', '"1e-9"')

    assert effort(Repaired(light, tmp_path), "elbow") == 1

    slide = light.replace('type="revolute"', 'type="prismatic"')
    assert effort(Repaired(slide, tmp_path), "elbow") == 10

    start, end = ARM.index("<inertial>"), ARM.index("</inertial>") + len("</inertial>")
    bare = (ARM[:start] + ARM[end:]).replace('effort="10"', 'effort="0"')

    guessed = Repaired(bare, tmp_path)

    assert effort(guessed, "shoulder") == 10
    assert any(
        line.endswith("10 N·m, a guess, as no mass is given") for line in guessed.told("defaulted")
    )


def test_a_prismatic_joint_lifts_three_times_what_hangs_on_it(tmp_path):
    done = Repaired(
        DRIVEN.replace('type="revolute"', 'type="prismatic"').replace('effort="10"', ""), tmp_path
    )
    assert effort(done, "shoulder") == 89  # 3 · g · 3 kg = 88.3 N
    assert effort(done, "elbow") == 59


def test_the_legs_of_a_floating_robot_can_carry_it(tmp_path):
    limit = '<limit lower="-1" upper="1" velocity="1"/>'
    parts = ['<link name="trunk">', HAND.partition(">")[2].replace('"2"', '"30"')]
    for side in "lr":
        names = ["trunk", *(f"{side}{number}" for number in (1, 2, 3))]
        for parent, child in pairwise(names):
            inside = f'<origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/>{limit}'
            parts += [
                HAND.replace("hand", child),
                joint(f"j_{child}", parent, child, "revolute", inside),
            ]
    walker = f'<robot name="walker">{"".join(parts)}</robot>'

    done = Repaired(walker, tmp_path)

    assert done.base == "floating"
    hip = G * (30 + 3 * 2) * (0.2 + 0.2 + 0.2)  # all but the leg itself, at the end of the leg
    assert hip <= effort(done, "j_l1") <= 1.1 * hip

    held = Repaired(walker, tmp_path, ImportOptions(base="fixed"))
    leg = 3 * G * 2 * (0.2 + 0.4 + 0.6)  # three times the leg alone
    assert leg <= effort(held, "j_l1") <= 1.1 * leg


@pytest.mark.parametrize("bad", ['velocity="0"', "", 'velocity="-1"'])
def test_a_missing_velocity_is_a_half_turn_or_a_metre_a_second(tmp_path, bad):
    turning = Repaired(with_defect('velocity="3"', bad), tmp_path)

    assert turning.plant.GetJointByName("shoulder").velocity_upper_limits() == pytest.approx(
        [np.pi]
    )
    assert any(
        "'shoulder' <limit>: no velocity above 0; set to 3.142 rad/s" in line
        for line in turning.told("defaulted")
    )

    sliding = Repaired(with_defect('velocity="3"', bad).replace("revolute", "prismatic"), tmp_path)
    assert sliding.plant.GetJointByName("shoulder").velocity_upper_limits() == [1.0]


ARMATURE = 3.0  # kg m²
ACCELERATION = 10.0  # rad/s², which the estimate states


def test_an_estimated_motor_moves_its_own_armature(tmp_path):
    """Gravity once, and ten rad/s² of rotor and load: the elbow carries 2 kg at 0.2 m and a hand's own inertia."""
    gears = f'<drake:rotor_inertia value="{ARMATURE / 100}"/><drake:gear_ratio value="10"/>'
    text = with_defect(DRIVE, drive("elbow", gears=gears), TWO).replace(
        ELBOW, ELBOW.replace('effort="10"', "")
    )

    done = Repaired(text, tmp_path)

    needed = G * 2 * 0.2 + (ARMATURE + 2 * 0.2**2) * ACCELERATION
    assert needed <= effort(done, "elbow") <= 1.15 * needed
    assert any("its rotor inertia of 3" in line for line in done.told("defaulted"))


def test_a_sliding_motor_moves_its_own_armature(tmp_path):
    gears = '<drake:rotor_inertia value="40"/><drake:gear_ratio value="1"/>'
    text = with_defect(DRIVE, drive("elbow", gears=gears), TWO).replace(
        'type="revolute"', 'type="prismatic"'
    )

    done = Repaired(text.replace('effort="10"', ""), tmp_path)

    needed = G * 2 + (40 + 2) * 5
    assert needed <= effort(done, "elbow") <= 1.1 * needed


def passive_joints(done: Repaired) -> list[str]:
    """Names of the joints that have no motor, after a check that Drake agrees."""
    driven = {
        done.plant.get_joint_actuator(index).joint().name()
        for index in done.plant.GetJointActuatorIndices()
    }
    idle = [name for name in ("shoulder", "elbow") if name not in driven]
    if idle:
        names = "', '".join(idle)
        assert any(line.startswith(f"joints '{names}': passive: ") for line in done.told("read"))
    return idle


ZERO = LIMIT.replace('"10"', '"0"')
NO_EFFORT = LIMIT.replace(' effort="10"', "")
BOTH_DRIVES = DRIVE + drive("elbow")
PASSIVE = [  # transmissions, limits of shoulder and elbow, and the joints that have no motor by them
    pytest.param(DRIVE, LIMIT, LIMIT, ["elbow"], id="no transmission of one"),
    pytest.param(DRIVE, NO_EFFORT, LIMIT, ["elbow"], id="driven without effort"),
    pytest.param(DRIVE, ZERO, LIMIT, ["elbow"], id="driven with effort 0"),
    pytest.param("", LIMIT, ZERO, ["elbow"], id="effort 0 of one"),
    pytest.param(BOTH_DRIVES, ZERO, LIMIT, ["shoulder"], id="effort 0 with a transmission"),
    pytest.param(
        BOTH_DRIVES, NO_EFFORT, ZERO, ["elbow"], id="effort 0 beside a motor without effort"
    ),
    pytest.param(drive("none"), LIMIT, LIMIT, [], id="transmission of no joint"),
    pytest.param("", LIMIT, NO_EFFORT, [], id="effort missing"),
    pytest.param("", ZERO, ZERO, [], id="all efforts 0"),
    pytest.param("", ZERO, NO_EFFORT, [], id="efforts 0 or missing"),
    pytest.param(BOTH_DRIVES, ZERO, ZERO, [], id="all efforts 0 with transmissions"),
    pytest.param("", LIMIT, LIMIT.replace('"10"', '"-5"'), [], id="negative effort"),
]


@pytest.mark.parametrize(("drives", "shoulder", "elbow", "expected"), PASSIVE)
def test_joints_without_a_motor_beside_others_with_one_are_passive(
    tmp_path, drives, shoulder, elbow, expected
):
    text = (
        TWO.replace(ELBOW, ELBOW.replace(LIMIT, elbow))
        .replace(LIMIT, shoulder, 1)
        .replace(DRIVE, drives)
    )
    assert passive_joints(Repaired(text, tmp_path)) == expected


def test_a_follower_keeps_its_motor(tmp_path):
    follower = ELBOW.replace("</joint>", '<mimic joint="shoulder"/></joint>')
    assert passive_joints(Repaired(TWO.replace(ELBOW, follower), tmp_path)) == []


def test_a_passive_joint_gets_no_speed_limit(tmp_path):
    done = Repaired(TWO.replace(ELBOW, ELBOW.replace('velocity="3"', 'velocity="0"')), tmp_path)
    assert np.isinf(done.plant.GetJointByName("elbow").velocity_upper_limits()).all()


def test_the_load_on_a_joint_is_that_of_the_stretched_arm_behind_it():
    """Three links whose origins are 1 m and 0.8 m apart, against sums over their centres of mass."""
    masses = np.array([2.0, 3.0, 1.0])  # kg
    centres = np.array([0.5, -0.4, 0.3])  # m, along x of each link: a sense does not matter
    lengths = np.array([1.0, 0.8])  # m, from the origin of each link to that of the next one
    own = 0.01  # kg m², of each link about its centre of mass
    links = "".join(
        f'<link name="link_{number}"><inertial><origin xyz="{centre} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{own}" iyy="{own}" izz="{own}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for number, (mass, centre) in enumerate(zip(masses, centres, strict=True))
    )
    joints = "".join(
        f'<joint name="joint_{number}" type="revolute"><origin xyz="{length} 0 0"/>'
        f'<parent link="link_{number}"/><child link="link_{number + 1}"/></joint>'
        for number, length in enumerate(lengths)
    )

    loads = _loads(ET.fromstring(f'<robot name="arm">{links}{joints}</robot>'))

    for number in range(3):
        origins = np.append(0.0, np.cumsum(lengths[number:]))
        distances = origins + np.abs(centres[number:])
        behind = masses[number:]
        load = loads[f"link_{number}"]
        assert load.mass == pytest.approx(behind.sum())
        assert load.moment == pytest.approx(behind @ distances)
        assert load.inertia == pytest.approx(behind @ distances**2 + own * len(behind))
        assert load.reach == pytest.approx(distances.max())
