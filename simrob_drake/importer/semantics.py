"""Read the SRDF of a robot's file: named postures, hands, and pairs of links whose collisions do not count.

An SRDF (semantic robot description format, of MoveIt) is a second file next to the robot's. It names groups of joints,
states of these groups (postures), end effectors (hands), and pairs of links that may overlap.
"""

import xml.etree.ElementTree as ET
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.file_cache import file_state
from simrob_drake.base.messages import message
from simrob_drake.importer.reading.source import read_source
from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import DRAKE, link_of, name_of

_FOLDERS = ("", "../srdf", "../config")
"""Folders in which an SRDF is sought, relative to the folder of the robot's file."""

_SUFFIXES = (".srdf", ".srdf.xacro")
"""Ends of the names of SRDF files."""

_OPEN_STATES = ("open", "opened")
"""Names of states in which a hand is open, in lower case."""

HOME_STATE = "home"
"""Name of the state that is taken for the robot's home posture."""

States = dict[str, dict[str, float]]
"""Named postures: by the name of the state, positions by the name of the joint or axis."""


class LinkPair(NamedTuple):
    """Names of two links, in alphabetical order."""

    first: str
    second: str


@dataclass(frozen=True)
class Semantics:
    """Content of an SRDF.

    Attributes:
        states: named postures [rad or m].
        hands: names of the joints in the groups of all end effectors. A group may name joints that the robot lacks.
        carriers: names of the links that carry an end effector.
        pairs: pairs of links whose collisions do not count.
    """

    states: States
    hands: frozenset[str]
    carriers: tuple[str, ...]
    pairs: frozenset[LinkPair]


NOTHING = Semantics({}, frozenset(), (), frozenset())
"""Content for a robot without an SRDF."""


def srdf_of(source: Path) -> Path | None:
    """Find the SRDF of a robot's file, or return None if there is none.

    It has the name of the robot's file up to the first dot, and lies next to it, or in a folder ``srdf`` or ``config``
    next to its folder.
    """
    # Also "arm.srdf" for "arm.urdf.xacro".
    stem = source.name.partition(".")[0]
    for folder, suffix in product(_FOLDERS, _SUFFIXES):
        file = source.parent / folder / f"{stem}{suffix}"
        if file_state(file) is not None:
            return file
    return None


def read_semantics(
    source: Path, robot: ET.Element, options: ImportOptions, report: ImportReport
) -> Semantics:
    """Read the SRDF of a robot. If there is one, an entry about it is added to the report.

    Args:
        source: file of the robot.
        robot: the robot, which is repaired already.
        options: options of the import, which may name an SRDF.
        report: report of the import.

    Returns:
        its content, or NOTHING if there is no SRDF, or if one that the options do not name cannot be read.

    Raises:
        InvalidModel: the SRDF that the options name cannot be read.
    """
    file = options.srdf or srdf_of(source)
    if file is None:
        return NOTHING
    try:
        # With a report of its own: read_source reports on the file that it is given, and the robot's report is about
        # the robot's file. What matters of the SRDF is reported below.
        tree = read_source(file, ImportReport(file), options)
    except InvalidModel as problem:
        # A file that was found by its name may belong to something else. One that the user names must be right.
        if options.srdf is not None:
            raise
        report.add(
            "dropped",
            message("importer.srdf_file", "SRDF {file}", file=file.name),
            message("importer.cannot_be_read", "cannot be read: {problem}", problem=problem),
        )
        return NOTHING

    joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
    links = {name_of(link) for link in robot.iterfind("link")}
    groups = {name_of(group): group for group in tree.iterfind("group")}
    hand_joints = set[str]()
    hand_carriers = []
    for end_effector in tree.iterfind("end_effector"):
        hand_joints |= _joints_of_group(end_effector.get("group", ""), groups, joints)
        parent_link = end_effector.get("parent_link", "")
        if parent_link in links:
            hand_carriers.append(parent_link)
    # Links that are joined by fixed joints count as one body: the name of the link that carries it, by link.
    carrier_of_link = carriers(robot)
    semantics = Semantics(
        states=_read_states(tree, joints.keys(), report),
        hands=frozenset(hand_joints),
        carriers=tuple(hand_carriers),
        pairs=frozenset(_ignored_pairs(tree, carrier_of_link)),
    )
    pairs = message(
        "importer.pairs_that_may_touch",
        "{count} pairs of links whose contacts are ignored",
        count=len(semantics.pairs),
    )
    report.add(
        "read",
        message("importer.srdf_file", "SRDF {file}", file=file.name),
        message(
            "importer.postures_and_pairs",
            "postures {states}; {pairs}",
            states=", ".join(semantics.states) or message("importer.no_postures", "none"),
            pairs=pairs,
        ),
    )
    return semantics


def _read_states(tree: ET.Element, joints: Container[str], report: ImportReport) -> States:
    """Read the states of an SRDF. Positions of unknown joints are left out, with an entry in the report.

    A value that is not one number, such as that of a joint with several degrees of freedom, is left out without an
    entry. So is a state of which no position is left.

    Args:
        tree: the SRDF.
        joints: names of the robot's joints.
        report: report of the import.
    """
    states: States = {}
    for state in tree.iterfind("group_state"):
        for joint in state.iterfind("joint"):
            try:
                value = float(joint.get("value", ""))
            except ValueError:
                # There are several values if the joint has several degrees of freedom.
                continue
            if name_of(joint) in joints:
                states.setdefault(name_of(state), {})[name_of(joint)] = value
            else:
                where = message("importer.srdf_state", "SRDF state '{name}'", name=name_of(state))
                report.add(
                    "dropped",
                    where,
                    message(
                        "importer.no_joint_of_robot",
                        "the robot has no joint '{joint}'",
                        joint=name_of(joint),
                    ),
                )
    return states


def _joints_of_group(
    name: str, groups: Mapping[str, ET.Element], joints: Mapping[str, ET.Element]
) -> set[str]:
    """Find the names of the joints of a group of an SRDF.

    These are the joints that the group names, the joints above its links, the joints on its chains, and the joints of
    the groups that it names. Each group is read once: groups may name each other, and thirty levels of two names each
    would be 2**30 groups.

    Args:
        name: name of the group. Without such a group, no joint is found.
        groups: groups of the SRDF, by name.
        joints: joints of the robot, by name.
    """
    # In a tree, one joint at most leads to each link.
    joint_above = {link_of(joint, "child"): joint for joint in joints.values()}
    found = set[str]()
    visited = set[str]()
    groups_left = [name]
    while groups_left:
        group_name = groups_left.pop()
        group = groups.get(group_name)
        if group is None or group_name in visited:
            continue
        visited.add(group_name)
        groups_left += [name_of(inner_group) for inner_group in group.iterfind("group")]
        found |= {name_of(joint) for joint in group.iterfind("joint")}
        for link in group.iterfind("link"):
            if name_of(link) in joint_above:
                found.add(name_of(joint_above[name_of(link)]))
        for chain in group.iterfind("chain"):
            found |= _joints_of_chain(chain, joint_above)
    return found


def _joints_of_chain(chain: ET.Element, joint_above: Mapping[str, ET.Element]) -> set[str]:
    """Find the names of the joints from the tip of a chain to its base, or to the root if the base is not on the way.

    Args:
        chain: element with the names of the tip link and the base link.
        joint_above: joint whose child a link is, by the link's name.
    """
    found = set[str]()
    # The joints of a broken robot may form a loop.
    visited = set[str]()
    link = chain.get("tip_link", "")
    while link in joint_above and link != chain.get("base_link") and link not in visited:
        visited.add(link)
        found.add(name_of(joint_above[link]))
        link = link_of(joint_above[link], "parent")
    return found


def _ignored_pairs(tree: ET.Element, carrier: Mapping[str, str]) -> Iterator[LinkPair]:
    """Yield the pairs of links whose collisions an SRDF disables.

    Links that fixed joints connect are one body, and the pair names the link that carries each body. Pairs within one
    body, or with an unknown link, are left out.

    Args:
        tree: the SRDF.
        carrier: link that carries the body of a link, by the link's name.
    """
    for pair in tree.iterfind("disable_collisions"):
        first, second = sorted(carrier.get(pair.get(key, ""), "") for key in ("link1", "link2"))
        # An unknown link counts as an empty name, which is sorted first.
        if first and first != second:
            yield LinkPair(first, second)


def add_filters(robot: ET.Element, semantics: Semantics) -> None:
    """Add Drake's collision filter groups to a robot, in place, so that collisions of the pairs do not count.

    Each link of a pair has a group of its own, which ignores the groups of other links.

    Args:
        robot: the ``robot`` element.
        semantics: content of the SRDF, with the pairs.
    """
    groups = dict[str, ET.Element]()
    # Sorted, so that imports of the same file write the same text.
    for link in sorted({link for pair in semantics.pairs for link in pair}):
        groups[link] = ET.SubElement(robot, f"{DRAKE}collision_filter_group", name=f"srdf_{link}")
        ET.SubElement(groups[link], f"{DRAKE}member", link=link)
    for pair in sorted(semantics.pairs):
        other_name = name_of(groups[pair.second])
        ET.SubElement(groups[pair.first], f"{DRAKE}ignored_collision_filter_group", name=other_name)


def described_by(semantics: Semantics, robot: RobotModel, report: ImportReport) -> dict[str, Any]:
    """Make the entries of an imported robot's file (robot.yaml) that its SRDF determines.

    Args:
        semantics: content of the SRDF.
        robot: the imported robot, as it is without the SRDF.
        report: report of the import, which gets an entry if fingers open the other way round.

    Returns:
        keys and values of robot.yaml: ``home_deg``, ``postures``, ``tools`` and ``gripper``, as far as they are given.
    """
    units = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
    postures: States = {}
    for name, state in semantics.states.items():
        postures[name] = {
            joint: float(f"{value / units[joint]:.6g}")
            for joint, value in state.items()
            if joint in units
        }
    # Only keys that the SRDF determines. The others stay as they are without it.
    entries: dict[str, Any] = {}
    # The home posture has a key of its own, so it is not one of the others.
    home = postures.pop(HOME_STATE, {})
    if home:
        own_home = robot.home_deg if isinstance(robot.home_deg, dict) else {}
        # Axes at zero are left out. If all are at zero, a single 0 is written for all axes.
        entries["home_deg"] = {
            axis: value for axis, value in (own_home | home).items() if value
        } or 0.0
    # A state may name joints that are no axes, such as those of a hand that the robot does not have.
    postures = {name: state for name, state in postures.items() if state}
    if postures:
        entries["postures"] = postures
    if robot.gripper is None:
        # A robot without fingers carries its tools on the links that carry end effectors in the SRDF. Tools that the
        # robot has already come last: they replace equal names.
        entries["tools"] = {**{link: link for link in semantics.carriers}, **robot.tools}
        return entries
    swapped = _swapped_fingers(robot.gripper.axes, postures, semantics)
    if swapped:
        # The two positions of every finger are exchanged, as fingers move together.
        axes = {axis: (opened, closed) for axis, (closed, opened) in robot.gripper.axes.items()}
        gripper = robot.gripper.model_copy(update={"axes": axes})
        entries["gripper"] = gripper.model_dump(mode="json", exclude_none=True)
        report.add(
            "repaired",
            "robot.yaml",
            message(
                "importer.open_as_srdf_says",
                "open and closed positions of {axes} are exchanged, as the SRDF has them",
                axes=", ".join(swapped),
            ),
        )
    return entries


def _swapped_fingers(
    axes: Mapping[str, Sequence[float]], postures: States, semantics: Semantics
) -> list[str]:
    """Find the fingers that are open, by the SRDF, at the position that was taken for their closed position.

    Args:
        axes: closed and open position of each finger, by the name of its axis.
        postures: named postures of the SRDF, in the same units.
        semantics: content of the SRDF.

    Returns:
        names of the fingers' axes.
    """
    open_positions = dict[str, float]()
    for name, state in postures.items():
        if name.lower() not in _OPEN_STATES:
            continue
        for axis, position in state.items():
            if axis in semantics.hands and axis in axes:
                open_positions[axis] = position
    swapped = []
    for axis, position in open_positions.items():
        closed, opened = axes[axis]
        # The open state need not be at a limit, so the nearer one of the two positions counts.
        if abs(position - closed) < abs(position - opened):
            swapped.append(axis)
    return swapped
