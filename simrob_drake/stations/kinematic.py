"""Wire a kinematic station: motion is the input, and the torque that it takes is computed."""

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.blocks.events import SteadySteps
from simrob_drake.blocks.wiring import joined, mapped
from simrob_drake.parts.site import StationPlant
from simrob_drake.stations.contact import with_friction
from simrob_drake.stations.dynamic import add_motion, declare_torque
from simrob_drake.stations.ports import StationPorts

STEP = 0.01
"""How often monitors look [s]: nothing is integrated here, so a simulator would go to the end in one step."""

_MOTION = ("reference", "reference_velocity", "reference_acceleration")


def add_motion_inputs(builder: DiagramBuilder, plant: StationPlant) -> tuple[dict[str, InputPort], OutputPort]:
    """Add inputs of position, velocity and acceleration for every robot.

    Returns:
        the inputs, each of whose blocks hands it on, and the state of the whole plant that they make.
    """
    inputs: dict[str, InputPort] = {}
    motions: list[OutputPort] = []
    for robot in plant.robots.values():
        for signal in _MOTION:
            block = builder.AddNamedSystem(f"{robot.prefix}{signal}", PassThrough(len(robot.joints)))
            inputs[f"{robot.prefix}{signal}"] = block.get_input_port()
            motions += [] if signal == _MOTION[-1] else [block.get_output_port()]
    spread = np.hstack([robot.axis_map.state_matrix.T for robot in plant.robots.values()])
    return inputs, mapped(builder, "multibody_state", spread, joined(builder, "motions", *motions))


def add_kinematic_robots(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the outputs of every robot, inverse dynamics, and geometry poses.

    The plant itself stands outside of the diagram: it is registered with the scene graph and never stepped.
    """
    for robot in ports.plant.robots.values():
        sources = {signal: ports.inputs[f"{robot.prefix}{signal}"].get_system() for signal in _MOTION}
        position, velocity = (sources[signal].get_output_port() for signal in _MOTION[:2])
        add_motion(ports, robot, position, position, velocity)
    force = _generalized_forces(builder, ports)
    for robot in ports.plant.robots.values():
        torque = mapped(builder, f"{robot.prefix}torque", robot.axis_map.velocity_matrix, force)
        declare_torque(ports, robot, with_friction(builder, ports, robot, torque))
    builder.Connect(ports.state, ports.plant.add_geometry_poses(builder, of_state=True))
    builder.AddNamedSystem("steady_steps", SteadySteps(STEP))


def _generalized_forces(builder: DiagramBuilder, ports: StationPorts) -> OutputPort:
    """Compute the generalized forces (nv) of the motion, without contacts, by inverse dynamics."""
    robots = ports.plant.robots.values()
    dynamics = InverseDynamics(ports.plant.plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics)
    builder.AddNamedSystem("inverse_dynamics", dynamics)
    builder.Connect(ports.state, dynamics.get_input_port_estimated_state())
    accelerations = [ports.inputs[f"{robot.prefix}{_MOTION[-1]}"].get_system().get_output_port() for robot in robots]
    spread = np.hstack([robot.axis_map.velocity_matrix.T for robot in robots])
    desired = mapped(builder, "accelerations", spread, joined(builder, "robot_accelerations", *accelerations))
    builder.Connect(desired, dynamics.get_input_port_desired_acceleration())
    return dynamics.get_output_port_generalized_force()
