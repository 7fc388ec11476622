"""The numbers of a station: elements of its ports, and of its file the parameters that can be set before it starts."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from simrob_drake.base.frames import VELOCITY_NAMES, XYZ_QUATERNION_NAMES
from simrob_drake.base.sections import Strict, field_texts
from simrob_drake.extensions.simulink.values.units import UnknownUnit, parse_unit, plain_unit
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.urdf import mass_of, name_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT, with_settings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve

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
            parts = (
                f"{parts.removesuffix(']')}{',' if parts.endswith(']') else '['}{int(part) + 1}]"
            )
        else:
            plain = re.fullmatch(r"[A-Za-z_]\w*", part, re.ASCII)
            own = part if plain else f"'{re.sub(_ODD, lambda found: f'u{ord(found[0]):x}', part)}'"
            parts += f"{'.' if parts else ''}{own}"
    return parts


def elements(ports: StationPorts) -> tuple[dict[str, Element], dict[str, Element]]:
    """Return the numbers of a station's inputs and of its outputs, by name and in order.

    A robot's reference is an input alone.
    """
    named = _declared(ports)
    inputs, outputs = _of_ports(ports.inputs, named), _of_ports(ports.outputs, named)
    return inputs, {name: element for name, element in outputs.items() if name not in inputs}


def _declared(ports: StationPorts) -> dict[str, dict[int, tuple[str, str]]]:
    """Return the names and units of numbers by their place, by port: those of signals, and of inputs by axis."""
    found: dict[str, dict[int, tuple[str, str]]] = {}
    for signal in ports.outputs.signals:
        port = signal.output or signal.names[0].rpartition(".")[0]
        names = [
            port if name == port else f"{port}.{name.rpartition('.')[2]}" for name in signal.names
        ]
        places = signal.entries or range(len(names))
        found.setdefault(port, {}).update(
            zip(places, zip(names, signal.units, strict=True), strict=True)
        )
    for robot in ports.plant.robots.values():
        for suffix, text in (("reference_velocity", "{0.si}/s"), ("feedforward", "{0.effort}")):
            port, units = f"{robot.prefix}{suffix}", map(text.format, robot.model.units)
            found[port] = dict(
                enumerate(zip((f"{port}.{axis}" for axis in robot.axes), units, strict=True))
            )
    return found


def _of_ports(
    ports: Mapping[str, Any], named: Mapping[str, Mapping[int, tuple[str, str]]]
) -> dict[str, Element]:
    return {
        legal(name): Element(legal(name), port, place, unit)
        for port, own in ports.items()
        for place, (name, unit) in (named.get(port) or _undeclared(port, own.size())).items()
    }


def _undeclared(port: str, size: int) -> dict[int, tuple[str, str]]:
    for kind, (names, units) in _UNDECLARED.items():
        if kind in port and len(names) == size:
            return {place: (f"{port}.{name}", units[place]) for place, name in enumerate(names)}
    return {place: (port if size == 1 else f"{port}.{place}", "1") for place in range(size)}


_GAINS = {
    "kp": "{effort}/{si}",
    "ki": "{effort}/({si}·s)",
    "kd": "{effort}·s/{si}",
    "torque_limit": "{effort}",
}
_OF_COMPUTED_TORQUE = {
    "kp": "1/s²",
    "kd": "1/s",
    "torque_limit": "{effort}",
}  # gains and their units
_SECTIONS = ("forces", "controllers", "contact", "floor")  # sections whose numbers are parameters
_LONGEST = 9  # entries that a list of such numbers has


@dataclass(frozen=True)
class Parameter:
    """A number of a station's file."""

    name: str  # by its key, as ``servo.kp.joint_1`` or ``forces.push.force[1]``, as FMI has names
    way: tuple[str, ...]  # to it in the station's file
    start: float  # its value where it is not set
    unit: str  # of SI, or ``deg``


def parameters_of(config: StationConfig) -> dict[str, Parameter]:
    """Return what of a dynamic station can be set, by name.

    These are the gains of each axis, by how much links are heavier, the masses of pieces, gravity, and the numbers of
    forces, controllers, contact and floor.
    """
    station = resolve(config)
    found = [one for robot in station.robots.values() for one in _of_robot(config, robot)]
    for name, piece in station.pieces.items():
        if config.pieces[name].density is None and piece.model.mass > 0:
            found += _numbers(float(piece.model.mass), ("pieces", name, "mass"), "kg")
    found += _numbers(float(config.gravity), ("gravity",), "m/s²")
    for section in _SECTIONS:
        found += _numbers(getattr(config, section), (section,), "1")
    return {parameter.name: parameter for parameter in found}


def with_parameters(config: StationConfig, values: Mapping[Parameter, float]) -> StationConfig:
    """Return a station with other values of some parameters (raises InvalidConfig: a value that cannot be)."""
    settings: dict[str, Any] = {}
    prefix = "" if list(config.robots) == [ONLY_ROBOT] else "robots."
    for parameter, value in values.items():
        match parameter.way:
            case "robots", robot, "servo", gain, axis:
                servo = settings.setdefault(f"{prefix}{robot}.servo", _servo_by_axis(config, robot))
                servo[gain][axis] = value
            case "robots", robot, "mass_factors", link:
                settings.setdefault(f"{prefix}{robot}.mass_factors", {})[link] = value
            case way:
                settings[".".join(way)] = value
    return with_settings(config, settings, "parameters")


def _units(config: StationConfig, robot: str) -> Mapping[str, str]:
    return _OF_COMPUTED_TORQUE if config.servo_of(robot).law == "computed_torque" else _GAINS


def _servo_by_axis(config: StationConfig, robot: str) -> dict[str, Any]:
    """Return a robot's servo section with all gains by axis; they may be those of all robots, or of its own file."""
    resolved = resolve(config).robots[robot]
    gains, axes = resolved.gains, resolved.axes
    by_axis = {
        gain: {
            axis: value
            for axis, value in zip(axes, getattr(gains, gain).tolist(), strict=True)
            if value < math.inf
        }
        for gain in _units(config, robot)
    }
    return config.servo_of(robot).model_dump(mode="json", exclude_none=True) | by_axis


def _of_robot(config: StationConfig, robot: ResolvedRobot) -> Iterator[Parameter]:
    for gain, unit in _units(config, robot.name).items():
        for axis, known, value in zip(
            robot.axes, robot.model.units, getattr(robot.gains, gain), strict=True
        ):
            way = ("robots", robot.name, "servo", gain, axis)
            yield from _numbers(
                float(value), way, unit.format(effort=known.effort, si=known.si), robot.prefix
            )
    stated = config.robots[robot.name].mass_factors
    for link in (
        name_of(link) for link in robot.model.element.iterfind("link") if mass_of(link) > 0
    ):
        to_link = ("robots", robot.name, "mass_factors", link)
        yield from _numbers(float(stated.get(link, 1.0)), to_link, "1", robot.prefix)


def _numbers(value: Any, way: tuple[str, ...], unit: str, prefix: str = "") -> Iterator[Parameter]:
    """Yield the numbers in a section, a list, or a number, with units as the texts below the keys have them."""
    if isinstance(value, Strict):
        texts = field_texts(type(value))
        for field, info in type(value).model_fields.items():
            yield from _numbers(
                getattr(value, field),
                (*way, info.alias or field),
                _unit(field, texts.get(field, "")),
            )
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            if "." not in str(key):
                yield from _numbers(inner, (*way, str(key)), unit)
    elif isinstance(value, Sequence) and not isinstance(value, str) and len(value) <= _LONGEST:
        for index, inner in enumerate(value):
            yield from _numbers(inner, (*way, str(index)), unit)
    elif isinstance(value, float) and math.isfinite(value):
        own = way[2:] if way[0] == "robots" else way
        yield Parameter(legal(prefix + ".".join(own)), way, value, unit)


def _unit(field: str, text: str) -> str:
    """Return the unit that a text has in brackets, the first of several: ``[N·m/rad, or N/m where it slides]``."""
    if field.endswith("_deg"):
        return "deg"
    found = re.search(r"\[([^],;]+)", text)
    if found:
        with suppress(UnknownUnit):
            parse_unit(plain_unit(found[1]))
            return found[1]
    return "1"
