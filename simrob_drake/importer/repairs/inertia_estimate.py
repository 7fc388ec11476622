"""The inertia of a link from its geometry: what a solid body of that shape would have."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Shape, Sphere
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.robots.urdf import DRAKE
from simrob_drake.robots.urdf_check import SHAPE_SIZES, shape_defect
from simrob_drake.robots.urdf_elements import pose_of

SMALL_MASS = 0.1
"""Of a link that has neither mass nor shape, such as the one between two axes that cross [kg]."""

_MAKERS = {"box": Box, "cylinder": Cylinder, "capsule": Capsule, "sphere": Sphere, "ellipsoid": Ellipsoid}
_LEAST_VOLUME = 1e-9  # m³, a cube of 1 mm: less is a decal, not a body


def inertia_of_shapes(link: ET.Element, folder: Path | None, density: float) -> SpatialInertia | None:
    """Return the inertia of a link's collision shapes, or of its visuals if it has none, as if they were solid.

    Args:
        link: the link; its shapes are positive, its meshes lie below the folder.
        folder: the robot's folder; None leaves meshes out.
        density: [kg/m³].

    Returns:
        about the link's origin, in its axes; None if it has no shape with a volume. Shapes that overlap count twice.
    """
    for role in ("collision", "visual"):
        total = None
        for element in link.iterfind(role):
            part = _solid(element, folder, density)
            if part is None:
                continue
            if total is None:
                total = part
            else:
                total += part
        if total is not None and total.get_mass() >= _LEAST_VOLUME * density:
            return total
    return None


def ball(mass: float, density: float) -> SpatialInertia:
    """Return the inertia of a solid ball of a mass [kg] and density [kg/m³] at a link's origin."""
    radius = (3 * mass / (4 * np.pi * density)) ** (1 / 3)
    return SpatialInertia.SolidSphereWithMass(mass=mass, radius=radius)


def with_mass(inertia: SpatialInertia, mass: float) -> SpatialInertia:
    """Return the inertia of the same body with another mass [kg]."""
    return SpatialInertia(mass, inertia.get_com(), inertia.get_unit_inertia())


def _solid(element: ET.Element, folder: Path | None, density: float) -> SpatialInertia | None:
    """Return the inertia of a visual or collision element in its link."""
    geometry = element.find("geometry")
    try:
        shape = None if geometry is None or not len(geometry) else _shape(geometry[0], folder)
        if shape is None:
            return None
        inertia = CalcSpatialInertia(shape=shape, density=density)
    except (RuntimeError, ValueError, SystemExit):  # flat or empty meshes; failed assertions come as SystemExit
        return None
    pose = pose_of(element)
    return inertia.ReExpress(pose.rotation()).Shift(-pose.translation())


def _shape(element: ET.Element, folder: Path | None) -> Shape | None:
    if element.tag == "mesh":
        scale = [float(word) for word in element.get("scale", "1").split()]
        name = element.get("filename", "")
        if folder is None or not name or not all(scale):
            return None
        return Convex(str(folder / name), scale * 3 if len(scale) == 1 else scale)
    if element.tag not in SHAPE_SIZES or shape_defect(element):
        return None
    return _MAKERS[element.tag.removeprefix(DRAKE)](
        *(float(word) for key in SHAPE_SIZES[element.tag] for word in element.attrib[key].split())
    )
