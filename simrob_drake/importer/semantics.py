"""What an SRDF beside a robot's file tells of it: named postures, hands, and links that do not mind each other.

An SRDF (semantic robot description format, of MoveIt) names groups of joints, states of them, and pairs of links.
"""

import xml.etree.ElementTree as ET
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os.path import isfile
from pathlib import Path
from typing import Any

from simrob_drake.errors import InvalidModel
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.reading.source import read_source
from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.urdf import DRAKE, link_of, name_of

_FOLDERS = ("", "../srdf", "../config")  # where it is looked for, from the robot's file
_SUFFIXES = (".srdf", ".srdf.xacro")
_OPEN = "open", "opened"
HOME_STATE = "home"
_States = dict[str, dict[str, float]]  # positions by joint or axis, by name


@dataclass(frozen=True)
class Semantics:
    """What an SRDF tells."""

    states: _States  # in rad or m
    hands: frozenset[str]  # joints of its end effectors
    carriers: tuple[str, ...]  # links that carry these
    pairs: frozenset[tuple[str, str]]  # of links whose collisions do not count


NOTHING = Semantics({}, frozenset(), (), frozenset())


def srdf_of(source: Path) -> Path | None:
    """Return the SRDF of a robot's file: that of its name beside it, or in ``srdf`` or ``config`` beside its folder."""
    stem = source.name.partition(".")[0]
    places = (source.parent / folder / f"{stem}{suffix}" for folder in _FOLDERS for suffix in _SUFFIXES)
    return next((place for place in places if isfile(place)), None)


def read_semantics(source: Path, robot: ET.Element, options: ImportOptions, report: ImportReport) -> Semantics:
    """Return what the SRDF of a repaired robot tells, which is entered in the report; nothing where there is none.

    Raises InvalidModel: one that was asked for cannot be read; another one is left out.
    """
    file = options.srdf or srdf_of(source)
    if file is None:
        return NOTHING
    try:
        tree = read_source(file, ImportReport(file), options)
    except InvalidModel as problem:
        if options.srdf is not None:
            raise
        report.add("dropped", f"SRDF {file.name}", f"cannot be read: {problem}")
        return NOTHING
    joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
    links = {name_of(link) for link in robot.iterfind("link")}
    ends, groups = list(tree.iterfind("end_effector")), {name_of(group): group for group in tree.iterfind("group")}
    found = Semantics(
        _states(tree, joints.keys(), report),
        frozenset(joint for end in ends for joint in _joints(end.get("group", ""), groups, joints)),
        tuple(link for end in ends if (link := end.get("parent_link", "")) in links),
        frozenset(_pairs(tree, carriers(robot))),
    )
    pairs = f"{len(found.pairs)} pairs of links that do not mind each other"
    report.add("read", f"SRDF {file.name}", f"postures {', '.join(found.states) or 'none'}; {pairs}")
    return found


def _states(tree: ET.Element, joints: Container[str], report: ImportReport) -> _States:
    states: _States = {}
    for state in tree.iterfind("group_state"):
        for joint in state.iterfind("joint"):
            try:
                value = float(joint.get("value", ""))
            except ValueError:  # several, of a joint that is no axis
                continue
            if name_of(joint) in joints:
                states.setdefault(name_of(state), {})[name_of(joint)] = value
            else:
                where = f"SRDF state '{name_of(state)}'"
                report.add("dropped", where, f"the robot has no joint '{name_of(joint)}'")
    return states


def _joints(name: str, groups: dict[str, ET.Element], joints: dict[str, ET.Element]) -> set[str]:
    """Return the joints of a group: named, above its links, on its chains, and those of the groups that it names.

    Each group is read once. Groups may name each other, and thirty levels of two names each would be 2**30 groups.
    """
    above = {link_of(joint, "child"): joint for joint in joints.values()}
    found = set[str]()
    visited = set[str]()
    waiting = [name]
    while waiting:
        group_name = waiting.pop()
        group = groups.get(group_name)
        if group is None or group_name in visited:
            continue
        visited.add(group_name)
        waiting += [name_of(named) for named in group.iterfind("group")]
        found |= {name_of(joint) for joint in group.iterfind("joint")}
        found |= {name_of(above[name_of(link)]) for link in group.iterfind("link") if name_of(link) in above}
        for chain in group.iterfind("chain"):
            found |= _joints_of_chain(chain, above)
    return found


def _joints_of_chain(chain: ET.Element, above: Mapping[str, ET.Element]) -> set[str]:
    """Return the joints from a chain's tip to its base, with the joint above each link by the link's name."""
    found = set[str]()
    visited = set[str]()
    link = chain.get("tip_link", "")
    while link in above and link != chain.get("base_link") and link not in visited:
        visited.add(link)
        found.add(name_of(above[link]))
        link = link_of(above[link], "parent")
    return found


def _pairs(tree: ET.Element, carrier: dict[str, str]) -> Iterator[tuple[str, str]]:
    for pair in tree.iterfind("disable_collisions"):
        one, other = sorted(carrier.get(pair.get(key, ""), "") for key in ("link1", "link2"))
        if one and one != other:
            yield one, other


def add_filters(robot: ET.Element, semantics: Semantics) -> None:
    """Let Drake ignore collisions of pairs of links, in place: a group of each link, which ignores others."""
    groups = dict[str, ET.Element]()
    for link in sorted({link for pair in semantics.pairs for link in pair}):
        groups[link] = ET.SubElement(robot, f"{DRAKE}collision_filter_group", name=f"srdf_{link}")
        ET.SubElement(groups[link], f"{DRAKE}member", link=link)
    for one, other in sorted(semantics.pairs):
        ET.SubElement(groups[one], f"{DRAKE}ignored_collision_filter_group", name=name_of(groups[other]))


def described_by(semantics: Semantics, robot: RobotModel, report: ImportReport) -> dict[str, Any]:
    """Return what of an imported robot's file is as its SRDF has it: postures, home, fingers and tools."""
    units = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
    postures = {
        name: {joint: float(f"{value / units[joint]:.6g}") for joint, value in state.items() if joint in units}
        for name, state in semantics.states.items()
    }
    found: dict[str, Any] = {}
    if home := postures.pop(HOME_STATE, {}):
        own = robot.home_deg if isinstance(robot.home_deg, dict) else {}
        found["home_deg"] = {axis: value for axis, value in (own | home).items() if value} or 0.0
    if postures := {name: state for name, state in postures.items() if state}:
        found["postures"] = postures
    if robot.gripper is None:
        found["tools"] = {**{link: link for link in semantics.carriers}, **robot.tools}
    elif swapped := _swapped(robot.gripper.axes, postures, semantics):
        axes = {axis: (opened, closed) for axis, (closed, opened) in robot.gripper.axes.items()}
        found["gripper"] = robot.gripper.model_copy(update={"axes": axes}).model_dump(mode="json", exclude_none=True)
        report.add("repaired", "robot.yaml", f"{', '.join(swapped)} are open where the SRDF says so")
    return found


def _swapped(axes: Mapping[str, Sequence[float]], postures: _States, semantics: Semantics) -> list[str]:
    """Return the fingers that are open where they were taken to be closed."""
    opened = {
        axis: value
        for name, state in postures.items()
        for axis, value in state.items()
        if name.lower() in _OPEN and axis in semantics.hands and axis in axes
    }
    return [axis for axis, value in opened.items() if abs(value - axes[axis][0]) < abs(value - axes[axis][1])]
