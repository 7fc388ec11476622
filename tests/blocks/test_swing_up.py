"""The swing-up controller against Drake's dynamics, the closed form of a pole on a cart and a Riccati solution."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JointActuatorIndex
from pydrake.systems.framework import DiagramBuilder
from scipy.linalg import solve_continuous_are

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import models_root
from simrob_drake.blocks.swing_up import (
    AxisDynamics,
    LqrWeights,
    SwingUp,
    SwingUpGains,
    balance_regulator,
    nearest_error,
)
from simrob_drake.robots.axis_map import AxisMap

CART_MASS = 10.0  # kg
POLE_MASS = 1.0  # kg, at the end of the pole
LENGTH = 0.5  # m
OWN_INERTIA = 0.00016  # of the ball at the pole's end [kg m²]
POLE_INERTIA = OWN_INERTIA + POLE_MASS * LENGTH**2  # about the pivot [kg m²]

DIAGRAMS: list[object] = []
"""The diagrams that own the plants of this module's robots."""


class Robot(NamedTuple):
    """A robot alone in a plant of plain Drake.

    Attributes:
        plant: the finalized plant, continuous.
        axes: the robot's axes in it.
        torque_limit: limits of the motors (n,) [N·m or N]; 0 of the passive axis.
        upright: posture to be balanced (n,) [rad or m].
        turns: whether each axis turns (n,).
    """

    plant: MultibodyPlant
    axes: AxisMap
    torque_limit: np.ndarray
    upright: np.ndarray
    turns: np.ndarray

    @property
    def driven(self) -> np.ndarray:
        return self.torque_limit > 0

    def block(self, *, gains: SwingUpGains | None = None, **changes: object) -> SwingUp:
        count = len(self.upright)
        arguments = {
            "plant": self.plant,
            "axes": self.axes,
            "torque_limit": self.torque_limit,
            "turns": self.turns,
            "upright": self.upright,
            "weights": LqrWeights(*np.ones((3, count))),
            "gains": gains or SwingUpGains(energy=0.7, position=2.0, velocity=1.5),
        }
        return SwingUp(**{**arguments, **changes})

    def accelerations(
        self, positions: np.ndarray, velocities: np.ndarray, torque: np.ndarray
    ) -> np.ndarray:
        """Accelerations (n,) that Drake computes for torques (n,) of the axes."""
        context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(
            context, self.axes.spread_positions(positions, self.plant.GetPositions(context))
        )
        self.plant.SetVelocities(context, self.axes.spread_velocities(velocities))
        self.plant.get_actuation_input_port().FixValue(context, torque[self.driven])
        rates = self.plant.EvalTimeDerivatives(context).CopyToVector()
        return self.axes.velocities(rates[self.plant.num_positions() :])


def robot_of(
    name: str, root: str, joints: list[str], *, sign: float = 1.0, **values: list[float]
) -> Robot:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(models_root() / name / f"{name}.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(root))
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -STANDARD_GRAVITY])
    # The block's torques are compared before their limits.
    plant.get_joint_actuator(JointActuatorIndex(0)).set_effort_limit(np.inf)
    plant.Finalize()
    DIAGRAMS.append(builder.Build())
    found = [plant.GetJointByName(joint) for joint in joints]
    arrays = {key: np.array(value) for key, value in values.items()}
    turns = np.array([joint.type_name() == "revolute" for joint in found])
    axes = AxisMap.of_joints(plant, found, np.full(len(joints), sign))
    return Robot(plant=plant, axes=axes, turns=turns, **arrays)


def cart_pole() -> Robot:
    limits = {"torque_limit": [100.0, 0.0], "upright": [0.0, np.pi]}
    return robot_of("cart_pole", "rail", ["slide", "pivot"], **limits)


def acrobot(sign: float = 1.0) -> Robot:
    limits = {"torque_limit": [0.0, 40.0], "upright": [np.pi, 0.0]}
    return robot_of("acrobot", "base", ["shoulder", "elbow"], sign=sign, **limits)


def pendubot() -> Robot:
    """An acrobot whose axes are named in the other order, to find a mix-up of axes."""
    limits = {"torque_limit": [40.0, 0.0], "upright": [0.0, np.pi]}
    return robot_of("acrobot", "base", ["elbow", "shoulder"], **limits)


ROBOTS = pytest.mark.parametrize(
    "make", [cart_pole, acrobot, pendubot], ids=lambda make: make.__name__
)


def states(count: int, seed: int = 3) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions and velocities of two axes, at random."""
    random = np.random.default_rng(seed)
    return [(random.uniform(-3, 3, 2), random.uniform(-4, 4, 2)) for _ in range(count)]


@ROBOTS
def test_the_torque_gives_the_driven_axis_the_acceleration_of_the_law(
    make: Callable[[], Robot],
) -> None:
    robot = make()
    gains = SwingUpGains(energy=0.7, position=2.0, velocity=1.5)
    block = robot.block(gains=gains)

    dynamics = AxisDynamics(robot.plant, robot.axes)

    (driven,) = np.flatnonzero(robot.driven)
    (passive,) = np.flatnonzero(~robot.driven)
    for position, velocity in states(10):
        terms = dynamics.terms(position, velocity)
        error = nearest_error(position - robot.upright, robot.turns)
        energy = block.energy_error(terms, position, velocity)
        torque = np.zeros(2)
        torque[driven] = block.swing_torque(terms, error, velocity, energy).item()
        wanted = gains.energy * energy * terms.mass[driven, passive] * velocity[passive]
        wanted -= gains.position * error[driven] + gains.velocity * velocity[driven]
        assert robot.accelerations(position, velocity, torque)[driven] == pytest.approx(
            wanted, rel=1e-9
        )


def test_the_energy_of_a_pole_is_the_closed_form() -> None:
    """The error is that of the pole as seen from the cart, or that of the whole robot with the cart's motion."""
    robot = cart_pole()
    dynamics = AxisDynamics(robot.plant, robot.axes)
    of_pole = robot.block(gains=SwingUpGains(1.0, 1.0, 1.0, of_passive_axis=True))

    of_robot = robot.block()

    for position, velocity in states(10):
        angle = position[1]
        cart_speed, turn_speed = velocity
        terms = dynamics.terms(position, velocity)

        error_of_pole = of_pole.energy_error(terms, position, velocity)
        error_of_robot = of_robot.energy_error(terms, position, velocity)

        height_below_upright = -LENGTH * (np.cos(angle) + 1.0)
        potential = POLE_MASS * STANDARD_GRAVITY * height_below_upright
        energy_of_pole = 0.5 * POLE_INERTIA * turn_speed**2 + potential
        assert error_of_pole == pytest.approx(energy_of_pole, abs=1e-9)
        # The sense of the pivot makes the end of the pole move towards -x.
        coupling = -POLE_MASS * LENGTH * np.cos(angle)
        energy_of_cart = (
            0.5 * (CART_MASS + POLE_MASS) * cart_speed**2 + coupling * cart_speed * turn_speed
        )
        assert error_of_robot == pytest.approx(energy_of_pole + energy_of_cart, abs=1e-9)


def test_the_energy_error_of_a_pole_fades_as_the_law_says() -> None:
    r"""The equation dE/dt = -k E (M_ap q_p')², from Drake's own accelerations."""
    robot = cart_pole()
    gain = 0.7
    block = robot.block(gains=SwingUpGains(gain, 0.0, 0.0, of_passive_axis=True))

    dynamics = AxisDynamics(robot.plant, robot.axes)

    no_error = np.zeros(2)
    for position, velocity in states(10):
        angle = position[1]
        turn_speed = velocity[1]
        terms = dynamics.terms(position, velocity)
        energy = block.energy_error(terms, position, velocity)

        force = block.swing_torque(terms, no_error, velocity, energy).item()

        turn_acceleration = robot.accelerations(position, velocity, np.array([force, 0.0]))[1]
        weight = POLE_MASS * STANDARD_GRAVITY * LENGTH * np.sin(angle)
        power = turn_speed * (POLE_INERTIA * turn_acceleration + weight)
        coupling = POLE_MASS * LENGTH * np.cos(angle)
        expected = -gain * energy * (coupling * turn_speed) ** 2
        assert power == pytest.approx(expected, rel=1e-8, abs=1e-9)


def test_a_robot_that_hangs_still_is_set_in_motion() -> None:
    """The motor pushes a robot at rest below, although the law itself is zero at zero speed."""
    robot = cart_pole()
    read = {"position": np.zeros(2), "velocity": np.zeros(2)}

    changes = robot.block().sample({"balancing": np.zeros(1)}, read)

    assert changes["feedforward"][0] != 0.0
    assert changes["feedforward"][1] == 0.0
    assert changes["balancing"] == 0.0
    assert changes["energy"] == pytest.approx(-2.0 * POLE_MASS * STANDARD_GRAVITY * LENGTH)


def test_the_linear_model_of_the_cart_and_pole_is_the_closed_form() -> None:
    """Upright, x' = A x + B u with A = [[0, 1], [M^-1 G, 0]]; the weight G turns the pole further over."""
    robot = cart_pole()
    weights = LqrWeights(*np.ones((3, 2)))
    dynamics = AxisDynamics(robot.plant, robot.axes)

    regulator = balance_regulator(dynamics, robot.driven, robot.upright, weights)

    coupling = POLE_MASS * LENGTH  # upright, the pole's end moves towards +x with a positive angle
    mass = np.array([[CART_MASS + POLE_MASS, coupling], [coupling, POLE_INERTIA]])
    weight = np.diag([0.0, POLE_MASS * STANDARD_GRAVITY * LENGTH])
    inverse = np.linalg.inv(mass)
    none = np.zeros((2, 2))
    expected = np.block([[none, np.eye(2)], [inverse @ weight, none]])
    np.testing.assert_allclose(regulator.dynamics_matrix, expected, atol=1e-8)
    np.testing.assert_allclose(regulator.input_matrix.ravel(), [0, 0, *inverse[:, 0]], atol=1e-12)


@ROBOTS
def test_the_regulator_solves_the_riccati_equation(make: Callable[[], Robot]) -> None:
    """Cost and gain are those of SciPy's solution S, K = R^-1 B' S, and the regulated robot is stable."""
    robot = make()
    weights = LqrWeights(
        position=np.array([3.0, 7.0]),
        velocity=np.array([0.5, 2.0]),
        torque=np.array([0.3, 0.4]),
    )
    dynamics = AxisDynamics(robot.plant, robot.axes)

    regulator = balance_regulator(dynamics, robot.driven, robot.upright, weights)

    a = regulator.dynamics_matrix
    b = regulator.input_matrix
    state_weights = np.diag([*weights.position, *weights.velocity])
    torque_weight = weights.torque[robot.driven].reshape(1, 1)
    cost = solve_continuous_are(a, b, state_weights, torque_weight)
    np.testing.assert_allclose(regulator.cost, cost, rtol=1e-6, atol=1e-8 * np.abs(cost).max())
    np.testing.assert_allclose(regulator.gain, b.T @ cost / torque_weight, rtol=1e-6)
    assert (np.linalg.eigvals(a - b @ regulator.gain).real < 0).all()
    assert (np.linalg.eigvals(a).real > 1.0).any()  # without the regulator it falls


def test_no_motor_saturates_within_the_largest_cost() -> None:
    """On the border of the set x' S x = r, the largest torque is just the motor's limit."""
    robot = acrobot()
    regulator = robot.block().regulator
    limit = robot.torque_limit[robot.driven]

    cost = regulator.largest_cost(limit)

    # Points of the set's border: x = L⁻ᵀ u sqrt(cost) with S = L Lᵀ and unit vectors u.
    random = np.random.default_rng(5)
    directions = random.normal(size=(4, 20000))
    directions /= np.linalg.norm(directions, axis=0)
    border = np.sqrt(cost) * np.linalg.solve(np.linalg.cholesky(regulator.cost).T, directions)
    torques = np.abs(regulator.gain @ border)
    assert torques.max() <= limit[0] * (1 + 1e-9)
    assert torques.max() > 0.98 * limit[0]


@pytest.mark.parametrize(
    ("was_balancing", "distance", "is_balancing"),
    [
        (0.0, 0.99, 1.0),
        (0.0, 1.01, 0.0),
        (1.0, 1.40, 1.0),  # it gives up at twice the cost, which grows with the square: 1.41² = 2
        (1.0, 1.42, 0.0),
    ],
)
def test_it_takes_over_and_gives_up_by_the_cost(
    was_balancing: float, distance: float, is_balancing: float
) -> None:
    """Distances are multiples of the one at which the cost is the largest that no motor's limit disturbs."""
    robot = acrobot()
    block = robot.block()
    largest = block.regulator.largest_cost(robot.torque_limit[robot.driven])
    direction = np.array([1.0, 0.0, 0.0, 0.0])
    distance_of_largest = np.sqrt(largest / (direction @ block.regulator.cost @ direction))
    state = distance * distance_of_largest * direction
    read = {"position": robot.upright + state[:2], "velocity": state[2:]}

    changes = block.sample({"balancing": np.array([was_balancing])}, read)

    assert changes["balancing"] == is_balancing


BALANCING = {"balancing": np.ones(1)}
NEAR_UPRIGHT = np.array([0.01, -0.02])
TURNING = np.array([0.1, 0.2])


def test_upright_is_any_number_of_turns() -> None:
    """Whole turns of the axes do not change the torque of the regulator."""
    robot = acrobot()
    position = robot.upright + NEAR_UPRIGHT
    turned = position + 2 * np.pi * np.array([-2, 3])

    torque = robot.block().sample(BALANCING, {"position": position, "velocity": TURNING})[
        "feedforward"
    ]
    same = robot.block().sample(BALANCING, {"position": turned, "velocity": TURNING})["feedforward"]

    assert torque[1] != 0.0
    np.testing.assert_allclose(same, torque, rtol=1e-9)


def test_axes_may_count_in_the_opposite_sense() -> None:
    """A robot whose axes count the other way round gets the opposite torque in the same state."""
    robot = acrobot()
    mirrored = acrobot(sign=-1.0)
    position = robot.upright + NEAR_UPRIGHT

    torque = robot.block().sample(BALANCING, {"position": position, "velocity": TURNING})[
        "feedforward"
    ]
    opposite = mirrored.block().sample(BALANCING, {"position": -position, "velocity": -TURNING})[
        "feedforward"
    ]

    assert torque[1] != 0.0
    np.testing.assert_allclose(opposite, -torque, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque_limit": np.array([1.0, 1.0])}, r"torque_limit is .*must be 0 for one axis"),
        ({"torque_limit": np.array([0.0, 0.0])}, r"torque_limit is .*must be 0 for one axis"),
        (
            {"upright": np.array([0.0, 1.0]), "key": "posture"},
            r"posture is .*an equilibrium.* 4\.13 N·m",
        ),
    ],
    ids=["no passive axis", "no motor", "no equilibrium"],
)
def test_what_cannot_be_balanced_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidParameter, match=words):
        cart_pole().block(**changes)


def test_a_passive_axis_that_no_motor_moves_is_refused() -> None:
    """Nothing couples two pendulums that hang on the world side by side."""
    plant = MultibodyPlant(time_step=0.0)
    link = (
        '<link name="{0}"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        '<joint name="{0}_joint" type="continuous"><parent link="base"/><child link="{0}"/><axis xyz="0 1 0"/></joint>'
    )
    text = (
        f'<robot name="two"><link name="base"/>{link.format("one")}{link.format("other")}</robot>'
    )
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    axes = AxisMap.of_joints(
        plant, [plant.GetJointByName(f"{name}_joint") for name in ("one", "other")]
    )

    robot = Robot(plant, axes, np.array([9.0, 0.0]), np.array([0.0, np.pi]), np.array([True, True]))

    with pytest.raises(InvalidParameter, match="a posture that the motors can balance"):
        robot.block()
