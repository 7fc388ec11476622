"""Joints that close a loop: where the tree is cut, and the posture in which all loops are closed.

A URDF is a tree, so one joint of each loop becomes constraints: two points on its axis stay together, or one of a ball.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.bodies import Link, RigidPart
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.mechanics.trees import Tree

_APART = 0.05  # m: of the two points on an axis
_CLOSED = 1e-6  # m
_NOTED = 1e-3  # rad or m, and of a second: what a target is missed by that is worth telling
_POINTS = {
    "Revolute Joint": ((0.0, 0.0, -_APART / 2), (0.0, 0.0, _APART / 2)),
    "Spherical Joint": ((0.0, 0.0, 0.0),),
}


def common_points(link: Link) -> list[tuple[Vector, Vector]]:
    """Return the points that a closing joint holds together, each in the first frames of its base and follower."""
    points = [np.array(point) for point in _POINTS[link.joint.node.kind]]
    return [(link.in_base.multiply(point), link.in_follower.multiply(point)) for point in points]


def cuttable(link: Link) -> bool:
    """Tell whether constraints can take a joint's place: it has points to hold, and nothing drives or senses it."""
    return link.joint.node.kind in _POINTS and not (link.joint.inputs or link.joint.outputs)


def can_close(link: Link) -> str:
    """Return why a joint cannot be cut, in words; empty if it can."""
    if link.joint.node.kind not in _POINTS:
        return "closes a loop; only revolute and ball joints can, the others stand where a tree can hold them"
    if link.joint.inputs or link.joint.outputs:
        return "closes a loop and is driven or sensed; do that at another joint of the loop"
    if any(freedom.damping or freedom.stiffness for freedom in link.joint.freedoms):
        link.joint.node.findings.report.add("dropped", link.joint.node.path, "spring and damper where it closes a loop")
    return ""


def body_poses(tree: Tree, positions: Vector) -> dict[RigidPart, RigidTransform]:
    """Return the pose of each body's first frame in the root body's, at positions (n,) of the tree's freedoms."""
    poses = {tree.root: RigidTransform()}
    values = iter(positions)
    for branch in tree.branches:
        pose = poses[branch.parent] @ branch.in_parent
        for freedom in branch.freedoms:
            pose = pose @ _moved(freedom, branch.sign * next(values))
        poses[branch.body] = pose @ branch.in_body.inverse()
    return poses


def close(tree: Tree, closures: Sequence[Link]) -> None:
    """Start a tree in a posture in which its loops are closed, as near as can be to what its joints ask for.

    Raises:
        InvalidModel: there is none nearby.
    """
    from scipy.optimize import least_squares

    freedoms = tree.freedoms
    desired = np.array([freedom.start or 0.0 for freedom in freedoms])
    held = np.array([freedom.start_counts for freedom in freedoms])

    def gaps(positions: Vector) -> Vector:
        poses = body_poses(tree, positions)
        pairs = [(link, *pair) for link in closures for pair in common_points(link)]
        return np.concatenate([poses[link.base].multiply(a) - poses[link.follower].multiply(b) for link, a, b in pairs])

    def gaps_and_wishes(positions: Vector) -> Vector:
        return np.concatenate([gaps(positions), held * (positions - desired)])

    near = least_squares(gaps_and_wishes, desired)
    closed = least_squares(gaps, near.x, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found, gap = closed.x, float(np.abs(gaps(closed.x)).max())
    node = closures[0].joint.node
    if gap > _CLOSED:
        raise node.refusal(f"closes a loop that does not close: {1e3 * gap:.3g} mm are left; give starts")
    speeds = _closed_speeds(freedoms, np.asarray(closed.jac))
    for freedom, position, speed in zip(freedoms, found, speeds, strict=True):
        for what, target, taken in (("", freedom.start, position), (" speed", freedom.start_speed, speed)):
            if target is not None and abs(target - taken) > _NOTED:
                message = f"starts at the{what or ' position'} {taken:.4g}, not {target:.4g}: so its loop closes"
                node.findings.report.add("repaired", freedom.name, message)
        freedom.start, freedom.start_speed = float(position), float(speed)
    node.findings.report.add("repaired", node.path, "closes a loop: constraints on its axis, which need the solver sap")


def _closed_speeds(freedoms: Sequence[Freedom], jacobian: Vector) -> Vector:
    """Return the speeds (n,) at which gaps of a Jacobian (g, n) stay closed, as near as can be to what is asked."""
    desired = np.array([freedom.start_speed or 0.0 for freedom in freedoms])
    counts = np.array([freedom.speed_counts for freedom in freedoms])
    gives = counts.min() / counts
    return np.asarray(desired - gives * (np.linalg.pinv(jacobian * gives, rcond=1e-6) @ (jacobian @ desired)))


def _moved(freedom: Freedom, position: float) -> RigidTransform:
    if freedom.turns:
        return RigidTransform(RotationMatrix(AngleAxis(position, freedom.axis)), np.zeros(3))
    return RigidTransform(position * freedom.axis)
