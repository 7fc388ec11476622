"""Repair the inertias of a robot. Those that no body can have are corrected, estimated or left out.

An inertia that is wrong by rounding only is corrected. Any other is removed from its link. What takes its place depends
on the options of the import: an estimate from the shapes of the link, or nothing.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
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
"""Error of moments, as a share of the largest one, up to which they count as rounded and are corrected."""

SMALL_MASS = 0.1
"""Mass of a link that has neither mass nor shape, such as the one between two axes that cross [kg]."""

_MARGIN = 1e-9
"""Error that writing and reading of numbers may add, as a share of the largest moment."""

_ON_AXIS = 1e-6
"""Distance up to which a point counts as on an axis [m]."""


@dataclass(frozen=True)
class _Inertial:
    """The content of a link's ``<inertial>``.

    Attributes:
        mass: the mass, or 0 if it is missing [kg].
        moments: moments about the centre of mass, shape (3, 3) [kg m²]; None if they are missing. Products of inertia
            that are missing are zero.
        place: pose of the centre of mass, with the axes of the moments, in the link.
    """

    mass: float
    moments: Vector | None
    place: RigidTransform

    @property
    def problem(self) -> str:
        """Reason why no body can have this inertia, in words; empty if a body can have it."""
        if self.mass < 0:
            return message("importer.negative_mass", "mass {mass:g} kg is negative", mass=self.mass)
        if not self.mass:
            return message("importer.moments_without_mass", "has moments of inertia but no mass")
        if self.moments is None:
            return message("importer.mass_without_moments", "has a mass but no moments of inertia")
        return impossible(self.moments)


class _Replacement(NamedTuple):
    """An inertia that has taken the place of a removed one.

    Attributes:
        kind: kind of the entry in the report.
        text: end of the entry's text, after the problem of the removed inertia.
    """

    kind: EntryKind
    text: str


def repair_inertias(
    robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Repair the inertias of all links, in place.

    Args:
        robot: the ``robot`` element, with repaired shapes.
        folder: folder of its meshes; None if there is none.
        options: options of the import, which say whether inertias are estimated.
        report: gets an entry for each repair, each body without inertia, and each inertia that looks wrong.
    """
    removed = _remove_impossible_inertias(robot, report)
    # Points of mass are possible inertias, which the first step leaves.
    removed |= _remove_points_on_axes(robot)

    carrier_of = carriers(robot)
    # Bodies in which a link still has a mass after the removals.
    bodies_with_mass = {
        carrier_of[name_of(link)] for link in robot.iterfind("link") if mass_of(link) > 0
    }
    for link in robot.iterfind("link"):
        inertia = removed.get(name_of(link))
        if inertia is None:
            continue
        # The user's wish comes first. Without it no number is made up, except for a point of mass.
        if options.estimate_inertia:
            replacement = _estimate(link, inertia, folder, options.density)
        elif (
            inertia.mass > 0
            and inertia.moments is None
            and carrier_of[name_of(link)] in bodies_with_mass
        ):
            # Other links of the same body have moments, so that a point of mass makes no body without moments.
            replacement = _replace_by_point(link, inertia)
        else:
            replacement = _Replacement("dropped", message("importer.left_out", "; left out"))
        element = message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link))
        # Joined as messages: an f-string would keep the English words only.
        report.add(replacement.kind, element, join_texts([inertia.problem, replacement.text], ""))

    # Bodies are looked at after single links: a link without inertia may be welded to one that has it.
    _repair_bodies_without_inertia(robot, folder, options, report)
    # Inertias that are possible, but not plausible, stay as they are. The user decides.
    for where, doubt in robot_doubts(robot, folder):
        report.add("read", where, doubt)


def _repair_bodies_without_inertia(
    robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Estimate the inertia of bodies that need one and have none if the options ask for that, otherwise report them.

    A body is a link with all links that fixed joints connect to it.

    Args:
        robot: the ``robot`` element.
        folder: folder of its meshes; None if there is none.
        options: options of the import.
        report: gets an entry for each estimate, and for each body without inertia.
    """
    # A root that is fixed to the world needs no inertia.
    is_floating = find_base(robot, options).base == "floating"
    for name in links_without_inertia(robot, floating=is_floating):
        if options.estimate_inertia:
            _estimate_body(name, bodies(robot)[name], folder, options.density, report)
            continue
        problem = message(
            "importer.no_usable_inertia",
            "has no usable inertia, so dynamic stations refuse this robot; write one, or estimate it "
            "with --estimate-inertia",
        )
        report.add("open", message("robots.link_called", "link '{link}'", link=name), problem)


def _read(inertial: ET.Element) -> _Inertial:
    """Read an ``<inertial>``. Moments count as missing if one of Ixx, Iyy and Izz is missing."""
    diagonal = [number(inertial.find("inertia"), key) for key in MOMENTS[:3]]
    moments = None if None in diagonal else moments_of(inertial)
    mass = number(inertial.find("mass"), "value") or 0.0
    return _Inertial(mass, moments, pose_of(inertial))


def _remove_impossible_inertias(robot: ET.Element, report: ImportReport) -> dict[str, _Inertial]:
    """Correct inertias that are wrong by rounding, and remove others that no body can have.

    Returns:
        the removed inertias, by the name of the link.
    """
    removed = {}
    for link in robot.iterfind("link"):
        inertia = _correct_or_remove(link, report)
        if inertia is not None:
            removed[name_of(link)] = inertia
    return removed


def _correct_or_remove(link: ET.Element, report: ImportReport) -> _Inertial | None:
    """Correct the inertia of a link. If it cannot be corrected, remove it and return it.

    Returns None if the link keeps its inertia or had none. An ``<inertial>`` without mass and moments counts as none:
    it is removed if it lacks ``<mass>`` or ``<inertia>``, and stays if it has both, with zeros.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where = message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link))
    inertia = _read(inertial)

    has_moments = inertia.moments is not None and inertia.moments.any()
    if not inertia.mass and not has_moments:
        # An incomplete <inertial> is removed. One with zeros in both elements is kept: it means a link without mass.
        if inertial.find("mass") is None or inertial.find("inertia") is None:
            link.remove(inertial)
            report.add(
                "dropped", where, message("importer.says_nothing", "has neither a mass nor moments")
            )
        return None

    problem = inertia.problem
    if not problem:
        return None
    corrected = None
    # Without a mass or without moments there is nothing that a small correction could make right.
    if inertia.mass > 0 and inertia.moments is not None:
        corrected = correct_rounding(inertia.moments)
    if corrected is None:
        link.remove(inertial)
        return inertia

    set_moments(inertial, corrected)
    listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(corrected))
    report.add(
        "repaired",
        where,
        message(
            "importer.by_rounding",
            "{problem}; corrected as a rounding error: {moments}",
            problem=problem,
            moments=listed,
        ),
    )
    return None


def correct_rounding(moments: Vector) -> Vector | None:
    """Find moments of inertia close to given ones that a body can have.

    A body can have the principal moments I1 <= I2 <= I3 if I1 >= 0 and I3 <= I1 + I2. An excess e = I3 - I1 - I2 > 0 is
    removed by adding e/3 to I1 and I2, and subtracting e/3 from I3.

    Args:
        moments: the moments, shape (3, 3) [kg m²].

    Returns:
        the corrected moments, or None if the given ones are wrong by more than rounding.
    """
    principal, axes = np.linalg.eigh(moments)  # in ascending order
    largest = float(np.abs(principal).max())
    # The first condition, I1 >= 0.
    corrected = np.maximum(principal, 0.0)
    # The second condition, I3 <= I1 + I2.
    excess = float(corrected[2] - corrected[0] - corrected[1])
    # The larger of the two violations decides whether this is rounding.
    error = max(-float(principal[0]), excess)
    if error > ROUNDING * largest:
        return None
    # The margin keeps the moments possible when they are written with few digits and read again.
    margin = _MARGIN * largest
    corrected += np.array([1.0, 1.0, -1.0]) * (max(excess, 0.0) + margin) / 3 + margin
    # Back from the principal axes to the axes of the link.
    result = axes @ np.diag(corrected) @ axes.T
    if impossible(result):
        return None
    # The product is symmetric up to rounding only.
    return np.asarray((result + result.T) / 2)


def _replace_by_point(link: ET.Element, inertia: _Inertial) -> _Replacement:
    """Write the mass of a removed inertia, as a point without moments, into its link."""
    no_moments = RotationalInertia(0, 0, 0)
    point = SpatialInertia.MakeFromCentralInertia(
        inertia.mass, inertia.place.translation(), no_moments
    )
    _write(link, point)
    return _Replacement(
        "defaulted",
        message(
            "importer.point_of_mass", "; replaced by a point mass of {mass:g} kg", mass=inertia.mass
        ),
    )


def _estimate(
    link: ET.Element, inertia: _Inertial, folder: Path | None, density: float
) -> _Replacement:
    """Estimate the inertia of a link whose own was removed, and write it.

    A mass that the link had is kept. A link with shapes gets the inertia of these. A link without shapes becomes a ball
    of its mass, or gets no inertia if it has no mass.

    Args:
        link: the link.
        inertia: the removed inertia.
        folder: folder of the meshes.
        density: density of the shapes [kg/m³].
    """
    estimate = inertia_of_shapes(link, folder, density)
    if estimate is not None and inertia.mass > 0:
        # The unit inertia, moments per mass, stays: the mass is distributed like the volume of the shapes.
        scaled = SpatialInertia(inertia.mass, estimate.get_com(), estimate.get_unit_inertia())
        whole = message(
            "importer.scaled_to_mass", "scaled to its mass of {mass:g} kg", mass=inertia.mass
        )
        text = message(
            "importer.estimated_and_scaled",
            "; estimated from its shapes: {inertia}, {scaled}",
            inertia=_write(link, scaled),
            scaled=whole,
        )
        return _Replacement("defaulted", text)
    if estimate is not None:
        text = message(
            "importer.estimated",
            "; estimated from its shapes: {inertia}",
            inertia=_write(link, estimate),
        )
        return _Replacement("defaulted", text)
    if inertia.mass > 0:
        # The ball has its centre at the centre of mass, while a link's inertia is about the link's origin.
        ball = _ball(inertia.mass, density).Shift(-inertia.place.translation())
        text = message(
            "importer.estimated_as_ball",
            "; estimated as a ball, as the link has no shape: {inertia}",
            inertia=_write(link, ball),
        )
        return _Replacement("defaulted", text)
    return _Replacement(
        "dropped",
        message(
            "importer.without_shape_left_out",
            "; left out, as the link has no shape for an estimate",
        ),
    )


def _estimate_body(
    carrier: str, links: list[ET.Element], folder: Path | None, density: float, report: ImportReport
) -> None:
    """Estimate the inertia of a body without mass from the shapes of its links. A body without shapes becomes a ball.

    Args:
        carrier: name of the link that carries the others of the body.
        links: the links of the body.
        folder: folder of the meshes.
        density: density of the shapes [kg/m³].
        report: gets an entry for each link that gets an inertia.
    """
    has_shapes = False
    for link in links:
        estimate = inertia_of_shapes(link, folder, density)
        if estimate is None:
            continue
        has_shapes = True
        text = message(
            "importer.estimated_at_density",
            "has no inertia; estimated from its shapes at {density:g} kg/m³: {inertia}",
            inertia=_write(link, estimate),
            density=density,
        )
        report.add(
            "defaulted", message("robots.link_called", "link '{link}'", link=name_of(link)), text
        )
    if has_shapes:
        return
    # Only the carrier becomes a ball: one inertia is enough for the body.
    link = next(link for link in links if name_of(link) == carrier)
    ball = _write(link, _ball(SMALL_MASS, density))
    report.add(
        "defaulted",
        message("robots.link_called", "link '{link}'", link=carrier),
        message(
            "importer.small_ball",
            "has neither inertia nor shape; estimated as a small ball: {inertia}",
            inertia=ball,
        ),
    )


def _write(link: ET.Element, inertia: SpatialInertia) -> str:
    """Write an inertia into a link, in place of its own, and return it in words.

    Args:
        link: the link.
        inertia: the inertia about the origin of the link, in the link's axes.
    """
    com = inertia.get_com()
    # A URDF gives moments about the centre of mass.
    moments = np.asarray(inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())
    if impossible(moments):
        # Moments of a thin shape may be impossible by rounding.
        corrected = correct_rounding(moments)
        moments = moments if corrected is None else corrected
    set_inertia(link, mass=inertia.get_mass(), moments=moments, pose=RigidTransform(com))
    listed = ", ".join(f"{moment:.3g}" for moment in np.linalg.eigvalsh(moments))
    return compound("{mass:.4g} kg, {moments} kg m²", mass=inertia.get_mass(), moments=listed)


def _remove_points_on_axes(robot: ET.Element) -> dict[str, _Inertial]:
    """Remove the masses of bodies at the ends of chains that are points on the axes of their joints.

    Such a body has no inertia about its axis, and nothing behind it that has. The mass matrix would be singular.

    Returns:
        the removed inertias, without moments, by the name of the link.
    """
    carrier_of = carriers(robot)
    links_of = bodies(robot)
    moving_joints = [joint for joint in robot.iterfind("joint") if joint.get("type") != "fixed"]
    fixed_joints = [joint for joint in robot.iterfind("joint") if joint.get("type") == "fixed"]
    bodies_with_joints = {carrier_of[link_of(joint, "parent")] for joint in moving_joints}
    joint_of_link = {link_of(joint, "child"): joint for joint in fixed_joints}

    # Only the last body of a chain: any other turns the bodies behind it as well, whose inertia is enough.
    removed: dict[str, _Inertial] = {}
    for joint in robot.iterfind("joint"):
        body = link_of(joint, "child")
        # A prismatic joint feels the mass itself, so a point is enough for it.
        if joint.get("type") not in ("revolute", "continuous") or body in bodies_with_joints:
            continue
        inertias = dict[str, _Inertial]()
        links = {}
        for link in links_of[body]:
            inertial = link.find("inertial")
            if inertial is not None and mass_of(link) > 0:
                links[name_of(link)] = link
                inertias[name_of(link)] = _read(inertial)
        axis = _axis_direction(joint)
        if not all(
            _is_on_axis(inertia, link, joint_of_link, axis) for link, inertia in inertias.items()
        ):
            continue
        for name, inertia in inertias.items():
            removed[name] = _Inertial(inertia.mass, None, inertia.place)
            inertial = links[name].find("inertial")
            assert inertial is not None
            links[name].remove(inertial)
    return removed


def _axis_direction(joint: ET.Element) -> Vector:
    """Read the direction of a joint's axis, shape (3,); x if the joint gives none, as a URDF has it."""
    axis = joint.find("axis")
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    return np.array(text.split(), dtype=float)


def _is_on_axis(
    inertia: _Inertial, link: str, joint_of_link: dict[str, ET.Element], axis: Vector
) -> bool:
    """Whether the mass of a link is a point on an axis through the origin of its body.

    Args:
        inertia: the inertia of the link.
        link: name of the link.
        joint_of_link: the fixed joint that holds each link to the next one of its body, by the link's name.
        axis: direction of the axis, shape (3,).
    """
    if inertia.moments is None or inertia.moments.any():
        return False
    # The centre of mass in the frame of the body: through all fixed joints up to the link at the moving joint.
    point = inertia.place.translation()
    while link in joint_of_link:
        joint = joint_of_link[link]
        point = pose_of(joint) @ point
        link = link_of(joint, "parent")
    # Distance of the point p from the line along the unit vector a: |p x a|.
    unit_axis = axis / np.linalg.norm(axis)
    distance = float(np.linalg.norm(np.cross(point, unit_axis)))
    return distance < _ON_AXIS


def _ball(mass: float, density: float) -> SpatialInertia:
    """Make the inertia of a solid ball of a mass [kg] and a density [kg/m³], about its centre."""
    # m = 4/3 pi r³ rho
    radius = (3 * mass / (4 * np.pi * density)) ** (1 / 3)
    return SpatialInertia.SolidSphereWithMass(mass=mass, radius=radius)
