"""What the pendant asks about an arm, against kinematics and dynamics, and in scenes of known distances."""

import json

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.extensions.pendant import arm_questions as ask
from simrob_drake.kinematics.solver import Unreachable
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.moves.move_j import MoveAbsJ
from tests.stations.test_coupled_references import gripper  # noqa: F401  # a fixture

HOME = {"robot.initial_deg": {"joint_5": 90}}
TURNED = [0.4, -0.3, 0.2, 0.5, -0.4, 0.3]
"""Where the foot of an arm stands that is not where the world begins."""


@pytest.fixture(scope="module")
def arm():
    return Arm(load_station("irb120_dynamic", HOME | {"robot.base": TURNED}))


def world(pose):
    """Return a pose in m and degrees as a transform, by rotations written out."""
    x, y, z, rz, ry, rx = pose
    return RigidTransform(RollPitchYaw(*np.deg2rad([rx, ry, rz])), [x, y, z])


def forward(arm, axes):
    """Return where Drake has the tool in the world with axes [deg]."""
    model = StationModel(arm.cell.config)
    model.place_robots({arm.name: np.deg2rad(list(axes.values()))})
    own = model.robots[arm.name]
    return model.pose(own.tools[own.tcp])


def assert_close(found, wanted, atol=1e-8):
    np.testing.assert_allclose(found.GetAsMatrix4(), wanted.GetAsMatrix4(), atol=atol)


def test_the_tool_is_where_forward_kinematics_has_it_in_every_frame():
    arm = Arm(load_station("irb120_chess", {"robot.base": TURNED}))
    tool = forward(arm, dict(zip(arm.axes, np.rad2deg(arm.reference), strict=True)))
    base = RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), TURNED[:3])
    assert_close(world(ask.tool_pose(arm, "world")), tool)
    assert_close(base @ world(ask.tool_pose(arm)), tool)
    assert_close(world(ask.tool_pose(arm, "tool")), RigidTransform())
    for frame in ("chess_board", "chess_board.square_3_5", "half_sphere"):
        assert frame in ask.frames(arm)
        assert_close(arm.frame(frame) @ world(ask.tool_pose(arm, frame)), tool)
    assert not {"gripper", "pencil"} & set(ask.frames(arm)), "what it carries goes with it"
    with pytest.raises(UnknownName, match="chess_bord"):
        ask.tool_pose(arm, "chess_bord")


def test_a_page_is_told_where_an_arm_is_and_what_it_can_take():
    arm = Arm("irb120_workcell")
    told = json.loads(json.dumps(ask.where(arm, "board")))
    assert told["axes"] == pytest.approx(dict.fromkeys(arm.axes, 0.0) | {"joint_5": 90.0})
    assert told["tool"] in told["tools"]
    assert told["carried"] == ["gripper", "pencil"]
    assert told["around"] == ["board", "inclined_table", "half_sphere", "cylinder"]
    assert told["pose"] == ask.tool_pose(arm, "board")
    assert told["base_pose"] == ask.tool_pose(arm)
    arm.tool("tool0")
    assert ask.where(arm)["tool"] == "tool0"


def test_a_jog_goes_along_the_axes_of_its_frame_and_turns_about_the_tool(arm):
    base, begin = (
        RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), TURNED[:3]),
        world(ask.tool_pose(arm, "world")),
    )
    way, turn = [0.03, -0.02, 0.05], world([0, 0, 0, 20, -10, 5]).rotation()
    delta = [*way, 20, -10, 5]
    found = {
        frame: base @ world(ask.jogged(arm, delta, frame)) for frame in ("world", "base", "tool")
    }
    assert_close(found["tool"], begin @ RigidTransform(turn, way))
    assert_close(found["world"], RigidTransform(turn @ begin.rotation(), begin.translation() + way))
    along = base.rotation()
    wanted = RigidTransform(
        along @ turn @ along.inverse() @ begin.rotation(), begin.translation() + along @ way
    )
    assert_close(found["base"], wanted)


def test_a_jog_from_a_middle_does_not_count_from_where_the_arm_is(arm):
    middle = ask.jogged(arm, [0.0, 0.0, 0.05, 0, 0, 10])
    once = ask.jogged(arm, [0.01, 0.02, 0.0, 5, 0, 0], "tool", middle)
    begin, by = world(middle), world([0.01, 0.02, 0.0, 5, 0, 0])
    assert_close(world(once), begin @ by)


def test_inverse_kinematics_takes_the_nearest_posture(arm):
    pose = ask.jogged(arm, [0.02, -0.03, 0.04, 5, -6, 7], "tool")
    axes = ask.inverse(arm, pose)
    base = RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), TURNED[:3])
    assert_close(forward(arm, axes), base @ world(pose))
    assert np.abs(np.array([*axes.values()]) - [0, 0, 0, 0, 90, 0]).max() < 30
    with pytest.raises(Unreachable, match="out of reach"):
        ask.inverse(arm, [2.0, 0, 0, 0, 0, 0])
    with pytest.raises(InvalidParameter, match="six finite numbers"):
        ask.inverse(arm, [2.0, 0, 0, np.nan, 0, 0])


def test_a_jog_is_a_move_that_the_joints_can_do_and_ends_on_a_tick(arm):
    move = ask.jog_move(arm, {"joint_1": 10, "joint_6": -100})
    content = json.loads(json.dumps(move))
    entry = MoveAbsJ.model_validate(content["move_abs_j"])
    np.testing.assert_allclose(np.rad2deg(entry.targets), [10, 0, 0, 0, 90, -100], atol=1e-12)
    assert entry.duration / 0.05 == pytest.approx(round(entry.duration / 0.05))
    peak = 1.875 * np.deg2rad(100) / entry.duration  # of a polynomial of degree five
    limit = arm.cell.robot(arm.name).model.speed_limits[5]
    assert 0.4 * limit < peak < 0.51 * limit
    arm.plan.move_abs_j(entry.targets, duration=entry.duration)
    assert ask.jog_move(arm, {"joint_1": 10}, 2.5)["move_abs_j"]["duration"] == 2.5
    with pytest.raises(
        JointLimitExceeded, match="the jog: joint_1 would be at 170 deg, 5 deg beyond"
    ):
        ask.jog_move(arm, {"joint_1": 170})


def test_a_jog_names_its_robot_where_there_are_several():
    cell = Workcell("two_irb120")
    assert ask.jog_move(cell.arm("left"), {"joint_1": 10})["move_abs_j"]["robot"] == "left"


def test_each_branch_brings_the_tool_to_the_pose_and_is_another(arm):
    wanted = world(ask.tool_pose(arm, "world"))
    found = ask.branches(arm)
    json.dumps(found)
    assert len(found) == 8
    for branch in found:
        assert_close(forward(arm, branch["axes"]), wanted)
    postures = np.array([[*branch["axes"].values()] for branch in found])
    apart = np.abs(postures[:, np.newaxis] - postures[np.newaxis]).max(axis=2)
    assert (apart + 1e3 * np.eye(len(found))).min() > 1
    assert found[0]["usable"]
    assert ask.branches(arm, [2.0, 0, 0, 0, 0, 0]) == []


def test_a_pose_may_be_that_of_another_tool():
    arm = Arm("irb120_workcell")
    pose = arm_pose_of(arm, "gripper")
    found = ask.branches(arm, pose, "world", "gripper")
    assert any(
        branch["axes"] == pytest.approx(ask.where(arm)["axes"], abs=1e-6) for branch in found
    )
    assert ask.where(arm)["tool"] == "pencil", "the arm keeps its own"


def arm_pose_of(arm, tool):
    other = Workcell(arm.cell.config).arm(tool=tool)
    return ask.tool_pose(other, "world")


def test_the_torque_of_a_branch_is_drakes_gravity_load(arm):
    model = StationModel(arm.cell.config)
    plant: MultibodyPlant = model.plant
    context, own = plant.CreateDefaultContext(), model.robots[arm.name]
    for branch in ask.branches(arm):
        own.axis_map.set_positions(plant, context, np.deg2rad([*branch["axes"].values()]))
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        torque = plant.CalcInverseDynamics(context, np.zeros(plant.num_velocities()), forces)
        np.testing.assert_allclose(
            [*branch["torque"].values()], own.axis_map.efforts(torque), atol=1e-9
        )
        axis, share = branch["load"]["axis"], branch["load"]["share"]
        shares = {
            name: abs(value) / branch["limit"][name] for name, value in branch["torque"].items()
        }
        assert share == pytest.approx(shares[axis])
        assert share == pytest.approx(max(shares.values()))


def test_the_room_of_a_branch_is_to_the_nearest_limit_of_the_urdf(arm):
    # deg, data sheet
    limits = np.array([[-165, 165], [-110, 110], [-110, 70], [-160, 160], [-120, 120], [-400, 400]])
    for branch in ask.branches(arm):
        values = np.array([*branch["axes"].values()])
        rooms = np.minimum(values - limits[:, 0], limits[:, 1] - values)
        assert branch["room"]["left"] == pytest.approx(rooms.min(), abs=1e-3)  # the URDF rounds
        assert branch["room"]["axis"] == arm.axes[int(rooms.argmin())]
        assert branch["room"]["unit"] == "deg"


BALL = {
    "pieces.load": {"model": "ball", "parent": "gripper", "pose": [0, 0, 0.3, 0, 0, 0]},
    "robot.initial_deg": {"joint_3": 20, "joint_5": 70},
}


@pytest.mark.parametrize(("height", "met"), [(0.09, ""), (0.05, "load in floor")])
def test_the_gap_to_the_floor_is_the_balls_height_without_its_radius(height, met):
    arm = Arm(load_station("irb120_dynamic", BALL), tool="load")
    found = ask.branches(arm, [0.35, 0.1, height, 0, 0, 180], "world")
    nearest = [branch for branch in found if branch["gap"]["between"] == ["load", "floor"]]
    # of itself: some branches fold the arm
    clear = [branch for branch in nearest if "link" not in branch["collision"]]
    assert clear
    for branch in clear:
        assert branch["gap"]["distance"] == pytest.approx(height - 0.06, abs=1e-9)
        assert branch["collision"] == met
        assert branch["usable"] is (not met and branch["room"]["left"] >= 0)


def test_the_gap_to_an_inclined_floor_is_along_its_normal():
    slope = {"floor.incline_deg": 10.0}
    found = ask.branches(
        Arm(load_station("irb120_dynamic", BALL | slope), tool="load"), [0.35, 0.1, 0.14, 0, 0, 180]
    )
    gaps = [
        branch["gap"]["distance"]
        for branch in found
        if branch["gap"]["between"] == ["load", "floor"]
    ]
    height = 0.14 * np.cos(np.deg2rad(10)) - 0.35 * np.sin(np.deg2rad(10))  # it rises along x
    np.testing.assert_allclose(gaps, height - 0.06, atol=1e-8)
    assert gaps


def test_what_no_posture_brings_nearer_does_not_count():
    """The column turns 160 mm above its floor, whatever the arm does."""
    level = Arm(load_station("irb120_dynamic", HOME))
    assert all("link_1" not in branch["gap"]["between"] for branch in ask.branches(level))
    assert all(branch["gap"]["distance"] > 0.2 for branch in ask.branches(level))


def test_the_gap_of_two_balls_is_the_distance_of_their_middles():
    other = {
        "pieces.other": {"model": "ball", "parent": "world", "pose": [0.35, 0.25, 0.08, 0, 0, 0]}
    }
    arm = Arm(load_station("irb120_dynamic", BALL | other), tool="load")
    found = ask.branches(arm, [0.35, 0.1, 0.12, 0, 0, 180], "world")
    gaps = [
        branch["gap"]["distance"]
        for branch in found
        if branch["gap"]["between"] == ["load", "other"]
    ]
    np.testing.assert_allclose(gaps, np.hypot(0.15, 0.04) - 0.12, atol=1e-6)
    assert gaps


def test_there_is_no_gap_with_nothing_around():
    arm = Arm(load_station("irb120_dynamic", {"floor": None}))
    assert all(branch["gap"] is None for branch in ask.branches(arm))


def test_jogging_a_finger_moves_its_partner(gripper):  # noqa: F811
    jogged = ask.jog_move(Arm(gripper), {"right": 0.01})["move_abs_j"]["targets"]
    np.testing.assert_allclose(jogged, [0.01, 0.01, 0.0], atol=1e-9)
