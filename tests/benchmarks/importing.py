"""Measure imports: speed and memory, each in a process of its own.

A robot of seven links with two meshes each, as arms are published, and a generated one of a hundred links.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import trimesh
from rich.console import Console
from rich.table import Table

from simrob_drake.base.files import models_root

LINKS = 100
ROUNDS = 3

_CHILD = """
import resource, sys, time
from pathlib import Path
began = time.perf_counter()
from simrob_drake.importer.importing import robot_from_file
loaded = time.perf_counter()
robot = robot_from_file(Path(sys.argv[1]))
ended = time.perf_counter()
peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
print(loaded - began, ended - loaded, peak / (1e6 if sys.platform == "darwin" else 1e3))
"""


def imports() -> Table:
    """Seconds of a first import, of the same again from the cache, and the peak memory of the larger process."""
    table = Table(
        "robot",
        "first [s]",
        "from the cache [s]",
        "peak memory [MB]",
        title="importing a published URDF",
    )
    for title, write in (
        (f"{LINKS} links, a mesh each", hundred_links),
        ("IRB120, 14 STL files", published_irb120),
    ):
        figures = []
        with tempfile.TemporaryDirectory() as folder:
            file = write(Path(folder) / "ros")
            for round_ in range(ROUNDS):
                cache = Path(folder) / f"cache_{round_}"
                figures.append((_measured(file, cache), _measured(file, cache)))
        first, again = (min(pair[index][1] for pair in figures) for index in (0, 1))
        peak = max(peak for pair in figures for _, _, peak in pair)
        table.add_row(title, f"{first:.2f}", f"{again:.3f}", f"{peak:.0f}")
    return table


def published_irb120(root: Path) -> Path:
    """Write the IRB120 as a ROS package: an STL file for each link's look and one for its collision shape."""
    ours, package = models_root() / "irb120", _package(root)
    robot = ET.parse(ours / "irb120.urdf").getroot()
    for transmission in robot.findall("transmission"):
        robot.remove(transmission)
    shown = {}
    for link in robot.iterfind("link"):
        meshes = [
            (visual, mesh) for visual in link.iterfind("visual") for mesh in visual.iter("mesh")
        ]
        if not meshes or len(shown) == 7:
            continue
        for visual, _ in meshes[1:]:
            link.remove(visual)
        for collision in link.findall("collision"):
            link.remove(collision)
        name, file = link.get("name", ""), ours / meshes[0][1].get("filename", "")
        shown[name] = file
        for role, element in (
            ("visual", meshes[0][0]),
            ("collision", ET.SubElement(link, "collision")),
        ):
            trimesh.load(file, force="mesh").export(package / "meshes" / f"{name}_{role}.stl")
            _show(element, f"package://arm_support/meshes/{name}_{role}.stl")
    for part in ("visual", "collision"):
        for link in robot.iterfind("link"):
            for element in link.findall(part) if link.get("name") not in shown else []:
                link.remove(element)
    return _written(robot, package)


def hundred_links(root: Path) -> Path:
    """Write a chain of many links with an STL file of 1280 faces each."""
    package = _package(root)
    robot = ET.Element("robot", name="chain")
    for index in range(LINKS):
        link = ET.SubElement(robot, "link", name=f"link_{index}")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "mass", value="1")
        moments = {
            key: "0.01" if key in ("ixx", "iyy", "izz") else "0"
            for key in ("ixx", "ixy", "ixz", "iyy", "iyz")
        }
        ET.SubElement(inertial, "inertia", moments | {"izz": "0.01"})
        ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05 + 0.0001 * index)
        ball.export(package / "meshes" / f"{index}.stl")
        for role in ("visual", "collision"):
            _show(ET.SubElement(link, role), f"package://arm_support/meshes/{index}.stl")
        if index:
            joint = ET.SubElement(robot, "joint", name=f"joint_{index}", type="continuous")
            ET.SubElement(joint, "parent", link=f"link_{index - 1}")
            ET.SubElement(joint, "child", link=f"link_{index}")
            ET.SubElement(joint, "origin", xyz="0 0 0.1")
            ET.SubElement(joint, "axis", xyz="0 1 0" if index % 2 else "1 0 0")
    return _written(robot, package)


def _package(root: Path) -> Path:
    package = root / "arm_support"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "package.xml").write_text("<package format='2'><name>arm_support</name></package>")
    return package


def _show(element: ET.Element, uri: str) -> None:
    for geometry in element.findall("geometry"):
        element.remove(geometry)
    ET.SubElement(ET.SubElement(element, "geometry"), "mesh", filename=uri)


def _written(robot: ET.Element, package: Path) -> Path:
    file = package / "urdf" / "arm.urdf"
    ET.ElementTree(robot).write(file)
    return file


def _measured(file: Path, cache: Path) -> tuple[float, float, float]:
    """Return seconds of Python's imports and of the robot's, and the peak memory [MB]."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    command = [sys.executable, "-c", _CHILD, str(file)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    modules, robot, peak = map(float, done.stdout.split())
    return modules, robot, peak


if __name__ == "__main__":
    Console().print(imports())
