"""Findings about collisions of robots with the ground, with themselves, with other robots and with pieces.

The station is not simulated. Its robots are set to postures along their references (the desired motions), and the
heights and overlaps of all bodies are measured in each posture. A finding is a result for the user: a warning, a note,
or that something is in order. The owner of a body is the robot that it belongs to: a link belongs to its robot, a piece
to the robot that carries it; other pieces have no owner. For heights, a *link* is a body of the plant: it includes the
links that are fixed to it and the pieces that it carries.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import list_names
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.blocks.references import Reference
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.collisions import Bodies, Overlap
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.solver_config import bound_value

_EVERY = 20
"""Every 20th of a reference's 501 samples is checked; checking all of them would be slow."""


class _TimedOverlap(NamedTuple):
    """A collision of two bodies in one of the checked postures.

    Attributes:
        time: time of the posture [s].
        overlap: the two bodies and how deep they overlap.
    """

    time: float
    overlap: Overlap


class _LinkHeight(NamedTuple):
    """Height of a link in one of the checked postures. Sorted, the lowest link comes first.

    Attributes:
        height: height of the link's lowest point above the ground [m].
        time: time of the posture [s].
        link: name of the link.
    """

    height: float
    time: float
    link: str


@dataclass(frozen=True)
class _Measurements:
    """Heights and collisions in the checked postures.

    Attributes:
        times: times of the m postures, shape (m,) [s].
        heights: for each robot by name, m mappings with the height of each of its links above the ground [m], by the
            link's name. Links without collision shapes are left out.
        overlaps: the collisions of all postures, without those with the floor.
    """

    times: Vector
    heights: Mapping[str, Sequence[Mapping[str, float]]]
    overlaps: Sequence[_TimedOverlap]


def clearance_findings(config: StationConfig, references: Mapping[str, Reference]) -> list[Finding]:
    """Check whether robots collide with the ground, with themselves or with other bodies.

    A robot with a reference is checked at samples of its reference, any other robot at its start posture. A station
    without robots has no findings.

    Args:
        config: the station.
        references: references by robot; robots that a controller leads have none.
    """
    if not config.robots:
        return []
    clearance = Clearance(config)
    # All checks below read the same postures: setting and measuring them takes most of the time.
    measured = _measure(clearance, references)
    findings = list[Finding]()
    for name, robot in clearance.station.robots.items():
        heights = measured.heights[name]
        has_shapes = bool(heights[0])
        if not has_shapes:
            text = message(
                "stations.no_colliding_shapes",
                "not examined: the robot has no collision shapes",
            )
            findings.append(
                Finding(
                    "note", message("stations.clearance_of", "clearance of {name}", name=name), text
                )
            )
            continue
        when_checked = message("stations.where_it_starts", "at the start,")
        if name in references:
            when_checked = message(
                "stations.at_times_along_reference",
                "at {count} samples of its reference,",
                count=len(measured.times),
            )
        # A robot that floats touches the floor with its feet, which is no collision.
        if not robot.floats:
            findings += _floor_findings(clearance, robot, measured, when_checked)
        findings += _self_findings(clearance, robot, measured, when_checked)
    return findings + _other_findings(clearance, measured)


def _measure(clearance: Clearance, references: Mapping[str, Reference]) -> _Measurements:
    """Set the robots to postures along their references, and measure heights and collisions in each posture.

    A robot without a reference stays in its start posture.
    """
    # All references are sampled at the same times. Without references, only the start is checked.
    times = np.zeros(1)
    postures = {}
    for name, reference in references.items():
        all_times, positions = reference_samples(reference, clearance.config.duration)
        times = all_times[::_EVERY]
        postures[name] = positions[::_EVERY]

    heights: dict[str, list[Mapping[str, float]]] = {name: [] for name in clearance.config.robots}
    overlaps = list[_TimedOverlap]()
    for index, time in enumerate(times.tolist()):
        # All robots are moved to the same time before overlaps are measured: they may hit each
        # other.
        clearance.place_robots({name: posture[index] for name, posture in postures.items()})
        overlaps += [_TimedOverlap(time, overlap) for overlap in clearance.overlaps()]
        for name, robot in clearance.station.robots.items():
            heights[name].append(clearance.lowest(robot))
    return _Measurements(times, heights, overlaps)


def _floor_findings(
    clearance: Clearance, robot: StationRobot, measured: _Measurements, when_checked: str
) -> list[Finding]:
    """Report how low a robot reaches: the link that is deepest below the ground, otherwise the one nearest to it.

    A link counts as below the ground if it is deeper than the bound ``below_floor`` of the verdict.

    Args:
        clearance: the station.
        robot: the robot, fixed to the world.
        measured: heights of the links in the checked postures.
        when_checked: text that describes the checked postures, such as "at the start,".

    Returns:
        one note if the station has no ground. Otherwise one finding about the moving links: a note if none of them has
        a shape, that it is in order if none is below the ground, otherwise that of `_contact_finding`. Before it, a
        warning if fixed links are below the ground.
    """
    ground = clearance.station.ground
    subject = message("stations.floor_and", "floor and {robot}", robot=robot.name)
    if not (ground.has_floor or ground.boxes):
        return [
            Finding(
                "note",
                subject,
                message("stations.there_is_no_floor", "not examined: the station has no floor"),
            )
        ]
    # The same bound judges the run later, see the section `verdict`.
    allowed_depth = bound_value(clearance.config.verdict.below_floor)
    fixed_heights, moving_heights = _split_by_motion(clearance, robot, measured)
    findings = []

    # A fixed link below the ground needs another remedy than a moving one: its base.
    # The default is on the ground, so that a robot without fixed shapes has no finding.
    fixed_height = min(fixed_heights, default=0.0)
    if fixed_height < -allowed_depth:
        text = message(
            "stations.fixed_below_ground",
            "the fixed links reach {depth:.0f} mm below the ground; raise the robot's base",
            depth=-fixed_height * 1e3,
        )
        findings.append(Finding("warning", subject, text))

    if not moving_heights:
        text = message(
            "stations.no_moving_shape",
            "not examined: no moving link has a collision shape",
        )
        return [*findings, Finding("note", subject, text)]
    # The tuples are compared by their heights first.
    lowest = min(moving_heights)
    if lowest.height >= -allowed_depth:
        # A link that is below the ground by no more than allowed counts as on the ground.
        height_mm = max(lowest.height, 0.0) * 1e3
        text = message(
            "stations.nearest_to_ground",
            "{when} the link nearest to the ground is {link}: {height:.0f} mm at {time:.2f} s",
            when=when_checked,
            link=lowest.link,
            height=height_mm,
            time=lowest.time,
        )
        return [*findings, Finding("ok", subject, text)]
    text = message(
        "stations.below_ground",
        "{link} is {depth:.0f} mm below the ground at {time:.2f} s",
        link=lowest.link,
        depth=-lowest.height * 1e3,
        time=lowest.time,
    )
    remedy = message(
        "stations.raise_base_or_change",
        "raise the robot's base, or change initial_deg and reference",
    )
    return [*findings, _contact_finding(clearance, subject, text, remedy)]


class _HeightsByMotion(NamedTuple):
    """Heights of a robot's links, in separate lists for links that are fixed to the world and links that move.

    Attributes:
        fixed: height of each fixed link [m].
        moving: heights of the moving links in all postures.
    """

    fixed: list[float]
    moving: list[_LinkHeight]


def _split_by_motion(
    clearance: Clearance,
    robot: StationRobot,
    measured: _Measurements,
) -> _HeightsByMotion:
    """Separate the heights of a robot's fixed links, such as its base, from those of its moving links."""
    plant = clearance.plant
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
    fixed_links = {body.name() for body in bodies if plant.IsAnchored(body)}
    by_motion = _HeightsByMotion(fixed=[], moving=[])
    for time, heights in zip(measured.times.tolist(), measured.heights[robot.name], strict=True):
        for link, height in heights.items():
            if link not in fixed_links:
                by_motion.moving.append(_LinkHeight(height, time, link))
            elif time == 0.0:
                # Fixed links have the same height at all times, so the first one suffices.
                by_motion.fixed.append(height)
    return by_motion


def _self_findings(
    clearance: Clearance, robot: StationRobot, measured: _Measurements, when_checked: str
) -> list[Finding]:
    """Report whether a robot collides with itself or with the pieces that it carries.

    Args:
        clearance: the station.
        robot: the robot.
        measured: the collisions of all bodies in the checked postures.
        when_checked: text that describes the checked postures, such as "at the start,".

    Returns:
        one finding, which also lists the pairs of bodies that `_left_out_text` names.
    """
    subject = message("stations.links_of", "links of {robot}", robot=robot.name)
    left_out = _left_out_text(clearance, robot)
    # `overlap.robot` is empty if no robot owns both bodies, so it never equals a robot's name
    # there.
    own = [timed for timed in measured.overlaps if timed.overlap.robot == robot.name]
    if own:
        text = _deepest_text(own) + left_out
        remedy = message("stations.change_start_or_reference", "change initial_deg or reference")
        return [_contact_finding(clearance, subject, text, remedy, is_own=True)]
    # Each posture has the heights of the same links, those with shapes.
    count = len(measured.heights[robot.name][0])
    text = message(
        "stations.no_body_in_another",
        "{when} none of {count} bodies with shapes overlaps another one{left_out}",
        when=when_checked,
        count=count,
        left_out=left_out,
    )
    return [Finding("ok", subject, text)]


def _left_out_text(clearance: Clearance, robot: StationRobot) -> str:
    """List the pairs of a robot's bodies that do not count as collisions.

    These are pairs of links that touch at home, and pairs of links and carried pieces that overlap nearly always. Links
    that a joint connects do not count either, and are not listed.

    Returns the end of a sentence, or an empty text if there are no such pairs.
    """
    policy = clearance.policy
    at_home = {bodies for bodies, owner in policy.home_contacts.items() if owner == robot.name}
    always = {bodies for bodies, owner in policy.permanent_overlaps.items() if owner == robot.name}
    # A pair with both reasons is listed with the stronger one.
    text = ""
    if always:
        text += message(
            "stations.pairs_always_overlap",
            "; not examined: {pairs}, whose shapes always overlap",
            pairs=_pairs_text(always),
        )
    only_at_home = at_home - always
    if only_at_home:
        text += message(
            "stations.pairs_touch_at_home",
            "; not examined: {pairs}, whose shapes touch in the home posture",
            pairs=_pairs_text(only_at_home),
        )
    return text


def _pairs_text(pairs: Collection[Bodies]) -> str:
    """List pairs of bodies in alphabetical order."""
    return list_names(sorted(join_texts(bodies, message("base.and", " and ")) for bodies in pairs))


def _other_findings(clearance: Clearance, measured: _Measurements) -> list[Finding]:
    """Report collisions between bodies of different owners: robots, pieces, or a robot and a piece.

    Collisions with the floor are not among them; :func:`_floor_findings` measures the height of each link instead.

    Returns:
        one finding: the deepest collision, or that none is found. The list is empty if the station has only one robot
        and no piece.
    """
    # A single robot or piece has no other one to collide with.
    if len(clearance.resolved.robots) + len(clearance.resolved.pieces) < 2:
        return []
    subject = message("stations.robots_and_pieces", "robots and pieces")
    # Overlaps within one robot have a finding of their own, see `_self_findings`.
    others = [timed for timed in measured.overlaps if timed.overlap.is_between_owners]
    if others:
        remedy = message("stations.move_one_of_them", "move one of them")
        return [_contact_finding(clearance, subject, _deepest_text(others), remedy)]
    text = message(
        "stations.nothing_overlaps",
        "no robot or piece overlaps another one along the references, except pieces that robots carry or hold",
    )
    return [Finding("ok", subject, text)]


def _contact_finding(
    clearance: Clearance,
    subject: str,
    text: str,
    remedy: str,
    *,
    is_own: bool = False,
) -> Finding:
    """Report a collision, as a note if the run simulates the contact, and as a warning if it does not.

    Args:
        clearance: the station.
        subject: the bodies that the finding is about.
        text: describes the collision.
        remedy: what the user may change, for a warning.
        is_own: whether both bodies belong to the same robot.
    """
    contact = clearance.config.contact
    # Contact forces hold bodies apart in a dynamic station; between links of one robot they are optional.
    is_simulated = False
    if contact is not None and clearance.config.engine.moves_by_forces:
        is_simulated = contact.self_collision or not is_own
    if is_simulated:
        text = message(
            "stations.if_nothing_held_back",
            "{text}, if the reference is followed exactly; in a run, contact forces separate the bodies",
            text=text,
        )
        return Finding("note", subject, text)
    why = message("stations.no_contact", "the station has no contact")
    if is_own and contact is not None:
        why = message("stations.self_collision_is_off", "contact.self_collision is off")
    text = message(
        "stations.nothing_holds_back",
        "{text}, and no contact force separates the bodies: {why}; {remedy}",
        text=text,
        why=why,
        remedy=remedy,
    )
    return Finding("warning", subject, text)


def _deepest_text(overlaps: Sequence[_TimedOverlap]) -> str:
    """Describe the deepest of some collisions, at least one, with its time, and count the other pairs of bodies."""
    # The first of equally deep ones, so that the text is the same in every run.
    time, deepest = max(overlaps, key=lambda timed: timed.overlap.depth)
    # A set, as the same pair may collide in many of the postures.
    other_pairs = len({timed.overlap.bodies for timed in overlaps}) - 1
    text = message(
        "stations.lie_in_each_other",
        "{bodies} overlap by {depth:.0f} mm at {time:.2f} s",
        bodies=join_texts(deepest.bodies, message("base.and", " and ")),
        depth=deepest.depth * 1e3,
        time=time,
    )
    if other_pairs:
        text += message(
            "stations.and_more_pairs",
            ", and {pairs} {pairs:more pair|more pairs}",
            pairs=other_pairs,
        )
    return text
