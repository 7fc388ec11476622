"""Couplings in place of the joints that close loops of a robot.

The robot of a station is a tree of links. A joint of a file that closes a loop, such as that of a four-bar linkage, is
taken out of the robot, and a coupling of the station (a section under ``couplings``) holds the two links instead. The
stages of an import pass such a coupling on as an XML element in the robot.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import pose_from_transform
from simrob_drake.robots.urdf import link_of, name_of, pose_of

TAG = "closing"
"""Tag of the XML element in which the stages of an import pass on a coupling that closes a loop."""

# A coupling of a station holds two links, as a joint of the file does, without being a part of the tree.
_KINDS = {
    "revolute": "hinge",
    "continuous": "hinge",
    "fixed": "weld",
    "ball": "ball",
    "spherical": "ball",
}
"""Kind of the coupling that moves as a joint does, by the joint's type."""

_DEFAULT_AXIS = "1 0 0"
"""Axis of a joint without ``<axis>``, as the URDF format defines it."""

_Z = 2
"""Index of the axis of its frames about which a hinge of a station turns: z."""

# The products of rotations leave errors of 1e-16 in numbers that the user reads and copies.
_DIGITS = 9
"""Count of decimals of lengths [m] and angles [rad] that are written."""


@dataclass(frozen=True)
class LoopCoupling:
    """A coupling that closes a loop of a robot.

    Attributes:
        name: name of the joint or constraint that the coupling replaces.
        kind: ``hinge``, ``ball`` or ``weld``.
        body: name of one link.
        other: name of the other link.
        place: where the coupling holds the one link, in the link's frame: a point (3,) [m] for a ball, otherwise a
            pose (6,) [x y z Rz Ry Rx].
        other_place: where the coupling holds the other link, likewise.
    """

    name: str
    kind: str
    body: str
    other: str
    place: list[float]
    other_place: list[float]

    @property
    def entry(self) -> dict[str, Any]:
        """Keys and values of the coupling in a station's section ``couplings``."""
        # A ball has no orientation, so its places are points.
        key = "point" if self.kind == "ball" else "pose"
        return {
            "kind": self.kind,
            "body": self.body,
            "other": self.other,
            key: self.place,
            f"other_{key}": self.other_place,
        }

    @property
    def line(self) -> str:
        """The line of YAML to write under ``couplings`` of a station."""
        pairs = [f"{key}: {_yaml_value(value)}" for key, value in self.entry.items()]
        return f"{self.name}: {{{', '.join(pairs)}}}"

    def element(self) -> ET.Element:
        """XML element in which the stages of an import pass the coupling on."""
        attributes = {
            "name": self.name,
            "kind": self.kind,
            "body": self.body,
            "other": self.other,
            "place": " ".join(map(repr, self.place)),
            "other_place": " ".join(map(repr, self.other_place)),
        }
        return ET.Element(TAG, attributes)

    @classmethod
    def of_element(cls, element: ET.Element) -> "LoopCoupling":
        """Read the coupling from an element that :meth:`element` has made."""
        return cls(
            name=element.get("name", ""),
            kind=element.get("kind", ""),
            body=element.get("body", ""),
            other=element.get("other", ""),
            place=_numbers(element.get("place", "")),
            other_place=_numbers(element.get("other_place", "")),
        )


def _numbers(text: str) -> list[float]:
    """Read the numbers of a text, which blanks separate."""
    return [float(number) for number in text.split()]


def _yaml_value(value: Any) -> str:
    """Write a value of a coupling, a text or a list of numbers, in a line of YAML."""
    if isinstance(value, list):
        # Six digits suffice for a line that is shown. The entry itself keeps all.
        numbers = [f"{number:.6g}" for number in value]
        return f"[{', '.join(numbers)}]"
    return str(value)


def closing_of_joint(joint: ET.Element) -> LoopCoupling | None:
    """Make the coupling that replaces a joint of a URDF. Returns None if no coupling moves as the joint does."""
    # A sliding joint, for example, has no coupling of its kind.
    kind = _KINDS.get(joint.get("type", ""))
    if kind is None:
        return None
    # In a URDF the frame of the child link is the frame of the joint, at the joint's zero position.
    place = pose_of(joint)
    other_place = RigidTransform()
    if kind == "hinge":
        axis = joint.find("axis")
        text = _DEFAULT_AXIS if axis is None else axis.get("xyz", _DEFAULT_AXIS)
        # A hinge turns about z, the joint about its axis: turn both frames so that z is that axis.
        direction = np.array(_numbers(text))
        turn = RigidTransform(RotationMatrix.MakeFromOneVector(direction, _Z), np.zeros(3))
        place = place @ turn
        other_place = other_place @ turn
    return LoopCoupling(
        name=name_of(joint),
        kind=kind,
        body=link_of(joint, "parent"),
        other=link_of(joint, "child"),
        place=_place_numbers(kind, place),
        other_place=_place_numbers(kind, other_place),
    )


def _place_numbers(kind: str, place: RigidTransform) -> list[float]:
    """Rounded numbers of a place: of its point (3,) for a ball, otherwise of its pose (6,) [x y z Rz Ry Rx]."""
    values = place.translation() if kind == "ball" else pose_from_transform(place)
    # The sum makes 0 of -0.
    return [float(np.round(value, _DIGITS)) + 0.0 for value in values]


def second_parents(robot: ET.Element) -> Iterator[ET.Element]:
    """Yield the joints that give a link a second parent: a joint earlier in the file has the same child link."""
    children = set[str]()
    for joint in robot.iterfind("joint"):
        # The first joint of the file keeps the link. Which one is better cannot be seen from here.
        child = link_of(joint, "child")
        if child in children:
            yield joint
        children.add(child)


def take_closings(robot: ET.Element) -> list[LoopCoupling]:
    """Remove the elements of couplings from a robot, in place, and read the couplings."""
    # A list, since the elements are removed from the robot that they are found in.
    elements = robot.findall(TAG)
    for element in elements:
        robot.remove(element)
    return [LoopCoupling.of_element(element) for element in elements]
