"""Every example runs, and says what it promises."""

import ast
import base64
import importlib.util
import json
import re
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import Workcell, load_station, simulate

pytestmark = pytest.mark.usefixtures("no_plots")

LONG = {
    "zjudancer_eight",
    "zjudancer_goal",
    "yobotics_walk",
    "humanoid_march",
    "stack",  # of five; tests/programs/test_grip.py puts one cube on another
    *re.findall(r'example\("(\w+)"\)', Path(__file__).read_text(encoding="utf-8")),
}
"""Examples that walk far, or with a test of their own below, which runs them without pictures."""
EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))
RUN_BY_OWN_TEST = {"tray"}
"""Examples that take minutes, and whose own test runs them as users do. They are not run twice."""
NOTEBOOKS = sorted((Path(__file__).parent.parent / "examples").glob("*.ipynb"))


def loaded(file):
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "file",
    [
        pytest.param(file, id=file.stem, marks=[pytest.mark.long] if file.stem in LONG else [])
        for file in EXAMPLES
        if file.stem not in RUN_BY_OWN_TEST
    ],
)
def test_an_example_runs(file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    loaded(file).main()

    assert capsys.readouterr().out.strip()
    assert {path.name for path in tmp_path.iterdir()} <= {"runs"}


def test_the_notebook_shows_its_run(tmp_path, monkeypatch, capsys):
    """Its cells run one after the other; the last line of one is shown as a notebook shows it. Outputs are not kept."""
    monkeypatch.chdir(tmp_path)

    (notebook,) = NOTEBOOKS
    cells = [
        cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"
    ]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)

    names, shown = {}, []
    for cell in cells:
        *body, last = ast.parse("".join(cell["source"])).body
        if not isinstance(last, ast.Expr):
            body.append(last)
        exec(compile(ast.Module(body, []), "a cell", "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), "a cell", "eval"), names))

    page = shown[0]._repr_html_()

    assert "ran to its end at 1 s" in page
    assert base64.b64decode(re.search('base64,([^"]*)"', page)[1]).startswith(b"\x89PNG")
    assert "joint_2" in page
    assert re.search(r"gives up to 3\d\.\d N·m", capsys.readouterr().out)
    assert list(tmp_path.iterdir()) == []


def example(name):
    return loaded(next(file for file in EXAMPLES if file.stem == name))


def test_the_station_wired_by_hand_is_the_station():
    by_hand = example("irb120_by_hand").run(duration=0.5)
    station = simulate(load_station("irb120_dynamic", {"pieces": {}}), duration=0.5)
    np.testing.assert_array_equal(by_hand, station.axes("q")[-1])


def test_a_block_of_ones_own_moves_the_arm():
    result = example("irb120_in_a_diagram").run()
    late = result.times > 0.5
    np.testing.assert_allclose(
        result["q.joint_5"][late], 0.3 * np.sin(2 * result.times[late]), atol=0.02
    )


def test_a_loop_of_ones_own_keeps_the_tool_at_its_height():
    """Without it the tool sags by what joints 2, 3 and 5 give: torque over kp, times their levers."""
    own_loop = example("own_loop")
    alone, kept = own_loop.run()
    sagged = alone["tcp.z"][0] - alone["tcp.z"][-1]
    levers = {
        "joint_2": own_loop.REACH,
        "joint_3": own_loop.REACH,
        "joint_5": own_loop.REACH - 0.302,
    }

    given = -sum(alone[f"tau.{joint}"][-1] / 1000 * lever for joint, lever in levers.items())

    assert sagged == pytest.approx(given, rel=0.03)
    late = kept.times > 4
    np.testing.assert_allclose(kept["tcp.z"][late], kept["tcp.z"][0], atol=sagged / 50)
    assert kept.units["keep_height.error"] == "m"


def test_the_regulator_takes_the_push_better_than_servos():
    lqr = example("irb120_lqr")
    most, late = lqr.strays(lqr.run())

    assert most < 0.6 * lqr.strays(lqr.run_servos())[0]
    assert late < 1e-3


def test_weaker_motors_hold_less():
    results = example("irb120_overload").run(limits=(150.0, 10.0))

    ends = {limit: np.rad2deg(result["q.joint_2"][-1]) for limit, result in results.items()}
    assert ends[150.0] == pytest.approx(31.2, abs=0.1)
    assert ends[10.0] == pytest.approx(110, abs=0.1)


@pytest.mark.long
def test_what_is_drawn_lies_on_the_table():
    arm, moves = example("irb120_draw").run()
    tip = example("irb120_draw").drawing(arm, moves)

    drawn = tip[np.abs(tip[:, 2]) < 1e-6]
    np.testing.assert_allclose([drawn[:, 0].min(), drawn[:, 1].min()], [0.01, 0.099], atol=1e-3)
    # bulge of the B
    np.testing.assert_allclose([drawn[:, 0].max(), drawn[:, 1].max()], [0.2643, 0.201], atol=1e-3)
    circle = drawn[(drawn[:, 0] > 0.115) & (drawn[:, 0] < 0.225)]
    np.testing.assert_allclose(
        np.linalg.norm(circle[:, :2] - [0.17, 0.15], axis=1), 0.05, atol=1e-4
    )


@pytest.mark.long
def test_the_pencil_keeps_to_the_axes_of_the_holes():
    holes = example("irb120_pencil_into_holes")
    for hole, way in holes.run().items():
        assert holes.off_axis(hole, way) < 1e-4


@pytest.mark.parametrize("mode", ["kinematic", pytest.param("dynamic", marks=pytest.mark.long)])
def test_the_rook_stands_on_its_square(mode):
    arm, _ = example("irb120_chess").run(mode=mode)
    off = (
        arm.cell.frame("rook").translation()
        - arm.cell.frame("chess_board.square_5_5").translation()
    )

    # its servos know its weight and the rook's
    assert np.linalg.norm(off) < (1e-6 if mode == "kinematic" else 5e-4)
    assert arm.cell.config.pieces["pencil"].parent == "gripper"
    assert arm.cell.config.pieces["rook"].parent == "chess_board"


@pytest.mark.long
def test_the_dynamic_arm_strays_by_millimetres_unless_its_servos_know_its_weight():
    ways = example("irb120_same_program").run()

    off = np.linalg.norm(ways["dynamic"] - ways["kinematic"], axis=1)
    assert 1e-3 < off.max() < 0.03
    assert (
        np.linalg.norm(ways["dynamic, with feedforward"] - ways["kinematic"], axis=1).max() < 5e-4
    )
    assert ways["dynamic"][:, 2].mean() < ways["kinematic"][:, 2].mean()  # it hangs lower


@pytest.mark.parametrize("mode", ["kinematic", pytest.param("dynamic", marks=pytest.mark.long)])
def test_the_bar_goes_from_hand_to_hand(mode):
    cell, moves = example("two_arms_handover").run(mode=mode)

    parents = [move.config.pieces["bar"].parent for move in moves]
    assert [parents[0], parents[3], parents[7], cell.config.pieces["bar"].parent] == [
        "world",
        "left_gripper",
        "right_gripper",
        "world",
    ]
    np.testing.assert_allclose(
        cell.frame("bar").translation(), [0.5, 0.3, 0.0], atol=1e-6 if mode == "kinematic" else 3e-4
    )


def test_a_camera_finds_the_parts_of_a_belt_where_they_are():
    belt = example("belt_camera")
    cell, known = belt.workcell(seed=3, parts=3), []
    belt.look(cell, known)
    places = np.array([cell.frame(f"part_{number}").translation()[:2] for number in range(3)])

    found = np.array(known)[:, :2] + [0.0, cell.position("belt")[0]]

    away = np.linalg.norm(places[:, np.newaxis] - found, axis=2)
    assert found.shape == (3, 2)
    assert away.min(axis=1).max() < 1e-3  # m; a pixel sees 2 mm


@pytest.mark.long
def test_parts_on_a_belt_that_runs_on_are_taken_where_a_camera_found_them():
    belt = example("belt_camera")
    cell, away = belt.run(seed=3, parts=2)

    assert len(away) == 2
    assert max(away) < 3e-3  # m from the tool to where a part truly was, in the plane of the belt
    assert {cell.config.pieces[f"part_{number}"].parent for number in range(2)} == {"pallet"}
    # it did not stop
    assert cell.position("belt")[0] - 0.45 == pytest.approx(belt.SPEED * cell.result().stop_time)


@pytest.mark.long
def test_the_belt_s_rook_stands_on_the_pallet():
    cell, _ = example("belt_pick").run()
    assert cell.config.pieces["rook"].parent == "pallet"
    np.testing.assert_allclose(cell.frame("rook").translation(), [0.1, 0.4, 0.0626], atol=1e-6)


@pytest.mark.long
def test_the_belt_s_program_is_the_same_as_a_file():
    cell, _ = example("belt_pick").run()
    whole = Workcell("belt_pick").perform(EXAMPLES[0].parent / "belt_pick.yaml")
    np.testing.assert_allclose(whole.values, cell.result().values, rtol=0, atol=1e-9)


@pytest.mark.long
def test_both_hands_leave_the_parcel_beside():
    robot = example("humanoid_box").run()

    np.testing.assert_allclose(
        robot.cell.frame("parcel").translation(), [0.03, -0.1243, 0.27], atol=1e-6
    )
    assert robot.cell.frame("parcel").rotation().IsNearlyIdentity(1e-6)
    assert robot.cell.config.pieces["parcel"].parent == "world"

    robot.simulate()  # the pieces change hands in the program
    assert len(robot.runs) == 3
    np.testing.assert_allclose(
        robot.cell.frame("parcel").translation(), [0.03, -0.1243, 0.27], atol=1e-6
    )
    # hangs down again; facts
    np.testing.assert_allclose(robot.pose("left_hand")[:2], [0.08318, 0.0], atol=1e-5)


def test_the_hands_keep_their_distance_while_they_carry():
    box = example("humanoid_box")
    robot = box.LeggedRobot("humanoid_box")
    robot.test_move(box.hands(robot, 0.0), 0.5)

    result = robot.test_move(box.hands(robot, box.SHIFT), 0.5)

    for q in result.axes("q"):
        apart = robot.pose("left_hand", q)[:3] - robot.pose("right_hand", q)[:3]
        np.testing.assert_allclose(apart, [2 * box.HALF_WIDTH, 0, 0], atol=2e-3)


def test_one_program_has_one_effect_on_three_humanoids():
    """Arm and leg turn about their joints by 30 degrees: ahead by sin 30, up by 1 - cos 30 of the same length."""
    humanoids = example("humanoids_same_program")
    result, robots = humanoids.run()

    assert [robot.name for robot in robots] == ["humanoid", "roid1", "zjudancer"]
    for robot in robots:
        ahead, up = humanoids.ways(result, robot, "right_foot")[-1]
        # the tool lies a little before the line
        assert up / ahead == pytest.approx(np.tan(np.deg2rad(15)), rel=0.1)
        assert 0.09 < ahead < 0.16


@pytest.mark.parametrize(
    ("robot", "gait"), [("roid1", None), ("zjudancer", None), ("roid1", "sideways")]
)
def test_a_humanoid_walks_as_it_is_told(robot, gait):
    pose = example("humanoids_walk").run(robot, gait, steps=2).pose("base")

    way, ahead = pose[-1, :2] - pose[0, :2], {"roid1": [1, 0], "zjudancer": [0, 1]}[robot]
    turned = np.rad2deg(2 * np.arctan2(pose[-1, 6], pose[-1, 3]))
    if gait == "sideways":
        assert abs(way @ ahead) < 0.02 < way[1]  # to its left
    else:
        assert way @ ahead > 0.1
    assert turned > 5 if robot == "zjudancer" else abs(turned) < 3


def test_all_joints_of_the_humanoid_reach_thirty_degrees():
    result = example("humanoid_all_joints").run()
    np.testing.assert_allclose(result.axes("q")[-1], np.deg2rad(30), atol=1e-9)
    assert np.abs(result.axes("tau")).max() < 3


@pytest.mark.long
def test_the_base_is_calmer_by_pd_than_by_p():
    pd_example = example("humanoid_p_against_pd")
    moves = {
        name: pd_example.base_moves(result) for name, result in pd_example.run(duration=6.0).items()
    }

    tilt = {name: np.abs(move[:, 4:]).max() for name, move in moves.items()}
    assert tilt["PD"] < 2
    assert tilt["P"] > 5
    assert all(move[-1, 1] < -50 for move in moves.values())  # both go to -y


@pytest.mark.long
def test_the_step_is_carried_by_the_large_areas_and_not_by_the_real_sole():
    results = example("humanoid_contact_areas").run()
    assert {area: result.ending for area, result in results.items()} == {
        "A": "completed",
        "B": "monitor",
        "C": "completed",
    }
    assert 1.5 < results["B"].stop_time < 2.5


@pytest.mark.long
def test_each_foot_of_the_quadruped_is_up_in_turn():
    stand = example("yobotics_three_legs")
    results = stand.run(seconds=0.4)
    for foot, result in results.items():
        heights = stand.foot_heights(result, np.arange(0.0, result.stop_time, 0.02))
        assert 0.02 * (heights[foot] > stand.ASKED).sum() >= 0.4
        assert all(height.max() < 1e-3 for other, height in heights.items() if other != foot)


@pytest.mark.long  # tests/programs/test_grip.py holds cubes, tests/stations/test_scatter.py scatters
def test_an_arm_takes_parts_from_where_a_seed_put_them():
    tray = example("tray")
    cell = tray.run(seed=4, parts=1)
    assert tray.off_place(cell, 0) < 5e-3  # m


@pytest.mark.long
def test_a_tray_of_ten_parts_is_emptied(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["tray.py", "7"])

    example("tray").main()

    printed = capsys.readouterr().out.splitlines()[0].partition(":")[2]
    distances = [float(text) for text in printed.split(",")]  # mm
    assert len(distances) == 10
    assert max(distances) < 5
    assert {path.name for path in tmp_path.iterdir()} == {"runs"}
