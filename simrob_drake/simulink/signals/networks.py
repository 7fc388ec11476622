r"""Motors, gear boxes and circuits: linear networks of Simscape's foundation library, as states of a signal flow.

Each element is equations of what is across its branches (a voltage, a speed) and through them (a current, a torque);
what flows into a node adds up to 0. Together they are :math:`E x' = A x + B_0 u + B_1 u' + \dots` of what signals give.
Where rows of E and, without E, of A do not determine x, what is stored depends on what is given, as a rotor's speed on
that of a joint: a combination of rows is then differentiated, until they do (index reduction; Hairer and Wanner,
Solving Ordinary Differential Equations II, VII). So a rotor reacts by exactly its inertia times the acceleration.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector
from simrob_drake.simulink.model.network import Connections
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.dynamics import rate_of
from simrob_drake.simulink.signals.forms import Primitive, Rule, Signal, SignalReader, Value, added, signal
from simrob_drake.simulink.tables import table
from simrob_drake.simulink.values.evaluate import evaluate, matrix
from simrob_drake.simulink.values.syntax import parse

_AT_ONCE = 1e-4  # s


class NetworkBlock(NamedTuple):
    """What a block of a network is, as `networks.yaml` has it."""

    ports: str
    branches: str
    equations: str


@cache
def elements() -> dict[str, NetworkBlock]:
    """Return the table, by type."""
    return {kind: NetworkBlock(*row) for kind, row in table("networks").items()}


_OTHER_NAMES = {"L": ("l",), "K": ("Ki", "Kv")}  # other names of figures
_ASIDE = ("PMIOPort", "Solver Configuration", "Connection Port", "ConnectionLabel", "SimscapeBus", "Two-Way Connection")
_AS_IS = {"parameterization": ("circuit_param", "1"), "lam_param": ("damping", "2"), "mech_orient": ("positive", "1")}
"""Choices that a block may have, and with which of them its figures are those of its equations."""


def ports_of(node: Node) -> dict[str, tuple[str, int]]:
    """Return side and number of each port of an element by name: as the file tells, or as the block is by default."""
    listed: dict[str, list[str]] = {}
    try:
        written = json.loads(node.text("InternalSimscapePortConfiguration", "{}"))
        listed = {
            side: [port["id"] for port in written[name]] for side, name in (("lconn", "Left"), ("rconn", "Right"))
        }
    except (ValueError, KeyError, TypeError):
        left, right = elements()[node.kind].ports.split("|")
        listed = {"lconn": left.split(), "rconn": right.split()}
    return {name: (side, place) for side, names in listed.items() for place, name in enumerate(names, start=1)}


def outputs_of(node: Node) -> list[tuple[str, str, int]]:
    """Return the ports at which an element tells something: name, side and number."""
    ports = ports_of(node)
    names = [part.partition("=")[0].strip() for part in elements()[node.kind].equations.split(";") if "=" in part]
    return [(name, *ports[name]) for name in names if name in ports]


Factors = tuple[dict[int, float], dict[int, float], dict[int, float]]
"""Of a sum: of rates, of unknowns and of signals, by their places."""


@dataclass
class _Equations:
    """Equations of unknowns and signals, being written: sums that are 0."""

    unknowns: dict[object, int] = field(default_factory=dict)
    signals: list[Value] = field(default_factory=lambda: [1.0])
    rows: list[Factors] = field(default_factory=list)
    outputs: list[dict[int, float]] = field(default_factory=list)  # what ports tell
    flows: dict[int, dict[int, float]] = field(default_factory=dict)  # into each node

    def unknown(self, what: object) -> int:
        return self.unknowns.setdefault(what, len(self.unknowns))

    def add(self, node: Node, reader: SignalReader) -> None:
        """Add what an element says."""
        element, ports = elements()[node.kind], ports_of(node)
        nets = {name: reader.network.net(node, *port) for name, port in ports.items()}
        known: dict[str, list[tuple[int, int, float]]] = {}  # of the factors: which, at what place, and how often
        for number, branch in enumerate(element.branches.split(", "), start=1):
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
            known |= {name: [(which, self.unknown((node, "x")), 1.0)] for name, which in (("x", 1), ("dx", 0))}
        for name, port in ports.items():
            driver = reader.physical(node, *port) if name in _driving(element) else None
            if driver is not None and driver.size:
                known[name] = [(2, len(self.signals), 1.0)]
                self.signals.append(driver.ravel()[0])
        for part in element.equations.split(";"):
            name, _, text = part.rpartition("=")
            if name.strip() in ports:
                self.outputs.append(_factors(node, text, known)[1])
            elif not name:
                self.rows.append(_factors(node, text, known))

    def matrices(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Return E, A, B and C of E x' = A x + B u and y = C x."""
        rows: list[Factors] = [*self.rows, *(({}, row, {}) for row in self.flows.values())]
        size = len(self.unknowns)
        found = [np.zeros((len(rows), width)) for width in (size, size, len(self.signals))]
        for number, parts in enumerate(rows):
            for whole, part, sign in zip(found, parts, (-1.0, 1.0, 1.0), strict=True):
                whole[number, list(part)] = [sign * value for value in part.values()]
        outputs = np.zeros((len(self.outputs), size))
        for number, part in enumerate(self.outputs):
            outputs[number, list(part)] = list(part.values())
        return found[0], found[1], found[2], outputs


def _driving(element: NetworkBlock) -> list[str]:
    return [word for part in element.equations.split(";") if "=" not in part for word in part.split()]


def _factors(node: Node, text: str, known: dict[str, list[tuple[int, int, float]]]) -> Factors:
    """Return the factors of a sum, which is linear in what is known: it is computed for each of these alone."""
    parameters: dict[str, float] = {}

    def value(asked: str) -> float:
        def lookup(name: str) -> Any:
            if name not in known and name not in parameters:
                parameters[name] = _figure(node, name)
            return matrix(parameters.get(name, float(name == asked)))

        return float(evaluate(parse(text), lookup)[0, 0])

    constant = value("")
    found: Factors = ({}, {}, {0: constant})
    for name, parts in known.items():
        for which, place, often in parts:
            found[which][place] = found[which].get(place, 0.0) + often * (value(name) - constant)
    return found


def _figure(node: Node, name: str) -> float:
    names = [one for one in (name, *_OTHER_NAMES.get(name, ())) if one in node.block.parameters]
    if len(names) > 1 and node.text("emf_or_torque").rpartition(".")[2] not in ("ki", "2"):
        names.reverse()
    if not names:
        raise node.refusal(f"{name} is neither a figure of it, nor a signal that drives it")
    for choice, known in _AS_IS.items():
        if (chosen := node.text(choice, known[0]).rpartition(".")[2]) not in known:
            raise node.refusal(f"its {choice} is {chosen}; {known[0]} is read")
    return node.number(names[0], "0") * node.in_si(node.text(f"{names[0]}_unit", "1"), names[0])


class Reduced(NamedTuple):
    """States s of a network, and what it tells: s' = a s + b u, y = c s + d[0] u + d[1] u'."""

    a: Vector
    b: Vector
    c: Vector
    d: list[Vector]


def reduced(e: Vector, a: Vector, b: Vector, c: Vector) -> Reduced | None:
    """Return the states of e x' = a x + b u and y = c x, which begin at 0; None where these do not determine y.

    It is computed in fractions, so what is nothing is exactly nothing.
    """
    size = e.shape[1]
    rows, rest = _echelon(np.hstack([e, a, b]), size)
    held, moved, b1 = rows[:, :size], rows[:, size : 2 * size], rows[:, 2 * size :]  # held x' = moved x + b1 u
    kept, b2 = rest[:, size : 2 * size], [rest[:, 2 * size :], 0 * rest[:, 2 * size :], 0 * rest[:, 2 * size :]]
    while True:  # of u, u' and u'': kept x + b2 u = 0
        both = np.vstack([held, kept])
        found, lost = _echelon(np.hstack([both, _fractions(np.eye(len(both)))]), size)
        if not len(lost):
            break
        stored, other = np.split(lost[0][size:], [len(held)])
        if not stored.any() or (other @ b2[2]).any():
            return None
        derived = [stored @ b1, -(other @ b2[0]), -(other @ b2[1])]
        kept, b2 = np.vstack([kept, stored @ moved]), [np.vstack(pair) for pair in zip(b2, derived, strict=True)]
        held, moved, b1 = (np.delete(one, np.flatnonzero(stored)[0], 0) for one in (held, moved, b1))
    if len(both) != size:
        return None
    states, rest, c = found[:, size : size + len(held)], found[:, size + len(held) :], _fractions(c)
    a, c, d = moved @ states, c @ states, [-(c @ rest @ one) for one in b2]
    driven = [-(moved @ rest @ one) for one in b2]
    driven[0] = driven[0] + b1
    if d[2].any():
        return None
    for place in (2, 1):  # a rate of what is given moves the states by what is given
        driven[place - 1], d[place - 1] = driven[place - 1] + a @ driven[place], d[place - 1] + c @ driven[place]
    return Reduced(a.astype(float), driven[0].astype(float), c.astype(float), [one.astype(float) for one in d])


def without_fast(full: Reduced) -> Reduced:
    """Return a network without what settles within ``_AT_ONCE``: it is where it would come to."""
    rates, modes = np.linalg.eig(full.a)
    fast = rates.real < -1.0 / _AT_ONCE
    if not fast.any():
        return full
    back = np.linalg.inv(modes)
    slow = (modes[:, ~fast] @ back[~fast]).real
    settled = (modes[:, fast] / rates[fast] @ back[fast]).real
    basis = np.linalg.svd(slow)[0][:, : int((~fast).sum())]
    at_once = [full.d[0] - full.c @ settled @ full.b, *full.d[1:]]
    return Reduced(basis.T @ full.a @ basis, basis.T @ slow @ full.b, full.c @ basis, at_once)


def _fractions(values: Any) -> Any:
    found = np.empty(values.shape, dtype=object)
    for place, value in np.ndenumerate(values):
        found[place] = value if isinstance(value, Fraction) else Fraction(repr(float(value)))
    return found


def _echelon(rows: Any, columns: int) -> tuple[Any, Any]:
    """Return rows by Gauss's elimination in their first columns: those with a pivot, by its place, and the others."""
    left: list[Any] = list(_fractions(rows))
    found: list[Any] = []
    for column in range(columns):
        place = next((place for place, row in enumerate(left) if row[column]), None)
        if place is None:
            continue
        pivot = left.pop(place)
        with np.errstate(all="ignore"):  # some processors tell of fractions what is not so
            pivot = pivot / pivot[column]
            found = [row - row[column] * pivot if row[column] else row for row in found]
            left = [row - row[column] * pivot if row[column] else row for row in left]
        found.append(pivot)
    width = rows.shape[1]
    shaped = [np.array(one, dtype=object).reshape(len(one), width) for one in (found, left)]
    return shaped[0], shaped[1]


def _members(network: Connections, start: Node) -> list[Node]:
    """Return the elements that hang together with one over conserving ports, and whatever else is on these."""
    found = {start: None}
    waiting = [start]
    while waiting:
        node = waiting.pop()
        if node.kind in elements():
            ports = ports_of(node)
            for name in elements()[node.kind].branches.replace(",", "").split():
                there = network.on(network.net(node, *ports[name])) if name in ports else []
                new = [one for one in there if one not in found and one.kind not in _ASIDE and not one.children]
                found |= dict.fromkeys(new)
                waiting += new
    return sorted(found, key=lambda one: one.path)


def _solved(reader: SignalReader, members: list[Node]) -> list[Signal]:
    """Return what the elements of a network tell, in order; nothing where it is not read, which is told of each."""
    strange = [node for node in members if node.kind not in elements()]
    try:
        if strange:
            raise strange[0].refusal(f"a {strange[0].kind} in a network: it is not linear, or not read")
        equations = _Equations()
        for node in members:
            equations.add(node, reader)
        found = reduced(*equations.matrices())
        if found is None:
            raise members[0].refusal("its network does not determine what it does")
        whole, found = len(found.a), without_fast(found)
        if len(found.a) < whole:
            members[0].note("approximated", f"what settles within {_AT_ONCE:g} s in its network is where it comes to")
    except (InvalidModel, ArithmeticError) as problem:
        file = f"{members[0].findings.report.source}: "
        for node in members:
            node.note("lost", f"its network is not read: {str(problem).removeprefix(file)}")
        return []
    return [signal([one]) for one in _outputs(members[0], found, equations.signals)]


def _outputs(node: Node, found: Reduced, inputs: list[Value]) -> list[Value]:
    states: list[Value] = []
    if size := len(found.a):
        matrices = {"A": found.a, "B": found.b, "C": np.eye(size), "D": np.zeros(found.b.shape)}
        parameters = {name: one.tolist() for name, one in matrices.items()}
        states = Primitive("state_space", parameters, lambda: inputs, node, size, 0).outputs
    parts = [(found.c, states), (found.d[0], inputs)]
    if found.d[1].any():
        driven = zip(inputs, (found.d[1] != 0.0).any(axis=0).tolist(), strict=True)
        parts.append((found.d[1], [rate_of(node, one) if counts else 0.0 for one, counts in driven]))
    return [
        added(*((float(own), value) for rows, values in parts for own, value in zip(rows[row], values, strict=True)))
        for row in range(len(found.c))
    ]


def _element(reader: SignalReader, node: Node, number: int) -> Signal:
    """Return what an element tells at one of the ports that do."""
    members = _members(reader.network, node)
    values = reader.once(members[0], lambda: _solved(reader, members))
    if not values:
        raise node.refusal("its network is not read")
    places = [(one, place) for one in members for place in range(len(outputs_of(one)))]
    return values[places.index((node, number - 1))]


NETWORKS: dict[str, Rule] = dict.fromkeys(elements(), _element)
