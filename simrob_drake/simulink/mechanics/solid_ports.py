"""The ports of a solid: its reference frame, its shape for contacts, and frames on its features.

Ports alternate between left and right from the top: first the solid's own frames, then its shape. The reference frame,
where it is shown, takes the first place on the right.
"""

from collections.abc import Callable
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.cross_sections import area, integral
from simrob_drake.simulink.mechanics.shapes import Weight, extrusion, extrusion_outline, revolution_outline
from simrob_drake.simulink.mechanics.solids import solid_kind
from simrob_drake.simulink.mechanics.transforms import AXES
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.reading.xml_part import Unreadable, parse_part

REFERENCE, GEOMETRY = "reference", "geometry"


class SolidPort(NamedTuple):
    """A port: where it is, and what it is: ``reference``, ``geometry``, or the description of a frame."""

    side: str
    number: int
    what: str | Element


def solid_ports(node: Node) -> list[SolidPort]:
    """Return the ports of a Solid, Inertia or Graphic block.

    Raises:
        InvalidModel: its frames cannot be read.
    """
    order: list[str | Element | None] = list(_frames(node))
    if node.is_on("ExportEntireGeometry") or node.is_on("ExportConvexHullGeometry"):
        order.append(GEOMETRY)
    if node.text("DoExposeReferenceFrame", "on") == "on":
        order = [*order[:1], *([None] if not order else []), REFERENCE, *order[1:]]
    sides = ("lconn", "rconn")
    return [SolidPort(sides[place % 2], place // 2 + 1, what) for place, what in enumerate(order) if what is not None]


def _frames(node: Node) -> list[Element]:
    text = node.text("SerializedFrames", "<Frames/>") or "<Frames/>"
    try:
        return list(parse_part(text.encode()).iter("Frame"))
    except Unreadable as problem:
        raise node.refusal(f"its SerializedFrames {problem}") from problem


def frame_pose(node: Node, frame: Element, weight: Weight | None = None) -> RigidTransform:
    """Return the pose of one of a solid's frames in its reference frame, of the solid's weight if that is known.

    Raises:
        InvalidModel: a feature whose place is not known here.
    """
    place = _origin(node, frame, weight)
    axes = []
    directions = []
    for name in ("PrimaryAxis", "SecondaryAxis"):
        source = frame.findtext(f"Value/{name}/Source") or "ReferenceFrame"
        if source not in ("ReferenceFrame", ""):
            feature = frame.findtext(f"Value/{name}/FeatureName") or source
            raise node.refusal(f"a frame follows '{feature}', which is not known here")
        default = "+Z" if name == "PrimaryAxis" else "+X"
        axes.append(AXES.get(frame.findtext(f"Value/{name}/DefinedDirection") or default, AXES[default]))
        directions.append(AXES.get(frame.findtext(f"Value/{name}/SourceDirection") or default, AXES[default]))
    if abs(axes[0] @ axes[1]) > 0.5 or abs(directions[0] @ directions[1]) > 0.5:
        raise node.refusal("a frame has both axes along one line")
    own = np.column_stack([*axes, np.cross(axes[0], axes[1])])
    there = np.column_stack([*directions, np.cross(directions[0], directions[1])])
    return RigidTransform(RotationMatrix(there @ own.T), place)


def _origin(node: Node, frame: Element, weight: Weight | None) -> Vector:
    source = frame.findtext("Value/Origin/Source") or "ReferenceFrame"
    feature = " ".join((frame.findtext("Value/Origin/FeatureName") or "").split())
    kind = solid_kind(node)
    place: Vector | None = None
    if source == "ReferenceFrame":
        place = np.zeros(3)
    elif source == "CenterOfMassFrame":
        place = np.zeros(3) if kind in _CENTRED else None if weight is None else weight.com
    elif source == "GeometricFeature" and kind in _FEATURES:
        place = _FEATURES[kind](node, feature)
    if place is None:
        raise node.refusal(f"a frame is on '{feature or source}', whose place is not known here")
    return place


def _on_brick(node: Node, feature: str) -> Vector | None:
    """Return the middle of a side, edge or corner, such as ``+x -y curve``."""
    half = node.numbers("BrickDimensions", "[1 1 1]", unit="m", size=3) / 2
    words = [word.upper() for word in feature.split()[:-1]]
    if not words or any(word not in AXES for word in words):
        return None
    return np.asarray(half * sum(AXES[word] for word in words))


def _on_cylinder(node: Node, feature: str) -> Vector | None:
    half = node.number("CylinderLength", "1", unit="m") / 2
    end = {"top": half, "bottom": -half, "side": 0.0}.get(feature.partition(" ")[0])
    return None if end is None else np.array([0.0, 0.0, end])


def _on_extrusion(node: Node, feature: str) -> Vector | None:
    half = node.number("ExtrusionLength", "1", unit="m") / 2
    where, _, number = feature.partition(" ")
    if where in ("top", "bottom"):
        return np.asarray(extrusion(node)[1].com + np.array([0.0, 0.0, half if where == "top" else -half]))
    side = number.rpartition(" ")[2]
    corners = extrusion_outline(node)
    if not side.isdecimal() or not 1 <= int(side) <= len(corners):
        return None
    message = f"a frame on '{feature}': in the middle of side {side}, counted as its corners are"
    node.findings.report.add("approximated", node.path, message)
    return np.append((corners[int(side) - 1] + corners[int(side) % len(corners)]) / 2, 0.0)


def _on_revolution(node: Node, feature: str) -> Vector | None:
    """Return the middle of an end of a part turn, or where a turned side stands on the axis."""
    outline, angle = revolution_outline(node)
    where, _, number = feature.partition(" ")
    if where in ("front", "back"):
        x, z = (integral(outline, axis) / area(outline) for axis in (lambda x, _: x, lambda _, z: z))
        turn = angle / 2 if where == "front" else -angle / 2
        node.findings.report.add("approximated", node.path, f"a frame on '{feature}': on the side of the larger angle")
        return np.array([x * np.cos(turn), x * np.sin(turn), z])
    side = number.rpartition(" ")[2]
    if where != "side" or not side.isdecimal() or not 1 <= int(side) <= len(outline):
        return None
    ends = outline[[int(side) - 1, int(side) % len(outline)]]
    message = f"a frame on '{feature}': on the axis, counted as its corners are"
    node.findings.report.add("approximated", node.path, message)
    return np.array([0.0, 0.0, ends[:, 1].mean()])


_CENTRED = "Brick Solid", "Cylindrical Solid", "Spherical Solid", "Ellipsoidal Solid"
_FEATURES: dict[str, Callable[[Node, str], Vector | None]] = {
    "Brick Solid": _on_brick,
    "Cylindrical Solid": _on_cylinder,
    "Extruded Solid": _on_extrusion,
    "Revolved Solid": _on_revolution,
    "Spherical Solid": lambda *_: np.zeros(3),
}
