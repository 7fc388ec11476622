"""Sensor of the mechanical power of a robot's joints."""

from typing import Literal

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.base.frames import Vector
from simrob_drake.base.signals import Signal, sensor_panel
from simrob_drake.blocks.block import Block
from simrob_drake.parts.sensors.sensor import Sensor, axis_names, sensor_label
from simrob_drake.parts.site import Site


class JointPower(Sensor):
    """Mechanical power that each motor gives to its joint [W]; negative while the motor brakes."""

    kind: Literal["joint_power"]
    robot: str | None = None
    """Robot whose joints are measured; the only robot of the station unless given."""

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add the block and declare its output ``joint_power.<sensor>`` (n) [W]."""
        robot = site.robot(self.robot)
        block = builder.AddNamedSystem(f"sensor.{name}", PowerOfJoints(len(robot.axes)))
        builder.Connect(site.port(builder, f"{robot.prefix}torque"), block.GetInputPort("torque"))
        builder.Connect(
            site.port(builder, f"{robot.prefix}velocity"), block.GetInputPort("velocity")
        )

        # One declaration for the columns of results, the plot and the block picture.
        output = f"joint_power.{name}"
        columns = axis_names("joint_power", name, robot.axes)
        units = ("W",) * len(robot.axes)
        panel = sensor_panel(f"joint power '{name}'", "power", columns)
        signal = Signal(columns, units, "effort", output, part=name, panel=panel)
        site.outputs.add(output, block.GetOutputPort("power"), signal)
        site.picture.draw(f"sensor.{name}", "sensor", sensor_label("Joint power", name), robot)


class PowerOfJoints(Block):
    r"""Multiply the torque of each joint by its speed: :math:`P_i = \tau_i \, \dot q_i`.

    Ports:
        in  ``torque`` (n) [N·m], ``velocity`` (n) [rad/s].
        out ``power`` (n) [W].
    """

    def __init__(self, size: int) -> None:
        """Make the block for ``size`` joints."""
        super().__init__()
        self._torque = self.DeclareVectorInputPort("torque", size)
        self._velocity = self.DeclareVectorInputPort("velocity", size)
        self.DeclareVectorOutputPort("power", size, self._calc_power)

    def _calc_power(self, context: Context, power: Vector) -> None:
        """Compute the power of each joint."""
        torque = self._torque.Eval(context)
        velocity = self._velocity.Eval(context)
        power.SetFromVector(np.multiply(torque, velocity))
