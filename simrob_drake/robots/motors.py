r"""The motors of a robot's joints as their makers publish them: what torque they have at what speed, and for how long.

All figures are of the output, behind the gear, unless its efficiency is told: torques are then before it. A
direct-current motor on a voltage has the torque

.. math::
    -\tau_s - D v \le \tau \le \tau_s - D v, \qquad D = \tau_s / v_0,

with the stall torque :math:`\tau_s` and the no-load speed :math:`v_0`, which both grow with the voltage. Faster than
that it brakes. Where its current is limited below that of the stall, :math:`|\tau| \le \tau_p`, too.

A supply of resistance R falls by :math:`R I` with the motor's own current, which is in proportion to its torque. With
the current :math:`I_s` at the stall on the voltage U, that leaves the no-load speed, and of the stall torque
:math:`\tau_s / (1 + R I_s / U)`.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag
from pydrake.math import RigidTransform

from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive, Strict, validated
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.axis_map import AxisValues, every_axis
from simrob_drake.robots.urdf import DRAKE, add_joint, child_of, copied, name_of, set_inertia, written

MOTORS_FILE = "motors.yaml"  # the motors that have names, in the folder of models
OF_URDF, NO_MOTOR = "urdf", "none"
"""A motor with the URDF's effort as stall torque and its velocity as no-load speed; and a servo without a motor."""


class Motor(Strict):
    """A motor with its gear; figures of its output, at ``voltage``. Those that are left out are not known."""

    model: str | None = None
    """A motor by name, whose figures hold where no others are given."""
    source: str = ""
    """Where the figures are from, and which are estimates."""
    stall_torque: Positive | None = None
    """τ_s, at rest [N·m, or N of an axis that slides]."""
    no_load_speed: Positive | None = None
    """v_0, at which none is left [rad/s or m/s]."""
    voltage: Positive | None = None
    """At which these two hold [V]."""
    supply: Positive | None = None
    """What it is supplied with under load [V]: both grow with it. As `voltage` unless given."""
    stall_current: Positive | None = None
    """I_s, at rest on `voltage` [A]."""
    supply_resistance: NotNegative = 0.0
    """R of battery and cables, by which the supply falls with the motor's own current [ohm]; n times as much where n
    motors pull at once."""
    gear_efficiency: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Part of the torque that the gear hands on, where the torques here are before it; losses are not in reverse."""
    peak_torque: Positive | None = None
    """τ_p, by its current [N·m or N]; the stall torque unless given."""
    rated_torque: Positive | None = None
    """What it may give forever [N·m or N]."""
    thermal_time: Positive = 30.0
    """Time constant with which it gets warm [s]."""
    rotor_inertia: NotNegative | None = None
    """Of the rotor, about its own axis [kg m²]; where gear_ratio is 1, at the output. Of the robot's `drives`."""
    gear_ratio: Annotated[float, Field(ge=1e-6, le=1e6)] | None = None
    """Speed of the rotor over that of the output. Of the robot's `drives`."""
    damping: NotNegative | None = None
    """Viscous friction [N·m·s/rad]. Of the robot's `drives`."""
    friction: NotNegative | None = None
    """Coulomb friction [N·m]. Of the robot's `drives`."""
    backlash_deg: NotNegative | None = None
    """Play of the gear in all [deg]. Of the robot's `drives`."""
    resolution_deg: NotNegative | None = None
    """Step of its encoder [deg]. Of sensors `encoders`."""

    @property
    def line(self) -> tuple[float, float]:
        """The stall torque [N·m] and the no-load speed [rad/s] on its supply."""
        assert self.stall_torque is not None
        assert self.no_load_speed is not None
        voltage = self.voltage or 1.0
        share = (self.supply or voltage) / voltage
        left = 1.0 / (1.0 + self.supply_resistance * (self.stall_current or 0.0) / voltage)
        return share * left * self.stall_torque, share * self.no_load_speed

    @property
    def at_output(self) -> "Motor":
        """The same motor, its torques behind its gear."""
        torques = {key: getattr(self, key) for key in ("stall_torque", "peak_torque", "rated_torque")}
        own = {key: self.gear_efficiency * value for key, value in torques.items() if value is not None}
        return self.model_copy(update={**own, "gear_efficiency": 1.0})


class CommandBusConfig(Strict):
    """The bus over which servos get their commands, from without."""

    rate: Annotated[Number, Field(gt=0, le=10_000)] = 100.0
    """How often they get one [Hz]; they hold it in between."""
    latency: Annotated[NotNegative, Field(le=1)] = 0.0
    """How late it is [s], to the nearest of these samples."""
    resolution_deg: NotNegative | None = None
    """Step from one position that can be commanded to the next [deg, or m where an axis slides]; 0 for none. That of
    the motors' encoders unless given."""

    @property
    def delay(self) -> int:
        """Samples by which commands are late: the latency, rounded to whole samples."""
        return round(self.latency * self.rate)


def _kind(choice: Any) -> str:
    if isinstance(choice, str):
        return "name"
    keys = choice.keys() if isinstance(choice, Mapping) else ()
    return "figures" if isinstance(choice, Motor) or any(key in Motor.model_fields for key in keys) else "axes"


_OneMotor = Annotated[
    Annotated[str, Tag("name")] | Annotated[Motor, Tag("figures")],
    Discriminator(lambda choice: "name" if isinstance(choice, str) else "figures"),
]
Motors = Annotated[
    Annotated[str, Tag("name")] | Annotated[Motor, Tag("figures")] | Annotated[dict[str, _OneMotor], Tag("axes")],
    Discriminator(_kind),
]
"""A motor for all axes, by name or by its figures, or a mapping of such by axis name or alias."""


@cache
def known_motors() -> Mapping[str, Motor]:
    """Return the motors that have names."""
    file = models_root() / MOTORS_FILE
    return {name: validated(Motor, content, file) for name, content in read_yaml(file).items()}


def rated_torques(motors: Iterable[Motor | None]) -> Vector:
    """Return what n motors may give forever, shape (n,) [N·m or N]; infinite where nothing is told."""
    return np.array([np.inf if motor is None else motor.rated_torque or np.inf for motor in motors])


PLAY = "_play"  # how the joints end, after the names of their motors' sides, between which links are free
_GEAR_MASS, _GEAR_INERTIA = 1e-3, 1e-7  # kg, kg m²: cenic takes no body without any

_Figure = Annotated[
    AxisValues,
    every_axis(
        lambda value: 0 <= value <= 1e9, message("robots.not_negative_below", "it is not negative, and at most 1e9")
    ),
]
_Ratio = Annotated[
    AxisValues,
    every_axis(lambda value: 1e-6 <= value <= 1e6, message("robots.positive_within", "it is positive, of 1e-6 to 1e6")),
]


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


class Gains(Strict):
    """Servo gains that a robot brings along; a station may set others."""

    kp: AxisValues | None = None
    """Proportional gain [N·m/rad, or N/m of a prismatic axis]."""
    ki: AxisValues | None = None
    """Integral gain [N·m/(rad·s) or N/(m·s)]."""
    kd: AxisValues | None = None
    """Derivative gain [N·m·s/rad or N·s/m]."""
    motor: Motors | None = None
    """Its motors, as in a station's `servo`."""
    passive: list[str] | None = None
    """Axes without a motor, which move freely; those whose joints have no motor in the URDF unless given."""
    torque_limit: AxisValues | None = None
    """Largest torque or force of the motor [N·m or N]; the effort limit of the URDF unless given."""
