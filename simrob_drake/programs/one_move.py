"""One move of a program, whoever does it: what messages call it, and where it leads axes that it names."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.robots.catalog import RobotModel

_ROUNDING = 1e-9  # rad or m


@contextmanager
def naming(move: str) -> Iterator[None]:
    """Put the name of a move before what goes wrong with it."""
    try:
        yield
    except SimrobError as problem:
        if move:
            problem.args = (f"{move}: {problem}",)
        raise


def move_name(number: int, count: int, file: str = "") -> str:
    """Return what messages call a move of a program that has so many, and may stand in a file."""
    if file:
        return f"{file}: moves[{number}]"
    return f"move {number}" if count > 1 else "the move"


def targets_on(model: RobotModel, target_deg: Mapping[str, float], where: str, time: float = 0.0) -> dict[int, float]:
    """Return the targets of a move on one robot: the place of each axis, and its position [rad or m].

    Args:
        model: the robot.
        target_deg: by axis name or alias.
        where: what messages call the move.
        time: how long it takes, for the error [s].

    Raises:
        UnknownName: an axis that the robot does not have; proposes the nearest.
        InvalidParameter: an axis under two names.
        JointLimitExceeded: a target beyond an axis' limits; tells by how much.
    """
    names, units, slides = list(model.axes), model.user_units, model.prismatic
    lower, upper = model.axis_limits
    found: dict[int, float] = {}
    for axis, value in target_deg.items():
        place = model.axis_index(axis, where)
        if place in found:
            raise InvalidParameter(f"{where}: {axis}", "another name of an axis that it moves, too", "named once")
        position = float(value * units[place])
        bound = lower[place] if position < lower[place] else upper[place]
        if abs(position - np.clip(position, lower[place], upper[place])) > _ROUNDING:
            unit, limit = ("m" if slides[place] else "deg"), bound / units[place]
            shown = f"{value:.4g} {unit}, {abs(value - limit):.4g} {unit} beyond its limit of {limit:.4g} {unit}"
            raise JointLimitExceeded(where, names[place], point=1, time=time, value=position, shown=shown)
        found[place] = position
    return found
