"""Gaits that are sequences of postures: a march as in the thesis, bows, waves, swimming strokes.

A posture is given by the angles of the axes, not by footholds; nothing keeps the robot in balance. The root link is
planned to stay where the robot stands in the first posture. *Knots* are postures with the times at which the robot is
in them.

"The thesis" is the work on a humanoid for which the original of this toolbox, SimRob, was written: it joined postures
by straight lines and gave the servos positions only.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from simrob_drake.base.arguments import positive
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Integer
from simrob_drake.blocks.references import smooth
from simrob_drake.kinematics.skeleton import Skeleton
from simrob_drake.parts.references import Waypoint
from simrob_drake.programs.gaits.motion import Gait, JointMotion, Pace
from simrob_drake.programs.gaits.phases import check_steps, samples
from simrob_drake.programs.gaits.walker import Walker, exchange_sides
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel

Ramps = Literal["smooth", "linear"]
"""How two postures are joined: with rest in each of them, or by straight lines."""


class _Knots(NamedTuple):
    """Postures, and the times at which the robot is in them.

    Attributes:
        times: times in ascending order, the first is 0 [s].
        postures: angles of the n axes at these times, shape (n,) each [rad].
    """

    times: list[float]
    postures: list[Vector]


class March(Gait):
    """A walk on two legs by joint angles that are joined by straight lines, as in the thesis."""

    section: ClassVar[str] = "marches"
    usual: ClassVar[str] = "march"
    steps: ClassVar[bool] = True
    pace: ClassVar[str] = "move_time"

    servo: Mapping[str, AxisValues] = Field(default_factory=dict)
    """Gains of the servos that replace those of the station: kp, kd."""
    move_time: Pace = 1.0
    """Time from one posture to the next [s]."""
    start_deg: AxisValues
    """Posture at the start and at the end [deg]."""
    left: Annotated[tuple[AxisValues, ...], Field(min_length=2)]
    """Postures of a step with the left foot [deg]. Axes that are left out are as at the start. The step with the right
    foot is the mirror image."""
    feed_velocity: Boolean = False
    """Whether the servos get the velocity of the reference as well. They do not in the thesis."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Plan the march, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: count of full steps. One more is added, because the first and the last one are half as long.
            amplitude: factor of how far all joints move from the posture at the start.
        """
        check_steps(steps)
        positive(amplitude, "amplitude", "1")
        model = walker.model
        # A file describes the left step only. The right one mirrors it, so that the walk is symmetric.
        start = _posture(model, self.start_deg, np.zeros(len(model.axes)))
        left_step = [_posture(model, posture, start) for posture in self.left]
        right_step = [exchange_sides(model, posture) for posture in left_step]
        postures = [start]
        for number in range(steps + 1):
            step = right_step if number % 2 else left_step
            # The feet are side by side at both ends. So the first step is half as long, and the last one ends in the
            # posture at the start.
            if number == steps:
                step = [*step[:-1], start]
            share = amplitude * (0.5 if number == 0 else 1.0)
            postures += [start + share * (posture - start) for posture in step]
        times = [float(time) for time in np.arange(len(postures)) * self.move_time]
        motion = _join_postures(walker, self.feet, _Knots(times, postures), "linear", self.rest)
        return replace(motion, servo=self.servo, feed_velocity=self.feed_velocity)


class Posing(Gait):
    """Postures one after the other."""

    section: ClassVar[str] = "sequences"
    on_feet: ClassVar[bool] = False

    start_deg: AxisValues = 0.0
    """Posture at the start [deg]."""
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures, each with the time at which the robot is in it. Axes that are left out stay where they are."""
    repeat: Integer = Field(default=1, ge=1, le=1000)
    """Count of times that the targets are repeated."""
    held: Boolean = False
    """Whether the sequence is for a robot whose trunk is held."""
    ramps: Ramps = "smooth"
    """Smooth: at rest in every posture. Linear: straight lines, as in the thesis."""
    feed_velocity: Boolean = True
    """Whether the servos get the velocity of the reference as well. They do not in the thesis."""
    falls: Boolean = False
    """Whether the sequence ends with the robot on the floor. If so, monitors of a fall ignore the robot."""

    @property
    def hangs(self) -> bool:
        """Whether the sequence is for a robot that is held by its trunk."""
        return self.held

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Plan the sequence, see :meth:`Gait.plan`. Limits of the axes are not checked here.

        Args:
            walker: the robot.
            steps: not used.
            amplitude: not used.

        Raises:
            InvalidParameter: the times of the targets do not ascend from above 0, or the sequence takes too long for
                one plan.
            UnknownName: the robot has no axis or no feet of a name in the sequence.
        """
        knots = self._knots(walker.model)
        # The times of the knots, not of the targets: they contain the start at 0 s, so that a first target at 0 s is
        # refused as well.
        if (np.diff(knots.times) <= 0).any():
            raise InvalidParameter(
                "targets",
                message(
                    "programs.at_times",
                    "at {times} s",
                    times=[target.time for target in self.targets],
                ),
                message("programs.one_after_other", "at ascending times after 0 s"),
            )
        motion = _join_postures(walker, self.feet, knots, self.ramps, self.rest)
        return replace(motion, feed_velocity=self.feed_velocity, falls=self.falls)

    def _knots(self, model: RobotModel) -> _Knots:
        """Compute the postures of all repetitions, and their times.

        The times ascend only if those of the targets do, which is not checked here.
        """
        # The start is the posture at the time 0. A repetition continues from the last target, not from the start.
        times = [0.0]
        postures = [_posture(model, self.start_deg, np.zeros(len(model.axes)))]
        for repetition in range(self.repeat):
            start_time = repetition * self.targets[-1].time
            for target in self.targets:
                times.append(start_time + target.time)
                # Axes that a target leaves out stay where the target before has put them.
                postures.append(_posture(model, target.target_deg, postures[-1]))
        return _Knots(times, postures)


def posing(robot: str | RobotModel | Walker, name: str, **changes: Any) -> JointMotion:
    """Plan one of a robot's sequences of postures; see :meth:`Gait.plan_by_name`.

    Args:
        robot: name or model of the robot, or a :class:`Walker`.
        name: name of the sequence in the robot's ``gaits.yaml``.
        **changes: values of parameters that replace those of the file.
    """
    return Posing.plan_by_name(robot, 0, name, **changes)


march = March.plan_by_name
"""Plan a walk by joint angles as in the thesis; the first and the last step are half as long, so one is added."""


def standing_height(skeleton: Skeleton, angles: Vector, feet: str | None = None) -> float:
    """Compute the height of the root link, not turned, at which the lowest foot of a robot touches the floor [m].

    Args:
        skeleton: links, joints and masses of the robot.
        angles: angles of its n axes, shape (n,) [rad].
        feet: kind of feet. If it is None, the default one.

    Returns:
        The height, at least 0. It is 0 if the robot has no feet.
    """
    if skeleton.model.feet is None:
        return 0.0
    frames = skeleton.frames(angles[np.newaxis])  # with the root at the height 0
    contact = skeleton.model.feet.kind(feet)
    # Feet are below the root, so their heights are negative while the root is at the height 0.
    lowest = 0.0
    for link in contact.links:
        points = contact.lowest_points(link, skeleton.link_poses(link, frames))[0]
        lowest = min(lowest, float(points[:, 2].min()))
    return -lowest


def _posture(model: RobotModel, values: AxisValues, default: Vector) -> Vector:
    """Convert the angles of a posture from degrees.

    Args:
        model: the robot.
        values: angles of some axes by name, one for each axis, or one for all [deg].
        default: angles of the axes that are left out, shape (n,) [rad].

    Returns:
        Angles of all axes, shape (n,) [rad].
    """
    return np.deg2rad(model.axis_vector(values, "target_deg", np.rad2deg(default)))


def _join_postures(
    walker: Walker,
    feet: str | None,
    knots: _Knots,
    ramps: Ramps,
    rest: float,
) -> JointMotion:
    """Plan the motion through postures.

    Args:
        walker: the robot.
        feet: kind of its feet. If it is None, the default one.
        knots: at least two postures, and their times in ascending order.
        ramps: ``smooth`` comes to rest in each posture, ``linear`` goes from one to the next at a constant speed.
        rest: time to stay in the last posture [s].
    """
    sample_times = samples(knots.times[-1] + rest)
    count = len(sample_times)
    times = np.array(knots.times)
    postures = np.array(knots.postures)
    # Index of the posture before each sample. The last interval goes on while the robot rests.
    before = np.clip(np.searchsorted(times, sample_times, side="right") - 1, 0, len(times) - 2)
    starts = times[before]
    ends = times[before + 1]
    # How much of the way between two postures is done at each sample, from 0 to 1.
    share = np.clip((sample_times - starts) / (ends - starts), 0.0, 1.0)
    # Linear shares stay as they are: then the speed jumps at each posture, as in the thesis.
    if ramps == "smooth":
        share = smooth(share)
    positions = postures[before] + share[:, np.newaxis] * (postures[before + 1] - postures[before])
    # The root stays over one position at the height of the first posture: how it moves then depends on the contacts.
    height = standing_height(walker.skeleton, postures[0], feet)
    root = stack_poses(np.tile([0.0, 0.0, height], (count, 1)), np.tile(np.eye(3), (count, 1, 1)))
    return JointMotion(walker.model, feet, sample_times, positions, root)
