"""Moves around obstacles: free by an independent look, by whichever posture is near, and in a line why not."""

import base64
import re
import sys
from itertools import product

import numpy as np
import pytest

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.frames import as_transform
from simrob_drake.kinematics.every_branch import goal_postures
from simrob_drake.kinematics.solver import Unreachable
from simrob_drake.programs import smooth_path
from simrob_drake.programs.errors import (
    GoalInCollision,
    NoFreePath,
    PathCollision,
    StartInCollision,
)
from simrob_drake.programs.free_path import metres_per_radian
from simrob_drake.programs.moves import move_free
from simrob_drake.programs.plan import check_collisions
from simrob_drake.programs.segments import PathPoint
from simrob_drake.results.animation.recording import save_recording
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.posed import PosedStation
from tests.programs.conftest import HOME, positions_between

AHEAD = (0.0, np.pi / 2, 0.0)
LEFT, RIGHT = (0.45, 0.2, 0.3, *AHEAD), (0.45, -0.2, 0.3, *AHEAD)
SHELF = """
shapes:
- {box: [0.3, 0.8, 0.02], pose: [0, 0, 0.15, 0, 0, 0]}
- {box: [0.3, 0.8, 0.02], pose: [0, 0, 0.45, 0, 0, 0]}
- {box: [0.3, 0.02, 0.6], pose: [0, 0, 0.3, 0, 0, 0]}
- {box: [0.04, 0.04, 0.04], pose: [-0.15, 0.2, 0.6, 0, 0, 0]}
frames: {left: [-0.1, 0.2, 0.3, 0, 1.5707963267948966, 0]}
"""


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    """An arm with a gripper before a shelf with two compartments."""
    piece = tmp_path_factory.mktemp("shelf") / "piece.yaml"
    piece.write_text(SHELF)
    shelf = {"model": str(piece), "parent": "world", "pose": [0.55, 0, 0, 0, 0, 0]}
    return load_station(
        "irb120_kinematic", {"robot.initial_deg": {"joint_5": 90}, "pieces.shelf": shelf}
    )


@pytest.fixture
def arm(station):
    return Arm(station)


@pytest.fixture(scope="module")
def to_left(station):
    """The plan of a move from the start to the left, which several tests begin with."""
    return Arm(station).plan.move_free(LEFT)


@pytest.fixture
def beside(arm, to_left):
    """The arm with its hand in the left of the compartment."""
    arm.cell.run(to_left)
    return arm


@pytest.fixture(scope="module")
def to_right(station, to_left):
    """The plan of the move from there to the right."""
    arm = Arm(station)
    arm.cell.run(to_left)
    return arm.plan.move_free(RIGHT)


@pytest.fixture
def optimised_briefly(monkeypatch):
    """Let the optimisation take a few steps of its many: for tests that do not ask how good its result is."""
    monkeypatch.setattr(smooth_path, "_ITERATIONS", 5)


def check_free(cell, result):
    """Look at 1000 postures of a run by the check of other moves, which knows nothing of the search."""
    rows = {robot: positions_between(result, 1000, robot) for robot in cell.config.robots}
    check_collisions(
        cell.collision_model,
        rows,
        np.linspace(0, result.stop_time, 1000),
        lambda at: PathPoint(0, f"{at} s"),
    )


class TestTheWay:
    @pytest.mark.long
    def test_it_leads_around_what_a_straight_move_runs_into(self, beside):
        with pytest.raises(PathCollision):
            beside.plan.move_j(RIGHT, check="collision")

        result = beside.move_free(RIGHT)
        check_free(beside.cell, result)

        np.testing.assert_allclose(
            beside.tool_pose().GetAsMatrix4(), as_transform(RIGHT).GetAsMatrix4(), atol=1e-6
        )

    @pytest.mark.long
    def test_the_same_seed_finds_the_same(self, beside, to_right, monkeypatch):
        again = beside.plan.move_free(RIGHT, seed=0)

        np.testing.assert_array_equal(to_right.stretches[0].postures, again.stretches[0].postures)

        # what differs is the search
        monkeypatch.setattr(move_free, "find_faster_path", lambda *_: None)
        one, other = (beside.plan.move_free(RIGHT, seed=seed) for seed in (0, 1))

        assert one.duration != other.duration

    @pytest.mark.long
    def test_a_free_turn_and_a_frame_of_a_piece_will_do(self, arm):
        arm.move_free("shelf.left", free_turn=True)

        np.testing.assert_allclose(arm.pose()[:3], LEFT[:3], atol=1e-6)

        across = arm.chain.forward(arm.position)[0, :3, 2]
        np.testing.assert_allclose(across, [1, 0, 0], atol=1e-6)  # the axis that it turns about

    @pytest.mark.long
    def test_a_carried_piece_takes_part(self, station):
        box = PieceConfig(model="box", parent="robot", pose=(0, 0, 0.2, 0, 0, 0))
        loaded = Arm(station.model_copy(update={"pieces": {**station.pieces, "box": box}}))
        high = Arm(station).joint([0.38, 0.2, 0.4, *AHEAD])

        Arm(station).plan.move_free(joints=high)

        with pytest.raises(GoalInCollision, match=r"box would overlap shelf by"):
            loaded.plan.move_free(joints=high)

        low = Arm(station).joint([0.38, 0.2, 0.3, *AHEAD])
        check_free(loaded.cell, loaded.move_free(joints=low))

    @pytest.mark.long
    def test_a_recording_shows_what_the_search_tried_where_that_is_asked_for(
        self, station, to_left, to_right, tmp_path
    ):
        cell = Arm(station).cell
        cell.record()
        arm = cell.arm()
        cell.run(to_left)
        begin = arm.pose()[:3]

        plain, shown = to_right, arm.plan.move_free(RIGHT, show_search=True)
        assert plain.search.shape == (0, 2, 3)

        ends = shown.search.reshape(-1, 3)
        assert len(ends) > 10
        assert min(np.linalg.norm(ends - begin, axis=1)) < 1e-6  # where both trees begin
        assert min(np.linalg.norm(ends - RIGHT[:3], axis=1)) < 1e-6
        np.testing.assert_array_equal(shown.end, plain.end)

        cell.run(shown)
        page = save_recording(cell.result(), tmp_path / "recording.html").read_text()
        assert "paths that the search tried" in page

        drawn = (base64.b64decode(found) for found in re.findall(r"base64,([A-Za-z0-9+/=]+)", page))
        assert any(b"search/robot/1" in message for message in drawn)

    def test_a_move_to_where_it_is(self, arm):
        assert arm.move_free(joints=HOME).message

    @pytest.mark.long
    @pytest.mark.usefixtures("optimised_briefly")
    def test_a_file_says_the_same(self, arm, station):
        arm.record()
        arm.move_free(LEFT, speed=0.3)
        arm.move_free("shelf.left", free_turn=True, seed=2, planning_time=5)
        arm.move_free(joints=HOME)
        again = Arm(station)

        for entry in arm.cell.tape.moves():
            again.do(entry)

        np.testing.assert_array_equal(again.position, arm.position)


@pytest.fixture(scope="module")
def holding(tmp_path_factory):
    """An arm whose fingers hold a bar of 0.4 m, and a post that its end would sweep."""
    folder = tmp_path_factory.mktemp("bar")
    (folder / "bar.yaml").write_text("{mass: 0.1, shapes: [{box: [0.4, 0.02, 0.02]}]}")
    (folder / "post.yaml").write_text(
        "shapes: [{box: [0.04, 0.04, 0.6], pose: [0, 0, 0.3, 0, 0, 0]}]"
    )
    fingers = {"left_finger": 0.0095, "right_finger": 0.0095}
    pieces = {
        **{f"cube_{number}": None for number in range(1, 6)},
        "bar": {
            "model": str(folder / "bar.yaml"),
            "free": True,
            "pose": [0.302, 0, 0.424, 0, 0, 0],
        },
        "post": {
            "model": str(folder / "post.yaml"),
            "parent": "world",
            "pose": [0.35, 0.3, 0, 0, 0, 0],
        },
    }
    own = {f"pieces.{name}": piece for name, piece in pieces.items()}
    return Arm(
        load_station("irb120_gripper", {"monitors": {}, "robot.initial_deg": fingers, **own})
    )


class TestHeldByFingers:
    @pytest.mark.long
    def test_what_is_held_goes_around_a_post(self, holding):
        end = [np.deg2rad(80), *holding.position[1:]]

        with pytest.raises(PathCollision, match="bar would collide with post"):
            holding.plan.move_abs_j(end)

        plan = holding.plan.move_free(joints=end)
        looks = plan.postures(np.linspace(0, plan.duration, 500))

        # a search that opens the fingers drops the bar
        np.testing.assert_allclose(looks[:, 6:], 0.0095, atol=1e-6)

        model, bar = holding.cell.collision_model, []
        held = model.plant.GetFrameByName("left_finger")
        grip = model.pose(held).inverse() @ model.pose(model.piece_origin("bar"))
        across = np.linspace(-0.01, 0.01, 5)
        # all through the bar
        points = np.array([*product(np.linspace(-0.2, 0.2, 161), across, across)])

        for posture in looks:
            model.place_robots({"robot": posture})
            bar.append((model.pose(held) @ grip @ points.T).T)

        # of the post's sides
        beside = np.abs(np.array(bar)[..., :2] - [0.35, 0.3]).max(axis=2) - 0.02
        above = np.array(bar)[..., 2] - 0.6
        assert np.maximum(beside, above).min() > -0.001  # what may touch

    def test_a_post_at_the_goal_is_told(self, holding):
        with pytest.raises(GoalInCollision, match=r"bar would overlap post by .* mm"):
            holding.plan.move_free(joints=[np.deg2rad(40), *holding.position[1:]])

    def test_what_is_carried_reaches_as_far_as_its_corners(self, holding):
        corners = holding.cell.free_space(["robot"]).carried_points("robot")
        model = holding.cell.collision_model

        own = model.pose(model.piece_origin("bar")).inverse() @ corners.T

        np.testing.assert_allclose(np.sort(own[0]), [-0.2] * 4 + [0.2] * 4, atol=1e-6)

    def test_a_way_is_looked_at_by_the_bar_in_the_axes_of_the_tool(self, holding, monkeypatch):
        asked = []
        monkeypatch.setattr(
            move_free,
            "metres_per_radian",
            lambda *known: (asked.append(known), metres_per_radian(*known))[1],
        )
        holding.plan.move_free(joints=[np.deg2rad(10), *holding.position[1:]])

        (_, corners), pose = asked[-1], holding.chain.forward(holding.position)[0]

        there = corners @ pose[:3, :3].T + pose[:3, 3]
        np.testing.assert_allclose(
            there, holding.cell.free_space(["robot"]).carried_points("robot"), atol=1e-6
        )

    def test_looks_are_as_near_as_the_end_of_the_bar_moves(self, holding):
        tip, chain = np.array([[-0.2, 0.0, 0.0]]), holding.chain

        way = np.random.default_rng(0).uniform(chain.lower, chain.upper, (50, chain.size))
        for axis, most in enumerate(metres_per_radian(chain, tip)):
            poses = [chain.forward(way + turn * np.eye(chain.size)[axis]) for turn in (0.0, 1e-4)]
            before, after = (pose[:, :3, :3] @ tip[0] + pose[:, :3, 3] for pose in poses)
            assert np.linalg.norm(after - before, axis=1).max() <= 1.001e-4 * most
        assert metres_per_radian(chain, tip)[5] == pytest.approx(0.2, abs=1e-3)


class TestShort:
    @pytest.mark.long
    def test_what_is_optimised_takes_less_time_and_is_free(self, beside, monkeypatch):
        arm = beside
        short = arm.plan.move_free(RIGHT, profile="time_optimal")
        monkeypatch.setattr(move_free, "find_faster_path", lambda *_: None)

        rounded = arm.plan.move_free(RIGHT, profile="time_optimal")

        assert short.duration < 0.95 * rounded.duration
        np.testing.assert_allclose(short.end, rounded.end)

        check_free(arm.cell, arm.cell.run(short))

    @pytest.mark.long
    def test_what_ends_in_a_hit_is_not_taken(self, beside, monkeypatch):
        monkeypatch.setattr(smooth_path, "_ROUNDS", 1)
        monkeypatch.setattr(smooth_path, "_EVERY", 10.0)  # too far apart to see the shelf
        plan = beside.plan.move_free(RIGHT)

        monkeypatch.setattr(move_free, "find_faster_path", lambda *_: None)

        assert plan.duration == beside.plan.move_free(RIGHT).duration

    def test_the_station_that_is_optimised_in_is_as_it_is_now(self, holding):
        """The bar hangs on a finger, the other pieces where they are; nothing is free any more, and the floor a box."""
        model = holding.cell.free_space(["robot"]).model
        frozen = model.frozen_station()
        assert not frozen.free_pieces
        assert frozen.pieces["bar"].parent == "robot"
        assert frozen.floor is None

        (floor,) = {*frozen.pieces} - {*model.config.pieces}
        copied = PosedStation(frozen)
        assert copied.plant.num_positions() == 8

        copied.place_robots({"robot": holding.reference})
        for name in ("bar", "post"):
            pose = copied.pose(copied.station.piece_frame(name, name))
            np.testing.assert_allclose(
                pose.GetAsMatrix4(), model.pose(model.piece_origin(name)).GetAsMatrix4(), atol=1e-9
            )

        top = (
            copied.pose(copied.station.piece_frame(floor, floor)).translation()[2]
            + frozen.pieces[floor].box[2] / 2
        )
        assert top == pytest.approx(0.0)


class TestTogether:
    def test_two_arms_pass_each_other(self):
        cell = Workcell("two_arms")
        cell.record()
        ends = {"left": [0, 60, -30, 0, 30, 0], "right": [40, 60, -30, 0, 30, 0]}
        moves = [{"move_free": {"joints_deg": end, "robot": robot}} for robot, end in ends.items()]
        result = cell.arm("left").do({"together": moves})

        check_free(cell, result)

        for robot, end in ends.items():
            np.testing.assert_allclose(np.rad2deg(cell.reference(robot)), end, atol=1e-9)

        again = Workcell("two_arms").arm("left").do(cell.tape.moves()[0])
        assert again.stop_time == result.stop_time

    def test_different_ways_to_do_it_are_refused(self):
        arm = Workcell("two_arms").arm("left")
        times = {"left": 1, "right": 2}

        moves = [
            {"move_free": {"joints": HOME, "robot": robot, "duration": time}}
            for robot, time in times.items()
        ]
        with pytest.raises(
            InvalidParameter, match="moves around obstacles are planned as one path"
        ):
            arm.do({"together": moves})


class TestWhyNot:
    """Errors in one line, and nothing moves."""

    def test_a_goal_in_collision(self, arm):
        with pytest.raises(
            GoalInCollision,
            match=r"in all \d postures that reach it: .* would overlap shelf by .* mm in the best of them",
        ):
            arm.move_free([0.5, -0.2, 0.46, *AHEAD])
        with pytest.raises(
            GoalInCollision,
            match=r"the only posture that reaches it: load would overlap floor by .* mm$",
        ):
            arm.move_free(joints=[0, 1.9, 0, 0, 1, 0])
        np.testing.assert_allclose(arm.position, HOME)

    def test_a_start_in_collision(self, arm):
        arm.move_abs_j([0, 0.9, 0, 0, 1, 0], check="limits")
        with pytest.raises(
            StartInCollision,
            match=r"the start is in collision: .* overlaps shelf by .* mm; leave the collision by",
        ):
            arm.move_free(joints=HOME)

    def test_no_way_within_the_time(self, beside):
        with pytest.raises(
            NoFreePath,
            match=r"no free path was found in 1e-06 s; .* m of motion left; obstacles: shelf",
        ):
            beside.move_free(RIGHT, planning_time=1e-6)

    @pytest.mark.parametrize(
        ("goal", "how", "kind", "text"),
        [
            ((0.9, 0, 0.3, *AHEAD), {}, Unreachable, "the target cannot be reached"),
            (None, {}, InvalidParameter, "the target: neither a pose nor joints are given"),
            (LEFT, {"joints": HOME}, InvalidParameter, "the target: a pose and joints are given"),
            ([LEFT, RIGHT], {}, InvalidParameter, "count of targets is 2; it must be 1"),
            (LEFT, {"seed": -1}, InvalidParameter, "seed is -1"),
            (LEFT, {"planning_time": 0}, InvalidParameter, "planning_time is 0"),
            (LEFT, {"free_turn": 1}, InvalidParameter, "free_turn is 1"),
            (
                LEFT,
                {"zone": "z10"},
                InvalidParameter,
                "zone: a move around obstacles has a single target",
            ),
            ("shelv", {}, SimrobError, "did you mean 'shelf'"),
            (None, {"joints": [0, 0, 0, 0, 90, 0]}, SimrobError, "if these are degrees"),
        ],
    )
    def test_what_is_no_target(self, arm, goal, how, kind, text):
        with pytest.raises(kind, match=text):
            arm.move_free(goal, **how)

    def test_two_targets_in_a_file(self, arm):
        with pytest.raises(InvalidConfig, match="exactly one of targets"):
            arm.do({"move_free": {"piece": "shelf", "joints": HOME}})

    def test_a_missing_package(self, beside, monkeypatch):
        monkeypatch.setitem(sys.modules, "ompl", None)
        with pytest.raises(SimrobError, match="move_free needs the extra plan: pip install"):
            beside.move_free(RIGHT)


def test_goals_reach_the_pose_by_different_postures(arm):
    for chain in (arm.chain, Workcell("irb120_on_belt").arm().chain):
        start = np.zeros(chain.size)
        target = chain.forward(np.full(chain.size, 0.4))
        found = goal_postures(chain, target, start)
        assert len(found) > 1
        np.testing.assert_allclose(
            chain.forward(found), np.broadcast_to(target, (len(found), 4, 4)), atol=1e-6
        )
        assert ((found >= chain.lower) & (found <= chain.upper)).all()


def test_depths_of_overlaps_are_told_in_millimetres():
    goal = GoalInCollision("point 1", 2, 0.0123, ("load", "floor"))
    start = StartInCollision(0.0045, ("load", "shelf"))

    assert "load would overlap floor by 12.3 mm" in str(goal)
    assert "load overlaps shelf by 4.5 mm" in str(start)
