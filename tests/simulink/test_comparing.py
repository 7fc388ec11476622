"""Logged signals against ours."""

import numpy as np
import pytest
from scipy.io import savemat

from simrob_drake import load_station, simulate
from simrob_drake.cli.app import run_command
from simrob_drake.errors import InvalidConfig, InvalidParameter, SimrobError, UnknownName
from simrob_drake.simulink.comparing import compare, read_log


@pytest.fixture(scope="module")
def run():
    return simulate("double_pendulum", duration=1.0, progress=False)


def test_a_log_of_our_own_run_differs_by_nothing(run, tmp_path):
    folder = run.save(tmp_path / "run", recording=False)
    times, logged = read_log(folder / "signals.csv", {})
    _, differences = compare(load_station("double_pendulum"), times, logged)
    found = {difference.signal: difference.largest for difference in differences}
    assert {"q.joint_1", "tau.joint_2", "tcp.x"} <= set(found)
    assert max(found[name] for name in ("q.joint_1", "q.joint_2")) < 1e-4  # the reference comes from a table


def test_what_differs_is_told(run, tmp_path, capsys):
    wave = 0.01 * np.sin(20 * run.times)
    log = {"tout": run.times, "yout": np.column_stack([run["q.joint_1"] + wave, run["q.joint_2"]])}
    savemat(tmp_path / "log.mat", log)
    times, logged = read_log(tmp_path / "log.mat", {"yout.1": "q.joint_1"})
    _, (difference,) = compare(load_station("double_pendulum"), times, logged)
    assert difference.largest == pytest.approx(0.01, rel=1e-2)
    assert difference.rms == pytest.approx(0.01 * np.sqrt(np.mean(np.sin(20 * run.times) ** 2)), rel=1e-6)
    assert run_command(
        ["compare", "double_pendulum", "--with", str(tmp_path / "log.mat"), "--map", "yout.1=q.joint_1",
         "--out", str(tmp_path / "out")]
    ) == 0  # fmt: skip
    assert "q.joint_1" in capsys.readouterr().out
    assert (tmp_path / "out" / "q.joint_1.png").stat().st_size > 5000
    signal, largest, *_ = (tmp_path / "out" / "differences.csv").read_text().splitlines()[1].split(",")
    assert (signal, float(largest)) == ("q.joint_1", pytest.approx(difference.largest))


def test_a_comparison_is_replaced_with_force_only_and_tells_what_it_left_out(run, tmp_path, capsys):
    rows = np.column_stack([run.times, run["q.joint_1"], run.times])
    np.savetxt(
        tmp_path / "a.csv", rows, delimiter=",", header="\ufefftime,q.joint_1,mine", comments="", encoding="utf-8"
    )
    command = ["compare", "double_pendulum", "--with", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out")]
    assert run_command(command) == 0
    assert "not among the station's signals: mine" in capsys.readouterr().out
    assert run_command(command) == 2
    assert "--force" in capsys.readouterr().err
    assert run_command([*command, "--force"]) == 0
    assert run_command([*command, "--force", "--map", "mine"]) == 2
    assert "THEIRS=OURS" in capsys.readouterr().err


def test_structures_of_to_workspace_and_semicolons_are_read(tmp_path):
    times, values = np.linspace(0, 1, 5), np.arange(10.0).reshape(5, 2)
    plain = {"time": times[:, None], "signals": {"values": values, "label": "", "dimensions": 2.0}}
    named = {"time": times[:, None], "signals": {"values": values[:, :1], "label": "elbow", "dimensions": 1.0}}
    savemat(tmp_path / "a.mat", {"simout": plain, "other": named})
    found, logged = read_log(tmp_path / "a.mat", {"elbow": "q.joint_1"})
    np.testing.assert_array_equal(found, times)
    assert {name: list(column) for name, column in logged.items()} == {
        "simout.1": [0, 2, 4, 6, 8], "simout.2": [1, 3, 5, 7, 9], "q.joint_1": [0, 2, 4, 6, 8],
    }  # fmt: skip
    (tmp_path / "a.csv").write_text("time;q.joint_1\n0;1.5\n0.5;2\n")
    found, logged = read_log(tmp_path / "a.csv", {})
    assert (list(found), list(logged["q.joint_1"])) == ([0, 0.5], [1.5, 2])
    savemat(tmp_path / "b.mat", {"q": values})
    with pytest.raises(InvalidParameter, match=r"tout = simout.Time; yout = simout.Data; save log.mat"):
        read_log(tmp_path / "b.mat", {})


def test_logs_that_cannot_be(tmp_path):
    file = tmp_path / "a.csv"
    for text, told in (
        ("x,y\n1,2\n", "column time"),
        ("time,x\n1,2\n1,3\n", "times rise"),
        ("time,x\n-1,2\n1,3\n", "from 0 or later"),
        ("time,x\n1,2\n", "two moments or more"),
        ("", "a.csv: is empty; it must hold a line of names"),
        ("\n\n", "is empty"),
        ("time,x\n", "two moments or more"),
    ):
        file.write_text(text)
        with pytest.raises(SimrobError, match=told):
            read_log(file, {})
    file.write_text("time\n0\n1\n")
    with pytest.raises(InvalidParameter, match="a log of nothing but times"):
        compare(load_station("double_pendulum"), *read_log(file, {}))
    file.write_text("time,q.joint_1\n2,0\n3,0\n")
    stops = {"monitors.settled": {}, "reference": {"kind": "hold"}}
    with pytest.raises(InvalidParameter, match="a log from 2 s on; it must be one that begins before"):
        compare(load_station("double_pendulum", stops), *read_log(file, {}))
    file.write_text("time,x\n0,2\n1,3\n")
    with pytest.raises(UnknownName, match="'y'"):
        read_log(file, {"y": "q.joint_1"})
    with pytest.raises(InvalidParameter, match="--map"):
        compare(load_station("double_pendulum"), *read_log(file, {}))
    with pytest.raises(InvalidConfig, match="cannot be read"):
        read_log(tmp_path / "none.csv", {})
