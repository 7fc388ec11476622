r"""The motors of a robot's joints as their makers publish them: the torque at each speed, and for how long.

All values are those of the output, behind the gear. If a motor gives the efficiency of its gear, its torques are
those before the gear. A direct-current motor at a fixed voltage has a torque within

.. math::
    -\tau_s - D v \le \tau \le \tau_s - D v, \qquad D = \tau_s / v_0,

with the stall torque :math:`\tau_s`, the no-load speed :math:`v_0` and the speed v. Both values are in proportion to
the voltage. Above its no-load speed the motor brakes. If its current is limited, so is its torque:
:math:`|\tau| \le \tau_p`.

The voltage of a supply with the resistance R falls by :math:`R I`, where I is the motor's own current, which is in
proportion to its torque. With the stall current :math:`I_s` at the voltage U, the no-load speed stays the same and the
stall torque becomes :math:`\tau_s / (1 + R I_s / U)`.
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
from simrob_drake.base.sections import NotNegative, Number, Positive, Strict, validate_section
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.axis_map import AxisValues, every_axis
from simrob_drake.robots.urdf import (
    DRAKE,
    add_joint,
    child_of,
    copy_of,
    format_number,
    name_of,
    set_inertia,
)

MOTORS_FILE = "motors.yaml"
"""Name of the file with the motors that have names, in the folder of models."""

OF_URDF = "urdf"
"""Name of the motor whose stall torque is the URDF's effort limit, and whose no-load speed is its velocity limit."""

NO_MOTOR = "none"
"""Name under which a servo has no motor."""


class Motor(Strict):
    """A motor with its gear. Its values are those of the output, at ``voltage``. Any of them may be left out."""

    model: str | None = None
    """Name of a known motor. Values that are left out here are those of this motor."""
    source: str = ""
    """Source of the values, and which of them are estimates."""
    stall_torque: Positive | None = None
    """Torque τ_s at rest [N·m, or N for a sliding axis]."""
    no_load_speed: Positive | None = None
    """Speed v_0 at which no torque is left [rad/s or m/s]."""
    voltage: Positive | None = None
    """Voltage at which stall torque and no-load speed are given [V]."""
    supply: Positive | None = None
    """Voltage of the supply under load [V]. Stall torque and no-load speed are in proportion to it. Equal to `voltage`
    unless given."""
    stall_current: Positive | None = None
    """Current I_s at rest, at `voltage` [A]."""
    supply_resistance: NotNegative = 0.0
    """Resistance R of battery and cables [ohm]. The voltage falls by R times the motor's own current. If n motors are
    loaded at once, give n times the resistance."""
    gear_efficiency: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the torque that the gear passes on, if the torques here are those before the gear. Losses of a gear that
    is driven from its output are not modelled."""
    peak_torque: Positive | None = None
    """Torque τ_p at the largest current [N·m or N]; the stall torque unless given."""
    rated_torque: Positive | None = None
    """Torque that the motor can give continuously [N·m or N]."""
    thermal_time: Positive = 30.0
    """Thermal time constant of the motor [s]."""
    rotor_inertia: NotNegative | None = None
    """Inertia of the rotor about its own axis [kg m²]; with a gear ratio of 1, at the output. As in the robot's
    `drives`."""
    gear_ratio: Annotated[float, Field(ge=1e-6, le=1e6)] | None = None
    """Speed of the rotor divided by that of the output. As in the robot's `drives`."""
    damping: NotNegative | None = None
    """Viscous friction [N·m·s/rad]. As in the robot's `drives`."""
    friction: NotNegative | None = None
    """Coulomb friction [N·m]. As in the robot's `drives`."""
    backlash_deg: NotNegative | None = None
    """Play of the gear from end to end [deg]. As in the robot's `drives`."""
    resolution_deg: NotNegative | None = None
    """Step of the encoder [deg]. As in sensors of the kind `encoders`."""

    @property
    def line(self) -> tuple[float, float]:
        """Stall torque [N·m or N] and no-load speed [rad/s or m/s] at the voltage of the supply.

        The stall torque is the lower one to which the resistance of the supply reduces it. The efficiency of the gear
        is not in it. The motor must have both values. Without a ``supply``, they count as given at its voltage.
        """
        assert self.stall_torque is not None
        assert self.no_load_speed is not None
        # Without a voltage the values hold as they are, so any number would do for it.
        voltage = self.voltage or 1.0
        supply_share = (self.supply or voltage) / voltage

        # With the supply voltage U_s:  τ = (U_s / U) τ_s / (1 + R I_s / U)  and  v = (U_s / U) v_0. The resistance does
        # not change the no-load speed, since the motor draws no current there.
        voltage_drop_at_stall = self.supply_resistance * (self.stall_current or 0.0)
        torque_share = 1.0 / (1.0 + voltage_drop_at_stall / voltage)
        stall_torque = supply_share * torque_share * self.stall_torque
        no_load_speed = supply_share * self.no_load_speed
        return stall_torque, no_load_speed

    @property
    def at_output(self) -> "Motor":
        """A copy of the motor with its torques behind the gear, and a gear efficiency of 1."""
        # Speeds pass the gear without loss, so that only torques change.
        update: dict[str, float] = {"gear_efficiency": 1.0}
        for key in ("stall_torque", "peak_torque", "rated_torque"):
            torque = getattr(self, key)
            if torque is not None:
                update[key] = self.gear_efficiency * torque
        return self.model_copy(update=update)


class CommandBusConfig(Strict):
    """The bus over which an external computer commands the servos."""

    rate: Annotated[Number, Field(gt=0, le=10_000)] = 100.0
    """Commands per second [Hz]. A servo holds each command until the next one."""
    latency: Annotated[NotNegative, Field(le=1)] = 0.0
    """Delay of a command [s], rounded to whole samples of `rate`."""
    resolution_deg: NotNegative | None = None
    """Step between positions that can be commanded [deg, or m for a sliding axis]; 0 for no steps. The step of the
    motors' encoders unless given."""

    @property
    def delay(self) -> int:
        """Delay of a command in samples: the latency, rounded to whole samples."""
        return round(self.latency * self.rate)


def _kind(choice: Any) -> str:
    """Recognise how a user gives motors: the "name" of one, the "values" of one, or a mapping by "axes"."""
    # Pydantic would try all three in turn and report the errors of each. With a decision, it reports those of one.
    if isinstance(choice, str):
        return "name"
    if isinstance(choice, Motor):
        return "values"
    # A mapping by axes has names of axes as keys; none of them is that of a value of a motor in practice.
    keys = choice.keys() if isinstance(choice, Mapping) else ()
    has_values = any(key in Motor.model_fields for key in keys)
    return "values" if has_values else "axes"


_OneMotor = Annotated[
    Annotated[str, Tag("name")] | Annotated[Motor, Tag("values")],
    Discriminator(lambda choice: "name" if isinstance(choice, str) else "values"),
]
Motors = Annotated[
    Annotated[str, Tag("name")]
    | Annotated[Motor, Tag("values")]
    | Annotated[dict[str, _OneMotor], Tag("axes")],
    Discriminator(_kind),
]
"""One motor for all axes, or a mapping of motors by axis name or alias. A motor is given by its name or its values."""


@cache
def known_motors() -> Mapping[str, Motor]:
    """Read the motors that have names, by name."""
    # Read once: the file belongs to the package, and does not change while Python runs.
    file = models_root() / MOTORS_FILE
    return {
        name: validate_section(Motor, content, file) for name, content in read_yaml(file).items()
    }


def rated_torques(motors: Iterable[Motor | None]) -> Vector:
    """Return the rated torques of n motors, shape (n,) [N·m or N].

    The torque of an axis without a motor, or of a motor without a rated torque, is infinite.
    """
    # An infinite torque is one that no torque exceeds, so that callers need no other case.
    torques = []
    for motor in motors:
        rated = None if motor is None else motor.rated_torque
        torques.append(np.inf if rated is None else rated)
    return np.array(torques)


PLAY = "_play"
"""End of the name of the joint that models the play of a gear. It follows the name of the motor's joint."""

_GEAR_MASS = 1e-3
"""Mass of the link between a motor and a gear with play [kg]. The solver cenic accepts no body without mass."""

_GEAR_INERTIA = 1e-7
"""Moments of inertia of that link [kg m²]."""

_DriveValue = Annotated[
    AxisValues,
    every_axis(
        lambda value: 0 <= value <= 1e9,
        message("robots.not_negative_below", "it must be a number from 0 to 1e9"),
    ),
]
_Ratio = Annotated[
    AxisValues,
    every_axis(
        lambda value: 1e-6 <= value <= 1e6,
        message("robots.positive_within", "it must be a number from 1e-6 to 1e6"),
    ),
]


class Drives(Strict):
    """Motors, gears and friction of a robot's joints, for each axis. A value that is not given is that of the URDF.

    A joint has the inertia of its rotor times the square of its gear ratio. Its friction at the speed v is

        d v + c sat(v / v_s)

    which is viscous and Coulomb friction. Below the speed v_s Coulomb friction is proportional to v, so a joint that is
    held by friction alone moves slowly.
    """

    rotor_inertia: _DriveValue | None = None
    """Inertia of the motor's rotor about its own axis [kg m², or kg for a sliding axis]; `drake:rotor_inertia` of the
    URDF unless given."""
    gear_ratio: _Ratio | None = None
    """Speed of the motor divided by that of the joint; `drake:gear_ratio` of the URDF, or 1, unless given."""
    damping: _DriveValue | None = None
    """Viscous friction d at the joint [N·m·s/rad or N·s/m]; `damping` of the URDF's `dynamics` unless given."""
    friction: _DriveValue | None = None
    """Coulomb friction c at the joint [N·m or N]; `friction` of the URDF's `dynamics` unless given."""
    friction_speed: Annotated[Number, Field(ge=1e-6)] = 0.01
    """Speed v_s below which Coulomb friction is proportional to speed [rad/s or m/s]. With a tenth of the default,
    solvers with loose tolerances repeat many steps."""
    backlash_deg: _DriveValue | None = None
    """Angle by which the link can move against its motor, from end to end [deg, or m]. Its ends are stops like those of
    joints. Positions are those of the motor. Only dynamic stations have backlash, and it needs a rotor_inertia."""


def set_drives(robot: ET.Element, key: str, values: Mapping[str, float]) -> None:
    """Write one value of the drives into a checked URDF, in place.

    Args:
        robot: the URDF.
        key: ``rotor_inertia`` or ``gear_ratio``, which Drake reads from actuators; ``damping`` or ``friction``, which
            belong to the joint.
        values: the value of each joint, by the joint's name. Other joints keep theirs.
    """
    # Friction is written where a URDF has it. Drake ignores it there; a station reads it for a block of its own.
    if key in ("damping", "friction"):
        for joint in robot.iterfind("joint"):
            if name_of(joint) in values:
                child_of(joint, "dynamics").set(key, format_number(values[name_of(joint)]))
        return
    # The drive of a joint without a motor has no effect: Drake adds rotor inertia to actuators only.
    for transmission in robot.iterfind("transmission"):
        for joint in transmission.iterfind("joint"):
            if name_of(joint) in values:
                actuator = child_of(transmission, "actuator")
                child_of(actuator, f"{DRAKE}{key}").set(
                    "value", format_number(values[name_of(joint)])
                )


def add_play(robot: ET.Element, play: Mapping[str, float]) -> None:
    """Add play between motors and links to a URDF, in place.

    A joint with play becomes two joints in a row. The joint itself is that of the motor and moves a light link, the
    gear. A second joint, ``<joint>_play``, carries the original link and moves freely between two stops.

    Args:
        robot: the URDF.
        play: play from end to end, by the name of the joint [rad or m]. Joints with a play of 0 stay as they are.
    """
    # A list, since the loop adds joints to the robot while it runs.
    loose_joints = [joint for joint in robot.iterfind("joint") if play.get(name_of(joint), 0.0) > 0]
    for joint in loose_joints:
        name = name_of(joint)
        child = child_of(joint, "child")
        gear = ET.SubElement(robot, "link", name=f"{name}_gear")
        set_inertia(gear, mass=_GEAR_MASS, moments=[_GEAR_INERTIA] * 3, pose=RigidTransform())

        play_joint = add_joint(
            robot,
            name + PLAY,
            kind="prismatic" if joint.get("type") == "prismatic" else "revolute",
            pose=RigidTransform(),
            parent=name_of(gear),
            child=child.get("link", ""),
        )
        play_joint.extend(map(copy_of, joint.findall("axis")))
        # The motor's joint is in the middle of the play, so that the link can move by half of it to either side. The
        # effort of 0 and the missing transmission make the second joint passive.
        half = play[name] / 2
        ET.SubElement(
            play_joint, "limit", lower=format_number(-half), upper=format_number(half), effort="0"
        )
        # The motor's joint now carries the gear; the link that it carried before hangs on the second joint.
        child.set("link", name_of(gear))


class Gains(Strict):
    """Servo gains and motors in a robot's file. A station may set others."""

    kp: AxisValues | None = None
    """Proportional gain [N·m/rad, or N/m of a prismatic axis]."""
    ki: AxisValues | None = None
    """Integral gain [N·m/(rad·s) or N/(m·s)]."""
    kd: AxisValues | None = None
    """Derivative gain [N·m·s/rad or N·s/m]."""
    motor: Motors | None = None
    """Motors of the joints, as in a station's `servo`."""
    passive: list[str] | None = None
    """Axes without a motor, which move freely; the axes whose joints have no motor in the URDF unless given."""
    torque_limit: AxisValues | None = None
    """Largest torque or force of the motor [N·m or N]; the effort limit of the URDF unless given."""
