"""The structure of a robot: elements that are used, numbers that are numbers, names that differ, and one tree."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from simrob_drake.errors import listed, nearest, shortened
from simrob_drake.importer.loops import TAG as CLOSING
from simrob_drake.importer.loops import LoopCoupling, closing_of_joint, second_parents
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.repairs.names import names, repair_names
from simrob_drake.robots.fingers import FOLLOWS
from simrob_drake.robots.urdf import DRAKE, MOMENTS, MOVABLE_JOINTS, joints_at, link_of, name_of, outward
from simrob_drake.robots.urdf_check import NUMBER, NUMBER_COUNTS, SHAPE_SIZES, check_parents, check_size

LARGEST = 1e30
"""Larger figures count as infinite: no length, mass or torque is near it, and their squares would overflow."""

SMALLEST = 1e-30  # smaller ones count as zero

_UNITS = {"xyz": "m", "size": "m", "radius": "m", "length": "m", "rpy": "rad", "lower": "rad", "upper": "rad"}
_CHECKED = ("link", "joint", "material")
_LEFTOVER = re.compile(r"\$\{.*?\}|\$\(.*?\)")


@dataclass(frozen=True)
class _Rule:
    """How many numbers an attribute holds, and what stands for unreadable ones."""

    counts: tuple[int, ...] = (1,)
    default: str | None = None  # None removes the attribute, so that it counts as missing
    needed: bool = False  # nothing can be put in their place


_ZERO = _Rule((3,), "0 0 0")
_RULES: dict[tuple[str, str], _Rule] = {
    **{(tag, key): _ZERO for tag in ("origin", "frame") for key in ("xyz", "rpy")},
    ("axis", "xyz"): _Rule((3,), needed=True),
    **{("limit", key): _Rule() for key in ("lower", "upper", "effort", "velocity", f"{DRAKE}acceleration")},
    **{("dynamics", key): _Rule(default="0") for key in ("damping", "friction")},
    ("mass", "value"): _Rule(),
    **{("inertia", key): _Rule() for key in MOMENTS},
    **{(tag, "radius"): _Rule() for tag in ("cylinder", "sphere", "capsule", f"{DRAKE}capsule")},
    **{(tag, "length"): _Rule() for tag in ("cylinder", "capsule", f"{DRAKE}capsule")},
    **{(f"{DRAKE}ellipsoid", key): _Rule() for key in "abc"},
    ("box", "size"): _Rule((3,)),
    ("mesh", "scale"): _Rule((1, 3)),
    ("color", "rgba"): _Rule((3, 4)),
    (f"{DRAKE}gear_ratio", "value"): _Rule(),
    (f"{DRAKE}rotor_inertia", "value"): _Rule(),
}  # by tag and attribute

_ANYWHERE = {key: _Rule(counts) for key, counts in NUMBER_COUNTS.items()}
"""By attribute alone: the rule of places where no reader looks, but where the check wants numbers all the same."""


def mend_numbers(robot: ET.Element, report: ImportReport) -> None:
    """Mend every number of a robot that is malformed, in place.

    Decimal commas, commas between numbers, brackets and units of the SI are understood. What is not becomes the default
    of its attribute where there is one, and is removed otherwise, so that it counts as missing. Raises InvalidModel: an
    expression of xacro was not expanded, or a joint's axis is not readable.
    """
    for where, element in _placed(robot):
        for key, value in element.attrib.items():
            leftover = _LEFTOVER.search(value)
            if leftover:
                raise report.refusal(
                    where, f'{key}="{shortened(value)}" is an expression of xacro; import the xacro file itself'
                )
        for key in list(element.attrib):
            rule = _RULES.get((element.tag, key), _ANYWHERE.get(key) if where.startswith(_CHECKED) else None)
            if rule is not None and key in element.attrib:  # an unreadable moment takes the others with it
                _mend(element, key, rule, where, report)


def number(element: ET.Element | None, key: str) -> float | None:
    """Return a mended number; None where it is missing."""
    text = None if element is None else element.get(key)
    return None if text is None else float(text)


def _placed(robot: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield every element with the words that say where it is."""
    yield "<robot>", robot
    for top in robot:
        whose = f"{top.tag} '{name_of(top)}'"
        for element in top.iter():
            yield (whose if element is top else f"{whose} <{element.tag.removeprefix(DRAKE)}>"), element


def _mend(element: ET.Element, key: str, rule: _Rule, where: str, report: ImportReport) -> None:
    text = element.attrib[key]
    words = [word for word in re.split(r"[ \t\r\n]+", text) if word]
    if len(words) in rule.counts and all(_is_finite(word) and not 0 < abs(float(word)) < SMALLEST for word in words):
        return
    readable = _readable(text, rule.counts, _UNITS.get(key, "kg"))
    shown = f'{key}="{shortened(text)}"'
    if readable is not None:
        element.set(key, " ".join(readable))
        report.add("repaired", where, f'{shown} written as "{element.get(key)}"')
    elif rule.needed and text.strip():
        raise report.refusal(where, f"{shown} is not {_counted(rule.counts)}")
    elif rule.default is not None:
        element.set(key, rule.default)
        report.add("defaulted", where, f'{shown} is not {_counted(rule.counts)}; "{rule.default}" instead')
    elif element.tag == "inertia":
        for moment in MOMENTS:
            element.attrib.pop(moment, None)
        report.add("dropped", where, f"{shown} is not {_counted(rule.counts)}; the moments count as missing")
    else:
        del element.attrib[key]
        report.add("dropped", where, f"{shown} is not {_counted(rule.counts)}; it counts as missing")


def _readable(text: str, counts: tuple[int, ...], unit: str) -> list[str] | None:
    """Return the numbers that a text surely means; None if it is not sure."""
    bare = text.replace("\N{MINUS SIGN}", "-").strip("()[]{} \t\r\n")
    spaced = re.sub(r"[,;]\s+|;", " ", bare)
    for candidate in (spaced, spaced.replace(",", " "), spaced.replace(",", ".")):
        words = [_without_unit(word, unit) for word in candidate.split()]
        if len(words) in counts and all(_is_finite(word) for word in words):
            return ["0" if abs(float(word)) < SMALLEST else word for word in words]
    return None


def _without_unit(word: str, unit: str) -> str:
    """Return a number without the unit that it has anyway, or the f of a programming language."""
    bare = (word.removesuffix(end) for end in (unit, "f", "F") if word.endswith(end))
    return next((rest for rest in bare if NUMBER.fullmatch(rest)), word)


def _is_finite(word: str) -> bool:
    return NUMBER.fullmatch(word) is not None and abs(float(word)) < LARGEST


def _counted(counts: tuple[int, ...]) -> str:
    listed = " or ".join(str(count) for count in counts)
    return "a finite number" if counts == (1,) else f"{listed} finite numbers"


_GROUPS = (f"{DRAKE}ignored_collision_filter_group", f"{DRAKE}member_group")
_VISUAL = {f"{DRAKE}{name}" for name in ("illustration_properties", "perception_properties", "accepting_renderer")}
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
}  # by tag, what may stand in it
_OPAQUE = ("transmission", "collision_filter_group", "linear_bushing_rpy", "proximity_properties")
"""What is read by a stage of its own, or by Drake alone."""
_REPEATED = {"link", "joint", "material", "transmission", "frame", "visual", "collision", *_VISUAL}
_KEPT_OF_DRAKE = {f"{DRAKE}collision_filter_group", f"{DRAKE}linear_bushing_rpy"}
_CLOSING = ("loop_joint", f"{DRAKE}joint", f"{DRAKE}ball_constraint", f"{DRAKE}tendon_constraint")


def repair_structure(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair a robot's elements, numbers, names and tree in place; raises InvalidModel: a defect without a repair."""
    check_size(robot, report.refusal)
    closings = list[ET.Element]()
    _keep_known_elements(robot, options, report, closings)
    repair_names(robot, report)  # first, since of two joints that are alike one goes
    closings += _closings_of_second_parents(robot, options, report)
    mend_numbers(robot, report)
    if not names(robot, "link"):
        raise report.refusal("", "has no link")
    dangling = _drop_dangling(robot, report)
    _keep_one_tree(robot, dangling, set(check_parents(robot, report.refusal)), report)
    drop_lost_frames(robot, report)
    robot.extend(closings)


def _closings_of_second_parents(
    robot: ET.Element, options: ImportOptions, report: ImportReport
) -> Iterator[ET.Element]:
    """Take out joints that give a link a second parent, and yield the couplings that replace them.

    Raises:
        InvalidModel: there is such a joint, and the options do not ask for couplings or for leaving it out.
    """
    for joint in list(second_parents(robot)):
        child = link_of(joint, "child")
        first = next(one for one in robot.iterfind("joint") if link_of(one, "child") == child)
        where = f"link '{child}'"
        problem = f"is the child of two joints, '{name_of(first)}' and '{name_of(joint)}'; a URDF is a tree"
        closing = closing_of_joint(joint) if link_of(joint, "parent") != child else None
        if closing is not None and options.couple:
            robot.remove(joint)
            yield closing.element()
            report.add("read", f"joint '{name_of(joint)}'", f"a coupling of the first station: {closing.line}")
        elif options.drop_loops:
            robot.remove(joint)
            report.add("lost", f"joint '{name_of(joint)}'", f"{where} {problem}; left out")
        elif closing is not None:
            advice = f"leave '{name_of(joint)}' out with --drop-loops and write `{closing.line}` under couplings of a "
            raise report.refusal(where, f"{problem}; {advice}station, or let --couple do both")


def _keep_known_elements(
    robot: ET.Element, options: ImportOptions, report: ImportReport, closings: list[ET.Element]
) -> None:
    """Leave out, in place, what no simulation here uses, told once a tag; move misplaced links and joints up.

    Couplings of loops that the options ask for are added to ``closings``.

    Raises InvalidModel: the robot closes a loop, or moves in a way that no station can drive.
    """
    for element in [element for element in robot if element.tag in _CLOSING]:
        where = f"<{element.tag.removeprefix(DRAKE)}> '{name_of(element)}'"
        problem = "is no part of a tree of motored joints, which a station's robot is"
        coupling = element.find(CLOSING)
        if coupling is not None and options.couple:
            robot.remove(element)
            closings.append(coupling)
            report.add("read", where, f"a coupling of the first station: {LoopCoupling.of_element(coupling).line}")
            continue
        if not options.drop_loops:
            advice = "remove it, or leave it out with --drop-loops"
            if coupling is not None:
                line = LoopCoupling.of_element(coupling).line
                advice = (
                    f"leave it out with --drop-loops and write `{line}` under couplings of a station with discrete "
                )
                advice += "steps, or let --couple do both"
            raise report.refusal(where, f"{problem}; {advice}")
        robot.remove(element)
        report.add("lost", where, f"{problem}; left out")
    _lift(robot, robot, report)
    dropped: Counter[tuple[str, str]] = Counter()
    _prune(robot, dropped)
    for (tag, place), count in dropped.items():
        report.add("dropped", f"<{tag}> in <{place}>", f"{count} ×: no simulation here uses it")
    _drop_second_ones(robot, report)


def _lift(robot: ET.Element, element: ET.Element, report: ImportReport) -> None:
    """Move links and joints that stand within links, joints or groups of them to where they belong."""
    for child in list(element):
        if child.tag in ("link", "joint", "group"):
            _lift(robot, child, report)
            if element is not robot and child.tag != "group":
                element.remove(child)
                robot.append(child)
                report.add(
                    "repaired", f"{child.tag} '{name_of(child)}'", f"stood in a <{element.tag}>; moved into <robot>"
                )


def _prune(element: ET.Element, dropped: Counter[tuple[str, str]]) -> None:
    if element.tag.removeprefix(DRAKE) in _OPAQUE or element.tag in _VISUAL:
        return
    allowed = _KNOWN.get(element.tag, set())
    if element.tag == "robot":
        allowed = allowed | _KEPT_OF_DRAKE
    for child in list(element):
        if child.tag in allowed:
            _prune(child, dropped)
        else:
            element.remove(child)
            dropped[child.tag.replace(DRAKE, "drake:"), element.tag] += 1


def _drop_second_ones(robot: ET.Element, report: ImportReport) -> None:
    """Keep the first of what stands once; readers of URDFs, Drake's among them, see no other."""
    for top in robot:
        if top.tag not in ("link", "joint", "material"):
            continue
        for element in top.iter():
            for place in [child.tag for child in element if child.tag not in _REPEATED]:
                for second in element.findall(place)[1:]:
                    element.remove(second)
                    report.add("dropped", f"{top.tag} '{name_of(top)}'", f"a second <{place}> in its <{element.tag}>")


def drop_lost_frames(robot: ET.Element, report: ImportReport) -> None:
    """Leave out, in place, Drake's frames, groups and bushings where they name what is not there."""
    links = set(names(robot, "link"))
    welded = {link_of(joint, "child") for joint in robot.iterfind("joint") if joint.get("type") == "fixed"}
    taken = set(links)
    for frame in list(robot.iterfind("frame")):
        name = name_of(frame)
        if not name or name in taken or frame.get("link") not in links:
            robot.remove(frame)
            report.add("dropped", f"frame '{name}'", "its link is not there, or its name is missing or taken")
        taken.add(name)
    for group in list(robot.iterfind(f"{DRAKE}collision_filter_group")):
        members = {member.get("link", "") for member in group.iterfind(f"{DRAKE}member")}
        name = f"collision filter group '{name_of(group)}'"
        if not name_of(group) or name in taken or not members or not members <= links - welded:
            robot.remove(group)
            report.add("dropped", name, "its name is missing or taken, or a member is no link or welded to another")
        taken.add(name)
    kept = {name_of(group) for group in robot.iterfind(f"{DRAKE}collision_filter_group")}
    for group in robot.iterfind(f"{DRAKE}collision_filter_group"):
        for other in [other for tag in _GROUPS for other in group.findall(tag) if name_of(other) not in kept]:
            group.remove(other)
            report.add("dropped", f"collision filter group '{name_of(group)}'", f"'{name_of(other)}' is no group")
    for bushing in list(robot.iterfind(f"{DRAKE}linear_bushing_rpy")):
        ends = {frame.get("name", "") for tag in "AC" for frame in bushing.iterfind(f"{DRAKE}bushing_frame{tag}")}
        if len(ends) != 2 or not ends <= taken:
            robot.remove(bushing)
            report.add("dropped", "drake:linear_bushing_rpy", "a frame of it is not there")


def _drop_dangling(robot: ET.Element, report: ImportReport) -> list[tuple[str, str]]:
    """Leave out joints that do not join two links, and return their names with what is wrong."""
    links = set(names(robot, "link"))
    by_case = {link.lower(): link for link in links}
    dropped = []
    for joint in list(robot.iterfind("joint")):
        where = f"joint '{name_of(joint)}'"
        for end in ("parent", "child"):
            link, element = link_of(joint, end), joint.find(end)
            if link in links:
                continue
            meant = by_case.get(link.lower())
            if element is not None and meant is not None and len(by_case) == len(links):
                element.set("link", meant)
                report.add("repaired", where, f"its {end} '{link}' is no link; '{meant}', which differs in case")
                continue
            robot.remove(joint)
            problem = f"its {end} '{link}' is no link{nearest(link, links)}" if link else f"it has no {end}"
            if end == "parent" and joint.get("type") in MOVABLE_JOINTS and link_of(joint, "child") in links:
                raise report.refusal(where, f"{problem}; without it the robot falls apart")
            report.add("dropped", where, f"{problem}; the joint is left out")
            dropped.append((where, problem))
            break
    return dropped


def _keep_one_tree(robot: ET.Element, dangling: list[tuple[str, str]], held: set[str], report: ImportReport) -> None:
    """Keep the one tree that is the robot: the only one that moves, or if none does, the largest."""
    roots = [name for name in names(robot, "link") if name not in held]
    if len(roots) == 1:
        return
    starts = joints_at(robot)
    trees = {root: outward(starts, root) for root in roots}
    moving = [root for root, joints in trees.items() if any(joint.get("type") != "fixed" for joint in joints)]
    largest = max(roots, key=lambda root: len(trees[root]))
    alone = sum(len(joints) == len(trees[largest]) for joints in trees.values()) == 1
    kept = moving[0] if len(moving) == 1 else largest
    if len(moving) > 1 or (not moving and not alone):
        for where, problem in dangling:
            raise report.refusal(where, f"{problem}; without it the robot falls apart")
        ends = moving or roots
        raise report.refusal("", f"has {len(ends)} root links ({listed(ends, 6)}); join them to one tree by joints")
    for root in roots:
        if root != kept:
            hung = [link_of(joint, "child") for joint in trees[root]]
            lost = {root, *hung}
            for element in [*trees[root], *(link for link in robot.iterfind("link") if name_of(link) in lost)]:
                robot.remove(element)
            with_it = f" with {listed(hung, 6)}" if hung else ""
            report.add("dropped", f"link '{root}'", f"no joint leads to it; left out{with_it}")
