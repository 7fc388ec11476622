"""A fall names the push before it, and no final error is taken from a motion that was cut off."""

from dataclasses import replace

import numpy as np
import pytest

from simrob_drake import simulate
from simrob_drake.base.messages import in_language
from simrob_drake.parts.forces import Push
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.program import Program
from simrob_drake.programs.whole_program import perform
from simrob_drake.results.animation.camera import base_distances
from simrob_drake.results.animation.pictures import captions
from simrob_drake.results.record.disturbances import last_disturbance
from simrob_drake.stations.load import load_station, with_settings

LEANS = "stopped because robot fell: it leans by more than 60 deg"
FALL = LEANS + ", at {at} s, {after} s after the push of {size} N on robot"


@pytest.fixture(scope="module")
def fall():
    """A humanoid that is pushed at 1 s of a wait, and falls."""
    changes = [{"time": 1.0, "push": {"force": [60, 0, 0]}}]
    content = {"station": "humanoid_dynamic", "moves": [{"wait": 2.0}], "changes": changes}
    return perform(Workcell("humanoid_dynamic"), Program.of_content(content, "the test"))


def test_a_fall_in_a_program_names_the_push_and_its_time(fall):
    """The end of the run names the push before the fall, and the time between both, in English and Spanish."""
    after = fall.stop_time - 1.0

    assert 0.1 < after < 0.3
    assert fall.end_in_words == FALL.format(
        at=f"{fall.stop_time:.4g}", after=f"{after:.2f}", size=60
    )
    verdict = fall.verdict
    assert (
        verdict.remarks[0].text.startswith("Stopped because robot fell")
        or fall.end_in_words in verdict.sentence
    )

    spanish = in_language(fall.end_in_words, "es")
    assert f"{after:.2f} s después de un empujón de 60 N a robot".replace(".", ",") in spanish


def test_no_final_error_of_a_motion_that_a_fall_cut_off(fall):
    """A robot that fell has no final error: its motion was not completed."""
    assert "final_error" not in fall.verdict.summary()["figures"]
    assert "largest_error" in fall.verdict.summary()["figures"]


def test_a_fall_in_a_single_run_names_the_last_push_that_had_begun():
    """Of several pushes, the one that began last before the fall is named."""
    pushes = {
        "first": {"start": 0.05, "duration": 0.2, "force": [0, 0, 3.0]},
        "second": {"start": 0.2, "duration": 0.2, "force": [48.0, 0, 36.0]},
        "too_late": {"start": 3.0, "force": [5.0, 0, 0]},
    }
    run = simulate("humanoid_dynamic", duration=3.5, pushes=pushes)

    assert run.stopped_by == "fall"
    assert run.end_in_words.endswith(
        f", {run.stop_time - 0.2:.2f} s after the push of 60 N on robot"
    )


def test_a_push_long_before_a_fall_is_not_named(fall):
    """A push more than `LONGEST_FALL` before the end is most likely not the cause."""
    part = fall.runs[0].runs[1]
    early = Push(kind="push", start=0.0, force=(60.0, 0.0, 0.0))

    pushed = replace(part, config=part.config.model_copy(update={"forces": {"early": early}}))

    assert "after the push" in pushed.end_in_words

    late = replace(pushed, times=pushed.times + 0.0)
    late.times[-1] = 5.1

    assert "after the push" not in late.end_in_words


def test_a_push_that_changes_cut_is_one_push(fall):
    """The parts of a push that a change of the station has cut count as one push with the first start."""
    before, pushed = fall.runs[0].runs
    config = pushed.config

    def part(start, duration, times):
        push = Push(kind="push", start=start, duration=duration, force=(60.0, 0.0, 0.0))
        changed = config.model_copy(update={"forces": {"push_0": push}})
        return replace(pushed, config=changed, times=np.array(times))

    # A push of 0.3 s that begins at 1.5 s: the cut at 1.6 s leaves 0.2 s of it, from the start of the next run.
    parts = (part(1.5, 0.3, [0.0, 1.6]), part(0.0, 0.2, [0.0, 0.5]))
    assert last_disturbance(replace(fall, runs=parts)).begin == pytest.approx(1.5)
    # A second push of the same name, after the end of the first one, is another push.
    parts = (part(0.5, 0.3, [0.0, 1.6]), part(0.0, 0.2, [0.0, 0.5]))
    assert last_disturbance(replace(fall, runs=parts)).begin == pytest.approx(1.6)
    assert last_disturbance(before) is None


def test_the_end_of_a_move_is_judged_and_not_a_change_in_it():
    """A change in the middle of a move cuts the run, but the final error is that at the end of the move."""
    content = {
        "station": "irb120_dynamic",
        "moves": [{"target_deg": {"joint_2": 40}, "duration": 1.0}],
        "changes": [{"time": 0.5, "set": {"servo.kp": 300}}],
    }
    run = perform(Workcell("irb120_dynamic"), Program.of_content(content, "the test"))

    error = abs(run["q_ref.joint_2"] - run["q.joint_2"])
    final = run.verdict["final_error"].worst
    assert (final.subject, final.time) == ("joint_2", pytest.approx(1.0))
    assert final.value == pytest.approx(error[-1], rel=1e-12)
    middle = run.runs[0].runs[0]
    assert "final_error" not in middle.verdict.summary()["figures"]
    # The second half begins where the robot is, behind its reference: no start of a station can change that.
    assert "initial_deg" not in " ".join(
        remark.remedy.text for remark in run.remarks if remark.remedy
    )


def test_the_film_strip_gives_the_distance_of_the_text(fall):
    """The last caption has the same distance as the summary."""
    distance = fall.summary()["locomotion"]["distance"]
    assert base_distances(fall, fall.times[[0, -1]]) == pytest.approx([0.0, distance])
    assert captions(fall.times[-1:], base_distances(fall, fall.times[-1:])) == [
        f"{fall.stop_time:.2f} s, {distance:.2f} m"
    ]


def test_a_program_without_moves_of_the_user_names_no_move():
    """A program that only plays the reference of its station names no move in its warnings."""
    station = with_settings(
        load_station("irb120_dynamic"), {"duration": 1.2, "servo.kp": 300}, "the test"
    )

    def warning(*moves):
        content = {"station": "irb120_dynamic", "moves": [*moves]}
        run = perform(Workcell(station), Program.of_content(content, "the test"))
        assert len(run.move_spans) == len(moves)
        return run.verdict["below_floor"].warning

    assert " at 1.11 s (bound 5 mm)" in warning({"play": 1.2})
    assert " at 1.11 s, in move 1 (bound 5 mm)" in warning({"play": 1.2}, {"wait": 0.1})
