"""Plausibility checks for the numbers of a station: of its robots, its pieces, and its own keys.

The checks only warn. Impossible numbers raise an error when the station is read.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from simrob_drake.errors import InvalidModel, listed
from simrob_drake.parts.site import ResolvedPiece, Surroundings
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.pieces import solid_inertia
from simrob_drake.robots.plausibility import Doubt, MassProperties, doubts_by_shapes, robot_doubts
from simrob_drake.robots.urdf_check import checked_urdf
from simrob_drake.sections import MOST_TURN
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.grouping import group_by_words

_POSES = ("pose", "other_pose", "base", "tcp_offset", "hand_pose")  # keys of poses [x y z Rz Ry Rx]
_FARTHEST = 100.0  # largest plausible coordinate of a pose [m]
_LARGEST = 30.0  # largest plausible side of a piece [m]; a plate that serves as ground may be larger
_PLATE = 1.0  # thickness up to which a piece counts as a plate [m]
_SMALLEST = 1e-4  # smallest plausible value for the largest side of a piece [m]
_STRONGEST_GRAVITY = 100.0  # largest plausible gravity [m/s²]; Jupiter has 25
_ROUGHEST = 5.0  # largest plausible coefficient of friction; rubber on rubber has about 1
_SCALES = 0.1, 10.0  # smallest and largest plausible factor of a link's mass
_LISTED = 3  # number of keys that a warning names


def plausibility_findings(config: StationConfig, station: Surroundings) -> list[Finding]:
    """Find implausible numbers in a station: in its robots, its pieces, and its own keys.

    Args:
        config: configuration of the station.
        station: the station's robots and pieces.

    Returns:
        warnings; numbers with the same doubt share one warning.
    """
    doubts = list[Doubt]()
    for name, robot in station.robots.items():
        doubts += [Doubt(f"robot '{name}': {where}", text) for where, text in _doubts_of(robot.model)]
    for piece in station.pieces.values():
        doubts += _piece_doubts(piece)
    for key, pose in _poses(config, ""):
        doubts += _pose_doubts(key, pose)
    for name, entry in config.robots.items():
        for link, factor in entry.mass_factors.items():
            if not _SCALES[0] <= factor <= _SCALES[1]:
                text = f"the mass is {factor:g} times that of the robot's file; was a mass in kg meant?"
                doubts.append(Doubt(f"robots.{name}.mass_factors.{link}", text))
    doubts += _gravity_doubts(config.gravity)
    friction = None if config.contact is None else config.contact.friction
    if friction is not None and friction.static > _ROUGHEST:
        text = f"a coefficient of friction of {friction.static:g}: rubber has about 1"
        doubts.append(Doubt("contact.friction.static", text))
    return _findings(doubts)


def _findings(doubts: Sequence[Doubt]) -> list[Finding]:
    """Make warnings of doubts; doubts with the same words share one warning."""
    return [
        Finding("warning", places[0].partition(":")[0], f"{listed(places, _LISTED)}: {text}")
        for places, text in group_by_words(doubts)
    ]


def _doubts_of(model: RobotModel) -> tuple[Doubt, ...]:
    """Find the doubtful numbers of a robot. Results for a URDF file are cached until the file changes."""
    # A robot that is described by Denavit-Hartenberg parameters has no URDF file.
    if model.dh is not None:
        return tuple(robot_doubts(model.element, model.folder))
    state = model.urdf_path.stat()
    return _doubts_of_file(model.urdf_path, (state.st_mtime_ns, state.st_size))


@lru_cache(maxsize=64)
def _doubts_of_file(path: Path, changed: object) -> tuple[Doubt, ...]:
    """Find the doubtful numbers of a clean URDF file.

    Args:
        path: the file.
        changed: time of the file's last change and its size. The function does not read them: they are part of the
            cache's key, so that a changed file is read again.
    """
    return tuple(robot_doubts(checked_urdf(path), path.parent))


def _piece_doubts(piece: ResolvedPiece) -> Iterator[Doubt]:
    """Yield the doubtful numbers of a piece: its sizes, and its mass and inertia compared with its shapes."""
    key, model = f"pieces.{piece.name}", piece.model
    for shape in model.shapes:
        # A mesh has no sides.
        sides = shape.box or shape.cylinder or ((shape.sphere,) if shape.sphere else ())
        if sides and max(sides) > _LARGEST and min(sides) > _PLATE:
            yield Doubt(key, f"a side of {max(sides):g} m; were millimetres meant? lengths are in metres")
        elif sides and max(sides) < _SMALLEST:
            yield Doubt(key, f"no side is longer than {max(sides):g} m; lengths are in metres")
    solids = [shape.solid(model.folder) for shape in model.shapes]
    # A piece without shapes has nothing to compare with, and one without mass has no inertia.
    if not solids or model.mass == 0:
        return
    try:
        filled = solid_inertia(solids, closed=False)
    except InvalidModel:  # a mesh without a volume
        return
    own = MassProperties(model.mass, np.array(model.com), float(sum(model.inertia[:3])))
    shapes = MassProperties(filled.volume, filled.centre, float(sum(filled.moments[:3])))
    for text in doubts_by_shapes(own, shapes):
        yield Doubt(key, text)


def _poses(node: Any, key: str) -> Iterator[tuple[str, Sequence[float]]]:
    """Yield all poses below a node of a configuration, depth first.

    Args:
        node: a model, a mapping, a list or a value of the configuration.
        key: dotted key of the node; an empty text for the whole configuration.

    Yields:
        the dotted key of each pose, and the pose [x y z Rz Ry Rx] in m and rad.
    """
    entries: Iterator[tuple[str, Any]] = iter(())
    if isinstance(node, BaseModel):
        entries = iter(node)
    elif isinstance(node, Mapping):
        entries = ((str(name), value) for name, value in node.items())
    elif isinstance(node, list | tuple):
        entries = ((str(index), value) for index, value in enumerate(node))
    for name, value in entries:
        below = f"{key}.{name}" if key else name
        if name in _POSES and isinstance(value, tuple) and len(value) == 6:
            yield below, value
        # The poses of a program are checked when the program is planned.
        elif name != "program":
            yield from _poses(value, below)


def _pose_doubts(key: str, pose: Sequence[float]) -> Iterator[Doubt]:
    """Yield the doubts about a pose [x y z Rz Ry Rx] in m and rad: too large an angle, too far a position."""
    turn = max(pose[3:], key=abs)
    if abs(turn) > MOST_TURN:
        text = f"an angle of {turn:g} rad is {abs(turn) / (2 * np.pi):.1f} turns; were degrees meant? {turn:g}° are "
        yield Doubt(key, f"{text}{np.deg2rad(turn):.6g} rad")
    place = max(pose[:3], key=abs)
    if abs(place) > _FARTHEST:
        yield Doubt(key, f"{place:g} m from where it is measured; were millimetres meant? lengths are in metres")


def _gravity_doubts(gravity: float) -> Iterator[Doubt]:
    """Yield the doubts about gravity [m/s²], which is positive if it pulls down: a wrong sign, or another unit."""
    if gravity < 0:
        yield Doubt("gravity", f"{gravity:g} m/s² pulls up: {-gravity:g} pulls down, along -z")
    if abs(gravity) > _STRONGEST_GRAVITY:
        yield Doubt("gravity", f"{gravity:g} m/s² is {abs(gravity) / 9.81:.3g} times that of the Earth; in mm/s²?")
