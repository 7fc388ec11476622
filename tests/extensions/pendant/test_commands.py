"""Commands in any order, however late their answers come: the program is as asked, and nothing hangs."""

import time
from concurrent.futures import Future
from contextlib import nullcontext

import pytest
from fake_runs import CountingRun
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simrob_drake.extensions.pendant.move_runner import Commands
from simrob_drake.extensions.pendant.run_client import RunClient
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.extensions.pendant.store import History, Taught

PATIENCE = 60.0  # s, for an answer


class Model:
    """What is taught by commands that are done one after the other; who runs what, and when, is nothing to it."""

    def __init__(self):
        self.history = History(Taught())

    @property
    def state(self):
        now = self.history.present
        return [move.entry() for move in now.program.moves], [move.entry() for move in now.pending]


def late(session):
    """Return the run of a session, which goes on until it is ended."""
    session.runs[-1].held = True
    return session.runs[-1]


def tick(session, number):
    """Let a run go on, if there is one that was not gone back in, which pauses it."""
    run = late(session)
    if run.running is not None and not run.back and run.time + 0.05 * number < run.end:
        run.tick(round(run.time + 0.05 * number, 9))


def finish(session):
    if late(session).running is not None:
        late(session).finish()


COMMANDS = {
    "test": lambda s, n: s.test({"left_elbow": float(n)}),
    "act": lambda s, n: s.try_move({"act": "bow"}),
    "discard": lambda s, n: s.discard(),
    "reset": lambda s, n: s.reset(),
    "simulate": lambda s, n: s.simulate(),
    "restart": lambda s, n: s.restart(),
    "stop": lambda s, n: s.stop(),
    "pause": lambda s, n: s.pause(),
    "go_on": lambda s, n: s.go_on(),
    "rewind": lambda s, n: s.rewind(s.run.reach * n / 9),
    "save": lambda s, n: s.exports.csv(),
    "add": lambda s, n: s.add(),
    "undo": lambda s, n: s.undo(),
    "redo": lambda s, n: s.redo(),
    "hear": lambda s, n: s.hear(),
    "tick": tick,
    "finish": lambda s, n: finish(s),
    "die": lambda s, n: late(s).die() if n == 9 else None,
}
TAUGHT = {"test", "act", "discard", "reset", "add", "undo", "redo"}
"""What of these changes what is taught; in a session in which all has time to be done, it is what the model has."""


def opened(folder):
    runs = []
    session = Session.open(
        "humanoid", folder, live=lambda tell: runs.append(CountingRun(tell)) or runs[-1]
    )
    session.runs = runs
    session.hear()
    return session


def settle(session):
    """Let all that is asked for be done."""
    for _ in range(100):
        session.hear()
        finish(session)
    session.hear()


def check_interleaving(folder, commands):
    """What is taught does not depend on when answers come; in the end all is answered, the robot where it is said."""
    slow, model, asked = opened(folder / "slow"), opened(folder / "model"), []
    for name, number in commands:
        late(slow)
        asked.append(COMMANDS[name](slow, number))
        if name in TAUGHT:
            COMMANDS[name](model, number)
            settle(model)
            assert (slow.book.program, slow.book.pending) == (
                model.book.program,
                model.book.pending,
            ), name
    settle(slow)
    assert slow.phase == "idle"
    assert all(one.done() for one in asked if hasattr(one, "done"))
    assert slow.run.start == pytest.approx(slow.runs[-1].time)
    assert slow.run.start <= slow.run.reach + 1e-9
    slow.close()
    model.close()


INTERLEAVED = st.lists(st.tuples(st.sampled_from(sorted(COMMANDS)), st.integers(0, 9)), max_size=25)


@settings(max_examples=15, deadline=None)
@given(INTERLEAVED)
@example(
    [("act", 0), ("rewind", 0), ("act", 0), ("add", 0)]
)  # it goes on before the way back is answered
@example([("act", 0), ("finish", 0), ("die", 9)])
@example([("act", 0), ("discard", 0), ("hear", 0), ("go_on", 0), ("act", 0)])
@example(
    [("act", 0), ("rewind", 0), ("simulate", 0), ("act", 0), ("add", 0)]
)  # and after it was stopped, too
def test_commands_in_any_order(tmp_path_factory, commands):
    check_interleaving(tmp_path_factory.mktemp("commands"), commands)


@pytest.mark.long
@settings(max_examples=200, deadline=None)
@given(INTERLEAVED)
def test_two_hundred_orders_of_commands(tmp_path_factory, commands):
    check_interleaving(tmp_path_factory.mktemp("commands"), commands)


@pytest.mark.parametrize("how", ["fails", "left", "cancelled", "done"])
def test_what_waited_is_answered_however_it_ends(how):
    client, begun = RunClient(), Future()
    commands = Commands(client)

    def begin():
        if how == "fails":
            raise ValueError("not so")
        return begun

    answer, after = commands.queued("first", begin), commands.queued("second", lambda: begun)
    if how == "left":
        assert answer.cancel()
        commands.forget("first")
    with pytest.raises(ValueError, match="not so") if how == "fails" else nullcontext():
        commands.set_phase("idle")
    commands.set_phase("idle")
    assert begun.cancel() if how == "cancelled" else begun.set_result(3) is None
    assert [answer.done(), after.done(), commands.waiting] == [True, True, {}]
    if how == "done":
        assert answer.result() == 3


def test_a_test_that_takes_the_place_of_one_not_begun_runs_from_where_that_would_have(tmp_path):
    session = opened(tmp_path)
    late(session)
    session.test({"left_elbow": 1.0}, 1.0)
    session.hear()
    tick(session, 4)
    session.hear()
    others = [lambda: session.rewind(0.1), lambda: session.test({"left_elbow": 3.0}, 1.0)]

    def interfere(_):
        if session.phase == "rewinding" and others:
            others.pop(0)()

    session.listen(interfere)
    session.test({"left_elbow": 2.0}, 1.0)  # stops the first, then goes back to its start
    settle(session)
    assert not others
    assert session.run.start == pytest.approx(1.0)
    session.close()


def test_a_way_back_that_waited_comes_after_the_test_that_was_begun(tmp_path):
    session = opened(tmp_path)
    late(session)
    session.test({"left_elbow": 1.0}, 1.0)
    session.hear()
    tick(session, 4)
    session.hear()
    session.test({"left_elbow": 2.0}, 1.0)  # stops the first, then goes back to its start
    session.listen(
        lambda _: session.phase == "rewinding" and not asked and asked.append(session.rewind(0.1))
    )
    asked = []
    session.hear()
    session.hear()
    assert asked
    assert [(name, how.get("time")) for name, how in late(session).asked("do", "rewind")] == [
        ("do", None),
        ("rewind", 0.0),
        ("do", None),
        ("rewind", 0.1),
    ]
    session.close()


def test_nothing_is_shown_behind_what_was_run(tmp_path):
    session = opened(tmp_path)
    session.rewind(0.05)  # the least that a slider can be dragged
    settle(session)
    assert (session.run.time, session.run.reach) == (0.0, 0.0)
    session.close()


def rapid_tests(folder, count):
    """Test moves of a real run in quick succession, at any moment of the one before; none hangs."""
    session = Session.open("irb120_kinematic", folder)
    try:
        session.set_pace(None)
        asked = []
        for number in range(count):
            asked.append(session.test({"joint_1": float(number % 40), "joint_2": 5.0}, 0.3))
            if number % 7 == 0:
                asked.append(session.rewind(session.run.reach * (number % 5) / 5))
            session.hear((number * 37 % 100) / 4000)
        end = time.monotonic() + PATIENCE
        while not all(one.done() for one in asked) or session.phase != "idle":
            assert time.monotonic() < end, f"{session.phase}: {session.message}"
            session.hear(0.05)
        assert session.run.reach == pytest.approx(0.3)
        assert session.message.wrong is False, session.message
        assert len(session.book.pending) == 1
    finally:
        session.close()


def test_rapid_tests_do_not_hang(tmp_path):
    rapid_tests(tmp_path, 30)


@pytest.mark.long
def test_five_hundred_rapid_tests_do_not_hang(tmp_path):
    rapid_tests(tmp_path, 500)
