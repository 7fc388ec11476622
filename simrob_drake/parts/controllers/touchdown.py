"""Loop for walking on ground of unknown height: a foot that touches early stays, another one moves on downward.

The thesis proposes it for four legs (p. 120): when the sphere of a foot touches, its leg holds what was applied last.

The robot has n axes and k feet; a *leg* is the chain of joints from the root link to a foot. The *plan* is the
reference of the servos without the offsets that the loop itself adds. A leg is in one of three *phases*. It follows the
plan; or its foot has touched early, while the plan still has the foot in the air; or it stands, until the plan lifts
the foot.
"""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Positive
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.support import Limb, limb_to
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.urdf import link_of, name_of

# Phases of a leg, as the output `phase` gives them.
# The leg follows the reference.
_FOLLOWS = 0.0
# The foot touches, while the reference still has it in the air.
_TOUCHED = 1.0
# The leg stands, until the reference lifts it.
_STANDS = 2.0


class Touchdown(LoopSection):
    """Hold a leg in its posture when its foot touches, and move a foot on downward if it does not touch when it should.

    `reads` names the feet and the sensors of their forces: `{left_foot: force.left}` for a tool `left_foot` and a force
    sensor `left`. The reference has a foot in the air if it is higher above the lowest foot than the clearance.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ("feedforward",)

    label: ClassVar[str] = message("parts.loop_touchdown", "touchdown")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_touch", "Contact of each foot"),
        message("parts.stage_phase", "Phase\nfollow, hold, stand"),
        message("parts.stage_legs_seek_ground", "Legs\nsearch for the ground"),
    )

    kind: Literal["touchdown"]
    force: Positive = 15.0
    """Force from which a foot touches [N]."""
    holds: Literal["positions", "torques"] = "positions"
    """Values at this moment that a leg holds. `positions`: the positions of its joints while the reference has the
    foot in the air, and then their distance from the reference while the leg stands. `torques`: the torques of its
    joints."""
    clearance: Positive = 0.008
    """Height above the lowest foot from which the reference has a foot in the air [m]."""
    search: NotNegative = 0.3
    """Speed at which a foot that does not touch when it should moves on downward [m/s]; 0 if it stays."""
    reach: NotNegative = 0.03
    """Largest distance of this motion [m]."""
    settle: Positive = 0.1
    """Time constant with which a leg that stands comes to the reference, which sets the trunk upright [s]."""
    release: Positive = 0.05
    """Time constant with which a leg goes back to the reference when that lifts it [s]."""

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes of the legs that end in the feet of `reads`, in the order of the robot's axes.

        Raises:
            InvalidParameter: no key of `reads` is a tool of the robot.
        """
        # The keys of `reads` are inputs of the loop: feet, or others such as `position`.
        feet = [foot for foot in self.reads if foot in robot.model.tools]
        if not feet:
            known = ", ".join(robot.model.tools) or message("parts.none_known", "none")
            expected = message(
                "parts.tools_with_force_sensors",
                "a mapping of tools to force sensors, {{<tool>: force.<sensor>}}; tools: {known}",
                known=known,
            )
            raise InvalidParameter(
                message(
                    "parts.reads_of_touchdown",
                    "reads of the touchdown loop of {robot}",
                    robot=robot.name,
                ),
                f"{list(self.reads)}",
                expected,
            )
        # Joint by which each link hangs on its parent. The way from a foot to the root link has all joints of its leg.
        joint_of_link = {
            link_of(joint, "child"): joint for joint in robot.model.element.iterfind("joint")
        }
        joints = set[str]()
        for foot in feet:
            link = robot.model.tools[foot]
            while link in joint_of_link:
                joint = joint_of_link[link]
                joints.add(name_of(joint))
                link = link_of(joint, "parent")
        return [name for name, axis in robot.model.axes.items() if axis.joint in joints]

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot. The key and the site (the station) have no effect here.

        Raises:
            Unsuitable: no joint moves a foot, or a joint of a leg slides.
        """
        limbs = {
            foot: limb_to(robot, robot.tools[foot])
            for foot in self.reads
            if foot in robot.model.tools
        }
        return UnknownGround(self, limbs, len(robot.axes))


class UnknownGround(SampledBlock):
    """Hold legs whose feet touch early, and extend legs whose feet do not touch when they should.

    Ports:
        in  the force on each foot (3) [N], by the foot's name; ``reference`` (n) of the servos, which contains the
            offset [rad]; ``position`` (n) [rad], ``torque`` (n) [N·m].
        out ``offset`` (n) [rad] and ``offset_velocity`` (n) [rad/s], added to the reference; ``feedforward`` (n)
            [N·m]; ``phase`` (k): 0 if a foot follows the reference, 1 if it touched early, 2 if it stands.
    """

    def __init__(self, section: Touchdown, limbs: Mapping[str, Limb], size: int) -> None:
        """Create the block.

        Args:
            section: section of the loop.
            limbs: legs, by the names of their k feet.
            size: count n of the robot's axes.
        """
        period = 1 / section.rate
        self.units = {"offset": "rad", "offset_velocity": "rad/s", "feedforward": "N·m"}
        self.components = {"phase": tuple(limbs)}
        self._limbs = dict(limbs)
        self._section = section
        # Share of the offsets that is added to the reference.
        self._weight = section.weight or 1.0
        # An offset that decays with a time constant is multiplied by exp(-period / constant) at each sample.
        self._release_factor = np.exp(-period / section.release)
        self._settle_factor = np.exp(-period / section.settle)
        zero = np.zeros(size)
        zero_of_feet = np.zeros(len(limbs))
        memory = {
            "offset": zero,
            "offset_velocity": zero,
            "feedforward": zero,
            "posture": zero,  # positions of a leg when its foot touched [rad]
            "torques": zero,  # torques of a leg when its foot touched [N·m]
            "plan": zero,  # reference without the offset [rad]
            "phase": zero_of_feet + _STANDS,
            "heights": zero_of_feet,  # heights of the feet in the plan [m]
            "sought": zero_of_feet,  # distance by which each foot has moved on downward [m]
        }
        super().__init__(
            period=period,
            reads={**dict.fromkeys(limbs, 3), "reference": size, "position": size, "torque": size},
            memory=memory,
            gives=("offset", "offset_velocity", "feedforward", "phase"),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the phase, the offset and the feedforward of each leg.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        # Copies of the vectors that the loop below changes leg by leg.
        new = {
            name: memory[name].copy()
            for name in ("offset", "posture", "torques", "phase", "sought")
        }
        # The reference that the servos get contains the loop's own offset of the last sample, times its weight.
        plan = read["reference"] - self._weight * memory["offset"]
        # Velocity of the plan [rad/s]. At the first sample the plan before is not known, so the velocity is wrong; it
        # is not used before a leg was lifted.
        velocity = (plan - memory["plan"]) / self.period
        new["offset_velocity"] = np.zeros(len(plan))
        new["feedforward"] = np.zeros(len(plan))

        # Heights of the feet in the plan, along the z axis of the robot's root link [m].
        angles = plan.tolist()
        heights = [limb.place(angles)[2] for limb in self._limbs.values()]
        last_heights = memory["heights"].tolist()
        last_phases = memory["phase"].tolist()
        # Height above which the plan has a foot in the air.
        lowest_in_air = min(heights) + self._section.clearance
        for number, (foot, limb) in enumerate(self._limbs.items()):
            leg = limb.places
            last_phase = last_phases[number]
            is_raised = heights[number] > lowest_in_air
            is_lowering = heights[number] < last_heights[number]
            phase = self._next_phase(
                last_phase, foot, read, is_raised=is_raised, is_lowering=is_lowering
            )
            new["phase"][number] = phase
            # At the moment of the touch, what is to be held is remembered.
            if phase == _TOUCHED and last_phase == _FOLLOWS:
                new["posture"][leg] = read["position"][leg]
                new["torques"][leg] = read["torque"][leg]

            if phase == _FOLLOWS:
                self._follow(new, number, limb, plan, is_raised=is_raised)
            elif phase == _TOUCHED:
                # plan + offset = posture, and the sum does not move: the leg stays as it was when its foot touched.
                new["offset"][leg] = (new["posture"] - plan)[leg]
                new["offset_velocity"][leg] = -velocity[leg]
            else:
                # A leg that stands slowly returns to the plan. This sets the trunk upright.
                new["offset"][leg] *= self._settle_factor
            if self._section.holds == "torques":
                self._hold_torques(
                    new, leg, read["position"] - plan, velocity, follows=phase == _FOLLOWS
                )
        return {**new, "plan": plan, "heights": np.array(heights)}

    def _next_phase(
        self, phase: float, foot: str, read: Named, *, is_raised: bool, is_lowering: bool
    ) -> float:
        """Phase of a leg at this sample.

        The force on the foot is only read if it matters, since reading takes time.

        Args:
            phase: phase before.
            foot: name of the foot.
            read: inputs of the sample.
            is_raised: whether the plan has the foot in the air.
            is_lowering: whether the plan moves the foot down.

        Returns:
            ``_FOLLOWS``, ``_TOUCHED`` or ``_STANDS``.
        """
        if phase == _STANDS:
            return _FOLLOWS if is_raised else _STANDS
        if phase == _TOUCHED:
            return _TOUCHED if is_raised else _STANDS
        # A leg that follows. While its foot is lifted, a force on the foot is the one of the lift-off, not a touch.
        may_touch = is_lowering or not is_raised
        if may_touch and math.hypot(*read[foot].tolist()) > self._section.force:
            return _TOUCHED if is_raised else _STANDS
        return _FOLLOWS

    def _follow(
        self, new: dict[str, Vector], number: int, limb: Limb, plan: Vector, *, is_raised: bool
    ) -> None:
        """Change the offset of a leg that does not touch, and the distance by which its foot was moved on downward.

        While the plan has the foot in the air, the leg returns to the plan. Afterwards, the foot moves on downward at
        the speed ``search``, until it has gone the distance ``reach``.

        Args:
            new: vectors of the new memory, by name. ``offset`` and ``sought`` are changed.
            number: index of the foot.
            limb: the leg.
            plan: reference without the offset, shape (n,) [rad].
            is_raised: whether the plan has the foot in the air.
        """
        if is_raised:
            new["offset"][limb.places] *= self._release_factor
            new["sought"][number] = 0.0
            return
        step = min(self._section.search * self.period, self._section.reach - new["sought"][number])
        # Straight down, along the z axis of the root link.
        motion = [0.0, 0.0, -step]
        # J dq = motion with the foot's Jacobian J; least squares, since a leg need not have exactly three axes.
        jacobian = limb.rates(plan + new["offset"])
        new["offset"][limb.places] += np.linalg.lstsq(jacobian, motion)[0]
        new["sought"][number] += step

    def _hold_torques(
        self,
        new: dict[str, Vector],
        leg: slice | list[int],
        to_position: Vector,
        velocity: Vector,
        *,
        follows: bool,
    ) -> None:
        """Apply only the torques from the moment of an early touch to a leg, until it follows the reference again.

        A leg that touched as planned is not changed. A leg that follows the reference has its stored torques cleared.
        With the reference at the measured position, the servos themselves apply nothing but their damping.

        Args:
            new: vectors of the new memory, by name, which are changed.
            leg: indices of the leg's axes.
            to_position: distance from the plan to the measured positions, shape (n,) [rad].
            velocity: velocity of the plan, shape (n,) [rad/s].
            follows: whether the leg follows the reference.
        """
        # The torques are stored at an early touch, and cleared while the leg follows. So they are all 0 if the leg
        # touched as planned: then it stands with its offset.
        if follows:
            new["torques"][leg] = 0.0
        elif new["torques"][leg].any():
            # plan + offset = measured position: the servos see no error.
            new["offset"][leg] = to_position[leg]
            new["offset_velocity"][leg] = -velocity[leg]
            new["feedforward"][leg] = new["torques"][leg]
