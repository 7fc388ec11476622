"""Plausibility checks for the numbers of a station: of its robots, its pieces, and its own keys.

The checks find the usual slips with units, such as millimetres where metres are expected. They only warn, since such
a number is possible. Impossible numbers raise an error when the station is read. A `Doubt` is one implausible number:
where it is, and a text that says what might have been meant. `plausibility_findings` turns doubts into warnings.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidModel, list_names
from simrob_drake.base.file_cache import FileState, file_state
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import MOST_TURN
from simrob_drake.parts.resolved import ResolvedPiece, StationContents
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.pieces import PieceShape, mesh_sides, solid_inertia
from simrob_drake.robots.plausibility import Doubt, MassProperties, doubts_by_shapes, robot_doubts
from simrob_drake.robots.urdf import mesh_file
from simrob_drake.robots.urdf_check import checked_urdf
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.grouping import group_by_words
from simrob_drake.stations.solver_config import ContactConfig

# Keys whose values are poses.
_POSE_KEYS = ("pose", "other_pose", "base", "tcp_offset", "hand_pose")
_FARTHEST = 100.0  # largest plausible coordinate of a pose [m]
# Largest plausible side of a piece [m]; a plate that serves as ground may be larger.
_LARGEST = 30.0
_PLATE = 1.0  # thickness up to which a piece counts as a plate [m]
_SMALLEST = 1e-4  # smallest plausible value for the largest side of a piece [m]
_STRONGEST_GRAVITY = 100.0  # largest plausible gravity [m/s²]; Jupiter has 25
# Largest plausible coefficient of friction; rubber on rubber has about 1.
_ROUGHEST = 5.0
# Smallest plausible factor on the mass that a robot's file gives a link.
_LEAST_MASS_FACTOR = 0.1
_LARGEST_MASS_FACTOR = 10.0  # largest plausible factor
_LISTED = 3  # number of keys that a warning names


class PoseAtKey(NamedTuple):
    """A pose of a configuration."""

    key: str  # dotted key of the pose, such as ``pieces.box.pose``
    pose: Sequence[float]  # x y z Rz Ry Rx: a position [m] and three angles [rad]


def plausibility_findings(config: StationConfig, station: StationContents) -> list[Finding]:
    """Find implausible numbers in a station: in its robots, its pieces, and its own keys.

    Args:
        config: configuration of the station.
        station: the station's robots and pieces.

    Returns:
        warnings; numbers with the same doubt share one warning.
    """
    doubts = list[Doubt]()
    for name, robot in station.robots.items():
        for doubt in _robot_doubts(robot.model):
            doubts.append(
                Doubt(
                    message(
                        "stations.robot_and_place",
                        "robot '{name}': {where}",
                        name=name,
                        where=doubt.where,
                    ),
                    doubt.text,
                )
            )
    for piece in station.pieces.values():
        doubts += _size_doubts(piece)
        doubts += _mass_doubts(piece)
    for found in _poses_in(config, ""):
        doubts += _pose_doubts(found)
    doubts += _mass_factor_doubts(config)
    doubts += _gravity_doubts(config.gravity)
    if config.contact is not None:
        doubts += _friction_doubts(config.contact)
    return _findings(doubts)


def _findings(doubts: Sequence[Doubt]) -> list[Finding]:
    """Make warnings of doubts; doubts whose texts differ only in their numbers share one warning."""
    findings = []
    for group in group_by_words(doubts):
        # A place is a dotted key, or "robot '<name>': <element>". It is part of the text, which alone becomes a warning
        # of a run; the subject is only a title.
        text = compound(
            "{places}: {text}", places=list_names(group.places, _LISTED), text=group.text
        )
        findings.append(
            Finding("warning", message("stations.implausible_number", "implausible number"), text)
        )
    return findings


def _robot_doubts(model: RobotModel) -> tuple[Doubt, ...]:
    """Find the implausible numbers of a robot. Results for a URDF file are cached until the file changes."""
    # A robot that is described by Denavit-Hartenberg parameters has no URDF file.
    if model.dh is not None:
        return tuple(robot_doubts(model.element, model.folder))
    return _urdf_doubts(model.urdf_path, file_state(model.urdf_path))


@lru_cache(maxsize=64)
def _urdf_doubts(path: Path, state: FileState | None) -> tuple[Doubt, ...]:
    """Find the implausible numbers of a URDF file.

    Args:
        path: the file, in the form that the import writes.
        state: state of the file. The function does not read it: it is part of the cache's key, so that a changed file
            is read again.
    """
    return tuple(robot_doubts(checked_urdf(path), path.parent))


def _size_doubts(piece: ResolvedPiece) -> Iterator[Doubt]:
    """Yield a doubt for each shape of a piece that is implausibly large or small.

    A shape of which one length is at most _PLATE counts as a plate, which is never too large: it may serve as ground.
    """
    key = f"pieces.{piece.name}"
    for shape in piece.model.shapes:
        sides = _sides(shape, piece.model.folder)
        if not sides:
            continue
        is_plate = min(sides) <= _PLATE
        if max(sides) > _LARGEST and not is_plate:
            yield Doubt(
                key,
                message(
                    "stations.long_side",
                    "a side of {side:g} m; were millimetres meant? lengths are in metres",
                    side=max(sides),
                ),
            )
        elif max(sides) < _SMALLEST:
            yield Doubt(
                key,
                message(
                    "stations.short_sides",
                    "no side is longer than {side:g} m; lengths are in metres",
                    side=max(sides),
                ),
            )


def _sides(shape: PieceShape, folder: Path) -> tuple[float, ...]:
    """Lengths that describe a shape [m]: sides of a box, radius and length of a cylinder, radius of a sphere.

    Of a mesh they are the sides of the box that encloses it. Returns an empty tuple for a mesh that is no OBJ file.

    Args:
        shape: the shape.
        folder: the folder of the piece's mesh files.
    """
    if shape.box is not None:
        return shape.box
    if shape.cylinder is not None:
        return shape.cylinder
    if shape.sphere is not None:
        return (shape.sphere,)
    file = mesh_file(str(shape.mesh), folder)
    return mesh_sides(file, shape.scale) if file.suffix.lower() == ".obj" else ()


def _mass_doubts(piece: ResolvedPiece) -> Iterator[Doubt]:
    """Yield the doubts that arise if the mass and the inertia of a piece are compared with its shapes.

    The shapes are taken as solid. Nothing is compared if the piece has no mass or no shapes, or if Drake cannot compute
    the volume of a mesh.
    """
    model = piece.model
    solids = [shape.solid(model.folder) for shape in model.shapes]
    # A piece without shapes has nothing to compare with, and one without mass has no inertia.
    if not solids or model.mass == 0:
        return
    try:
        # A mesh that encloses no volume counts as its convex hull.
        filled = solid_inertia(solids, closed=False)
    except InvalidModel:  # Drake cannot read a mesh, or the mesh is flat
        return
    # The first three of the six numbers of an inertia are the moments, and their sum is the trace. With a density of
    # 1 kg/m³, the mass of the shapes is their volume.
    own = MassProperties(model.mass, np.array(model.com), float(sum(model.inertia[:3])))
    shapes = MassProperties(filled.volume, filled.centre, float(sum(filled.moments[:3])))
    for text in doubts_by_shapes(own, shapes):
        yield Doubt(f"pieces.{piece.name}", text)


def _poses_in(node: Any, key: str) -> Iterator[PoseAtKey]:
    """Search for the poses in a part of a configuration, and yield them, depth first.

    Poses are the values of six numbers under _POSE_KEYS. The section ``program`` is not searched.

    Args:
        node: a pydantic model, a mapping, a list or a single value of the configuration.
        key: dotted key of the node; an empty text for the whole configuration.
    """
    for name, value in _entries(node):
        below = f"{key}.{name}" if key else name
        if name in _POSE_KEYS and isinstance(value, tuple) and len(value) == 6:
            yield PoseAtKey(below, value)
        elif below != "program":  # the poses of a program are checked when the program is planned
            yield from _poses_in(value, below)


def _entries(node: Any) -> Iterator[tuple[str, Any]]:
    """Yield the name and the value of each entry of a node; nothing for a single value such as a number.

    The entries of a list have their indices as names.
    """
    if isinstance(node, BaseModel):
        yield from node  # pydantic yields pairs of a field's name and its value
    elif isinstance(node, Mapping):
        for name, value in node.items():
            yield str(name), value
    elif isinstance(node, list | tuple):
        for index, value in enumerate(node):
            yield str(index), value


def _pose_doubts(found: PoseAtKey) -> Iterator[Doubt]:
    """Yield the doubts about a pose: an angle that is too large, a position that is too far away."""
    # The largest angle suffices: a pose in degrees is wrong in all of them.
    angle = max(found.pose[3:], key=abs)
    if abs(angle) > MOST_TURN:
        turns = abs(angle) / (2 * np.pi)
        text = message(
            "stations.angle_of_turns",
            "an angle of {angle:g} rad is {turns:.1f} turns; were degrees meant? ",
            angle=angle,
            turns=turns,
        )
        text += message(
            "stations.degrees_are_radians",
            "{degrees:g}° are {radians:.6g} rad",
            degrees=angle,
            radians=np.deg2rad(angle),
        )
        yield Doubt(found.key, text)
    # In the same way the largest coordinate suffices, for a pose in millimetres.
    coordinate = max(found.pose[:3], key=abs)
    if abs(coordinate) > _FARTHEST:
        text = message(
            "stations.far_coordinate",
            "a coordinate of {coordinate:g} m; were millimetres meant? lengths are in metres",
            coordinate=coordinate,
        )
        yield Doubt(found.key, text)


def _mass_factor_doubts(config: StationConfig) -> Iterator[Doubt]:
    """Yield a doubt for each implausible factor by which a station changes the mass of a robot's link."""
    for name, robot in config.robots.items():
        for link, factor in robot.mass_factors.items():
            if not _LEAST_MASS_FACTOR <= factor <= _LARGEST_MASS_FACTOR:
                text = message(
                    "stations.mass_factor",
                    "the mass is {factor:g} times that of the robot's file; was a mass in kg meant?",
                    factor=factor,
                )
                yield Doubt(f"robots.{name}.mass_factors.{link}", text)


def _gravity_doubts(gravity: float) -> Iterator[Doubt]:
    """Yield the doubts about gravity [m/s²], which is positive if it pulls down: a wrong sign, or another unit."""
    if gravity < 0:
        yield Doubt(
            "gravity",
            message(
                "stations.gravity_pulls_up",
                "{gravity:g} m/s² points up; write {right:g} for gravity along -z",
                gravity=gravity,
                right=-gravity,
            ),
        )
    if abs(gravity) > _STRONGEST_GRAVITY:
        ratio = abs(gravity) / STANDARD_GRAVITY
        yield Doubt(
            "gravity",
            message(
                "stations.gravity_of_earth",
                "{gravity:g} m/s² is {ratio:.3g} times that of the Earth; were mm/s² meant?",
                gravity=gravity,
                ratio=ratio,
            ),
        )


def _friction_doubts(contact: ContactConfig) -> Iterator[Doubt]:
    """Yield a doubt if the coefficient of static friction is implausibly large."""
    friction = contact.friction
    if friction is not None and friction.static > _ROUGHEST:
        text = message(
            "stations.odd_friction",
            "a coefficient of friction of {static:g}: rubber has about 1",
            static=friction.static,
        )
        yield Doubt("contact.friction.static", text)
