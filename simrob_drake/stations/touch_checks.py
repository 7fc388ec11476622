"""What can be said before a run of what touches: surfaces, what lies in what at the start, and along the references."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.blocks.references import Reference
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.clearance import Clearance, Overlap
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.steps import Finding

DEEP = 1e-3
"""Things that rest on each other are less deep in each other [m]."""

_PRESSED = 1e-4  # bodies that lie deeper in each other than this at the start are pushed apart [m]
_EVERY = 20  # of the 501 samples of a reference
_BURIED = 5e-3  # what stands on the floor may reach below it by as much [m]
_LISTED = 3


def contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    """Look at the surfaces of a station, and at what lies in what at the start."""
    config, plant = ports.config, ports.plant
    if config.contact is None:
        return [Finding("note", "contact", "the station has none: whatever meets passes through each other")]
    dissipates = [config.contact, *(piece.contact for piece in config.pieces.values() if piece.contact is not None)]
    findings = []
    if config.solver.scheme == "sap" and any(material.dissipation for material in dissipates):
        text = "the solver scheme sap does not know contact.dissipation; take lagged or similar"
        findings.append(Finding("warning", "contact", text))
    context = diagram.CreateDefaultContext()
    query = plant.scene_graph.get_query_output_port().Eval(plant.scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    fallen_back = pairs_without_surface(plant.plant, plant.scene_graph.model_inspector())
    if fallen_back and config.contact.model != "point":
        text = f"both are rigid, so {', '.join(fallen_back)} meet in points; make one of them compliant"
        findings.append(Finding("warning", "contact", text))
    pairs = [pair for pair in query.ComputePointPairPenetration() if pair.depth > _PRESSED]
    if not pairs:
        return [*findings, Finding("ok", "contact", "of what can touch nothing penetrates at the start")]
    deepest = max(pairs, key=lambda pair: pair.depth)
    names = " and ".join(inspector.GetName(geometry) for geometry in (deepest.id_A, deepest.id_B))
    text = f"{names} penetrate by {deepest.depth * 1e3:.1f} mm at the start"
    text += "; move one of them" if deepest.depth > DEEP else ""
    return [*findings, Finding("warning" if deepest.depth > DEEP else "ok", "contact", text)]


def clearance_findings(config: StationConfig, references: Mapping[str, Reference]) -> list[Finding]:
    """Look how near the shapes of a station's robots come to the ground, to themselves and to others.

    That is along their references, where they follow these exactly; at the start where a controller leads.
    """
    if not config.robots:
        return []
    clearance = Clearance(config)
    sampled = {name: reference_samples(reference, config.duration) for name, reference in references.items()}
    ways = {name: positions[::_EVERY] for name, (_, positions) in sampled.items()}
    times = next((times[::_EVERY] for times, _ in sampled.values()), np.zeros(1))
    heights: dict[str, list[Mapping[str, float]]] = {name: [] for name in config.robots}
    overlaps: list[tuple[float, Overlap]] = []
    for row, time in enumerate(times.tolist()):
        clearance.place_robots({name: way[row] for name, way in ways.items()})
        overlaps += [(time, overlap) for overlap in clearance.overlaps()]
        for name, robot in clearance.station.robots.items():
            heights[name].append(clearance.lowest(robot))
    findings = []
    for name, robot in clearance.station.robots.items():
        looked = f"at {len(times)} times along its reference" if name in references else "where it starts"
        if not heights[name][0]:
            text = "not looked at: the robot has no shapes that collide"
            findings.append(Finding("note", f"clearance of {name}", text))
            continue
        if not robot.floats:
            findings += _floor_findings(clearance, robot, times, heights[name], looked)
        findings += _self_findings(clearance, robot, overlaps, len(heights[name][0]), looked)
    return findings + _other_findings(clearance, overlaps)


def _floor_findings(
    clearance: Clearance, robot: StationRobot, times: Vector, heights: list[Mapping[str, float]], looked: str
) -> list[Finding]:
    ground, subject = clearance.station.ground, f"floor and {robot.name}"
    if not (ground.has_floor or ground.boxes):
        return [Finding("note", subject, "not looked at: there is no floor")]
    held = {
        body.name()
        for body in map(clearance.plant.get_body, clearance.plant.GetBodyIndices(robot.instance))
        if clearance.plant.IsAnchored(body)
    }
    foot = min((height for link, height in heights[0].items() if link in held), default=0.0)
    findings = []
    if foot < -_BURIED:
        text = f"what is fixed of it reaches {-foot * 1e3:.0f} mm below the ground; raise its base"
        findings.append(Finding("warning", subject, text))
    moving = [
        (height, time, link)
        for time, row in zip(times.tolist(), heights, strict=True)
        for link, height in row.items()
        if link not in held
    ]
    lowest, time, link = min(moving, default=(np.inf, 0.0, ""))
    if lowest >= -_BURIED:
        text = f"{looked} {link} comes nearest to the ground: {max(lowest, 0.0) * 1e3:.0f} mm at {time:.2f} s"
        return [*findings, Finding("ok", subject, text)]
    text = f"{link} is {-lowest * 1e3:.0f} mm below the ground at {time:.2f} s"
    return [*findings, _met(clearance, subject, text, "raise its base, or change initial_deg and reference")]


def _self_findings(
    clearance: Clearance, robot: StationRobot, overlaps: list[tuple[float, Overlap]], shapes: int, looked: str
) -> list[Finding]:
    subject = f"links of {robot.name}"
    left_out = sorted(" and ".join(bodies) for bodies, owner in clearance.made_so.items() if owner == robot.name)
    spared = f"; left out: {listed(left_out)}, whose shapes always overlap" if left_out else ""
    own = [(time, overlap) for time, overlap in overlaps if overlap.robot == robot.name]
    if not own:
        return [Finding("ok", subject, f"{looked} none of {shapes} bodies with shapes lies in another{spared}")]
    return [_met(clearance, subject, _deepest(own) + spared, "change initial_deg or reference", own=True)]


def _other_findings(clearance: Clearance, overlaps: list[tuple[float, Overlap]]) -> list[Finding]:
    if len(clearance.resolved.robots) + len(clearance.resolved.pieces) < 2:
        return []
    others = [(time, overlap) for time, overlap in overlaps if not overlap.robot]
    if others:
        return [_met(clearance, "robots and pieces", _deepest(others), "move one of them")]
    return [Finding("ok", "robots and pieces", "none lies in one that it does not hang on, where references lead")]


def _met(clearance: Clearance, subject: str, text: str, remedy: str, *, own: bool = False) -> Finding:
    """Return what is to be said of things that meet: a run with contact shows it, any other lets them pass."""
    config = clearance.config
    if config.mode == "dynamic" and config.contact is not None and (config.contact.self_collision or not own):
        return Finding("note", subject, f"{text}, if nothing held them back; the run shows what comes of it")
    why = "contact.self_collision is off" if own and config.contact is not None else "the station has no contact"
    return Finding("warning", subject, f"{text}, and nothing holds them back: {why}; {remedy}")


def _deepest(overlaps: list[tuple[float, Overlap]]) -> str:
    time, worst = max(overlaps, key=lambda one: one[1].depth)
    more = len({overlap.bodies for _, overlap in overlaps}) - 1
    text = f"{' and '.join(worst.bodies)} lie {worst.depth * 1e3:.0f} mm in each other at {time:.2f} s"
    return text + (f", and {more} more pairs" if more else "")


def listed(names: list[str]) -> str:
    """Return names in a row, of many the first ones."""
    rest = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + rest
