"""Mass and moments of a link as a URDF gives them: read, judged, mended where only rounded, and written."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.frames import Vector
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.robots.urdf_elements import pose_of, written

ROUNDING = 1e-3
"""Moments that miss what a body can have by less than this part of the largest are rounded ones, and are mended."""

_KEYS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_MARGIN = 1e-9  # of the largest moment: what writing and reading may cost


@dataclass(frozen=True)
class Figures:
    """What a link's ``<inertial>`` says.

    Attributes:
        mass: [kg]; None where it is missing.
        moments: about the centre of mass, (3, 3) [kg m²]; None where they are missing.
        place: pose of the centre of mass and the axes of the moments in the link.
    """

    mass: float | None
    moments: Vector | None
    place: RigidTransform

    @property
    def is_empty(self) -> bool:
        """Whether nothing is said: no mass, no moments."""
        return not self.mass and (self.moments is None or not self.moments.any())

    @property
    def problem(self) -> str:
        """What no body can have; empty if all is well."""
        if self.mass is not None and self.mass < 0:
            return f"mass {self.mass:g} kg is negative"
        if not self.mass:
            return "has moments of inertia but no mass"
        if self.moments is None:
            return "has a mass but no moments of inertia"
        if is_physical(self.moments):
            return ""
        listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(self.moments))
        return f"no body has the principal moments {listed} kg m²: none is negative, none exceeds the others' sum"


def read_figures(inertial: ET.Element) -> Figures:
    """Return what an ``<inertial>`` says; products of inertia that are missing are zero."""
    element = inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (number(element, key) for key in _KEYS)
    moments = None
    if xx is not None and yy is not None and zz is not None:
        xy, xz, yz = xy or 0.0, xz or 0.0, yz or 0.0
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Figures(number(inertial.find("mass"), "value"), moments, pose_of(inertial))


def is_physical(moments: Vector) -> bool:
    """Whether a body can have these moments, (3, 3) [kg m²], as Drake judges it."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = moments.tolist()
    return bool(RotationalInertia(xx, yy, zz, xy, xz, yz).CouldBePhysicallyValid())


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
    return np.asarray((result + result.T) / 2) if is_physical(result) else None


def write_moments(inertial: ET.Element, moments: Vector) -> None:
    """Write moments, (3, 3) [kg m²], into an ``<inertial>``."""
    element = inertial.find("inertia")
    element = ET.SubElement(inertial, "inertia") if element is None else element
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = moments.tolist()
    for key, value in zip(_KEYS, (xx, yy, zz, xy, xz, yz), strict=True):
        element.set(key, written(value))


def write_inertia(link: ET.Element, inertia: SpatialInertia) -> None:
    """Write an inertia, about the link's origin and in its axes, into a link; one that it has is replaced."""
    for old in link.findall("inertial"):
        link.remove(old)
    com = inertia.get_com()
    moments = np.asarray(inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", xyz=" ".join(written(value) for value in com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=written(inertia.get_mass()))
    right = moments if is_physical(moments) else mended(moments)
    write_moments(inertial, moments if right is None else right)
    link.insert(0, inertial)
