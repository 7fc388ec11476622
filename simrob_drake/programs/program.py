"""A program of a robot: moves by name, of axes, gaits, tools and pieces, that mean the same on every robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BeforeValidator, model_validator

from simrob_drake.errors import InvalidConfig, InvalidParameter, nearest, quoted, shortened
from simrob_drake.folders import written_at_once
from simrob_drake.given import as_path, instance
from simrob_drake.programs.arm_moves import ARM_KINDS, ArmMove
from simrob_drake.programs.automatic import Automatic, pace_of
from simrob_drake.programs.moves import LEG_KINDS, JointMove, LegMove
from simrob_drake.programs.timeline import Change
from simrob_drake.quantities import Duration
from simrob_drake.yaml_files import Strict, parse_yaml, read_yaml, validated

AnyMove = LegMove | ArmMove
KINDS: dict[str, type[AnyMove]] = {**LEG_KINDS, **ARM_KINDS}
"""By the key that tells them apart."""


def _as_usual(given: Any) -> Any:
    return ({} if given else None) if isinstance(given, bool) else given


class Program(Strict):
    """What a robot is told: moves, and cells for a sequencer. Every change gives a new program.

    A move is ``{target_deg, duration}``, ``{walk: {steps, amplitude, gait, ...}}``, ``{act: bow}``, ``{attach: box}``,
    ``{release: box}``, ``{wait: 0.5}`` or ``{play: 5}``; of an arm also ``{move_l: {targets, wobj, speed, ...}}``,
    likewise ``move_abs_j``, ``move_j`` and ``move_c``, ``{tool: pencil}`` or ``{together: [...]}``.
    :mod:`simrob_drake.programs.moves` and :mod:`simrob_drake.programs.arm_moves` have all keys,
    :mod:`simrob_drake.programs.timeline` those of changes.
    """

    description: str = ""
    """What it is, in a line."""
    station: str | None = None
    """Where `simrob run` runs it: a station's name, or a file from where the program lies."""
    robot: str | None = None
    """Which robot of that station; needed where there are several. Moves of arms may name others."""
    moves: tuple[AnyMove, ...] = ()
    """One after the other, from where the robot stands at the start."""
    references: tuple[JointMove, ...] = ()
    """Cells (SimRob's ``joint{k}``) that a sequencer goes through, each for as long as it takes."""
    grid: Duration | None = None
    """Runs are cut at multiples of this time [s], from each of which they can be repeated; 0.05 with changes."""
    changes: tuple[Change, ...] = ()
    """What happens to the station while the moves run: settings, pushes, drags."""
    automatic: Annotated[Automatic | None, BeforeValidator(_as_usual)] = None
    """How references are run instead of moves, in the robot's own time: `{tolerance_deg: 3}`, or `true`."""

    @model_validator(mode="after")
    def _something_automatic(self) -> Self:
        if self.automatic and not self.references:
            raise ValueError("automatic: references are run, and there are none")
        return self

    @property
    def duration(self) -> float:
        """Of all moves of joints [s]; what walks and acts take depends on the robot."""
        return float(sum(move.duration for move in self.moves if isinstance(move, JointMove)))

    def __repr__(self) -> str:
        """Say in one line what it holds."""
        moves = ", ".join(next(iter(type(move).model_fields)) for move in self.moves)
        held = f"{counted(len(self.moves), 'move')}{shortened(f': {moves}') if moves else ''}"
        references = f"; {counted(len(self.references), 'reference')}" if self.references else ""
        return f"<Program of {held}{references}>"

    __str__ = __repr__

    def added(self, *moves: AnyMove) -> Program:
        """Return the program with moves behind it."""
        _check_moves(*moves)
        return self.model_copy(update={"moves": (*self.moves, *moves)})

    def inserted(self, index: int, move: AnyMove) -> Program:
        """Return the program with a move before the one of number ``index``, counted from 0; its length: at the end.

        Raises:
            InvalidParameter: no such number.
        """
        _check_moves(move)
        place = self._place(index, len(self.moves))
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place:])})

    def removed(self, index: int) -> Program:
        """Return the program without a move; negative numbers count from the end.

        Raises:
            InvalidParameter: no such number.
        """
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], *self.moves[place + 1 :])})

    def edited(self, index: int, move: AnyMove) -> Program:
        """Return the program with another move in place of one.

        Raises:
            InvalidParameter: no such number.
        """
        _check_moves(move)
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place + 1 :])})

    def with_automatic(self, given: bool | Automatic | Mapping[str, Any]) -> Program:
        """Return the program with another way to be run.

        Raises:
            SimrobError: as :func:`pace_of`.
        """
        return self.model_copy(update={"automatic": None if given is False else pace_of(given)})

    def on(self, station: str) -> Program:
        """Return the program with another station that it is to run on."""
        return self.model_copy(update={"station": station})

    def with_reference(self, cell: JointMove) -> Program:
        """Return the program with a cell behind the others."""
        instance(cell, "cell", JointMove, "a JointMove, such as JointMove(target_deg={'waist': 10})")
        return self.model_copy(update={"references": (*self.references, cell)})

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML, in place of what the file holds, and return the file.

        Raises:
            OutputError: it cannot be written; then what was there stays as it was.
        """
        target = as_path(file, "file")
        written_at_once(target, self.text())
        return target

    def text(self) -> str:
        """Return the program as YAML."""
        content = {key: value for key, value in self.model_dump(mode="json").items() if value}
        how: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "width": 120, "default_flow_style": None}
        return str(yaml.dump(content, Dumper=yaml.CSafeDumper, **how))

    @classmethod
    def load(cls, file: Path | str) -> Program:
        """Return the program that a YAML file holds.

        Raises:
            InvalidConfig: a file that cannot be read or is damaged; names the file, the move and the key, or the line.
        """
        source = as_path(file, "file")
        return cls._of(read_yaml(source), source)

    @classmethod
    def of_text(cls, text: str, where: str = "the program") -> Program:
        """Return the program that a YAML text holds, likewise; errors call it as ``where`` says."""
        content = parse_yaml(text, where)
        return cls._of(instance(content, where, dict, "a mapping with moves"), where)

    @classmethod
    def _of(cls, content: dict[str, Any], source: Path | str) -> Program:
        for key in ("moves", "references"):
            entries = content.get(key)
            for number, entry in enumerate(entries if isinstance(entries, list) else []):
                _check_entry(entry, key, f"{source}: {key}[{number}]")
        return validated(cls, content, source)

    def _place(self, index: int, last: int) -> int:
        count = len(self.moves)
        instance(index, "index", int, "the number of a move")
        place = index + count if index < 0 else index
        if not 0 <= place <= last:
            known = f"from {-count} to {last}, the program has {counted(count, 'move')}"
            raise InvalidParameter("index", index, known if last >= 0 else "of a move; there is none")
        return place


def _check_moves(*moves: object) -> None:
    for move in moves:
        instance(move, "move", tuple(KINDS.values()), "a move, such as JointMove(target_deg={'waist': 10})")


def counted(count: int, thing: str) -> str:
    """Return how many things there are, in words of messages."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def _check_entry(entry: Any, key: str, where: str) -> None:
    """Check one move or cell of a file by itself, so that messages can name it."""
    if not isinstance(entry, dict):
        raise InvalidConfig(where, "", f"must be a mapping of keys to values (it is {quoted(entry)})")
    told = JointMove if key == "references" else next((kind for name, kind in KINDS.items() if name in entry), None)
    kind: type[Strict] | None = told
    strange = next((name for name in entry if name not in JointMove.model_fields), None)
    if kind is None and strange is not None:
        known = [*KINDS, *JointMove.model_fields]
        raise InvalidConfig(where, str(strange), f"unknown key{nearest(str(strange), known)}")
    validated(kind or JointMove, entry, where)
