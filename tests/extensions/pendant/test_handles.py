"""What a hand in the view can take hold of: against Drake's plants, built by hand, and the session that hears of it."""

from dataclasses import replace

import numpy as np
import pytest
from fake_runs import BenchRun
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant.handles import _limbs, _moved, handles, reached
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.arm import Workcell
from simrob_drake.robots.catalog import load_robot


class ByHand:
    """A robot of a URDF, its root where it stands in a station, axes in degrees."""

    def __init__(self, name, root, posture):
        self.model, self.plant, self.posture = (
            load_robot(name),
            MultibodyPlant(0.0),
            np.rad2deg(posture),
        )
        self.plant.set_adjacent_bodies_collision_filters(False)
        Parser(self.plant).AddModels(str(self.model.urdf_path))
        self.plant.WeldFrames(
            self.plant.world_frame(), self.plant.GetFrameByName(self.model.root), root
        )
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()

    def at(self, frame, **axes):
        for axis, value in (dict(zip(self.model.axes, self.posture, strict=True)) | axes).items():
            own = self.model.axes[axis]
            self.plant.GetJointByName(own.joint).set_angle(
                self.context, own.sign * np.deg2rad(value)
            )
        return self.plant.GetFrameByName(frame).CalcPoseInWorld(self.context)


def standing(name):
    cell = Workcell(load_station(f"{name}_dynamic", {"duration": 1}))
    robot = next(iter(cell.config.robots))
    return cell, robot, ByHand(name, cell.model.pose(cell.robot(robot).root), cell.position(robot))


def six(pose):
    return [*pose.translation(), *np.rad2deg(RollPitchYaw(pose.rotation()).vector()[::-1])]


@pytest.mark.parametrize(
    ("name", "limb", "by"),
    [
        ("humanoid", "left_foot", [0.02, 0.0, 0.05]),  # of a stretched leg
        ("zjudancer", "right_foot", [0.03, -0.01, 0.03]),
        ("yobotics", "front_left_foot", [0.02, 0.02, 0.04]),
        ("roid1", "right_hand", [0.03, 0.0, 0.02]),
    ],
)
def test_a_limb_goes_where_it_is_put(name, limb, by):
    cell, robot, by_hand = standing(name)
    frame = by_hand.model.tools[limb]
    begin = by_hand.at(frame)
    told = handles(cell, robot, {}, {})["handles"][f"limb:{limb}"]["pose"]
    np.testing.assert_allclose(np.reshape(told, (4, 4), order="F"), begin.GetAsMatrix4(), atol=1e-6)
    target = RigidTransform(begin.rotation(), begin.translation() + by)
    axes = reached(cell, robot, limb, six(target), {}, turned=False)
    found = by_hand.at(frame, **axes)
    np.testing.assert_allclose(found.translation(), target.translation(), atol=5e-5)
    if len(axes) == 6:
        assert found.rotation().IsNearlyEqualTo(target.rotation(), 1e-4)
    lower, upper = np.rad2deg(by_hand.model.axis_limits)
    places = [list(by_hand.model.axes).index(axis) for axis in axes]
    values = np.array([*axes.values()])
    assert (values >= lower[places] - 1e-6).all()
    assert (values <= upper[places] + 1e-6).all()


def test_a_limb_is_turned_where_it_cannot_keep_its_place():
    cell, robot, by_hand = standing("humanoid")
    frame = by_hand.model.tools["right_foot"]
    begin = by_hand.at(frame)
    target = RigidTransform(
        RotationMatrix.MakeYRotation(0.4) @ begin.rotation(), begin.translation()
    )
    found = by_hand.at(frame, **reached(cell, robot, "right_foot", six(target), {}, turned=True))
    assert (found.rotation().inverse() @ target.rotation()).ToAngleAxis().angle() == pytest.approx(
        0.0, abs=1e-3
    )


@pytest.mark.parametrize("name", ["irb120", "humanoid", "yobotics"])
def test_a_link_turns_about_the_axis_that_is_told(name):
    cell, robot, by_hand = standing(name)
    links = handles(cell, robot, {}, {})["links"]
    assert {link["axis"] for link in links.values()} == {*by_hand.model.axes}
    lower, upper = np.rad2deg(by_hand.model.axis_limits)
    for path, link in links.items():
        body, place = path.rpartition("/")[2], list(by_hand.model.axes).index(link["axis"])
        assert (link["low"], link["high"]) == pytest.approx((lower[place], upper[place]))
        before = by_hand.at(body)
        now = by_hand.at(body, **{link["axis"]: link["value"] + 10.0})
        about = RigidTransform(link["point"])
        turn = RigidTransform(_about(link["along"], np.deg2rad(10.0)), [0, 0, 0])
        assert now.IsNearlyEqualTo(about @ turn @ about.inverse() @ before, 1e-6)


def _about(axis, angle):
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return RotationMatrix(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)


def test_a_limb_with_several_tools_is_one():
    cell, robot, _ = standing("humanoid")
    own = cell.robot(robot)
    twice = own.model.model_copy(
        update={"tools": {**own.model.tools, "palm": own.model.tools["right_hand"]}}
    )
    assert {*_limbs(replace(own, model=twice), _moved(own))} == {
        "right_hand",
        "left_hand",
        "right_foot",
        "left_foot",
    }


def test_what_is_to_be_elsewhere_is_counted_from_there():
    cell, robot, by_hand = standing("humanoid")
    near = {"left_shoulder_pitch": 40.0}
    told = handles(cell, robot, {}, near)
    hand = by_hand.at(by_hand.model.tools["left_hand"], **near)
    place = np.reshape(told["handles"]["limb:left_hand"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(place, hand.GetAsMatrix4(), atol=1e-6)
    assert 40.0 in [pytest.approx(link["value"]) for link in told["links"].values()]


def test_what_cannot_be_is_told():
    cell, robot, _ = standing("humanoid")
    with pytest.raises(SimrobError, match="left_foot"):
        reached(cell, robot, "left_fot", [0] * 6, {}, turned=False)
    with pytest.raises(SimrobError, match="six finite numbers"):
        reached(cell, robot, "left_foot", [0, 0, 0], {}, turned=False)


@pytest.fixture
def teach(tmp_path):
    opened = []

    def open_(subject):
        opened.append(Session.open(subject, tmp_path, live=BenchRun))
        opened[-1].hear()
        return opened[-1]

    yield open_
    for session in opened:
        session.close()


def answered(session, answer):
    session.hear()
    return answer.result(1.0)


def viewed(session):
    """Return what the view is told last of each subject from now on."""
    told = {}
    session.listen_to_view(told.__setitem__)
    return told


def test_an_arm_goes_where_its_tool_is_put_and_its_links_turn(teach):
    session = teach("irb120_kinematic")
    told = viewed(session)
    session.hand.open()
    session.hear()
    (command,) = told["handles"]
    begin = RigidTransform(np.reshape(command["handles"]["tool:"]["pose"], (4, 4), order="F"))
    session.hand.put("tool:", six(RigidTransform([0, 0, -0.1]) @ begin), turned=False, over=True)
    session.hear()
    now = np.reshape(told["handles"][0]["handles"]["tool:"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(now[:3, 3], begin.translation() - [0, 0, 0.1], atol=1e-6)
    session.hand.turn("joint_1", 30.0)
    session.hear()
    assert answered(session, session.arm.where())["axes"]["joint_1"] == pytest.approx(30.0)


def test_a_target_is_put_elsewhere_and_undone(teach):
    session = teach("irb120_kinematic")
    session.arm.teach_target("here")
    session.hear()
    session.hand.open()
    told = viewed(session)
    before = session.book.targets["here"]
    pose = np.add(before["pose"], [0, 0.05, -0.1, 0, 0, 0])
    session.hand.put("target:here", pose.tolist(), turned=False, over=False)
    session.hear()
    assert session.book.targets["here"] == before
    session.hand.put("target:here", pose.tolist(), turned=False, over=True)
    session.hear()
    after = session.book.targets["here"]
    np.testing.assert_allclose(after["pose"], pose, atol=1e-5)
    place = np.reshape(told["handles"][0]["handles"]["target:here"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(place[:3, 3], pose[:3], atol=1e-6)
    session.arm.jog_axes(after["axes"])
    session.hear()
    np.testing.assert_allclose(
        answered(session, session.arm.where("world"))["pose"], pose, atol=1e-4
    )
    session.hand.put("target:here", [9.0, 0, 0, 0, 0, 0], turned=False, over=True)
    session.hear()
    assert session.message.wrong
    assert session.book.targets["here"] == after
    session.undo()
    assert session.book.targets["here"] == before


def test_a_target_that_goes_with_a_piece_is_put_elsewhere_in_the_frame_of_that(teach):
    session = teach("irb120_gripper")
    session.arm.teach_target("here", "cube_2")
    session.hear()
    frame, *_ = np.reshape(handles_of(session)["piece:cube_2"]["pose"], (1, 4, 4)).transpose(
        0, 2, 1
    )
    pose = np.add(answered(session, session.arm.where("world"))["pose"], [0, 0.02, -0.05, 0, 0, 0])
    session.hand.put("target:here", pose.tolist(), turned=False, over=True)
    session.hear()
    after = session.book.targets["here"]
    assert after["frame"] == "cube_2"
    tcp = np.reshape(handles_of(session)["target:here"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(tcp[:3, 3], pose[:3], atol=1e-6)
    in_frame = frame[:3, :3].T @ (pose[:3] - frame[:3, 3])
    np.testing.assert_allclose(after["pose"][:3], in_frame, atol=1e-5)


def handles_of(session):
    """Return what can be taken now."""
    told = viewed(session)
    session.hand.open()
    session.hear()
    return told["handles"][0]["handles"]


@pytest.mark.long
def test_a_piece_begins_where_it_is_put(teach):
    session = teach("irb120_gripper")
    told = viewed(session)
    session.hand.open()
    session.hear()
    pose = [0.35, 0.1, 0.02, 90.0, 0.0, 0.0]
    session.hand.put("piece:cube_1", pose, turned=False, over=False)
    assert session.book.settings == {}
    session.hand.put("piece:cube_1", pose, turned=True, over=True)
    session.hear()
    assert session.setup.value("pieces.cube_1.pose") == pytest.approx(
        [0.35, 0.1, 0.02, np.pi / 2, 0, 0], abs=1e-6
    )
    place = np.reshape(told["handles"][0]["handles"]["piece:cube_1"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(place[:3, [0, 3]], [[0, 0.35], [1, 0.1], [0, 0.02]], atol=1e-6)


def test_a_limb_sets_joints_of_which_a_ghost_is_shown(teach):
    session = teach("humanoid_dynamic")
    heard, told = [], viewed(session)
    session.listen(lambda topic: heard.append(dict(session.hand.asked)), "hand")
    session.hand.open()
    session.hear()
    begin = RigidTransform(
        np.reshape(told["handles"][0]["handles"]["limb:left_hand"]["pose"], (4, 4), order="F")
    )
    session.hand.put(
        "limb:left_hand", six(RigidTransform([0.05, 0, 0.1]) @ begin), turned=False, over=False
    )
    session.hear()
    session.hand.turn("right_elbow", 25.0)
    assert [{*one} for one in heard] == [
        {"left_shoulder_pitch", "left_shoulder_roll", "left_elbow", "left_wrist"},
        {"right_elbow"},
    ]
    session.hand.lean(heard[0])
    session.hear()
    assert {command["type"] for command in told["ghosts"]} == {"delete", "copy", "set_transform"}
    now = np.reshape(told["handles"][0]["handles"]["limb:left_hand"]["pose"], (4, 4), order="F")
    np.testing.assert_allclose(now[:3, 3], np.add(begin.translation(), [0.05, 0, 0.1]), atol=1e-4)
    session.hand.lean({})
    session.hear()
    assert [command["type"] for command in told["ghosts"]] == ["delete"]
    session.hand.lean(heard[0])
    session.hear()
    told["ghosts"] = []
    assert session.setup.set("gravity", 3.7)
    session.hear()
    assert {command["type"] for command in told["ghosts"]} == {"delete", "copy", "set_transform"}, (
        "as before"
    )


def test_handles_of_a_station_that_is_built_anew_are_where_it_begins(teach):
    """The gizmo stayed where the tool was before."""
    session = teach("irb120_dynamic")
    seen = []
    session.listen_to_view(
        lambda subject, commands: seen.append(commands[0]) if subject == "handles" else None
    )
    session.hand.open()
    session.hear()
    begin = seen[-1]["handles"]["tool:"]["pose"]
    session.arm.jog_axes({"joint_1": 30.0})
    session.hear()
    jogged = seen[-1]["handles"]["tool:"]["pose"]
    assert np.abs(np.subtract(jogged, begin)).max() > 0.1
    seen.clear()
    assert session.setup.set("servo.kp", 1200.0)
    session.hear()
    assert {} in [command["handles"] for command in seen], (
        "nothing to be taken while the station is built"
    )
    np.testing.assert_allclose(seen[-1]["handles"]["tool:"]["pose"], begin, atol=1e-9)
