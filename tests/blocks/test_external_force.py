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
def pushed(
    add_irb120: Callable[[DiagramBuilder], MultibodyPlant],
) -> tuple[MultibodyPlant, Diagram]:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    tcp = plant.AddFrame(FixedOffsetFrame("tcp", plant.GetFrameByName("tool0"), OFFSET))
    plant.Finalize()
    block = add_external_force(builder, plant, tcp, name="external_force")
    builder.Connect(
        block.get_spatial_forces_output_port(), plant.get_applied_spatial_force_input_port()
    )
    builder.ExportInput(block.get_command_input_port(), "force")
    return plant, builder.Build()


def acceleration(
    plant: MultibodyPlant, diagram: Diagram, context: Context, force: np.ndarray
) -> np.ndarray:
    """Accelerations (nv,) of the plant under a force (3,) [N] in the axes of the tool."""
    diagram.GetInputPort("force").FixValue(context, force)
    return plant.get_generalized_acceleration_output_port().Eval(
        plant.GetMyContextFromRoot(context)
    )


@pytest.mark.parametrize("seed", range(10))
def test_a_force_at_the_tcp_is_the_generalized_force_of_its_jacobian(
    pushed: tuple[MultibodyPlant, Diagram], seed: int
) -> None:
    """The force changes M dv/dt by J' R f in any state, with the rotation R of the tool in the world."""
    plant, diagram = pushed
    random = np.random.default_rng(seed)
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyContextFromRoot(context)
    positions = random.uniform(plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
    velocities = random.normal(size=6)
    plant.SetPositionsAndVelocities(plant_context, np.concatenate([positions, velocities]))
    force = random.normal(scale=20.0, size=3)

    with_force = acceleration(plant, diagram, context, force)
    without_force = acceleration(plant, diagram, context, np.zeros(3))

    world = plant.world_frame()
    tcp = plant.GetFrameByName("tcp")
    origin = np.zeros(3)
    jacobian = plant.CalcJacobianTranslationalVelocity(
        plant_context, JacobianWrtVariable.kV, tcp, origin, world, world
    )
    expected = jacobian.T @ (tcp.CalcRotationMatrixInWorld(plant_context) @ force)
    found = plant.CalcMassMatrix(plant_context) @ (with_force - without_force)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_each_component_pushes_along_its_own_axis_of_the_tcp(
    pushed: tuple[MultibodyPlant, Diagram], axis: int
) -> None:
    plant, diagram = pushed
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyContextFromRoot(context)
    diagram.GetInputPort("force").FixValue(context, 5.0 * np.eye(3)[axis])
    forces = plant.get_applied_spatial_force_input_port().Eval(mine)
    total = sum(force.F_Bq_W.translational() for force in forces)

    rotation = plant.GetFrameByName("tcp").CalcRotationMatrixInWorld(mine).matrix()

    np.testing.assert_allclose(total, 5.0 * rotation[:, axis], atol=1e-12)
