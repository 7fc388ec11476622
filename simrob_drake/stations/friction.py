"""Wire the Coulomb friction of a station's robots, as its solver can take it."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Saturation

from simrob_drake.blocks.wiring import fed, mapped, summed
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.ports import StationPorts


def wire_friction(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Let the actuators that stand for friction want their joints to rest; under ``cenic`` add blocks in their place.

    Actuators of ``cenic`` hold one torque a joint, the motor's. It linearises other forces at the start of a step h,
    and friction that turns a joint's motion around within a step would do so for ever: there v_s is at least c h / M,
    M being the inertia that the axis feels alone.
    """
    config, plant = ports.config, ports.plant.plant
    for robot in ports.plant.robots.values():
        friction = robot.model.friction
        if not friction.any():
            continue
        if config.solver.scheme == "cenic":
            speed = np.maximum(
                robot.model.drives.friction_speed, friction * config.solver.max_step / robot.free_inertias()
            )
            sliding = _sliding(builder, ports, robot, speed)
            spread = -robot.axis_map.velocity_matrix.T
            ports.generalized_forces.append(mapped(builder, f"{robot.prefix}friction.force", spread, sliding))
        elif config.servo_of(robot.name).realization != "implicit":
            rest = plant.get_desired_state_input_port(robot.instance)
            builder.Connect(fed(builder, f"{robot.prefix}rest", ConstantVectorSource(np.zeros(rest.size()))), rest)
            ports.draw_nothing(f"{robot.prefix}rest")


def with_friction(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, torque: OutputPort) -> OutputPort:
    """Return torques (n,) [N·m or N] without friction, with what the motors give against that."""
    if not robot.model.friction.any():
        return torque
    sliding = _sliding(builder, ports, robot, np.full(len(robot.axes), robot.model.drives.friction_speed))
    return summed(builder, f"{robot.prefix}friction.torque", torque, sliding)


def _sliding(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, speed: Vector) -> OutputPort:
    """Add c sat(v / v_s), size n, of the plant's state."""
    name, friction = f"{robot.prefix}friction", robot.model.friction
    ports.draw(name, "force", f"Friction\nof {robot.model.name}", robot)
    slope = (friction / speed)[:, np.newaxis] * robot.axis_map.state_matrix[len(friction) :]
    return fed(builder, name, Saturation(-friction, friction), mapped(builder, f"{name}.slope", slope, ports.state))
