"""An external force at the TCP acts as the generalized force J^T f."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, JacobianWrtVariable
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from simrob_drake.blocks.passive_joints import add_external_force

OFFSET = RigidTransform(RollPitchYaw(0.4, -0.3, 1.0), [0.02, -0.03, 0.15])


@pytest.fixture
def pushed(add_irb120: Callable[[DiagramBuilder], MultibodyPlant]) -> tuple[MultibodyPlant, Diagram]:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    tcp = plant.AddFrame(FixedOffsetFrame("tcp", plant.GetFrameByName("tool0"), OFFSET))
    plant.Finalize()
    block = add_external_force(builder, plant, tcp, name="external_force")
    builder.Connect(block.get_spatial_forces_output_port(), plant.get_applied_spatial_force_input_port())
    builder.ExportInput(block.get_command_input_port(), "force")
    return plant, builder.Build()


def acceleration(plant: MultibodyPlant, diagram: Diagram, context: Context, force: np.ndarray) -> np.ndarray:
    diagram.GetInputPort("force").FixValue(context, force)
    return plant.get_generalized_acceleration_output_port().Eval(plant.GetMyContextFromRoot(context))


@pytest.mark.parametrize("seed", range(10))
def test_a_force_at_the_tcp_is_the_generalized_force_of_its_jacobian(
    pushed: tuple[MultibodyPlant, Diagram], seed: int
) -> None:
    plant, diagram = pushed
    random = np.random.default_rng(seed)
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyContextFromRoot(context)
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    plant.SetPositionsAndVelocities(mine, np.concatenate([random.uniform(lower, upper), random.normal(size=6)]))
    force = random.normal(scale=20.0, size=3)

    world, tcp = plant.world_frame(), plant.GetFrameByName("tcp")
    jacobian = plant.CalcJacobianTranslationalVelocity(mine, JacobianWrtVariable.kV, tcp, np.zeros(3), world, world)
    expected = jacobian.T @ (tcp.CalcRotationMatrixInWorld(mine) @ force)
    change = acceleration(plant, diagram, context, force) - acceleration(plant, diagram, context, np.zeros(3))
    np.testing.assert_allclose(plant.CalcMassMatrix(mine) @ change, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_each_component_pushes_along_its_own_axis_of_the_tcp(pushed: tuple[MultibodyPlant, Diagram], axis: int) -> None:
    plant, diagram = pushed
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyContextFromRoot(context)
    diagram.GetInputPort("force").FixValue(context, 5.0 * np.eye(3)[axis])
    forces = plant.get_applied_spatial_force_input_port().Eval(mine)
    total = sum(force.F_Bq_W.translational() for force in forces)
    rotation = plant.GetFrameByName("tcp").CalcRotationMatrixInWorld(mine).matrix()
    np.testing.assert_allclose(total, 5.0 * rotation[:, axis], atol=1e-12)
