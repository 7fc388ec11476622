"""Remarks about a run: severity, remedy and language. Each remedy is applied, and the run is then within its bounds."""

import json
import re
import shlex
from ast import literal_eval
from pathlib import Path
from string import Formatter

import numpy as np
import pytest

import simrob_drake
from simrob_drake import Arm, Program, Workcell, load_station, simulate
from simrob_drake.base.messages import catalogue, in_language
from simrob_drake.base.remarks import Remark, Remedy, worst_severity
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.cli.app import run_command
from simrob_drake.cli.screen import say_remark
from simrob_drake.programs.whole_program import perform
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.verdict.judge import CRITERIA
from simrob_drake.results.verdict.verdict import Measure, MeasuredValue, Verdict

pytestmark = pytest.mark.usefixtures("no_plots")

SOFT = {"servo.kp": 300}
"""An arm that sags by 4 deg under gravity, and whose tool goes 23 mm into the floor on its way."""

INTO_THE_FLOOR = {
    "reference.target_deg": {"joint_2": 100, "joint_3": 20},
    "reference.duration": 0.3,
    "duration": 0.6,
}
"""A motion that takes the arm into the floor at full speed."""


def run(name: str, overrides: dict | None = None, **options: float) -> SimulationResult:
    return simulate(load_station(name, overrides), progress=False, **options)


def remark_about(result: SimulationResult, words: str) -> Remark:
    (remark,) = (remark for remark in result.remarks[1:] if words in remark.text)
    return remark


def with_remedy(overrides: dict, remark: Remark) -> dict:
    """Changes of a station with those of a remark's remedy. The button of a page sets its value, ``--set`` its text."""
    assert remark.remedy is not None
    pairs = [setting.split("=", 1) for setting in remark.remedy.settings]
    assert {key: parse_yaml(text, "--set") for key, text in pairs} == remark.remedy.changes
    return {**overrides, **remark.remedy.changes}


@pytest.fixture(scope="module")
def soft() -> SimulationResult:
    return run("irb120_dynamic", SOFT)


def test_a_run_within_all_bounds_says_so_in_one_line():
    (remark,) = run("irb120_dynamic", duration=1.5).remarks
    assert remark == Remark("success", "ran to its end at 1.5 s. All within bounds")


def test_an_arm_that_sags_is_told_so_and_the_remedy_removes_the_warning(soft):
    sentence, *warnings = soft.remarks

    assert sentence.severity == "warning"
    assert sentence.text.startswith("ran to its end at 3 s. Two bounds exceeded: final error, ")
    assert {warning.severity for warning in warnings} == {"warning"}

    sag = remark_about(soft, "joint_2 ended")
    assert sag.remedy.setting == "servo.feedforward=gravity"
    assert remark_about(soft, "below the floor").remedy.text.startswith(
        "this station has no contact"
    )

    held = run("irb120_dynamic", with_remedy(SOFT, sag))
    assert held.remarks[1:] == []
    assert held.verdict["final_error"].worst.value < np.deg2rad(0.01)


def test_contact_is_the_remedy_of_an_arm_that_sinks_through_the_floor_of_a_station_without(soft):
    sinks = remark_about(soft, "below the floor")
    stopped = run("irb120_dynamic", with_remedy(SOFT, sinks), duration=1.5)

    assert stopped.verdict["below_floor"].worst.value < 0.005
    assert [doubt for doubt in stopped.verdict.doubts if "unstable" in doubt] == []

    low = {"robot.base": [0, 0, -0.83, 0, 0, 0], "reference": {"kind": "hold"}}
    kinematic = remark_about(run("irb120_kinematic", low, duration=0.1), "below the floor")

    assert "this station has no contact" in kinematic.remedy.text
    assert kinematic.remedy.setting == ""  # a prescribed motion stops at nothing


def test_a_move_that_is_too_fast_gets_the_duration_at_which_it_is_not():
    fast = {"reference.duration": 0.2}
    speed = remark_about(run("irb120_dynamic", fast, duration=1.0), "of its speed")

    assert speed.remedy.key == "reference.duration"
    assert speed.remedy.value > 0.2

    slower = run("irb120_dynamic", with_remedy(fast, speed), duration=1.0)
    assert not [warning for warning in slower.warnings if "of its speed" in warning]


def test_servos_that_swing_are_given_damping_whatever_bound_they_exceed():
    swinging = run("irb120_dynamic", {"servo.kp": 1e5, "servo.kd": 0.0}, duration=1.5)

    remedies = {remark.remedy.text for remark in swinging.verdict.remarks if remark.remedy}

    assert len(swinging.verdict.remarks) > 2
    assert remedies == {"the servo of joint_1 swings about its reference: raise kd, or reduce kp"}


def test_a_servo_that_sags_and_lags_has_one_remedy():
    """The largest error, which lasts to the end, was put down to a lag, and the final error to gravity."""
    bounds = {"verdict.largest_error_deg": 1.0, "verdict.final_error_deg": 1.0}
    sagging = run("irb120_dynamic", {"servo.kp": 300, "servo.kd": 30, **bounds}, duration=3.0)

    ended = remark_about(sagging, "joint_2 ended").remedy
    was = remark_about(sagging, "joint_2 was").remedy

    assert ended == was
    assert was.key == "servo.feedforward"


def test_a_motor_that_cannot_hold_is_not_given_more_time():
    weak = run("irb120_dynamic", {"servo.torque_limit": {"joint_2": 2}}, duration=1.0)
    remedy = remark_about(weak, "joint_2 ended").remedy

    assert "too weak" in remedy.text
    assert (remedy.key, remedy.setting) == ("servo.torque_limit", "")


def test_a_robot_with_its_own_servo_section_gets_its_own_key():
    own = {"robots.left.servo": {"kp": 200, "kd": 20}}
    remedy = remark_about(run("two_irb120", own, duration=1.5), "left.joint_2 ended").remedy
    assert remedy.setting == "robots.left.servo.feedforward=gravity"


@pytest.mark.parametrize("section", ["robot", "robots.left"])
def test_the_remedies_of_an_only_robot_with_sections_of_its_own_have_keys_that_act(section):
    """The station's own `servo` has no effect on such a robot, and its `reference` alone is not complete."""
    station = {"name": "own_sections", "duration": 1.0}
    servo = {
        f"{section}.model": "irb120",
        f"{section}.servo": {"kp": 300, "kd": 20},
        f"{section}.initial_deg": {"joint_2": 60},
        "reference": {"kind": "hold"},
    }
    sag = remark_about(simulate(load_station(station, servo), progress=False), "joint_2 ended")
    assert sag.remedy.setting == f"{section}.servo.feedforward=gravity"
    held = load_station(station, with_remedy(servo, sag))
    assert held.servo_of(held.only_robot).feedforward == "gravity"

    ramp = {"kind": "ramp", "target_deg": {"joint_1": 80}, "duration": 0.05}
    fast = {f"{section}.model": "irb120", f"{section}.reference": ramp}
    speed = remark_about(simulate(load_station(station, fast), progress=False), "of its speed")
    assert speed.remedy.key == f"{section}.reference.duration"
    slower = load_station(station, with_remedy(fast, speed))
    assert slower.reference_of(slower.only_robot).duration == speed.remedy.value > 0.05


@pytest.mark.parametrize("section", ["robot", "robots.left"])
def test_the_start_of_an_only_robot_has_the_key_of_its_section(section):
    away = {
        f"{section}.model": "irb120",
        f"{section}.initial_deg": {"joint_5": 90},
        "reference": AWAY["reference"],
    }
    station = {"name": "own_sections", "duration": 0.2}

    error = remark_about(simulate(load_station(station, away), progress=False), "joint_5 was")

    assert error.remedy.key == f"{section}.initial_deg"

    begun = load_station(station, with_remedy(away, error))
    assert begun.robots[begun.only_robot].initial_deg == error.remedy.value


def test_boxes_that_sink_into_each_other_get_a_stiffer_contact():
    board = {"parent": "world", "pose": [-0.2, -0.2, 0.1, 0, 0, 0]}
    box = {"model": "box_on_corners", "free": True, "pose": [0, 0, 0.201, 0, 0, 0]}
    soft_boxes = {"pieces": {"board": board, "box": box}, "contact.stiffness": 500, "sensors": {}}

    sunk = remark_about(run("box_on_floor", soft_boxes, duration=1.0), "penetrated each other by")

    assert sunk.remedy.setting == "contact.stiffness=5000.0"
    assert run("box_on_floor", with_remedy(soft_boxes, sunk), duration=1.0).warnings == []


def test_a_fall_is_a_failure_and_a_stop_that_was_asked_for_is_none():
    pushed = {"forces.push": {"kind": "push", "force": [60, 0, 0], "start": 0.1, "duration": 0.3}}
    fell = run("roid1_dynamic", {**pushed, "reference": {"kind": "hold"}}, duration=3.0)

    assert fell.ending == "monitor"
    (remark,) = fell.remarks
    assert (remark.severity, remark.text) == ("failure", fell.end_in_words)

    (stopped, *_) = run("irb120_force_stop").remarks
    assert stopped.severity == "success"


def test_a_program_counts_its_missed_targets_and_names_moves_from_one():
    moves = [
        {"move_abs_j": {"targets": [0.5 * sign, 0, 0, 0, 0.5, 0], "duration": 0.5}}
        for sign in (1, -1)
    ]
    cell = Workcell(load_station("irb120_dynamic", {"servo.kp": 200}))

    result = perform(cell, Program.model_validate({"moves": moves}))

    sentence = result.remarks[0].text
    misses = [move.position_error for move in result.verdict.moves]
    assert f"Two targets missed, by up to {1e3 * max(misses):.3g} mm" in sentence

    named = {number for warning in result.warnings for number in re.findall(r"move (\d)", warning)}
    assert named == {"1", "2"}
    final = result.verdict["final_error"].worst
    assert (final.move, final.time) in [
        ("move 1", pytest.approx(0.5)),
        ("move 2", pytest.approx(1.0)),
    ]
    assert (
        f" at {final.time:.2f} s, in {final.move} (bound " in result.verdict["final_error"].warning
    )


def test_the_table_of_criteria_has_no_alarm_within_the_bounds():
    """Of issue 55: "payload 66.7 %", "below the floor 0.0486 mm" and "shortened steps 34.6 %" read as failures."""
    verdict = run("irb120_dynamic").verdict

    rows = {row.criterion: row for row in verdict.table}
    assert {row.severity for row in rows.values()} == {"success"}
    assert (rows["payload"].value, rows["payload"].bound) == ("2 kg", "3 kg")
    assert re.fullmatch(r"\d\d %", rows["solver retries"].value)
    assert rows["solver retries"].bound == "300 %"
    assert str(verdict) == "Ran to its end at 3 s. All within bounds"
    assert max(map(len, repr(verdict).splitlines())) <= 80


def test_a_notebook_shows_severity_and_remedy(soft):
    page = soft._repr_html_()

    assert "<td>warning</td><td>final error</td>" in page
    assert "<td>ok</td><td>payload</td>" in page
    assert "servo.feedforward=gravity" in page
    assert "<th>criterion</th>" in soft.verdict._repr_html_()


def test_summary_json_has_the_same_words(soft, tmp_path):
    folder = soft.save(tmp_path / "run", recording=False)

    verdict = json.loads((folder / "summary.json").read_text())["verdict"]
    assert verdict["severity"] == "warning"
    assert verdict["sentence"].startswith("Ran to its end at 3 s. Two bounds exceeded")
    assert [entry["text"] for entry in verdict["remarks"]] == soft.warnings
    assert verdict["remarks"][0]["set"] == "servo.feedforward=gravity"
    assert verdict["figures"]["final_error"]["severity"] == "warning"


def test_each_criterion_has_its_words_in_spanish_with_a_decimal_comma():
    for criterion in CRITERIA:
        value = MeasuredValue("joint_2", 2.345, criterion.unit, 1.0, 0.5, 1.0, "N·m", "move 2")
        measure = Measure(criterion, (value._replace(value=0.5) if criterion.least else value,))
        for text in (measure.warning, measure.row.criterion):
            spanish = in_language(text, "es")
            assert spanish != text
            assert not re.search(r"\d\.\d| of | at |bound", spanish)


def test_every_spanish_template_of_results_has_the_fields_of_the_english_one():
    """Templates of the code are found in its text; those of the criteria by the criteria."""
    sources = [
        file.read_text() for file in (Path(simrob_drake.__file__).parent / "results").rglob("*.py")
    ]
    # A text may be written as several literals, one after the other.
    written = re.compile(r'message\(\s*"(results\.\w+)",\s*((?:"(?:[^"\\]|\\.)*"\s*)+)')
    english = {
        name: literal_eval(f"({text})")
        for source in sources
        for name, text in written.findall(source)
    }
    for criterion in CRITERIA:
        english[f"results.title_{criterion.name}"] = criterion.title
        english[f"results.beyond_{criterion.name}"] = criterion.sentence

    spanish = catalogue("results", "es")

    assert english.keys() <= spanish.keys(), english.keys() - spanish.keys()
    for name, template in english.items():
        assert fields(template) == fields(spanish[name]), name


def fields(template: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(template) if name}


def test_severities_are_ordered():
    assert worst_severity([]) == "success"
    assert (
        worst_severity([Remark("note", ""), Remark("failure", ""), Remark("warning", "")])
        == "failure"
    )
    assert Remedy("wait").setting == ""
    assert Remedy("wait", "duration", 3.0).setting == "duration=3.0"
    assert Verdict((), 100.0).severity == "success"


def test_the_command_line_tells_a_shared_remedy_once(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    assert run_command(["run", "irb120_dynamic", "--no-recording", "--set", "servo.kp=150"]) == 0
    captured = capsys.readouterr()
    assert captured.err.count("--set servo.feedforward=gravity") == 1
    assert captured.err.count("--set contact={}") == 1
    assert max(map(len, captured.err.splitlines())) <= 80
    assert "verdict   " not in captured.out


def test_an_option_and_its_setting_stay_on_one_line(capsys):
    """So that they can be copied; a setting with spaces is quoted for the shell, and remains whole."""
    settings = (
        ("contact.stiffness", 25000.0),
        ("solver.max_step", 0.0005),
        ("reference.target_deg", "{joint_5: 60, joint_2: 30}"),
        ("servo.feedforward", "gravity"),
    )
    text = "take smaller steps in the solver or let the arm rest, such as with --set solver.max_step=0.0005"
    say_remark(Remark("warning", "it fails", Remedy(text, "contact", {}, settings)))
    lines = [line.strip() for line in capsys.readouterr().err.splitlines()]

    options = " ".join(lines[lines.index("--set contact={} --set contact.stiffness=25000.0") :])

    assert max(map(len, lines)) <= 72
    assert not [line for line in lines if line.endswith("--set")]
    expected = ["contact={}", *(f"{key}={value}" for key, value in settings)]
    assert shlex.split(options) == [word for setting in expected for word in ("--set", setting)]

    quoted = "--set 'reference.target_deg={joint_5: 60, joint_2: 30}'"
    assert [line for line in lines if quoted in line]


def test_a_lag_in_a_program_is_answered_with_time():
    arm = Arm(load_station("irb120_dynamic", {"servo.kp": 200}))
    hasty = arm.move_abs_j([0.8, 0.5, 0, 0, 0.5, 0], duration=0.3, check="nothing")

    texts = {remark.remedy.text for remark in hasty.remarks[1:] if remark.remedy}
    assert texts == {"the servos lag behind: give the motion more time, or raise kp and kd"}


AWAY = {
    "reference": {"kind": "hold", "target_deg": 0},
    "robot.initial_deg": {"joint_5": 90},
    "duration": 1,
}
"""An arm that begins away from its reference: joint 5 jumps by 90 deg."""


def test_a_start_away_from_the_reference_is_answered_with_the_start():
    away = run("irb120_dynamic", AWAY)
    error = remark_about(away, "joint_5 was 90 deg from its reference at 0.00 s")

    assert "joint_5 begins at 90 deg, but its reference begins at 0 deg" in error.remedy.text
    for remark in away.remarks[1:]:
        assert remark.remedy is None or "more time" not in remark.remedy.text
    assert run("irb120_dynamic", with_remedy(AWAY, error)).warnings == []


def test_a_run_that_began_in_a_state_has_no_key_for_its_start():
    first = run("irb120_dynamic", AWAY, duration=0.002)
    again = simulate(
        "irb120_dynamic",
        start=first.final_state,
        reference=(np.array([0.0, 1.0]), np.zeros((2, 6))),
    )

    error = remark_about(again, "joint_5 was")

    assert "begin the reference where the robot begins" in error.remedy.text
    assert error.remedy.settings == []


def test_contact_as_a_remedy_copes_with_an_arm_that_hits_the_floor_at_full_speed():
    """Under radau3 with contact this motion would take hours: its steps become 2 µs long."""
    sinks = remark_about(run("irb120_dynamic", INTO_THE_FLOOR), "below the floor")
    assert sinks.remedy.settings == [
        "contact={}",
        "solver.kind=discrete",
        "servo.realization=implicit",
    ]
    assert sinks.summary()["set_also"] == sinks.remedy.settings[1:]

    stopped = run("irb120_dynamic", with_remedy(INTO_THE_FLOOR, sinks))

    assert len(stopped.step_times) == pytest.approx(600, abs=2)  # fixed steps of 1 ms
    assert stopped.verdict["below_floor"].worst.value < 0.005
    # Steps of a fifth agree: the arm lies on the floor with joint_2 at the same angle.
    fine = run("irb120_dynamic", {**with_remedy(INTO_THE_FLOOR, sinks), "solver.time_step": 2e-4})
    assert stopped["q.joint_2"][-1] == pytest.approx(fine["q.joint_2"][-1], abs=np.deg2rad(1.0))


def test_contact_as_a_remedy_leaves_a_solver_that_copes():
    sinks = remark_about(
        run("irb120_dynamic", {**INTO_THE_FLOOR, "solver.scheme": "cenic"}), "below the floor"
    )
    assert sinks.remedy.settings == ["contact={}"]
