"""What touches what: feet of robots, surfaces of pieces, the floor."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.importer.report import ImportReport
from simrob_drake.simulink.mechanics.bodies import Bodies, Body, frame_place
from simrob_drake.simulink.mechanics.contacts import Contact, Surface, dissipation
from simrob_drake.simulink.model.network import Network
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.writing.urdf import RobotFile

MOST_DISSIPATION = 50.0
"""s/m: a contact that damps more does not bounce either way, and is hard to integrate."""


@dataclass
class Touching:
    """The contacts of a station.

    Attributes:
        ends: bodies and solids of each contact.
        surface: figures that all share, as the station says them; None without contacts.
        floor: whether a plane at z = 0 is one of the ends.
        colliding: solids that touch.
    """

    ends: list[tuple[Contact, tuple[Body, Node], tuple[Body, Node]]] = field(default_factory=list)
    floor: bool = False
    planes: list[tuple[Node, RigidTransform]] = field(default_factory=list)
    colliding: set[Node] = field(default_factory=set)


def read_touching(contacts: list[Contact], bodies: Bodies, network: Network, turn: RigidTransform) -> Touching:
    """Sort contacts by what they connect; ``turn`` places the model's world in ours."""
    touching = Touching()
    for contact in contacts:
        one, other = ((bodies.by_place[frame_place(network, node)], node) for node in contact.pair)
        touching.ends.append((contact, one, other))
        for body, node in (one, other):
            touching.colliding.add(node)
            if node.kind in ("Infinite Plane", "Disk") and body.grounded:
                pose = turn @ body.frames[network.net(node, "lconn")]
                flat = np.allclose(pose.rotation().matrix()[:, 2], [0, 0, 1], atol=1e-6)
                if flat and abs(pose.translation()[2]) < 1e-6:
                    touching.floor = True
                elif (node.path, None) not in [(other_node.path, None) for other_node, _ in touching.planes]:
                    touching.planes.append((node, pose))
    return touching


def feet_of(robot: RobotFile, touching: Touching, gravity: float, report: ImportReport) -> dict[str, Any] | None:
    """Return the feet of a robot as its `robot.yaml` has them: spheres of one radius, or None."""
    points: dict[str, list[list[float]]] = {}
    radii: list[float] = []
    surfaces: list[Surface] = []
    seen: set[Node] = set()
    for contact, *ends in touching.ends:
        for body, node in ends:
            if body not in robot.links or body.grounded or node in seen:
                continue
            seen.add(node)
            solid = next((solid for solid in body.solids if solid.node is node), None)
            if solid is None or solid.shape is None or solid.shape.kind != "sphere":
                report.add("dropped", contact.node.path, f"contact of {node.path}: only spheres of robots touch")
                continue
            place = (robot.frames[body].inverse() @ solid.pose).translation()
            points.setdefault(robot.links[body], []).append([round(float(value), 12) for value in place])
            radii.append(solid.shape.size[0])
            surfaces.append(contact.surface)
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


def bounded_dissipation(surface: Surface, weight: float, report: ImportReport, where: str) -> float:
    """Return the dissipation of a contact, and tell how it differs from the model's damper."""
    wanted = dissipation(surface, weight)
    taken = float(f"{min(wanted, MOST_DISSIPATION):.6g}")
    depth = 2 * weight / surface.stiffness
    told = (
        f"contact damper {surface.damping:g} N·s/m beside the spring as dissipation {taken:g} s/m: "
        f"equal at a depth of {surface.damping / surface.stiffness / taken:.2g} m"
        if taken
        else "contact without damping"
    )
    if wanted > MOST_DISSIPATION:
        told += f" (for {depth:.2g} m it would be {wanted:.3g}: neither bounces)"
    report.add("repaired", where, told)
    return taken
