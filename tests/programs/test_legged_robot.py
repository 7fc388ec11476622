"""Legged robots do what joint angles tell them, and go on from where they stand."""

import re

import numpy as np
import pytest

from simrob_drake import Arm, LeggedRobot, Program, SimrobError, Workcell, load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.kinematics import Unreachable
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.quadruped import three_legs
from simrob_drake.programs.gaits.registry import first_gait, gaits_of
from simrob_drake.programs.legged_gait import planned_gait, taught_arms
from simrob_drake.robots.catalog import load_robot

pytestmark = pytest.mark.usefixtures("no_plots")

HUMANOIDS = ("humanoid", "roid1", "zjudancer")
ARM, KNEES = (
    {"HomDF": 40},
    {"CadDF": 15, "RodD": 45, "TobD": -30, "CadIF": 15, "RodI": 45, "TobI": -30},
)


@pytest.fixture
def standing():
    """The humanoid on its own feet."""
    return LeggedRobot("humanoid_dynamic")


@pytest.fixture
def held():
    """The humanoid held by its trunk, motion as the input."""
    return LeggedRobot("humanoid_fixed")


def snapshot(robot):
    state = None if robot.cell.state is None else robot.cell.state.to_json()
    return robot.program, state, robot.cell.config


def turned(robot, axis):
    return np.rad2deg(robot.position[robot.axes.index(axis)])


FEET = (("walk", "spheres_C"), ("march", None))  # that two gaits are made for


class TestMoves:
    def test_a_test_moves_and_stores_nothing(self, held):
        result = held.test_move({"HomDF": 40, "left_knee": 20}, 0.5)

        assert result.stop_time == 0.5
        assert turned(held, "right_shoulder_pitch") == pytest.approx(40)
        assert turned(held, "left_knee") == pytest.approx(20)
        assert held.program == Program()

        held.test_move({"RodI": 30}, 0.5)
        assert turned(held, "right_shoulder_pitch") == pytest.approx(40)  # who is not named stays
        assert turned(held, "left_knee") == pytest.approx(30)  # angles are absolute

    def test_a_kinematic_move_has_a_torque(self, held):
        """It is smooth: rest at both ends, and the peak speed of the polynomial of degree five."""
        result = held.test_move({"HomDF": 40}, 0.5)

        speed = np.rad2deg(result["v.right_shoulder_pitch"])
        assert speed.max() == pytest.approx(1.875 * 40 / 0.5, rel=1e-3)
        np.testing.assert_allclose(speed[[0, -1]], 0, atol=1e-9)
        assert 0.01 < np.abs(result["tau.right_shoulder_pitch"]).max() < 3

    def test_two_tests_are_one_run(self, standing):
        """Joints, velocities and the pose of the trunk go on: cut in two, a move ends where the whole one does."""
        standing.test_move(KNEES, 1.0)
        half = standing.velocity

        second = standing.test_move(KNEES | {"HomDF": 30}, 0.6)
        assert np.abs(half).max() > 0.05  # it was on its way: the servos lag by 1 s
        np.testing.assert_allclose(second.axes("v")[0], half, atol=1e-9)

        whole = LeggedRobot("humanoid_dynamic")
        program = Program.model_validate(
            {"moves": [{"target_deg": KNEES}, {"target_deg": {"HomDF": 30}, "duration": 0.6}]}
        )

        result = whole.run(program)
        assert result.stop_time == pytest.approx(1.6)
        # accuracy 1e-3, steps of 20 ms
        np.testing.assert_allclose(standing.position, whole.position, atol=2e-3)

        apart = standing.base_pose.translation() - whole.base_pose.translation()
        assert np.linalg.norm(apart) < 1e-3

        sunk = standing.base_pose.translation()[2]
        assert 0.40 < sunk < 0.4455  # and it did bend its knees

    def test_ramps_are_straight_on_a_dynamic_station(self, standing):
        result = standing.add_move(ARM, 0.5)
        reference = np.rad2deg(result["q_ref.right_shoulder_pitch"])
        np.testing.assert_allclose(reference, 80 * result.times, atol=1e-9)

    def test_the_program_in_one_run_ends_where_its_moves_did(self, standing):
        for targets, duration in ((KNEES, 1.0), (ARM, 0.5)):
            standing.add_move(targets, duration)
        q, base = standing.position, standing.base_pose.translation()

        result = standing.simulate()

        assert result.stop_time == pytest.approx(1.5)
        assert result.start is None
        np.testing.assert_allclose(standing.position, q, atol=2e-3)
        np.testing.assert_allclose(standing.base_pose.translation(), base, atol=1e-3)

        again = standing.simulate()
        # from the start, to the last bit
        np.testing.assert_array_equal(again.values, result.values)

    def test_the_step_of_the_thesis(self, standing):
        result = standing.step()

        assert [dict(move.target_deg) for move in standing.program.moves][1] == {
            "RodD": 30,
            "TobD": -30,
        }
        assert result.ending == "completed"
        assert standing.base_pose.translation()[1] == pytest.approx(-0.06, abs=0.02)  # towards -y
        assert standing.base_pose.rotation().matrix()[2, 2] > np.cos(np.deg2rad(4))

    def test_a_reference_is_kept_for_the_sequencer(self, held):
        held.add_reference({"HomIF": 30, "CadDF": 30})
        held.add_reference({"HomIF": 0})

        assert held.cell.state is None
        assert [cell.target_deg for cell in held.program.references] == [
            {"HomIF": 30, "CadDF": 30},
            {"HomIF": 0},
        ]
        assert held.program.moves == ()

    def test_robots_of_a_station_move_one_at_a_time(self):
        config = load_station("humanoid_fixed")
        entry = config.robots["robot"]
        robots = {
            name: entry.model_copy(update={"base": (x, 0.0, 0.44, 0.0, 0.0, 0.0)})
            for name, x in (("left", 0.3), ("right", -0.3))
        }
        config = config.model_copy(update={"robots": robots, "name": "two_humanoids"})
        cell = Workcell(config)
        left, right = LeggedRobot(cell, "left"), LeggedRobot(cell, "right")
        left.test_move(ARM, 0.2)

        right.test_move({"HomIF": 10}, 0.2)

        assert turned(left, "right_shoulder_pitch") == pytest.approx(40)
        assert turned(right, "right_shoulder_pitch") == 0
        np.testing.assert_allclose(
            left.pose("head")[:2] - right.pose("head")[:2], [0.6, 0], atol=1e-12
        )
        with pytest.raises(InvalidParameter, match="one of left, right"):
            LeggedRobot(cell)


class TestEditing:
    def test_moves_are_inserted_edited_and_removed(self, held):
        held.add_move(ARM, 0.2)
        held.add_move({"RodD": 10}, 0.2)
        held.insert(1, {"RodI": 20}, 0.3)
        held.edit(0, {"HomDF": 60})

        held.edit(-1, duration=0.4)

        assert [(dict(move.target_deg), move.duration) for move in held.program.moves] == [
            ({"HomDF": 60}, 0.2),
            ({"RodI": 20}, 0.3),
            ({"RodD": 10}, 0.4),
        ]
        assert turned(held, "right_shoulder_pitch") == pytest.approx(40)  # it stays where it is

        result = held.simulate()
        assert result.stop_time == pytest.approx(0.9)
        assert [
            turned(held, axis) for axis in ("right_shoulder_pitch", "left_knee", "right_knee")
        ] == pytest.approx([60, 20, 10])

        held.remove(0)
        held.simulate()

        assert turned(held, "right_shoulder_pitch") == 0

    def test_undo_takes_back_robot_and_program(self, standing):
        seen = [snapshot(standing)]
        for do in (
            lambda: standing.test_move(ARM, 0.1),
            lambda: standing.add_move(ARM, 0.1),
            lambda: standing.insert(0, KNEES),
            lambda: standing.edit(0, duration=0.2),
            lambda: standing.add_reference(ARM),
            standing.remove,
            standing.simulate,
            standing.reset,
        ):
            do()
            seen.append(snapshot(standing))

        for before in reversed(seen[:-1]):
            standing.undo()
            assert snapshot(standing) == before
        with pytest.raises(InvalidParameter, match="undo: nothing has been done yet"):
            standing.undo()

    def test_alternatives_are_tried_from_the_same_state(self, standing):
        standing.add_move(KNEES, 0.3)
        first = standing.test_move({"HomDF": 30}, 0.2)
        standing.undo()
        standing.test_move({"HomDF": -30}, 0.2)

        standing.undo()

        np.testing.assert_array_equal(standing.test_move({"HomDF": 30}, 0.2).values, first.values)

    def test_reset_goes_back_to_the_start(self, standing):
        standing.add_move(KNEES, 0.3)
        standing.reset(keep_program=True)

        assert len(standing.program.moves) == 1
        np.testing.assert_array_equal(standing.position, np.zeros(18))
        np.testing.assert_array_equal(standing.base_pose.translation(), [0, 0, 0.446])

        standing.reset()
        assert standing.program == Program()

    def test_a_program_is_saved_and_loaded(self, held, tmp_path):
        held.add_move(ARM, 0.2)
        held.add_reference({"RodD": 10})
        file = held.save(tmp_path / "arm.yaml")
        other = LeggedRobot("zjudancer_dynamic")

        other.load(file)

        assert other.program == held.program.on("humanoid_fixed")
        assert other.run(file).stop_time == pytest.approx(0.2)


class TestEveryRobot:
    @pytest.mark.parametrize("name", HUMANOIDS)
    def test_one_program_has_one_effect(self, name):
        """HomIF 30 brings the left hand ahead and up, CadDF 30 the right foot: seen from the robot, on each of them."""
        robot = LeggedRobot(
            load_station(f"{name}_dynamic", {"mode": "kinematic", "contact": None, "monitors": {}})
        )
        before = {tool: robot.pose(tool, frame="trunk")[:3] for tool in robot.tools}
        robot.run(Program.model_validate({"moves": [{"target_deg": {"HomIF": 30, "CadDF": 30}}]}))
        left = before["left_foot"] - before["right_foot"]
        up = transform_from_pose([0, 0, 0, 0, 0, 0]).inverse().rotation().matrix()[2]

        vertical = robot.base_pose.rotation().inverse().matrix() @ up

        ahead = np.cross(left, vertical) / np.linalg.norm(left)
        for tool in robot.tools:
            moved = robot.pose(tool, frame="trunk")[:3] - before[tool]
            if tool in ("left_hand", "right_foot"):
                assert moved @ ahead > 0.05
                assert moved @ vertical > 0.005
            else:
                np.testing.assert_allclose(moved, 0, atol=1e-9)

    @pytest.mark.long
    @pytest.mark.parametrize(
        ("name", "steps", "least"), [("humanoid", 1, 0.08), ("yobotics", 2, 0.25)]
    )
    def test_it_walks_from_where_it_stands(self, name, steps, least):
        robot = LeggedRobot(f"{name}_dynamic")
        config = robot.cell.config

        result = robot.walk(steps)

        assert result.ending == "completed"

        measures = result.summary()["locomotion"]
        assert measures["ahead"] > least
        assert abs(measures["drift"]) < 0.02
        # servos and solver are its own again, and the floor was large enough
        assert robot.cell.config == config

        robot.undo()
        half = robot.walk(steps, amplitude=0.5).summary()["locomotion"]

        assert half["ahead"] == pytest.approx(measures["ahead"] / 2, rel=0.25)

    @pytest.mark.long
    def test_a_far_walk_gets_a_larger_floor(self):
        robot = LeggedRobot(load_station("roid1_dynamic", {"floor.size": 0.5}))
        robot.walk(2)
        assert robot.cell.config.floor.size >= 2

    def test_a_gait_is_made_for_its_feet(self):
        robot = LeggedRobot(load_station("humanoid_dynamic", {"robot.feet": "spheres_B"}))
        with pytest.raises(
            InvalidParameter,
            match=r"is spheres_B; it must be spheres_C for the gait walk: set robot\.feet to spheres_C",
        ):
            robot.walk(2, gait="walk")

    @pytest.mark.parametrize(
        ("name", "least"),
        [
            pytest.param("roid1", 0.06, marks=pytest.mark.long),
            ("zjudancer", 0.1),
            ("humanoid", 0.06),
        ],
    )
    def test_feet_as_large_carry_a_gait_that_is_made_for_others(self, name, least):
        """Soles under what is planned for spheres; the humanoid's, 15 % narrower than those of `real_sole`, too."""
        soles = {"robot.feet": "soles", "contact.model": "hydroelastic_with_fallback"}
        robot = LeggedRobot(load_station(f"{name}_dynamic", soles))

        result = robot.walk(4)

        assert result.ending == "completed"
        assert result.summary()["locomotion"]["ahead"] > least

    def test_feet_without_a_gait_are_told(self):
        gaits = gaits_of("humanoid", steps=True)
        known = {name: gaits[name].model_copy(update={"feet": feet}) for name, feet in FEET}
        with pytest.raises(
            InvalidParameter,
            match=r"is soles; it must be a kind for which it has a gait: spheres_C \(robot",
        ):
            first_gait(load_robot("humanoid"), "soles", known)


class TestStep:
    """One step: upright, ahead by its length within a third, and standing at the end."""

    @pytest.mark.parametrize(
        "solver",
        [
            pytest.param({}, id=""),
            pytest.param({"solver.max_step": 0.0025}, id="tight", marks=pytest.mark.long),
        ],
    )
    @pytest.mark.parametrize(
        ("name", "way", "feet"),
        [
            ("roid1", 0.07, None),
            pytest.param("zjudancer", 0.1, None, marks=pytest.mark.long),
            ("yobotics", 0.15, None),
            ("humanoid", 0.06, None),
            pytest.param("humanoid", 0.06, "spheres_B", marks=pytest.mark.long),
        ],
    )
    def test_every_legged_robot_takes_a_step(self, name, way, feet, solver):
        station = f"{name}_dynamic"
        robot = LeggedRobot(
            load_station(station, solver if feet is None else solver | {"robot.feet": feet})
        )
        upright = robot.base_pose.rotation().matrix()[2]

        result = robot.step()

        assert result.ending == "completed"
        assert result.summary()["locomotion"]["ahead"] == pytest.approx(way, rel=0.33)
        assert abs(result.summary()["locomotion"]["drift"]) < 0.01
        assert robot.base_pose.rotation().matrix()[2] @ upright > np.cos(np.deg2rad(4))
        assert len(robot.program.moves) == (4 if name == "humanoid" and feet is None else 1)

        stays = robot.base_pose.translation()
        robot.test_move({robot.axes[0]: np.rad2deg(robot.reference[0])}, 1.0)

        # the humanoid's servos lag by 1 s
        np.testing.assert_allclose(robot.base_pose.translation(), stays, atol=0.015)

    @pytest.mark.long
    def test_the_act_of_that_name_goes_as_far(self, standing):
        """Neither is told the reference's velocity, as in the thesis; the act stands for 2 s behind the step."""
        act = standing.act("step").summary()["locomotion"]
        standing.reset()
        start = standing.base_pose.translation()
        standing.step()
        standing.cell.wait(2.0)

        way = start[1] - standing.base_pose.translation()[1]

        assert act["ahead"] == pytest.approx(way, abs=0.002)
        assert way == pytest.approx(0.07, abs=0.004)

    @pytest.mark.long
    def test_its_time_is_that_of_its_moves(self):
        quick, slow = LeggedRobot("humanoid_fixed"), LeggedRobot("roid1_dynamic")
        quick.step(0.1)

        assert [move.duration for move in quick.program.moves] == [0.1] * 4

        slow.step(0.5)
        assert slow.program.moves[0].entry()["walk"] == {
            "steps": 1,
            "ramp_steps": 0,
            "step_time": 0.5,
        }

    def test_who_has_no_legs_is_told(self):
        with pytest.raises(
            InvalidParameter, match=r"robot is irb120; .* a robot with legs, for step\(\)"
        ):
            LeggedRobot("irb120_dynamic").step()


class TestGaits:
    @pytest.mark.long
    def test_it_marches_from_where_it_stands(self, standing):
        """As the march planned alone does: 4 steps of the thesis's manner go 0.12 to 0.25 m."""
        config = standing.cell.config
        result = standing.walk(4, gait="march")

        # the gains of the thesis as they are
        assert "reference_velocity" not in result.config.inputs
        assert result.ending == "completed"
        assert 0.12 < result.summary()["locomotion"]["ahead"] < 0.25
        assert standing.cell.config == config

    def test_a_sequence_ends_in_its_last_posture(self, held):
        held.test_move(ARM, 0.2)
        result = held.act("wave", rest=0.0)

        begun = result.stop_time - 4.0  # into its posture, 45 deg away, and there
        assert begun == pytest.approx(2.0 + 0.5)
        at = np.interp(
            begun + np.array([0.0, 1.0, 1.5]), result.times, np.rad2deg(result["q.right_elbow"])
        )
        assert at == pytest.approx((0, 20, 60), abs=1e-3)
        assert turned(held, "right_shoulder_pitch") == pytest.approx(0, abs=1e-6)
        assert held.program == Program()

        held.undo()
        assert turned(held, "right_shoulder_pitch") == pytest.approx(40)

    @pytest.mark.parametrize("name", [pytest.param("humanoid", marks=pytest.mark.long), "yobotics"])
    def test_who_stands_in_the_posture_of_a_gait_begins_at_once(self, name):
        robot = LeggedRobot(f"{name}_dynamic")
        first, second = (robot.walk(4, store=True) for _ in range(2))

        planned = planned_gait(robot, None, {}, steps=4).duration

        assert planned <= second.stop_time < planned + 0.2
        assert second.stop_time < first.stop_time
        assert second.ending == "completed"

        ahead = [result.summary()["locomotion"]["ahead"] for result in (first, second)]
        assert ahead[1] == pytest.approx(ahead[0], rel=0.2)  # it walks as well

    @pytest.mark.long
    def test_who_is_still_moving_settles_first(self, held):
        held.act("wave", rest=0.0)

        assert held.act("wave", rest=0.0).stop_time == pytest.approx(4.0)  # there already

        held.test_move({"HomDF": 20}, 0.3)
        assert held.act("wave", rest=0.0).stop_time == pytest.approx(
            4.0 + 2.5 * np.sqrt(20 / 45), abs=0.02
        )

        standing = LeggedRobot("humanoid_dynamic")
        ready = standing.act("crouch", rest=0.0).stop_time
        standing.test_move({"HomDF": 40}, 0.1)

        standing.test_move({"HomDF": 0}, 0.1)  # back in the posture, by its references

        assert standing.act("crouch", rest=0.0).stop_time == pytest.approx(6.5)
        assert ready > 6.5

    def test_figures_of_an_act_can_be_changed(self, held):
        held.act("swim")
        once, twice = (held.act("swim", repeat=count).stop_time for count in (1, 2))
        assert twice - once == pytest.approx(2.0)

    @pytest.mark.long
    def test_the_quadruped_lifts_the_foot_that_is_asked_for(self):
        robot = LeggedRobot("yobotics_dynamic")
        result = robot.act("three_legs", foot="rear_right_foot", seconds=0.5, height=0.03)
        planned = three_legs("yobotics", foot="rear_right_foot", seconds=0.5).duration
        begun = result.stop_time - planned
        middle = result.axes("q")[np.searchsorted(result.times, begun + 1.5 + 0.6 + 0.25)]

        rise = {
            foot: robot.pose(foot, middle, "trunk")[2] - robot.pose(foot, frame="trunk")[2]
            for foot in robot.feet
        }

        assert rise.pop("rear_right_foot") == pytest.approx(0.03, abs=0.01)
        assert max(map(abs, rise.values())) < 0.005

    @pytest.mark.long
    def test_an_act_that_is_to_fall_is_done_when_the_robot_lies(self, standing):
        config = standing.cell.config
        result = standing.act("fall_forward", store=True)

        assert result.ending == "completed"
        assert len(standing.program.moves) == 1
        assert standing.pose("trunk" if "trunk" in standing.tools else "head")[2] < 0.3
        assert standing.cell.config.monitors == config.monitors  # of which one ends what comes next
        assert standing.act("bow").stopped_by == "fall"


class TestGeometry:
    def test_feet_and_head_are_where_the_figures_say(self, standing):
        """Of facts on the model: ankle ±44.42 mm beside the middle; head 34.4 mm over the trunk's frame."""
        np.testing.assert_allclose(
            standing.pose("left_foot")[:3], [0.04442, standing.pose("right_foot")[1], 0], atol=0.002
        )
        np.testing.assert_allclose(
            standing.pose("head", frame="trunk")[:3], [0, 0, 0.0344], atol=1e-6
        )

        moved = standing.pose("left_foot", np.zeros((2, 18)), "right_foot")
        assert moved.shape == (2, 6)
        np.testing.assert_allclose(np.linalg.norm(moved[:, :3], axis=1), 2 * 0.04442, atol=1e-6)

    def test_the_world_moves_with_the_trunk(self, standing):
        standing.test_move(KNEES, 1.0)
        trunk = standing.base_pose @ transform_from_pose(standing.pose("right_hand", frame="trunk"))

        np.testing.assert_allclose(trunk.translation(), standing.pose("right_hand")[:3], atol=1e-9)
        # on the floor, though the trunk sank
        assert standing.pose("left_foot")[2] == pytest.approx(0.0, abs=3e-3)

    @pytest.mark.parametrize("name", ["humanoid", "roid1", "yobotics"])
    def test_limbs_reach_places(self, name):
        robot = LeggedRobot(f"{name}_dynamic")
        for tool in [tool for tool in robot.tools if tool.endswith(("hand", "foot"))]:
            q = np.zeros(len(robot.axes))
            moving = list(robot.chain(tool).order)
            q[moving] = 0.2 + 0.1 * np.arange(len(moving))
            wanted = robot.pose(tool, q, "trunk")[:3]
            found = robot.joint(tool, wanted)
            np.testing.assert_allclose(robot.pose(tool, found, "trunk")[:3], wanted, atol=1e-5)
            others = [axis for axis in range(len(q)) if axis not in moving]
            np.testing.assert_array_equal(found[others], robot.reference[others])

    @pytest.mark.parametrize("name", HUMANOIDS)
    def test_every_humanoid_raises_its_hand(self, name):
        """The place of the docs: arms that hang straight bend, whatever side the robot looks to."""
        robot = LeggedRobot(f"{name}_dynamic")
        place = robot.pose("right_hand", frame="trunk")[:3] + np.array([0, 0, 0.05])

        q = robot.joint("right_hand", place)

        np.testing.assert_allclose(robot.pose("right_hand", q, "trunk")[:3], place, atol=1e-5)

    def test_a_leg_of_six_axes_reaches_a_pose(self):
        robot = LeggedRobot("roid1_dynamic")
        pose = robot.pose("left_foot", frame="trunk") + np.array(
            [0.02, 0.01, 0.03, 0.1, 0.05, -0.05]
        )

        q = robot.joint("left_foot", pose)

        np.testing.assert_allclose(robot.pose("left_foot", q, "trunk"), pose, atol=1e-4)
        assert set(robot.targets_deg(q)) <= {
            axis for axis in robot.axes if axis.startswith("left_")
        }

    def test_the_whole_body_reaches_from_a_standing_foot(self, standing):
        place = standing.pose("left_hand", frame="right_foot")[:3] + np.array([0, -0.05, 0.02])
        q = standing.joint("left_hand", place, "right_foot")
        np.testing.assert_allclose(
            standing.pose("left_hand", q, "right_foot")[:3], place, atol=1e-5
        )

    @pytest.mark.parametrize(
        ("name", "shift"),
        [
            ("humanoid", [0, 0, -0.03]),
            ("roid1", [0, 0.015, -0.02]),
            ("yobotics", [0.02, 0.01, -0.03]),
        ],
    )
    def test_the_trunk_moves_over_feet_that_stay(self, name, shift):
        robot = LeggedRobot(f"{name}_dynamic")
        robot.test_move({robot.axes[0]: 0}, 0.1)  # it settles

        feet, trunk = {foot: robot.pose(foot)[:3] for foot in robot.feet}, robot.base_pose

        assert len(feet) == (4 if name == "yobotics" else 2)

        q = robot.posture(transform_from_pose([*shift, 0, 0, 0]) @ trunk)
        robot.test_move(robot.targets_deg(q), 1.0)

        # a lag of 1 s
        robot.test_move({robot.axes[0]: np.rad2deg(q[0])}, 5.0 if name == "humanoid" else 0.5)

        for foot, place in feet.items():
            np.testing.assert_allclose(robot.pose(foot)[:3], place, atol=2e-3)

        went = robot.base_pose.translation() - trunk.translation()
        np.testing.assert_allclose(went, shift, atol=3e-3)  # by the servos' errors under the weight

    def test_hands_reach_while_the_trunk_sinks(self, standing):
        trunk = transform_from_pose([0, 0, -0.03, 0, 0, 0]) @ standing.base_pose
        place = [-0.09, -0.12, 0.25]
        q = standing.posture(trunk, {"right_hand": place})

        hand = trunk @ transform_from_pose(standing.pose("right_hand", q, "trunk"))

        np.testing.assert_allclose(hand.translation(), place, atol=1e-5)
        for foot in standing.feet:
            stays = trunk @ transform_from_pose(standing.pose(foot, q, "trunk"))
            np.testing.assert_allclose(stays.translation(), standing.pose(foot)[:3], atol=1e-4)

    def test_a_trunk_that_is_held_stays(self, held):
        with pytest.raises(InvalidParameter, match="a robot that stands on its own feet"):
            held.posture([0, 0, 0.4, 0, 0, 0])

    def test_the_trunk_cannot_fly(self, standing):
        with pytest.raises(Unreachable):
            standing.posture([0, 0, 0.6, 0, 0, 0])

    def test_what_is_too_far_is_unreachable(self, standing):
        with pytest.raises(Unreachable):
            standing.joint("right_hand", [0, -1.0, 0])

    def test_an_unknown_tool_has_a_nearest_name(self, standing):
        with pytest.raises(UnknownName, match=r"did you mean 'left_foot'\?"):
            standing.pose("left_fot")
        with pytest.raises(InvalidParameter, match="a posture of 18 axes"):
            standing.targets_deg([0.0])


class TestErrors:
    @pytest.mark.parametrize(
        ("do", "error", "message"),
        [
            (lambda r: r.test_move({"HomDG": 3}), UnknownName, r"did you mean 'Hom\w+'\?"),
            (lambda r: r.add_move({"left_kne": 3}), UnknownName, "did you mean 'left_knee'"),
            (
                lambda r: r.test_move({"HomDF": 200}),
                JointLimitExceeded,
                "right_shoulder_pitch would be at 200 deg, 20 deg",
            ),
            (
                lambda r: r.add_reference({"HomDF": -200}),
                JointLimitExceeded,
                "110 deg beyond its limit of -90 deg",
            ),
            (lambda r: r.test_move({"HomDF": 10}, 0), InvalidParameter, "duration is 0"),
            (lambda r: r.step(-1), InvalidParameter, "duration is -1"),
            (lambda r: r.edit(0, duration=0), InvalidParameter, "duration is 0"),
            (lambda r: r.edit(0, {"HomDF": 999}), JointLimitExceeded, "beyond its limit"),
            (lambda r: r.insert(9, {"HomDF": 9}), InvalidParameter, "index is 9"),
            (lambda r: r.remove(1), InvalidParameter, "index is 1"),
            (
                lambda r: r.run(Program()),
                InvalidParameter,
                "the program: it has no move that takes time",
            ),
            (lambda r: r.run("none.yaml"), InvalidConfig, "none.yaml: cannot be read"),
            (lambda r: r.walk(0), InvalidParameter, "steps is 0; it must be a whole number, 1 to"),
            (
                lambda r: r.walk(-1, gait="march"),
                InvalidParameter,
                "steps is -1; it must be a whole number, 1 to",
            ),
            (lambda r: r.walk(2, gait="trott"), UnknownName, "gait of humanoid"),
            (lambda r: r.walk(4, gait="bow"), UnknownName, "gait of humanoid 'bow'"),
            (
                lambda r: r.walk(4, gait="march", amplitude=5),
                JointLimitExceeded,
                "march at .* right_ankle_pitch",
            ),
            (
                lambda r: r.walk(4, step_tme=1),
                UnknownName,
                "parameter of the gait walk 'step_tme'; did you mean 'step_t",
            ),
            (
                lambda r: r.walk(4, feet="spheres_A"),
                InvalidParameter,
                "is spheres_C; .*set robot.feet to spheres_A",
            ),
            (lambda r: r.act("bwo"), UnknownName, "act of humanoid 'bwo'; did you mean 'bow'"),
            (lambda r: r.act("bow", repeat=0), InvalidConfig, "gait bow: repeat"),
            (
                lambda r: r.act("swim"),
                InvalidParameter,
                "a station that holds the trunk of humanoid, for swim",
            ),
            (
                lambda r: r.walk(4, amplitude=20),
                OutOfReach,
                r"leg of right_foot is \d+ mm too short",
            ),
            (lambda r: r.walk(4, amplitude=float("nan")), InvalidParameter, "amplitude"),
        ],
    )
    def test_all_stays_as_it_was(self, standing, do, error, message):
        standing.add_move(ARM, 0.05)
        before = snapshot(standing)

        with pytest.raises(error, match=message):
            do(standing)
        assert snapshot(standing) == before

        standing.undo()
        assert standing.program == Program()  # nor did the error leave anything to undo

    def test_the_feet_of_one_of_several_robots_have_a_key_of_their_own(self, tmp_path):
        """A gait for other feet names the key that chooses them: `robot.feet` belongs to a single robot only."""
        file = tmp_path / "pair.yaml"
        file.write_text(
            """
            robots:
              first: {model: humanoid, base: [0, 0, 0.446, 0, 0, 0], feet: spheres_C}
              second: {model: humanoid, base: [2, 0, 0.446, 0, 0, 0], feet: spheres_C}
            floor: {size: 6}
            contact: {model: point}
            """
        )
        robot = LeggedRobot(file, "second")

        with pytest.raises(InvalidParameter, match=r"set robots\.second\.feet to spheres_A"):
            robot.walk(4, feet="spheres_A")

    def test_an_empty_program_cannot_be_simulated(self, standing):
        with pytest.raises(
            InvalidParameter, match=r"the program: it has no move that takes time; .*add_move"
        ):
            standing.simulate()

    @pytest.mark.parametrize(
        ("station", "message"),
        [("irb120_dynamic", "a robot without gaits"), ("humanoid_fixed", "a dynamic station")],
    )
    def test_who_cannot_walk_is_told_why(self, station, message):
        with pytest.raises(InvalidParameter, match=message):
            LeggedRobot(station).walk(4)

    def test_a_program_that_the_robot_cannot_do_is_not_loaded(self, standing, tmp_path):
        file = Program.model_validate({"moves": [{"target_deg": {"torso_yaw": 10}}]}).save(
            tmp_path / "turn.yaml"
        )
        with pytest.raises(
            UnknownName, match=r"axis of humanoid \(under .*turn\.yaml: move 1\) 'torso_yaw'"
        ):
            standing.load(file)
        assert standing.program == Program()

    @pytest.mark.parametrize(
        ("content", "says"),
        [
            (
                {"moves": [{"target_deg": ARM}, {"target_deg": {"HomDF": 200}}]},
                "move 2: right_shoulder_pitch would be",
            ),
            (
                {"moves": [{"target_deg": {"HomDF": 200}}]},
                "move 1: right_shoulder_pitch would be at 200 deg",
            ),
            (
                {"moves": [{"walk": {"steps": 0}}]},
                "move 1: steps is 0; it must be a whole number, 1 to",
            ),
            (
                {"references": [{"target_deg": {"HomDF": 200}}]},
                "reference 1: right_shoulder_pitch would be",
            ),
        ],
    )
    def test_a_file_and_its_move_are_named(self, standing, tmp_path, content, says):
        file = Program.model_validate(content).save(tmp_path / "program.yaml")
        with pytest.raises(SimrobError, match=f"^{re.escape(f'{file}: {says}')}"):
            standing.load(file)
        if "moves" in content:
            with pytest.raises(SimrobError, match=f"^{re.escape(f'{file}: {says}')}"):
                standing.run(file)

    def test_a_station_without_that_robot(self):
        with pytest.raises(SimrobError, match="there is no robot 'left'"):
            LeggedRobot("humanoid_fixed", "left")
        for programmed in (LeggedRobot, Arm):
            with pytest.raises(
                InvalidParameter,
                match="station is bouncing_ball; it must be a station with a robot",
            ):
                programmed("bouncing_ball")

    def test_legs_are_not_for_arms(self):
        with pytest.raises(
            InvalidParameter, match=r"robot is humanoid; .* LeggedRobot programs robots with legs"
        ):
            Arm("humanoid_dynamic")

    def test_one_move_is_one(self, held):
        held.insert(0, ARM)
        with pytest.raises(InvalidParameter, match=r"the program has 1 move$"):
            held.remove(3)


TIP = {"TobD": -80, "TobI": -80}  # over, by the ankles' turn


class TestFalls:
    """A robot that falls is back where it was before, and so is its program."""

    def test_nothing_of_a_fall_is_stored(self, standing):
        standing.add_move(ARM, 0.3)
        before = snapshot(standing)

        result = standing.add_move(TIP, 3.0)

        assert result.stopped_by == "fall"
        assert "robot fell" in result.message
        assert np.isfinite(result.values).all()
        assert result.summary()["locomotion"]["fall_time"] == result.stop_time
        assert standing.runs == [result]
        assert snapshot(standing) == before
        assert standing.add_move(ARM, 1.0).ending == "completed"  # it stands
        assert len(standing.program.moves) == 2

        standing.undo()
        assert snapshot(standing) == before

        standing.undo()
        assert standing.program == Program()

    def test_nor_of_several_moves_of_which_one_falls(self, standing):
        before = snapshot(standing)
        falls = Program.model_validate(
            {"moves": [{"target_deg": TIP, "duration": 3.0}, {"act": "bow"}]}
        )

        assert standing.run(falls).stopped_by == "fall"
        assert snapshot(standing) == before

        standing.insert(0, TIP, 3.0)
        assert standing.simulate().stopped_by == "fall"
        assert standing.cell.state is None
        assert len(standing.program.moves) == 1  # what was stored stays, to be mended

    def test_another_monitor_ends_a_move_that_counts(self):
        high = float(LeggedRobot("humanoid_dynamic").pose("right_hand")[2]) + 0.01
        watch = {
            "kind": "workspace",
            "tool": "right_hand",
            "lower": [-1, -1, -1],
            "upper": [1, 1, high],
        }
        robot = LeggedRobot(load_station("humanoid_dynamic", {"monitors.high": watch}))

        result = robot.add_move({"HomDF": 90}, 1.0)

        assert result.stopped_by == "high"
        assert len(robot.program.moves) == 1
        np.testing.assert_array_equal(robot.position, result.axes("q")[-1])


@pytest.mark.long
def test_a_walk_leaves_arms_where_they_were_taught_to_be(standing):
    """Earlier in the same program too; legs and the other arm are the gait's own."""
    arm, other = (standing.axes.index(f"{side}_elbow") for side in ("left", "right"))
    plain = planned_gait(standing, None, {}, steps=1)
    assert taught_arms(standing) == {}

    standing.run(
        Program(moves=[{"target_deg": {"left_elbow": 60}, "duration": 0.5}, {"walk": {"steps": 1}}])
    )
    assert taught_arms(standing) == {"left_elbow": pytest.approx(60)}

    taught = planned_gait(standing, None, {}, steps=1)
    np.testing.assert_allclose(taught.positions[:, arm], np.deg2rad(60), atol=1e-9)
    np.testing.assert_allclose(taught.positions[:, other], plain.positions[:, other], atol=1e-9)

    bearing = next(iter(gaits_of(standing.model, steps=True).values())).bearing.model_dump()
    own = planned_gait(standing, None, {"bearing": bearing}, steps=1)
    np.testing.assert_allclose(own.positions[:, arm], plain.positions[:, arm], atol=1e-9)


@pytest.mark.parametrize("by_file", [False, True])
def test_a_saved_program_names_its_station_so_that_it_runs(tmp_path, by_file):
    """It was written without, and `simrob run` refused it."""
    station = "humanoid_dynamic"
    if by_file:
        station = tmp_path / "station.yaml"
        station.write_text(load_station("humanoid_dynamic").to_yaml())

    saved = Program.load(LeggedRobot(station).save(tmp_path / "program.yaml"))

    assert saved.station == str(station)


def test_a_saved_program_names_no_station_that_is_another(tmp_path):
    robot = LeggedRobot("humanoid_dynamic", overrides={"servo.kd": 20})

    assert Program.load(robot.save(tmp_path / "program.yaml")).station is None
