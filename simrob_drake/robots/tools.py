"""Where a robot of which only the URDF is known carries its tools: the ends of its chains."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from simrob_drake.robots.urdf import MOVABLE_JOINTS, link_of, name_of

_USUAL = re.compile(r"tool|tcp|flange|end_?effector|(^|_)ee(_|f?$)|tip|grasp", re.IGNORECASE)
"""Names that published robots give to the place of the tool."""


def tool_links(root: ET.Element) -> list[str]:
    """Return the links that can carry a tool, the likeliest first.

    These are the ends of the kinematic chains: of every chain the link with a usual name (``tool0``, ``tcp`` ...) that
    is rigidly attached to its last moving link, else the outermost such link. Chains whose end has a usual name come
    first, then those with more joints, then file order.

    Args:
        root: the ``robot`` element, with at least one joint that moves.
    """
    ends = []
    for end, joints in _chain_ends(root):
        attached = _rigidly_attached(root, end)
        usual = [link for link in attached if _USUAL.search(link)]
        ends.append((not usual, -joints, (usual or attached)[-1]))
    return [tool for _, _, tool in sorted(ends, key=lambda end: end[:2])]


def _chain_ends(root: ET.Element) -> list[tuple[str, int]]:
    """Return each last moving link, in file order, with the number of joints that move it."""
    joint_of = {link_of(joint, "child"): joint for joint in root.iterfind("joint")}
    moved = [link for link, joint in joint_of.items() if joint.get("type") in MOVABLE_JOINTS]
    counts: dict[str, int] = {}
    inner: set[str] = set()
    for link in moved:
        joint, carriers = joint_of[link], []
        while True:
            parent = link_of(joint, "parent")
            if joint.get("type") in MOVABLE_JOINTS:
                carriers.append(link_of(joint, "child"))
            if parent not in joint_of:
                break
            joint = joint_of[parent]
        counts[link] = len(carriers)
        inner.update(carriers[1:])
    return [(link, counts[link]) for link in moved if link not in inner]


def _rigidly_attached(root: ET.Element, link: str) -> list[str]:
    """Return a link and what is fixed to it, in the order from the inside to the outside."""
    links = [link]
    for carrier in links:
        fixed = [j for j in root.iterfind("joint") if link_of(j, "parent") == carrier and j.get("type") == "fixed"]
        links += [link_of(joint, "child") for joint in fixed]
    return [name for name in links if name in {name_of(element) for element in root.iterfind("link")}]
