"""Where a robot of which only the URDF is known carries its tools."""

import xml.etree.ElementTree as ET

import pytest

from simrob_drake.robots.bodies import tool_links


def robot(*joints: str) -> ET.Element:
    """Return a robot of joints written as ``parent > child``, or ``parent - child`` for a fixed one."""
    root = ET.Element("robot", name="r")
    links: list[str] = []
    for number, text in enumerate(joints):
        parent, kind, child = text.split()
        links += [name for name in (parent, child) if name not in links]
        joint = ET.SubElement(
            root, "joint", name=f"j{number}", type="fixed" if kind == "-" else "revolute"
        )
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
    for link in links:
        ET.SubElement(root, "link", name=link)
    return root


@pytest.mark.parametrize(
    ("joints", "tools"),
    [
        (["base > a", "a > b"], ["b"]),
        (["base - frame", "base > a", "a - flange", "flange - tool0"], ["tool0"]),
        (["base > a", "a - tool0", "tool0 - camera"], ["tool0"]),
        (["base > a", "a - cover"], ["cover"]),
        (["base > left", "base > arm", "arm > hand"], ["hand", "left"]),
        (["base > arm", "arm > finger", "base > wrist", "wrist - tcp"], ["tcp", "finger"]),
    ],
)
def test_tools_are_the_ends_of_chains_the_likeliest_first(joints, tools):
    assert tool_links(robot(*joints)) == tools
