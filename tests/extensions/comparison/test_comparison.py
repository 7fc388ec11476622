"""`simrob compare`: engines that agree within their errors, and those that do not, are told as such."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from simrob_drake import load_station, simulate
from simrob_drake.base import extras
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.comparison.engines import (
    Account,
    Quantity,
    _in_mujoco,
    _inverse_dynamics,
    apart,
    compare_engines,
    differences,
    other_scheme,
    quantities,
    save_comparison,
)
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver
from tests.programs.test_station_program import station as turning  # noqa: F401  # a fixture

Q, TAU = Quantity("q", "rad"), Quantity("tau", "N·m")


def account(name: str, values: np.ndarray, error: float) -> Account:
    return Account(name, np.arange(len(values)) / 100, {Q: values}, {Q: error})


def test_a_difference_is_within_the_sum_of_both_errors_or_not() -> None:
    first, other = (
        account("one", np.zeros((4, 2)), 0.1),
        account("two", np.array([[0, 0], [0, 0.25], [0, 0], [0, 0]]), 0.1),
    )
    (found,) = differences(first, [other])
    assert (found.largest, found.at, found.error) == (0.25, 0.01, pytest.approx(0.2))
    assert not found.within
    (found,) = differences(first, [account("two", 0.15 * np.ones((3, 2)), 0.1)])
    assert found.within
    assert differences(first, [account("two", np.zeros((4, 2)), 0.1)]) == []  # nothing to tell


def test_quaternions_mean_the_same_with_the_other_sign() -> None:
    turned = np.array([[0.8, 0.6, 0, 0], [0.6, 0.8, 0, 0]])
    np.testing.assert_array_equal(apart(turned, -turned), 0)
    np.testing.assert_array_equal(apart(turned[:, :3], -turned[:, :3]), [1.6, 1.6])


@pytest.mark.long
def test_the_error_of_a_run_covers_how_far_it_is_from_a_converged_one() -> None:
    """Of first order, a run four times finer leaves a third of what lies between the two; the bar is all of it."""
    solver = {
        "solver": {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-2, "max_step": 0.02},
        "duration": 1.5,
    }
    config = load_station("irb120_dynamic", solver)
    finer = config.model_copy(update={"solver": config.solver.tighter(4)})
    best = config.model_copy(update={"solver": config.solver.tighter(40)})
    coarse, fine, converged = (simulate(own, progress=False) for own in (config, finer, best))
    own = Account.of("cenic", fine, coarse)
    exact = quantities(converged)
    for what in (Q, TAU):
        off = float(apart(own.values[what], exact[what]).max())
        assert 0.1 * own.errors[what] < off <= own.errors[what]


def test_other_schemes_work_otherwise() -> None:
    cenic = ContinuousSolver(kind="continuous", scheme="cenic")
    explicit = ContinuousSolver(kind="continuous", scheme="runge_kutta3", accuracy=1e-5)
    assert other_scheme(cenic).scheme == "lagged"
    assert other_scheme(explicit) == explicit.model_copy(update={"scheme": "radau3"})
    assert other_scheme(ContinuousSolver(kind="continuous", scheme="radau3")).scheme == "cenic"
    assert other_scheme(DiscreteSolver(kind="discrete")).scheme == "cenic"


@pytest.mark.long
def test_an_arm_is_the_same_in_four_engines() -> None:
    pytest.importorskip("simrob_drake.extensions.mujoco")
    pytest.importorskip("mujoco")
    told = compare_engines(load_station("irb120_dynamic", {"duration": 0.3}))
    assert [one.name for one in told.accounts] == [
        "Drake, radau3",
        "Drake, cenic",
        "inverse dynamics",
        "MuJoCo",
    ]
    found = differences(told.accounts[0], told.accounts[1:])
    assert {one.account for one in found if one.quantity == TAU} == {
        "Drake, cenic",
        "inverse dynamics",
        "MuJoCo",
    }
    assert [one for one in found if not one.within] == []
    heavier = _in_mujoco(
        "MuJoCo", load_station("irb120_dynamic", {"duration": 0.3, "pieces.load.mass": 2.0})
    )
    broken = {one.quantity: one for one in differences(told.accounts[0], [heavier])}
    assert not broken[Q].within  # another load is found out


@pytest.mark.long
def test_mujoco_knows_the_torques_of_a_given_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("simrob_drake.extensions.mujoco")
    pytest.importorskip("mujoco")
    for station in ("humanoid_fixed", "irb120_on_belt"):
        out = tmp_path / station
        assert (
            run_command(
                [
                    "compare",
                    station,
                    "--out",
                    str(out),
                    "--set",
                    "duration=0.5",
                    "--set",
                    "program=null",
                ]
            )
            == 0
        )
        with (out / "engines.csv").open() as file:
            rows = list(csv.DictReader(file))
        (torque,) = [row for row in rows if row["quantity"] == "tau" and row["unit"] == "N·m"]
        assert float(torque["largest"]) < 1e-12
        assert torque["within"] == "yes"
        assert (out / "engines.png").stat().st_size > 5000
    assert "Drake, inverse dynamics" in capsys.readouterr().out


def test_who_cannot_tell_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    told = compare_engines(load_station("bouncing_ball", {"duration": 0.1}))
    assert [one.name for one in told.accounts] == ["Drake, runge_kutta3", "Drake, radau3"]
    assert "arms alone" in told.missing["inverse dynamics"]
    assert "extra mujoco" in told.missing["MuJoCo"]
    assert run_command(["compare", "bouncing_ball", "--set", "duration=0.1"]) == 0
    assert "MuJoCo: it needs the extra mujoco: pip install" in capsys.readouterr().out


def test_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "file").touch()
    for command, told in (
        (["compare", "bouncing_bal"], "did you mean 'bouncing_ball'"),
        (
            ["compare", "bouncing_ball", "--map", "a=b"],
            "--map: it has an effect only with --with; leave it out",
        ),
        (["compare", "bouncing_ball", "--out", str(tmp_path / "mine")], "exists already"),
        (
            ["compare", "bouncing_ball", "--out", str(tmp_path / "mine"), "--force"],
            "contains files that are not a result",
        ),
    ):
        assert run_command(command) == 2
        assert told in capsys.readouterr().err


def test_the_picture_says_in_words_what_is_compared(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure))
    times = np.linspace(0.0, 1.0, 3)
    place = Quantity("left.tcp", "m")
    first, other = (
        Account(name, times, {Q: part, place: part}, {Q: 0.1, place: 0.1}, "")
        for name, part in (("Drake", np.zeros((3, 1))), ("MuJoCo", np.ones((3, 1))))
    )
    save_comparison(
        [first, other], differences(first, [other]), tmp_path / "out", station="two_arms"
    )
    (figure,) = figures
    assert figure.get_label() == "two_arms: difference from Drake, the largest of all axes"
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "joint positions [rad]",
        "left: place of the tool [m]",
    ]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "MuJoCo",
        "numerical errors of both: below they agree",
    ]


@pytest.mark.long
def test_forces_of_sliding_axes_are_held_against_forces() -> None:
    own = _inverse_dynamics("inverse dynamics", load_station("irb120_on_belt", {"duration": 0.2}))
    whole = simulate("irb120_on_belt", duration=0.2, progress=False)
    found = {
        what: values for what, values in quantities(whole).items() if what.name.endswith("tau")
    }
    assert {what: values.shape[1] for what, values in own.values.items()} == {
        what: values.shape[1] for what, values in found.items()
    }
    assert {what.unit for what in found} == {"N", "N·m"}


def test_engines_are_compared_while_the_program_of_a_station_is_done(turning: Path) -> None:  # noqa: F811
    pytest.importorskip("simrob_drake.extensions.mujoco")
    found = compare_engines(load_station(turning))
    assert found.accounts[0].times[-1] == pytest.approx(0.3)
    assert "it does no programs of kinematic stations" in found.missing["MuJoCo"]


def test_code_of_a_station_runs_only_if_that_is_allowed(tmp_path, capsys, monkeypatch):
    compared = []
    monkeypatch.setattr(
        "simrob_drake.extensions.comparison.commands._compare_engines",
        lambda config, out, *, force: compared.append(config.name),
    )
    file = tmp_path / "mine.yaml"
    file.write_text(
        "robot: {model: irb120}\nreference: {kind: hold}\ncontrollers:\n"
        '  mine: {kind: own, class: "pydrake.systems.primitives:ConstantVectorSource", '
        "parameters: {source_value: [0.5]}}\n"
    )

    assert run_command(["compare", str(file)]) == ExitCode.BAD_INPUT
    assert "if you trust this code" in capsys.readouterr().err
    assert run_command(["compare", str(file), "--allow-code"]) == ExitCode.DONE

    assert compared == ["mine"]
