"""What Transform Sensors hand out: parts of a station's frame sensor, or blocks that compute it from these."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import ONE, Form, Signal, Term, added
from simrob_drake.simulink.signals.primitives import Primitive

if TYPE_CHECKING:
    from simrob_drake.simulink.signals.tracing import Tracer

SENSOR = "Transform Sensor"
PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
"""What a frame sensor tells, in the order of its terms."""
_TURNS = ("X", "Y", "Z", "1", "2", "3")
_PORTS = [
    *("Angle", "Axis", "Angle1", "Angle2", "Angle3", "Q", "R"),
    *(f"Omega{axis}" for axis in _TURNS), "QDot", "RDot",
    *(f"Alpha{axis}" for axis in _TURNS), "QDDot", "RDDot",
    *(f"{name}{dots}" for dots in ("", "Dot", "DDot") for name in ("X", "Y", "Z", "Rad", "Azim", "Dist", "Inc")),
]  # fmt: skip
"""Its signals in the order of its ports, of which only those are there that are switched on."""
_DIRECT = {
    **{name: (index,) for index, name in enumerate("XYZ")},
    "Q": (3, 4, 5, 6),
    **{f"{name}Dot": (7 + index,) for index, name in enumerate("XYZ")},
    **{f"Omega{name}": (10 + index,) for index, name in enumerate("XYZ")},
}
_FIRST_PORT = 2  # after the follower's frame


def sensed(tracer: Tracer, node: Node) -> dict[int, Signal]:
    """Return the signals of a Transform Sensor by the number of their right port; what no station has is open."""
    asked = [name for name in _PORTS if node.is_on(f"Sense{name}")]
    made = _Computed(tracer, node)
    return {port: made.signal(name, port) for port, name in enumerate(asked, start=_FIRST_PORT)}


class _Computed:
    """Makes the signals of one sensor."""

    def __init__(self, tracer: Tracer, node: Node) -> None:
        self._tracer, self._node, self._numbers = tracer, node, count()

    def signal(self, name: str, port: int) -> Signal:
        """Return what a port hands out."""
        if name in _DIRECT:
            return [{Term("sensed", self._node, index): 1.0} for index in _DIRECT[name]]
        if name == "R":
            return [self._entry(row, column) for column in range(3) for row in range(3)]
        form = self._form(name)
        return [{Term("open", self._node, port): 1.0} if form is None else form]

    def _form(self, name: str) -> Form | None:
        place, (qw, *turn), (vx, vy, vz) = self._parts(0, 3), self._parts(3, 4), self._parts(7, 3)
        x, y, _ = place
        back = added((-1.0, vx))
        made: dict[str, Callable[[], Form]] = {
            "Angle": lambda: added((2.0, self._angle(self._length(turn), qw))),
            "Rad": lambda: self._length([x, y]),
            "Azim": lambda: self._angle(y, x),
            "Dist": lambda: self._length(place),
            "Inc": lambda: self._angle(place[2], self._length([x, y])),
            "RadDot": lambda: self._ratio(self._dot([x, y], [vx, vy]), self._length([x, y])),
            "AzimDot": lambda: self._ratio(self._dot([x, y], [vy, back]), self._dot([x, y], [x, y])),
            "DistDot": lambda: self._ratio(self._dot(place, [vx, vy, vz]), self._length(place)),
        }
        return made[name]() if name in made else None

    def _entry(self, row: int, column: int) -> Form:
        """Return an entry of the rotation matrix, from the quaternion."""
        qw, *turn = self._parts(3, 4)
        if row == column:
            others = [turn[index] for index in range(3) if index != row]
            return added((1.0, {ONE: 1.0}), (-2.0, self._dot(others, others)))
        sign = 2.0 if (row - column) % 3 == 1 else -2.0
        mixed, about = self._dot([turn[row]], [turn[column]]), self._dot([qw], [turn[3 - row - column]])
        return added((2.0, mixed), (sign, about))

    def _parts(self, first: int, number: int) -> Signal:
        return [{Term("sensed", self._node, index): 1.0} for index in range(first, first + number)]

    def _dot(self, one: Signal, other: Signal) -> Form:
        return added(*((1.0, self._block("product", *pair)) for pair in zip(one, other, strict=True)))

    def _length(self, vector: Signal) -> Form:
        return self._block("function", self._dot(vector, vector), function="sqrt")

    def _angle(self, across: Form, along: Form) -> Form:
        return self._block("function", across, along, function="atan2")

    def _ratio(self, upper: Form, lower: Form) -> Form:
        return self._block("product", upper, lower, divides=[1])

    def _block(self, kind: str, *forms: Form, **figures: object) -> Form:
        term = Term("block", self._node, next(self._numbers))
        inputs = partial(list[Form], forms)
        self._tracer.primitives[term] = Primitive(self._node, kind, figures, inputs, place=term.index)
        return {term: 1.0}
