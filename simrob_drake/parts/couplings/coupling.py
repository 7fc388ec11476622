r"""What the kinds of coupling share: where they hold, and which stations can have them.

Drake's discrete solvers have constraints. Under an implicit continuous scheme a coupling is a spring and a damper, so
stiff that what it holds vibrates at :math:`\omega = 2000` rad/s: an acceleration a opens it by :math:`a / \omega^2`.
"""

from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    FixedOffsetFrame,
    LinearBushingRollPitchYaw,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import WORLD, Site, StationPlant, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.sections import Strict, Triple

_ANCHOR = "couplings_anchor"
_CLOSED = 1e-3
"""How far apart at the start what is held together may be [m or rad]."""
STIFFNESS, RELAXES = 2000.0**2, 2e-4
"""Stiffness of a coupling by what it holds [1/s²], and its damper by that [s]."""


class CouplingSection(Strict):
    """A section of ``couplings``.

    A kind has its key ``kind``, a method ``add(plant)``, which adds it to a plant that is not finalized, and
    ``caption()``, which tells it in words.
    """

    constrains: ClassVar[bool] = True
    """Whether it is a constraint, or so stiff a spring that it counts as one."""
    schemes: ClassVar[tuple[str, ...]] = ("radau3", "radau1", "implicit_euler", "velocity_implicit_euler")
    """Continuous schemes that hold it."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station is moved by forces, by a solver that holds it, and that there is what it holds.

        Raises:
            SimrobError: names the key, and what would be right.
        """
        if station.mode == "kinematic":
            raise InvalidParameter(key, "a coupling in a kinematic station", "left out: its reference moves all joints")
        if self.constrains and station.time_step == 0 and station.scheme not in self.schemes:
            expected = f"{'radau3, or ' if self.schemes else ''}kind: discrete with scheme: sap, which hold {key}"
            raise InvalidParameter("solver", station.scheme, expected)

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add what holds it beside the plant: nothing, unless it couples axes under a continuous scheme."""

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


def _stiffnesses(plant: MultibodyPlant) -> tuple[float, float]:
    """Return the stiffness of couplings in a plant, by all that it weighs, against slides [N/m] and turns [N·m/rad]."""
    bodies = [plant.get_body(BodyIndex(index)) for index in range(1, plant.num_bodies())]
    mass = sum(body.default_mass() for body in bodies)
    inertia = sum(body.default_spatial_inertia().CalcRotationalInertia().get_moments().sum() / 2 for body in bodies)
    return STIFFNESS * mass, STIFFNESS * float(inertia)


def add_bushing(plant: MultibodyPlant, one: Attachment, other: Attachment, *, turns_about_z: bool = False) -> None:
    """Hold two frames together by stiff springs; they may turn about their z.

    About y they must not, as Drake's bushing counts turns by roll, pitch and yaw.
    """
    frames = [
        plant.AddFrame(FixedOffsetFrame(f"coupled_{plant.num_frames()}", end.body.body_frame(), end.pose))
        for end in (one, other)
    ]
    slide, turn = _stiffnesses(plant)
    turns, slides = np.array([turn, turn, 0.0 if turns_about_z else turn]), np.full(3, slide)
    bushing = LinearBushingRollPitchYaw(*frames, turns, RELAXES * turns, slides, RELAXES * slides)
    plant.AddForceElement(bushing)


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
