"""A station as the slave class that pythonfmu wraps; each unit is a class of its own made of this one."""

from __future__ import annotations

import ctypes
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element as XmlElement
from xml.etree.ElementTree import SubElement

from pythonfmu import Boolean, DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String
from pythonfmu.enums import Fmi2Status

from simrob_drake.errors import SimrobError
from simrob_drake.simulink.fmi.unit import Element, StepFailed, SteppedStation

STATION_FILE = "station.yaml"

_BASES = {
    "1": {},
    "m": {"m": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "rad": {"rad": "1"},
    "rad/s": {"rad": "1", "s": "-1"},
    "rad/s2": {"rad": "1", "s": "-2"},
    "m/s2": {"m": "1", "s": "-2"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
}
"""Units of the variables by their SI bases."""


class StationSlave(Fmi2Slave):
    """A station of FMI: inputs and outputs are its ports, an element each, named ``<port>.<axis or element>``."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._station = SteppedStation(Path(self.resources) / STATION_FILE)
        self.description = self._station.config.description
        self.default_experiment = DefaultExperiment(
            start_time=0.0, stop_time=self._station.config.duration, step_size=1e-3
        )
        self._units: dict[str, str] = {}
        self._refused: dict[str, str] = {}
        for element in self._station.inputs:
            setter = partial(self._set, element)
            self._register(Real(element.name, causality=Fmi2Causality.input, setter=setter), element)
        for element in self._station.outputs:
            if element.name in self._units:
                continue  # the reference is an input, too
            self._register(Real(element.name, causality=Fmi2Causality.output), element)
        for variable in (
            Boolean("stopped", getter=lambda: bool(self._station.stopped), **_DISCRETE),
            String("message", getter=lambda: self._station.stopped, **_DISCRETE),
        ):
            self.register_variable(variable, nested=False)

    def _register(self, variable: Any, element: Element) -> None:
        variable.getter = partial(self._station.get, element)
        self.register_variable(variable, nested=False)
        self._units[element.name] = element.unit

    def _set(self, element: Element, value: float) -> None:
        """Set an input; one that cannot be makes the next step an error, and not the unit unusable."""
        try:
            self._station.set(element, value)
            self._refused.pop(element.name, None)
        except SimrobError as problem:
            self._refused[element.name] = str(problem)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Go on by a step; where that cannot be, the reason is logged and the step is an error."""
        if self._refused:
            self.log("; ".join(self._refused.values()), Fmi2Status.error)
            return False
        try:
            self._station.advance(current_time + step_size)
        except (StepFailed, SimrobError) as problem:
            self.log(str(problem), Fmi2Status.error)
            return False
        if self._station.stopped:
            self.log(self._station.stopped, Fmi2Status.warning)
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        return self._station.state()

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._station.put(state)

    def to_xml(self, model_options: dict[str, str] | None = None) -> XmlElement:
        """Return the model description, with units."""
        root: XmlElement = super().to_xml({**(model_options or {}), **_ABILITIES})
        definitions = XmlElement("UnitDefinitions")
        for unit in sorted(set(self._units.values())):
            SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", _BASES.get(unit, {}))
        root.insert(1, definitions)
        structure = root.find("ModelStructure")
        outputs = structure.find("Outputs") if structure is not None else None
        if structure is not None and outputs is not None:
            unknowns = SubElement(structure, "InitialUnknowns")
            for output in outputs:
                SubElement(unknowns, "Unknown", index=output.get("index", ""))
        for variable in root.iter("ScalarVariable"):
            real = variable.find("Real")
            if real is not None:
                real.set("unit", self._units[variable.get("name", "")])
        return root


MOST_INSTANCES = 100_000
"""Of one unit in one process."""


def keep(namespace: dict[str, Any]) -> None:
    """Keep the variables of a unit's module alive.

    pythonfmu gives back one reference too many to them for every instance, and the second would find them gone.
    """
    for _ in range(MOST_INSTANCES):
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(namespace))


_DISCRETE = {"causality": Fmi2Causality.output, "variability": Fmi2Variability.discrete}
_ABILITIES = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
