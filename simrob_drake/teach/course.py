"""What was run since the start of the station, and where each move of it began: what can be gone back to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from simrob_drake.programs.program import AnyMove


@dataclass(frozen=True)
class Leg:
    """A part of what was run.

    Attributes:
        move: which; None of what is no move, as one that was stopped.
        start: when it began [s]; None where that is not known.
    """

    move: AnyMove | None
    start: float | None = None


class Course:
    """What was run, move by move.

    Attributes:
        mark: where in it what was tried begins.
        in_time: whether times are those of a program of the same moves.
    """

    def __init__(self) -> None:
        """Begin at the start of the station, where nothing was run."""
        self._legs: list[Leg] = []
        self.mark = 0
        self.in_time = True

    def played(self, moves: Sequence[AnyMove]) -> None:
        """Take a whole program that was run from the start."""
        self._legs = [Leg(move, None if number else 0.0) for number, move in enumerate(moves)]
        self.mark, self.in_time = len(self._legs), True

    def went_on(self, moves: Sequence[AnyMove | None], time: float, *, free: bool = False) -> None:
        """Take moves that were begun at a time [s]; ``free`` ones count as no tries."""
        self._legs += [Leg(move, None if number else time) for number, move in enumerate(moves)]
        if free:
            self.mark = len(self._legs)

    def settled(self) -> None:
        """Count what was tried as stored."""
        self.mark = len(self._legs)

    def stands_behind(self, moves: Sequence[AnyMove]) -> bool:
        """Tell whether exactly these moves were run before what was tried, from the start on and in their time."""
        return self.in_time and [leg.move for leg in self._legs[: self.mark]] == list(moves)

    def at_start(self) -> bool:
        """Tell whether nothing was run."""
        return not self._legs

    def align(self, moves: Sequence[AnyMove]) -> None:
        """Find anew where what was tried begins, as the program has changed: behind these moves, if they were run."""
        count = len(moves)
        if [leg.move for leg in self._legs[:count]] == list(moves):
            self.mark = count
        self.mark = min(self.mark, len(self._legs))

    def has_others(self, tried: Sequence[AnyMove]) -> bool:
        """Tell whether something else was tried than these moves, or their beginning."""
        done = [leg.move for leg in self._legs[self.mark :]]
        return done != list(tried[: len(done)])

    def back_to(self, tried: Sequence[AnyMove]) -> tuple[float | None, int]:
        """Forget what was tried otherwise than these moves.

        Returns:
            when the first that differs began [s], None if none differs or that is not known; and how many of the moves
            are still done.
        """
        done, kept = self._legs[self.mark :], 0
        while kept < min(len(done), len(tried)) and done[kept].move == tried[kept]:
            kept += 1
        if kept == len(done):
            return None, kept
        while kept and done[kept].start is None:
            kept -= 1
        start = done[kept].start
        del self._legs[self.mark + kept :]
        if start is None:
            self._legs.insert(self.mark, Leg(None))  # the robot is not where these moves would have it
            self.mark += 1
        return start, kept
