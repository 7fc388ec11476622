"""Proofs: what is doubted, what is concluded, and that the page tells it."""

import csv
import re

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import proof
from simrob_drake.extensions.tuning.conclusion import START, WON, conclusion
from simrob_drake.extensions.tuning.doubts import doubts, moves
from simrob_drake.extensions.tuning.journal import made
from simrob_drake.extensions.tuning.proof import PAGE, TABLE, Proof, ProofFolder
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder, winner_of
from tests.extensions.tuning.test_scene import GAIT
from tests.extensions.tuning.test_study import PENDULUM


def of(station, seeds, changes=None):
    """Return the doubts of a station with changes."""
    return doubts(Scene.of(station, changes or {}), seeds)


@pytest.mark.parametrize(
    ("station", "changes", "kinds"),
    [
        ("irb120_dynamic", {}, "pushes masses friction noise moves gains torque solver engine"),
        ("zjudancer_dynamic", {}, "pushes masses friction floor noise gains torque solver engine"),
        (
            "zjudancer_dynamic",
            GAIT,
            "pushes masses friction floor noise moves gains torque solver engine",
        ),
        (
            "humanoid_balance",
            {},
            "pushes masses friction floor noise gains torque latency solver engine",
        ),
        ("two_irb120", {}, "pushes masses friction noise moves solver engine"),
        ("irb120_kinematic", {}, ""),
    ],
)
def test_each_doubt_changes_one_thing_by_draws_of_its_own(station, changes, kinds):
    found = of(station, 3, changes)
    assert list(found) == ["as thought", *kinds.split()]
    assert found == of(station, 3, changes)
    for kind, drawn in found.items():
        assert all(drawn[place] != drawn[place - 1] for place in range(1, len(drawn))), kind
        for change in drawn[:1]:
            Scene.of(station, {**changes, **change})


def test_pushes_are_a_part_of_the_weight_and_masses_near_those_thought():
    weight = 4.7 * 9.80665  # ZJUDancer, within a tenth
    drawn = of("zjudancer_dynamic", 20)
    forces = np.array(
        [np.linalg.norm(change["forces.held_back.force"]) for change in drawn["pushes"]]
    )
    assert forces.min() > 0.09 * weight
    assert forces.max() < 0.22 * weight
    ballast = [change["pieces.held_back.mass"] for change in drawn["masses"]]
    assert 0.02 * 4.2 < min(ballast) < max(ballast) < 0.1 * 5.2
    masses = [change["pieces.load.mass"] for change in of("irb120_dynamic", 20)["masses"]]
    assert 0.8 <= min(masses) < 0.95
    assert 1.05 < max(masses) <= 1.2


def test_gains_and_torques_are_doubted_within_a_tenth_and_down_to_seven_tenths():
    drawn = of("irb120_dynamic", 20)
    gains = np.array(
        [[change[f"servo.kp.{axis}"] for axis in range(6)] for change in drawn["gains"]]
    )
    assert 900 <= gains.min() < 920
    assert 1080 < gains.max() <= 1100
    limits = np.array([change["servo.torque_limit"] for change in drawn["torque"]])
    assert 0.7 * 150 <= limits[:, 0].min() < 0.8 * 150
    assert np.allclose(limits / limits[:, :1], limits[0] / limits[0, 0])


def rows(costs, ended="completed", **more):
    return [
        {
            "of": of,
            "doubt": doubt,
            "draw": draw,
            "ended": ended if of == WON else "completed",
            "cost": cost,
            **more,
        }
        for doubt, draws in (("as thought", 1), ("noise", 4))
        for draw in range(draws)
        for of, cost in zip((START, WON), costs, strict=True)
    ]


@pytest.mark.parametrize(
    ("given", "proven", "told"),
    [
        (
            rows((2.0, 1.0)),
            True,
            "1 in the median, 2 at the start, 0.50 of it; less in 5 of 5 pairs, by 1 or more in the median",
        ),
        (rows((1.0, 2.0)), False, "it does not cost less throughout"),
        (rows((2.0, 1.0))[:4], False, "less in 2 of 2 pairs, too few to be sure"),
        (rows((2.0, 1.0), ended="fall"), False, "noise: 4 of 4 do not (start 0): fall"),
        (rows((2.0, 1.0), over_limits=0.5), True, "noise: 4 of 4 do not (start 4): beyond a limit"),
        (
            [{"of": WON, "doubt": "noise", "draw": 0, "ended": "completed"}],
            True,
            "1 of 1 runs of the winner hold (21 to 100 %, 95 % sure).",
        ),
        (
            [{"of": WON, "doubt": "noise", "draw": 0, "ended": "fall"}],
            False,
            "less sure under noise",
        ),
        (
            rows((2.0, 1.0), beyond="foot_slip"),
            True,
            "5 of 5 runs of the winner pass a bound of their verdict: foot_slip (5)",
        ),
    ],
)
def test_a_winner_is_proven_if_it_is_as_sure_and_costs_less(given, proven, told):
    found, words = conclusion(given)
    assert found is proven
    assert told in " ".join(words)


def pairs(doubt, gains, start=100.0):
    """Return the runs of a start and of a winner that costs less by so much."""
    costs = {START: [start] * len(gains), WON: [start - gain for gain in gains]}
    return [
        {"of": of, "doubt": doubt, "draw": draw, "ended": "completed", "cost": cost}
        for of in (START, WON)
        for draw, cost in enumerate(costs[of])
    ]


@pytest.mark.parametrize(
    ("thought", "solver", "moves", "proven"),
    [
        ([8, 8, 8], [8, 7, 9], [6, 5, 7, 6, 8, 7], True),
        # other solvers find another gain by 2
        (
            [1, 1, 1],
            [3, -2, 0.5],
            [1, 1, 1, 1, 1, 1],
            False,
        ),
        # in 21 of 25 pairs: surely in the median, but not throughout
        (
            [8, 8, 8],
            [8, 7, 9],
            [6] * 15 + [-1] * 4,
            False,
        ),
        # the winner of one move costs more in others
        (
            [8, 8, 8],
            [8, 7, 9],
            [-22, -83, -40, 6, 8, 7],
            False,
        ),
    ],
)
def test_a_gain_is_proven_beyond_the_error_of_the_solvers_and_for_other_moves(
    thought, solver, moves, proven
):
    rows = [*pairs("as thought", thought), *pairs("solver", solver), *pairs("moves", moves)]
    found, words = conclusion(rows, ["floor", "engine"])
    assert found is proven
    told = " ".join(words)
    error = np.median(np.abs(np.subtract(solver, thought)))
    assert f"is another by {error:.4g} with other solvers" in told
    assert "95 % sure" in told
    assert words[-1] == "Not doubted: floor, engine."


def test_moves_are_doubted_within_what_was_thought():
    move = {"reference": {"kind": "move", "target_deg": [10, 20, 30, 0, 0, 60]}}
    drawn = of("irb120_dynamic", 20, move)["moves"]
    targets = np.array(
        [[change[f"reference.target_deg.{axis}"] for axis in range(6)] for change in drawn]
    )
    shares = targets[:, [0, 1, 2, 5]] / [10, 20, 30, 60]
    assert 0.5 <= shares.min() < 0.6
    assert 0.9 < shares.max() <= 1.0
    assert (targets[:, 3:5] == 0).all()
    asked = {"controllers.walk.commands": [{"time": 0.5, "ahead": 0.2, "turn_deg": 5}]}
    (change,) = of("zjudancer_walking", 1, asked)["moves"]
    (command,) = change["controllers.walk.commands"]
    assert 0.1 <= command["ahead"] <= 0.2
    assert command["turn_deg"] / command["ahead"] == pytest.approx(25)
    assert command["time"] == 0.5
    through = {
        "reference": {"kind": "sequence", "targets": [{"time": 0.5, "target_deg": {"joint_1": 10}}]}
    }
    (change,) = of("irb120_dynamic", 1, through)["moves"]
    (target,) = change["reference.targets"]
    assert 5 <= target["target_deg"]["joint_1"] <= 10
    assert target["time"] == 0.5


def test_a_winner_of_one_move_alone_is_not_proven():
    rows = pairs("as thought", [8] * 6)
    assert conclusion(rows)[0]
    proven, words = conclusion(rows, ["moves"], moved=False)
    assert not proven
    assert words[0] == "Not proven: no run makes another move; a case of proof may."
    assert words[-1] == "Not doubted: moves."


def test_what_moves_is_known_and_so_is_what_a_proof_itself_moves():
    assert [moves(Scene.of(name, {})) for name in ("irb120_dynamic", "zjudancer_dynamic")] == [
        True,
        False,
    ]
    study = {"station": "irb120_kinematic", "vary": {"gravity": "uniform:1:2"}, "cost": {"work": 1}}
    for case, moved in (({"gravity": 3}, False), ({"reference.duration": 3}, True)):
        own = Study(
            **study,
            proof={"vary": {key: {"values": [value]} for key, value in case.items()}, "count": 1},
        )
        made_of = Proof(
            station=own.station, parameters={START: {}, WON: {}}, conditions=[case], study=own
        )
        assert made_of.moved(["solver"]) is moved
        assert "backlash" in made_of.undoubted(["solver"])
        assert "solver" not in made_of.undoubted(["solver"])


HELPED = {
    "station": "double_pendulum",
    "overrides": {
        "gravity": 0,
        "robot.initial_deg": 0,
        "servo": {"kp": 500, "kd": 20},
        "duration": 0.3,
        "reference": {"kind": "move", "target_deg": 30, "duration": 0.3},
        "forces.help": {"kind": "push", "at": "lower_link", "duration": 0.3, "force": [0, 0, 0]},
    },
    "vary": {"forces.help.force.1": {"low": -200, "high": 200, "start": 0}},
    "cost": {"tracking_error": 1},
    "proof": {"cases": [{"reference.target_deg": target} for target in (-30, -20, -10)]},
}
"""A force that was found for one move: it helps there, and hinders all others."""


@pytest.mark.long
def test_prove_says_not_proven_of_a_winner_that_is_worse_on_other_moves(
    tmp_path, capsys, monkeypatch
):
    """Such a one was once proven, by the very move that it was found for."""
    kept = ("as thought", "moves")

    def few(scene, seeds):
        return {kind: drawn for kind, drawn in doubts(scene, seeds).items() if kind in kept}

    monkeypatch.setattr(proof, "doubts", few)
    study, folder = Study(**HELPED), tmp_path / "study"
    StudyFolder(folder, study)
    (folder / "winner.yaml").write_text("forces.help.force.1: 160.0\n")
    assert run_command(["prove", str(folder), "--seeds", "1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("Not proven: it does not cost less throughout.")
    assert "less in 0 of 6 pairs" in said
    assert "Not doubted: pushes" in said
    with (folder / "prove" / TABLE).open() as file:
        found = [row for row in csv.DictReader(file) if row["doubt"] == "as thought"]
    costs = {
        of: np.array([float(row["cost"]) for row in found if row["of"] == of])
        for of in (START, WON)
    }
    worse = costs[WON] / costs[START]
    assert worse.min() > 1.2
    assert worse.max() > 1.8
    before, after = (
        made(study.cases(one, study.search)[0]).rows[0]
        for one in (study.start, winner_of(folder, study))
    )
    assert after["tracking_error"] < 0.85 * before["tracking_error"]  # on the move of the search


def test_a_study_proves_nothing_without_cases_that_the_search_has_not_seen(tmp_path, capsys):
    alone = {key: value for key, value in PENDULUM.items() if key != "proof"} | {"trials": 3}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(alone))
    out = tmp_path / "study"
    assert (
        run_command(["tune", str(tmp_path / "study.yaml"), "--out", str(out), "--workers", "1"])
        == 0
    )
    assert "Not proven: the study has no cases of its own under proof." in capsys.readouterr().out
    assert run_command(["prove", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        "study.yaml: proof: is not there; a winner is proven under cases that its search has not seen"
        in line
    )
    same = {**PENDULUM, "proof": {"cases": [{}], "seeds": [3, 0]}}
    with pytest.raises(
        InvalidConfig, match=r"proof.cases.0: is with seed 3 a run of the search, too"
    ):
        Study(**same).check()  # nothing is random in it: another seed is no other run


@pytest.mark.long
def test_a_study_is_proven_where_it_was_never_tried_and_the_page_tells_it(tmp_path, capsys):
    folder = tmp_path / "study"
    StudyFolder(folder, Study(**{**PENDULUM, "search": {}})).run(workers=1, progress=False)
    assert run_command(["prove", str(folder), "--seeds", "1", "--workers", "1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "runs of the winner hold" in said
    page = (folder / "prove" / PAGE).read_text()
    assert said.split(". ")[0] in page
    assert not re.search("https?:", page)
    assert page.count("data:image/png;base64,") == 1
    proof = Proof.of(str(folder), 1)
    winner = yaml.safe_load((folder / "winner.yaml").read_text())
    # nothing is run again
    kept = ProofFolder(folder / "prove", proof).run(workers=1, progress=False)
    case = next(
        case for case in proof.cases() if case.shown == {"of": WON, "doubt": "friction", "draw": 0}
    )
    alone = simulate(load_station("double_pendulum", case.overrides), progress=False)
    assert all(case.overrides[key] == value for key, value in winner.items())
    assert alone.ending == "completed"
    assert kept[1][0] in said
    assert (folder / "prove" / TABLE).is_file()


def test_a_study_without_a_winner_and_no_study_are_told(tmp_path, capsys):
    StudyFolder(tmp_path / "study", Study(**PENDULUM))
    for given, told in (
        (tmp_path / "study", "has no winner.yaml yet"),
        ("double_pendulun", "did you mean"),
    ):
        assert run_command(["prove", str(given)]) == 2
        assert told in " ".join(capsys.readouterr().err.split())
