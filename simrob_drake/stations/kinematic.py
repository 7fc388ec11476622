"""Wire a kinematic station: motion is the input, and the torque that it takes is computed."""

from __future__ import annotations

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from simrob_drake.blocks.events import SteadySteps
from simrob_drake.blocks.wiring import joined, mapped
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.ports import StationPorts, add_input

STEP = 0.01
"""How often monitors look [s]: nothing is integrated here, so a simulator would go to the end in one step."""


def add_kinematic_robots(builder: DiagramBuilder, plant: StationPlant, config: StationConfig) -> StationPorts:
    """Add inputs of position, velocity and acceleration for every robot, inverse dynamics, and geometry poses.

    The plant itself stands outside of the diagram: it is registered with the scene graph and never stepped.
    """
    inputs: dict[str, InputPort] = {}
    outputs: dict[str, OutputPort] = {}
    for robot in plant.robots.values():
        for signal, source in (("position", "reference"), ("velocity", "reference_velocity")):
            outputs[f"{robot.prefix}{signal}"] = add_input(builder, inputs, robot, source)
        outputs[f"{robot.prefix}acceleration"] = add_input(builder, inputs, robot, "reference_acceleration")
        outputs[f"{robot.prefix}reference"] = outputs[f"{robot.prefix}position"]
    state = _add_state(builder, plant, outputs)
    _add_torques(builder, plant, state, outputs)
    builder.Connect(state, plant.add_geometry_poses(builder, of_state=True))
    builder.AddNamedSystem("steady_steps", SteadySteps(STEP))
    return StationPorts(config, plant, state, inputs, outputs)


def _add_state(builder: DiagramBuilder, plant: StationPlant, outputs: dict[str, OutputPort]) -> OutputPort:
    """Put the motions of all robots together into the state of the whole plant."""
    motions = [outputs[f"{r.prefix}{signal}"] for r in plant.robots.values() for signal in ("position", "velocity")]
    spread = np.hstack([plant.state_map(robot).T for robot in plant.robots.values()])
    return mapped(builder, "multibody_state", spread, joined(builder, "motions", *motions))


def _add_torques(
    builder: DiagramBuilder, plant: StationPlant, state: OutputPort, outputs: dict[str, OutputPort]
) -> None:
    """Compute the torques of the motion, without contacts, by inverse dynamics."""
    dynamics = InverseDynamics(plant.plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics)
    builder.AddNamedSystem("inverse_dynamics", dynamics)
    builder.Connect(state, dynamics.get_input_port_estimated_state())
    pick = {robot.name: plant.velocity_map(robot) for robot in plant.robots.values()}
    accelerations = [outputs.pop(f"{robot.prefix}acceleration") for robot in plant.robots.values()]
    spread = np.hstack([matrix.T for matrix in pick.values()])
    desired = mapped(builder, "accelerations", spread, joined(builder, "robot_accelerations", *accelerations))
    builder.Connect(desired, dynamics.get_input_port_desired_acceleration())
    for robot in plant.robots.values():
        torque = mapped(
            builder, f"{robot.prefix}torque", pick[robot.name], dynamics.get_output_port_generalized_force()
        )
        outputs[f"{robot.prefix}torque"] = torque
