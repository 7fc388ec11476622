"""The map between a robot's axes and a plant's joints, against a plant whose joints stand in another order."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    JacobianWrtVariable,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
)

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.robots.axis_map import AxisMap, in_a_row

SIGNS = np.array([-1.0, 1.0, -1.0])


@pytest.fixture
def plant():
    """Return a plant with a free body (7 positions, 6 velocities) before and after a chain of three joints."""
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.2, 0.3)
    plant.AddRigidBody("before", inertia)
    parent = plant.world_frame()
    for name, kind, axis in (
        ("lift", PrismaticJoint, [0, 0, 1]),
        ("turn", RevoluteJoint, [1, 0, 0]),
        ("twist", RevoluteJoint, [0, 1, 0]),
    ):
        body = plant.AddRigidBody(f"{name}_link", inertia)
        joint = plant.AddJoint(kind(name, parent, body.body_frame(), axis))
        plant.AddJointActuator(f"{name}_motor", joint)
        parent = body.body_frame()
    plant.AddRigidBody("after", inertia)
    plant.Finalize()
    return plant


@pytest.fixture
def joints(plant):
    return [plant.GetJointByName(name) for name in ("twist", "lift", "turn")]


@pytest.fixture
def axes(plant, joints):
    return AxisMap.of_joints(plant, joints, SIGNS)


def test_axes_are_the_joints_in_axis_order_and_sense(plant, joints, axes):
    context = plant.CreateDefaultContext()
    wanted = np.array([0.3, -0.2, 0.7])
    axes.set_positions(plant, context, wanted)
    joints[1].set_translation_rate(context, 2.0)

    joints[2].set_angular_rate(context, 3.0)

    assert [
        joints[0].get_angle(context),
        joints[1].get_translation(context),
        joints[2].get_angle(context),
    ] == [
        -0.3,
        -0.2,
        -0.7,
    ]
    assert axes.positions(plant.GetPositions(context)) == pytest.approx(wanted, abs=0)
    assert axes.velocities(plant.GetVelocities(context)) == pytest.approx([0, 2.0, -3.0], abs=0)


def test_efforts_do_the_work_that_the_plant_sees(axes):
    """Power is the same seen from the axes and from the plant, whatever the senses."""
    rng = np.random.default_rng(1)
    speed, effort = rng.normal(size=(2, 3))

    full = axes.spread_velocities(effort) @ axes.spread_velocities(speed)

    assert full == pytest.approx(effort @ speed)
    assert axes.efforts(axes.spread_velocities(effort)) == pytest.approx(effort, abs=0)


def test_a_jacobian_maps_axis_velocities(plant, axes):
    context = plant.CreateDefaultContext()
    axes.set_positions(plant, context, np.array([0.3, -0.2, 0.7]))
    speed = np.array([1.0, 2.0, -0.5])
    tip = plant.GetFrameByName("twist_link")
    plant.SetVelocities(context, axes.spread_velocities(speed))
    jacobian = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, tip, np.zeros(3), plant.world_frame(), plant.world_frame()
    )

    moves = tip.CalcSpatialVelocityInWorld(context).get_coeffs()

    assert axes.velocities(jacobian) @ speed == pytest.approx(moves)


def test_what_is_not_an_axis_stays(plant, axes):
    q, v = np.arange(1.0, 18.0), np.arange(1.0, 16.0)

    assert (plant.num_positions(), plant.num_velocities()) == (17, 15)

    put_q, put_v = axes.spread_positions(np.zeros(3), q), axes.spread_velocities(np.zeros(3), v)
    assert np.flatnonzero(put_q != q).tolist() == sorted(axes.position_places)
    assert np.flatnonzero(put_v != v).tolist() == sorted(axes.velocity_places)
    assert q[0] == 1.0, "what was given is not changed"


def test_samples_go_along(plant, axes):
    rng = np.random.default_rng(2)
    q, v = (
        rng.normal(size=(4, 5, plant.num_positions())),
        rng.normal(size=(4, 5, plant.num_velocities())),
    )

    assert axes.positions(q).shape == axes.velocities(v).shape == (4, 5, 3)
    assert axes.positions(q)[2, 3] == pytest.approx(axes.positions(q[2, 3]), abs=0)
    assert axes.spread_positions(axes.positions(q), q) == pytest.approx(q, abs=0)
    assert axes.spread_velocities(axes.velocities(v), v) == pytest.approx(v, abs=0)
    assert axes.spread_velocities(axes.efforts(v)).shape == v.shape


def test_matrices_are_the_same_maps(plant, axes):
    rng = np.random.default_rng(3)
    q, v = rng.normal(size=plant.num_positions()), rng.normal(size=plant.num_velocities())

    assert axes.position_matrix @ q == pytest.approx(axes.positions(q), abs=0)
    assert axes.velocity_matrix @ v == pytest.approx(axes.velocities(v), abs=0)

    both = np.concatenate([axes.positions(q), axes.velocities(v)])
    assert axes.state_matrix @ np.concatenate([q, v]) == pytest.approx(both, abs=0)


def test_actuators_get_what_the_axes_are_given(plant, axes):
    effort = np.array([1.0, -2.0, 3.0])
    actuation = axes.actuation_matrix(plant, plant.GetJointByName("lift").model_instance())
    assert plant.MakeActuationMatrix() @ actuation @ effort == pytest.approx(
        axes.spread_velocities(effort), abs=0
    )


@pytest.mark.parametrize("signs", [[1, -1], [1, 1, 2], [1, 1, 0.5], [[1, 1, 1]]])
def test_signs_are_one_a_joint(plant, joints, signs):
    with pytest.raises(InvalidParameter, match="3 numbers 1 or -1, one for each joint"):
        AxisMap.of_joints(plant, joints, signs)


def test_without_signs_axes_are_joints(plant, joints):
    assert AxisMap.of_joints(plant, joints).signs.tolist() == [1, 1, 1]


@pytest.mark.parametrize("places", [[4, 5, 6], [3], [], [4, 6, 7], [2, 1, 0], [1, 1, 2]])
def test_places_in_a_row_stand_for_the_same_values(places: list[int]) -> None:
    values, known = np.arange(9.0), np.array(places, np.intp)
    short = in_a_row(known)

    assert values[short].tolist() == values[known].tolist()
    assert isinstance(short, slice) == (places in ([4, 5, 6], [3]))
