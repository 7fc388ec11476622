"""A session by itself: what is taught, how it is kept, and what becomes of it when something breaks."""

import runpy
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from threading import Thread
from zipfile import ZipFile

import numpy as np
import pytest
import yaml
from fake_runs import CountingRun
from hypothesis import given, settings
from hypothesis import strategies as st

from simrob_drake import Program, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant import run_client, store
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.extensions.pendant.store import MOST_STEPS
from simrob_drake.stations.load import with_settings

ELBOW, KNEE = {"left_elbow": 30.0}, {"left_knee": 20.0}


class Taught(Session):
    """A session with the run that it has now."""

    runs: list[CountingRun]

    @property
    def worker(self):
        return self.runs[-1]


@pytest.fixture
def teach(tmp_path):
    """Open sessions one after the other in one folder."""
    opened = []

    def open_(subject="humanoid", **how):
        for before in opened:
            before.close()
        runs = []

        def live(on_news):
            runs.append(CountingRun(on_news))
            return runs[-1]

        session = Taught.open(subject, tmp_path, live=live, **how)
        session.runs = runs
        session.hear()
        opened.append(session)
        return session

    yield open_
    for before in opened:
        before.close()


def test_the_program_that_a_station_carries_is_taught_first(teach, tmp_path):
    station = tmp_path / "yobotics_program.yaml"
    station.write_text(
        yaml.safe_dump({"robot": {"model": "yobotics"}, "program": {"moves": [{"wait": 0.5}]}})
    )
    session = teach(str(station))
    assert [move.key for move in session.book.program.moves] == ["wait"]
    session.book.remove(0)
    assert teach(str(station)).book.program.moves == ()  # what was taught since counts


def heard(session, future):
    """Return the result of what a session was asked for."""
    session.hear()
    session.hear()
    assert future.done()
    return future.result()


def tried(session, *given):
    """Test a move; return None if something was wrong."""
    return heard(session, session.test(*given))


def on_disk(session):
    return Program.load(session.book.file)


# Try


def test_tests_gather_in_one_move_that_begins_where_the_first_did(teach):
    session = teach()
    assert tried(session, ELBOW, 1.5) is not None
    assert tried(session, {"HomIF": 40}) is not None
    assert session.book.pending == (
        {"target_deg": {"left_elbow": 30.0, "HomIF": 40.0}, "duration": 1.5},
    )
    first, back, both = session.worker.asked("do", "rewind")
    assert first == ("do", {"moves": [{"target_deg": ELBOW, "duration": 1.5}]})
    assert back == ("rewind", {"time": 0.0})
    assert both == ("do", {"moves": list(session.book.pending)})
    assert not session.book.program.moves
    assert session.add()
    assert not session.book.pending
    assert [move.target_deg for move in session.book.program.moves] == [
        {"left_elbow": 30.0, "HomIF": 40.0}
    ]
    assert tried(session, KNEE) is not None  # the next one begins behind it
    assert session.worker.asked("do", "rewind")[3:] == [
        ("do", {"moves": list(session.book.pending)})
    ]
    assert session.run.time == 2.5


def test_a_suggested_duration_is_one_that_the_servos_can_follow(teach):
    """The elbow's servo lags by kd/kp = 1 s, so 2 degrees allow 2 degrees a second."""
    session = teach()
    assert session.suggest_duration(ELBOW) == pytest.approx(15.0)
    start = [np.deg2rad(20.0) if axis == "left_elbow" else 0.0 for axis in session.book.model.axes]
    assert session.suggest_duration({"left_elbow": 30}, start) == pytest.approx(5.0)
    with pytest.raises(SimrobError, match="left_elbow"):
        session.suggest_duration({"left_elbow": 400})


def test_tested_again_it_is_seen_again(teach):
    session = teach()
    tried(session, ELBOW)
    assert tried(session, ELBOW) is not None
    assert [name for name, _ in session.worker.asked("do", "rewind")] == ["do", "rewind", "do"]
    assert session.run.time == 1.0
    assert session.undo()
    assert not session.book.history.can_undo


def test_nothing_is_added_before_something_is_tested(teach):
    session = teach()
    assert not session.add()
    assert session.message.key == "nothing_tested"
    assert session.message.wrong


def test_discard_goes_back_to_before_all_that_was_tried(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    tried(session, KNEE)
    heard(session, session.try_move({"walk": {"steps": 2}}))
    assert len(session.book.pending) == 2
    assert heard(session, session.discard())
    assert session.worker.asked("rewind") == [("rewind", {"time": 1.0})]
    assert session.book.pending == ()
    assert len(session.book.program.moves) == 1
    assert session.run.time == 1.0


def test_a_step_is_the_robots_own(teach):
    session = teach()
    heard(session, session.step())
    assert [list(move["target_deg"]) for move in session.book.pending] == [
        ["CadIF", "RodI"],
        ["RodD", "TobD"],
        ["CadIF", "RodI"],
        ["RodD", "TobD", "HomDF"],
    ]
    tried(session, ELBOW)  # no part of the step
    assert len(session.book.pending) == 5
    other = teach("roid1")
    heard(other, other.step())
    assert [list(move) for move in other.book.pending] == [["walk"]]


def test_what_cannot_be_run_is_not_kept(teach):
    session = teach()
    tried(session, ELBOW)
    session.worker.refused = "do"
    assert tried(session, KNEE) is None
    assert str(session.message) == "do cannot be"
    assert session.phase == "idle"
    assert session.book.pending == ({"target_deg": ELBOW, "duration": 1.0},)
    assert not session.book.history.can_redo


def falling(session, asked, begun=0.0):
    """Let the robot fall in a run that was asked for, 0.8 s after it began."""
    session.hear()
    session.worker.tick(begun + 0.75)
    session.worker.finish("monitor", goes_on=False, time=begun, reached=begun + 0.8)
    session.hear()
    assert asked.done()


def test_a_move_in_which_the_robot_falls_is_kept_and_can_be_looked_at(teach):
    session = teach()
    tried(session, KNEE)
    session.add()
    session.worker.held = True
    falling(session, session.test({"HomIF": 110.0, "HomDF": 110.0}), 1.0)
    assert [move["target_deg"] for move in session.book.pending] == [
        {"HomIF": 110.0, "HomDF": 110.0}
    ]
    assert session.message.wrong
    assert (session.run.time, session.run.reach) == (1.8, 1.8)
    session.rewind(1.5)
    session.hear()
    assert (session.run.time, session.run.reach) == (1.5, 1.8)
    session.rewind(1.0)
    session.hear()
    again = session.test({"HomIF": 40.0})  # the others stay as they were
    session.hear()
    assert session.worker.asked("do")[-1][1]["moves"] == list(session.book.pending)
    assert session.book.pending[0]["target_deg"] == {"HomIF": 40.0, "HomDF": 110.0}
    session.worker.finish(time=2.0)
    session.hear()
    assert again.result()
    assert (session.run.time, session.run.reach) == (2.0, 2.0)


def test_after_a_fall_the_next_test_begins_before_it_and_nothing_is_done_twice(teach):
    session = teach()
    session.worker.held = True
    fallen = session.test(ELBOW, 1.0)
    session.hear()
    session.worker.tick(0.5)
    session.worker.note(push={"at": "trunk", "force": [9, 0, 0]})
    falling(session, fallen)
    assert len(session.book.history.present.changes) == 1
    session.test(ELBOW, 2.0)
    session.hear()
    assert not session.worker.asked("rewind")
    assert not session.book.history.present.changes  # nobody pushes any more
    session.worker.finish()
    session.hear()
    session.test(KNEE)
    session.hear()
    assert session.worker.asked("rewind") == [("rewind", {"time": 0.0})]


def test_what_fell_gives_way_to_what_is_tried_instead(teach):
    session = teach()
    tried(session, ELBOW)
    session.worker.held = True
    falling(session, session.try_move({"walk": {"steps": 4, "amplitude": 1.9}}), 1.0)
    assert len(session.book.pending) == 2
    falling(session, session.try_move({"walk": {"steps": 4, "amplitude": 1.5}}), 1.0)
    assert [move["walk"]["amplitude"] for move in session.book.pending[1:]] == [1.5]
    session.test(KNEE)
    session.hear()
    assert [list(move["target_deg"]) for move in session.book.pending] == [
        ["left_elbow"],
        ["left_knee"],
    ]
    assert session.worker.asked("do")[-1][1]["moves"] == [session.book.pending[1]]
    session.worker.finish()
    session.hear()
    falling(session, session.step(), 2.0)
    assert session.undo()
    assert len(session.book.pending) == 2


def test_a_move_that_fell_can_be_added_and_discarded(teach):
    for name in ("add", "discard"):
        session = teach()
        session.worker.held = True
        falling(session, session.test(ELBOW))
        getattr(session, name)()
        session.hear()
        assert session.book.pending == ()
        assert len(session.book.program.moves) == (name == "add")
        assert session.run.time == (0.8 if name == "add" else 0.0)
        session.undo()
        session.undo()


def test_a_program_in_which_the_robot_falls_can_be_looked_at(teach):
    session = teach()
    session.book.insert(0, {"walk": {"steps": 4}})
    session.worker.held = True
    falling(session, session.simulate())
    assert (session.run.time, session.run.reach) == (0.8, 0.8)
    session.rewind(0.5)
    session.hear()
    session.go_on()
    session.hear()
    assert [name for name, _ in session.worker.asked("rewind", "go_on")] == ["rewind", "go_on"]


def test_the_way_back_ends_with_the_run_that_it_leads_into(teach):
    session = teach()
    tried(session, ELBOW, 2.0)
    assert session.run.reach == 2.0
    heard(session, session.restart())
    assert session.run.reach == 0.0
    tried(session, KNEE)
    assert session.run.reach == 2.0


def test_a_run_can_be_looked_at_when_its_process_has_died(teach):
    session = teach()
    session.worker.held = True
    session.test(ELBOW, 2.0)
    session.hear()
    for number in range(1, 20):
        session.worker.tick(number / 20, position=[number])
    session.watch(["position"])
    session.hear()
    session.worker.die()
    session.hear()
    session.hear()
    assert session.message.key == "died"
    assert (session.phase, session.run.time, session.run.reach) == ("idle", 0.95, 0.95)
    assert session.run.lost
    session.worker.shown = False  # its station is at the start
    assert heard(session, session.rewind(0.5))
    assert session.worker.positions == [0.5]
    assert (session.run.time, session.run.reach, session.run.rewound) == (0.5, 0.95, False)
    assert heard(session, session.restart())
    assert (session.run.time, session.run.reach, session.run.lost) == (0.0, 0.0, False)
    session.test(ELBOW, 1.0)
    session.hear()
    assert session.worker.asked("do")[-1] == (
        "do",
        {"moves": [{"target_deg": ELBOW, "duration": 1.0}]},
    )


def test_of_a_run_whose_process_died_there_is_what_was_watched(teach):
    session = teach()
    session.watch(["position"])
    session.worker.held = True
    session.test(ELBOW, 2.0)
    session.hear()
    for number in range(1, 4):
        session.worker.tick(number / 20, position=[number, -number])
    session.worker.die()
    session.hear()
    (died,) = session.run.ended
    assert (died.kind, died.begun, died.reached) == ("tried", 0.0, 0.15)
    assert died.history("position") == [(0.05, [1, -1]), (0.1, [2, -2]), (0.15, [3, -3])]


def test_ten_runs_are_kept(teach):
    session = teach()
    for _ in range(12):
        heard(session, session.simulate())
    assert [ended.number for ended in session.run.ended] == list(range(3, 13))


def test_simulate_plays_all_from_the_start(teach):
    session = teach()
    for target in (ELBOW, KNEE):
        tried(session, target)
        session.add()
    tried(session, {"HomIF": 10})
    assert heard(session, session.simulate())
    (_, played), *_ = session.worker.asked("play")
    assert Program.of_text(played["program"]).moves == session.book.program.moves
    assert session.run.time == 2.0
    assert len(session.book.pending) == 1  # what was tested is not lost, nor taken for stored
    tried(session, {"HomIF": 20})
    assert session.worker.asked("do")[-1][1]["moves"] == list(session.book.pending)
    assert session.run.time == 3.0


def test_an_empty_program_leaves_the_station_to_its_file(teach):
    session = teach()
    heard(session, session.simulate())
    (_, played), *_ = session.worker.asked("play")
    duration = load_station("humanoid_dynamic").duration
    assert Program.of_text(played["program"]).moves[0].duration == duration
    assert not session.book.program.moves


def test_what_is_asked_for_while_something_runs(teach):
    session = teach()
    session.worker.held = True
    first = session.test(ELBOW, 2.0)
    session.hear()
    session.worker.tick(0.5)
    second = session.test(KNEE)  # goes with the first: that is ended
    session.hear()
    session.hear()
    assert [name for name, _ in session.worker.asked("do", "stop", "rewind")] == [
        "do",
        "stop",
        "rewind",
        "do",
    ]
    assert first.done()
    later = session.try_move({"walk": {"steps": 2}})  # does not: it waits
    assert session.message.key == "waits"
    session.hear()
    assert not later.done()
    assert len(session.worker.asked("do")) == 2
    session.worker.finish()
    session.hear()
    session.hear()
    assert second.done()
    assert session.worker.asked("do")[-1][1]["moves"] == [{"walk": {"steps": 2}}]
    session.worker.finish()
    assert heard(session, later) is not None


def test_reset_erases_all_and_undo_brings_it_back(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    tried(session, KNEE)
    before = session.book.program, session.book.pending
    assert heard(session, session.reset())
    assert not session.book.program.moves
    assert not session.book.pending
    assert session.undo()
    assert (session.book.program, session.book.pending) == before
    assert session.redo()
    assert not session.book.program.moves


# Bad input


@pytest.mark.parametrize(
    ("target", "told"),
    [
        (
            {"left_elbow": 300},
            "left_elbow would be at 300 deg, 170 deg beyond its limit of 130 deg",
        ),
        ({"left_elbo": 3}, "did you mean 'left_elbow'?"),
        ({"left_elbow": float("nan")}, "must be a finite number"),
        ({"left_elbow": "3"}, "must be a finite number"),
        ({"left_elbow": 3, "CodI": 4}, "its axis has a target under another name already"),
        ({}, "at least one axis"),
    ],
)
def test_wrong_targets_are_refused_in_words(teach, target, told):
    session = teach()
    assert tried(session, target) is None
    assert told in str(session.message)
    assert session.message.wrong
    assert not session.book.pending
    assert not session.worker.asked("do")
    assert not session.book.history.can_undo
    assert not session.book.insert(0, {"target_deg": target})


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (lambda s: s.book.edit(3, {"act": "bow"}), "the index of a move, and the program has none"),
        (lambda s: s.book.insert(0, {"hop": 1}), "hop: unknown key"),
        (lambda s: s.book.insert(0, {"walk": {"steps": "many"}}), "steps"),
        (lambda s: s.book.remove_change(0), "index"),
        (lambda s: s.setup.set("servo.kpp", 3), "servo.kpp: unknown key; did you mean 'kp'?"),
        (lambda s: s.setup.set("servo.kp", -3), "a gain must be between 0 and"),
        (lambda s: s.setup.switch_loop("balanse", True), "did you mean 'balance'?"),
        (lambda s: s.set_pace(7).result(), "0.1 to 4 times as fast as the clock"),
        (lambda s: s.test(ELBOW, 0).result(), "a positive time [s]"),
        (lambda s: s.try_move({"walk": {"steps": 0.5}}).result(), "steps"),
        (lambda s: s.push("trunk", [1, 2]).result(), "force"),
        (lambda s: s.push("trunk", [1, 2, float("inf")]).result(), "force"),
        (lambda s: s.drag("trunk", [0, 0, 0], ["a", 0, 0]).result(), "targets"),
        (lambda s: s.arm.choose_branch(0).result(), "branch"),
        (lambda s: s.arm.run_line(0).result(), "index"),
        (lambda s: s.arm.add_line("move_j", "p1"), "there is no target 'p1'"),
    ],
)
def test_wrong_input_is_told_and_changes_nothing(teach, asked, told):
    session = teach()
    before = on_disk(session)
    assert not asked(session)
    assert told in str(session.message)
    assert session.message.wrong
    assert on_disk(session) == before
    assert not session.book.history.can_undo


def test_no_such_subject(tmp_path):
    for subject, told in [
        ("humanoyd", "did you mean 'humanoid'?"),
        ("a.urdf", "there is no such file"),
    ]:
        with pytest.raises(SimrobError, match=told.replace("?", r"\?")):
            Session.open(subject, tmp_path, live=CountingRun)


# Keeping


OPERATIONS = {
    "test": lambda s, n: tried(s, {"left_elbow": float(n)}),
    "add": lambda s, n: s.add(),
    "discard": lambda s, n: heard(s, s.discard()),
    "act": lambda s, n: heard(s, s.try_move({"act": "bow"})),
    "insert": lambda s, n: s.book.insert(
        min(n, len(s.book.program.moves)), {"target_deg": {"left_knee": n}}
    ),
    "edit": lambda s, n: s.book.edit(-1, {"target_deg": {"HomIF": n}}),
    "remove": lambda s, n: s.book.remove(0),
    "move": lambda s, n: s.book.move_entry(0, len(s.book.program.moves) - 1),
    "describe": lambda s, n: s.book.describe(f"{n}\u2028"),
    "reset": lambda s, n: heard(s, s.reset()),
    "simulate": lambda s, n: heard(s, s.simulate()),
    "note": lambda s, n: s.worker.note(set={"servo.kp": 100 + n}),
    "undo": lambda s, n: s.undo(),
    "redo": lambda s, n: s.redo(),
}


def state(session):
    return session.book.program, session.book.pending, session.book.settings, session.book.targets


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(OPERATIONS)), st.integers(0, 9)), max_size=12))
def test_all_that_is_done_is_in_the_file_and_can_be_undone(tmp_path_factory, operations):
    folder = tmp_path_factory.mktemp("taught")
    live = []
    session = Taught.open(
        "humanoid", folder, live=lambda tell: live.append(CountingRun(tell)) or live[-1]
    )
    session.runs = live
    session.hear()
    states = [state(session)]
    for name, number in operations:
        OPERATIONS[name](session, number)
        session.hear()
        assert on_disk(session).moves == session.book.program.moves
        assert on_disk(session).changes == session.book.program.changes
        states.append(state(session))
    now, steps = state(session), 0
    while session.undo():
        session.hear()
        assert state(session) in states
        steps += 1
    assert state(session) == states[0]
    for _ in range(steps):
        assert session.redo()
        session.hear()
    while session.undo():
        pass
    while state(session) != now and session.redo():
        pass
    assert state(session) == now
    session.close()
    again = Taught.open("humanoid", folder, live=CountingRun)
    assert state(again) == now
    again.close()


def test_a_session_is_taken_up_where_it_was_left(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    tried(session, KNEE)
    session.setup.set("servo.kp", 120)
    again = teach()
    assert state(again) == state(session)
    assert again.worker.asked("open")[0][1]["settings"] == {"servo.kp": 120}
    assert again.undo()
    assert not again.book.settings
    assert again.undo()
    assert not again.book.pending
    assert again.undo()
    assert len(again.book.pending) == 1
    assert not again.book.program.moves


@pytest.mark.parametrize("writes", [0, 1])
def test_a_kill_between_two_files_loses_nothing(teach, monkeypatch, writes):
    session = teach()
    tried(session, ELBOW)
    session.add()
    real, count = store.written_at_once, []

    def killed(file, text):
        if len(count) == writes:
            raise KeyboardInterrupt
        count.append(file)
        real(file, text)

    monkeypatch.setattr(store, "written_at_once", killed)
    with pytest.raises(KeyboardInterrupt):
        session.book.edit(0, {"target_deg": KNEE})
    monkeypatch.undo()
    again = teach()
    assert again.book.program.moves[0].target_deg == (KNEE if writes else ELBOW)
    assert on_disk(again).moves == again.book.program.moves
    assert again.undo()


def test_what_is_changed_by_hand_counts_and_can_be_undone(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    text = session.book.file.read_text()
    session.book.file.write_text(text.replace("30.0", "44.0"))
    again = teach()
    assert again.book.program.moves[0].target_deg == {"left_elbow": 44.0}
    assert again.undo()
    assert again.book.program.moves[0].target_deg == ELBOW


ANOTHERS = {"left_elbow": 44.0}


def changed_elsewhere(session):
    """Let another editor change the first move of a program, and the session notice."""
    text = session.book.file.read_text().replace("30.0", "44.0")
    assert "44.0" in text
    session.book.file.write_text(text)
    tried(session, KNEE)
    return text


def test_another_editors_change_is_not_overwritten(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    assert not session.book.conflict
    text = changed_elsewhere(session)
    assert session.book.conflict
    assert session.add()
    assert len(session.book.program.moves) == 2  # one can teach on
    assert session.exports.program().result() is None
    assert session.message.key == "conflict"
    assert session.book.file.read_text() == text
    again = teach()  # nor is anything lost by a kill
    assert [move.target_deg for move in again.book.program.moves] == [ANOTHERS]
    assert again.undo()
    assert [move.target_deg for move in again.book.program.moves] == [ELBOW, KNEE]
    assert on_disk(again).moves == again.book.program.moves


def test_another_editors_change_is_taken_and_can_be_undone(teach):
    session = teach()
    assert not session.take_theirs()
    tried(session, ELBOW)
    session.add()
    changed_elsewhere(session)
    session.add()
    assert session.take_theirs()
    assert not session.book.conflict
    assert [move.target_deg for move in session.book.program.moves] == [ANOTHERS]
    assert session.undo()
    assert [move.target_deg for move in session.book.program.moves] == [ELBOW, KNEE]
    assert on_disk(session).moves == session.book.program.moves
    assert session.redo()
    assert [move.target_deg for move in on_disk(session).moves] == [ANOTHERS]


def test_both_are_kept(teach):
    session = teach()
    assert not session.keep_both()
    tried(session, ELBOW)
    session.add()
    text, theirs = changed_elsewhere(session), session.book.file
    session.add()
    assert session.keep_both()
    assert not session.book.conflict
    assert str(session.message).startswith("program.yaml stays as the other program left it")
    assert theirs.read_text() == text
    assert session.book.file.name == "program-2.yaml"
    assert [move.target_deg for move in on_disk(session).moves] == [ELBOW, KNEE]
    session.book.remove(0)
    assert len(on_disk(session).moves) == 1
    assert theirs.read_text() == text


def test_what_another_editor_left_damaged_is_kept(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    session.book.file.write_text("moves: [")
    session.book.describe("mine")
    assert session.book.conflict
    assert session.message.key == "conflict"
    session.take_theirs()
    assert session.message.key == "damaged"
    assert (session.book.file.name, session.book.program.description) == ("program-2.yaml", "mine")
    assert session.book.file.with_name("program.yaml").read_text() == "moves: ["


def test_a_change_that_was_taken_back_or_a_file_that_is_gone_is_no_conflict(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    text = session.book.file.read_text()
    session.book.file.write_text("moves: []")
    session.book.describe("mine")
    assert session.message.key == "conflict"
    session.book.file.write_text(text.replace("\n", "\r\n"))
    session.book.describe("mine, too")
    assert not session.book.conflict
    assert str(session.message) == ""
    session.book.file.unlink()
    session.book.describe("again")
    assert not session.book.conflict
    assert len(on_disk(session).moves) == 1


@pytest.mark.parametrize("closed", [False, True])
def test_a_script_or_station_that_somebody_has_changed_is_put_aside(teach, closed):
    session = teach()
    session.book.insert(0, {"wait": 1.0})
    script = session.exports.script().result()
    session.book.insert(0, {"wait": 2.0})
    assert session.exports.script().result() == script  # nobody has touched it
    assert session.message.key == "exported"
    mine = script.read_text() + "print('mine')\n"
    script.write_text(mine)
    assert session.setup.set("servo.kp", 120)
    session.hear()
    station = session.book.store.station_file
    station.write_text("mine: 1\n")
    if closed:
        session = teach()
    assert session.setup.set("servo.kp", 130)
    assert closed or session.message.fills["kept"] == "program-station-edited-1.yaml"
    assert session.exports.script().result() == script
    assert session.message.key == "put_aside"
    assert script.with_name("program-edited-1.py").read_text() == mine
    assert "mine" not in script.read_text()
    assert station.with_name("program-station-edited-1.yaml").read_text() == "mine: 1\n"
    assert load_station(station).servo.kp == 130
    session.hear()
    assert session.setup.set("servo.kp", 140)
    assert len(list(station.parent.glob("*edited*"))) == 2


def test_a_damaged_file_is_kept_and_what_was_taught_goes_on(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    damaged = session.book.file.read_text()[:-20] + ": ["
    session.book.file.write_text(damaged)
    again = teach()
    assert again.message.key == "damaged"
    assert again.message.wrong
    assert "is not YAML" in str(again.message)
    assert session.book.file.read_text() == damaged
    assert again.book.file.name == "program-2.yaml"
    assert again.book.program.moves == session.book.program.moves
    assert again.book.history.can_undo
    again.book.describe("on and on")
    assert teach().book.program.description == "on and on"  # no third file
    again.book.file.write_text("moves: [{}]")
    third = teach()
    assert third.book.file.name == "program-3.yaml"
    assert again.book.file.read_text() == "moves: [{}]"


@pytest.mark.parametrize("text", ["", "0", "\n\n", "x\n9\n{}", 'x\n0\n{"pending": 3}', "\0" * 50])
def test_damaged_steps_leave_the_program(teach, text):
    session = teach()
    tried(session, ELBOW)
    session.add()
    session.book.store.steps_file.write_text(text)
    again = teach()
    assert again.book.program.moves == session.book.program.moves
    assert not again.book.history.can_undo
    assert again.book.remove(0)
    assert teach().book.history.can_undo


def test_a_program_can_be_what_is_opened(teach, tmp_path):
    own = tmp_path / "bows.yaml"
    Program(station="humanoid_dynamic", moves=[{"act": "bow"}]).save(own)
    session = teach(own)
    assert session.book.file == own
    assert len(session.book.program.moves) == 1
    Program(moves=[{"act": "bow"}]).save(own)
    with pytest.raises(SimrobError, match="station: missing"):
        teach(own)


def test_a_urdf_is_given_a_station_that_stays(teach, tmp_path, one_joint_urdf):
    files = []
    for folder in ("one", "two"):
        files.append(tmp_path / folder / "arm.urdf")
        files[-1].parent.mkdir()
        files[-1].write_text(one_joint_urdf)
    first = teach(files[0])
    assert tried(first, {"shoulder": 10}) is not None
    first.add()
    assert first.book.file == tmp_path / "arm" / "program.yaml"
    assert on_disk(first).station == "arm.yaml"
    packed = heard(first, first.exports.script())
    with ZipFile(packed) as content:
        content.extractall(tmp_path / "elsewhere")
    files[0].unlink()  # as on another computer
    script = tmp_path / "elsewhere" / "program" / "program.py"
    assert 'Path(__file__).with_name("program-station.yaml")' in script.read_text()
    script.write_text(script.read_text().partition("result.save(")[0])
    result = runpy.run_path(str(script))["result"]
    assert np.rad2deg(result["q_ref.shoulder"][-1]) == pytest.approx(10)
    files[0].write_text(one_joint_urdf)
    assert teach(files[1]).book.file == tmp_path / "arm-2" / "program.yaml"
    assert len(teach(files[0]).book.program.moves) == 1


def test_a_program_of_another_robot_is_kept(teach, tmp_path):
    other = tmp_path / "reach.yaml"
    Program(station="irb120_dynamic", moves=[{"move_j": {"targets": [0.3, 0, 0.5]}}]).save(other)
    kept = other.read_text()
    session = teach(program=other)
    assert session.message.key == "foreign"
    assert "move_j" in str(session.message)
    assert other.read_text() == kept
    assert session.book.file == tmp_path / "humanoid_dynamic" / "reach-2.yaml"
    assert not session.book.program.moves
    walk = tmp_path / "walk.yaml"
    Program(station="humanoid_dynamic", moves=[{"walk": {"steps": 4}}]).save(walk)
    assert teach("irb120", program=walk).message.key == "foreign"


def test_a_program_of_another_humanoid_is_taken_over(teach):
    session = teach()
    tried(session, {"HomIF": 30, "CadDF": 30})
    session.add()
    kept = session.book.file.read_text()
    for robot in ("roid1", "zjudancer"):
        other = teach(robot, program=session.book.file)
        assert other.message.key == "taken_over"
        assert not other.message.wrong
        assert other.book.program.moves == session.book.program.moves
        assert on_disk(other).station == f"{robot}_dynamic"
        other.book.remove(0)
        assert session.book.file.read_text() == kept


def test_a_program_of_ones_own_is_taught_where_it_lies(teach, tmp_path):
    own = tmp_path / "bows.yaml"
    Program(station="humanoid_dynamic", moves=[{"act": "bow"}]).save(own)
    session = teach(program=own)
    assert session.book.file == own
    assert session.message.key == ""
    tried(session, ELBOW)
    session.add()
    assert len(Program.load(own).moves) == 2
    assert Program.load(own).station == "humanoid_dynamic"


def test_robots_of_one_station_have_programs_of_their_own_and_arms_share_one(teach):
    for robot in ("roid1", "zjudancer"):
        session = teach("three_humanoids", robot=robot)
        tried(session, {"HomIF": 10})
        session.add()
        assert session.book.file.name == f"{robot}.yaml"
        assert on_disk(session).robot == robot
        assert len(session.book.program.moves) == 1
    for number, robot in enumerate(("left", "right")):
        session = teach("two_irb120", robot=robot)
        assert session.message.key == ""
        assert len(session.book.program.moves) == number
        assert session.book.insert(
            number, {"move_abs_j": {"targets_deg": [0, 0, 0, 0, 0, 0], "robot": robot}}
        )
        assert session.book.file.name == "program.yaml"


def test_a_full_disk_is_told_and_nothing_is_forgotten(teach):
    session, told = teach(), []
    session.listen(lambda topic: told.append(str(session.message)))
    session.book.file.parent.rename(session.book.file.parent.with_name("gone"))
    session.book.file.parent.write_text("in the way")
    tried(session, ELBOW)
    assert any("cannot be written: File exists" in message for message in told)
    assert session.book.pending
    session.book.describe("mine")
    assert session.message.wrong
    session.book.file.parent.unlink()
    assert session.add()
    assert str(session.message) == ""  # it is true no more
    assert len(on_disk(session).moves) == 1


def test_two_processes_do_not_teach_in_one_folder(teach, tmp_path):
    session = teach()
    with pytest.raises(SimrobError, match="another process is using this folder"):
        Session.open("humanoid", tmp_path, live=CountingRun)
    session.close()
    Session.open("humanoid", tmp_path, live=CountingRun).close()


# Changes while it runs


def test_changes_of_a_run_go_into_the_program(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    session.worker.held = True
    session.simulate()
    session.hear()
    session.worker.tick(0.5)
    session.worker.note(set={"servo.kp": 90})
    session.worker.note(drag={"at": "trunk", "targets": [[0, 0, 1]]})
    session.worker.note(drag={"at": "trunk", "targets": [[0, 0, 1], [0, 0, 2]]})  # it has gone on
    session.worker.tick(0.2)
    session.worker.note(push={"at": "trunk", "force": [1, 0, 0]})
    session.hear()
    told = [change.model_dump(mode="json") for change in on_disk(session).changes]
    assert [one["time"] for one in told] == [0.2, 0.5, 0.5]
    assert told[2]["drag"]["targets"] == [[0, 0, 1], [0, 0, 2]]
    session.worker.tick(0.5)
    session.worker.note(set={"servo.kp": 90})  # as it runs anew
    session.hear()
    assert len(session.book.program.changes) == 3
    assert session.undo()
    assert len(session.book.program.changes) == 2
    assert session.book.remove_change(0)
    assert len(session.book.program.changes) == 1
    assert session.book.edit_change(0, {"time": 0.1, "set": {"servo.kp": 80}})
    assert session.book.program.changes[0].set == {"servo.kp": 80}


def test_a_slider_that_is_moved_is_one_step(teach):
    session = teach()
    session.worker.held = True
    session.simulate()
    session.hear()
    for number in range(5):
        session.worker.tick(0.05 * number)
        session.worker.note(set={"servo.kp": 90 + number})
    session.hear()
    assert len(session.book.program.changes) == 5
    assert session.undo()
    assert not session.book.program.changes
    assert not session.book.history.can_undo


def test_changes_of_what_is_tried_wait_with_it(teach):
    session = teach()
    session.worker.held = True
    session.test(ELBOW)
    session.hear()
    session.worker.tick(0.4)
    session.worker.note(push={"at": "trunk", "force": [1, 0, 0]})
    session.worker.finish()
    session.hear()
    assert not session.book.program.changes
    session.add()
    assert [change.time for change in session.book.program.changes] == [0.4]
    session.test(KNEE)
    session.hear()
    session.worker.tick(1.4)
    session.worker.note(push={"at": "trunk", "force": [2, 0, 0]})
    session.worker.finish()
    session.hear()
    session.test({"HomIF": 3})  # runs anew, and nobody pushes
    session.hear()
    session.worker.finish()
    session.hear()
    session.add()
    assert [change.time for change in session.book.program.changes] == [0.4]


def test_a_change_elsewhere_than_the_program_leads_is_not_stored(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    session.book.insert(0, {"act": "bow"})  # which the robot has not done
    session.worker.held = True
    session.test(KNEE)
    session.hear()
    session.worker.note(set={"servo.kp": 90})
    session.hear()
    session.add()
    assert session.message.key == "not_stored"
    assert not session.book.program.changes


def test_gone_back_to(teach):
    session = teach()
    tried(session, ELBOW, 2.0)
    session.add()
    heard(session, session.rewind(0.5))
    assert session.run.time == 0.5
    heard(session, session.go_on())
    assert session.run.time == 2.0
    session.rewind(0.5)
    session.hear()
    tried(session, KNEE)  # from there: no more what the program would do
    session.worker.note(set={"servo.kp": 90})
    session.hear()
    assert session.message.key == "not_stored"


def test_rapid_tests_wait_for_the_way_back(teach, monkeypatch):
    """A second test slips in while the first one's way back is not answered yet: it is run once, from the start."""
    session = teach()
    tried(session, ELBOW)
    call, held = session.worker.call, []

    def slowly(method, /, **arguments):
        answer = call(method, **arguments)
        if method != "rewind":
            return answer
        late = Future()
        held.append(lambda: late.set_result(answer.result()))
        return late

    monkeypatch.setattr(session.worker, "call", slowly)
    first = session.test({"left_elbow": 20.0})
    second = session.test({"left_elbow": 10.0})
    session.hear()
    assert len(session.worker.asked("do")) == 1  # neither yet
    while held:
        held.pop(0)()
        session.hear()
        session.hear()
    assert first.done()
    assert second.done()
    assert [moves["moves"][0]["target_deg"] for _, moves in session.worker.asked("do")] == [
        ELBOW,
        {"left_elbow": 10.0},
    ]
    assert (session.phase, session.run.time) == ("idle", 1.0)


def test_going_on_where_nothing_is_left_to_run_ends(teach):
    session = teach()
    session.worker.held = True
    session.run.rewound = True  # the run has gone on meanwhile
    session.go_on()
    session.hear()
    assert session.phase == "idle"


def test_gone_back_to_in_a_pause(teach):
    session = teach()
    session.worker.held = True
    session.test(ELBOW, 2.0)
    session.hear()
    session.worker.tick(1.0)
    session.worker.tell({"news": "phase", "phase": "paused"})
    session.rewind(0.5)
    session.hear()
    assert session.run.time == 0.5
    session.go_on()
    session.worker.finish()
    session.hear()
    assert session.run.time == 2.0


# The run and who listens


def test_a_killed_run_is_started_again(teach):
    session = teach()
    heard(session, session.set_pace(2.0))
    session.watch(["position"], "tab")
    tried(session, ELBOW)
    session.add()
    session.worker.held = True
    session.worker._stop = lambda: None  # it is killed before it can
    tested = session.test(KNEE)
    asked = session.simulate()  # waits until that is ended
    before = state(session)
    session.worker.die()
    session.hear()
    assert session.message.key == "died"
    assert "killed by signal 9" in str(session.message)
    assert len(session.runs) == 2
    assert session.runs[0].closed
    assert tested.result() is None
    assert asked.result() is None
    assert state(session) == before  # and what was being tested is still there
    assert on_disk(session).moves == session.book.program.moves
    assert session.worker.asked("pace", "watch") == [
        ("pace", {"factor": 2.0}),
        ("watch", {"signals": ["position"]}),
    ]
    session.hear()
    assert session.phase == "idle"
    session.runs[0].tick(77.0)  # what an old run still tells
    session.hear()
    assert session.run.time == 1.0  # where the old one was
    assert heard(session, session.simulate()) is not None


def test_a_tab_that_leaves_while_there_is_no_run_hides_no_message(teach):
    session = teach()
    session.watch(["position"], "tab")

    def leave(_):
        forget()
        session.watch((), "tab")

    forget = session.listen(leave)
    session.worker.die()
    session.hear()
    assert session.message.key == "died"


def test_a_run_that_dies_again_and_again_is_left_alone(teach):
    session = teach()
    for _ in range(run_client._DEATHS + 1):
        session.worker.die()
        session.hear()
        session.hear()
    assert session.message.key == "lost"
    assert session.phase == "gone"
    count = len(session.runs)
    asked = session.simulate()  # asked for again it is tried again
    session.hear()
    assert len(session.runs) == count + 1
    assert heard(session, asked) is not None


def test_a_station_that_cannot_be_opened_leaves_the_program(teach):
    session = teach()
    tried(session, ELBOW)
    session.add()
    session.worker.refused = "open"
    assert session.setup.set("servo.kp", 130)
    session.hear()
    assert str(session.message) == "open cannot be"
    assert session.phase == "idle"
    assert session.book.settings == {}
    assert len(session.book.program.moves) == 1


def test_what_waits_for_an_opening_that_fails_is_answered(teach, monkeypatch):
    monkeypatch.setattr(CountingRun, "refused", "open")
    session = teach()
    assert session.phase == "gone"
    for ask in (lambda: session.test(ELBOW), session.simulate):
        asked = ask()  # tries to open it once more
        session.hear()
        assert (session.phase, str(session.message)) == ("gone", "open cannot be")
        assert asked.result(timeout=0) is None


def test_tabs_hear_of_changes_until_they_forget(teach):
    session, heard_by = teach(), {"one": [], "two": []}
    forget = session.listen(heard_by["one"].append)
    session.listen(heard_by["two"].append)
    views = []
    session.listen_to_view(lambda subject, commands: views.append((subject, commands)))
    session.worker.tell({"news": "view", "subject": "poses", "commands": [1]})
    session.book.describe("heard")
    session.hear()
    assert heard_by["one"] == heard_by["two"] == ["program"]
    assert views[0] == ("poses", [1])
    forget()
    forget()
    session.book.describe("no more")
    assert len(heard_by["one"]) == 1
    assert len(heard_by["two"]) == 2


def test_tabs_watch_what_each_wants(teach):
    session = teach()
    session.watch(["position", "torque"], "one")
    session.watch(["position", "base_pose"], "two")
    assert session.worker.asked("watch")[-1][1] == {"signals": ["position", "torque", "base_pose"]}
    for number in range(3000):
        session.worker.tick(number * 0.05, position=[number], torque=[0.0])
    session.hear()
    assert session.run.values["position"] == [2999]
    assert len(session.run.history["position"]) == 2400
    session.watch([], "one")
    assert list(session.run.history) == ["position", "base_pose"]
    assert len(session.run.history["position"]) == 2400


def test_news_of_another_thread_are_handed_over(tmp_path):
    handed, runs = [], []
    session = Session.open(
        "humanoid",
        tmp_path,
        live=lambda tell: runs.append(CountingRun(tell)) or runs[0],
        hand_over=handed.append,
    )
    while handed:
        handed.pop(0)()
    telling = Thread(target=partial(runs[0].tick, 1.25))
    telling.start()
    telling.join()
    assert session.run.time == 0.0  # until the page's thread takes it
    handed.pop(0)()
    assert session.run.time == 1.25
    session.close()


@pytest.mark.long
def test_five_hundred_runs_leave_no_more_than_the_rings(teach):
    session = teach()
    session.watch(["position"])
    for number in range(500):
        tried(session, {"left_elbow": float(number % 90)})
        session.worker.tick(number, position=[0.0] * 20)
        session.add() if number % 2 else heard(session, session.discard())
        session.worker.calls.clear()
        if number % 50 == 0:
            session.reset()
            session.hear()
    kept = session.book.history._steps
    assert len(kept) <= MOST_STEPS
    assert sum(len(text) for _, text in kept) < 2e6
    assert len(session.run.moves._entries) <= 60


# The station


def test_settings_open_the_station_anew_and_can_be_undone(teach):
    session = teach()
    assert session.setup.set("servo.kp", 120)
    assert session.setup.value("servo.kp") == 120
    session.hear()
    assert session.worker.asked("open")[-1][1]["settings"] == {"servo.kp": 120}
    assert session.phase == "idle"
    program = on_disk(session)
    assert load_station(session.book.file.parent / program.station).servo.kp == 120
    assert session.undo()
    assert session.book.settings == {}
    session.hear()
    assert session.worker.asked("open")[-1][1]["settings"] == {}
    assert on_disk(session).station == "humanoid_dynamic"
    session.redo()
    assert session.setup.unset("servo.kp")
    assert session.setup.value("servo.kp") != 120
    session.hear()
    session.worker.held = True
    session.simulate()
    session.hear()
    assert not session.setup.set("servo.kp", 130)
    assert session.message.key == "busy"


def test_loops_are_switched(teach):
    session = teach()
    loops = {loop["name"]: loop["on"] for loop in session.description["loops"]}
    assert loops["height"] is False
    assert loops["balance"] is False
    assert session.setup.switch_loop("height", True)
    assert (
        session.book.config.controllers["height"]
        == load_station("humanoid_height").controllers["height"]
    )
    session.hear()
    assert {"name": "height", "on": True} in session.description["loops"]
    assert session.setup.switch_loop("height", False)
    assert not session.book.config.controllers
    assert not session.book.settings
    own = teach("humanoid_height")
    assert own.setup.switch_loop("height", False)
    assert not own.book.config.controllers
    assert own.setup.switch_loop("height", True)
    assert own.book.settings == {}


def test_no_setting_brings_code_along(teach):
    session = teach("irb120")
    own = {"kind": "own", "class": "os:System"}
    assert not session.setup.set("controllers.mine", own)
    assert "allow_code=True" in str(session.message)
    with pytest.raises(SimrobError, match="allow_code=True"):
        with_settings(session.book.config, {"controllers.mine": own})


@pytest.mark.parametrize("robot", ["ur5", "puma560", "yobotics", "double_pendulum"])
def test_every_robot_has_a_station(teach, robot):
    session = teach(robot)
    assert session.book.model.name == robot
    assert Path(session.book.file).is_file()


def test_a_station_without_robots(teach):
    session = teach("bouncing_ball")
    assert session.book.robot == ""
    assert session.message.key == ""
    assert tried(session, ELBOW) is None
    assert session.message.wrong
    assert heard(session, session.simulate()) is not None


def drivable(session):
    """Let the robot be one that can be driven, hold its run, and return that."""
    limits = {"ahead": 0.2, "backward": 0.1, "sideways": 0.0, "turn_deg": 20.0, "facing_deg": 0.0}
    session.client.description["robots"][session.book.robot]["drives"] = limits
    session.worker.held = True
    return session.worker


def test_one_tab_drives_and_others_are_not_heard(teach):
    session = teach()
    run = drivable(session)
    session.driving.begin("mine")
    session.hear()
    session.driving.command("mine", 0.5, 0, -1)
    session.driving.command("another", 1, 0, 0)
    assert session.driving.begin("another").result() is None
    assert str(session.message) == "Another tab drives the robot"
    session.driving.end("another")
    assert not run.asked("stop")
    session.driving.end("mine")
    session.hear()
    asked = [arguments for _, arguments in run.asked("steer")]
    assert [(one["ahead"], one["turn_deg"]) for one in asked] == [(0.1, -20.0), (0.0, 0.0)]
    assert session.driving.driver is None
    session.driving.command("mine", 1, 0, 0)  # which drives no more
    assert len(run.asked("steer")) == 2


def test_what_is_asked_by_hand_is_within_what_the_legs_can(teach):
    session = teach()
    drivable(session)
    session.driving.begin("mine")
    session.hear()
    for parts, speeds in (((-1, 1, 0), (-0.1, 0.0, 0.0)), ((9, 0, 9), (0.2, 0.0, 20.0))):
        session.driving.command("mine", *parts)
        assert session.driving.asked == speeds


def test_a_robot_without_a_walk_is_not_driven_and_no_pace_beyond_the_clock_s(teach):
    session = teach()
    assert session.driving.begin("mine").result() is None
    assert str(session.message) == "This robot has no walk by commands in this station"
    run = drivable(session)
    session.set_pace(None)
    session.driving.begin("mine")
    assert session.client.pace == 1.0
    assert run.asked("do")[0][1]["moves"] == [{"go": {"duration": 600.0}}]


def test_who_is_not_where_the_program_leads_does_not_drive(teach):
    """What was asked for would not be in the program, and the walk that is added not the one that was driven."""
    session = teach()
    tried(session, ELBOW)
    session.add()
    heard(session, session.restart())
    drivable(session).held = False
    assert session.driving.begin("mine").done()
    assert session.driving.driver is None
    assert "simulate the program first" in str(session.message)
    heard(session, session.simulate())
    session.driving.begin("mine")
    assert session.driving.driver == "mine"


def test_what_is_tested_after_a_drive_finds_it_as_long_as_it_was(teach):
    session = teach()
    run = drivable(session)
    session.driving.begin("mine")
    session.hear()
    run.tick(4.0)
    session.test({"left_elbow": 30}, 1.0)  # which waits
    session.driving.end("mine")
    for _ in range(3):
        session.hear()
    assert [move.duration for move in session.book.history.present.pending] == [4.0, 1.0]
    assert [arguments["moves"] for _, arguments in run.asked("do")][1:] == [
        [{"target_deg": {"left_elbow": 30.0}, "duration": 1.0}]
    ]
    assert not run.asked("rewind")


def test_a_move_that_a_walk_overrules_is_refused_before_it_is_tried(teach):
    """Of a walking robot, a shoulder that was asked for 60 degrees ended at 6: the walk sets all joints."""
    session = teach("humanoid_walking")
    assert session.book.overruling_loop() == "walk"
    assert tried(session, {"right_shoulder_pitch": 60}, 1.0) is None
    told = str(session.message)
    assert "right_shoulder_pitch: controllers.walk sets all joints of the robot" in told
    assert "turn it off under Outer loops" in told
    assert not session.worker.asked("do")
    # Without the walk, the move is tried.
    assert session.setup.switch_loop("walk", False)
    assert session.book.overruling_loop() == ""
    assert tried(session, {"right_shoulder_pitch": 60}, 1.0) is not None


@pytest.mark.parametrize("name", ["humanoid_balance", "humanoid_fall_guard", "humanoid_sequencer"])
def test_loops_that_do_not_always_set_the_reference_overrule_no_moves(teach, name):
    assert teach(name).book.overruling_loop() == ""


def test_an_angle_typed_during_a_jog_leaves_the_targets_of_other_axes(teach):
    """The second jog stopped the first one on its way, and its axis silently stayed there."""
    session = teach("irb120")
    session.worker.held = True

    session.arm.jog_axes({"joint_1": -40})
    session.hear()
    session.arm.jog_axes({"joint_3": 30})
    session.worker.finish("stopped")
    session.hear()
    session.worker.finish()
    session.hear()
    session.arm.jog_axes({"joint_5": 10})

    asked = [arguments["targets_deg"] for _, arguments in session.worker.asked("jog")]
    assert asked == [{"joint_1": -40}, {"joint_1": -40, "joint_3": 30}, {"joint_5": 10}]


def test_a_jog_is_not_compared_with_what_comes_next(teach):
    session = teach()
    run = session.run
    session.test(ELBOW)
    session.hear()
    session.add()
    session.simulate()
    session.hear()
    session.arm.jog_axes({"left_elbow": 5})
    session.hear()
    assert [ended.kind for ended in run.ended] == ["tried", "program", "free"]

    run.compare_last()

    assert run.compared is run.ended[1]
