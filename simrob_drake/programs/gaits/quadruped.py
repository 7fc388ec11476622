"""Gaits on four legs: the trot, the crawl, and standing on three feet.

All of them plan footholds and the zero-moment point (ZMP) in the frame of :mod:`~simrob_drake.programs.gaits.phases`:
x ahead, y to the left, the origin in the middle of the feet at the start. A foothold is a vector (3,): x [m], y [m] and
the foot's turn to the left [rad]. The trunk goes where the ZMP is planned.
"""

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Number, Positive
from simrob_drake.programs.gaits.motion import EvenSteps, JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import (
    Phase,
    check_steps,
    gait_plan,
    pose_after,
    ramp_shares,
)
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.robots.catalog import RobotModel

PAIRS = (("front_left_foot", "rear_right_foot"), ("front_right_foot", "rear_left_foot"))
"""Pairs of feet that a trot swings at the same time."""
CRAWL_ORDER = ("rear_left_foot", "front_left_foot", "rear_right_foot", "front_right_foot")
"""Order in which a crawl swings the feet.

Each hind foot swings before the fore foot of its side: so three feet always stand around the trunk.
"""

# Times of standing on three feet [s]: before the weight is shifted, to shift it, and to raise or lower the foot.
_BEFORE = 0.5
_SHIFT = 1.0
_RAISE = 0.6

# Candidates of `nearest_inside` are computed on the sides themselves: rounding errors may put them outside [m].
_INSIDE_TOLERANCE = 1e-9


class Trot(EvenSteps, SolvedGait):
    """A gait on four legs that swings diagonal pairs of feet in turn."""

    section: ClassVar[str] = "trots"
    usual: ClassVar[str] = "trot"

    ramp_steps: Integer = Field(default=4, ge=0)
    """Count of steps at the start in which the step length grows. At the end it shrinks in as many steps."""
    lift: Positive = 0.05
    """Largest height of the swinging feet [m]."""
    lead: Number = 0.0
    """Distance of the trunk ahead of the middle of its feet, as a part of the step [1]."""
    all_stand: Positive = 0.1
    """Part of a step in which all feet stand [1]."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Plan the trot, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: count of full steps, of a pair of feet each.
            amplitude: not used, since the step is scaled by it already.
        """
        check_steps(steps)
        start = _start_footholds(walker, self)
        origin = np.zeros(2)
        # The robot stands first, so that its servos have come to rest before the first feet lift off.
        phases = [Phase(duration=self.settle, zmp=origin, transfer=0.0)]
        pose = np.zeros(3)  # of the middle of the feet: x, y, turn
        full_step = np.array([self.step_length, self.sideways, np.deg2rad(self.turn_deg)])
        # Each share is the length of a step over that of a full one: it grows at the start, shrinks at the end, and is
        # 0 for the last step.
        for number, share in enumerate(ramp_shares(steps, self.ramp_steps)):
            landing = pose_after(pose, *(share * full_step))
            # The trunk goes over the middle between the pair that stands and the pair that lands, and leads it.
            # Two feet support along a line only. This line goes through the middle between both pairs' footholds.
            between = pose_after((pose + landing) / 2, *(share * self.lead * full_step))
            swing = {foot: pose_after(landing, *start[foot][:2]) for foot in PAIRS[number % 2]}
            phases.append(
                Phase(
                    duration=self.step_time,
                    zmp=between[:2],
                    transfer=self.step_time,
                    swing=swing,
                    lift=self.lift,
                    rest=self.all_stand * self.step_time,
                    heading=between[2],
                )
            )
            pose = landing
        phases.append(
            Phase(
                duration=self.settle + self.rest,
                zmp=pose[:2],
                transfer=self.settle,
                heading=pose[2],
            )
        )
        return _motion_of_phases(walker, self, start, phases)


class Crawl(SolvedGait):
    """A gait on four legs that swings one leg at a time."""

    section: ClassVar[str] = "crawls"
    steps: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ("stride",)
    pace: ClassVar[str] = "leg_time"

    inside: Positive = 0.04
    """Least distance of the zero-moment point from the sides of the triangle of the three standing feet [m]."""
    leg_time: Pace
    """Time from the touchdown of one leg to that of the next one [s]."""
    stride: Number = 0.0
    """Distance that each leg swings ahead [m]."""
    lift: Positive = 0.04
    """Largest height of the swinging foot [m]."""
    shift: Positive = 0.6
    """Part of the leg's time in which all feet stand, while the trunk moves over the next three standing feet [1]."""
    settle: Pace = 0.8
    """Time to stand before the first leg and after the last one [s]."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Plan the crawl, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: count of legs that swing, one after the other.
            amplitude: not used, since the stride is scaled by it already.
        """
        check_steps(steps)
        start = _start_footholds(walker, self)
        footholds = {foot: foothold.copy() for foot, foothold in start.items()}
        # Each leg's time has two parts: all feet stand while the trunk moves, then the leg swings.
        shift_time = self.shift * self.leg_time
        phases = [Phase(duration=self.settle, zmp=np.zeros(2), transfer=0.0)]
        for number in range(steps):
            swinging = CRAWL_ORDER[number % 4]
            triangle = np.array([footholds[foot][:2] for foot in footholds if foot != swinging])
            # The trunk moves no further than it has to: to the allowed position that is nearest to the feet's middle.
            over = nearest_inside(_middle_of(footholds), triangle, self.inside)
            landing = pose_after(footholds[swinging], self.stride)
            # The foot lifts off only when the trunk is over the other three: without them the robot would tip over.
            phases.append(
                Phase(
                    duration=self.leg_time,
                    zmp=over,
                    transfer=shift_time,
                    swing={swinging: landing},
                    lift=self.lift,
                    delay=shift_time,
                )
            )
            footholds[swinging] = landing
        # After the last leg the trunk returns to the middle of all four feet, where the robot stands most firmly.
        end = _middle_of(footholds)
        phases.append(Phase(duration=self.settle + self.rest, zmp=end, transfer=self.settle))
        return _motion_of_phases(walker, self, start, phases)


class Stand(SolvedGait):
    """Standing on three of four legs."""

    section: ClassVar[str] = "stands"

    inside: Positive = 0.04
    """Least distance of the zero-moment point from the sides of the triangle of the three standing feet [m]."""
    foot: str
    """Name of the foot that is raised."""
    height: Positive = 0.03
    """Height of the raised foot [m]."""
    seconds: Pace = 5.0
    """Time that the foot stays at this height [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Plan to shift the weight, raise the foot, lower it and shift the weight back; see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: not used.
            amplitude: not used.

        Raises:
            UnknownName: the robot has no foot of this name, or no feet of the kind that the gait names.
            InvalidParameter: the robot has other feet, or no position is as far inside the triangle as `inside`.
            OutOfReach: a leg is too short for the path of its foot, or a joint is beyond a limit.
        """
        start = _start_footholds(walker, self)
        if self.foot not in start:
            what = message("programs.foot_of", "foot of {model}", model=walker.model.name)
            raise UnknownName(what, self.foot, start)
        # The origin of the plan is below the root, in the middle of feet that are evenly placed around it.
        origin = np.zeros(2)
        triangle = np.array([start[foot][:2] for foot in start if foot != self.foot])
        over = nearest_inside(origin, triangle, self.inside)
        raising = Phase(
            duration=self.seconds + 2 * _RAISE,
            zmp=over,
            transfer=0.0,
            # The foot lands where it was: it only goes up and down.
            swing={self.foot: start[self.foot]},
            lift=self.height,
            hold=self.seconds,
        )
        phases = [
            Phase(duration=_BEFORE, zmp=origin, transfer=0.0),
            Phase(duration=_SHIFT, zmp=over, transfer=_SHIFT),
            raising,
            Phase(duration=_SHIFT + self.rest, zmp=origin, transfer=_SHIFT),
        ]
        return _motion_of_phases(walker, self, start, phases)


trot = Trot.plan_by_name
"""Plan a trot; ``ramp_steps`` steps and one that brings the feet under the hips come in addition to the full ones."""


def crawl(
    robot: str | RobotModel | Walker,
    legs: int,
    name: str = "crawl",
    *,
    amplitude: float = 1.0,
    **changes: Any,
) -> JointMotion:
    """Plan a crawl, see :meth:`Gait.plan_by_name`.

    Args:
        robot: name or model of the robot, or a :class:`Walker`.
        legs: count of legs that swing. After a multiple of four the feet stand as at the start.
        name: name of the crawl in the robot's ``gaits.yaml``.
        amplitude: factor of the stride.
        **changes: values of parameters that replace those of the file.
    """
    return Crawl.plan_by_name(robot, legs, name, amplitude=amplitude, **changes)


def three_legs(
    robot: str | RobotModel | Walker, name: str = "three_legs", **changes: Any
) -> JointMotion:
    """Plan to raise one foot, and to stand on the other three; see :meth:`Gait.plan_by_name`.

    Args:
        robot: name or model of the robot, or a :class:`Walker`.
        name: name of the stand in the robot's ``gaits.yaml``.
        **changes: values of parameters that replace those of the file, such as `foot`, the name of the raised foot.
    """
    return Stand.plan_by_name(robot, 0, name, **changes)


def nearest_inside(point: Vector, triangle: Vector, margin: float) -> Vector:
    """Find the position nearest to a point whose distance from all sides of a triangle is at least a margin.

    Args:
        point: the point, shape (2,) [m].
        triangle: corners of the triangle in either sense of rotation, shape (3, 2) [m].
        margin: least distance from each side, inside the triangle [m].

    Returns:
        The position, shape (2,) [m]. It is the point itself if that is far enough inside.

    Raises:
        InvalidParameter: no position in the triangle has this distance from all sides.
    """
    # The determinant is twice the signed area of the triangle, positive for counterclockwise corners.
    is_counterclockwise = np.linalg.det(triangle[1:] - triangle[0]) > 0
    corners = triangle if is_counterclockwise else triangle[::-1]
    # A position p is allowed if n p >= d for each side, with the unit normal n that points inside.
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)[:, np.newaxis]
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / lengths
    offsets = np.einsum("kx,kx->k", normals, corners) + margin
    # The nearest position is the point, its projection on a side that is moved inside, or a corner of such sides.
    candidates = [np.asarray(point, dtype=float)]
    for normal, offset in zip(normals, offsets, strict=True):
        candidates.append(point + (offset - normal @ point) * normal)
    # Where two moved sides meet, both conditions hold with equality: two linear equations for the corner.
    candidates += [
        np.linalg.solve(normals[pair], offsets[pair]) for pair in ([0, 1], [1, 2], [2, 0])
    ]
    allowed = [
        position
        for position in candidates
        if (normals @ position >= offsets - _INSIDE_TOLERANCE).all()
    ]
    if not allowed:
        raise InvalidParameter(
            "inside",
            margin,
            message(
                "programs.within_triangle",
                "smaller than the radius of the circle inside the triangle of three feet [m]",
            ),
        )
    return min(allowed, key=lambda position: float(np.linalg.norm(position - point)))


def _middle_of(footholds: dict[str, Vector]) -> Vector:
    """Mean position of the feet, shape (2,) [m], from their footholds (3,) by name."""
    return np.asarray(np.mean([foothold[:2] for foothold in footholds.values()], axis=0))


def _start_footholds(walker: Walker, gait: SolvedGait) -> dict[str, Vector]:
    """Footholds of the four feet at the start, by foot: x [m], y [m] and turn [rad], shape (3,) each.

    They are where the feet are with all axes at zero, seen from the root, and further out by `widen`.

    Raises:
        InvalidParameter: the robot has other feet.
        UnknownName: the robot has no feet of the kind that the gait names.
    """
    needed = message("programs.four_feet_to_walk", "four feet for this gait")
    feet = walker.feet_by_name(CRAWL_ORDER, gait.feet, needed)
    footholds = {}
    for name, foot in feet.items():
        left = foot.home[1] + foot.side * gait.widen
        footholds[name] = np.array([foot.home[0], left, 0.0])
    return footholds


def _motion_of_phases(
    walker: Walker,
    gait: SolvedGait,
    start: dict[str, Vector],
    phases: list[Phase],
) -> JointMotion:
    """Solve the motion of a gait from its phases.

    Args:
        walker: the robot.
        gait: the gait.
        start: foothold (3,) of each foot at the start, by name.
        phases: the phases, one after the other. At the start the ZMP is at the origin of the plan.

    Raises:
        InvalidParameter: the phases take too long for one plan, or a leg has neither three, four nor six joints.
        OutOfReach: a leg is too short for the path of its foot, or a joint is beyond a limit.
    """
    plan = gait_plan(start, np.zeros(2), phases)
    return WholeBody(walker, gait, plan).solve()[0]
