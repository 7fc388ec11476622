"""The legs of a robot: chains of axes of equal lengths that reach lowest, and the feet on which they stand.

A *chain* is the sequence of axes between the root link and a body. A *posture* is the vector of the positions of a
robot's axes (n,), in rad or m. All heights and points of this module are in the world, with the robot's root upright;
no floor is involved.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import KNEELING, BodyChain, Clearance, outline
from simrob_drake.stations.posed import posture_range

_LOWEST = 0.7
"""Chains are legs if they reach at least this fraction of the depth under the root that the lowest chains reach."""

_LENGTH_TOLERANCE = 0.02
"""Relative difference up to which the lengths of two chains are equal: left and right legs of published models."""

_RANDOM_POSTURES = 60
"""Count of random postures in which the reach of chains is measured."""

_SAME_PLANE = np.cos(np.deg2rad(3.0))
"""Facets of a convex hull whose normals have at least this cosine belong to one flat side."""

_SMALLEST_SOLE = 0.15
"""Smallest area of a sole, as a fraction of the whole surface of the foot."""

_ALONG_AXIS = 0.9
"""A side is no sole if the cosine of its normal and the last axis is larger: it is the side of a wheel."""

_WEIGHT_OF_AREA = 1.2
"""Weight of a side's area if it is vertical. A side that looks down has 1 more, one that looks up has 1 less."""

_ROUND = 0.3
"""A foot is round, a ball or a wheel, if its middle is nearer to its joint than this fraction of its size."""


@dataclass(frozen=True)
class Leg:
    """A chain of axes from the root to a foot.

    Attributes:
        axes: indices of its axes, from the root outward.
        links: the links that these axes move, in the same order. The first link is the hip.
        foot: the link at the end of the chain.
        point: the point with which the foot stands, in the frame of the foot, shape (3,) [m].
        normal: unit normal of the sole, outward, in the frame of the foot, shape (3,); None for a tip or a ball.
    """

    axes: list[int]
    links: list[RigidBody]
    foot: RigidBody
    point: Vector
    normal: Vector | None


class _Support(NamedTuple):
    """The part of a foot on which it stands, in the frame of the foot.

    Attributes:
        point: the middle of the sole, the centre of a round foot, or the tip of another foot, shape (3,) [m].
        normal: unit normal of the sole, outward, shape (3,); None if the foot has no sole.
    """

    point: Vector
    normal: Vector | None


def put_upright(
    clearance: Clearance,
    robot: StationRobot,
    posture: Vector,
    height: float = 0.0,
) -> None:
    """Put a robot with a free base into a posture (n,) [rad or m], its root upright at a height [m]."""
    pose = RigidTransform(np.array([0.0, 0.0, height]))
    clearance.plant.SetFreeBodyPose(clearance.context, robot.root.body(), pose)
    clearance.place_robots({robot.name: posture})


def foot_place(clearance: Clearance, leg: Leg) -> Vector:
    """Position of a leg's standing point in the world (3,) [m], in the present configuration."""
    return np.asarray(clearance.plant.EvalBodyPoseInWorld(clearance.context, leg.foot) @ leg.point)


def straight(robot: StationRobot) -> Vector:
    """Posture (n,) in which most legs are straight: zero, even if zero is outside of the limits."""
    return np.zeros(len(robot.axes))


def ends_of(clearance: Clearance, robot: StationRobot) -> list[BodyChain]:
    """Find the bodies with collision shapes at the ends of a robot's chains of axes, with their chains.

    A body is at an end if no body farther outward has a collision shape.
    """
    bodies_with_shapes = set(clearance.lowest(robot))
    # Only bodies that an axis moves: the root link is no end.
    chains = [
        chain
        for chain in clearance.chains(robot)
        if chain.axes and chain.body.name() in bodies_with_shapes
    ]
    # All proper beginnings of chains: a chain among them goes on to another body.
    beginnings = {tuple(chain.axes[:count]) for chain in chains for count in range(len(chain.axes))}
    return [chain for chain in chains if tuple(chain.axes) not in beginnings]


def legs_of(clearance: Clearance, robot: StationRobot) -> list[list[Leg]]:
    """Find the groups of chains that may be the legs of a robot. The robot is moved.

    The chains of a group have equally many axes, and are equal in at least one of their two lengths, see
    :func:`chain_lengths`. A group may be legs if it reaches about as low as the lowest group. The reach below the root
    is measured at home and with all axes at zero. If no group reaches below the root there (legs that are level, or
    folded up), it is measured in random postures as well. If no group reaches below the root in these either, and the
    end of a chain is the lowest body of the robot, the root's frame is under the feet. The reach is then measured below
    the lowest hip, in the first two postures.

    Returns:
        the groups, the lowest first; empty if no two chains belong to one group.
    """
    groups = [group for group in _equal_chains(clearance, robot) if len(group) > 1]
    natural = [robot.model.home, straight(robot)]
    # A fixed seed, so that the same robot has the same legs in every run.
    random = np.random.default_rng(0).uniform(
        *posture_range(robot), (_RANDOM_POSTURES, len(robot.axes))
    )
    # Each trial has postures, and the height over the root from which the depth of chains is measured [m].
    trials = [(natural, 0.0), ([*natural, *random], 0.0)]
    if _stands_on_ends(clearance, robot, groups):
        trials.append((natural, _lowest_hip(clearance, robot, groups)))
    for postures, level in trials:
        heights = [_lowest_height(clearance, robot, group, postures) - level for group in groups]
        lowest_first = np.argsort(heights, kind="stable")
        # Heights below the root, or the hip, are negative. A group is low if its height is below _LOWEST times that of
        # the lowest group, which is then negative, too: if all heights are positive, no group is low.
        low = [groups[index] for index in lowest_first if heights[index] < _LOWEST * min(heights)]
        if low:
            return low
    return []


def _stands_on_ends(
    clearance: Clearance, robot: StationRobot, groups: Sequence[Sequence[Leg]]
) -> bool:
    """Whether the lowest body of a robot, with all axes at zero, is the end of one of these chains.

    Otherwise the robot rests on another body, such as its base. The robot is moved.
    """
    put_upright(clearance, robot, straight(robot))
    heights = clearance.lowest(robot)
    lowest = min(heights, key=lambda name: heights[name], default="")
    return any(leg.foot.name() == lowest for group in groups for leg in group)


def _lowest_hip(
    clearance: Clearance, robot: StationRobot, groups: Sequence[Sequence[Leg]]
) -> float:
    """Height of the lowest first joint of all chains over the root's frame [m], with all axes at zero."""
    put_upright(clearance, robot, straight(robot))
    hips = [robot.joints[leg.axes[0]].frame_on_child() for group in groups for leg in group]
    heights = [float(hip.CalcPoseInWorld(clearance.context).translation()[2]) for hip in hips]
    return min(heights, default=0.0)


def _equal_chains(clearance: Clearance, robot: StationRobot) -> list[list[Leg]]:
    """Group the chains of at least two axes by their count of axes and by their lengths.

    A chain belongs to a group if it has as many axes as the group's first chain, and is equal to it in at least one of
    the two lengths of :func:`chain_lengths`. A chain that equals no other one is a group of its own.
    """
    groups = list[list[Leg]]()
    # Lengths of the first chain of each group, as by chain_lengths.
    lengths_of_groups = list[Vector]()
    for body, axes in ends_of(clearance, robot):
        if len(axes) < 2:  # such a body could not be put at a given point of the ground
            continue
        links = [robot.joints[axis].child_body() for axis in axes]
        lengths = chain_lengths(clearance, robot, axes)
        support = _foot_support(clearance, robot, body, axes[-1])
        leg = Leg(axes, links, body, support.point, support.normal)
        for group, group_lengths in zip(groups, lengths_of_groups, strict=True):
            has_equal_count = len(group[0].axes) == len(axes)
            if has_equal_count and has_any_equal_length(lengths, group_lengths, _LENGTH_TOLERANCE):
                group.append(leg)
                break
        else:  # no group has a chain that equals this one
            groups.append([leg])
            lengths_of_groups.append(lengths)
    return groups


def chain_lengths(
    clearance: Clearance,
    robot: StationRobot,
    axes: Sequence[int],
    leg: Leg | None = None,
) -> Vector:
    """Measure the length of a chain in two ways, with all axes at zero.

    Left and right legs of one robot may differ in one of the two: in the first if their joints are drawn at other
    points along their axes, in the second if zero is another posture.

    Args:
        clearance: the robot's geometry. The robot is moved.
        robot: the robot.
        axes: indices of the chain's axes, from the root outward.
        leg: if given, both lengths go on to the standing point of this leg.

    Returns:
        the length from joint to joint, and the straight distance from the first to the last point, shape (2,) [m].
    """
    put_upright(clearance, robot, straight(robot))
    frames = [robot.joints[axis].frame_on_child() for axis in axes]
    points = [frame.CalcPoseInWorld(clearance.context).translation() for frame in frames]
    # The joints of two legs may agree although one leg has a longer foot.
    if leg is not None:
        points.append(foot_place(clearance, leg))
    distances = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.array([distances.sum(), np.linalg.norm(points[-1] - points[0])])


def has_any_equal_length(lengths: Vector, other_lengths: Vector, tolerance: float) -> bool:
    """Whether two chains are equal in at least one of their two lengths, up to a relative tolerance.

    Args:
        lengths: the two lengths of a chain, from :func:`chain_lengths`, shape (2,) [m].
        other_lengths: those of the other chain, shape (2,) [m].
        tolerance: largest difference as a share of the larger length.
    """
    difference = np.abs(lengths - other_lengths)
    return bool((difference <= tolerance * np.maximum(lengths, other_lengths)).any())


def _lowest_height(
    clearance: Clearance,
    robot: StationRobot,
    legs: list[Leg],
    postures: Iterable[Vector],
) -> float:
    """Height of the lowest standing point of some legs over the root [m], the lowest in all given postures (n,)."""
    heights = []
    for posture in postures:
        put_upright(clearance, robot, posture)
        heights += [foot_place(clearance, leg)[2] for leg in legs]
    return float(min(heights))


def _foot_support(
    clearance: Clearance,
    robot: StationRobot,
    body: RigidBody,
    axis: int,
) -> _Support:
    """Find the part of a body with which it stands: a flat sole, else the centre of a ball, else the tip.

    Args:
        clearance: the robot's geometry. The robot is moved.
        robot: the robot.
        body: the foot.
        axis: index of the axis that moves the foot.
    """
    points = outline(clearance.station, body)  # shape (k, 3) [m], in the frame of the body
    distances = np.linalg.norm(points, axis=1)  # from the joint, which is at the frame's origin
    joint = robot.joints[axis]
    direction = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else np.zeros(3)
    put_upright(clearance, robot, straight(robot))
    # The third row of the body's rotation is the world's z axis in the frame of the body.
    pose = clearance.plant.EvalBodyPoseInWorld(clearance.context, body)
    down = -pose.rotation().matrix()[2]
    sole = _find_sole(points, float(KNEELING * distances.max()), direction, down)
    if sole is not None:
        return sole
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    # The middle of a ball or a wheel is near its joint: it turns about it, and touches the ground anywhere.
    is_round = np.linalg.norm(middle) < _ROUND * distances.max()
    tip = points[int(distances.argmax())]
    return _Support(middle if is_round else tip, None)


def _find_sole(
    points: Vector,
    knee_distance: float,
    axis: Vector,
    down: Vector,
) -> _Support | None:
    """Find the flat side of a foot on which it can stand.

    A sole is a large flat side of the convex hull. All of it is farther from the joint than a knee would be, and it
    is not normal to the foot's axis, as the side of a wheel is. Of several such sides, the sole is a large one that
    looks down where all axes are zero.

    Args:
        points: outline of the foot in its frame, shape (k, 3) [m].
        knee_distance: distance from the joint up to which contact means kneeling [m].
        axis: direction of the axis that moves the foot, in the frame of the foot, shape (3,); zero if it is prismatic.
        down: downward direction where all axes are zero, in the frame of the foot, shape (3,).

    Returns:
        the centre and the normal of the sole, or None if the foot has no such side.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None  # fewer than four points, or all of them in one plane
    normals = hull.equations[:, :3]
    corners = points[hull.simplices]  # (facets, 3 corners, 3)
    # Area of a triangle: half of the length of the cross product of two edges.
    edge_products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(edge_products, axis=1) / 2

    # The hull's facets are triangles. A side consists of all facets with about the normal of one facet: row i of this
    # matrix (facets, facets) has True for the facets of the side of facet i.
    sides = normals @ normals.T > _SAME_PLANE
    side_areas = sides @ areas
    nearest_distances = []
    for side in sides:
        corners_of_side = corners[side].reshape(-1, 3)
        nearest_distances.append(np.linalg.norm(corners_of_side, axis=1).min())
    nearest = np.array(nearest_distances)
    is_far_from_joint = nearest > knee_distance
    is_large = side_areas > _SMALLEST_SOLE * areas.sum()
    is_across_axis = np.abs(normals @ axis) < _ALONG_AXIS
    is_possible = is_far_from_joint & is_large & is_across_axis
    if not is_possible.any():
        return None

    # Large sides and sides that look down win: A (1.2 + cos), with the angle of the normal to down.
    score = side_areas * (_WEIGHT_OF_AREA + normals @ down)
    best = sides[
        int(np.argmax(np.where(is_possible, score, -np.inf)))
    ]  # whether each facet belongs to it
    # The centre and the normal are means over the facets, weighted by area.
    centre = (areas[best, np.newaxis] * corners[best].mean(axis=1)).sum(axis=0) / areas[best].sum()
    normal = areas[best] @ normals[best]
    return _Support(np.asarray(centre), np.asarray(normal / np.linalg.norm(normal)))
