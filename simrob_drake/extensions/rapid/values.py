"""The data of RAPID: numbers, texts, records, arrays; and poses among them as transforms [m] and back [mm]."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import WRONG_NORM, Vector, has_wrong_norm
from simrob_drake.base.frames import rotation_of as rotation_of_quaternion
from simrob_drake.base.messages import message


class WrongType(ValueError):
    """A value of another type than is asked for; the text is what messages say, without the place."""


class LeftOut(WrongType):
    """What leaves its line out and not the program: a name that no module declares, a move that cannot be made."""


class NoData(LeftOut):
    """A name of data that no module declares, or that is a signal of which nothing is known."""


@dataclass
class RecordValue:
    """A value of a record type, with its components by name in lower case."""

    kind: str
    parts: "dict[str, Value]"

    def __getitem__(self, path: str) -> Any:
        """Return a component, or one of a component: ``record["trans.x"]``."""
        name, _, rest = path.partition(".")
        part = self.parts[name]
        return part[rest] if rest and isinstance(part, RecordValue) else part

    def flat(self) -> list[Any]:
        """Return all that it holds in a row, components of components, too."""
        return [
            value
            for part in self.parts.values()
            for value in (part.flat() if isinstance(part, RecordValue) else [part])
        ]


@dataclass(frozen=True)
class SignalName:
    """An input or output of the robot's controller, by its name as the module writes it; case is not significant."""

    name: str


Value: TypeAlias = "float | bool | str | RecordValue | SignalName | list[Any]"

_MOST_ELEMENTS = 1_000_000  # of an array
_LARGE = 1e9  # numbers beyond are written with an exponent
_SIMPLE: Mapping[str, Value] = {"num": 0.0, "bool": False, "string": ""}
_SIGNALS = frozenset(f"signal{kind}" for kind in ("di", "do", "gi", "go", "ai", "ao"))
_SHAPES = {
    float: message("rapid.a_num", "a num"),
    bool: message("rapid.a_bool", "a bool"),
    str: message("rapid.a_string", "a string"),
    list: message("rapid.an_aggregate", "an aggregate"),
    SignalName: message("rapid.a_signal", "a signal"),
}


@dataclass
class Types:
    """The types of a program: components (type, name) of records by name, and other names of types."""

    records: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)

    def known(self, kind: str) -> bool:
        """Tell whether there is such a type."""
        return self.plain(kind) in (*self.records, *_SIMPLE, *_SIGNALS)

    def plain(self, kind: str) -> str:
        """Return the type that a name stands for, in lower case."""
        name, seen = kind.lower(), set[str]()
        while name in self.aliases and name not in seen:
            seen.add(name)
            name = self.aliases[name]
        return name

    def default(self, kind: str, sizes: Sequence[int] = ()) -> Value:
        """Return what data of a type holds that is given no value, an array of it with sizes."""
        if sizes:
            if not 0 < math.prod(sizes) <= _MOST_ELEMENTS:
                raise WrongType(
                    message(
                        "rapid.array_of",
                        "an array of {size} elements",
                        size="×".join(map(str, sizes)),
                    )
                )
            return [self.default(kind, sizes[1:]) for _ in range(sizes[0])]
        name = self.plain(kind)
        if name in self.records:
            return RecordValue(name, {part: self.default(own) for own, part in self.records[name]})
        return SignalName("") if name in _SIGNALS else _SIMPLE[name]

    def fitted(self, kind: str, value: Value, dimensions: int = 0) -> Value:
        """Return a value's copy as one of a type, aggregates as records and arrays; raises WrongType: it is none."""
        name = self.plain(kind)
        if dimensions:
            if not isinstance(value, list):
                raise WrongType(
                    message(
                        "rapid.array_asked_for",
                        "{shape} where an array of {name} is asked for",
                        shape=shape(value),
                        name=name,
                    )
                )
            return [self.fitted(kind, one, dimensions - 1) for one in value]
        if name in self.records:
            return self._record(name, value)
        desired = SignalName if name in _SIGNALS else type(_SIMPLE[name])
        if type(value) is not desired:
            raise WrongType(
                message(
                    "rapid.shape_asked_for",
                    "{shape} where {other} is asked for",
                    shape=shape(value),
                    other=_SHAPES[desired],
                )
            )
        return value

    def _record(self, name: str, value: Value) -> RecordValue:
        parts = self.records[name]
        if isinstance(value, RecordValue) and value.kind == name:
            values = list(value.parts.values())
        elif isinstance(value, list):
            values = value
        else:
            raise WrongType(
                message(
                    "rapid.record_asked_for",
                    "{shape} where a {name} is asked for",
                    shape=shape(value),
                    name=name,
                )
            )
        if len(values) != len(parts):
            raise WrongType(
                message(
                    "rapid.aggregate_of",
                    "an aggregate of {count} where a {name} has {components} components",
                    count=len(values),
                    name=name,
                    components=len(parts),
                )
            )
        return RecordValue(
            name,
            {part: self.fitted(own, one) for (own, part), one in zip(parts, values, strict=True)},
        )


def shape(value: Value) -> str:
    """Return what a value is, for messages."""
    return (
        message("rapid.a_kind", "a {kind}", kind=value.kind)
        if isinstance(value, RecordValue)
        else _SHAPES[type(value)]
    )


def texted(value: Value) -> str:
    """Return a value as RAPID writes it."""
    if isinstance(value, RecordValue):
        return texted(list(value.parts.values()))
    if isinstance(value, list):
        return f"[{','.join(map(texted, value))}]"
    if isinstance(value, SignalName):
        return value.name
    if isinstance(value, bool):
        return str(value).upper()
    return '"' + value.replace('"', '""') + '"' if isinstance(value, str) else number_text(value)


def number_text(value: float) -> str:
    """Return a number by the fewest digits that give it back, to 12 decimals."""
    if abs(value) >= _LARGE:
        return f"{value:.15G}" if value % _LARGE else f"{value:.0E}"
    return repr(round(float(value), 12) + 0.0).removesuffix(".0")


def place_of(pos: RecordValue) -> Vector:
    """Return a ``pos`` [mm] as a place (3,) [m]."""
    return np.array(pos.flat(), dtype=float) / 1e3


def rotation_of(orient: RecordValue) -> RotationMatrix:
    """Return the rotation of an ``orient``; raises WrongType: its quaternion is all zero."""
    wxyz = np.array(orient.flat(), dtype=float)
    if not np.linalg.norm(wxyz) > 0:
        raise WrongType(
            message("rapid.orient_of_zeros", "an orient of four zeros, which is no rotation,")
        )
    return rotation_of_quaternion(wxyz)


_ROUNDED_NORM = 1e-4
"""Deviation of a quaternion's norm from 1 that is due to rounding: programs write quaternions with four decimals."""


class OrientFault(NamedTuple):
    """A quaternion whose norm is not 1.

    Attributes:
        text: the fault in words, with the norm.
        is_wrong: whether the norm is so far from 1 that it cannot be rounding.
    """

    text: str
    is_wrong: bool


def orient_faults(value: "Value", name: str = "") -> list[OrientFault]:
    """Find the quaternions in a value whose norm is not 1.

    Args:
        value: data of any type, such as a ``robtarget`` or an array of them.
        name: name of the value for messages; empty if it has none. Names of components and indices are appended to it.
    """
    faults = []
    if isinstance(value, list):
        for number, element in enumerate(value, 1):  # RAPID counts from 1
            faults += orient_faults(element, f"{name}{{{number}}}")
    elif isinstance(value, RecordValue) and value.kind == "orient":
        faults += _faults_of_quaternion(value, name)
    elif isinstance(value, RecordValue):
        for component, part in value.parts.items():
            faults += orient_faults(part, f"{name}.{component}" if name else component)
    return faults


def _faults_of_quaternion(orient: RecordValue, name: str) -> list[OrientFault]:
    """Find the fault of a single quaternion: a list with one entry, or none."""
    quaternion = np.array(orient.flat(), dtype=float)
    norm = float(np.linalg.norm(quaternion))
    deviation = abs(norm - 1.0)
    if deviation <= _ROUNDED_NORM:
        return []
    # A quaternion of zeros is refused when something is turned by it, in `rotation_of`, so it is not reported here.
    # Only the axes of a load's inertia, `aom`, turn nothing: their zeros are reported.
    is_of_load = name.endswith("aom")
    if norm == 0 and not is_of_load:
        return []
    owner = message("rapid.of_name", " of {name}", name=name) if name else ""
    problem = message(
        "rapid.quaternion_norm",
        "the quaternion {quaternion}{owner} has a norm of {norm:.6g}; it must be 1 within {tolerance:g}",
        quaternion=texted(orient),
        owner=owner,
        norm=norm,
        tolerance=WRONG_NORM,
    )
    remedy = "" if norm == 0 else message("rapid.normalised_here", "; it is normalised here")
    return [OrientFault(f"{problem}{remedy}", has_wrong_norm(quaternion))]


def transform_of(pose: RecordValue) -> RigidTransform:
    """Return a ``pose`` [mm], or the place and orientation of a ``robtarget``, as a transform [m]."""
    return RigidTransform(rotation_of(pose["rot"]), place_of(pose["trans"]))


def _vector(kind: str, names: str, values: Vector | Sequence[float]) -> RecordValue:
    return RecordValue(kind, dict(zip(names.split(), map(float, values), strict=True)))


pos_of = partial(_vector, "pos", "x y z")


def orient_of(rotation: RotationMatrix) -> RecordValue:
    """Return a rotation as an ``orient``, its first component not negative."""
    wxyz = rotation.ToQuaternion().wxyz()
    return _vector("orient", "q1 q2 q3 q4", wxyz if wxyz[0] >= 0 else -wxyz)


def pose_of(transform: RigidTransform) -> RecordValue:
    """Return a transform [m] as a ``pose`` [mm]."""
    return RecordValue(
        "pose",
        {"trans": pos_of(1e3 * transform.translation()), "rot": orient_of(transform.rotation())},
    )


FREE_AXES = _vector(
    "extjoint", "eax_a eax_b eax_c eax_d eax_e eax_f", [9e9] * 6
)  # of robots without external axes
confdata_of = partial(_vector, "confdata", "cf1 cf4 cf6 cfx")
robjoint_of = partial(_vector, "robjoint", "rax_1 rax_2 rax_3 rax_4 rax_5 rax_6")


def robtarget_of(transform: RigidTransform, configuration: Sequence[float]) -> RecordValue:
    """Return a transform [m] with a configuration as a ``robtarget`` [mm]."""
    return RecordValue(
        "robtarget",
        {**pose_of(transform).parts, "robconf": confdata_of(configuration), "extax": FREE_AXES},
    )
