"""Findings about collisions of robots with the ground, with themselves, with other robots and with pieces."""

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
"""Every 20th of a reference's 501 samples is checked; checking all of them would be slow."""


def clearance_findings(config: StationConfig, references: Mapping[str, Reference]) -> list[Finding]:
    """Check whether robots collide with the ground, with themselves or with other bodies.

    A robot with a reference is checked at samples of its reference, any other robot at its start posture.
    """
    if not config.robots:
        return []
    clearance = Clearance(config)
    sampled = {name: reference_samples(reference, config.duration) for name, reference in references.items()}
    postures = {name: positions[::_EVERY] for name, (_, positions) in sampled.items()}
    # All references are sampled at the same times; without any, only the start is checked.
    times = next((times[::_EVERY] for times, _ in sampled.values()), np.zeros(1))
    heights: dict[str, list[Mapping[str, float]]] = {name: [] for name in config.robots}
    overlaps: list[tuple[float, Overlap]] = []
    for index, time in enumerate(times.tolist()):
        clearance.place_robots({name: posture[index] for name, posture in postures.items()})
        overlaps += [(time, overlap) for overlap in clearance.overlaps()]
        for name, robot in clearance.station.robots.items():
            heights[name].append(clearance.lowest(robot))
    findings = []
    for name, robot in clearance.station.robots.items():
        when_checked = f"at {len(times)} times along its reference" if name in references else "where it starts"
        if not heights[name][0]:
            text = "not looked at: the robot has no shapes that collide"
            findings.append(Finding("note", f"clearance of {name}", text))
            continue
        if not robot.floats:  # a robot without a fixed base stands on the floor
            findings += _floor_findings(clearance, robot, times, heights[name], when_checked)
        findings += _self_findings(clearance, robot, overlaps, len(heights[name][0]), when_checked)
    return findings + _other_findings(clearance, overlaps)


def _floor_findings(
    clearance: Clearance, robot: StationRobot, times: Vector, heights: list[Mapping[str, float]], when_checked: str
) -> list[Finding]:
    """Find links of a robot that lie below the ground.

    Args:
        clearance: the station.
        robot: the robot, fixed to the world.
        times: times of the checked postures [s].
        heights: height of each link above the ground [m] by name, one mapping for each time.
        when_checked: text that tells the user at which postures the robot was checked.
    """
    ground, subject = clearance.station.ground, f"floor and {robot.name}"
    if not (ground.has_floor or ground.boxes):
        return [Finding("note", subject, "not looked at: there is no floor")]
    fixed_links = {
        body.name()
        for body in map(clearance.plant.get_body, clearance.plant.GetBodyIndices(robot.instance))
        if clearance.plant.IsAnchored(body)
    }
    bound = bound_value(clearance.config.verdict.below_floor)
    fixed_height = min((height for link, height in heights[0].items() if link in fixed_links), default=0.0)
    findings = []
    if fixed_height < -bound:
        text = f"what is fixed of it reaches {-fixed_height * 1e3:.0f} mm below the ground; raise its base"
        findings.append(Finding("warning", subject, text))
    moving = [
        (height, time, link)
        for time, link_heights in zip(times.tolist(), heights, strict=True)
        for link, height in link_heights.items()
        if link not in fixed_links
    ]
    if not moving:
        return [*findings, Finding("note", subject, "not looked at: no link that moves has a shape to touch with")]
    lowest, time, link = min(moving)
    if lowest >= -bound:
        text = f"{when_checked} {link} comes nearest to the ground: {max(lowest, 0.0) * 1e3:.0f} mm at {time:.2f} s"
        return [*findings, Finding("ok", subject, text)]
    text = f"{link} is {-lowest * 1e3:.0f} mm below the ground at {time:.2f} s"
    return [
        *findings,
        _contact_finding(clearance, subject, text, "raise its base, or change initial_deg and reference"),
    ]


def _self_findings(
    clearance: Clearance, robot: StationRobot, overlaps: list[tuple[float, Overlap]], shapes: int, when_checked: str
) -> list[Finding]:
    """Find collisions between links of one robot.

    Args:
        clearance: the station.
        robot: the robot.
        overlaps: all collisions in the station, with their times [s].
        shapes: count of the robot's bodies that have collision shapes.
        when_checked: text that tells the user at which postures the robot was checked.
    """
    subject = f"links of {robot.name}"
    left_out = _left_out_text(clearance, robot)
    own = [(time, overlap) for time, overlap in overlaps if overlap.robot == robot.name]
    if not own:
        return [Finding("ok", subject, f"{when_checked} none of {shapes} bodies with shapes lies in another{left_out}")]
    return [_contact_finding(clearance, subject, _deepest(own) + left_out, "change initial_deg or reference", own=True)]


def _left_out_text(clearance: Clearance, robot: StationRobot) -> str:
    """Text that lists the pairs of links that never count as a collision, with the reasons; empty if there are none."""
    policy = clearance.policy
    at_home = {bodies for bodies, owner in policy.home_contacts.items() if owner == robot.name}
    always = {bodies for bodies, owner in policy.permanent_overlaps.items() if owner == robot.name}
    text = ""
    for pairs, reason in ((always, "always overlap"), (at_home - always, "touch at home")):
        names = sorted(" and ".join(bodies) for bodies in pairs)
        text += f"; left out: {listed(names)}, whose shapes {reason}" if names else ""
    return text


def _other_findings(clearance: Clearance, overlaps: list[tuple[float, Overlap]]) -> list[Finding]:
    """Find collisions between different robots, or between robots and pieces; ``overlaps`` has the times [s]."""
    if len(clearance.resolved.robots) + len(clearance.resolved.pieces) < 2:
        return []
    others = [(time, overlap) for time, overlap in overlaps if overlap.is_between_owners]
    if others:
        return [_contact_finding(clearance, "robots and pieces", _deepest(others), "move one of them")]
    return [Finding("ok", "robots and pieces", "none lies in one that it does not hang on, where references lead")]


def _contact_finding(clearance: Clearance, subject: str, text: str, remedy: str, *, own: bool = False) -> Finding:
    """Report a collision, as a note if the run simulates the contact, and as a warning if it does not.

    Args:
        clearance: the station.
        subject: the bodies that the finding is about.
        text: describes the collision.
        remedy: tells the user what to change.
        own: whether both bodies belong to the same robot.
    """
    config = clearance.config
    if config.mode == "dynamic" and config.contact is not None and (config.contact.self_collision or not own):
        return Finding("note", subject, f"{text}, if nothing held them back; the run shows what comes of it")
    why = "contact.self_collision is off" if own and config.contact is not None else "the station has no contact"
    return Finding("warning", subject, f"{text}, and nothing holds them back: {why}; {remedy}")


def _deepest(overlaps: list[tuple[float, Overlap]]) -> str:
    """Describe the deepest of some collisions with its time [s], and count the other pairs of bodies."""
    time, worst = max(overlaps, key=lambda timed: timed[1].depth)
    more = len({overlap.bodies for _, overlap in overlaps}) - 1
    text = f"{' and '.join(worst.bodies)} lie {worst.depth * 1e3:.0f} mm in each other at {time:.2f} s"
    return text + (f", and {more} more pairs" if more else "")
