"""The legs of a robot: chains of axes that are alike and reach lowest, and the feet with which they stand."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import KNEELING, Clearance, outline
from simrob_drake.stations.posed import posture_range

_LOWEST = 0.7  # part of what the lowest chains reach that others reach which may be legs
_ALIKE = 0.02  # part by which the sizes of chains may differ that are alike
_REACHES = 60  # postures of chance in which it is looked how low chains reach
_FLAT = np.cos(np.deg2rad(3.0))  # facets of a hull whose normals differ by less are one
_SOLE = 0.15  # part of the surface of a foot that its sole has at least
_ACROSS, _DOWNWARD = 0.9, 1.2  # cosine of its normal and the last axis; and weight of where it looks
_ROUND = 0.3  # a foot whose middle is so near to its joint, by its size, is a wheel or a ball


@dataclass(frozen=True)
class Leg:
    """A chain of axes from the root to a foot."""

    axes: list[int]  # their numbers, from the root outward
    links: list[RigidBody]  # that they move, in this order; the first is the hip
    foot: RigidBody  # the link at its end
    point: Vector  # with which it stands, in the foot [m]
    normal: Vector | None  # of its sole, outward, in the foot; None for a tip or a ball


def put_upright(clearance: Clearance, robot: StationRobot, posture: Vector, height: float = 0.0) -> None:
    """Put a robot with a free base into a posture (n,) [rad or m], its root upright at a height [m]."""
    pose = RigidTransform(np.array([0.0, 0.0, height]))
    clearance.plant.SetFreeBodyPose(clearance.context, robot.root.body(), pose)
    clearance.place_robots({robot.name: posture})


def foot_place(clearance: Clearance, leg: Leg) -> Vector:
    """Return where a foot is that stands with its point (3,) [m], in the present configuration."""
    return np.asarray(clearance.plant.EvalBodyPoseInWorld(clearance.context, leg.foot) @ leg.point)


def ends_of(clearance: Clearance, robot: StationRobot) -> list[tuple[RigidBody, list[int]]]:
    """Return the bodies with shapes at the ends of a robot's chains of axes, and these."""
    shaped = set(clearance.lowest(robot))
    chains = [(body, axes) for body, axes in clearance.chains(robot) if axes and body.name() in shaped]
    inner = {tuple(axes[:count]) for _, axes in chains for count in range(len(axes))}
    return [(body, axes) for body, axes in chains if tuple(axes) not in inner]


def legs_of(clearance: Clearance, robot: StationRobot) -> list[list[Leg]]:
    """Return groups of chains that are alike, those that reach lowest at home or stretched out, else anyhow, first."""
    groups = list[tuple[Vector, list[Leg]]]()
    for body, axes in ends_of(clearance, robot):
        if len(axes) > 1:
            links, own = [robot.joints[axis].child_body() for axis in axes], lengths(clearance, robot, axes)
            leg = Leg(axes, links, body, *_foot(clearance, robot, body, axes[-1]))
            for others, group in groups:
                if len(group[0].axes) == len(axes) and alike(own, others, _ALIKE):
                    group.append(leg)
                    break
            else:
                groups.append((own, [leg]))

    pairs = [group for _, group in groups if len(group) > 1]
    natural = [robot.model.home, straight(robot)]
    chance = np.random.default_rng(0).uniform(*posture_range(robot), (_REACHES, len(robot.axes)))
    for postures in (natural, [*natural, *chance]):  # legs that lie level, or are up, reach down in others
        heights = [_lowest(clearance, robot, group, postures) for group in pairs]
        legs = [row for row in np.argsort(heights, kind="stable") if heights[row] < _LOWEST * min(heights)]
        if legs:
            return [pairs[row] for row in legs]
    return []


def lengths(clearance: Clearance, robot: StationRobot, axes: Sequence[int], foot: Leg | None = None) -> Vector:
    """Return how long a chain is from joint to joint, and straight from its first to its last, shape (2,) [m].

    Both up to the point on which a leg stands if that is asked for, where all axes are zero. Of a pair one may differ:
    the first where joints are drawn at other places along their axes, the second where zero is another posture.
    """
    put_upright(clearance, robot, straight(robot))
    places = [robot.joints[axis].frame_on_child().CalcPoseInWorld(clearance.context).translation() for axis in axes]
    if foot is not None:
        places.append(foot_place(clearance, foot))
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return np.array([ways.sum(), np.linalg.norm(places[-1] - places[0])])


def alike(some: Vector, others: Vector, part: float) -> bool:
    """Whether one of the lengths (2,) of two chains differs by a part of it at most."""
    return bool((np.abs(some - others) <= part * np.maximum(some, others)).any())


def _lowest(clearance: Clearance, robot: StationRobot, legs: list[Leg], postures: Iterable[Vector]) -> float:
    """Return the height over the root at which one of legs stands lowest in some posture [m]."""
    heights = []
    for posture in postures:
        put_upright(clearance, robot, posture)
        heights += [foot_place(clearance, leg)[2] for leg in legs]
    return float(min(heights))


def straight(robot: StationRobot) -> Vector:
    """Return the posture (n,) in which most legs are straight, be it within their limits or not: zero."""
    return np.zeros(len(robot.axes))


def _foot(clearance: Clearance, robot: StationRobot, body: RigidBody, axis: int) -> tuple[Vector, Vector | None]:
    """Return with what a foot stands: the middle of a flat sole and its normal, its centre if round, or its tip."""
    points = outline(clearance.station, body)
    ways = np.linalg.norm(points, axis=1)
    joint = robot.joints[axis]
    turns = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else np.zeros(3)
    put_upright(clearance, robot, straight(robot))
    down = -clearance.plant.EvalBodyPoseInWorld(clearance.context, body).rotation().matrix()[2]
    sole = _sole(points, float(KNEELING * ways.max()), turns, down)
    if sole is not None:
        return sole
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    return (middle if np.linalg.norm(middle) < _ROUND * ways.max() else points[int(ways.argmax())]), None


def _sole(points: Vector, near: float, turns: Vector, down: Vector) -> tuple[Vector, Vector] | None:
    """Return the middle and the normal of the flat side on which a body can stand, in its frame; None without.

    That is a large one, which no point of its outline (k, 3) is nearer to the joint of than a knee is, ``near`` [m],
    and the last axis, whose direction ``turns`` is zero if it slides, is not normal to it, as a wheel's is. Of several
    it is a large one that looks ``down`` where all axes are zero.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    normals, corners = hull.equations[:, :3], points[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    same = normals @ normals.T > _FLAT
    far = np.array([np.linalg.norm(corners[row].reshape(-1, 3), axis=1).min() for row in same]) > near
    fits = far & (same @ areas > _SOLE * areas.sum()) & (np.abs(normals @ turns) < _ACROSS)
    if not fits.any():
        return None
    best = int(np.argmax(np.where(fits, (same @ areas) * (_DOWNWARD + normals @ down), -np.inf)))
    parts = same[best]
    centre = (areas[parts, np.newaxis] * corners[parts].mean(axis=1)).sum(axis=0) / areas[parts].sum()
    normal = areas[parts] @ normals[parts]
    return np.asarray(centre), np.asarray(normal / np.linalg.norm(normal))
