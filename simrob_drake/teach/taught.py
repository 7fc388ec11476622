"""All that is taught, and its history: what undo and redo go through, and what no kill may take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, cast

from pydantic import Field, ValidationError

from simrob_drake.errors import SimrobError
from simrob_drake.parts.site import WORLD
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.programs.moves.kinds import AnyMove
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.sections import Number, Strict


class Target(Strict):
    """Where an arm was when it was taught."""

    axes: dict[str, Number]
    """Its posture [deg, or m of a prismatic axis]."""
    pose: Annotated[tuple[Number, ...], Field(min_length=6, max_length=6)]
    """[x y z Rz Ry Rx] of its tool centre point in a frame [m, deg]."""
    frame: str = WORLD
    """The world, or a work object."""
    tool: str = ""
    """Whose that point is."""
    robot: str = ""
    """Which arm of the station."""


class Taught(Strict):
    """All that is taught; every change gives another one."""

    program: Program = Program(grid=GRID)
    """What is stored."""
    pending: tuple[AnyMove, ...] = ()
    """What was tried since, and is neither stored nor discarded."""
    joins: bool = False
    """Whether the next tested move of axes joins the last of these."""
    changes: tuple[Change, ...] = ()
    """What was changed while it was tried."""
    targets: dict[str, Target] = Field(default_factory=dict)
    """Of an arm, by name."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Of the station, by dotted key."""

    @classmethod
    def of(cls, program: Program) -> Taught:
        """Return what is taught by a program alone; it gets a grid if it has none."""
        return cls().replaced(program=program.model_copy(update={"grid": program.grid or GRID}))

    def replaced(self, **changes: Any) -> Taught:
        """Return it with something changed, all of it checked already."""
        return self.model_copy(update=changes)

    def with_program(self, **changes: Any) -> Taught:
        """Return it with something of the program changed, likewise."""
        return self.replaced(program=self.program.model_copy(update=changes))

    def with_tested(self, move: JointMove) -> Taught:
        """Return it with a move of axes tried: it joins the one that was tested last, if nothing came between."""
        if not self.joins:
            return self.replaced(pending=(*self.pending, move), joins=True)
        *others, last = self.pending
        both = JointMove(target_deg={**cast(JointMove, last).target_deg, **move.target_deg}, duration=move.duration)
        return self.replaced(pending=(*others, both))

    def with_tried(self, *moves: Move) -> Taught:
        """Return it with moves tried that stand for themselves."""
        return self.replaced(pending=(*self.pending, *moves), joins=False)

    def added(self) -> Taught:
        """Return it with what was tried stored."""
        moves, changes = (*self.program.moves, *self.pending), (*self.program.changes, *self.changes)
        return self.with_program(moves=moves, changes=changes).discarded()

    def discarded(self) -> Taught:
        """Return it without what was tried."""
        return self.replaced(pending=(), joins=False, changes=())


def with_change(changes: Sequence[Change], change: Change) -> tuple[Change, ...]:
    """Return changes with another one, in order of time, in place of one of the same moment, kind and thing."""
    kept = [one for one in changes if _of(one) != _of(change)]
    return tuple(sorted([*kept, change], key=lambda one: one.time))


def _of(change: Change) -> tuple[Any, ...]:
    """Return what a change is of: a later one of the same replaces it, as a drag that has gone on."""
    return change.time, tuple(change.set or ()), change.push and change.push.at, change.drag and change.drag.at


def entries_of(moves: Sequence[Move]) -> list[dict[str, Any]]:
    """Return moves as a program's file has them."""
    return [move.entry() for move in moves]


MOST_STEPS, MOST_LETTERS = 200, 2_000_000
"""What is kept to go back to; the oldest is forgotten first."""


class History:
    """What is taught now, with what undo goes back to and what redo brings back."""

    def __init__(self, taught: Taught | None = None) -> None:
        """Begin with what is taught already."""
        self._steps = [_as_step(Taught() if taught is None else taught)]
        self._at = 0
        self._label = ""

    @property
    def present(self) -> Taught:
        """What is taught now."""
        return self._steps[self._at][0]

    @property
    def can_undo(self) -> bool:
        """Whether there is something to go back to."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to bring back."""
        return self._at < len(self._steps) - 1

    def record(self, taught: Taught, label: str = "") -> None:
        """Take a step, if something is new; what was undone before is forgotten.

        Args:
            taught: what is taught from now on.
            label: of a step that goes on with the last one if that had the same, as a slider that is still moved.
        """
        if taught == self.present:
            return
        keep = self._at + (0 if label and label == self._label and self._at > 0 else 1)
        self._steps[keep:] = [_as_step(taught)]
        self._at, self._label = len(self._steps) - 1, label
        letters = sum(len(text) for _, text in self._steps)
        while len(self._steps) > MOST_STEPS or (letters > MOST_LETTERS and len(self._steps) > 1):
            letters -= len(self._steps.pop(0)[1])
            self._at -= 1

    def withdraw(self) -> None:
        """Forget the last step, which came to nothing."""
        if self.can_undo:
            self.undo()
            del self._steps[self._at + 1 :]

    def undo(self) -> None:
        """Go back a step."""
        self._at, self._label = max(self._at - 1, 0), ""

    def redo(self) -> None:
        """Bring a step back."""
        self._at, self._label = min(self._at + 1, len(self._steps) - 1), ""

    def text(self) -> str:
        """Return all of it: the number of the present step, and one line for each."""
        return "\n".join([str(self._at), *(text for _, text in self._steps)]) + "\n"

    @classmethod
    def of_text(cls, text: str) -> History | None:
        """Return what :meth:`text` gave; None of anything else."""
        at, *lines = text.removesuffix("\n").split("\n")
        history = cls()
        try:
            history._steps = [(Taught.model_validate_json(line), line) for line in lines]
            history._at = range(len(lines))[int(at)]
        except (ValidationError, SimrobError, ValueError, IndexError):
            return None
        return history


def _as_step(taught: Taught) -> tuple[Taught, str]:
    return taught, taught.model_dump_json()
