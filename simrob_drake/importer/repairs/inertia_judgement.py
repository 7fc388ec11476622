"""Inertias that a body can have, but hardly one of this shape: the usual slips with units are told."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from simrob_drake.importer.repairs.inertia_estimate import inertia_of_shapes
from simrob_drake.importer.repairs.inertia_figures import read_figures
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import mass_of, name_of

_HEAVIEST = 20_000.0  # kg/m³, as tungsten and gold
_LIGHTEST = 1.0  # kg/m³, as air
_FAR = 1.0  # m


def judge_inertia(link: ET.Element, folder: Path | None, report: ImportReport) -> None:
    """Tell of figures that a body can have, but hardly one of this shape: the usual slips with units."""
    inertial = link.find("inertial")
    if inertial is None or mass_of(link) == 0:
        return
    figures, solid = read_figures(inertial), inertia_of_shapes(link, folder, 1.0)
    if solid is None or figures.mass is None or figures.moments is None:
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
