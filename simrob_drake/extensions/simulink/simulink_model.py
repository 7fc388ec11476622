"""Read everything of a model: blocks, mechanics, contacts, control laws, and what stops it."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.extensions.simulink.cad.model import read_cad_model
from simrob_drake.extensions.simulink.mechanics.bodies import (
    Bodies,
    ContactPair,
    RigidPart,
    read_bodies,
    read_contacts,
)
from simrob_drake.extensions.simulink.mechanics.joints import Freedom, Joint
from simrob_drake.extensions.simulink.mechanics.loops import close, cuttable
from simrob_drake.extensions.simulink.mechanics.shapes import MeshFiles
from simrob_drake.extensions.simulink.mechanics.trees import Tree, grow
from simrob_drake.extensions.simulink.model.network import Connections
from simrob_drake.extensions.simulink.model.nodes import Expanded, Findings, Node, expand
from simrob_drake.extensions.simulink.reading.model_file import Libraries, read_model
from simrob_drake.extensions.simulink.signals.arithmetic import ARITHMETIC
from simrob_drake.extensions.simulink.signals.code import CODE
from simrob_drake.extensions.simulink.signals.components import offer_component
from simrob_drake.extensions.simulink.signals.dynamics import DYNAMICS
from simrob_drake.extensions.simulink.signals.forms import (
    MOST_ELEMENTS,
    Form,
    Rule,
    Signal,
    Term,
    TermKind,
    Tracer,
    Value,
    flat,
    signal,
    terms_of,
)
from simrob_drake.extensions.simulink.signals.laws import (
    ExternalForce,
    Law,
    begin_on_motions,
    forces_of_contacts,
    read_laws,
    read_pushes,
)
from simrob_drake.extensions.simulink.signals.networks import NETWORKS, outputs_of
from simrob_drake.extensions.simulink.signals.robotics import ROBOTICS
from simrob_drake.extensions.simulink.signals.routing import ROUTING, subsystem
from simrob_drake.extensions.simulink.signals.sources import (
    PHYSICAL,
    SENSOR,
    SOURCES,
    out_of_physics,
    sensed,
)
from simrob_drake.extensions.simulink.values.workspace import Variables, find_octave
from simrob_drake.robots.imports import ImportReport

_LONGEST = 3600.0  # s


@dataclass
class SimulinkModel:
    """What a model is."""

    path: Path  # the file
    expanded: Expanded  # its blocks, with libraries put in
    network: Connections  # what is connected with what
    bodies: Bodies  # its mechanics
    world: RigidPart | None  # None where no frame is it
    trees: list[Tree]
    contacts: list[ContactPair]  # what may touch
    laws: dict[Freedom, Law]  # of the driven degrees of freedom
    pushes: list[ExternalForce]  # forces and torques on bodies, from signals
    tracer: Tracer  # that has followed its signals
    stopping: list[Node]  # contacts whose distance stops the simulation
    stops: dict[Node, Value]  # what else stops it, by the Stop block: as soon as the sum is not 0
    gravity: Vector | None  # shape (3,) [m/s²]; None where what is around it tells
    duration: float  # of a run [s]
    report: ImportReport  # what was found

    @property
    def findings(self) -> Findings:
        """What was not known."""
        return self.expanded.findings

    def law_of(self, freedom: Freedom) -> Law:
        """Return what drives a degree of freedom; an idle law where nothing does."""
        return self.laws.get(freedom, Law())


def read_simulink(
    path: Path | str,
    *,
    libraries: tuple[Path, ...] = (),
    meshes: tuple[Path, ...] = (),
    variables: dict[str, Any] | None = None,
    assume: bool = False,
    octave: bool = False,
    servos: bool = False,
    contact_law: bool = False,
) -> SimulinkModel:
    """Read a model.

    Args:
        path: `.slx` or `.mdl`, or the `.xml` of a CAD assembly.
        libraries: folders where libraries and referenced subsystems lie, beside the model's own.
        meshes: likewise for mesh files.
        variables: of the MATLAB workspace, by name.
        assume: take a block's default for a parameter whose variable is not known.
        octave: run code of masks and of the model's workspace that is outside the subset in GNU Octave.
        servos: let laws that come to a servo be one, instead of a signal flow.
        contact_law: let spheres touch planes by Simscape's law, instead of the station's contact.

    Raises:
        InvalidModel: the file cannot be read, or a block's figures cannot be.
    """
    path = as_path(path, "path")
    report = ImportReport(path)
    findings = Findings(report, assume=assume)
    model = read_cad_model(path) if path.suffix.lower() == ".xml" else read_model(path)
    for note in model.notes:
        report.add(*note)
    files = Libraries([path.parent, *libraries])
    runner = find_octave(files.folders) if octave else None
    expanded = expand(model, files, dict(variables or {}), findings, runner)
    network = Connections(expanded)
    bodies = read_bodies(network, MeshFiles([path.parent, *meshes]))
    world, trees = grow(bodies, cuttable)
    contacts = read_contacts(network)
    joints = [link.joint for link in bodies.links]
    tracer = tracer_of(network, joints, contacts)
    laws, pushes = read_laws(tracer, joints, servos=servos), read_pushes(tracer, bodies)
    by_law = forces_of_contacts(contacts, bodies) if contact_law else {}
    pushes += by_law.values()
    contacts = [contact for contact in contacts if contact not in by_law]
    begin_on_motions(laws)
    for tree in trees:
        close(tree)
    stopping, stops = _stopping(tracer, expanded)
    _tell_of_others(expanded, tracer)
    return SimulinkModel(
        path, expanded, network, bodies, world, trees, contacts, laws, pushes, tracer, stopping, stops,
        _gravity(expanded, network, bodies), _duration(expanded), report,
    )  # fmt: skip


def undefined_variables(model: SimulinkModel) -> InvalidModel | None:
    """Return one error that tells all variables that are not known, or None."""
    missing = model.findings.undefined
    if not missing:
        return None
    counts = {
        name: message("simulink.and_more_places", " and {count} more", count=len(places) - 1)
        if len(places) > 1
        else ""
        for name, places in missing.items()
    }
    listed = [f"{name} ({places[0]}{counts[name]})" for name, places in missing.items()]
    more = (
        message("simulink.and_more_missing", ", and {count} more", count=len(missing) - 8)
        if len(missing) > 8
        else ""
    )
    first = next(iter(missing)).partition(" ")[0]
    offered = model.expanded.libraries.offered(model.expanded.model)
    files = sorted({offered[name][0] for name in missing if name in offered})
    taken = (
        message(
            "simulink.files_would_set",
            "what {files} would set, and else defaults,",
            files=", ".join(files[:3]),
        )
        if files
        else "defaults"
    )
    remedy = message(
        "simulink.give_variables",
        "give them with --set {first}=VALUE or --variables FILE.mat, or take {taken} with --assume",
        first=first,
        taken=taken,
    )
    return InvalidModel(
        model.path,
        "",
        message(
            "simulink.unknown_variables",
            "variables that only MATLAB knows: {names}{more}; {remedy}",
            names="; ".join(listed[:8]),
            more=more,
            remedy=remedy,
        ),
    )


def _gravity(expanded: Expanded, network: Connections, bodies: Bodies) -> Vector | None:
    """Return it [m/s²]; 0 where no block tells it, as in Simulink; None for a part of a model, or a CAD assembly."""
    found: list[Vector] = []
    for node in expanded.nodes:
        if node.kind != "Mechanism Configuration" or node.block.commented != "off":
            continue
        how = node.text("UniformGravity", "Constant")
        own = (
            node.numbers("GravityVector", "[0 0 -9.80665]", unit="m/s^2", size=3)
            if how != "None"
            else np.zeros(3)
        )
        if network.net(node, "rconn") in bodies.by_place:
            found.append(own)
            if how not in ("None", "Constant") or not np.allclose(own, found[0]):
                node.note(
                    "lost",
                    message(
                        "simulink.gravity_from_signal",
                        "its gravity comes from a signal, or differs; that of the first dialog is taken",
                    ),
                )
        elif own.any():
            node.note(
                "dropped",
                message("simulink.connected_with_no_body", "it is connected with no body"),
            )
    whole = expanded.model.kind == "Model"
    if not found and bodies.by_place and expanded.model.kind != "Assembly":
        lacking = (
            message("simulink.no_gravity", "none: no Mechanism Configuration tells it")
            if whole
            else message("simulink.gravity_of_outside", "the earth's: what it is put into tells it")
        )
        expanded.findings.report.add("read", "gravity", lacking)
    return found[0] if found else np.zeros(3) if whole else None


def _duration(expanded: Expanded) -> float:
    try:
        value = float(
            np.asarray(expanded.root.workspace.value(expanded.model.stop_time)).reshape(-1)[0]
        )
    except (ValueError, LookupError, IndexError, TypeError):
        value = 10.0
    return min(value, _LONGEST) if np.isfinite(value) and value > 0 else 10.0


def _stopping(tracer: Tracer, expanded: Expanded) -> tuple[list[Node], dict[Node, Value]]:
    """Return the contacts whose distance, compared with zero, stops the simulation, and what else does."""
    found, stops = list[Node](), dict[Node, Value]()
    for node in (one for one in expanded.nodes if one.kind in ("Stop", "Stop Simulation")):
        source = tracer.network.source(node)
        compares = source is not None and source[0].kind in (
            "Compare To Zero",
            "Compare To Constant",
        )
        values = flat(tracer.input(source[0])) if source and compares else []
        terms = (term for value in values for term in terms_of(value))
        contacts = [
            term.of for term in terms if term.kind == "distance" and isinstance(term.of, Node)
        ]
        found += contacts
        stops |= {} if contacts else {node: flat(tracer.input(node))[0]}
    return found, stops


_UNHEEDED = {
    "TriggerPort": message(
        "simulink.trigger_not_read", "its trigger is not read: what is in it goes on all the time"
    ),
    "ResetPort": message("simulink.reset_not_read", "its reset is not read: its states go on"),
}
"""What a subsystem becomes that has such a port."""


def _tell_of_others(expanded: Expanded, tracer: Tracer) -> None:
    """Report what no station has: triggers that something moves by, open blocks, callbacks."""
    report = expanded.findings.report
    for port in (node for node in expanded.nodes if node.kind in _UNHEEDED):
        subsystem = port.path.removesuffix(port.block.name)
        if any(
            node.path.startswith(subsystem) and tracer.followed(node) for node in expanded.nodes
        ):
            report.add("approximated", subsystem.removesuffix("/"), _UNHEEDED[port.kind])
    for node, why in tracer.opened.items():
        block = node.kind or message("simulink.block", "block")
        text = message("simulink.left_open", "{block}: left open", block=block)
        report.add("open", node.path, join_texts([text, why], "; ") if why else text)
    for name in expanded.model.callbacks:
        text = message(
            "simulink.a_callback",
            "a callback: what it assigns is read where a block asks for it, and nothing else is done",
        )
        report.add("read", name, text)
    level: Variables | None = expanded.root.workspace
    while level is not None:
        for file in sorted(level.absent):
            report.add(
                "defaulted",
                level.name,
                message(
                    "simulink.variables_from_elsewhere",
                    "takes variables from {file}, which lies in none of the folders",
                    file=file,
                ),
            )
        level = level.outer


RULES: dict[str, Rule] = {
    **ROUTING, **ARITHMETIC, **CODE, **SOURCES, **DYNAMICS, **PHYSICAL, **NETWORKS, **ROBOTICS,
    "PS-Simulink Converter": out_of_physics,
}  # fmt: skip
"""What each type of block gives."""
_SENSED: tuple[TermKind, ...] = ("q", "w", "a", "t")


def tracer_of(network: Connections, joints: list[Joint], contacts: list[ContactPair]) -> Tracer:
    """Return what follows the signals of a model, those that joints, contacts and sensors measure included."""
    tracer = Tracer(network, {**RULES, **dict.fromkeys(("SubSystem", "ModelReference"), subsystem)})
    for joint in joints:
        _offer_sensed(tracer, joint)
    for contact in contacts:
        if contact.senses_distance:
            tracer.offer(
                contact.node,
                contact.senses_distance,
                partial(_each, Term("distance", contact.node)),
            )
    for node in network.expanded.nodes:
        if node.kind == SENSOR:
            for number, give in sensed(node).items():
                tracer.offer(node, number, give)
        elif node.kind in PHYSICAL:
            tracer.offer(node, 1, partial(tracer.output, node))
        elif node.kind not in NETWORKS:
            offer_component(tracer, node)
        for number, (_, side, port) in enumerate(
            outputs_of(node) if node.kind in NETWORKS else (), start=1
        ):
            tracer.offer(node, port, partial(tracer.output, node, number), side)
    return tracer


def _offer_sensed(tracer: Tracer, joint: Joint) -> None:
    for number, (freedom, what) in joint.outputs.items():
        kind = next((kind for kind in _SENSED if kind == what), None)
        term = (
            Term(kind, freedom) if kind else Term("open", joint.node, (number - 1) * MOST_ELEMENTS)
        )
        tracer.offer(joint.node, number, partial(_each, term))
    for number, parts in joint.senses.items():
        terms = [Term("sensed", joint.node, part) for part in parts]
        tracer.offer(
            joint.node, number, partial(_each, *(terms or [Term("open", joint.node, number)]))
        )


def _each(*terms: Term) -> Signal:
    return signal(Form({term: 1.0}) for term in terms)
