"""What readers of other formats need beyond a URDF: links between joints, a posture at home, gains of servos.

Posture and gains are noted at the joints, to go with them through the repairs, and taken off before a robot is written.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from pydrake.math import RigidTransform

from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.urdf import format_number, name_of, set_inertia

ROOT = "robot_world"  # the link that stands for the world
_SHARE = 1e-9  # of a body's mass and moments, for links between its joints: some simulators take none without
_LEAST = 1e-9  # kg, and kg m²
HOME, KP, KD = "simrob_home", "simrob_kp", "simrob_kd"
"""Attributes of a joint: where it is at home [rad or m], gains of its servo [N·m/rad, N·m·s/rad; N/m, N·s/m]."""

Notes = Mapping[str, Mapping[str, float]]  # by key and joint


def add_between(robot: ET.Element, free: FreeNames, name: str, mass: float = 1.0, moment: float = 0.01) -> str:
    """Add a link between two joints of a body, of next to no mass, and return its name.

    ``name``, mass [kg] and largest moment [kg m²] are those of the body; ``free`` gives names of links.
    """
    link = ET.SubElement(robot, "link", name=free.take(f"{name}_between"))
    moments = [_SHARE * max(moment, _LEAST)] * 3
    set_inertia(link, mass=_SHARE * max(mass, _LEAST), moments=moments, pose=RigidTransform())
    return link.get("name", "")


def add_note(joint: ET.Element, key: str, value: float) -> None:
    """Note something at a joint."""
    joint.set(key, format_number(value))


def take_notes(robot: ET.Element) -> Notes:
    """Take all notes off the joints, and return them."""
    notes: dict[str, dict[str, float]] = {key: {} for key in (HOME, KP, KD)}
    for joint in robot.iterfind("joint"):
        for key, values in notes.items():
            value = joint.attrib.pop(key, None)
            if value is not None:
                values[name_of(joint)] = float(value)
    return {key: values for key, values in notes.items() if values}
