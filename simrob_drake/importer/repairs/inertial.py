"""Mass and moments of a link: as its URDF gives them, and as a solid body of its shapes would have them."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Shape, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.frames import Vector
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.robots.urdf import DRAKE, MOMENTS, impossible, moments_of, pose_of, set_inertia
from simrob_drake.robots.urdf_check import SHAPE_SIZES, shape_defect

ROUNDING = 1e-3
"""Moments that miss what a body can have by less than this part of the largest are rounded ones, and are mended."""

_MARGIN = 1e-9  # of the largest moment: what writing and reading may cost

SMALL_MASS = 0.1
"""Of a link that has neither mass nor shape, such as the one between two axes that cross [kg]."""
_MAKERS = {"box": Box, "cylinder": Cylinder, "capsule": Capsule, "sphere": Sphere, "ellipsoid": Ellipsoid}
_LEAST_VOLUME = 1e-9  # m³, a cube of 1 mm: less is a decal, not a body


@dataclass(frozen=True)
class Inertial:
    """What a link's ``<inertial>`` says.

    Attributes:
        mass: [kg]; 0 where it is missing.
        moments: about the centre of mass, (3, 3) [kg m²]; None where they are missing.
        place: pose of the centre of mass and the axes of the moments in the link.
    """

    mass: float
    moments: Vector | None
    place: RigidTransform

    @property
    def is_empty(self) -> bool:
        """Whether nothing is said: no mass, no moments."""
        return not self.mass and (self.moments is None or not self.moments.any())

    @property
    def problem(self) -> str:
        """What no body can have; empty if all is well."""
        if self.mass < 0:
            return f"mass {self.mass:g} kg is negative"
        if not self.mass:
            return "has moments of inertia but no mass"
        if self.moments is None:
            return "has a mass but no moments of inertia"
        return impossible(self.moments)


def read_inertial(inertial: ET.Element) -> Inertial:
    """Return what an ``<inertial>`` says; products of inertia that are missing are zero."""
    diagonal = [number(inertial.find("inertia"), key) for key in MOMENTS[:3]]
    moments = None if None in diagonal else moments_of(inertial)
    return Inertial(number(inertial.find("mass"), "value") or 0.0, moments, pose_of(inertial))


def mended(moments: Vector) -> Vector | None:
    """Return the nearest moments that a body can have; None if these are wrong by more than rounding."""
    principal, axes = np.linalg.eigh(moments)
    largest = float(np.abs(principal).max())
    right = np.maximum(principal, 0.0)
    excess = float(right[2] - right[0] - right[1])
    if max(-float(principal[0]), excess) > ROUNDING * largest:
        return None
    margin = _MARGIN * largest
    right += np.array([1.0, 1.0, -1.0]) * (max(excess, 0.0) + margin) / 3 + margin
    result = axes @ np.diag(right) @ axes.T
    return None if impossible(result) else np.asarray((result + result.T) / 2)


def write_inertia(link: ET.Element, inertia: SpatialInertia) -> Vector:
    """Write an inertia, about the link's origin and in its axes, into a link in place of one that it has.

    Returns:
        its moments about the centre of mass, (3, 3) [kg m²].
    """
    com = inertia.get_com()
    moments = np.asarray(inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())
    right = mended(moments) if impossible(moments) else moments
    written = moments if right is None else right
    set_inertia(link, mass=inertia.get_mass(), moments=written, pose=RigidTransform(com))
    return written


def inertia_of_shapes(link: ET.Element, folder: Path | None, density: float) -> SpatialInertia | None:
    """Return the inertia of a link's collision shapes, or of its visuals if it has none, as if they were solid [kg/m³].

    It is about the link's origin, in its axes; None if it has no shape with a volume. Shapes are positive, and those
    that overlap count twice; meshes lie below the robot's folder, and are left out without one.
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
