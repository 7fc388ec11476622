"""Torques of the model: against the closed form of two links in a plane, and the law of the error that they make."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.blocks.model_torque import add_admittance, add_computed_torque, add_feedforward
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.passive_joints import set_friction
from simrob_drake.blocks.servo import ServoGains, ServoSignals
from simrob_drake.parts.controllers.efforts import _ArmWeight
from simrob_drake.robots.axis_map import AxisMap

# Two rods that hang down at zero.
MASSES = np.array([3.0, 2.0])  # [kg]
LENGTHS = np.array([0.4, 0.3])  # [m]
GRAVITY = 9.81  # [m/s²]
SIGNS = np.array([1.0, -1.0])
NONE = np.zeros(2)
UNLIMITED = np.full(2, np.inf)
GAINS = ServoGains(
    kp=np.array([100.0, 50.0]),
    ki=NONE,
    kd=np.array([20.0, 3.0]),
    torque_limit=UNLIMITED,
    integral_limit=UNLIMITED,
)


def two_links() -> tuple[MultibodyPlant, AxisMap]:
    """Make a plant of rods that turn about y, the second axis counted the other way round, and of a body that flies."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -GRAVITY]))
    plant.AddRigidBody("stone", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
    joints = []
    parent = plant.world_frame()
    about_y = np.array([0.0, -1.0, 0.0])
    for index, (mass, length) in enumerate(zip(MASSES, LENGTHS, strict=True)):
        middle = np.array([0.0, 0.0, -length / 2])
        about_end = UnitInertia.ThinRod(length, np.array([0.0, 0.0, 1.0])).ShiftFromCenterOfMass(
            -middle
        )
        link = plant.AddRigidBody(f"link_{index}", SpatialInertia(mass, middle, about_end))
        frame = parent
        if index:
            ahead = RigidTransform(np.array([0.0, 0.0, -LENGTHS[index - 1]]))
            frame = plant.AddFrame(FixedOffsetFrame(f"end_{index}", parent, ahead))
        joint = RevoluteJoint(f"joint_{index}", frame, link.body_frame(), about_y)
        joints.append(plant.AddJoint(joint))
        plant.AddJointActuator(f"motor_{index}", joints[-1])
        parent = link.body_frame()
    plant.Finalize()
    for joint in joints:
        joint.set_default_angle(0.7)  # another position than any that a test asks for
    return plant, AxisMap.of_joints(plant, joints, SIGNS)


def closed_form(
    positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray
) -> np.ndarray:
    """Torques of the axes of two rods, shape (2,) [N·m]: M(q) a + h(q, v) + g(q) (J. J. Craig, section 6.7).

    Args:
        positions: positions of the axes, shape (2,) [rad]. The second axis is counted the other way round.
        velocities: velocities of the axes, shape (2,) [rad/s].
        accelerations: accelerations of the axes, shape (2,) [rad/s²].
    """
    m1, m2 = MASSES
    l1, l2 = LENGTHS
    q1, q2 = SIGNS * positions
    v1, v2 = SIGNS * velocities

    # A rod has the inertia m l² / 3 about its end, and its centre of mass in its middle.
    end_inertia_1 = m1 * l1**2 / 3
    end_inertia_2 = m2 * l2**2 / 3
    cross = m2 * l1 * l2 / 2
    coupling = end_inertia_2 + cross * np.cos(q2)
    whole = end_inertia_1 + m2 * l1**2 + end_inertia_2 + 2 * cross * np.cos(q2)
    inertia = np.array([[whole, coupling], [coupling, end_inertia_2]])
    coriolis = cross * np.sin(q2) * np.array([-(2 * v1 * v2 + v2**2), v1**2])
    lower_weight = m2 * GRAVITY * l2 / 2 * np.sin(q1 + q2)
    upper_weight = (m1 / 2 + m2) * GRAVITY * l1 * np.sin(q1)
    weight = np.array([upper_weight + lower_weight, lower_weight])
    return SIGNS * (inertia @ (SIGNS * accelerations) + coriolis + weight)


def sources(builder: DiagramBuilder, values: dict[str, np.ndarray]) -> dict[str, OutputPort]:
    """Add a constant source for each value. Returns their outputs by name."""
    ports = {}
    for name, value in values.items():
        ports[name] = builder.AddNamedSystem(name, ConstantVectorSource(value)).get_output_port()
    return ports


def whole_state(plant: MultibodyPlant, axes: AxisMap, state: np.ndarray) -> np.ndarray:
    """State of the plant with that of the axes (4,) put in; all else is as at the start."""
    whole = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    belongs_to_axes = axes.state_matrix.any(axis=0)
    whole[belongs_to_axes] = 0.0
    return whole + axes.state_matrix.T @ state


def evaluated(builder: DiagramBuilder, port: OutputPort) -> np.ndarray:
    """Build the diagram, and evaluate one of its ports in the default context."""
    builder.ExportOutput(port, "result")
    diagram = builder.Build()
    return np.asarray(diagram.GetOutputPort("result").Eval(diagram.CreateDefaultContext()))


def some_motion() -> dict[str, np.ndarray]:
    """A desired motion and a measured state of two axes at random."""
    random = np.random.default_rng(4)
    return {
        "reference": random.uniform(-2, 2, 2),
        "state": random.uniform(-2, 2, 4),
        "reference_velocity": random.uniform(-3, 3, 2),
        "reference_acceleration": random.uniform(-5, 5, 2),
    }


@pytest.mark.parametrize("moving", [True, False])
def test_the_feedforward_is_the_closed_form_of_what_is_asked_for(moving: bool) -> None:
    """The feedforward without a desired velocity and acceleration is that of a robot at rest."""
    plant, axes = two_links()
    builder = DiagramBuilder()
    values = some_motion()
    ports = sources(builder, values)
    velocity = values["reference_velocity"]
    acceleration = values["reference_acceleration"]
    if not moving:
        del ports["reference_velocity"], ports["reference_acceleration"]
        velocity = acceleration = np.zeros(2)

    (torque,) = add_feedforward(builder, plant, [(axes, ServoSignals(**ports))], name="model")

    expected = closed_form(values["reference"], velocity, acceleration)
    np.testing.assert_allclose(evaluated(builder, torque), expected, atol=1e-10)


@pytest.mark.parametrize("pushed", [True, False])
def test_the_computed_torque_is_that_of_the_acceleration_that_is_wanted(pushed: bool) -> None:
    """The torque gives the axes ddq_r + kd (dq_r - v) + kp (q_r - q); a feedforward is added to it."""
    plant, axes = two_links()
    builder = DiagramBuilder()
    values = some_motion()
    signals = dict(values)
    feedforward = np.zeros(2)
    if pushed:
        feedforward = signals["feedforward"] = np.array([1.0, 2.0])
    state = ConstantVectorSource(whole_state(plant, axes, values["state"]))
    state_port = builder.AddSystem(state).get_output_port()
    ports = sources(builder, signals)

    torque = add_computed_torque(
        builder, plant, state_port, axes, ServoSignals(**ports), GAINS, name="law"
    )

    position, velocity = np.hsplit(values["state"], 2)
    position_error = values["reference"] - position
    velocity_error = values["reference_velocity"] - velocity
    wanted = (
        values["reference_acceleration"] + GAINS.kd * velocity_error + GAINS.kp * position_error
    )
    expected = closed_form(position, velocity, wanted) + feedforward
    np.testing.assert_allclose(evaluated(builder, torque), expected, atol=1e-10)


@pytest.mark.parametrize("has_more_signals", [True, False])
def test_the_admittance_integrates_the_torque_that_the_model_does_not_explain(
    has_more_signals: bool,
) -> None:
    """x' = K (ID - kp (q_r - q) + kd (v - v_r) - tau_ff - x), with the terms of the signals that are wired."""
    builder = DiagramBuilder()
    values = some_motion()
    values["feedforward"] = np.array([1.5, -2.5])
    model_torque = np.array([4.0, -3.0])
    gain = 20.0  # [1/s]
    state_of_block = np.array([0.7, -0.4])
    ports = sources(builder, {**values, "model": model_torque})
    model = ports.pop("model")
    del ports["reference_acceleration"]
    if not has_more_signals:
        del ports["reference_velocity"], ports["feedforward"]

    torque = add_admittance(builder, ServoSignals(**ports), GAINS, model, gain=gain, prefix="")
    builder.ExportOutput(torque, "torque")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState(state_of_block)

    q, v = np.hsplit(values["state"], 2)
    desired_velocity = values["reference_velocity"] if has_more_signals else 0.0
    feedforward = values["feedforward"] if has_more_signals else 0.0
    explained = (
        GAINS.kp * (values["reference"] - q) - GAINS.kd * (v - desired_velocity) + feedforward
    )
    rates = diagram.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(
        rates, gain * (model_torque - explained - state_of_block), rtol=1e-12
    )
    np.testing.assert_array_equal(diagram.GetOutputPort("torque").Eval(context), state_of_block)


def test_the_momentum_observer_finds_torques_from_outside_on_links_whose_inertia_changes() -> None:
    """Two rods swing as sines, so their inertia and Coriolis torques change; the servos lack constant torques."""
    plant, axes = two_links()
    period = 1e-3  # [s]
    gain = 10.0  # [1/s]
    times = period * np.arange(200)
    external = np.array([0.3, -0.2])  # [N·m]
    observer = MomentumObserver(plant=plant, axes=axes, gain=gain, period=period)
    amplitude = np.array([0.8, 1.1])  # [rad]
    rate = np.array([6.0, 9.0])  # [rad/s]
    phase = np.array([0.2, 1.0])  # [rad]

    memory = np.full(6, np.inf)  # no sample was taken yet
    estimates = []
    for time in times:
        angle = rate * time + phase
        q = amplitude * np.sin(angle)
        v = amplitude * rate * np.cos(angle)
        a = -amplitude * rate**2 * np.sin(angle)
        servo_torque = closed_form(q, v, a) - external
        state = whole_state(plant, axes, np.concatenate([q, v]))
        memory = observer.next_state(memory, state, servo_torque)
        estimates.append(memory[:2])

    # A first-order filter with the time constant 1 / gain finds a constant torque.
    share = 1 - np.exp(-gain * times)
    np.testing.assert_allclose(estimates, external * share[:, np.newaxis], atol=2e-3)


def test_friction_takes_the_rotor_of_a_motor_over_so_that_it_counts_once() -> None:
    """With and without friction, the mass matrix has the motor's reflected rotor inertia exactly once."""
    gear_ratio = 10.0
    rotor_inertia = 0.01  # [kg m²]
    inertias = []

    for friction in (0.0, 5.0):
        plant = MultibodyPlant(0.0)
        body = plant.AddRigidBody(
            "link", SpatialInertia(2.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
        )
        upward = np.array([0.0, 0.0, 1.0])
        joint = plant.AddJoint(
            RevoluteJoint("joint", plant.world_frame(), body.body_frame(), upward)
        )
        motor = plant.AddJointActuator("motor", joint)
        motor.set_default_gear_ratio(gear_ratio)
        motor.set_default_rotor_inertia(rotor_inertia)

        set_friction(plant, [joint], np.array([friction]), speed=0.01)
        plant.Finalize()

        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
        assert len(actuators) == (2 if friction else 1)
        reflected = sum(
            each.default_gear_ratio() ** 2 * each.default_rotor_inertia() for each in actuators
        )
        assert reflected == pytest.approx(gear_ratio**2 * rotor_inertia)
        inertias.append(plant.CalcMassMatrix(plant.CreateDefaultContext())[0, 0])

    assert inertias[1] == pytest.approx(inertias[0])


def test_a_stopped_arm_is_held_where_it_is_by_a_reference_that_carries_its_weight() -> None:
    """A servo at rest gives kp (q_r - q), which must be the torque of gravity."""
    plant, axes = two_links()
    kp = np.array([100.0, 50.0])
    q = np.array([0.6, -1.1])

    offset = _ArmWeight(plant, axes, 1 / kp).compensation(q)

    np.testing.assert_allclose(kp * offset, closed_form(q, np.zeros(2), np.zeros(2)), atol=1e-10)
