"""What the parts of a station say of a run, in words."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.results.record.run import RecordedRun

_REMARKS = {
    "clipped": "is asked for more than its legs can follow, and does what they can",
    "blind": "reads what is not a number, and goes on as planned",
}
_MOST = 3  # stretches of time that are told one by one


def remarks_of(run: RecordedRun) -> list[str]:
    """Return what walks have to say of a run or a program: when they were asked for too much, and when they were blind.

    Times are those of samples.
    """
    begins = np.cumsum([0.0, *(part.stop_time for part in run.parts)])
    return [remark for begin, part in zip(begins, run.parts, strict=False) for remark in _remarks(part, float(begin))]


def _remarks(run: RecordedRun, begin: float) -> Iterator[str]:
    for name, section in run.config.controllers.items():
        for output, remark in _REMARKS.items() if section.kind == "walk" else ():
            spans = _spans(run[f"{name}.{output}"], begin + run.times)
            if spans:
                when = ", ".join(f"{first:.2f} to {last:.2f} s" for first, last in spans[:_MOST])
                more = f" and {len(spans) - _MOST} times more" if len(spans) > _MOST else ""
                yield f"{name} {remark}: {when}{more}"


def _spans(on: Vector, times: Vector) -> list[tuple[float, float]]:
    """Return first and last times of the stretches in which something is 1 and not 0."""
    turns = np.flatnonzero(np.diff(np.concatenate([[0.0], on, [0.0]])))
    return [(float(times[first]), float(times[last - 1])) for first, last in list(pairwise(turns))[::2]]
