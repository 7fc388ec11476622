"""Stations that carry a program: read, changed, run, swept, compared, and what is said of one that cannot be."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from simrob_drake import Workcell, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.cli.programs import check_program, own_program
from simrob_drake.programs.whole_program import carried_program, run_whole
from simrob_drake.stations.load import station_yaml

pytestmark = pytest.mark.usefixtures("no_plots")

TURN = {"moves": [{"target_deg": {"joint_1": 10}, "duration": 0.3}]}
STATION = {"mode": "kinematic", "robot": {"model": "irb120"}, "sample_rate": 100}
TURNED = np.deg2rad(10)


@pytest.fixture
def station(tmp_path: Path) -> Path:
    file = tmp_path / "turn.yaml"
    file.write_text(yaml.safe_dump({**STATION, "program": TURN}))
    return file


def test_it_does_its_program_in_place_of_its_reference(station: Path) -> None:
    config = load_station(station)
    whole = run_whole(config)

    assert whole.stop_time == pytest.approx(0.3)
    assert whole["q.joint_1"][-1] == pytest.approx(TURNED)
    assert simulate(config, duration=0.1)["q.joint_1"].max() == 0  # the station alone
    assert Workcell(config).config.program is None  # who has it at hand says what is done


def test_a_file_may_hold_it_and_is_carried_with_the_station(station: Path, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(yaml.safe_dump({"station": "irb120_kinematic", **TURN}))
    station.write_text(yaml.safe_dump({**STATION, "program": "own.yaml"}))

    config = load_station(station)

    assert config.program == TURN

    (tmp_path / "again.yaml").write_text(station_yaml(config))
    assert load_station(tmp_path / "again.yaml", {"name": config.name}) == config


def test_paths_of_its_changes_start_at_its_file_and_stay_in_the_package(
    station: Path, tmp_path: Path
) -> None:
    (tmp_path / "inner").mkdir()
    change = {"at": 0.1, "set": {"start": "start.json"}}
    (tmp_path / "inner" / "own.yaml").write_text(yaml.safe_dump({**TURN, "changes": [change]}))

    config = load_station(station, {"program": str(tmp_path / "inner" / "own.yaml")})

    assert config.program is not None
    assert config.program["changes"][0]["set"]["start"] == str(tmp_path / "inner" / "start.json")

    station.write_text(yaml.safe_dump({**STATION, "program": "/etc/hostname.yaml"}))
    with pytest.raises(
        SimrobError, match=r"program: /etc/hostname\.yaml is outside the allowed folders"
    ):
        load_station(station)


def test_overrides_change_it_replace_it_and_leave_it_out(station: Path, tmp_path: Path) -> None:
    changed = run_whole(load_station(station, {"program.moves.0.duration": 0.2}))

    assert changed.stop_time == pytest.approx(0.2)

    (tmp_path / "other.yaml").write_text(yaml.safe_dump({"moves": [{"wait": 0.1}]}))
    other = carried_program(load_station(station, {"program": str(tmp_path / "other.yaml")}))

    assert other is not None
    assert [move.key for move in other.moves] == ["wait"]
    assert carried_program(load_station(station, {"program": None})) is None
    with pytest.raises(
        SimrobError, match=r"program\.moves\.1: has no entry '1'; the entries are 0 to 0"
    ):
        load_station(station, {"program.moves.1.duration": 0.2})


@pytest.mark.long
def test_the_command_line_runs_and_checks_it(
    station: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)

    assert run_command(["check", str(station)]) == 0
    assert "1 entries can be done, in 0.3 s" in capsys.readouterr().out
    assert run_command(["run", str(station), "--no-recording", "--out", "r"]) == 0
    assert yaml.safe_load((tmp_path / "r" / "program.yaml").read_text())["moves"] == TURN["moves"]
    assert run_command(["run", str(station), "--duration", "1"]) == 2
    assert "--set program=null" in capsys.readouterr().err
    plain = [
        "run",
        str(station),
        "--set",
        "program=null",
        "--duration",
        "0.1",
        "--no-recording",
        "--out",
        "p",
    ]
    assert run_command(plain) == 0
    assert not (tmp_path / "p" / "program.yaml").exists()


def test_a_program_that_cannot_be_names_the_move(station: Path) -> None:
    config = load_station(station, {"program.moves.0.target_deg": {"joint_7": 1}})
    with pytest.raises(SimrobError, match=r"no axis of irb120 .*'joint_7'; did you mean 'joint_6'"):
        run_whole(config)
    with pytest.raises(
        SimrobError, match=r"turn: program: move 1: mve_l: unknown key; did you mean 'move_l'"
    ):
        run_whole(load_station(station, {"program": {"moves": [{"mve_l": [0, 0, 0]}]}}))


@pytest.mark.parametrize(
    "name",
    [
        "belt_pick",
        "irb120_chess",
        "irb120_on_belt",
        "irb120_gripper",
        "two_arms",
        "humanoid_box",
        "yobotics_terrain",
    ],
)
def test_every_shipped_program_can_be_done(name: str) -> None:
    """Looked at as `simrob check` does, which moves nothing."""
    config = load_station(name)
    assert check_program(own_program(config), config).level != "warning"
