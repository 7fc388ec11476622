"""Programs of legged robots hold walks, acts and pieces that change hands, beside moves of joints."""

import numpy as np
import pytest

from simrob_drake import LeggedRobot, Program, Workcell, load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.moves.attach import AttachMove, ReleaseMove
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.programs.moves.walk import ActMove, WalkMove

pytestmark = pytest.mark.usefixtures("no_plots")

ARM = {"HomDF": 40}
TIP = {"target_deg": {"TobD": -80, "TobI": -80}, "duration": 3.0}  # over, by the ankles' turn
PARCEL = {"parent": "world", "pose": [0.2, -0.3, 0.3, 0, 0, 0]}
IN_HAND = [0.0, 0.0, -0.05, 0.0, 0.0, 0.0]


@pytest.fixture
def carrier():
    """The humanoid on its own feet, with a parcel in the world."""
    return LeggedRobot(load_station("humanoid_dynamic", {"pieces.parcel": PARCEL}))


@pytest.fixture
def held():
    """The humanoid held by its trunk, with a parcel on a stand."""
    return LeggedRobot("humanoid_box")


def snapshot(robot):
    state = None if robot.cell.state is None else robot.cell.state.to_json()
    return robot.program, state, robot.cell.config


class TestOnThePhysics:
    @pytest.mark.long
    def test_a_program_with_all_kinds_does_again_what_was_done(self, carrier, tmp_path):
        """Arm up, two steps, take the parcel, arm higher, bow, let go: from the start, it all comes again."""
        carrier.add_move(ARM, 0.4)
        carrier.walk(2, store=True)
        carrier.attach("parcel", pose=IN_HAND, store=True)
        carrier.add_move({"HomDF": 60}, 0.4)
        carrier.act("bow", rest=0.0, store=True)
        carrier.release("parcel", store=True)

        carrier.add_move({"HomDF": 0}, 0.4)
        kinds = [JointMove, WalkMove, AttachMove, JointMove, ActMove, ReleaseMove, JointMove]
        assert [type(move) for move in carrier.program.moves] == kinds

        before, left = snapshot(carrier), carrier.cell.frame("parcel").translation()
        result = carrier.simulate()
        assert result is carrier.runs[-1]
        assert [run.stop_time for run in carrier.runs] == pytest.approx(
            [0.4, 6.95, 0.4, 7.5, 0.4], abs=0.2
        )
        assert {run.ending for run in carrier.runs} == {"completed"}
        assert [run.config.pieces["parcel"].parent for run in carrier.runs] == [
            *["world"] * 2,
            *["robot"] * 2,
            "world",
        ]
        for run, later in zip(carrier.runs, carrier.runs[1:], strict=False):
            # each begins where one ended
            np.testing.assert_array_equal(later.axes("q")[0], run.axes("q")[-1])
        assert snapshot(carrier) == before
        np.testing.assert_array_equal(carrier.cell.frame("parcel").translation(), left)

        other = LeggedRobot(carrier._start)
        other.load(carrier.save(tmp_path / "carry.yaml"))
        assert other.program == carrier.program

        other.simulate()
        np.testing.assert_array_equal(other.position, carrier.position)

    @pytest.mark.long
    def test_a_hand_takes_where_the_robot_has_walked_to(self, carrier):
        carrier.walk(4)
        went = carrier.base_pose.translation()[1]
        assert went < -0.1

        hand = carrier.pose("right_hand")[:3]
        with pytest.raises(
            InvalidParameter,
            match=r"parcel: .* mm away from robot, which takes pieces within 30 mm",
        ):
            carrier.attach("parcel")

        before_it = [hand[0], hand[1] - 0.05, hand[2], 0.3, 0.0, 0.0]  # by 20 mm
        carrier.cell.attach("parcel", "world", pose=before_it)
        place = carrier.cell.frame("parcel").GetAsMatrix4()

        carrier.attach("parcel")
        np.testing.assert_allclose(carrier.cell.frame("parcel").GetAsMatrix4(), place, atol=1e-9)

        in_hand = transform_from_pose(carrier.pose("right_hand")).inverse() @ carrier.cell.frame(
            "parcel"
        )
        carrier.test_move(ARM, 0.3)

        seen = transform_from_pose(carrier.pose("right_hand")) @ in_hand
        np.testing.assert_allclose(
            carrier.cell.frame("parcel").GetAsMatrix4(), seen.GetAsMatrix4(), atol=1e-9
        )

    def test_a_fall_ends_the_program(self, carrier):
        falls = Program.model_validate({"moves": [TIP, {"act": "bow"}, {"attach": "parcel"}]})
        before = snapshot(carrier)

        result = carrier.run(falls)

        assert result.stopped_by == "fall"
        assert len(carrier.runs) == 1
        assert snapshot(carrier) == before

    @pytest.mark.long
    @pytest.mark.parametrize("name", ["roid1", "yobotics"])
    def test_a_walk_is_what_the_robot_knows_as_one(self, name):
        robot = LeggedRobot(f"{name}_dynamic")
        result = robot.run(Program.model_validate({"moves": [{"walk": {"steps": 4}}]}))
        assert result.summary()["locomotion"]["ahead"] > 0.05


class TestEditing:
    @pytest.mark.long
    def test_moves_of_all_kinds_are_inserted_edited_and_removed(self, carrier):
        carrier.insert(0, {"walk": {"steps": np.int64(4), "step_time": 0.5}})
        carrier.insert(1, {"attach": "parcel"})
        carrier.insert(2, ARM, 0.3)
        carrier.edit(0, {"walk": {"steps": 2, "gait": "march"}})
        carrier.edit(2, {"HomDF": 30})  # keeps its time
        carrier.edit(1, {"act": {"name": "bow", "repeat": 2}})
        carrier.insert(3, {"target_deg": ARM, "duration": 0.2})
        carrier.edit(3, carrier.program.moves[2])

        dumped = [move.entry() for move in carrier.program.moves]

        assert dumped == [
            {"walk": {"steps": 2, "gait": "march"}},
            {"act": {"name": "bow", "repeat": 2}},
            {"target_deg": {"HomDF": 30.0}, "duration": 0.3},
            {"target_deg": {"HomDF": 30.0}, "duration": 0.3},
        ]
        assert carrier.program.duration == pytest.approx(0.6)
        assert carrier.cell.state is None  # nothing has moved

        for _ in range(8):
            carrier.undo()
        assert carrier.program == Program()

    def test_undo_takes_a_stored_piece_back(self, held):
        held.add_move(ARM, 0.1)
        before = snapshot(held)

        held.attach("parcel", pose=IN_HAND, store=True)

        assert held.program.moves[-1] == AttachMove(piece="parcel", pose=IN_HAND)

        held.undo()
        assert snapshot(held) == before

    @pytest.mark.long
    def test_what_is_not_to_be_stored_is_not(self, carrier):
        carrier.act("wave")
        carrier.attach("parcel", pose=IN_HAND)
        assert carrier.program == Program()

    def test_a_program_of_before_is_as_valid(self, held, tmp_path):
        file = tmp_path / "old.yaml"
        file.write_text(
            "moves:\n- target_deg: {HomDF: 40.0}\n  duration: 0.2\n- target_deg: {RodD: 10}\n"
        )

        held.load(file)

        assert held.program.duration == 1.2
        assert held.simulate().stop_time == pytest.approx(1.2)  # one run
        assert Program.load(held.save(file)) == held.program.on("humanoid_box")

    def test_short_forms_come_back_as_they_went(self, tmp_path):
        text = (
            "moves:\n- walk: {steps: 3}\n- {act: wave}\n- {attach: parcel}\n- {release: parcel}\n"
        )
        (tmp_path / "short.yaml").write_text(text)

        program = Program.load(tmp_path / "short.yaml")

        assert program.save(tmp_path / "again.yaml").read_text() == text


class TestTools:
    def test_the_left_hand_takes_and_feels_the_weight(self, held):
        """0.1 kg at some way ahead of the left shoulder: its torque by the lever, and nothing at the right one."""
        held.test_move({"HomIF": 60, "HomDF": 60}, 0.2)
        mount = transform_from_pose(held.pose("left_hand"))
        before = {
            side: held.test_move({"RodD": 0}, 0.1)[f"tau.{side}_shoulder_pitch"][-1]
            for side in ("left", "right")
        }
        held.attach("parcel", "left_hand", pose=IN_HAND)

        place = mount @ transform_from_pose(IN_HAND)

        np.testing.assert_allclose(
            held.cell.frame("parcel").GetAsMatrix4(), place.GetAsMatrix4(), atol=1e-9
        )

        result = held.test_move({"RodD": 0}, 0.1)
        plant = held.cell.model.plant
        shoulder = held.cell.model.pose(
            plant.GetJointByName("left_shoulder_frontal").frame_on_child()
        ).translation()

        lever = shoulder[1] - place.translation()[1]  # it looks to -y

        assert lever > 0.03
        more = result["tau.left_shoulder_pitch"][-1] - before["left"]
        assert more == pytest.approx(0.1 * 9.80665 * lever, rel=1e-3)
        assert result["tau.right_shoulder_pitch"][-1] == pytest.approx(before["right"], abs=1e-6)
        assert held.cell.model.robots["robot"].tcp == "parcel"

        held.release("parcel")
        assert held.cell.model.robots["robot"].tcp == "left_hand"

    def test_the_other_hand_takes_it_over(self, held):
        for tool in ("left_hand", "right_hand", "left_foot"):
            held.attach("parcel", tool, pose=IN_HAND, store=True)
            assert held.cell.config.pieces["parcel"].frame == tool
            place = (
                transform_from_pose(held.pose(tool)) @ transform_from_pose(IN_HAND)
            ).GetAsMatrix4()
            np.testing.assert_allclose(held.cell.frame("parcel").GetAsMatrix4(), place, atol=1e-9)

        held.add_move({"CadIF": 30}, 0.2)
        moved = held.cell.frame("parcel").GetAsMatrix4()

        assert np.linalg.norm(moved[:3, 3] - place[:3, 3]) > 0.05  # the foot has taken it along
        kept = {"piece": "parcel", "tool": "left_hand", "pose": IN_HAND}
        assert held.program.moves[0].entry() == {"attach": kept}

        held.simulate()
        np.testing.assert_allclose(held.cell.frame("parcel").GetAsMatrix4(), moved, atol=1e-9)

    def test_a_piece_that_is_carried_carries_another(self, held):
        held.attach("stand", "left_hand", pose=IN_HAND)
        held.attach("parcel", "stand", pose=[0.0, 0.0, 0.03, 0.0, 0.0, 0.0])
        assert held.cell.config.pieces["parcel"].parent == "stand"

    def test_on_its_feet_it_takes_with_the_left_hand(self, carrier):
        carrier.attach("parcel", "left_hand", pose=IN_HAND)

        assert carrier.test_move({"HomIF": 40}, 0.5).ending == "completed"

        seen = transform_from_pose(carrier.pose("left_hand")) @ transform_from_pose(IN_HAND)
        np.testing.assert_allclose(
            carrier.cell.frame("parcel").GetAsMatrix4(), seen.GetAsMatrix4(), atol=1e-9
        )

    def test_a_station_file_names_the_hand(self):
        station = load_station(
            "humanoid_box",
            {"pieces.parcel": {"parent": "robot", "frame": "left_hand", "pose": [0.0] * 6}},
        )
        robot = LeggedRobot(station)

        np.testing.assert_allclose(
            robot.cell.frame("parcel").translation(), robot.pose("left_hand")[:3], atol=1e-9
        )
        with pytest.raises(
            InvalidConfig,
            match=r"tool or link of robot for pieces\.parcel\.frame 'left_hnd'; did you mean 'left_",
        ):
            load_station(
                "humanoid_box", {"pieces.parcel": {"parent": "robot", "frame": "left_hnd"}}
            )


class TestErrors:
    @pytest.mark.parametrize(
        ("move", "error", "message"),
        [
            (
                {"walk": {"steps": 4, "gait": "trot"}},
                UnknownName,
                "^move 2: there is no gait of humanoid 'trot'",
            ),
            (
                {"walk": {"steps": 4, "amplitude": 30}},
                OutOfReach,
                r"^move 2: the leg of right_foot is \d+ mm too short",
            ),
            (
                {"walk": {"steps": -1}},
                InvalidParameter,
                "^move 2: steps is -1; it must be a whole number, 1 to",
            ),
            (
                {"walk": {"steps": 0}},
                InvalidParameter,
                "^move 2: steps is 0; it must be a whole number, 1 to",
            ),
            (
                {"walk": {"steps": 4, "amplitud": 2}},
                UnknownName,
                "^move 2: there is no parameter of the gait walk 'amp",
            ),
            (
                {"act": "swim"},
                InvalidParameter,
                "^move 2: station is humanoid_dynamic; .* for swim",
            ),
            (
                {"attach": "parcle"},
                UnknownName,
                "^move 2: there is no piece 'parcle'; did you mean 'parcel'",
            ),
            (
                {"attach": {"piece": "parcel", "tool": "left_hnd"}},
                UnknownName,
                "^move 2: .* did you mean 'left_hand'",
            ),
            (
                {"release": {"piece": "parcel", "parent": "parcel"}},
                InvalidParameter,
                "^move 2: parcel: it is attached to no robot",
            ),
            (
                {"HomDF": 200},
                JointLimitExceeded,
                "^move 2: right_shoulder_pitch would be at 200 deg",
            ),
        ],
    )
    def test_the_move_is_named_and_nothing_happens(self, carrier, move, error, message):
        carrier.add_move(ARM, 0.1)
        before = snapshot(carrier)

        with pytest.raises(error, match=message):
            carrier.insert(1, move)
        moves = [
            {"target_deg": ARM},
            move if error is not JointLimitExceeded else {"target_deg": move},
        ]
        if error is not InvalidConfig:
            with pytest.raises(error, match=message):
                carrier.run(Program.model_validate({"moves": moves}))
        assert snapshot(carrier) == before

    def test_a_duration_goes_with_targets(self, held):
        held.insert(0, {"act": "wave"})
        for do in (
            lambda: held.edit(0, duration=2.0),
            lambda: held.insert(0, {"act": "wave"}, 2.0),
        ):
            with pytest.raises(InvalidParameter, match=r"duration: .*; leave it out"):
                do()

    def test_pieces_alone_take_no_time(self, held):
        held.attach("parcel", pose=IN_HAND, store=True)
        with pytest.raises(InvalidParameter, match="it has no move that takes time"):
            held.simulate()

    @pytest.mark.parametrize("piece", [3, None, ["parcel"]])
    def test_a_piece_goes_by_its_name(self, held, piece):
        with pytest.raises(InvalidParameter, match=r"piece is .*; it must be a text"):
            held.attach(piece)

    def test_only_moves_of_joints_run_beside_those_of_other_robots(self):
        robot = LeggedRobot(Workcell("three_humanoids"), "humanoid")
        program = Program.model_validate({"moves": [{"target_deg": ARM}, {"act": "wave"}]})
        with pytest.raises(InvalidParameter, match="move 2 is act; it must be a move of joints"):
            robot.reference_of(program)

    @pytest.mark.parametrize(
        ("entry", "message"),
        [
            ("{wlak: {steps: 3}}", "move 2: wlak: unknown key; did you mean 'walk'?"),
            ("{walk: {stes: 3}}", "move 2: walk.steps: this key is required"),
            ("{walk: 3}", "move 2: walk: "),
            ("{walk: {steps: 2.5}}", "move 2: walk.steps: "),
            ("{act: wave, duration: 3}", "move 2: duration: unknown key"),
            ("{attach: {piece: parcel, pose: [0, 0]}}", "move 2: attach.pose: "),
            (
                "{release: {piece: parcel, parnt: world}}",
                "move 2: release.parnt: unknown key; did you mean 'parent'",
            ),
            ("{duration: 3}", "move 2: target_deg: this key is required"),
        ],
    )
    def test_a_damaged_file_tells_where(self, tmp_path, entry, message):
        file = tmp_path / "program.yaml"
        file.write_text(f"moves:\n- {{act: wave}}\n- {entry}\n")

        with pytest.raises(InvalidConfig) as problem:
            Program.load(file)
        assert str(problem.value).startswith(f"{file}: {message}")
