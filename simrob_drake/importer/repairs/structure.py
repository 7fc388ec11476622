"""Repair the structure of a robot (a URDF): unknown elements, malformed numbers, duplicate names, and its tree.

A robot is an XML tree of elements, and its links are a second tree, which its joints form: each joint has a parent link
and a child link. Every change adds an entry to the report of the import.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from simrob_drake.base.errors import list_names, nearest, shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.importer.loops import TAG as CLOSING
from simrob_drake.importer.loops import LoopCoupling, closing_of_joint, second_parents
from simrob_drake.importer.repairs.names import names, repair_names
from simrob_drake.robots.fingers import FOLLOWS
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    MOMENTS,
    MOVABLE_JOINTS,
    joints_at,
    link_of,
    name_of,
    outward,
)
from simrob_drake.robots.urdf_check import (
    NUMBER,
    NUMBER_COUNTS,
    SHAPE_SIZES,
    check_parents,
    check_size,
)

LARGEST = 1e30
"""Larger numbers count as infinite: no length, mass or torque is near it, and their squares would overflow."""

SMALLEST = 1e-30
"""Smaller absolute values count as zero."""

_UNITS = {
    "xyz": "m",
    "size": "m",
    "radius": "m",
    "length": "m",
    "rpy": "rad",
    "lower": "rad",
    "upper": "rad",
}
"""Unit that a number of an attribute may be written with, by the attribute's name."""
_DEFAULT_UNIT = "kg"
"""Unit that the numbers of other attributes may be written with."""

_CHECKED = ("link", "joint", "material")
"""Tags of the elements in which all numbers are checked."""

_XACRO_EXPRESSION = re.compile(r"\$\{.*?\}|\$\(.*?\)")
"""An expression of xacro, such as ``${width / 2}`` or ``$(arg name)``."""


@dataclass(frozen=True)
class _NumberRule:
    """Rule for an attribute that holds numbers.

    Attributes:
        counts: counts of numbers that are allowed.
        default: text that replaces unreadable numbers. If it is None, the attribute is removed.
        is_required: whether unreadable numbers are an error, because nothing can replace them.
    """

    counts: tuple[int, ...] = (1,)
    default: str | None = None
    is_required: bool = False


# Positions and angles that cannot be read become zero, which is the format's own default for an origin.
_ZERO = _NumberRule((3,), "0 0 0")
_RULES: dict[tuple[str, str], _NumberRule] = {
    **{(tag, key): _ZERO for tag in ("origin", "frame") for key in ("xyz", "rpy")},
    # No default replaces an axis: about another axis the robot would move in another way.
    ("axis", "xyz"): _NumberRule((3,), is_required=True),
    **{
        ("limit", key): _NumberRule()
        for key in ("lower", "upper", "effort", "velocity", f"{DRAKE}acceleration")
    },
    **{("dynamics", key): _NumberRule(default="0") for key in ("damping", "friction")},
    ("mass", "value"): _NumberRule(),
    **{("inertia", key): _NumberRule() for key in MOMENTS},
    **{
        (tag, "radius"): _NumberRule()
        for tag in ("cylinder", "sphere", "capsule", f"{DRAKE}capsule")
    },
    **{(tag, "length"): _NumberRule() for tag in ("cylinder", "capsule", f"{DRAKE}capsule")},
    **{(f"{DRAKE}ellipsoid", key): _NumberRule() for key in "abc"},
    ("box", "size"): _NumberRule((3,)),
    ("mesh", "scale"): _NumberRule((1, 3)),
    ("color", "rgba"): _NumberRule((3, 4)),
    (f"{DRAKE}gear_ratio", "value"): _NumberRule(),
    (f"{DRAKE}rotor_inertia", "value"): _NumberRule(),
}
"""Rules by the tag of the element and the name of the attribute."""

_RULES_OF_OTHER_TAGS = {key: _NumberRule(counts) for key, counts in NUMBER_COUNTS.items()}
"""Rules by the name of the attribute, for elements with other tags: no reader uses their numbers, but the final check
of an import requires numbers there, too."""


def repair_numbers(robot: ET.Element, report: ImportReport) -> None:
    """Repair every number of a robot that is malformed, in place.

    Decimal commas, commas between numbers, brackets and the attribute's unit (m, rad or kg) are understood. Other text
    is replaced by the default of its attribute if there is one, and is removed otherwise, so that it counts as missing.

    Args:
        robot: the ``robot`` element.
        report: gets an entry for each repair.

    Raises:
        InvalidModel: an expression of xacro was not expanded, or a joint's axis is not readable.
    """
    for place in _elements_with_places(robot):
        element = place.element
        for key, value in element.attrib.items():
            # Its value depends on other parts of the xacro file, which are not in this one.
            if _XACRO_EXPRESSION.search(value):
                problem = message(
                    "importer.expression_of_xacro",
                    '{key}="{value}" is an expression of xacro; import the xacro file itself',
                    key=key,
                    value=shorten(value),
                )
                raise report.refusal(place.words, problem)
        # The words begin with the tag of the link, joint or material.
        is_checked = place.words.startswith(_CHECKED)
        # A list, since repairs remove attributes.
        for key in list(element.attrib):
            rule = _RULES.get((element.tag, key))
            if rule is None and is_checked:
                rule = _RULES_OF_OTHER_TAGS.get(key)
            # The repair of an unreadable moment of inertia removes the other moments, too.
            if rule is not None and key in element.attrib:
                _repair_numbers(element, key, rule, place.words, report)


def number(element: ET.Element | None, key: str) -> float | None:
    """Read a number that is repaired already. Returns None if the element or its attribute is missing."""
    text = None if element is None else element.get(key)
    return None if text is None else float(text)


class _Place(NamedTuple):
    """An element of a robot, and its place in words.

    Attributes:
        words: the place, such as "joint 'elbow' <limit>".
        element: the element.
    """

    words: str
    element: ET.Element


def _elements_with_places(robot: ET.Element) -> Iterator[_Place]:
    """Yield every element of a robot, itself included, with its place in words."""
    yield _Place("<robot>", robot)
    for top in robot:
        # Elements have no names of their own, so the words name the link, joint or material that contains them.
        owner = compound("{tag} '{name_of}'", tag=top.tag, name_of=name_of(top))
        for element in top.iter():
            tag = element.tag.removeprefix(DRAKE)
            yield _Place(
                owner if element is top else compound("{owner} <{tag}>", owner=owner, tag=tag),
                element,
            )


def _repair_numbers(
    element: ET.Element, key: str, rule: _NumberRule, where: str, report: ImportReport
) -> None:
    """Repair the numbers of one attribute, in place.

    Args:
        element: the element.
        key: name of the attribute.
        rule: rule for its numbers.
        where: place of the element in words, for the report.
        report: report of the import.

    Raises:
        InvalidModel: the numbers are not readable, and the rule requires them.
    """
    text = element.attrib[key]
    # Only at the blanks of XML. `split` would also accept other blanks, such as non-breaking ones.
    words = [word for word in re.split(r"[ \t\r\n]+", text) if word]
    # A correct text is not written again, so that its digits stay as they are.
    if len(words) in rule.counts and all(_is_plain_number(word) for word in words):
        return
    value = f'{key}="{shorten(text)}"'
    problem = message(
        "importer.is_not_count",
        "{value} is not {count}",
        value=value,
        count=_count_text(rule.counts),
    )
    numbers = _understand_numbers(text, rule.counts, _UNITS.get(key, _DEFAULT_UNIT))
    if numbers is not None:
        element.set(key, " ".join(numbers))
        report.add(
            "repaired",
            where,
            message(
                "importer.written_as",
                '{value} written as "{written}"',
                value=value,
                written=element.get(key),
            ),
        )
    elif rule.is_required and text.strip():
        # An empty text is no error: it counts as missing, and a later stage gives the default.
        raise report.refusal(where, problem)
    elif rule.default is not None:
        element.set(key, rule.default)
        report.add(
            "defaulted",
            where,
            message(
                "importer.default_instead",
                '{problem}; "{default}" is used',
                problem=problem,
                default=rule.default,
            ),
        )
    elif element.tag == "inertia":
        # Some moments without the others would be those of another body.
        for moment in MOMENTS:
            element.attrib.pop(moment, None)
        report.add(
            "dropped",
            where,
            message(
                "importer.moments_count_as_missing",
                "{problem}; the moments count as missing",
                problem=problem,
            ),
        )
    else:
        del element.attrib[key]
        report.add(
            "dropped",
            where,
            message(
                "importer.counts_as_missing", "{problem}; it counts as missing", problem=problem
            ),
        )


def _understand_numbers(text: str, counts: tuple[int, ...], unit: str) -> list[str] | None:
    """Read the numbers that a malformed text means, in order.

    Args:
        text: the text, such as "(1,5; 2; 3)".
        counts: counts of numbers that are allowed.
        unit: unit that may follow a number.

    Returns:
        the numbers as they were written, very small ones as 0; None if the text cannot be understood.
    """
    # Texts that were copied from documents have a minus sign that is no hyphen.
    plain = text.replace("\N{MINUS SIGN}", "-").strip("()[]{} \t\r\n")
    spaced = re.sub(r"[,;]\s+|;", " ", plain)
    # A comma that is left separates numbers, or else it is a decimal comma.
    for candidate in (spaced, spaced.replace(",", " "), spaced.replace(",", ".")):
        # The count decides which meaning is right: "1,5" is one number where one is expected.
        words = [_without_unit(word, unit) for word in candidate.split()]
        if len(words) in counts and all(_is_finite(word) for word in words):
            # The words of the file, and not their values, so that no digit changes.
            return ["0" if abs(float(word)) < SMALLEST else word for word in words]
    return None


def _without_unit(word: str, unit: str) -> str:
    """Remove the unit or the suffix f from a number, such as 1.5m or 1.5f. Other words are returned unchanged.

    The suffix f marks numbers of single precision in C.
    """
    for suffix in (unit, "f", "F"):
        rest = word.removesuffix(suffix)
        if word.endswith(suffix) and NUMBER.fullmatch(rest):
            return rest
    return word


def _is_finite(word: str) -> bool:
    """Whether a word is a number, and not so large that it counts as infinite."""
    return NUMBER.fullmatch(word) is not None and abs(float(word)) < LARGEST


def _is_plain_number(word: str) -> bool:
    """Whether a word is a finite number that needs no repair: 0, or not so small that it counts as 0."""
    return _is_finite(word) and not 0 < abs(float(word)) < SMALLEST


def _count_text(counts: tuple[int, ...]) -> str:
    """Describe counts of numbers, such as "3 or 4 finite numbers"."""
    if counts == (1,):
        return message("importer.finite_number", "a finite number")
    alternatives = str(counts[0])
    for count in counts[1:]:
        alternatives = message(
            "importer.either_count", "{first} or {second}", first=alternatives, second=count
        )
    return message(
        "importer.finite_numbers", "{alternatives} finite numbers", alternatives=alternatives
    )


_GROUPS = (f"{DRAKE}ignored_collision_filter_group", f"{DRAKE}member_group")
"""Tags of the elements in a collision filter group that name another group."""

_VISUAL = {
    f"{DRAKE}{name}"
    for name in ("illustration_properties", "perception_properties", "accepting_renderer")
}
"""Tags of Drake's elements in a visual."""

_KNOWN: dict[str, set[str]] = {
    "robot": {"link", "joint", "material", "transmission", "frame"},
    "link": {"inertial", "visual", "collision"},
    "joint": {"parent", "child", "origin", "axis", "limit", "dynamics", "mimic", FOLLOWS},
    "inertial": {"origin", "mass", "inertia"},
    "visual": {"origin", "geometry", "material"} | _VISUAL,
    "collision": {"origin", "geometry", f"{DRAKE}proximity_properties"},
    "geometry": {"mesh", *SHAPE_SIZES},
    "mesh": {f"{DRAKE}declare_convex"},
    "material": {"color", "texture"},
}
"""Tags of the elements that may be in an element, by its tag."""

_OPAQUE = ("transmission", "collision_filter_group", "linear_bushing_rpy", "proximity_properties")
"""Elements whose content is not checked here: another stage of the import, or Drake alone, reads it."""

_REPEATED = {"link", "joint", "material", "transmission", "frame", "visual", "collision", *_VISUAL}
"""Elements of which an element may contain several."""

_KEPT_OF_DRAKE = {f"{DRAKE}collision_filter_group", f"{DRAKE}linear_bushing_rpy"}
"""Tags of Drake's elements that a robot may contain in addition to those of the format."""

_LOOP_TAGS = ("loop_joint", f"{DRAKE}joint", f"{DRAKE}ball_constraint", f"{DRAKE}tendon_constraint")
"""Elements that close a loop, or move in a way that no motor drives."""


def repair_structure(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair a robot's elements, numbers, names and tree in place.

    If the options ask for couplings in place of joints that close loops, their elements are added at the end of the
    robot.

    Args:
        robot: the ``robot`` element, as its reader has made it.
        options: options of the import: what becomes of joints that close loops.
        report: gets an entry for each change.

    Raises:
        InvalidModel: a defect has no repair.
    """
    # The size comes first: a file that is too large would occupy the other steps for long.
    check_size(robot, report.refusal)
    # Loops come first: the next step would remove their elements as unknown ones.
    closings = _take_out_loops(robot, options, report)
    _keep_known_elements(robot, report)
    # Names come before second parents: of two equal joints with the same child one is removed here.
    repair_names(robot, report)
    closings += _closings_of_second_parents(robot, options, report)
    # Only of elements that are left, so that a number in an element without use is no error.
    repair_numbers(robot, report)
    if not names(robot, "link"):
        raise report.refusal("", message("importer.has_no_link", "has no link"))
    dropped_joints = _drop_dangling_joints(robot, report)
    # From here on, each link is the child of one joint at most.
    child_links = set(check_parents(robot, report.refusal))
    _keep_one_tree(robot, dropped_joints, child_links, report)
    # After the links are final, since frames and groups name links.
    drop_lost_frames(robot, report)
    # The couplings are no elements of a URDF: the steps above would remove them.
    robot.extend(closings)


def _closings_of_second_parents(
    robot: ET.Element, options: ImportOptions, report: ImportReport
) -> Iterator[ET.Element]:
    """Take joints that give a link a second parent out of a robot, in place, and yield the couplings that replace them.

    A coupling is yielded as an XML element, which the stages of the import pass on. A joint without such a coupling
    stays in the robot if the options do not allow to drop it: the check of parents refuses it later.

    Raises:
        InvalidModel: a coupling could replace a joint, but the options do not ask for couplings or for leaving it out.
    """
    for joint in list(second_parents(robot)):
        child = link_of(joint, "child")
        # The first joint keeps the link as its child.
        first = next(other for other in robot.iterfind("joint") if link_of(other, "child") == child)
        where = message("robots.link_called", "link '{link}'", link=child)
        problem = message(
            "importer.child_of_two_joints",
            "is the child of two joints, '{first}' and '{second}'; a URDF is a tree",
            first=name_of(first),
            second=name_of(joint),
        )
        # A joint of a link to itself closes nothing, so no coupling can replace it.
        joins_two_links = link_of(joint, "parent") != child
        closing = closing_of_joint(joint) if joins_two_links else None
        if closing is not None and options.couple:
            robot.remove(joint)
            yield closing.element()
            report.add(
                "read",
                message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
                message(
                    "importer.coupling_of_first_station",
                    "becomes a coupling of the robot's first station: {line}",
                    line=closing.line,
                ),
            )
        elif options.drop_loops:
            robot.remove(joint)
            report.add(
                "lost",
                message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
                # The entry is about the joint, and the problem about the link, so that the text names both.
                message(
                    "importer.place_left_out",
                    "{where} {problem}; left out",
                    where=where,
                    problem=problem,
                ),
            )
        elif closing is not None:
            advice = message(
                "importer.drop_and_couple",
                "leave '{joint}' out with --drop-loops and write `{line}` under couplings of a station",
                joint=name_of(joint),
                line=closing.line,
            )
            raise report.refusal(
                where,
                message(
                    "importer.or_couple",
                    "{problem}; {advice}. The option --couple does both",
                    problem=problem,
                    advice=advice,
                ),
            )


def _take_out_loops(
    robot: ET.Element, options: ImportOptions, report: ImportReport
) -> list[ET.Element]:
    """Take the elements that close loops, or move in a way that no motor drives, out of a robot, in place.

    Returns:
        XML elements of the couplings that replace them, if the options ask for couplings.

    Raises:
        InvalidModel: there is such an element, and the options do not ask for couplings or for leaving it out.
    """
    closings = []
    # A list, since elements are removed from the robot in this loop.
    for element in [element for element in robot if element.tag in _LOOP_TAGS]:
        where = compound(
            "<{tag}> '{name_of}'", tag=element.tag.removeprefix(DRAKE), name_of=name_of(element)
        )
        problem = message(
            "importer.no_part_of_tree",
            "does not fit into a robot, which is a tree of joints with motors",
        )
        # The reader of the file has added this child if a coupling can replace the element.
        coupling = element.find(CLOSING)
        line = "" if coupling is None else LoopCoupling.of_element(coupling).line
        if coupling is not None and options.couple:
            robot.remove(element)
            closings.append(coupling)
            report.add(
                "read",
                where,
                message(
                    "importer.coupling_of_first_station",
                    "becomes a coupling of the robot's first station: {line}",
                    line=line,
                ),
            )
        elif options.drop_loops:
            robot.remove(element)
            report.add(
                "lost",
                where,
                message("importer.problem_left_out", "{problem}; left out", problem=problem),
            )
        elif coupling is not None:
            advice = message(
                "importer.drop_loop_and_couple",
                "leave it out with --drop-loops and write `{line}` under couplings of a station with discrete steps",
                line=line,
            )
            raise report.refusal(
                where,
                message(
                    "importer.or_couple",
                    "{problem}; {advice}. The option --couple does both",
                    problem=problem,
                    advice=advice,
                ),
            )
        else:
            raise report.refusal(
                where,
                message(
                    "importer.remove_or_drop",
                    "{problem}; remove the element, or leave it out with --drop-loops",
                    problem=problem,
                ),
            )
    return closings


def _keep_known_elements(robot: ET.Element, report: ImportReport) -> None:
    """Move misplaced links and joints to the top of a robot, and remove elements that no simulation uses, in place."""
    # A joint in a link, for example, would be removed with the unknown elements if it stayed there.
    _move_to_top(robot, robot, report)
    removed_counts: Counter[_Nesting] = Counter()
    _remove_unknown(robot, removed_counts)
    # One entry for each kind of element: files for Gazebo have hundreds of equal ones.
    for nesting, count in removed_counts.items():
        report.add(
            "dropped",
            message(
                "importer.tag_in_parent",
                "<{tag}> in <{parent}>",
                tag=nesting.tag,
                parent=nesting.parent,
            ),
            message(
                "importer.no_simulation_uses_it",
                "{count} ×: no simulation uses this element",
                count=count,
            ),
        )
    # Last, since an element of which there are two may have been removed as an unknown one.
    _remove_repeated(robot, report)


def _move_to_top(robot: ET.Element, element: ET.Element, report: ImportReport) -> None:
    """Move the links and joints within an element of a robot, and within its links, joints and groups, to the robot."""
    for child in list(element):
        if child.tag in ("link", "joint", "group"):
            _move_to_top(robot, child, report)
            # Groups have no meaning in a URDF. They are removed with the unknown elements when their content is moved.
            if element is not robot and child.tag != "group":
                element.remove(child)
                robot.append(child)
                report.add(
                    "repaired",
                    compound("{tag} '{name_of}'", tag=child.tag, name_of=name_of(child)),
                    message(
                        "importer.moved_into_robot",
                        "was in a <{tag}>; moved into <robot>",
                        tag=element.tag,
                    ),
                )


class _Nesting(NamedTuple):
    """Tag of an element, and tag of the element that contains it."""

    tag: str
    parent: str


def _remove_unknown(element: ET.Element, removed_counts: Counter[_Nesting]) -> None:
    """Remove elements that no simulation uses from an element and all below it, in place, and count them."""
    # These contain elements whose tags are not in _KNOWN.
    if element.tag.removeprefix(DRAKE) in _OPAQUE or element.tag in _VISUAL:
        return
    allowed = _KNOWN.get(element.tag, set())
    if element.tag == "robot":
        # A new set: _KNOWN itself must not change.
        allowed = allowed | _KEPT_OF_DRAKE
    for child in list(element):
        if child.tag in allowed:
            _remove_unknown(child, removed_counts)
        else:
            element.remove(child)
            # The name space is a long URL. Users know it by its prefix.
            removed_counts[_Nesting(child.tag.replace(DRAKE, "drake:"), element.tag)] += 1


def _remove_repeated(robot: ET.Element, report: ImportReport) -> None:
    """Remove the second and further elements of a tag that may occur only once in an element, in place.

    Readers of URDFs, such as Drake's, use the first one only.
    """
    for top in robot:
        if top.tag not in ("link", "joint", "material"):
            continue
        for element in top.iter():
            # A list of tags, since elements are removed from what is iterated.
            for tag in [child.tag for child in element if child.tag not in _REPEATED]:
                for repeated in element.findall(tag)[1:]:
                    element.remove(repeated)
                    report.add(
                        "dropped",
                        compound("{tag} '{name_of}'", tag=top.tag, name_of=name_of(top)),
                        message(
                            "importer.second_tag",
                            "a second <{tag}> in its <{parent}>",
                            tag=tag,
                            parent=element.tag,
                        ),
                    )


def drop_lost_frames(robot: ET.Element, report: ImportReport) -> None:
    """Remove Drake's frames, collision filter groups and bushings that Drake would refuse, in place.

    They name missing elements, or have no name, or the name of another one. Stages that remove links call this function
    afterwards.

    Args:
        robot: the ``robot`` element.
        report: gets an entry for each element that is removed.
    """
    links = set(names(robot, "link"))
    # Drake has a frame of the name of each link, so no other frame may have such a name.
    taken_names = set(links)
    for frame in list(robot.iterfind("frame")):
        name = name_of(frame)
        if not name or name in taken_names or frame.get("link") not in links:
            robot.remove(frame)
            report.add(
                "dropped",
                message("importer.frame_called", "frame '{name}'", name=name),
                message(
                    "importer.frame_without_link",
                    "its link does not exist, or its name is missing or already used",
                ),
            )
        else:
            taken_names.add(name)
    _drop_lost_groups(robot, links, taken_names, report)
    # A bushing is a spring and damper between two frames, so it needs both.
    for bushing in list(robot.iterfind(f"{DRAKE}linear_bushing_rpy")):
        # A bushing names its two frames in <bushing_frameA> and <bushing_frameC>.
        ends = {
            frame.get("name", "")
            for tag in "AC"
            for frame in bushing.iterfind(f"{DRAKE}bushing_frame{tag}")
        }
        if len(ends) != 2 or not ends <= taken_names:
            robot.remove(bushing)
            report.add(
                "dropped",
                "drake:linear_bushing_rpy",
                message("importer.frame_missing", "one of its frames does not exist"),
            )


def _drop_lost_groups(
    robot: ET.Element, links: set[str], taken_names: set[str], report: ImportReport
) -> None:
    """Remove collision filter groups that Drake would refuse, and names of missing groups in the others, in place.

    These groups have no name, the name of an earlier group, no members, or members that are no links. A group with a
    link that is welded to another one is removed, too.

    Args:
        robot: the robot.
        links: names of its links.
        taken_names: names of links and frames, to which the groups are added in words: a group may have the name of a
            link.
        report: report of the import.
    """
    welded_links = {
        link_of(joint, "child") for joint in robot.iterfind("joint") if joint.get("type") == "fixed"
    }
    for group in list(robot.iterfind(f"{DRAKE}collision_filter_group")):
        members = {member.get("link", "") for member in group.iterfind(f"{DRAKE}member")}
        # The words before the name let a group have the name of a link or frame.
        name = message(
            "importer.collision_filter_group",
            "collision filter group '{name}'",
            name=name_of(group),
        )
        # Drake refuses a second group of the same name.
        has_free_name = bool(name_of(group)) and name not in taken_names
        # A link that is welded to another one may be merged with it later in the import.
        has_known_members = bool(members) and members <= links - welded_links
        if not has_free_name or not has_known_members:
            robot.remove(group)
            report.add(
                "dropped",
                name,
                message(
                    "importer.group_with_problem",
                    "its name is missing or already used, or one of its members is not a link or is welded "
                    "to another link",
                ),
            )
        taken_names.add(name)
    # Only now is it known which groups are left.
    group_names = {name_of(group) for group in robot.iterfind(f"{DRAKE}collision_filter_group")}
    for group in robot.iterfind(f"{DRAKE}collision_filter_group"):
        for tag in _GROUPS:
            for other in group.findall(tag):
                if name_of(other) not in group_names:
                    group.remove(other)
                    where = message(
                        "importer.collision_filter_group",
                        "collision filter group '{name}'",
                        name=name_of(group),
                    )
                    report.add(
                        "dropped",
                        where,
                        message(
                            "importer.no_group",
                            "'{name}' is not a collision filter group",
                            name=name_of(other),
                        ),
                    )


class _DroppedJoint(NamedTuple):
    """A joint that was removed because it does not join two links.

    Attributes:
        where: the joint in words, such as "joint 'elbow'".
        problem: what is wrong with it.
    """

    where: str
    problem: str


def _drop_dangling_joints(robot: ET.Element, report: ImportReport) -> list[_DroppedJoint]:
    """Remove joints that do not join two links, in place. Names of links that differ in case only are corrected.

    Returns:
        the removed joints, in file order.

    Raises:
        InvalidModel: a joint of a type that motors can move has an existing child link and no parent link.
    """
    links = set(names(robot, "link"))
    link_in_any_case = {link.lower(): link for link in links}
    if len(link_in_any_case) < len(links):
        # If two links differ in case only, it is not known which one a joint means.
        link_in_any_case = {}
    dropped = []
    # A list, since joints are removed from the robot in this loop.
    for joint in list(robot.iterfind("joint")):
        where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
        for end in ("parent", "child"):
            link = link_of(joint, end)
            if link in links or _correct_case(joint, end, link_in_any_case, where, report):
                continue
            robot.remove(joint)
            if link:
                problem = message(
                    "importer.end_is_no_link",
                    "its <{end}> '{link}' is not a link{suggestion}",
                    end=end,
                    link=link,
                    suggestion=nearest(link, links),
                )
            else:
                problem = message("importer.has_no_end", "has no <{end}>", end=end)
            # A joint without a child moves nothing. A link that loses its parent would be a robot of its own.
            is_child_lost = end == "parent" and link_of(joint, "child") in links
            if is_child_lost and joint.get("type") in MOVABLE_JOINTS:
                raise report.refusal(
                    where,
                    message(
                        "importer.falls_apart",
                        "{problem}; without this joint the links are not connected",
                        problem=problem,
                    ),
                )
            report.add(
                "dropped",
                where,
                message(
                    "importer.joint_left_out", "{problem}; the joint is left out", problem=problem
                ),
            )
            # Kept for the case that the links are not connected without the joint, which is found later.
            dropped.append(_DroppedJoint(where, problem))
            # The joint is removed, so its other end does not matter any more.
            break
    return dropped


def _correct_case(
    joint: ET.Element,
    end: str,
    link_in_any_case: Mapping[str, str],
    where: str,
    report: ImportReport,
) -> bool:
    """Correct the name of a joint's link if a link has this name with other capital letters, in place.

    Args:
        joint: the joint.
        end: ``parent`` or ``child``.
        link_in_any_case: names of the links, by these names in lower case.
        where: the joint in words, for the report.
        report: report of the import.

    Returns:
        whether the name was corrected.
    """
    element = joint.find(end)
    link = link_of(joint, end)
    intended = link_in_any_case.get(link.lower())
    if element is None or intended is None:
        return False
    element.set("link", intended)
    report.add(
        "repaired",
        where,
        message(
            "importer.differs_in_case",
            "its <{end}> '{link}' is not a link; '{intended}' is used, which differs in case only",
            end=end,
            link=link,
            intended=intended,
        ),
    )
    return True


def _keep_one_tree(
    robot: ET.Element,
    dropped_joints: list[_DroppedJoint],
    child_links: Collection[str],
    report: ImportReport,
) -> None:
    """Keep one tree of links, in place: the only one that moves, or if none does, the largest.

    Args:
        robot: the robot.
        dropped_joints: joints that were removed, one of which may have connected the trees.
        child_links: names of the links that are the child of a joint; the others are roots.
        report: report of the import.

    Raises:
        InvalidModel: several trees move, or none moves and the largest is not the only one of its size.
    """
    roots = [name for name in names(robot, "link") if name not in child_links]
    if len(roots) == 1:
        return
    joints_of_link = joints_at(robot)
    # The joints of each tree, by the name of its root.
    trees = {root: outward(joints_of_link, root) for root in roots}
    # A tree in which nothing moves may be scenery around the robot.
    moving = [
        root
        for root, joints in trees.items()
        if any(joint.get("type") != "fixed" for joint in joints)
    ]
    largest = max(roots, key=lambda root: len(trees[root]))
    # Of two rigid trees of equal size, neither is more probably the robot.
    as_large = [root for root in roots if len(trees[root]) == len(trees[largest])]
    if len(moving) > 1 or (not moving and len(as_large) > 1):
        if dropped_joints:
            # The joint that was removed is the more probable cause, and the user can repair it.
            joint = dropped_joints[0]
            raise report.refusal(
                joint.where,
                message(
                    "importer.falls_apart",
                    "{problem}; without this joint the links are not connected",
                    problem=joint.problem,
                ),
            )
        found_roots = moving or roots
        raise report.refusal(
            "",
            message(
                "importer.several_roots",
                "has {count} root links ({ends}); connect them by joints to one tree",
                count=len(found_roots),
                ends=list_names(found_roots, 6),
            ),
        )
    # What is left is a robot with loose links, such as those of a scene, or rigid trees of different sizes.
    kept = moving[0] if moving else largest
    for root in roots:
        if root != kept:
            _remove_tree(robot, root, trees[root], report)


def _remove_tree(
    robot: ET.Element, root: str, joints: list[ET.Element], report: ImportReport
) -> None:
    """Remove a tree of links from a robot, in place.

    Args:
        robot: the robot.
        root: name of the tree's root link.
        joints: joints of the tree.
        report: report of the import.
    """
    # The root link is no joint's child, so it is not among these.
    other_links = [link_of(joint, "child") for joint in joints]
    lost_links = {root, *other_links}
    for element in [
        *joints,
        *(link for link in robot.iterfind("link") if name_of(link) in lost_links),
    ]:
        robot.remove(element)
    addition = (
        message("importer.with_other_links", " with {links}", links=list_names(other_links, 6))
        if other_links
        else ""
    )
    report.add(
        "dropped",
        message("robots.link_called", "link '{link}'", link=root),
        message(
            "importer.no_joint_leads_to_it",
            "no joint connects this link with the robot; left out{addition}",
            addition=addition,
        ),
    )
