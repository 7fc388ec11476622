"""The station ``irb120_dynamic`` with the bare arm, wired by hand from the blocks: what add_station() does."""

from __future__ import annotations

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.files import models_root
from simrob_drake.blocks.passive_joints import add_joint_stops
from simrob_drake.blocks.references import add_reference, ramp
from simrob_drake.blocks.servo import ServoGains, ServoSignals, add_servos

JOINTS = [f"joint_{number}" for number in range(1, 7)]
TORQUE_LIMIT = np.array([150.0, 150.0, 100.0, 30.0, 30.0, 15.0])  # N·m, the efforts of the URDF


def run(*, duration: float = 3.0) -> np.ndarray:
    """Move all joints by 30 degrees in 1 s; return the joint positions (6,) [rad] at the end."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    (arm,) = Parser(plant).AddModels(str(models_root() / "irb120" / "irb120.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link"))
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -9.80665])
    plant.Finalize()

    reference = add_reference(builder, ramp(np.zeros(6), np.full(6, np.pi / 6), duration=1.0))
    torque = add_servos(
        builder,
        ServoSignals(reference=reference.position, state=plant.get_state_output_port(arm)),
        ServoGains(np.full(6, 1000.0), np.zeros(6), np.full(6, 10.0), TORQUE_LIMIT, TORQUE_LIMIT),
        names=JOINTS,
    )
    builder.Connect(torque, plant.get_actuation_input_port(arm))
    add_joint_stops(builder, plant, stiffness=5.73e5, damping=573.0)

    diagram = builder.Build()
    simulator = Simulator(diagram)
    solver = SimulatorConfig(
        integration_scheme="radau3", accuracy=1e-2, max_step_size=0.1, use_error_control=True
    )
    ApplySimulatorConfig(solver, simulator)
    simulator.AdvanceTo(duration)
    return plant.GetPositions(plant.GetMyContextFromRoot(simulator.get_context()))


def main() -> None:
    """Print where the joints ended."""
    print("joints at", np.rad2deg(run()).round(2), "deg")


if __name__ == "__main__":
    main()
