"""Solid, Inertia and Graphic blocks: what a body weighs, what is seen of it, and what its ports are.

Ports of a solid alternate between left and right from the top: first its own frames, then its shape. The reference
frame, where it is shown, takes the first place on the right.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics import shapes
from simrob_drake.extensions.simulink.mechanics.joints import AXES
from simrob_drake.extensions.simulink.mechanics.shapes import (
    NOTHING,
    MeshFiles,
    Shape,
    Weight,
    centre,
    extrusion,
    extrusion_outline,
    revolution_outline,
)
from simrob_drake.extensions.simulink.model.network import Connections
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.reading.graph import Unreadable, one_line, parse_part
from simrob_drake.robots.imports import ImportReport

_SHAPES: dict[str, Callable[[Node], tuple[Shape, Weight]]] = {
    "Brick Solid": shapes.brick, "Cylindrical Solid": shapes.cylinder, "Spherical Solid": shapes.sphere,
    "Ellipsoidal Solid": shapes.ellipsoid, "Extruded Solid": shapes.extrusion, "Revolved Solid": shapes.revolution,
}  # fmt: skip
_OLD_SHAPES = {
    "Brick": "Brick Solid", "Cylinder": "Cylindrical Solid", "Sphere": "Spherical Solid",
    "Ellipsoid": "Ellipsoidal Solid", "FromFile": "File Solid",
    **dict.fromkeys(("RegularExtrusion", "GeneralExtrusion"), "Extruded Solid"),
    **dict.fromkeys(("Revolution", "GeneralSolidOfRevolution"), "Revolved Solid"),
}  # fmt: skip
SOLIDS = {*_SHAPES, "File Solid", "Solid", "Inertia", "Graphic"}  # the blocks that are read here


_POINT = 1e-8  # m²: a mass without extent turns as a ball of 0.16 mm


@dataclass(frozen=True)
class SolidBody:
    """A solid on a frame."""

    node: Node
    weight: Weight  # in the solid's frame
    shape: Shape | None  # what is seen, or touches; None without
    colour: tuple[float, float, float, float]  # red, green, blue, opacity
    visible: bool = True  # whether it is seen
    file: Path | None = None  # a mesh file in place of a shape, already found
    scale: float = 1.0  # of the mesh file
    # of the solid in the frame of its body
    pose: RigidTransform = field(default_factory=RigidTransform)


VARIABLE = {
    "General Variable Mass": ("VariableInertiaType", "PointMass", "Inertia", "InertiaType"),
    "Variable Spherical Solid": (
        "RadiusType",
        "CalculateFromMass",
        "Spherical Solid",
        "BasedOnType",
    ),
}
"""Masses from an input: the parameter and its choice that are read where it is constant, what they are then, how."""


def hold_constant(network: Connections, node: Node) -> None:
    """Let a mass from an input be that of a solid, where the input is constant."""
    name, choice, place, how = VARIABLE[node.kind]
    inputs = {other.kind: other for other in network.on(network.net(node, "lconn"))}
    source = (
        network.source(inputs["Simulink-PS Converter"])
        if "Simulink-PS Converter" in inputs
        else None
    )
    mode = node.text("MassType") in ("TimeVarying", "ProvidedByInput")
    if not mode or source is None or source[0].kind != "Constant" or node.text(name) != choice:
        return
    unit = inputs["Simulink-PS Converter"].text("Unit", "kg")
    mass = source[0].number("Value", "1") * node.in_si(
        "kg" if unit in ("1", "inherit", "") else unit, "Unit", "kg"
    )
    density = node.number("Density", "1000", unit="kg/m^3")
    if mass <= 0 or density <= 0:
        return
    radius = (0.75 * mass / density / np.pi) ** (1 / 3)  # of a ball of even density
    ball = {how: "Mass", "SphereRadius": f"{radius:.17g}", "SphereRadiusUnits": "m"}
    parameters = {**node.block.parameters, "Mass": f"{mass:.17g}", "MassUnits": "kg"}
    parameters |= {how: choice} if how == "InertiaType" else ball
    node.note(
        "read", message("simulink.constant_mass", "its mass is constant: {mass:g} kg", mass=mass)
    )
    node.block = replace(
        node.block, kind=f"sm_lib/Body Elements/{place}", linked=True, parameters=parameters
    )


def read_solid(node: Node, meshes: MeshFiles) -> SolidBody:
    """Return what a solid block is.

    Raises InvalidModel: figures that cannot be, or a weight that only a missing mesh could tell.
    """
    kind = _kind_of(node)
    shape: Shape | None = None
    even: Weight | None = None  # of 1 kg/m³
    file, scale = None, 1.0
    if kind in _SHAPES:
        try:
            shape, even = _SHAPES[kind](node)
        except InvalidModel as problem:
            computed = node.text("InertiaType", "CalculateFromGeometry") == "CalculateFromGeometry"
            if computed and _density(node) != 0 and not node.findings.undefined:
                raise
            node.note(
                "dropped",
                message("simulink.its_shape", "its shape: it {problem}", problem=problem.problem),
            )
            even = NOTHING
    elif kind == "File Solid":
        file, scale = meshes.of(node)
    weight = _weight(node, kind, even, lambda: meshes.weight(node, file, scale))
    seen = kind != "Inertia" and node.text("GraphicType", "FromGeometry") != "None"
    return SolidBody(node, weight, shape, _colour(node), visible=seen, file=file, scale=scale)


def _kind_of(node: Node) -> str:
    """Return the block that a solid is today: older models have one for all shapes (raises InvalidModel: unknown)."""
    shape = node.text("GeometryShape", "Brick")
    if node.kind == "Solid" and shape not in _OLD_SHAPES:
        raise node.refusal(
            message("simulink.unknown_shape", "has the unknown shape '{shape}'", shape=shape)
        )
    return _OLD_SHAPES[shape] if node.kind == "Solid" else node.kind


def _density(node: Node) -> float | None:
    """Return the density that a solid's weight follows from [kg/m³]; None where its mass is known instead."""
    based = node.text("BasedOnType", "Density") != "Mass"
    return node.number("Density", "1000", unit="kg/m^3") if based else None


def _weight(node: Node, kind: str, even: Weight | None, of_mesh: Callable[[], Weight]) -> Weight:
    if kind == "Graphic":
        return NOTHING
    method = node.text("InertiaType", "Custom" if kind == "Inertia" else "CalculateFromGeometry")
    if method == "PointMass":
        return replace(NOTHING, mass=_mass(node))
    if method == "Custom":
        mass = _mass(node)
        moments = node.numbers(
            "MomentsOfInertia", "[1 1 1]", unit="kg*m^2", size=3, unknown="[0 0 0]"
        )
        yz, zx, xy = node.numbers("ProductsOfInertia", "[0 0 0]", unit="kg*m^2", size=3)
        inertia = np.diag(moments) + np.array([[0, xy, zx], [xy, 0, yz], [zx, yz, 0]])
        return Weight(mass, node.numbers("CenterOfMass", "[0 0 0]", unit="m", size=3), inertia)
    if method != "CalculateFromGeometry":
        raise node.refusal(
            message(
                "simulink.unknown_inertia_type",
                "has the unknown inertia type '{method}'",
                method=method,
            )
        )
    if (density := _density(node)) == 0:
        return NOTHING
    even = even or of_mesh()
    if density is None:
        return even.scaled(_mass(node) / even.mass) if even.mass else NOTHING
    if density < 0:
        raise node.refusal(
            message(
                "simulink.negative_density",
                "Density is {density:g}; it must not be negative",
                density=density,
            )
        )
    return even.scaled(density)


def _mass(node: Node) -> float:
    mass = node.number("Mass", "1", unit="kg", unknown="0")
    if mass < 0:
        raise node.refusal(
            message(
                "simulink.negative_mass", "Mass is {mass:g}; it must not be negative", mass=mass
            )
        )
    return mass


def _colour(node: Node) -> tuple[float, float, float, float]:
    values = np.clip(node.numbers("GraphicDiffuseColor", "[0.5 0.5 0.5]"), 0.0, 1.0)
    red, green, blue = values[:3] if values.size >= 3 else np.full(3, 0.5)
    opacity = node.numbers("GraphicOpacity", "1")
    return (
        float(red),
        float(green),
        float(blue),
        float(np.clip(opacity[0] if opacity.size else 1.0, 0.05, 1.0)),
    )


def moved(weight: Weight, pose: RigidTransform) -> Weight:
    """Return a weight in the frame that ``pose`` places it in."""
    turn = pose.rotation().matrix()
    return Weight(
        weight.mass, np.asarray(pose.multiply(weight.com)), turn @ weight.inertia @ turn.T
    )


def together(weights: list[Weight]) -> Weight:
    """Return several bodies as one, all in the same frame."""
    mass = sum(weight.mass for weight in weights)
    if mass <= 0:
        return NOTHING
    com = sum((weight.mass * weight.com for weight in weights), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for weight in weights:
        arm: Vector = weight.com - com
        inertia = (
            inertia + weight.inertia + weight.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        )
    return Weight(mass, com, inertia)


def possible_moments(name: str, weight: Weight, report: ImportReport) -> Vector:
    """Return moments, (3, 3), that a real body can have: Simscape takes any inertia, Drake does not."""
    moments, axes = np.linalg.eigh((weight.inertia + weight.inertia.T) / 2)
    allowed = np.maximum(moments, weight.mass * _POINT)
    excess = allowed[2] - allowed[0] - allowed[1]
    if excess > -1e-12 * allowed[2]:
        allowed[:2] += max(excess, 0.0) / 2 + 1e-9 * allowed[2]
    if np.allclose(allowed, moments, rtol=1e-7, atol=0.0):
        return weight.inertia
    shown = ", ".join(f"{moment:.3g}" for moment in moments)
    report.add(
        "repaired",
        name,
        message(
            "simulink.made_possible",
            "no body has the principal moments {moments} kg m²: made possible",
            moments=shown,
        ),
    )
    return np.asarray(axes @ np.diag(allowed) @ axes.T)


REFERENCE, GEOMETRY = "reference", "geometry"


class SolidPort(NamedTuple):
    """A port: where it is, and what it is: ``reference``, ``geometry``, or the description of a frame."""

    side: str
    number: int
    what: str | Element


def solid_ports(node: Node) -> list[SolidPort]:
    """Return the ports of a Solid, Inertia or Graphic block (raises InvalidModel: its frames cannot be read)."""
    try:
        frames = parse_part((node.text("SerializedFrames") or "<Frames/>").encode()).iter("Frame")
    except Unreadable as problem:
        raise node.refusal(
            message("simulink.serialized_frames", "its SerializedFrames {problem}", problem=problem)
        ) from problem
    order: list[str | Element | None] = list(frames)
    if node.is_on("ExportEntireGeometry") or node.is_on("ExportConvexHullGeometry"):
        order.append(GEOMETRY)
    if node.text("DoExposeReferenceFrame", "on") == "on":
        order = [*order[:1], *([None] if not order else []), REFERENCE, *order[1:]]
    sides = ("lconn", "rconn")
    return [
        SolidPort(sides[place % 2], place // 2 + 1, what)
        for place, what in enumerate(order)
        if what is not None
    ]


def frame_pose(node: Node, frame: Element, weight: Weight | None = None) -> RigidTransform:
    """Return the pose of one of a solid's frames in its reference frame, of the solid's weight if that is known.

    Raises InvalidModel: a feature whose place is not known here.
    """
    place, axes, directions = _origin(node, frame, weight), [], []
    for name, default in (("PrimaryAxis", "+Z"), ("SecondaryAxis", "+X")):
        source = frame.findtext(f"Value/{name}/Source") or "ReferenceFrame"
        along = frame.findtext(f"Value/{name}/SourceDirection") or default
        feature = one_line(frame.findtext(f"Value/{name}/FeatureName") or source)
        direction = (
            AXES.get(along, AXES[default])
            if source == "ReferenceFrame"
            else _normal(node, feature, along)
        )
        if direction is None:
            raise node.refusal(
                message(
                    "simulink.frame_follows_unknown",
                    "a frame follows '{feature}', which is not known here",
                    feature=feature,
                )
            )
        axes.append(
            AXES.get(frame.findtext(f"Value/{name}/DefinedDirection") or default, AXES[default])
        )
        directions.append(direction)
    if abs(axes[0] @ axes[1]) > 0.5 or abs(directions[0] @ directions[1]) > 0.5:
        raise node.refusal(
            message("simulink.frame_axes_on_line", "a frame has both axes along one line")
        )
    own, there = (np.column_stack([*two, np.cross(*two)]) for two in (axes, directions))
    return RigidTransform(RotationMatrix(there @ own.T), place)


def _normal(node: Node, feature: str, along: str) -> Vector | None:
    """Return where a flat side of a solid looks, or backwards for ``-Z``, shape (3,); None of what is not known."""
    kind, side = _kind_of(node), feature.removesuffix(" surface").upper()
    ends = {"TOP": "+Z", "BOTTOM": "-Z"} if kind in ("Cylindrical Solid", "Extruded Solid") else {}
    ends = ends or (dict(zip(AXES, AXES, strict=True)) if kind == "Brick Solid" else {})
    if side not in ends or along[-1:] != "Z" or not feature.endswith(" surface"):
        return None
    return -AXES[ends[side]] if along == "-Z" else AXES[ends[side]]


def _origin(node: Node, frame: Element, weight: Weight | None) -> Vector:
    source = frame.findtext("Value/Origin/Source") or "ReferenceFrame"
    feature, kind = one_line(frame.findtext("Value/Origin/FeatureName") or ""), _kind_of(node)
    place: Vector | None = None
    if source == "ReferenceFrame":
        place = np.zeros(3)
    elif source == "CenterOfMassFrame":
        place = np.zeros(3) if kind in _CENTRED else None if weight is None else weight.com
    elif source == "GeometricFeature" and kind in _FEATURES:
        place = _FEATURES[kind](node, feature)
    if place is None:
        raise node.refusal(
            message(
                "simulink.frame_place_unknown",
                "a frame is on '{feature}', whose place is not known here",
                feature=feature or source,
            )
        )
    return place


def _on_brick(node: Node, feature: str) -> Vector | None:
    """Return the middle of a side, edge or corner, such as ``+x -y curve``."""
    half = node.numbers("BrickDimensions", "[1 1 1]", unit="m", size=3) / 2
    words = [word.upper() for word in feature.split()[:-1]]
    if not words or any(word not in AXES for word in words):
        return None
    return np.asarray(half * sum(AXES[word] for word in words))


def _on_cylinder(node: Node, feature: str) -> Vector | None:
    end = {"top": 0.5, "bottom": -0.5, "side": 0.0}.get(feature.partition(" ")[0])
    return (
        None
        if end is None
        else np.array([0.0, 0.0, end * node.number("CylinderLength", "1", unit="m")])
    )


def _on_extrusion(node: Node, feature: str) -> Vector | None:
    half = node.number("ExtrusionLength", "1", unit="m") / 2
    where = feature.partition(" ")[0]
    if where in ("top", "bottom"):
        return np.asarray(
            extrusion(node)[1].com + np.array([0.0, 0.0, half if where == "top" else -half])
        )
    if (ends := _side(feature, extrusion_outline(node))) is None:
        return None
    side = feature.rpartition(" ")[2]
    node.note(
        "approximated",
        message(
            "simulink.frame_in_middle_of_side",
            "a frame on '{feature}': in the middle of side {side}, counted as its corners are",
            feature=feature,
            side=side,
        ),
    )
    return np.append(ends.mean(axis=0), 0.0)


def _side(feature: str, outline: Vector) -> Vector | None:
    """Return the corners (2, 2) of a side of an outline that is called by its number."""
    number = feature.rpartition(" ")[2]
    known = number.isdecimal() and 1 <= int(number) <= len(outline)
    return outline[[int(number) - 1, int(number) % len(outline)]] if known else None


def _on_revolution(node: Node, feature: str) -> Vector | None:
    """Return the middle of an end of a part turn, or where a turned side stands on the axis."""
    outline, angle = revolution_outline(node)
    where = feature.partition(" ")[0]
    if where in ("front", "back"):
        x, z = centre(outline)
        turn = angle / 2 if where == "front" else -angle / 2
        node.note(
            "approximated",
            message(
                "simulink.frame_on_larger_angle",
                "a frame on '{feature}': on the side of the larger angle",
                feature=feature,
            ),
        )
        return np.array([x * np.cos(turn), x * np.sin(turn), z])
    if where != "side" or (ends := _side(feature, outline)) is None:
        return None
    node.note(
        "approximated",
        message(
            "simulink.frame_on_axis",
            "a frame on '{feature}': on the axis, counted as its corners are",
            feature=feature,
        ),
    )
    return np.array([0.0, 0.0, ends[:, 1].mean()])


_CENTRED = "Brick Solid", "Cylindrical Solid", "Spherical Solid", "Ellipsoidal Solid"
_FEATURES: dict[str, Callable[[Node, str], Vector | None]] = {
    "Brick Solid": _on_brick, "Extruded Solid": _on_extrusion, "Revolved Solid": _on_revolution,
    "Cylindrical Solid": _on_cylinder, "Spherical Solid": lambda *_: np.zeros(3),
}  # fmt: skip
