"""What Optuna shows of searches and sweeps: the journal's trials, its plots, its dashboard; and trials left early."""

import json
import socket
import sys
import time
from threading import Thread
from types import SimpleNamespace
from urllib.request import urlopen

import matplotlib as mpl
import numpy as np
import optuna
import pytest

from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import dashboard, study_folder, sweep_folder
from simrob_drake.extensions.tuning.analysis import (
    add_trials,
    save_convergence,
    save_plots,
    save_sensitivity,
    study_in_optuna,
    sweep_in_optuna,
)
from simrob_drake.extensions.tuning.dashboard import Dashboard
from simrob_drake.extensions.tuning.journal import ROWS, Record
from simrob_drake.extensions.tuning.rollout import Case
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.extensions.tuning.sweep_folder import SweepFolder

ASKED = {
    "station": "double_pendulum",
    "overrides": {"duration": 0.02, "reference.duration": 0.01},
    "vary": {
        "servo.kp": {"low": 10, "high": 1000, "start": 50, "log": True},
        "servo.kd": {"low": 1, "high": 100},
    },
    "cost": {"tracking_error": 1},
    "search": {"cases": [{}, {"gravity": 1.62}, {"gravity": 15}]},
}
SWEEP = {"station": "double_pendulum", "overrides": ASKED["overrides"]}
STUDY = Study(**ASKED, prune=True)


def record(number, kp, kd, errors):
    """Return a trial whose runs had some tracking errors."""
    runs = [
        {"servo.kp": kp, "servo.kd": kd, "seed": 0, "ended": "completed", "message": ""}
        for _ in errors
    ]
    return Record(
        number=number,
        rows=[{**run, "tracking_error": error} for run, error in zip(runs, errors, strict=True)],
    )


def records(count):
    """Return trials whose costs hang by a hundred times on kp alone; every fifth was left after its first run."""
    source = np.random.default_rng(0)
    found = []
    for number in range(1, count + 1):
        kp, kd = 10 ** source.uniform(1, 3), source.uniform(1, 100)
        found.append(record(number, kp, kd, [kp / 1000] * (1 if number % 5 == 0 else 3)))
    return found


def test_trials_of_the_journal_are_those_of_optuna():
    made = records(10)
    found = study_in_optuna("gains", STUDY, made[:6])
    add_trials(found, STUDY, made)
    add_trials(found, STUDY, made)
    assert [trial.user_attrs["trial"] for trial in found.trials] == list(range(1, 11))
    assert [trial.state.name for trial in found.trials] == [*["COMPLETE"] * 4, "PRUNED"] * 2
    for trial, one in zip(found.trials, made, strict=True):
        assert trial.params == {key: one.rows[0][key] for key in STUDY.vary}
        assert trial.user_attrs["tracking_error"] == pytest.approx(one.rows[0]["tracking_error"])
        assert trial.value == (
            None if len(one.rows) < 3 else pytest.approx(STUDY.mean(one.rows)[0][0])
        )
    assert found.best_trial.params["servo.kp"] == min(
        one.rows[0]["servo.kp"] for one in made if len(one.rows) == 3
    )
    assert found.trials[0].distributions["servo.kp"].log


@pytest.mark.long
def test_plots_tell_what_matters_and_leave_matplotlib_as_it_was(tmp_path):
    before = dict(mpl.rcParams)
    found = study_in_optuna("gains", STUDY, records(20))
    files = save_plots(found, tmp_path / "plots")
    save_convergence(tmp_path / "convergence.png", [found, found])
    assert [file.stem for file in files] == ["importance", "slices", "parallel", "trades"]
    assert all(file.stat().st_size > 5000 for file in [*files, tmp_path / "convergence.png"])
    assert dict(mpl.rcParams) == before
    importance = optuna.importance.get_param_importances(found)
    assert importance["servo.kp"] > 0.8
    assert save_plots(study_in_optuna("one", STUDY, records(1)), tmp_path / "none") == []
    assert not (tmp_path / "none").exists()


@pytest.mark.long
def test_several_costs_have_plots_of_each_and_their_front(tmp_path):
    study = Study(
        **{**ASKED, "cost": [{"tracking_error": 1}, {"tracking_error": 2}], "method": "genetic"}
    )
    files = save_plots(
        study_in_optuna("two", study, [one for one in records(12) if len(one.rows) == 3]), tmp_path
    )
    assert {"slices_cost_1", "slices_cost_2", "trades_cost_2", "front"} < {
        file.stem for file in files
    }


def test_a_sweep_tells_which_key_each_measure_hangs_on(tmp_path):
    sweep = Sweep(
        station="double_pendulum",
        vary={"servo.kp": "uniform:1:9", "solver.scheme": "radau3,cenic"},
        seeds=9,
    )
    source, rows = np.random.default_rng(0), []
    for number in range(1, 61):
        kp, scheme = source.uniform(1, 9), ("radau3", "cenic")[number % 2]
        row = {"number": number, "ended": "completed", "servo.kp": kp, "solver.scheme": scheme}
        rows.append(
            {**row, "work": kp**2, "final_error": float(scheme == "cenic"), "overshoot": None}
        )
    rows.append({"number": 61, "ended": "diverged", "servo.kp": 5.0, "solver.scheme": "cenic"})
    found = sweep_in_optuna("sweep", sweep.vary, rows)
    assert (found.metric_names, len(found.trials)) == (["work", "final_error"], 60)
    with pytest.warns(UserWarning, match="low"):
        of = [
            optuna.importance.get_param_importances(found, target=lambda one, at=at: one.values[at])
            for at in (0, 1)
        ]
    assert of[0]["servo.kp"] > 0.8
    assert of[1]["solver.scheme"] > 0.8
    save_sensitivity(tmp_path / "sensitivity.png", found)
    assert (tmp_path / "sensitivity.png").stat().st_size > 5000


def test_the_dashboard_shows_trials_as_they_come_to_this_computer_alone(monkeypatch):
    monkeypatch.setattr(dashboard, "_AGAIN", 0.05)
    made = records(6)
    kept = SimpleNamespace(records=made[:2], read=lambda: kept.records)
    shown = Dashboard({"gains": SimpleNamespace(study=STUDY, journal=kept)}, 0)
    serving = Thread(target=shown.serve, daemon=True)
    serving.start()

    def of(path):
        with urlopen(f"{shown.address}{path}", timeout=20) as answer:
            return json.load(answer)

    assert shown.address.startswith("http://127.0.0.1:")
    (study,) = of("/api/studies")["study_summaries"]
    assert study["study_name"] == "gains"
    kept.records = made
    deadline = time.monotonic() + 20
    while len(of(f"/api/studies/{study['study_id']}?after=0")["trials"]) < 6:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    shown.close()
    serving.join(timeout=20)
    assert not serving.is_alive()


def test_a_port_that_is_taken_and_a_folder_of_nothing_are_told_in_a_line(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=f"port {port} is taken"):
            Dashboard({}, port)
    assert run_command(["dashboard", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.fixture
def _bowl(monkeypatch):
    """Let runs cost the less the nearer kp is to 300."""

    def measured(case):
        error = abs(np.log(case.overrides["servo.kp"] / 300)) + 1e-3 * case.overrides.get(
            "gravity", 9.8
        )
        return [{"ended": "completed", "message": "", "tracking_error": error}]

    monkeypatch.setattr(Case, "measured", measured)


@pytest.mark.usefixtures("_bowl")
def test_hopeless_trials_are_left_early_and_the_winner_is_the_same(tmp_path):
    """Whenever it was killed, it goes on to the last byte."""
    asked = {**ASKED, "trials": 30, "together": 6}
    found = {}
    for name, prune in (("whole", False), ("raced", True)):
        place = StudyFolder(tmp_path / name, Study(**asked, prune=prune))
        place.run(progress=False)
        found[name] = place.best, sum(len(one.rows) for one in place.journal.records)
    assert found["whole"][0] == found["raced"][0]
    assert found["whole"][1] == 90
    assert found["raced"][1] < 60
    rows = tmp_path / "raced" / ROWS
    lines = rows.read_bytes().splitlines(keepends=True)
    for kept in range(2, 30, 4):  # within batches, too
        rows.write_bytes(b"".join(lines[:kept]) + lines[kept][:30])
        StudyFolder.there(tmp_path / "raced").run(progress=False)
        assert rows.read_bytes() == b"".join(lines)


def kept_plots(monkeypatch):
    """Return a list of what is drawn, in place of drawing it."""
    drawn = []
    for module, names in (
        (study_folder, ["save_plots"]),
        (sweep_folder, ["save_sensitivity", "save_sweep_plots"]),
    ):
        monkeypatch.setattr(module, "plots_there", lambda: True)
        for name in names:
            monkeypatch.setattr(module, name, lambda *given: drawn.append(given))
    return drawn


@pytest.mark.usefixtures("_bowl")
def test_folders_end_with_their_plots(tmp_path, monkeypatch):
    drawn = kept_plots(monkeypatch)
    StudyFolder(tmp_path / "study", Study(**{**ASKED, "trials": 2, "search": {}})).run(
        progress=False
    )
    SweepFolder(tmp_path / "sweep", Sweep(**{**SWEEP, "vary": {"servo.kp": "20,40"}})).run(
        progress=False
    )
    (found, folder), _, (file, swept) = drawn
    assert (folder, len(found.trials)) == (tmp_path / "study/plots", 2)
    assert (file, len(swept.trials)) == (tmp_path / "sweep/plots/sensitivity.png", 2)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"cost": {"tracking_error": -1}},
            r"prune: is for one cost that no run lowers, and tracking_error can",
        ),
        ({"cost": {"work": 1, "speed": 1}}, r"prune: .* and speed can count less than 0"),
        (
            {"cost": [{"work": 1}, {"final_error": 1}], "method": "genetic"},
            r"prune: .* and here are 2",
        ),
        ({"search": {}}, r"prune: has nothing to leave out: each trial is one run"),
    ],
)
def test_what_cannot_be_left_early_is_told(changed, told):
    with pytest.raises(InvalidConfig, match=told):
        Study(**{**ASKED, **changed}, prune=True).check()


def test_without_optuna_the_dashboard_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna_dashboard", None)
    with pytest.raises(SimrobError, match="the dashboard needs the extra tune: pip install"):
        Dashboard({})
