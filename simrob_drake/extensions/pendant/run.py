"""A run: its moments, signals and moves, how it ended, and how far joints are from where they should be.

It can be looked at whatever ended it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Any, Literal, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.programs.moves.move import Move

Kind = Literal["", "program", "tried", "free"]
"""What is run, or was last: the program, what is tried, or something that is neither stored nor waits to be."""
_VALUES = 2400  # values of a signal that are kept: two minutes of simulated time
_MOMENTS = 20_000  # that can be gone back to
_SAME = 1e-9  # s
_ENDED = 10  # runs that can be compared
_NEAR = 0.05  # s; from a moment to the next, unless a program has a grid of its own


class LogEntry(NamedTuple):
    """A part of what was run: a move, None of what is none as one that was stopped; and when it began [s], if known."""

    move: Move | None
    start: float | None = None


class RunLog:
    """What was run, move by move.

    Attributes:
        mark: where in it what was tried begins.
        in_time: whether times are those of a program of the same moves.
    """

    def __init__(self) -> None:
        """Begin at the start of the station, where nothing was run."""
        self._entries: list[LogEntry] = []
        self.mark = 0
        self.in_time = True

    def restart_with(self, moves: Sequence[Move]) -> None:
        """Take a whole program that was run from the start."""
        self._entries, self.in_time = [], True
        self.append(moves, 0.0, free=True)

    def append(self, moves: Sequence[Move | None], time: float, *, free: bool = False) -> None:
        """Take moves that were begun at a time [s]; ``free`` ones count as no tries."""
        self._entries += [
            LogEntry(move, None if number else time) for number, move in enumerate(moves)
        ]
        if free:
            self.mark_stored()

    def mark_stored(self) -> None:
        """Count what was tried as stored."""
        self.mark = len(self._entries)

    def start_of_last(self, move: Move | None) -> float | None:
        """Return when the last move began [s], if it is this one and that is known."""
        last = self._entries[-1] if self._entries else None
        return last.start if last is not None and last.move == move else None

    def replace_last(self, move: Move) -> None:
        """Take another move for the last one."""
        self._entries[-1] = self._entries[-1]._replace(move=move)

    def is_program(self, moves: Sequence[Move]) -> bool:
        """Tell whether nothing was run but these moves, all before what was tried, from the start on and in time."""
        return not self._entries or self.has_done(moves)

    def has_done(self, moves: Sequence[Move]) -> bool:
        """Tell whether these moves were run, from the start on and in time, and nothing else before what was tried."""
        return self.in_time and self._done(0, self.mark) == list(moves)

    def _done(self, begin: int, end: int | None = None) -> list[Move | None]:
        return [entry.move for entry in self._entries[begin:end]]

    def align_with(self, moves: Sequence[Move]) -> None:
        """Find anew where what was tried begins, as the program has changed: behind these moves, if they were run."""
        stored = self._done(0, len(moves)) == list(moves)
        self.mark = len(moves) if stored else min(self.mark, len(self._entries))

    def has_others(self, tried: Sequence[Move]) -> bool:
        """Tell whether something else was tried than these moves, or their beginning."""
        done = self._done(self.mark)
        return done != list(tried[: len(done)])

    def back_to(self, tried: Sequence[Move]) -> tuple[float | None, int]:
        """Forget what was tried otherwise than these moves.

        Returns:
            when the first that differs began [s], None if none differs or that is not known; and how many of the moves
            are still done.
        """
        done, kept = self._entries[self.mark :], 0
        while kept < min(len(done), len(tried)) and done[kept].move == tried[kept]:
            kept += 1
        if kept == len(done):
            return None, kept
        while kept and done[kept].start is None:
            kept -= 1
        start = done[kept].start
        del self._entries[self.mark + kept :]
        if start is None:
            # the robot is not where these moves would have it
            self._entries.insert(self.mark, LogEntry(None))
            self.mark += 1
        return start, kept


class Moments:
    """Positions of the whole plant at times, in their order: what a run looked like."""

    def __init__(self, times: Sequence[float] = (), positions: Sequence[Vector] = ()) -> None:
        """Take times [s], and the positions then."""
        self._times, self._positions = list(times), list(positions)

    def keep(self, time: float, positions: Vector | None) -> None:
        """Add the latest one, if its positions are known."""
        if positions is not None:
            self.forget_from(time)
            self._times.append(time)
            self._positions.append(positions)
            del self._times[:-_MOMENTS], self._positions[:-_MOMENTS]

    def forget_from(self, time: float) -> None:
        """Forget those at a time [s] and after it."""
        first = bisect_left(self._times, time - _SAME)
        del self._times[first:], self._positions[first:]

    def between(self, begin: float, end: float) -> Moments:
        """Return those from one time to another [s]."""
        part = slice(bisect_left(self._times, begin - _SAME), bisect_left(self._times, end + _SAME))
        return Moments(self._times[part], self._positions[part])

    def at(self, time: float) -> Vector | None:
        """Return the positions at the moment next to a time [s]; None where none is kept nearby."""
        place = bisect_left(self._times, time)
        near = min(
            range(max(place - 1, 0), min(place + 1, len(self._times))),
            key=lambda i: abs(self._times[i] - time),
            default=None,
        )
        return (
            self._positions[near]
            if near is not None and abs(self._times[near] - time) <= _NEAR
            else None
        )


class EndedRun(NamedTuple):
    """One thing that was run, however it ended, to be looked at again and compared with others."""

    number: int  # counts from 1 since the session was opened
    kind: Kind  # of it
    begun: float  # when it began, since the start of the station [s]; ``reached``: how far it came
    reached: float
    ending: str  # ``completed``, ``monitor``, ``stopped``, ``diverged`` ... or ``died``
    # of each signal its times [s], shape (m,), and its values, shape (m, n)
    signals: dict[str, tuple[Vector, Vector]]
    moments: Moments  # what it looked like

    def history(self, signal: str) -> list[tuple[float, Any]]:
        """Return the values of a signal as ``(time, value)`` in order of time; nothing of one that it has not."""
        times, values = self.signals.get(signal, (np.empty(0), np.empty((0, 0))))
        return list(zip(times.tolist(), values.tolist(), strict=True))

    def within(self, time: float) -> float:
        """Return the moment of it that is next to a time [s]."""
        return min(max(time, self.begun), self.reached)


class TaughtRun:
    """What was run since the start of the station, up to the end of it, a fall, or the death of its process.

    Attributes:
        time: of the moment that is shown [s].
        reach: how far the run has come [s], also one that came to nothing.
        start: where the robot stands, and the next move begins [s]; after a fall before it, which is not what is shown.
        ratio: simulated time over the clock's.
        values: last value of each watched signal.
        moments: what it looked like.
        history: of each watched signal its last values, as ``(time, value)`` in order of time.
        moves: what was run.
        kind: of what is run, or was last.
        ending: how the last run ended, as its news told; None before.
        rewound: whether a moment is shown that more was run after, and what comes next goes on from there.
        lost: whether the process that ran it is gone, so that nothing goes on from its moments.
        ended: the last ten things that were run, the newest last.
        shown: the one of these that is looked at in place of the present run; None: none.
        compared: the one that is shown beside what is looked at; None: none.
    """

    def __init__(self) -> None:
        """Begin at the start of a station, where nothing was run."""
        self.values: dict[str, Any] = {}
        self.history: dict[str, deque[tuple[float, Any]]] = {}
        self.moments = Moments()
        self.time = self.reach = self.ratio = 0.0
        self.ending: dict[str, Any] | None = None
        self.ended: deque[EndedRun] = deque(maxlen=_ENDED)
        self.shown: EndedRun | None = None
        self.compared: EndedRun | None = None
        self._compared_by_itself: EndedRun | None = None  # by compare_last, not by the user
        self.at_start()

    def at_start(self, *, lost: bool = False) -> None:
        """Count nothing as run, since the robot stands at the start of the station; what is shown stays."""
        self.moves, self.lost = RunLog(), lost
        self.kind: Kind = ""
        self.start, self.rewound = 0.0, False

    def stand(self, time: float) -> None:
        """Take note that the robot stands where it was at a time [s], and is shown there."""
        self.time = self.start = time
        self.rewound, self.shown = False, None

    def compare_last(self) -> None:
        """Compare what comes next with the last run of the program, unless the user has chosen another one.

        If the program has not run, it is the last move that was tested. A jog is never compared: it begins and ends
        elsewhere, so that its ghost and its curves would say nothing.
        """
        if self.compared not in (None, self._compared_by_itself):
            return
        # The newest one first.
        runs = list(reversed(self.ended))
        played = [run for run in runs if run.kind == "program"]
        tested = [run for run in runs if run.kind == "tried"]
        for run in (played + tested)[:1]:
            self.compared = self._compared_by_itself = run

    @property
    def ghost(self) -> EndedRun | None:
        """The compared run, if the view is to draw it; None if there is nothing to compare it with.

        Right after a change of the station the robot stands where the compared run began as well. A ghost there would
        only hide the robot, unless the user has chosen the run.
        """
        nothing_ran = self.shown is None and self.reach == 0.0
        if nothing_ran and self.compared is self._compared_by_itself:
            return None
        return self.compared

    @property
    def span(self) -> tuple[float, float]:
        """From when to when there are moments of what is looked at [s]."""
        return (self.shown.begun, self.shown.reached) if self.shown else (0.0, self.reach)

    def history_of(self, signal: str) -> Sequence[tuple[float, Any]]:
        """Return the values of a watched signal in what is looked at, as ``(time, value)`` in order of time."""
        return self.shown.history(signal) if self.shown else self.history.get(signal, ())

    def watch(self, signals: Iterable[str]) -> None:
        """Keep the values of these signals, and no others; of what ended last they are known already."""
        self.history = {
            name: self.history.get(name) or deque(self._of_last(name), _VALUES) for name in signals
        }
        self.values = {name: value for name, value in self.values.items() if name in self.history}

    def _of_last(self, signal: str) -> list[tuple[float, Any]]:
        last = self.ended[-1].history(signal) if self.ended else ()
        return [row for row in last if row[0] <= self.reach + _SAME]

    def take(
        self, time: float, positions: Vector | None, values: dict[str, Any], ratio: float = 0.0
    ) -> None:
        """Take a moment [s]: positions of the whole plant, values of signals; what was run later is forgotten."""
        self._forget_from(time)
        self.time = self.reach = time
        self.ratio, self.shown = ratio, None
        self.moments.keep(time, positions)
        self.values |= values
        for name in self.history.keys() & values.keys():
            self.history[name].append((time, values[name]))

    def _forget_from(self, time: float) -> None:
        self.moments.forget_from(time)
        for ring in self.history.values():
            while ring and ring[-1][0] > time - _SAME:
                ring.pop()

    def end(self, news: dict[str, Any]) -> None:
        """Take what is told of its end, which may come between two ticks; and where the robot stands then."""
        self.ending = news
        if not self.rewound:
            self.time = self.reach = news["reached"]
            self.start = news["time"]
            self._forget_from(self.reach + 2 * _SAME)
            self.moments.keep(self.reach, news.get("positions"))
        self._keep_ended(news["begun"], news["reached"], news["ending"], news["signals"])

    def die(self) -> None:
        """Take note that the process is gone; of what ran then there is what was watched."""
        watched = {
            name: (
                np.array([time for time, _ in ring]),
                np.array([np.atleast_1d(value) for _, value in ring]),
            )
            for name, ring in self.history.items()
            if ring
        }
        self._keep_ended(self.start, self.reach, "died", watched)

    def _keep_ended(
        self, begun: float, reached: float, ending: str, signals: dict[str, Any]
    ) -> None:
        number = self.ended[-1].number + 1 if self.ended else 1
        moments = self.moments.between(begun, reached)
        self.ended.append(EndedRun(number, self.kind, begun, reached, ending, signals, moments))


Level = Literal["", "amber", "red"]  # how much it is: nothing to speak of, to be seen, or a lot
Reason = Literal["", "limit", "stop", "moving", "gains"]
"""The drive is at its limit, a stop holds the joint, it is on its way, or it rests where its gains hold it."""

BOUNDS: Mapping[str, tuple[float, float]] = {"deg": (2.0, 10.0), "m": (0.002, 0.01)}
"""From where on it is amber, and red [deg or m]."""
_FULL = 0.995  # of a limit, which solvers reach but for rounding
_AT_STOP: Mapping[str, float] = {"deg": 0.5, "m": 0.0005}  # deg or m
_STILL: Mapping[str, float] = {"deg": 5.0, "m": 0.01}  # deg/s or m/s


class Shortfall(NamedTuple):
    """What is left between asked and done."""

    off: float  # how far the joint is from where it should be, positive beyond it [deg or m]
    level: Level = ""  # how much that is
    reason: Reason = ""  # why; nothing where nothing is to be told


def level_of(off: float, unit: str) -> Level:
    """Return how much it is to be off by something [deg or m]."""
    amber, red = BOUNDS[unit]
    return "red" if abs(off) >= red else "amber" if abs(off) >= amber else ""


def shortfall(
    axis: Mapping[str, Any],
    asked: float,
    done: float,
    *,
    speed: float = 0.0,
    torque: float = 0.0,
    limit: float = inf,
) -> Shortfall:
    """Return how far an axis, as a description has it, is from where it should be, and why.

    What was asked and done are in [deg or m], ``speed`` by the second; the drive's ``torque`` and its ``limit`` in [N·m
    or N].
    """
    unit, off = axis["unit"], done - asked
    if axis.get("passive", False):  # no motor is to bring it anywhere
        return Shortfall(off)
    level = level_of(off, unit)
    if abs(torque) >= _FULL * limit:
        return Shortfall(off, "red", "limit")
    if not level:
        return Shortfall(off)
    if not axis["low"] + _AT_STOP[unit] < done < axis["high"] - _AT_STOP[unit]:
        return Shortfall(off, level, "stop")
    return Shortfall(off, level, "moving" if abs(speed) > _STILL[unit] else "gains")
