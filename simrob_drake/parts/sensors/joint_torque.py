"""Torque that each joint hands on."""

from typing import Literal

from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.blocks.joint_torque_sensor import JointTorqueSensor
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
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
