"""When something happens in a run: by closed forms, and by what the run itself says."""

from itertools import pairwise

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.results.record.run import events_of
from simrob_drake.results.record.touch import _touch_in_words
from simrob_drake.results.result import join_runs


@pytest.fixture(scope="module")
def ball():
    return simulate(load_station("bouncing_ball"), duration=1.0, progress=False)


def test_contacts_of_several_times_are_each_of_its_own(ball):
    """Contact results of a call for several times are independent of each other."""
    times = np.array([0.0, 0.19, 0.3])
    together = [len(Contacts.of(results).pairs) for results in list(ball.contacts_at(times))]

    alone = [len(Contacts.of(next(ball.contacts_at(times[k : k + 1]))).pairs) for k in range(3)]

    assert together == alone == [0, 1, 0]


def test_a_ball_touches_when_it_has_fallen(ball):
    """The first contact is at the time of the free fall, sqrt(2 h / g), within one step."""
    events = events_of(ball)

    assert [text for _, text in events] == [
        "start",
        "ball touches the ground",
        "ball touches the ground",
        "ball touches the ground",
        "end",
    ]
    fall = np.sqrt(2 * 0.1 / 9.81)
    step = np.diff(ball.step_times).max()
    assert fall <= events[1][0] <= fall + step

    heights = ball.piece_pose("ball")[:, 2]
    for time, _ in events[1:4]:
        assert np.interp(time, ball.times, heights) < 0.06  # its radius
        assert np.interp(time - 2 * step, ball.times, heights) > 0.06


@pytest.mark.parametrize(
    ("pair", "sentence"),
    [
        ({"box", "world"}, "box touches the ground"),
        ({"box", "table"}, "box touches table"),
        # two robots of the same model have links of the same names
        ({"link_6"}, "link_6 touches link_6"),
    ],
)
def test_a_contact_names_both_bodies_or_the_ground(pair, sentence):
    """A contact with the world is one with the ground; equal names of two bodies are written twice."""
    assert _touch_in_words(frozenset(pair)) == sentence


def test_runs_that_follow_each_other_end_moves(ball):
    """A program has an event at the end of each run, and one end."""
    events = events_of(join_runs([ball, ball]))

    assert (1.0, "move ends") in events
    assert events[-1] == (2.0, "end")
    assert len(events) == 9


def test_a_monitor_s_stop_is_named():
    """The last event of a run that a monitor ended has the name of the monitor."""
    stopped = simulate(load_station("irb120_force_stop"), progress=False)
    assert events_of(stopped)[-1] == (stopped.stop_time, "stopped: stop")


@pytest.mark.long
def test_the_feet_of_a_walk_touch_in_turn():
    """Left and right feet touch alternately once the walk has begun."""
    walk = LeggedRobot("roid1_dynamic").walk(4)
    feet = [text.split("_")[0] for time, text in events_of(walk)[1:-1] if time > 1]

    assert len(feet) >= 4
    assert all(one != other for one, other in pairwise(feet))
