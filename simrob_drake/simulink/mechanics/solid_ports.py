"""The ports of a solid: its reference frame, its shape for contacts, and frames on its features.

Ports alternate between left and right from the top: first the solid's own frames, then its shape. The reference frame,
where it is shown, takes the first place on the right.
"""

from __future__ import annotations

from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.shapes import extrusion, extrusion_outline
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


def frame_pose(node: Node, frame: Element) -> RigidTransform:
    """Return the pose of one of a solid's frames in its reference frame.

    Raises:
        InvalidModel: a feature whose place is not known here.
    """
    place = _origin(node, frame)
    axes = []
    directions = []
    for name in ("PrimaryAxis", "SecondaryAxis"):
        source = frame.findtext(f"Value/{name}/Source") or "ReferenceFrame"
        if source == "GeometricFeature":
            raise node.refusal(f"a frame follows {frame.findtext(f'Value/{name}/FeatureName')}, which is not known here")
        default = "+Z" if name == "PrimaryAxis" else "+X"
        axes.append(AXES.get(frame.findtext(f"Value/{name}/DefinedDirection") or default, AXES[default]))
        directions.append(AXES.get(frame.findtext(f"Value/{name}/SourceDirection") or default, AXES[default]))
    if abs(axes[0] @ axes[1]) > 0.5 or abs(directions[0] @ directions[1]) > 0.5:
        raise node.refusal("a frame has both axes along one line")
    own = np.column_stack([*axes, np.cross(*axes)])
    there = np.column_stack([*directions, np.cross(*directions)])
    return RigidTransform(RotationMatrix(there @ own.T), place)


def _origin(node: Node, frame: Element) -> Vector:
    source = frame.findtext("Value/Origin/Source") or "ReferenceFrame"
    if source == "ReferenceFrame":
        return np.zeros(3)
    feature = " ".join((frame.findtext("Value/Origin/FeatureName") or "").split())
    kind = node.kind
    if source == "CenterOfMassFrame":
        if kind in ("Brick Solid", "Cylindrical Solid", "Spherical Solid", "Ellipsoidal Solid"):
            return np.zeros(3)
    elif kind == "Brick Solid":
        half = node.numbers("BrickDimensions", "[1 1 1]", unit="m", size=3) / 2
        words = feature.split()[:-1]
        if words and all(word.upper() in AXES for word in words):
            return np.asarray(half * sum(AXES[word.upper()] for word in words))
    elif kind in ("Cylindrical Solid", "Extruded Solid"):
        cylinder = kind == "Cylindrical Solid"
        length = node.number("CylinderLength" if cylinder else "ExtrusionLength", "1", unit="m")
        end = {"top": length / 2, "bottom": -length / 2, "side": 0.0}.get(feature.partition(" ")[0])
        if end is not None and cylinder:
            return np.array([0.0, 0.0, end])
        if end is not None and not feature.startswith("side"):
            return np.asarray(extrusion(node)[1].com + [0.0, 0.0, end])
        number = feature.rpartition(" ")[2]
        if end is not None and number.isdecimal():
            corners = extrusion_outline(node)
            if 1 <= int(number) <= len(corners):
                node.findings.report.add("read", node.path, f"a frame on '{feature}': in the middle of side {number}")
                return np.append((corners[int(number) - 1] + corners[int(number) % len(corners)]) / 2, 0.0)
    raise node.refusal(f"a frame is on '{feature or source}', whose place is not known here")
