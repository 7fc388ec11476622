"""What the kinds of coupling share: where they hold, and which stations can have them."""

from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import Context

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import WORLD, StationPlant, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.sections import Strict, Triple

_ANCHOR = "couplings_anchor"
_CLOSED = 1e-3
"""How far apart at the start what is held together may be [m or rad]."""


class CouplingSection(Strict):
    """A section of ``couplings``.

    A kind has its key ``kind``, a method ``add(plant)``, which adds it to a plant that is not finalized, and
    ``caption()``, which tells it in words.
    """

    constrains: ClassVar[bool] = True
    """Whether it is a constraint, which discrete solvers alone hold."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station is moved by forces, by a solver that holds it, and that there is what it holds.

        Raises:
            SimrobError: names the key, and what would be right.
        """
        if station.mode == "kinematic":
            raise InvalidParameter(key, "a coupling in a kinematic station", "left out: its reference moves all joints")
        if self.constrains and station.time_step == 0:
            expected = f"kind: discrete, with scheme: sap: only discrete solvers hold {key}"
            raise InvalidParameter("solver", station.scheme, expected)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far what it holds together is apart in a context [m or rad]; 0 of what may be anywhere."""
        return 0.0

    def check_start(self, key: str, plant: StationPlant, context: Context) -> None:
        """Check that the station starts in a posture that it allows.

        Raises:
            InvalidParameter: it does not.
        """
        if (gap := self.gap(plant, context)) > _CLOSED:
            raise InvalidParameter(key, f"{gap:.4g} m (or rad) off at the start", f"at most {_CLOSED:g} off")


class Attachment(NamedTuple):
    """A point of a body: the body, and the pose there of the frame whose origin it is."""

    body: RigidBody
    pose: RigidTransform


class BetweenPoints(CouplingSection):
    """A coupling of a point of one body with a point of another."""

    body: str
    """A tool or link of a robot, or a piece."""
    point: Triple = (0.0, 0.0, 0.0)
    """Where on it, along its axes [m]."""
    other: str = WORLD
    """The other body, likewise."""
    other_point: Triple = (0.0, 0.0, 0.0)
    """Where on that [m]; in the world's axes unless `other` is given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station has both bodies."""
        super().check(key, station)
        for part in ("body", "other"):
            check_frame(station, f"{key}.{part}", getattr(self, part))
        if self.body == self.other:
            raise InvalidParameter(f"{key}.other", self.other, "another one than body")

    def ends(self, plant: StationPlant) -> tuple[Attachment, Attachment]:
        """Return both points."""
        return end_of(plant, self.body, self.point), end_of(plant, self.other, self.other_point)

    def distance(self, plant: StationPlant, context: Context) -> float:
        """Return how far the points are apart in a context [m]."""
        one, other = (plant.plant.EvalBodyPoseInWorld(context, end.body) @ end.pose for end in self.ends(plant))
        return float(np.linalg.norm(one.translation() - other.translation()))


def anchored(plant: MultibodyPlant, end: Attachment) -> Attachment:
    """Return an end that constraints can hold: on a body that is welded to the world in place of the world itself.

    A constraint on the world's own body ends the process (Drake 1.51 to 1.58).
    """
    if end.body.index() != plant.world_body().index():
        return end
    if not plant.HasBodyNamed(_ANCHOR):
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)  # of no account: it stands
        body = plant.AddRigidBody(_ANCHOR, plant.AddModelInstance(_ANCHOR), inertia)
        plant.WeldFrames(plant.world_frame(), body.body_frame())
    return Attachment(plant.GetBodyByName(_ANCHOR), end.pose)


def end_of(plant: StationPlant, name: str, offset: Triple | RigidTransform) -> Attachment:
    """Return a point, or a pose, of what :func:`~simrob_drake.parts.targets.frame_of` finds."""
    frame = frame_of(plant, name)
    pose = offset if isinstance(offset, RigidTransform) else RigidTransform(np.array(offset))
    return Attachment(frame.body(), frame.GetFixedPoseInBodyFrame() @ pose)
