"""Points and frames of bodies that stay together, or apart by a length."""

from typing import ClassVar, Literal

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from simrob_drake.frames import transform_from_pose
from simrob_drake.parts.couplings.coupling import (
    Attachment,
    BetweenPoints,
    CouplingSection,
    add_bushing,
    anchored,
    end_of,
)
from simrob_drake.parts.site import WORLD, StationPlant, Surroundings
from simrob_drake.parts.targets import check_frame
from simrob_drake.sections import ORIGIN, Pose, Positive

_HALF_APART = 0.025  # m: of the points on a hinge's axis


class Ball(BetweenPoints):
    """Two points that stay together, as in a ball and socket."""

    schemes: ClassVar[tuple[str, ...]] = ()
    kind: Literal["ball"]

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = (anchored(plant.plant, end) for end in self.ends(plant))
        points = one.pose.translation(), other.pose.translation()
        plant.plant.AddBallConstraint(one.body, points[0], other.body, points[1])

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the points are apart [m]."""
        return self.distance(plant, context)

    def caption(self) -> str:
        """Return it in words."""
        return f"a ball joint between {self.body} and {self.other}"


class Rod(BetweenPoints):
    """Two points that stay apart by a length, as the ends of a massless rod with ball joints."""

    schemes: ClassVar[tuple[str, ...]] = ()
    kind: Literal["rod"]
    length: Positive
    """[m]."""

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = (anchored(plant.plant, end) for end in self.ends(plant))
        points = one.pose.translation(), other.pose.translation()
        plant.plant.AddDistanceConstraint(one.body, points[0], other.body, points[1], self.length)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return by how much the length is missed [m]."""
        return abs(self.distance(plant, context) - self.length)

    def caption(self) -> str:
        """Return it in words."""
        return f"a rod of {self.length:g} m from {self.body} to {self.other}"


class BetweenFrames(CouplingSection):
    """A coupling of a frame of one body with a frame of another."""

    body: str
    """A tool or link of a robot, or a piece."""
    pose: Pose = ORIGIN
    """The frame on it, [x y z Rz Ry Rx]."""
    other: str = WORLD
    """The other body, likewise."""
    other_pose: Pose = ORIGIN
    """The frame on that."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station can have it."""
        super().check(key, station)
        for part in ("body", "other"):
            check_frame(station, f"{key}.{part}", getattr(self, part))

    def ends(self, plant: StationPlant) -> tuple[Attachment, Attachment]:
        """Return both frames."""
        ends = (self.body, self.pose), (self.other, self.other_pose)
        one, other = (end_of(plant, name, transform_from_pose(pose)) for name, pose in ends)
        return one, other

    def apart(self, plant: StationPlant, context: Context) -> RigidTransform:
        """Return the pose of the other frame in the first one."""
        one, other = (plant.plant.EvalBodyPoseInWorld(context, end.body) @ end.pose for end in self.ends(plant))
        return one.inverse() @ other


class Weld(BetweenFrames):
    """Two frames that stay together."""

    kind: Literal["weld"]

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        if not plant.plant.time_step():
            add_bushing(plant.plant, *self.ends(plant))
            return
        one, other = (anchored(plant.plant, end) for end in self.ends(plant))
        plant.plant.AddWeldConstraint(one.body, one.pose, other.body, other.pose)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the frames are apart, the larger of distance [m] and angle [rad]."""
        apart = self.apart(plant, context)
        return max(float(np.linalg.norm(apart.translation())), float(apart.rotation().ToAngleAxis().angle()))

    def caption(self) -> str:
        """Return it in words."""
        return f"{self.body} welded to {self.other}"


class Hinge(BetweenFrames):
    """Two frames that stay together but turn about their z."""

    kind: Literal["hinge"]

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized: of a discrete one, two points on its axis stay together."""
        if not plant.plant.time_step():
            add_bushing(plant.plant, *self.ends(plant), turns_about_z=True)
            return
        one, other = (anchored(plant.plant, end) for end in self.ends(plant))
        for point in ([0.0, 0.0, -_HALF_APART], [0.0, 0.0, _HALF_APART]):
            places = one.pose.multiply(np.array(point)), other.pose.multiply(np.array(point))
            plant.plant.AddBallConstraint(one.body, places[0], other.body, places[1])

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the frames are apart, the larger of distance [m] and angle of their axes [rad]."""
        apart = self.apart(plant, context)
        tilt = np.arccos(np.clip(apart.rotation().matrix()[2, 2], -1.0, 1.0))
        return max(float(np.linalg.norm(apart.translation())), float(tilt))

    def caption(self) -> str:
        """Return it in words."""
        return f"a hinge between {self.body} and {self.other}"
