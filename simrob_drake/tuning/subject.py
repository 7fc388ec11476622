"""Who is pushed or burdened: a robot on feet of its own, what it weighs, and where it looks."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.parts.forces.force import place_of
from simrob_drake.parts.monitors import Fall
from simrob_drake.results.record.walks import headings
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


@dataclass(frozen=True)
class Subject:
    """A robot on its feet.

    Attributes:
        name: in the station.
        key: of its section.
        root: the link that it is held by in other stations.
        mass: with what it carries [kg].
        heading: where it looks at the start, counterclockwise from the world's x [rad].
        ahead: its way ahead, level, along the axes of what is pushed, shape (3,).
        left: likewise to its left.
    """

    name: str
    key: str
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
        InvalidParameter: no robot that stands on feet of its own, or none whose fall a monitor ends.
    """
    name = config.only_robot or one_of("robot for --at", (at or "").partition(".")[0], config.robots)
    resolved = resolve(config)
    robot = resolved.robots[name]
    if config.mode == "kinematic" or not robot.floats:
        told = f"a dynamic station with a robot on feet of its own, and {name} is held"
        raise InvalidParameter("station", config.name, told)
    if not any(isinstance(one, Fall) and one.faller(config.only_robot) == name for one in config.monitors.values()):
        told = f"a station that tells when {name} has fallen: monitors: {{fall: {{height: METRES, tilt_deg: 60}}}}"
        raise InvalidParameter("station", config.name, told)
    station = add_plant(DiagramBuilder(), resolved)
    plant, context, body = station.plant, station.plant.CreateDefaultContext(), station.robots[name]
    place, _ = place_of(station, at or name)
    base = body.root.CalcPoseInWorld(context)
    heading = float(headings(station, body, xyz_quaternion_from_transform(base)[np.newaxis])[0])
    turned = RigidTransform(RotationMatrix.MakeZRotation(heading), np.zeros(3))
    seen = place.CalcPoseInWorld(context).rotation().inverse() @ turned.rotation()
    return Subject(
        name=name,
        key=ONLY_ROBOT if name == config.only_robot == ONLY_ROBOT else f"robots.{name}",
        root=robot.model.root,
        mass=float(plant.CalcTotalMass(context, [body.instance])),
        heading=heading,
        ahead=seen.col(0),
        left=seen.col(1),
    )
