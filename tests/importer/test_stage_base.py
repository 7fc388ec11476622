"""Fixed or floating: by choice, by what the file says, and by the shape of the robot."""

import xml.etree.ElementTree as ET

import pytest
from repair_stages import joint

from simrob_drake.base.messages import in_language
from simrob_drake.importer.repairs.base import choose_base
from simrob_drake.robots.imports import ImportOptions, ImportReport


def robot(branches: list[list[str]], root: str = "body", foot: str = "") -> ET.Element:
    """Return a robot whose branches are lists of joint types; they start at a plate fixed to the root."""
    parts = [
        f'<link name="{root}">{foot}</link>',
        '<link name="plate"/>',
        joint("plate", root, "plate"),
    ]
    for number, kinds in enumerate(branches):
        names = ["plate", *(f"l{number}{step}" for step in range(len(kinds)))]
        for parent, child, kind in zip(names[:-1], names[1:], kinds, strict=True):
            parts += [f'<link name="{child}"/>', joint(f"j{child}", parent, child, kind)]
    return ET.fromstring(f"<robot name='r'>{''.join(parts)}</robot>")


LEG = ["revolute", "continuous", "revolute"]
WHEEL = ["continuous"]


@pytest.mark.parametrize(
    ("element", "base", "reason"),
    [
        (robot([LEG * 2]), "fixed", "no pair of legs and no wheels"),
        (robot([LEG, LEG]), "floating", "2 branches of 3 or more joints start at the root link"),
        (robot([LEG, LEG[:2]]), "fixed", "no pair of legs"),
        (robot([LEG, ["fixed", *LEG]]), "floating", "2 branches"),
        (robot([LEG, ["revolute", "fixed", "fixed"]]), "fixed", "no pair of legs"),
        (
            robot([WHEEL] * 4),
            "floating",
            "4 continuous joints start at the root link, as wheels do",
        ),
        (robot([WHEEL, WHEEL, ["continuous", "continuous"]]), "floating", "3 continuous joints"),
        (robot([WHEEL] * 2), "fixed", "no wheels"),
        (robot([LEG, LEG], root="robot_world"), "fixed", "the root link is the world"),
        (robot([LEG, LEG], root="world_link"), "fixed", "the root link is the world"),
        (robot([LEG, LEG], root="underworld"), "floating", "2 branches"),
    ],
)
def test_the_base_is_found_and_the_reason_told(tmp_path, element, base, reason):
    report = ImportReport(tmp_path / "a.urdf")

    assert choose_base(element, ImportOptions(), report) == base
    [entry] = report.entries
    assert entry.kind == "read"
    assert entry.text.startswith(f"{base} base: ")
    assert reason in entry.text
    assert entry.text.endswith(f"choose --base {'floating' if base == 'fixed' else 'fixed'}")


@pytest.mark.parametrize(
    ("branches", "way", "base"),
    [
        (2, "0 0 -0.3", "floating"),  # legs
        (2, "0.1 0 -0.3", "floating"),
        (2, "0 0 0.3", "fixed"),  # two arms
        (2, "0.3 0 -0.1", "fixed"),
        (5, "0 0 0.03", "fixed"),  # a hand
        (6, "0.1 0 0", "floating"),  # an insect
    ],
)
def test_legs_hang_down_and_arms_and_fingers_do_not(tmp_path, branches, way, base):
    element = robot([LEG] * branches)
    for moved in element.iterfind("joint"):
        if moved.get("name") != "plate":
            for old in moved.findall("origin"):
                moved.remove(old)
            ET.SubElement(moved, "origin", xyz=way)
    assert choose_base(element, ImportOptions(), ImportReport(tmp_path / "a.urdf")) == base


def called(*branches: str, way: str = "0 0 -0.3", kind: str = "revolute") -> ET.Element:
    """Return a robot whose branches are names of joints; ``waist>l_hip`` starts behind another joint."""
    parts = ['<link name="base"/>']
    for names in branches:
        parent, _, rest = names.rpartition(">")
        parent = parent and f"{parent}_link"
        for name in rest.split():
            moved = joint(name, parent or "base", f"{name}_link", kind, f'<origin xyz="{way}"/>')
            parts += [f'<link name="{name}_link"/>', moved]
            parent = f"{name}_link"
    return ET.fromstring(f"<robot name='r'>{''.join(parts)}</robot>")


LEGS = ("l_hip l_knee l_ankle", "r_hip r_knee r_ankle")
ARMS = ("left_shoulder left_elbow left_wrist", "right_shoulder right_elbow right_wrist")
HAND = [
    f"{finger}_1 {finger}_2 {finger}_3" for finger in ("thumb", "index_finger", "little_finger")
]
DOG = [f"{leg}_HFE {leg}_KFE" for leg in ("LF", "RF", "LH", "RH")]


@pytest.mark.parametrize(
    ("element", "base", "reason"),
    [
        # that hang at zero
        (
            called(*ARMS),
            "fixed",
            "6 joints have names of arms or hands",
        ),
        (called(*HAND), "fixed", "9 joints have names"),  # of a hand that points downward
        (called("waist neck", *[f"waist>{arm}" for arm in ARMS]), "fixed", "6 joints"),
        (called(*ARMS, "l_hip", "r_hip"), "fixed", "6 joints"),  # hips alone are no legs
        (called(*ARMS, *LEGS), "floating", "2 branches of 'base' have names of legs"),
        (
            called(*ARMS, "waist", *[f"waist>{leg}" for leg in LEGS]),
            "floating",
            "2 branches of 'waist_link'",
        ),
        (called("LHipYaw LKnee", "RHipYaw RKnee"), "floating", "2 branches"),
        # in whichever way its legs point
        (
            called(*DOG, way="0.1 0 0.2"),
            "floating",
            "4 branches",
        ),
        (called(*DOG, "arm_1 arm_2 arm_3"), "floating", "4 branches"),
        # by shape alone
        (
            called("whip_1 whip_2 ship", "telegram_1 telegram_2 chip"),
            "floating",
            "as legs do",
        ),
        (
            called("wheel_left", "wheel_right", kind="continuous"),
            "floating",
            "2 continuous joints have names of wheels",
        ),
        (called("frontWheel", "valve", kind="continuous"), "fixed", "no wheels"),
        (called("wheel_left", "wheel_right"), "fixed", "no wheels"),  # that turn some degrees
    ],
)
def test_names_tell_legs_and_wheels_from_arms_and_hands(tmp_path, element, base, reason):
    report = ImportReport(tmp_path / "a.urdf")
    assert choose_base(element, ImportOptions(), report) == base
    assert reason in report.entries[0].text


@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("root", ["body", "world_link"])
def test_a_choice_wins(tmp_path, base, root):
    report = ImportReport(tmp_path / "a.urdf")
    element = robot([LEG, LEG], root=root)

    element.set("simrob_base", "floating")

    assert choose_base(element, ImportOptions(base=base), report) == base
    assert report.entries[0].text == f"{base} base: chosen by the user"
    assert element.get("simrob_base") is None


def test_the_value_of_the_option_is_the_same_in_each_language(tmp_path):
    report = ImportReport(tmp_path / "a.urdf")

    choose_base(robot([LEG, LEG]), ImportOptions(), report)

    spanish = in_language(report.entries[0].text, "es")
    assert spanish.startswith("base libre: ")
    assert spanish.endswith("--base fixed")
