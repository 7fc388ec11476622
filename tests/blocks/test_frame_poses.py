"""FramePoses against the plant's own kinematics."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.blocks.frame_poses import FramePoses

OFFSET = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.01, 0.02, 0.03])
FRAMES = ("base_link", "tool0", "pen")


@pytest.fixture
def plant(irb120: MultibodyPlant) -> MultibodyPlant:
    irb120.AddFrame(FixedOffsetFrame("pen", irb120.GetFrameByName("tool0"), OFFSET))
    irb120.Finalize()
    return irb120


def block_of(plant: MultibodyPlant) -> FramePoses:
    return FramePoses(plant=plant, frames={name: plant.GetFrameByName(name) for name in FRAMES})


def pose(block: FramePoses, name: str, state: np.ndarray) -> np.ndarray:
    context = block.CreateDefaultContext()
    block.GetInputPort("state").FixValue(context, state)
    return block.GetOutputPort(name).Eval(context)


@pytest.mark.parametrize("name", FRAMES)
def test_the_pose_is_that_of_the_plant(plant: MultibodyPlant, name: str) -> None:
    block = block_of(plant)
    frame = plant.GetFrameByName(name)

    random = np.random.default_rng(7)
    for q in random.uniform(
        plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits(), (20, 6)
    ):
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        found = transform_from_xyz_quaternion(
            pose(block, name, np.concatenate([q, random.normal(size=6)]))
        )
        expected = frame.CalcPoseInWorld(context)
        np.testing.assert_allclose(found.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-13)


def test_the_flange_of_the_irb120_points_down_at_home(plant: MultibodyPlant) -> None:
    home = np.concatenate([np.deg2rad([0, 0, 0, 0, 90, 0]), np.zeros(6)])
    found = pose(block_of(plant), "tool0", home)

    # the known pose of the flange
    np.testing.assert_allclose(found[:3], [0.302, 0, 0.558], atol=1e-12)
    np.testing.assert_allclose(np.abs(found[3:]), [0, 0, 1, 0], atol=1e-12)  # half a turn about y


def test_one_evaluation_leaves_nothing_for_the_next(plant: MultibodyPlant) -> None:
    block = block_of(plant)
    before = pose(block, "tool0", np.zeros(12))

    pose(block, "tool0", np.full(12, 0.5))

    np.testing.assert_array_equal(pose(block, "tool0", np.zeros(12)), before)


def test_all_ports_follow_a_change_of_the_state_in_any_order(plant: MultibodyPlant) -> None:
    block = block_of(plant)
    context = block.CreateDefaultContext()
    for q in (np.zeros(12), np.full(12, 0.5), np.zeros(12)):
        for name in (*FRAMES, *reversed(FRAMES)):
            block.GetInputPort("state").FixValue(context, q)
            np.testing.assert_array_equal(
                block.GetOutputPort(name).Eval(context), pose(block_of(plant), name, q)
            )


def test_recorded_states_give_what_the_ports_give(plant: MultibodyPlant) -> None:
    block = block_of(plant)
    states = np.random.default_rng(3).normal(size=(5, 12))
    for name in FRAMES:
        np.testing.assert_array_equal(
            block.at(name, states), [pose(block, name, state) for state in states]
        )
        assert block.at(name, states[:0]).shape == (0, 7)


def test_a_frame_that_cannot_move_needs_no_state(plant: MultibodyPlant) -> None:
    block = block_of(plant)
    standing = block.GetOutputPort("base_link").Eval(block.CreateDefaultContext())
    np.testing.assert_array_equal(standing, [0, 0, 0, 1, 0, 0, 0])


def test_the_block_works_where_the_plant_is_part_of_the_diagram(
    add_irb120: Callable[[DiagramBuilder], MultibodyPlant],
) -> None:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    plant.Finalize()
    block = builder.AddSystem(
        FramePoses(plant=plant, frames={"tip": plant.GetFrameByName("tool0")})
    )
    builder.Connect(plant.get_state_output_port(), block.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()

    found = block.GetOutputPort("tip").Eval(block.GetMyContextFromRoot(context))

    np.testing.assert_allclose(found[:3], [0.374, 0, 0.630], atol=1e-12)
