"""The commands about robots, from the outside: import, view, station, and check of a file."""

import json
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import urllib.request

import pytest
import yaml

from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.base.packages import remember_grants, remembered_grants
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command

pytestmark = pytest.mark.usefixtures("no_plots")

RAW = """<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <visual><geometry><box size="0.1 0.1 0.3"/></geometry><material name="undefined"/></visual>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="0" velocity="0"/>
  </joint>
</robot>
"""


@pytest.fixture(autouse=True)
def _apart(tmp_path, monkeypatch):
    """Work in an empty folder beside the source, with a cache of one's own."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


@pytest.fixture
def raw(tmp_path):
    (tmp_path / "source").mkdir()
    file = tmp_path / "source" / "arm.urdf"
    file.write_text(RAW)
    return file


def test_import_tells_what_it_did_and_where_the_robot_is(raw, tmp_path, capsys):
    assert run_command(["import", str(raw)]) == 0
    out = capsys.readouterr().out
    assert "arm_imported/arm.urdf" in out
    assert "undefined" in out
    report = json.loads((tmp_path / "work" / "arm_imported" / "report.json").read_text())
    assert report["summary"] in out


def test_check_of_a_file_reports_and_writes_nothing(raw, tmp_path, capsys):
    assert run_command(["check", str(raw)]) == 0
    out = capsys.readouterr().out
    assert "shoulder" in out
    assert "defaulted" in out
    assert list((tmp_path / "work").iterdir()) == []
    assert not (tmp_path / "cache").exists()


@pytest.mark.probe
def test_modules_that_lie_around_are_never_run(raw, tmp_path, monkeypatch):
    trap = "from pathlib import Path\nPath(__file__).with_suffix('.sprung').touch()\n"
    for name in ("yaml", "numpy", "pydantic"):
        (raw.parent / f"{name}.py").write_text(trap)

    monkeypatch.chdir(raw.parent)

    assert run_command(["check", "arm.urdf"]) == 0
    assert list(raw.parent.glob("*.sprung")) == []


def test_the_drafted_station_runs_at_once(raw, tmp_path, capsys):
    assert run_command(["station", str(raw)]) == 0
    said = capsys.readouterr().out.splitlines()
    remarks = [
        line
        for line in (tmp_path / "work" / "arm.yaml").read_text().splitlines()
        if "the motors need" in line
    ]
    assert [line.removeprefix("# ") in " ".join(said) for line in remarks] == [True]

    proposed = said[-1].strip().removeprefix("simrob ")
    # The robot is in another folder than the station, which the command remembers.
    assert proposed == "run arm.yaml"
    assert f"--mesh-path {raw.parent}" in said
    assert (
        run_command([*shlex.split(proposed), "--duration", "0.2", "--out", "r", "--no-recording"])
        == 0
    )
    assert "q.shoulder" in (tmp_path / "work" / "r" / "signals.csv").read_text().splitlines()[0]
    assert run_command(["check", "arm.yaml"]) == 0
    assert "import of arm.urdf" in capsys.readouterr().out
    assert run_command(["station", str(raw)]) == ExitCode.BAD_INPUT
    assert "--force" in capsys.readouterr().err


def test_only_the_station_at_this_path_may_read_the_robot(raw, tmp_path, capsys):
    assert run_command(["station", str(raw)]) == 0

    text = (tmp_path / "work" / "arm.yaml").read_text()
    (tmp_path / "work" / "other.yaml").write_text(text)

    assert run_command(["check", "other.yaml"]) == ExitCode.BAD_INPUT
    assert f"allow it with --mesh-path {raw.parent}" in capsys.readouterr().err

    # What is remembered is the package of the robot, and nothing else.
    private = tmp_path / "private"
    private.mkdir()
    (private / "arm.urdf").write_text(raw.read_text())

    (tmp_path / "work" / "arm.yaml").write_text(text.replace(str(raw), str(private / "arm.urdf")))

    assert run_command(["check", "arm.yaml"]) == ExitCode.BAD_INPUT
    assert f"allow it with --mesh-path {private}" in capsys.readouterr().err


def test_of_a_mesh_folder_nothing_around_it_is_remembered(raw, tmp_path):
    meshes = tmp_path / "own" / "parts"
    meshes.mkdir(parents=True)

    assert run_command(["station", str(raw), "--mesh-path", str(meshes)]) == 0

    assert remembered_grants(tmp_path / "work" / "arm.yaml") == [raw.parent, meshes]


def test_a_damaged_memory_of_grants_allows_nothing(raw, tmp_path, capsys):
    assert run_command(["station", str(raw)]) == 0

    (memory,) = tmp_path.rglob("station_grants.json")
    for content in ("[]", "{", '{"a": 1}', "\x00"):
        memory.write_text(content)
        assert run_command(["check", "arm.yaml"]) == ExitCode.BAD_INPUT
        assert "allow it with --mesh-path" in capsys.readouterr().err
    assert run_command(["station", str(raw), "--force"]) == 0
    assert run_command(["check", "arm.yaml"]) == 0


def test_without_a_memory_the_command_names_the_flag(raw, tmp_path, monkeypatch, capsys):
    (tmp_path / "full").write_text("a file where the folder of the cache would be")
    monkeypatch.setattr("simrob_drake.base.packages.cache_root", lambda: tmp_path / "full")

    assert run_command(["station", str(raw)]) == 0
    assert f"simrob run arm.yaml --mesh-path {raw.parent}" in capsys.readouterr().out


def test_the_oldest_grants_are_forgotten(tmp_path, monkeypatch):
    monkeypatch.setattr("simrob_drake.base.packages._MOST_REMEMBERED", 2)

    for name in ("a", "b", "a", "c"):
        assert remember_grants(tmp_path / f"{name}.yaml", [tmp_path / name])

    found = {name: remembered_grants(tmp_path / f"{name}.yaml") for name in "abc"}
    assert found == {"a": [tmp_path / "a"], "b": [], "c": [tmp_path / "c"]}


@pytest.mark.long
def test_a_station_of_the_package_takes_a_raw_robot(published_irb120, tmp_path):
    setting = f"robot.urdf={published_irb120}"

    arguments = [
        "run",
        "irb120_dynamic",
        "--set",
        setting,
        "--duration",
        "0.2",
        "--no-recording",
        "--out",
        "r",
    ]
    assert run_command(arguments) == 0
    text = (tmp_path / "work" / "r" / "station.yaml").read_text()
    assert "urdf: " in text  # of the copy that the result carries
    assert "model: irb120" not in text


def test_a_robot_without_inertias_is_drafted_with_the_way_to_motion_by_torque(tmp_path, capsys):
    file = tmp_path / "arm and hand.urdf"
    file.write_text(re.sub("<inertial>.*</inertial>", "", RAW))

    (tmp_path / "meshes").mkdir()

    own = [
        "--mesh-path",
        str(tmp_path / "meshes"),
        "--mesh-path",
        str(tmp_path),
        "--density",
        "900",
    ]
    assert run_command(["station", str(file), "--out", "a.yaml", *own]) == 0
    text = (tmp_path / "work" / "a.yaml").read_text()
    assert "mode: kinematic" in text

    proposed = next(
        line for line in text.splitlines() if "For a dynamic station, run: " in line
    ).partition("run: simrob ")[2]
    assert run_command([*shlex.split(proposed), "--out", "b.yaml"]) == 0
    again = yaml.safe_load((tmp_path / "work" / "b.yaml").read_text())
    assert again["mode"] == "dynamic"
    assert again["robot"]["import_options"] == {
        "mesh_path": [str(tmp_path / "meshes"), str(tmp_path)], "estimate_inertia": True, "density": 900.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["import", "none.urdf"], "none.urdf"),
        (["import", "{raw}", "--out", "{raw.parent}/out"], "overlaps the source"),
        (["import", "{raw}", "--collision", "sphere"], "sphere"),
        (["import", "{raw}", "--density", "-1", "--estimate-inertia"], "density"),
        (["station", "{raw}", "--out", "station.txt"], ".yaml"),
        (
            ["import", "{raw}", "--mesh-path", "/no/where"],
            "Invalid value for '--mesh-path': dir '/no/where' does not exist",
        ),
        (["import", "{raw}", "--mesh-path", "{raw}"], "is a file"),
        (
            ["view", "irb120", "--collision", "box"],
            "--collision: this is not the file of a robot",
        ),
        (["view", "irb121"], "did you mean 'irb120'"),
        (["view", "none.urdf"], "none.urdf"),
        (["check", "none.urdf"], "none.urdf"),
    ],
)
def test_bad_input_is_one_line(raw, tmp_path, capsys, arguments, says):
    assert run_command([argument.format(raw=raw) for argument in arguments]) == ExitCode.BAD_INPUT
    captured = capsys.readouterr()
    assert says in captured.err
    assert len(captured.err.strip().splitlines()) == 1
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.long
def test_view_shows_the_robot_until_it_is_interrupted(raw):
    command = [sys.executable, "-u", "-m", "simrob_drake.cli", "view", str(raw)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as window:
        line = window.stdout.readline()
        url = line.split()[-1]
        assert url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(url) as page:
            assert page.status == 200
        window.send_signal(signal.SIGINT)
        assert window.wait(timeout=20) == 130
        assert window.stderr.read().splitlines()[-1] == "simrob: interrupted"


def test_a_file_is_a_robot_whatever_the_case_of_its_ending(raw, capsys):
    shouted = raw.with_suffix(".URDF")
    shouted.write_bytes(raw.read_bytes())

    assert run_command(["check", str(shouted)]) == ExitCode.DONE
    assert "moving links without inertia" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "named"),
    [(["--library", "."], "--library"), (["--octave"], "--octave"), (["--set", "a=1"], "--set"),
     (["--contact-law"], "--contact-law")],
)  # fmt: skip
def test_options_of_simulink_models_are_refused_with_a_urdf(raw, options, named, capsys):
    assert run_command(["import", str(raw), *options]) == ExitCode.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert named in line
    assert re.search("the option belongs to (a )?Simulink models?; leave it out", line)
    assert not list(raw.parent.glob("*imported"))


def test_check_refuses_them_as_well(raw, capsys):
    assert run_command(["check", str(raw), "--assume"]) == ExitCode.BAD_INPUT
    assert "--assume" in capsys.readouterr().err


TABLE = """
name: two
dh:
  convention: classical
  rows:
    - {d: 0.3, a: 0.3, alpha_deg: 90, limit_deg: [-100, 100], effort: 80, mass: 3}
    - {a: 0.3, limit_deg: [-170, -10], effort: 80, mass: 2}
"""


def test_check_takes_a_table_by_its_path(capsys):
    (path := pathlib.Path("two_links.yaml")).write_text(TABLE)

    assert run_command(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "two: 2 axes" in out
    assert "payload at tool0" in out


def test_station_takes_a_table_by_its_path_and_runs(capsys):
    (path := pathlib.Path("two_links.yaml")).write_text(TABLE)

    assert run_command(["station", str(path), "--out", "first.yaml"]) == 0

    written = yaml.safe_load(pathlib.Path("first.yaml").read_text())
    assert written["robot"]["model"] == "two_links.yaml"
    assert run_command(["check", "first.yaml"]) == 0
    assert "within the joint limits" in capsys.readouterr().out


def test_options_of_an_import_do_not_go_with_a_table(capsys):
    pathlib.Path("two_links.yaml").write_text(TABLE)
    assert (
        run_command(["station", "two_links.yaml", "--out", "first.yaml", "--estimate-inertia"])
        == ExitCode.BAD_INPUT
    )
    assert "two_links.yaml describes a robot" in capsys.readouterr().err


def test_torques_of_a_robot_without_inertias_are_one_line_with_the_reason(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(re.sub("<inertial>.*</inertial>", "", RAW))

    assert run_command(["station", str(file)]) == 0

    capsys.readouterr()
    assert run_command(["check", "arm.yaml"]) == 0

    out = " ".join(capsys.readouterr().out.split())
    assert "0.00 N·m" not in out
    assert "holding requires" not in out
    assert (
        len(
            re.findall(
                "torques and payload of robot not predicted: 1 moving link has no inertia", out
            )
        )
        == 1
    )
