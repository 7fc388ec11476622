"""Proofs: what is doubted, what is concluded, and that the page tells it."""

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.cli.app import run_command
from simrob_drake.errors import InvalidConfig
from simrob_drake.tuning.conclusion import START, WON, conclusion
from simrob_drake.tuning.doubts import doubts
from simrob_drake.tuning.proof import PAGE, TABLE, Proof, ProofFolder
from simrob_drake.tuning.study import Study
from simrob_drake.tuning.study_folder import StudyFolder
from tests.tuning.test_study import PENDULUM


@pytest.mark.parametrize(
    ("station", "kinds"),
    [
        ("irb120_dynamic", ["as thought", "pushes", "masses", "friction", "noise", "moves", "solver"]),
        ("zjudancer_dynamic", ["as thought", "pushes", "masses", "friction", "floor", "noise", "solver"]),
        ("irb120_kinematic", ["as thought"]),
    ],
)
def test_each_doubt_changes_one_thing_by_draws_of_its_own(station, kinds):
    found = doubts(load_station(station), 3, second_engine=False)
    assert list(found) == kinds
    assert found == doubts(load_station(station), 3, second_engine=False)
    for kind, changes in found.items():
        assert all(changes[place] != changes[place - 1] for place in range(1, len(changes))), kind
        for change in changes:
            load_station(station, change)


def test_pushes_are_a_part_of_the_weight_and_masses_near_those_thought():
    weight = 4.7 * 9.80665  # ZJUDancer, within a tenth
    drawn = doubts(load_station("zjudancer_dynamic"), 20)
    forces = np.array([np.linalg.norm(change["forces.held_back"]["force"]) for change in drawn["pushes"]])
    assert forces.min() > 0.09 * weight
    assert forces.max() < 0.22 * weight
    masses = [change["pieces.load.mass"] for change in doubts(load_station("irb120_dynamic"), 20)["masses"]]
    assert 0.8 <= min(masses) < 0.95
    assert 1.05 < max(masses) <= 1.2


def rows(costs, ended="completed", **more):
    return [
        {"of": of, "doubt": doubt, "draw": draw, "ended": ended if of == WON else "completed", "cost": cost, **more}
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
        ([{"of": WON, "doubt": "noise", "draw": 0, "ended": "fall"}], False, "less sure under noise"),
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
        ([1, 1, 1], [3, -2, 0.5], [1, 1, 1, 1, 1, 1], False),  # other solvers find another gain by 2
        (
            [8, 8, 8],
            [8, 7, 9],
            [6] * 15 + [-1] * 4,
            False,
        ),  # in 21 of 25 pairs: surely in the median, but not throughout
        ([8, 8, 8], [8, 7, 9], [-22, -83, -40, 6, 8, 7], False),  # the winner of one move costs more in others
    ],
)
def test_a_gain_is_proven_beyond_the_error_of_the_solvers_and_for_other_moves(thought, solver, moves, proven):
    rows = [*pairs("as thought", thought), *pairs("solver", solver), *pairs("moves", moves)]
    found, words = conclusion(rows, ["floor", "engine"])
    assert found is proven
    told = " ".join(words)
    error = np.median(np.abs(np.subtract(solver, thought)))
    assert f"is another by {error:.4g} with other solvers" in told
    assert "95 % sure" in told
    assert words[-1] == "Not doubted: floor, engine."


def test_moves_are_doubted_within_what_was_thought():
    station = load_station("irb120_dynamic", {"reference": {"kind": "move", "target_deg": [10, 20, 30, 0, 0, 60]}})
    drawn = doubts(station, 20)["moves"]
    targets = np.array([change["reference.target_deg"] for change in drawn])
    shares = targets[:, [0, 1, 2, 5]] / [10, 20, 30, 60]
    assert 0.5 <= shares.min() < 0.6
    assert 0.9 < shares.max() <= 1.0
    assert (targets[:, 3:5] == 0).all()
    walk = load_station(
        "zjudancer_walking", {"controllers.walk.commands": [{"time": 0.5, "ahead": 0.2, "turn_deg": 5}]}
    )
    (change,) = doubts(walk, 1)["moves"]
    (command,) = change["controllers.walk.commands"]
    assert 0.1 <= command["ahead"] <= 0.2
    assert command["turn_deg"] / command["ahead"] == pytest.approx(25)
    assert command["time"] == 0.5


def test_a_study_proves_nothing_without_cases_that_the_search_has_not_seen(tmp_path, capsys):
    alone = {key: value for key, value in PENDULUM.items() if key != "proof"} | {"trials": 3}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(alone))
    out = tmp_path / "study"
    assert run_command(["tune", str(tmp_path / "study.yaml"), "--out", str(out), "--workers", "1"]) == 0
    assert "Not proven: the study has no cases of its own under proof." in capsys.readouterr().out
    assert run_command(["prove", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "study.yaml: proof: is not there; a winner is proven under cases that its search has not seen" in line
    same = {**PENDULUM, "proof": {"cases": [{}], "seeds": [3, 0]}}
    with pytest.raises(InvalidConfig, match=r"proof.cases.0: is a case of the search, too, with seed 0"):
        Study(**same).check()


@pytest.mark.long
def test_a_study_is_proven_where_it_was_never_tried_and_the_page_tells_it(tmp_path, capsys):
    folder = tmp_path / "study"
    StudyFolder(folder, Study(**{**PENDULUM, "search": {}})).run(workers=1, progress=False)
    assert run_command(["prove", str(folder), "--seeds", "1", "--workers", "1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "runs of the winner hold" in said
    page = (folder / "prove" / PAGE).read_text()
    assert said.split(". ")[0] in page
    assert "http" not in page
    assert page.count("data:image/png;base64,") == 1
    proof = Proof.of(str(folder), 1)
    winner = yaml.safe_load((folder / "winner.yaml").read_text())
    kept = ProofFolder(folder / "prove", proof).run(workers=1, progress=False)  # nothing is run again
    case = next(case for case in proof.cases() if case.shown == {"of": WON, "doubt": "friction", "draw": 0})
    alone = simulate(load_station("double_pendulum", case.overrides), progress=False)
    assert all(case.overrides[key] == value for key, value in winner.items())
    assert alone.ending == "completed"
    assert kept[1][0] in said
    assert (folder / "prove" / TABLE).is_file()


def test_a_study_without_a_winner_and_no_study_are_told(tmp_path, capsys):
    StudyFolder(tmp_path / "study", Study(**PENDULUM))
    for given, told in ((tmp_path / "study", "has no winner.yaml yet"), ("double_pendulun", "did you mean")):
        assert run_command(["prove", str(given)]) == 2
        assert told in " ".join(capsys.readouterr().err.split())
