"""Mass and moments of a link as a URDF gives them: read, judged, mended where only rounded, and written."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import SpatialInertia

from simrob_drake.frames import Vector
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.robots.urdf_elements import MOMENTS, impossible, moments_of, pose_of, set_inertia

ROUNDING = 1e-3
"""Moments that miss what a body can have by less than this part of the largest are rounded ones, and are mended."""

_MARGIN = 1e-9  # of the largest moment: what writing and reading may cost


@dataclass(frozen=True)
class Figures:
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


def read_figures(inertial: ET.Element) -> Figures:
    """Return what an ``<inertial>`` says; products of inertia that are missing are zero."""
    given = [number(inertial.find("inertia"), key) for key in MOMENTS[:3]]
    moments = None if None in given else moments_of(inertial)
    return Figures(number(inertial.find("mass"), "value") or 0.0, moments, pose_of(inertial))


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
    figures = moments if right is None else right
    set_inertia(link, mass=inertia.get_mass(), moments=figures, pose=RigidTransform(com))
    return figures
