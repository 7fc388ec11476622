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

MASSES, LENGTHS, GRAVITY = np.array([3.0, 2.0]), np.array([0.4, 0.3]), 9.81  # kg, m, m/s²: rods that hang down at zero
SIGNS = np.array([1.0, -1.0])


def two_links() -> tuple[MultibodyPlant, AxisMap]:
    """Return rods that turn about y, the second axis counted the other way round, and a body that flies beside."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -GRAVITY]))
    plant.AddRigidBody("stone", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
    joints, parent = [], plant.world_frame()
    for index, (mass, length) in enumerate(zip(MASSES, LENGTHS, strict=True)):
        middle = np.array([0.0, 0.0, -length / 2])
        about_end = UnitInertia.ThinRod(length, np.array([0.0, 0.0, 1.0])).ShiftFromCenterOfMass(-middle)
        link = plant.AddRigidBody(f"link_{index}", SpatialInertia(mass, middle, about_end))
        frame = parent
        if index:
            ahead = RigidTransform(np.array([0.0, 0.0, -LENGTHS[index - 1]]))
            frame = plant.AddFrame(FixedOffsetFrame(f"end_{index}", parent, ahead))
        joints.append(
            plant.AddJoint(RevoluteJoint(f"joint_{index}", frame, link.body_frame(), np.array([0.0, -1.0, 0.0])))
        )
        plant.AddJointActuator(f"motor_{index}", joints[-1])
        parent = link.body_frame()
    plant.Finalize()
    for joint in joints:
        joint.set_default_angle(0.7)  # which is not where they are asked to be
    return plant, AxisMap.of_joints(plant, joints, SIGNS)


def closed_form(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return the torques of two rods (textbook of Craig, 6.7), of axes; q2 is counted the other way round."""
    (m1, m2), (l1, l2) = MASSES, LENGTHS
    (q1, q2), (v1, v2), (a1, a2) = SIGNS * q, SIGNS * v, SIGNS * a
    cross = m2 * l1 * l2 / 2
    inertia = np.array(
        [
            [m1 * l1**2 / 3 + m2 * (l1**2 + l2**2 / 3) + 2 * cross * np.cos(q2), m2 * l2**2 / 3 + cross * np.cos(q2)],
            [m2 * l2**2 / 3 + cross * np.cos(q2), m2 * l2**2 / 3],
        ]
    )
    coriolis = cross * np.sin(q2) * np.array([-(2 * v1 * v2 + v2**2), v1**2])
    lower = m2 * GRAVITY * l2 / 2 * np.sin(q1 + q2)
    weight = np.array([(m1 / 2 + m2) * GRAVITY * l1 * np.sin(q1) + lower, lower])
    return SIGNS * (inertia @ np.array([a1, a2]) + coriolis + weight)


def sources(builder: DiagramBuilder, values: dict[str, np.ndarray]) -> dict[str, OutputPort]:
    return {
        name: builder.AddNamedSystem(name, ConstantVectorSource(value)).get_output_port()
        for name, value in values.items()
    }


def some_motion() -> dict[str, np.ndarray]:
    random = np.random.default_rng(4)
    return {
        "reference": random.uniform(-2, 2, 2),
        "state": random.uniform(-2, 2, 4),
        "reference_velocity": random.uniform(-3, 3, 2),
        "reference_acceleration": random.uniform(-5, 5, 2),
    }


@pytest.mark.parametrize("moving", [True, False])
def test_the_feedforward_is_the_closed_form_of_what_is_asked_for(moving: bool) -> None:
    plant, axes = two_links()
    builder, values = DiagramBuilder(), some_motion()
    ports = sources(builder, values)
    if not moving:
        del ports["reference_velocity"], ports["reference_acceleration"]
    (torque,) = add_feedforward(builder, plant, [(axes, ServoSignals(**ports))], name="model")
    builder.ExportOutput(torque, "torque")
    diagram = builder.Build()
    rest = np.zeros(2)
    motion = (values["reference_velocity"], values["reference_acceleration"]) if moving else (rest, rest)
    found = diagram.GetOutputPort("torque").Eval(diagram.CreateDefaultContext())
    np.testing.assert_allclose(found, closed_form(values["reference"], *motion), atol=1e-10)


@pytest.mark.parametrize("pushed", [True, False])
def test_the_computed_torque_is_that_of_the_acceleration_that_is_wanted(pushed: bool) -> None:
    plant, axes = two_links()
    builder, values = DiagramBuilder(), some_motion()
    ports = sources(builder, {**values, **({"feedforward": np.array([1.0, 2.0])} if pushed else {})})
    kp, kd = np.array([100.0, 50.0]), np.array([20.0, 3.0])
    unlimited = np.full(2, np.inf)
    gains = ServoGains(kp, np.zeros(2), kd, unlimited, unlimited)
    q, v = np.hsplit(values["state"], 2)
    whole = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    whole[axes.state_matrix.any(axis=0)] = 0.0
    state = builder.AddSystem(ConstantVectorSource(whole + axes.state_matrix.T @ values["state"])).get_output_port()
    torque = add_computed_torque(builder, plant, state, axes, ServoSignals(**ports), gains, name="law")
    builder.ExportOutput(torque, "torque")
    diagram = builder.Build()
    wanted = values["reference_acceleration"] + kd * (values["reference_velocity"] - v) + kp * (values["reference"] - q)
    expected = closed_form(q, v, wanted) + ([1.0, 2.0] if pushed else 0.0)
    found = diagram.GetOutputPort("torque").Eval(diagram.CreateDefaultContext())
    np.testing.assert_allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("has_more_signals", [True, False])
def test_the_admittance_integrates_the_torque_that_the_model_does_not_explain(has_more_signals: bool) -> None:
    """x' = K (ID - kp (q_r - q) + kd (v - v_r) - tau_ff - x), with the terms of the signals that are wired."""
    builder, values = DiagramBuilder(), some_motion()
    values["feedforward"] = np.array([1.5, -2.5])
    model_torque = np.array([4.0, -3.0])
    gain, state_of_block = 20.0, np.array([0.7, -0.4])
    kp, kd = np.array([100.0, 50.0]), np.array([20.0, 3.0])
    unlimited = np.full(2, np.inf)
    gains = ServoGains(kp, np.zeros(2), kd, unlimited, unlimited)
    ports = sources(builder, {**values, "model": model_torque})
    model = ports.pop("model")
    del ports["reference_acceleration"]
    if not has_more_signals:
        del ports["reference_velocity"], ports["feedforward"]

    torque = add_admittance(builder, ServoSignals(**ports), gains, model, gain=gain, prefix="")
    builder.ExportOutput(torque, "torque")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState(state_of_block)

    q, v = np.hsplit(values["state"], 2)
    desired_velocity = values["reference_velocity"] if has_more_signals else 0.0
    feedforward = values["feedforward"] if has_more_signals else 0.0
    explained = kp * (values["reference"] - q) - kd * (v - desired_velocity) + feedforward
    rates = diagram.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, gain * (model_torque - explained - state_of_block), rtol=1e-12)
    np.testing.assert_array_equal(diagram.GetOutputPort("torque").Eval(context), state_of_block)


def test_the_momentum_observer_finds_torques_from_outside_on_links_whose_inertia_changes() -> None:
    """Two rods swing as sines, so their inertia and Coriolis torques change; the servos lack constant torques."""
    plant, axes = two_links()
    period, gain, count = 1e-3, 10.0, 200
    external = np.array([0.3, -0.2])
    observer = MomentumObserver(plant=plant, axes=axes, gain=gain, period=period)
    amplitude, rate, phase = np.array([0.8, 1.1]), np.array([6.0, 9.0]), np.array([0.2, 1.0])
    rest = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    rest[axes.state_matrix.any(axis=0)] = 0.0

    memory = np.full(6, np.inf)
    estimates = []
    for time in period * np.arange(count):
        angle = rate * time + phase
        q, v, a = amplitude * np.sin(angle), amplitude * rate * np.cos(angle), -amplitude * rate**2 * np.sin(angle)
        servo_torque = closed_form(q, v, a) - external
        memory = observer.next_state(memory, rest + axes.state_matrix.T @ np.concatenate([q, v]), servo_torque)
        estimates.append(memory[:2])

    expected = external * (1 - np.exp(-gain * period * np.arange(count)))[:, np.newaxis]
    np.testing.assert_allclose(estimates, expected, atol=2e-3)


def test_friction_takes_the_rotor_of_a_motor_over_so_that_it_counts_once() -> None:
    inertias = []
    for friction in (0.0, 5.0):
        plant = MultibodyPlant(0.0)
        body = plant.AddRigidBody("link", SpatialInertia(2.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
        upward = np.array([0.0, 0.0, 1.0])
        joint = plant.AddJoint(RevoluteJoint("joint", plant.world_frame(), body.body_frame(), upward))
        motor = plant.AddJointActuator("motor", joint)
        motor.set_default_gear_ratio(10.0)
        motor.set_default_rotor_inertia(0.01)

        set_friction(plant, [joint], np.array([friction]), 0.01)
        plant.Finalize()

        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
        assert len(actuators) == (2 if friction else 1)
        reflected = sum(each.default_gear_ratio() ** 2 * each.default_rotor_inertia() for each in actuators)
        assert reflected == pytest.approx(10.0**2 * 0.01)
        inertias.append(plant.CalcMassMatrix(plant.CreateDefaultContext())[0, 0])
    assert inertias[1] == pytest.approx(inertias[0])


def test_a_stopped_arm_is_held_where_it_is_by_a_reference_that_carries_its_weight() -> None:
    """A servo at rest gives kp (q_r - q), which must be the torque of gravity."""
    plant, axes = two_links()
    kp = np.array([100.0, 50.0])
    q = np.array([0.6, -1.1])

    offset = _ArmWeight(plant, axes, 1 / kp).compensation(q)

    np.testing.assert_allclose(kp * offset, closed_form(q, np.zeros(2), np.zeros(2)), atol=1e-10)
