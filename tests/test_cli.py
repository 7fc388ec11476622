"""The command line from the outside: exit codes, files, and one line for every mistake."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import Dynamics, Workcell
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import models_root
from simrob_drake.cli import ExitCode
from simrob_drake.cli.__main__ import DEBUG, run_guarded
from simrob_drake.cli.app import run_command
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.tables import _pose_differences, fold_axes
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.findings import Finding

pytestmark = pytest.mark.usefixtures("no_plots")


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.plots
def test_a_run_leaves_a_whole_result(tmp_path, capsys):
    assert run_command(["run", "irb120_dynamic", "--duration", "0.3", "--out", "result"]) == 0

    files = {
        str(file.relative_to(tmp_path / "result"))
        for file in (tmp_path / "result").rglob("*")
        if file.is_file()
    }
    assert {
        "summary.json",
        "signals.csv",
        "station.yaml",
        "recording.html",
        "film_strip.png",
    } <= files
    assert {"plots/position.png", "plots/torque.png"} <= files
    out = capsys.readouterr().out
    assert "ran to its end at 0.3 s" in out
    assert (tmp_path / "result" / "recording.html").as_uri() in out


@pytest.mark.long
def test_options_of_output_do_not_change_the_signals(tmp_path):
    command = ["run", "irb120_dynamic", "--duration", "0.2"]
    run_command([*command, "--out", "plain", "--no-recording"])
    run_command([*command, "--out", "live", "--no-recording", "--live"])
    run_command([*command, "--out", "recorded"])

    plain, live, recorded = (
        (tmp_path / name / "signals.csv").read_bytes() for name in ("plain", "live", "recorded")
    )

    assert plain == live == recorded


def test_a_monitors_stop_is_a_success(tmp_path):
    settings = ["--set", "servo.torque_limit=10", "--set", "monitors.torque_limit.hold=0.2"]
    assert run_command(["run", "irb120_dynamic", "--out", "r", "--no-recording", *settings]) == 0
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["stopped_by"] == "torque_limit"


def test_a_divergence_exits_with_3_and_keeps_what_there_is(tmp_path, capsys):
    settings = ["servo.torque_limit=1e12", "solver.scheme=explicit_euler", "solver.max_step=0.01"]

    arguments = [part for setting in settings for part in ("--set", setting)]
    assert (
        run_command(["run", "irb120_dynamic", "--out", "r", "--no-recording", *arguments])
        == ExitCode.DIVERGED
    )
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["stopped_by"] == "diverged"
    assert len((tmp_path / "r" / "signals.csv").read_text().splitlines()) > 2
    assert "likely cause" in capsys.readouterr().out


def test_converge_prints_the_difference(capsys):
    assert (
        run_command(["run", "irb120_dynamic", "--duration", "0.2", "--no-recording", "--converge"])
        == 0
    )

    lines = capsys.readouterr().out.splitlines()
    row = next(
        line
        for line in lines[lines.index(next(li for li in lines if "ten times" in li)) :]
        if "joint_2" in line
    )

    assert 0 < float(row.split()[1]) < 3e-3
    _, difference, of, _, degrees, *rest = row.split()
    assert (of, rest[0], rest[-1]) == ("rad", "deg", "N·m")
    assert float(degrees) == pytest.approx(np.rad2deg(float(difference)), rel=0.01)


@pytest.mark.long
def test_converge_compares_the_base_of_a_legged_robot(capsys):
    command = [
        "run",
        "humanoid_dynamic",
        "--duration",
        "0.3",
        "--no-recording",
        "--set",
        "robot.base=[0,0,0.46,0,0,0]",
    ]

    assert run_command([*command, "--converge"]) == 0

    rows = {
        " ".join(line.split()[:3]): line.split()[3:5]
        for line in capsys.readouterr().out.splitlines()
    }
    place, attitude = rows["position of base"], rows["orientation of base"]
    assert (place[1], attitude[1]) == ("mm", "deg")
    assert 1e-3 < float(place[0]) < 10  # it drops by 14 mm
    assert 0 < float(attitude[0]) < 5


def test_attitudes_differ_by_the_angle_between_them():
    turned = np.array(
        [[0, 0, 0, 1, 0, 0, 0], [0, 0, 0, -1, 0, 0, 0], [1, 2, 2, np.cos(0.1), 0, np.sin(0.1), 0.0]]
    )
    (_, ways, _), (_, angles, _) = _pose_differences(turned, np.array([[0, 0, 0, 1.0, 0, 0, 0]]))

    np.testing.assert_allclose(ways, [0, 0, 3000])
    np.testing.assert_allclose(angles, [0, 0, np.rad2deg(0.2)], atol=1e-9)


def test_the_default_folder_is_under_runs(tmp_path):
    run_command(["run", "double_pendulum", "--duration", "0.1", "--no-recording"])
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("double_pendulum-")


@pytest.mark.parametrize("name", ["[a]", "[/a]", ":x:"])
def test_brackets_are_the_users_and_no_markup(tmp_path, capsys, name):
    """Of rich's markup [a] would be swallowed, [/a] an error after the run, and :x: another sign."""
    station = name.replace("/", "")  # which no station's name has, but folders have
    text = f"name: '{station}'\nrobot: {{model: double_pendulum, initial_deg: 40}}\nreference: {{kind: hold}}\n"
    (tmp_path / "mine.yaml").write_text(text)

    # warnings, before the run
    settings = [
        "--set",
        "servo.torque_limit=0.001",
        "--set",
        "servo.kp=1",
    ]

    command = [
        "run",
        "mine.yaml",
        "--duration",
        "0.1",
        "--out",
        f"runs/{name}/x",
        "--no-recording",
        *settings,
    ]
    assert run_command(command) == 0
    captured = capsys.readouterr()
    assert f"result    runs/{name}/x" in captured.out
    assert f"{station}: ran to its end" in captured.out
    assert "warning torque of joint_1" in captured.err


def test_list_names_everything(capsys):
    assert run_command(["list"]) == 0
    out = capsys.readouterr().out
    for name in (
        "irb120_dynamic",
        "irb120_kinematic",
        "double_pendulum",
        "two_irb120",
        "irb120",
        "gripper",
        "pencil",
    ):
        assert name in out


def test_check_foretells_the_overload(capsys):
    assert run_command(["check", "irb120_dynamic", "--set", "servo.torque_limit=10"]) == 0

    out = " ".join(capsys.readouterr().out.split())
    assert "warning torque of joint_2" in out
    assert "-20.79" in out


def test_check_folds_the_axes_that_are_far_from_their_torque_limits(capsys):
    """The 18 axes of the humanoid have a limit of 3 N·m; a knee needs the most, 0.61 N·m or 20 %."""
    assert run_command(["check", "humanoid_balance"]) == 0

    folded = " ".join(capsys.readouterr().out.split())
    assert folded.count("torque of") == 1
    assert "torque of right_knee standing requires -0.61 N·m" in folded
    assert "17 more axes each needs at most 20% of its torque limit; --all lists each" in folded
    assert run_command(["check", "humanoid_balance", "--all"]) == 0

    shown = " ".join(capsys.readouterr().out.split())
    assert shown.count("torque of") == len(load_robot("humanoid").axes)
    assert "more axes" not in shown


def test_an_axis_near_its_limit_or_with_a_warning_is_not_folded():
    def axis(number, share, level="ok"):
        return Finding(level, f"axis {number}", "", share)

    easy = [axis(number, 0.01 * number) for number in range(1, 9)]
    warned, loaded = axis(9, 0.1, "warning"), axis(10, 0.61)
    other = Finding("ok", "contact", "")
    *shown, summary, last = fold_axes([other, loaded, *easy[::-1], warned])
    assert {finding.subject for finding in (*shown, last)} == {
        "contact",
        "axis 10",
        "axis 8",
        "axis 9",
    }
    assert summary.subject == "7 more axes"
    assert "at most 7%" in summary.text
    few = [*easy[:7], loaded, other]
    assert fold_axes(few) == few


@pytest.mark.long
@pytest.mark.parametrize("subject", ["irb120", "robot.urdf", "program.yaml"])
def test_check_refuses_to_show_all_axes_of_what_is_no_station(subject, tmp_path, capsys):
    (tmp_path / "robot.urdf").write_text("<robot name='r'><link name='l'/></robot>")
    (tmp_path / "program.yaml").write_text("station: irb120_dynamic\nmoves: [{wait: 1}]\n")
    file = tmp_path / subject
    argument = str(file) if file.exists() else subject

    assert run_command(["check", argument, "--all"]) == ExitCode.BAD_INPUT

    assert capsys.readouterr().err.startswith("simrob: --all: this is ")


def test_check_tells_what_an_arm_can_carry(capsys):
    """The Puma's elbow is the first at its limit, stretched out level: see tests/test_dynamics.py for the figures."""
    arm = Dynamics.of_robot("puma560")

    assert run_command(["check", "puma560"]) == 0

    out = " ".join(capsys.readouterr().out.split())
    assert f"{arm.payload(load_robot('puma560').home).min():.3g} kg" in out
    assert (
        f"{arm.payload(arm.weakest_posture()).min():.3g} kg, limited by the motor of joint_2" in out
    )
    assert run_command(["check", "irb120_dynamic"]) == 0

    course = np.linspace(0, 1, 51)[:, np.newaxis] * np.full(6, np.deg2rad(30))
    held = Workcell("irb120_dynamic").arm().dynamics.payload(course).min()

    assert f"{held:.3g} kg more at load" in " ".join(capsys.readouterr().out.split())
    assert run_command(["check", "puma560", "--set", "duration=1"]) == ExitCode.BAD_INPUT


def test_check_shows_a_urdf(capsys):
    from simrob_drake.base.files import models_root

    assert run_command(["check", str(models_root() / "irb120" / "irb120.urdf")]) == 0
    assert "joint_6" in capsys.readouterr().out


def test_diagram_writes_what_the_suffix_says(tmp_path, capsys):
    assert run_command(["diagram", "double_pendulum"]) == 0
    assert capsys.readouterr().out.startswith("digraph")
    assert run_command(["diagram", "double_pendulum", "--out", "picture.mmd"]) == 0
    assert (tmp_path / "picture.mmd").read_text().count("flowchart LR") == 1


def test_a_picture_is_replaced_by_force_only(tmp_path, capsys):
    (tmp_path / "mine.dot").write_text("dear to me")

    assert run_command(["diagram", "double_pendulum", "--out", "mine.dot"]) == ExitCode.BAD_INPUT
    assert "replace it with --force" in capsys.readouterr().err
    assert (tmp_path / "mine.dot").read_text() == "dear to me"
    assert run_command(["diagram", "double_pendulum", "--out", "mine.dot", "--force"]) == 0
    assert "digraph" in (tmp_path / "mine.dot").read_text()


@pytest.mark.parametrize(
    ("command", "unit"), [("run", "time [s]"), ("station", "estimated [kg/m³]"), ("walk", "--gait")]
)
def test_help_keeps_its_units(capsys, command, unit):
    assert run_command([command, "--help"]) == 0
    assert unit in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize("asked", ["-h", "--help"])
def test_help_has_its_commands_under_titles_and_flags_without_a_type(capsys, asked):
    assert run_command([asked]) == 0

    shown = capsys.readouterr().out
    shown_titles = re.findall(r"^╭─ ([\w ]+) ─", shown, re.MULTILINE)

    own_titles = ["Options", "Stations", "Robots", "Exchange and other engines", "Extensions"]

    assert [title for title in shown_titles if title in own_titles] == own_titles
    assert shown_titles[-1] == own_titles[-1]
    assert run_command(["run", asked]) == 0
    assert "<bool>" not in shown + capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize(
    ("typed", "completed"), [("dia", "diagram"), ("run irb120_kin", "irb120_kinematic")]
)
def test_a_shell_completes_commands_and_stations(typed, completed):
    words = {"COMP_WORDS": f"simrob {typed}", "COMP_CWORD": str(len(typed.split()))}
    environment = {**os.environ, "_SIMROB_COMPLETE": "complete_bash", **words}
    start = "import sys; sys.argv = ['simrob']; from simrob_drake.cli.__main__ import main; main()"

    done = subprocess.run(
        [sys.executable, "-c", start], env=environment, capture_output=True, text=True, check=False
    )

    assert done.stdout.split() == [completed]


@pytest.mark.parametrize("command", ["run", "check", "walk"])
def test_a_file_that_is_not_there_is_told_as_such(capsys, command):
    assert run_command([command, "a.step"]) == ExitCode.BAD_INPUT
    assert capsys.readouterr().err == "simrob: a.step: there is no such file\n"


def test_check_says_that_a_robot_starts_below_the_floor(capsys):
    assert run_command(["check", "humanoid_dynamic", "--set", "robot.base=[0,0,0.3,0,0,0]"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "warning base the lowest point of the feet is 146.00 mm below the floor at the start" in out
    )


def test_settings_may_stand_in_files(tmp_path):
    (tmp_path / "stiff.yaml").write_text("servo: {kp: 1234}\nduration: 2\n")
    (tmp_path / "damped.yaml").write_text("servo: {kd: 56}\n")

    config = station_from("irb120_dynamic", ["stiff.yaml", "damped.yaml", "servo.torque_limit=78"])

    assert (config.servo.kp, config.servo.kd, config.servo.torque_limit, config.duration) == (
        1234,
        56,
        78,
        2,
    )
    with pytest.raises(
        SimrobError,
        match=r"--set servo\.kp=1: --set servo\.kp already sets this key; leave out one",
    ):
        station_from("irb120_dynamic", ["stiff.yaml", "servo.kp=1"])
    with pytest.raises(SimrobError, match=r"--set stiff\.yaml: --duration already sets this key"):
        station_from("irb120_dynamic", ["stiff.yaml"], duration=1)
    with pytest.raises(SimrobError, match=r"no\.yaml: cannot be read"):
        station_from("irb120_dynamic", ["no.yaml"])


MISTAKES = {
    "an unknown station": (["run", "irb120_dinamic"], "did you mean 'irb120_dynamic'?"),
    "an unknown key": (["run", "irb120_dynamic", "--set", "servo.kpp=1"], "servo.kpp: unknown key"),
    "no value": (
        ["run", "irb120_dynamic", "--set", "servo.kp"],
        "must be of the form key.path=value",
    ),
    "no YAML": (["run", "irb120_dynamic", "--set", "servo.kp=[1"], "is not YAML"),
    "a negative mass": (
        ["run", "irb120_dynamic", "--set", "pieces.load.mass=-1"],
        "pieces.load.mass",
    ),
    "a far reference": (
        ["run", "irb120_dynamic", "--set", "reference.target_deg=120"],
        "within the joint's limits",
    ),
    "a missing table": (
        ["run", "irb120_dynamic", "--set", "reference={kind: table, file: no.csv}"],
        "no.csv: cannot be read",
    ),
    "a missing URDF": (
        ["run", "irb120_dynamic", "--set", "robot.urdf=no.urdf"],
        "no.urdf: there is no such file",
    ),
    "a missing URDF to check": (["check", "no.urdf"], "no.urdf: there is no such file"),
    "a duration of nothing": (["run", "irb120_dynamic", "--duration", "0"], "duration"),
    "a word for a duration": (
        ["run", "irb120_dynamic", "--duration", "long"],
        "--duration: must be a number (it is 'long')",
    ),
    "an unknown option": (
        ["run", "irb120_dynamic", "--ot", "x"],
        "there is no option --ot; did you mean '--out'?",
    ),
    "an unknown command": (["rum"], "there is no command 'rum'; did you mean 'run'?"),
    "no station": (
        ["run"],
        "simrob run needs STATION|PROGRAM; for example: simrob run irb120_dynamic",
    ),
    "a folder that cannot be": (
        ["run", "irb120_dynamic", "--out", "/proc/nowhere/x"],
        "cannot be written",
    ),
    "two durations": (
        ["run", "irb120_dynamic", "--duration", "0.2", "--set", "duration=1e9"],
        "--set duration=1e9: --duration already sets this key; leave out one of the two",
    ),
    "two values of one key": (
        ["run", "irb120_dynamic", "--set", "servo.kp=1", "--set", "servo.kp=2"],
        "--set servo.kp already sets this key",
    ),
    "a bad duration": (
        ["run", "double_pendulum", "--duration", "-1"],
        "simrob: --duration: must be greater than 0",
    ),
    "a bad setting": (
        ["run", "double_pendulum", "--set", "duration=-1"],
        "simrob: --set duration: must be greater",
    ),
    "bad YAML": (
        ["run", "double_pendulum", "--set", "servo.kp=[1"],
        "simrob: --set servo.kp=[1: is not YAML: while parsing",
    ),
    "endless samples": (["run", "double_pendulum", "--set", "sample_rate=1e9"], "at most 10000"),
    "an endless run": (
        ["run", "double_pendulum", "--duration", "1e9"],
        "at most 10000 s at a sample_rate of 100 Hz",
    ),
    "a folder as station": (["run", "/"], "simrob: /: is a folder"),
    "a setting of a URDF": (
        ["check", "a.urdf", "--set", "duration=1"],
        "--set: this is the file of a robot",
    ),
    "inertia of a station": (
        ["check", "irb120_dynamic", "--estimate-inertia"],
        "--estimate-inertia: this is a station",
    ),
    "an unknown picture format": (["diagram", "irb120_dynamic", "--out", "x.gif2"], ".svg"),
}


@pytest.mark.parametrize(("arguments", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_gets_one_clear_line_and_leaves_nothing(tmp_path, capfd, arguments, message):
    assert run_command(arguments) == ExitCode.BAD_INPUT
    captured = capfd.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("simrob: ")
    assert message in lines[0]
    assert list(tmp_path.iterdir()) == []


TABLES = {
    "a column is missing": ("time,joint_1\n0,0\n1,0\n", "lacks the columns joint_2"),
    "a word": (
        "time,joint_1,joint_2\n0,0,0\n1,x,0\n",
        "line 3: contains a value that is not a number",
    ),
    "a short row": ("time,joint_1,joint_2\n0,0,0\n1,0\n", "line 3"),
    "unsorted times": (
        "time,joint_1,joint_2\n1,0,0\n0,0,0\n",
        "line 3: time 0 s follows 1 s; times must increase",
    ),
    "nan": (
        "time,joint_1,joint_2\n0,0,0\n1,nan,0\n",
        "line 3: contains a value that is not a number",
    ),
    "one row": ("time,joint_1,joint_2\n0,0,0\n", "fewer than two rows"),
    "nothing": ("", "is empty; it must contain a line of names"),
}


@pytest.mark.parametrize(("text", "message"), TABLES.values(), ids=TABLES)
def test_a_bad_table_is_named_with_its_line(tmp_path, capsys, text, message):
    (tmp_path / "move.csv").write_text(text)
    settings = ["--set", "reference.kind=table", "--set", "reference.file=move.csv"]

    assert run_command(["run", "double_pendulum", *settings]) == ExitCode.BAD_INPUT
    assert message in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["move.csv"]


def test_a_table_is_followed(tmp_path):
    (tmp_path / "move.csv").write_text(
        "time,joint_2,joint_1\n0,0.5236,0.6981\n1,0.6,0.7\n2,0.7,0.8\n3,0.8,0.9\n"
    )
    settings = ["--set", "reference.kind=table", "--set", "reference.file=move.csv"]

    assert (
        run_command(
            ["run", "double_pendulum", *settings, "--out", "r", "--no-recording", "--duration", "1"]
        )
        == 0
    )
    header, *rows = (tmp_path / "r" / "signals.csv").read_text().splitlines()
    names, last = header.split(","), np.array(rows[-1].split(","), dtype=float)
    assert last[names.index("q_ref.joint_1")] == pytest.approx(0.7)
    assert last[names.index("q_ref.joint_2")] == pytest.approx(0.6)


def test_importing_the_package_is_quick_and_loads_nothing_heavy():
    """Meshcat, matplotlib and pydrake.all stay out: they would make every command slow."""
    code = "import sys, simrob_drake; print([m for m in ('matplotlib', 'pydrake.all', 'trimesh') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


THREADS = """
import atexit, os, sys
from simrob_drake.cli.__main__ import main
atexit.register(lambda: print("threads", len(os.listdir("/proc/self/task"))))
sys.argv = ["simrob", "diagram", "irb120_kinematic"]
main()
"""


@pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="counts threads as Linux tells them"
)
@pytest.mark.parametrize(
    ("told", "threads"),
    [
        ({}, 1),
        ({"OPENBLAS_NUM_THREADS": "2"}, 2),
        pytest.param({"OMP_NUM_THREADS": "2"}, 2, marks=pytest.mark.long),
    ],
)
def test_one_thread_works_unless_the_environment_says_otherwise(told, threads):
    command = [sys.executable, "-c", THREADS]
    plain = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}

    done = subprocess.run(
        command, env={**plain, **told}, capture_output=True, text=True, check=True
    )

    assert done.stdout.splitlines()[-1] == f"threads {min(threads, len(os.sched_getaffinity(0)))}"


@pytest.mark.long
@pytest.mark.plots
def test_plots_are_written_as_what_is_asked_for(tmp_path, capsys):
    command = [
        "run",
        "irb120_dynamic",
        "--duration",
        "0.1",
        "--no-recording",
        "--out",
        "r",
        "--plots",
    ]

    assert run_command([*command, "svg"]) == 0
    assert {file.name for file in (tmp_path / "r" / "plots").iterdir()} == {
        "position.svg",
        "torque.svg",
        "tcp.svg",
    }
    assert run_command([*command, "jpg"]) == ExitCode.BAD_INPUT
    assert "--plots: must be one of" in capsys.readouterr().err


def broken(_):
    return {}["x" * 5000]


def asserted(_):
    raise SystemExit(
        "Failure at leaf_system.h:478 in DeclarePeriodicEvent(): condition 'x' failed.\nmore"
    )


@pytest.mark.parametrize(
    ("command", "said"), [(broken, "KeyError: 'xxx"), (asserted, "a check of Drake: Failure at")]
)
def test_whatever_else_fails_is_one_line_whose_traceback_can_be_seen(
    command, said, monkeypatch, capsys
):
    for debug in ("", "1"):
        monkeypatch.setenv(DEBUG, debug)
        assert run_guarded(command, []) == ExitCode.BAD_INPUT
        *before, last = capsys.readouterr().err.splitlines()
        assert last.startswith(f"simrob: unexpected error: {said}")
        assert last.endswith("SIMROB_DEBUG=1 shows the traceback")
        assert any("Traceback" in line for line in before) == bool(debug)
        assert debug or not before
    with pytest.raises(SystemExit):
        run_guarded(lambda _: sys.exit(3), [])
    with pytest.raises(KeyError):
        broken([])


@pytest.mark.parametrize(
    ("module", "told"),
    [
        (
            "nothing_like_it.part",
            "simrob run needs the package nothing_like_it, which is not installed: pip install noth",
        ),
        (
            "simrob_drake.gone",
            "simrob run needs the module simrob_drake.gone, which is missing from this installation",
        ),
    ],
)
def test_a_missing_package_is_named(capsys, module, told):
    def command(_):
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    assert run_guarded(command, ["run"]) == ExitCode.BAD_INPUT
    assert told in capsys.readouterr().err


@pytest.mark.long
def test_an_encoding_that_lacks_letters_ends_nothing(tmp_path):
    command = [sys.executable, "-m", "simrob_drake.cli", "check", "double_pendulum"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}

    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    assert r"N\xb7m" in done.stdout


EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.parametrize(
    ("file", "said"),
    [
        (
            EXAMPLES / "learning" / "yobotics_walker.onnx",
            "is not a station, but a network: controllers: {policy: ",
        ),
        (EXAMPLES / "own_loop.py", "is not a station, but a script: python "),
        (models_root() / "roid1" / "gaits.yaml", "is not a station, but the gaits of a robot"),
        (
            models_root() / "pieces" / "ball" / "piece.yaml",
            "is not a station, but a piece: pieces: {part: {model: ",
        ),
        (
            Path(__file__).parents[1] / "README.md",
            "is neither a station nor a robot; stations and programs are read from",
        ),
        ("x" * 5000, "there is no station"),
        (f"{'x' * 5000}.yaml", "there is no such file"),
    ],
)
def test_check_says_what_a_file_is_that_is_no_station(file, said, capsys):
    assert run_command(["check", str(file)]) == ExitCode.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize(
    ("station", "setting", "said"),
    [
        ("irb120_dynamic", "start=/etc/passwd", "/etc/passwd: is not JSON"),
        (
            "roid1_walking",
            "controllers.walk.gait.max_speed.ahead=1e9",
            "max_speed.ahead: must be at most",
        ),
    ],
)
def test_check_says_nothing_ok_that_is_none(station, setting, said, capsys):
    assert run_command(["check", station, "--set", setting]) == ExitCode.BAD_INPUT
    assert said in capsys.readouterr().err


def test_the_main_job_is_one_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs/demo").mkdir(parents=True)

    (tmp_path / "runs/demo/summary.json").write_text("{}")  # of a result before, which is replaced

    assert run_command(["demo"]) == 0
    assert (tmp_path / "runs/demo/recording.html").as_uri() in "".join(
        capsys.readouterr().out.split("\n")
    )


def test_a_robot_of_the_package_is_no_file_that_gets_a_first_station(capsys, tmp_path):
    """The error named a path that nobody gave, and proposed the name that was given."""
    assert (
        run_command(["station", "puma560", "--out", str(tmp_path / "a.yaml")]) == ExitCode.BAD_INPUT
    )

    told = capsys.readouterr().err
    assert "puma560: this is a robot of the package" in told
    assert "robot: {model: puma560}" in " ".join(told.split())
