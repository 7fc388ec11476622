"""Findings about what comes near what: robots, the ground, themselves and pieces."""

from collections.abc import Mapping

import numpy as np

from simrob_drake.blocks.references import Reference
from simrob_drake.errors import listed
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.collisions import Overlap
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.solver_config import bound_value

_EVERY = 20
"""One of so many of a reference's 501 samples is judged."""


def clearance_findings(config: StationConfig, references: Mapping[str, Reference]) -> list[Finding]:
    """Look how near robots come to ground, themselves and others, along references, or as controllers begin."""
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
    bound = bound_value(clearance.config.verdict.below_floor)
    foot = min((height for link, height in heights[0].items() if link in held), default=0.0)
    findings = []
    if foot < -bound:
        text = f"what is fixed of it reaches {-foot * 1e3:.0f} mm below the ground; raise its base"
        findings.append(Finding("warning", subject, text))
    moving = [
        (height, time, link)
        for time, row in zip(times.tolist(), heights, strict=True)
        for link, height in row.items()
        if link not in held
    ]
    if not moving:
        return [*findings, Finding("note", subject, "not looked at: no link that moves has a shape to touch with")]
    lowest, time, link = min(moving)
    if lowest >= -bound:
        text = f"{looked} {link} comes nearest to the ground: {max(lowest, 0.0) * 1e3:.0f} mm at {time:.2f} s"
        return [*findings, Finding("ok", subject, text)]
    text = f"{link} is {-lowest * 1e3:.0f} mm below the ground at {time:.2f} s"
    return [*findings, _met(clearance, subject, text, "raise its base, or change initial_deg and reference")]


def _self_findings(
    clearance: Clearance, robot: StationRobot, overlaps: list[tuple[float, Overlap]], shapes: int, looked: str
) -> list[Finding]:
    subject = f"links of {robot.name}"
    spared = _left_out_text(clearance, robot)
    own = [(time, overlap) for time, overlap in overlaps if overlap.robot == robot.name]
    if not own:
        return [Finding("ok", subject, f"{looked} none of {shapes} bodies with shapes lies in another{spared}")]
    return [_met(clearance, subject, _deepest(own) + spared, "change initial_deg or reference", own=True)]


def _left_out_text(clearance: Clearance, robot: StationRobot) -> str:
    """Return the pairs of links that never count as a collision, with the reasons."""
    policy = clearance.policy
    at_home = {bodies for bodies, owner in policy.home_contacts.items() if owner == robot.name}
    always = {bodies for bodies, owner in policy.permanent_overlaps.items() if owner == robot.name}
    text = ""
    for pairs, reason in ((always, "always overlap"), (at_home - always, "touch at home")):
        names = sorted(" and ".join(bodies) for bodies in pairs)
        text += f"; left out: {listed(names)}, whose shapes {reason}" if names else ""
    return text


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
