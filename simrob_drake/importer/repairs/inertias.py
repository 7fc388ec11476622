"""Inertias: what no body can have is mended, estimated or left out, and what looks wrong is told."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.structure import number
from simrob_drake.robots.bodies import bodies, carriers, links_without_inertia
from simrob_drake.robots.imports import EntryKind, ImportOptions, ImportReport
from simrob_drake.robots.plausibility import robot_doubts
from simrob_drake.robots.shape_inertia import inertia_of_shapes
from simrob_drake.robots.urdf import (
    MOMENTS,
    impossible,
    link_of,
    mass_of,
    moments_of,
    name_of,
    pose_of,
    set_inertia,
    set_moments,
)

ROUNDING = 1e-3
"""Moments that miss what a body can have by less than this part of the largest are rounded ones, and are mended."""
SMALL_MASS = 0.1  # of a link that has neither mass nor shape, such as the one between two axes that cross [kg]
_MARGIN = 1e-9  # of the largest moment: what writing and reading may cost
_ON_AXIS = 1e-6  # m


@dataclass(frozen=True)
class _Inertial:
    """What a link's ``<inertial>`` says: its mass [kg], 0 where it is missing, its moments and where they are.

    The moments are about the centre of mass, (3, 3) [kg m²], or None where they are missing; products of inertia that
    are missing are zero. ``place`` is the pose of the centre of mass, and of the axes of the moments, in the link.
    """

    mass: float
    moments: Vector | None
    place: RigidTransform

    @property
    def problem(self) -> str:
        """What no body can have; empty if all is well."""
        if self.mass < 0:
            return message("importer.negative_mass", "mass {mass:g} kg is negative", mass=self.mass)
        if not self.mass:
            return message("importer.moments_without_mass", "has moments of inertia but no mass")
        if self.moments is None:
            return message("importer.mass_without_moments", "has a mass but no moments of inertia")
        return impossible(self.moments)


def repair_inertias(robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport) -> None:
    """Leave only inertias that a body can have, in place, others estimated by the repaired shapes where so chosen."""
    taken_out = {name_of(link): inertia for link in robot.iterfind("link") if (inertia := _repair(link, report))}
    taken_out |= _take_out_points_on_axes(robot)
    carrier = carriers(robot)
    heavy = {carrier[name_of(link)] for link in robot.iterfind("link") if mass_of(link) > 0}
    for link in robot.iterfind("link"):
        if (inertia := taken_out.get(name_of(link))) is not None:
            if options.estimate_inertia:
                kind, how = _estimated(link, inertia, folder, options.density)
            elif inertia.mass > 0 and inertia.moments is None and carrier[name_of(link)] in heavy:
                point = inertia.mass, inertia.place.translation(), RotationalInertia(0, 0, 0)
                _write(link, SpatialInertia.MakeFromCentralInertia(*point))
                kind, how = (
                    "defaulted",
                    message("importer.point_of_mass", "; a point of {mass:g} kg", mass=inertia.mass),
                )
            else:
                kind, how = "dropped", message("importer.left_out", "; left out")
            report.add(
                kind,
                message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link)),
                f"{inertia.problem}{how}",
            )
    floating = find_base(robot, options)[0] == "floating"
    for name in links_without_inertia(robot, floating=floating):
        if options.estimate_inertia:
            _estimate_body(name, bodies(robot)[name], folder, options.density, report)
        else:
            problem = message(
                "importer.no_usable_inertia",
                "has no usable inertia: dynamic stations refuse this robot; estimate it with --estimate-inertia",
            )
            report.add("open", message("robots.link_called", "link '{link}'", link=name), problem)
    for where, doubt in robot_doubts(robot, folder):
        report.add("read", where, doubt)


def _read(inertial: ET.Element) -> _Inertial:
    diagonal = [number(inertial.find("inertia"), key) for key in MOMENTS[:3]]
    moments = None if None in diagonal else moments_of(inertial)
    return _Inertial(number(inertial.find("mass"), "value") or 0.0, moments, pose_of(inertial))


def _repair(link: ET.Element, report: ImportReport) -> _Inertial | None:
    """Mend a link's inertia; where that is impossible, take it out and return what it said."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where, inertia = message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link)), _read(inertial)
    if not inertia.mass and (inertia.moments is None or not inertia.moments.any()):
        if inertial.find("mass") is None or inertial.find("inertia") is None:
            link.remove(inertial)
            report.add("dropped", where, message("importer.says_nothing", "says nothing: no mass, no moments"))
        return None
    problem = inertia.problem
    if not problem:
        return None
    right = mended(inertia.moments) if inertia.mass > 0 and inertia.moments is not None else None
    if right is not None:
        set_moments(inertial, right)
        listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(right))
        report.add(
            "repaired",
            where,
            message("importer.by_rounding", "{problem}; by rounding, so {moments}", problem=problem, moments=listed),
        )
        return None
    link.remove(inertial)
    return inertia


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


def _estimated(link: ET.Element, inertia: _Inertial, folder: Path | None, density: float) -> tuple[EntryKind, str]:
    """Estimate what an inertia should have been that is taken out, and return what was done."""
    estimate = inertia_of_shapes(link, folder, density)
    if estimate is not None and inertia.mass > 0:
        scaled = SpatialInertia(inertia.mass, estimate.get_com(), estimate.get_unit_inertia())
        whole = message("importer.scaled_to_mass", "scaled to its mass of {mass:g} kg", mass=inertia.mass)
        return "defaulted", message(
            "importer.estimated_and_scaled",
            "; estimated: {inertia} of its shapes, {scaled}",
            inertia=_write(link, scaled),
            scaled=whole,
        )
    if estimate is not None:
        return "defaulted", message(
            "importer.estimated", "; estimated: {inertia} of its shapes", inertia=_write(link, estimate)
        )
    if inertia.mass > 0:
        ball = _ball(inertia.mass, density).Shift(-inertia.place.translation())
        return "defaulted", message(
            "importer.estimated_as_ball", "; and it has no shape; a ball: {inertia}", inertia=_write(link, ball)
        )
    return "dropped", message("importer.without_shape_left_out", ", and it has no shape; left out")


def _estimate_body(
    carrier: str, links: list[ET.Element], folder: Path | None, density: float, report: ImportReport
) -> None:
    """Give a body without mass that of the shapes of its links, or a small one."""
    estimates = [
        (link, estimate) for link in links if (estimate := inertia_of_shapes(link, folder, density)) is not None
    ]
    for link, estimate in estimates:
        how = message(
            "importer.estimated_at_density",
            "has no inertia; estimated: {inertia} of its shapes at {density:g} kg/m³",
            inertia=_write(link, estimate),
            density=density,
        )
        report.add("defaulted", message("robots.link_called", "link '{link}'", link=name_of(link)), how)
    if not estimates:
        link = next(link for link in links if name_of(link) == carrier)
        guess = _write(link, _ball(SMALL_MASS, density))
        report.add(
            "defaulted",
            message("robots.link_called", "link '{link}'", link=carrier),
            message("importer.small_ball", "has neither inertia nor shape; a small ball: {inertia}", inertia=guess),
        )


def _write(link: ET.Element, inertia: SpatialInertia) -> str:
    """Write an inertia, about the link's origin and in its axes, in place of a link's own; return it in words."""
    com = inertia.get_com()
    moments = np.asarray(inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())
    right = mended(moments) if impossible(moments) else moments
    right = moments if right is None else right
    set_inertia(link, mass=inertia.get_mass(), moments=right, pose=RigidTransform(com))
    listed = ", ".join(f"{moment:.3g}" for moment in np.linalg.eigvalsh(right))
    return compound("{mass:.4g} kg, {moments} kg m²", mass=inertia.get_mass(), moments=listed)


def _take_out_points_on_axes(robot: ET.Element) -> dict[str, _Inertial]:
    """Take inertias out that leave the mass matrix singular, and return them by link: of the last bodies of chains."""
    carrier, links = carriers(robot), bodies(robot)
    inner = {carrier[link_of(joint, "parent")] for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    fixed = {link_of(j, "child"): j for j in robot.iterfind("joint") if j.get("type") == "fixed"}
    taken: dict[str, _Inertial] = {}
    for joint in robot.iterfind("joint"):
        last = link_of(joint, "child")
        if joint.get("type") in ("revolute", "continuous") and last not in inner:
            axis = joint.find("axis")
            along = np.array(("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split(), dtype=float)
            heavy = [(link, link.find("inertial")) for link in links[last] if mass_of(link) > 0]
            points = [(link, inertial, _read(inertial)) for link, inertial in heavy if inertial is not None]
            if all(_is_on_axis(point, name_of(link), fixed, along) for link, _, point in points):
                for link, inertial, point in points:
                    taken[name_of(link)] = _Inertial(point.mass, None, point.place)
                    link.remove(inertial)
    return taken


def _is_on_axis(inertia: _Inertial, link: str, fixed: dict[str, ET.Element], axis: Vector) -> bool:
    """Whether a link's mass is a point on an axis through its body's origin; ``fixed`` are joints by what they hold."""
    if inertia.moments is None or inertia.moments.any():
        return False
    place = inertia.place.translation()
    while link in fixed:
        place, link = pose_of(fixed[link]) @ place, link_of(fixed[link], "parent")
    return float(np.linalg.norm(np.cross(place, axis / np.linalg.norm(axis)))) < _ON_AXIS


def _ball(mass: float, density: float) -> SpatialInertia:
    """Return the inertia of a solid ball of a mass [kg] and density [kg/m³] at a link's origin."""
    return SpatialInertia.SolidSphereWithMass(mass=mass, radius=(3 * mass / (4 * np.pi * density)) ** (1 / 3))
