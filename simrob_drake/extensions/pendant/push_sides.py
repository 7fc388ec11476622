"""Where the axes of the bodies of a station point, in words, so that users need not know the axes to push a body."""

import numpy as np
from pydrake.multibody.tree import Frame

from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.parts.forces import place_of
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.programs.arm import Workcell
from simrob_drake.results.record.walks import headings

SIDES: dict[str, Vector] = {
    f"{sign}{name}": float(f"{sign}1") * np.eye(3)[axis]
    for axis, name in enumerate("xyz")
    for sign in "-+"
}
"""The six directions of a push, each as a unit vector (3,) in the axes of the body."""

_ALONG = np.cos(np.deg2rad(30.0))
"""A side has a word if its angle to the direction of the word is at most 30 deg."""


def push_sides(cell: Workcell, bodies: list[str]) -> dict[str, dict[str, str]]:
    """Name the sides of bodies as the station stands now.

    Sides of a robot and its links are seen from the robot: ``ahead``, ``back``, ``left``, ``right``, ``up``, ``down``.
    Pieces have no front: only ``up`` and ``down``.

    Args:
        cell: the station.
        bodies: names of the bodies: robots, links, tools, pieces.

    Returns:
        by body, the words of its sides, by side, such as ``{"+x": "left"}``. Sides that are oblique are left out.
    """
    model = cell.model
    directions = {name: _directions_of(cell, robot) for name, robot in model.robots.items()}
    found = {}
    for body in bodies:
        frame, _ = place_of(model.station, body)
        robot = _robot_of(model.station, frame)
        words = _vertical_directions() if robot is None else directions[robot]
        rotation = model.pose(frame).rotation().matrix()
        found[body] = {
            side: word for side, axis in SIDES.items() if (word := _word_of(rotation @ axis, words))
        }
    return found


def _robot_of(station: StationPlant, frame: Frame) -> str | None:
    """Name of the robot of which a frame is a part. Returns None for a frame of a piece."""
    instance = frame.body().model_instance()
    return next(
        (robot.name for robot in station.robots.values() if robot.instance == instance), None
    )


def _vertical_directions() -> dict[str, Vector]:
    """Unit vectors (3,) in the world that need no front, by word."""
    up = np.array([0.0, 0.0, 1.0])
    return {"up": up, "down": -up}


def _directions_of(cell: Workcell, robot: StationRobot) -> dict[str, Vector]:
    """Unit vectors (3,) in the world that point ahead of a robot, to its sides, up and down, by word."""
    root_pose = xyz_quaternion_from_transform(cell.model.pose(robot.root))
    (heading,) = headings(cell.model.station, robot, np.array([root_pose]))
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    left = np.array([-np.sin(heading), np.cos(heading), 0.0])
    return {"ahead": ahead, "back": -ahead, "left": left, "right": -left, **_vertical_directions()}


def _word_of(direction: Vector, words: dict[str, Vector]) -> str:
    """Find the word for a unit vector (3,) in the world. Returns an empty text if it is oblique to all of them."""
    return next((word for word, known in words.items() if direction @ known >= _ALONG), "")
