"""The functions of RAPID that depend on their arguments alone."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.base.frames import three_point_frame
from simrob_drake.extensions.rapid.expressions import Call
from simrob_drake.extensions.rapid.values import (
    RecordValue,
    Value,
    WrongType,
    number_text,
    orient_of,
    place_of,
    pos_of,
    pose_of,
    rotation_of,
    texted,
    transform_of,
)

_DECIMALS = 6  # of numbers as texts, unless asked for


def _of(function: Callable[..., Value], *kinds: str) -> Callable[[Call], Value]:
    """Return a function of arguments of some types."""
    return lambda call: function(*(call.value(index, kind) for index, kind in enumerate(kinds)))


def _of_numbers(function: Callable[..., float]) -> Callable[[Call], Value]:
    def result(call: Call) -> Value:
        return float(function(*(call.value(index, "num") for index in range(call.count))))

    return result


def _offs(call: Call) -> Value:
    target, offset = call.value(0, "robtarget"), [call.value(index, "num") for index in (1, 2, 3)]
    return _moved(target, RigidTransform(np.array(offset) / 1e3) @ transform_of(target))


def _rel_tool(call: Call) -> Value:
    target, offset = call.value(0, "robtarget"), [call.value(index, "num") for index in (1, 2, 3)]
    turn = [math.radians(call.option(name, "num", 0.0)) for name in ("rx", "ry", "rz")]
    rotation = RotationMatrix.MakeXRotation(turn[0]) @ RotationMatrix.MakeYRotation(turn[1])
    tool = RigidTransform(rotation @ RotationMatrix.MakeZRotation(turn[2]), np.array(offset) / 1e3)
    return _moved(target, transform_of(target) @ tool)


def _moved(target: RecordValue, transform: RigidTransform) -> RecordValue:
    return RecordValue("robtarget", {**target.parts, **pose_of(transform).parts})


def _rounded(how: Callable[[float], float]) -> Callable[[Call], Value]:
    def result(call: Call) -> Value:
        scale = 10.0 ** call.option("dec", "num", 0.0)
        return float(how(call.value(0, "num") * scale) / scale)

    return result


def _euler_zyx(call: Call) -> Value:
    roll_pitch_yaw = RollPitchYaw(rotation_of(call.value(0, "orient"))).vector()
    return math.degrees(
        roll_pitch_yaw[next(index for index, axis in enumerate("xyz") if call.has(axis))]
    )


def _of_positions(function: Callable[..., Any], count: int = 2) -> Callable[[Call], Value]:
    return _of(
        lambda *places: float(function(*(np.array(one.flat()) for one in places))), *["pos"] * count
    )


def _num_to_str(call: Call) -> Value:
    return f"{call.value(0, 'num'):.{int(call.value(1, 'num'))}{'e' if call.has('exp') else 'f'}}"


def _val_to_str(call: Call) -> Value:
    value = call.value(0)
    return (
        number_text(float(f"{value:.{_DECIMALS}g}"))
        if isinstance(value, float)
        else texted(value).strip('"')
    )


def _str_find(call: Call) -> Value:
    text, begin = call.value(0, "string"), int(call.value(1, "num")) - 1
    places = (
        place + 1 for place in range(begin, len(text)) if text[place] in call.value(2, "string")
    )
    return float(next(places, len(text) + 1))


def _str_match(call: Call) -> Value:
    text, place = call.value(0, "string"), int(call.value(1, "num")) - 1
    found = text.find(call.value(2, "string"), max(place, 0))
    return float(found + 1 if found >= 0 else len(text) + 1)


def _str_to_val(call: Call) -> Value:
    """Give data the value that a text writes, and tell whether it is one of its type."""
    text, place = call.value(0, "string"), call.place(1)
    try:
        place.set(call.task.types.fitted(place.kind, call.task.read(text), place.dimensions))
    except WrongType:
        return False
    return True


def _dim(call: Call) -> Value:
    array = call.value(0)
    for _ in range(int(call.value(1, "num")) - 1):
        array = array[0]
    return float(len(array))


FUNCTIONS: Mapping[str, Callable[[Call], Value]] = {
    "abs": _of_numbers(abs),
    "sqrt": _of_numbers(math.sqrt),
    "pow": _of_numbers(math.pow),
    "exp": _of_numbers(math.exp),
    "sin": _of_numbers(lambda angle: math.sin(math.radians(angle))),
    "cos": _of_numbers(lambda angle: math.cos(math.radians(angle))),
    "tan": _of_numbers(lambda angle: math.tan(math.radians(angle))),
    "asin": _of_numbers(lambda *values: math.degrees(math.asin(*values))),
    "acos": _of_numbers(lambda *values: math.degrees(math.acos(*values))),
    "atan": _of_numbers(lambda *values: math.degrees(math.atan(*values))),
    "atan2": _of_numbers(lambda *values: math.degrees(math.atan2(*values))),
    "round": _rounded(lambda value: math.copysign(math.floor(abs(value) + 0.5), value)),
    "trunc": _rounded(math.trunc),
    "bitand": _of_numbers(lambda one, other: int(one) & int(other)),
    "bitor": _of_numbers(lambda one, other: int(one) | int(other)),
    "numtodnum": _of_numbers(float),
    "dnumtonum": _of_numbers(float),
    "offs": _offs,
    "reltool": _rel_tool,
    "eulerzyx": _euler_zyx,
    "orientzyx": _of(
        lambda *turns: orient_of(RollPitchYaw(*map(math.radians, turns[::-1])).ToRotationMatrix()),
        "num",
        "num",
        "num",
    ),
    # It is there to normalise: a norm that is not 1 is no fault.
    "norient": lambda call: orient_of(rotation_of(call.task.typed(call.argument(0), "orient"))),
    "posemult": _of(
        lambda one, other: pose_of(transform_of(one) @ transform_of(other)), "pose", "pose"
    ),
    "poseinv": _of(lambda pose: pose_of(transform_of(pose).inverse()), "pose"),
    "posevect": _of(
        lambda pose, place: pos_of(1e3 * (transform_of(pose) @ place_of(place))), "pose", "pos"
    ),
    "defframe": _of(
        lambda *points: pose_of(three_point_frame(*(place_of(one["trans"]) for one in points))),
        *["robtarget"] * 3,
    ),
    "distance": _of_positions(lambda one, other: np.linalg.norm(one - other)),
    "dotprod": _of_positions(np.dot),
    "vectmagn": _of_positions(np.linalg.norm, 1),
    "numtostr": _num_to_str,
    "dnumtostr": _num_to_str,
    "valtostr": _val_to_str,
    "strlen": _of(lambda text: float(len(text)), "string"),
    "strpart": _of(
        lambda text, begin, size: text[int(begin) - 1 : int(begin) - 1 + int(size)],
        "string",
        "num",
        "num",
    ),
    "strfind": _str_find,
    "strmatch": _str_match,
    "strtoval": _str_to_val,
    "bytetostr": lambda call: f"{int(call.value(0, 'num'))}",
    "dim": _dim,
    "present": lambda call: call.has_parameter(0),
    "opmode": lambda call: 1.0,
    "runmode": lambda call: 1.0,
    "robos": lambda call: False,
    "cdate": lambda call: "2000-01-01",
    "ctime": lambda call: "00:00:00",
    "gettime": lambda call: 0.0,
}
"""By name in lower case, from a call to its value."""
