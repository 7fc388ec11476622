"""Logged signals against ours."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from scipy.io import savemat

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError, UnknownName
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.simulink.logs import compare, read_log


@pytest.fixture(scope="module")
def run():
    return simulate("double_pendulum", duration=1.0, progress=False)


@pytest.mark.long
def test_a_log_of_our_own_run_differs_by_nothing(run, tmp_path):
    folder = run.save(tmp_path / "run", recording=False)
    logged = read_log(folder / "signals.csv", {})
    _, differences = compare(load_station("double_pendulum"), logged)
    found = {difference.signal: difference.largest for difference in differences}
    assert {"q.joint_1", "tau.joint_2", "tcp.x"} <= set(found)
    # the reference comes from a table
    assert max(found[name] for name in ("q.joint_1", "q.joint_2")) < 1e-4


def test_what_differs_is_told(run, tmp_path, capsys):
    wave = 0.01 * np.sin(20 * run.times)
    log = {"tout": run.times, "yout": np.column_stack([run["q.joint_1"] + wave, run["q.joint_2"]])}
    savemat(tmp_path / "log.mat", log)
    logged = read_log(tmp_path / "log.mat", {"yout.1": "q.joint_1"})
    _, (difference,) = compare(load_station("double_pendulum"), logged)
    assert difference.largest == pytest.approx(0.01, rel=1e-2)
    assert difference.rms == pytest.approx(
        0.01 * np.sqrt(np.mean(np.sin(20 * run.times) ** 2)), rel=1e-6
    )
    assert run_command(
        ["compare", "double_pendulum", "--with", str(tmp_path / "log.mat"), "--map", "yout.1=q.joint_1",
         "--out", str(tmp_path / "out")]
    ) == 0  # fmt: skip
    assert "q.joint_1" in capsys.readouterr().out
    assert (tmp_path / "out" / "q.joint_1.png").stat().st_size > 5000
    signal, largest, *_ = (
        (tmp_path / "out" / "differences.csv").read_text().splitlines()[1].split(",")
    )
    assert (signal, float(largest)) == ("q.joint_1", pytest.approx(difference.largest))


@pytest.mark.long
def test_a_comparison_is_replaced_with_force_only_and_tells_what_it_left_out(run, tmp_path, capsys):
    rows = np.column_stack([run.times, run["q.joint_1"], run.times])
    np.savetxt(
        tmp_path / "a.csv",
        rows,
        delimiter=",",
        header="\ufefftime,q.joint_1,mine",
        comments="",
        encoding="utf-8",
    )
    command = [
        "compare",
        "double_pendulum",
        "--with",
        str(tmp_path / "a.csv"),
        "--out",
        str(tmp_path / "out"),
    ]
    assert run_command(command) == 0
    assert "not among the station's signals: mine" in capsys.readouterr().out
    assert run_command(command) == 2
    assert "--force" in capsys.readouterr().err
    assert run_command([*command, "--force"]) == 0
    assert run_command([*command, "--force", "--map", "mine"]) == 2
    assert "THEIRS=OURS" in capsys.readouterr().err


TIMED = np.linspace(0, 1, 5)
ROWS = np.arange(10.0).reshape(5, 2)


def found_in(file, names=None):
    """Return the values of a log's signals, whose times are all the same five."""
    logged = read_log(file, names or {})
    for signal in logged.values():
        np.testing.assert_array_equal(signal.times, TIMED)
    return {name: list(signal.values) for name, signal in logged.items()}


def test_structures_of_to_workspace_are_read(tmp_path):
    """By name or label, of a Scope with several signals, and without times of their own beside `tout`."""
    plain = {
        "time": TIMED[:, None],
        "signals": {"values": ROWS, "label": "", "dimensions": 2.0},
        "blockName": "m/To",
    }
    named = {
        "time": TIMED[:, None],
        "signals": {"values": ROWS[:, :1], "label": "elbow", "dimensions": 1.0},
    }
    savemat(tmp_path / "a.mat", {"simout": plain, "other": named})
    assert found_in(tmp_path / "a.mat", {"elbow": "q.joint_1"}) == {
        "simout.1": [0, 2, 4, 6, 8], "simout.2": [1, 3, 5, 7, 9], "q.joint_1": [0, 2, 4, 6, 8],
    }  # fmt: skip
    kinds = [("values", object), ("label", object)]
    signals = np.array([(ROWS[:, :1], ""), (ROWS[:, 1:], "wrist")], dtype=kinds)
    bare = {"time": np.zeros((0, 0)), "signals": {"values": ROWS[:, 1:], "label": ""}}
    savemat(
        tmp_path / "b.mat",
        {"scope": {"time": TIMED[:, None], "signals": signals}, "bare": bare, "tout": TIMED},
    )
    assert found_in(tmp_path / "b.mat") == {
        "scope.1": [0, 2, 4, 6, 8], "wrist": [1, 3, 5, 7, 9], "bare": [1, 3, 5, 7, 9],
    }  # fmt: skip


def test_signals_of_one_file_may_have_times_of_their_own(tmp_path, run):
    """Two To Workspace blocks of other rates, one of them in degrees: both are held against the same run."""
    slow = {
        "time": run.times[::10, None],
        "signals": {"values": np.rad2deg(run["q.joint_1"][::10, None]), "label": ""},
    }
    fast = {
        "time": run.times[:, None],
        "signals": {"values": run["v.joint_2"][:, None] + 0.5, "label": ""},
    }
    savemat(tmp_path / "a.mat", {"out": {"slow": slow, "fast": fast}})
    logged = read_log(tmp_path / "a.mat", {"out.slow": "q.joint_1:deg", "out.fast": "v.joint_2"})
    assert [len(signal.times) for signal in logged.values()] == [
        len(run.times[::10]),
        len(run.times),
    ]
    _, differences = compare(load_station("double_pendulum"), logged)
    largest = {difference.signal: difference.largest for difference in differences}
    assert largest == {
        "q.joint_1": pytest.approx(0, abs=1e-9),
        "v.joint_2": pytest.approx(0.5, abs=1e-9),
    }
    with pytest.raises(
        InvalidParameter, match=r"--map is q.joint_1:kg; it must be of a unit like rad"
    ):
        compare(
            load_station("double_pendulum"),
            read_log(tmp_path / "a.mat", {"out.slow": "q.joint_1:kg"}),
        )


def test_matrices_with_their_times_are_read(tmp_path):
    """To File has a row for each signal below that of the times; From Workspace a column beside it."""
    savemat(tmp_path / "a.mat", {"ans": np.vstack([TIMED, ROWS.T])})
    assert found_in(tmp_path / "a.mat") == {"ans.1": [0, 2, 4, 6, 8], "ans.2": [1, 3, 5, 7, 9]}
    savemat(tmp_path / "b.mat", {"simin": np.column_stack([TIMED, ROWS[:, 1]])})
    assert found_in(tmp_path / "b.mat") == {"simin": [1, 3, 5, 7, 9]}
    # as of a timeseries
    savemat(tmp_path / "c.mat", {"Time": TIMED, "Data": ROWS.T.reshape(2, 1, 5)})
    assert found_in(tmp_path / "c.mat") == {"Data.1": [0, 2, 4, 6, 8], "Data.2": [1, 3, 5, 7, 9]}
    cells = np.empty(2, dtype=object)
    cells[:] = [{"Time": TIMED, "Data": ROWS[:, 0]}, {"Time": TIMED, "Data": ROWS[:, 1]}]
    savemat(tmp_path / "d.mat", {"logsout": cells})
    assert found_in(tmp_path / "d.mat") == {
        "logsout.1": [0, 2, 4, 6, 8],
        "logsout.2": [1, 3, 5, 7, 9],
    }


def test_of_samples_at_a_jump_the_last_counts(tmp_path):
    savemat(tmp_path / "a.mat", {"tout": [0.0, 0.5, 0.5, 1.0], "yout": [1.0, 2.0, 3.0, 4.0]})
    logged = read_log(tmp_path / "a.mat", {})["yout"]
    assert (list(logged.times), list(logged.values)) == ([0, 0.5, 1], [1, 3, 4])


def test_tables_with_semicolons_and_of_parquet(tmp_path):
    (tmp_path / "a.csv").write_text("Time;q.joint_1\n0;1,5\n0,5;2\n1;2.5\n")
    logged = read_log(tmp_path / "a.csv", {})["q.joint_1"]
    assert (list(logged.times), list(logged.values)) == ([0, 0.5, 1], [1.5, 2, 2.5])
    pytest.importorskip("pyarrow", reason="needs pyarrow")
    from pyarrow import parquet, table

    parquet.write_table(table({"time": TIMED, "elbow": ROWS[:, 0]}), tmp_path / "a.parquet")
    assert found_in(tmp_path / "a.parquet", {"elbow": "q.joint_1"}) == {
        "q.joint_1": [0, 2, 4, 6, 8]
    }
    (tmp_path / "b.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(InvalidParameter, match="a table of numbers"):
        read_log(tmp_path / "b.parquet", {})


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="without GNU Octave")
def test_files_of_octave_are_read(tmp_path):
    code = (
        "simout.time = linspace(0, 1, 5)'; simout.signals.values = reshape(0:9, 2, 5)'; simout.signals.label = '';"
        " save('-v7', 'a.mat', 'simout'); ans = [simout.time'; simout.signals.values']; save('-v6', 'b.mat', 'ans');"
        " tout = simout.time; yout = simout.signals.values; save('-hdf5', 'c.mat', 'tout', 'yout');"
    )
    subprocess.run(
        ["octave-cli", "--no-init-file", "--quiet", "--eval", code],
        cwd=tmp_path,
        check=True,
        timeout=60,
    )
    for file, name in (("a.mat", "simout"), ("b.mat", "ans")):
        assert found_in(tmp_path / file) == {
            f"{name}.1": [0, 2, 4, 6, 8],
            f"{name}.2": [1, 3, 5, 7, 9],
        }
    with pytest.raises(InvalidParameter, match=r"c\.mat; it must be"):
        read_log(tmp_path / "c.mat", {})


@pytest.mark.parametrize(
    ("kind", "lines"),
    [
        (
            "timeseries",
            "tout = simout.Time; yout = squeeze(simout.Data); save -v7 log.mat tout yout",
        ),
        ("Simulink.SimulationData.Dataset", "s = simout{1}.Values; tout = s.Time"),
        ("Simulink.SimulationOutput", "tout = simout.tout; yout = simout.yout{1}.Values.Data"),
        ("timetable", "tout = seconds(simout.Properties.RowTimes)"),
    ],
)
def test_objects_that_only_matlab_reads_say_how_to_export_them(tmp_path, monkeypatch, kind, lines):
    """SciPy gives such an object as its class and numbers that mean nothing; here as its two ways of saying so."""
    from scipy.io.matlab import MatlabOpaque

    fields = [("_TypeSystem", object), ("_Class", object), ("_ObjectMetadata", object)]
    older = [("s0", object), ("s1", object), ("s2", object), ("arr", object)]
    for objects in (
        {"simout": MatlabOpaque(np.array([("MCOS", kind, np.zeros((6, 1)))], dtype=fields))},
        {"None": MatlabOpaque(np.array([("simout", "MCOS", kind, np.zeros((6, 1)))], dtype=older))},
    ):
        monkeypatch.setattr(
            "simrob_drake.extensions.simulink.logs.contents_of_mat", lambda *_, found=objects: found
        )
        with pytest.raises(InvalidParameter, match=re.escape(lines)) as told:
            read_log(tmp_path / "a.mat", {})
        assert f"simout is a {kind}, which only MATLAB reads" in str(told.value)
        objects |= {"tout": TIMED, "yout": ROWS}
        assert list(read_log(tmp_path / "a.mat", {})) == ["yout.1", "yout.2"]
        with pytest.raises(InvalidParameter, match="only MATLAB reads"):
            read_log(tmp_path / "a.mat", {"simout.1": "q.joint_1"})


def test_logs_that_cannot_be(tmp_path):
    file = tmp_path / "a.csv"
    for text, told in (
        ("x,y\n1,2\n", "column time"),
        ("time,x\n1,2\n1,3\n", "times rise"),
        ("time,x\n-1,2\n1,3\n", "from 0 or later"),
        ("time,x\n1,2\n", "two moments or more"),
        ("", "a.csv: is empty; it must contain a line of names"),
        ("\n\n", "is empty"),
        ("time,x\n", "two moments or more"),
    ):
        file.write_text(text)
        with pytest.raises(SimrobError, match=told):
            read_log(file, {})
    file.write_text("time\n0\n1\n")
    with pytest.raises(InvalidParameter, match="and signals of its length"):
        read_log(file, {})
    savemat(tmp_path / "b.mat", {"q": -ROWS})
    with pytest.raises(InvalidParameter, match="a log with a column time"):
        read_log(tmp_path / "b.mat", {})
    savemat(tmp_path / "b.mat", {"t": TIMED, "q": [1.0, 2.0, np.nan, 4.0, 5.0]})
    with pytest.raises(InvalidParameter, match=r"q.joint_1 without a number at 0.5 s"):
        compare(load_station("double_pendulum"), read_log(tmp_path / "b.mat", {"q": "q.joint_1"}))
    file.write_text("time,q.joint_1\n2,0\n3,0\n")
    stops = {"monitors.settled": {}, "reference": {"kind": "hold"}}
    with pytest.raises(
        InvalidParameter, match="a log from 2 s on; it must be one that begins before"
    ):
        compare(load_station("double_pendulum", stops), read_log(file, {}))
    file.write_text("time,x\n0,2\n1,3\n")
    with pytest.raises(UnknownName, match="'y'"):
        read_log(file, {"y": "q.joint_1"})
    with pytest.raises(InvalidParameter, match="--map"):
        compare(load_station("double_pendulum"), read_log(file, {}))
    with pytest.raises(InvalidConfig, match="cannot be read"):
        read_log(tmp_path / "none.csv", {})
