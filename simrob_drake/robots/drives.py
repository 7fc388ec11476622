"""What stands in a URDF about the drives of its joints: rotors, gears, viscous and Coulomb friction."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from simrob_drake.robots.urdf import DRAKE, name_of
from simrob_drake.robots.urdf_elements import child_of, written


def set_drives(robot: ET.Element, key: str, values: Mapping[str, float]) -> None:
    """Write figures of drives into a checked URDF, by joint.

    They are ``rotor_inertia`` or ``gear_ratio``, which Drake reads in actuators, ``damping`` or ``friction``.
    """
    if key in ("damping", "friction"):
        for joint in robot.iterfind("joint"):
            if name_of(joint) in values:
                child_of(joint, "dynamics").set(key, written(values[name_of(joint)]))
        return
    for drive in robot.iterfind("transmission"):
        for driven in drive.iterfind("joint"):
            if name_of(driven) in values:
                gear = child_of(child_of(drive, "actuator"), f"{DRAKE}{key}")
                gear.set("value", written(values[name_of(driven)]))


def joint_friction(joint: ET.Element) -> float:
    """Return a joint's Coulomb friction [N·m or N]; 0 where the URDF gives none."""
    dynamics = joint.find("dynamics")
    return 0.0 if dynamics is None else float(dynamics.get("friction", 0))
