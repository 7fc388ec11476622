"""What happens in a run or a program, and when: for pictures at those moments, and as a table."""

from collections.abc import Iterator

import numpy as np
from pydrake.geometry import GeometryId

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.results.record.run import RecordedRun, begins_of

_LOOKS = 4000  # at most so many steps of a run are asked what touches what
_APART = 0.1  # s that two bodies are apart before they touch again: what trembles touches once
_TOGETHER = 0.01  # part of the whole time in which two events are one
_MOST = 24  # of those that a picture has room for

Event = tuple[float, str]  # when [s], and what in a few words


def all_events(result: RecordedRun) -> list[Event]:
    """Return what happens in a run: its start, contacts that begin and its end; in a program, what is between, too.

    That is the ends of its runs, and what is attached and let go after them.
    """
    found = [(0.0, "start"), *result.marks]
    for begin, run in zip(begins_of(*result.parts), result.parts, strict=False):
        found += [(float(begin + time), text) for time, text in _contacts(run)]
    stopped = f"stopped: {result.stopped_by}" if result.ending == "monitor" else "end"
    return [*sorted(found, key=lambda event: event[0]), (result.stop_time, stopped)]


def events_of(result: RecordedRun) -> list[Event]:
    """Return the events of :func:`all_events` that pictures can show apart, two dozen at most."""
    everything, end, together = all_events(result), result.stop_time, _TOGETHER
    while len(events := _apart(everything, together * end)) > _MOST:
        together *= 1.5
    return events


def _apart(everything: list[Event], gap: float) -> list[Event]:
    """Return the first of the events within each gap [s], but rather a hand-over, as "rook to gripper", and the end."""
    events: list[Event] = []
    for time, text in everything:
        if not events or time - events[-1][0] > gap:
            events.append((time, text))
        elif time == everything[-1][0] or (" to " in text and len(events) > 1):
            events[-1] = (time, text)
    return events


def _contacts(run: RecordedRun) -> Iterator[Event]:
    """Yield when bodies begin to touch that were apart, but for those that touch from the start."""
    if run.contacts_at is None:
        return
    steps = run.step_times[:: -(-len(run.step_times) // _LOOKS)]
    touched: dict[frozenset[str], float] = {}
    before: set[frozenset[str]] = set()
    for time, results in zip(steps, run.contacts_at(steps), strict=True):
        contacts = Contacts.of(results)
        pressing = np.asarray(contacts.forces.any(axis=1))
        shapes = [pair for pair, presses in zip(contacts.pairs, pressing, strict=True) if presses]
        pairs = {frozenset(_body(run, shape) for shape in pair) for pair in shapes}
        for pair in sorted(pairs - before, key=sorted):
            if time > 0 and time - touched.get(pair, -np.inf) > _APART:
                yield float(time), f"{' on '.join(sorted(pair - {'world'}))} touches"
        touched |= dict.fromkeys(pairs, time)
        before = pairs


def _body(run: RecordedRun, shape: GeometryId) -> str:
    frame = run.plant.scene_graph.model_inspector().GetFrameId(shape)
    return str(run.plant.plant.GetBodyFromFrameId(frame).name())
