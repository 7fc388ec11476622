"""What drives joints and acts on bodies: sums of signals, motion over time, contact; servos where the user asks."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, count
from math import inf

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import (
    BETWEEN,
    PUSH,
    Bodies,
    ContactPair,
    ContactParameters,
    Coupling,
    Link,
    RigidPart,
)
from simrob_drake.extensions.simulink.mechanics.joints import Freedom, Joint
from simrob_drake.extensions.simulink.mechanics.loops import PRESCRIBED
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.arithmetic import applied, limited, looked_up
from simrob_drake.extensions.simulink.signals.forms import (
    PARTS,
    Form,
    Primitive,
    Signal,
    Term,
    Tracer,
    Value,
    added,
    closure,
    early,
    of_time,
    signal,
    terms_of,
    widened,
)
from simrob_drake.extensions.simulink.signals.sources import orientation, part_of
from simrob_drake.robots.imports import EntryKind

_ROUNDING = 1e-9
_INSTANT = 1e-6
_PLACES = 3


@dataclass
class Law:
    """What drives a joint."""

    net: Value = 0.0  # its torque as a sum; 0 of a servo, and of a joint that a motion drives
    # the position over time of a motion, or of the joint's reference where an input of the model says it; None where
    # nothing does
    reference: Value | None = None
    kp: float = 0.0  # of a servo, sat(kp (reference - q) + ki ∫ (reference - q) - kd w)
    ki: float = 0.0
    kd: float = 0.0
    limit: float = inf
    rotor: float = 0.0  # the inertia of a motor's rotor as the joint feels it [kg m², or kg]

    @property
    def is_idle(self) -> bool:
        """Whether nothing drives the joint."""
        return not (self.kp or self.ki or self.kd or terms_of(self.net))


def read_laws(tracer: Tracer, joints: list[Joint], *, servos: bool = False) -> dict[Freedom, Law]:
    """Return the law of every driven degree of freedom; with ``servos`` those that come to one are servos.

    Raises InvalidModel: vectors that do not fit.
    """
    laws: dict[Freedom, Law] = {}
    for joint in joints:
        for number, (freedom, how) in joint.inputs.items():
            value = _first(tracer, joint.node, number, how)
            if how == "motion":
                laws[freedom] = Law(reference=value)
            else:
                rotor = -terms_of(value).get(Term("a", freedom), 0.0)
                if rotor > 0:
                    value = added((1.0, value), (rotor, Form({Term("a", freedom): 1.0})))
                laws[freedom] = (servos and _servo(value, freedom)) or Law(net=value)
                laws[freedom].rotor = max(rotor, 0.0)
    for term, (freedom, factor) in commanded([law.net for law in laws.values()]).items():
        if freedom in laws:
            laws[freedom].reference = Form({term: factor})
    _follow_motions({freedom: law for freedom, law in laws.items() if freedom.driven == "motion"})
    return laws


def _follow_motions(moved: dict[Freedom, Law]) -> None:
    """Let motions that take the position of a joint whose motion is given, perhaps their own, take that motion."""
    motions = {freedom: law.reference or 0.0 for freedom, law in moved.items()}
    made: dict[Primitive, Primitive] = {}

    def block(old: Primitive) -> Primitive:
        if old not in made:
            made[old] = replace(old, inputs=lambda: [inserted(one) for one in old.inputs()])
        return made[old]

    def inserted(value: Value, within: tuple[Freedom, ...] = ()) -> Value:
        total: list[tuple[float, Value]] = []
        for term, factor in terms_of(value).items():
            part: Value = Form({term: 1.0})
            if isinstance(term.of, Primitive):
                part = Form({replace(term, of=block(term.of)): 1.0})
            elif (
                term.kind == "q"
                and isinstance(term.of, Freedom)
                and term.of in motions
                and term.of not in within
            ):
                part = inserted(motions[term.of], (*within, term.of))
            total.append((factor, part))
        return added(*total)

    for freedom, law in moved.items():
        if any(
            term.kind == "q" and term.of in motions
            for terms in closure([motions[freedom]])
            for term in terms
        ):
            law.reference = inserted(motions[freedom], (freedom,))


def begin_on_motions(laws: dict[Freedom, Law]) -> None:
    """Let joints whose motion is given start on it, at its speed, before all that other joints ask for."""
    for freedom, law in laws.items():
        if freedom.driven == "motion" and law.reference is not None and of_time(law.reference):
            before, after = (early(law.reference, time) for time in (0.0, _INSTANT))
            if before is not None and after is not None:
                freedom.start, freedom.start_speed = before, (after - before) / _INSTANT
                freedom.start_counts = freedom.speed_counts = PRESCRIBED


def _first(tracer: Tracer, node: Node, number: int, how: str) -> Value:
    """Return the first element of what drives a joint at a port; what nothing drives is told, and is 0."""
    effort = tracer.physical(node, "lconn", number)
    if effort is not None and effort.size:
        first: Value = effort.ravel()[0]
        return first
    open_ = tracer.network.alone(node, "lconn", number)  # it is 0, as in Simscape
    deed: EntryKind = "defaulted" if open_ else "lost"
    text = (
        message("simulink.is_not_connected", "is not connected")
        if open_
        else message("simulink.comes_from_unread", "comes from what is not read")
        if effort is None
        else message("simulink.has_no_elements", "has no elements")
    )
    if tracer.network.leads_outside(node, "lconn", number):
        deed, text = (
            "defaulted",
            message("simulink.comes_from_port", "comes from a port of the model"),
        )
    node.note(
        deed,
        message(
            "simulink.nothing_drives_input",
            "its {how} input {problem}: nothing drives it",
            how=how,
            problem=text,
        ),
    )
    return 0.0


def commanded(values: list[Value]) -> dict[Term, tuple[Freedom, float]]:
    """Return which joint's position follows which input of the model, and the factor: `k (factor input - q)`."""
    found: dict[Term, tuple[Freedom, float]] = {}
    taken: set[Freedom] = set()
    for terms in closure(values):
        for term, value in terms.items():
            for other, gain in terms.items() if term.kind == "input" and term not in found else ():
                if (
                    other.kind == "q"
                    and isinstance(other.of, Freedom)
                    and other.of not in taken
                    and gain * value < 0
                ):
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
    terms = _without_pid(law, terms)
    q, w = Term("q", freedom), Term("w", freedom)
    law.kp, law.kd = -terms.pop(q, 0.0), law.kd - terms.pop(w, 0.0)
    for term, block in [(term, term.of) for term in terms]:
        if isinstance(block, Primitive) and block.kind == "integrator":
            (value,) = block.inputs()
            inner = terms_of(value)
            law.ki += -terms.pop(term) * inner.get(q, 0.0)
            if {"lower", "upper", "period"} & block.parameters.keys() or not all(
                map(_asks, inner.keys() - {q})
            ):
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
        if (
            not isinstance(block, Primitive)
            or block.kind != "pid"
            or block.parameters.get("period")
        ):
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
            node.note(
                "approximated",
                message(
                    "simulink.derivative_on_speed",
                    "its derivative acts on measured speed alone, unfiltered",
                ),
            )
    return total


def _asks(term: Term) -> bool:
    """Tell whether a term can be part of a reference: a constant, an input, or of time alone."""
    if term.kind in ("one", "input", "time"):
        return True
    return isinstance(term.of, Primitive) and of_time(Form({term: 1.0}))


@dataclass(frozen=True, eq=False)
class ExternalForce:
    """What one block applies."""

    node: Node
    body: RigidPart  # on which it acts
    pose: RigidTransform  # of its frame in the first one of the body
    force: list[Value]  # along the axes of its frame, each of 3 [N, N·m]
    torque: list[Value]
    senses: bool = True  # whether it acts along the axes of the world, so that the orientation of its frame is measured
    ends: tuple[Node, Node] | None = None
    """The blocks on whose frames what it senses is, and from where that is seen; its own unless given."""

    @property
    def terms(self) -> Iterator[Term]:
        """All that it depends on, followed as it is asked for."""
        return (term for terms in closure([*self.force, *self.torque]) for term in terms)

    @property
    def jumps(self) -> bool:
        """Whether it depends on how a body is, and on a choice or a sign, as where contact is drawn of signals."""
        blocks = [term.of for term in self.terms if isinstance(term.of, Primitive)]
        chooses = any(
            one.kind in ("switch", "compare") or one.parameters.get("function") == "sign"
            for one in blocks
        )
        return chooses and any(term.kind in ("q", "w", "sensed") for term in self.terms)


def read_pushes(tracer: Tracer, bodies: Bodies) -> list[ExternalForce]:
    """Return what blocks apply from signals; those that inputs of the model drive alone stay ports of the station."""
    pushes = []
    for body in bodies.bodies:
        for mark in [mark for mark in body.marks if mark[0].kind == PUSH]:
            push = _push(tracer, mark[0], body, mark[1])
            if any(term.kind != "input" for term in push.terms):
                pushes.append(push)
                body.marks.remove(mark)
            else:
                push.node.note(
                    "read",
                    message(
                        "simulink.external_force_port",
                        "it is the port external_force or external_torque of the station, at this frame",
                    ),
                )
    between = (
        _apart(tracer, coupling) for coupling in bodies.couplings if coupling.node.kind == BETWEEN
    )
    floating = (_pulled(tracer, link) for link in bodies.links if link.joint.pulls)
    return [*pushes, *chain(*between, *floating)]


def _pulled(tracer: Tracer, link: Link) -> list[ExternalForce]:
    """Return what signals, springs and dampers of a floating joint do to its follower, and to a base that can move."""
    node, wrench = link.joint.node, np.zeros(6).astype(object)
    real, *turned = (part_of(node, index) for index in range(3, 7))
    half = applied("sqrt", sum((part * part for part in turned), start=0.0))
    # of the turn's axis and angle
    share = 2.0 * applied("atan2", half, real) / applied("max", half, _SLOWEST)
    for pull in link.joint.pulls:
        turns = pull.place >= _PLACES
        place: Value = share * turned[pull.place - _PLACES] if turns else part_of(node, pull.place)
        speed = part_of(node, pull.place + 7)
        if pull.port:
            wrench[pull.place] += _first(tracer, node, pull.port, "force")
        wrench[pull.place] -= pull.stiffness * (place - pull.rest) + pull.damping * speed
        for bound, way, stiffness in pull.stops:
            wrench[pull.place] += way * stiffness * applied("max", 0.0, way * (bound - place))
    force, torque = wrench[:_PLACES], wrench[_PLACES:]
    turn = orientation(node).T
    pushes = [
        ExternalForce(
            node, link.follower, link.in_follower, list(turn.dot(force)), list(turn.dot(torque))
        )
    ]
    if not link.base.grounded:
        arm = [part_of(node, index) for index in range(_PLACES)]
        moment = [
            torque[i] + arm[i - 2] * force[i - 1] - arm[i - 1] * force[i - 2]
            for i in range(_PLACES)
        ]
        pushes.append(
            ExternalForce(
                node, link.base, link.in_base, list(-1.0 * force), [-one for one in moment]
            )
        )
    return pushes


def _apart(tracer: Tracer, coupling: Coupling) -> list[ExternalForce]:
    """Return what pushes two bodies apart along the line between them, on the follower and on the base."""
    node = coupling.node
    sides = (tracer.physical(node, side, 2) for side in ("lconn", "rconn"))
    if (values := next((one for one in sides if one is not None), None)) is None:
        node.note(
            "lost",
            message(
                "simulink.force_not_connected",
                "its force input is not connected: nothing drives it",
            ),
        )
        return []
    line = [part_of(node, index) for index in range(_PLACES)]
    length = applied("sqrt", sum((part * part for part in line), start=0.0))
    pull: Signal = signal([values.ravel()[0] * (part / length) for part in line])
    return [
        ExternalForce(node, coupling.base, coupling.in_base, list(-1.0 * pull), [0.0] * 3),
        ExternalForce(
            node,
            coupling.follower,
            coupling.in_follower,
            list(orientation(node).T.dot(pull)),
            [0.0] * 3,
        ),
    ]


def _push(tracer: Tracer, node: Node, body: RigidPart, pose: RigidTransform) -> ExternalForce:
    """Read the ports of one block, of the force and then of the torque: for each axis that is on, then a vector."""
    ports, senses, parts = count(1), False, []
    for what in ("Force", "Torque"):
        vector: Signal = np.zeros(3).astype(object)
        for axis in (axis for axis in ("X", "Y", "Z", "") if node.is_on(f"Enable{what}{axis}")):
            values = tracer.physical(node, "lconn", next(ports))
            if values is not None and axis:
                vector["XYZ".index(axis)] += values.ravel()[0]
            elif values is not None and values.size in (1, _PLACES):
                vector = vector + widened(values.ravel(), _PLACES)
            elif values is not None:
                text = message(
                    "simulink.force_of_wrong_size",
                    "its {what} input has {size} elements, not {expected}: nothing drives it",
                    what=what.lower(),
                    size=values.size,
                    expected=_PLACES,
                )
                node.note("lost", text)
        if node.text(f"{what}ResolutionFrame", "AttachedFrame") == "World" and any(vector):
            senses, vector = True, orientation(node).T.dot(vector)
        parts.append(list(vector))
    return ExternalForce(node, body, pose, parts[0], parts[1], senses)


_SLOWEST = 1e-9  # m/s


def forces_of_contacts(
    contacts: Iterable[ContactPair], bodies: Bodies
) -> dict[ContactPair, ExternalForce]:
    r"""Return what contacts of spheres with planes of the world do to the spheres; others are not there.

    .. math:: f_n = s(d / w) (k d + b \dot d), \qquad f_t = -\mu(|v|) f_n v / |v|

    of the depth d, with :math:`s(x) = 3 x^2 - 2 x^3` over the transition region w, and never pulling: Simscape's own
    law. The coefficient of friction rises in this way to the static one at the critical speed, and falls to the dynamic
    one at 1.5 times that.
    """
    found: dict[ContactPair, ExternalForce] = {}
    for contact in contacts:
        bodies_of = {solid.node: (body, solid) for body in bodies.bodies for solid in body.solids}
        plane, sphere = sorted(contact.pair, key=lambda node: node in bodies_of)
        body, solid = bodies_of.get(sphere, (None, None))
        stands = plane in bodies.standing and not contact.senses_distance
        if body is None or solid is None or solid.shape is None or body.grounded or not stands:
            continue
        if solid.shape.kind != "sphere":
            continue
        force, torque = _wrench(contact.node, contact.surface, solid.shape.size[0])
        found[contact] = ExternalForce(
            contact.node, body, solid.pose, force, torque, ends=(sphere, plane)
        )
        contact.node.note(
            "read", message("simulink.own_contact_law", "by its own law, as forces on the sphere")
        )
    return found


def _wrench(
    node: Node, surface: ContactParameters, radius: float
) -> tuple[list[Value], list[Value]]:
    """Return force and torque on a sphere in its own axes, from where it is seen from the plane."""
    seen = {part: part_of(node, index) for index, part in enumerate(PARTS)}
    width = node.number("NormalTransitionRegionWidth", "1e-4", unit="m")
    depth = radius - seen["z"]
    share = limited(depth * (1.0 / width), 0.0, 1.0)
    pressed = surface.stiffness * depth - surface.damping * seen["vz"]
    normal = applied("max", 0.0, share * share * (3.0 - 2.0 * share) * pressed)
    sliding = seen["vx"] - radius * seen["wy"], seen["vy"] + radius * seen["wx"]
    speed = applied("sqrt", sliding[0] * sliding[0] + sliding[1] * sliding[1])
    across: list[Value] = [0.0, 0.0]
    if surface.static:
        part = np.linspace(0.0, 1.0, 11)
        smooth, speeds = (
            part * part * (3.0 - 2.0 * part),
            surface.speed * np.append(part, 1.0 + 0.5 * part[1:]),
        )
        falling = surface.static + (surface.dynamic - surface.static) * smooth[1:]
        coefficient = looked_up(
            speed, speeds, np.append(surface.static * smooth, falling), clip=True
        )
        grip = coefficient * normal / applied("max", speed, _SLOWEST)
        across = [-1.0 * (grip * one) for one in sliding]
    turn = orientation(node).T
    force, torque = (
        signal([*across, normal]),
        signal([radius * across[1], -radius * across[0], 0.0]),
    )
    return list(turn.dot(force)), list(turn.dot(torque))
