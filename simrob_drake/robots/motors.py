r"""The motors of a robot's joints as their makers publish them: what torque they have at what speed, and for how long.

All figures are of the output, behind the gear. A direct-current motor on a voltage has the torque

.. math::
    -\tau_s - D v \le \tau \le \tau_s - D v, \qquad D = \tau_s / v_0,

with the stall torque :math:`\tau_s` and the no-load speed :math:`v_0`, which both grow with the voltage. Faster than
that it brakes. Where its current is limited below that of the stall, :math:`|\tau| \le \tau_p`, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag

from simrob_drake.files import models_root
from simrob_drake.frames import Vector
from simrob_drake.sections import NotNegative, Positive, Strict, validated
from simrob_drake.yaml_files import read_yaml

MOTORS_FILE = "motors.yaml"
"""The motors that have names, in the folder of models."""
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
        share = 1.0 if self.supply is None or self.voltage is None else self.supply / self.voltage
        return share * self.stall_torque, share * self.no_load_speed


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
