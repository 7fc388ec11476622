"""Put a gripper of two fingers on the IRB 120: ``python models/irb120_gripper/make_urdf.py [FOLDER]``.

The URDF is made of the arm's own, so that its figures stand in one place. Stroke, force, speed and mass are of the size
of a Robotiq Hand-E (its instruction manual names 130 N; the others are estimates); the shapes are plain boxes.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

HERE = Path(__file__).resolve().parent
ARM = HERE.parent / "irb120" / "irb120.urdf"
PALM = (0.075, 0.09, 0.095)
"""Of the housing [m]; the last from the flange outward."""
FINGER, PAD = (0.022, 0.012, 0.05), (0.018, 0.004, 0.022)
STROKE, FORCE, SPEED = 0.025, 130.0, 0.15
"""Of each finger [m, N, m/s]."""
PALM_MASS, FINGER_MASS = 0.9, 0.05  # kg
NOTE = "\n  Made by make_urdf.py of irb120.urdf: an ABB IRB 120 with a gripper of two fingers.\n"


def box(
    link: ET.Element,
    size: tuple[float, ...],
    place: tuple[float, ...],
    colour: str,
    *,
    collides: bool,
) -> None:
    """Add a box to a link."""
    for tag in ("visual", "collision") if collides else ("visual",):
        shape = ET.SubElement(link, tag)
        ET.SubElement(shape, "origin", xyz=" ".join(f"{value:.6g}" for value in place))
        ET.SubElement(
            ET.SubElement(shape, "geometry"), "box", size=" ".join(f"{value:g}" for value in size)
        )
        if tag == "visual":
            ET.SubElement(shape, "material", name=colour)


def inertial(link: ET.Element, mass: float, size: tuple[float, ...], z: float) -> None:
    """Give a link the inertia of a solid box about its middle, z [m] out on its axis."""
    own = ET.SubElement(link, "inertial")
    ET.SubElement(own, "origin", xyz=f"0 0 {z:g}")
    ET.SubElement(own, "mass", value=f"{mass:g}")
    x, y, depth = (side**2 for side in size)
    moments = {"ixx": y + depth, "iyy": x + depth, "izz": x + y}
    figures = {key: f"{mass * value / 12:.6g}" for key, value in moments.items()}
    ET.SubElement(own, "inertia", {**figures, "ixy": "0", "ixz": "0", "iyz": "0"})


def joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, **parts: dict[str, str]
) -> None:
    """Add a joint with its further elements."""
    made = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(made, "parent", link=parent)
    ET.SubElement(made, "child", link=child)
    for tag, attributes in parts.items():
        ET.SubElement(made, tag, attributes)


def finger(robot: ET.Element, side: str, sign: int) -> None:
    """Add a finger that slides to its side; closed, the pads touch."""
    link = ET.SubElement(robot, "link", name=f"{side}_finger")
    box(link, FINGER, (0, sign * (PAD[1] + FINGER[1] / 2), FINGER[2] / 2), "steel", collides=True)
    box(link, PAD, (0, sign * PAD[1] / 2, FINGER[2] - PAD[2] / 2), "graphite", collides=True)
    inertial(link, FINGER_MASS, FINGER, FINGER[2] / 2)
    limit = {"lower": "0", "upper": f"{STROKE:g}", "effort": f"{FORCE:g}", "velocity": f"{SPEED:g}"}
    start, along = {"xyz": f"0 0 {PALM[2]:g}"}, {"xyz": f"0 {sign} 0"}
    joint(
        robot,
        f"{side}_finger",
        "prismatic",
        "palm",
        f"{side}_finger",
        origin=start,
        axis=along,
        limit=limit,
    )
    motor = ET.SubElement(robot, "transmission", name=f"transmission_{side}_finger")
    ET.SubElement(motor, "type").text = "transmission_interface/SimpleTransmission"
    ET.SubElement(motor, "joint", name=f"{side}_finger")
    ET.SubElement(motor, "actuator", name=f"motor_{side}_finger")


def main(folder: Path = HERE) -> None:
    """Write the URDF into a folder beside that of the arm."""
    robot = ET.parse(ARM).getroot()
    robot.set("name", "irb120_gripper")
    robot.insert(0, ET.Comment(NOTE))
    palm = ET.SubElement(robot, "link", name="palm")
    box(palm, PALM, (0, 0, PALM[2] / 2), "graphite", collides=True)
    inertial(palm, PALM_MASS, PALM, PALM[2] / 2)
    joint(robot, "mount", "fixed", "tool0", "palm")
    for side, sign in (("left", 1), ("right", -1)):
        finger(robot, side, sign)
    ET.SubElement(robot, "link", name="grasp")
    joint(
        robot,
        "grasp",
        "fixed",
        "palm",
        "grasp",
        origin={"xyz": f"0 0 {PALM[2] + FINGER[2] - PAD[2] / 2:g}"},
    )
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"../{ARM.parent.name}/{mesh.get('filename')}")
    ET.indent(robot)
    text = ET.tostring(robot, encoding="unicode")
    (folder / "irb120_gripper.urdf").write_text(
        f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8"
    )


if __name__ == "__main__":
    main(*(Path(folder) for folder in sys.argv[1:]))
