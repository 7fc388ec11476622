"""What the command line shows: results, findings and robots as tables."""

import numpy as np
from rich.table import Table
from rich.text import Text

from simrob_drake.base.errors import listed
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message, translate
from simrob_drake.base.remarks import SEVERITY_WORDS, Severity
from simrob_drake.cli.screen import SEVERITY_STYLES, table
from simrob_drake.dynamics import Dynamics
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.verdict.verdict import Verdict
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import CHANGE, ENTRY_KINDS, EntryKind, ImportReport
from simrob_drake.robots.plausibility import moving_mass, payload_doubt
from simrob_drake.stations.findings import Finding

LARGEST_DIFFERENCE = message("cli.largest_difference", "largest difference")
AT_TIME = message("cli.at_time", "at [s]")


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
    """Make the table of the times at which the robots reached the cells of their sequencers."""
    rows = [
        (name, str(number), "–" if time is None else compound("{time:.2f}", time=time))
        for name, times in result.cells.items()
        for number, time in enumerate(times)
    ]
    return table(
        (
            message("cli.controller", "controller"),
            message("cli.cell", "cell"),
            message("cli.reached", "reached [s]"),
        ),
        *rows,
    )


def convergence_table(result: SimulationResult, tight: SimulationResult) -> Table:
    """Make the table of the largest differences between a run and a tighter one, over their common time.

    It lists the position and the torque at the end of each joint, and the position and orientation of each free base
    and piece.
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
            largest = in_units(difference[worst], unit.si)
            time = compound("{time:.2f}", time=result.times[worst])
            torque_difference = compound("{value:.2e}", value=end)
            rows.append((f"{robot.prefix}{axis}", largest, time, torque_difference, unit.effort))
    free = {
        f"{robot.prefix}base": robot.name for robot in result.plant.robots.values() if robot.model.base == "floating"
    }
    poses = {name: (result.pose("base", robot), tight.pose("base", robot)) for name, robot in free.items()}
    poses |= {piece: (result.piece_pose(piece), tight.piece_pose(piece)) for piece in result.config.free_pieces}
    for name, (loose, exact) in poses.items():
        for quantity, differences, unit_name in _pose_differences(loose[:common], exact[:common]):
            worst = int(np.argmax(differences))
            subject = message("cli.quantity_of", "{quantity} of {name}", quantity=quantity, name=name)
            largest = compound("{value:.2e} {unit}", value=differences[worst], unit=unit_name)
            rows.append((subject, largest, compound("{time:.2f}", time=result.times[worst]), "–", ""))
    headings = (
        message("cli.joint", "joint"),
        LARGEST_DIFFERENCE,
        AT_TIME,
        message("cli.difference_of_torque", "torque at end"),
        message("cli.unit", "unit"),
    )
    title = message("cli.against_tighter_run", "Difference to a run with ten times tighter accuracy")
    return table(headings, *rows, title=title)


def _pose_differences(poses: Vector, others: Vector) -> list[tuple[str, Vector, str]]:
    """Differences of poses x y z qw qx qy qz, shape (m, 7): in position [mm] and in orientation [deg], (m,) each.

    Returns:
        for each of the two quantities its name, the differences and their unit.
    """
    ways = 1e3 * np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    # The quaternions q and -q are the same orientation, so the smaller distance counts.
    chords = [np.linalg.norm(poses[:, 3:] - sign * others[:, 3:], axis=1) for sign in (1, -1)]
    angles = np.rad2deg(4 * np.arcsin(np.minimum(*chords) / 2))
    return [
        (message("cli.position", "position"), ways, "mm"),
        (message("cli.orientation", "orientation"), angles, "deg"),
    ]


def in_units(value: float, unit: str) -> str:
    """Write a value with its unit, for a table; an angle is also written in degrees."""
    if unit == "1":  # a share, or an entry of a quaternion
        return compound("{value:.2e}", value=value)
    if unit == "rad":
        return compound("{value:.2e} rad = {degrees:.2e} deg", value=value, degrees=float(np.rad2deg(value)))
    return compound("{value:.2e} {unit}", value=value, unit=unit)


def findings_table(findings: list[Finding]) -> Table:
    """Make the table of the findings of a check, with one row for each."""
    rows = [(_mark(finding.severity), finding.subject, finding.text) for finding in findings]
    headings = ("", message("cli.subject", "subject"), message("cli.finding", "finding"))
    return table(headings, *rows, numbers=False)


def robot_table(robot: RobotModel) -> Table:
    """Make the table of the axes of a robot, with their limits of position and effort."""
    lower, upper = ([compound("{end:.5g}", end=end) for end in limit / robot.user_units] for limit in robot.axis_limits)
    # A passive axis has no motor.
    efforts = [compound("{effort:g}", effort=effort) if effort > 0 else "–" for effort in robot.efforts]
    rows = zip(robot.axes, lower, upper, robot.unit_names, efforts, robot.effort_units, strict=True)
    base = message("cli.fixed_base", "fixed base")
    if robot.base == "floating":
        base = message("cli.floating_base", "floating base")
    title = message(
        "cli.robot_with_axes",
        "{robot}: {count} {count:axis|axes}, {base}",
        robot=robot.name,
        count=len(robot.axes),
        base=base,
    )
    headings = (
        message("cli.axis", "axis"),
        message("cli.lower", "lower"),
        message("cli.upper", "upper"),
        message("cli.unit", "unit"),
        message("cli.effort", "effort"),
        message("cli.unit", "unit"),
    )
    return table(headings, *rows, title=title)


def payload_lines(robot: RobotModel) -> list[str]:
    """Sentences about the mass that an arm can hold at its first tool: at home, and in its weakest posture."""
    dynamics = Dynamics.of_robot(robot)
    lines = list[str]()
    postures = (
        (message("cli.at_home", "at home"), robot.home),
        (message("cli.in_weakest_posture", "in its weakest posture"), dynamics.weakest_posture()),
    )
    for where, posture in postures:
        masses = dynamics.payload(posture)
        axis = int(np.argmin(masses))
        if not np.isfinite(masses[axis]):  # no motor carries the load, as in a robot that moves in a plane
            continue
        # Adding 0.0 turns -0.0 into 0.0.
        positions = (posture / robot.user_units).round(3) + 0.0
        line = message(
            "cli.payload",
            "payload at {tool} {where} ({posture}): {mass:.3g} kg, limited by the motor of {axis}",
            tool=next(iter(robot.tools)),
            where=where,
            posture=join_texts([compound("{value:.3g}", value=value) for value in positions], " "),
            mass=float(masses[axis]),
            axis=list(robot.axes)[axis],
        )
        doubt = payload_doubt(float(masses[axis]), moving_mass(robot.element))
        lines.append(compound("{line}; {doubt}", line=line, doubt=doubt) if doubt else line)
    return lines


def report_table(report: ImportReport) -> Table:
    """Make the table of the entries of an import; elements to which the same was done share a row."""
    elements: dict[tuple[EntryKind, str], list[str]] = {}
    for entry in report.entries:
        elements.setdefault((entry.kind, entry.text), []).append(entry.element)
    rows = [
        (Text(translate(CHANGE[kind]), _COLOURS[kind]), listed(names, 4), text)
        for (kind, text), names in sorted(elements.items(), key=lambda item: ENTRY_KINDS.index(item[0][0]))
    ]
    headings = ("", message("cli.element", "element"), message("cli.what_was_done", "what was done"))
    return table(headings, *rows, numbers=False)
