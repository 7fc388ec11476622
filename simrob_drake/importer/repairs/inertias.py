"""Inertias: what no body can have is mended, estimated or left out, and what looks wrong is told."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.inertial import (
    SMALL_MASS,
    Inertial,
    ball,
    inertia_of_shapes,
    mended,
    read_inertial,
    with_mass,
    write_inertia,
)
from simrob_drake.robots.bodies import bodies, carriers
from simrob_drake.robots.urdf import link_of, mass_of, name_of, pose_of, root_link, set_moments

_HEAVIEST = 20_000.0  # kg/m³, as tungsten and gold
_LIGHTEST = 1.0  # kg/m³, as air
_FAR = 1.0  # m, between a centre of mass and the middle of the shapes
_ON_AXIS = 1e-6  # m


def repair_inertias(robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport) -> None:
    """Leave only inertias that a body can have, in place, and estimate the others where that was chosen.

    The robot's shapes are repaired; their meshes lie in the folder.
    """
    unusable: dict[str, Inertial] = {}
    for link in robot.iterfind("link"):
        inertia = _repair(link, report)
        if inertia is not None:
            unusable[name_of(link)] = inertia
    unusable |= _take_out_points_on_axes(robot)
    taken_out = [(link, unusable[name_of(link)]) for link in robot.iterfind("link") if name_of(link) in unusable]
    if options.estimate_inertia:
        _estimate_unusable(taken_out, folder, options, report)
    else:
        _leave_out(robot, taken_out, report)
    for carrier in _bodies_without_mass(robot, options):
        if options.estimate_inertia:
            _estimate_body(carrier, bodies(robot)[carrier], folder, options, report)
        else:
            report.add(
                "open",
                f"link '{carrier}'",
                "has no usable inertia: dynamic stations refuse this robot; estimate it with --estimate-inertia",
            )
    for link in robot.iterfind("link"):
        _report_implausible(link, folder, report)


def _repair(link: ET.Element, report: ImportReport) -> Inertial | None:
    """Mend a link's inertia; where that is impossible, take it out and return what it said."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where, inertia = f"link '{name_of(link)}' <inertial>", read_inertial(inertial)
    if inertia.is_empty:
        if inertial.find("mass") is None or inertial.find("inertia") is None:
            link.remove(inertial)
            report.add("dropped", where, "says nothing: no mass, no moments")
        return None
    problem = inertia.problem
    if not problem:
        return None
    right = mended(inertia.moments) if inertia.mass > 0 and inertia.moments is not None else None
    if right is not None:
        set_moments(inertial, right)
        listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(right))
        report.add("repaired", where, f"{problem}; by rounding, so {listed}")
        return None
    link.remove(inertial)
    return inertia


def _leave_out(robot: ET.Element, taken_out: list[tuple[ET.Element, Inertial]], report: ImportReport) -> None:
    """Tell which inertias were taken out; a mass on a body that has moments already stays, as a point."""
    carrier = carriers(robot)
    heavy = {carrier[name_of(link)] for link in robot.iterfind("link") if mass_of(link) > 0}
    for link, inertia in taken_out:
        where = f"link '{name_of(link)}' <inertial>"
        if inertia.mass > 0 and inertia.moments is None and carrier[name_of(link)] in heavy:
            place = inertia.place.translation()
            write_inertia(link, SpatialInertia.MakeFromCentralInertia(inertia.mass, place, RotationalInertia(0, 0, 0)))
            report.add("defaulted", where, f"{inertia.problem}; a point of {inertia.mass:g} kg")
        else:
            report.add("dropped", where, f"{inertia.problem}; left out")


def _estimate_unusable(
    taken_out: list[tuple[ET.Element, Inertial]], folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    for link, inertia in taken_out:
        where = f"link '{name_of(link)}' <inertial>"
        estimate = inertia_of_shapes(link, folder, options.density)
        if estimate is not None and inertia.mass > 0:
            text = _write(link, with_mass(estimate, inertia.mass))
            how = f"estimated: {text} of its shapes, scaled to its mass of {inertia.mass:g} kg"
        elif estimate is not None:
            how = f"estimated: {_write(link, estimate)} of its shapes"
        elif inertia.mass > 0:
            text = _write(link, ball(inertia.mass, options.density).Shift(-inertia.place.translation()))
            how = f"and it has no shape; a ball: {text}"
        else:
            report.add("dropped", where, f"{inertia.problem}, and it has no shape; left out")
            continue
        report.add("defaulted", where, f"{inertia.problem}; {how}")


def _estimate_body(
    carrier: str, links: list[ET.Element], folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Give a body without mass that of the shapes of its links, or a small one."""
    found = False
    for link in links:
        estimate = inertia_of_shapes(link, folder, options.density)
        if estimate is not None:
            found = True
            text = f"has no inertia; estimated: {_write(link, estimate)} of its shapes at {options.density:g} kg/m³"
            report.add("defaulted", f"link '{name_of(link)}'", text)
    if not found:
        link = next(link for link in links if name_of(link) == carrier)
        guess = _write(link, ball(SMALL_MASS, options.density))
        report.add("defaulted", f"link '{carrier}'", f"has neither inertia nor shape; a small ball: {guess}")


def _bodies_without_mass(robot: ET.Element, options: ImportOptions) -> list[str]:
    """Return the links that carry a moving body without mass; the root moves where it floats."""
    heavy = {carrier for carrier, links in bodies(robot).items() if any(mass_of(link) > 0 for link in links)}
    moved = [link_of(joint, "child") for joint in robot.iterfind("joint") if joint.get("type") != "fixed"]
    if find_base(robot, options)[0] == "floating":
        moved.insert(0, root_link(robot))
    return [link for link in moved if link not in heavy]


def _write(link: ET.Element, inertia: SpatialInertia) -> str:
    """Write an inertia, about the link's origin and in its axes, into a link, and return it in words."""
    moments = write_inertia(link, inertia)
    listed = ", ".join(f"{moment:.3g}" for moment in np.linalg.eigvalsh(moments))
    return f"{inertia.get_mass():.4g} kg, {listed} kg m²"


def _take_out_points_on_axes(robot: ET.Element) -> dict[str, Inertial]:
    """Take the inertias out, in place, that leave the mass matrix singular, and return what they said, by link.

    Only the last body of a chain is looked at: what is further in may be moved by what is further out.
    """
    carrier, links = carriers(robot), bodies(robot)
    inner = {carrier[link_of(joint, "parent")] for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    fixed = {link_of(j, "child"): j for j in robot.iterfind("joint") if j.get("type") == "fixed"}
    taken: dict[str, Inertial] = {}
    for joint in robot.iterfind("joint"):
        last = link_of(joint, "child")
        if joint.get("type") in ("revolute", "continuous") and last not in inner:
            inertials = {name_of(link): link.find("inertial") for link in links[last] if mass_of(link) > 0}
            points = {name: read_inertial(found) for name, found in inertials.items() if found is not None}
            if all(_is_on_axis(inertia, _pose_in_body(name, fixed), _axis(joint)) for name, inertia in points.items()):
                taken |= {name: Inertial(inertia.mass, None, inertia.place) for name, inertia in points.items()}
    for link in robot.iterfind("link"):
        inertial = link.find("inertial")
        if name_of(link) in taken and inertial is not None:
            link.remove(inertial)
    return taken


def _pose_in_body(link: str, fixed: Mapping[str, ET.Element]) -> RigidTransform:
    """Return a link's pose in the link that carries it, given the fixed joints by the link that they hold."""
    pose = RigidTransform()
    while link in fixed:
        pose, link = pose_of(fixed[link]) @ pose, link_of(fixed[link], "parent")
    return pose


def _axis(joint: ET.Element) -> Vector:
    axis = joint.find("axis")
    return np.array(("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split(), dtype=float)


def _is_on_axis(inertia: Inertial, pose: RigidTransform, axis: Vector) -> bool:
    """Whether a link's mass is a point on an axis through the origin of its body, in which the link has the pose."""
    offset = np.cross(pose @ inertia.place.translation(), axis / np.linalg.norm(axis))
    return inertia.moments is not None and not inertia.moments.any() and float(np.linalg.norm(offset)) < _ON_AXIS


def _report_implausible(link: ET.Element, folder: Path | None, report: ImportReport) -> None:
    """Tell of figures that a body can have, but hardly one of this shape: the usual slips with units."""
    inertial = link.find("inertial")
    if inertial is None or mass_of(link) == 0:
        return
    inertia, solid = read_inertial(inertial), inertia_of_shapes(link, folder, 1.0)
    if solid is None or inertia.moments is None:
        return
    where, volume = f"link '{name_of(link)}' <inertial>", solid.get_mass()
    density = inertia.mass / volume
    if not _LIGHTEST <= density <= _HEAVIEST:
        report.add("read", where, f"mass {inertia.mass:g} kg in {volume:.3g} m³ is {density:.3g} kg/m³; grams, or mm?")
    com = solid.get_com()
    spread = float(np.trace(solid.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())) / volume
    if not spread > 0:  # lost in rounding: the shapes lie absurdly far out
        return
    apart = float(np.linalg.norm(inertia.place.translation() - com))
    if apart > _FAR + 2 * np.sqrt(spread):
        report.add("read", where, f"its centre of mass lies {apart:.3g} m from the middle of its shapes; in mm?")
    ratio = float(np.trace(inertia.moments)) / inertia.mass / spread
    if ratio > 100 or 0 < ratio < 0.01:
        report.add("read", where, f"its moments are {ratio:.3g} times those of a solid body of its mass and shapes")
