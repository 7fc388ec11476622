"""Recognise servos: the law of each driven joint, from the sum that its torque is."""

from dataclasses import dataclass, field
from math import inf

from simrob_drake.simulink.mechanics.joints import Freedom, Joint
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import ONE, Form, Term
from simrob_drake.simulink.signals.primitives import commanded
from simrob_drake.simulink.signals.tracing import Tracer

_ROUNDING = 1e-9


@dataclass
class Law:
    """A servo: sat(kp (wanted - q) + ki ∫ (wanted - q) - kd w), or for a motion input what is wanted itself.

    Attributes:
        kp, ki, kd: gains.
        limit: of the effort; infinite without.
        wanted: the position as a sum of inputs, sources and constants.
        effort: what of the effort depends on no position: constants, inputs and open blocks.
        net: the whole effort where it is no servo, as a sum of what blocks compute; empty of a servo.
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    limit: float = inf
    wanted: Form = field(default_factory=dict)
    effort: Form = field(default_factory=dict)
    net: Form = field(default_factory=dict)

    @property
    def is_idle(self) -> bool:
        """Whether nothing drives the joint."""
        return not (self.kp or self.ki or self.kd or self.net or self.effort)


def read_laws(tracer: Tracer, joints: list[Joint]) -> dict[Freedom, Law]:
    """Return the law of every driven degree of freedom.

    Raises:
        InvalidModel: an algebraic loop, or vectors that do not fit.
    """
    laws: dict[Freedom, Law] = {}
    for joint in joints:
        for number, (freedom, how) in joint.inputs.items():
            signal = tracer.physical(joint.node, "lconn", number)
            if signal is None:
                outside = tracer.network.leads_outside(joint.node, "lconn", number)
                told = (
                    f"its {how} input comes from a port of the model: nothing drives it"
                    if outside
                    else (f"its {how} input is not connected; connect it, or choose another actuation")
                )
                joint.node.findings.report.add("defaulted" if outside else "refused", joint.node.path, told)
                laws[freedom] = Law()
            elif not signal:
                raise joint.node.refusal(f"its {how} input has no elements")
            elif how == "motion":
                laws[freedom] = Law(wanted=signal[0])
            else:
                laws[freedom] = _Reading(tracer, joint.node, freedom).law(signal[0])
    nets = [law.net for law in laws.values() if law.net]
    for term, (freedom, factor) in commanded(tracer, nets).items():
        if freedom in laws:
            laws[freedom].wanted = {term: factor}
    return laws


class _Reading:
    """One joint's law."""

    def __init__(self, tracer: Tracer, node: Node, freedom: Freedom) -> None:
        self._tracer, self._freedom = tracer, freedom
        self._report, self._path = node.findings.report, freedom.name
        self._is_servo = True

    def law(self, form: Form) -> Law:
        """Return what an effort is: a servo, or else the net of blocks that it is."""
        law = self._servo(form)
        return law if self._is_servo else Law(net=form)

    def _servo(self, form: Form) -> Law:
        limit, form = self._unlimited(form)
        law = Law(limit=limit)
        own = {"q": form.get(Term("q", self._freedom), 0.0), "w": form.get(Term("w", self._freedom), 0.0)}
        rest = {term: value for term, value in form.items() if term.of is not self._freedom or term.kind not in own}
        law.kp, law.kd = max(0.0, -own["q"]), max(0.0, -own["w"])
        if max(own.values()) > _ROUNDING:
            self._is_servo = False
        for term, value in rest.items():
            self._take(law, term, value)
        if any(term.kind in ("one", "source") for term in law.effort):
            self._is_servo = False
        return law

    def _unlimited(self, form: Form) -> tuple[float, Form]:
        """Take off saturations that the whole effort goes through."""
        limit = inf
        while len(form) == 1:
            ((term, value),) = form.items()
            if term not in self._tracer.limits:
                break
            bounds = self._tracer.limits[term]
            if abs(bounds.lower + bounds.upper) > _ROUNDING * max(1.0, abs(bounds.upper)):
                self._is_servo = False
            limit = min(limit, abs(value) * max(abs(bounds.upper), abs(bounds.lower)))
            form = {inner: value * factor for inner, factor in bounds.inner.items()}
        return limit, form

    def _take(self, law: Law, term: Term, value: float) -> None:
        if term.kind == "integral":
            self._integral(law, term, value)
        elif term.kind in ("input", "source", "one") and law.kp > 0:
            law.wanted[term] = value / law.kp
            if term.kind == "input" and abs(law.wanted[term] - 1) > 1e-6:
                ratio = f"reference times {value:.6g}, position times {law.kp:.6g}"
                self._report.add("read", self._path, f"its reference is scaled by {law.wanted[term]:.6g} ({ratio})")
        elif term.kind in ("input", "source", "one"):
            law.effort[term] = value
        elif term.kind in ("q", "w", "sat", "block", "distance", "sensed"):
            self._is_servo = False
        elif isinstance(term.of, Freedom):
            self._drop(f"coupling with {term.kind} of {term.of.name} ({value:.6g})")
        else:
            where = term.of.path if isinstance(term.of, Node) else term.kind
            self._drop(f"what comes from {where}; give it to the port feedforward")
            law.effort[term] = value

    def _integral(self, law: Law, term: Term, value: float) -> None:
        inner = self._tracer.integrands[term]()
        gain = -value * inner.get(Term("q", self._freedom), 0.0)
        others = [
            part for part in inner if part.of is not self._freedom and part.kind not in ("input", "source", "one")
        ]
        if gain <= 0 or others:
            self._is_servo = False
        else:
            law.ki += gain

    def _drop(self, what: str) -> None:
        self._report.add("dropped", self._path, f"of its control law: {what}")


def is_zero(form: Form) -> bool:
    """Tell whether a form is nothing."""
    return all(abs(value) < _ROUNDING for value in form.values())


def constant_part(form: Form) -> float:
    """Return the number in a form."""
    return form.get(ONE, 0.0)
