"""Inertias: what no body can have is mended, estimated or left out, and what looks wrong is told."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.inertia_estimate import SMALL_MASS, ball, inertia_of_shapes, with_mass
from simrob_drake.importer.repairs.inertia_figures import Figures, mended, read_figures, write_inertia, write_moments
from simrob_drake.importer.repairs.inertia_judgement import judge_inertia
from simrob_drake.importer.repairs.points_on_axes import take_out_points_on_axes
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.bodies import bodies, carriers
from simrob_drake.robots.urdf import link_of, mass_of, name_of, root_link
from simrob_drake.robots.urdf_elements import written


def repair_inertias(robot: ET.Element, folder: Path | None, options: ImportOptions, report: ImportReport) -> None:
    """Leave only inertias that a body can have, in place, and estimate the others where that was chosen.

    Args:
        robot: the robot; its shapes are repaired.
        folder: where its meshes lie.
        options: whether to estimate, and at which density.
        report: what it is told to.
    """
    unusable: dict[str, Figures] = {}
    for link in robot.iterfind("link"):
        figures = _repair(link, report)
        if figures is not None:
            unusable[name_of(link)] = figures
    unusable |= take_out_points_on_axes(robot)
    if options.estimate_inertia:
        _estimate_unusable(robot, unusable, folder, options, report)
    else:
        _leave_out(robot, unusable, report)
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
        judge_inertia(link, folder, report)


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
    if figures.mass is not None and figures.mass > 0 and figures.moments is not None:
        right = mended(figures.moments)
        if right is not None:
            write_moments(inertial, right)
            listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(right))
            report.add("repaired", where, f"{problem}; by rounding, so {listed}")
            return None
    link.remove(inertial)
    return figures


def _leave_out(robot: ET.Element, unusable: dict[str, Figures], report: ImportReport) -> None:
    """Tell which inertias were taken out; a mass on a body that has moments already stays, as a point."""
    carrier = carriers(robot)
    heavy = {carrier[name_of(link)] for link in robot.iterfind("link") if mass_of(link) > 0}
    for link in robot.iterfind("link"):
        figures = unusable.get(name_of(link))
        if figures is None:
            continue
        where = f"link '{name_of(link)}' <inertial>"
        if (
            figures.mass is not None
            and figures.mass > 0
            and figures.moments is None
            and carrier[name_of(link)] in heavy
        ):
            place = figures.place.translation()
            write_inertia(link, SpatialInertia.MakeFromCentralInertia(figures.mass, place, RotationalInertia(0, 0, 0)))
            report.add("defaulted", where, f"{figures.problem}; a point of {figures.mass:g} kg")
        else:
            report.add("dropped", where, f"{figures.problem}; left out")


def _estimate_unusable(
    robot: ET.Element, unusable: dict[str, Figures], folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    for link in robot.iterfind("link"):
        figures = unusable.get(name_of(link))
        if figures is None:
            continue
        where = f"link '{name_of(link)}' <inertial>"
        mass = figures.mass if figures.mass is not None and figures.mass > 0 else None
        estimate = inertia_of_shapes(link, folder, options.density)
        if estimate is not None:
            write_inertia(link, estimate if mass is None else with_mass(estimate, mass))
            how = "of its shapes" if mass is None else f"of its shapes, scaled to its mass of {mass:g} kg"
            report.add("defaulted", where, f"{figures.problem}; estimated: {_told(link)} {how}")
        elif mass is not None:
            round_one = ball(mass, options.density)
            centre = figures.place.translation()
            write_inertia(link, round_one.Shift(-centre))
            report.add("defaulted", where, f"{figures.problem}, and it has no shape; a ball: {_told(link)}")
        else:
            report.add("dropped", where, f"{figures.problem}, and it has no shape; left out")


def _estimate_body(
    carrier: str, links: list[ET.Element], folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Give a body without mass that of the shapes of its links, or a small one."""
    found = False
    for link in links:
        estimate = inertia_of_shapes(link, folder, options.density)
        if estimate is not None:
            found = True
            write_inertia(link, estimate)
            text = f"has no inertia; estimated: {_told(link)} of its shapes at {options.density:g} kg/m³"
            report.add("defaulted", f"link '{name_of(link)}'", text)
    if not found:
        link = next(link for link in links if name_of(link) == carrier)
        write_inertia(link, ball(SMALL_MASS, options.density))
        report.add("defaulted", f"link '{carrier}'", f"has neither inertia nor shape; a small ball: {_told(link)}")


def _bodies_without_mass(robot: ET.Element, options: ImportOptions) -> list[str]:
    """Return the links that carry a moving body without mass; the root moves where it floats."""
    heavy = {carrier for carrier, links in bodies(robot).items() if any(mass_of(link) > 0 for link in links)}
    moved = [link_of(joint, "child") for joint in robot.iterfind("joint") if joint.get("type") != "fixed"]
    if find_base(robot, options)[0] == "floating":
        moved.insert(0, root_link(robot))
    return [link for link in moved if link not in heavy]


def _told(link: ET.Element) -> str:
    inertial = link.find("inertial")
    assert inertial is not None  # just written
    figures = read_figures(inertial)
    moments = np.linalg.eigvalsh(figures.moments) if figures.moments is not None else np.zeros(3)
    listed = ", ".join(f"{moment:.3g}" for moment in moments)
    return f"{written(float(f'{figures.mass:.4g}'))} kg, {listed} kg m²"
