"""A hand of its own file is put on an arm by the options of an import, and the arm grips with it."""

import numpy as np
import pytest
import yaml

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.importer.importing import import_robot, robot_from_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.parse import held_robot
from simrob_drake.robots.urdf import mass_of, name_of
from tests.robots.hands import box, finger, joint, link

ARM = f"""<robot name="arm">{link("base")}{link("upper", mass=2)}{link("tool0", mass=1)}
{joint("turn", "base", "upper", kind="revolute", axis="0 0 1")}
{joint("reach", "upper", "tool0", at="0 0 0.5")}</robot>"""
# its root is called as one of the arm's, and a sliding joint as its hinge
HAND = f"""<robot name="hand">{link("base", mass=0.2)}{link("palm", box("0.06 0.12 0.04", "0 0 -0.02"), mass=0.3)}
{joint("turn", "base", "palm", kind="fixed", at="0 0 0.03")}{finger("left")}{finger("right", follows="left_slide")}
</robot>"""
ON_ARM = [0.0, 0.0, 0.01, np.pi / 2, 0.0, 0.0]


@pytest.fixture
def files(tmp_path):
    for name, text in (("arm", ARM), ("hand", HAND)):
        (tmp_path / f"{name}.urdf").write_text(text)
    return tmp_path


def options(files, **own):
    return ImportOptions(hand=files / "hand.urdf", hand_pose=ON_ARM, **own)


def test_both_trees_are_one_robot_and_nothing_is_lost(files):
    robot = robot_from_file(files / "arm.urdf", options(files))

    assert list(robot.axes) == ["turn", "reach", "left_slide", "right_slide"]
    assert [*robot.gripper.axes] == ["left_slide", "right_slide"]
    assert next(iter(robot.tools)) == "grasp"
    assert {"base", "hand_base"} <= {name_of(one) for one in robot.element.iterfind("link")}

    masses = sum(mass_of(one) for one in robot.element.iterfind("link"))
    assert masses == pytest.approx(0.1 + 2 + 1 + 0.2 + 0.3 + 2 * 0.05)


def test_the_hand_is_where_it_was_told_to_be(files):
    """The base, tool0 0.5 m up, 10 mm of the pose, 30 mm to the palm, 70 mm to the pads; y is along the arm's -x."""
    plant, _ = held_robot(robot_from_file(files / "arm.urdf", options(files)))
    pose = plant.GetFrameByName("grasp").CalcPoseInWorld(plant.CreateDefaultContext())

    np.testing.assert_allclose(pose.translation(), [0, 0, 0.61], atol=1e-6)
    np.testing.assert_allclose(pose.rotation().matrix()[:, 1], [-1, 0, 0], atol=1e-9)


def test_it_may_hang_on_any_link(files):
    plant, _ = held_robot(robot_from_file(files / "arm.urdf", options(files, hand_link="upper")))
    pose = plant.GetFrameByName("grasp").CalcPoseInWorld(plant.CreateDefaultContext())

    np.testing.assert_allclose(pose.translation(), [0, 0, 0.11], atol=1e-6)
    with pytest.raises(SimrobError, match="uper"):
        robot_from_file(files / "arm.urdf", options(files, hand_link="uper"))


def test_a_hand_that_changed_is_imported_again(files):
    assert robot_from_file(files / "arm.urdf", options(files)).efforts[-1] == 20
    (files / "hand.urdf").write_text(HAND.replace('effort="20"', 'effort="30"'))
    assert robot_from_file(files / "arm.urdf", options(files)).efforts[-1] == 30


def test_what_is_wrong_with_a_hand_names_its_file(files, tmp_path_factory):
    (files / "hand.urdf").write_text("<robot name='hand'/>")
    out = tmp_path_factory.mktemp("elsewhere") / "out"

    with pytest.raises(SimrobError, match=r"hand\.urdf.* has no link"):
        import_robot(files / "arm.urdf", out, options(files))
    assert not out.exists()


@pytest.mark.usefixtures("no_plots")
def test_the_command_writes_a_station_that_has_both(files, monkeypatch):
    monkeypatch.chdir(files)

    pose = ["--hand-pose", *(f"{value:.6f}" for value in ON_ARM)]
    assert (
        run_command(["station", "arm.urdf", "--hand", "hand.urdf", *pose, "--out", "s.yaml"]) == 0
    )
    content = yaml.safe_load((files / "s.yaml").read_text())
    assert content["robot"]["import_options"]["hand_pose"] == pytest.approx(ON_ARM, abs=1e-6)
    assert "right_slide_follows" in content["couplings"]

    # beside the station
    (files / "s.yaml").write_text((files / "s.yaml").read_text().replace(f"{files}/", ""))
    assert load_station(files / "s.yaml").robots["robot"].import_options.hand == files / "hand.urdf"


def test_a_hand_outside_of_the_stations_folder_is_not_read(files, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "hand.urdf"
    elsewhere.write_text(HAND)
    section = {"urdf": "arm.urdf", "import_options": {"hand": str(elsewhere)}}

    (files / "s.yaml").write_text(yaml.safe_dump({"robot": section, "mode": "kinematic"}))

    with pytest.raises(SimrobError, match=r"robot\.import_options\.hand"):
        load_station(files / "s.yaml")
