"""Warnings about mechanics of a robot's file that are lost in its import, or that the station's solver cannot hold."""

from collections.abc import Iterator
from pathlib import Path

from simrob_drake.errors import listed
from simrob_drake.importer.options import Entry, read_report
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.coupled import unheld_mimics
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.grouping import group_by_words


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
    findings = [
        _unheld_mimic_finding(config, axis, leader) for axis, leader in unheld_mimics(config, robot.name, robot.model)
    ]
    report = read_report(robot.model.folder)
    if report is None:
        return findings
    source = source or config.robots[robot.name].urdf or report.source
    subject = f"import of {source.name}"
    losses = _losses(robot, report.of("lost"))
    for (first, *others), text in group_by_words((entry.element, entry.text) for entry in losses):
        # A loss of the whole robot names no element.
        detail = f"{first}: {text}" if first else text
        detail += f"; likewise {listed(others)}" if others else ""
        findings.append(Finding("warning", subject, f"lost in the {subject}: {detail}"))
    # The note is only for a station that imports the file itself.
    if config.robots[robot.name].urdf is not None:
        findings.append(Finding("note", subject, f"{report.summary()}; `simrob check {source}` tells all"))
    return findings


def _losses(robot: ResolvedRobot, lost: list[Entry]) -> Iterator[Entry]:
    """Select the losses of an import that the station does not compensate.

    Two kinds of entries are left out: friction of a joint whose drive, in the robot's file or the station, has friction
    again; and mimic joints, which older imports reported as lost and which stations now couple.

    Args:
        robot: the imported robot.
        lost: losses by the report of the import.
    """
    axis_of = {f"joint '{axis.joint}'": name for name, axis in robot.model.axes.items()}
    has_friction = dict(zip(robot.axes, robot.model.friction > 0, strict=True))
    for entry in lost:
        # An element that is no joint of an axis has the axis "", which neither friction nor followers contain.
        axis = axis_of.get(entry.element.removesuffix(" <dynamics>"), "")
        is_friction_restored = entry.text.startswith("friction ") and has_friction.get(axis, False)
        is_coupled = entry.text.startswith("mimics ") and axis in robot.model.followers
        if not (is_friction_restored or is_coupled):
            yield entry


def _unheld_mimic_finding(config: StationConfig, axis: str, leader: str) -> Finding:
    """Make the warning for a mimic joint that the station's solver does not hold: an axis and its leader."""
    scheme = config.solver.scheme
    text = f"{axis} follows {leader} in the robot's file, but solver {scheme} holds no coupling: each moves by its "
    text += "own motor; take solver.kind discrete, or scheme radau3 or cenic"
    return Finding("warning", f"mimic of {axis}", text)
