"""Who is pushed or burdened: a robot on feet of its own, what it weighs, and where it looks."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.parts.forces import place_of
from simrob_drake.parts.monitors.places import Fall
from simrob_drake.parts.site import named
from simrob_drake.parts.targets import frame_names
from simrob_drake.results.record.walks import headings
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


@dataclass(frozen=True)
class Subject:
    """A robot on its feet.

    Attributes:
        name: in the station.
        root: the link that it is held by in other stations.
        mass: with what it carries [kg].
        heading: where it looks at the start, counterclockwise from the world's x [rad].
        ahead: its forward direction, level, along the axes of what is pushed, shape (3,).
        left: likewise to its left.
    """

    name: str
    root: str
    mass: float
    heading: float
    ahead: Vector
    left: Vector

    def along(self, turn: float) -> Vector:
        """Return the way at an angle from ahead to the left [rad], along the axes of what is pushed, shape (3,)."""
        return np.asarray(np.cos(turn) * self.ahead + np.sin(turn) * self.left)


def subject_of(config: StationConfig, at: str | None = None) -> Subject:
    """Return the robot that is pushed.

    Args:
        config: the station.
        at: where: a robot, or a frame of one as ``forces`` name them; the root of the only robot unless given.

    Raises:
        UnknownName: there is no such place.
        InvalidParameter: no robot that stands on feet of its own, or none whose fall a monitor ends.
    """
    resolved = resolve(config)
    frames = [frame for frame in frame_names(resolved) if config.only_robot or frame.partition(".")[0] in config.robots]
    place = named(at, [*config.robots, *(frames if at else [])], kind="robot, tool or link", key="--at")
    name = config.only_robot or place.partition(".")[0]
    robot = resolved.robots[name]
    if config.mode == "kinematic" or not robot.floats:
        expected = f"a dynamic station with a robot on feet of its own, and {name} is held"
        raise InvalidParameter("station", config.name, expected)
    if not any(isinstance(one, Fall) and one.faller(config.only_robot) == name for one in config.monitors.values()):
        expected = f"a station that tells when {name} has fallen: monitors: {{fall: {{height: METRES, tilt_deg: 60}}}}"
        raise InvalidParameter("station", config.name, expected)
    station = add_plant(DiagramBuilder(), resolved)
    plant, context, body = station.plant, station.plant.CreateDefaultContext(), station.robots[name]
    base = body.root.CalcPoseInWorld(context)
    heading = float(headings(station, body, xyz_quaternion_from_transform(base)[np.newaxis])[0])
    turned = RigidTransform(RotationMatrix.MakeZRotation(heading), np.zeros(3))
    seen = place_of(station, place)[0].CalcPoseInWorld(context).rotation().inverse() @ turned.rotation()
    ahead, left, _ = seen.matrix().T.copy()  # Drake 1.51 lets go of what it shows a column of
    return Subject(
        name=name,
        root=robot.model.root,
        mass=float(plant.CalcTotalMass(context, [body.instance])),
        heading=heading,
        ahead=ahead,
        left=left,
    )
