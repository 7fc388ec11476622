"""Sessions with the real run: what is taught is done, and can be done again without the page to the last bit."""

import gc
import os
import re
import runpy
import signal
import time
from zipfile import ZipFile

import numpy as np
import pytest
import yaml
from fake_runs import BenchRun

from simrob_drake import Program, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.pendant import run_pacer
from simrob_drake.extensions.pendant.run import Moments, shortfall
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.simulation import pace
from simrob_drake.simulation.stepping import Stepper


@pytest.fixture
def teach(tmp_path):
    opened = []

    def open_(subject, **how):
        for before in opened:
            before.close()
        runs = []
        session = Session.open(
            subject, tmp_path, live=lambda tell: runs.append(BenchRun(tell)) or runs[0], **how
        )
        session.hear()
        opened.append(session)
        return session, runs[0]

    yield open_
    for before in opened:
        before.close()


def heard(session, future):
    heard_until(session, future.done)
    session.hear()
    return future.result()


def table(file):
    with open(file) as opened:
        names = opened.readline().strip().split(",")
        return names, np.loadtxt(opened, delimiter=",")


def check_script(session, page):
    """The exported script gives the signals of the page's own run."""
    script = heard(session, session.exports.script())
    if script.suffix == ".zip":  # of a station of one's own
        with ZipFile(script) as packed:
            packed.extractall(script.with_name("elsewhere"))
        (script,) = script.with_name("elsewhere").rglob("*.py")
    quick = script.with_name("quick.py")
    quick.write_text(script.read_text().partition("result.save(")[0])
    result = runpy.run_path(str(quick))["result"]
    names, values = page
    assert names == ["time", *result.names]
    np.testing.assert_allclose(values[:, 1:], result.values, rtol=0, atol=1e-9)


@pytest.mark.long
def test_a_station_in_mujoco_is_taught_pushed_and_dragged_likewise(teach):
    session, run = teach("humanoid")
    session.setup.set("solver", {"kind": "mujoco", "time_step": 0.005})
    heard(session, session.test({"left_elbow": 30}, 0.3))
    session.add()
    held = {"at": "trunk", "point": [0, 0, 0.1]}
    run.at = {
        0.1: [
            ("change", {"settings": {"servo.kp": 90.0}}),
            ("push", {"at": "trunk", "force": [5, 0, 0]}),
        ],
        0.2: [("drag", {**held, "target": [0.05, 0, 0.5]})],
    }
    assert heard(session, session.simulate())["ending"] == "completed"
    assert session.setup.value("solver.kind") == "mujoco"
    check_script(session, table(heard(session, session.exports.csv())))


@pytest.mark.long
def test_the_script_gives_the_signals_of_the_page(teach):
    session, run = teach("humanoid")
    for target, duration in [({"left_elbow": 30, "right_knee": 5}, 0.3), ({"HomIF": 30}, 0.33)]:
        heard(session, session.test(target, duration))
        session.add()
    session.setup.set("servo.kd", 9)
    session.hear()
    held = {"at": "trunk", "point": [0, 0, 0.1]}
    run.at = {
        0.1: [
            ("change", {"settings": {"servo.kp": 90.0}}),
            ("push", {"at": "trunk", "force": [5, 0, 0]}),
        ],
        0.2: [("drag", {**held, "target": [0.05, 0, 0.5]})],
        0.3: [("drag", {**held, "target": [0.08, 0, 0.5]})],
        0.4: [("drag", {**held, "target": None})],
    }
    assert heard(session, session.simulate())["ending"] == "completed"
    assert [
        len(change.drag.targets) if change.drag else 0 for change in session.book.program.changes
    ] == [0, 0, 4]
    page = table(heard(session, session.exports.csv()))
    check_script(session, page)
    # again, and nobody touches it
    assert heard(session, session.simulate())["ending"] == "completed"
    assert np.array_equal(table(heard(session, session.exports.csv()))[1], page[1])
    assert Program.load(session.book.file).changes == session.book.program.changes
    unchanged = session.book.program.model_copy(update={"changes": ()})
    heard(session, run.call("play", program=unchanged.text()))
    calm = table(heard(session, session.exports.csv()))[1]
    assert np.abs(calm - page[1][: len(calm)]).max() > 1e-3  # they were felt


LEAN = """
from pydrake.systems.primitives import ConstantVectorSource


class Lean(ConstantVectorSource):
    def __init__(self, *, by: float) -> None:
        super().__init__([by])
"""


def test_the_script_of_a_station_with_a_block_of_ones_own_takes_its_file_along(teach, tmp_path):
    (tmp_path / "lean.py").write_text(LEAN)
    own = {"kind": "own", "class": "lean.py:Lean", "parameters": {"by": 0.5}}
    station = {"robot": {"model": "double_pendulum"}, "controllers": {"mine": own}, "duration": 1}
    (tmp_path / "leaning.yaml").write_text(yaml.safe_dump(station))
    session, _ = teach(tmp_path / "leaning.yaml", allow_code=True)
    packed = heard(session, session.exports.script())
    (tmp_path / "lean.py").unlink()
    with ZipFile(packed) as files:
        files.extractall(tmp_path / "elsewhere")
    (file,) = (tmp_path / "elsewhere").rglob("*-station.yaml")
    assert (
        load_station(file, allow_code=True)
        .controllers["mine"]
        .block("mine")
        .get_output_port()
        .size()
        == 1
    )


@pytest.mark.long
def test_a_walk_is_driven_added_and_repeated_without_a_hand(teach, monkeypatch):
    monkeypatch.setattr(run_pacer, "PATIENCE", 60.0)
    session, run = teach("roid1")
    ahead, turning = (
        {"ahead": 0.1, "sideways": 0, "turn_deg": 0},
        {"ahead": 0.1, "sideways": 0, "turn_deg": 15},
    )
    run.at = {
        0.2: [("steer", ahead)],
        0.6: [("steer", turning)],
        1.0: [("steer", ahead)],
        1.8: [("stop", {})],
    }
    assert heard(session, session.driving.begin("tab"))["ending"] == "stopped"
    (walk,), (change,) = session.book.pending, session.book.changes
    assert walk == {"go": {"duration": 1.8}}
    assert change.drive.commands == (
        (0.0, 0.1, 0.0, 0.0),
        (0.4, 0.1, 0.0, 15.0),
        (0.8, 0.1, 0.0, 0.0),
    )
    page = table(heard(session, session.exports.csv()))
    session.add()
    assert heard(session, session.simulate())["ending"] == "completed"
    np.testing.assert_array_equal(table(heard(session, session.exports.csv()))[1], page[1])
    check_script(session, page)
    assert session.driving.driver is None


@pytest.mark.long
def test_a_walk_that_nobody_holds_on_to_stands(teach, monkeypatch):
    """A tab that was closed, or a line that is cut, says nothing more: the walk does not go on without it."""
    monkeypatch.setattr(run_pacer, "PATIENCE", 0.0)
    session, run = teach("roid1")
    run.at = {0.2: [("steer", {"ahead": 0.1, "sideways": 0, "turn_deg": 0})], 0.4: [("stop", {})]}
    heard(session, session.driving.begin("tab"))
    assert [change.drive.commands for change in session.book.changes] == [((0.0, 0.0, 0.0, 0.0),)]


@pytest.mark.long
def test_while_it_runs_it_is_told_what_holds_a_run_up_and_then_what_became_of_it(
    teach, monkeypatch
):
    monkeypatch.setattr(pace, "_PATIENCE", 0.0)
    monkeypatch.setattr(pace, "_SLOWEST", 1e6)
    monkeypatch.setattr(pace, "_OFTEN", 0.0)
    session, _ = teach("irb120_dynamic")
    told = []
    session.listen(
        lambda topic: topic == "message" and told.append((session.phase, str(session.message)))
    )
    heard(session, session.test({"joint_1": 20}, 0.5))
    (during, slow), (_, ended) = told
    assert during == "running"
    assert re.match(r"irb120_dynamic runs at .* real time.* with .* s left: ", slow)
    lines = ended.splitlines()
    assert lines[0].startswith("Ran to its end at 0.5 s")
    assert len(lines) == len(session.run.ending["remarks"])
    assert {row.severity for row in session.message.criteria} <= {"success", "note", "warning"}
    assert "final error" in [row.criterion for row in session.message.criteria]


@pytest.mark.long
def test_a_push_of_a_test_that_was_discarded_is_forgotten(teach):
    ends = []
    for pushed in (False, True):
        session, run = teach("humanoid")
        if pushed:
            run.at = {0.1: [("push", {"at": "trunk", "force": [9, 0, 0]})]}
            heard(session, session.test({"left_elbow": 30}, 0.2))
            heard(session, session.discard())
            assert not run.at
        heard(session, session.test({"left_knee": 5}, 0.3))
        ends.append(heard(session, run.call("posture")))
        heard(session, session.discard())
    assert ends[0] == ends[1]


def test_a_run_that_is_over_is_let_go(teach):
    session, _ = teach("humanoid")
    for angle in (10, 20, 30):
        heard(session, session.test({"left_elbow": angle}, 0.1))
    gc.collect()
    assert not [one for one in gc.get_objects() if type(one) is Stepper]


@pytest.mark.long
def test_an_arm_is_jogged_taught_and_plays(teach):
    session, _ = teach("irb120")
    for axes in ({"joint_1": 20, "joint_5": 40}, {"joint_1": -20}):
        assert heard(session, session.arm.jog_axes(axes)) is not None
        assert heard(session, session.arm.jog_tool([0, 0, 0.03, 0, 0, 5], "tool")) is not None
        assert heard(session, session.arm.teach_target())
    assert list(session.book.targets) == ["p1", "p2"]
    assert not session.book.program.moves  # jogs are no moves of the program
    assert session.arm.add_line("move_abs_j", "p1")
    assert session.arm.add_line("move_l", "p2", speed=0.4)
    assert heard(session, session.simulate())["ending"] == "completed"
    place = heard(session, session.arm.where("world"))
    np.testing.assert_allclose(place["pose"], session.book.targets["p2"]["pose"], atol=1e-4)
    check_script(session, table(heard(session, session.exports.csv())))
    found = heard(session, session.arm.branches("p1"))
    number = next(n for n, branch in enumerate(found) if branch["usable"])
    assert heard(session, session.arm.choose_branch(number)) is not None
    reached = heard(session, session.arm.where("world"))
    np.testing.assert_allclose(
        reached["pose"][:3], session.book.targets["p1"]["pose"][:3], atol=1e-5
    )
    heard(session, session.arm.tool("gripper"))
    heard(session, session.arm.teach_target("grip"))
    assert session.arm.add_line("move_j", "grip")
    kinds = [move.key for move in session.book.program.moves]
    assert kinds == ["move_abs_j", "move_l", "tool", "move_j"]
    assert heard(session, session.arm.jog_tool([0, 0, 5, 0, 0, 0])) is None
    assert "out of reach" in str(session.message)
    shown = []
    forget = session.listen_to_view(
        lambda subject, commands: shown.append(commands) if subject == "ghosts" else None
    )
    assert heard(session, session.arm.branches())
    assert session.arm.ghosts
    for step in (0, 1, -1):  # one ghost at a time, and none before the first
        heard(session, session.arm.show_branch((session.arm.shown_ghost or 0) + step))
        paths = {
            command["path"].split("/")[3] for command in shown[-1] if command["type"] == "copy"
        }
        assert paths == {"0"}
    assert session.arm.shown_ghost == 0
    heard(session, session.arm.show_branch(-1))
    assert session.arm.shown_ghost == 0
    forget()
    assert session.setup.set("gravity", 3.7)
    while session.phase != "idle":
        session.hear(0.1)
    assert session.arm.ghosts == [], "they were of the station before"


HOLDING = """
robot: {model: irb120}
solver: {kind: discrete, time_step: 0.001}
duration: 0.1
controllers:
  mine: {kind: own, class: "pydrake.systems.primitives:ConstantVectorSource", parameters: {source_value: [0.5]}}
"""


@pytest.mark.long
def test_code_that_a_station_names_runs_where_its_user_allows_it(teach, tmp_path):
    file = tmp_path / "holding.yaml"
    file.write_text(HOLDING)
    with pytest.raises(SimrobError, match=r"controllers\.mine: would run .* or --allow-code"):
        teach(file)
    session, _ = teach(file, allow_code=True)
    assert session.setup.set("gravity", 3.7)
    session.hear()
    assert heard(session, session.simulate())["ending"] == "completed"
    page = table(heard(session, session.exports.csv()))
    assert "mine.y0" in page[0]
    check_script(session, page)


def test_the_command_passes_on_what_its_user_allows(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "simrob_drake.extensions.pendant.server.serve",
        lambda *_, **how: asked.append(how["allow_code"]),
    )
    for more in ([], ["--allow-code"]):
        assert run_command(["teach", "irb120", "--folder", str(tmp_path), *more]) == 0
    assert asked == [False, True]


@pytest.mark.long
def test_a_piece_is_taken_and_left(teach):
    session, _ = teach("humanoid_box")
    pose = [0, 0, -0.1, 0, 0, 0]
    assert (
        heard(
            session,
            session.try_move({"attach": {"piece": "parcel", "tool": "right_hand", "pose": pose}}),
        )["ending"]
        == "completed"
    )
    assert heard(session, session.test({"right_elbow": 20}, 0.2))["ending"] == "completed"
    assert [next(iter(move)) for move in session.book.pending] == ["attach", "target_deg"]
    session.add()
    assert heard(session, session.simulate())["ending"] == "completed"
    assert heard(session, session.try_move({"attach": "parcle"})) is None
    assert "did you mean 'parcel'?" in str(session.message)
    assert not session.book.pending


def forward(session, run, tool):
    """Return how far ahead of the trunk the reference of a humanoid has a tool [m]."""
    cell = run._bench.cell
    own, model = cell.robot(session.book.robot), cell.model
    model.place_robots({session.book.robot: cell.reference(session.book.robot)})
    place = model.pose(own.root).inverse() @ model.pose(
        model.mount(session.book.robot, own.model.tools[tool])
    )
    facing = np.deg2rad(load_gaits(own.model).facing_deg)
    return float(np.array([np.cos(facing), np.sin(facing), 0]) @ place.translation())


@pytest.mark.long
def test_taught_once_the_same_limbs_move_the_same_way_on_all_humanoids(teach):
    session, run = teach("humanoid")
    heard(session, session.test({"HomIF": 30}, 0.4))
    heard(session, session.test({"CadDF": 30}))
    session.add()
    file = session.book.file
    for robot in ("humanoid", "roid1", "zjudancer"):
        if robot != "humanoid":
            session, run = teach(robot, program=file)
        tools = "left_hand", "right_hand", "right_foot", "left_foot"
        heard(session, session.restart())
        before = {tool: forward(session, run, tool) for tool in tools}
        assert heard(session, session.simulate()) is not None
        moved = {tool: forward(session, run, tool) - place for tool, place in before.items()}
        assert moved["left_hand"] > 0.03, robot
        assert moved["right_foot"] > 0.03, robot
        assert abs(moved["right_hand"]) < 1e-9, robot
        assert abs(moved["left_foot"]) < 1e-9, robot
        asked = np.rad2deg(run._bench.cell.reference(session.book.robot))
        # the humanoid of MATLAB follows with a lag of 1 s
        reached = heard(session, run.call("posture"))
        for alias in ("HomIF", "CadDF"):
            number = session.book.model.axis_index(alias)
            assert asked[number] == pytest.approx(30, abs=1e-9), robot
            assert 4 < reached[list(session.book.model.axes)[number]] < 34, robot


@pytest.mark.long
def test_a_worker_that_is_killed_comes_back_with_the_program(tmp_path):
    session = Session.open("irb120_kinematic", tmp_path)
    try:
        heard_until(session, lambda: session.phase == "idle")
        session.test({"joint_1": 20}, 5.0)
        session.add()
        asked = session.simulate()
        heard_until(session, lambda: session.phase == "running")
        os.kill(session.client._live.pid, signal.SIGKILL)
        heard_until(session, asked.done)
        assert asked.result() is None
        heard_until(session, lambda: session.message.key == "died")
        heard_until(session, lambda: session.phase == "idle")
        assert len(session.book.program.moves) == 1
        session.set_pace(None)
        assert heard(session, session.simulate())["ending"] == "completed"
    finally:
        session.close()


def heard_until(session, condition, patience=60.0):
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, f"{session.phase}: {session.message}"
        session.hear(0.1)


HIPS = {"left_hip_pitch": 110, "right_hip_pitch": 110}


def shown(session, run):
    """Return where the view has the trunk."""
    scene = run._bench._view.scene
    return scene.pose(scene.station.robots[session.book.robot].root).translation()


@pytest.mark.long
def test_a_fall_is_scrubbed_with_its_signals_and_gone_back_from(teach):
    """Both hips 110 degrees forward: the run can be looked at through the fall, whatever is asked for then."""
    session, run = teach("humanoid")
    session.watch(["base_pose"])
    ended = heard(session, session.test(HIPS, 3.0))
    assert (ended["ending"], ended["goes_on"], session.run.start) == ("monitor", False, 0.0)
    reach = session.run.reach
    assert reach == session.run.time > 2.0
    lying = shown(session, run)
    rows = list(session.run.history["base_pose"])
    assert [row[0] for row in rows] == sorted(row[0] for row in rows)
    assert rows[-1][0] > reach - 0.06
    for at, pose in (rows[5], rows[-1], rows[20]):
        assert heard(session, session.rewind(at))
        assert session.run.time == at
        np.testing.assert_allclose(shown(session, run), pose[:3], atol=1e-9)
    heard(session, session.rewind(reach))
    np.testing.assert_allclose(shown(session, run), lying)
    assert heard(session, session.restart())
    assert (session.run.time, session.run.reach) == (0.0, 0.0)
    assert shown(session, run)[2] > lying[2] + 0.05


@pytest.mark.long
def test_a_run_that_diverges_is_scrubbed(teach):
    session, _ = teach("irb120_dynamic")
    for key, value in {
        "solver.scheme": "explicit_euler",
        "solver.max_step": 0.01,
        "servo.torque_limit": 1e12,
    }.items():
        assert session.setup.set(key, value)
        session.hear()
    heard(session, session.test({"joint_1": 20.0}, 0.5))
    assert session.run.ending["ending"] == "diverged"
    assert session.run.start == 0.0 < session.run.reach
    assert heard(session, session.rewind(session.run.reach / 2))
    assert session.run.rewound
    assert heard(session, session.go_on())["ending"] == "diverged"  # again
    assert heard(session, session.restart())
    assert session.run.reach == 0.0


@pytest.mark.long
def test_the_last_ten_runs_are_kept_and_two_are_compared(teach):
    """Of the same program with other gains all signals are there, as the file has them that is taken away."""
    session, _ = teach("humanoid")
    session.book.insert(0, {"target_deg": {"left_elbow": 30}, "duration": 0.4})
    tables = {}
    for gain in (80.0, 160.0):
        assert session.setup.set("servo.kp", gain)
        session.hear()
        heard(session, session.simulate())
        names, values = table(heard(session, session.exports.csv()))
        tables[session.run.ended[-1].number] = dict(zip(names, values.T, strict=True))
    assert [ended.number for ended in session.run.ended] == [1, 2]
    assert session.earlier.compare(1)
    first, second = session.run.compared, session.run.ended[-1]
    columns_of = {signal["name"]: signal["columns"] for signal in session.description["signals"]}
    for ended in (first, second):
        assert (ended.kind, ended.begun, ended.reached, ended.ending) == (
            "program",
            0.0,
            0.4,
            "completed",
        )
        csv = tables[ended.number]
        for name, columns in columns_of.items():
            times, values = ended.signals[name]
            np.testing.assert_allclose(times, csv["time"], atol=1e-9)
            np.testing.assert_allclose(
                values, np.array([csv[column] for column in columns]).T, rtol=1e-5, atol=1e-6
            )
    assert abs(first.signals["position"][1] - second.signals["position"][1]).max() > 1e-3
    assert first.history("position")[-1][0] == pytest.approx(0.4)
    assert first.history("no such") == []
    assert not session.earlier.compare(7)
    assert "run" in str(session.message)
    assert session.run.compared is first
    assert session.earlier.compare(None)
    assert session.run.compared is None


def test_a_ghost_does_not_hide_a_robot_that_stands_where_the_run_before_began(teach):
    """After a change of the station the ghost lay upon the robot, which looked blue, until something was run."""
    session, _ = teach("humanoid")
    session.book.insert(0, {"target_deg": {"left_elbow": 30}, "duration": 0.4})
    heard(session, session.simulate())
    told = []
    session.listen_to_view(
        lambda kind, commands: told.append(commands) if kind == "compared" else None
    )
    assert session.setup.set("servo.kp", 300.0)
    session.hear()
    assert session.run.compared is session.run.ended[0], "its curves stay in the plots"
    assert [
        command["type"] for commands in told for command in commands if command["type"] != "delete"
    ] == []
    heard(session, session.simulate())
    assert {command["type"] for command in told[-1]} == {"copy", "set_transform"}


@pytest.mark.long
def test_a_run_before_is_scrubbed_with_the_ghost_of_another_beside_it(teach):
    """Both stand where their own run had them at the same moment, though the station has other gains by now."""
    session, _ = teach("humanoid")
    session.book.insert(0, {"target_deg": {"left_elbow": 60}, "duration": 0.4})
    seen, told = [], {}
    session.listen_to_view(told.__setitem__)

    def posed():
        return matrices(told["poses"], "/drake/station/")

    for gain in (20.0, 160.0):
        assert session.setup.set("servo.kp", gain)
        session.hear()
        heard(session, session.simulate())
        heard(session, session.rewind(0.2))
        seen.append(posed())
    assert session.earlier.compare(2)
    assert heard(session, session.earlier.show(1))
    heard(session, session.rewind(0.2))
    assert (session.run.time, session.run.span) == (0.2, (0.0, 0.4))
    assert posed() == seen[0]
    ghost = matrices(told["compared"], "/drake/compared/")
    assert ghost == {path: seen[1][path] for path in ghost}
    assert len(ghost) > 10
    assert max(np.abs(np.subtract(ghost[path], seen[0][path])).max() for path in ghost) > 1e-2
    heard(session, session.rewind(9.0))
    assert session.run.time == 0.4
    assert heard(session, session.earlier.show(None))
    assert session.run.shown is None
    assert posed() == seen[1], "where the present run was gone back to"
    heard(session, session.earlier.show(1))
    heard(session, session.test({"left_elbow": 10}, 0.2))
    assert session.run.shown is None, "what is run is looked at"
    session.earlier.compare(None)
    session.hear()
    assert [command["type"] for command in told["compared"]] == ["delete"]


def test_a_run_of_another_plant_is_not_shown(teach):
    session, _ = teach("humanoid")
    heard(session, session.test({"left_elbow": 10}, 0.2))
    moments = Moments([0.0, 0.2], [np.zeros(3), np.zeros(3)])
    session.run.ended[0] = session.run.ended[0]._replace(moments=moments)
    assert heard(session, session.earlier.show(1)) is None
    assert "as it is now" in str(session.message)


def matrices(commands, root):
    """Return the poses below a path that commands set, by what hangs there."""
    return {
        command["path"].removeprefix(root): command["matrix"]
        for command in commands
        if command["type"] == "set_transform" and command["path"].startswith(root)
    }


@pytest.mark.long
def test_what_fell_stands_in_the_list_from_where_it_began(teach):
    session, _ = teach("humanoid")
    heard(session, session.test({"left_elbow": 10}, 0.2))
    session.add()
    heard(session, session.test(HIPS, 3.0))
    _, fell = session.run.ended
    assert (fell.kind, fell.begun, fell.ending) == ("tried", 0.2, "monitor")
    assert fell.reached == session.run.reach
    times, base = fell.signals["base_pose"]
    assert times[0] == 0.2
    assert fell.reached == pytest.approx(times[-1]), (
        "though the monitor was seen at the end of a step"
    )
    np.testing.assert_allclose(fell.moments.at(fell.reached)[4:7], base[-1, :3], atol=1e-3)
    assert base[-1, 2] < base[0, 2] - 0.05


@pytest.mark.long
def test_what_the_drives_can_do_is_told_as_it_was_changed_while_something_ran(teach):
    """And only the joints that it left without their torque are said to be at their limit."""
    session, run = teach("irb120_dynamic")
    session.watch(("reference", "position", "torque"))
    assert heard(session, session.client.ask("torque_limits")) == [150, 150, 100, 30, 30, 15]
    run.at = {0.5: [("change", {"settings": {"servo.torque_limit": {"joint_2": 5.0}}})]}
    heard(
        session,
        session.try_move({"move_abs_j": {"targets_deg": [0, 30, 0, 0, 0, 0], "duration": 1.0}}),
    )
    limits = heard(session, session.client.ask("torque_limits"))
    assert limits[1] == 5.0
    assert abs(session.run.values["torque"][1]) == pytest.approx(5.0, rel=0.001)
    axes = session.description["robots"]["robot"]["axes"]
    signals = [np.degrees(session.run.values[name]) for name in ("reference", "position")]
    asked, done = (dict(zip(session.book.model.axes, values, strict=True)) for values in signals)
    torque = session.run.values["torque"]
    told = [
        shortfall(
            axis,
            asked[axis["name"]],
            done[axis["name"]],
            torque=torque[number],
            limit=limits[number],
        )
        for number, axis in enumerate(axes)
    ]
    assert [
        axis["name"] for axis, one in zip(axes, told, strict=True) if one.reason == "limit"
    ] == ["joint_2"]
    assert told[1].off > 2.0, "it has sunk"


def test_a_run_reports_when_each_move_began_though_joint_moves_are_one_run(teach):
    session, _ = teach("humanoid")
    for angle in (30, 0):
        heard(session, session.test({"left_elbow": angle}, 1.0))
        session.add()
    ended = heard(session, session.simulate())
    assert [(move["begin"], move["end"]) for move in ended["moves"]] == [(0.0, 1.0), (1.0, 2.0)]
    assert [move["entry"]["target_deg"] for move in ended["moves"]] == [
        {"left_elbow": 30.0},
        {"left_elbow": 0.0},
    ]


@pytest.mark.long
def test_a_watched_signal_of_a_loop_that_was_switched_off_does_not_end_the_run(teach):
    """Plots may still show a signal that the station has no more; it comes back with the loop."""
    session, run = teach("humanoid_balance")
    session.watch(["position", "balance.com"])
    assert run._bench.pacer.watched == ["position", "balance.com"]

    assert session.setup.switch_loop("balance", False)
    session.hear()
    ended = heard(session, session.simulate())

    assert ended["ending"] == "monitor"  # the push makes it fall: no fault of the program
    assert run._bench.pacer.watched == ["position"]

    assert session.setup.switch_loop("balance", True)
    session.hear()
    assert run._bench.pacer.watched == ["position", "balance.com"]
