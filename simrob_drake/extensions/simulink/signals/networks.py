r"""Motors, gear boxes, friction and circuits: networks of Simscape's foundation library, as states of a signal flow.

Each element is equations of what is across its branches (a voltage, a speed) and through them (a current, a torque);
what flows into a node adds up to 0. Together they are :math:`E x' = A x + B u` of what signals give
(:mod:`.descriptors`). What no sum can tell is a law: a signal that depends on the network's own states. Those of
friction and hard stops are as Simscape's documentation has them (Rotational Friction, Translational Hard Stop).
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.simulink.model.network import Connections, Place
from simrob_drake.extensions.simulink.model.nodes import Node, without_file
from simrob_drake.extensions.simulink.signals.arithmetic import (
    applied,
    chosen,
    compared,
    limited,
    looked_up,
)
from simrob_drake.extensions.simulink.signals.descriptors import (
    AT_ONCE,
    Reduced,
    reduced,
    without_fast,
)
from simrob_drake.extensions.simulink.signals.dynamics import rate_of
from simrob_drake.extensions.simulink.signals.forms import (
    Primitive,
    Rule,
    Signal,
    Tracer,
    Value,
    added,
    flat,
    signal,
)
from simrob_drake.extensions.simulink.signals.translation import Translation
from simrob_drake.extensions.simulink.tables import table
from simrob_drake.extensions.simulink.values.code import undefined
from simrob_drake.extensions.simulink.values.evaluate import (
    NUMBERS,
    Evaluator,
    UndefinedVariable,
    matrix,
)
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood, parse


class NetworkBlock(NamedTuple):
    """What a block of a network is, as `networks.yaml` has it."""

    ports: str
    branches: str
    equations: str
    law: str = ""
    """What ``f`` of its equations is: no sum, of what is across its branches and of x."""


@cache
def elements() -> dict[str, NetworkBlock]:
    """Return the table, by type."""
    return {kind: NetworkBlock(*row) for kind, row in table("networks").items()}


_OTHER_NAMES = {"L": ("l",), "K": ("Ki", "Kv"), "radius": ("R",)}  # other names of figures
_AS_IS = {
    "parameterization": ("circuit_param", "1"), "lam_param": ("damping", "2"), "mech_orient": ("positive", "1"),
    "friction_model": ("off",), "or": ("1",), "enable_backlash": ("false",), "mu_visc": ("[0, 0]", "[0 0]"),
}  # fmt: skip
"""Choices that a block may have, and with which of them its figures are those of its equations."""


def ports_of(node: Node) -> dict[str, tuple[str, int]]:
    """Return side and number of each port of an element by name: as the file tells, or as the block is by default."""
    try:
        written = json.loads(node.text("InternalSimscapePortConfiguration", "{}"))
        listed = {
            f"{side[0].lower()}conn": [port["id"] for port in written[side]]
            for side in ("Left", "Right")
        }
    except (ValueError, KeyError, TypeError):
        left, right = elements()[node.kind].ports.split("|")
        listed = {"lconn": left.split(), "rconn": right.split()}
    return {
        name: (side, place)
        for side, names in listed.items()
        for place, name in enumerate(names, start=1)
    }


def outputs_of(node: Node) -> list[tuple[str, str, int]]:
    """Return the ports at which an element tells something: name, side and number."""
    ports = ports_of(node)
    names = [
        part.partition("=")[0].strip()
        for part in elements()[node.kind].equations.split(";")
        if "=" in part
    ]
    return [(name, *ports[name]) for name in names if name in ports]


Factors = tuple[dict[int, float], dict[int, float], dict[int, float]]
"""Of a sum: of rates, of unknowns and of signals, by their places."""


class _Law(NamedTuple):
    """What an element gives that is no sum: a signal of the network, which depends on unknowns."""

    node: Node
    place: int
    takes: dict[str, dict[int, float]]
    driven: dict[str, Value]  # by signals, which come from elsewhere


Known = dict[str, list[tuple[int, int, float]]]
"""What words of equations are: of the factors which, at what place, and how often."""


@dataclass
class _Equations:
    """Equations of unknowns and signals, being written: sums that are 0."""

    unknowns: dict[object, int] = field(default_factory=dict)
    signals: list[Value] = field(default_factory=lambda: [1.0])
    rows: list[Factors] = field(default_factory=list)
    outputs: list[dict[int, float]] = field(default_factory=list)  # what ports tell
    laws: list[_Law] = field(default_factory=list)
    flows: dict[int, dict[int, float]] = field(default_factory=dict)  # into each node

    def unknown(self, what: object) -> int:
        return self.unknowns.setdefault(what, len(self.unknowns))

    def add(self, node: Node, reader: Tracer) -> None:
        """Add what an element says."""
        element, ports = elements()[node.kind], ports_of(node)
        known = self._branches(
            node, element, {name: reader.network.net(node, *port) for name, port in ports.items()}
        )
        sums = [part for part in element.equations.split(";") if "=" not in part]
        driving = re.findall(r"\w+", " ".join([*sums, element.law]))
        drivers = {
            name: reader.physical(node, *port) for name, port in ports.items() if name in driving
        }
        driven: dict[str, Value] = {
            name: flat(one)[0] for name, one in drivers.items() if one is not None and one.size
        }
        if element.law:
            words = re.findall(r"\w+", element.law)
            takes = {
                name: {place: often for _, place, often in known[name]}
                for name in known
                if name in words
            }
            self.laws.append(_Law(node, len(self.signals), takes, driven))
            known["f"] = self._signal(0.0)
        known |= {name: self._signal(value) for name, value in driven.items()}
        for part in element.equations.split(";"):
            name, _, text = part.rpartition("=")
            if name.strip() in ports:
                self.outputs.append(_factors(node, text, known)[1])
            elif not name:
                self.rows.append(_factors(node, text, known))

    def _signal(self, value: Value) -> list[tuple[int, int, float]]:
        self.signals.append(value)
        return [(2, len(self.signals) - 1, 1.0)]

    def _branches(self, node: Node, element: NetworkBlock, nets: dict[str, object]) -> Known:
        known: Known = {}
        for number, branch in enumerate(element.branches.split(", "), start=1):
            if nets.keys().isdisjoint(
                branch.split()
            ):  # of the two ends one may be hidden: it stands still
                raise node.refusal(
                    message(
                        "simulink.odd_ports",
                        "its ports are {ports}, none of which is {expected}",
                        ports=", ".join(nets),
                        expected=branch.split()[0],
                    )
                )
            through = self.unknown((node, number))
            ends = [(self.unknown(nets[name]), sign) for name, sign in zip(branch.split(), (1.0, -1.0), strict=True)
                    if name in nets]  # fmt: skip
            for place, sign in ends:
                flow = self.flows.setdefault(place, {})
                flow[through] = flow.get(through, 0.0) + sign
            for name, which in (("", 1), ("d", 0)):
                known[f"{name}v{number}"] = [(which, place, sign) for place, sign in ends]
                known[f"{name}i{number}"] = [(which, through, 1.0)]
        if "dx" in element.equations:
            known |= {
                name: [(which, self.unknown((node, "x")), 1.0)]
                for name, which in (("x", 1), ("dx", 0))
            }
        return known

    def matrices(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Return E, A, B and C of E x' = A x + B u and y = C x."""
        rows: list[Factors] = [*self.rows, *(({}, row, {}) for row in self.flows.values())]
        asked = [*self.outputs, *(part for law in self.laws for part in law.takes.values())]
        e, a, b = zip(*rows, strict=True)
        size = len(self.unknowns)
        return -_dense(e, size), _dense(a, size), _dense(b, len(self.signals)), _dense(asked, size)


def _dense(rows: Sequence[dict[int, float]], size: int) -> Vector:
    """Return rows of factors by their places as a matrix."""
    return np.array([[row.get(place, 0.0) for place in range(size)] for row in rows]).reshape(
        len(rows), size
    )


def _factors(node: Node, text: str, known: Known) -> Factors:
    """Return the factors of a sum, which is linear in what is known: it is computed for each of these alone."""
    parameters: dict[str, float] = {}

    def value(asked: str) -> float:
        def lookup(name: str) -> Any:
            if name not in known and name not in parameters:
                parameters[name] = _figure(node, name)
            return matrix(parameters.get(name, float(name == asked)))

        return float(Evaluator(lookup, NUMBERS).evaluated(parse(text))[0, 0])

    constant = value("")
    found: Factors = ({}, {}, {0: constant})
    for name, parts in known.items():
        for which, place, often in parts:
            found[which][place] = found[which].get(place, 0.0) + often * (value(name) - constant)
    return found


_NEITHER = message(
    "simulink.neither_value_nor_signal", "is neither a figure of it, nor a signal that drives it"
)
_SENSES = {"same": 1.0, "opposite": -1.0}
"""Choices that are figures."""


def _figure(node: Node, name: str) -> float:
    names = [one for one in (name, *_OTHER_NAMES.get(name, ())) if one in node.block.parameters]
    if len(names) > 1 and node.text("emf_or_torque").rpartition(".")[2] not in ("ki", "2"):
        names.reverse()
    if not names:
        raise node.refusal(compound("{name} {neither}", name=name, neither=_NEITHER))
    for choice, known in _AS_IS.items():
        if (chosen := node.text(choice, known[0]).rpartition(".")[2]) not in known:
            raise node.refusal(
                message(
                    "simulink.choice_not_read",
                    "its {choice} is {chosen}; {known} is read",
                    choice=choice,
                    chosen=chosen,
                    known=known[0],
                )
            )
    if (sense := _SENSES.get(node.text(names[0]).rpartition(".")[2])) is not None:
        return sense
    return node.quantity(names[0])


def _members(network: Connections, start: Node) -> list[Node]:
    """Return the elements that hang together with one over conserving ports, and whatever else is on these."""

    def conserving(node: Node) -> list[Place]:
        branches, ports = (
            (elements()[node.kind].branches, ports_of(node))
            if node.kind in elements()
            else ("", {})
        )
        return [
            network.net(node, *ports[name])
            for name in branches.replace(",", "").split()
            if name in ports
        ]

    return sorted(network.joined(start, conserving), key=lambda one: one.path)


def _solved(reader: Tracer, members: list[Node]) -> list[Signal]:
    """Return what the elements of a network tell, in order; nothing where it is not read, which is told of each."""
    strange = [node for node in members if node.kind not in elements()]
    try:
        if strange:
            raise strange[0].refusal(
                message(
                    "simulink.not_linear_in_network",
                    "a {kind} in a network: it is not linear, or not read",
                    kind=strange[0].kind,
                )
            )
        equations = _Equations()
        for node in members:
            equations.add(node, reader)
        found = reduced(*equations.matrices())
        if found is None:
            raise members[0].refusal(
                message(
                    "simulink.network_undetermined", "its network does not determine what it does"
                )
            )
        settled = without_fast(found)
        if not _acts_at_once(settled, equations) and len(settled.a) < len(found.a):
            members[0].note(
                "approximated",
                message(
                    "simulink.settles_at_once",
                    "what settles within {seconds:g} s in its network is where it comes to",
                    seconds=AT_ONCE,
                ),
            )
            found = settled
        if _acts_at_once(found, equations):
            law = equations.laws[0].node
            raise law.refusal(
                message(
                    "simulink.nothing_keeps_speed",
                    "a {kind} in a network: nothing beside it keeps its speed; an inertia would",
                    kind=law.kind,
                )
            )
        return [signal([one]) for one in _outputs(members[0], found, equations)]
    except (InvalidModel, NotUnderstood, ArithmeticError) as problem:
        why = without_file(problem, members[0].findings.report.source)
        for node in members:
            node.note(
                "lost",
                message("simulink.network_not_read_why", "its network is not read: {why}", why=why),
            )
        return []


def _acts_at_once(found: Reduced, equations: _Equations) -> bool:
    """Return whether a law gives what another, or itself, takes, with no state between."""
    gives, takes = [law.place for law in equations.laws], slice(len(equations.outputs), None)
    return any(one[takes, gives].any() for one in found.d)


def _law_of(node: Node, values: dict[str, Value]) -> Value:
    start = next((name for name in ("x", "phi") if node.is_on(f"{name}_specify")), None)
    begun = {"start": node.quantity(start) if start else 0.0}
    if "model" in elements()[node.kind].law:
        begun["model"] = node.number("model", "3")
        if begun["model"] not in (1, 2, 3):
            raise node.refusal(
                message(
                    "simulink.restitution_model",
                    "its model is by a coefficient of restitution; stiffness and damping are read",
                )
            )
    known = {name: signal([value]).reshape(1, 1) for name, value in {**values, **begun}.items()}

    def figure(name: str) -> Any:
        return undefined(name) if name not in node.block.parameters else matrix(_figure(node, name))

    run = Translation(known, figure, own={"stop": _stop, "within": partial(_within, node)})
    try:
        return flat(run.value(elements()[node.kind].law))[0]
    except UndefinedVariable as problem:
        raise node.refusal(
            compound("{problem} {neither}", problem=problem.name, neither=_NEITHER)
        ) from problem


def _stop(
    depth: Value, speed: Value, stiffness: float, damping: float, model: float, width: float
) -> Value:
    """Return what a stop resists with that is entered: at once, or growing over a width (Simscape, Hard Stop)."""
    damped = chosen(compared(">=", speed, 0.0), speed, 0.0) if model == 2 else speed
    force = stiffness * depth + damping * damped
    if model == 1:
        share = limited(depth / width, 0.0, 1.0)
        force = force * (share * share * (3.0 - 2.0 * share))
    return chosen(compared(">=", depth, 0.0), force, 0.0)


def _within(node: Node, torque: Value, speed: Value) -> Value:
    """Return what a motor gives of a torque at a speed: by a table, or by its greatest torque and power."""
    speed = applied("abs", speed)
    if node.text("torque_speed_param", "tabulated").rpartition(".")[2] in ("tabulated", "1"):
        speeds = node.numbers("w_t", "[0 3750 7500 8000]") * node.in_si(
            node.text("w_t_unit", "rpm"), "w_t"
        )
        most = node.numbers("T_t", "[.09 .08 .07 0]") * node.in_si(
            node.text("T_t_unit", "N*m"), "T_t"
        )
        bound = looked_up(speed, speeds, most, clip=True)
    else:
        power = node.quantity("power_max", default="30")
        bound = power / applied("max", speed, power / node.quantity("torque_max", default="0.1"))
    return applied("max", applied("min", torque, bound), -1.0 * bound)


def _outputs(node: Node, found: Reduced, equations: _Equations) -> list[Value]:
    states: list[Value] = []
    inputs = equations.signals
    if size := len(found.a):
        matrices = {"A": found.a, "B": found.b, "C": np.eye(size), "D": np.zeros(found.b.shape)}
        parameters = {name: one.tolist() for name, one in matrices.items()}
        states = Primitive("state_space", parameters, lambda: inputs, node, size, 0).outputs
    parts = [(found.c, states), (found.d[0], inputs)]
    if found.d[1].any():
        driven = zip(inputs, (found.d[1] != 0.0).any(axis=0).tolist(), strict=True)
        parts.append(
            (found.d[1], [rate_of(node, one) if counts else 0.0 for one, counts in driven])
        )

    def output(row: int) -> Value:
        return added(
            *(
                (float(own), one)
                for rows, values in parts
                for own, one in zip(rows[row], values, strict=True)
            )
        )

    rows = itertools.count(len(equations.outputs))
    for law in equations.laws:
        inputs[law.place] = _law_of(
            law.node, law.driven | {name: output(next(rows)) for name in law.takes}
        )
    return [output(row) for row in range(len(equations.outputs))]


def _element(reader: Tracer, node: Node, number: int) -> Signal:
    """Return what an element tells at one of the ports that do."""
    members = _members(reader.network, node)
    values = reader.once(members[0], lambda: _solved(reader, members))
    if not values:
        raise node.refusal(message("simulink.network_not_read", "its network is not read"))
    places = [(one, place) for one in members for place in range(len(outputs_of(one)))]
    return values[places.index((node, number - 1))]


NETWORKS: dict[str, Rule] = dict.fromkeys(elements(), _element)
