"""Links that are rigidly joined are one body: which links those are, and who carries them."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from simrob_drake.robots.urdf import MOVABLE_JOINTS, link_of, mass_of, name_of, root_link


def carriers(robot: ET.Element) -> dict[str, str]:
    """Return, by link, the link that carries its body: the first one on the way to the root that a joint moves."""
    fixed = {link_of(j, "child"): link_of(j, "parent") for j in robot.iterfind("joint") if j.get("type") == "fixed"}
    found: dict[str, str] = {}
    for link in (name_of(element) for element in robot.iterfind("link")):
        way = [link]
        while way[-1] in fixed and way[-1] not in found:
            way.append(fixed[way[-1]])
        found.update(dict.fromkeys(way, found.get(way[-1], way[-1])))
    return found


def bodies(robot: ET.Element) -> dict[str, list[ET.Element]]:
    """Return, by the link that carries it, the links of each body."""
    carrier, found = carriers(robot), dict[str, list[ET.Element]]()
    for link in robot.iterfind("link"):
        found.setdefault(carrier[name_of(link)], []).append(link)
    return found


def links_without_inertia(robot: ET.Element, *, floating: bool = False) -> list[str]:
    """Return the links that move but carry no mass, nor anything with mass rigidly attached: no dynamics for them.

    Args:
        robot: the ``robot`` element.
        floating: the root link moves, too.
    """
    weightless = {link for link, parts in bodies(robot).items() if not any(mass_of(part) > 0 for part in parts)}
    moved = {link_of(j, "child") for j in robot.iterfind("joint") if j.get("type") in MOVABLE_JOINTS}
    if floating:
        moved.add(root_link(robot))
    return [name for name in map(name_of, robot.iterfind("link")) if name in moved & weightless]
