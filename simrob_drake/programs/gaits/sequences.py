"""Postures one after the other: the thesis's step and march, bows, waves, swimming strokes, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from simrob_drake.base.arguments import positive
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stacked
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Integer
from simrob_drake.blocks.references import smooth
from simrob_drake.kinematics.skeleton import Skeleton
from simrob_drake.parts.references import Waypoint
from simrob_drake.programs.gaits.motion import Gait, JointMotion, Pace
from simrob_drake.programs.gaits.phases import check_steps, samples
from simrob_drake.programs.gaits.walker import Walker, mirrored
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel


class March(Gait):
    """A walk on two legs by joint angles, joined by straight lines: the thesis's manner."""

    section: ClassVar[str] = "marches"
    usual: ClassVar[str] = "march"
    steps: ClassVar[bool] = True
    pace: ClassVar[str] = "move_time"

    servo: Mapping[str, AxisValues] = Field(default_factory=dict)
    """Servo gains for it, in place of the station's: kp, kd."""
    move_time: Pace = 1.0
    """Of each sub-move [s]."""
    start_deg: AxisValues
    """Posture at the start and at the end [deg]."""
    left: Annotated[tuple[AxisValues, ...], Field(min_length=2)]
    """Postures of a step with the left foot; axes that are left out are as at the start. The right one mirrors them."""
    feed_velocity: Boolean = False
    """Whether the servos are told the reference's velocity, too; not so in the thesis."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Return its motion; the amplitude scales how far all joints go from the posture at the start."""
        check_steps(steps)
        positive(amplitude, "amplitude", "1")
        model = walker.model
        start = _vector(model, self.start_deg, np.zeros(len(model.axes)))
        left = [_vector(model, posture, start) for posture in self.left]
        moves = {0: left, 1: [mirrored(model, posture) for posture in left]}
        postures = [start]
        for step in range(steps + 1):
            share = amplitude * (0.5 if step == 0 else 1.0)
            sub_moves = moves[step % 2] if step < steps else [*moves[step % 2][:-1], start]
            postures += [start + share * (posture - start) for posture in sub_moves]
        times = np.arange(len(postures)) * self.move_time
        motion = _motion(walker, self.feet, list(times), postures, "linear", self.rest)
        return replace(motion, servo=self.servo, feed_velocity=self.feed_velocity)


class Posing(Gait):
    """Postures one after the other."""

    section: ClassVar[str] = "sequences"
    on_feet: ClassVar[bool] = False

    start_deg: AxisValues = 0.0
    """Posture at the start [deg]."""
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures, and when to be there; axes that are left out stay."""
    repeat: Integer = Field(default=1, ge=1, le=1000)
    """How often to go through the targets."""
    held: Boolean = False
    """Whether it is for a robot that is held by its trunk."""
    ramps: Literal["smooth", "linear"] = "smooth"
    """Smooth: at rest in every posture. Linear: straight lines, as in the thesis."""
    feed_velocity: Boolean = True
    """Whether the servos are told the reference's velocity, too; not so in the thesis."""
    falls: Boolean = False
    """Whether it ends on the floor: monitors of the robot's fall do not watch it then."""

    @property
    def hangs(self) -> bool:
        """Whether it is for a robot that is held by its trunk."""
        return self.held

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        model = walker.model
        start = _vector(model, self.start_deg, np.zeros(len(model.axes)))
        times, postures = [0.0], [start]
        for number in range(self.repeat):
            begun = number * self.targets[-1].time
            for target in self.targets:
                times.append(begun + target.time)
                postures.append(_vector(model, target.target_deg, postures[-1]))
        if (np.diff(times) <= 0).any():
            raise InvalidParameter(
                "targets",
                message("programs.at_times", "at {times} s", times=[target.time for target in self.targets]),
                message("programs.one_after_other", "one after the other"),
            )
        motion = _motion(walker, self.feet, times, postures, self.ramps, self.rest)
        return replace(motion, feed_velocity=self.feed_velocity, falls=self.falls)


def posing(robot: str | RobotModel | Walker, name: str, **changes: Any) -> JointMotion:
    """Return one of a robot's sequences of postures, whose targets' times rise; see :meth:`Gait.planned`."""
    return Posing.planned(robot, 0, name, **changes)


march = March.planned
"""Plan a walk by joint angles in the thesis's manner; the first and the last step are half as long, so one is added."""


def standing_height(skeleton: Skeleton, angles: Vector, feet: str | None = None) -> float:
    """Return how high the root of a robot is while its lowest foot touches the floor [m]."""
    if skeleton.model.feet is None:
        return 0.0
    frames, contact = skeleton.frames(angles[np.newaxis]), skeleton.model.feet.kind(feet)
    lowest = [contact.lowest_points(link, skeleton.link_poses(link, frames))[0, :, 2].min() for link in contact.links]
    return -min(0.0, *map(float, lowest))


def _vector(model: RobotModel, values: AxisValues, otherwise: Vector) -> Vector:
    return np.deg2rad(model.axis_vector(values, "target_deg", np.rad2deg(otherwise)))


def _motion(
    walker: Walker,
    feet: str | None,
    times: Sequence[float],
    postures: Sequence[Vector],
    ramps: Literal["smooth", "linear"],
    rest: float,
) -> JointMotion:
    """Join postures, by straight lines or at rest in each."""
    at = samples(times[-1] + rest)
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    starts, ends = np.array(times)[piece], np.array(times)[piece + 1]
    share = np.clip((at - starts) / (ends - starts), 0.0, 1.0)
    if ramps == "smooth":
        share = smooth(share)
    table = np.array(postures)
    positions = table[piece] + share[:, np.newaxis] * (table[piece + 1] - table[piece])
    count, height = len(at), standing_height(walker.skeleton, table[0], feet)
    root = stacked(np.tile([0.0, 0.0, height], (count, 1)), np.tile(np.eye(3), (count, 1, 1)))
    return JointMotion(walker.model, feet, at, positions, root)
