"""A station as the object that the libraries of pythonfmu and pythonfmu3 call; each unit has a class of its own of it.

Both libraries load a module of Python in the unit, make one object an instance, and call its methods by name.
"""

from __future__ import annotations

import ctypes
import json
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.simulink.fmi.unit import MESSAGE, STOPPED, TIME, variables_of
from simrob_drake.extensions.simulink.stepping.station import StepFailed, SteppedStation

STATION_FILE = "station.yaml"
_OK, _WARNING, _ERROR = 0, 1, 3


class UnitLogEntry(NamedTuple):
    """An entry of the log that the tool which runs the unit keeps."""

    status: int
    category: str
    msg: str
    debug: bool = False


class StepResult(NamedTuple):
    """What became of a step: false is an error to FMI 2.0, and 3.0 reads the status."""

    status: int
    terminateSimulation: bool = False  # noqa: N815  # as FMI 3.0 calls it

    def __bool__(self) -> bool:
        return self.status == _OK


class Fmi2Slave:
    """A station of FMI; the name is that by which pythonfmu finds it."""

    def __init__(self, *, resources: str, **_: Any) -> None:
        self._station = SteppedStation(Path(resources) / STATION_FILE)
        self._names = [variable.name for variable in variables_of(self._station)]
        self._refused: dict[str, str] = {}
        self._messages: list[UnitLogEntry] = []
        self._offset: float | None = None

    def terminate(self, *_: float) -> None:
        """Do nothing: parameters and inputs may be set until the first step, which says what they cannot be."""

    setup_experiment = enter_initialization_mode = exit_initialization_mode = terminate

    def do_step(self, current_time: float, step_size: float) -> StepResult:
        """Go on by a step; where that cannot be, the reason is logged and the step is an error."""
        if self._offset is None:
            self._offset = current_time - self._station.time
        try:
            if self._refused:
                raise StepFailed("; ".join(self._refused.values()))
            self._station.advance(current_time - self._offset + step_size)
        except (StepFailed, SimrobError) as problem:
            self._messages.append(UnitLogEntry(_ERROR, "logStatusError", str(problem)))
            return StepResult(_ERROR)
        if self._station.stopped:
            self._messages.append(UnitLogEntry(_WARNING, "logStatusWarning", self._station.stopped))
        return StepResult(_OK, bool(self._station.stopped))

    def get_real(self, references: list[int]) -> list[float]:
        """Return numbers; of a station that cannot be built as its parameters say, those without them."""
        return [self._get(self._names[reference]) for reference in references]

    def _get(self, name: str) -> float:
        if name == TIME:
            return self._station.time + (self._offset or 0.0)
        try:
            return self._station.get(name)
        except SimrobError:  # which the step will tell
            return 0.0

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Set inputs and parameters; one that cannot be makes the next step an error, and not the unit unusable."""
        for reference, value in zip(references, values, strict=True):
            name = self._names[reference]
            try:
                self._station.set(name, value)
                self._refused.pop(name, None)
            except SimrobError as problem:
                self._refused[name] = str(problem)

    get_float64, set_float64 = get_real, set_real

    def get_boolean(self, references: list[int]) -> list[bool]:
        """Return whether a monitor ended the run."""
        return [
            self._names[reference] == STOPPED and bool(self._station.stopped)
            for reference in references
        ]

    def get_string(self, references: list[int]) -> list[str]:
        """Return why a monitor ended the run."""
        return [
            self._station.stopped if self._names[reference] == MESSAGE else ""
            for reference in references
        ]

    def _get_log_queue(self) -> list[UnitLogEntry]:
        return self._messages

    def _get_fmu_state(self) -> dict[str, Any]:
        return {**self._station.state(), "offset": self._offset}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._offset = state["offset"]
        self._station.put(state)

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return json.dumps(state).encode()

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any]:
        return dict(json.loads(state))


def keep(namespace: dict[str, Any]) -> None:
    """Keep the variables of a unit's module: pythonfmu runs it for every instance, and lets it go once too often."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(namespace))
