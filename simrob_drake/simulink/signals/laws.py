"""What drives each joint and acts on each body: sums of signals, or motion over time; servos where the user asks."""

from dataclasses import dataclass
from math import inf

import numpy as np
from pydantic import TypeAdapter
from pydrake.math import RigidTransform

from simrob_drake.errors import SimrobError
from simrob_drake.importer.options import EntryKind
from simrob_drake.parts.controllers.flow_blocks import FlowBlock
from simrob_drake.parts.controllers.signal_flow import FlowBlockConfig
from simrob_drake.simulink.mechanics.bodies import BETWEEN, PUSH, Bodies, Coupling, Link, RigidPart
from simrob_drake.simulink.mechanics.joints import Freedom, Joint
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import applied
from simrob_drake.simulink.signals.forms import (
    Form,
    Primitive,
    Signal,
    Term,
    Value,
    added,
    closure,
    signal,
    terms_of,
    widened,
)
from simrob_drake.simulink.signals.frame_sensing import orientation
from simrob_drake.simulink.signals.tracing import Tracer

_ROUNDING = 1e-9
_INSTANT, _HARD = 1e-6, 1.0
_PLACES = 3
AS_WRITTEN: TypeAdapter[FlowBlock] = TypeAdapter(FlowBlockConfig)
"""What checks a block as it stands in a station's file."""


@dataclass
class Law:
    """What drives a joint.

    Attributes:
        net: its torque as a sum; 0 of a servo, and of a joint that a motion drives.
        reference: the position over time of a motion, or of the joint's reference where an input of the model says it;
            None where nothing does.
        kp, ki, kd, limit: of a servo, sat(kp (reference - q) + ki ∫ (reference - q) - kd w).
    """

    net: Value = 0.0
    reference: Value | None = None
    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    limit: float = inf

    @property
    def is_idle(self) -> bool:
        """Whether nothing drives the joint."""
        return not (self.kp or self.ki or self.kd or terms_of(self.net))


def read_laws(tracer: Tracer, joints: list[Joint], *, servos: bool = False) -> dict[Freedom, Law]:
    """Return the law of every driven degree of freedom; with ``servos`` those that come to one are servos.

    Raises:
        InvalidModel: vectors that do not fit.
    """
    laws: dict[Freedom, Law] = {}
    for joint in joints:
        for number, (freedom, how) in joint.inputs.items():
            effort = tracer.physical(joint.node, "lconn", number)
            value = _first(tracer, joint, number, how, effort)
            if how == "motion":
                laws[freedom] = Law(reference=value)
            else:
                laws[freedom] = (servos and _servo(value, freedom)) or Law(net=value)
    for term, (freedom, factor) in commanded([law.net for law in laws.values()]).items():
        if freedom in laws:
            laws[freedom].reference = Form({term: factor})
    return laws


def begin_on_motions(laws: dict[Freedom, Law]) -> None:
    """Let joints whose motion is given start on it, at its speed, before all that other joints ask for."""
    for freedom, law in laws.items():
        if freedom.driven == "motion" and law.reference is not None and of_time(law.reference):
            try:
                before, after = (_at(law.reference, time) for time in (0.0, _INSTANT))
            except (
                SimrobError,
                ValueError,
                ArithmeticError,
                RecursionError,
            ):  # what writes it tells it, or it is a loop
                continue
            freedom.start, freedom.start_speed = before, (after - before) / _INSTANT
            freedom.start_counts = freedom.speed_counts = _HARD


def _at(value: Value, time: float) -> float:
    """Return a value of time alone, at a time [s] so early that its states are as at the start."""
    total = 0.0
    for term, factor in terms_of(value).items():
        own = time if term.kind == "time" else 1.0
        if isinstance(term.of, Primitive):
            inputs = [_at(one, time) for one in term.of.inputs()]
            written = {"kind": term.of.kind, **term.of.parameters, **({"of": [{}] * len(inputs)} if inputs else {})}
            block = AS_WRITTEN.validate_python(written)
            own = block.output(time, block.start, inputs)[term.index]
        total += factor * float(own)
    return total


def _first(tracer: Tracer, joint: Joint, number: int, how: str, effort: Signal | None) -> Value:
    """Return the first element of what drives a joint; what nothing drives is told, and is 0."""
    if effort is not None and effort.size:
        first: Value = effort.ravel()[0]
        return first
    outside = tracer.network.leads_outside(joint.node, "lconn", number)
    message = (
        "comes from a port of the model" if outside else "has no elements" if effort is not None else "is not connected"
    )
    deed: EntryKind = "defaulted" if outside else "lost"
    joint.node.findings.report.add(deed, joint.node.path, f"its {how} input {message}: nothing drives it")
    return 0.0


def commanded(values: list[Value]) -> dict[Term, tuple[Freedom, float]]:
    """Return which joint's position follows which input of the model, and the factor: `k (factor input - q)`."""
    found: dict[Term, tuple[Freedom, float]] = {}
    taken: set[Freedom] = set()
    for terms in closure(values):
        for term, value in terms.items():
            for other, gain in terms.items() if term.kind == "input" and term not in found else ():
                if other.kind == "q" and isinstance(other.of, Freedom) and other.of not in taken and gain * value < 0:
                    found[term] = other.of, -value / gain
                    taken.add(other.of)
                    break
    return found


def _servo(value: Value, freedom: Freedom) -> Law | None:
    law, factor = Law(), 1.0
    while isinstance(value, Form) and len(value.terms) == 1:
        ((term, own),) = value.terms.items()
        block = term.of
        if not isinstance(block, Primitive) or block.kind != "saturation":
            break
        lower, upper = block.parameters.get("lower", -inf), block.parameters.get("upper", inf)
        if abs(lower + upper) > _ROUNDING * max(1.0, abs(upper)):
            return None
        factor *= own
        law.limit = min(law.limit, abs(factor) * upper)
        (value,) = block.inputs()
    terms = {term: factor * own for term, own in terms_of(value).items()}
    return law if _take(law, terms, freedom) else None


def _take(law: Law, terms: dict[Term, float], freedom: Freedom) -> bool:
    """Fill a servo in, and tell whether that is all there is to it."""
    terms = _without_pid(law, terms)
    q, w = Term("q", freedom), Term("w", freedom)
    law.kp, law.kd = -terms.pop(q, 0.0), law.kd - terms.pop(w, 0.0)
    integrals = [term for term in terms if isinstance(term.of, Primitive) and term.of.kind == "integrator"]
    for term in integrals:
        assert isinstance(term.of, Primitive)
        (value,) = term.of.inputs()
        inner = terms_of(value)
        law.ki += -terms.pop(term) * inner.get(q, 0.0)
        if {"lower", "upper", "period"} & term.of.parameters.keys() or not all(map(_asks, inner.keys() - {q})):
            return False
    if min(law.kp, law.ki, law.kd) < 0 or not all(map(_asks, terms)) or (terms and not law.kp):
        return False
    if law.kp:
        law.reference = added((1.0 / law.kp, Form(terms)))
    return True


def _without_pid(law: Law, terms: dict[Term, float]) -> dict[Term, float]:
    """Return terms with PID controllers as what they come to without their filter: told as an approximation."""
    total: dict[Term, float] = {}
    for term, own in terms.items():
        block = term.of
        if not isinstance(block, Primitive) or block.kind != "pid" or block.parameters.get("period"):
            total[term] = total.get(term, 0.0) + own
            continue
        (error, *_) = block.inputs()
        parameters, node = block.parameters, block.node
        law.limit = min(law.limit, abs(own) * parameters.get("upper", inf))
        for inner, factor in terms_of(error).items():
            total[inner] = total.get(inner, 0.0) + own * factor * parameters.get("p", 0.0)
            if inner.kind == "q":
                law.ki -= own * factor * parameters.get("i", 0.0)
                law.kd -= own * factor * parameters.get("d", 0.0)
        if node is not None and parameters.get("d"):
            message = "its derivative acts on measured speed alone, unfiltered"
            node.findings.report.add("approximated", node.path, message)
    return total


def _asks(term: Term) -> bool:
    """Tell whether a term can be part of a reference: a constant, an input, or of time alone."""
    if term.kind in ("one", "input", "time"):
        return True
    return isinstance(term.of, Primitive) and of_time(Form({term: 1.0}))


def of_time(value: Value) -> bool:
    """Tell whether a value depends on time alone."""
    return all(term.kind in ("one", "time", "block") for terms in closure([value]) for term in terms)


@dataclass(frozen=True, eq=False)
class ExternalForce:
    """What one block applies.

    Attributes:
        node: the block.
        body, pose: on which it acts, and its frame in the first one of that.
        force, torque: along the axes of its frame, each of 3 [N, N·m].
        senses: whether it acts along the axes of the world, so that the orientation of its frame is measured.
        ends: the blocks on whose frames what it senses is, and from where that is seen; its own unless given.
    """

    node: Node
    body: RigidPart
    pose: RigidTransform
    force: list[Value]
    torque: list[Value]
    senses: bool
    ends: tuple[Node, Node] | None = None


def read_pushes(tracer: Tracer, bodies: Bodies) -> list[ExternalForce]:
    """Return what blocks apply from signals; those that inputs of the model drive alone stay ports of the station."""
    pushes = []
    for body in bodies.bodies:
        for node, pose in [mark for mark in body.marks if mark[0].kind == PUSH]:
            push = _push(tracer, node, body, pose)
            if any(term.kind != "input" for terms in closure([*push.force, *push.torque]) for term in terms):
                pushes.append(push)
                body.marks.remove((node, pose))
            else:
                message = "it is the port external_force or external_torque of the station, at this frame"
                node.findings.report.add("read", node.path, message)
    for coupling in bodies.couplings:
        if coupling.node.kind == BETWEEN:
            pushes += _apart(tracer, coupling)
    for link in bodies.links:
        if link.joint.pulls:
            pushes += _pulled(tracer, link)
    return pushes


def _pulled(tracer: Tracer, link: Link) -> list[ExternalForce]:
    """Return what signals, springs and dampers of a floating joint do to its follower, and to a base that can move."""
    node, wrench = link.joint.node, np.zeros(6).astype(object)
    for pull in link.joint.pulls:
        place, speed = (
            _sensed(node, pull.place % _PLACES),
            _sensed(node, pull.place + 7),
        )  # of a torque it has no spring
        if pull.port and (values := tracer.physical(node, "lconn", pull.port)) is not None:
            wrench[pull.place] += values.ravel()[0]
        elif pull.port:
            node.findings.report.add("lost", node.path, "its force input is not connected: nothing drives it")
        wrench[pull.place] -= pull.stiffness * (place - pull.rest) + pull.damping * speed
        for bound, way, stiffness in pull.stops:
            wrench[pull.place] += way * stiffness * applied("max", 0.0, way * (bound - place))
    force, torque = wrench[:_PLACES], wrench[_PLACES:]
    turn = orientation(node).T
    pushes = [ExternalForce(node, link.follower, link.in_follower, list(turn.dot(force)), list(turn.dot(torque)), True)]
    if not link.base.grounded:
        arm = [_sensed(node, index) for index in range(_PLACES)]
        moment = [torque[i] + arm[i - 2] * force[i - 1] - arm[i - 1] * force[i - 2] for i in range(_PLACES)]
        pushes.append(ExternalForce(node, link.base, link.in_base, list(-1.0 * force), [-one for one in moment], True))
    return pushes


def _sensed(node: Node, part: int) -> Form:
    """Return a part of what a frame sensor of a block measures."""
    return Form({Term("sensed", node, part): 1.0})


def _apart(tracer: Tracer, coupling: Coupling) -> list[ExternalForce]:
    """Return what pushes two bodies apart along the line between them, on the follower and on the base."""
    node = coupling.node
    values = tracer.physical(node, "lconn", 2)
    if values is None:
        values = tracer.physical(node, "rconn", 2)
    if values is None:
        node.findings.report.add("lost", node.path, "its force input is not connected: nothing drives it")
        return []
    line = [_sensed(node, index) for index in range(_PLACES)]
    length = applied("sqrt", sum((part * part for part in line), start=0.0))
    pull: Signal = signal([values.ravel()[0] * (part / length) for part in line])
    ends = (coupling.base, coupling.in_base, -1.0 * pull), (
        coupling.follower, coupling.in_follower, orientation(node).T.dot(pull))  # fmt: skip
    return [ExternalForce(node, body, pose, list(force), [0.0] * 3, True) for body, pose, force in ends]


def _push(tracer: Tracer, node: Node, body: RigidPart, pose: RigidTransform) -> ExternalForce:
    """Read the ports of one block, of the force and then of the torque: for each axis that is on, then a vector."""
    port, senses, parts = 0, False, []
    for what in ("Force", "Torque"):
        vector: Signal = np.zeros(3).astype(object)
        for axis in ("X", "Y", "Z", ""):
            if not node.is_on(f"Enable{what}{axis}"):
                continue
            port += 1
            values = tracer.physical(node, "lconn", port)
            if values is not None and axis:
                vector["XYZ".index(axis)] += values.ravel()[0]
            elif values is not None and values.size in (1, _PLACES):
                vector = vector + widened(values.ravel(), _PLACES)
            elif values is not None:
                message = f"its {what.lower()} input has {values.size} elements, not {_PLACES}: nothing drives it"
                node.findings.report.add("lost", node.path, message)
        if node.text(f"{what}ResolutionFrame", "AttachedFrame") == "World" and any(vector):
            senses, vector = True, orientation(node).T.dot(vector)
        parts.append(list(vector))
    return ExternalForce(node, body, pose, parts[0], parts[1], senses)
