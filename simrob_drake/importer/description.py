"""The draft of the ``robot.yaml`` of an imported robot: its axes, home posture, fingers and servo gains."""

from typing import Any

import numpy as np
import yaml

from simrob_drake.base.constants import LARGEST_GAIN
from simrob_drake.base.errors import list_names
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.messages import message
from simrob_drake.importer.gains import first_gains
from simrob_drake.importer.semantics import HOME_STATE, NOTHING, Semantics, described_by
from simrob_drake.importer.trees import HOME, KD, KP, Notes
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import ImportReport

_HEADER = """\
# Draft of an import. You can edit this file.
# axes: the joints, in the order of every vector. Rename an axis as in `elbow: {joint: joint_3, sign: -1}`.
# gripper: closed and open position of each finger [deg, or m if the finger slides].
# tools: frames of the URDF that moves can position. Pieces are attached to the first one.
"""


def draft(
    robot: RobotModel, notes: Notes, report: ImportReport, semantics: Semantics = NOTHING
) -> str:
    """Write the text of a ``robot.yaml`` for an imported robot.

    Args:
        robot: the robot of the imported URDF.
        notes: home posture and servo gains that the source contains, by joint.
        report: report of the import, which gets an entry for each value that the import has chosen.
        semantics: content of the robot's SRDF.
    """
    # The order is that of the file: first what a reader looks for, at last the long lists of gains.
    content: dict[str, Any] = {
        "name": robot.name,
        "description": f"{robot.name}, imported",
        "source": report.source.name,
        "urdf": robot.urdf,
        "base": robot.base,
        "root": robot.root,
        "axes": list(robot.axes),
        "tools": robot.tools,
    }
    home = _draft_home(robot, notes, report, semantics)
    if home:
        content["home_deg"] = home
    if robot.gripper is not None:
        # Without the fields that have no value, so that the file shows only what was found.
        content["gripper"] = robot.gripper.model_dump(mode="json", exclude_none=True)
        _report_fingers(list(robot.gripper.axes), report)
    if robot.loops:
        content["loops"] = {name: dict(entry) for name, entry in robot.loops.items()}
    # An SRDF states postures, tools and open fingers. It replaces what the import has guessed from the URDF.
    content |= described_by(semantics, robot, report)
    # Gains follow from masses. A robot with links that lack them can only move kinematically, without servos.
    if not robot.links_without_inertia:
        content["servo"] = _draft_gains(robot, notes, report)
    # Lists and short mappings stand on one line each, as a person would write them.
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
    )
    return _HEADER + text


def _draft_home(
    robot: RobotModel, notes: Notes, report: ImportReport, semantics: Semantics
) -> dict[str, float]:
    """Home posture of an imported robot, in the user's units, by axis.

    It is empty if all axes are at 0. It is also empty if only the SRDF has a home posture, which is added later.

    Args:
        robot: the robot of the imported URDF.
        notes: home posture that the source contains, by joint [rad or m].
        report: gets an entry if the import has chosen a position because 0 is outside of an axis' limits.
        semantics: content of the robot's SRDF, which may have a home posture of its own.
    """
    units = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
    home = {}
    for axis, value in notes.get(HOME, {}).items():
        if value:
            # Six digits: the conversion of an exact angle to radians and back leaves 89.99999999999999 for 90.
            home[axis] = float(f"{value / units[axis]:.6g}")
    if home:
        return home
    # Nothing is reported if the SRDF has a home posture, as that posture replaces this one.
    if not isinstance(robot.home_deg, dict) or HOME_STATE in semantics.states:
        return {}
    fingers = robot.gripper.axes if robot.gripper is not None else {}
    # Fingers are open in the home posture, which is reported with them. The other axes cannot be at 0.
    at_middle = [axis for axis in robot.home_deg if axis not in fingers]
    if at_middle:
        report.add(
            "defaulted",
            ROBOT_FILE,
            message(
                "importer.start_midway",
                "the limits of {axes} exclude zero, so the home posture is in the middle of the range",
                axes=", ".join(at_middle),
            ),
        )
    return dict(robot.home_deg)


def _report_fingers(fingers: list[str], report: ImportReport) -> None:
    """Report the axes that were found to be fingers: a single moving jaw, or several fingers."""
    names = ", ".join(fingers)
    if len(fingers) == 1:
        text = message(
            "importer.is_moving_jaw",
            "{names} is the moving jaw of a hand. It is closed where it is nearest to the fixed jaw, "
            "and open in the home posture",
            names=names,
        )
    else:
        text = message(
            "importer.are_fingers",
            "{names} are fingers. They are closed where they are nearest to each other, and open in "
            "the home posture",
            names=names,
        )
    report.add("read", ROBOT_FILE, text)


def _draft_gains(
    robot: RobotModel, notes: Notes, report: ImportReport
) -> dict[str, dict[str, float]]:
    """Servo gains of an imported robot: ``kp`` and ``kd``, each by axis.

    Gains of the source's actuators are taken over. Where the source has no kp, or no kd, of an axis, the axis gets this
    gain of its first gains.

    Args:
        robot: the robot of the imported URDF. Each of its moving links has an inertia.
        notes: gains that the source contains, by joint.
        report: gets entries about the origin of the gains.
    """
    # First gains for all axes: the report needs them, and a file may have actuators at some joints only.
    first = first_gains(robot)
    first_kp = dict(zip(robot.axes, first.kp.tolist(), strict=True))
    first_kd = dict(zip(robot.axes, first.kd.tolist(), strict=True))
    source_kp = notes.get(KP, {})
    source_kd = notes.get(KD, {})
    if source_kp:
        report.add(
            "read",
            ROBOT_FILE,
            message(
                "importer.gains_of_actuators",
                "servo gains of {count} {count:axis|axes} are those of the file's actuators",
                count=len(source_kp),
            ),
        )
    # Passive axes have no servo, so they need no gains.
    if len(source_kp) < np.count_nonzero(~robot.passive):
        report.add(
            "defaulted",
            ROBOT_FILE,
            message("importer.gains_of_mass_matrix", "servo gains from the mass matrix"),
        )
    _report_stiff_joints(first_kp, report)
    # Gains of the file win, as its author has tuned them.
    return {"kp": first_kp | dict(source_kp), "kd": first_kd | dict(source_kd)}


def _report_stiff_joints(kp: dict[str, float], report: ImportReport) -> None:
    """Report the axes whose joints are so heavily damped that no servo moves them.

    Args:
        kp: proportional gain that the import has chosen for each axis, by name. It grows with the damping of the joint,
            up to LARGEST_GAIN.
        report: report of the import.
    """
    # A gain at the limit means that the damping would demand a larger one, see `first_gains`.
    stiff_axes = [axis for axis, gain in kp.items() if gain >= LARGEST_GAIN]
    if stiff_axes:
        report.add(
            "approximated",
            ROBOT_FILE,
            message(
                "importer.no_servo_moves",
                "no servo can move {axes}: the damping of the joint is too large. If the joint is not "
                "to move, make it fixed",
                axes=list_names(stiff_axes),
            ),
        )
