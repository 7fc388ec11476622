"""The timeline below the view: how long moves take, where a run is, and moves that are dragged elsewhere."""

import asyncio

import pytest

pytest.importorskip("nicegui", reason="needs the extra gui")
from legs_session import LegsSession
from nicegui import ui
from nicegui.testing import user_simulation

from simrob_drake.extensions.pendant.pages.move_list import (
    ProgramTimeline,
    durations_of,
    position_in,
)
from simrob_drake.extensions.pendant.pages.words import words
from simrob_drake.programs.moves.kinds import check_move

ELBOW, WALK = {"target_deg": {"left_elbow": 30.0}, "duration": 2.0}, {"walk": {"steps": 2}}
TAKE = {"attach": {"piece": "box"}}


def done(*moves):
    """Moves as a run reports them: each after the one before, with its duration [s]."""
    begin, found = 0.0, []
    for move, duration in moves:
        found.append({"entry": check_move(move).entry(), "begin": begin, "end": begin + duration})
        begin += duration
    return found


def test_durations_are_those_of_the_last_run_up_to_the_first_other_move():
    moves = [check_move(one) for one in (ELBOW, TAKE, WALK)]
    ran = done((ELBOW, 2.05), (TAKE, 0.0), (WALK, 3.6))
    assert durations_of(moves, ()) == [2.0, 0.0, None]
    assert durations_of(moves, ran) == pytest.approx([2.05, 0.0, 3.6])
    assert durations_of(moves[:1], ran) == [2.05]
    assert durations_of(moves[1:], ran) == [0.0, None], (
        "another program, which begins with another move"
    )
    assert durations_of(moves, done((ELBOW, 0.7))) == [0.7, 0.0, None], (
        "one that fell in the first move"
    )


def test_two_joint_moves_that_are_one_run_have_a_block_each():
    moves = [
        check_move({"target_deg": {"left_elbow": angle}, "duration": 1.0}) for angle in (30.0, 0.0)
    ]
    durations = durations_of(moves, done(*((move.entry(), 1.0) for move in moves)))
    assert durations == [1.0, 1.0]
    assert position_in(1.4, durations) == (1, pytest.approx(0.4))


@pytest.mark.parametrize(
    ("time", "place"),
    [(0.0, (0, 0.0)), (1.5, (0, 0.75)), (2.0, (2, 0.0)), (3.0, (2, 0.25)), (6.0, None)],
)
def test_a_run_is_in_the_move_that_takes_its_time(time, place):
    assert position_in(time, [2.0, 0.0, 4.0]) == place


def test_in_a_move_of_unknown_length_it_stays_at_its_beginning():
    assert position_in(9.0, [2.0, None, 4.0]) == (1, 0.0)


def test_blocks_show_where_the_run_is_and_lead_back_to_where_they_began():
    session = LegsSession(moves=[ELBOW, WALK, ELBOW])

    async def run():
        async with user_simulation(lambda: ProgramTimeline(session, words("en"))) as user:
            await user.open("/")
            blocks = sorted(
                (one for one in user.find(ui.element).elements if "pendant-block" in one.classes),
                key=lambda one: one.props["data-move"],
            )
            assert blocks[0].props["title"] == "1. left elbow: fore-arm up 30° in 2 s · 2 s"
            session.run.kind = "program"
            session.run.take(1.5, None, {})
            session.told("tick")
            await asyncio.sleep(0.05)
            assert [("now" in one.classes) for one in blocks] == [True, False, False]
            assert blocks[0].style["--at"] == "75.0%"
            ran = done((ELBOW, 2.0), (WALK, 3.5), (ELBOW, 2.0))
            ending = {"moves": ran, "reached": 7.5, "time": 7.5, "begun": 0.0}
            ending |= {"ending": "completed", "signals": None}
            session.run.end(ending)
            session.run.time = 6.5
            session.told("phase")
            await asyncio.sleep(0.05)
            with user:
                blocks = [
                    one
                    for one in ui.context.client.elements.values()
                    if "pendant-block" in one.classes
                ]
            assert [one.style["flex-grow"] for one in blocks] == ["2.000", "3.500", "2.000"]
            assert blocks[2].style["--at"] == "50.0%"
            timeline = blocks[0].parent_slot.parent
            (drop,) = [one for one in timeline._event_listeners.values() if one.type == "drop"]
            timeline._handle_event({"listener_id": drop.id, "args": [2, 0]})
            assert [move.entry() for move in session.program.moves] == [
                ELBOW,
                ELBOW,
                check_move(WALK).entry(),
            ]
            (down,) = [
                one for one in timeline._event_listeners.values() if one.type == "pointerdown"
            ]
            for seconds, duration in ((3.1234, 3.1), (-1.0, 0.05)):
                timeline._handle_event({"listener_id": down.id, "args": [0, seconds]})
                assert session.program.moves[0].entry() == {**ELBOW, "duration": duration}
            with user:
                edges = [
                    one
                    for one in ui.context.client.elements.values()
                    if "pendant-edge" in one.classes
                ]
            assert len(edges) == 2, "a walk takes as long as its steps"

    asyncio.run(run())
