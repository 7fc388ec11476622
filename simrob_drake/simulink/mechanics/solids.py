"""Solid, Inertia and Graphic blocks: what a body weighs, and what is seen of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportReport
from simrob_drake.simulink.mechanics import shapes
from simrob_drake.simulink.mechanics.mesh_files import MeshFiles
from simrob_drake.simulink.mechanics.shapes import NOTHING, Shape, Weight
from simrob_drake.simulink.model.nodes import Node

_SHAPES: dict[str, Callable[[Node], tuple[Shape, Weight]]] = {
    "Brick Solid": shapes.brick,
    "Cylindrical Solid": shapes.cylinder,
    "Spherical Solid": shapes.sphere,
    "Ellipsoidal Solid": shapes.ellipsoid,
    "Extruded Solid": shapes.extrusion,
    "Revolved Solid": shapes.revolution,
}
_OLD_SHAPES = {
    "Brick": "Brick Solid",
    "Cylinder": "Cylindrical Solid",
    "Sphere": "Spherical Solid",
    "Ellipsoid": "Ellipsoidal Solid",
    "RegularExtrusion": "Extruded Solid",
    "GeneralExtrusion": "Extruded Solid",
    "Revolution": "Revolved Solid",
    "FromFile": "File Solid",
}
SOLIDS = {*_SHAPES, "File Solid", "Solid", "Inertia", "Graphic"}
"""The blocks that are read here."""


_POINT = 1e-8
"""m²: a mass without extent turns as a ball of 0.16 mm."""


@dataclass(frozen=True)
class SolidBody:
    """A solid on a frame.

    Attributes:
        node: the block.
        weight: in the solid's frame.
        shape: what is seen, or touches; None without.
        file: a mesh file in place of a shape, already found.
        scale: of the mesh file.
        colour: red, green, blue, opacity.
        visible: whether it is seen.
        pose: of the solid in the frame of its body.
    """

    node: Node
    weight: Weight
    shape: Shape | None
    colour: tuple[float, float, float, float]
    visible: bool = True
    file: Path | None = None
    scale: float = 1.0
    pose: RigidTransform = field(default_factory=RigidTransform)


def read_solid(node: Node, meshes: MeshFiles) -> SolidBody:
    """Return what a solid block is.

    Raises:
        InvalidModel: figures that cannot be, or a weight that only a missing mesh could tell.
    """
    kind = solid_kind(node)
    shape: Shape | None = None
    even: Weight | None = None  # of 1 kg/m³
    file, scale = None, 1.0
    if kind in _SHAPES:
        try:
            shape, even = _SHAPES[kind](node)
        except InvalidModel as problem:
            if _weighs_by_shape(node, kind) and not node.findings.undefined:
                raise
            message = str(problem).rpartition(f"{node.path}: ")[2]
            node.findings.report.add("dropped", node.path, f"its shape: it {message}")
            even = NOTHING
    elif kind == "File Solid":
        file, scale = meshes.of(node)
    weight = _weight(node, kind, even, lambda: meshes.weight(node, file, scale))
    seen = kind != "Inertia" and node.text("GraphicType", "FromGeometry") != "None"
    return SolidBody(node, weight, shape, _colour(node), visible=seen, file=file, scale=scale)


def solid_kind(node: Node) -> str:
    """Return the block that a solid is today: older models have one for all shapes.

    Raises:
        InvalidModel: an unknown shape.
    """
    if node.kind != "Solid":
        return node.kind
    shape = node.text("GeometryShape", "Brick")
    if shape not in _OLD_SHAPES:
        raise node.refusal(f"has the unknown shape '{shape}'")
    return _OLD_SHAPES[shape]


def _weighs_by_shape(node: Node, kind: str) -> bool:
    """Tell whether a solid's mass follows from its shape."""
    computed = node.text("InertiaType", "CalculateFromGeometry") == "CalculateFromGeometry" and kind != "Graphic"
    massless = node.text("BasedOnType", "Density") == "Density" and node.number("Density", "1000", unit="kg/m^3") == 0
    return computed and not massless


def _weight(node: Node, kind: str, even: Weight | None, of_mesh: Callable[[], Weight]) -> Weight:
    if kind == "Graphic":
        return NOTHING
    method = node.text("InertiaType", "Custom" if kind == "Inertia" else "CalculateFromGeometry")
    if method == "PointMass":
        return Weight(_mass(node), np.zeros(3), np.zeros((3, 3)))
    if method == "Custom":
        mass = _mass(node)
        moments = node.numbers("MomentsOfInertia", "[1 1 1]", unit="kg*m^2", size=3, unknown="[0 0 0]")
        yz, zx, xy = node.numbers("ProductsOfInertia", "[0 0 0]", unit="kg*m^2", size=3)
        inertia = np.diag(moments) + np.array([[0, xy, zx], [xy, 0, yz], [zx, yz, 0]])
        return Weight(mass, node.numbers("CenterOfMass", "[0 0 0]", unit="m", size=3), inertia)
    if method != "CalculateFromGeometry":
        raise node.refusal(f"has the unknown inertia type '{method}'")
    based = node.text("BasedOnType", "Density")
    if based == "Density" and node.number("Density", "1000", unit="kg/m^3") == 0:
        return NOTHING
    if even is None:
        even = of_mesh()
    if based == "Mass":
        return even.scaled(_mass(node) / even.mass) if even.mass else NOTHING
    density = node.number("Density", "1000", unit="kg/m^3")
    if density < 0:
        raise node.refusal(f"Density is {density:g}; it must not be negative")
    return even.scaled(density)


def _mass(node: Node) -> float:
    mass = node.number("Mass", "1", unit="kg", unknown="0")
    if mass < 0:
        raise node.refusal(f"Mass is {mass:g}; it must not be negative")
    return mass


def _colour(node: Node) -> tuple[float, float, float, float]:
    values = np.clip(node.numbers("GraphicDiffuseColor", "[0.5 0.5 0.5]"), 0.0, 1.0)
    red, green, blue = values[:3] if values.size >= 3 else np.full(3, 0.5)
    opacity = node.numbers("GraphicOpacity", "1")
    return float(red), float(green), float(blue), float(np.clip(opacity[0] if opacity.size else 1.0, 0.05, 1.0))


def moved(weight: Weight, pose: RigidTransform) -> Weight:
    """Return a weight in the frame that ``pose`` places it in."""
    turn = pose.rotation().matrix()
    return Weight(weight.mass, np.asarray(pose.multiply(weight.com)), turn @ weight.inertia @ turn.T)


def together(weights: list[Weight]) -> Weight:
    """Return several bodies as one, all in the same frame."""
    mass = sum(weight.mass for weight in weights)
    if mass <= 0:
        return NOTHING
    com = sum((weight.mass * weight.com for weight in weights), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for weight in weights:
        arm: Vector = weight.com - com
        inertia = inertia + weight.inertia + weight.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
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
    report.add("repaired", name, f"no body has the principal moments {shown} kg m²: made possible")
    return np.asarray(axes @ np.diag(allowed) @ axes.T)
