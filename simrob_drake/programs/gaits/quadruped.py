"""Walking on four legs: the trot, the crawl, and standing on three."""

from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import Crawl, Stand, Trot
from simrob_drake.programs.gaits.phases import Phase, check_steps, course, on_path, ramp_shares
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.robots.catalog import RobotModel

PAIRS = (("front_left_foot", "rear_right_foot"), ("front_right_foot", "rear_left_foot"))
"""Feet that a trot swings together."""
CRAWL_ORDER = ("rear_left_foot", "front_left_foot", "rear_right_foot", "front_right_foot")
"""Each hind foot comes before the fore foot of its side: then the trunk always has three feet about it."""


def trot(
    robot: str | RobotModel | Walker, steps: int, name: str = "trot", *, amplitude: float = 1.0, **changes: Any
) -> JointMotion:
    """Plan a trot: diagonal pairs in turn; the last step brings the feet under the hips.

    Args:
        robot: its name, its model, or a :class:`Walker` that tells what it carries and on what slope.
        steps: how many full steps ahead; ``ramp_steps`` and the last one come in addition.
        name: of the trot in the robot's `gaits.yaml`.
        amplitude: scales length, way sideways and turn of the steps.
        changes: parameters of :class:`Trot` to change.

    Raises:
        OutOfReach: steps that are too long or too high for the legs.
        InvalidParameter: a robot that has other than four feet, or too few steps.
        UnknownName: no such trot.
    """
    walker = Walker.of(robot)
    gait: Trot = walker.gait("trots", name, changes, amplitude)
    check_steps(steps)
    start = _stance(walker, gait)
    phases, pose = [Phase(gait.settle, np.zeros(2), 0.0)], np.zeros(3)
    move = np.array([gait.step_length, gait.sideways, np.deg2rad(gait.turn_deg)])
    stand = gait.all_stand * gait.step_time
    for number, share in enumerate(ramp_shares(steps, gait.ramp_steps)):
        landing = on_path(pose, *(share * move))
        between = on_path((pose + landing) / 2, *(share * gait.lead * move))  # of pairs that stand and that land
        goals = {foot: on_path(landing, *start[foot][:2]) for foot in PAIRS[number % 2]}
        *over, heading = between
        time = gait.step_time
        phases.append(Phase(time, np.array(over), time, goals, lift=gait.lift, rest=stand, heading=heading))
        pose = landing
    phases.append(Phase(gait.settle + gait.rest, pose[:2], gait.settle, heading=pose[2]))
    return _solved(walker, gait, start, phases)


def crawl(
    robot: str | RobotModel | Walker, legs: int, name: str = "crawl", *, amplitude: float = 1.0, **changes: Any
) -> JointMotion:
    """Plan a crawl: one leg after the other, the zero-moment point well inside of the other three feet.

    Args:
        robot: its name, its model, or a :class:`Walker` that tells what it carries and on what slope.
        legs: how many legs swing in all; a multiple of four ends as it began.
        name: of the crawl in the robot's `gaits.yaml`.
        amplitude: scales the stride.
        changes: parameters of :class:`Crawl` to change.

    Raises:
        OutOfReach: strides that are too long or too high for the legs.
        InvalidParameter: a robot that has other than four feet, or no legs to swing.
        UnknownName: no such crawl.
    """
    walker = Walker.of(robot)
    gait: Crawl = walker.gait("crawls", name, changes, amplitude)
    check_steps(legs)
    start = _stance(walker, gait)
    place = {foot: at.copy() for foot, at in start.items()}
    shift = gait.shift * gait.leg_time
    phases = [Phase(gait.settle, np.zeros(2), 0.0)]
    for number in range(legs):
        swinging = CRAWL_ORDER[number % 4]
        triangle = np.array([place[foot][:2] for foot in place if foot != swinging])
        middle = np.mean([at[:2] for at in place.values()], axis=0)
        goal, over = on_path(place[swinging], gait.stride), moved_inside(middle, triangle, gait.inside)
        phases.append(Phase(gait.leg_time, over, shift, {swinging: goal}, lift=gait.lift, delay=shift))
        place[swinging] = goal
    end = np.mean([at[:2] for at in place.values()], axis=0)
    phases.append(Phase(gait.settle + gait.rest, end, gait.settle))
    return _solved(walker, gait, start, phases)


def three_legs(robot: str | RobotModel | Walker, name: str = "three_legs", **changes: Any) -> JointMotion:
    """Plan to lift one foot and stand on the other three.

    Args:
        robot: its name, its model, or a :class:`Walker` that tells what it carries and on what slope.
        name: of the stand in the robot's `gaits.yaml`.
        changes: parameters of :class:`Stand` to change, such as ``foot``.

    Raises:
        OutOfReach: a foot that cannot be lifted so high.
        UnknownName: no such stand or foot.
        InvalidConfig: a height or a time that is not positive.
    """
    walker = Walker.of(robot)
    gait: Stand = walker.gait("stands", name, changes)
    start, foot = _stance(walker, gait), gait.foot
    if foot not in start:
        raise UnknownName(f"foot of {walker.model.name}", foot, start)
    triangle = np.array([at[:2] for other, at in start.items() if other != foot])
    over = moved_inside(np.zeros(2), triangle, gait.inside)
    rise = 0.6
    phases = [
        Phase(0.5, np.zeros(2), 0.0),
        Phase(1.0, over, 1.0),
        Phase(gait.seconds + 2 * rise, over, 0.0, {foot: start[foot]}, lift=gait.height, hold=gait.seconds),
        Phase(1.0 + gait.rest, np.zeros(2), 1.0),
    ]
    return _solved(walker, gait, start, phases)


def moved_inside(point: Vector, triangle: Vector, margin: float) -> Vector:
    """Return the nearest place to a point that lies inside of a triangle by a margin.

    Args:
        point: shape (2,) [m].
        triangle: corners, shape (3, 2) [m].
        margin: distance from every side [m].

    Raises:
        InvalidParameter: a triangle too small for the margin.
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
        raise InvalidParameter("inside", margin, "smaller than what the triangle of three feet has room for [m]")
    return min(inside, key=lambda place: float(np.linalg.norm(place - point)))


def _stance(walker: Walker, gait: Trot | Crawl | Stand) -> dict[str, Vector]:
    """Return where the feet stand about the middle of them, shape (3,) each [m, rad]."""
    feet = walker.feet()
    if sorted(foot.name for foot in feet) != sorted(CRAWL_ORDER):
        raise InvalidParameter(
            f"robot {walker.model.name}", f"one with {len(feet)} feet", "one with four feet, to walk so"
        )
    return {foot.name: np.array([foot.home[0], foot.home[1] + foot.side * gait.widen, 0.0]) for foot in feet}


def _solved(walker: Walker, gait: Trot | Crawl | Stand, start: dict[str, Vector], phases: list[Phase]) -> JointMotion:
    way = course(start, np.zeros(2), phases)
    return WholeBody(walker, gait, way).solve()[0]
