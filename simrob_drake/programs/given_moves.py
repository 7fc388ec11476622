"""Moves of what users give in Python, checked: what is wrong is told as of any other parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.moves import MOVE_TIME, AnyMove, Cell, Move, kind_of
from simrob_drake.yaml_files import Strict, validated

Entry = TypeVar("Entry", bound=Strict)

_EXPECTED = {
    "duration": "a positive time [s]",
    "target_deg": "a mapping of at least one axis to degrees",
    "steps": "a whole number",
    "amplitude": "a finite number; 1 walks as the gait's figures say",
}


def move_of(target_deg: Mapping[str, Any], duration: Any = MOVE_TIME) -> Move:
    """Return a checked move of what a user gave.

    Raises:
        InvalidParameter: no axis, an angle that is no finite number, or a duration that is not positive.
    """
    return checked(Move, target_deg=target_deg, duration=duration)


def cell_of(target_deg: Mapping[str, Any]) -> Cell:
    """Return a checked cell of what a user gave.

    Raises:
        InvalidParameter: no axis, or an angle that is no finite number.
    """
    return checked(Cell, target_deg=target_deg)


def any_move(
    given: AnyMove | Mapping[str, Any], duration: float | None = None, *, otherwise: float = MOVE_TIME
) -> AnyMove:
    """Return a move of any kind of what a user gave: targets of axes, or what would stand in a program's file.

    Args:
        given: targets [deg] by axis, a mapping such as ``{"walk": {"steps": 4}}``, or a move.
        duration: of a move of joints [s].
        otherwise: its duration unless given [s].

    Raises:
        SimrobError: as :func:`move_of`; or a mapping that is wrong.
    """
    if isinstance(given, Strict):
        made = given
    elif isinstance(given, Mapping) and (kind := kind_of(given)) is not None:
        made = validated(kind, _plain(given), "the move")
    else:
        return move_of(given, otherwise if duration is None else duration)
    if duration is not None:
        raise InvalidParameter("duration", duration, "left out: it goes with targets of axes")
    return made


def checked(kind: type[Entry], /, **content: Any) -> Entry:
    """Return what a user gave as a checked entry of a program.

    Raises:
        InvalidParameter: the first value that cannot be.
    """
    try:
        return kind.model_validate(_plain(content))
    except ValidationError as problem:
        finding = problem.errors()[0]
        key = ".".join(str(part) for part in finding["loc"])
        otherwise = "a finite number [deg]" if key.startswith("target_deg") else "a text"
        raise InvalidParameter(key, finding["input"], _EXPECTED.get(key, otherwise)) from problem


def _plain(value: Any) -> Any:
    """Return a value with numpy's numbers and arrays as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    return [_plain(part) for part in value] if isinstance(value, (list, tuple)) else value
