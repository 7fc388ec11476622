"""Programs written as RAPID and URScript: read by regular expressions here, and by the package's own import."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.rapid.exporting import ExportedProgram, rapid_text, urscript_text
from simrob_drake.extensions.rapid.importing import import_rapid
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.program import Program
from simrob_drake.stations.load import bare_station

STATION = bare_station("irb120")
DOWN = [np.pi, 0, np.pi]  # Rz Ry Rx of a tool that points down
PROGRAM = Program.of_text(f"""
moves:
- move_abs_j: {{targets_deg: [0, 0, 0, 0, 90, 0], speed: 0.5}}
- tool: {{pose: [0, 0, 0.1, 0.3, 0, 0]}}
- move_j: {{targets: [0.35, -0.1, 0.4, {np.pi}, 0, {np.pi}], speed: 1.0, wobj: [0.01, 0.02, 0, 0.1, 0, 0]}}
- move_l: {{targets: [[0.35, -0.1, 0.35], [0.37, 0, 0.35], [0.4, 0.05, 0.38]], speed: 0.2, zone: z10}}
- wait: 0.3
- move_l: {{targets: [0.35, 0.1, 0.4, 3.0, 0.1, 3.1]}}
- move_c: {{via: [0.37, 0.12, 0.4], targets: [0.38, 0.1, 0.41], duration: 1.5}}
- move_l: {{targets: [0.35, 0.1, 0.4, 3.0, 0.1, 3.1], speed: 0.333, acceleration: 1.0}}
- move_abs_j: {{targets_deg: [[10, 0, 0, 0, 90, 0], [20, 0, 10, 0, 80, 0]], speed: 0.3, zone: 0.0123}}
- move_l: {{targets: [[0.35, 0, 0.4, {np.pi}, 0, {np.pi}], [0.35, 0.05, 0.42, {np.pi}, 0, {np.pi}]], duration: 1.5}}
- move_j: {{targets: [0.35, -0.1, 0.4, {np.pi}, 0, {np.pi}], duration: 2}}
""")
NUMBER = r"(-?[\d.]+(?:E\+?\d+)?)"
ROBTARGET = re.compile(
    rf"CONST robtarget (\w+):=\[\[{NUMBER},{NUMBER},{NUMBER}\],\[{NUMBER},{NUMBER},{NUMBER},{NUMBER}\],"
    rf"\[{NUMBER},{NUMBER},{NUMBER},{NUMBER}\],\[(?:9E\+09,){{5}}9E\+09\]\];"
)


def postures(program: Program) -> np.ndarray:
    """Return the axes over a whole program as it is planned, at 200 times, shape (200, 6)."""
    cell, plans, ends = Workcell(STATION), [], [0.0]

    def stand(own: list[Plan], duration: float | None) -> None:
        plans.append(own[0] if own else cell.reference("robot"))
        ends.append(ends[-1] + cell.stand(own, duration))

    for move in program.moves:
        move.perform(cell, None, stand)
    rows = []
    for time in np.linspace(0, ends[-1] - 1e-6, 200):
        row = int(np.searchsorted(ends, time, side="right")) - 1
        plan = plans[row]
        rows.append(
            plan.postures(np.array([time - ends[row]]))[0] if isinstance(plan, Plan) else plan
        )
    return np.array(rows)


def exported(program: Program) -> tuple[str, str]:
    return rapid_text(ExportedProgram.of(program, Workcell(STATION)), "Test")


@pytest.mark.long
def test_the_same_motion_comes_back(tmp_path):
    file = tmp_path / "Test.mod"
    file.write_text(exported(PROGRAM)[0])
    back = import_rapid(file, STATION)
    assert back.remarks == ()
    np.testing.assert_allclose(postures(back.program), postures(PROGRAM), atol=1e-9)


def quadrant(angle: float) -> int:
    return int(np.floor(angle / (np.pi / 2) + 1e-9))


def sides(q: np.ndarray) -> int:
    """Return cfx by the plane geometry of the arm: 270 mm up, 70 mm up and 302 mm ahead from the elbow."""
    ahead = 0.27 * np.sin(q[1]) + 0.07 * np.sin(q[1] + q[2]) + 0.302 * np.cos(q[1] + q[2])
    before_lower_arm = 0.302 * np.cos(q[2]) + 0.07 * np.sin(q[2])
    return 4 * (ahead < 0) + 2 * (before_lower_arm < 0) + (q[4] < 0)


@pytest.mark.long
def test_quaternions_and_configurations_are_read_by_others():
    text, table = exported(PROGRAM)
    targets = {found[0]: [float(value) for value in found[1:]] for found in ROBTARGET.findall(text)}
    assert len(targets) == text.count("CONST robtarget") == 9
    assert table == ""
    wxyz = np.array([values[3:7] for values in targets.values()])
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=1), 1.0, atol=1e-11)
    np.testing.assert_allclose(targets["p10"][:3], [350, -100, 400])
    turned = Rotation.from_quat(targets["p50"][3:7], scalar_first=True)
    np.testing.assert_allclose(
        turned.as_matrix(), Rotation.from_euler("ZYX", [3.0, 0.1, 3.1]).as_matrix(), atol=1e-11
    )
    cell, found = Workcell(STATION), {}
    moves = [
        line.split()[1].split(",")[0]
        for line in text.splitlines()
        if re.match(r" +Move[JL] ", line)
    ]
    for number in (2, 3, 5, 7, 9, 10):  # moves of the tool; only the last of joined ones rests
        cell.rehearse(PROGRAM.model_copy(update={"moves": PROGRAM.moves[: number + 1]}))
        q = cell.reference("robot")
        found[number] = [quadrant(q[0]), quadrant(q[3]), quadrant(q[5]), sides(q)]
        cell = Workcell(STATION)
    named = dict(
        zip(
            (2, 3, 5, 7, 9, 10),
            (moves[0], moves[3], moves[4], moves[5], moves[7], moves[8]),
            strict=True,
        )
    )
    assert {number: targets[name][7:11] for number, name in named.items()} == found


def test_the_module_says_how_each_move_is_done():
    lines = [line.strip() for line in exported(PROGRAM)[0].partition("PROC main()")[2].splitlines()]
    assert "MoveJ p10,v1000,fine,tcp1\\WObj:=wobj1;" in lines
    assert "MoveL p30,v200,z10,tcp1;" in lines
    assert "MoveC p70,p60,v100\\T:=1.5,fine,tcp1;" in lines
    assert "PathAccLim TRUE\\AccMax:=1,TRUE\\DecelMax:=1;" in lines
    assert "WaitTime 0.3;" in lines


def test_pieces_are_signals_with_their_table(tmp_path):
    station = bare_station(
        "irb120",
        {"pieces.part": {"model": "pencil", "parent": "world", "pose": [0.374, 0, 0.2, 0, 0, 0]}},
    )
    program = Program.of_text("""
moves:
- move_abs_j: {targets_deg: [0, 0, 0, 0, 90, 0], duration: 1}
- attach: {piece: part, pose: [0, 0, 0, 0, 0, 0]}
- move_l: {targets: [0.302, 0.1, 0.5], duration: 1}
- release: {piece: part, fixed: true}
""")
    text, table = rapid_text(ExportedProgram.of(program, Workcell(station)), "Test")
    assert re.findall(r"SetDO .*", text) == ["SetDO do_part,1;", "SetDO do_part,0;"]
    (tmp_path / "Test.mod").write_text(text)
    (tmp_path / "io.yaml").write_text(table)
    back = import_rapid(tmp_path / "Test.mod", station, signals=tmp_path / "io.yaml")
    assert [move.entry() for move in back.program.moves[1::2]] == [
        move.entry() for move in program.moves[1::2]
    ]


def test_urscript_has_poses_in_the_base_and_rotation_vectors():
    text = urscript_text(ExportedProgram.of(PROGRAM, Workcell(STATION)), "Test")
    lines = [line.strip() for line in text.splitlines()]
    assert lines[0] == "def Test():"
    assert lines[-2:] == ["end", "Test()"]
    assert "set_tcp(p[0, 0, 0.1, 0, 0, 0.3])" in lines
    lined = re.search(r"movel\(p\[(.*?)\], a=2, v=0.2, r=0.01\)", text)
    values = [float(value) for value in lined[1].split(",")]
    np.testing.assert_allclose(values[:3], [0.35, -0.1, 0.35], atol=1e-9)
    # turned with the work object
    pose = Rotation.from_euler("ZYX", [0.1, 0, 0]) * Rotation.from_euler("ZYX", DOWN)
    np.testing.assert_allclose(
        Rotation.from_rotvec(values[3:]).as_matrix(), pose.as_matrix(), atol=1e-9
    )
    ended = [float(value) for value in re.findall(r"movej\(\[(.*?)\], t=2\)", text)[0].split(",")]
    np.testing.assert_allclose(ended, postures(PROGRAM)[-1], atol=1e-8)


def test_what_other_languages_cannot_say_is_told():
    program = Program.of_text("""
moves:
- move_abs_j: {targets_deg: [[10, 0, 0, 0, 90, 0], [20, 0, 0, 0, 90, 0]], points: 30}
- move_l: {targets: [0.35, 0, 0.4], speed: 0.1, profile: trapezoid}
""")
    remarks = ExportedProgram.of(program, Workcell(STATION)).remarks
    assert remarks == [
        "move 1: points left out",
        "move 1: passes its targets smoothly here, rests at each there; give it a zone",
        "move 2: profile trapezoid left out: only its time is kept",
    ]
    with pytest.raises(InvalidParameter, match="move 2: the move is play"):
        ExportedProgram.of(Program.of_text("moves: [{wait: 1}, {play: 1}]"), Workcell(STATION))


@pytest.mark.long
def test_the_commands_write_run_and_import(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "station.yaml").write_text("mode: kinematic\nrobot: {model: irb120}\n")
    short = "moves: [{move_abs_j: {targets_deg: [0, 0, 0, 0, 90, 0], duration: 1}}, {wait: 0.1}]"
    Program.of_text(short).on("station.yaml").save(tmp_path / "program.yaml")
    assert (
        run_command(["export", "program.yaml", "--rapid", "Out.mod", "--urscript", "out.script"])
        == 0
    )
    assert run_command(["import", "Out.mod", "--robot", "irb120", "--out", "back.yaml"]) == 0
    assert "program back.yaml" in " ".join(capsys.readouterr().out.split())
    assert Program.load("back.yaml").station == "back_station.yaml"
    run = ["run", "Out.mod", "--robot", "irb120", "--no-recording", "--out"]
    assert run_command([*run, "one"]) == 0
    (tmp_path / "Out.mod").write_text(
        (tmp_path / "Out.mod").read_text().replace("WaitTime", "WaitTym")
    )
    assert run_command(["import", "Out.mod", "--robot", "irb120", "--out", "lost.yaml"]) == 4
    assert run_command([*run, "two"]) == 2
    told = capsys.readouterr()
    assert (
        "WaitTym is not known, and left out; did you mean 'waittime'?; the program was not run: "
        "--allow-losses runs it without these lines" in told.err
    )
    assert not (tmp_path / "two").exists()


def test_the_example_of_the_page_is_done(tmp_path):
    page = (Path(__file__).parents[3] / "docs/rapid.md").read_text()
    module = next(
        block
        for block in re.findall(r"```text\n(.*?)```", page, re.DOTALL)
        if block.startswith("MODULE")
    )
    (tmp_path / "Pick.mod").write_text(module)
    table = "signals: {doGrip: {does: {1: []}}, diPart: {is: {0: 0, 2.5: 1}}}"
    (tmp_path / "io.yaml").write_text(table)
    done = import_rapid(tmp_path / "Pick.mod", STATION, signals=tmp_path / "io.yaml")
    assert [str(remark) for remark in done.remarks] == []
    assert done.time > 2.5


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["run", "A.mod"], "--robot is missing; it must be the robot that runs the program"),
        (["run", "A.mod", "--robot", "irb120"], "A.mod: line 1: there is no PROC main()"),
        (
            ["run", "irb120_kinematic", "--robot", "irb120"],
            "--robot: the option belongs to RAPID modules; leave it out",
        ),
        (["import", "none.mod", "--robot", "irb120"], "none.mod: No such file"),
        (["export", "irb120_kinematic", "--rapid", "B.mod"], "irb120_kinematic: is not a program"),
        (["export", "irb120_kinematic"], "or --sdf or --mjcf, or --rapid or --urscript"),
        (
            ["export", "p.yaml", "--rapid", "x.txt", "--urscript", "./x.txt"],
            "--urscript is x.txt; it must be a different file from that of --rapid",
        ),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, command, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "A.mod").write_text("MODULE A ENDMODULE")
    assert run_command(command) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
