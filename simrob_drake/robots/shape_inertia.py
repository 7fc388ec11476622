"""The inertia of a link of a URDF, estimated from its shapes as if they were solid bodies of one density."""

import xml.etree.ElementTree as ET
from pathlib import Path

from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Shape, Sphere
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.robots.urdf import DRAKE, pose_of
from simrob_drake.robots.urdf_check import SHAPE_SIZES, shape_defect

_LEAST_VOLUME = 1e-9
"""Volume below which shapes are decals and not bodies [m³]. A cube of 1 mm has this volume."""
# Drake's class of each tag. The order of its arguments is that of SHAPE_SIZES.
_CLASSES = {
    "box": Box,
    "cylinder": Cylinder,
    "capsule": Capsule,
    "sphere": Sphere,
    "ellipsoid": Ellipsoid,
}


def inertia_of_shapes(
    link: ET.Element, folder: Path | None, density: float
) -> SpatialInertia | None:
    """Compute the inertia of a link's collision shapes or, if these have no volume, of its visual shapes.

    The common volume of shapes that overlap counts twice. Shapes of less than 1 mm³ in all count as without volume, and
    shapes that cannot be read are left out.

    Args:
        link: a ``link`` element.
        folder: folder of the robot's meshes. If it is None, meshes are left out.
        density: density of the shapes [kg/m³].

    Returns:
        the inertia about the link's origin, in the axes of the link, or None if no shapes have a volume.
    """
    # Collision shapes first: they are closed and simple, while visual meshes often have holes and inner faces.
    for tag in ("collision", "visual"):
        total: SpatialInertia | None = None
        for element in link.iterfind(tag):
            inertia = _inertia_of_shape(element, folder, density)
            if inertia is None:
                continue
            if total is None:
                total = inertia
            else:
                total += inertia
        if total is not None and total.get_mass() >= _LEAST_VOLUME * density:
            return total
    return None


def _inertia_of_shape(
    element: ET.Element, folder: Path | None, density: float
) -> SpatialInertia | None:
    """Compute the inertia of one shape about the link's origin, in the axes of the link.

    Args:
        element: a ``collision`` or ``visual`` element.
        folder: folder of the robot's meshes. If it is None, meshes cannot be read.
        density: density of the shape [kg/m³].

    Returns:
        the inertia, or None if the shape has no volume or cannot be read.
    """
    shape_element = element.find("geometry/*")
    if shape_element is None:
        return None
    try:
        shape = _read_shape(shape_element, folder)
        if shape is None:
            return None
        inertia = CalcSpatialInertia(shape=shape, density=density)
    # Flat or empty meshes have no hull. Failed assertions of Drake come as SystemExit.
    except (RuntimeError, ValueError, SystemExit):
        return None
    # From the axes and the origin of the shape to those of the link.
    pose = pose_of(element)
    return inertia.ReExpress(pose.rotation()).Shift(-pose.translation())


def _read_shape(element: ET.Element, folder: Path | None) -> Shape | None:
    """Make the Drake shape of a child of a ``<geometry>``, such as a ``<box>``. A mesh becomes its convex hull.

    Args:
        element: the element of the shape.
        folder: folder to which the names of meshes are relative; None if meshes cannot be read.

    Returns:
        the shape. None if the shape is unknown or has wrong sizes, if a mesh has no file or is scaled by 0, or if
        ``folder`` is None for a mesh.
    """
    if element.tag == "mesh":
        scales = [float(word) for word in element.get("scale", "1").split()]
        name = element.get("filename", "")
        if folder is None or not name or not all(scales):
            return None
        # One number scales all three directions.
        scale_vector = scales * 3 if len(scales) == 1 else scales
        return Convex(str(folder / name), scale_vector)
    sizes = SHAPE_SIZES.get(element.tag)
    if sizes is None or shape_defect(element):
        return None
    # All numbers of all sizes, in the order in which Drake's class takes them.
    values = [float(word) for key in sizes for word in element.attrib[key].split()]
    shape_class = _CLASSES[element.tag.removeprefix(DRAKE)]
    return shape_class(*values)
