"""The numbers of a station's ports, one by one: names that FMI takes, and units."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from simrob_drake.frames import XYZ_QUATERNION_NAMES
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.poses import VELOCITY_NAMES

_XYZ = ("x", "y", "z")
_UNDECLARED = {
    "pose": (XYZ_QUATERNION_NAMES, ("m",) * 3 + ("1",) * 4),
    "velocity": (VELOCITY_NAMES, ("m/s",) * 3 + ("rad/s",) * 3),
    "force": (_XYZ, ("N",) * 3),
    "torque": (_XYZ, ("N·m",) * 3),
}
"""Names and units of ports that no signal of a result tells, by what is in the port's name."""

_ODD = r"""[^ !#-&(-[\]-~]"""
"""Letters that FMI has not even in quotes."""


@dataclass(frozen=True)
class Element:
    """One number of a port."""

    name: str  # ``<port>.<element>``, as :func:`legal` has it; ``<port>`` alone where it is the only one
    port: str
    index: int  # in the port
    unit: str  # of SI


def legal(name: str) -> str:
    """Return a dotted name as FMI has structured ones: ``walk.capture.0`` is ``walk.capture[1]``, ``a-b`` is ``'a-b'``.

    Elements without a name count from 1, as in MATLAB; those of a matrix are ``A[1,2]``.
    """
    parts = ""
    for part in name.split("."):
        if part.isdecimal() and parts:
            parts = f"{parts.removesuffix(']')}{',' if parts.endswith(']') else '['}{int(part) + 1}]"
        else:
            parts += f"{'.' if parts else ''}{_part(part)}"
    return parts


def _part(part: str) -> str:
    if re.fullmatch(r"[A-Za-z_]\w*", part, re.ASCII):
        return part
    return f"'{re.sub(_ODD, lambda found: f'u{ord(found[0]):x}', part)}'"


def elements(ports: StationPorts) -> tuple[dict[str, Element], dict[str, Element]]:
    """Return the numbers of a station's inputs and of its outputs, by name and in order.

    A robot's reference is an input alone.
    """
    named = _declared(ports)
    inputs = _of_ports({name: port.size() for name, port in ports.inputs.items()}, named)
    outputs = _of_ports({name: port.size() for name, port in ports.outputs.items()}, named)
    return inputs, {name: element for name, element in outputs.items() if name not in inputs}


def _declared(ports: StationPorts) -> dict[str, dict[int, tuple[str, str]]]:
    """Return the names and units of numbers by their place, by port: those of signals, and of inputs by axis."""
    found: dict[str, dict[int, tuple[str, str]]] = {}
    for signal in ports.signals:
        port = signal.output or signal.names[0].rpartition(".")[0]
        names = [port if name == port else f"{port}.{name.rpartition('.')[2]}" for name in signal.names]
        places = signal.entries or range(len(names))
        found.setdefault(port, {}).update(zip(places, zip(names, signal.units, strict=True), strict=True))
    for robot in ports.plant.robots.values():
        for suffix, units in (
            ("reference_velocity", [f"{unit.si}/s" for unit in robot.model.units]),
            ("feedforward", [unit.effort for unit in robot.model.units]),
        ):
            port = f"{robot.prefix}{suffix}"
            names = [f"{port}.{axis}" for axis in robot.axes]
            found[port] = dict(enumerate(zip(names, units, strict=True)))
    return found


def _of_ports(sizes: Mapping[str, int], named: Mapping[str, Mapping[int, tuple[str, str]]]) -> dict[str, Element]:
    found = {}
    for port, size in sizes.items():
        for place, (name, unit) in (named.get(port) or _undeclared(port, size)).items():
            found[legal(name)] = Element(legal(name), port, place, unit)
    return found


def _undeclared(port: str, size: int) -> dict[int, tuple[str, str]]:
    for kind, (names, units) in _UNDECLARED.items():
        if kind in port and len(names) == size:
            return {place: (f"{port}.{name}", units[place]) for place, name in enumerate(names)}
    return {place: (port if size == 1 else f"{port}.{place}", "1") for place in range(size)}
