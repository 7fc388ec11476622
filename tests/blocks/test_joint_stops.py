"""Joint stops against their equation, and a pendulum that falls against one."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder

from simrob_drake.blocks.passive_joints import add_joint_stops

AddPendulum = Callable[..., MultibodyPlant]

# The joints of the Simulink models: 1e4 N m/deg and 10 N m s/deg.
STIFFNESS = 1e4 * 180 / np.pi
DAMPING = 10 * 180 / np.pi


def with_stops(builder: DiagramBuilder, plant: MultibodyPlant) -> Diagram:
    plant.Finalize()
    stops = add_joint_stops(builder, plant, stiffness=STIFFNESS, damping=DAMPING)
    if stops is not None:
        builder.Connect(stops, plant.get_applied_generalized_force_input_port())
    builder.ExportInput(plant.get_actuation_input_port(), "actuation")
    return builder.Build()


def stop_force(plant: MultibodyPlant, diagram: Diagram, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyContextFromRoot(context)
    plant.SetPositionsAndVelocities(mine, np.concatenate([q, v]))
    return plant.get_applied_generalized_force_input_port().Eval(mine)


def law(q: np.ndarray, v: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    ahead = q + DAMPING / STIFFNESS * v
    return -STIFFNESS * (ahead - np.clip(ahead, lower, upper))


@pytest.fixture
def arm(add_irb120: Callable[[DiagramBuilder], MultibodyPlant]) -> tuple[MultibodyPlant, Diagram]:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    plant.Finalize()
    stops = add_joint_stops(builder, plant, stiffness=STIFFNESS, damping=DAMPING)
    if stops is not None:
        builder.Connect(stops, plant.get_applied_generalized_force_input_port())
    return plant, builder.Build()


def test_inside_of_its_range_a_joint_feels_nothing(arm: tuple[MultibodyPlant, Diagram]) -> None:
    plant, diagram = arm
    lower = plant.GetPositionLowerLimits()

    upper = plant.GetPositionUpperLimits()

    random = np.random.default_rng(11)
    for _ in range(20):
        v = random.uniform(-5, 5, 6)
        room = np.abs(v) * DAMPING / STIFFNESS + 1e-9
        np.testing.assert_array_equal(
            stop_force(plant, diagram, random.uniform(lower + room, upper - room), v), 0
        )


def test_outside_the_force_is_that_of_the_equation(arm: tuple[MultibodyPlant, Diagram]) -> None:
    plant, diagram = arm
    lower = plant.GetPositionLowerLimits()
    upper = plant.GetPositionUpperLimits()
    random = np.random.default_rng(12)
    pushed = 0

    for _ in range(50):
        side = random.choice([lower, upper])
        q = side + random.normal(scale=0.01, size=6)
        v = random.normal(scale=5.0, size=6)
        expected = law(q, v, lower, upper)
        np.testing.assert_allclose(stop_force(plant, diagram, q, v), expected, rtol=1e-9, atol=1e-6)
        pushed += int((expected != 0).sum())

    assert 50 < pushed < 250  # of 300: both free and pushed joints were met


def test_each_joint_may_have_figures_of_its_own(
    add_irb120: Callable[[DiagramBuilder], MultibodyPlant],
) -> None:
    builder = DiagramBuilder()
    plant = add_irb120(builder)
    plant.Finalize()
    stiffness = np.geomspace(1e2, 1e5, 6)
    damping = np.linspace(50.0, 0.0, 6)
    stops = add_joint_stops(builder, plant, stiffness=stiffness, damping=damping)
    if stops is not None:
        builder.Connect(stops, plant.get_applied_generalized_force_input_port())
    diagram = builder.Build()

    q = plant.GetPositionUpperLimits() + 0.1

    v = np.full(6, 0.2)
    np.testing.assert_allclose(stop_force(plant, diagram, q, v), -stiffness * 0.1 - damping * 0.2)


def test_a_stop_only_pushes_and_never_pulls(arm: tuple[MultibodyPlant, Diagram]) -> None:
    plant, diagram = arm
    upper = plant.GetPositionUpperLimits()

    random = np.random.default_rng(13)
    for _ in range(50):
        q = upper + random.uniform(-0.01, 0.01, 6)
        assert (stop_force(plant, diagram, q, random.normal(scale=20.0, size=6)) <= 0).all()


@pytest.mark.parametrize("limits", [(-np.inf, 0.5), (-0.5, np.inf), (-0.5, 0.5)])
def test_one_sided_limits_have_one_stop(
    add_pendulum: AddPendulum, limits: tuple[float, float]
) -> None:
    builder = DiagramBuilder()
    plant = add_pendulum(builder, limits=limits)

    diagram = with_stops(builder, plant)

    for q in (-1.0, 0.0, 1.0):
        expected = law(np.array([q]), np.zeros(1), np.array([limits[0]]), np.array([limits[1]]))
        np.testing.assert_allclose(stop_force(plant, diagram, np.array([q]), np.zeros(1)), expected)


def test_without_limits_there_are_no_blocks(add_pendulum: AddPendulum) -> None:
    builder = DiagramBuilder()
    plant = add_pendulum(builder)

    diagram = with_stops(builder, plant)

    assert not [system for system in diagram.GetSystems() if system.get_name().startswith("stops.")]
    assert not plant.get_applied_generalized_force_input_port().HasValue(
        plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    )


@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_a_falling_pendulum_stops_shortly_behind_its_limit_and_gains_no_energy(
    add_pendulum: AddPendulum, speed: float
) -> None:
    limit = 0.5
    builder = DiagramBuilder()
    plant = add_pendulum(builder, limits=(-np.inf, limit))
    diagram = with_stops(builder, plant)
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="radau3", accuracy=1e-6, max_step_size=0.01), simulator
    )
    context = simulator.get_mutable_context()
    mine = plant.GetMyMutableContextFromRoot(context)
    diagram.GetInputPort("actuation").FixValue(context, [0.0])
    plant.SetPositionsAndVelocities(mine, [-1.5, speed])
    positions = []
    energies = []

    def record(_: object) -> None:
        position = plant.GetPositions(mine)[0]
        spring = STIFFNESS * max(position - limit, 0.0) ** 2 / 2
        positions.append(position)
        energies.append(plant.CalcKineticEnergy(mine) + plant.CalcPotentialEnergy(mine) + spring)

    simulator.set_monitor(record)
    simulator.AdvanceTo(3.0)
    # at the limit [J]
    kinetic = 0.5 * 1.0 * 0.25 * speed**2 + 9.80665 * 0.5 * (np.cos(limit) - np.cos(1.5))
    # all of it in the spring
    assert limit < max(positions) < limit + np.sqrt(2 * kinetic / STIFFNESS)
    # With mechanical and spring energy E, dE/dt is never positive; 1e-4 is what accuracy 1e-6 leaves over 3 s.
    assert np.diff(energies).max() < 1e-4
    assert energies[-1] < energies[0] - 0.5 * kinetic  # the damper took most of the impact
