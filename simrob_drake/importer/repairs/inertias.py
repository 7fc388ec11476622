"""Inertias: what no body can have is mended, estimated or left out, and what looks wrong is told."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.inertia_figures import (
    SMALL_MASS,
    Figures,
    ball,
    inertia_of_shapes,
    mended,
    read_figures,
    with_mass,
    write_inertia,
)
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.bodies import bodies, carriers
from simrob_drake.robots.urdf import link_of, mass_of, name_of, root_link
from simrob_drake.robots.urdf_elements import pose_of, set_moments

_HEAVIEST = 20_000.0  # kg/m³, as tungsten and gold
_LIGHTEST = 1.0  # kg/m³, as air
_FAR = 1.0  # m, between a centre of mass and the middle of the shapes
_ON_AXIS = 1e-6  # m


def repair_inertias(robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport) -> None:
    """Leave only inertias that a body can have, in place, and estimate the others where that was chosen.

    The robot's shapes are repaired; their meshes lie in the folder.
    """
    unusable: dict[str, Figures] = {}
    for link in robot.iterfind("link"):
        figures = _repair(link, report)
        if figures is not None:
            unusable[name_of(link)] = figures
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
                "refused",
                f"link '{carrier}'",
                "has no usable inertia: dynamic stations refuse this robot; estimate it with --estimate-inertia",
            )
    for link in robot.iterfind("link"):
        _judge(link, folder, report)


def _repair(link: ET.Element, report: ImportReport) -> Figures | None:
    """Mend a link's inertia; where that is impossible, take it out and return what it said."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where, figures = f"link '{name_of(link)}' <inertial>", read_figures(inertial)
    if figures.is_empty:
        if inertial.find("mass") is None or inertial.find("inertia") is None:
            link.remove(inertial)
            report.add("dropped", where, "says nothing: no mass, no moments")
        return None
    problem = figures.problem
    if not problem:
        return None
    right = mended(figures.moments) if figures.mass > 0 and figures.moments is not None else None
    if right is not None:
        set_moments(inertial, right)
        listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(right))
        report.add("repaired", where, f"{problem}; by rounding, so {listed}")
        return None
    link.remove(inertial)
    return figures


def _leave_out(robot: ET.Element, taken_out: list[tuple[ET.Element, Figures]], report: ImportReport) -> None:
    """Tell which inertias were taken out; a mass on a body that has moments already stays, as a point."""
    carrier = carriers(robot)
    heavy = {carrier[name_of(link)] for link in robot.iterfind("link") if mass_of(link) > 0}
    for link, figures in taken_out:
        where = f"link '{name_of(link)}' <inertial>"
        if figures.mass > 0 and figures.moments is None and carrier[name_of(link)] in heavy:
            place = figures.place.translation()
            write_inertia(link, SpatialInertia.MakeFromCentralInertia(figures.mass, place, RotationalInertia(0, 0, 0)))
            report.add("defaulted", where, f"{figures.problem}; a point of {figures.mass:g} kg")
        else:
            report.add("dropped", where, f"{figures.problem}; left out")


def _estimate_unusable(
    taken_out: list[tuple[ET.Element, Figures]], folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    for link, figures in taken_out:
        where = f"link '{name_of(link)}' <inertial>"
        estimate = inertia_of_shapes(link, folder, options.density)
        if estimate is not None and figures.mass > 0:
            told = _write(link, with_mass(estimate, figures.mass))
            how = f"estimated: {told} of its shapes, scaled to its mass of {figures.mass:g} kg"
        elif estimate is not None:
            how = f"estimated: {_write(link, estimate)} of its shapes"
        elif figures.mass > 0:
            told = _write(link, ball(figures.mass, options.density).Shift(-figures.place.translation()))
            how = f"and it has no shape; a ball: {told}"
        else:
            report.add("dropped", where, f"{figures.problem}, and it has no shape; left out")
            continue
        report.add("defaulted", where, f"{figures.problem}; {how}")


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
        told = _write(link, ball(SMALL_MASS, options.density))
        report.add("defaulted", f"link '{carrier}'", f"has neither inertia nor shape; a small ball: {told}")


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


def _take_out_points_on_axes(robot: ET.Element) -> dict[str, Figures]:
    """Take the inertias out, in place, that leave the mass matrix singular, and return what they said, by link.

    Only the last body of a chain is looked at: what is further in may be moved by what is further out.
    """
    carrier, links = carriers(robot), bodies(robot)
    inner = {carrier[link_of(joint, "parent")] for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    fixed = {link_of(j, "child"): j for j in robot.iterfind("joint") if j.get("type") == "fixed"}
    taken: dict[str, Figures] = {}
    for joint in robot.iterfind("joint"):
        last = link_of(joint, "child")
        if joint.get("type") in ("revolute", "continuous") and last not in inner:
            points = _masses(links[last])
            if all(_is_on_axis(figures, _pose_in_body(name, fixed), _axis(joint)) for name, figures in points.items()):
                taken |= {name: Figures(figures.mass, None, figures.place) for name, figures in points.items()}
    for link in robot.iterfind("link"):
        inertial = link.find("inertial")
        if name_of(link) in taken and inertial is not None:
            link.remove(inertial)
    return taken


def _masses(links: list[ET.Element]) -> dict[str, Figures]:
    """Return what the links with mass say, by name."""
    inertials = {name_of(link): link.find("inertial") for link in links if mass_of(link) > 0}
    return {name: read_figures(inertial) for name, inertial in inertials.items() if inertial is not None}


def _pose_in_body(link: str, fixed: Mapping[str, ET.Element]) -> RigidTransform:
    """Return a link's pose in the link that carries it, given the fixed joints by the link that they hold."""
    pose = RigidTransform()
    while link in fixed:
        pose, link = pose_of(fixed[link]) @ pose, link_of(fixed[link], "parent")
    return pose


def _axis(joint: ET.Element) -> Vector:
    axis = joint.find("axis")
    return np.array(("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split(), dtype=float)


def _is_on_axis(figures: Figures, pose: RigidTransform, axis: Vector) -> bool:
    """Whether a link's mass is a point on an axis through the origin of its body, in which the link has the pose."""
    offset = np.cross(pose @ figures.place.translation(), axis / np.linalg.norm(axis))
    return figures.moments is not None and not figures.moments.any() and float(np.linalg.norm(offset)) < _ON_AXIS


def _judge(link: ET.Element, folder: Path | None, report: ImportReport) -> None:
    """Tell of figures that a body can have, but hardly one of this shape: the usual slips with units."""
    inertial = link.find("inertial")
    if inertial is None or mass_of(link) == 0:
        return
    figures, solid = read_figures(inertial), inertia_of_shapes(link, folder, 1.0)
    if solid is None or figures.moments is None:
        return
    where, volume = f"link '{name_of(link)}' <inertial>", solid.get_mass()
    density = figures.mass / volume
    if not _LIGHTEST <= density <= _HEAVIEST:
        report.add("read", where, f"mass {figures.mass:g} kg in {volume:.3g} m³ is {density:.3g} kg/m³; grams, or mm?")
    com = solid.get_com()
    spread = float(np.trace(solid.Shift(com).CalcRotationalInertia().CopyToFullMatrix3())) / volume
    if not spread > 0:  # lost in rounding: the shapes lie absurdly far out
        return
    apart = float(np.linalg.norm(figures.place.translation() - com))
    if apart > _FAR + 2 * np.sqrt(spread):
        report.add("read", where, f"its centre of mass lies {apart:.3g} m from the middle of its shapes; in mm?")
    ratio = float(np.trace(figures.moments)) / figures.mass / spread
    if ratio > 100 or 0 < ratio < 0.01:
        report.add("read", where, f"its moments are {ratio:.3g} times those of a solid body of its mass and shapes")
