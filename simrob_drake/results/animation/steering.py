"""Sliders and keys by which the user of a page commands the walks of a station."""

from collections.abc import Callable
from functools import partial
from math import radians

from simrob_drake.results.animation.window import Board, Control
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.walking.parameters import MaxSpeed

_AHEAD, _LEFT, _TURN, _STOP = "ahead ↑ ↓ [m/s]", "left Q E [m/s]", "turn ← → [°/s]", "stop: space"
_NOTCHES = 5  # from rest to the max_speed


class Steering:
    """What the user of a page commands: for each walk a slider for each speed, and a button that stops.

    Attributes:
        controls: for the page; those of several walks have the walk's name before theirs. The keys are the first's.
        hands: what each walk is asked for at a time, as ``simulate(commands=...)`` takes it; nothing before it is set.
        board: the page, which is shown when a walk was stopped.
    """

    def __init__(self, config: StationConfig) -> None:
        """Prepare; a station without walks has nothing to set."""
        walks = {name: section for name, section in config.controllers.items() if section.kind == "walk"}
        self.controls = dict[str, Control]()
        self.hands: dict[str, Callable[[float], tuple[float, float, float] | None]] = {}
        station = resolve(config)
        for number, (name, section) in enumerate(walks.items()):
            prefix = f"{name}: " if len(walks) > 1 else ""
            parameters = section.walking(station.robot(section.robot, f"controllers.{name}"))
            self.controls |= _controls(parameters.max_speed, prefix, keys=number == 0)
            self.hands[name] = partial(self._command, prefix)
        self.board: Board | None = None
        self._begun = set[str]()

    def _command(self, prefix: str, _: float) -> tuple[float, float, float] | None:
        sliders = [prefix + name for name in (_AHEAD, _LEFT, _TURN)]
        stop = self.controls[prefix + _STOP]
        if stop.value:
            stop.value = 0.0
            for name in sliders:
                self.controls[name].value = 0.0
                if self.board is not None:
                    self.board.show(name)
            self._begun.add(prefix)
        ahead, left, turn = (round(self.controls[name].value, 6) for name in sliders)
        if ahead or left or turn:
            self._begun.add(prefix)
        return (ahead, left, radians(turn)) if prefix in self._begun else None


def _controls(max_speed: MaxSpeed, prefix: str, *, keys: bool) -> dict[str, Control]:
    """Return the controls of a walk."""
    found = {}
    for name, low, high, less, more in (
        (_AHEAD, max_speed.backward, max_speed.ahead, "ArrowDown", "ArrowUp"),
        (_LEFT, max_speed.sideways, max_speed.sideways, "KeyE", "KeyQ"),
        (_TURN, max_speed.turn_deg, max_speed.turn_deg, "ArrowRight", "ArrowLeft"),
    ):
        step = (high or 1.0) / _NOTCHES
        found[prefix + name] = Control(0.0, -low, high, step, *((less, more) if keys else ()))
    return {**found, prefix + _STOP: Control(key="Space" if keys else None)}
