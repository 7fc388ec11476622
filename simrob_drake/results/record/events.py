"""What happens in a run or a program, and when: for pictures at those moments, and as a table."""

from simrob_drake.results.record.run import RecordedRun, begins_of
from simrob_drake.results.record.touch import Event

_TOGETHER = 0.01  # part of the whole time in which two events are one
_MOST = 24  # of those that a picture has room for


def all_events(result: RecordedRun) -> list[Event]:
    """Return what happens in a run: its start, contacts that begin and its end; in a program, what is between, too.

    That is the ends of its runs, and what is attached and let go after them.
    """
    found = [(0.0, "start"), *result.marks]
    for begin, run in zip(begins_of(*result.parts), result.parts, strict=False):
        found += [(float(begin + time), text) for time, text in run.onsets]
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
