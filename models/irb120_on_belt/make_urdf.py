"""Put the IRB 120 on the carriage of the belt: ``python models/irb120_on_belt/make_urdf.py [FOLDER]``.

The URDF is made of those of the two robots, so that all figures stand in one place; the meshes are the arm's own.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

HERE = Path(__file__).resolve().parent
BELT, ARM = HERE.parent / "belt" / "belt.urdf", HERE.parent / "irb120" / "irb120.urdf"
MOUNT = {"xyz": "0 0 0.1", "rpy": "1.5707963267948966 -1.5707963267948966 0"}
"""The arm's foot in the frame of the carriage: upright, x along the travel, as in SimRob's station."""
NOTE = "\n  Made by make_urdf.py of belt.urdf and irb120.urdf: an ABB IRB 120 on the carriage of a belt.\n"


def main(folder: Path = HERE) -> None:
    """Write the URDF into a folder beside that of the arm."""
    robot = ET.Element("robot", name="irb120_on_belt")
    robot.append(ET.Comment(NOTE))
    belt, arm = (ET.parse(file).getroot() for file in (BELT, ARM))
    robot.extend(belt)
    mount = ET.SubElement(robot, "joint", name="mount", type="fixed")
    ET.SubElement(mount, "parent", link="carriage")
    ET.SubElement(mount, "child", link="base_link")
    ET.SubElement(mount, "origin", MOUNT)
    robot.extend(arm)
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"../{ARM.parent.name}/{mesh.get('filename')}")
    ET.indent(robot)
    text = ET.tostring(robot, encoding="unicode")
    (folder / "irb120_on_belt.urdf").write_text(
        f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8"
    )


if __name__ == "__main__":
    main(*(Path(folder) for folder in sys.argv[1:]))
