"""A program of a legged robot: moves in degrees, by axis name, that mean the same on every robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import yaml
from pydantic import Field, ValidationError

from simrob_drake.errors import InvalidParameter
from simrob_drake.folders import written_at_once
from simrob_drake.robots.pieces import Positive
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

Targets = Annotated[dict[str, Number], Field(min_length=1)]
"""Where axes are to be [deg], and m for an axis that slides, by name or alias; the others stay where they were."""


Step = TypeVar("Step", bound=Strict)


class Move(Strict):
    """Axes that go to their targets at the same time."""

    target_deg: Targets
    """Absolute positions at the end."""
    duration: Positive = 1.0
    """Time that it takes [s]."""


class Cell(Strict):
    """Targets without a time: who follows them goes on when they are reached (SimRob's ``joint{k}``)."""

    target_deg: Targets
    """Absolute positions that count as reached together."""


class Program(Strict):
    """What a robot is told: moves in time, and cells for a sequencer. Every change gives a new program."""

    description: str = ""
    moves: tuple[Move, ...] = ()
    """One after the other, from where the robot stands at the start."""
    references: tuple[Cell, ...] = ()
    """In the order in which a sequencer goes through them."""

    @property
    def duration(self) -> float:
        """Of all moves [s]."""
        return float(sum(move.duration for move in self.moves))

    def added(self, *moves: Move) -> Program:
        """Return the program with moves behind it."""
        return self.model_copy(update={"moves": (*self.moves, *moves)})

    def inserted(self, index: int, move: Move) -> Program:
        """Return the program with a move before the one of number ``index``, counted from 0; its length: at the end.

        Raises:
            InvalidParameter: no such number.
        """
        place = self._place(index, len(self.moves))
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place:])})

    def removed(self, index: int) -> Program:
        """Return the program without a move; negative numbers count from the end.

        Raises:
            InvalidParameter: no such number.
        """
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], *self.moves[place + 1 :])})

    def edited(self, index: int, move: Move) -> Program:
        """Return the program with another move in place of one.

        Raises:
            InvalidParameter: no such number.
        """
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place + 1 :])})

    def with_reference(self, cell: Cell) -> Program:
        """Return the program with a cell behind the others."""
        return self.model_copy(update={"references": (*self.references, cell)})

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML, in place of what the file holds, and return the file.

        Raises:
            OutputError: it cannot be written; then what was there stays as it was.
        """
        path = Path(file)
        content = {key: value for key, value in self.model_dump(mode="json").items() if value}
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
        written_at_once(path, text)
        return path

    @classmethod
    def load(cls, file: Path | str) -> Program:
        """Return the program that a YAML file holds.

        Raises:
            InvalidConfig: a file that cannot be read or is damaged; names the file, the move and the key, or the line.
        """
        path = Path(file)
        content = read_yaml(path)
        steps: tuple[tuple[str, type[Strict]], ...] = (("moves", Move), ("references", Cell))
        for key, kind in steps:
            entries = content.get(key)
            for number, entry in enumerate(entries if isinstance(entries, list) else []):
                if isinstance(entry, dict):
                    validated(kind, entry, f"{path}: {key}[{number}]")
        return validated(cls, content, path)

    def _place(self, index: int, last: int) -> int:
        count = len(self.moves)
        place = index + count if index < 0 else index
        if not 0 <= place <= last:
            expected = (
                f"from {-count} to {last}, the program has {count} moves" if last >= 0 else "of a move; there is none"
            )
            raise InvalidParameter("index", index, expected)
        return place


def move_of(target_deg: Mapping[str, Any], duration: Any) -> Move:
    """Return a checked move of what a user gave.

    Raises:
        InvalidParameter: no axis, an angle that is no finite number, or a duration that is not positive.
    """
    return _checked(lambda: Move(target_deg=_plain(target_deg), duration=_plain_number(duration)))


def cell_of(target_deg: Mapping[str, Any]) -> Cell:
    """Return a checked cell of what a user gave.

    Raises:
        InvalidParameter: no axis, or an angle that is no finite number.
    """
    return _checked(lambda: Cell(target_deg=_plain(target_deg)))


def _checked(make: Callable[[], Step]) -> Step:
    try:
        return make()
    except ValidationError as problem:
        finding = problem.errors()[0]
        key, given = ".".join(str(part) for part in finding["loc"]), finding["input"]
        if finding["loc"] == ("duration",):
            raise InvalidParameter("duration", given, "a positive time [s]") from problem
        if finding["loc"] == ("target_deg",):
            raise InvalidParameter("target_deg", given, "a mapping of at least one axis to degrees") from problem
        raise InvalidParameter(key, given, "a finite number [deg]") from problem


def _plain(target_deg: Mapping[str, Any]) -> Any:
    if not isinstance(target_deg, Mapping):
        return target_deg
    return {str(axis): _plain_number(value) for axis, value in target_deg.items()}


def _plain_number(value: Any) -> Any:
    """Return numpy's numbers as Python's own."""
    return value.item() if isinstance(value, np.number) else value
