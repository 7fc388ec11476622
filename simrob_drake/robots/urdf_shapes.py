"""The shapes of a URDF's links: boxes and spheres, and how any shape is written as an element.

Lengths are in metres, angles in radians; all numbers are written as given.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Numbers = Sequence[float]
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """A box, cylinder, sphere or mesh somewhere on a link."""

    tag: str
    attributes: Mapping[str, str]
    xyz: Numbers = ZERO
    rpy: Numbers = ZERO


def box(size: Numbers, xyz: Numbers = ZERO, rpy: Numbers = ZERO) -> Shape:
    """Return a box of a size, shape (3,) [m], about its centre."""
    return Shape("box", {"size": text(size)}, xyz, rpy)


def sphere(radius: float, xyz: Numbers = ZERO) -> Shape:
    """Return a sphere about its centre."""
    return Shape("sphere", {"radius": text([radius])}, xyz)


def shape_element(link: ET.Element, tag: str, shape: Shape) -> ET.Element:
    """Add a shape to a link, as a ``visual`` or a ``collision`` element, and return that."""
    element = ET.SubElement(link, tag)
    add_origin(element, shape.xyz, shape.rpy)
    ET.SubElement(ET.SubElement(element, "geometry"), shape.tag, dict(shape.attributes))
    return element


def add_origin(element: ET.Element, xyz: Numbers, rpy: Numbers) -> None:
    """Add a place and a turn to an element, where they are not zero."""
    if any(xyz) or any(rpy):
        turned = {"rpy": text(rpy)} if any(rpy) else {}
        ET.SubElement(element, "origin", {"xyz": text(xyz), **turned})


def text(values: Numbers) -> str:
    """Return numbers as an attribute of a URDF."""
    return " ".join(f"{float(value):.12g}" for value in values)
