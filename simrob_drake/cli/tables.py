"""What the command line shows: results, findings and robots as tables."""

import numpy as np
from rich.table import Table
from rich.text import Text

from simrob_drake.base.errors import listed
from simrob_drake.base.frames import Vector
from simrob_drake.base.remarks import SEVERITY_WORDS, Severity
from simrob_drake.cli.language import translate
from simrob_drake.cli.screen import SEVERITY_STYLES, table
from simrob_drake.dynamics import Dynamics
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.verdict.verdict import Verdict
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import ENTRY_KINDS, EntryKind, ImportReport
from simrob_drake.robots.plausibility import moving_mass, payload_doubt
from simrob_drake.stations.findings import Finding

_COLOURS: dict[EntryKind, str] = {
    "read": "dim", "repaired": "green", "approximated": "green", "defaulted": "yellow", "dropped": "magenta",
    "open": "yellow", "lost": "red", "refused": "red",
}  # fmt: skip


def _mark(severity: Severity) -> Text:
    """Word for a severity, in its colour."""
    return Text(translate(SEVERITY_WORDS[severity]), SEVERITY_STYLES[severity])


def criteria_table(verdict: Verdict) -> Table:
    """Make the table of criteria: severity, criterion, value, bound, and the part with the worst value."""
    rows = [(_mark(row.severity), row.criterion, row.value, row.bound, row.worst) for row in verdict.table]
    criteria = table(verdict.headings, *rows, numbers=False)
    for column in (2, 3):  # value and bound
        criteria.columns[column].justify = "right"
    return criteria


def cells_table(result: SimulationResult) -> Table:
    """Return when the robots reached the cells of their sequencers."""
    rows = [
        (name, str(number), "–" if time is None else f"{time:.2f}")
        for name, times in result.cells.items()
        for number, time in enumerate(times)
    ]
    return table(("controller", "cell", "reached [s]"), *rows)


def convergence_table(result: SimulationResult, tight: SimulationResult) -> Table:
    """Return the largest differences between a run and a tighter one over their common time.

    They are those of every joint, and in place and attitude those of every base and piece that is free.
    """
    common = min(len(result.times), len(tight.times))
    rows = list[tuple[str, ...]]()
    for robot in result.plant.robots.values():
        for axis, unit in zip(robot.axes, robot.model.units, strict=True):
            column = f"{robot.prefix}q.{axis}"
            difference = np.abs(result[column][:common] - tight[column][:common])
            worst = int(np.argmax(difference))
            torque = f"{robot.prefix}tau.{axis}"
            end = abs(result[torque][common - 1] - tight[torque][common - 1])
            moved = in_units(difference[worst], unit.si), f"{result.times[worst]:.2f}"
            rows.append((f"{robot.prefix}{axis}", *moved, f"{end:.2e}", unit.effort))
    free = {
        f"{robot.prefix}base": robot.name for robot in result.plant.robots.values() if robot.model.base == "floating"
    }
    poses = {name: (result.pose("base", robot), tight.pose("base", robot)) for name, robot in free.items()}
    poses |= {piece: (result.piece_pose(piece), tight.piece_pose(piece)) for piece in result.config.free_pieces}
    for name, (loose, exact) in poses.items():
        for what, apart, of in _pose_differences(loose[:common], exact[:common]):
            worst = int(np.argmax(apart))
            rows.append((f"{what} of {name}", f"{apart[worst]:.2e} {of}", f"{result.times[worst]:.2f}", "–", ""))
    headings = ("joint", "largest difference", "at [s]", "in torque at the end", "unit")
    return table(headings, *rows, title="against a run ten times tighter")


def _pose_differences(poses: Vector, others: Vector) -> list[tuple[str, Vector, str]]:
    """Return by how much poses x y z qw qx qy qz, shape (m, 7), differ: in place [mm] and attitude [deg], (m,) each."""
    ways = 1e3 * np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    chords = [np.linalg.norm(poses[:, 3:] - sign * others[:, 3:], axis=1) for sign in (1, -1)]  # q and -q are the same
    angles = np.rad2deg(4 * np.arcsin(np.minimum(*chords) / 2))
    return [("place", ways, "mm"), ("attitude", angles, "deg")]


def in_units(value: float, unit: str) -> str:
    """Return a figure with its unit, an angle in degrees, too."""
    return f"{value:.2e} {unit}" + (f" = {np.rad2deg(value):.2e} deg" if unit == "rad" else "")


def findings_table(findings: list[Finding]) -> Table:
    """Return the findings of a check, a row each."""
    rows = [(_mark(finding.severity), Text(finding.subject), Text(finding.text)) for finding in findings]
    return table(("", "subject", "finding"), *rows, numbers=False)


def robot_table(robot: RobotModel) -> Table:
    """Return the axes of a robot with their limits."""
    lower, upper = ([f"{end:.5g}" for end in limit / robot.user_units] for limit in robot.axis_limits)
    efforts = [f"{effort:g}" if effort > 0 else "–" for effort in robot.efforts]  # a passive axis has no motor
    rows = zip(robot.axes, lower, upper, robot.unit_names, efforts, robot.effort_units, strict=True)
    title = f"{robot.name}: {len(robot.axes)} axes, {robot.base} base"
    return table(("axis", "lower", "upper", "unit", "effort", "unit"), *rows, title=title)


def payload_lines(robot: RobotModel) -> list[str]:
    """Return in words what an arm can hold at its first tool, at home and where it can least."""
    dynamics, lines = Dynamics.of_robot(robot), []
    for where, posture in (("at home", robot.home), ("in its weakest posture", dynamics.weakest_posture())):
        masses = dynamics.payload(posture)
        axis = int(np.argmin(masses))
        if np.isfinite(masses[axis]):
            shown = " ".join(f"{value:.3g}" for value in (posture / robot.user_units).round(3) + 0.0)
            least = f"{masses[axis]:.3g} kg, by the motor of {list(robot.axes)[axis]}"
            doubt = payload_doubt(float(masses[axis]), moving_mass(robot.element))
            line = f"payload at {next(iter(robot.tools))} {where} ({shown}): {least}"
            lines.append(f"{line}; {doubt}" if doubt else line)
    return lines


def report_table(report: ImportReport) -> Table:
    """Return what an import did, a row for each deed; elements to which the same was done share a row."""
    elements: dict[tuple[EntryKind, str], list[str]] = {}
    for entry in report.entries:
        elements.setdefault((entry.kind, entry.text), []).append(entry.element)
    rows = [
        (Text(kind, _COLOURS[kind]), Text(listed(names, 4)), Text(text))
        for (kind, text), names in sorted(elements.items(), key=lambda one: ENTRY_KINDS.index(one[0][0]))
    ]
    return table(("", "element", "what was done"), *rows, numbers=False)
