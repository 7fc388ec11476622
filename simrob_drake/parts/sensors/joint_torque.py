"""Torque that each joint hands on, as sensors between gear and link tell it."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, OutputPort

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly
from simrob_drake.parts.sensors.sensor import Sensor, axis_names, sensor_label
from simrob_drake.parts.site import Site, StationRobot, Surroundings
from simrob_drake.signals import Signal, sensor_panel


class JointTorque(Sensor):
    """Torque that each joint hands on to its link, between gear and link [N·m]."""

    kind: Literal["joint_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot exists, and that the scheme tells reaction forces."""
        station.robot(self.robot, key)
        if station.scheme in ("cenic", "mujoco"):
            expected = f"left out under {station.scheme}, which tells no forces of joints; read the output torque"
            raise InvalidParameter(key, "a joint_torque sensor", expected)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``joint_torque.<sensor>`` (n) [N·m or N]."""
        robot, output = site.robot(self.robot), f"joint_torque.{name}"
        names, units = axis_names("joint_torque", name, robot.axes), robot.model.effort_units
        panel = sensor_panel(f"joint torque '{name}'", "torque", names, units)
        port = _port(builder, site, name, robot)
        site.add(output, port, Signal(names, tuple(units), "effort", output, part=name, panel=panel))


def _port(builder: DiagramBuilder, site: Site, name: str, robot: StationRobot) -> OutputPort:
    if site.station.mode == "kinematic":  # what inverse dynamics gives is what the joints hand on
        return site.outputs[f"{robot.prefix}torque"]
    block = JointTorqueSensor(joints=robot.joints, signs=robot.axis_map.signs)
    site.draw(f"sensor.{name}", "sensor", sensor_label("Joint torques", name), robot)
    return fed(builder, f"sensor.{name}", block, site.plant.plant.get_reaction_forces_output_port())


class JointTorqueSensor(Block):
    """Measure the torque about, or the force along, each joint's axis: what the joint hands on to its link.

    It is the motor's torque less the joint's own damping. Forces that act on the links from outside, such as elastic
    end stops, are no part of it.

    Ports:
        in  ``reaction_forces``: of the plant, not of one that ``cenic`` steps.
        out ``torque`` (n): [N·m], or [N] of a sliding joint.
    """

    def __init__(self, *, joints: Sequence[Joint], signs: Vector) -> None:
        """Make the block for one-axis ``joints`` whose axes count positive in the sense of ``signs`` (n,)."""
        super().__init__()
        self._joints = [
            (int(joint.index()), isinstance(joint, PrismaticJoint), sign * _axis(joint))
            for joint, sign in zip(joints, signs, strict=True)
        ]
        self._forces = self.DeclareAbstractInputPort("reaction_forces", Value[list[SpatialForce]]())
        self.DeclareVectorOutputPort("torque", len(joints), weakly(self._calc_torque))

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        forces = self._forces.Eval(context)
        for place, (index, slides, axis) in enumerate(self._joints):
            force = forces[index]
            output.SetAtIndex(place, float(axis @ (force.translational() if slides else force.rotational())))


def _axis(joint: Joint) -> Vector:
    """Return the axis in the joint's frames, where it is the same in both."""
    return np.asarray(joint.translation_axis() if isinstance(joint, PrismaticJoint) else joint.revolute_axis())
