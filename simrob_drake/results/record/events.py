"""What happens in runs that follow each other, and when: for pictures at those moments."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from pydrake.geometry import GeometryId

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.results.record.run import RecordedRun

_LOOKS = 4000  # at most so many steps of a run are asked what touches what
_APART = 0.1  # s that two bodies are apart before they touch again: what trembles touches once
_TOGETHER = 0.01  # part of the whole time in which two events are one

Event = tuple[float, str]
"""When [s], and what in a few words."""


def begins_of(runs: Sequence[RecordedRun]) -> list[float]:
    """Return when runs that follow each other begin, and when the last one ends, in seconds from the first."""
    return [0.0, *np.cumsum([run.stop_time for run in runs]).tolist()]


def events_of(runs: Sequence[RecordedRun]) -> list[Event]:
    """Return the start, contacts that begin, ends of moves, what is attached and detached between them, and the end.

    Args:
        runs: each begun where the one before ended, their times [s] counted on.
    """
    begins, found = begins_of(runs), [(0.0, "start")]
    for begin, run in zip(begins, runs, strict=False):
        found += [(begin + time, text) for time, text in _contacts(run)]
    for end, (before, after) in zip(begins[1:], pairwise(runs), strict=False):
        found.append((end, _handed_over(before, after)))
    found.append((begins[-1], f"stopped: {runs[-1].stopped_by}" if runs[-1].ending == "monitor" else "end"))
    events: list[Event] = []
    for time, text in sorted(found, key=lambda event: event[0]):
        if not events or time - events[-1][0] > _TOGETHER * begins[-1]:
            events.append((time, text))
        elif time == begins[-1]:  # the end tells more than what happens a moment before
            events[-1] = (time, text)
    return events


def _handed_over(before: RecordedRun, after: RecordedRun) -> str:
    changes = []
    for name, piece in after.config.pieces.items():
        old = before.config.pieces.get(name)
        if old is not None and old.parent != piece.parent:
            changes.append(f"{name} to {piece.parent}")
    return ", ".join(changes) or "move ends"


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
