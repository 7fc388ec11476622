"""Robots on legs, written by the tests: boxes and balls on joints."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from simrob_drake.base.folders import CACHE_VARIABLE

ABOUT = {"roll": "1 0 0", "pitch": "0 1 0", "yaw": "0 0 1"}


class Tree:
    """A URDF that grows by links."""

    def __init__(self, mass: float, size: str) -> None:
        """Begin with a trunk."""
        self.robot = ET.Element("robot", name="made")
        self.link("trunk", mass, size=size)

    def link(
        self, name: str, mass: float, *, size: str = "", radius: float = 0.0, at: str = "0 0 0"
    ) -> None:
        """Add a link with a box or a ball; with neither one that has no shape."""
        link = ET.SubElement(self.robot, "link", name=name)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=at)
        ET.SubElement(inertial, "mass", value=str(mass))
        moment = str(mass * 0.01)
        ET.SubElement(
            inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0"
        )
        if size or radius:
            shape = ET.SubElement(link, "collision")
            ET.SubElement(shape, "origin", xyz=at)
            geometry = ET.SubElement(shape, "geometry")
            ET.SubElement(geometry, "box", size=size) if size else ET.SubElement(
                geometry, "sphere", radius=str(radius)
            )

    def joint(
        self,
        name: str,
        parent: str,
        child: str,
        at: str,
        about: str,
        effort: float,
        span: float = 2.4,
    ) -> None:
        """Add a joint that turns."""
        joint = ET.SubElement(self.robot, "joint", name=name, type="revolute")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "origin", xyz=at)
        ET.SubElement(joint, "axis", xyz=ABOUT[about])
        ET.SubElement(
            joint, "limit", lower=str(-span), upper=str(span), effort=str(effort), velocity="20"
        )

    def write(self, folder: Path) -> Path:
        """Write it into a folder of its own."""
        (folder / "source").mkdir()
        file = folder / "source" / "made.urdf"
        ET.ElementTree(self.robot).write(file)
        return file


def dog(*, effort: float = 30.0, ball: bool = True, left: float = 0.2) -> Tree:
    """Return a quadruped of 8 kg whose joints say nothing of what they are."""
    tree = Tree(6.0, "0.4 0.2 0.1")
    for number, (x, y) in enumerate([(0.18, 0.1), (0.18, -0.1), (-0.18, 0.1), (-0.18, -0.1)]):
        shank = left if y > 0 else 0.2
        tree.link(f"a{number}", 0.2)
        tree.link(f"b{number}", 0.2, at="0 0 -0.1")
        tree.link(f"c{number}", 0.1, radius=0.02 if ball else 0.0, at=f"0 0 {-shank}")
        tree.joint(f"j{number}a", "trunk", f"a{number}", f"{x} {y} 0", "roll", effort, 0.8)
        tree.joint(f"j{number}b", f"a{number}", f"b{number}", f"0 {y / 5} 0", "pitch", effort)
        tree.joint(f"j{number}c", f"b{number}", f"c{number}", "0 0 -0.2", "pitch", effort)
    return tree


def biped(
    joints: tuple[str, ...] = ("yaw", "roll", "pitch", "knee", "pitch", "roll"),
    *,
    effort: float = 40.0,
) -> Tree:
    """Return a biped of 5 kg with arms and a head, whose joints say nothing of what they are."""
    tree = Tree(2.6, "0.1 0.16 0.2")
    for side, y in (("p", 0.05), ("q", -0.05)):
        parent, at = "trunk", f"0 {y} -0.1"
        for number, about in enumerate(joints):
            name, last = f"{side}{number}", number == len(joints) - 1
            tree.link(
                name,
                0.15,
                size="0.14 0.08 0.02" if last else "",
                at="0.02 0 -0.03" if last else "0 0 -0.02",
            )
            knee = about == "knee"
            tree.joint(f"{name}j", parent, name, at, "pitch" if knee else about, effort)
            parent, at = (
                name,
                "0 0 -0.15" if knee or (joints[number + 1 : number + 2] == ("knee",)) else "0 0 0",
            )
        tree.link(f"{side}arm", 0.15, size="0.03 0.03 0.2", at="0 0 -0.1")
        tree.joint(f"{side}shoulder", "trunk", f"{side}arm", f"0 {2.5 * y} 0.08", "pitch", effort)
    tree.link("skull", 0.2, radius=0.05)
    tree.joint("neck", "trunk", "skull", "0 0 0.16", "yaw", effort)
    return tree


def spider(spread: float = 0.15, *, turned: bool = False) -> Tree:
    """Return a hexapod of 3 kg whose legs lie level, left and right of its x axis, or its y axis, where all is zero."""

    def at(ahead: float, left: float) -> str:
        return f"{-left} {ahead} 0" if turned else f"{ahead} {left} 0"

    tree = Tree(2.0, "0.4 0.1 0.05" if not turned else "0.1 0.4 0.05")
    for number, (x, side) in enumerate(
        (x, side) for x in (spread, 0.0, -spread) for side in (1, -1)
    ):
        tree.link(f"a{number}", 0.05)
        tree.link(f"b{number}", 0.05, at=at(0, 0.05 * side))
        tree.link(f"c{number}", 0.05, radius=0.01, at=at(0, 0.12 * side))
        about = "pitch" if turned else "roll"
        tree.joint(f"j{number}a", "trunk", f"a{number}", at(x, 0.06 * side), "yaw", 5.0, 1.0)
        tree.joint(f"j{number}b", f"a{number}", f"b{number}", at(0, 0.02 * side), about, 5.0, 1.5)
        tree.joint(f"j{number}c", f"b{number}", f"c{number}", at(0, 0.1 * side), about, 5.0)
    return tree


def arm() -> Tree:
    """Return a single chain that leads upward."""
    tree = Tree(1.0, "0.2 0.2 0.1")
    for number, parent in enumerate(("trunk", "l0", "l1")):
        tree.link(f"l{number}", 0.2, size="0.04 0.04 0.2", at="0 0 0.1")
        tree.joint(f"j{number}", parent, f"l{number}", "0 0 0.2", "pitch", 10.0)
    return tree


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
