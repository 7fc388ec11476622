"""What became of every block of a model, and how faithful its station is, in one line."""

from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import yaml

from simrob_drake.importer.options import EntryKind
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import closure
from simrob_drake.simulink.signals.tracing import RULES
from simrob_drake.simulink.simulink_model import SimulinkModel

Fate = Literal["exact", "ignored", "approximated", "open", "lost"]
FATES: tuple[Fate, ...] = get_args(Fate)
"""What can become of a block, the least loss first."""

Domain = Literal["structure", "mechanics", "signals"]


class BlockType(NamedTuple):
    """A row of the table.

    Attributes:
        domain: what it is part of.
        fate: what becomes of it unless more is known of the block.
        text: how it is approximated, what is left open, or what a loss counts as; may be empty.
    """

    domain: Domain
    fate: Fate
    text: str = ""


@cache
def block_types() -> dict[str, BlockType]:
    """Return the table, by type."""
    content = yaml.safe_load(Path(__file__).with_name("block_types.yaml").read_text(encoding="utf-8"))
    rows: dict[str, BlockType] = {}
    for domain, fates in content.items():
        for fate, types in fates.items():
            texts = types if isinstance(types, dict) else dict.fromkeys(types, "")
            rows |= {name: BlockType(domain, fate, text or "") for name, text in texts.items()}
    return rows


_BY_ENTRY: dict[EntryKind, Fate] = {
    "approximated": "approximated", "defaulted": "approximated", "open": "open", "lost": "lost", "refused": "lost",
}  # fmt: skip
"""What an entry of the report makes of the block that it is about."""


@dataclass(frozen=True)
class BlockOutcome:
    """What became of one block.

    Attributes:
        path: from the model's top.
        type: of the block.
        domain, fate, text: as in the table of block types.
        noun: what a loss counts as.
    """

    path: str
    type: str
    domain: Domain
    fate: Fate
    text: str = ""
    noun: str = ""


def outcomes(model: SimulinkModel) -> list[BlockOutcome]:
    """Return what became of every block of a model's file and libraries, those that take no part included."""
    found: dict[str, list[tuple[Fate, str]]] = {}
    for entry in model.report.entries:
        if entry.kind in _BY_ENTRY:
            found.setdefault(entry.element, []).append((_BY_ENTRY[entry.kind], entry.text))
    undriven = _undriven(model)
    left_out = [
        BlockOutcome(path, kind, "structure", "ignored", why) for path, (kind, why) in model.expanded.left_out.items()
    ]
    return [
        *(_outcome(model, node, found.get(node.path, []), undriven.get(node, "")) for node in model.expanded.nodes),
        *left_out,
    ]


def _undriven(model: SimulinkModel) -> dict[Node, str]:
    """Return what drives joints, and acts on bodies, but comes from blocks that are left open; these by their names."""
    drives = [(push.node, [*push.force, *push.torque]) for push in model.pushes]
    for link in model.bodies.links:
        laws = [model.laws[freedom] for freedom in link.joint.freedoms if freedom in model.laws]
        drives.append((link.joint.node, [value for law in laws for value in (law.net, law.reference or 0.0)]))
    found: dict[Node, str] = {}
    for node, values in drives:
        terms = (term for terms in closure(values) for term in terms if term.kind == "open")
        if names := sorted({term.of.path for term in terms if isinstance(term.of, Node)}):
            found[node] = ", ".join(names)
    return found


def _outcome(model: SimulinkModel, node: Node, found: list[tuple[Fate, str]], undriven: str) -> BlockOutcome:
    if node.block.commented == "through":
        return BlockOutcome(node.path, node.kind, "structure", "ignored", "commented through: its ports are joined")
    row = block_types().get(node.kind) or _unknown(model, node)
    fate, text = max([(row.fate, row.text), *found], key=lambda one: FATES.index(one[0]))
    if row.domain == "mechanics" and fate != "lost" and (unread := model.network.unread(node)):
        ports = ", ".join(f"{side} {number}" for _, side, number in unread)
        fate, text = "lost", f"nothing reads its port {ports}"
    if undriven and fate != "lost":
        text = f"what drives it comes from {undriven}, left open: it is 0 until something drives that"
        return BlockOutcome(node.path, node.kind, "mechanics", "lost", text, "drive")
    noun = row.text if row.fate == "lost" and row.text else node.kind
    return BlockOutcome(node.path, node.kind, row.domain, fate, text, noun)


def _unknown(model: SimulinkModel, node: Node) -> BlockType:
    if node.children:
        return BlockType("structure", "exact")
    if node.kind not in RULES and model.network.unread(node):
        return BlockType("mechanics", "lost", node.kind)
    if node in model.opened:
        return BlockType("signals", "open")
    if not model.tracer.followed(node):
        return BlockType("signals", "ignored", "nothing that moves depends on it")
    return BlockType("signals", "exact")


def lost_mechanics(found: list[BlockOutcome]) -> list[BlockOutcome]:
    """Return the blocks of the mechanics that are lost."""
    return [outcome for outcome in found if outcome.domain == "mechanics" and outcome.fate == "lost"]


def fidelity(found: list[BlockOutcome], prescribed: int = 0) -> str:
    """Return how faithful a station is, as in ``2 gears and 1 spring lost; 3 control blocks left open``."""
    nouns = Counter(outcome.noun for outcome in lost_mechanics(found))
    lost = [_counted(number, noun) for noun, number in nouns.items()]
    parts = [
        f"{' and '.join(part for part in (', '.join(lost[:-1]), *lost[-1:]) if part)} lost"
        if lost
        else "mechanics complete"
    ]
    parts.append(f"{_counted(prescribed, 'joint')} prescribed" if prescribed else "")
    opened = sum(outcome.fate == "open" for outcome in found)
    parts.append(f"{_counted(opened, 'control block')} left open" if opened else "")
    return "; ".join(part for part in parts if part)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
