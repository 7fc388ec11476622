"""The chain against Drake, against DH tables, and against finite differences."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.kinematics import Chain, UnsupportedChain
from simrob_drake.kinematics.closed_form import SixAxisArm
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes

EXACT = 1e-12  # a dozen products of numbers near 1 lose no more than a few 1e-16 each


def test_forward_is_drakes(irb120_chain, random_postures, drake_poses):
    postures = random_postures(irb120_chain, 500)
    np.testing.assert_allclose(
        irb120_chain.forward(postures), drake_poses(irb120_chain, postures), atol=EXACT
    )


def test_urdf_dh_table_and_analytic_model_agree(
    irb120_chain, random_postures, tables, textbook_poses
):
    postures = random_postures(irb120_chain, 10_000)
    of_urdf = irb120_chain.forward(postures)

    np.testing.assert_allclose(of_urdf, textbook_poses(tables["irb120"], postures), atol=1e-9)
    np.testing.assert_allclose(of_urdf, SixAxisArm.of(irb120_chain).forward(postures), atol=1e-9)


@pytest.mark.parametrize("name", ["puma560", "tx40", "ur5"])
def test_analytic_model_of_offset_shoulders(
    name, dh_chain, random_postures, tables, textbook_poses
):
    chain = dh_chain(tables[name])
    postures = random_postures(chain, 1000)

    truth = textbook_poses(tables[name], postures)

    np.testing.assert_allclose(chain.forward(postures), truth, atol=EXACT)
    np.testing.assert_allclose(SixAxisArm.of(chain).forward(postures), truth, atol=EXACT)


def test_arm_on_a_belt_has_seven_axes(dh_chain, random_postures, drake_poses, tables, belt):
    chain = dh_chain(tables["irb120"], slide=belt)
    postures = random_postures(chain, 200)

    assert chain.size == 7
    assert chain.revolute.tolist() == [False] + [True] * 6
    np.testing.assert_allclose(chain.forward(postures), drake_poses(chain, postures), atol=EXACT)

    _assert_jacobian_is_derivative(chain, postures[0])


def test_jacobian_is_drakes(irb120_chain, random_postures):
    place = irb120_chain.in_plant
    context = place.plant.CreateDefaultContext()
    for posture in random_postures(irb120_chain, 20):
        place.plant.SetPositions(context, posture)
        drakes = place.plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, place.tool, np.zeros(3), place.base, place.base
        )
        np.testing.assert_allclose(
            irb120_chain.jacobian(posture)[0], np.roll(drakes, 3, axis=0), atol=EXACT
        )


def _assert_jacobian_is_derivative(chain, posture):
    step = 1e-6
    jacobian = chain.jacobian(posture)[0]
    for axis in range(chain.size):
        ahead, behind = (
            chain.forward(posture + sign * step * np.eye(chain.size)[axis])[0] for sign in (1, -1)
        )
        turn = (ahead - behind)[:3, :3] @ chain.forward(posture)[0, :3, :3].T / (2 * step)
        slope = [*(ahead - behind)[:3, 3] / (2 * step), turn[2, 1], turn[0, 2], turn[1, 0]]
        # central differences: step² and 1e-16/step
        np.testing.assert_allclose(jacobian[:, axis], slope, atol=1e-8)


def test_signs_and_order_of_axes(irb120_chain, random_postures):
    place = irb120_chain.in_plant
    signs = np.array([1, -1, 1, -1, -1, 1])
    mixed = [3, 0, 5, 1, 2, 4]
    chain = Chain.of_plant(
        place.plant,
        joints=[place.joints[axis] for axis in mixed],
        signs=signs[mixed],
        base=place.base,
        tool=place.tool,
        names=[f"a{axis}" for axis in mixed],
    )

    postures = random_postures(irb120_chain, 50)

    np.testing.assert_allclose(
        chain.forward((signs * postures)[:, mixed]), irb120_chain.forward(postures), atol=EXACT
    )
    assert chain.upper[chain.axis_index("a2")] == irb120_chain.upper[2]
    assert chain.upper[chain.axis_index("a1")] == -irb120_chain.lower[1]

    _assert_jacobian_is_derivative(chain, postures[0][mixed])


def test_way_from_one_arm_to_another(random_postures):
    model, plant = load_robot("irb120"), MultibodyPlant(0.0)
    urdf = with_absolute_meshes(model.element, model.folder)
    arms = [
        add_urdf(plant, urdf, name=name, where="two arms", collision=False)
        for name in ("left", "right")
    ]
    for arm in arms:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link", arm))
    plant.Finalize()
    joints = [plant.get_joint(index) for arm in arms for index in plant.GetJointIndices(arm)]
    joints = [joint for joint in joints if joint.num_positions()]
    left, right = (plant.GetFrameByName("tool0", arm) for arm in arms)
    names = [f"{side}.{axis}" for side in ("left", "right") for axis in model.axes]
    chain = Chain.of_plant(plant, joints=joints, base=left, tool=right, names=names)

    context = plant.CreateDefaultContext()

    for posture in random_postures(chain, 20):
        plant.SetPositions(context, posture)
        np.testing.assert_allclose(
            chain.forward(posture)[0], right.CalcPose(context, left).GetAsMatrix4(), atol=EXACT
        )

    _assert_jacobian_is_derivative(chain, posture)


def test_joints_beside_the_way_move_nothing(irb120_chain):
    place = irb120_chain.in_plant
    elbow = place.plant.GetFrameByName("link_3")

    chain = Chain.of_plant(place.plant, joints=place.joints, base=place.base, tool=elbow)

    assert chain.order == (0, 1, 2)
    assert not chain.jacobian(np.full(6, 0.3))[0, :, 3:].any()


def test_another_tool(irb120_chain, home):
    pencil = irb120_chain.with_tool([0, 0, 0.07, np.pi / 2, 0, 0]).with_tool([0, 0, 0.148, 0, 0, 0])
    tip = pencil.forward(home)[0]

    np.testing.assert_allclose(tip[:3, 3], [0.302, 0, 0.340], atol=1e-12)  # facts of the irb120
    np.testing.assert_allclose(tip[:3, 2], [0, 0, -1], atol=1e-12)

    _assert_jacobian_is_derivative(pencil, home)


def test_reach_is_an_upper_bound(irb120_chain, random_postures):
    places = irb120_chain.forward(random_postures(irb120_chain, 2000))[:, :3, 3]
    assert np.linalg.norm(places - irb120_chain.points[0], axis=1).max() <= irb120_chain.reach


def test_unlisted_joint_between_the_frames(irb120_chain):
    place = irb120_chain.in_plant
    with pytest.raises(UnsupportedChain, match="joint_6"):
        Chain.of_plant(place.plant, joints=place.joints[:5], base=place.base, tool=place.tool)


@pytest.mark.parametrize(
    "positions",
    [
        [0.0] * 5,
        [[0.0] * 7],
        [[[0.0] * 6]],
        [0, 0, np.nan, 0, 0, 0],
        "home",
        [],
        [[]],
        [[0.0] * 6, [0.0]],
    ],
)
def test_bad_postures(irb120_chain, positions):
    with pytest.raises(InvalidParameter, match=r"positions.*6 finite numbers"):
        irb120_chain.forward(positions)


def test_unknown_names(irb120_chain):
    with pytest.raises(UnknownName, match="did you mean 'tool0'"):
        Chain.of_robot(load_robot("irb120"), "tool")
    with pytest.raises(UnknownName, match="did you mean 'joint_2'"):
        irb120_chain.axis_index("joint2")


@pytest.mark.parametrize("signs", [[1, 1], [1, 1, 1, 1, 1, 0.5]])
def test_bad_signs(irb120_chain, signs):
    place = irb120_chain.in_plant
    with pytest.raises(InvalidParameter, match="signs"):
        Chain.of_plant(
            place.plant, joints=place.joints, base=place.base, tool=place.tool, signs=signs
        )


def test_a_base_that_is_elsewhere_carries_poses_and_jacobians(irb120_chain, random_postures):
    postures = random_postures(irb120_chain, 20)
    base = np.array(
        [
            RigidTransform(RollPitchYaw(0.1 * k, 0.3, -0.2 * k), [k, 1, 2]).GetAsMatrix4()
            for k in range(20)
        ]
    )
    frames = irb120_chain.frames(postures, base)

    poses = irb120_chain.tool_poses(frames)

    np.testing.assert_allclose(poses, base @ irb120_chain.forward(postures), atol=1e-12)

    turns = np.zeros((20, 6, 6))
    turns[:, :3, :3] = turns[:, 3:, 3:] = base[:, :3, :3]

    found = irb120_chain.jacobian_at(frames, poses[:, :3, 3])

    np.testing.assert_allclose(found, turns @ irb120_chain.jacobian(postures), atol=1e-12)
