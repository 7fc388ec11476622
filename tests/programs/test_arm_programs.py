"""Programs of arms: what happened as one result, and files that do what Python did."""

import csv

import numpy as np
import pytest
import yaml

from simrob_drake import Arm, Program, Workcell, load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.frames import as_transform, xyz_quaternion_from_transform
from simrob_drake.cli.programs import check_program
from simrob_drake.programs.moves.together import MOTIONS
from simrob_drake.programs.timing import How
from simrob_drake.results.record.run import all_events
from tests.programs.conftest import BARE, DOWN, HOME

pytestmark = pytest.mark.usefixtures("no_plots")

BOX = {"model": "box_on_corners", "parent": "robot", "pose": [0, 0, 0.15, 0, 0, 0]}
FALLS = {
    "robot.model": "irb120",
    "robot.initial_deg": {"joint_5": 90},
    "pieces": {"box": BOX},
    "contact": {"model": "point"},
    "floor": {"size": 2},
    "solver.max_step": 0.01,
}


@pytest.fixture(scope="module")
def picked():
    """A belt that brings a rook and an arm that stands it on the pallet, and where the rook was after each move."""
    cell = Workcell("belt_pick")
    belt, arm = cell.arm("belt"), cell.arm("arm")
    belt.move_abs_j([0.1])
    cell.record()
    seen = [cell.frame("rook")]

    def moved(run):
        seen.append(cell.frame("rook"))
        return run

    runs = [
        moved(belt.move_abs_j([0.5], duration=0.9)),
        moved(arm.move_j([0, 0, 0.035, *DOWN], wobj="rook")),
    ]
    arm.attach("rook")
    over = arm.plan.move_j([0.1, 0.4, 0.0626, 0, 0, 0], duration=1.1, check=None)
    runs += [moved(cell.run(over, belt.plan.move_abs_j([0.0], check=None))), moved(cell.wait(0.1))]
    arm.release("rook", "pallet")
    return cell, runs, seen


class TestWhatHappened:
    def test_every_piece_is_where_it_was(self, picked):
        cell, runs, seen = picked
        whole = cell.result()
        ends = np.cumsum([0.0, *(run.stop_time for run in runs)])

        poses = whole.piece_pose("rook")

        for time, there in zip(ends, seen, strict=True):
            row = int(np.flatnonzero(np.isclose(whole.times, time))[0])
            np.testing.assert_allclose(poses[row], xyz_quaternion_from_transform(there), atol=1e-12)
        on_belt = whole.times <= 0.9  # 0.1 m to 0.5 m along y; the arm stands
        travelled = whole["belt.q.belt"][on_belt] - whole["belt.q.belt"][0]
        np.testing.assert_allclose(poses[on_belt, 1] - poses[0, 1], travelled, atol=1e-12)
        held = (whole.times > 2.0) & (whole.times < 2.6)  # the rook is the tool
        tool = np.column_stack([whole[f"arm.tcp.{axis}"] for axis in "xyz"])
        apart = np.linalg.norm(poses[held, :3] - tool[held], axis=1)
        np.testing.assert_allclose(apart, apart[0], atol=1e-12)

    def test_signals_are_those_of_the_runs_one_after_the_other(self, picked):
        cell, runs, _ = picked
        whole, begin = cell.result(), 0.0

        assert (np.diff(whole.times) > 0).all()

        for run in runs:
            rows = np.isclose(whole.times[:, None], begin + run.times[:-1]).any(axis=1)
            for name in ("belt.q.belt", "arm.tau.joint_2", "arm.tcp.x"):
                np.testing.assert_array_equal(whole[name][rows], run[name][:-1])
            begin += run.stop_time
        assert whole.stop_time == pytest.approx(begin, abs=1e-12)
        assert whole["arm.q.joint_1"][-1] == runs[-1]["arm.q.joint_1"][-1]
        assert whole.message == "ran to its end at 3.1 s"
        assert {"piece.rook.x", "piece.rook.qz"} <= set(whole.units)
        assert whole.plant.robots["arm"].tcp == "gripper, rook"

        at = whole.positions_at(np.array([0.3, 1.0]))
        own = [
            run.plant.robots["belt"].axis_map.positions(run.positions_at(np.array([0.3])))[0, 0]
            for run in runs[:1]
        ]

        assert whole.plant.robots["belt"].axis_map.positions(at)[0, 0] == own[0]

    def test_events_say_what_happened_when(self, picked, tmp_path):
        cell, _, _ = picked
        expected = [
            (0.0, "start"),
            (0.9, "move 1 (move_abs_j of belt) ends"),
            (1.9, "rook to gripper"),
            (3.0, "move 4 (move_j of arm, move_abs_j of belt) ends"),
            (3.1, "rook to pallet"),  # after the last run
            (3.1, "end"),
        ]

        assert all_events(cell.result()) == expected

        folder = cell.save(tmp_path / "picked", recording=False)
        with (folder / "events.csv").open() as lines:
            header, *rows = csv.reader(lines)

        assert header == ["time", "event"]
        assert [(float(time), text) for time, text in rows] == expected

    @pytest.mark.long
    def test_a_piece_that_falls_is_taken_from_where_it_lies(self):
        arm = Arm(load_station("irb120_dynamic", FALLS))
        arm.record()
        arm.wait(0.05)
        arm.release("box")
        fall = arm.wait(0.5)
        lies = arm.cell.frame("box")
        arm.cell.attach("box", "robot", pose=[0, 0, 0.15, 0, 0, 0])
        arm.wait(0.05)

        whole = arm.result()

        falls = (whole.times >= 0.05) & (whole.times < 0.55)
        np.testing.assert_allclose(
            whole["piece.box.z"][falls], fall["piece.box.z"][:-1], atol=1e-12
        )

        before = whole.positions_at(np.array([0.55 - 1e-9]))[0]
        place = whole.plant.plant.get_body(whole.plant.free_pieces["box"].index())
        context = whole.plant.plant.CreateDefaultContext()
        whole.plant.plant.SetPositions(context, before)

        there = whole.plant.plant.EvalBodyPoseInWorld(context, place)

        assert there.IsNearlyEqualTo(
            lies @ as_transform(arm.cell.model.resolved.pieces["box"].model.tcp).inverse(), 1e-6
        )
        assert whole["piece.box.z"][-1] > 0.3  # in the hand again
        assert "box touches" in " ".join(text for _, text in all_events(whole))

    @pytest.mark.long
    def test_a_recording_is_done_again_on_the_dynamic_station(self, kinematic):
        kinematic.record()
        kinematic.move_j([0, 0, 0.01, 0, 0, np.pi], wobj="weight", check=None)
        kinematic.attach("weight")
        kinematic.move_l([0, 0, 0.05], wobj=kinematic, speed=0.2)
        kinematic.tool("gripper")
        kinematic.move_abs_j(HOME)

        here = kinematic.simulate()
        np.testing.assert_allclose(here.axes("q")[-1], kinematic.position, atol=1e-12)
        assert len(here.runs) == 3

        real = kinematic.simulate(load_station("irb120_dynamic", BARE))
        assert [run.config.pieces["weight"].parent for run in real.runs] == [
            "world",
            "load",
            "load",
        ]
        assert real.stop_time == pytest.approx(here.stop_time, abs=1e-12)

        off = np.linalg.norm(real.piece_pose("weight")[-1, :3] - here.piece_pose("weight")[-1, :3])
        assert 1e-4 < off < 0.03  # m: it sags

        slow = kinematic.simulate(duration=2 * here.stop_time)
        np.testing.assert_allclose(
            slow.piece_pose("weight")[-1], here.piece_pose("weight")[-1], atol=1e-12
        )


def _program(text):
    return Program.model_validate(yaml.safe_load(text))


def everything(arm, form=list):
    """Do all that the file of a program can say, with poses in a form."""
    arm.record()
    arm.move_abs_j(np.array(HOME) + 0.05, duration=0.2)
    arm.move_abs_j(np.array([[0.1, 0, 0, 0, 1.5, 0], HOME]), times=[0.3, 0.5], stop=True)
    arm.tool("load")
    arm.move_j(form([0.35, 0.05, 0.3, *DOWN]))
    arm.move_j([[0.1, 0.1, 0.05, *DOWN], [0.12, 0.1, 0.05, *DOWN]], wobj="table", solver="numeric")
    arm.move_l(form([0.02, 0, 0, 0, 0, 0.1]), wobj=arm, points=5)
    arm.tool(form([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]))
    arm.move_l([0, 0, -0.01], wobj=arm, speed=0.1)
    arm.move_c([0.13, 0.13, 0.05], [0.1, 0.15, 0.05], wobj="table", duration=0.4)
    arm.move_l([0, 0, -0.02], wobj=form(arm.pose(arm.reference).tolist()), check="nothing")
    arm.wait(0.1)
    arm.attach("weight", pose=form([0, 0, 0.05, 0, 0, 0.3]))
    arm.cell.run(arm.plan.move_abs_j(HOME), duration=1.2)
    arm.release("weight", "table")
    arm.cell.attach("table", "world", pose=[0.4, 0.1, 0.05, 0, 0, 0])
    arm.wait(0.1)
    arm.release("load", fixed=True)
    return arm.result()


class TestFiles:
    @pytest.mark.parametrize("mode", ["kinematic", pytest.param("dynamic", marks=pytest.mark.long)])
    def test_a_script_and_its_file_give_equal_signals(self, mode, tmp_path, request):
        arm = request.getfixturevalue(mode)
        arm.wait(0.05)  # it begins in a state
        whole = everything(arm)
        folder = arm.save(tmp_path / "script", recording=False)

        again = Workcell(folder / "station.yaml").perform(folder / "program.yaml")

        np.testing.assert_array_equal(again.values, whole.values)

        other = again.save(tmp_path / "file", recording=False)
        for name in ("signals.csv", "events.csv", "program.yaml", "start.json"):
            assert (other / name).read_bytes() == (folder / name).read_bytes(), name

    @pytest.mark.parametrize(
        "form",
        [
            pytest.param(as_transform, marks=pytest.mark.long),
            lambda pose: as_transform(pose).GetAsMatrix4(),
        ],
    )
    def test_transforms_are_told_as_pose_vectors(self, kinematic, form):
        whole = everything(kinematic, form)
        again = Workcell(load_station("irb120_kinematic", BARE)).perform(_program(whole.program))
        # torques, by rounding of the poses
        np.testing.assert_allclose(again.values, whole.values, rtol=0, atol=1e-9)

    @pytest.mark.long
    def test_degrees_and_short_forms_are_the_same_moves(self):
        long = [
            {"target_deg": {"joint_5": 90, "joint_1": 10}, "duration": 0.6},
            {"move_abs_j": {"targets": [0, 0, 0, 0, np.pi / 2, 0]}},
            {"move_j": {"targets": [[0.35, 0.1, 0.3, 0, 0, np.pi]]}},
            {"move_c": {"targets": [0.35, 0.2, 0.3], "via": [0.37, 0.15, 0.3]}},
            {"tool": {"name": "tool0"}},
        ]
        short = [
            {"target_deg": {"joint_5": 90, "joint_1": 10}, "duration": 0.6},
            {"move_abs_j": {"targets_deg": [0, 0, 0, 0, 90, 0]}},
            {"move_j": {"targets_deg": [0.35, 0.1, 0.3, 0, 0, 180]}},
            {"move_c": {"targets_deg": [0.35, 0.2, 0.3], "via": [0.37, 0.15, 0.3]}},
            {"tool": "tool0"},
        ]

        one, other = (
            Workcell("irb120_kinematic").perform(Program.model_validate({"moves": moves}))
            for moves in (long, short)
        )

        np.testing.assert_allclose(one.values, other.values, rtol=0, atol=1e-12)
        assert one.axes("q")[29, 4] != 0
        assert Program.model_validate({"moves": [{"move_l": [0, 0, 1]}]}).moves[0].targets == (
            0,
            0,
            1,
        )

    @pytest.mark.long
    def test_two_arms_and_a_moved_piece(self, tmp_path):
        cell = Workcell("two_arms")
        left, right = cell.arm("left"), cell.arm("right")
        cell.record()
        early = left.plan.move_j([0, 0, 0.1, *DOWN], wobj="bar")
        cell.wait(0.1)
        # the bar goes, and the plan not with it
        cell.attach("bar", "world", pose=[-0.4, 0.3, 0, 0, 0, 0])
        cell.run(early, right.plan.move_abs_j([0.2, 0, 0, 0, 1.5, 0]))
        right.move_l([0, 0, 0.0], wobj=right)
        left.move_l(
            cell.frame("right").inverse() @ (left.pose()[:3] + np.array([0, 0, 0.03])), wobj=right
        )
        folder = cell.save(tmp_path / "two", recording=False)
        again = Workcell(folder / "station.yaml").perform(folder / "program.yaml")

        whole = cell.result()

        for robot, signal in (("left", "q"), ("left", "tau"), ("right", "q"), ("right", "tau")):
            np.testing.assert_allclose(
                again.axes(signal, robot), whole.axes(signal, robot), rtol=0, atol=1e-9
            )
        np.testing.assert_allclose(
            again.piece_pose("bar"), whole.piece_pose("bar"), rtol=0, atol=1e-12
        )
        moves = yaml.safe_load((folder / "program.yaml").read_text())["moves"]
        first = moves[2]["together"][0]["move_j"]
        # its upper end, where it was
        np.testing.assert_allclose(first["wobj"][:3], [-0.5, 0.35, 0.148], atol=1e-12)
        assert [moves[k]["move_l"]["wobj"] for k in (3, 4)] == ["right", "right"]

    def test_what_no_file_can_say_has_none(self, kinematic, tmp_path):
        kinematic.record()
        kinematic.wait(0.1)

        kinematic.cell.follow({"robot": (np.array([0.0, 0.1]), np.array([HOME, HOME]))}, 0.1)

        assert len(kinematic.result().runs) == 2
        assert not (kinematic.save(tmp_path / "no", recording=False) / "program.yaml").exists()
        for change in (
            lambda: kinematic.move_abs_j(HOME) and kinematic.cell.change(kinematic.cell.config),
            lambda: (
                kinematic.wait(0.1),
                kinematic.pause(),
                kinematic.wait(0.1),
                kinematic.resume(),
            ),
        ):
            kinematic.record()
            change()
            assert kinematic.result().program == ""
        with pytest.raises(InvalidParameter, match="the recording: it is empty; call record"):
            Arm("irb120_kinematic").save()

    @pytest.mark.parametrize("kind", MOTIONS)
    def test_a_file_can_say_how_a_move_is_done(self, kind):
        assert set(How.__annotations__) <= set(kind.model_fields)


MISTAKES = {
    "an unknown key": (
        {"move_l": {"target": [0, 0, 1]}},
        r"move 2: move_l\.target: unknown key.*'targets'",
    ),
    "an unknown move": ({"move_x": [0, 0, 1]}, r"move 2: move_x: unknown key"),
    "two units": (
        {"move_l": {"targets": [0, 0, 1], "targets_deg": [0, 0, 1]}},
        "one of targets and targets_deg",
    ),
    "a text": ({"move_l": "up"}, r"move 2: move_l"),
    "an unknown robot": (
        {"move_l": {"targets": [0, 0, 1], "robot": "b"}},
        r"move 2: there is no robot 'b'",
    ),
    "an unknown work object": (
        {"move_l": {"targets": [0, 0, 1], "wobj": "tabel"}},
        r"move 2.*'tabel'.*'table'",
    ),
    "an unknown tool": ({"tool": "grippr"}, r"move 2: there is no tool .*'gripper'"),
    "out of reach": ({"move_j": [2.0, 0, 1, 0, 0, 0]}, r"move 2: the target"),
    "two durations": (
        {"move_abs_j": {"targets": [0] * 6, "duration": 1, "speed": 1}},
        "given by duration and speed",
    ),
    "too few axes": ({"move_abs_j": [0, 0]}, r"move 2: targets"),
    "far away": ({"attach": "weight"}, r"move 2: weight.* mm away from"),
    "a walk": ({"walk": {"steps": 2}}, r"move 2: the move is walk; it must be a move for arms"),
    "an unknown piece": ({"release": "dice"}, r"move 2: there is no piece 'dice'"),
    "nothing together": ({"together": []}, r"move 2: together"),
    "one robot twice": (
        {"together": [{"move_abs_j": [0] * 6}] * 2},
        r"move 2: plans .*of different robots",
    ),
}


@pytest.mark.parametrize(("move", "message"), MISTAKES.values(), ids=MISTAKES)
def test_what_cannot_be_done_is_named_before_anything_moves(kinematic, tmp_path, move, message):
    file = tmp_path / "p.yaml"
    file.write_text(yaml.safe_dump({"moves": [{"move_abs_j": [0.1, 0, 0, 0, 1.5, 0]}, move]}))

    with pytest.raises(SimrobError, match=message) as problem:
        kinematic.cell.perform(file)
    assert str(file) in str(problem.value) or isinstance(problem.value, InvalidConfig)
    assert kinematic.cell.state is None


def test_the_look_ahead_ends_where_a_piece_comes_to_rest():
    cell = Workcell(load_station("irb120_dynamic", FALLS))
    moves = [
        {"wait": 0.1},
        {"release": "box"},
        {"move_abs_j": list(HOME)},
        {"attach": "box"},
        {"move_abs_j": [9] * 6},
    ]

    found = check_program(Program.model_validate({"moves": moves}), cell.config, "p.yaml")

    assert (
        "3 of 5 entries can be done, in 1.1 s; move 4 depends on where a piece falls" in found.text
    )
    assert cell.state is None
    with pytest.raises(InvalidParameter, match="it has no move that takes time"):
        cell.perform(Program.model_validate({"moves": [{"release": "box"}]}))


@pytest.mark.long
def test_what_turns_out_on_the_way_leaves_the_station_as_it_was():
    cell = Workcell(load_station("irb120_dynamic", FALLS))
    moves = [{"wait": 0.05}, {"release": "box"}, {"wait": 0.3}, {"attach": "box"}, {"wait": 0.1}]

    before = cell.config
    with pytest.raises(InvalidParameter, match=r"move 4: box: it is \d+ mm away from load"):
        cell.perform(Program.model_validate({"moves": moves}))
    assert (cell.state, cell.config, cell.tape.entries) == (None, before, [])


def test_a_monitor_ends_the_program():
    cell = Workcell(
        load_station("irb120_dynamic", {"monitors": {"joint_limit": {"margin_deg": 60}}})
    )
    moves = [
        {"wait": 0.1},
        {"move_abs_j": {"targets": [0, 1.2, 0, 0, 0, 0], "check": None}},
        {"wait": 1.0},
    ]

    whole = cell.perform(Program.model_validate({"moves": moves}))

    assert (whole.ending, len(whole.runs)) == ("monitor", 2)
    # of the whole program, not of its last run
    assert whole.message.endswith(f", at {whole.stop_time:.4g} s")
    assert whole.stop_time > 0.1
    assert all_events(whole)[-1] == (whole.stop_time, "stopped: joint_limit")


def test_legs_refuse_what_is_for_arms():
    from simrob_drake import LeggedRobot

    robot = LeggedRobot("humanoid_fixed")
    with pytest.raises(
        InvalidParameter,
        match=r"move 2 is move_l; .* for robots with legs: one of target_deg, walk, go, act",
    ):
        robot.run(Program.model_validate({"moves": [{"act": "bow"}, {"move_l": [0, 0, 1]}]}))
