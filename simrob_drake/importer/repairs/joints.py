"""Repair the joints of a robot (a URDF) so that Drake can move them: types, axes, friction, limits, and followers.

A follower is a joint that moves with another joint, its leader, as the element ``mimic`` of the format says:
position = multiplier * position of the leader + offset. Every change adds an entry to the report of the import.
"""

import difflib
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import nearest, shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.importer.repairs.base import FLOATING_MARK
from simrob_drake.importer.repairs.structure import drop_lost_frames, number
from simrob_drake.robots.fingers import FOLLOWS, mimic_line
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    ENDLESS,
    MOVABLE_JOINTS,
    child_of,
    format_number,
    joint_limits,
    joints_at,
    link_of,
    movable_joints,
    name_of,
    place,
    pose_of,
)
from simrob_drake.robots.urdf_check import numbers_in

_TYPES = (*MOVABLE_JOINTS, "fixed", "floating", "planar")
"""Types of joints in the URDF format."""

_OF_OTHER_FORMATS = (
    "revolute2",
    "screw",
    "ball",
    "universal",
    "gearbox",
    "spherical",
    "cylindrical",
)
"""Types of joints in SDF and in other formats. They move in other ways than the types with similar names above."""

_ADVICE = {
    "floating": message(
        "importer.only_root_floats",
        "only the root of a robot can float; use joints that motors can drive, or a fixed joint",
    ),
    "planar": message(
        "importer.write_planar",
        "write two prismatic joints and one revolute or continuous joint, or a fixed joint",
    ),
}
"""Advice for the types of joints that no motor can drive."""

_DEFAULT_AXIS = "1 0 0"
"""Axis of a joint whose file gives none, in the URDF format."""

DEFAULT_STROKE = 1.0
"""Range of a prismatic joint without limits, to each side [m]."""

_ROUNDING = 1e-4
"""Limits that differ by less are equal, up to the rounding of their file [rad or m]."""

_NO_DIRECTION = 1e-6
"""A shorter axis vector has no direction."""

_UNIT_LENGTH = 1e-3
"""An axis vector is a unit vector, up to rounding, if its length differs from 1 by less."""

_TYPE_LIKENESS = 0.75
"""Least likeness of a misspelled type to a known one, from 0 to 1, as ``difflib`` measures it."""

_ACCELERATION = f"{DRAKE}acceleration"
"""Attribute of a limit with the largest acceleration [rad/s² or m/s²]. It is an extension of Drake."""

_FIXED_AT = "simrob_fixed_at"
"""Attribute of a joint that was fixed where its equal limits hold it [rad or m], until its followers are repaired."""


def repair_joints(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair a robot's joints in place: types, axes, limits, dynamics and followers.

    Args:
        robot: the ``robot`` element, whose structure is repaired.
        options: options of the import: what becomes of dry friction.
        report: gets an entry for each change.

    Raises:
        InvalidModel: no motor can drive a joint, a repair is not possible, or no joint moves.
    """
    # Types come first, as all later steps depend on them.
    for joint in robot.iterfind("joint"):
        _repair_type(joint, report)
    # A floating joint at the root says that the base floats. Anywhere else it is refused below.
    _replace_floating_joint(robot, report)
    for joint in robot.iterfind("joint"):
        where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
        kind = joint.get("type", "")
        if kind in _ADVICE:
            raise report.refusal(
                where,
                message(
                    "importer.no_motor_can_drive",
                    "has the type {kind}, which no motor can drive; {advice}",
                    kind=kind,
                    advice=_ADVICE[kind],
                ),
            )
        # A fixed joint has no axis and no limits that a simulation reads.
        if kind != "fixed":
            _repair_axis(joint, where, report)
            _repair_limits(joint, where, report)
            _repair_dynamics(joint, where, options, report)
    # Followers come after the limits: a leader whose two limits are equal has become a fixed joint by now.
    _check_followers(robot, report)
    _fix_still_followers(robot, report)
    _report_followers(robot, report)
    # Only followers that still move need wider limits.
    _widen_followers(robot, report)
    # Joints may have been fixed above, so this check comes late.
    if not movable_joints(robot):
        raise report.refusal(
            "",
            message(
                "importer.no_moving_joint",
                "has no joint that moves; a rigid object is a piece of a station (pieces:), not a robot",
            ),
        )
    # The link of a floating joint at the root may have carried frames.
    drop_lost_frames(robot, report)


def _repair_type(joint: ET.Element, report: ImportReport) -> None:
    """Correct a misspelled type of a joint, in place.

    Raises:
        InvalidModel: the type is missing, unknown or belongs to another format.
    """
    where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
    kind = joint.get("type", "")
    if kind in _TYPES:
        return
    plain = kind.strip().lower()
    similar = difflib.get_close_matches(plain, _TYPES, n=1, cutoff=_TYPE_LIKENESS)
    # revolute2 of SDF, for example, has two axes. It is no misspelled revolute.
    if plain in _OF_OTHER_FORMATS or not similar:
        known = ", ".join((*MOVABLE_JOINTS, "fixed"))
        text = (
            message("importer.its_type_is", "has the type '{kind}'", kind=kind)
            if kind
            else message("importer.it_has_no_type", "has no type")
        )
        raise report.refusal(
            where,
            message(
                "importer.types_of_joints",
                "{problem}; the joints of a robot have the types {known}",
                problem=text,
                known=known,
            ),
        )
    # Letters in the wrong case, blanks and typing errors are understood.
    joint.set("type", similar[0])
    report.add(
        "repaired",
        where,
        message(
            "importer.similar_type",
            "has the type '{kind}'; {similar} is used",
            kind=kind,
            similar=similar[0],
        ),
    )


def _replace_floating_joint(robot: ET.Element, report: ImportReport) -> None:
    """Remove a floating joint at an empty root link, in place, so that the link behind it is a root that floats.

    Nothing is done unless that joint is the only one at the root. A mark at the robot's element says that it floats.
    """
    child_links = {link_of(joint, "child") for joint in robot.iterfind("joint")}
    roots = [link for link in robot.iterfind("link") if name_of(link) not in child_links]
    if not roots:
        # The joints form a loop, which a later stage refuses.
        return
    root = roots[0]
    joints = joints_at(robot)[name_of(root)]
    # A root link with an inertia or a shape is more than a name for the world, so it stays.
    is_empty = len(root) == 0
    if len(joints) != 1 or joints[0].get("type") != "floating" or not is_empty:
        return
    joint = joints[0]
    robot.remove(joint)
    robot.remove(root)
    # Without the joint nothing else in the robot shows that its base floats.
    robot.set(FLOATING_MARK, "floating")
    new_root = link_of(joint, "child")
    why = message(
        "importer.floats_below",
        "floats at the empty root '{root}'; both are left out, and '{new_root}' is a floating root",
        root=name_of(root),
        new_root=new_root,
    )
    report.add(
        "repaired", message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)), why
    )


def _check_followers(robot: ET.Element, report: ImportReport) -> None:
    """Check every ``mimic`` and rename it to ``FOLLOWS``, the tag from which stations make a coupling, in place.

    A ``mimic`` without a meaning is removed: at a fixed joint, or with a leader that is missing or follows the joint
    itself. Of joints that follow each other in a loop, only the first one in the file loses its ``mimic``; the others
    follow it then. Joints that follow a fixed joint, or follow with a multiplier of 0, keep theirs here:
    :func:`_fix_still_followers` makes them fixed joints afterwards.
    """
    joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
    followers = {name: joint for name, joint in joints.items() if joint.find("mimic") is not None}
    for name, joint in followers.items():
        where = message("robots.joint_called", "joint '{joint}'", joint=name)
        mimic = child_of(joint, "mimic")
        _repair_mimic(mimic, where, report)
        multiplier, _ = mimic_line(mimic)
        leader = mimic.get("joint", "")
        statement = message("importer.mimics", "mimics '{leader}'", leader=leader)
        # A fixed joint moves as before without its mimic, so this is no loss.
        if joint.get("type") == "fixed":
            joint.remove(mimic)
            report.add(
                "dropped",
                where,
                message(
                    "importer.fixed_joints_move_with_nothing",
                    "{statement}, but is fixed and cannot move",
                    statement=statement,
                ),
            )
        elif multiplier == 0:
            # The joint does not move, whatever its leader is. It need not even exist.
            continue
        elif leader not in joints:
            # The joint will need a motor of its own, which the author did not intend: the entry is a loss.
            joint.remove(mimic)
            problem = message(
                "importer.which_is_no_joint",
                "which is no joint{suggestion}",
                suggestion=nearest(leader, joints),
            )
            report.add(
                "lost",
                where,
                message(
                    "importer.moves_on_its_own",
                    "{statement}, {problem}; the joint moves independently",
                    statement=statement,
                    problem=problem,
                ),
            )
        elif _leads_back(joints, name):
            joint.remove(mimic)
            report.add(
                "lost",
                where,
                message(
                    "importer.leads_back_to_itself",
                    "{statement}, which itself follows this joint; the joint moves independently",
                    statement=statement,
                ),
            )
    # The tag is renamed last: _leads_back looks for the old one.
    for joint in followers.values():
        follows = joint.find("mimic")
        if follows is not None:
            follows.tag = FOLLOWS


def _report_followers(robot: ET.Element, report: ImportReport) -> None:
    """Report each joint that still follows another one: stations couple them."""
    for joint in robot.iterfind("joint"):
        follows = joint.find(FOLLOWS)
        if follows is None:
            continue
        multiplier, offset = mimic_line(follows)
        statement = message(
            "importer.mimics_with_ratio",
            "mimics '{leader}' with a multiplier of {multiplier:g} and an offset of {offset:g}",
            leader=follows.get("joint", ""),
            multiplier=multiplier,
            offset=offset,
        )
        report.add(
            "read",
            message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
            message(
                "importer.stations_couple_them",
                "{statement}; stations couple the two joints",
                statement=statement,
            ),
        )


def _repair_mimic(mimic: ET.Element, where: str, report: ImportReport) -> None:
    """Replace a multiplier and an offset that are no numbers by the format's defaults, in place."""
    for key, default in (("multiplier", "1"), ("offset", "0")):
        text = mimic.get(key)
        # A missing attribute has the format's default, so it needs no repair.
        if text is not None and len(numbers_in(text) or []) != 1:
            # This changes the motion, unlike the repair of a number that can be understood.
            mimic.set(key, default)
            problem = message(
                "importer.no_number_of_mimic",
                "{key}='{text}' of its mimic is not a number; {default} is used, the format's default",
                key=key,
                text=shorten(text),
                default=default,
            )
            report.add("lost", where, problem)


def _leads_back(joints: Mapping[str, ET.Element], name: str) -> bool:
    """Whether the joint that a joint mimics follows that joint itself, directly or through others."""
    visited = set[str]()
    current = name
    # The search ends at a joint that was visited before, which may be in a loop that the first joint is not a part of.
    while current in joints and current not in visited:
        visited.add(current)
        mimic = joints[current].find("mimic")
        if mimic is None:
            return False
        current = mimic.get("joint", "")
    return current == name


def _fix_still_followers(robot: ET.Element, report: ImportReport) -> None:
    """Turn followers of a joint that does not move, and followers with a multiplier of 0, into fixed joints, in place.

    Each is fixed at the position that it has by its leader's position.
    """
    joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
    # A joint that was fixed may lead others, earlier in the file: so search from the beginning after each one.
    follower = _find_still_follower(joints)
    while follower is not None:
        follows = child_of(follower, FOLLOWS)
        multiplier, offset = mimic_line(follows)
        leader = _leader_of(joints, follower)
        # The position of a fixed joint counts as 0, unless this module has fixed the joint at another position.
        position = multiplier * float(leader.get(_FIXED_AT, "0")) + offset
        follower.remove(follows)
        _fix_at(follower, position)
        still_leader = message(
            "importer.follows_still_joint",
            "follows '{leader}', which does not move",
            leader=name_of(leader),
        )
        why = (
            still_leader
            if multiplier
            else message("importer.follows_by_zero", "follows with a multiplier of 0")
        )
        report.add(
            "repaired",
            message("robots.joint_called", "joint '{joint}'", joint=name_of(follower)),
            message(
                "importer.fixed_at", "{why}; fixed at {position:g}", why=why, position=position
            ),
        )
        follower = _find_still_follower(joints)
    for joint in joints.values():
        # The attribute is no part of a URDF.
        joint.attrib.pop(_FIXED_AT, None)


def _find_still_follower(joints: Mapping[str, ET.Element]) -> ET.Element | None:
    """Find the first follower of a joint that does not move, or with a multiplier of 0.

    Returns None if there is no such follower.
    """
    for joint in joints.values():
        follows = joint.find(FOLLOWS)
        if follows is None:
            continue
        multiplier, _ = mimic_line(follows)
        # Other types than these are fixed by now.
        if multiplier == 0 or _leader_of(joints, joint).get("type") not in MOVABLE_JOINTS:
            return joint
    return None


def _leader_of(joints: Mapping[str, ET.Element], follower: ET.Element) -> ET.Element:
    """Joint that a follower follows. It is the follower itself if the leader is missing (with a multiplier of 0)."""
    return joints.get(child_of(follower, FOLLOWS).get("joint", ""), follower)


def _widen_followers(robot: ET.Element, report: ImportReport) -> None:
    """Widen the limits of every follower so that it can go wherever its leader takes it, in place.

    A prismatic follower of a leader without limits keeps its own.
    """
    joints = {
        name_of(joint): joint
        for joint in robot.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
    }
    finished = set[str]()  # names of the followers that are done

    def widen_after_leader(name: str) -> None:
        """Widen the limits of a joint, if it is a follower, after those of its leader, which may follow, too."""
        joint = joints[name]
        follows = joint.find(FOLLOWS)
        if name in finished or follows is None:
            return
        finished.add(name)
        # The leader is in the dictionary of joints that move: followers of other joints were made fixed before.
        leader = joints[follows.get("joint", "")]
        # First the leader, whose limits may get wider, too.
        widen_after_leader(name_of(leader))
        _widen_follower(joint, leader, report)

    for name in joints:
        widen_after_leader(name)


def _widen_follower(joint: ET.Element, leader: ET.Element, report: ImportReport) -> None:
    """Widen the limits of one follower so that it can go wherever its leader takes it, in place.

    If the leader has no limits, a revolute follower becomes continuous, and a prismatic one keeps its own limits.
    """
    multiplier, offset = mimic_line(child_of(joint, FOLLOWS))
    # The follower's position is multiplier * q + offset, which takes its extreme values at the limits of the leader's
    # position q. A negative multiplier exchanges lower and upper.
    ends = [multiplier * limit + offset for limit in joint_limits(leader)]
    own_limits = joint_limits(joint)
    lower = min(*ends, *own_limits)
    upper = max(*ends, *own_limits)
    # Files round numbers such as pi/2. Such a difference needs no entry in the report.
    if np.allclose((lower, upper), own_limits, rtol=0, atol=_ROUNDING):
        return
    where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
    own_range = compound("[{lower:.4g}, {upper:.4g}]", lower=own_limits[0], upper=own_limits[1])
    problem = message(
        "importer.limits_leave_out",
        "its limits {range} do not contain all positions that follow from the limits of '{leader}'",
        range=own_range,
        leader=name_of(leader),
    )
    if np.isfinite((lower, upper)).all():
        limit = child_of(joint, "limit")
        # Twelve digits, so that rounding errors of the product are not written.
        limit.set("lower", f"{lower:.12g}")
        limit.set("upper", f"{upper:.12g}")
        report.add(
            "repaired",
            where,
            message(
                "importer.limits_widened",
                "{problem}; widened to [{lower:.4g}, {upper:.4g}]",
                problem=problem,
                lower=lower,
                upper=upper,
            ),
        )
    # Otherwise the leader has no limits. A prismatic follower keeps its own, since it must have some.
    elif joint.get("type") == "revolute":
        _set_range(joint, None, None)
        joint.set("type", "continuous")
        report.add(
            "repaired",
            where,
            message(
                "importer.continuous_instead",
                "{problem}; the joint becomes continuous",
                problem=problem,
            ),
        )


def _repair_axis(joint: ET.Element, where: str, report: ImportReport) -> None:
    """Make the axis of a joint a unit vector, up to rounding, in place; a missing axis gets the format's default.

    Raises:
        InvalidModel: the axis is zero.
    """
    axis = child_of(joint, "axis")
    # Also if there was no <axis>: the line above has added it.
    if "xyz" not in axis.attrib:
        axis.set("xyz", _DEFAULT_AXIS)
        report.add(
            "defaulted",
            where,
            message(
                "importer.has_no_axis",
                "has no axis; {axis} is used, the format's default",
                axis=_DEFAULT_AXIS,
            ),
        )
        return
    text = axis.attrib["xyz"]
    direction = np.array(text.split(), dtype=float)
    length = float(np.linalg.norm(direction))
    # No default takes the place of a zero vector: its author may have meant a joint that does not move.
    if length < _NO_DIRECTION:
        raise report.refusal(
            compound("{where} <axis>", where=where),
            message(
                "importer.no_direction",
                'xyz="{text}" has no direction; write one, or make the joint fixed',
                text=text,
            ),
        )
    # Drake normalizes the axis anyway. A length that differs by more than rounding may be a mistake of the file, which
    # the user should see.
    if abs(length - 1) > _UNIT_LENGTH:
        axis.set("xyz", " ".join(format_number(value) for value in (direction / length).tolist()))
        report.add(
            "repaired",
            compound("{where} <axis>", where=where),
            message(
                "importer.axis_length",
                'xyz="{text}" has the length {length:.4g}; normalized to "{axis}"',
                text=text,
                length=length,
                axis=axis.get("xyz"),
            ),
        )


def _repair_dynamics(
    joint: ET.Element, where: str, options: ImportOptions, report: ImportReport
) -> None:
    """Repair the damping of a joint, in place, and remove its dry friction, or add it to the damping.

    Args:
        joint: the joint.
        where: name of the joint, for the report.
        options: options of the import, which decide about the friction.
        report: report of the import.
    """
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return
    place_in_file = compound("{where} <dynamics>", where=where)
    for key in ("damping", "friction"):
        value = number(dynamics, key)
        # A negative value would feed energy into the motion.
        if value is not None and value < 0:
            dynamics.set(key, "0")
            report.add(
                "repaired",
                place_in_file,
                message(
                    "importer.negative_value",
                    "{key} {value:g} is negative; set to 0",
                    key=key,
                    value=value,
                ),
            )
    friction = number(dynamics, "friction")
    if friction:
        _remove_friction(joint, dynamics, friction, place_in_file, options, report)


def _remove_friction(
    joint: ET.Element,
    dynamics: ET.Element,
    friction: float,
    where: str,
    options: ImportOptions,
    report: ImportReport,
) -> None:
    """Remove the dry friction of a joint, in place, or add it to the damping if the options request it.

    Args:
        joint: the joint.
        dynamics: its ``<dynamics>``.
        friction: the friction [N·m or N], which is positive.
        where: name of the joint and of its element, for the report.
        options: options of the import; `friction_as_damping` adds the friction to the damping.
        report: report of the import.
    """
    # Joints of Drake have viscous damping, but no dry friction. Drives of a station have it.
    del dynamics.attrib["friction"]
    if options.friction_as_damping:
        damping = number(dynamics, "damping") or 0.0
        total = damping + friction
        dynamics.set("damping", format_number(total))
        report.add(
            "repaired",
            where,
            message(
                "importer.damping_plus_friction",
                "friction {friction:g} is added to damping {damping:g}, which becomes {total:g}",
                damping=damping,
                friction=friction,
                total=total,
            ),
        )
    else:
        # The key is that of a station with this robot alone, in which the axis has the name of the joint.
        advice = message(
            "importer.friction_setting",
            "set it with `--set robot.drives.friction.{joint}={friction:g}`, or add it to the "
            "damping with --friction-as-damping",
            joint=name_of(joint),
            friction=friction,
        )
        report.add(
            "lost",
            where,
            message(
                "importer.friction_dropped",
                "friction {friction:g} is not imported, as files seldom have measured values; {advice}",
                friction=friction,
                advice=advice,
            ),
        )


def _repair_limits(joint: ET.Element, where: str, report: ImportReport) -> None:
    """Repair the limits of position and acceleration of a joint that moves, in place.

    Another module repairs the limits of effort and velocity later.

    Args:
        joint: the joint: continuous, revolute or prismatic.
        where: name of the joint, for the report.
        report: report of the import.
    """
    place_in_file = compound("{where} <limit>", where=where)
    limit = joint.find("limit")
    if limit is not None:
        _repair_acceleration(limit, place_in_file, report)
    kind = joint.get("type")
    lower = number(limit, "lower")
    upper = number(limit, "upper")
    range_text = _range_text(lower, upper)
    if kind == "continuous":
        _repair_continuous_range(joint, lower, upper, place_in_file, report)
    elif lower or upper:
        # A limit other than 0 is meant as one. The other may be missing, which means 0 in a URDF.
        _repair_range(joint, lower, upper, place_in_file, report)
    # From here on both limits are missing or 0, by which files say that there are none.
    elif kind == "prismatic":
        # Unlike a revolute joint, it cannot become a joint of another type that needs no limits.
        _set_range(joint, -DEFAULT_STROKE, DEFAULT_STROKE)
        problem = message(
            "importer.stroke_of_prismatic",
            "{range}; set to ±{stroke:g} m, as a prismatic joint needs a range",
            range=range_text,
            stroke=DEFAULT_STROKE,
        )
        report.add("defaulted", place_in_file, problem)
    elif kind == "revolute":
        _set_range(joint, None, None)
        joint.set("type", "continuous")
        report.add(
            "defaulted",
            place_in_file,
            message(
                "importer.nothing_stops_it",
                "{range}; without a range the joint becomes continuous",
                range=range_text,
            ),
        )


def _repair_acceleration(limit: ET.Element, where: str, report: ImportReport) -> None:
    """Remove a limit of the acceleration that is not positive, in place. Without it the acceleration has no limit."""
    acceleration = number(limit, _ACCELERATION)
    if acceleration is None or acceleration > 0:
        return
    del limit.attrib[_ACCELERATION]
    report.add(
        "dropped",
        where,
        message(
            "importer.acceleration_not_positive",
            "acceleration {acceleration:g} is not positive",
            acceleration=acceleration,
        ),
    )


def _repair_continuous_range(
    joint: ET.Element, lower: float | None, upper: float | None, where: str, report: ImportReport
) -> None:
    """Remove the limits of a continuous joint, in place, unless they are a range.

    Args:
        joint: the joint.
        lower: lower limit [rad]; None if it is missing.
        upper: upper limit [rad]; None if it is missing.
        where: name of the joint and of its element, for the report.
        report: report of the import.
    """
    if lower is None and upper is None:
        return
    # Drake keeps the limits of a continuous joint if there are both.
    if lower is not None and upper is not None and lower < upper:
        report.add(
            "read",
            where,
            message(
                "importer.limits_of_continuous",
                "the limits {lower:g} and {upper:g} of this continuous joint apply",
                lower=lower,
                upper=upper,
            ),
        )
        return
    _set_range(joint, None, None)
    report.add(
        "dropped",
        where,
        message(
            "importer.no_range_of_continuous",
            "{range} is not a range; a continuous joint needs none",
            range=_range_text(lower, upper),
        ),
    )


def _repair_range(
    joint: ET.Element, lower: float | None, upper: float | None, where: str, report: ImportReport
) -> None:
    """Repair the limits of a revolute or prismatic joint, of which at least one is not 0, in place.

    A joint whose limits are equal becomes fixed there, and a revolute joint with very large limits continuous.

    Args:
        joint: the joint.
        lower: lower limit [rad or m]; None if it is missing.
        upper: upper limit [rad or m]; None if it is missing.
        where: name of the joint and of its element, for the report.
        report: report of the import.
    """
    for key, value in (("lower", lower), ("upper", upper)):
        if value is None:
            report.add(
                "defaulted",
                where,
                message(
                    "importer.has_no_key", "has no {key}; 0 is used, the format's default", key=key
                ),
            )
    first = lower or 0.0
    second = upper or 0.0
    if first > second:
        report.add(
            "repaired",
            where,
            message(
                "importer.limits_exchanged",
                "lower {lower:g} is above upper {upper:g}; exchanged",
                lower=first,
                upper=second,
            ),
        )
    # Exchanged limits are the more probable intention, as a range from 1 to -1 is empty.
    low = min(first, second)
    high = max(first, second)
    if low == high:
        # Equal limits hold the joint where they are, which a solver could do only with a stiff stop.
        _fix_at(joint, low)
        report.add(
            "repaired",
            where,
            message(
                "importer.limits_are_equal",
                "lower and upper are both {position:g}, so the joint cannot move; it becomes fixed there",
                position=low,
            ),
        )
        return
    # Some files write such numbers for a joint without limits.
    if joint.get("type") == "revolute" and max(-low, high) > ENDLESS:
        _set_range(joint, None, None)
        joint.set("type", "continuous")
        report.add(
            "repaired",
            where,
            message(
                "importer.limits_stop_nothing",
                "{range} rad do not restrict the motion; the joint becomes continuous",
                range=_range_text(low, high),
            ),
        )
    else:
        _set_range(joint, low, high)


def _fix_at(joint: ET.Element, position: float) -> None:
    """Turn a joint that moves into a fixed joint at a position [rad or m], in place, and record the position.

    The record is the attribute _FIXED_AT, which :func:`_fix_still_followers` reads and removes.
    """
    # The axis is given in the frame of the joint, which coincides with the child link's frame at position 0.
    x, y, z = (float(word) for word in child_of(joint, "axis").get("xyz", "").split())
    length = math.hypot(x, y, z)
    direction = [x / length, y / length, z / length]
    if joint.get("type") == "prismatic":
        motion = RigidTransform([position * part for part in direction])
    else:
        motion = RigidTransform(
            RotationMatrix(AngleAxis(angle=position, axis=direction)), [0, 0, 0]
        )
    # Pose of the child link at this position: the origin of the joint, then its motion.
    place(joint, pose_of(joint) @ motion)
    joint.set("type", "fixed")
    joint.set(_FIXED_AT, format_number(position))
    # What is left belongs to a motion that the joint no longer has.
    for element in [child for child in joint if child.tag in ("axis", "limit", "dynamics")]:
        joint.remove(element)


def _set_range(joint: ET.Element, lower: float | None, upper: float | None) -> None:
    """Set the limits of a joint [rad or m], in place. None removes a limit; equal limits keep their text."""
    for key, value in (("lower", lower), ("upper", upper)):
        limit = joint.find("limit")
        if value is None:
            if limit is not None:
                limit.attrib.pop(key, None)
        # A limit that stays keeps the digits of its file.
        elif number(limit, key) != value:
            child_of(joint, "limit").set(key, format_number(value))


def _range_text(lower: float | None, upper: float | None) -> str:
    """Describe the limits of a joint [rad or m], of which each is None if it is missing."""
    if lower is None and upper is None:
        return message("importer.no_limits", "no limits")
    missing = message("importer.limit_missing", "missing")
    lower_text = missing if lower is None else f"{lower:g}"
    upper_text = missing if upper is None else f"{upper:g}"
    return message(
        "importer.lower_and_upper",
        "lower {lower}, upper {upper}",
        lower=lower_text,
        upper=upper_text,
    )
