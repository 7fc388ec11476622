"""Warnings about the mechanics of a robot's file that a station does not simulate.

Two causes are covered. An import converts a robot's file to a URDF and writes a *report*, whose entries name what was
lost, such as a spring. And a *mimic joint*, which the file makes follow another joint (its leader), is only held by
some solvers.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from simrob_drake.base.errors import list_names
from simrob_drake.base.messages import Message, compound, message
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import Entry, read_report
from simrob_drake.robots.urdf import mass_of, name_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.coupled import unheld_mimics
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.grouping import WordGroup, group_by_words


def import_findings(
    config: StationConfig,
    robot: ResolvedRobot,
    *,
    source: Path | None = None,
) -> list[Finding]:
    """Find the mechanics of a robot's file that the station does not simulate.

    Args:
        config: configuration of the station.
        robot: a robot of the station, whether it was imported or not.
        source: file under which the user knows the robot, for the texts. If it is None, the file of the station's
            section or of the import is named.

    Returns:
        a warning for each mimic joint that the solver does not hold. For an imported robot also one warning about lost
        joint friction, a warning for each other loss of mechanics (losses with the same words share one), and a note
        about estimated inertias, each if there is any; and a note that sums up the import, if the station itself
        imports the robot.
    """
    findings = []
    for follower, leader in unheld_mimics(config, robot.name, robot.model):
        findings.append(_unheld_mimic_finding(config, follower, leader))
    # The report is a file next to the converted URDF. Files that need no conversion have none.
    report = read_report(robot.model.folder)
    if report is None:  # the robot was not imported
        return findings
    # The file that the station imports; None if the station names the robot by a model.
    imported_by_station = config.robots[robot.name].urdf
    source = source or imported_by_station or report.source
    subject = message("stations.import_of", "import of {file}", file=source.name)
    # Friction has a finding of its own, as a setting brings it back.
    frictions = _lost_frictions(robot, report.of("lost"))
    if frictions:
        findings.append(_friction_finding(config, robot, source, frictions))
    losses = [(loss.element, loss.text) for loss in _losses(robot, report.of("lost"))]
    for group in group_by_words(losses):
        text = _loss_text(group)
        # The text alone becomes a warning of a run, so it names the file; the subject is only a title.
        title = message("stations.lost_mechanics", "lost mechanics")
        whole_text = message(
            "stations.lost_in", "lost in the {subject}: {text}", subject=subject, text=text
        )
        findings.append(Finding("warning", title, whole_text))
    estimated = estimated_inertias(robot.model, source)
    if estimated:
        inertias = message("stations.inertias_of", "inertias of {robot}", robot=robot.name)
        findings.append(Finding("note", inertias, estimated))
    # A station may also use a robot that was imported earlier. Only the station that imports gets the summary.
    if imported_by_station is not None:
        summary = message(
            "stations.summary_of_import",
            "{summary}; `simrob check {source}` shows the details",
            summary=report.summary(),
            source=source,
        )
        findings.append(Finding("note", subject, summary))
    return findings


def _loss_text(group: WordGroup) -> str:
    """Describe losses with the same text: the first element with the text, then the names of the other elements."""
    first, *others = group.places
    # A loss of the whole robot names no element.
    text = compound("{first}: {text}", first=first, text=group.text) if first else group.text
    if others:
        text += message(
            "stations.likewise", "; the same applies to {others}", others=list_names(others)
        )
    return text


def _axis_of_joint(robot: ResolvedRobot, element: str) -> str | None:
    """Find the axis whose joint an entry of a report describes. Returns None if the entry describes something else.

    Args:
        robot: the imported robot.
        element: element that the entry names, such as ``joint 'elbow' <dynamics>``.
    """
    # Entries name a part of the joint's element, such as its dynamics, or the joint itself.
    whole_element = element.removesuffix(" <dynamics>")
    for name, axis in robot.model.axes.items():
        # Reports are in English. A message compares as its English text, whatever language the user sees.
        if whole_element == message("stations.joint_called", "joint '{joint}'", joint=axis.joint):
            return name
    return None


def _losses(robot: ResolvedRobot, lost: list[Entry]) -> Iterator[Entry]:
    """Select the losses of an import that become findings of their own.

    Friction of an axis is left out: `_friction_finding` reports it, unless the axis has friction again. Mimic joints of
    axes are left out, too. Older imports reported them as lost, but stations now couple such an axis to its leader;
    `_unheld_mimic_finding` reports those that the solver does not hold.

    Args:
        robot: the imported robot.
        lost: entries of the import's report about losses.

    Yields:
        the losses that remain.
    """
    for loss in lost:
        axis = _axis_of_joint(robot, loss.element)
        if axis is not None:
            if _FRICTION.match(loss.text):
                continue
            if loss.text.startswith("mimics ") and axis in robot.model.followers:
                continue
        yield loss


_FRICTION = re.compile(r"friction ([-+.\de]+)")
"""Start of the English text of a report's entry about lost friction, with its amount [N·m or N]."""


def _lost_frictions(robot: ResolvedRobot, lost: list[Entry]) -> dict[str, float]:
    """Find axes whose friction the import left out. Returns the friction in the robot's file, by axis [N·m or N].

    Axes that have friction again, by the section ``drives`` of the robot or of the station, are left out.

    Args:
        robot: the imported robot.
        lost: entries of the import's report about losses.
    """
    has_friction = dict(zip(robot.axes, robot.model.friction > 0, strict=True))
    frictions = {}
    for loss in lost:
        axis = _axis_of_joint(robot, loss.element)
        amount = _FRICTION.match(loss.text)  # its first group is the friction as a text
        if axis is not None and amount is not None and not has_friction[axis]:
            frictions[axis] = float(amount[1])
    return frictions


def _friction_finding(
    config: StationConfig,
    robot: ResolvedRobot,
    source: Path,
    frictions: Mapping[str, float],
) -> Finding:
    """Warn of joint friction that an import left out, with the setting that brings it back.

    Args:
        config: configuration of the station.
        robot: the imported robot.
        source: file of the robot.
        frictions: friction in the file, by axis [N·m or N].
    """
    units = dict(zip(robot.model.axes, robot.model.effort_units, strict=True))
    amounts = [
        compound("{axis} {friction:g} {unit}", axis=axis, friction=friction, unit=units[axis])
        for axis, friction in frictions.items()
    ]
    section = config.robot_key(robot.name)
    # One axis is set by its own key, several by one mapping, so that the user copies a single option.
    if len(frictions) == 1:
        ((axis, friction),) = frictions.items()
        setting = f"{section}.drives.friction.{axis}={friction:g}"
    else:
        values = ", ".join(f"{axis}: {friction:g}" for axis, friction in frictions.items())
        # Quoted for the shell, since braces and spaces have a meaning there.
        setting = f"'{section}.drives.friction={{{values}}}'"
    text = message(
        "stations.friction_left_out",
        "the import of {file} leaves out joint friction, which is seldom measured: {frictions}; "
        "`--set {setting}` restores it",
        file=source.name,
        frictions=list_names(amounts),
        setting=setting,
    )
    return Finding("warning", message("stations.friction_subject", "joint friction"), text)


_ESTIMATED = re.compile(r"estimated (from|as) |estimated: |a (small )?ball: ")
"""Part of the English text of a report's entry about an inertia that the import estimated.

Reports of earlier imports have the second or third form.
"""

_LINK_OF_ENTRY = re.compile(r"link '(.*)'")
"""Start of the English name of an element of a link, with the link's name."""


def estimated_inertias(model: RobotModel, source: Path | None = None) -> Message | None:
    """Name the links of a robot whose inertias its import estimated. Returns None if there is no such link.

    Args:
        model: the robot, whether it was imported or not.
        source: file under which the user knows the robot; if it is None, that of the import's report.
    """
    report = read_report(model.folder)
    if report is None:
        return None
    masses = {name_of(link): mass_of(link) for link in model.element.iterfind("link")}
    links = []
    for entry in report.of("defaulted"):
        link = _LINK_OF_ENTRY.match(entry.element)
        if link is not None and _ESTIMATED.search(entry.text):
            links.append(
                compound("{link} ({mass:.3g} kg)", link=link[1], mass=masses.get(link[1], 0.0))
            )
    if not links:
        return None
    file = (source or report.source).name
    return message(
        "stations.estimated_inertias",
        "the inertia of {links} is an estimate, since {file} has no usable value",
        links=list_names(links),
        file=file,
    )


def _unheld_mimic_finding(config: StationConfig, follower: str, leader: str) -> Finding:
    """Make the warning for a mimic joint that the station's solver does not hold.

    Args:
        config: configuration of the station.
        follower: name of the axis of the mimic joint.
        leader: name of the axis that it follows.
    """
    scheme = config.engine.name
    text = message(
        "stations.follower_uncoupled",
        "{follower} follows {leader} in the robot's file, but the solver {scheme} does not support "
        "couplings: each axis has its ",
        follower=follower,
        leader=leader,
        scheme=scheme,
    )
    text += message(
        "stations.own_motor", "own motor; use solver.kind discrete, or scheme radau3 or cenic"
    )
    return Finding(
        "warning", message("stations.mimic_of", "mimic of {follower}", follower=follower), text
    )
