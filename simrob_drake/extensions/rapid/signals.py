"""The signals of a controller, as a table says what they do and what they are: `--io table.yaml`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PlainSerializer, model_validator

from simrob_drake.base.arguments import as_path
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Strict, validate_section
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.programs.moves.kinds import AnyMove
from simrob_drake.programs.moves.move import Move

Does = Annotated[tuple[AnyMove, ...], PlainSerializer(list)]


class SignalEntry(Strict):
    """What a signal does or is; one of its keys."""

    does: dict[int, Does] | None = None
    """Of an output: the moves of a program that are done when it gets a value, as `{1: [{attach: part}]}`."""
    is_: Number | dict[float, Number] | None = Field(None, alias="is")
    """Of an input: its value, or its values from times on [s], as `{0: 0, 2.5: 1}`."""
    sensor: str | None = None
    """Of an input: the signal of the station that it watches, as `distance.part`."""
    below: Number | None = None
    """It is 1 while that signal is below this value, in the signal's unit."""
    above: Number | None = None
    """It is 1 while that signal is above this value."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(value is not None for value in (self.does, self.is_, self.sensor)) != 1:
            raise ValueError(
                message("rapid.one_of_signal", "a signal is told by one of does, is and sensor")
            )
        if (self.sensor is not None) != ((self.below is None) != (self.above is None)):
            raise ValueError(
                message("rapid.sensor_with_bound", "a sensor goes with one of below and above")
            )
        return self


class SignalTable(Strict):
    """All signals by name."""

    signals: dict[str, SignalEntry] = Field(default_factory=dict)


class Signals:
    """The signals of a controller while a program is done: what was set, and what the table says of the rest.

    Names may be in capitals or not, as in RAPID.
    """

    def __init__(self, table: SignalTable | None = None) -> None:
        """Take a table; without one outputs do nothing, and inputs are not known."""
        entries = (table or SignalTable()).signals
        self._entries = {name.lower(): entry for name, entry in entries.items()}
        self._set: dict[str, float] = {}

    @classmethod
    def load(cls, file: Path | str) -> "Signals":
        """Return the signals of a table; raises InvalidConfig: an unreadable file, or a wrong entry with its key."""
        source = as_path(file, "file")
        return cls(validate_section(SignalTable, read_yaml(source), source))

    @property
    def sensors(self) -> list[str]:
        """The signals of the station that inputs watch."""
        return [entry.sensor for entry in self._entries.values() if entry.sensor is not None]

    @property
    def inputs(self) -> list[str]:
        """The names of all signals that are no outputs."""
        return [name for name, entry in self._entries.items() if entry.does is None]

    def put(self, name: str, value: float) -> Sequence[Move] | None:
        """Set an output, and return what that does; None if the table has no such output."""
        self._set[name.lower()] = value
        entry = self._entries.get(name.lower())
        return None if entry is None or entry.does is None else entry.does.get(int(value), ())

    def value(self, name: str, time: float, seen: Mapping[str, float]) -> float | None:
        """Return the value of a signal at a time [s], with what sensors see; None if nothing tells."""
        entry = self._entries.get(name.lower())
        if entry is None or entry.does is not None:
            return self._set.get(name.lower(), None if entry is None else 0.0)
        if entry.sensor is not None:
            now = seen.get(entry.sensor)
            if now is None:
                return None
            return float(
                now < entry.below if entry.below is not None else now > (entry.above or 0.0)
            )
        if isinstance(entry.is_, dict):
            return max(
                ((at, value) for at, value in entry.is_.items() if at <= time), default=(0.0, 0.0)
            )[1]
        return entry.is_

    def next_change(self, name: str, time: float) -> float | None:
        """Return when an input changes next [s]; None if its table tells of no change."""
        entry = self._entries.get(name.lower())
        changes: Any = entry.is_ if entry is not None and isinstance(entry.is_, dict) else ()
        return min((at for at in changes if at > time), default=None)

    def watches(self, name: str) -> bool:
        """Tell whether an input watches a sensor, which nothing tells beforehand."""
        entry = self._entries.get(name.lower())
        return entry is not None and entry.sensor is not None
