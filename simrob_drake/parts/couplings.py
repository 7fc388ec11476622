r"""The kinds of couplings that a station file can name: gears, ball joints, rods, welds, hinges and springs.

A coupling holds two bodies or several axes together in addition to the joints of the robots. Bodies are links or
tools of robots, pieces, or the world; axes are the joints of robots, with or without a motor.

A soft spring is a force. Drake's discrete solvers hold the other couplings as constraints. An implicit continuous
scheme holds gears, welds and hinges, but no ball joints and rods, by a spring and a damper. They are so stiff that what
they hold vibrates at :math:`\omega = 2000` rad/s: an acceleration :math:`a` opens the coupling by
:math:`a / \omega^2`.

Methods get the station at different times of its construction: `StationContents` describes the station before anything
is built, `StationPlant` is its multibody plant with the robots in it, and `Site` adds the ports of the blocks around
the plant.
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

from simrob_drake.base.drake_versions import TENDONS
from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.sections import ORIGIN, NotNegative, Number, Pose, Positive, Strict, Triple
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer
from simrob_drake.parts.coupling import DAMPING_TIME, STIFFNESS_PER_INERTIA, CouplingSection
from simrob_drake.parts.engine import Engine
from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.resolved import WORLD, StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.robots.coupled_axes import Equation

# Name of a body welded to the world, which takes the world's place in constraints.
_ANCHOR = "couplings_anchor"
# Half the distance between the two points that stay together on a hinge's axis [m]. The smaller it is, the more the
# errors of the two constraints tilt the hinge.
_HALF_HINGE = 0.025
# Drake requires a positive free length of a spring [m].
_SHORTEST_SPRING = 1e-9


class Attachment(NamedTuple):
    """The frame on a body that a coupling holds.

    Attributes:
        body: the body.
        pose: pose of the frame in the body's frame.
    """

    body: RigidBody
    pose: RigidTransform


def add_bushing(
    plant: MultibodyPlant, first: Attachment, second: Attachment, *, turns_about_z: bool = False
) -> None:
    """Hold two frames together by stiff springs and dampers, added to a plant that is not finalized.

    The springs are stiff enough for the mass and inertia of all bodies of the plant together.

    Args:
        plant: the plant.
        first: one frame, with its body.
        second: the other frame, with its body.
        turns_about_z: leave out the spring and the damper against rotation about z, for a hinge. The free axis must
            not be y: Drake's bushing measures rotations by roll, pitch and yaw, and a pitch of 90 degrees is a
            singularity.
    """
    # Index 0 is the world, which has no mass.
    bodies = [plant.get_body(BodyIndex(index)) for index in range(1, plant.num_bodies())]
    mass = 0.0
    inertia = 0.0
    for body in bodies:
        mass += body.default_mass()
        # Half the trace of the inertia is at least the moment of inertia about any axis through the body's origin.
        inertia += body.default_spatial_inertia().CalcRotationalInertia().get_moments().sum() / 2
    # k = omega² m: a mass m on a spring k vibrates at omega = sqrt(k / m), with omega² = STIFFNESS_PER_INERTIA.
    linear = STIFFNESS_PER_INERTIA * mass
    angular = STIFFNESS_PER_INERTIA * float(inertia)
    stiffness_about_z = 0.0 if turns_about_z else angular
    # Stiffnesses along x, y, z [N/m] and against roll, pitch, yaw [N·m/rad]. Yaw is the rotation about z.
    linear_stiffness = np.full(3, linear)
    angular_stiffness = np.array([angular, angular, stiffness_about_z])

    frames = []
    for end in (first, second):
        frame = FixedOffsetFrame(f"coupled_{plant.num_frames()}", end.body.body_frame(), end.pose)
        frames.append(plant.AddFrame(frame))
    bushing = LinearBushingRollPitchYaw(
        *frames,
        angular_stiffness,
        DAMPING_TIME * angular_stiffness,
        linear_stiffness,
        DAMPING_TIME * linear_stiffness,
    )
    plant.AddForceElement(bushing)


class Between(Strict, ABC):
    """A section that connects a frame of one body with a frame of another body: the base class of such couplings."""

    body: str
    """A tool or link of a robot, or a piece."""
    other: str = WORLD
    """The other body: a tool or link of a robot, a piece, or the world."""

    @property
    @abstractmethod
    def own_poses(self) -> tuple[RigidTransform, RigidTransform]:
        """Poses of the connected frames: in the frame of `body`, and in the frame of `other`."""

    def check_bodies(self, key: str, station: StationContents) -> None:
        """Check that the station has both bodies.

        Args:
            key: key of the coupling in the station, such as ``couplings.mesh``.
            station: the station with the coupling.

        Raises:
            SimrobError: the station lacks a body; the message names the key.
        """
        for part in ("body", "other"):
            check_frame(station, f"{key}.{part}", getattr(self, part))

    def ends(self, plant: StationPlant) -> list[Attachment]:
        """Find the two connected frames in a plant: first the one on `body`, then the one on `other`."""
        ends = []
        for name, own_pose in zip((self.body, self.other), self.own_poses, strict=True):
            # The name may be that of a frame fixed to a body, such as a tool. The pose of the section is given in the
            # named frame, so its pose in the body is the product of both poses.
            frame = frame_of(plant, name)
            ends.append(Attachment(frame.body(), frame.GetFixedPoseInBodyFrame() @ own_pose))
        return ends

    def constraint_ends(self, plant: StationPlant) -> list[Attachment]:
        """Find the two connected frames for a constraint, and add a body in the world's place if one is there.

        Drake 1.51 ends the process at a constraint on the world. So a frame of the world is moved to a body that is
        welded to the world, which all couplings share. The plant must not be finalized.

        Returns:
            The frame on `body`, then the frame on `other`.
        """
        multibody = plant.plant
        world = multibody.world_body()
        ends = self.ends(plant)
        is_on_world = any(end.body is world for end in ends)
        if is_on_world and not multibody.HasBodyNamed(_ANCHOR):
            # The plant needs an inertia for each body. This one has no effect: the body never moves.
            inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)
            anchor = multibody.AddRigidBody(_ANCHOR, multibody.AddModelInstance(_ANCHOR), inertia)
            multibody.WeldFrames(multibody.world_frame(), anchor.body_frame())
        # The anchor's frame is the world's frame, so poses stay the same.
        return [
            Attachment(multibody.GetBodyByName(_ANCHOR), end.pose) if end.body is world else end
            for end in ends
        ]

    def relative_pose(self, plant: StationPlant, context: Context) -> RigidTransform:
        """Pose of the frame on `other`, in the frame on `body`, in a context of the plant."""
        # Poses of both frames in the world.
        first, second = (
            plant.plant.EvalBodyPoseInWorld(context, end.body) @ end.pose
            for end in self.ends(plant)
        )
        return first.inverse() @ second

    def distance(self, plant: StationPlant, context: Context) -> float:
        """Distance between the origins of the two frames, in a context of the plant [m]."""
        return float(np.linalg.norm(self.relative_pose(plant, context).translation()))


class BetweenPoints(Between, CouplingSection):
    """A coupling of a point of one body with a point of another."""

    point: Triple = (0.0, 0.0, 0.0)
    """Position of the point on the body, along the body's axes [m]."""
    other_point: Triple = (0.0, 0.0, 0.0)
    """Position of the point on the other body [m]; in the world's axes unless `other` is given."""

    def check(self, key: str, station: StationContents) -> None:
        """Check the station's mode and solver, that it has both bodies, and that their names are not the same.

        Args:
            key: key of the coupling in the station, for errors.
            station: the station with the coupling.

        Raises:
            SimrobError: the coupling does not fit the station, which may lack a body, or both names are the same.
        """
        super().check(key, station)
        self.check_bodies(key, station)
        # The distance of two points of one body cannot change.
        if self.body == self.other:
            raise InvalidParameter(
                f"{key}.other",
                self.other,
                message("parts.other_than_body", "different from {key}.body", key=key),
            )

    @property
    def own_poses(self) -> tuple[RigidTransform, RigidTransform]:
        """Frames at the points, with the axes of their bodies."""
        return RigidTransform(np.array(self.point)), RigidTransform(np.array(self.other_point))


class Ball(BetweenPoints):
    """Two points that stay together, as in a ball and socket."""

    has_springs: ClassVar[bool] = False
    kind: Literal["ball"]

    def caption(self) -> str:
        """Describe the coupling in words."""
        return message(
            "parts.coupling_ball",
            "a ball joint between {body} and {other}",
            body=self.body,
            other=self.other,
        )

    def add(self, plant: StationPlant) -> None:
        """Add the ball joint as a constraint to a plant that is not finalized."""
        first, second = self.constraint_ends(plant)
        plant.plant.AddBallConstraint(
            first.body, first.pose.translation(), second.body, second.pose.translation()
        )

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Distance between the points, which is 0 in a closed ball joint [m]."""
        return self.distance(plant, context)


class Rod(BetweenPoints):
    """Two points that keep a distance, as the ends of a massless rod with ball joints."""

    has_springs: ClassVar[bool] = False
    kind: Literal["rod"]
    length: Positive
    """Length of the rod [m]."""

    def caption(self) -> str:
        """Describe the coupling in words."""
        return message(
            "parts.coupling_rod",
            "a rod of {length:g} m from {body} to {other}",
            length=self.length,
            body=self.body,
            other=self.other,
        )

    def add(self, plant: StationPlant) -> None:
        """Add the rod as a constraint to a plant that is not finalized."""
        first, second = self.constraint_ends(plant)
        plant.plant.AddDistanceConstraint(
            first.body,
            first.pose.translation(),
            second.body,
            second.pose.translation(),
            self.length,
        )

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Absolute difference between the points' distance and the rod's length [m]."""
        return abs(self.distance(plant, context) - self.length)


class BetweenFrames(Between, CouplingSection):
    """A coupling of a frame of one body with a frame of another."""

    pose: Pose = ORIGIN
    """Pose of the frame on the body, [x y z Rz Ry Rx]."""
    other_pose: Pose = ORIGIN
    """Pose of the frame on the other body."""

    def check(self, key: str, station: StationContents) -> None:
        """Check the station's mode and solver, and that it has both bodies.

        Args:
            key: key of the coupling in the station, for errors.
            station: the station with the coupling.

        Raises:
            SimrobError: the coupling does not fit the station, which may lack a body.
        """
        super().check(key, station)
        self.check_bodies(key, station)

    @property
    def own_poses(self) -> tuple[RigidTransform, RigidTransform]:
        """The frames of `pose` and `other_pose`."""
        return transform_from_pose(self.pose), transform_from_pose(self.other_pose)


class Weld(BetweenFrames):
    """Two frames that stay together."""

    kind: Literal["weld"]

    def caption(self) -> str:
        """Describe the coupling in words."""
        return message(
            "parts.coupling_weld", "{body} welded to {other}", body=self.body, other=self.other
        )

    def add(self, plant: StationPlant) -> None:
        """Add the weld to a plant that is not finalized: a constraint in a discrete plant, else stiff springs."""
        # Drake has a weld constraint for discrete plants only.
        is_discrete = plant.plant.time_step() > 0
        if not is_discrete:
            add_bushing(plant.plant, *self.ends(plant))
            return
        first, second = self.constraint_ends(plant)
        plant.plant.AddWeldConstraint(first.body, first.pose, second.body, second.pose)

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Difference of the two frames: the larger number of their distance [m] and the angle between them [rad]."""
        # The relative pose of a closed weld is the identity.
        turn = self.relative_pose(plant, context).rotation()
        return max(self.distance(plant, context), float(turn.ToAngleAxis().angle()))


class Hinge(BetweenFrames):
    """Two frames that stay together but turn about their z axis."""

    kind: Literal["hinge"]

    def caption(self) -> str:
        """Describe the coupling in words."""
        return message(
            "parts.coupling_hinge",
            "a hinge between {body} and {other}",
            body=self.body,
            other=self.other,
        )

    def add(self, plant: StationPlant) -> None:
        """Add the hinge to a plant that is not finalized.

        In a discrete plant, two constraints each hold a point of the hinge's axis together. A continuous plant gets
        stiff springs.
        """
        is_discrete = plant.plant.time_step() > 0
        if not is_discrete:
            add_bushing(plant.plant, *self.ends(plant), turns_about_z=True)
            return
        first, second = self.constraint_ends(plant)
        # Two points that stay together leave only the rotation about the line through them.
        for point in np.array([[0.0, 0.0, -_HALF_HINGE], [0.0, 0.0, _HALF_HINGE]]):
            plant.plant.AddBallConstraint(
                first.body, first.pose.multiply(point), second.body, second.pose.multiply(point)
            )

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Difference of the two frames: their distance [m] or the angle of their z axes [rad], the larger number."""
        # The frames may turn about z against each other, so only the angle between their z axes counts.
        rotation = self.relative_pose(plant, context).rotation().matrix()
        # The entry zz of the rotation is the cosine of that angle, up to rounding.
        tilt = np.arccos(np.clip(rotation[2, 2], -1.0, 1.0))
        return max(self.distance(plant, context), float(tilt))


class CoupledJoint(NamedTuple):
    """A joint of a plant that a gear couples.

    Attributes:
        joint: the joint.
        ratio: factor of the joint's position in the gear's equation: the ratio of the robot's axis, with the opposite
            sign if the positive sense of the axis is opposite to that of the joint.
    """

    joint: Joint
    ratio: float


class Gear(CouplingSection):
    r"""Axes whose weighted sum of positions is constant: gears, racks, screws, belts.

    .. math:: \sum_i r_i q_i = c

    of axes with position :math:`q_i` and ratios :math:`r_i`. Two gears of radii 1 and 2 that mesh have the ratios 1 and
    2; a planetary gear couples three axes; a rack slides by its pinion's radius a radian.
    """

    guides_references: ClassVar[bool] = True
    kind: Literal["gear"]
    ratios: Annotated[dict[str, Number], Field(min_length=2)]
    """Ratio of each axis by its name (<robot>.<axis> where there are several robots): {sun: 1, planet: 2}. The
    first axis follows the others where a reference gives one value for all axes."""
    total: Number | None = None
    """Constant sum of positions [rad or m] times ratios; that of the initial posture unless given."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that the station has the gear's axes, and a solver that holds a gear of so many axes.

        Args:
            key: key of the gear in the station, such as ``couplings.mesh``.
            station: the station with the gear.

        Raises:
            SimrobError: an axis is unknown, or the solver or the installed Drake cannot hold the gear; the message
                names the key.
        """
        super().check(key, station)
        # The prefix is "<robot>." in a station of several robots, and empty in one of a single robot.
        known = [
            f"{robot.prefix}{axis}" for robot in station.robots.values() for axis in robot.axes
        ]
        for name in self.ratios:
            one_of(message("parts.axis_for_ratios", "axis for {key}.ratios", key=key), name, known)
        # Every solver that holds gears holds gears of two axes. In a kinematic station the references obey any gear.
        if len(self.ratios) == 2 or not station.engine.moves_by_forces:
            return
        engine = station.engine
        if not engine.constrains_many_axes:
            others = message(
                "parts.gears_of_two_axes",
                "{engine} supports gears of two axes only, and {key} couples {count}",
                engine=engine.name,
                key=key,
                count=len(self.ratios),
            )
            raise InvalidParameter(
                "solver.scheme",
                engine.name,
                message(
                    "parts.radau_or_discrete", "radau3, or kind: discrete; {others}", others=others
                ),
            )
        # `add` couples more than two joints by a tendon, which older Drake versions do not have.
        if engine.has_discrete_states and not TENDONS.is_there:
            raise Unsuitable(
                f"{key}.ratios",
                message(
                    "parts.older_drake",
                    "this version of Drake couples two axes only, not {count}",
                    count=len(self.ratios),
                ),
                message("parts.newer_drake", "install a newer Drake, or couple two axes"),
            )

    def is_constrained(self, engine: Engine) -> bool:
        """Whether the engine of a station has a constraint for gears."""
        return engine.constrains_gears

    def equation(self, key: str) -> Equation:
        """Make the gear's equation between positions of axes, which references obey. Its label is the gear's key."""
        return Equation(key, self.ratios, self.total)

    def _axis_ratios(self, robot: StationRobot) -> Vector:
        """Ratios of all n axes of a robot in this gear, shape (n,); axes that are not coupled have the ratio 0."""
        # Ratios are named as in the station: with the robot's prefix if there are several robots.
        return np.array([self.ratios.get(f"{robot.prefix}{axis}", 0.0) for axis in robot.axes])

    def constant_sum(self, plant: StationPlant) -> float:
        """Constant c of the gear's equation [rad or m]: ``total``, or else the sum in the robots' initial postures."""
        if self.total is not None:
            return self.total
        initial_sum = 0.0
        for robot in plant.robots.values():
            initial_sum += float(self._axis_ratios(robot) @ robot.initial)
        return initial_sum

    def coupled_joints(self, plant: StationPlant) -> list[CoupledJoint]:
        """Find the joints of a plant that the gear couples, in the order of the plant's robots and their axes.

        An axis with the ratio 0 has no part in the gear, and its joint is left out.
        """
        coupled = []
        for robot in plant.robots.values():
            ratios = self._axis_ratios(robot)
            # The positive sense of an axis may be opposite to that of its joint: q_axis = sign q_joint.
            for joint, axis, ratio in zip(
                robot.joints, robot.model.axes.values(), ratios, strict=True
            ):
                if ratio:
                    coupled.append(CoupledJoint(joint, float(ratio) * axis.sign))
        return coupled

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Absolute difference between the sum of positions times ratios and its constant value [rad or m]."""
        positions = plant.plant.GetPositions(context)
        present_sum = 0.0
        for robot in plant.robots.values():
            present_sum += float(self._axis_ratios(robot) @ robot.axis_map.positions(positions))
        return abs(present_sum - self.constant_sum(plant))

    def add(self, plant: StationPlant) -> None:
        """Add the gear as a constraint to a plant that is not finalized, if the plant's solver holds constraints.

        Otherwise nothing is added here: `add_forces` adds a spring later, or another engine has a constraint of its
        own.
        """
        if not plant.holds_constraints:
            return
        # sum(r_i q_i) = total, in the positions of the plant's joints.
        coupled = self.coupled_joints(plant)
        total = self.constant_sum(plant)
        # Older Drake versions and cenic have constraints for two joints only.
        if len(coupled) == 2:
            # ratio_0 q_0 + ratio_1 q_1 = total, solved for q_0.
            first, second = coupled
            gear_ratio = -second.ratio / first.ratio
            offset = total / first.ratio
            plant.plant.AddCouplerConstraint(first.joint, second.joint, gear_ratio, offset)
        else:
            # A tendon has the length sum(ratios * q) + offset, here with the offset -total. Its lower and its upper
            # limit, the last two arguments, are 0, so that the sum stays at the total.
            joints = [entry.joint.index() for entry in coupled]
            ratios = [entry.ratio for entry in coupled]
            plant.plant.AddTendonConstraint(joints, ratios, -total, 0.0, 0.0)

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        r"""Add a stiff spring and damper that couple the axes, if neither the plant nor its engine has a constraint.

        The spring acts on the sum :math:`s = \sum_i r_i q_i` with the force :math:`f = k (c - s - T \dot s)`, where
        :math:`T` is `DAMPING_TIME`. Each axis feels :math:`r_i f`.

        Args:
            builder: builder of the station's diagram.
            site: the station under construction. The output port of the forces is appended to its generalized forces.
            key: key of the gear in the station, which begins the names of the added blocks.
        """
        plant = site.plant.plant
        # Another engine, whose block takes the plant's place, has its own constraint for the gear.
        if site.plant.holds_constraints or site.plant.stand_in is not None:
            return
        # Products of these rows with the plant's state (nq + nv,) are s and its rate. The row `ratios` (nv,) holds the
        # ratio of each velocity of the plant, and so the direction of the spring's force.
        state_size = plant.num_positions() + plant.num_velocities()
        sum_row = np.zeros(state_size)
        rate_row = np.zeros(state_size)
        ratios = np.zeros(plant.num_velocities())
        for robot in site.plant.robots.values():
            axis_ratios = self._axis_ratios(robot)
            axis_count = len(axis_ratios)
            # The product of the robot's state matrix (2 n, nq + nv) with the plant's state has the positions of the
            # axes, then their velocities.
            state_matrix = robot.axis_map.state_matrix
            sum_row += axis_ratios @ state_matrix[:axis_count]
            rate_row += axis_ratios @ state_matrix[axis_count:]
            ratios += axis_ratios @ robot.axis_map.velocity_matrix

        # The inertia that the spring feels at the start is 1 / (ratios M^-1 ratios), with the mass matrix M.
        inverse_mass = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
        stiffness = STIFFNESS_PER_INERTIA / (ratios @ inverse_mass @ ratios)
        # The force f is the product of this row with the vector (state, 1). The 1 brings in the constant c.
        force_row = stiffness * np.append(
            -sum_row - DAMPING_TIME * rate_row, self.constant_sum(site.plant)
        )
        one = add_and_connect(builder, f"{key}.one", ConstantVectorSource([1.0]))
        state_and_one = add_multiplexer(builder, f"{key}.bus", site.state, one)
        # Generalized forces of the plant, shape (nv,): ratios f.
        forces = add_matrix_gain(
            builder, f"{key}.force", np.outer(ratios, force_row), state_and_one
        )
        site.generalized_forces.append(forces)
        # In the picture of the diagram the first two blocks are only wires.
        site.picture.draw_nothing(f"{key}.one", f"{key}.bus")
        site.picture.draw(
            f"{key}.force",
            "force",
            message("parts.block_couples", "Coupling of\n{axes}", axes=", ".join(self.ratios)),
        )

    def caption(self) -> str:
        """Describe the gear in words."""
        terms = [
            compound("{ratio:g} {axis}", ratio=ratio, axis=axis)
            for axis, ratio in self.ratios.items()
        ]
        return message(
            "parts.coupling_gear", "a gear: {terms} is constant", terms=join_texts(terms, " + ")
        )


class Spring(BetweenPoints):
    r"""A spring with a damper between two points, under any solver.

    The force :math:`f = k (l - l_0) + d\,\dot l` pulls the points together, where :math:`l` is their distance and
    :math:`l_0` the length without force.
    """

    constrains: ClassVar[bool] = False
    kind: Literal["spring"]
    length: NotNegative = 0.0
    """Length without force [m]."""
    stiffness: NotNegative
    """Stiffness [N/m]."""
    damping: NotNegative = 0.0
    """Damping [N·s/m]."""

    def caption(self) -> str:
        """Describe the coupling in words."""
        return message(
            "parts.coupling_spring",
            "a spring of {stiffness:g} N/m from {body} to {other}",
            stiffness=self.stiffness,
            body=self.body,
            other=self.other,
        )

    def add(self, plant: StationPlant) -> None:
        """Add the spring to a plant that is not finalized."""
        # A force element acts on the world, too, so no anchor is needed as for a constraint.
        first, second = self.ends(plant)
        spring = LinearSpringDamper(
            first.body,
            first.pose.translation(),
            second.body,
            second.pose.translation(),
            max(self.length, _SHORTEST_SPRING),
            self.stiffness,
            self.damping,
        )
        plant.plant.AddForceElement(spring)


KINDS = Kinds(
    __name__,
    {
        "gear": "Gear",
        "ball": "Ball",
        "rod": "Rod",
        "weld": "Weld",
        "hinge": "Hinge",
        "spring": "Spring",
    },
    base=CouplingSection,
    point="couplings",
)
CouplingConfig = Annotated[CouplingSection, KINDS]
Couplings = Annotated[dict[str, CouplingConfig], KINDS.names_are_kinds]
