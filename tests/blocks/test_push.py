"""A push gives a body its impulse, whatever the solver's steps."""

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from simrob_drake.blocks.push import Push, add_pushes

from simrob_drake.errors import InvalidParameter

MASS = 2.0  # kg


def velocity_after(pushes: list[Push], scheme: str, *, until: float = 1.0) -> np.ndarray:
    """Push a free body without weight, with steps far longer than the push, and return its velocity (3,)."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.set_name("plant")
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    ball = SpatialInertia.MakeFromCentralInertia(MASS, np.zeros(3), RotationalInertia(0.1, 0.1, 0.1))
    body = plant.AddRigidBody("ball", ball)
    plant.Finalize()
    forces = add_pushes(builder, plant, body.body_frame(), pushes, name="pushes")
    builder.Connect(forces, plant.get_applied_spatial_force_input_port())
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(SimulatorConfig(integration_scheme=scheme, max_step_size=0.1, accuracy=1e-3), simulator)
    simulator.AdvanceTo(until)
    return plant.GetVelocities(plant.GetMyContextFromRoot(simulator.get_context()))[3:]


@pytest.mark.parametrize("scheme", ["cenic", "radau3", "runge_kutta3"])
def test_the_impulse_arrives(scheme: str) -> None:
    push = Push(0.213, 0.1, np.array([3.0, -10.0, 1.0]))
    # Schemes with a stage at a step's end find the force gone there; their error control keeps that to a thousandth.
    np.testing.assert_allclose(velocity_after([push], scheme), push.force * 0.1 / MASS, rtol=2e-3)


def test_pushes_add_up_where_they_overlap() -> None:
    pushes = [Push(0.0, 0.2, np.array([1.0, 0, 0])), Push(0.1, 0.5, np.array([0, 4.0, 0]))]
    np.testing.assert_allclose(velocity_after(pushes, "cenic"), [0.1, 1.0, 0.0], atol=2e-4)


def test_before_a_push_nothing_moves() -> None:
    np.testing.assert_array_equal(velocity_after([Push(0.5, 0.1, np.ones(3))], "cenic", until=0.5), np.zeros(3))


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ((-0.1, 0.1, np.ones(3)), "start of a push is -0.1"),
        ((0.0, 0.0, np.ones(3)), "duration of a push is 0.0"),
        ((0.0, 0.1, np.ones(2)), "three finite numbers"),
        ((0.0, 0.1, np.array([1, 2, np.nan])), "three finite numbers"),
    ],
)
def test_figures_that_make_no_push_are_refused(figures: tuple, message: str) -> None:
    with pytest.raises(InvalidParameter, match=message):
        Push(*figures)
