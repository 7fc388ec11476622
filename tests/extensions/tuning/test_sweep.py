"""Many runs of a station: which they are, what is measured of them, and that none is lost or made twice."""

import csv
import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from distributed import Client, KilledWorker, LocalCluster
from pyarrow import parquet

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError
from simrob_drake.base.files import diagrams_root
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import processes
from simrob_drake.extensions.tuning.journal import ROWS, Trial, made
from simrob_drake.extensions.tuning.processes import Cluster, Processes
from simrob_drake.extensions.tuning.rollout import measures
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.extensions.tuning.sweep_folder import TABLE, SweepFolder
from tests.extensions.tuning.dying import dies

SHORT = {"duration": 0.2, "reference.duration": 0.1}
WILD = {"duration": 1, "solver.max_step": 0.01, "servo.torque_limit": 1e12}
PENDULUM = Sweep(station="double_pendulum", vary={"servo.kp": "20,40"}, overrides=SHORT)


def test_every_combination_is_run_with_every_seed():
    """Parts that are random have streams of their own, but for those that the user sets."""
    sensors = {"one": {"kind": "imu"}, "two": {"kind": "imu"}, "own": {"kind": "imu", "seed": 7}}
    vary = {"servo.kp": "50,100", "servo.kd": "uniform:1:2"}
    overrides = {"sensors": sensors, "sensors.own.seed": 7}
    cases = Sweep(station="humanoid_dynamic", vary=vary, overrides=overrides, seeds=3).cases()
    assert [case.number for case in cases] == [1, 2, 3, 4, 5, 6]
    assert [case.shown["servo.kp"] for case in cases] == [50, 50, 50, 100, 100, 100]
    assert [case.seed for case in cases] == [0, 1, 2, 0, 1, 2]
    assert [case.shown["servo.kd"] for case in cases[:3]] == [
        case.shown["servo.kd"] for case in cases[3:]
    ]
    seeds = [
        tuple(sensor.seed for sensor in case.scene().config.sensors.values()) for case in cases[:3]
    ]
    assert seeds == [(0, 1000, 7), (1, 1001, 7), (2, 1002, 7)]


def test_all_keys_may_be_drawn_at_once():
    asked = {
        "servo.kp": "loguniform:20:200",
        "servo.kd": {"low": 1, "high": 2},
        "solver.scheme": "cenic,radau3",
    }
    cases = Sweep(station="double_pendulum", vary=asked, sampling="latin", count=8).cases()
    assert len(cases) == 8
    assert sorted(round(8 * (case.shown["servo.kd"] - 1) - 0.5) for case in cases) == list(range(8))
    assert [case.shown["solver.scheme"] for case in cases].count("cenic") == 4
    assert cases[3].scene().config.servo.kp == cases[3].shown["servo.kp"]
    grid = Sweep(station="double_pendulum", vary=asked, sampling="grid", count=3).cases()
    assert len(grid) == 3 * 3 * 2


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"count": 3}, "--count: it belongs to --sampling, which is not given; leave it out"),
        (
            {"sampling": "grid", "vary": {"servo.kp": "uniform:1:2"}, "count": 9999, "seeds": 11},
            "at most 100000",
        ),
        ({"vary": {"servo.kpp": "1,2"}}, "--vary servo.kpp: unknown key; did you mean 'kp'"),
        ({"vary": {"servo.kp": "-1,2"}}, "--vary servo.kp"),
        ({"vary": {"duration": "1,2"}}, "--vary duration: --set gives this key already"),
        ({"vary": {}}, "--vary: nothing is varied; give it at least once"),
        ({"seeds": 2}, "--seeds is 2; it must be 1 where nothing is random"),
        ({"vary": {"servo.kp": "lin:1:2:999", "servo.kd": "lin:1:2:999"}}, "at most 100000"),
        ({"station": "doble_pendulum"}, "did you mean 'double_pendulum'"),
    ],
)
def test_what_cannot_be_is_told_before_any_run(changed, told):
    with pytest.raises(SimrobError, match=told):
        Sweep(**{**PENDULUM.model_dump(), **changed}).cases()


@pytest.mark.parametrize(
    "changed", [{"seeds": 0}, {"seeds": 1001}, {"sede": 1}, {"vary": {"servo.kp": 3}}]
)
def test_a_sweep_of_other_content_is_none(changed):
    with pytest.raises(InvalidConfig):
        Sweep(**{**PENDULUM.model_dump(), **changed})


def test_measures_are_those_of_the_signals():
    """What has no way to go cannot overshoot; what diverged has no figures."""
    run = simulate(load_station("irb120_dynamic"))
    found = measures(run)
    joints = [
        (run[f"q_ref.{axis}"], run[f"q.{axis}"]) for axis in map("joint_{}".format, range(1, 7))
    ]
    errors = [reference - position for reference, position in joints]
    assert found["tracking_error"] == pytest.approx(
        np.linalg.norm(errors) / np.sqrt(np.size(errors))
    )
    assert found["final_error"] == pytest.approx(max(abs(error[-1]) for error in errors))
    assert found["overshoot"] == pytest.approx(
        max(max(q - r.max()) / (r.max() - r.min()) for r, q in joints)
    )
    assert found["overshoot"] > 0.01
    still = simulate(
        load_station("double_pendulum", {"duration": 0.1, "reference": {"kind": "hold"}})
    )
    assert measures(still)["overshoot"] is None
    diverged = simulate(load_station("irb120_dynamic", {**WILD, "solver.scheme": "explicit_euler"}))
    assert diverged.ending == "diverged"
    assert measures(diverged) == {}


class TestFolder:
    @pytest.mark.long
    @pytest.mark.usefixtures("processes")
    def test_a_sweep_ends_as_table_and_plots_and_each_run_is_that_of_simulate(self, tmp_path):
        rows = SweepFolder(tmp_path / "sweep", PENDULUM).run(workers=2, progress=False)
        with (tmp_path / "sweep" / TABLE).open() as file:
            table = list(csv.DictReader(file))
        assert [row["number"] for row in table] == ["1", "2"]
        alone = measures(simulate(load_station("double_pendulum", {**SHORT, "servo.kp": 40})))
        assert {name: rows[1][name] for name in alone} == alone
        assert float(table[1]["tracking_error"]) == alone["tracking_error"]
        columns = parquet.read_table(tmp_path / "sweep/sweep.parquet").to_pydict()
        assert columns["tracking_error"] == [row["tracking_error"] for row in rows]
        assert {file.name for file in (tmp_path / "sweep/plots").iterdir()} == {
            "over_servo.kp.png",
            "spread.png",
        }

    @pytest.mark.long
    def test_it_goes_on_where_it_was_killed(self, tmp_path):
        """Lines that are whole count, half a line does not; nothing is made twice."""
        whole = SweepFolder(tmp_path / "sweep", PENDULUM).run(workers=1, progress=False)
        first = {**whole[0], "message": "kept"}
        line = {
            "number": 1,
            "rows": [{key: value for key, value in first.items() if key != "number"}],
        }
        (tmp_path / "sweep/rows.jsonl").write_bytes(
            f'{json.dumps(line)}\n{{"number": 2, "ser'.encode() + b"\xc3"
        )
        assert SweepFolder.there(tmp_path / "sweep").run(workers=1, progress=False) == [
            first,
            whole[1],
        ]

    def test_another_sweep_is_refused_and_so_is_a_station_that_has_changed(self, tmp_path):
        station = tmp_path / "own.yaml"
        text = (diagrams_root() / "double_pendulum.yaml").read_text()
        station.write_text(text)
        SweepFolder(tmp_path / "sweep", PENDULUM.model_copy(update={"station": str(station)}))
        with pytest.raises(OutputError, match="another sweep"):
            SweepFolder(tmp_path / "sweep", PENDULUM)
        station.write_text(text.replace("gravity: 9.81", "gravity: 1.62"))
        with pytest.raises(InvalidConfig, match="has changed since"):
            SweepFolder.there(tmp_path / "sweep")

    @pytest.mark.long
    def test_a_run_that_cannot_be_or_diverges_is_a_row(self, tmp_path):
        sweep = Sweep(
            station="irb120_dynamic",
            vary={"solver.scheme": "cenic,nope,explicit_euler"},
            overrides=WILD,
        )
        ends = [
            row["ended"]
            for row in SweepFolder(tmp_path / "sweep", sweep).run(workers=1, progress=False)
        ]
        assert ends == ["completed", "refused", "diverged"]


def made_by(engine, tasks, work=dies):
    with engine as workers:
        return sorted(workers.outcomes(work, tasks, lambda task: -task[0]))


def killing(task):
    """Return a task's number, but fail at task 3 as Dask does with what killed several workers."""
    (number,) = task
    if number == 3:
        raise KilledWorker("task", SimpleNamespace(address="tcp://gone"), 3)
    return number


@pytest.mark.long
def test_a_process_that_dies_takes_its_own_task_alone(tmp_path):
    tasks = [(number, tmp_path / str(number)) for number in range(7)]
    found = made_by(Processes(2), tasks)
    assert found == [-3, 0, 1, 2, 4, 5, 6]


@pytest.mark.long
def test_the_command_goes_on_after_kill_9(tmp_path):
    folder = tmp_path / "sweep"
    settings = [f"--set={key}={value}" for key, value in SHORT.items()]
    vary = ["--vary", "servo.kp=lin:10:100:12"]
    command = ["sweep", "double_pendulum", *vary, *settings, "--out", str(folder), "--workers", "1"]
    going = subprocess.Popen(
        [sys.executable, "-m", "simrob_drake.cli", *command], start_new_session=True
    )
    while not (folder / "rows.jsonl").is_file() or not (folder / "rows.jsonl").read_text():
        assert going.poll() is None
        time.sleep(0.01)
    workers = psutil.Process(going.pid).children()
    going.kill()
    going.wait()
    _, alive = psutil.wait_procs(workers, timeout=10)
    assert alive == []  # no worker stays behind
    assert 0 < len((folder / "rows.jsonl").read_text().splitlines()) < 12
    assert run_command(command) == 0
    rows = [json.loads(line) for line in (folder / "rows.jsonl").read_text().splitlines()]
    assert sorted(row["number"] for row in rows) == list(range(1, 13))


def test_a_process_makes_one_trial_at_a_time_however_many_threads_ask():
    """A Dask worker has as many as processors unless told, and a built station is used again."""
    begun = []

    class Slow(Trial):
        columns = ({},)

        def measured(self):
            begun.append(self.number)
            time.sleep(0.02)
            begun.append(self.number)
            return [{"ended": "completed"}]

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(made, [Slow(number) for number in range(1, 9)]))
    assert begun[::2] == begun[1::2]


@pytest.mark.long
@pytest.mark.usefixtures("no_plots")
def test_one_run_is_made_again(tmp_path, capsys):
    SweepFolder(tmp_path / "sweep", PENDULUM).run(workers=1, progress=False)
    assert run_command(["sweep", str(tmp_path / "sweep"), "--run", "2", "--no-recording"]) == 0
    assert load_station(tmp_path / "sweep/run_2/station.yaml").servo.kp == 40
    assert run_command(["sweep", str(tmp_path / "sweep"), "--run", "3"]) == 2
    assert "a number of the table, 1 to 2" in capsys.readouterr().err


@pytest.fixture(scope="module")
def dask():
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        yield local


@pytest.fixture
def scheduler(dask):
    """The address of a scheduler with workers: those that a test has killed are there again."""
    dask.wait_for_workers(2, timeout=60)
    return dask.scheduler_address


@pytest.fixture(scope="module")
def threads():
    """The address of a scheduler whose workers are threads of this process, which are there at once."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as one:
        yield one.scheduler_address


class TestCluster:
    @pytest.mark.long
    def test_its_rows_are_those_of_this_machine(self, scheduler, tmp_path):
        here = SweepFolder(tmp_path / "here", PENDULUM).run(workers=1, progress=False)
        assert (
            SweepFolder(tmp_path / "there", PENDULUM).run(scheduler=scheduler, progress=False)
            == here
        )

    def test_a_task_that_killed_several_workers_takes_itself_alone(self, threads):
        """Dask tells so by what it raises for it."""
        assert made_by(Cluster(threads), [(number,) for number in range(7)], killing) == [
            -3,
            0,
            1,
            2,
            4,
            5,
            6,
        ]

    @pytest.mark.long
    def test_a_worker_that_dies_takes_its_own_task_alone(self, scheduler, tmp_path):
        tasks = [(number, tmp_path / str(number)) for number in range(7)]
        found = made_by(Cluster(scheduler), tasks)
        assert found == [-3, 0, 1, 2, 4, 5, 6]

    @pytest.mark.long
    def test_a_scheduler_that_is_killed_takes_no_run_with_it(self, scheduler, tmp_path):
        """One line tells it, what it had done is kept, and another one goes on: each run is there once, to the byte."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        python = [sys.executable, "-m"]
        short_lived = subprocess.Popen(
            [*python, "distributed.cli.dask_scheduler", "--no-dashboard", "--host", address],
            stderr=subprocess.DEVNULL,
        )
        worker = [*python, "distributed.cli.dask_worker", address, "--nthreads=1", "--no-dashboard"]
        working = subprocess.Popen(worker, start_new_session=True, stderr=subprocess.DEVNULL)
        sweep = Sweep(**{**PENDULUM.model_dump(), "vary": {"servo.kp": "lin:10:100:60"}})
        place = SweepFolder(tmp_path / "sweep", sweep)
        journal = place.folder / ROWS
        command = [*python, "simrob_drake.cli", "sweep", str(place.folder), "--scheduler", address]
        try:
            while True:
                going = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
                while going.poll() is None and not (
                    journal.exists() and b"\n" in journal.read_bytes()
                ):
                    time.sleep(0.01)
                if going.poll() is None:
                    break
                assert going.returncode == 2  # it is not there yet, or has no worker
            short_lived.kill()
            told = going.communicate(timeout=60)[1].splitlines()
        finally:
            short_lived.kill()
            os.killpg(working.pid, signal.SIGKILL)
        assert going.returncode == 2
        assert len(told) == 1
        assert f"the scheduler {address} is gone; what is done is kept" in told[0]
        assert 0 < journal.read_bytes().count(b"\n") < 60
        place.run(scheduler=scheduler, progress=False)
        whole = SweepFolder(tmp_path / "whole", sweep)
        whole.run(workers=1, progress=False)
        assert sorted(journal.read_bytes().splitlines()) == sorted(
            (whole.folder / ROWS).read_bytes().splitlines()
        )

    @pytest.mark.parametrize(
        ("who", "package", "version", "told"),
        [
            ("scheduler", "drake", "0.1", "drake 0.1"),
            ("worker", "simrob-drake", None, "simrob-drake not at all"),
        ],
    )
    def test_another_version_anywhere_is_refused_in_one_line(
        self, threads, who, package, version, told, monkeypatch
    ):
        asked = Client.get_versions

        def versions(client, **more):
            found = asked(client, **more)
            (found["scheduler"] if who == "scheduler" else [*found["workers"].values()][1])[
                "packages"
            ][package] = version
            return found

        monkeypatch.setattr(Client, "get_versions", versions)
        with pytest.raises(
            SimrobError,
            match=rf"the {who} .*has {told}; it must have {package} \d+\.\d+\S+, as this",
        ) as no:
            Cluster(threads)
        assert "\n" not in str(no.value)

    def test_what_this_computer_has_not_may_differ(self, threads, monkeypatch):
        monkeypatch.setattr(processes, "_PACKAGES", ("python", "no-such-package"))
        with Cluster(threads):
            pass

    @pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "carrier-pigeon://x"])
    def test_no_scheduler_there(self, address, monkeypatch):
        monkeypatch.setattr(processes, "_PATIENCE", 1)
        with pytest.raises(SimrobError, match="the address of a Dask that answers"):
            Cluster(address)
