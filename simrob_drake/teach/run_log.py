"""What was run since the start of the station, and where each move of it began: what can be gone back to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from simrob_drake.programs.moves.move import Move


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
        self._entries += [LogEntry(move, None if number else time) for number, move in enumerate(moves)]
        if free:
            self.mark_stored()

    def mark_stored(self) -> None:
        """Count what was tried as stored."""
        self.mark = len(self._entries)

    def is_program(self, moves: Sequence[Move]) -> bool:
        """Tell whether nothing was run but these moves, all before what was tried, from the start on and in time."""
        return not self._entries or (self.in_time and self._done(0, self.mark) == list(moves))

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
            self._entries.insert(self.mark, LogEntry(None))  # the robot is not where these moves would have it
            self.mark += 1
        return start, kept
