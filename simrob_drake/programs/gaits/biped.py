r"""Gaits on two legs: a walk, planned footstep by footstep, and a kick.

Both plan footholds and the zero-moment point (ZMP) in the frame of :mod:`~simrob_drake.programs.gaits.phases`: x ahead,
y to the left, the origin in the middle of the feet at the start. A foothold is a vector (3,): x [m], y [m] and the
foot's turn to the left [rad]. The ZMP is the point of the floor about which the ground's forces have no level moment:
the weight is over it.

The kicking foot is brought back and comes to rest there. It gathers its speed v over a distance b, so that it has this
speed at the point that it hits, without a jump of its acceleration, and loses it over the same distance behind the
point:

.. math:: \dot s(t) = v \left(3 u^2 - 2 u^3\right), \qquad u = t / T, \quad T = 2 b / v .
"""

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.interpolate import BPoly

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Positive
from simrob_drake.programs.gaits.motion import EvenSteps, JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import (
    Phase,
    check_steps,
    gait_plan,
    pose_after,
    ramp_shares,
)
from simrob_drake.programs.gaits.walker import Foot, Walker
from simrob_drake.programs.gaits.whole_body import WholeBody

FEET = ("right_foot", "left_foot")
"""Names of the two feet, in the order in which they step."""

# Kinds of legs by the count of their axes.
_AXES_WITHOUT_YAW = 4  # no yaw at the hip and no roll at the ankle
_ALL_AXES = 6  # the foot can have any pose


class BipedWalk(EvenSteps, SolvedGait):
    """A walk on two legs."""

    section: ClassVar[str] = "walks"
    usual: ClassVar[str] = "walk"

    lift: Positive = 0.03
    """Largest height of the swinging foot [m]."""
    double_support: Positive = 0.2
    """Part of a step in which both feet stand [1]."""
    zmp_inward: Number = 0.0
    """Distance of the zero-moment point from the middle of each foot towards the other foot [m]."""
    zmp_ahead: Number = 0.0
    """Distance of the zero-moment point ahead of the middle of each foot [m]."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Plan the walk, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: count of full steps.
            amplitude: not used, since the step is scaled by it already.
        """
        return planned_walk(walker, steps, self).motion


walk = BipedWalk.plan_by_name
"""Plan a walk; ``ramp_steps`` steps and one that brings the feet side by side come in addition to the full ones."""


class PlannedWalk(NamedTuple):
    """A walk and its zero-moment point.

    Attributes:
        motion: joint angles and poses of the root over m samples.
        desired_zmp: zero-moment point of the plan, shape (m, 2) [m], in the frame of the plan.
        zmp: zero-moment point of the motion if no foot slips, shape (m, 2) [m], in the frame of the plan.
    """

    motion: JointMotion
    desired_zmp: Vector
    zmp: Vector


def planned_walk(walker: Walker, steps: int, gait: BipedWalk) -> PlannedWalk:
    """Plan a walk.

    Args:
        walker: the robot.
        steps: count of full steps. Steps of the ramps, and one that brings the feet together, come in addition.
        gait: parameters of the walk.

    Raises:
        InvalidParameter: the robot cannot perform the walk, the count of steps is less than 1, or the walk takes too
            long for one plan.
        UnknownName: the robot has no feet of the kind that the gait names.
        OutOfReach: a leg is too short for a step, or a joint is beyond a limit.
    """
    needed = message("programs.two_feet_to_walk", "two feet for this gait")
    feet = walker.feet_by_name(FEET, gait.feet, needed)
    _check(walker.model.name, steps, gait, feet)
    start = {}
    for name, foot in feet.items():
        left = foot.home[1] + foot.side * gait.widen
        start[name] = np.array([0.0, left, 0.0])  # x, y, turn
    # At the start the weight is on both feet: the zero-moment point is half-way between them, ahead by `zmp_ahead`.
    plan = gait_plan(start, np.array([gait.zmp_ahead, 0.0]), _walk_phases(steps, gait, start))
    motion, zmp = WholeBody(walker, gait, plan).solve()
    return PlannedWalk(motion, plan.zmp, zmp)


def _walk_phases(steps: int, gait: BipedWalk, start: dict[str, Vector]) -> list[Phase]:
    """Plan the phases of a walk: shift the weight, step with each foot in turn, and come to rest.

    Args:
        steps: count of full steps.
        gait: parameters of the walk.
        start: foothold (3,) of each foot at the start, by name.
    """
    transfer_time = gait.double_support * gait.step_time
    # Ahead [m], to the left [m] and turn to the left [rad].
    full_step = np.array([gait.step_length, gait.sideways, np.deg2rad(gait.turn_deg)])
    footholds = {name: foothold.copy() for name, foothold in start.items()}
    pose = np.zeros(3)  # of the middle of the feet: x, y, turn

    def zmp_under(name: str) -> Vector:
        """Zero-moment point while only this foot stands, shape (2,) [m]."""
        inward = -np.sign(start[name][1]) * gait.zmp_inward
        return pose_after(footholds[name], gait.zmp_ahead, inward)[:2]

    # The weight goes to the foot that stands during the first step.
    first_standing = FEET[1]
    phases = [Phase(duration=gait.settle, zmp=zmp_under(first_standing), transfer=gait.settle)]
    # Each share is the length of a step over that of a full one: it grows at the start, shrinks at the end, and is 0
    # for the last step.
    for number, share in enumerate(ramp_shares(steps, gait.ramp_steps)):
        swinging = FEET[number % 2]
        standing = FEET[(number + 1) % 2]
        # The middle of the feet goes ahead by one step, and the swinging foot lands at its own side of it.
        pose = pose_after(pose, *(share * full_step))
        landing = pose_after(pose, left=start[swinging][1])
        # Before the first step the weight is on the standing foot already.
        delay = transfer_time if number else 0.0
        step = Phase(
            duration=gait.step_time,
            zmp=zmp_under(standing),
            transfer=delay,
            swing={swinging: landing},
            lift=gait.lift,
            delay=delay,
            heading=pose[2],
        )
        phases.append(step)
        footholds[swinging] = landing
    # The last step has brought the feet side by side: now the weight goes to both of them.
    middle = pose_after(pose, gait.zmp_ahead)[:2]
    phases.append(Phase(duration=gait.settle, zmp=middle, transfer=gait.settle, heading=pose[2]))
    # A phase without duration is an error.
    if gait.rest > 0:
        phases.append(Phase(duration=gait.rest, zmp=middle, transfer=0.0, heading=pose[2]))
    return phases


def _check(robot: str, steps: int, gait: BipedWalk, feet: dict[str, Foot]) -> None:
    """Check the parameters of a walk.

    Args:
        robot: name of the robot, for the message.
        steps: count of full steps.
        gait: parameters of the walk.
        feet: the feet of the robot by name.

    Raises:
        InvalidParameter: the count of steps is less than 1, no part of a step is on one foot, or the walk turns or goes
            sideways on legs that cannot.
    """
    check_steps(steps)
    if not gait.double_support < 1:
        raise InvalidParameter(
            "double_support",
            gait.double_support,
            message("programs.part_of_step", "a part of the step, less than 1"),
        )
    # Such a leg keeps its sole flat only as long as the foot moves straight ahead, see the module `legs`.
    has_leg_without_yaw = any(len(foot.axes) == _AXES_WITHOUT_YAW for foot in feet.values())
    if has_leg_without_yaw and (gait.turn_deg or gait.sideways):
        expected = message(
            "programs.legs_cannot_turn",
            "0, because the legs of {robot} can neither turn nor roll their feet",
            robot=robot,
        )
        raise InvalidParameter("turn_deg, sideways", (gait.turn_deg, gait.sideways), expected)


class _Roles(NamedTuple):
    """The foot that kicks and the foot that stands."""

    kicking: Foot
    standing: Foot


class Kick(SolvedGait):
    """A kick on two legs."""

    section: ClassVar[str] = "kicks"
    usual: ClassVar[str] = "kick"

    foot: str | None = None
    """Name of the foot that kicks. If it is not set, the foot that has the ball most straight ahead, or the right foot
    without a ball."""
    speed: Positive = 0.6
    """Speed of the foot's tip at the point that it hits [m/s]."""
    point: tuple[Number, Number] | None = None
    """Point that the tip goes through: ahead and to the left of the middle of the feet [m]. If it is not set, in front
    of the foot."""
    toward_deg: Number = 0.0
    """Direction of the kick, counterclockwise from ahead [deg]."""
    swing: Positive = 0.08
    """Distance over which the foot speeds up before the hit, and over which it slows down after the hit [m]."""
    lift: Positive = 0.03
    """Height of the sole during the kick [m]."""
    zmp_inward: Number = 0.0
    """Distance of the zero-moment point from the middle of the standing foot towards the other foot [m]."""
    zmp_ahead: Number = 0.0
    """Distance of the zero-moment point ahead of the middle of the standing foot [m]."""
    settle: Pace = 1.0
    """Time of each of the two weight transfers: to one foot before the kick, and to both feet after it [s]."""
    raising: Pace = 0.6
    """Time to raise the foot and bring it back, and again to lower it after the kick [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Plan the kick, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: not used.
            amplitude: not used.
        """
        feet = self._check_feet(walker)
        roles = self._assign_roles(feet)
        start = {foot.name: self._start_foothold(foot) for foot in feet.values()}
        standing_zmp = np.array([self.zmp_ahead, -roles.standing.side * self.zmp_inward])
        over_standing = start[roles.standing.name][:2] + standing_zmp
        between_feet = np.array([self.zmp_ahead, 0.0])
        # Three phases: the weight goes to the standing foot, the other foot kicks, and the weight goes to both feet.
        times = self._knot_times()
        phases = [
            Phase(duration=self.settle, zmp=over_standing, transfer=self.settle),
            Phase(duration=times[-1], zmp=over_standing, transfer=0.0),
            Phase(duration=self.settle + self.rest, zmp=between_feet, transfer=self.settle),
        ]
        plan = gait_plan(start, between_feet, phases)
        # No phase swings the kicking foot; its path (x, y, height, turn) replaces the one on which it stands. The kick
        # is the second phase: its times count from the end of the first.
        path = BPoly.from_derivatives(times, self._knots(roles.kicking))
        kick_times = np.clip(plan.times - self.settle, 0.0, times[-1])
        paths = {**plan.feet, roles.kicking.name: path(kick_times)}
        return WholeBody(walker, self, replace(plan, feet=paths)).solve()[0]

    def aim(
        self,
        walker: Walker,
        root: Vector,
        angles: Vector,
        *,
        ball: Vector,
        radius: float,
        toward: Vector | None,
    ) -> dict[str, Any]:
        """Compute the parameters with which the kick hits a ball in its middle.

        Args:
            walker: the robot.
            root: pose of its root link in the world, shape (4, 4).
            angles: angles of its n axes now, shape (n,) [rad].
            ball: horizontal position of the ball in the world, shape (2,) [m].
            radius: radius of the ball [m].
            toward: position in the world towards which the ball is kicked, shape (2,) [m]. If it is None, the ball goes
                where the standing foot looks.

        Returns:
            Values of the parameters `foot`, `toward_deg` and `point`, and of `lift` if the ball is so large that
            the foot has to be raised to its middle.
        """
        feet = self._check_feet(walker)
        poses = {
            name: foot.poses(angles[np.newaxis], root[np.newaxis])[0] for name, foot in feet.items()
        }
        # The foot that has the ball most straight ahead kicks, unless the gait names one: the distance of the ball to
        # the left or right of each foot decides [m].
        sideways = {name: abs(_seen_from(pose, ball)[1]) for name, pose in poses.items()}
        nearest = min(feet, key=lambda name: sideways[name])
        roles = self._assign_roles(feet, nearest)

        # The plan begins with the standing foot at its home, turned ahead: the ball is seen from there.
        standing_pose = poses[roles.standing.name]
        position = _seen_from(standing_pose, ball)
        direction = np.array([1.0, 0.0])
        if toward is not None:
            direction = _seen_from(standing_pose, toward) - position
        turn = float(np.arctan2(direction[1], direction[0]))
        # The tip hits the ball's surface opposite to the direction in which the ball is kicked.
        ball_in_plan = position + self._start_foothold(roles.standing)[:2]
        point = ball_in_plan - radius * np.array([np.cos(turn), np.sin(turn)])
        aim = {
            "foot": roles.kicking.name,
            "toward_deg": float(np.rad2deg(turn)),
            "point": point.tolist(),
        }
        # The middle of the foot is `over` above its sole. A higher ball is hit in its middle if the sole is lifted.
        if radius > roles.kicking.over:
            aim["lift"] = radius - roles.kicking.over
        return aim

    def _check_feet(self, walker: Walker) -> dict[str, Foot]:
        """Find the two feet of the robot by name, and check that they can do the kick.

        Raises:
            InvalidParameter: the robot has other feet, or the kick is to the side and the legs cannot turn their feet.
            UnknownName: the robot has no feet of the kind that the gait names, or no foot with the name of the kicking
                foot.
        """
        feet = walker.feet_by_name(
            FEET, self.feet, message("programs.two_feet_to_kick", "two feet for a kick")
        )
        if self.foot is not None and self.foot not in feet:
            raise UnknownName(
                message("programs.foot_of", "foot of {model}", model=walker.model.name),
                self.foot,
                feet,
            )
        # A kick to the side turns the foot about the vertical, for which a leg needs a yaw axis.
        can_turn = all(len(foot.axes) >= _ALL_AXES for foot in feet.values())
        if self.toward_deg and not can_turn:
            expected = message(
                "programs.legs_cannot_turn_feet",
                "0, because the legs of {model} cannot turn their feet",
                model=walker.model.name,
            )
            raise InvalidParameter("toward_deg", self.toward_deg, expected)
        return feet

    def _assign_roles(self, feet: dict[str, Foot], nearest: str = FEET[0]) -> _Roles:
        """Determine which foot kicks and which one stands.

        Args:
            feet: the two feet by name.
            nearest: name of the foot that kicks unless the gait names one.
        """
        kicking = self.foot or nearest
        (standing,) = (foot for name, foot in feet.items() if name != kicking)
        return _Roles(feet[kicking], standing)

    def _start_foothold(self, foot: Foot) -> Vector:
        """Foothold before and after the kick: x [m], y [m] and turn [rad], shape (3,)."""
        return np.array([0.0, foot.home[1] + foot.side * self.widen, 0.0])

    def _knot_times(self) -> Vector:
        """Times of the knots of the kicking foot's path since its lift-off, shape (5,) [s]; see :meth:`_knots`."""
        # T of the module: time of the swing before the hit, and again of that after it.
        stroke = 2.0 * self.swing / self.speed
        # From lift-off to back, hit, front and touchdown.
        return np.cumsum([0.0, self.raising, stroke, stroke, self.raising])

    def _knots(self, foot: Foot) -> list[Vector]:
        """Compute the knots of the kicking foot's path: lift-off, back, hit, front, touchdown.

        Returns:
            For each of the 5 knots position, velocity and acceleration (rows) of x, y, height [m] and turn [rad]
            (columns), shape (3, 4). From back to hit the polynomial of degree five then has the speed of the module's
            equation, and from hit to front the same in reverse. Before and after, the foot moves from rest to rest.
        """
        turn = np.deg2rad(self.toward_deg)
        home = self._start_foothold(foot)
        # Pose of the foot when it hits. Without a point it swings from its foothold, so that it hits one swing ahead.
        direction = np.array([np.cos(turn), np.sin(turn), 0.0, 0.0])
        hit = np.array([*home[:2], self.lift, turn]) + self.swing * direction
        if self.point is not None:
            # The tip is half the foot's length ahead of its middle.
            hit[:2] = self.point - foot.half[0] * direction[:2]
        positions = np.zeros((5, 4))
        positions[[0, 4]] = [*home[:2], 0.0, home[2]]  # lift-off and touchdown are at the foothold
        positions[1:4] = hit + np.outer([-self.swing, 0.0, self.swing], direction)
        # The foot moves in the middle knot only. The acceleration is zero in all knots, so that it has no jumps.
        velocities = np.zeros((5, 4))
        velocities[2] = self.speed * direction
        accelerations = np.zeros((5, 4))
        return list(np.stack([positions, velocities, accelerations], axis=1))


def _seen_from(foot_pose: Vector, position: Vector) -> Vector:
    """Compute a horizontal position in the frame of a foot: ahead and to the left, shape (2,) [m].

    Args:
        foot_pose: pose of the foot in the world, shape (4, 4).
        position: the position in the world, shape (2,) [m].
    """
    # The foot may be tilted: only the horizontal part of its x axis counts.
    ahead = foot_pose[:2, 0] / np.linalg.norm(foot_pose[:2, 0])
    to_foot = np.array([[ahead[0], ahead[1]], [-ahead[1], ahead[0]]])
    return to_foot @ (position - foot_pose[:2, 3])
