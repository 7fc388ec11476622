"""What each type of block gives at its outputs, and how the signals of a model are followed by that."""

from functools import partial

from simrob_drake.simulink.mechanics.bodies import ContactPair
from simrob_drake.simulink.mechanics.joints import Joint
from simrob_drake.simulink.model.network import Connections
from simrob_drake.simulink.signals.arithmetic import ARITHMETIC
from simrob_drake.simulink.signals.dynamics import DYNAMICS
from simrob_drake.simulink.signals.forms import MOST_ELEMENTS, Form, Signal, Term, TermKind, signal
from simrob_drake.simulink.signals.matlab import MATLAB, offer_component
from simrob_drake.simulink.signals.networks import NETWORKS, outputs_of
from simrob_drake.simulink.signals.robotics import ROBOTICS
from simrob_drake.simulink.signals.routing import ROUTING, subsystem
from simrob_drake.simulink.signals.sources import PHYSICAL, SENSOR, SOURCES, out_of_physics, sensed
from simrob_drake.simulink.signals.tracing import Rule, Tracer

RULES: dict[str, Rule] = {
    **ROUTING, **ARITHMETIC, **SOURCES, **DYNAMICS, **MATLAB, **PHYSICAL, **NETWORKS, **ROBOTICS,
    "PS-Simulink Converter": out_of_physics,
}  # fmt: skip
"""What each type of block gives."""
_SENSED: dict[str, TermKind] = {kind: kind for kind in ("q", "w", "a", "t")}


def tracer_of(network: Connections, joints: list[Joint], contacts: list[ContactPair]) -> Tracer:
    """Return what follows the signals of a model, those that joints, contacts and sensors measure included."""
    tracer = Tracer(network, {**RULES, **dict.fromkeys(("SubSystem", "ModelReference"), subsystem)})
    for joint in joints:
        _offer_sensed(tracer, joint)
    for contact in contacts:
        if contact.senses_distance:
            tracer.offer(contact.node, contact.senses_distance, partial(_each, Term("distance", contact.node)))
    for node in network.expanded.nodes:
        if node.kind == SENSOR:
            for number, give in sensed(node).items():
                tracer.offer(node, number, give)
        elif node.kind in PHYSICAL:
            tracer.offer(node, 1, partial(tracer.output, node))
        elif node.kind not in NETWORKS:
            offer_component(tracer, node)
        for number, (_, side, port) in enumerate(outputs_of(node) if node.kind in NETWORKS else (), start=1):
            tracer.offer(node, port, partial(tracer.output, node, number), side)
    return tracer


def _offer_sensed(tracer: Tracer, joint: Joint) -> None:
    for number, (freedom, what) in joint.outputs.items():
        term = (
            Term(_SENSED[what], freedom) if what in _SENSED else Term("open", joint.node, (number - 1) * MOST_ELEMENTS)
        )
        tracer.offer(joint.node, number, partial(_each, term))
    for number, parts in joint.senses.items():
        terms = [Term("sensed", joint.node, part) for part in parts]
        tracer.offer(joint.node, number, partial(_each, *(terms or [Term("open", joint.node, number)])))


def _each(*terms: Term) -> Signal:
    return signal(Form({term: 1.0}) for term in terms)
