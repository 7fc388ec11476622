"""What touches what: feet of robots, surfaces of pieces, the floor."""

from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportReport
from simrob_drake.simulink.mechanics.bodies import Bodies, RigidPart, frame_place
from simrob_drake.simulink.mechanics.contacts import ContactPair, ContactParameters, dissipation
from simrob_drake.simulink.mechanics.shapes import NOTHING, Shape, positive
from simrob_drake.simulink.mechanics.solids import SolidBody
from simrob_drake.simulink.model.network import Connections
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.writing.urdf import RobotFile

_PLANE = "Infinite Plane"
MOST_DISSIPATION = 50.0
"""s/m: a contact that damps more does not bounce either way, and is hard to integrate."""


@dataclass
class Touching:
    """The contacts of a station.

    Attributes:
        ends: bodies and solids of each contact.
        floor: whether a plane at z = 0 is one of the ends.
        slabs: other planes and disks of the world, as what is under them, in the model's world.
        colliding: solids that touch.
        standing: those of them that are feet of robots.
    """

    ends: list[tuple[ContactPair, tuple[RigidPart, Node], tuple[RigidPart, Node]]] = field(default_factory=list)
    floor: bool = False
    slabs: dict[Node, SolidBody] = field(default_factory=dict)
    colliding: set[Node] = field(default_factory=set)
    standing: set[Node] = field(default_factory=set)


def read_touching(contacts: list[ContactPair], bodies: Bodies, network: Connections, turn: RigidTransform) -> Touching:
    """Sort contacts by what they connect; ``turn`` places the model's world in ours."""
    touching = Touching()
    for contact in contacts:
        one, other = ((bodies.by_place[frame_place(network, node)], node) for node in contact.pair)
        touching.ends.append((contact, one, other))
        for body, node in (one, other):
            touching.colliding.add(node)
            if node.kind not in (_PLANE, "Disk"):
                continue
            pose = body.frames[network.net(node, "lconn")]
            there = turn @ pose
            flat = np.allclose(there.rotation().matrix()[:, 2], [0, 0, 1], atol=1e-6)
            if not body.grounded:
                node.findings.report.add("dropped", contact.node.path, f"contact of {node.path}, a surface that moves")
            elif node.kind == _PLANE and flat and abs(there.translation()[2]) < 1e-6:
                touching.floor = True
            elif node not in touching.slabs:
                touching.slabs[node] = _slab(node, pose)
    return touching


def _slab(node: Node, pose: RigidTransform) -> SolidBody:
    """Return what is under a plane, 20 m wide, or under a disk."""
    if node.kind == _PLANE:
        shape, thick = Shape("box", (20.0, 20.0, 1.0)), 1.0
    else:
        (radius,), thick = positive(node, "Radius", "1", 1), 0.02
        shape = Shape("cylinder", (radius, thick))
    grey = (0.5, 0.5, 0.5, 1.0)
    under = pose @ RigidTransform([0.0, 0.0, -thick / 2])
    return SolidBody(node, NOTHING, shape, grey, visible=node.kind != _PLANE, pose=under)


def feet_of(robot: RobotFile, touching: Touching, gravity: float, report: ImportReport) -> dict[str, Any] | None:
    """Return the feet of a robot as its `robot.yaml` has them: spheres of one radius, or None.

    A box stands on small spheres in its corners, which share its spring and damper by four.
    """
    points: dict[str, list[list[float]]] = {}
    radii: list[float] = []
    surfaces: list[ContactParameters] = []
    seen: set[Node] = set()
    for contact, *ends in touching.ends:
        for body, node in ends:
            if body not in robot.links or body.grounded or node in seen:
                continue
            seen.add(node)
            solid = next((solid for solid in body.solids if solid.node is node), None)
            if solid is None or solid.shape is None or solid.shape.kind not in ("sphere", "box"):
                message = f"contact of {node.path}: only spheres and boxes of robots touch"
                report.add("dropped", contact.node.path, message)
                continue
            touching.standing.add(node)
            own, radius, share = _spheres(solid.shape)
            if share > 1:
                report.add("repaired", node.path, f"a box that touches: spheres of {radius:.3g} m in its corners")
            pose, surface = robot.frames[body].inverse() @ solid.pose, contact.surface
            places = [[round(float(value), 12) for value in pose.multiply(point)] for point in own]
            points.setdefault(robot.links[body], []).extend(places)
            radii += [radius] * share
            surfaces.append(replace(surface, stiffness=surface.stiffness / share, damping=surface.damping / share))
    if not points:
        return None
    if len(set(radii)) > 1 or len(set(surfaces)) > 1:
        report.add("repaired", robot.element.get("name", ""), "its contacts differ: all get the figures of the first")
    surface = surfaces[0]
    damping = bounded_dissipation(surface, robot.mass * gravity / len(radii), report, robot.element.get("name", ""))
    kind = {
        "radius": float(radii[0]),
        "stiffness": surface.stiffness,
        "dissipation": damping,
        "friction": [surface.static, surface.dynamic],
        "points": points,
    }
    return {"default": "spheres", "contacts": {"spheres": kind}}


def _spheres(shape: Shape) -> tuple[list[Vector], float, int]:
    """Return the spheres that a sphere or a box touches with: middles, radius, and how many of them carry it."""
    if shape.kind == "sphere":
        return [np.zeros(3)], shape.size[0], 1
    half = np.array(shape.size) / 2
    radius = float(half.min() / 5)
    return [np.array(signs) * (half - radius) for signs in product((-1, 1), repeat=3)], radius, 4


def bounded_dissipation(surface: ContactParameters, weight: float, report: ImportReport, where: str) -> float:
    """Return the dissipation of a contact, and tell how it differs from the model's damper."""
    exact = dissipation(surface, weight)
    taken = float(f"{min(exact, MOST_DISSIPATION):.6g}")
    depth = 2 * weight / surface.stiffness
    message = (
        f"contact damper {surface.damping:g} N·s/m beside the spring as dissipation {taken:g} s/m: "
        f"equal at a depth of {surface.damping / surface.stiffness / taken:.2g} m"
        if taken
        else "contact without damping"
    )
    if exact > MOST_DISSIPATION:
        message += f" (for {depth:.2g} m it would be {exact:.3g}: neither bounces)"
    report.add("repaired", where, message)
    return taken
