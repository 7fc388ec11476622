"""Give every link and joint of a robot a name of its own.

Elements that refer to a link or a joint, such as the ends of joints, are changed with it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from simrob_drake.base.messages import message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, link_of, name_of

WORLD = "world"
"""Name of the link that every plant of Drake has. No link of a robot can have it."""

_REFER_TO_LINKS = ("parent", "child", "frame", f"{DRAKE}member")
"""Tags of elements whose attribute ``link`` names a link."""


def repair_names(robot: ET.Element, report: ImportReport) -> None:
    """Give the robot, its links and its joints names of their own, in place.

    Args:
        robot: the ``robot`` element.
        report: gets an entry for each repair.

    Raises:
        InvalidModel: two links, or two joints with the same child, have the same name and different contents.
    """
    # Blanks come first, since names that differ in blanks only are the same name.
    _strip_names(robot, report)
    # The format requires a name of the robot.
    if not name_of(robot):
        robot.set("name", report.source.stem or "robot")
        report.add(
            "repaired",
            "<robot>",
            message(
                "importer.called_after_file",
                "has no name; named '{name}' after its file",
                name=name_of(robot),
            ),
        )
    # Links get their names before joints, which are named after their links.
    _name_links(robot, report)
    free = FreeNames(names(robot, "joint"))
    for joint in robot.iterfind("joint"):
        if not name_of(joint):
            name = free.take(f"{link_of(joint, 'parent')}_to_{link_of(joint, 'child')}")
            joint.set("name", name)
            report.add(
                "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=name),
                message(
                    "importer.called_after_links", "has no name in the file; named after its links"
                ),
            )
    # All elements have a name now, so that those with equal names can be compared.
    _separate_links(robot, report)
    _separate_joints(robot, report)
    # Last, because only one link is renamed: a second definition of a link `world` must have been removed before.
    _rename_world(robot, report)


def free_name(name: str, taken: Iterable[str]) -> str:
    """Make a name that is not taken: the given name, or this name with a number."""
    return FreeNames(taken).take(name)


class FreeNames:
    """Makes names that are not taken. Each of thousands of equal names takes as little time as the first."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        """Begin with the names that are taken already."""
        self._taken = set(taken)
        # The last number that was tried for each name. Without it, each search would begin at 2 again.
        self._last_numbers: dict[str, int] = {}

    def is_free(self, name: str) -> bool:
        """Whether a name is not taken."""
        return name not in self._taken

    def take(self, base: str) -> str:
        """Return a name, or the name with the next free number, and mark it as taken."""
        name = base
        while name in self._taken:
            # The first name has no number, so the second one gets the number 2.
            number = self._last_numbers.get(base, 1) + 1
            self._last_numbers[base] = number
            name = f"{base}_{number}"
        self._taken.add(name)
        return name


def names(robot: ET.Element, tag: str) -> list[str]:
    """List the names of all links, or of all joints, in file order; ``tag`` is ``link`` or ``joint``."""
    return [name_of(element) for element in robot.iterfind(tag)]


def without_name(element: ET.Element) -> str:
    """Write the content of an element without its name, to compare elements."""
    # The order of attributes has no meaning in XML, so they are sorted.
    attributes = {key: value for key, value in element.attrib.items() if key != "name"}
    return f"{element.tag}{sorted(attributes.items())}[{','.join(_content(child) for child in element)}]"


def _content(element: ET.Element) -> str:
    """Write an element with its attributes in order, its text and its children, to compare elements."""
    text = (element.text or "").strip()
    children = ",".join(_content(child) for child in element)
    return f"{element.tag}{sorted(element.attrib.items())}{text}[{children}]"


def _strip_names(robot: ET.Element, report: ImportReport) -> None:
    """Remove blanks at both ends of names, and of references to them. Most readers of URDFs do not ignore them."""
    for element in robot.iter():
        for key in ("name", "link", "joint"):
            value = element.get(key, "")
            stripped = value.strip()
            # An element without the attribute is equal, too: the default is an empty text.
            if value == stripped:
                continue
            element.set(key, stripped)
            report.add(
                "repaired",
                f"<{element.tag}>",
                message(
                    "importer.blanks_around",
                    "{key}='{value}' has blanks at its ends; written as '{stripped}'",
                    key=key,
                    value=value,
                    stripped=stripped,
                ),
            )


def _name_links(robot: ET.Element, report: ImportReport) -> None:
    """Give names to links without a name, in place.

    A single such link gets the name of the single link that joints refer to and that is missing.
    """
    nameless = [link for link in robot.iterfind("link") if not name_of(link)]
    ends = {link_of(joint, end) for joint in robot.iterfind("joint") for end in ("parent", "child")}
    # Joints may start at the world, which is not a link of the file.
    missing = sorted(ends - set(names(robot, "link")) - {"", WORLD})
    # Names that joints refer to are taken, too: a new link must not become the end of a joint by chance.
    free = FreeNames({*names(robot, "link"), *ends})
    # If one link has no name and joints refer to one missing link, it must be this one.
    is_clear = len(nameless) == len(missing) == 1
    for index, link in enumerate(nameless):
        name = missing[0] if is_clear else free.take(f"link_{index + 1}")
        link.set("name", name)
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=name),
            message("importer.had_no_name", "has no name in the file")
            + (
                message(
                    "importer.joint_asks_for_it",
                    "; joints refer to this name, and no other link is missing",
                )
                if is_clear
                else ""
            ),
        )


def _separate_links(robot: ET.Element, report: ImportReport) -> None:
    """Remove links of the same name that are empty or equal, in place, so that one with each name is left.

    Raises:
        InvalidModel: two links have the same name and different contents.
    """
    first: dict[str, ET.Element] = {}
    for link in list(robot.iterfind("link")):
        name = name_of(link)
        # The first link of each name is remembered, and the following ones are compared with it.
        other = first.setdefault(name, link)
        if other is link:
            continue
        if len(link) and len(other) and without_name(link) != without_name(other):
            raise report.refusal(
                message("robots.link_called", "link '{link}'", link=name),
                message(
                    "importer.twice_rename_one",
                    "is defined twice with different contents; rename or remove one of them",
                ),
            )
        # One of the two may be empty: the one with more in it is kept.
        if len(link) > len(other):
            first[name] = link
            robot.remove(other)
        else:
            robot.remove(link)
        report.add(
            "dropped",
            message("robots.link_called", "link '{link}'", link=name),
            message(
                "importer.twice_left_out",
                "is defined twice; the definition that adds nothing is left out",
            ),
        )


def _separate_joints(robot: ET.Element, report: ImportReport) -> None:
    """Remove a second joint of the same name that is equal, and rename one that holds another link.

    Raises:
        InvalidModel: two joints of the same name hold the same link in different ways.
    """
    first: dict[str, ET.Element] = {}
    free = FreeNames(names(robot, "joint"))
    for joint in list(robot.iterfind("joint")):
        name = name_of(joint)
        other = first.setdefault(name, joint)
        if other is joint:
            continue
        if without_name(joint) == without_name(other):
            robot.remove(joint)
            report.add(
                "dropped",
                message("robots.joint_called", "joint '{joint}'", joint=name),
                message("importer.twice_word_for_word", "is defined twice with the same content"),
            )
        elif link_of(joint, "child") == link_of(other, "child"):
            raise report.refusal(
                message("robots.joint_called", "joint '{joint}'", joint=name),
                message(
                    "importer.twice_remove_one",
                    "is defined twice with different contents; remove one of them",
                ),
            )
        else:
            # Both joints are needed, since each holds another link.
            new = free.take(name)
            joint.set("name", new)
            first[new] = joint
            report.add(
                "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=new),
                message(
                    "importer.second_joint_called",
                    "was a second joint with the name '{name}'; references to this name mean the first one",
                    name=name,
                ),
            )


def _rename_world(robot: ET.Element, report: ImportReport) -> None:
    """Rename a link that has the name of Drake's world, in place.

    If joints start at the world and there is no such link, an empty link with the new name is added.
    """
    # Frames and collision filter groups refer to links, too.
    referring = [element for element in robot.iter() if element.tag in _REFER_TO_LINKS]
    references = [element for element in referring if element.get("link") == WORLD]
    own_link = next((link for link in robot.iterfind("link") if name_of(link) == WORLD), None)
    is_parent = any(element.tag == "parent" for element in references)
    if own_link is None and not is_parent:
        return
    new = free_name(f"robot_{WORLD}", names(robot, "link"))
    if own_link is None:
        robot.insert(0, ET.Element("link", name=new))
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=new),
            message(
                "importer.joint_starts_at_world",
                "a joint starts at '{world}', which is not a link; an empty link is added",
                world=WORLD,
            ),
        )
    else:
        own_link.set("name", new)
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=new),
            message(
                "importer.called_as_world",
                "had the name '{world}', which Drake reserves for its own link",
                world=WORLD,
            ),
        )
    for element in references:
        element.set("link", new)
