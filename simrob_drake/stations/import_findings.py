"""Mechanics of a robot's file that a station does not have: what its import lost, and mimics that no solver holds."""

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
    """Look at what the import of a robot did to its mechanics.

    Args:
        config: of the station.
        robot: of the station, imported or not.
        source: file that the user knows the robot by; that of the station's section unless given.

    Returns:
        a warning for each loss of mechanics, losses of the same words in one, and a note that sums up the import.
    """
    findings = [_unheld(config, axis, leader) for axis, leader in unheld_mimics(config, robot.name, robot.model)]
    report = read_report(robot.model.folder)
    if report is None:
        return findings
    source = source or config.robots[robot.name].urdf or report.source
    subject = f"import of {source.name}"
    losses = _losses(robot, report.of("lost"))
    for (first, *others), text in group_by_words((entry.element, entry.text) for entry in losses):
        told = f"{first}: {text}" if first else text
        told += f"; likewise {listed(others)}" if others else ""
        findings.append(Finding("warning", subject, f"lost in the {subject}: {told}"))
    if config.robots[robot.name].urdf is not None:
        findings.append(Finding("note", subject, f"{report.summary()}; `simrob check {source}` tells all"))
    return findings


def _losses(robot: ResolvedRobot, lost: list[Entry]) -> Iterator[Entry]:
    """Yield the losses of an import that the station does not make good.

    Friction that drives of the robot or the station bring back is none, nor is a mimic of an import of before, which
    stations couple by now.
    """
    axis_of = {f"joint '{axis.joint}'": name for name, axis in robot.model.axes.items()}
    rubs = dict(zip(robot.axes, robot.model.friction > 0, strict=True))
    for entry in lost:
        axis = axis_of.get(entry.element.removesuffix(" <dynamics>"), "")
        is_back = entry.text.startswith("friction ") and rubs.get(axis, False)
        is_coupled = entry.text.startswith("mimics ") and axis in robot.model.followers
        if not (is_back or is_coupled):
            yield entry


def _unheld(config: StationConfig, axis: str, leader: str) -> Finding:
    """The warning for an axis that the solver does not tie to its leader."""
    scheme = config.solver.scheme
    text = f"{axis} follows {leader} in the robot's file, but solver {scheme} holds no coupling: each moves by its "
    text += "own motor; take solver.kind discrete, or scheme radau3 or cenic"
    return Finding("warning", f"mimic of {axis}", text)
