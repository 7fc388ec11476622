"""A move that is planned, and whether a robot can do it: joint limits, speeds, accelerations, collisions."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from simrob_drake.arguments import instance
from simrob_drake.errors import shortened
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.errors import (
    AccelerationLimitExceeded,
    JointLimitExceeded,
    PathCollision,
    SpeedLimitExceeded,
)
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.segments import Stretch, named_point, trajectory
from simrob_drake.stations.collisions import Bodies

Check = Literal["nothing", "limits", "collision"]
"""What is looked at before a move beside its reach: joint limits, speeds and accelerations, or these and collisions;
None, as ``limits``, leaves collisions out."""
CHECKED: Check = "collision"  # what is looked at unless told
_LOOKS = 4  # a point


@dataclass(frozen=True)
class Plan:
    """A move of one robot, ready to be run.

    Attributes:
        robot: whose move it is.
        stretches: the motions from rest to rest that it is made of, one after the other, the first from time 0.
        arrivals: when each target is reached, shape (k,) [s].
        points: on the way to each target.
        check: what was looked at; collisions are again with the moves that are run at the same time.
        entry: what a program's file has of it; None if no file can say it.
        frame: where the work object was when the move was planned; None without one.
        search: ways of the tool that a search tried, for the recording, shape (k, 2, 3) [m].
    """

    robot: str
    stretches: tuple[Stretch, ...]
    arrivals: Vector
    points: int
    check: Check = CHECKED
    entry: Mapping[str, Any] | None = None
    frame: RigidTransform | None = None
    search: Vector = field(default_factory=lambda: np.zeros((0, 2, 3)))

    def __repr__(self) -> str:
        times, end = (" ".join(f"{value:.4g}" for value in values) for values in (self.arrivals, self.end))
        return shortened(f"<Plan of {self.robot}: to [{end}], targets at {times} s>", 200)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Of its axes, shape (n, 1), from 0 to the duration."""
        return trajectory(self.stretches)

    @property
    def duration(self) -> float:
        """Of the whole move [s]."""
        return float(self.arrivals[-1])

    @property
    def start(self) -> Vector:
        """Where it begins, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[0].postures[0])

    @property
    def end(self) -> Vector:
        """Where it leads, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[-1].postures[-1])

    @property
    def looks(self) -> Vector:
        """Times at which it is looked at, shape (k,) [s]: evenly, and where its polynomials meet."""
        even = np.linspace(0.0, self.duration, _LOOKS * max(self.points * len(self.arrivals), 10) + 1)
        return np.union1d(even, np.concatenate([stretch.times for stretch in self.stretches]))

    def of_axes(self, robot: str, axes: slice) -> "Plan":
        """Return the motion of some axes, those of one of several robots that move together."""
        return replace(self, robot=robot, stretches=tuple(stretch.of_axes(axes) for stretch in self.stretches))

    def postures(self, times: Vector) -> Vector:
        """Return the postures (m, n) at times (m,) [s]."""
        return np.asarray(self.trajectory.vector_values(times.tolist())).T

    def motion(self, times: Vector) -> tuple[Vector, Vector, Vector]:
        """Return positions, velocities and accelerations at times (m,) [s], (m, n) each, as dynamics take them."""
        orders = [self.trajectory, self.trajectory.MakeDerivative(1), self.trajectory.MakeDerivative(2)]
        positions, velocities, accelerations = (np.array(order.vector_values(times.tolist())).T for order in orders)
        return positions, velocities, accelerations

    def named(self, time: float) -> tuple[int, str]:
        """Return the number of the point that a time [s] belongs to, counted from 1, and its name."""
        index = min(int(np.searchsorted(self.arrivals, time - 1e-9)), len(self.arrivals) - 1)
        begin = self.arrivals[index - 1] if index else 0.0
        part = (time - begin) / (self.arrivals[index] - begin)
        return named_point(part, self.points, target_name(index, len(self.arrivals)))


def target_name(index: int, count: int) -> str:
    """Return what messages call a target."""
    return f"targets[{index}]" if count > 1 else "the target"


Naming = Callable[[float], tuple[int, str]]  # from a time [s] of a move to the number of its point and the point's name
Remedy = Callable[[float, float], str]
"""From how many times slower a move can be done, and in what time [s], to what its user may do about it."""
_ROUNDING = 1e-9  # rad or m
_MARGIN = 1.02  # of what messages propose


def check_limits(chain: Chain, times: Vector, postures: Vector, named: Naming, hint: str = "") -> None:
    """Check that all axes stay within their limits.

    Args:
        chain: the arm.
        times: times of the postures, shape (k,) [s].
        postures: positions of the axes, shape (k, n) [rad or m].
        named: gives the number and the name of the point that a time belongs to.
        hint: text that is appended to the message.

    Raises:
        JointLimitExceeded: names the first point, the axis, its position and its limits.
    """
    violation = chain.limits.find_violation(postures)
    if violation is None:
        return
    time = float(times[violation.row])
    number, name = named(time)
    value = float(postures[violation.row, violation.axis])
    text = f"{violation.value} {violation.unit}, beyond its limits of {violation.limits}{hint}"
    raise JointLimitExceeded(name, chain.names[violation.axis], point=number, time=time, value=value, shown=text)


def rate_ratio(trajectory: Trajectory, times: Vector, limits: Vector, order: int) -> float:
    """Return the largest ratio of a joint's speed (order 1) or acceleration (2) to its limit (n,); up to 1 it can."""
    return float((_rates(trajectory, times, order) / limits).max())


def check_rates(
    chain: Chain, trajectory: Trajectory, times: Vector, limits: Vector, order: int, named: Naming, remedy: Remedy
) -> None:
    """Check that no axis is faster than its limit (order 1), or sped up more (2), at times (k,) [s].

    Limits are (n,) [rad/s or m/s, rad/s² or m/s²]. Raises SpeedLimitExceeded, AccelerationLimitExceeded: names the
    first offending point, and what would do, a ``remedy`` included.
    """
    rates = _rates(trajectory, times, order)
    ratios = rates / limits
    if ratios.max() <= 1 + _ROUNDING:
        return
    row = int(np.argmax((ratios > 1 + _ROUNDING).any(axis=1)))
    axis = int(np.argmax(ratios[row]))
    number, name = named(float(times[row]))
    revolute, slower = bool(chain.revolute[axis]), _MARGIN * float(ratios.max()) ** (1 / order)
    unit = "/s²" if order == 2 else "/s"
    limit = f"beyond its limit of {shown(limits[axis], revolute)}{unit}"
    kind = AccelerationLimitExceeded if order == 2 else SpeedLimitExceeded
    raise kind(
        name,
        chain.names[axis],
        point=number,
        time=float(times[row]),
        rate=float(rates[row, axis]),
        duration=slower * float(times[-1]),
        shown=f"{shown(rates[row, axis], revolute)}{unit}, {limit}; {remedy(slower, slower * times[-1])}",
    )


def check_tool_speed(chain: Chain, plan: Plan, limit: float, remedy: Remedy) -> None:
    """Check that the tool centre point is no faster than a limit [m/s]; raises SpeedLimitExceeded, as above."""
    times = plan.looks
    postures, rates, _ = plan.motion(times)
    speeds = np.linalg.norm(np.einsum("kin,kn->ki", chain.jacobian(postures)[:, :3], rates), axis=1)
    row, slower = int(speeds.argmax()), _MARGIN * float(speeds.max()) / limit
    if slower <= _MARGIN * (1 + _ROUNDING):
        return
    number, name = plan.named(float(times[row]))
    duration = slower * float(times[-1])
    beyond = f"{speeds[row]:.3g} m/s, beyond the {limit:g} m/s that it is rated for; {remedy(slower, duration)}"
    raise SpeedLimitExceeded(
        name, "the tool", point=number, time=float(times[row]), rate=float(speeds[row]), duration=duration, shown=beyond
    )


def _rates(trajectory: Trajectory, times: Vector, order: int) -> Vector:
    rates: Vector = np.abs(np.asarray(trajectory.MakeDerivative(order).vector_values(times.tolist())).T)
    return rates


def shown(value: float, revolute: bool) -> str:
    """Return a position or speed of an axis as messages show it: in degrees or metres."""
    return f"{np.rad2deg(value):.1f} deg" if revolute else f"{value:.3f} m"


def check_collisions(
    model: StationModel,
    robots: Mapping[str, Vector],
    times: Vector,
    named: Naming,
    *,
    judged: Collection[str] | None = None,
) -> None:
    """Check that robots do not collide during a motion, by the station's collision policy.

    Two bodies that touch at the first time may stay as deep, such as a piece on its table.
    Two bodies of different owners that overlap deeply at the first time are not checked
    against each other, see :meth:`CollisionPolicy.allowed_from_start`.

    Args:
        model: the station with collision shapes. Robots that do not move stay as they are in
            this model.
        robots: postures (k, n) [rad or m] of each robot that moves, by name.
        times: times of the postures, shape (k,) [s].
        named: gives the number and the name of the point that a time belongs to.
        judged: names of the robots whose collisions count. If it is None, the collisions of
            all robots that move count.

    Raises:
        PathCollision: names the first point with a collision, and the two bodies.
    """
    movers = robots if judged is None else judged
    depths_at_start: dict[Bodies, float] = {}
    for index, time in enumerate(times):
        model.place_robots({name: postures[index] for name, postures in robots.items()})
        if index == 0:
            depths_at_start = model.policy.allowed_from_start(movers)
            continue
        overlaps = model.policy.overlaps(movers, depths_at_start)
        if overlaps:
            deepest = overlaps[0]
            number, name = named(float(time))
            raise PathCollision(
                name,
                point=number,
                time=float(time),
                bodies=deepest.moved,
                depth=deepest.depth,
            )


def check_moves(model: StationModel, plans: Sequence[Plan]) -> None:
    """Check that moves that run at the same time do not collide with anything, nor with each other.

    A robot whose plan does not have `check="collision"` moves too. Its own collisions do not
    count; others may still collide with it.

    Raises:
        PathCollision: names the first collision, by the point of the longest move.
    """
    for plan in plans:
        instance(plan, "plan", Plan, "made by arm.plan, such as arm.plan.move_l(...)")
    longest = max(plans, key=lambda plan: plan.duration)
    times = np.unique(np.concatenate([plan.looks for plan in plans]))
    # A robot whose move ends earlier stays at its end.
    postures = {plan.robot: plan.postures(np.minimum(times, plan.duration)) for plan in plans}
    judged = [plan.robot for plan in plans if plan.check == "collision"]
    check_collisions(model, postures, times, longest.named, judged=judged)
