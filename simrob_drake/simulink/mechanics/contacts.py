"""Spatial Contact Forces: which solids touch, and with which figures."""

from collections.abc import Iterator
from dataclasses import dataclass

from simrob_drake.simulink.mechanics.solid_ports import GEOMETRY, solid_ports
from simrob_drake.simulink.mechanics.solids import SOLIDS
from simrob_drake.simulink.model.network import Connections, Place
from simrob_drake.simulink.model.nodes import Node


@dataclass(frozen=True)
class ContactParameters:
    """Figures of a contact.

    Attributes:
        stiffness: [N/m].
        damping: [N·s/m], of a damper beside the spring.
        static, dynamic: coefficients of friction.
        speed: below which a contact sticks [m/s].
    """

    stiffness: float
    damping: float
    static: float
    dynamic: float
    speed: float


@dataclass(frozen=True, eq=False)
class ContactPair:
    """A pair that may touch.

    Attributes:
        node: the block.
        pair: the two solids or surfaces.
        surface: the figures.
        senses_distance: the number of the port that tells the distance, or 0.
    """

    node: Node
    pair: tuple[Node, Node]
    surface: ContactParameters
    senses_distance: int = 0


_DISTANCE_AFTER = 2  # it is the first of the sensed signals


def read_contacts(network: Connections) -> list[ContactPair]:
    """Return the contacts of a model.

    Raises:
        InvalidModel: figures that cannot be.
    """
    nodes = [node for node in network.expanded.nodes if node.block.commented == "off"]
    geometry: dict[Place, Node] = {}
    for node in nodes:
        for side, number in _geometry_ports(node):
            geometry[network.net(node, side, number)] = node
    contacts = []
    for node in nodes:
        if node.kind != "Spatial Contact Force":
            continue
        ends = [geometry.get(network.net(node, side)) for side in ("lconn", "rconn")]
        if ends[0] is None or ends[1] is None:
            node.findings.report.add("dropped", node.path, "the contact: one of its ends is no solid or plane")
            continue
        sensed = _DISTANCE_AFTER if node.is_on("SenseSeparationDistance") else 0
        contacts.append(ContactPair(node, (ends[0], ends[1]), _surface(node), sensed))
    return contacts


def _geometry_ports(node: Node) -> Iterator[tuple[str, int]]:
    """Return the ports that hand out a shape."""
    if node.kind in ("Infinite Plane", "Disk"):
        yield "rconn", 1
    elif node.kind in SOLIDS:
        yield from ((port.side, port.number) for port in solid_ports(node) if port.what == GEOMETRY)


def _surface(node: Node) -> ContactParameters:
    report = node.findings.report
    if node.text("NormalForceType", "SmoothSpringDamper") != "SmoothSpringDamper":
        report.add("dropped", node.path, "its normal force comes from a signal: the figures of the block are taken")
    friction = node.text("FrictionType", "SmoothStickSlip")
    if friction not in ("SmoothStickSlip", "None"):
        report.add("dropped", node.path, "its friction comes from a signal: the figures of the block are taken")
    without = friction == "None"
    static = 0.0 if without else node.number("CoefficientOfStaticFriction", "0.5")
    dynamic = 0.0 if without else node.number("CoefficientOfDynamicFriction", "0.3")
    stiffness = node.number("NormalStiffness", "1e6", unit="N/m")
    damping = node.number("NormalDamping", "1e3", unit="N*s/m")
    if stiffness <= 0 or damping < 0 or min(static, dynamic) < 0:
        raise node.refusal("has a stiffness that is not positive, or a negative damping or friction")
    if dynamic > static:
        report.add("repaired", node.path, f"dynamic friction {dynamic:g} above static {static:g}: both {dynamic:g}")
        static = dynamic
    return ContactParameters(
        stiffness, damping, static, dynamic, node.number("FrictionalCriticalVelocity", "1e-3", unit="m/s") or 1e-3
    )


def dissipation(surface: ContactParameters, weight_carried: float) -> float:
    """Return Hunt and Crossley's d [s/m] for a contact with a damper beside its spring.

    Simscape adds k x and b dx/dt; Drake multiplies, k x (1 + d dx/dt). They are equal at the depth b / (k d), which is
    put to twice the depth at rest: as deep as a body sinks that is laid down.

    Args:
        surface: of the contact.
        weight_carried: what presses on it at rest [N].
    """
    depth = max(2 * weight_carried / surface.stiffness, 1e-6)
    return surface.damping / (surface.stiffness * depth)
