"""The pushes and pulls on the bodies of a station during a run, to name the one before which a robot fell.

A *push* is a force that the station applies to a body for a while. A *pull* is the force of a spring that drags a body
after a target (`Drag`). A *program* is a sequence of runs that follow each other, recorded as one run with ``runs``.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from simrob_drake.base.messages import Message, message
from simrob_drake.parts.forces import Drag, Push

Run: TypeAlias = Any
"""A `RecordedRun`. Its module imports this one, so the class cannot be named here."""

LONGEST_FALL = 5.0
"""Longest time from a disturbance to a fall that is put down to it [s]. A robot that stumbles for longer than this
walks or stands again."""

_ROUNDING = 1e-6
"""Times that differ by at most this are equal [s]."""


class Disturbance(NamedTuple):
    """A push or a pull on a body.

    Attributes:
        begin: when it began, in the time of the whole run [s].
        end: when it ends, in the time of the whole run [s].
        text: what it is, in words, such as "the push of 60 N on trunk".
    """

    begin: float
    end: float
    text: Message


class _SingleRun(NamedTuple):
    """One of the runs that follow each other in a program.

    Attributes:
        run: the run.
        shift: time of the whole program at the run's time zero [s].
    """

    run: Run
    shift: float


def last_disturbance(run: Run) -> Disturbance | None:
    """Find the push or pull that began last before the end of a run. Returns None if there is none.

    A program cuts a push where another change begins. Its parts count as one push, which began with the first part.

    Args:
        run: a single run or a program.
    """
    known = dict[str, Disturbance]()  # the latest of each name
    # The time of a program begins at 0. That of a single run is absolute: it may begin later.
    for single in _single_runs(run, 0.0 if run.runs else run.start_time):
        for name, found in _disturbances_of(single):
            before = known.get(name)
            begins_with_run = found.begin <= single.shift + single.run.start_time + _ROUNDING
            continues = (
                before is not None and begins_with_run and before.end >= found.begin - _ROUNDING
            )
            # The rest of a push that a program has cut: the push began with its first part.
            begin = before.begin if before is not None and continues else found.begin
            known[name] = found._replace(begin=begin)
    return max(known.values(), key=lambda disturbance: disturbance.begin, default=None)


def _single_runs(run: Run, begin: float) -> Iterator[_SingleRun]:
    """Yield the runs that a program consists of, also those of a move that changes have cut.

    Args:
        run: a program or a single run.
        begin: time of the whole program at which it begins [s].
    """
    if not run.runs:
        yield _SingleRun(run, begin - run.start_time)
        return
    for part in run.runs:
        yield from _single_runs(part, begin)
        begin += part.simulated_time


def _disturbances_of(single: _SingleRun) -> Iterator[tuple[str, Disturbance]]:
    """Yield the pushes and pulls that begin before the end of a run, each after its name in the configuration."""
    config = single.run.config
    for name, force in config.forces.items():
        # Forces of other kinds, such as a sine, are no events with a begin.
        if not isinstance(force, Push | Drag) or force.start >= single.run.stop_time:
            continue
        # Without the key `at`, a force acts on the only robot.
        body = force.at or config.only_robot or name
        if isinstance(force, Push):
            size = float(np.linalg.norm(force.force))
            text = message(
                "results.push_on", "the push of {size:.3g} N on {body}", size=size, body=body
            )
        else:
            text = message("results.pull_on", "the pull on {body}", body=body)
        yield name, Disturbance(single.shift + force.start, single.shift + force.end, text)
