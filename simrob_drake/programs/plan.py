"""A move that is planned, and whether a robot can do it: joint limits, speeds, accelerations, collisions.

A move leads to one target or past several. On the way to each target it has numbered points, by which error messages
name a part of the move, such as "point 3 of 30 on the way to targets[1]". A *rate* is a speed or an acceleration of an
axis.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import shorten
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.errors import (
    AccelerationLimitExceeded,
    JointLimitExceeded,
    PathCollision,
    SpeedLimitExceeded,
)
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.segments import PathPoint, Stretch, named_point, trajectory
from simrob_drake.stations.collisions import Bodies

Check = Literal["nothing", "limits", "collision"]
"""What is checked before a move, in addition to its reach: nothing, joint limits with speeds and accelerations, or
these and collisions. Where a user may give None, it means ``limits``."""
CHECKED: Check = "collision"  # the default
_LOOKS_PER_POINT = 4  # count of times at which a plan is checked, for each of its points
_LEAST_POINTS = 10  # a plan is checked as if it had at least this count of points


class PlannedMotion(NamedTuple):
    """Motion of n axes at m times.

    Attributes:
        positions: positions, shape (m, n) [rad or m].
        velocities: velocities, shape (m, n) [rad/s or m/s].
        accelerations: accelerations, shape (m, n) [rad/s² or m/s²].
    """

    positions: Vector
    velocities: Vector
    accelerations: Vector


@dataclass(frozen=True)
class Plan:
    """A move of one robot, ready to be run.

    Attributes:
        robot: name of the robot.
        stretches: the motions from rest to rest that the move consists of, one after the other, the first from time 0.
        arrivals: times at which the targets are reached, shape (k,) [s].
        points: count of points on the way to each target.
        check: what was checked. Collisions are checked again with the moves that are run at the same time.
        entry: keys and values of the move in a program's file; None if no file can describe it.
        written_as: key under which the user wrote the move, if that is not the key of the entry; empty otherwise.
        frame: pose of the work object in the world when the move was planned; None without a work object.
        search: pieces of paths of the tool that a search tried, for the recording: start and end of each piece in the
            world, shape (k, 2, 3) [m].
    """

    robot: str
    stretches: tuple[Stretch, ...]
    arrivals: Vector
    points: int
    check: Check = CHECKED
    entry: Mapping[str, Any] | None = None
    written_as: str = ""
    frame: RigidTransform | None = None
    search: Vector = field(default_factory=lambda: np.zeros((0, 2, 3)))

    @property
    def kind(self) -> str:
        """Name of the move for users: the key under which it is written. Empty if no file can describe the move."""
        return self.written_as or next(iter(self.entry or ()), "")

    def __repr__(self) -> str:
        times = " ".join(f"{time:.4g}" for time in self.arrivals)
        end = " ".join(f"{position:.4g}" for position in self.end)
        return shorten(f"<Plan of {self.robot}: to [{end}], targets at {times} s>", 200)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Positions of the axes as a function of time, shape (n, 1), from 0 to the duration."""
        return trajectory(self.stretches)

    @property
    def duration(self) -> float:
        """Duration of the whole move [s]."""
        return float(self.arrivals[-1])

    @property
    def start(self) -> Vector:
        """Posture at the start of the move, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[0].postures[0])

    @property
    def end(self) -> Vector:
        """Posture at the end of the move, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[-1].postures[-1])

    @property
    def looks(self) -> Vector:
        """Times at which the plan is checked, shape (k,) [s]: evenly spaced, and where two polynomials meet."""
        # Points that the user sees may be few: a plan is checked at more times, so that no peak is missed.
        point_count = max(self.points * len(self.arrivals), _LEAST_POINTS)
        even_times = np.linspace(0.0, self.duration, _LOOKS_PER_POINT * point_count + 1)
        # Accelerations can be largest where two polynomials meet.
        knots = np.concatenate([stretch.times for stretch in self.stretches])
        return np.union1d(even_times, knots)

    def of_axes(self, robot: str, axes: slice) -> "Plan":
        """Plan of one of several robots that move together: the motion of its axes.

        Args:
            robot: name of the robot.
            axes: indices of the robot's axes among the axes of this plan.
        """
        return replace(
            self, robot=robot, stretches=tuple(stretch.of_axes(axes) for stretch in self.stretches)
        )

    def postures(self, times: Vector) -> Vector:
        """Postures (m, n) at times (m,) [s]."""
        return np.asarray(self.trajectory.vector_values(times.tolist())).T

    def motion(self, times: Vector) -> PlannedMotion:
        """Positions, velocities and accelerations at times (m,) [s], as methods of the dynamics take them."""
        velocity = self.trajectory.MakeDerivative(1)
        acceleration = self.trajectory.MakeDerivative(2)
        # Drake's vector_values takes a list.
        samples = times.tolist()
        return PlannedMotion(
            positions=np.array(self.trajectory.vector_values(samples)).T,
            velocities=np.array(velocity.vector_values(samples)).T,
            accelerations=np.array(acceleration.vector_values(samples)).T,
        )

    def point_at(self, time: float) -> PathPoint:
        """Point that a time [s] of the move belongs to: the next point on the way to the target, with its name."""
        # The time of an arrival belongs to its target, not to the next one, in spite of rounding.
        index = min(int(np.searchsorted(self.arrivals, time - 1e-9)), len(self.arrivals) - 1)
        departure = self.arrivals[index - 1] if index else 0.0  # from the target before [s]
        fraction = (time - departure) / (self.arrivals[index] - departure)
        return named_point(fraction, self.points, target_name(index, len(self.arrivals)))


def target_name(index: int, count: int) -> str:
    """Name of the target with an index among `count` targets, for messages."""
    return f"targets[{index}]" if count > 1 else message("programs.the_target", "the target")


PointNaming = Callable[[float], PathPoint]
"""Gives the point that a time [s] of a move belongs to."""
Remedy = Callable[[float, float], str]
"""Writes the advice for a move that is too fast. Its arguments: the factor on the duration with which the robot can do
the move, and that duration [s]."""
_ROUNDING = 1e-9  # relative excess of a limit that is due to rounding
MARGIN = 1.02  # margin of the durations that messages propose, or that are taken


def check_limits(
    chain: Chain, times: Vector, postures: Vector, naming: PointNaming, hint: str = ""
) -> None:
    """Check that all axes stay within their limits.

    Args:
        chain: the arm.
        times: times of the postures, shape (k,) [s].
        postures: positions of the axes, shape (k, n) [rad or m].
        naming: gives the point that a time belongs to, for the message.
        hint: text that is appended to the message.

    Raises:
        JointLimitExceeded: names the first point, the axis, its position and its limits.
    """
    # The first posture beyond a limit, with texts for the message in degrees or metres.
    violation = chain.limits.find_violation(postures)
    if violation is None:
        return
    time = float(times[violation.row])
    point = naming(time)
    raise JointLimitExceeded(
        point.name,
        chain.names[violation.axis],
        point=point.number,
        time=time,
        value=float(postures[violation.row, violation.axis]),
        shown=message(
            "programs.position_beyond_limits",
            "{position} {unit}, beyond its limits of {limits}{hint}",
            position=violation.value,
            unit=violation.unit,
            limits=violation.limits,
            hint=hint,
        ),
    )


def rate_ratio(trajectory: Trajectory, times: Vector, limits: Vector, order: int) -> float:
    """Largest ratio of an axis's speed or acceleration to its limit; the motion is possible up to a ratio of 1.

    Args:
        trajectory: positions of the axes, shape (n, 1) [rad or m].
        times: times at which the motion is checked, shape (k,) [s].
        limits: limits of the axes, shape (n,) [rad/s or m/s, rad/s² or m/s²].
        order: order of the derivative: 1 for speeds, 2 for accelerations.
    """
    return float((_rates(trajectory, times, order) / limits).max())


def check_rates(
    chain: Chain,
    trajectory: Trajectory,
    times: Vector,
    limits: Vector,
    order: int,
    naming: PointNaming,
    remedy: Remedy,
) -> None:
    """Check that all axes stay within their limits of speed or acceleration.

    Args:
        chain: the arm.
        trajectory: positions of the axes, shape (n, 1) [rad or m].
        times: times at which the motion is checked, shape (k,) [s].
        limits: limits of the axes, shape (n,) [rad/s or m/s, rad/s² or m/s²].
        order: order of the derivative: 1 for speeds, 2 for accelerations.
        naming: gives the point that a time belongs to, for the message.
        remedy: writes the advice for a slower move, from the factor on the duration and the new duration [s].

    Raises:
        SpeedLimitExceeded, AccelerationLimitExceeded: names the first point beyond a limit, and gives the advice.
    """
    rates = _rates(trajectory, times, order)
    ratios = rates / limits
    is_beyond = ratios > 1 + _ROUNDING
    if not is_beyond.any():
        return
    # The message names the first point, but its advice follows from the largest excess of the whole move.
    row = int(np.argmax(is_beyond.any(axis=1)))  # the first time with an axis beyond its limit
    axis = int(np.argmax(ratios[row]))
    time = float(times[row])
    point = naming(time)
    # In k times the duration, speeds are k times smaller and accelerations k² times.
    factor = MARGIN * float(ratios.max()) ** (1 / order)
    duration = factor * float(times[-1])
    is_revolute = bool(chain.revolute[axis])
    per_second = "/s²" if order == 2 else "/s"
    rate = f"{axis_text(rates[row, axis], is_revolute)}{per_second}"
    limit = f"{axis_text(limits[axis], is_revolute)}{per_second}"
    error_class = AccelerationLimitExceeded if order == 2 else SpeedLimitExceeded
    raise error_class(
        point.name,
        chain.names[axis],
        point=point.number,
        time=time,
        rate=float(rates[row, axis]),
        duration=duration,
        shown=message(
            "programs.rate_beyond_limit",
            "{rate}, beyond its limit of {limit}; {remedy}",
            rate=rate,
            limit=limit,
            remedy=remedy(factor, duration),
        ),
    )


def check_tool_speed(chain: Chain, plan: Plan, limit: float, remedy: Remedy) -> None:
    """Check that the tool centre point is no faster than a limit.

    Args:
        chain: the arm.
        plan: the plan of the arm's move.
        limit: largest speed of the tool centre point [m/s].
        remedy: writes the advice for a slower move, from the factor on the duration and the new duration [s].

    Raises:
        SpeedLimitExceeded: names the point of the largest speed, and gives the advice.
    """
    times = plan.looks
    motion = plan.motion(times)
    jacobians = chain.jacobian(motion.positions)[:, :3]  # the rows of the translation
    # For each time k, the product of the Jacobian (3, n) and the velocities of the n axes.
    velocities = np.einsum("kin,kn->ki", jacobians, motion.velocities)
    speeds = np.linalg.norm(velocities, axis=1)
    row = int(speeds.argmax())
    # Factor on the duration with which the move is possible, with the margin of advices.
    factor = MARGIN * float(speeds.max()) / limit
    # The same as: the largest speed is at most the limit, up to rounding.
    if factor <= MARGIN * (1 + _ROUNDING):
        return
    time = float(times[row])
    point = plan.point_at(time)
    duration = factor * float(times[-1])
    speed = message(
        "programs.tool_speed",
        "{speed:.3g} m/s, beyond its rated speed of {limit:g} m/s",
        speed=speeds[row],
        limit=limit,
    )
    raise SpeedLimitExceeded(
        point.name,
        message("programs.the_tool", "the tool"),
        point=point.number,
        time=time,
        rate=float(speeds[row]),
        duration=duration,
        shown=compound("{speed}; {remedy}", speed=speed, remedy=remedy(factor, duration)),
    )


def _rates(trajectory: Trajectory, times: Vector, order: int) -> Vector:
    """Absolute values of the derivative of a trajectory at k times, shape (k, n).

    Args:
        trajectory: positions of the axes, shape (n, 1) [rad or m].
        times: the times, shape (k,) [s].
        order: order of the derivative: 1 for speeds, 2 for accelerations.
    """
    derivative = trajectory.MakeDerivative(order)
    rates: Vector = np.abs(np.asarray(derivative.vector_values(times.tolist())).T)
    return rates


def axis_text(value: float, is_revolute: bool) -> str:
    """Position of an axis [rad or m] as messages show it: in degrees for a revolute axis, otherwise in metres."""
    return (
        message("programs.degrees", "{degrees:.1f} deg", degrees=np.rad2deg(value))
        if is_revolute
        else compound("{value:.3f} m", value=value)
    )


def check_collisions(
    model: StationModel,
    robots: Mapping[str, Vector],
    times: Vector,
    naming: PointNaming,
    *,
    judged: Collection[str] | None = None,
) -> None:
    """Check that robots do not collide during a motion, by the station's collision policy.

    The robots of the model are left in their postures at the last time that was checked.

    Two bodies that touch at the first time may stay as deep, such as a piece on its table.
    Two bodies of different owners that overlap deeply at the first time are not checked
    against each other, see :meth:`CollisionPolicy.allowed_from_start`.

    Args:
        model: the station with collision shapes. Robots that do not move stay as they are in
            this model.
        robots: postures (k, n) [rad or m] of each robot that moves, by name.
        times: times of the postures, shape (k,) [s].
        naming: gives the point that a time belongs to, for the message.
        judged: names of the robots whose collisions count, with each other and with everything else. If it is None,
            the collisions of all robots that move count.

    Raises:
        PathCollision: names the first point with a collision, and the two bodies that overlap deepest there.
    """
    movers = robots if judged is None else judged
    depths_at_start: dict[Bodies, float] = {}
    for index, time in enumerate(times):
        model.place_robots({name: postures[index] for name, postures in robots.items()})
        # The start itself is not judged: it only shows what touches already.
        if index == 0:
            depths_at_start = model.policy.allowed_from_start(movers)
            continue
        overlaps = model.policy.overlaps(movers, depths_at_start)
        # The deepest overlap comes first: it names the two bodies that matter.
        if overlaps:
            deepest = overlaps[0]
            point = naming(float(time))
            raise PathCollision(
                point.name,
                point=point.number,
                time=float(time),
                bodies=deepest.moved,
                depth=deepest.depth,
            )


def check_moves(model: StationModel, plans: Sequence[Plan]) -> None:
    """Check that moves that run at the same time do not collide with anything, nor with each other.

    A robot whose plan does not have `check="collision"` moves too. Its own collisions do not
    count; others may still collide with it.

    Args:
        model: the station with collision shapes.
        plans: the plans, at least one, each of another robot. Other robots stay as they are in the model.

    Raises:
        InvalidParameter: a value is no plan.
        PathCollision: names the first collision, by the point of the longest move.
    """
    for plan in plans:
        instance(
            plan,
            "plan",
            Plan,
            message("programs.a_plan", "a plan, such as that of arm.plan.move_l(...)"),
        )
    # Messages name the point of the longest move, which is still under way at any time.
    longest = max(plans, key=lambda plan: plan.duration)
    times = np.unique(np.concatenate([plan.looks for plan in plans]))
    # A robot whose move ends earlier stays at its end.
    postures = {plan.robot: plan.postures(np.minimum(times, plan.duration)) for plan in plans}
    judged = [plan.robot for plan in plans if plan.check == "collision"]
    check_collisions(model, postures, times, longest.point_at, judged=judged)
