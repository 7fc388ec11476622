"""Searches: what they cost, that they find what is there, go on where they were killed, and prove what they found."""

import csv
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import yaml
from pyarrow import parquet

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError
from simrob_drake.base.files import diagrams_root
from simrob_drake.base.folders import alone_in
from simrob_drake.base.sections import validated
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import study_folder
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.extensions.tuning.rollout import measures
from simrob_drake.extensions.tuning.search import Enough, search
from simrob_drake.extensions.tuning.study import Method, Study
from simrob_drake.extensions.tuning.study_folder import PROOF, TRIALS, StudyFolder, winner_of
from simrob_drake.stations.resolve import resolve
from tests.extensions.tuning.here import Here

PENDULUM = {
    "station": "double_pendulum",
    "overrides": {"duration": 0.3, "reference.duration": 0.2},
    "vary": {
        "servo.kp": {"low": 10, "high": 1000, "start": 50, "log": True},
        "servo.kd": {"low": 1, "high": 100},
    },
    "cost": {"tracking_error": 1},
    "trials": 6,
    "together": 3,
    "search": {"cases": [{}, {"gravity": 1.62}]},
    "proof": {"cases": [{"gravity": 3.7}], "seeds": [7]},
}


def bowl(limit):
    """Return costs that are least, 0, at 0.3 in six dimensions, the points that were asked for, and what they cost."""
    asked, told = [], []

    def costs(points):
        for point in points:
            if len(asked) == limit:
                raise Enough
            asked.append(point.copy())
            told.append(float(np.arange(1, 7) @ (point - 0.3) ** 2))
        return np.array(told[-len(points) :])[:, np.newaxis], np.zeros(len(points))

    return costs, asked, told


@pytest.mark.parametrize(
    "method", [name for name in get_args(Method) if name != "gp" or find_spec("torch")]
)
def test_every_method_comes_nearer_within_its_bounds_and_is_the_same_again(method):
    # a model of Gaussian processes takes its time
    runs = [bowl(14 if method == "gp" else 60) for _ in range(2)]
    for costs, _, _ in runs:
        search(method, np.full(6, 0.8), costs, together=6, seed=3)
    (_, first, told), (_, again, _) = runs
    assert np.array_equal(first, again)
    assert np.array_equal(first[0], np.full(6, 0.8))
    assert np.min(first) >= 0
    assert np.max(first) <= 1
    assert min(told) < (0.9 if method == "random" else 0.6) * told[0]


def test_what_a_run_costs():
    """Weights of measures, a price for what is beyond a limit, and a higher one for what does not go to its end."""
    changed = {
        "cost": {"work": 2, "overshoot": 3},
        "limits": {"peak_torque": 0.5},
        "least": {"final_error": 0.2},
    }
    study = Study(**{**PENDULUM, **changed, "failure": 10})
    measured = {"work": 4.0, "overshoot": 0.1, "peak_torque": 0.4, "final_error": 0.3}
    row = {"ended": "completed", **measured, "stop_time": 1.0, "duration": 4.0}
    for change, cost, over in [
        ({}, 8.3, 0),
        ({"peak_torque": 0.75}, 8.3 + 10 * 0.5, 0.5),
        ({"final_error": 0.15}, 8.3 + 10 * 0.25, 0.25),
        ({"ended": "fall"}, 17.5, 1.75),
        ({"overshoot": None}, 20, 2),
        ({"overshoot": float("nan")}, 20, 2),
    ]:
        assert study.judged({**row, **change}) == (
            pytest.approx(np.array([cost])),
            pytest.approx(over),
        )
    assert study.judged({"ended": "refused"})[0] == 20
    study.check_measures([row, {**row, "overshoot": None}])
    with pytest.raises(InvalidConfig, match=r"cost\.overshoot: means nothing in this station"):
        study.check_measures([{**row, "overshoot": None}])


def test_a_fall_may_be_a_cost_and_several_costs_are_apart():
    study = Study(**{**PENDULUM, "cost": [{"fall": 2}, {"speed": -1}], "method": "genetic"})
    row = {"ended": "fall", "fall": 1.0, "speed": 0.4, "stop_time": 1.0, "duration": 4.0}
    assert study.judged(row)[0] == pytest.approx([2, -0.4])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"vary": {}}, "vary"),
        ({"vary": {"servo.kp": {"low": 2, "high": 1}}}, "low must be less than high"),
        ({"vary": {"servo.kp": {"low": 0, "high": 1, "log": True}}}, "low must be positive"),
        ({"vary": {"servo.kp": {"low": 1, "high": 2, "start": 3}}}, "start must be between"),
        (
            {"vary": {"servo.kpp": {"low": 1, "high": 2}}},
            "vary servo.kpp: unknown key; did you mean 'kp'",
        ),
        ({"cost": {"tracking_eror": 1}}, "did you mean 'tracking_error'"),
        ({"limits": {"torque": 1}}, "no measure 'torque'"),
        ({"least": {"marging": 1}}, "did you mean 'margin'"),
        ({"least": {"margin": 1}}, "margin: this key is needed"),
        ({"margin": {"push": "shove", "sizes": [1, 2]}}, "no push 'shove'"),
        ({"margin": {"push": "shove", "sizes": [2, 1]}}, "sizes must grow"),
        ({"cost": [{"work": 1}, {"final_error": 1}]}, "method cma: knows one cost, and here are 2"),
        ({"vary": {"gait.step_time": {"low": 0.1, "high": 1}}}, "without gaits"),
        ({"vary": {"program.moves.0.duration": {"low": 0.1, "high": 1}}}, "program"),
        ({"search": {"cases": []}}, "search.cases"),
        ({"search": {"cases": [{"servo.kp": 3}]}}, "search.cases.0.servo.kp: varies"),
        (
            {"proof": {"cases": [{"gravty": 3}]}},
            "proof.cases.0 gravty: unknown key; did you mean 'gravity'",
        ),
        (
            {"proof": {"cases": [{"reference.target_deg": 1e300}]}},
            r"cases\[0\].reference.target_deg: must be zero, or",
        ),
        (
            {"proof": {"cases": [{"reference.target_deg": 1e6}]}},
            "proof.cases.0: reference of joint_1 is .* limits",
        ),
        (
            {"proof": {"cases": [{"start": "/etc/passwd"}]}},
            "start: /etc/passwd is outside the allowed folders",
        ),
        ({"trials": "200"}, "trials: must be an integer"),
        ({"search": {"seeds": ["1"]}}, "search.seeds"),
        ({"method": "annealing"}, "method"),
        ({"station": "pendulum"}, "double_pendulum"),
    ],
)
def test_a_study_that_cannot_be_is_told_before_any_run(changed, told, tmp_path):
    file = tmp_path / "study.yaml"
    file.write_text(yaml.safe_dump({**PENDULUM, **changed}))
    with pytest.raises(SimrobError, match=told):
        Study.read(file)


STUDIES = sorted((Path(__file__).parents[3] / "examples" / "studies").glob("*.yaml"))
QUICK_STUDIES = {"irb120_gains", "zjudancer_walk"}
"""One of an arm and one of a walk; the others are checked in the long tests."""


@pytest.mark.parametrize(
    "file",
    [
        pytest.param(
            file, id=file.stem, marks=[] if file.stem in QUICK_STUDIES else [pytest.mark.long]
        )
        for file in STUDIES
    ],
)
def test_the_studies_of_the_project_can_be(file):
    study = Study.read(str(file))
    assert study.cases(study.start, study.search)


EDGE = "controllers.walk.gait.feedback.zmp_limit"


def test_seeds_may_draw_robots_and_floors_and_places_of_a_list_may_vary():
    changed = {
        "cost": {"tilt": 1},
        "search": {"seeds": [1, 2], "drawn": True},
        "overrides": {},
        "proof": {},
    }
    vary = {f"{EDGE}.1": {"low": 0, "high": 0.02}}
    study = Study(**{**PENDULUM, **changed, "station": "roid1_walking", "vary": vary})
    thought = load_station("roid1_walking")
    own = thought.controllers["walk"].gait["feedback"]
    for case in study.cases({f"{EDGE}.1": 0.004}, study.search):
        config = case.scene().config
        told = drawn(thought, case.seed)
        assert config.robots["robot"].mass_factors == told["robot.mass_factors"]
        assert config.contact.friction.static == told["contact.friction"]["static"]
        measured = config.controllers["walk"].walking(resolve(config).robots["robot"])
        assert measured.feedback.zmp_limit == (own["zmp_limit"][0], 0.004)
    with pytest.raises(SimrobError, match=r"feedback.zmp_limit"):
        load_station("roid1_walking", {f"{EDGE}.2": 0.004})


DRAWN = {
    "vary": {"gravity": "uniform:1:9", "reference.duration": {"values": [0.1, 0.2]}},
    "count": 4,
}


def test_conditions_are_listed_and_drawn():
    """Every case with every draw and every seed."""
    study = Study(
        **{**PENDULUM, "search": {"cases": [{}, {"servo.ki": 1}], **DRAWN}, "proof": None}
    )
    study.check()
    changes = [case.overrides for case in study.cases(study.start, study.search)]
    gravities = [change["gravity"] for change in changes]
    assert len(changes) == 8
    assert gravities[:4] == gravities[4:]
    # Sobol: one in each quarter
    assert sorted(int((gravity - 1) / 2) for gravity in gravities[:4]) == [
        0,
        1,
        2,
        3,
    ]
    assert [change["reference.duration"] for change in changes].count(0.1) == 4
    assert ["servo.ki" in change for change in changes] == [False] * 4 + [True] * 4


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"search": DRAWN, "proof": DRAWN},
            r"proof\.cases\.0, draw 1: is with seed 0 a run of the search, too",
        ),
        # as it is
        (
            {"proof": {"cases": [{"gravity": 9.81}]}},
            r"proof\.cases\.0: is with seed 0 a run of the search",
        ),
        # nothing is random
        (
            {"proof": {"seeds": [3]}},
            r"proof\.cases\.0: is with seed 3 a run of the search",
        ),
        (
            {"proof": {"vary": {"servo.kp": "uniform:1:2"}}},
            r"proof\.cases\.0, draw 1\.servo\.kp: varies; a case cannot",
        ),
        (
            {"proof": {"vary": {"gravty": "uniform:1:2"}}},
            r"proof\.vary gravty: unknown key; did you mean 'gravity'",
        ),
        (
            {"proof": {"vary": {"gravity": {"low": 2}}}},
            r"proof\.vary\.gravity\.high: this key is required",
        ),
        ({"proof": {"sampling": "sobel"}}, "there is no 'sobel'; did you mean 'sobol'"),
    ],
)
def test_runs_that_are_held_out_are_others_than_those_of_the_search(changed, told):
    with pytest.raises(SimrobError, match=told):
        validated(Study, {**PENDULUM, **changed}, "study.yaml").check("study.yaml")


def test_a_proof_that_draws_others_is_one():
    Study(**{**PENDULUM, "search": DRAWN, "proof": {**DRAWN, "seed": 1}}).check()


def test_names_and_whole_numbers_are_searched_and_keys_that_count_under_some_alone(
    tmp_path, monkeypatch
):
    vary = {
        "solver.scheme": {"values": ["radau3", "cenic"]},
        "robot.initial_deg": {"low": 30, "high": 40, "integer": True},
        "servo.kd": {"low": 5, "high": 100, "when": {"solver.scheme": "radau3"}},
    }
    monkeypatch.setattr(study_folder, "engine", lambda **_: Here())
    asked = {**PENDULUM, "vary": vary, "search": {}, "trials": 8, "together": 4, "method": "random"}
    StudyFolder(tmp_path / "study", Study(**asked)).run(progress=False)
    place = StudyFolder.there(tmp_path / "study")
    tried = [parameters for parameters, _ in place.trials]
    assert {one["solver.scheme"] for one in tried} == {"radau3", "cenic"}
    assert all(("servo.kd" in one) == (one["solver.scheme"] == "radau3") for one in tried)
    assert all(isinstance(one["robot.initial_deg"], int) for one in tried)
    assert winner_of(tmp_path / "study", place.study) == place.best[0]
    place.run(progress=False)  # nothing is run again
    assert [parameters for parameters, _ in place.trials] == tried


class TestFolder:
    def test_the_winner_is_proven_where_it_was_never_tried(self, tmp_path):
        place = StudyFolder(tmp_path / "study", Study(**PENDULUM))
        proof = place.run(workers=2, progress=False)
        measured, (cost,) = place.best
        assert place.trials[0][0] == pytest.approx({"servo.kp": 50, "servo.kd": 50.5})
        assert cost < 0.9 * place.trials[0][1]
        under = {**PENDULUM["overrides"], **measured}
        alone = [
            measures(simulate(load_station("double_pendulum", {**under, **case})))["tracking_error"]
            for case in ({}, {"gravity": 1.62}, {"gravity": 3.7})
        ]
        assert cost == pytest.approx(np.mean(alone[:2]), rel=1e-12)
        assert [row["of"] for row in proof] == ["start", "best"]
        assert proof[1]["cost"] == pytest.approx(alone[2], rel=1e-12)
        assert load_station(tmp_path / "study/station.yaml").servo.kp == measured["servo.kp"]
        with (
            (tmp_path / "study" / TRIALS).open() as trials,
            (tmp_path / "study" / PROOF).open() as proven,
        ):
            assert [float(row["cost"]) for row in csv.DictReader(trials)] == [
                float(cost[0]) for _, cost in place.trials
            ]
            assert len(list(csv.DictReader(proven))) == 2
        columns = parquet.read_table(tmp_path / "study/trials.parquet").to_pydict()
        assert columns["cost"] == [float(cost[0]) for _, cost in place.trials]

    @pytest.mark.long
    def test_more_trials_go_on_from_those_that_are_there(self, tmp_path):
        """What is kept is not run again; together they are the trials of one search."""
        whole = StudyFolder(tmp_path / "whole", Study(**PENDULUM))
        whole.run(workers=1, progress=False)
        StudyFolder(tmp_path / "parts", Study(**{**PENDULUM, "trials": 4})).run(
            workers=1, progress=False
        )
        parts = StudyFolder(tmp_path / "parts", Study(**PENDULUM))
        parts.run(workers=1, progress=False)
        assert parts.trials == whole.trials

    def test_a_station_that_has_changed_is_refused_and_so_is_a_second_process(self, tmp_path):
        text = (diagrams_root() / "double_pendulum.yaml").read_text()
        (tmp_path / "own.yaml").write_text(text)
        study = Study(**{**PENDULUM, "station": str(tmp_path / "own.yaml")})
        place = StudyFolder(tmp_path / "study", study)
        with (
            alone_in(tmp_path / "study"),
            pytest.raises(OutputError, match="another process is using"),
        ):
            place.run(workers=1, progress=False)
        (tmp_path / "own.yaml").write_text(text.replace("gravity: 9.81", "gravity: 1.62"))
        with pytest.raises(InvalidConfig, match="has changed since"):
            StudyFolder(tmp_path / "study", study)

    def test_another_study_is_refused(self, tmp_path):
        StudyFolder(tmp_path / "study", Study(**PENDULUM))
        with pytest.raises(OutputError, match="another study"):
            StudyFolder(tmp_path / "study", Study(**{**PENDULUM, "seed": 1}))


def test_several_costs_end_as_a_front_of_trades(tmp_path):
    """None of the front is beaten in both costs, everything else is; the winner is one of them."""
    aims = [{"tracking_error": 1}, {"work": 1}]
    study = Study(
        **{**PENDULUM, "cost": aims, "method": "genetic", "trials": 12, "together": 6, "search": {}}
    )
    place = StudyFolder(tmp_path / "study", study)
    proof = place.run(workers=1, progress=False)
    costs = np.array([cost for _, cost in place.trials])
    beaten = [
        any((other <= cost).all() and (other < cost).any() for other in costs) for cost in costs
    ]
    assert place.front() == [number for number, lost in enumerate(beaten) if not lost]
    assert any(place.best[0] == place.trials[number][0] for number in place.front())
    assert {"cost_1", "cost_2"} <= set(proof[0])
    with (tmp_path / "study/front.csv").open() as file:
        assert [int(row["trial"]) - 1 for row in csv.DictReader(file)] == place.front()
    assert [
        cost.tolist() for _, cost in StudyFolder.there(tmp_path / "study").trials
    ] == costs.tolist()


def test_gaussian_processes_need_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    costs, *_ = bowl(3)
    with pytest.raises(SimrobError, match="method gp needs the extra rl: pip install"):
        search("gp", np.full(6, 0.8), costs, together=2, seed=0)


@pytest.mark.long
def test_the_command_goes_on_after_kill_9_and_compares_methods(tmp_path, capsys):
    """No trial is lost or counted twice."""
    (tmp_path / "gains.yaml").write_text(yaml.safe_dump({**PENDULUM, "trials": 8, "search": {}}))
    methods = ["--method", "nelder_mead", "--method", "genetic"]
    command = [
        "tune",
        str(tmp_path / "gains.yaml"),
        *methods,
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "1",
    ]
    going = subprocess.Popen(
        [sys.executable, "-m", "simrob_drake.cli", *command], start_new_session=True
    )
    journal = tmp_path / "out/nelder_mead/rows.jsonl"
    while not journal.is_file() or journal.read_text().count("\n") < 2:
        assert going.poll() is None
        time.sleep(0.01)
    os.killpg(going.pid, signal.SIGKILL)
    going.wait()
    assert run_command(command) == 0
    assert "completed 1 of 1 1 of 1" in " ".join(capsys.readouterr().out.split())
    for name in ("nelder_mead", "genetic"):
        with (tmp_path / "out" / name / TRIALS).open() as file:
            assert [int(row["trial"]) for row in csv.DictReader(file)] == list(range(1, 9))
    assert (tmp_path / "out/convergence.png").is_file()


def test_a_study_reads_no_robot_outside_of_its_folder(tmp_path):
    (tmp_path / "own").mkdir()
    study = {
        "station": "irb120_dynamic",
        "overrides": {"robot.urdf": str(tmp_path / "private" / "arm.urdf")},
        "vary": {"servo.kp": {"low": 1, "high": 2}},
        "cost": {"error": 1},
    }
    file = tmp_path / "own" / "study.yaml"
    file.write_text(yaml.safe_dump(study))
    with pytest.raises(InvalidConfig, match=r"study.yaml: robot.urdf: .*--mesh-path"):
        Study.read(file)


def test_check_says_that_a_study_is_no_station(tmp_path, capsys):
    file = Path(__file__).parents[3] / "examples" / "studies" / "irb120_gains.yaml"
    assert run_command(["check", str(file)]) == 2
    assert f"{file}: is not a station, but a study: simrob tune {file}" in capsys.readouterr().err
    (tmp_path / "sweep.yaml").write_text("station: irb120_dynamic")
    assert run_command(["run", str(tmp_path)]) == 2
    assert (
        f"is not a station, but the folder of a sweep: simrob sweep {tmp_path}"
        in capsys.readouterr().err
    )
