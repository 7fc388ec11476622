"""What was run since the start of the station, and where each move of it began: what can be gone back to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from simrob_drake.programs.moves.move import Move


@dataclass(frozen=True)
class LogEntry:
    """A part of what was run.

    Attributes:
        move: which; None of what is no move, as one that was stopped.
        start: when it began [s]; None where that is not known.
    """

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
        self._entries = [LogEntry(move, None if number else 0.0) for number, move in enumerate(moves)]
        self.mark, self.in_time = len(self._entries), True

    def append(self, moves: Sequence[Move | None], time: float, *, free: bool = False) -> None:
        """Take moves that were begun at a time [s]; ``free`` ones count as no tries."""
        self._entries += [LogEntry(move, None if number else time) for number, move in enumerate(moves)]
        if free:
            self.mark = len(self._entries)

    def mark_stored(self) -> None:
        """Count what was tried as stored."""
        self.mark = len(self._entries)

    def is_program(self, moves: Sequence[Move]) -> bool:
        """Tell whether exactly these moves were run before what was tried, from the start on and in their time."""
        return self.in_time and [entry.move for entry in self._entries[: self.mark]] == list(moves)

    def at_start(self) -> bool:
        """Tell whether nothing was run."""
        return not self._entries

    def align_with(self, moves: Sequence[Move]) -> None:
        """Find anew where what was tried begins, as the program has changed: behind these moves, if they were run."""
        count = len(moves)
        if [entry.move for entry in self._entries[:count]] == list(moves):
            self.mark = count
        self.mark = min(self.mark, len(self._entries))

    def has_others(self, tried: Sequence[Move]) -> bool:
        """Tell whether something else was tried than these moves, or their beginning."""
        done = [entry.move for entry in self._entries[self.mark :]]
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
