"""Import a Simulink model: to a folder with robots, pieces and a station that runs, and what became of every block."""

import json
import re
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from functools import cache
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from simrob_drake import simulate
from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import SimrobError, format_count
from simrob_drake.base.files import content_of
from simrob_drake.base.folders import filled_at_once
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.extensions.simulink.mechanics.bodies import BETWEEN, GEARS, ROD, SPRING
from simrob_drake.extensions.simulink.mechanics.joints import JOINTS, Freedom
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import Value, closure
from simrob_drake.extensions.simulink.signals.networks import NETWORKS
from simrob_drake.extensions.simulink.simulink_model import (
    RULES,
    SimulinkModel,
    read_simulink,
    undefined_variables,
)
from simrob_drake.extensions.simulink.tables import table
from simrob_drake.extensions.simulink.writing.station import SOLVERS, StationWriter
from simrob_drake.extensions.simulink.writing.touching import StationFiles
from simrob_drake.extensions.simulink.writing.urdf import plain
from simrob_drake.robots.imports import REPORT_FILE, EntryKind, ImportReport

Fate = Literal["exact", "ignored", "approximated", "open", "lost"]
FATES: tuple[Fate, ...] = get_args(Fate)  # what can become of a block, the least loss first

Domain = Literal["structure", "mechanics", "signals"]


class BlockType(NamedTuple):
    """A row of the table."""

    domain: Domain  # what it is part of
    fate: Fate  # what becomes of it unless more is known of the block
    text: str = (
        ""  # how it is approximated, what is left open, or what a loss counts as; may be empty
    )


@cache
def block_types() -> dict[str, BlockType]:
    """Return the table, by type."""
    rows = dict.fromkeys(NETWORKS, BlockType("mechanics", "exact"))
    content: Any = table("block_types")
    for domain, fates in content.items():
        for fate, types in fates.items():
            texts = types if isinstance(types, dict) else dict.fromkeys(types, "")
            rows |= {name: BlockType(domain, fate, text or "") for name, text in texts.items()}
    return rows


_BY_ENTRY: dict[EntryKind, Fate] = {
    "approximated": "approximated", "defaulted": "approximated", "open": "open", "lost": "lost", "refused": "lost",
}  # fmt: skip
"""What an entry of the report makes of the block that it is about."""


_SENSING = {*JOINTS, *GEARS, ROD, SPRING, BETWEEN, "Spatial Contact Force", "Transform Sensor"}
"""Blocks whose right ports but the first tell what they measure."""


@dataclass(frozen=True)
class BlockOutcome:
    """What became of one block."""

    path: str  # from the model's top
    type: str  # of the block
    domain: Domain  # as fate and text in the table of block types
    fate: Fate
    text: str = ""
    noun: str = ""  # what a loss counts as


def outcomes(model: SimulinkModel) -> list[BlockOutcome]:
    """Return what became of every block of a model's file and libraries, those that take no part included."""
    found = defaultdict[str, list[tuple[Fate, str]]](list)
    for entry in model.report.entries:
        found[entry.element] += (
            [(_BY_ENTRY[entry.kind], entry.text)] if entry.kind in _BY_ENTRY else []
        )
    undriven, expanded = _undriven(model), model.expanded
    known = {node.path for node in expanded.nodes} | expanded.left_out.keys()
    whole = (entry for entry in model.report.of("lost") if entry.element not in known)
    return [
        *(
            BlockOutcome(one.element, "station", "mechanics", "lost", one.text, one.element)
            for one in whole
        ),
        *(
            _outcome(model, node, found[node.path], undriven.get(node, ""))
            for node in expanded.nodes
        ),
        *(
            BlockOutcome(path, kind, "structure", "ignored", why)
            for path, (kind, why) in expanded.left_out.items()
        ),
    ]


_MEASURED = ("q", "w", "a", "t", "distance", "sensed")  # kinds of terms that no time tells


def _undriven(model: SimulinkModel) -> dict[Node, str]:
    """Return why joints are not driven, or bodies pushed, as in the model: for what is open, or no motion over time."""
    drives = [(push.node, [*push.force, *push.torque]) for push in model.pushes]
    motions: list[tuple[Node, list[Value]]] = []
    for link in model.bodies.links:
        for freedom in link.joint.freedoms:
            law = model.law_of(freedom)
            drives.append((link.joint.node, [law.net, law.reference or 0.0]))
            motions += (
                [(link.joint.node, [law.reference or 0.0])] if freedom.driven == "motion" else []
            )
    found: dict[Node, str] = {}
    for node, values in motions:
        followed = [
            term.of for terms in closure(values) for term in terms if term.kind in _MEASURED
        ]
        names = {of.name for of in followed if isinstance(of, Freedom)}
        if names := names | {of.path for of in followed if isinstance(of, Node)}:
            measured = ", ".join(sorted(names))
            found[node] = message(
                "simulink.motion_follows_measured",
                "its motion follows what is measured ({measured}), not time alone: it is held at its start",
                measured=measured,
            )
    for node, values in drives:
        opened = (term.of for terms in closure(values) for term in terms if term.kind == "open")
        if paths := ", ".join(sorted({of.path for of in opened if isinstance(of, Node)})):
            found[node] = message(
                "simulink.driven_by_left_open",
                "what drives it comes from {paths}, left open: it is 0 until something drives that",
                paths=paths,
            )
    return found


def _outcome(
    model: SimulinkModel, node: Node, found: list[tuple[Fate, str]], undriven: str
) -> BlockOutcome:
    if node.block.commented == "through":
        return BlockOutcome(
            node.path,
            node.kind,
            "structure",
            "ignored",
            message("simulink.commented_through", "commented through: its ports are joined"),
        )
    row = block_types().get(node.kind) or _unknown(model, node)
    fate, text = max([*found, (row.fate, row.text)], key=lambda one: FATES.index(one[0]))
    heeded = row.domain == "mechanics" and row.fate != "ignored" and fate != "lost"
    if heeded and (unread := model.network.unread(node)):
        ports = ", ".join(f"{side} {number}" for _, side, number in unread)
        if node.kind in _SENSING and all(
            side == "rconn" and number > 1 for _, side, number in unread
        ):
            text = f"{text}; no station measures what its port {ports} tells".removeprefix("; ")
        elif _stands_alone(model, node):
            fate, text = "ignored", _ALONE
        else:
            fate, text = (
                "lost",
                message(
                    "simulink.nothing_reads_port", "nothing reads its port {ports}", ports=ports
                ),
            )
    if undriven and fate != "lost":
        return BlockOutcome(node.path, node.kind, "mechanics", "lost", undriven, "drive")
    noun = row.text if row.fate == "lost" and row.text else node.kind
    return BlockOutcome(node.path, node.kind, row.domain, fate, text, noun)


_ALONE = message(
    "simulink.network_joined_with_no_body",
    "its network is joined with no body, and nothing that moves depends on it",
)


def _stands_alone(model: SimulinkModel, node: Node) -> bool:
    """Tell whether a block is part of a network that is joined with no body, and of which nothing that moves takes."""
    joined = model.network.joined(node)
    mechanics = {
        kind for kind, row in block_types().items() if row.domain == "mechanics"
    } - NETWORKS.keys()
    return not any(one.kind in mechanics or model.tracer.followed(one) for one in joined)


def _unknown(model: SimulinkModel, node: Node) -> BlockType:
    if node.children:
        return BlockType("structure", "exact")
    if node.kind not in RULES and model.network.unread(node):
        alone = _stands_alone(model, node)
        return (
            BlockType("mechanics", "ignored", _ALONE)
            if alone
            else BlockType("mechanics", "lost", node.kind)
        )
    if node in model.tracer.opened:
        return BlockType("signals", "open")
    followed = model.tracer.followed(node)
    return BlockType(
        "signals",
        *(
            ("exact",)
            if followed
            else (
                "ignored",
                message("simulink.nothing_depends", "nothing that moves depends on it"),
            )
        ),
    )


def lost_mechanics(found: list[BlockOutcome]) -> list[BlockOutcome]:
    """Return the blocks of the mechanics that are lost."""
    return [
        outcome for outcome in found if outcome.domain == "mechanics" and outcome.fate == "lost"
    ]


def fidelity(found: list[BlockOutcome], prescribed: int = 0, assumed: int = 0) -> str:
    """Return how faithful a station is, as in ``2 gears and 1 spring lost; 3 control blocks left open``.

    ``prescribed`` joints have a motion that is given, and ``assumed`` figures a default in place of unknown variables.
    """
    nouns = Counter(outcome.noun for outcome in lost_mechanics(found))
    lost = [_counted_noun(number, noun) for noun, number in nouns.items()]
    headline = message("simulink.mechanics_complete", "mechanics complete")
    if lost:
        before_last = [join_texts(lost[:-1])] if len(lost) > 1 else []
        all_lost = join_texts([*before_last, lost[-1]], message("base.and", " and "))
        headline = message("simulink.things_lost", "{things} lost", things=all_lost)
    alone = sum(outcome.text == _ALONE for outcome in found)
    opened = sum(outcome.fate == "open" for outcome in found)
    parts = [
        (
            assumed,
            message(
                "simulink.count_assumed", "{count} {count:figure|figures} assumed", count=assumed
            ),
        ),
        (
            prescribed,
            message(
                "simulink.count_prescribed",
                "{count} {count:joint|joints} prescribed",
                count=prescribed,
            ),
        ),
        (
            alone,
            message(
                "simulink.count_alone",
                "{count} network {count:block|blocks} joined with no body",
                count=alone,
            ),
        ),
        (
            opened,
            message(
                "simulink.count_open",
                "{count} control {count:block|blocks} left open",
                count=opened,
            ),
        ),
    ]
    return join_texts([headline, *(text for count, text in parts if count)], "; ")


def _counted_noun(count: int, noun: str) -> str:
    """Count what is lost: "2 cables"."""
    named = _noun(noun, count)
    return (
        format_count(count, noun)
        if named is None
        else compound("{count} {noun}", count=count, noun=named)
    )


def _noun(noun: str, count: int) -> str | None:
    """Word for what is lost, which other languages have.

    Args:
        noun: word in the singular, of the table of block types, or the type of a block.
        count: how many are lost.

    Returns:
        the word in the singular or plural, or None for the type of a block, which is a name.
    """
    words = {
        "lead screw": message(
            "simulink.noun_lead_screw", "{count:lead screw|lead screws}", count=count
        ),
        "constant velocity joint": message(
            "simulink.noun_velocity_joint",
            "{count:constant velocity joint|constant velocity joints}",
            count=count,
        ),
        "constraint": message(
            "simulink.noun_constraint", "{count:constraint|constraints}", count=count
        ),
        "force": message("simulink.noun_force", "{count:force|forces}", count=count),
        "tyre": message("simulink.noun_tyre", "{count:tyre|tyres}", count=count),
        "contact": message("simulink.noun_contact", "{count:contact|contacts}", count=count),
        "variable mass": message(
            "simulink.noun_variable_mass", "{count:variable mass|variable masses}", count=count
        ),
        "flexible body": message(
            "simulink.noun_flexible_body", "{count:flexible body|flexible bodies}", count=count
        ),
        "pulley": message("simulink.noun_pulley", "{count:pulley|pulleys}", count=count),
        "cable": message("simulink.noun_cable", "{count:cable|cables}", count=count),
        "drive": message("simulink.noun_drive", "{count:drive|drives}", count=count),
    }
    return words.get(noun)


@dataclass(frozen=True)
class ImportedModel:
    """What an import made."""

    model: SimulinkModel  # what was read
    files: StationFiles  # what was written
    station: Path | None  # the station's file; None where nothing moves
    outcomes: list[BlockOutcome]  # what became of every block

    @property
    def fidelity(self) -> str:
        """How faithful the station is, in one line."""
        assumed = sum(map(len, self.model.findings.undefined.values()))
        return fidelity(self.outcomes, len(self.files.content.get("prescribed", ())), assumed)

    @property
    def report(self) -> ImportReport:
        """What became of the blocks."""
        return self.model.report


def import_simulink(
    path: Path | str, folder: Path | str, *, force: bool = False, **options: Any
) -> ImportedModel:
    """Write the robots, pieces and station of a model into a folder, with a report.

    Args:
        path: `.slx` or `.mdl`, or the `.xml` of a CAD assembly.
        folder: where to; it appears at once, when everything is in it.
        force: replace an import that is there.
        options: of :func:`~simrob_drake.extensions.simulink.simulink_model.read_simulink`.

    Raises:
        InvalidModel: the model cannot be read, uses variables that are not known, or holds what no station can be.
        OutputError: the folder cannot be written, or exists.
    """
    path, folder = as_path(path, "path"), as_path(folder, "folder")
    model = read_simulink(path, **options)
    check_importable(model)
    with filled_at_once(folder, marker=REPORT_FILE, force=force) as work:
        files = StationWriter(model, work).write()
        file = f"{plain(path.stem)}.yaml"
        station = folder / file if files.content else None
        axes = sum(len(robot.tree.freedoms) for robot in files.robots.values())
        if files.content.get("couplings") and axes > _FEW:
            model.report.add(
                "approximated",
                "run",
                message(
                    "simulink.tried_for_steps",
                    "with {axes} axes it is tried for {most} steps at most",
                    axes=axes,
                    most=_most_tried(axes),
                ),
            )
        if files.content.get("couplings"):
            _hold(work / file, files.content, axes, model.report)
        elif files.content.get("contact"):  # which a solver's steps may be too long for
            _tell_of_run(*_try(work / file, _BEGUN, axes), model.report)
        made = ImportedModel(model, files, station, outcomes(model))
        report = {
            "fidelity": made.fidelity,
            **model.report.as_json(),
            "blocks": [asdict(outcome) for outcome in made.outcomes],
        }
        (work / REPORT_FILE).write_text(
            json.dumps(report, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
        )
    return made


_TRIED, _MOST_TRIED, _FEW, _LEAST_TRIED = 0.2, 2000, 60, 3
"""What is tried of a run [s], in how many steps with a few axes; the work of a step grows with the cube of these."""
_BEGUN = 1e-4  # s of a run that only shows whether it begins
_OPEN, _TORN = (
    1e-3,
    0.1,
)  # m or rad, what a coupling may be open then and not be noted, and be none any more


def _most_tried(axes: int) -> int:
    return max(_LEAST_TRIED, int(_MOST_TRIED * min(1.0, _FEW / max(axes, 1)) ** 3))


def _try(station: Path, duration: float, axes: int) -> tuple[str, dict[str, float]]:
    """Return why a station does not go on from its first moments, and which couplings are open [m or rad]."""
    steps, most = count(1), _most_tried(axes)

    def look(*_: Any) -> None:
        if next(steps) == most:
            raise KeyboardInterrupt  # which ends a run, and keeps what was reached

    try:
        result = simulate(station, duration=duration, progress=False, on_step=look)
    except SimrobError as problem:
        return str(problem).replace(str(station), station.name), {}
    if result.ending == "interrupted" and next(steps) <= most:
        raise KeyboardInterrupt  # by the user
    gaps = (
        measure.entries
        for measure in result.verdict.measures
        if measure.criterion.name == "coupling_gap"
    )
    soft = {
        entry.subject: entry.value for entry in chain.from_iterable(gaps) if entry.value > _OPEN
    }
    return result.message if result.ending in ("diverged", "failed") else "", soft


def _tell_of_run(stops: str, soft: dict[str, float], report: ImportReport) -> None:
    if stops:
        report.add(
            "lost",
            "run",
            message(
                "simulink.does_not_run", "the station does not run as it is: {stops}", stops=stops
            ),
        )
    elif max(soft.values(), default=0.0) > _TORN:
        report.add(
            "lost",
            message("simulink.closed_loop", "closed loop"),
            message("simulink.comes_apart", "it comes apart within {tried:g} s", tried=_TRIED),
        )
    for name, gap in soft.items():
        text = message(
            "simulink.coupling_too_weak",
            "its coupling holds less than what pulls at it: {gap:.3g} mm (or mrad) open",
            gap=1e3 * gap,
        )
        report.add(
            "approximated",
            name,
            message(
                "simulink.within_seconds", "{text} within {tried:g} s", text=text, tried=_TRIED
            ),
        )


def _hold(station: Path, content: dict[str, Any], axes: int, report: ImportReport) -> None:
    """Let couplings too soft for what they hold be constraints of a discrete solver, or shorten its steps."""
    stops, soft = _try(station, _TRIED, axes)
    for kind, step, most in (("continuous", 1e-4, _OPEN), ("discrete", 1e-5, 10 * _OPEN)):
        worst = max(soft.values(), default=0.0)
        if content["solver"]["kind"] != kind or not (stops or worst > most):
            continue
        written, tied = content_of(station), {**SOLVERS["points"], "time_step": step}
        station.write_bytes(
            re.sub(rb"(?m)^solver: .*$", f"solver: {json.dumps(tied)}".encode(), written)
        )
        why, still = _try(station, _TRIED, axes)
        if not why and (stops or max(still.values(), default=0.0) < worst):
            stops, soft, content["solver"] = "", still, tied
            report.add(
                "read",
                "solver",
                message(
                    "simulink.discrete_instead",
                    "a discrete one, steps of {step:g} s: couplings were too soft otherwise",
                    step=step,
                ),
            )
        else:
            station.write_bytes(written)
    _tell_of_run(stops, soft, report)


def check_importable(model: SimulinkModel) -> None:
    """Check that a station can be made of a model.

    Raises InvalidModel: variables that are not known, or what was refused.
    """
    missing = None if model.findings.assume else undefined_variables(model)
    if missing is not None:
        raise missing
    refused = model.report.of("refused")
    if refused:
        more = (
            message(
                "simulink.and_more_refused",
                " (and {count} more: simrob check {path})",
                count=len(refused) - 1,
                path=model.path.name,
            )
            if len(refused) > 1
            else ""
        )
        raise model.report.refusal(refused[0].element, refused[0].text + more)
    weighs = any(body.solids for body in model.bodies.bodies)
    if not weighs and not model.bodies.links:
        raise model.report.refusal(
            "",
            message(
                "simulink.no_bodies",
                "holds no Simscape Multibody bodies: there is nothing to simulate",
            ),
        )
