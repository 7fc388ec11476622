"""Trees of bodies and joints, one for each mechanism; joints that are left over close loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.cluster.hierarchy import DisjointSet

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import (
    GEARS,
    ROD,
    Bodies,
    Coupling,
    Link,
    RigidPart,
    moved,
)
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.model.nodes import Node

Holding = dict[RigidPart, list[Link]]
Poses = Mapping[RigidPart, RigidTransform]  # poses of bodies' first frames in that of the root
Twists = Mapping[RigidPart, Vector]
"""How bodies move with each position: turns, then velocities of what of them is at the root's origin, shape (6, n)."""
_STEP = 1e-6  # m and rad: by which a body is moved to see what that does to a gap


@dataclass(frozen=True, eq=False)
class Closing(Coupling):
    """What holds two bodies together where a loop is cut."""

    kind: Literal["ball", "rod", "weld", "hinge"]  # of the station's coupling
    length: float = 0.0  # of a rod [m]

    @property
    def parameters(self) -> dict[str, float]:
        """Return what a station's file has of it beside its ends."""
        return {"length": self.length} if self.kind == "rod" else {}

    def gap(self, poses: Poses) -> Vector:
        """Return by what it is open [m, and rad]: (3,) of a ball, (1,) of a rod, (6,) of a weld or hinge."""
        apart = (poses[self.base] @ self.in_base).inverse() @ (
            poses[self.follower] @ self.in_follower
        )
        place: Vector = apart.translation()
        if self.kind == "rod":
            return np.array([np.linalg.norm(place) - self.length])
        if self.kind == "ball":
            return place
        if self.kind == "hinge":
            return np.concatenate([place, apart.rotation().matrix()[:, 2] - [0.0, 0.0, 1.0]])
        turn = apart.rotation().ToQuaternion()
        return np.concatenate([place, 2 * np.copysign(1.0, turn.w()) * turn.xyz()])

    def slopes(self, poses: Poses, twists: Twists) -> Vector:
        """Return how its gap of k numbers changes with each of n positions, shape (k, n)."""
        base, follower = poses[self.base], poses[self.follower]

        def open_by(way: Vector) -> Vector:
            there = RigidTransform(RollPitchYaw(way[:3]), way[3:]) @ follower
            return self.gap({self.base: base, self.follower: there})

        ways = _STEP * np.eye(6)
        columns = np.column_stack([(open_by(way) - open_by(-way)) / (2 * _STEP) for way in ways])
        return np.asarray(columns @ (twists[self.follower] - twists[self.base]))


@dataclass(frozen=True, eq=False)
class BodyOnJoint:
    """A body on its joint."""

    body: RigidPart
    parent: RigidPart  # what it hangs on; None for the world or the root body
    link: Link  # by which joint
    reversed: bool  # whether the joint's base is the outer body

    @property
    def in_parent(self) -> RigidTransform:
        """Pose of the joint's frame on the parent, in the parent's first frame."""
        return self.link.in_follower if self.reversed else self.link.in_base

    @property
    def in_body(self) -> RigidTransform:
        """Pose of the joint's frame on the body, in the body's first frame."""
        return self.link.in_base if self.reversed else self.link.in_follower

    @property
    def freedoms(self) -> list[Freedom]:
        """The degrees of freedom from the parent outward."""
        return (
            list(reversed(self.link.joint.freedoms)) if self.reversed else self.link.joint.freedoms
        )

    @property
    def sign(self) -> float:
        """The sense of the joint's coordinates as seen from the parent."""
        return -1.0 if self.reversed else 1.0


@dataclass(eq=False)
class Tree:
    """A mechanism."""

    root: RigidPart  # the body it starts from: the world, or a free one
    frame: RigidTransform = field(default_factory=RigidTransform)
    """Pose of the root link's frame in the root body's first frame."""
    # pose of that frame in the world at the start
    base: RigidTransform = field(default_factory=RigidTransform)
    speed: Vector = field(default_factory=lambda: np.zeros(6))
    """Of its origin, then how fast it turns, in the world's axes, shape (6,) [m/s, rad/s]."""
    branches: list[BodyOnJoint] = field(default_factory=list)  # in the order they are reached
    closures: list[Link] = field(default_factory=list)  # joints between its bodies that close loops
    closings: list[Closing] = field(default_factory=list)  # what holds together where these are cut
    couplings: list[Coupling] = field(default_factory=list)  # gears and rods between its bodies
    gears: dict[Node, dict[Freedom, float]] = field(default_factory=dict)
    """How much each degree of freedom counts in sums that stay as they are."""

    @property
    def bodies(self) -> set[RigidPart]:
        """The root, and all that hangs on it."""
        return {self.root, *(branch.body for branch in self.branches)}

    def behind(self, body: RigidPart) -> list[RigidPart]:
        """Return what hangs on a body, over any number of joints."""
        found = [body]
        for branch in self.branches:
            found += [branch.body] if branch.parent in found else []
        return found[1:]

    @property
    def freedoms(self) -> list[Freedom]:
        """All degrees of freedom, in order."""
        return [freedom for branch in self.branches for freedom in branch.freedoms]


def grow(bodies: Bodies, cuttable: Callable[[Link], bool]) -> tuple[RigidPart | None, list[Tree]]:
    """Return the world, and the trees of a model: one for each joint on the world, one for each free group.

    Loops are cut far from the world, but where that would be at a joint that is not ``cuttable``.
    """
    world = next((body for body in bodies.bodies if body.grounded), None)
    trees = _grown(bodies, world, bodies.links)
    if not all(cuttable(link) for tree in trees for link in tree.closures):
        trees = _grown(bodies, world, _spanning(bodies.links, cuttable))
    for link in bodies.links:
        if link.joint.floating and link.base is not world:
            link.joint.node.note(
                "approximated",
                message(
                    "simulink.starts_from_world", "starts from the world: its base is no part of it"
                ),
            )
    return world, trees


def _spanning(links: list[Link], cuttable: Callable[[Link], bool]) -> list[Link]:
    """Return joints that reach every body once, those that cannot be cut first."""
    joined = DisjointSet([body for link in links for body in (link.base, link.follower)])
    return [link for link in sorted(links, key=cuttable)
            if link.joint.floating or joined.merge(link.base, link.follower)]  # fmt: skip


def _grown(bodies: Bodies, world: RigidPart | None, links: list[Link]) -> list[Tree]:
    holding: Holding = {}
    for link in sorted(links, key=lambda link: not (link.joint.inputs or link.joint.outputs)):
        if not link.joint.floating:
            holding.setdefault(link.base, []).append(link)
            holding.setdefault(link.follower, []).append(link)
    seen: set[RigidPart] = set() if world is None else {world}
    trees: list[Tree] = []
    for link in holding.get(world, []) if world is not None else []:
        tree = Tree(link.base if link.base is world else link.follower)
        _grow(tree, [link], holding, seen)
        trees += [tree] if tree.branches else []  # else a loop, which is told below
    floating = [link.follower for link in bodies.links if link.joint.floating]
    led_to = {link.follower for link in bodies.links}
    first = [body for body in bodies.bodies if body not in led_to]
    for body in (*floating, *first, *bodies.bodies):
        if body not in seen and not body.grounded:
            seen.add(body)
            trees.append(_free_tree(body, bodies))
            _grow(trees[-1], holding.get(body, []), holding, seen)
    _find_loops(bodies, trees)
    return trees


def _grow(tree: Tree, links: list[Link], holding: Holding, seen: set[RigidPart]) -> None:
    """Add what hangs on the root of a tree by these joints, and on that."""
    ways = [(tree.root, link) for link in links]
    for here, link in ways:  # which grow meanwhile
        outer = link.follower if link.base is here else link.base
        if outer not in seen and not outer.grounded:
            seen.add(outer)
            tree.branches.append(BodyOnJoint(outer, here, link, link.follower is here))
            ways += [(outer, following) for following in holding[outer]]


def _free_tree(body: RigidPart, bodies: Bodies) -> Tree:
    for link in bodies.links:
        if link.joint.floating and link.follower is body:
            joint = link.in_base @ link.joint.start
            tree = _seen_from_its_middle(body, joint @ link.in_follower.inverse())
            linear, rate = (
                link.in_base.rotation() @ part for part in np.split(link.joint.start_speed, 2)
            )
            arm = tree.base.translation() - joint.translation()
            tree.speed = np.concatenate([linear + np.cross(rate, arm), rate])
            return tree
    place = next((place for place in body.frames if place in bodies.roots), next(iter(body.frames)))
    return _seen_from_its_middle(body, body.frames[place].inverse())


def _seen_from_its_middle(body: RigidPart, first: RigidTransform) -> Tree:
    """Return the tree of a free root, its link's frame that of the heaviest solid; ``first`` is the body's pose."""
    frame = (
        max(body.solids, key=lambda solid: solid.weight.mass).pose
        if body.solids
        else RigidTransform()
    )
    return Tree(body, frame, first @ frame)


def _find_loops(bodies: Bodies, trees: list[Tree]) -> None:
    used = {branch.link for tree in trees for branch in tree.branches}
    for link in bodies.links:
        if link not in used and not link.joint.floating and (tree := _owner(link, trees)):
            tree.closures.append(link)
    for coupling in bodies.couplings:
        if coupling.node.kind in (*GEARS, ROD) and (tree := _owner(coupling, trees)):
            tree.couplings.append(coupling)


def _owner(between: Coupling, trees: list[Tree]) -> Tree | None:
    """Return the tree of two bodies; two that stand on the world become one. None where a body is in no tree."""
    owners = [
        [tree for tree in trees if body in tree.bodies] for body in (between.base, between.follower)
    ]
    both = [tree for tree in owners[0] if tree in owners[1]]
    if both or not all(owners) or owners[0][0].root is not owners[1][0].root:
        return both[0] if both else None
    (one, *_), (other, *_) = owners
    one.branches += other.branches
    one.closures += other.closures
    one.couplings += other.couplings
    trees.remove(other)
    return one


def body_motions(tree: Tree, positions: Vector) -> tuple[Poses, Twists]:
    """Return where the bodies of a tree are at positions (n,) of its freedoms, and how they move with each of these."""
    poses, twists = {tree.root: RigidTransform()}, {tree.root: np.zeros((6, positions.size))}
    place = 0
    for branch in tree.branches:
        pose, twist = poses[branch.parent] @ branch.in_parent, twists[branch.parent].copy()
        for freedom in branch.freedoms:
            axis = branch.sign * (pose.rotation().matrix() @ freedom.axis)
            if freedom.turns:
                twist[:, place] = [*axis, *np.cross(pose.translation(), axis)]
            else:
                twist[3:, place] = axis
            pose = pose @ moved(freedom, branch.sign * float(positions[place]))
            place += 1
        poses[branch.body], twists[branch.body] = pose @ branch.in_body.inverse(), twist
    return poses, twists


def body_poses(tree: Tree, positions: Vector) -> Poses:
    """Return the pose of each body's first frame in the root body's, at positions (n,) of the tree's freedoms."""
    return body_motions(tree, np.asarray(positions))[0]
