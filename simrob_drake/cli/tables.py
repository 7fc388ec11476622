"""Tables of the command line: of results, findings, robots and imports.

Cells are messages, which :func:`simrob_drake.cli.screen.table` translates into the language of the output.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rich.table import Table
from rich.text import Text

from simrob_drake.base.errors import list_names
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

# Headings that extensions use in their tables, too.
LARGEST_DIFFERENCE = message("cli.largest_difference", "largest difference")
AT_TIME = message("cli.at_time", "at [s]")

_EASY_SHARE = 0.6
"""Largest torque of an axis, as a share of its limit, with which the axis can share a row with others [1]."""

_MOST_EASY_AXES = 7
"""A station with more easy axes than this has one row for them. An arm on a linear axis has seven."""

_COLOURS: dict[EntryKind, str] = {
    "read": "dim",
    "repaired": "green",
    "approximated": "green",
    "defaulted": "yellow",
    "dropped": "magenta",
    "open": "yellow",
    "lost": "red",
    "refused": "red",
}
"""Colours for the kinds of entries in the report of an import, by what the import did with a part of the file."""

_LISTED_ELEMENTS = 4
"""Largest count of names in one cell of the report of an import. A further one is only counted."""


def _severity_word(severity: Severity) -> Text:
    """Word for a severity, in its colour."""
    return Text(translate(SEVERITY_WORDS[severity]), SEVERITY_STYLES[severity])


def criteria_table(verdict: Verdict) -> Table:
    """Make the table of criteria: severity, criterion, value, bound, and the part with the worst value."""
    rows = [
        (_severity_word(row.severity), row.criterion, row.value, row.bound, row.worst)
        for row in verdict.table
    ]
    criteria = table(verdict.headings, *rows, numbers=False)
    # Only the columns of the value and of the bound are numbers.
    for column in (2, 3):
        criteria.columns[column].justify = "right"
    return criteria


def cells_table(result: SimulationResult) -> Table:
    """Make the table of the times [s], since the start of each sequencer, at which the robots reached its cells.

    A *sequencer* is a controller that leads a robot from one posture (a *cell*) to the next. A cell that was not
    reached has a dash in place of its time.
    """
    rows = []
    for controller, times in result.cells.items():
        for index, time in enumerate(times):
            # A run may end before the last cell.
            reached = "–" if time is None else compound("{time:.2f}", time=time)
            rows.append((controller, str(index), reached))
    headings = (
        message("cli.controller", "controller"),
        message("cli.cell", "cell"),
        message("cli.reached", "reached [s]"),
    )
    return table(headings, *rows)


def convergence_table(result: SimulationResult, tight: SimulationResult) -> Table:
    """Make the table of the largest differences between a run and a tighter one, over their common time.

    It lists for each joint the largest difference of the position, and the difference of the torque at the end; and for
    each free base and piece the largest differences of position and orientation.
    """
    rows = [*_rows_of_joints(result, tight), *_rows_of_bodies(result, tight)]
    headings = (
        message("cli.joint", "joint"),
        LARGEST_DIFFERENCE,
        AT_TIME,
        message("cli.difference_of_torque", "torque at end"),
        message("cli.unit", "unit"),
    )
    title = message(
        "cli.against_tighter_run", "Difference to a run with ten times tighter accuracy"
    )
    return table(headings, *rows, title=title)


def _rows_of_joints(result: SimulationResult, tight: SimulationResult) -> list[tuple[str, ...]]:
    """Rows of the table of differences for the joints.

    The cells are the joint's name, the largest difference of its position, the time of that, the difference of its
    torque at the end of the runs' common time, and the unit of the torque.
    """
    # One of the runs may have ended early. Both are recorded at the same times, so samples are compared by index.
    sample_count = min(len(result.times), len(tight.times))
    last = sample_count - 1
    rows = list[tuple[str, ...]]()
    for robot in result.plant.robots.values():
        for axis, unit in zip(robot.axes, robot.model.units, strict=True):
            # Signals of a robot have its prefix, which is empty if the station has only one robot.
            position = f"{robot.prefix}q.{axis}"
            differences = np.abs(result[position][:sample_count] - tight[position][:sample_count])
            worst = int(np.argmax(differences))
            torque = f"{robot.prefix}tau.{axis}"
            torque_difference = abs(result[torque][last] - tight[torque][last])
            row = (
                f"{robot.prefix}{axis}",
                in_units(differences[worst], unit.si),
                compound("{time:.2f}", time=result.times[worst]),
                compound("{value:.2e}", value=torque_difference),
                unit.effort,
            )
            rows.append(row)
    return rows


def _rows_of_bodies(result: SimulationResult, tight: SimulationResult) -> list[tuple[str, ...]]:
    """Rows of the table of differences for bodies that move freely: bases of robots, and free pieces.

    A body has no torque and no single unit, so these cells are a dash and empty.
    """
    sample_count = min(len(result.times), len(tight.times))
    rows = list[tuple[str, ...]]()
    for body in [*_base_poses(result, tight), *_piece_poses(result, tight)]:
        for difference in _pose_differences(
            body.poses[:sample_count], body.tight_poses[:sample_count]
        ):
            worst = int(np.argmax(difference.values))
            row = (
                message(
                    "cli.quantity_of",
                    "{quantity} of {name}",
                    quantity=difference.quantity,
                    name=body.name,
                ),
                compound(
                    "{value:.2e} {unit}", value=difference.values[worst], unit=difference.unit
                ),
                compound("{time:.2f}", time=result.times[worst]),
                "–",
                "",
            )
            rows.append(row)
    return rows


class _BodyPoses(NamedTuple):
    """Poses of a body in a run and in the tighter run, each x y z qw qx qy qz, shape (m, 7).

    The runs may have different counts m of samples.

    Attributes:
        name: name of the body for users.
        poses: poses in the run.
        tight_poses: poses in the tighter run.
    """

    name: str
    poses: Vector
    tight_poses: Vector


def _base_poses(result: SimulationResult, tight: SimulationResult) -> list[_BodyPoses]:
    """Poses of the bases of all robots whose base moves freely."""
    bodies = list[_BodyPoses]()
    for robot in result.plant.robots.values():
        if robot.model.base == "floating":
            name = f"{robot.prefix}base"
            bodies.append(
                _BodyPoses(name, result.pose("base", robot.name), tight.pose("base", robot.name))
            )
    return bodies


def _piece_poses(result: SimulationResult, tight: SimulationResult) -> list[_BodyPoses]:
    """Poses of all pieces that move freely."""
    pieces = result.config.free_pieces
    return [
        _BodyPoses(piece, result.piece_pose(piece), tight.piece_pose(piece)) for piece in pieces
    ]


class _Difference(NamedTuple):
    """Differences of one quantity of poses.

    Attributes:
        quantity: name of the quantity.
        values: the differences, shape (m,).
        unit: their unit.
    """

    quantity: str
    values: Vector
    unit: str


def _pose_differences(poses: Vector, others: Vector) -> list[_Difference]:
    """Compute the distance [mm] and the angle [deg] between poses x y z qw qx qy qz, shape (m, 7), sample by sample."""
    # From m to mm.
    distances = 1e3 * np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    # Unit quaternions p and q of orientations that differ by the angle a have the distance |p - q| = 2 sin(a / 4), so
    # a = 4 asin(|p - q| / 2). The quaternions q and -q are the same orientation: the smaller distance counts.
    quaternions = poses[:, 3:]
    other_quaternions = others[:, 3:]
    distances_to_same = np.linalg.norm(quaternions - other_quaternions, axis=1)
    distances_to_negative = np.linalg.norm(quaternions + other_quaternions, axis=1)
    chords = np.minimum(distances_to_same, distances_to_negative)
    angles = np.rad2deg(4 * np.arcsin(chords / 2))
    return [
        _Difference(message("cli.position", "position"), distances, "mm"),
        _Difference(message("cli.orientation", "orientation"), angles, "deg"),
    ]


def in_units(value: float, unit: str) -> str:
    """Write a value with its unit, for a table. An angle is also written in degrees.

    Args:
        value: the value.
        unit: its unit: "1" for a value without a unit, "rad", "m" or another one.
    """
    # A share, or an entry of a quaternion.
    if unit == "1":
        return compound("{value:.2e}", value=value)
    if unit == "rad":
        return compound(
            "{value:.2e} rad = {degrees:.2e} deg", value=value, degrees=float(np.rad2deg(value))
        )
    return compound("{value:.2e} {unit}", value=value, unit=unit)


def findings_table(findings: Sequence[Finding], *, show_all: bool = False) -> Table:
    """Make the table of the findings of a check, with one row for each.

    Args:
        findings: the findings.
        show_all: whether each axis has its row. Otherwise one row stands for the axes that `fold_axes` folds.
    """
    shown = findings if show_all else fold_axes(findings)
    rows = [(_severity_word(finding.severity), finding.subject, finding.text) for finding in shown]
    headings = ("", message("cli.subject", "subject"), message("cli.finding", "finding"))
    return table(headings, *rows, numbers=False)


def fold_axes(findings: Sequence[Finding]) -> list[Finding]:
    """Replace the findings about axes with easy torques by one finding, if a station has many of these axes.

    An axis is easy if its finding is no warning and its torque is at most `_EASY_SHARE` of its limit. The easy axis
    with the largest share keeps its finding, so that the user sees how much the robot is loaded.
    """
    easy = [
        finding
        for finding in findings
        if finding.level != "warning"
        and finding.torque_share is not None
        and finding.torque_share <= _EASY_SHARE
    ]
    # Few rows are easy to read as they are.
    if len(easy) <= _MOST_EASY_AXES:
        return list(findings)
    most_loaded = max(easy, key=_torque_share)
    folded = [finding for finding in easy if finding is not most_loaded]
    summary = Finding(
        "ok" if all(finding.level == "ok" for finding in folded) else "note",
        message("cli.more_axes", "{count} more axes", count=len(folded)),
        message(
            "cli.within_share_of_torque",
            "each needs at most {largest:.0%} of its torque limit; {option} lists each",
            largest=max(map(_torque_share, folded)),
            option="--all",
        ),
    )
    # The summary takes the position of the last of the axes that it replaces.
    last = folded[-1]
    shown = [summary if finding is last else finding for finding in findings]
    return [finding for finding in shown if all(finding is not other for other in folded)]


def _torque_share(finding: Finding) -> float:
    """Share of the torque limit that a finding reports, or 0 if the finding is not about an axis."""
    return finding.torque_share or 0.0


def robot_table(robot: RobotModel) -> Table:
    """Make the table of the axes of a robot, with their limits of position and effort."""
    # Limits are in SI units, and the table in the units for users: deg instead of rad.
    lower_limits, upper_limits = robot.axis_limits
    # Numbers stay fields of messages, so that a language writes its own decimal sign.
    lower = [compound("{end:.5g}", end=end) for end in lower_limits / robot.user_units]
    upper = [compound("{end:.5g}", end=end) for end in upper_limits / robot.user_units]
    # A passive axis has no motor.
    efforts = [
        compound("{effort:g}", effort=effort) if effort > 0 else "–" for effort in robot.efforts
    ]
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
    """Sentences about the mass that an arm can hold at its first tool: at home, and in its weakest posture.

    A posture in which no motor limits the mass has no sentence.

    Args:
        robot: an arm, with at least one tool. All moving links have a mass.
    """
    dynamics = Dynamics.of_robot(robot)
    lines = list[str]()
    postures = (
        (message("cli.at_home", "at home"), robot.home),
        (message("cli.in_weakest_posture", "in its weakest posture"), dynamics.weakest_posture()),
    )
    for where, posture in postures:
        # Largest mass that the motor of each axis can hold [kg]. The weakest motor limits the payload.
        masses = dynamics.payload(posture)
        axis = int(np.argmin(masses))
        mass = float(masses[axis])
        # No motor carries the load, as in a robot that moves in a level plane.
        if not np.isfinite(mass):
            continue
        # Adding 0.0 turns -0.0 into 0.0.
        positions = (posture / robot.user_units).round(3) + 0.0
        line = message(
            "cli.payload",
            "payload at {tool} {where} ({posture}): {mass:.3g} kg, limited by the motor of {axis}",
            tool=next(iter(robot.tools)),
            where=where,
            posture=join_texts([compound("{value:.3g}", value=value) for value in positions], " "),
            mass=mass,
            axis=list(robot.axes)[axis],
        )
        # An implausible payload is a sign of masses, lengths or efforts in other units, which no other check finds.
        doubt = payload_doubt(mass, moving_mass(robot.element))
        lines.append(compound("{line}; {doubt}", line=line, doubt=doubt) if doubt else line)
    return lines


def report_table(report: ImportReport) -> Table:
    """Make the table of the entries of an import, in the order of their kinds.

    Entries of the same kind with the same text, such as a missing inertia of many links, share a row.
    """
    rows = []
    # The order of the kinds goes from what was read to what was refused, so the worst entries are next to the prompt.
    for kind in ENTRY_KINDS:
        change = Text(translate(CHANGE[kind]), _COLOURS[kind])
        # Names of the elements that a row lists, by the text of the row.
        elements_by_text = dict[str, list[str]]()
        for entry in report.entries:
            if entry.kind == kind:
                elements_by_text.setdefault(entry.text, []).append(entry.element)
        for text, elements in elements_by_text.items():
            rows.append((change, list_names(elements, _LISTED_ELEMENTS), text))
    headings = (
        "",
        message("cli.element", "element"),
        message("cli.what_was_done", "what was done"),
    )
    return table(headings, *rows, numbers=False)
