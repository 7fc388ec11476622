"""Warnings about the mechanics of a robot's file that a station does not simulate.

Two causes are covered. An import converts a robot's file to a URDF and writes a *report*, whose entries name what was
lost, such as a spring. And a *mimic joint*, which the file makes follow another joint (its leader), is only held by
some solvers.
"""

from collections.abc import Iterator
from pathlib import Path

from simrob_drake.base.errors import listed
from simrob_drake.base.messages import compound, message
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.imports import Entry, read_report
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.coupled import unheld_mimics
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.grouping import WordGroup, group_by_words


def import_findings(config: StationConfig, robot: ResolvedRobot, *, source: Path | None = None) -> list[Finding]:
    """Find the mechanics of a robot's file that the station does not simulate.

    Args:
        config: configuration of the station.
        robot: a robot of the station, whether it was imported or not.
        source: file under which the user knows the robot, for the texts. If it is None, the file of the station's
            section or of the import is named.

    Returns:
        a warning for each mimic joint that the solver does not hold; for an imported robot also a warning for each loss
        of mechanics (losses with the same words share one), and a note that sums up the import.
    """
    findings = []
    for follower, leader in unheld_mimics(config, robot.name, robot.model):
        findings.append(_unheld_mimic_finding(config, follower, leader))
    report = read_report(robot.model.folder)
    if report is None:  # the robot was not imported
        return findings
    imported_by_station = config.robots[robot.name].urdf
    source = source or imported_by_station or report.source
    subject = message("stations.import_of", "import of {file}", file=source.name)
    losses = [(loss.element, loss.text) for loss in _losses(robot, report.of("lost"))]
    for group in group_by_words(losses):
        text = _loss_text(group)
        # The text alone becomes a warning of a run, so it names the file; the subject is only a title.
        findings.append(
            Finding(
                "warning",
                message("stations.lost_mechanics", "lost mechanics"),
                message("stations.lost_in", "lost in the {subject}: {text}", subject=subject, text=text),
            )
        )
    # A station may also use a robot that was imported earlier. Only the station that imports gets the summary.
    if imported_by_station is not None:
        findings.append(
            Finding(
                "note",
                subject,
                message(
                    "stations.summary_of_import",
                    "{summary}; `simrob check {source}` tells all",
                    summary=report.summary(),
                    source=source,
                ),
            )
        )
    return findings


def _loss_text(group: WordGroup) -> str:
    """Describe losses with the same text: the first element with the text, then the other elements."""
    first, *others = group.places
    text = (
        compound("{first}: {text}", first=first, text=group.text) if first else group.text
    )  # a loss of the whole robot names no element
    if others:
        text += message("stations.likewise", "; likewise {others}", others=listed(others))
    return text


def _losses(robot: ResolvedRobot, lost: list[Entry]) -> Iterator[Entry]:
    """Select the losses of an import that the station does not compensate.

    Two kinds of losses are compensated, and so left out. Friction of a joint is lost in the URDF, but the section
    ``drives`` of the robot or of the station may give the axis friction again. Mimic joints were reported as lost by
    older imports; stations now couple such an axis to its leader.

    Args:
        robot: the imported robot.
        lost: entries of the import's report about losses.

    Yields:
        the losses that remain.
    """
    axis_of_element: dict[str, str] = {
        message("stations.joint_called", "joint '{joint}'", joint=axis.joint): name
        for name, axis in robot.model.axes.items()
    }
    has_friction = dict(zip(robot.axes, robot.model.friction > 0, strict=True))
    for loss in lost:
        element = loss.element.removesuffix(" <dynamics>")
        axis = axis_of_element.get(element)
        if axis is not None:
            if loss.text.startswith("friction ") and has_friction[axis]:
                continue
            if loss.text.startswith("mimics ") and axis in robot.model.followers:
                continue
        yield loss


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
        "{follower} follows {leader} in the robot's file, but solver {scheme} holds no coupling: each moves by its ",
        follower=follower,
        leader=leader,
        scheme=scheme,
    )
    text += message("stations.own_motor", "own motor; take solver.kind discrete, or scheme radau3 or cenic")
    return Finding("warning", message("stations.mimic_of", "mimic of {follower}", follower=follower), text)
