"""The drives of a robot's joints, and what a URDF says of them: rotors, gears and their play, friction."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Annotated

from pydantic import Field
from pydrake.math import RigidTransform

from simrob_drake.robots.axis_map import AxisValues, every_axis
from simrob_drake.robots.urdf import DRAKE, add_joint, child_of, copied, name_of, set_inertia, written
from simrob_drake.sections import Number, Strict

PLAY = "_play"
"""How the joints end, after the names of their motors' sides, between which links are free."""
_GEAR_MASS, _GEAR_INERTIA = 1e-3, 1e-7  # kg, kg m²: cenic takes no body without any

_Figure = Annotated[AxisValues, every_axis(lambda value: 0 <= value <= 1e9, "it is not negative, and at most 1e9")]
_Ratio = Annotated[AxisValues, every_axis(lambda value: 1e-6 <= value <= 1e6, "it is positive, of 1e-6 to 1e6")]


class Drives(Strict):
    """Motors, gears and friction of a robot's joints, per axis. What is not given comes from its URDF.

    A joint feels the inertia of its rotor times the square of its gear ratio. Friction is d v + c sat(v / v_s), viscous
    and Coulomb's: below the speed v_s the second is proportional to v, so what it holds creeps.
    """

    rotor_inertia: _Figure | None = None
    """Of the motor, about its own axis [kg m²; kg of one that slides]; `drake:rotor_inertia` of a URDF."""
    gear_ratio: _Ratio | None = None
    """Speed of the motor over that of the joint; `drake:gear_ratio` of a URDF, or 1."""
    damping: _Figure | None = None
    """Viscous friction d at the joint [N·m·s/rad or N·s/m]; `damping` of a URDF's `dynamics`."""
    friction: _Figure | None = None
    """Coulomb friction c at the joint [N·m or N]; `friction` of a URDF's `dynamics`."""
    friction_speed: Annotated[Number, Field(ge=1e-6)] = 0.01
    """v_s, below which Coulomb friction is proportional to speed [rad/s or m/s]; solvers that step loosely trip over a
    tenth of it."""
    backlash_deg: _Figure | None = None
    """How far the link is free against its motor in all, between stops as those of joints [deg, or m]; positions are
    those of the motor. Dynamic stations alone know it, and it needs a rotor_inertia."""


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


def add_play(robot: ET.Element, play: Mapping[str, float]) -> None:
    """Let links move freely against the motors of their joints, by ``play`` in all [rad or m], in place.

    The joint itself is the motor's side, its link a gear of a gram; ``<joint>_play`` follows, between its stops.
    """
    for joint in [joint for joint in robot.iterfind("joint") if play.get(name_of(joint), 0.0) > 0]:
        name, child = name_of(joint), child_of(joint, "child")
        gear, half = ET.SubElement(robot, "link", name=f"{name}_gear"), play[name] / 2
        set_inertia(gear, mass=_GEAR_MASS, moments=[_GEAR_INERTIA] * 3, pose=RigidTransform())
        ends = {"parent": name_of(gear), "child": child.get("link", "")}
        kind = "prismatic" if joint.get("type") == "prismatic" else "revolute"
        loose = add_joint(robot, name + PLAY, kind=kind, pose=RigidTransform(), **ends)
        loose.extend(map(copied, joint.findall("axis")))
        ET.SubElement(loose, "limit", lower=written(-half), upper=written(half), effort="0")
        child.set("link", name_of(gear))


def joint_friction(joint: ET.Element) -> float:
    """Return a joint's Coulomb friction [N·m or N]; 0 where the URDF gives none."""
    dynamics = joint.find("dynamics")
    return 0.0 if dynamics is None else float(dynamics.get("friction", 0))
