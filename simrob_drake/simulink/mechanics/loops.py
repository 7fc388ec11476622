"""Where the loops of a mechanism are cut, and the posture and speeds at which it starts with them closed.

A tree has no loops, so a hinge or ball that nothing drives becomes a coupling. Any other joint keeps its
place in the tree: it holds one half of its body, and the halves are welded together.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.bodies import ROD, Coupling, Link, RigidPart
from simrob_drake.simulink.mechanics.couplings import gear_row
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.mechanics.shapes import positive
from simrob_drake.simulink.mechanics.trees import BodyOnJoint, Closing, Tree, body_poses

_CLOSED = 1e-6  # m
_NOTED = 1e-3  # rad or m, and of a second: what a target is missed by that is worth telling
_CHANGES = 1e-3
"""By so much of its largest factor a gear's factors may change with the posture."""
_CUT: dict[str, Literal["hinge", "ball"]] = {"Revolute Joint": "hinge", "Spherical Joint": "ball"}


def cuttable(link: Link) -> bool:
    """Tell whether a coupling can take a joint's place: there is one, and nothing drives, senses or springs it."""
    joint = link.joint
    held = any(freedom.damping or freedom.stiffness for freedom in joint.freedoms)
    return joint.node.kind in _CUT and not (joint.inputs or joint.outputs or held)


def close(tree: Tree) -> None:
    """Cut the loops of a tree, and start it with them closed, as near as can be to what its joints ask for.

    Raises:
        InvalidModel: there is no such posture nearby.
    """
    for link in tree.closures:
        tree.closings += _cut(tree, link)
    for coupling in tree.couplings:
        if coupling.node.kind == ROD:
            ends = coupling.base, coupling.follower, coupling.in_base, coupling.in_follower
            (length,) = positive(coupling.node, "Distance", "1", 1)
            tree.closings.append(Closing(coupling.node, *ends, "rod", float(length)))
    joints = [branch.link.joint for branch in tree.branches]
    screws = {joint.node: joint.screw for joint in joints if joint.screw}
    if tree.closings or screws:
        _settle(tree, _rows(tree, screws.values()))
    tree.gears |= screws
    for coupling in tree.couplings:
        if coupling.node.kind != ROD:
            _mesh(tree, coupling)
    if tree.closings or tree.gears:
        _start(tree)


def _cut(tree: Tree, link: Link) -> list[Closing]:
    node = link.joint.node
    if cuttable(link):
        node.note("read", "closes a loop: a coupling in its place")
        joined = link.base, link.follower, link.in_base, link.in_follower
        return [Closing(node, *joined, _CUT[node.kind])]
    whole, turned = (link.base, True) if link.follower.grounded else (link.follower, False)
    halves = [replace(solid, weight=solid.weight.scaled(0.5)) for solid in whole.solids]
    whole.solids[:] = halves
    half = RigidPart(dict(whole.frames), [replace(solid, visible=False) for solid in halves])
    base, follower = (half, link.follower) if turned else (link.base, half)
    own = Link(node, base, follower, link.in_base, link.in_follower, link.joint)
    tree.branches.append(BodyOnJoint(half, link.follower if turned else link.base, own, turned))
    node.note("read", "closes a loop: its body is two halves that are welded together")
    return [Closing(node, half, whole, RigidTransform(), RigidTransform(), "weld")]


def _rows(tree: Tree, sums: Iterable[dict[Freedom, float]]) -> Vector:
    """Return sums of positions as rows of factors, shape (k, n)."""
    rows = [[one.get(freedom, 0.0) for freedom in tree.freedoms] for one in sums]
    return np.array(rows).reshape(len(rows), len(tree.freedoms))


def _desired(tree: Tree) -> Vector:
    return np.array([freedom.start or 0.0 for freedom in tree.freedoms])


def _gaps(tree: Tree, positions: Vector) -> Vector:
    """Return by what the loops of a tree are open at positions (n,)."""
    poses = body_poses(tree, positions)
    return np.concatenate([np.zeros(0), *(closing.gap(poses) for closing in tree.closings)])


def _settle(tree: Tree, screws: Vector) -> None:
    """Start a tree where its loops are closed, and sums of its positions (k, n) are 0.

    Raises:
        InvalidModel: there is no such posture nearby.
    """
    from scipy.optimize import least_squares

    desired, held = _desired(tree), np.array([freedom.start_counts for freedom in tree.freedoms])

    def gaps(positions: Vector) -> Vector:
        return np.concatenate([_gaps(tree, positions), screws @ positions])

    def gaps_and_wishes(positions: Vector) -> Vector:
        return np.concatenate([gaps(positions), held * (positions - desired)])

    near = least_squares(gaps_and_wishes, desired)
    found = least_squares(gaps, near.x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    if (gap := float(np.abs(gaps(found)).max())) > _CLOSED:
        node = tree.closings[0].node if tree.closings else tree.branches[0].link.joint.node
        raise node.refusal(f"closes a loop that does not close: {1e3 * gap:.3g} mm are left; give starts")
    for freedom, position in zip(tree.freedoms, found, strict=True):
        _tell(freedom, " position", freedom.start, position, tree)
        freedom.start = float(position)


def _mesh(tree: Tree, coupling: Coupling) -> None:
    """Note which sum of positions a gear keeps; one whose factors change with the posture is lost."""
    desired, node = _desired(tree), coupling.node
    try:
        row = gear_row(coupling, lambda positions: body_poses(tree, positions), desired)
        moved = desired + 0.1 * (np.eye(desired.size) - np.linalg.pinv(row[None]) @ row[None]) @ np.cos(desired)
        other = gear_row(coupling, lambda positions: body_poses(tree, positions), moved)
        if not row.any() or np.abs(other - row).max() > _CHANGES * np.abs(row).max():
            raise node.refusal("its ratio changes with the posture" if row.any() else "turns nothing")
    except InvalidModel as problem:
        node.lose(problem)
        return
    tree.gears[node] = {freedom: float(f"{own:.9g}") for freedom, own in zip(tree.freedoms, row, strict=True) if own}


def _start(tree: Tree) -> None:
    """Start a tree at speeds that its loops and gears allow, as near as can be to what its joints ask for."""
    freedoms, positions, step = tree.freedoms, _desired(tree), 1e-6
    ways = step * np.eye(len(freedoms))
    columns = [(_gaps(tree, positions + way) - _gaps(tree, positions - way)) / (2 * step) for way in ways]
    jacobian = np.vstack([np.array(columns).T.reshape(-1, len(freedoms)), _rows(tree, [*tree.gears.values()])])
    desired = np.array([freedom.start_speed or 0.0 for freedom in freedoms])
    counts = np.array([freedom.speed_counts for freedom in freedoms])
    gives = counts.min() / counts
    speeds = desired - gives * (np.linalg.pinv(jacobian * gives, rcond=1e-6) @ (jacobian @ desired))
    for freedom, speed in zip(freedoms, speeds, strict=True):
        _tell(freedom, " speed", freedom.start_speed, speed, tree)
        freedom.start_speed = float(speed)


def _tell(freedom: Freedom, what: str, target: float | None, taken: float, tree: Tree) -> None:
    if target is not None and abs(target - taken) > _NOTED:
        message = f"starts at the{what} {taken:.4g}, not {target:.4g}: so its loop closes"
        tree.branches[0].link.joint.node.findings.report.add("approximated", freedom.name, message)
