"""Check the boxes, spheres, cylinders and capsules of a URDF: a size that is none would end the simulator."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from simrob_drake.robots.urdf import DRAKE

_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    f"{DRAKE}capsule": {"radius": 1, "length": 1},
    f"{DRAKE}ellipsoid": {"a": 1, "b": 1, "c": 1},
}
PRIMITIVES = frozenset(_SIZES)


def defect_of(shape: ET.Element) -> str:
    """Return what is wrong with the sizes of a primitive, in words; empty where nothing is."""
    for key, count in _SIZES[shape.tag].items():
        text = shape.get(key)
        if text is None:
            return f"has no {key}"
        numbers = numbers_in(text)
        if numbers is None or len(numbers) != count:
            return f'has {key}="{text}" where {count} {"number" if count == 1 else "numbers"} should be'
        if not all(number > 0 for number in numbers):
            return f'has {key}="{text}", which is not positive'
    return ""


def numbers_in(text: str) -> list[float] | None:
    """Return the numbers in a text; None if a word of it is none, or not finite."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return None
    return numbers if all(math.isfinite(number) for number in numbers) and "_" not in text else None
