"""Merging rigidly joined links changes nothing but the number of bodies."""

import xml.etree.ElementTree as ET
from copy import deepcopy

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.robots.bodies import merge_fixed_links

INERTIAL = """<inertial><origin xyz="{x} 0.02 0.03" rpy="0.3 -0.2 {x}"/><mass value="{mass}"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial>"""


def link(name: str, mass: float = 0.0, x: float = 0.1) -> str:
    return f'<link name="{name}">{INERTIAL.format(mass=mass, x=x) if mass else ""}</link>'


def joint(name: str, kind: str, parent: str, child: str, origin: str) -> str:
    limit = '<limit lower="-2" upper="2" effort="9"/>' if kind == "revolute" else ""
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin {origin}/><axis xyz="0.6 0 0.8"/>{limit}</joint>"""


ROBOT = "\n".join(
    [
        '<robot name="chain">',
        link("base", 2.0),
        link("upper", 1.0),
        link("bracket", 0.5, x=-0.2),
        link("motor", 0.7, x=0.3),
        link("flange"),
        link("fore", 0.4),
        link("tip", 0.1),
        joint("j1", "revolute", "base", "upper", 'xyz="0 0 0.3" rpy="0.1 0.2 0.3"'),
        # before its parent's
        joint("f2", "fixed", "bracket", "motor", 'xyz="0.1 0 0" rpy="0 1.5707963267948966 0"'),
        joint("f1", "fixed", "upper", "bracket", 'xyz="0 0.2 0.1" rpy="-0.4 0.5 1.1"'),
        joint("f3", "fixed", "motor", "flange", 'xyz="0 0 0.1" rpy="0.7 0 0"'),
        joint("j2", "revolute", "flange", "fore", 'xyz="0.05 0 0.2" rpy="0 0.3 0"'),
        joint("f4", "fixed", "fore", "tip", 'xyz="0 0.1 0.2" rpy="0.2 0 0.9"'),
        '<frame name="eye" link="motor" xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/>',
        "</robot>",
    ]
)


@pytest.fixture
def plants() -> list[MultibodyPlant]:
    """The robot as it is, and merged."""
    robots = [ET.fromstring(ROBOT), ET.fromstring(ROBOT)]
    merge_fixed_links(robots[1])
    plants = []
    for robot in robots:
        plant = MultibodyPlant(0.0)
        Parser(plant).AddModelsFromString(ET.tostring(robot, encoding="unicode"), "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        plant.Finalize()
        plants.append(plant)
    return plants


def test_only_moving_links_stay_bodies(plants: list[MultibodyPlant]) -> None:
    assert [plant.num_bodies() for plant in plants] == [1 + 7, 1 + 3]


def test_the_dynamics_are_the_same(plants: list[MultibodyPlant]) -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        state = random.uniform(-2, 2, 4)
        figures = []
        for plant in plants:
            context = plant.CreateDefaultContext()
            plant.SetPositionsAndVelocities(context, state)
            matrix, bias = plant.CalcMassMatrix(context), plant.CalcBiasTerm(context)
            gravity, com = (
                plant.CalcGravityGeneralizedForces(context),
                plant.CalcCenterOfMassPositionInWorld(context),
            )
            figures.append(
                np.concatenate([matrix.ravel(), bias, gravity, com, [plant.CalcTotalMass(context)]])
            )
        np.testing.assert_allclose(figures[1], figures[0], atol=1e-12)


def test_every_link_and_frame_keeps_its_pose(plants: list[MultibodyPlant]) -> None:
    contexts = [plant.CreateDefaultContext() for plant in plants]
    for plant, context in zip(plants, contexts, strict=True):
        plant.SetPositions(context, np.array([0.7, -1.1]))
    for name in ("base", "upper", "bracket", "motor", "flange", "fore", "tip", "eye"):
        poses = [
            plant.GetFrameByName(name).CalcPoseInWorld(context)
            for plant, context in zip(plants, contexts, strict=True)
        ]
        assert poses[0].IsNearlyEqualTo(poses[1], 1e-12), name


def test_a_robot_without_fixed_joints_is_left_alone() -> None:
    robot = ET.fromstring(ROBOT)
    merge_fixed_links(robot)
    again = deepcopy(robot)

    merge_fixed_links(again)

    assert ET.tostring(again) == ET.tostring(robot)
