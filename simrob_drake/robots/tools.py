"""Where a robot of which only the URDF is known carries its tools: the ends of its chains."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.urdf import MOVABLE_JOINTS, joints_at, link_of, outward, root_link

_USUAL = re.compile(r"tool|tcp|flange|end_?effector|(^|_)ee(_|f?$)|tip|grasp", re.IGNORECASE)
"""Names that published robots give to the place of the tool."""


def tool_links(root: ET.Element) -> list[str]:
    """Return the links of a robot, at least one joint of which moves, that can carry a tool, the likeliest first.

    These are the ends of the kinematic chains: of every chain the link with a usual name (``tool0``, ``tcp`` ...) that
    is rigidly attached to its last moving link, else the outermost such link. Chains whose end has a usual name come
    first, then those with more joints, then file order.
    """
    carrier, starts = carriers(root), joints_at(root)
    moving = [joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    inner = {carrier[link_of(joint, "parent")] for joint in moving}
    counts = {root_link(root): 0}  # of the joints that move each link
    for joint in outward(starts, root_link(root)):
        counts[link_of(joint, "child")] = counts[link_of(joint, "parent")] + (joint.get("type") in MOVABLE_JOINTS)
    ends = []
    for end in [link_of(joint, "child") for joint in moving]:
        if end not in inner:
            attached = [end, *(link_of(joint, "child") for joint in outward(starts, end, rigid=True))]
            usual = [link for link in attached if _USUAL.search(link)]
            ends.append((not usual, -counts[end], (usual or attached)[-1]))
    return [tool for _, _, tool in sorted(ends, key=lambda end: end[:2])]
