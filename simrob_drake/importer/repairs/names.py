"""Every link and joint has a name of its own, and whoever names one names the same."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from simrob_drake.base.messages import message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, link_of, name_of

WORLD = "world"  # Drake's own link; no robot's link can have its name

_NAMES_A_LINK = ("parent", "child", "frame", f"{DRAKE}member")


def repair_names(robot: ET.Element, report: ImportReport) -> None:
    """Give robot, links and joints names of their own, in place; raises InvalidModel: two different links share one."""
    _strip(robot, report)
    if not name_of(robot):
        robot.set("name", report.source.stem or "robot")
        report.add(
            "repaired",
            "<robot>",
            message("importer.called_after_file", "has no name; called '{name}' after its file", name=name_of(robot)),
        )
    _name_links(robot, report)
    free = FreeNames(names(robot, "joint"))
    for joint in robot.iterfind("joint"):
        if not name_of(joint):
            name = free.take(f"{link_of(joint, 'parent')}_to_{link_of(joint, 'child')}")
            joint.set("name", name)
            report.add(
                "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=name),
                message("importer.called_after_links", "had no name; called after its links"),
            )
    _part_links(robot, report)
    _part_joints(robot, report)
    _rename_world(robot, report)


def free_name(name: str, taken: Iterable[str]) -> str:
    """Return a name that nobody has yet: the wanted one, or that with a number."""
    return FreeNames(taken).take(name)


class FreeNames:
    """Gives names that nobody has yet, thousands as quickly as one."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)
        self._numbers: dict[str, int] = {}

    def is_free(self, name: str) -> bool:
        """Check whether nobody has a name yet."""
        return name not in self._taken

    def take(self, base: str) -> str:
        """Return the wanted name, or that with a number, and keep it from others."""
        name = base
        while name in self._taken:
            number = self._numbers[base] = self._numbers.get(base, 1) + 1
            name = f"{base}_{number}"
        self._taken.add(name)
        return name


def names(robot: ET.Element, tag: str) -> list[str]:
    """Return the names of all links, or joints, in file order."""
    return [name_of(element) for element in robot.iterfind(tag)]


def without_name(element: ET.Element) -> str:
    """Return what an element holds but for its name, to compare elements by."""
    attributes = {key: value for key, value in element.attrib.items() if key != "name"}
    return f"{element.tag}{sorted(attributes.items())}[{','.join(_content(child) for child in element)}]"


def _content(element: ET.Element) -> str:
    text = (element.text or "").strip()
    children = ",".join(_content(child) for child in element)
    return f"{element.tag}{sorted(element.attrib.items())}{text}[{children}]"


def _strip(robot: ET.Element, report: ImportReport) -> None:
    """Take blanks from both ends of names, and of whatever names them: most readers would not find them again."""
    for top in (robot, *robot):
        for element in [top] if top is robot else top.iter():
            for key in ("name", "link", "joint"):
                value = element.get(key, "")
                if value != value.strip():
                    element.set(key, value.strip())
                    report.add(
                        "repaired",
                        f"<{element.tag}>",
                        message(
                            "importer.blanks_around",
                            "{key}='{value}' has blanks around it; '{stripped}'",
                            key=key,
                            value=value,
                            stripped=value.strip(),
                        ),
                    )


def _name_links(robot: ET.Element, report: ImportReport) -> None:
    nameless = [link for link in robot.iterfind("link") if not name_of(link)]
    ends = {link_of(joint, end) for joint in robot.iterfind("joint") for end in ("parent", "child")}
    missing = sorted(ends - set(names(robot, "link")) - {"", WORLD})
    free = FreeNames({*names(robot, "link"), *ends})
    for index, link in enumerate(nameless):
        sure = len(nameless) == len(missing) == 1  # then only this one can be meant
        name = missing[0] if sure else free.take(f"link_{index + 1}")
        link.set("name", name)
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=name),
            message("importer.had_no_name", "had no name")
            + (message("importer.joint_asks_for_it", "; a joint asks for one of this name") if sure else ""),
        )


def _part_links(robot: ET.Element, report: ImportReport) -> None:
    """Drop a second link of the same name where it says nothing new."""
    first: dict[str, ET.Element] = {}
    for link in list(robot.iterfind("link")):
        name = name_of(link)
        other = first.setdefault(name, link)
        if other is link:
            continue
        if len(link) and len(other) and without_name(link) != without_name(other):
            raise report.refusal(
                message("robots.link_called", "link '{link}'", link=name),
                message(
                    "importer.twice_rename_one", "stands twice with different contents; rename or remove one of them"
                ),
            )
        spare = other if len(link) > len(other) else link
        first[name] = link if spare is other else other
        robot.remove(spare)
        report.add(
            "dropped",
            message("robots.link_called", "link '{link}'", link=name),
            message("importer.twice_left_out", "stands twice; the one that says nothing new is left out"),
        )


def _part_joints(robot: ET.Element, report: ImportReport) -> None:
    """Drop a second joint that is the same, and rename one that only has the same name."""
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
                message("importer.twice_word_for_word", "stands twice, word for word"),
            )
        elif link_of(joint, "child") == link_of(other, "child"):
            raise report.refusal(
                message("robots.joint_called", "joint '{joint}'", joint=name),
                message("importer.twice_remove_one", "stands twice with different contents; remove one of them"),
            )
        else:
            new = free.take(name)
            joint.set("name", new)
            first[new] = joint
            report.add(
                "repaired",
                message("robots.joint_called", "joint '{joint}'", joint=new),
                message(
                    "importer.second_joint_called",
                    "was a second joint called '{name}'; whoever names that gets the first",
                    name=name,
                ),
            )


def _rename_world(robot: ET.Element, report: ImportReport) -> None:
    """Give a link called like Drake's world another name, and make one where a joint starts at it without it."""
    elements = [element for top in robot for element in top.iter() if element.tag in _NAMES_A_LINK]
    references = [element for element in elements if element.get("link") == WORLD]
    own = next((link for link in robot.iterfind("link") if name_of(link) == WORLD), None)
    if own is None and not any(element.tag == "parent" for element in references):
        return
    new = free_name(f"robot_{WORLD}", names(robot, "link"))
    if own is None:
        robot.insert(0, ET.Element("link", name=new))
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=new),
            message(
                "importer.joint_starts_at_world",
                "a joint starts at '{world}', which is no link; an empty one made",
                world=WORLD,
            ),
        )
    else:
        own.set("name", new)
        report.add(
            "repaired",
            message("robots.link_called", "link '{link}'", link=new),
            message("importer.called_as_world", "was called '{world}', as is Drake's own link", world=WORLD),
        )
    for element in references:
        element.set("link", new)
