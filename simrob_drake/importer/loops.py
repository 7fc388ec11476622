"""Joints that close loops: what a station's couplings say in their place, since a robot is a tree."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import pose_from_transform
from simrob_drake.robots.urdf import link_of, name_of, pose_of

TAG = "closing"
"""Element in which the stages of an import hand on a coupling that closes a loop."""

_Z = 2  # a hinge turns about the z of its frames
_DIGITS = 9  # of lengths and angles that are written


@dataclass(frozen=True)
class LoopCoupling:
    """A coupling that closes a loop of a robot.

    Attributes:
        name: of the joint or constraint that it replaces.
        kind: ``hinge``, ``ball`` or ``weld``.
        body: link that is held.
        other: link that it is held to.
        place: where on the body: a point (3,) [m] of a ball, else a pose (6,) [x y z Rz Ry Rx].
        other_place: where on the other, likewise.
    """

    name: str
    kind: str
    body: str
    other: str
    place: list[float]
    other_place: list[float]

    @property
    def entry(self) -> dict[str, Any]:
        """The coupling as a station has it under ``couplings``."""
        key = "point" if self.kind == "ball" else "pose"
        places = {key: self.place, f"other_{key}": self.other_place}
        return {"kind": self.kind, "body": self.body, "other": self.other, **places}

    @property
    def line(self) -> str:
        """The line to write under ``couplings`` of a station."""
        words = [f"{key}: {_text(value)}" for key, value in self.entry.items()]
        return f"{self.name}: {{{', '.join(words)}}}"

    def element(self) -> ET.Element:
        """The element in which stages of an import hand the coupling on."""
        own = {"name": self.name, "kind": self.kind, "body": self.body, "other": self.other}
        places = {"place": self.place, "other_place": self.other_place}
        return ET.Element(TAG, own | {key: " ".join(map(repr, value)) for key, value in places.items()})

    @classmethod
    def of_element(cls, element: ET.Element) -> "LoopCoupling":
        """Read the coupling of an element."""
        return cls(
            name=element.get("name", ""),
            kind=element.get("kind", ""),
            body=element.get("body", ""),
            other=element.get("other", ""),
            place=_numbers(element.get("place", "")),
            other_place=_numbers(element.get("other_place", "")),
        )


def _numbers(text: str) -> list[float]:
    """Read numbers that stand in a text with blanks between them."""
    return [float(number) for number in text.split()]


def _text(value: Any) -> str:
    """A value of a coupling in a line of YAML."""
    return f"[{', '.join(f'{number:.6g}' for number in value)}]" if isinstance(value, list) else str(value)


def closing_of_joint(joint: ET.Element) -> LoopCoupling | None:
    """The coupling that replaces a joint of a URDF. Returns None if no coupling moves as the joint does."""
    kinds = {"revolute": "hinge", "continuous": "hinge", "fixed": "weld", "ball": "ball", "spherical": "ball"}
    kind = kinds.get(joint.get("type", ""))
    if kind is None:
        return None
    place, other = pose_of(joint), RigidTransform()
    if kind == "ball":
        numbers = _rounded(place.translation()), _rounded(other.translation())
    else:
        if kind == "hinge":
            axis = joint.find("axis")
            direction = [float(number) for number in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()]
            turn = RigidTransform(RotationMatrix.MakeFromOneVector(np.array(direction), _Z), np.zeros(3))
            place, other = place @ turn, other @ turn
        numbers = _rounded(pose_from_transform(place)), _rounded(pose_from_transform(other))
    return LoopCoupling(
        name=name_of(joint),
        kind=kind,
        body=link_of(joint, "parent"),
        other=link_of(joint, "child"),
        place=numbers[0],
        other_place=numbers[1],
    )


def _rounded(values: Any) -> list[float]:
    """Numbers as they are written, without what rounding leaves of zero."""
    return [float(np.round(value, _DIGITS)) + 0.0 for value in values]


def second_parents(robot: ET.Element) -> Iterator[ET.Element]:
    """Yield the joints whose child link is the child of a joint before."""
    held = set[str]()
    for joint in robot.iterfind("joint"):
        child = link_of(joint, "child")
        if child in held:
            yield joint
        held.add(child)


def take_closings(robot: ET.Element) -> list[LoopCoupling]:
    """Take the couplings off a robot that the stages of its import handed on."""
    found = robot.findall(TAG)
    for element in found:
        robot.remove(element)
    return [LoopCoupling.of_element(element) for element in found]
