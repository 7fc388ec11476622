"""FramePose against the plant's own kinematics."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.frame_pose import FramePose
from simrob_drake.frames import transform_from_xyz_quaternion

OFFSET = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.01, 0.02, 0.03])


@pytest.fixture
def plant(irb120: MultibodyPlant) -> MultibodyPlant:
    irb120.AddFrame(FixedOffsetFrame("pen", irb120.GetFrameByName("tool0"), OFFSET))
    irb120.Finalize()
    return irb120


def pose(block: FramePose, state: np.ndarray) -> np.ndarray:
    context = block.CreateDefaultContext()
    block.GetInputPort("state").FixValue(context, state)
    return block.GetOutputPort("pose").Eval(context)


@pytest.mark.parametrize("name", ["tool0", "pen"])
def test_the_pose_is_that_of_the_plant(plant: MultibodyPlant, name: str) -> None:
    frame = plant.GetFrameByName(name)
    block = FramePose(plant=plant, frame=frame)
    random = np.random.default_rng(7)
    for q in random.uniform(plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits(), (20, 6)):
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        found = transform_from_xyz_quaternion(pose(block, np.concatenate([q, random.normal(size=6)])))
        expected = frame.CalcPoseInWorld(context)
        np.testing.assert_allclose(found.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-13)


def test_the_flange_of_the_irb120_points_down_at_home(plant: MultibodyPlant) -> None:
    block = FramePose(plant=plant, frame=plant.GetFrameByName("tool0"))
    home = np.concatenate([np.deg2rad([0, 0, 0, 0, 90, 0]), np.zeros(6)])
    x, y, z, *quaternion = pose(block, home)
    np.testing.assert_allclose([x, y, z], [0.302, 0, 0.558], atol=1e-12)  # the known pose of the flange
    np.testing.assert_allclose(np.abs(quaternion), [0, 0, 1, 0], atol=1e-12)  # half a turn about y


def test_one_evaluation_leaves_nothing_for_the_next(plant: MultibodyPlant) -> None:
    block = FramePose(plant=plant, frame=plant.GetFrameByName("tool0"))
    first, second = np.zeros(12), np.full(12, 0.5)
    before = pose(block, first)
    pose(block, second)
    np.testing.assert_array_equal(pose(block, first), before)


def test_two_contexts_of_one_block_do_not_mix(plant: MultibodyPlant) -> None:
    builder = DiagramBuilder()
    blocks = [builder.AddSystem(FramePose(plant=plant, frame=plant.GetFrameByName("tool0"))) for _ in range(2)]
    for index, block in enumerate(blocks):
        builder.ExportInput(block.get_input_port(), f"state_{index}")
        builder.ExportOutput(block.get_output_port(), f"pose_{index}")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    states = [np.zeros(12), np.full(12, 0.5)]
    for index, state in enumerate(states):
        diagram.GetInputPort(f"state_{index}").FixValue(context, state)
    for index, state in enumerate(states):
        alone = pose(FramePose(plant=plant, frame=plant.GetFrameByName("tool0")), state)
        np.testing.assert_array_equal(diagram.GetOutputPort(f"pose_{index}").Eval(context), alone)


def test_the_block_works_where_the_plant_is_part_of_the_diagram(
    add_irb120: Callable[[DiagramBuilder], MultibodyPlant],
) -> None:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    plant.Finalize()
    block = builder.AddSystem(FramePose(plant=plant, frame=plant.GetFrameByName("tool0")))
    builder.Connect(plant.get_state_output_port(), block.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    found = block.get_output_port().Eval(block.GetMyContextFromRoot(context))
    np.testing.assert_allclose(found[:3], [0.374, 0, 0.630], atol=1e-12)
