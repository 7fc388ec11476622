"""Trees of bodies and joints, one for each mechanism, and where their loops are cut.

A URDF is a tree, so one joint of each loop becomes constraints: two points on its axis stay together, or one of a ball.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.bodies import Bodies, Link, RigidPart
from simrob_drake.simulink.mechanics.joints import Freedom

Holding = dict[RigidPart, list[Link]]


@dataclass(frozen=True, eq=False)
class BodyOnJoint:
    """A body on its joint.

    Attributes:
        body: the body.
        parent: what it hangs on; None for the world or the root body.
        link: by which joint.
        reversed: whether the joint's base is the outer body.
    """

    body: RigidPart
    parent: RigidPart
    link: Link
    reversed: bool

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
        return list(reversed(self.link.joint.freedoms)) if self.reversed else self.link.joint.freedoms

    @property
    def sign(self) -> float:
        """The sense of the joint's coordinates as seen from the parent."""
        return -1.0 if self.reversed else 1.0


@dataclass(eq=False)
class Tree:
    """A mechanism.

    Attributes:
        root: the body it starts from: the world, or a free one.
        frame: pose of the root link's frame in the root body's first frame.
        base: pose of that frame in the world at the start.
        speed: of its origin, then how fast it turns, in the world's axes, shape (6,) [m/s, rad/s].
        branches: in the order they are reached.
        closures: joints between its bodies that close loops.
    """

    root: RigidPart
    frame: RigidTransform = field(default_factory=RigidTransform)
    base: RigidTransform = field(default_factory=RigidTransform)
    speed: Vector = field(default_factory=lambda: np.zeros(6))
    branches: list[BodyOnJoint] = field(default_factory=list)
    closures: list[Link] = field(default_factory=list)

    @property
    def bodies(self) -> set[RigidPart]:
        """The root, and all that hangs on it."""
        return {self.root, *(branch.body for branch in self.branches)}

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
            message = "starts from the world: its base is no part of it"
            link.joint.node.findings.report.add("repaired", link.joint.node.path, message)
    return world, trees


def _spanning(links: list[Link], cuttable: Callable[[Link], bool]) -> list[Link]:
    """Return joints that reach every body once, those that cannot be cut first."""
    group: dict[RigidPart, RigidPart] = {}

    def found(body: RigidPart) -> RigidPart:
        while body in group:
            body = group[body]
        return body

    kept = []
    for link in sorted(links, key=cuttable):
        one, other = found(link.base), found(link.follower)
        if link.joint.floating or one is not other:
            kept.append(link)
        if not link.joint.floating and one is not other:
            group[one] = other
    return kept


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
        outer = link.follower if link.base is world else link.base
        if outer in seen:
            continue  # the loop is told below
        seen.add(outer)
        tree.branches.append(BodyOnJoint(outer, tree.root, link, link.follower is world))
        _grow(tree, outer, link, holding, seen)
        trees.append(tree)
    for body in _free_roots(bodies, seen):
        if body in seen:
            continue
        tree = _free_tree(body, bodies)
        seen.add(body)
        _grow(tree, body, None, holding, seen)
        trees.append(tree)
    _find_loops(bodies, trees)
    return trees


def _grow(tree: Tree, start: RigidPart, entry: Link | None, holding: Holding, seen: set[RigidPart]) -> None:
    queue: deque[tuple[RigidPart, Link | None]] = deque([(start, entry)])
    while queue:
        here, came = queue.popleft()
        for link in holding.get(here, []):
            outer = link.follower if link.base is here else link.base
            if link is came or outer in seen or outer.grounded:
                continue
            seen.add(outer)
            tree.branches.append(BodyOnJoint(outer, here, link, link.follower is here))
            queue.append((outer, link))


def _free_roots(bodies: Bodies, seen: set[RigidPart]) -> list[RigidPart]:
    """Return bodies that may be roots: first those that floating joints hold, then those no joint leads to."""
    floating = [link.follower for link in bodies.links if link.joint.floating and not link.follower.grounded]
    led_to = {link.follower for link in bodies.links}
    first = [body for body in bodies.bodies if body not in led_to]
    return [body for body in (*floating, *first, *bodies.bodies) if body not in seen and not body.grounded]


def _free_tree(body: RigidPart, bodies: Bodies) -> Tree:
    """Return the tree of a free root, where it begins."""
    for link in bodies.links:
        if link.joint.floating and link.follower is body:
            joint = link.in_base @ link.joint.start
            tree = _seen_from_its_middle(body, joint @ link.in_follower.inverse())
            linear, rate = (link.in_base.rotation() @ part for part in np.split(link.joint.start_speed, 2))
            arm = tree.base.translation() - joint.translation()
            tree.speed = np.concatenate([linear + np.cross(rate, arm), rate])
            return tree
    place = next((place for place in body.frames if place in bodies.roots), next(iter(body.frames)))
    return _seen_from_its_middle(body, body.frames[place].inverse())


def _seen_from_its_middle(body: RigidPart, first: RigidTransform) -> Tree:
    """Return the tree of a free root, its link's frame that of the heaviest solid; ``first`` is the body's pose."""
    frame = max(body.solids, key=lambda solid: solid.weight.mass).pose if body.solids else RigidTransform()
    return Tree(body, frame, first @ frame)


def _find_loops(bodies: Bodies, trees: list[Tree]) -> None:
    """Give each tree the joints that are left over between its bodies."""
    used = {branch.link for tree in trees for branch in tree.branches}
    for link in bodies.links:
        if link in used or link.joint.floating:
            continue
        owners = [next((tree for tree in trees if body in tree.bodies), None) for body in (link.base, link.follower)]
        both = [tree for tree in trees if link.base in tree.bodies and link.follower in tree.bodies]
        if both:
            both[0].closures.append(link)
        elif owners[0] and owners[1]:  # both stand on the world: one mechanism
            owners[0].branches += owners[1].branches
            owners[0].closures += [*owners[1].closures, link]
            trees.remove(owners[1])


_APART = 0.05  # m: of the two points on an axis
_CLOSED = 1e-6  # m
_NOTED = 1e-3  # rad or m, and of a second: what a target is missed by that is worth telling
_POINTS = {"Revolute Joint": ((0.0, 0.0, -_APART / 2), (0.0, 0.0, _APART / 2)), "Spherical Joint": ((0.0, 0.0, 0.0),)}


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
