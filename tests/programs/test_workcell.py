"""A station goes on where its last run left it: pieces change hands, arms share it, recordings replay."""

import base64
import json
import urllib.request

import numpy as np
import pytest

from simrob_drake import Arm, SimrobError, State, Workcell, load_station, simulate
from simrob_drake.base.frames import transform_from_pose
from tests.programs.conftest import BARE, DOWN, HOME

pytestmark = pytest.mark.usefixtures("no_plots")


def masses(cell):
    plant = cell.model.plant
    robot = cell.model.robots["robot"]
    return plant.CalcTotalMass(plant.CreateDefaultContext(), [robot.instance])


class TestAttach:
    @pytest.mark.parametrize("parent", ["load", "gripper", "robot", "table", "world"])
    def test_the_piece_keeps_its_place_in_the_world(self, kinematic, parent):
        cell = kinematic.cell
        kinematic.tool(
            {"robot": "tool0"}.get(parent, parent)
            if parent in ("robot", "gripper", "load")
            else "load"
        )
        kinematic.move_j([0, 0, 0.01, 0, 0, np.pi], wobj="weight", check=None)
        before = cell.frame("weight").GetAsMatrix4()

        cell.attach("weight", parent)

        np.testing.assert_allclose(cell.frame("weight").GetAsMatrix4(), before, atol=1e-9)

        result = cell.wait(0.1)
        assert result.config.pieces["weight"].parent == parent
        np.testing.assert_allclose(cell.frame("weight").GetAsMatrix4(), before, atol=1e-9)

    def test_it_brings_mass_tool_centre_point_and_what_hangs_on_it(self, kinematic):
        cell = kinematic.cell
        kinematic.move_j([0.1, 0.1, 0.01, *DOWN], wobj="table")
        cell.attach("weight", "table")
        bare = masses(cell)
        place = cell.frame("weight").GetAsMatrix4()

        cell.attach("table", "load")

        assert masses(cell) - bare > 1.0
        np.testing.assert_allclose(cell.frame("weight").GetAsMatrix4(), place, atol=1e-9)
        assert {"table", "weight"} <= set(kinematic.tools)
        # the table's TCP is the arm's now
        np.testing.assert_allclose(kinematic.pose(wobj="table"), 0, atol=1e-9)

        cell.attach("table", "world")
        assert masses(cell) == pytest.approx(bare)
        assert cell.model.robots["robot"].tcp == "load"  # what carried it

    def test_it_moves_with_the_arm_and_stays_where_it_is_put(self, kinematic):
        cell = kinematic.cell
        kinematic.move_j([0, 0, 0.0, 0, 0, np.pi], wobj="weight", check=None)
        kinematic.attach("weight")
        kinematic.move_j([0.3, -0.2, 0.2, 0, 0, 0])

        put = cell.frame("weight").GetAsMatrix4()

        np.testing.assert_allclose(put[:3, 3], [0.3, -0.2, 0.2], atol=1e-8)

        kinematic.release("weight")
        result = kinematic.move_abs_j(HOME)

        np.testing.assert_allclose(cell.frame("weight").GetAsMatrix4(), put, atol=1e-9)
        assert result.config.pieces["weight"].parent == "world"

    def test_the_tool_stays_where_it_is_not_given_away(self, kinematic):
        cell = kinematic.cell
        kinematic.tool("gripper")
        kinematic.move_j([0, 0, 0, 0, 0, np.pi], wobj="weight", check=None)
        cell.attach("weight", "table")

        cell.attach("load", "world")
        assert cell.model.robots["robot"].tcp == "gripper"

        cell.attach("weight", "gripper")
        assert cell.model.robots["robot"].tcp == "weight"

        kinematic.tool("gripper")
        kinematic.tool([0, 0, 0.05, 0, 0, 0])
        before = kinematic.pose()

        cell.attach("weight", "world")
        np.testing.assert_allclose(kinematic.pose(), before, atol=1e-12)

        cell.attach("gripper", "world")
        assert cell.model.robots["robot"].tcp == "tool0"

    def test_a_piece_can_be_put_into_a_frame(self, kinematic):
        kinematic.cell.attach("weight", "table", frame="tcp", pose=[0.1, 0.1, 0, 0, 0, 0])
        place = kinematic.frame("table") @ transform_from_pose([0.1, 0.1, 0, 0, 0, 0])
        assert kinematic.frame("weight").IsNearlyEqualTo(place, 1e-12)

    def test_on_the_dynamic_station_the_arm_feels_the_weight(self, dynamic):
        dynamic.move_j([0, 0, 0.0, 0, 0, np.pi], wobj="weight", duration=1.0, check=None)
        dynamic.wait(1.0)
        before = dynamic.wait(0.2)["tau.joint_2"][-1]
        dynamic.attach("weight")
        held = dynamic.wait(2.0)

        expected = dynamic.inverse_dynamics()

        np.testing.assert_allclose(held.axes("tau")[-1], expected, rtol=0.01, atol=0.01)

        lever = dynamic.frame("weight").translation()[0]  # joint 2 stands over the origin
        # 1 kg; the arm sags a bit
        assert held["tau.joint_2"][-1] - before == pytest.approx(-9.80665 * lever, rel=0.05)

        dynamic.release("weight", fixed=True)
        put = dynamic.frame("weight").GetAsMatrix4()

        free = dynamic.move_abs_j(HOME)

        np.testing.assert_allclose(dynamic.frame("weight").GetAsMatrix4(), put, atol=1e-9)
        np.testing.assert_array_equal(free.axes("q")[0], held.axes("q")[-1])  # from the very state
        np.testing.assert_array_equal(free.axes("v")[0], held.axes("v")[-1])

    @pytest.mark.parametrize(
        ("piece", "parent", "frame", "message"),
        [
            ("weight", "weight", None, "parent of weight is the piece itself"),
            (
                "gripper",
                "load",
                None,
                "parent of gripper is load; it must be .* a piece that is not attached to gripper",
            ),
            ("wieght", "world", None, "no piece 'wieght'; did you mean 'weight'"),
            ("weight", "tabel", None, "no parent 'tabel'; did you mean 'table'"),
            ("weight", "table", "tpc", "no frame of table 'tpc'; did you mean 'tcp'"),
            ("weight", "robot", "tool", "no tool or link of robot 'tool'; did you mean 'tool0'"),
            ("weight", "world", "tcp", "the world has no frames; leave it out"),
        ],
    )
    def test_what_cannot_be_is_refused_and_all_stays(
        self, kinematic, piece, parent, frame, message
    ):
        config = kinematic.cell.config
        with pytest.raises(SimrobError, match=message):
            kinematic.cell.attach(piece, parent, frame=frame)
        assert kinematic.cell.config is config


class TestState:
    def test_a_dynamic_move_begins_at_the_state_that_the_last_one_left(self, dynamic):
        first = dynamic.move_abs_j([0.3, 0.2, 0, 0, 1.2, 0], duration=0.6)

        assert np.abs(dynamic.velocity).max() > 1e-3  # still swinging

        second = dynamic.wait(0.5)
        np.testing.assert_array_equal(second.axes("q")[0], first.axes("q")[-1])
        np.testing.assert_array_equal(second.axes("v")[0], first.axes("v")[-1])
        np.testing.assert_allclose(second.axes("q_ref")[0], [0.3, 0.2, 0, 0, 1.2, 0], atol=1e-12)
        assert second.times[0] == 0.0

    def test_gains_can_change_on_the_way(self, dynamic):
        dynamic.wait(1.0)
        stiff = dynamic.cell.config.servo.model_copy(update={"kp": 4000})
        sag = dynamic.reference - dynamic.position
        dynamic.cell.change(dynamic.cell.config.model_copy(update={"servo": stiff}))

        dynamic.wait(1.5)

        assert (dynamic.reference - dynamic.position)[1] == pytest.approx(sag[1] / 4, rel=0.05)

    def test_another_initial_posture_counts_before_the_first_run(self):
        cell = Workcell("double_pendulum")
        cell.change(
            load_station(
                "double_pendulum", {"robot.initial_deg": [20, 0], "reference": {"kind": "hold"}}
            )
        )

        np.testing.assert_allclose(cell.reference("robot"), np.deg2rad([20, 0]))

        result = cell.wait(0.05)
        np.testing.assert_allclose(
            result.axes("q_ref"), np.tile(np.deg2rad([20, 0]), (len(result.times), 1))
        )
        np.testing.assert_allclose(result.axes("q")[0], np.deg2rad([20, 0]))

    def test_a_station_with_other_robots_is_refused(self, kinematic):
        with pytest.raises(SimrobError, match="that of a station with the robots robot"):
            kinematic.cell.change(load_station("two_irb120"))


class TestSeveralArms:
    def test_one_moves_and_the_other_holds(self):
        cell = Workcell("two_irb120")  # dynamic
        left, right = cell.arm("left"), cell.arm("right")

        result = left.move_abs_j([0.4, 0.2, 0, 0, 0.3, 0])

        np.testing.assert_array_equal(result.axes("q_ref", "right"), 0)
        assert np.abs(right.position).max() < 0.03  # it sags
        assert left.reference[0] == pytest.approx(0.4)

    def test_both_at_once_and_one_after_the_other_lead_to_the_same(self):
        goals = {"left": [0.4, 0.2, 0, 0, 0.3, 0], "right": [-0.4, 0.1, 0.2, 0, 1.0, 0]}
        ends = []

        for together in (True, False):
            cell = Workcell("two_arms")
            plans = {name: cell.arm(name).plan for name in goals}
            if together:
                fast = plans["left"].move_abs_j(goals["left"], duration=0.8)
                result = cell.run(fast, plans["right"].move_abs_j(goals["right"], duration=1.2))
                assert result.stop_time == pytest.approx(1.2)
            else:
                for name, goal in goals.items():
                    cell.arm(name).move_abs_j(goal)
            ends.append([cell.position(name) for name in goals])

        np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)

    def test_another_arm_is_a_work_object(self):
        cell = Workcell("two_arms")
        left, right = cell.arm("left"), cell.arm("right")
        for wobj in (left, "left"):
            np.testing.assert_allclose(
                right.pose(wobj=wobj), right.pose(wobj=left.pose()), atol=1e-12
            )

    def test_two_plans_of_one_robot_are_refused(self, kinematic):
        plan = kinematic.plan.move_abs_j(HOME)
        with pytest.raises(SimrobError, match="of different robots"):
            kinematic.cell.run(plan, plan)


class TestRecording:
    @pytest.mark.long
    def test_replay_gives_the_same_motion_sample_by_sample(self, dynamic):
        dynamic.wait(0.2)
        dynamic.record()
        moves = [
            dynamic.move_j([0.1, 0.1, 0.1, *DOWN], wobj="table"),
            dynamic.move_l([0.2, 0.1, 0.1], wobj="table"),
        ]
        dynamic.attach("weight", "robot", pose=[0, 0, 0.05, 0, 0, 0])
        moves.append(dynamic.move_abs_j(HOME))
        dynamic.pause()
        dynamic.wait(0.2)
        dynamic.resume()
        moves.append(dynamic.wait(0.1))
        state = dynamic.cell.state

        replayed = dynamic.replay()

        assert len(replayed) == 4
        for again, move in zip(replayed, moves, strict=True):
            np.testing.assert_array_equal(again.values, move.values)
        assert dynamic.cell.state is state  # the arm stays where it is

        again = dynamic.simulate()
        assert [run.config.pieces["weight"].parent for run in again.runs] == ["world", "robot"]
        # without what was not recorded
        np.testing.assert_allclose(again.axes("q")[-1], dynamic.position, atol=1e-2)
        assert dynamic.cell.state is state

        dynamic.record()
        assert dynamic.replay() == []
        with pytest.raises(SimrobError, match="the recording: it is empty; call record"):
            dynamic.simulate()

    @pytest.mark.long
    def test_a_recorded_program_runs_as_one_on_this_station_and_another(self, kinematic):
        kinematic.record()
        moves = [
            kinematic.move_j([0.1, 0.1, 0.1, *DOWN], wobj="table"),
            kinematic.move_l([0.2, 0.1, 0.1], wobj="table"),
        ]

        whole = kinematic.simulate()
        np.testing.assert_allclose(whole.axes("q")[100:], moves[1].axes("q"), atol=1e-9)

        slow = kinematic.simulate(duration=4.0)
        np.testing.assert_allclose(slow.axes("q")[::2], whole.axes("q"), atol=1e-9)
        with pytest.raises(SimrobError, match="duration is 0; it must be a positive time"):
            kinematic.simulate(duration=0)

        real = kinematic.simulate(load_station("irb120_dynamic", BARE))
        assert real.config.mode == "dynamic"
        np.testing.assert_allclose(real.axes("q_ref"), whole.axes("q_ref"), atol=1e-9)

        lag = np.abs(real.axes("q") - whole.axes("q")).max()
        assert 1e-3 < lag < 0.1

    def test_gaps_are_refused_by_simulate_alone(self, kinematic):
        kinematic.record()
        kinematic.move_abs_j([0.2, 0, 0, 0, 1.5, 0])
        kinematic.pause()
        kinematic.move_abs_j(HOME)
        kinematic.resume()

        kinematic.move_abs_j([-0.2, 0, 0, 0, 1.5, 0])

        assert len(kinematic.replay()) == 2
        with pytest.raises(SimrobError, match="a run does not begin where the one before ended"):
            kinematic.simulate()


class TestResults:
    def test_a_move_can_be_saved_and_run_again(self, dynamic, tmp_path):
        dynamic.wait(0.3)
        result = dynamic.move_abs_j([0.3, 0.2, 0, 0, 1.2, 0], duration=0.5)

        folder = result.save(tmp_path / "move", recording=False)

        assert {"summary.json", "signals.csv", "start.json", "station.yaml"} <= {
            file.name for file in folder.iterdir()
        }

        start = State.from_json((folder / "start.json").read_text())
        again = simulate(load_station(folder / "station.yaml"), start=start)

        # the reference came by a table
        np.testing.assert_allclose(again.axes("q"), result.axes("q"), atol=1e-4)

    def test_a_monitor_ends_a_move_and_the_arm_stays_there(self):
        arm = Arm(load_station("irb120_dynamic", {"monitors": {"joint_limit": {"margin_deg": 60}}}))
        result = arm.move_abs_j([0, 1.2, 0, 0, 0, 0], check=None)

        assert result.ending == "monitor"
        assert result.stop_time < 1.0
        np.testing.assert_array_equal(arm.position, result.axes("q")[-1])

    def test_a_run_that_diverges_leaves_the_arm_as_it_was(self):
        unstable = {
            "solver": {"kind": "continuous", "scheme": "explicit_euler", "max_step": 0.01},
            "robot.initial_deg": {"joint_5": 90},
        }
        arm = Arm(load_station("irb120_dynamic", unstable))

        result = arm.move_abs_j([0.3, 0.2, 0, 0, 1.2, 0], duration=2.0)

        assert result.ending == "diverged"
        assert arm.cell.state is None
        np.testing.assert_allclose(arm.position, HOME, atol=1e-12)


@pytest.mark.long
def test_the_window_shows_moves_and_draws_the_way_of_the_tool(kinematic):
    url = kinematic.show(HOME)
    assert url.startswith("http://127.0.0.1:")

    kinematic.move_abs_j([0.2, 0, 0, 0, 1.5, 0], duration=0.2)
    window = kinematic.cell._window

    (told,) = json.loads(window._window.news({"scene": 1, "poses": 0}).partition(b"data: ")[2])[-1:]
    assert b"/drake/tool_path/robot/0" in base64.b64decode(told)
    assert urllib.request.urlopen(url, timeout=5).status == 200

    kinematic.attach("weight", pose=[0.0] * 6)
    assert kinematic.show() == url

    kinematic.cell.close()
