"""The inertia of a link's shapes, as if they were solid."""

import xml.etree.ElementTree as ET
from pathlib import Path

from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Shape, Sphere
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.robots.urdf import DRAKE, pose_of
from simrob_drake.robots.urdf_check import SHAPE_SIZES, shape_defect

_LEAST_VOLUME = 1e-9  # m³, a cube of 1 mm: less is a decal, not a body
_MAKERS = {"box": Box, "cylinder": Cylinder, "capsule": Capsule, "sphere": Sphere, "ellipsoid": Ellipsoid}


def inertia_of_shapes(link: ET.Element, folder: Path | None, density: float) -> SpatialInertia | None:
    """Return the inertia of a link's collision shapes, or of its visuals if it has none, as if they were solid [kg/m³].

    It is about the link's origin, in its axes; None if it has no shape with a volume. Shapes are positive, and those
    that overlap count twice; meshes lie below the robot's folder, and are left out without one.
    """
    for role in ("collision", "visual"):
        parts = [part for element in link.iterfind(role) if (part := _solid(element, folder, density)) is not None]
        for part in parts[1:]:
            parts[0] += part
        if parts and parts[0].get_mass() >= _LEAST_VOLUME * density:
            return parts[0]
    return None


def _solid(element: ET.Element, folder: Path | None, density: float) -> SpatialInertia | None:
    """Inertia of one shape about the link's origin, or None if it has no volume or cannot be read."""
    shape = element.find("geometry/*")
    try:
        solid = None if shape is None else _shape(shape, folder)
        inertia = None if solid is None else CalcSpatialInertia(shape=solid, density=density)
    except (RuntimeError, ValueError, SystemExit):  # flat or empty meshes; failed assertions come as SystemExit
        return None
    pose = pose_of(element)
    return None if inertia is None else inertia.ReExpress(pose.rotation()).Shift(-pose.translation())


def _shape(element: ET.Element, folder: Path | None) -> Shape | None:
    """Return the shape of an element of a ``<geometry>``. Returns None if its sizes or its file are missing."""
    if element.tag == "mesh":
        scale = [float(word) for word in element.get("scale", "1").split()]
        name = element.get("filename", "")
        if folder is None or not name or not all(scale):
            return None
        return Convex(str(folder / name), scale * 3 if len(scale) == 1 else scale)
    sizes = SHAPE_SIZES.get(element.tag)
    if sizes is None or shape_defect(element):
        return None
    values = (float(word) for key in sizes for word in element.attrib[key].split())
    return _MAKERS[element.tag.removeprefix(DRAKE)](*values)
