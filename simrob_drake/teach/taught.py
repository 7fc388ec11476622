"""All that is taught: what undo and redo go through, and what no kill may take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, cast

from pydantic import Field

from simrob_drake.errors import InvalidConfig, nearest
from simrob_drake.parts.site import WORLD
from simrob_drake.programs.moves import JointMove, plain
from simrob_drake.programs.program import KINDS, AnyMove, Program
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.yaml_files import Number, Strict, validated


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
        return cls().but(program=program.model_copy(update={"grid": program.grid or GRID}))

    def but(self, **changes: Any) -> Taught:
        """Return it with something changed, all of it checked already."""
        return self.model_copy(update=changes)

    def with_program(self, **changes: Any) -> Taught:
        """Return it with something of the program changed, likewise."""
        return self.but(program=self.program.model_copy(update=changes))

    def with_tested(self, move: JointMove) -> Taught:
        """Return it with a move of axes tried: it joins the one that was tested last, if nothing came between."""
        if not self.joins:
            return self.but(pending=(*self.pending, move), joins=True)
        *others, last = self.pending
        both = JointMove(target_deg={**cast(JointMove, last).target_deg, **move.target_deg}, duration=move.duration)
        return self.but(pending=(*others, both))

    def with_tried(self, *moves: AnyMove) -> Taught:
        """Return it with moves tried that stand for themselves."""
        return self.but(pending=(*self.pending, *moves), joins=False)

    def added(self) -> Taught:
        """Return it with what was tried stored."""
        moves, changes = (*self.program.moves, *self.pending), (*self.program.changes, *self.changes)
        return self.with_program(moves=moves, changes=changes).discarded()

    def discarded(self) -> Taught:
        """Return it without what was tried."""
        return self.but(pending=(), joins=False, changes=())


def entry_of(given: Mapping[str, Any]) -> AnyMove:
    """Return a move of what would stand in a program's file.

    Raises:
        InvalidConfig: what is no move; names the key.
    """
    kind = next((kind for key, kind in KINDS.items() if key in given), None)
    if kind is None:
        key = next(iter(given), "")
        raise InvalidConfig("the move", str(key), f"is no kind of move{nearest(key, KINDS)}")
    made: AnyMove = validated(kind, plain(given), "the move")
    return made


def with_change(changes: Sequence[Change], change: Change) -> tuple[Change, ...]:
    """Return changes with another one, in order of time, in place of one of the same moment, kind and thing."""
    kept = [one for one in changes if _of(one) != _of(change)]
    return tuple(sorted([*kept, change], key=lambda one: one.time))


def _of(change: Change) -> tuple[Any, ...]:
    """Return what a change is of: a later one of the same replaces it, as a drag that has gone on."""
    return change.time, tuple(change.set or ()), change.push and change.push.at, change.drag and change.drag.at


def told(moves: Sequence[AnyMove]) -> list[dict[str, Any]]:
    """Return moves as a program's file has them."""
    return [move.model_dump(mode="json") for move in moves]
