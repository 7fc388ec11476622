"""The contact, sensors and monitors of a station, from the contacts of a model."""

from dataclasses import dataclass, field
from typing import Any

from pydrake.math import RigidTransform

from simrob_drake.parts.site import WORLD
from simrob_drake.simulink.mechanics.bodies import RigidPart
from simrob_drake.simulink.mechanics.trees import Tree
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.simulink_model import SimulinkModel
from simrob_drake.simulink.writing.names import UniqueNames
from simrob_drake.simulink.writing.touching import Touching, bounded_dissipation
from simrob_drake.simulink.writing.urdf import RobotFile


@dataclass
class StationFiles:
    """What is written.

    Attributes:
        robots: by name, with their `robot.yaml`.
        pieces: names.
        groups: of those that stand in the world, by the subsystem or block that they come from.
        free: of those that nothing holds, by what they are.
        content: of the station's file; empty where nothing moves, and there is no station.
    """

    robots: dict[str, RobotFile] = field(default_factory=dict)
    pieces: list[str] = field(default_factory=list)
    groups: dict[str, str] = field(default_factory=dict)
    free: dict[Tree, str] = field(default_factory=dict)
    content: dict[str, Any] = field(default_factory=dict)

    def named(self, body: RigidPart, turn: RigidTransform) -> tuple[str, RigidTransform] | None:
        """Return what a body is called in the station, and the pose of its first frame there; None if it is not in it.

        ``turn`` places the model's world in ours.
        """
        if body.grounded:
            return WORLD, turn
        for name, robot in self.robots.items():
            if body in robot.links:
                prefix = f"{name}." if len(self.robots) > 1 else ""
                return prefix + robot.links[body], robot.frames[body].inverse()
        return next(((name, tree.frame.inverse()) for tree, name in self.free.items() if tree.root is body), None)


def contact_sections(
    touching: Touching, files: StationFiles, model: SimulinkModel, gravity: float, names: UniqueNames
) -> dict[str, Any]:
    """Return the sections `contact`, `sensors` and `monitors`.

    Args:
        touching: the contacts.
        files: the robots and pieces that are written.
        model: what was read.
        gravity: [m/s²].
        names: those that are given.
    """
    writer = _Sections(touching, files, model, gravity, names)
    return {"contact": writer.contact(), **writer.sensors()}


class _Sections:
    """One station's."""

    def __init__(
        self, touching: Touching, files: StationFiles, model: SimulinkModel, gravity: float, names: UniqueNames
    ) -> None:
        self.touching, self.files, self.model = touching, files, model
        self.gravity, self.names, self.report = gravity, names, model.report

    def contact(self) -> dict[str, Any]:
        """Return the contact section: the figures of the first contact that no robot's feet tell."""
        section: dict[str, Any] = {"model": "point"}
        robot_bodies = {body for robot in self.files.robots.values() for body in robot.links}
        own = [
            (contact, ends)
            for contact, *ends in self.touching.ends
            if not any(body in robot_bodies and not body.grounded for body, _ in ends)
        ]
        if own and self.files.pieces:
            contact, ends = own[0]
            surface = contact.surface
            moving = next((body for body, _ in ends if not body.grounded), None)
            weight = sum(solid.weight.mass for solid in moving.solids) * self.gravity if moving else 1.0
            shared = sum(any(body is moving for body, _ in other) for _, other in own)
            section |= {
                "stiffness": surface.stiffness,
                "dissipation": bounded_dissipation(surface, weight / shared, self.report, contact.node.path),
                "friction": {"static": surface.static, "dynamic": surface.dynamic},
                "stiction_speed": surface.speed,
            }
            if len({other.surface for other, _ in own}) > 1:
                self.report.add("repaired", "contact", "contacts differ: all pieces get the figures of the first")
        elif self.touching.ends:
            section["stiction_speed"] = self.touching.ends[0][0].surface.speed
        return section

    def sensors(self) -> dict[str, Any]:
        """Return distance sensors for contacts that sense it, and monitors where it stops the simulation."""
        sensors: dict[str, Any] = {}
        monitors: dict[str, Any] = {}
        for contact, *ends in self.touching.ends:
            if not contact.senses_distance:
                continue
            names = [self._end_name(body, node) for body, node in ends]
            if None in names:
                continue
            body, other = (names[1], names[0]) if names[0] == "floor" else (names[0], names[1])
            name = self.names.give(contact.node.path)
            sensors[name] = {"kind": "distance", "body": body, "other": other}
            if contact.node in self.model.stopping:
                monitors[f"{name}_stop"] = {"kind": "contact", "sensor": name}
        return ({"sensors": sensors} if sensors else {}) | ({"monitors": monitors} if monitors else {})

    def _end_name(self, body: RigidPart, node: Node) -> str | None:
        if any(body in robot.links and not body.grounded for robot in self.files.robots.values()):
            named = self.files.named(body, RigidTransform())
            return named[0] if named and node in self.touching.standing else None
        if node.kind == "Infinite Plane" and node not in self.touching.slabs:
            return "floor"
        free = next((name for tree, name in self.files.free.items() if tree.root is body), None)
        return free or self.files.groups.get(node.path.partition("/")[0]) or None
