"""Walks that somebody commands while a run is under way, and the table of commands by which it can be repeated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING, TypeAlias, cast

from pydrake.systems.framework import Context, Diagram

from simrob_drake.arguments import instance
from simrob_drake.errors import InvalidParameter, one_of, quoted
from simrob_drake.frames import numbers
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
    from simrob_drake.parts.controllers.walk import Walk, WalkingLoop
    from simrob_drake.walking.commands import Commanded

Hands: TypeAlias = Mapping[str, Callable[[float], Sequence[float] | None]]
"""By the name of a controller of kind ``walk``, what it is asked for at a time [s]: speeds ahead and to the left [m/s],
turn [rad/s]; None leaves it as it is."""
_DIGITS = 9  # of degrees in a second: a table holds no more, and a run is to be repeated to the last bit


class ByHand:
    """Hands over what walks are asked for, after each accepted step; their next sample obeys."""

    def __init__(self, config: StationConfig, hands: Hands | None) -> None:
        """Prepare.

        Raises:
            InvalidParameter: something else than functions by name, or a name of something that is no walk.
        """
        self._hands = {} if hands is None else instance(hands, "commands", Mapping, "a mapping by controller")
        self._rows: dict[str, list[Commanded]] = {}
        walks = [name for name, section in config.controllers.items() if section.kind == "walk"]
        for name, ask in self._hands.items():
            one_of("walk", name, walks)
            if not callable(ask):
                raise InvalidParameter(f"commands: {name}", ask, "a function of the time")

    def look(self, diagram: Diagram, context: Context) -> None:
        """Ask, and tell the walks; of the moment at which a run begins nobody is asked.

        Raises:
            InvalidParameter: an answer that is no command.
        """
        time = context.get_time()
        for name, ask in self._hands.items():
            if not time or (command := ask(time)) is None:
                continue
            row, rows = _row(name, time, command), self._rows.setdefault(name, [])
            if not rows or row.command != rows[-1].command:
                rows.append(row)
                loop = cast("WalkingLoop", diagram.GetSubsystemByName(f"controller.{name}"))
                loop.command_by_hand(loop.GetMyMutableContextFromRoot(context), row.command)

    def commanded(self, config: StationConfig) -> StationConfig:
        """Return a station whose tables hold what was commanded: run again, it does the same."""
        sections = {name: cast("Walk", config.controllers[name]).commanded(rows) for name, rows in self._rows.items()}
        return config.model_copy(update={"controllers": {**config.controllers, **sections}}) if sections else config

    @property
    def names(self) -> tuple[str, ...]:
        """The walks that were commanded."""
        return tuple(self._rows)


def _row(name: str, time: float, command: Sequence[float]) -> Commanded:
    from simrob_drake.walking.commands import Commanded  # loaded where a walk is commanded: most stations have none

    values = numbers(command)
    if values.shape != (3,) or not all(abs(value) < float("inf") for value in values):
        expected = "three numbers: speeds ahead and to the left [m/s], turn [rad/s]"
        raise InvalidParameter(f"commands: {name} at {time:g} s", quoted(command), expected)
    ahead, left, turn = values.tolist()
    return Commanded(time=time, ahead=ahead, sideways=left, turn_deg=round(degrees(turn), _DIGITS))
