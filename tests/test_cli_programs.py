"""Programs from the command line: of arms and of legs, run and checked."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image

from simrob_drake import Workcell
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.stations.load import load_station

pytestmark = pytest.mark.usefixtures("no_plots")

PICK = [
    {
        "move_j": {
            "targets_deg": [0, 0, 0.05, 0, 0, 180],
            "wobj": "bar",
            "robot": "left",
            "duration": 0.9,
        }
    },
    {"move_l": {"targets": [0, 0, -0.02], "wobj": "bar", "robot": "left", "speed": 0.5}},
    {"attach": {"piece": "bar", "robot": "left"}},
    {"move_l": {"targets": [0, 0, 0.05], "wobj": "bar", "robot": "left", "speed": 0.5}},
]
WAVES = {
    "station": "humanoid_fixed",
    "moves": [{"act": "wave"}, {"target_deg": {"HomDF": 20}, "duration": 0.2}],
}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(name="p.yaml", station="two_arms", moves=PICK, **more):
    with open(name, "w") as file:
        yaml.safe_dump({"station": station, "moves": moves, **more}, file)
    return name


def signals(folder):
    header, *rows = (folder / "signals.csv").read_text().splitlines()
    return header.split(","), np.array([row.split(",") for row in rows], dtype=float)


@pytest.mark.long
@pytest.mark.plots
def test_a_program_of_arms_is_one_result_that_runs_again(tmp_path, capsys):
    assert run_command(["run", write(), "--out", "r"]) == ExitCode.DONE

    out = " ".join(capsys.readouterr().out.split())
    assert "two_arms: ran to its end at" in out

    held = {
        "summary.json",
        "signals.csv",
        "events.csv",
        "program.yaml",
        "station.yaml",
        "recording.html",
        "plots",
    }
    assert held | {"film_strip.png"} == {file.name for file in (tmp_path / "r").iterdir()}

    cell = Workcell("two_arms")
    left = cell.arm("left")
    expected = [left.move_j([0, 0, 0.05, 0, 0, np.pi], wobj="bar", duration=0.9)]
    expected.append(left.move_l([0, 0, -0.02], wobj="bar", speed=0.5))
    left.attach("bar")
    expected.append(left.move_l([0, 0, 0.05], wobj="bar", speed=0.5))
    names, values = signals(tmp_path / "r")

    rows = [run.axes("q", "left")[: None if run is expected[-1] else -1] for run in expected]
    np.testing.assert_array_equal(
        values[:, [names.index(f"left.q.joint_{n}") for n in range(1, 7)]], np.vstack(rows)
    )
    z = values[:, names.index("piece.bar.z")]
    assert z[-1] - z[0] == pytest.approx(0.05, abs=1e-9)
    assert (
        json.loads((tmp_path / "r" / "summary.json").read_text())["final"]["piece_pose"]["bar"][2]
        == z[-1]
    )
    assert (
        run_command(["run", "r/program.yaml", "--out", "again", "--frames", "2"]) == ExitCode.DONE
    )
    for file in (
        "signals.csv",
        "events.csv",
        "program.yaml",
        "station.yaml",
        "recording.html",
        "plots/piece_bar.png",
    ):
        assert (tmp_path / "again" / file).read_bytes() == (tmp_path / "r" / file).read_bytes(), (
            file
        )

    one, other = (Image.open(tmp_path / folder / "film_strip.png") for folder in ("r", "again"))
    assert one.size != other.size  # four events against two frames


@pytest.mark.long
def test_the_folder_of_a_program_of_legs_holds_all_of_it(tmp_path, capsys):
    with open("w.yaml", "w") as file:
        yaml.safe_dump(WAVES, file)

    assert run_command(["run", "w.yaml", "--out", "r", "--no-recording"]) == ExitCode.DONE
    assert "fixed: ran to its end at" in capsys.readouterr().out

    names, values = signals(tmp_path / "r")
    assert "q.right_shoulder_pitch" in names
    assert values[0, 0] == 0
    assert (np.diff(values[:, 0]) > 0).all()
    assert values[-1, 0] > 2.0
    assert "act wave ends" in (tmp_path / "r" / "events.csv").read_text()
    assert (
        run_command(["run", "r/program.yaml", "--out", "again", "--no-recording"]) == ExitCode.DONE
    )
    np.testing.assert_array_equal(signals(tmp_path / "again")[1], values)


@pytest.mark.long
def test_check_says_what_a_program_takes(capsys):
    assert run_command(["check", write()]) == ExitCode.DONE
    assert "4 entries can be done, in 1." in " ".join(capsys.readouterr().out.split())

    with open("w.yaml", "w") as file:
        yaml.safe_dump(WAVES, file)
    assert run_command(["check", "w.yaml"]) == ExitCode.DONE
    assert "2 moves can be done" in capsys.readouterr().out


MISTAKES = {
    "no station": (
        ["run"],
        {"station": None},
        "station: this key is required: the name or the file of the station",
    ),
    "no robot": (
        ["check"],
        {"moves": [{"move_l": [0, 0, 1]}]},
        "p.yaml: move 1: robot is not named",
    ),
    "legs": (
        ["run"],
        {"station": "humanoid_dynamic", "moves": [{"move_l": [0, 0, 1]}]},
        "a robot with a fixed base",
    ),
    "out of reach": (
        ["check"],
        {"moves": [PICK[0], {"move_l": {"targets": [9, 0, 0], "robot": "left"}}]},
        "move 2:",
    ),
    "frames": (["run", "--frames", "one"], {}, 'must be a number of at least 2, or "events"'),
    "a duration": (["run", "--duration", "2"], {}, "--duration: a program has its own duration"),
    "an import": (["check", "--estimate-inertia"], {}, "--estimate-inertia: this is a program"),
    "nothing": (["run"], {"moves": []}, "has no move that takes time"),
}


@pytest.mark.parametrize(("command", "program", "message"), MISTAKES.values(), ids=MISTAKES)
def test_what_cannot_be_done_is_one_line_and_leaves_nothing(
    tmp_path, capfd, command, program, message
):
    write(**program)

    assert run_command([*command, "p.yaml"]) == ExitCode.BAD_INPUT
    captured = capfd.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert message in " ".join(captured.err.split())
    assert [file.name for file in tmp_path.iterdir()] == ["p.yaml"]


@pytest.mark.long
def test_a_station_is_changed_beneath_its_program(tmp_path):
    arguments = ["run", write(), "--out", "r", "--no-recording", "--set", "mode=dynamic"]
    assert run_command(arguments) == ExitCode.DONE
    assert load_station(tmp_path / "r" / "station.yaml").mode == "dynamic"
