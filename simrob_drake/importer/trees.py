"""Help for readers of other formats, which make a URDF from a file: links between joints, and notes at joints.

A URDF has no place for the home posture and for gains of servos. They are noted as attributes of the joints, so that
repairs of the URDF keep them with the joints, and are removed before the URDF is written.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from pydrake.math import RigidTransform

from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.urdf import format_number, name_of, set_inertia

ROOT = "robot_world"
"""Name of the link that takes the place of the world."""

_SHARE = 1e-9
"""Share of a body's mass and moments that a link between its joints gets: some simulators refuse links without mass."""

_LEAST = 1e-9
"""Least mass [kg], and least moment [kg m²], of which this share is taken."""

HOME = "simrob_home"
"""Attribute of a joint with its position in the home posture [rad or m]."""

KP = "simrob_kp"
"""Attribute of a joint with the proportional gain of its servo [N·m/rad or N/m]."""

KD = "simrob_kd"
"""Attribute of a joint with the derivative gain of its servo [N·m·s/rad or N·s/m]."""

Notes = Mapping[str, Mapping[str, float]]
"""Values by the attribute (``HOME``, ``KP`` or ``KD``), and then by the name of the joint."""


def add_between(
    robot: ET.Element, free: FreeNames, name: str, mass: float = 1.0, moment: float = 0.01
) -> str:
    """Add a link of almost no mass between two joints of a body. Several joints then move the body one after the other.

    Args:
        robot: the ``robot`` element.
        free: the names of links that are taken, to which the new one is added.
        name: name of the body.
        mass: mass of the body [kg].
        moment: largest moment of inertia of the body [kg m²].

    Returns:
        the name of the new link.
    """
    link = ET.SubElement(robot, "link", name=free.take(f"{name}_between"))
    # Equal moments about all axes, as those of a ball, are possible for a body.
    moments = [_SHARE * max(moment, _LEAST)] * 3
    # The share is so small that the body moves as before.
    set_inertia(link, mass=_SHARE * max(mass, _LEAST), moments=moments, pose=RigidTransform())
    return link.get("name", "")


def add_note(joint: ET.Element, key: str, value: float) -> None:
    """Note a value at a joint, under the attribute ``HOME``, ``KP`` or ``KD``."""
    joint.set(key, format_number(value))


def take_notes(robot: ET.Element) -> Notes:
    """Remove all notes from the joints, and return them. Attributes that no joint has are left out."""
    notes: dict[str, dict[str, float]] = {key: {} for key in (HOME, KP, KD)}
    for joint in robot.iterfind("joint"):
        for key, values in notes.items():
            # Readers of URDFs do not have these attributes, so they are removed before the file is written.
            value = joint.attrib.pop(key, None)
            if value is not None:
                values[name_of(joint)] = float(value)
    return {key: values for key, values in notes.items() if values}
