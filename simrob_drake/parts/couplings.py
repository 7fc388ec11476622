r"""What ties joints and bodies of a station together beside its joints: the kinds that a station file can name.

Drake's discrete solvers have constraints. Under an implicit continuous scheme a coupling is a spring and a damper, so
stiff that what it holds vibrates at :math:`\omega = 2000` rad/s: an acceleration a opens it by :math:`a / \omega^2`.
"""

from abc import ABC, abstractmethod
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    FixedOffsetFrame,
    Joint,
    LinearBushingRollPitchYaw,
    LinearSpringDamper,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.blocks.block import fed, joined, mapped
from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector, transform_from_pose
from simrob_drake.parts.coupling import RELAXES, STIFFNESS, CouplingSection
from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.site import WORLD, Site, StationPlant, StationRobot, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.robots.coupled_axes import Equation
from simrob_drake.sections import ORIGIN, NotNegative, Number, Pose, Positive, Strict, Triple

_ANCHOR = "couplings_anchor"
_HALF_APART = 0.025  # m: of the points on a hinge's axis
_SHORTEST = 1e-9  # m: Drake wants a length, though it need not have one


class Attachment(NamedTuple):
    """A point of a body: the body, and the pose there of the frame whose origin it is."""

    body: RigidBody
    pose: RigidTransform


def add_bushing(plant: MultibodyPlant, one: Attachment, other: Attachment, *, turns_about_z: bool = False) -> None:
    """Hold two frames together by springs, stiff for all that the plant weighs; they may turn about their z.

    About y they must not, as Drake's bushing counts turns by roll, pitch and yaw.
    """
    bodies = [plant.get_body(BodyIndex(index)) for index in range(1, plant.num_bodies())]
    mass = sum(body.default_mass() for body in bodies)
    inertia = sum(body.default_spatial_inertia().CalcRotationalInertia().get_moments().sum() / 2 for body in bodies)
    slide, turn = STIFFNESS * mass, STIFFNESS * float(inertia)
    frames = [
        plant.AddFrame(FixedOffsetFrame(f"coupled_{plant.num_frames()}", end.body.body_frame(), end.pose))
        for end in (one, other)
    ]
    turns, slides = np.array([turn, turn, 0.0 if turns_about_z else turn]), np.full(3, slide)
    bushing = LinearBushingRollPitchYaw(*frames, turns, RELAXES * turns, slides, RELAXES * slides)
    plant.AddForceElement(bushing)


class Between(Strict, ABC):
    """What couplings of one body with another share."""

    body: str
    """A tool or link of a robot, or a piece."""
    other: str = WORLD
    """The other body, likewise."""

    @property
    @abstractmethod
    def places(self) -> tuple[RigidTransform, RigidTransform]:
        """Where it holds, on the one and on the other."""

    def check_bodies(self, key: str, station: Surroundings) -> None:
        """Check that the station has both bodies; raises SimrobError: it lacks one."""
        for part in ("body", "other"):
            check_frame(station, f"{key}.{part}", getattr(self, part))

    def ends(self, plant: StationPlant) -> list[Attachment]:
        """Return both ends."""
        frames = [frame_of(plant, name) for name in (self.body, self.other)]
        ends = zip(frames, self.places, strict=True)
        return [Attachment(frame.body(), frame.GetFixedPoseInBodyFrame() @ place) for frame, place in ends]

    def anchored(self, plant: StationPlant) -> list[Attachment]:
        """Return both ends, the world's on a welded body: constraints on the world end the process (Drake 1.51)."""
        own, ends = plant.plant, self.ends(plant)
        if any(end.body is own.world_body() for end in ends) and not own.HasBodyNamed(_ANCHOR):
            inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)  # of no account: it stands
            body = own.AddRigidBody(_ANCHOR, own.AddModelInstance(_ANCHOR), inertia)
            own.WeldFrames(own.world_frame(), body.body_frame())
        return [
            Attachment(own.GetBodyByName(_ANCHOR), end.pose) if end.body is own.world_body() else end for end in ends
        ]

    def apart(self, plant: StationPlant, context: Context) -> RigidTransform:
        """Return the pose of the other end in the first one."""
        one, other = (plant.plant.EvalBodyPoseInWorld(context, end.body) @ end.pose for end in self.ends(plant))
        return one.inverse() @ other

    def distance(self, plant: StationPlant, context: Context) -> float:
        """Return how far the ends are apart in a context [m]."""
        return float(np.linalg.norm(self.apart(plant, context).translation()))


class BetweenPoints(Between, CouplingSection):
    """A coupling of a point of one body with a point of another."""

    point: Triple = (0.0, 0.0, 0.0)
    """Where on the body, along its axes [m]."""
    other_point: Triple = (0.0, 0.0, 0.0)
    """Where on the other [m]; in the world's axes unless `other` is given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station has both bodies, and that they are not the same.

        Raises:
            SimrobError: the station lacks a body, or both names are the same.
        """
        super().check(key, station)
        self.check_bodies(key, station)
        if self.body == self.other:
            raise InvalidParameter(f"{key}.other", self.other, "another one than body")

    @property
    def places(self) -> tuple[RigidTransform, RigidTransform]:
        """The points, with the axes of their bodies."""
        return RigidTransform(np.array(self.point)), RigidTransform(np.array(self.other_point))


class Ball(BetweenPoints):
    """Two points that stay together, as in a ball and socket."""

    schemes: ClassVar[tuple[str, ...]] = ()
    kind: Literal["ball"]
    words: ClassVar[str] = "a ball joint between {it.body} and {it.other}"

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = self.anchored(plant)
        plant.plant.AddBallConstraint(one.body, one.pose.translation(), other.body, other.pose.translation())

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the points are apart [m]."""
        return self.distance(plant, context)


class Rod(BetweenPoints):
    """Two points that stay apart by a length, as the ends of a massless rod with ball joints."""

    schemes: ClassVar[tuple[str, ...]] = ()
    kind: Literal["rod"]
    words: ClassVar[str] = "a rod of {it.length:g} m from {it.body} to {it.other}"
    length: Positive
    """[m]."""

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = self.anchored(plant)
        points = one.pose.translation(), other.pose.translation()
        plant.plant.AddDistanceConstraint(one.body, points[0], other.body, points[1], self.length)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return by how much the length is missed [m]."""
        return abs(self.distance(plant, context) - self.length)


class BetweenFrames(Between, CouplingSection):
    """A coupling of a frame of one body with a frame of another."""

    pose: Pose = ORIGIN
    """The frame on the body, [x y z Rz Ry Rx]."""
    other_pose: Pose = ORIGIN
    """The frame on the other."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station has both bodies; raises SimrobError: it lacks one."""
        super().check(key, station)
        self.check_bodies(key, station)

    @property
    def places(self) -> tuple[RigidTransform, RigidTransform]:
        """Both frames."""
        return transform_from_pose(self.pose), transform_from_pose(self.other_pose)


class Weld(BetweenFrames):
    """Two frames that stay together."""

    kind: Literal["weld"]
    words: ClassVar[str] = "{it.body} welded to {it.other}"

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        if not plant.plant.time_step():
            add_bushing(plant.plant, *self.ends(plant))
            return
        one, other = self.anchored(plant)
        plant.plant.AddWeldConstraint(one.body, one.pose, other.body, other.pose)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the frames are apart, the larger of distance [m] and angle [rad]."""
        turn = self.apart(plant, context).rotation()
        return max(self.distance(plant, context), float(turn.ToAngleAxis().angle()))


class Hinge(BetweenFrames):
    """Two frames that stay together but turn about their z."""

    kind: Literal["hinge"]
    words: ClassVar[str] = "a hinge between {it.body} and {it.other}"

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized: of a discrete one, two points on its axis stay together."""
        if not plant.plant.time_step():
            add_bushing(plant.plant, *self.ends(plant), turns_about_z=True)
            return
        one, other = self.anchored(plant)
        for point in np.array([[0.0, 0.0, -_HALF_APART], [0.0, 0.0, _HALF_APART]]):
            places = one.pose.multiply(point), other.pose.multiply(point)
            plant.plant.AddBallConstraint(one.body, places[0], other.body, places[1])

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Return how far the frames are apart, the larger of distance [m] and angle of their axes [rad]."""
        tilt = np.arccos(np.clip(self.apart(plant, context).rotation().matrix()[2, 2], -1.0, 1.0))
        return max(self.distance(plant, context), float(tilt))


class Gear(CouplingSection):
    r"""Axes of which a sum of positions stays as it is: gears, racks, screws, belts.

    .. math:: \sum_i r_i q_i = c

    of axes with position :math:`q_i` and ratios :math:`r_i`. Two gears of radii 1 and 2 that mesh have the ratios 1 and
    2; a planetary gear couples three axes; a rack slides by its pinion's radius a radian.
    """

    schemes: ClassVar[tuple[str, ...]] = (*CouplingSection.schemes, "cenic")
    engines: ClassVar[tuple[str, ...]] = ("mujoco",)
    guides_references: ClassVar[bool] = True
    kind: Literal["gear"]
    ratios: Annotated[dict[str, Number], Field(min_length=2)]
    """How much each axis counts, by name (<robot>.<axis> where there are several robots): {sun: 1, planet: 2}. The
    first axis follows the others where a reference gives one value for all axes."""
    total: Number | None = None
    """What the sum of positions [rad or m] times ratios stays; that of the initial posture unless given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station has the gear's axes, and a solver that holds a gear of so many axes.

        Args:
            key: key of the gear in the station, such as ``couplings.mesh``.
            station: the station with the gear.

        Raises:
            SimrobError: an axis is unknown, or the solver cannot hold the gear; the message names the key.
        """
        super().check(key, station)
        known = [f"{robot.prefix}{axis}" for robot in station.robots.values() for axis in robot.axes]
        for name in self.ratios:
            one_of(f"axis for {key}.ratios", name, known)
        # Every solver that holds gears holds gears of two axes. In a kinematic station the references obey any gear.
        if len(self.ratios) == 2 or station.mode == "kinematic":
            return
        if station.scheme == "cenic":
            expected = f"radau3, or kind: discrete: cenic holds gears of two axes, and {key} has {len(self.ratios)}"
            raise InvalidParameter("solver.scheme", station.scheme, expected)
        if station.time_step and not hasattr(MultibodyPlant, "AddTendonConstraint"):
            older = "of two: older Drake couples no more"
            raise InvalidParameter(f"{key}.ratios", f"of {len(self.ratios)} axes", older)

    def equation(self, key: str) -> Equation:
        """Make the gear's equation between positions of axes. ``key``, its key in the station, is the label."""
        return Equation(key, self.ratios, self.total)

    def _counts(self, robot: StationRobot) -> Vector:
        """Read the gear's ratios of a robot's n axes, shape (n,); axes that are not coupled have the ratio 0."""
        return np.array([self.ratios.get(f"{robot.prefix}{axis}", 0.0) for axis in robot.axes])

    def kept(self, plant: StationPlant) -> float:
        """Compute the constant sum of positions times ratios: ``total``, or else the initial posture's [rad or m]."""
        initial = sum(float(self._counts(robot) @ robot.initial) for robot in plant.robots.values())
        return initial if self.total is None else self.total

    def levers(self, plant: StationPlant) -> list[tuple[Joint, float]]:
        """Find the coupled joints of a plant.

        Returns:
            pairs of a joint and its ratio. The ratio counts in the joint's own sense, which may be opposite to the
            sense of the robot's axis.
        """
        levers = []
        for robot in plant.robots.values():
            counts = self._counts(robot)
            for joint, axis, ratio in zip(robot.joints, robot.model.axes.values(), counts, strict=True):
                if ratio:
                    levers.append((joint, float(ratio) * axis.sign))
        return levers

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Compute by how much the sum of positions times ratios differs from its constant value [rad or m]."""
        positions = plant.plant.GetPositions(context)
        sums = (self._counts(robot) @ robot.axis_map.positions(positions) for robot in plant.robots.values())
        return abs(float(sum(sums)) - self.kept(plant))

    def add(self, plant: StationPlant) -> None:
        """Add the gear as a constraint to a plant that is not finalized, if the plant's solver holds constraints."""
        if not plant.holds_constraints:
            return
        levers = self.levers(plant)
        kept = self.kept(plant)
        # Older Drake versions and cenic have constraints for two joints only.
        if len(levers) == 2:
            (driven, ratio), (driver, other_ratio) = levers
            plant.plant.AddCouplerConstraint(driven, driver, -other_ratio / ratio, kept / ratio)
        else:
            joints = [joint.index() for joint, _ in levers]
            ratios = [ratio for _, ratio in levers]
            plant.plant.AddTendonConstraint(joints, ratios, -kept, 0.0, 0.0)

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add a stiff spring and damper that couple the axes, if Drake's plant has no constraint for the gear."""
        plant, robots = site.plant.plant, site.plant.robots.values()
        if site.plant.holds_constraints or site.plant.engine is not None:
            return
        # Rows that give the sum of positions times ratios, and its rate, from the plant's state. The row "spread" is
        # the direction of the spring's force among the generalized forces.
        each = [(robot.axis_map, self._counts(robot)) for robot in robots]
        place = sum(counts @ axes.state_matrix[: len(counts)] for axes, counts in each)
        speed = sum(counts @ axes.state_matrix[len(counts) :] for axes, counts in each)
        spread = sum(counts @ axes.velocity_matrix for axes, counts in each)
        # The stiffness is for the inertia that the spring feels at the start: 1 / (spread M^-1 spread).
        mobility = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
        stiffness = STIFFNESS / (spread @ mobility @ spread)
        law = stiffness * np.append(-place - RELAXES * speed, self.kept(site.plant))
        one = fed(builder, f"{key}.one", ConstantVectorSource([1.0]))
        bus = joined(builder, f"{key}.bus", site.state, one)
        site.generalized_forces.append(mapped(builder, f"{key}.force", np.outer(spread, law), bus))
        site.draw_nothing(f"{key}.one", f"{key}.bus")
        site.draw(f"{key}.force", "force", f"What couples\n{', '.join(self.ratios)}")

    def caption(self) -> str:
        """Describe the gear in words."""
        return "a gear: " + " + ".join(f"{ratio:g} {axis}" for axis, ratio in self.ratios.items()) + " stays as it is"


class Spring(BetweenPoints):
    r"""A spring with a damper between two points, under any solver.

    .. math:: f = k (l - l_0) + d\,\dot l

    pulls them together, of their distance :math:`l`.
    """

    constrains: ClassVar[bool] = False
    kind: Literal["spring"]
    words: ClassVar[str] = "a spring of {it.stiffness:g} N/m from {it.body} to {it.other}"
    length: NotNegative = 0.0
    """At which it is slack [m]."""
    stiffness: NotNegative
    """[N/m]."""
    damping: NotNegative = 0.0
    """[N·s/m]."""

    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""
        one, other = self.ends(plant)
        points = one.pose.translation(), other.pose.translation()
        length = max(self.length, _SHORTEST)
        spring = LinearSpringDamper(one.body, points[0], other.body, points[1], length, self.stiffness, self.damping)
        plant.plant.AddForceElement(spring)


KINDS = Kinds(
    __name__,
    {"gear": "Gear", "ball": "Ball", "rod": "Rod", "weld": "Weld", "hinge": "Hinge", "spring": "Spring"},
    base=CouplingSection,
    point="couplings",
)
CouplingConfig = Annotated[CouplingSection, KINDS]
Couplings = Annotated[dict[str, CouplingConfig], KINDS.names_are_kinds]
