"""What was asked of a run against what became of it: each figure against what is known of the run otherwise."""

import json

import numpy as np
import pytest

from simrob_drake import Arm, LeggedRobot, Runner, load_station, simulate
from simrob_drake.base.errors import VerdictError
from simrob_drake.cli.app import run_command
from simrob_drake.results.record.touch import Slide
from simrob_drake.results.result import join_runs
from simrob_drake.results.verdict.judge import CRITERIA
from simrob_drake.results.verdict.verdict import (
    Criterion,
    Measure,
    MeasuredValue,
    Verdict,
    join_verdicts,
)
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import VerdictConfig

pytestmark = pytest.mark.usefixtures("no_plots")


def run(name, overrides=None, **options):
    return simulate(load_station(name, overrides), progress=False, **options)


JOINTS = [f"joint_{number}" for number in range(1, 7)]


@pytest.fixture(scope="module")
def weak():
    """A move of 50 deg that a torque of 2 N·m can't begin to do."""
    return run(
        "irb120_dynamic",
        {"servo.torque_limit": {"joint_2": 2}, "reference.target_deg": {"joint_2": 50}},
    )


@pytest.fixture(scope="module")
def hasty():
    """The kinematic arm asked to turn within 0.1 s."""
    return run("irb120_kinematic", {"reference.duration": 0.1}, duration=0.2)


def boxes(stiffness: float, **bounds: float | str) -> StationConfig:
    """Return a box of 2 kg, on balls in its corners, that begins 1 mm deep in a board of the same stiffness."""
    box = {"model": "box_on_corners", "free": True, "pose": [0, 0, 0.201, 0, 0, 0]}
    board = {"parent": "world", "pose": [-0.2, -0.2, 0.1, 0, 0, 0]}  # its upper face is 2 mm higher
    pieces = {"board": board, "box": box}
    return load_station(
        "box_on_floor",
        {"pieces": pieces, "contact.stiffness": stiffness, "sensors": {}, "verdict": bounds},
    )


def test_every_bound_of_a_station_is_that_of_a_criterion():
    of_axes = {f"{c.name}_{unit}" for c in CRITERIA if c.unit == "rad" for unit in ("deg", "m")}

    of_moves = {f"move_{what}" for what in ("end", "following", "speed", "distance")}
    others = {c.name for c in CRITERIA if c.unit != "rad"}
    assert others | of_axes | of_moves == set(VerdictConfig.model_fields)


def test_a_move_that_saturates_is_warned_of(weak):
    error = np.abs(weak["q_ref.joint_2"] - weak["q.joint_2"])

    worst = weak.verdict["final_error"].worst
    assert (worst.subject, worst.value) == ("joint_2", error[-1])
    assert np.rad2deg(worst.value) > 50
    assert weak.verdict["torque_time"].worst.value == pytest.approx(
        np.mean(np.abs(weak["tau.joint_2"]) > 1.998)
    )
    ended = f"joint_2 ended {np.rad2deg(error[-1]):.3g} deg from its target position (bound 3 deg)"
    assert ended in weak.warnings
    assert any(
        warning.startswith("joint_2 was at its torque limit for ") for warning in weak.warnings
    )


def test_a_run_that_does_as_asked_has_no_warnings():
    well = run("irb120_dynamic", duration=1.5)

    assert well.warnings == []
    assert well.verdict["final_error"].worst.value < np.deg2rad(3)
    assert well.verdict.sample_rate == 100
    assert well.verdict.contact_rate is None


def test_a_hinge_without_a_motor_among_others_is_asked_nothing():
    none = {"joint_5": 0.0}
    loose = {
        "servo.kp": {**dict.fromkeys(JOINTS, 1e4), **none},
        "servo.kd": {**dict.fromkeys(JOINTS, 100.0), **none},
    }
    own = {
        "servo.feedforward": "none",
        "inputs": [],
        "reference": {"kind": "hold"},
        "duration": 0.5,
    }

    run = simulate(load_station("irb120_dynamic", {**loose, **own}), progress=False)

    assert np.ptp(run.axes("q")[:, 4]) > 0.1
    assert run.verdict["largest_error"].worst.subject != "joint_5"

    limp = simulate(
        load_station("irb120_dynamic", {"servo.kp": 0.0, "servo.kd": 0.0, **own}), progress=False
    )
    assert limp.verdict["largest_error"].worst.value > 0.1  # a whole robot without servos is told


def test_speeds_and_torques_beyond_their_limits_are_warned_of(hasty):
    model = hasty.plant.robots["robot"].model
    share = np.abs(hasty.axes("v")) / model.speed_limits

    figure = hasty.verdict["speed_share"]
    assert figure.worst.value == pytest.approx(share.max())
    assert {entry.subject: entry.value for entry in figure.entries} == dict(
        zip(model.axes, share.max(axis=0).tolist(), strict=True)
    )
    assert hasty.times[share[:, share.max(axis=0).argmax()].argmax()] == figure.worst.time
    assert hasty.verdict["speed_time"].worst.value == pytest.approx((share > 1).mean(axis=0).max())

    fastest = np.abs(hasty.axes("v")).max(axis=0)[int(share.max(axis=0).argmax())]
    assert f"{np.rad2deg(fastest):.3g} of " in figure.warning
    assert " deg/s," in figure.warning, "positions are in degrees, too"
    assert hasty.verdict[
        "torque_share"
    ].warning  # what the motion needs, whether there is a motor for it or not
    assert "final_error" not in hasty.verdict.summary()["figures"]  # it is where it is asked to be


def test_a_tool_below_the_floor_is_warned_of():
    """The tool begins at 0.63 m, its holder is put 0.83 m lower: no contact says so."""
    sunk = run(
        "irb120_kinematic",
        {"robot.base": [0, 0, -0.83, 0, 0, 0], "reference": {"kind": "hold"}},
        duration=0.1,
    )
    assert sunk.warnings == ["tool load was 200 mm below the floor at 0.00 s (bound 5 mm)"]


def test_boxes_that_sink_into_each_other_are_warned_of():
    """At rest four corners carry m g at k x each, so x = m g / (4 k): 2 kg on 490 N/m sink by 10 mm."""
    result = simulate(boxes(2 * 9.80665 / (4 * 0.010)), duration=3.0, progress=False)

    assert result["piece.box.z"][-1] == pytest.approx(0.202 - 0.010, abs=1e-4)
    worst = result.verdict["penetration"].worst
    assert (worst.subject, worst.unit) == ("board and box", "m")
    # it is level to some mrad
    assert worst.value == pytest.approx(0.202 - result["piece.box.z"].min(), abs=2e-5)
    (warning,) = result.warnings
    assert warning.startswith("board and box penetrated each other by ")
    assert result.verdict.contact_rate == 50
    assert not simulate(boxes(1e5), duration=0.5, progress=False).verdict["penetration"].warning


def test_a_station_sets_its_own_bounds():
    assert not simulate(boxes(490.0, penetration="none"), duration=0.1, progress=False).warnings

    (warning,) = simulate(boxes(1e5, penetration=1e-6), duration=0.1, progress=False).warnings
    assert warning.endswith("(bound 0.001 mm)")
    with pytest.raises(ValueError, match=r"verdict\.penetration"):
        boxes(1e5, penetration=-1)
    with pytest.raises(ValueError, match=r"verdict\.slip.*foot_slip"):
        load_station("box_on_floor", {"verdict.slip": 0.1})


def test_a_verdict_changes_nothing():
    runner = Runner("box_on_floor")
    first = runner.run(duration=0.3)

    signals, forces = (
        first.values.copy(),
        [c.num_point_pair_contacts() for c in first.contacts_at(first.times)],
    )

    assert first.verdict["penetration"].worst.value > 0
    assert [c.num_point_pair_contacts() for c in first.contacts_at(first.times)] == forces
    np.testing.assert_array_equal(first.values, signals)
    np.testing.assert_array_equal(runner.run(duration=0.3).values, signals)


def test_slides_count_from_step_to_step():
    """Two stances: three ways of 1 cm, and after a lift one of 2 cm."""
    slide = Slide(
        np.array([0.01, 0.01, 0.01, 0, 0.02, 0]), np.array([1, 1, 1, 0, 1, 1], dtype=bool)
    )

    assert slide.total == pytest.approx(0.05)
    assert slide.longest == (pytest.approx(0.03), 3)
    assert Slide(np.zeros(4), np.zeros(4, dtype=bool)).longest == (0.0, 0)
    assert Slide(np.zeros(0), np.zeros(0, dtype=bool)).longest == (0.0, 0)


def test_runs_that_follow_each_other_are_judged_by_their_worst():
    largest = Criterion("largest_error", "rad", "", "{of}{when}", lambda run: None)
    share = Criterion("torque_time", "1", "", "{of}", lambda run: None, per_time=True)

    def verdict(error: float, at: float, part: float) -> Verdict:
        figures = (
            Measure(largest, (MeasuredValue("a", error, "rad", 0.5, at, 0.0, ""),)),
            share_of(part),
        )
        return Verdict(figures, 100.0)

    def share_of(part: float) -> Measure:
        return Measure(share, (MeasuredValue("a", part, "1", 0.3, None, 0.0, ""),))

    whole = join_verdicts([verdict(0.2, 0.9, 1.0), verdict(0.8, 0.4, 0.0)], [1.0, 3.0])
    assert (whole["largest_error"].worst.value, whole["largest_error"].worst.time) == (0.8, 1.4)
    assert whole["torque_time"].worst.value == 0.25
    assert whole.warnings == ["a at 1.40 s (bound 28.6 deg)"]


def test_a_run_that_keeps_its_time_is_judged_at_times_of_the_program():
    """Times of a run that continues another one begin where that one ended, and count once in the whole."""
    runner = Runner(load_station("irb120_kinematic"))
    first = runner.run(duration=0.3)
    second = runner.run(duration=0.5, start=first.final_state, start_time="keep")

    whole = join_runs([first, second]).verdict["speed_share"].worst

    alone = second.verdict["speed_share"].worst
    assert whole.value == alone.value
    assert whole.time == pytest.approx(alone.time)


LAME = {"servo.torque_limit": 2.0, "reference.duration": 0.1}


def test_strict_runs_raise_and_keep_the_result():
    with pytest.raises(
        VerdictError, match=r"^irb120_dynamic: .*from its target position"
    ) as caught:
        run("irb120_dynamic", LAME, duration=0.3, strict=True)
    assert caught.value.result.ending == "completed"

    explicit = {
        "solver.scheme": "explicit_euler",
        "solver.max_step": 0.01,
        "servo.torque_limit": 1e12,
    }
    with pytest.raises(VerdictError, match="diverged"):
        run("irb120_dynamic", explicit, strict=True)
    assert run("irb120_dynamic", duration=0.2, strict=True).ending == "completed"


def test_a_strict_station_stays_where_it_was():
    arm = Arm(load_station("irb120_dynamic", LAME))
    arm.cell.strict, before = True, arm.position.copy()

    with pytest.raises(VerdictError):
        arm.move_abs_j([0.8, 0.4, 0, 0.8, 0.8, 0.8], duration=0.5, check="nothing")
    np.testing.assert_array_equal(arm.position, before)

    robot = LeggedRobot(load_station("humanoid_fixed", {"verdict.speed_share": 0.001}))
    robot.add_move({"left_knee": 20}, 0.2)

    with pytest.raises(VerdictError, match="left_knee moved at"):
        robot.simulate(strict=True)
    assert robot.simulate().warnings
    assert robot.cell.strict is False


@pytest.mark.parametrize(("options", "code"), [(["--strict"], 4), ([], 0)])
def test_the_command_line_tells_the_verdict(options, code, tmp_path, capsys):
    settings = [part for key, value in LAME.items() for part in ("--set", f"{key}={value}")]

    folder = ["--out", str(tmp_path / "run"), "--no-recording", "--duration", "0.3"]
    assert run_command(["run", "irb120_dynamic", *settings, *folder, *options]) == code
    said = capsys.readouterr()
    assert "bounds exceeded: final error, " in " ".join(said.out.split())
    assert "from its target position (bound 3 deg" in " ".join(said.err.split())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    figure = summary["verdict"]["figures"]["final_error"]
    assert figure["value"] == max(figure["each"].values()) > figure["bound"]
    assert summary["verdict"]["sample_rate"] == 100
    assert any("from its target position" in warning for warning in summary["warnings"])


@pytest.mark.parametrize(
    ("rates", "joined"), [((500.0, 100.0), 100.0), ((None, 250.0), 250.0), ((None, None), None)]
)
def test_joined_verdicts_have_the_lowest_rates_of_their_runs(rates, joined):
    """What happened between two evaluations may have been missed in one of the runs: the coarsest rate counts."""
    runs = [
        Verdict(measures=(), sample_rate=sample_rate, contact_rate=rate)
        for sample_rate, rate in zip((200.0, 100.0), rates, strict=True)
    ]

    whole = join_verdicts(runs, [1.0, 1.0])

    assert whole.contact_rate == joined
    assert whole.sample_rate == 100.0
