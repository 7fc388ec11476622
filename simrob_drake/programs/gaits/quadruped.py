"""Walking on four legs: the trot, the crawl, and standing on three."""

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Number, Positive
from simrob_drake.programs.gaits.motion import EvenSteps, JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import Phase, check_steps, gait_plan, on_path, ramp_shares
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.robots.catalog import RobotModel

PAIRS = (("front_left_foot", "rear_right_foot"), ("front_right_foot", "rear_left_foot"))
"""Feet that a trot swings together."""
CRAWL_ORDER = ("rear_left_foot", "front_left_foot", "rear_right_foot", "front_right_foot")
"""Each hind foot comes before the fore foot of its side: then the trunk always has three feet about it."""


class Trot(EvenSteps, SolvedGait):
    """A gait on four legs, diagonal pairs in turn."""

    section: ClassVar[str] = "trots"
    usual: ClassVar[str] = "trot"

    ramp_steps: Integer = Field(default=4, ge=0)
    """Number of additional steps at the start, in which the step length grows, and at the end, in which it shrinks."""
    lift: Positive = 0.05
    """Height of the swinging feet [m]."""
    lead: Number = 0.0
    """How far the trunk runs ahead of the middle of its feet, as a part of the step."""
    all_stand: Positive = 0.1
    """Part of a step in which all feet stand."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        check_steps(steps)
        start = _stance(walker, self)
        phases, pose = [Phase(self.settle, np.zeros(2), 0.0)], np.zeros(3)
        move = np.array([self.step_length, self.sideways, np.deg2rad(self.turn_deg)])
        stand = self.all_stand * self.step_time
        for number, share in enumerate(ramp_shares(steps, self.ramp_steps)):
            landing = on_path(pose, *(share * move))
            between = on_path((pose + landing) / 2, *(share * self.lead * move))  # of pairs that stand and that land
            goals = {foot: on_path(landing, *start[foot][:2]) for foot in PAIRS[number % 2]}
            *over, heading = between
            time = self.step_time
            phases.append(Phase(time, np.array(over), time, goals, lift=self.lift, rest=stand, heading=heading))
            pose = landing
        phases.append(Phase(self.settle + self.rest, pose[:2], self.settle, heading=pose[2]))
        return _solved(walker, self, start, phases)


class Crawl(SolvedGait):
    """A gait on four legs, one leg at a time."""

    section: ClassVar[str] = "crawls"
    steps: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ("stride",)
    pace: ClassVar[str] = "leg_time"

    inside: Positive = 0.04
    """How far inside of the three standing feet's triangle the zero-moment point stays [m]."""
    leg_time: Pace
    """From one leg's footfall to the next one's [s]."""
    stride: Number = 0.0
    """How far each leg goes when its turn comes [m]."""
    lift: Positive = 0.04
    """Height of the swinging foot [m]."""
    shift: Positive = 0.6
    """Part of the leg's time in which all feet stand and the trunk goes over the next three."""
    settle: Pace = 0.8
    """Time to stand before the first leg and after the last one [s]."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        check_steps(steps)
        start = _stance(walker, self)
        place = {foot: at.copy() for foot, at in start.items()}
        shift = self.shift * self.leg_time
        phases = [Phase(self.settle, np.zeros(2), 0.0)]
        for number in range(steps):
            swinging = CRAWL_ORDER[number % 4]
            triangle = np.array([place[foot][:2] for foot in place if foot != swinging])
            middle = np.mean([at[:2] for at in place.values()], axis=0)
            goal, over = on_path(place[swinging], self.stride), moved_inside(middle, triangle, self.inside)
            phases.append(Phase(self.leg_time, over, shift, {swinging: goal}, lift=self.lift, delay=shift))
            place[swinging] = goal
        end = np.mean([at[:2] for at in place.values()], axis=0)
        phases.append(Phase(self.settle + self.rest, end, self.settle))
        return _solved(walker, self, start, phases)


class Stand(SolvedGait):
    """Standing on three legs."""

    section: ClassVar[str] = "stands"

    inside: Positive = 0.04
    """How far inside of the three standing feet's triangle the zero-moment point stays [m]."""
    foot: str
    """Which foot is up."""
    height: Positive = 0.03
    """How high [m]."""
    seconds: Pace = 5.0
    """How long it stays there [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        start, foot = _stance(walker, self), self.foot
        if foot not in start:
            raise UnknownName(message("programs.foot_of", "foot of {model}", model=walker.model.name), foot, start)
        triangle = np.array([at[:2] for other, at in start.items() if other != foot])
        over = moved_inside(np.zeros(2), triangle, self.inside)
        rise = 0.6
        phases = [
            Phase(0.5, np.zeros(2), 0.0),
            Phase(1.0, over, 1.0),
            Phase(self.seconds + 2 * rise, over, 0.0, {foot: start[foot]}, lift=self.height, hold=self.seconds),
            Phase(1.0 + self.rest, np.zeros(2), 1.0),
        ]
        return _solved(walker, self, start, phases)


trot = Trot.planned
"""Plan a trot; ``ramp_steps`` steps and one that brings the feet under the hips come in addition to the full ones."""


def crawl(
    robot: str | RobotModel | Walker, legs: int, name: str = "crawl", *, amplitude: float = 1.0, **changes: Any
) -> JointMotion:
    """Plan a crawl in which so many legs swing, a multiple of four to end as it began; see :meth:`Gait.planned`."""
    return Crawl.planned(robot, legs, name, amplitude=amplitude, **changes)


def three_legs(robot: str | RobotModel | Walker, name: str = "three_legs", **changes: Any) -> JointMotion:
    """Plan to lift one foot, the parameter ``foot``, and stand on the other three; see :meth:`Gait.planned`."""
    return Stand.planned(robot, 0, name, **changes)


def moved_inside(point: Vector, triangle: Vector, margin: float) -> Vector:
    """Return the place nearest to a point (2,) that lies in a triangle (3, 2) by a margin [m].

    Raises:
        InvalidParameter: the triangle is too small for the margin.
    """
    corners = triangle if np.linalg.det(triangle[1:] - triangle[0]) > 0 else triangle[::-1]  # counterclockwise
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, np.newaxis]
    offsets = np.einsum("kx,kx->k", normals, corners) + margin
    candidates = [np.asarray(point, dtype=float)]
    candidates += [point + (offset - normal @ point) * normal for normal, offset in zip(normals, offsets, strict=True)]
    candidates += [np.linalg.solve(normals[[a, b]], offsets[[a, b]]) for a, b in ((0, 1), (1, 2), (2, 0))]
    inside = [place for place in candidates if (normals @ place >= offsets - 1e-9).all()]
    if not inside:
        raise InvalidParameter(
            "inside",
            margin,
            message("programs.within_triangle", "smaller than what the triangle of three feet has room for [m]"),
        )
    return min(inside, key=lambda place: float(np.linalg.norm(place - point)))


def _stance(walker: Walker, gait: SolvedGait) -> dict[str, Vector]:
    """Return where the feet stand about the middle of them, shape (3,) each [m, rad]."""
    feet = walker.feet_called(CRAWL_ORDER, gait.feet, message("programs.four_feet_to_walk", "four feet, to walk so"))
    return {name: np.array([foot.home[0], foot.home[1] + foot.side * gait.widen, 0.0]) for name, foot in feet.items()}


def _solved(walker: Walker, gait: SolvedGait, start: dict[str, Vector], phases: list[Phase]) -> JointMotion:
    way = gait_plan(start, np.zeros(2), phases)
    return WholeBody(walker, gait, way).solve()[0]
