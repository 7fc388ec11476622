"""Frames that are rigidly joined are one body: which frames those are, what each body carries, and what may touch."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.joints import (
    JOINTS,
    Freedom,
    Joint,
    read_joint,
    rigid_transform,
)
from simrob_drake.extensions.simulink.mechanics.shapes import MeshFiles
from simrob_drake.extensions.simulink.mechanics.solids import (
    GEOMETRY,
    REFERENCE,
    SOLIDS,
    VARIABLE,
    SolidBody,
    frame_pose,
    hold_constant,
    read_solid,
    solid_ports,
)
from simrob_drake.extensions.simulink.model.network import Connections, Place
from simrob_drake.extensions.simulink.model.nodes import Node

_SAME = 1e-6  # how far apart two ways to one frame may put it [m, and of rotation]


@dataclass(eq=False)
class RigidPart:
    """A rigid body: frames, and what hangs on them."""

    frames: dict[Place, RigidTransform] = field(default_factory=dict)
    """Pose of each of its physical nodes in the first one."""
    solids: list[SolidBody] = field(default_factory=list)  # with their poses there
    marks: list[tuple[Node, RigidTransform]] = field(default_factory=list)
    """Reference Frames, and where external forces act, with their poses."""
    grounded: bool = False  # whether it is the world


@dataclass(frozen=True, eq=False)
class Coupling:
    """What is between two bodies: a gear, rod, spring or force, a joint, or what closes a loop."""

    node: Node
    base: RigidPart
    follower: RigidPart
    in_base: RigidTransform  # pose of the block's frame in the base
    in_follower: RigidTransform  # likewise in the follower

    @property
    def ends(self) -> tuple[Node, RigidPart, RigidPart, RigidTransform, RigidTransform]:
        """What it is between, for another coupling in its place."""
        return self.node, self.base, self.follower, self.in_base, self.in_follower


@dataclass(frozen=True, eq=False)
class Link(Coupling):
    """A joint between two bodies, and what it lets free."""

    joint: Joint


@dataclass
class Bodies:
    """The mechanics of a model."""

    bodies: list[RigidPart]  # all of them; the world first, if there is one
    links: list[Link]  # the joints that connect them
    couplings: list[Coupling]  # what else does
    by_place: dict[Place, RigidPart]  # which body a physical node is on
    roots: set[Place]  # physical nodes that no transform or joint leads to
    standing: set[Node] = field(default_factory=set)  # planes of the world


PUSH = "External Force and Torque"
GEARS = (
    "Common Gear Constraint",
    "Bevel Gear Constraint",
    "Rack and Pinion Constraint",
    "Worm and Gear Constraint",
)
ROD, SPRING, BETWEEN = "Distance Constraint", "Spring and Damper Force", "Internal Force"
_MARKS = ("Reference Frame", PUSH)
CLOUD, GRID = "Point Cloud", "Grid Surface"
_GEOMETRY_ONLY = {"Infinite Plane", "Disk", "Point", CLOUD, GRID, "Spline", "Line Segment"}
"""Curves and surfaces: their frame is the left port."""


def frame_place(network: Connections, node: Node) -> Place:
    """Return the physical node of a solid's reference frame, or of a surface's; one of its own where it is hidden."""
    if node.kind in _GEOMETRY_ONLY:
        return network.net(node, "lconn")
    if node.kind not in SOLIDS:
        return network.net(node, "rconn")
    for port in solid_ports(node):
        if port.what == REFERENCE:
            return network.net(node, port.side, port.number)
    return (id(node), REFERENCE, 0)


def read_bodies(network: Connections, meshes: MeshFiles) -> Bodies:
    """Return the bodies and joints of a model.

    Raises InvalidModel: a block's figures cannot be, or frames contradict each other.
    """
    frames = _Frames(network, meshes)
    for node in network.expanded.nodes:
        if node.block.commented == "off":
            try:
                if node.kind in VARIABLE:
                    hold_constant(network, node)
                frames.take(node)
            except InvalidModel as problem:
                node.lose(problem)
    bodies, world = Bodies([], [], [], {}, set()), RigidPart(grounded=True)
    worlds = {
        place for node, place in frames.attached if node.kind == "World Frame"
    } or _held_outside(network, frames)
    for place in (*worlds, *frames.edges, *(place for _, place in frames.attached)):
        if place not in bodies.by_place:
            _gather(frames.edges, place, world if place in worlds else RigidPart(), bodies)
    _attach(frames, bodies)
    for what, base, follower in frames.joints:
        one, other = bodies.by_place[base], bodies.by_place[follower]
        ends = one, other, one.frames[base], other.frames[follower]
        if isinstance(what, Joint):
            bodies.links.append(Link(what.node, *ends, what))
        elif one is not other:
            bodies.couplings.append(Coupling(what, *ends))
    bodies.roots = {place for place in bodies.by_place if place not in frames.entered}
    return bodies


def moved(freedom: Freedom, position: float) -> RigidTransform:
    """Return what a degree of freedom does to the pose behind it at a position [rad or m]."""
    if freedom.turns:
        return RigidTransform(RotationMatrix(AngleAxis(position, freedom.axis)), np.zeros(3))
    return RigidTransform(position * freedom.axis)


def _locked(joint: Joint) -> RigidTransform:
    """Return the pose of the follower in the base of a joint that is locked where its targets are."""
    pose = joint.start
    for freedom in joint.freedoms:
        pose = pose @ moved(freedom, freedom.start or 0.0)
    joint.node.note(
        "approximated",
        message("simulink.locked_joint", "is locked: welded where its targets are, or else at 0"),
    )
    return pose


Edges = dict[Place, list[tuple[Place, RigidTransform, Node]]]
"""By physical node: which others are rigidly joined with it, with their poses in it, and by which block."""


_ENDS = "lconn", "rconn"
_SEEN = (
    "Rigid Transform",
    "Reference Frame",
    "Graphic",
    "Spline",
)  # what neither weighs, holds nor tells


class _Frames:
    """What is on which physical node, and how these are joined."""

    def __init__(self, network: Connections, meshes: MeshFiles) -> None:
        self._network, self._meshes = network, meshes
        self.solids: dict[Node, SolidBody] = {}
        self.edges: Edges = {}
        self.entered: set[Place] = set()
        self.joints: list[tuple[Joint | Node, Place, Place]] = []
        self.attached: list[tuple[Node, Place]] = []

    def take(self, node: Node) -> None:
        if node.kind == "Rigid Transform":
            self._join(*self._ends(node), rigid_transform(node), node)
        elif node.kind == "Weld Joint":
            self._join(*self._ends(node), RigidTransform(), node)
        elif node.kind in JOINTS and not any(
            self._network.on(self._network.net(node, side)) for side in _ENDS
        ):
            node.note(
                "dropped", message("simulink.joint_not_connected", "the joint: it is not connected")
            )
        elif node.kind in JOINTS:
            joint, (base, follower) = read_joint(node), self._ends(node)
            if node.text("JointMode") == "Locked":
                self._join(base, follower, _locked(joint), node)
            else:
                self._join((id(node), "tilt", 1), follower, joint.tilt, node)
                self.joints.append((joint, base, (id(node), "tilt", 1)))
        elif node.kind in SOLIDS:
            self._take_solid(node)
        elif node.kind in (*GEARS, ROD, SPRING, BETWEEN, "Transform Sensor"):
            base, follower = (self._network.net(node, side) for side in _ENDS)
            self.attached += [(node, base), (node, follower)]
            self.joints += [] if node.kind == "Transform Sensor" else [(node, base, follower)]
        elif node.kind in ("World Frame", *_MARKS) or node.kind in _GEOMETRY_ONLY:
            self.attached.append((node, frame_place(self._network, node)))

    def _ends(self, node: Node) -> tuple[Place, Place]:
        base, follower = self._network.net(node, "lconn"), self._network.net(node, "rconn")
        self.entered.add(follower)
        for place in (base, follower):
            self.edges.setdefault(place, [])
        return base, follower

    def _join(self, base: Place, follower: Place, pose: RigidTransform, node: Node) -> None:
        self.edges.setdefault(base, []).append((follower, pose, node))
        self.edges.setdefault(follower, []).append((base, pose.inverse(), node))

    def _take_solid(self, node: Node) -> None:
        place = frame_place(self._network, node)
        self.attached.append((node, place))
        try:
            self.solids[node] = read_solid(node, self._meshes)
        except InvalidModel as problem:
            node.lose(problem)
        for port in solid_ports(node):
            if isinstance(port.what, Element):
                there = self._network.net(node, port.side, port.number)
                self._join(place, there, self._pose_on(node, port.what, there), node)

    def _pose_on(self, node: Node, frame: Element, there: Place) -> RigidTransform:
        """Return where a frame of a solid is; where that is not known it is lost, and in the solid's own frame."""
        solid = self.solids.get(node)
        try:
            return frame_pose(node, frame, None if solid is None else solid.weight)
        except InvalidModel as problem:
            if self._only_seen(node, there):
                node.note(
                    "approximated",
                    message(
                        "simulink.at_reference_frame",
                        "{problem}; taken at its reference frame, for nothing weighs there",
                        problem=problem.problem,
                    ),
                )
            else:
                node.lose(
                    problem,
                    message("simulink.taken_at_reference_frame", "; taken at its reference frame"),
                )
            return RigidTransform()

    def _only_seen(self, node: Node, there: Place) -> bool:
        """Tell whether a frame of a solid carries nothing but marks and pictures."""

        def ends(one: Node) -> list[Place]:
            if one is node:
                return [there]
            return (
                [self._network.net(one, side) for side in _ENDS]
                if one.kind == "Rigid Transform"
                else []
            )

        return all(one is node or one.kind in _SEEN for one in self._network.joined(node, ends))


def _held_outside(network: Connections, frames: _Frames) -> set[Place]:
    """Return the frame by which a file that others put in is held: the only one of its ports to which nothing leads."""
    ports = {network.net(node, "conn"): node for node in network.expanded.root.children.values()
             if node.kind == "PMIOPort"}  # fmt: skip
    bases = {base for _, base, _ in frames.joints}
    found = {
        place
        for place in ports
        if place in frames.edges.keys() | bases and place not in frames.entered
    }
    if len(found) != 1:
        return set()
    (place,) = found
    ports[place].note(
        "approximated",
        message(
            "simulink.stands_in_world", "stands in the world, in place of what this is put into"
        ),
    )
    return found


def _gather(edges: Edges, start: Place, body: RigidPart, bodies: Bodies) -> None:
    """Walk along rigid connections from a frame of a body: all that is reached is part of it."""
    bodies.bodies += [] if body in bodies.bodies else [body]
    body.frames[start], bodies.by_place[start] = RigidTransform(), body
    reached = [start]
    for here in reached:  # which grow meanwhile
        for place, pose, node in edges.get(here, ()):
            there = body.frames[here] @ pose
            if place not in body.frames:
                body.frames[place], bodies.by_place[place] = there, body
                reached.append(place)
            elif not body.frames[place].IsNearlyEqualTo(there, _SAME):
                text = message(
                    "simulink.rigid_loop_differs",
                    "closes a loop of rigid frames that does not fit: ways to one frame differ; one is taken",
                )
                node.note("lost", text)


def _attach(frames: _Frames, bodies: Bodies) -> None:
    for node, place in frames.attached:
        body = bodies.by_place[place]
        if node in frames.solids:
            body.solids.append(replace(frames.solids[node], pose=body.frames[place]))
        elif node.kind == "Infinite Plane" and body.grounded:
            bodies.standing.add(node)
        elif node.kind in _MARKS:
            body.marks.append((node, body.frames[place]))


@dataclass(frozen=True)
class ContactParameters:
    """Figures of a contact."""

    stiffness: float  # [N/m]
    damping: float  # [N·s/m], of a damper beside the spring
    static: float  # coefficient of friction
    dynamic: float  # coefficient of friction
    speed: float  # below which a contact sticks [m/s]


@dataclass(frozen=True, eq=False)
class ContactPair:
    """A pair that may touch."""

    node: Node
    pair: tuple[Node, Node]  # the two solids or surfaces
    surface: ContactParameters  # the figures
    senses_distance: int = 0  # the number of the port that tells the distance, or 0


_DISTANCE_AFTER = 2  # it is the first of the sensed signals


def read_contacts(network: Connections) -> list[ContactPair]:
    """Return the contacts of a model; those whose figures cannot be are lost."""
    nodes = [node for node in network.expanded.nodes if node.block.commented == "off"]
    geometry: dict[Place, Node] = {}
    for node in nodes:
        for side, number in _geometry_ports(node):
            geometry[network.net(node, side, number)] = node
    contacts = []
    for node in nodes:
        if node.kind != "Spatial Contact Force":
            continue
        one, other = (geometry.get(network.net(node, side)) for side in _ENDS)
        if one is not None and other is not None:
            try:
                sensed = _DISTANCE_AFTER if node.is_on("SenseSeparationDistance") else 0
                contacts.append(ContactPair(node, (one, other), _surface(node), sensed))
            except InvalidModel as problem:
                node.lose(problem)
        elif not any(network.on(network.net(node, side)) for side in _ENDS):
            node.note(
                "dropped",
                message("simulink.contact_not_connected", "the contact: it is not connected"),
            )
        elif any(
            network.leads_outside(node, side, 1)
            for side in _ENDS
            if network.net(node, side) not in geometry
        ):
            node.note(
                "dropped",
                message("simulink.contact_with_outside", "the contact: with what this is put into"),
            )
        else:
            node.note(
                "lost",
                message(
                    "simulink.contact_without_solid",
                    "the contact: one of its ends is no solid or plane",
                ),
            )
    return contacts


def _geometry_ports(node: Node) -> Iterator[tuple[str, int]]:
    if node.kind in ("Infinite Plane", "Disk", CLOUD, GRID):
        yield "rconn", 1
    elif node.kind in SOLIDS:
        yield from ((port.side, port.number) for port in solid_ports(node) if port.what == GEOMETRY)


def _surface(node: Node) -> ContactParameters:
    if node.text("NormalForceType", "SmoothSpringDamper") != "SmoothSpringDamper":
        node.note(
            "approximated",
            message(
                "simulink.normal_force_from_signal",
                "its normal force comes from a signal: the figures of the block are taken",
            ),
        )
    friction = node.text("FrictionType", "SmoothStickSlip")
    if friction not in ("SmoothStickSlip", "None"):
        node.note(
            "approximated",
            message(
                "simulink.friction_from_signal",
                "its friction comes from a signal: the figures of the block are taken",
            ),
        )
    static = 0.0 if friction == "None" else node.number("CoefficientOfStaticFriction", "0.5")
    dynamic = 0.0 if friction == "None" else node.number("CoefficientOfDynamicFriction", "0.3")
    stiffness = node.number("NormalStiffness", "1e6", unit="N/m")
    damping = node.number("NormalDamping", "1e3", unit="N*s/m")
    if stiffness <= 0 or damping < 0 or min(static, dynamic) < 0:
        raise node.refusal(
            message(
                "simulink.stiffness_not_positive",
                "has a stiffness that is not positive, or a negative damping or friction",
            )
        )
    if dynamic > static:
        node.note(
            "repaired",
            message(
                "simulink.dynamic_over_static",
                "dynamic friction {dynamic:g} above static {static:g}: both {dynamic:g}",
                dynamic=dynamic,
                static=static,
            ),
        )
        static = dynamic
    speed = node.number("FrictionalCriticalVelocity", "1e-3", unit="m/s") or 1e-3
    return ContactParameters(stiffness, damping, static, dynamic, speed)
