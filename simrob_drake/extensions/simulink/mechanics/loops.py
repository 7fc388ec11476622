r"""Where the loops of a mechanism are cut, which joints gears couple, and the posture and speeds at which it starts.

A tree has no loops, so a hinge or ball that nothing drives becomes a coupling. Any other joint keeps its
place in the tree: it holds one half of its body, and the halves are welded together.

A gear lets two pitch points slip by nothing: :math:`t \cdot (v_B(P_B) - v_F(P_F)) = 0` along the teeth. That is linear
in the speeds of the joints, with factors that stay the same where the gears' axes stay apart as they are, so the sum of
positions times factors stays what it is, planetary gears included.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import GEARS, ROD, Coupling, Link, RigidPart
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.mechanics.shapes import positive
from simrob_drake.extensions.simulink.mechanics.trees import (
    BodyOnJoint,
    Closing,
    Tree,
    body_motions,
    body_poses,
)
from simrob_drake.extensions.simulink.model.nodes import Node

Residual = Callable[[Vector], Vector]  # of positions (n,)


@dataclass(frozen=True)
class Teeth:
    """Where two gears mesh."""

    base: Vector  # a point of the base, shape (3,) [m]
    follower: Vector  # a point of the follower, shape (3,) [m]
    along: Vector  # the direction in which these do not slip, shape (3,)
    screw: float = 0.0  # how far the follower moves along it as the base turns about it [m/rad]; 0 of what is no screw


def _unit(node: Node, vector: Vector, what: str) -> Vector:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise node.refusal(
            message("simulink.unknown_teeth", "cannot tell where its teeth are: {what}", what=what)
        )
    return np.asarray(vector / length)


def _z(frame: RigidTransform) -> Vector:
    return np.asarray(frame.rotation().matrix()[:, 2])


def _toward(direction: Vector, target: Vector) -> Vector:
    return direction if direction @ target >= 0 else -direction


def _common(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    inside = node.text("GearType", "External") == "Internal"
    if node.text("SpecificationType", "PitchCircleRadii") == "PitchCircleRadii":
        own, other = _radii(node, "BaseGearRadius", "FollGearRadius")
    else:
        ratio, (distance,) = (
            node.number("GearRatio", "1"),
            positive(node, "CenterDistance", "20", 1),
        )
        own = distance / (abs(ratio - 1) if inside else ratio + 1)
        other = ratio * own
    between = _unit(
        node,
        follower.translation() - base.translation(),
        message("simulink.frames_at_one_place", "its frames are at one place"),
    )
    base_side, follower_side = (
        (1.0, -1.0) if not inside else (1.0, 1.0) if own > other else (-1.0, -1.0)
    )
    places = (
        base.translation() + base_side * own * between,
        follower.translation() + follower_side * other * between,
    )
    return Teeth(*places, np.cross(_z(base), between))


def _bevel(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    axes = _z(base), _z(follower)
    across = _unit(
        node, np.cross(*axes), message("simulink.axes_are_parallel", "its axes are parallel")
    )
    between = follower.translation() - base.translation()
    _unit(node, between, message("simulink.frames_at_one_place", "its frames are at one place"))
    own, other = _radii(node, "BaseGearRadius", "FollGearRadius")
    place = base.translation() + own * _toward(np.cross(across, axes[0]), between)
    return Teeth(
        place, follower.translation() + other * _toward(np.cross(across, axes[1]), -between), across
    )


def _rack(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    turning, along = _z(base), _z(follower)
    out = _unit(
        node,
        np.cross(turning, along),
        message("simulink.rack_along_pinion", "the rack slides along the pinion's axis"),
    )
    (radius,) = positive(node, "PinionRadius", "10", 1)
    place = base.translation() + radius * _toward(out, follower.translation() - base.translation())
    return Teeth(place, place, along)


def _worm(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    along, turning = _z(base), _z(follower)
    if node.text("SpecificationMethod", "PitchCircleRadii") != "PitchCircleRadii":
        raise node.refusal(
            message(
                "simulink.pitch_radii_only",
                "is given by distance and ratio; only pitch radii are read",
            )
        )
    worm, gear = _radii(node, "WormRadius", "GearRadius")
    lead = worm * np.tan(node.number("WormLeadAngle", "4.2", unit="rad"))
    out = _unit(
        node,
        np.cross(along, turning),
        message("simulink.worm_along_gear", "the worm is along the gear's axis"),
    )
    place = follower.translation() + gear * _toward(
        out, base.translation() - follower.translation()
    )
    hand = -1.0 if node.text("WormDirection", "RightHand") == "RightHand" else 1.0
    return Teeth(base.translation(), place, along, hand * lead)


def _radii(node: Node, *names: str) -> tuple[float, float]:
    one, other = (float(positive(node, name, "10", 1)[0]) for name in names)
    return one, other


_TEETH = dict(zip(GEARS, (_common, _bevel, _rack, _worm), strict=True))


def _gear_row(tree: Tree, coupling: Coupling, positions: Vector) -> Vector:
    """Return how fast the teeth of a gear slip for the speed of each joint, (n,), at positions (n,) [rad or m]."""
    poses, twists = body_motions(tree, positions)
    one, other = coupling.base, coupling.follower
    ends = poses[one] @ coupling.in_base, poses[other] @ coupling.in_follower
    teeth = _TEETH[coupling.node.kind](coupling.node, *ends)
    slips = _speeds(twists[one], teeth.base) - _speeds(twists[other], teeth.follower)
    row: Vector = teeth.along @ (slips + teeth.screw * (twists[one] - twists[other])[:3])
    row[np.abs(row) < 1e-7 * np.abs(row).max(initial=0.0)] = 0.0
    return row


def _speeds(twist: Vector, point: Vector) -> Vector:
    """Return how fast a point of a body moves with each position, shape (3, n)."""
    return np.asarray(twist[3:] + np.cross(twist[:3], point, axisa=0, axisc=0))


_CLOSED, _LOOSE = (
    1e-6,
    4e-4,
)  # m and rad: what is no gap, and what a station takes of one that rounded figures leave
PRESCRIBED = 1.0  # how much a start counts that a motion gives: nothing moves it
_NOTED = 1e-3  # rad or m, and of a second: what a target is missed by that is worth telling
_FAR, _MOST_STARTS = (
    0.2,
    20,
)  # rad or m: what a target is missed by for which other starts are tried, and how many
_NUDGE = 1e-4  # rad or m: off a posture where what is open depends on nothing, such as a hinge turned over
_MANY, _FEW_STARTS, _APART = 100, 3, 0.1
"""Positions beyond which chance finds no other sides: then so many starts are tried, as near as this [rad]."""
_BOUND = 1e-7  # how much staying counts beside closing
_CHANGES = 1e-3  # by so much of its largest factor a gear's factors may change with the posture
_CUT: dict[str, Literal["hinge", "ball"]] = {"Revolute Joint": "hinge", "Spherical Joint": "ball"}


def cuttable(link: Link) -> bool:
    """Tell whether a coupling can take a joint's place: there is one, and the joint neither acts, senses nor asks."""
    joint = link.joint
    asked = any((one.start, one.start_speed) != (None, None) for one in joint.freedoms)
    held = asked or any(one.damping or one.stiffness for one in joint.freedoms)
    return joint.node.kind in _CUT and not (joint.inputs or joint.outputs or joint.pulls or held)


def close(tree: Tree) -> None:
    """Cut the loops of a tree, and start it with them closed, as near as can be to what its joints ask for."""
    for link in tree.closures:
        tree.closings += _cut(tree, link)
    gears = [coupling for coupling in tree.couplings if coupling.node.kind != ROD]
    for rod in (coupling for coupling in tree.couplings if coupling not in gears):
        (length,) = positive(rod.node, "Distance", "1", 1)
        tree.closings.append(Closing(*rod.ends, "rod", float(length)))
    joints = [branch.link.joint for branch in tree.branches]
    screws = {joint.node: joint.screw for joint in joints if joint.screw}
    if tree.closings or screws:
        _settle(tree, _rows(tree, screws.values()))
    tree.gears |= screws
    for gear in gears:
        _mesh(tree, gear)
    if tree.closings or tree.gears:
        _start(tree)


def _cut(tree: Tree, link: Link) -> list[Closing]:
    node = link.joint.node
    if cuttable(link):
        node.note(
            "read", message("simulink.loop_as_coupling", "closes a loop: a coupling in its place")
        )
        return [Closing(*link.ends, _CUT[node.kind])]
    whole, turned = (link.base, True) if link.follower.grounded else (link.follower, False)
    halves = [replace(solid, weight=solid.weight.scaled(0.5)) for solid in whole.solids]
    whole.solids[:] = halves
    half = RigidPart(dict(whole.frames), [replace(solid, visible=False) for solid in halves])
    own = replace(link, base=half) if turned else replace(link, follower=half)
    tree.branches.append(BodyOnJoint(half, link.follower if turned else link.base, own, turned))
    node.note(
        "read",
        message(
            "simulink.loop_as_halves",
            "closes a loop: its body is two halves that are welded together",
        ),
    )
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


def _slopes(tree: Tree, positions: Vector) -> Vector:
    """Return how the k gaps of a tree change with its positions (n,), shape (k, n)."""
    motions = body_motions(tree, positions)
    return np.vstack(
        [np.zeros((0, positions.size)), *(closing.slopes(*motions) for closing in tree.closings)]
    )


def _nearest(tree: Tree, open_by: Residual, slopes: Residual) -> Vector:
    """Return the positions (n,) at which loops are open, and wishes missed, by least; ``slopes`` is of ``open_by``.

    Where wishes are missed, what nobody asks for is tried on other sides of its loop.
    """
    desired, asked = (
        _desired(tree),
        np.array([freedom.start is not None for freedom in tree.freedoms]),
    )
    loose = ~asked & np.array([freedom.turns for freedom in tree.freedoms])
    anywhere = np.array([freedom.start_counts == 0.0 for freedom in tree.freedoms])
    if anywhere.any():  # it begins where the others leave it
        desired = _least(open_by, slopes, desired + _NUDGE * anywhere, anywhere).x
    every = np.ones(desired.size, dtype=bool)
    found, rng = _least(open_by, slopes, desired, every), np.random.default_rng(0)
    near = loose.size > _MANY
    for _ in range(_FEW_STARTS if near else _MOST_STARTS if loose.any() else 0):
        far = np.any(asked & (np.abs(found.x - desired) > _FAR))
        if not far and np.abs(_gaps(tree, found.x)).max(initial=0.0) < _LOOSE:
            break
        ways = loose * rng.uniform(
            -_APART if near else -np.pi, _APART if near else np.pi, desired.size
        )
        other = (found.x if near else desired) + ways
        found = min(found, _least(open_by, slopes, other, every), key=lambda one: float(one.cost))
    return np.asarray(found.x)


def _least(
    open_by: Residual,
    slopes: Residual,
    start: Vector,
    moves: NDArray[np.bool_],
    tight: float = 1e-8,
) -> Any:
    """Return what scipy makes of the least squares of some positions, the others as at the start; ``x`` is of all."""
    from scipy.optimize import least_squares

    led, origin = np.eye(start.size)[:, moves], start * ~moves

    def whole(moving: Any) -> Vector:
        return np.asarray(origin + led @ moving)

    def missed(moving: Any) -> Any:
        return open_by(whole(moving))

    def change(moving: Any) -> Any:
        return slopes(whole(moving)) @ led

    found: Any = least_squares(missed, start[moves], change, xtol=tight, ftol=tight, gtol=tight)
    found.x = whole(found.x)
    return found


def _settle(tree: Tree, screws: Vector) -> None:
    """Start a tree where its loops are closed, and sums of its positions (k, n) are 0; else its loops are lost."""
    desired, held = _desired(tree), np.array([freedom.start_counts for freedom in tree.freedoms])

    def gaps(positions: Vector) -> Vector:
        return np.concatenate([_gaps(tree, positions), screws @ positions])

    def missed(counts: Vector, place: Vector) -> tuple[Residual, Residual]:
        return (
            lambda positions: np.concatenate([gaps(positions), counts * (positions - place)]),
            lambda positions: np.vstack([_slopes(tree, positions), screws, np.diag(counts)]),
        )

    found, moves = _nearest(tree, *missed(held, desired)), held < PRESCRIBED
    staying = missed(np.full(held.size, _BOUND), found.copy())  # where a way is free it stays there
    found[~moves] = desired[~moves]
    if moves.any():
        found = _least(*staying, found, moves, tight=1e-15).x
    endless = np.array(
        [one.turns and one.lower == -np.inf and one.upper == np.inf for one in tree.freedoms]
    )
    endless &= ~screws.any(axis=0)  # there a whole turn is a way
    found -= endless * 2 * np.pi * np.round((found - desired) / (2 * np.pi))
    poses = body_poses(tree, found)
    worst = max(
        tree.closings, key=lambda closing: float(np.abs(closing.gap(poses)).max()), default=None
    )
    node = worst.node if worst else tree.branches[0].link.joint.node
    if (gap := float(np.abs(gaps(found)).max())) > _LOOSE:
        node.note(
            "lost",
            message(
                "simulink.loop_does_not_close",
                "closes a loop that does not close: {gap:.3g} mm (or mrad) are left; give starts",
                gap=1e3 * gap,
            ),
        )
        tree.closings.clear()
        return
    if gap > _CLOSED:
        node.note(
            "approximated",
            message(
                "simulink.loop_left_open",
                "closes a loop whose figures leave {gap:.2g} mm open",
                gap=1e3 * gap,
            ),
        )
    for freedom, position in zip(tree.freedoms, found, strict=True):
        _tell(freedom, " position", freedom.start, position, tree)
        freedom.start = float(position)


def _mesh(tree: Tree, coupling: Coupling) -> None:
    """Note which sum of positions a gear keeps; one whose factors change with the posture is lost."""
    desired, node = _desired(tree), coupling.node
    try:
        row = _gear_row(tree, coupling, desired)
        moved = desired + 0.1 * (
            np.eye(desired.size) - np.linalg.pinv(row[None]) @ row[None]
        ) @ np.cos(desired)
        other = _gear_row(tree, coupling, moved)
        if not row.any() or np.abs(other - row).max() > _CHANGES * np.abs(row).max():
            raise node.refusal(
                message("simulink.ratio_changes", "its ratio changes with the posture")
                if row.any()
                else message("simulink.turns_nothing", "turns nothing")
            )
    except InvalidModel as problem:
        node.lose(problem)
        return
    tree.gears[node] = {
        freedom: float(f"{own:.9g}") for freedom, own in zip(tree.freedoms, row, strict=True) if own
    }


def _start(tree: Tree) -> None:
    """Start a tree at speeds that its loops and gears allow, as near as can be to what its joints ask for."""
    freedoms = tree.freedoms
    jacobian = np.vstack([_slopes(tree, _desired(tree)), _rows(tree, [*tree.gears.values()])])
    desired = np.array([freedom.start_speed or 0.0 for freedom in freedoms])
    counts = np.array([freedom.speed_counts for freedom in freedoms])
    gives = counts.min() / counts
    speeds = desired - gives * (np.linalg.pinv(jacobian * gives, rcond=1e-6) @ (jacobian @ desired))
    for freedom, speed in zip(freedoms, speeds, strict=True):
        _tell(freedom, " speed", freedom.start_speed, speed, tree)
        freedom.start_speed = float(speed)


def _tell(freedom: Freedom, what: str, target: float | None, taken: float, tree: Tree) -> None:
    if target is not None and abs(target - taken) > _NOTED:
        text = message(
            "simulink.starts_to_close",
            "starts at the{what} {taken:.4g}, not {target:.4g}: so its loop closes",
            what=what,
            taken=taken,
            target=target,
        )
        tree.branches[0].link.joint.node.findings.report.add("approximated", freedom.name, text)
