"""A loop that lets feet find ground of unknown height: a foot that touches early stays, one that finds none seeks it.

The thesis proposes it for four legs (p. 120): a foot sphere that, on touching, holds what was applied last.
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

_FOLLOWS, _TOUCHED, _STANDS = 0.0, 1.0, 2.0
"""A leg goes as planned; it touched while the plan still has it in the air; it stands, until the plan lifts it."""


class Touchdown(LoopSection):
    """Hold a leg as it is when its foot touches, and let it seek the ground where that is lower than planned.

    `reads` names the feet and what tells their forces: `{left_foot: force.left}` for a tool `left_foot` and a force
    sensor `left`. A foot is in the air while the reference has it higher over its lowest foot than the clearance.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ("feedforward",)

    label: ClassVar[str] = message("parts.loop_touchdown", "touchdown")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_touch", "Touch of each foot"),
        message("parts.stage_phase", "Phase\nfollow, hold, stand"),
        message("parts.stage_legs_seek_ground", "Legs\nseek the ground"),
    )

    kind: Literal["touchdown"]
    force: Positive = 15.0
    """Force from which a foot touches [N]."""
    holds: Literal["positions", "torques"] = "positions"
    """What of that moment: the joints' positions while the reference has the foot in the air, and their distance from
    the reference while it stands; or their torques, for both."""
    clearance: Positive = 0.008
    """How high the reference has a foot that is in the air, over the lowest one [m]."""
    search: NotNegative = 0.3
    """How fast a foot that does not touch when it should goes on downward [m/s]; 0 if it stays."""
    reach: NotNegative = 0.03
    """How far at most [m]."""
    settle: Positive = 0.1
    """Time constant with which a leg that stands comes to the reference, which sets the trunk upright [s]."""
    release: Positive = 0.05
    """Time constant with which a leg goes back to the reference when that lifts it [s]."""

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes of the legs that end in its feet."""
        feet = [foot for foot in self.reads if foot in robot.model.tools]
        if not feet:
            known = ", ".join(robot.model.tools) or "none"
            expected = message(
                "parts.tools_with_force_sensors",
                "some of its tools, each with a force sensor: {{<tool>: force.<sensor>}}; tools: {known}",
                known=known,
            )
            raise InvalidParameter(
                message("parts.reads_of_touchdown", "reads of a touchdown of {robot}", robot=robot.name),
                f"{list(self.reads)}",
                expected,
            )
        inward = {link_of(joint, "child"): joint for joint in robot.model.element.iterfind("joint")}
        joints = set[str]()
        for foot in feet:
            link = robot.model.tools[foot]
            while link in inward:
                joints.add(name_of(inward[link]))
                link = link_of(inward[link], "parent")
        return [name for name, axis in robot.model.axes.items() if axis.joint in joints]

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        limbs = {foot: limb_to(robot, robot.tools[foot]) for foot in self.reads if foot in robot.model.tools}
        return UnknownGround(self, limbs, len(robot.axes))


class UnknownGround(SampledBlock):
    """Hold legs that touch, extend legs that should and do not.

    Ports:
        in  by each foot's name: the force on it (3) [N]; ``reference`` (n): what the servos are asked for, with the
            offset; ``position`` (n) [rad], ``torque`` (n) [N·m].
        out ``offset`` (n) [rad] and ``offset_velocity`` (n) [rad/s], on the reference; ``feedforward`` (n) [N·m];
            ``phase`` (k): 0 where a foot follows the reference, 1 where it touched early, 2 where it stands.
    """

    def __init__(self, section: Touchdown, limbs: Mapping[str, Limb], size: int) -> None:
        """Make the block of a section, for legs by the names of their k feet, of a robot of n axes."""
        period, self.units = 1 / section.rate, {"offset": "rad", "offset_velocity": "rad/s", "feedforward": "N·m"}
        self._limbs, self._section, self.components = dict(limbs), section, {"phase": tuple(limbs)}
        self._keeps, self._stays = np.exp(-period / section.release), np.exp(-period / section.settle)
        zero, feet = np.zeros(size), np.zeros(len(limbs))
        memory = {"offset": zero, "offset_velocity": zero, "feedforward": zero}
        memory |= dict.fromkeys(("posture", "torques", "plan"), zero)
        super().__init__(
            period=period,
            reads={**dict.fromkeys(limbs, 3), "reference": size, "position": size, "torque": size},
            memory={**memory, "phase": feet + _STANDS, "heights": feet, "sought": feet},
            gives=("offset", "offset_velocity", "feedforward", "phase"),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what each leg is asked for beyond the reference."""
        new = {name: memory[name].copy() for name in ("offset", "posture", "torques", "phase", "sought")}
        plan = read["reference"] - memory["offset"]
        speed = (plan - memory["plan"]) / self.period  # not used before a leg has been lifted
        new["offset_velocity"], new["feedforward"] = np.zeros(len(plan)), np.zeros(len(plan))
        angles, before, phases = plan.tolist(), memory["heights"].tolist(), memory["phase"].tolist()
        heights = [limb.place(angles)[2] for limb in self._limbs.values()]
        least = min(heights) + self._section.clearance
        for number, (foot, limb) in enumerate(self._limbs.items()):
            raised, leg = heights[number] > least, limb.places
            phase = self._phase(phases[number], raised, heights[number] < before[number], foot, read)
            if phase == _TOUCHED and phases[number] == _FOLLOWS:
                new["posture"][leg], new["torques"][leg] = read["position"][leg], read["torque"][leg]
            if phase == _FOLLOWS:
                self._seek(new, number, limb, plan, raised)
            elif phase == _TOUCHED:
                new["offset"][leg] = (new["posture"] - plan)[leg]
                new["offset_velocity"][leg] = -speed[leg]
            else:
                new["offset"][leg] *= self._stays
            if self._section.holds == "torques":
                # a leg that touched early: its servos apply what they did then, and nothing beside
                if phase == _FOLLOWS:
                    new["torques"][leg] = 0.0
                elif new["torques"][leg].any():
                    new["offset"][leg], new["offset_velocity"][leg] = (read["position"] - plan)[leg], -speed[leg]
                    new["feedforward"][leg] = new["torques"][leg]
            new["phase"][number] = phase
        return {**new, "plan": plan, "heights": np.array(heights)}

    def _phase(self, phase: float, raised: bool, lowers: bool, foot: str, read: Named) -> float:
        """Return what a leg does next; the force on its foot is looked at only where it matters: that takes time."""
        if phase == _STANDS:
            return _FOLLOWS if raised else _STANDS
        if phase == _TOUCHED:
            return _TOUCHED if raised else _STANDS
        touches = (lowers or not raised) and math.hypot(*read[foot].tolist()) > self._section.force
        return (_TOUCHED if raised else _STANDS) if touches else _FOLLOWS

    def _seek(self, new: dict[str, Vector], number: int, limb: Limb, plan: Vector, raised: bool) -> None:
        """Let a leg that has not touched go on downward where it should have, and back to the reference before."""
        if raised:
            new["offset"][limb.places] *= self._keeps
            new["sought"][number] = 0.0
            return
        step = min(self._section.search * self.period, self._section.reach - new["sought"][number])
        new["offset"][limb.places] += np.linalg.lstsq(limb.rates(plan + new["offset"]), [0.0, 0.0, -step])[0]
        new["sought"][number] += step
