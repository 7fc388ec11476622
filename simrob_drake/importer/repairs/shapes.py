"""Rewrite the shapes of a robot so that a simulator takes them: primitives checked, meshes as OBJ files.

Colours are as in RViz: a mesh that brings its own keeps them, and the URDF's material colours the others. Every colour
of a mesh becomes a ``<visual>`` of its own; a texture stays with its mesh.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

from simrob_drake.importer.meshes.library import MeshLibrary
from simrob_drake.importer.meshes.places import MeshOutside, MeshPlaces
from simrob_drake.importer.meshes.writing import MeshWriter
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.collisions import Collisions
from simrob_drake.importer.repairs.shape_elements import ShapeNames, check_geometry, drop, shapes_of
from simrob_drake.importer.repairs.visuals import Visuals
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import name_of


def import_shapes(
    robot: ET.Element, *, source: Path, folder: Path | None, options: ImportOptions, report: ImportReport
) -> None:
    """Rewrite every ``<visual>`` and ``<collision>`` of a robot, in place, and write its meshes.

    Args:
        robot: the ``robot`` element with unique names and origins that are numbers.
        source: the URDF, an absolute path; relative mesh names start at its folder.
        folder: where ``meshes/`` is written; None writes nothing.
        options: where meshes may lie, and what collisions become.
        report: takes a note of everything that is done.

    Raises:
        InvalidModel: a mesh, or a file that it names, lies outside of the folders that may be read.
    """
    library = MeshLibrary(MeshPlaces(source, options.mesh_path))
    writer, names = MeshWriter(folder), ShapeNames(robot)
    visuals = Visuals(library, writer, names, report)
    collisions = Collisions(library, writer, names, report, options.collision)
    for link in robot.iterfind("link"):
        _check_shapes(link, report)
        drawn = [deepcopy(element) for element in link.iterfind("visual")]
        try:
            visuals.rewrite(link)
            collisions.rewrite(link, drawn)
        except MeshOutside as problem:
            raise report.refusal(f"link '{name_of(link)}'", str(problem)) from problem
    collisions.finish(robot)


def _check_shapes(link: ET.Element, report: ImportReport) -> None:
    """Drop what is no shape."""
    for tag in ("visual", "collision"):
        for where, element in shapes_of(link, tag):
            problem = check_geometry(element, where, report)
            if problem:
                drop(link, element, where, problem, report)
