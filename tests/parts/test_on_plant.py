"""Servos, motors, monitors, contact sensors and IMUs on a plant without any station, against their equations."""

import numpy as np
import pytest
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import (
    add_contact_sensor,
    add_imu,
    add_joint_limit_monitor,
    add_joint_servos,
    add_monitor,
)
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.on_plant import _effort_limits
from simrob_drake.robots.motors import Motor

# Two links that turn about y, in a row. Only the elbow has an actuator, with an effort limit of 8 N·m.
TWO_LINKS = """
<robot name="links">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -1"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="1.5" effort="8" velocity="10"/></joint>
  TRANSMISSIONS
</robot>
"""
TRANSMISSION = """
  <transmission name="JOINT_motor"><type>transmission_interface/SimpleTransmission</type>
    <joint name="JOINT"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="JOINT_motor"/></transmission>
"""


def links(*driven, time_step=0.0):
    """Make a builder with a finalized plant of the two links, hung from the world."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
    transmissions = "".join(TRANSMISSION.replace("JOINT", joint) for joint in driven)
    Parser(plant).AddModelsFromString(TWO_LINKS.replace("TRANSMISSIONS", transmissions), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return builder, plant


def torques_at(builder, plant, servos, state, **inputs):
    """Evaluate the torques of servos, shape (n,), in a state (nq + nv,) with inputs by name."""
    for name in inputs:
        builder.ExportInput(getattr(servos, name), name)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    for name, values in inputs.items():
        diagram.GetInputPort(name).FixValue(context, values)
    system = servos.torque.get_system()
    torque = servos.torque.Eval(system.GetMyContextFromRoot(context))
    generalized = plant.get_net_actuation_output_port().Eval(plant.GetMyContextFromRoot(context))
    return torque, generalized


STATE = np.array([0.3, -0.4, 1.2, -0.7])  # rad, rad, rad/s, rad/s


@pytest.mark.parametrize("order", [["shoulder", "elbow"], ["elbow", "shoulder"]])
def test_the_law_of_the_servos(order):
    builder, plant = links("shoulder", "elbow")
    servos = add_joint_servos(
        builder,
        plant,
        order,
        kp={"shoulder": 20.0, "elbow": 30.0},
        kd={"shoulder": 2.0, "elbow": 3.0},
        torque_limit={"shoulder": 50.0},
        with_reference_velocity=True,
        with_feedforward=True,
    )
    places = {"shoulder": 0, "elbow": 1}
    kp, kd, most = (
        {"shoulder": 20.0, "elbow": 30.0},
        {"shoulder": 2.0, "elbow": 3.0},
        {"shoulder": 50.0, "elbow": 8.0},
    )
    desired, speed, extra = np.array([1.0, 0.5]), np.array([0.2, -0.1]), np.array([0.4, -0.6])
    torque, _ = torques_at(
        builder,
        plant,
        servos,
        STATE,
        reference=desired,
        reference_velocity=speed,
        feedforward=extra,
    )
    for index, joint in enumerate(order):
        position, velocity = STATE[places[joint]], STATE[2 + places[joint]]
        command = (
            kp[joint] * (desired[index] - position)
            - kd[joint] * (velocity - speed[index])
            + extra[index]
        )
        assert torque[index] == pytest.approx(
            np.clip(command, -most[joint], most[joint]), abs=1e-12
        )
    # the effort limit of the file saturates it
    assert torque[order.index("elbow")] == pytest.approx(8.0)
    assert servos.passive == []


def test_a_joint_without_an_actuator_is_passive():
    builder, plant = links("elbow")
    servos = add_joint_servos(builder, plant, kp=5.0, kd=1.0)
    assert servos.joints == ["shoulder", "elbow"]
    assert servos.passive == ["shoulder"]
    torque, net = torques_at(builder, plant, servos, STATE, reference=np.ones(2))
    expected = 5.0 * (1.0 - STATE[1]) - 1.0 * STATE[3]
    np.testing.assert_allclose(torque, [0.0, expected], atol=1e-12)
    np.testing.assert_allclose(net, [expected], atol=1e-12)


def test_a_plant_without_actuators_has_no_servos_to_connect():
    builder, plant = links()
    servos = add_joint_servos(builder, plant, kp=5.0, kd=1.0)
    torque, _ = torques_at(builder, plant, servos, STATE, reference=np.ones(2))
    np.testing.assert_array_equal(torque, np.zeros(2))


@pytest.mark.parametrize("speed", [-4.0, 0.0, 2.0, 6.0, 9.0])
def test_a_motor_has_less_torque_the_faster_it_turns(speed):
    """With its whole voltage it gives stall (1 - v / v_0) in the direction of the command."""
    builder, plant = links("shoulder", "elbow")
    motor = Motor(stall_torque=6.0, no_load_speed=8.0)
    servos = add_joint_servos(
        builder, plant, kp=1000.0, kd=0.0, torque_limit=100.0, motor={"elbow": motor}
    )
    state = np.array([0.0, 0.0, 0.0, speed])
    torque, _ = torques_at(builder, plant, servos, state, reference=np.array([0.0, 1.0]))
    assert torque[1] == pytest.approx(6.0 * (1 - speed / 8.0), abs=1e-12)


def test_servos_hold_the_links_against_gravity():
    builder, plant = links("shoulder", "elbow")
    servos = add_joint_servos(builder, plant, kp=500.0, kd=40.0, torque_limit=100.0)
    builder.ExportInput(servos.reference, "reference")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    diagram.GetInputPort("reference").FixValue(simulator.get_mutable_context(), [0.5, 0.5])
    simulator.AdvanceTo(3.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    gravity = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(plant.GetPositions(context), 0.5 + gravity / 500.0, atol=1e-3)


def test_a_monitor_of_joint_limits_ends_the_run():
    builder, plant = links("elbow")
    add_joint_limit_monitor(builder, plant, ["elbow"], margin=0.1)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetVelocities(context, [0.0, 12.0])
    status = simulator.AdvanceTo(2.0)
    assert status.reason() == status.ReturnReason.kReachedTerminationCondition
    assert "elbow reached a joint limit at 1.4" in status.message()
    assert plant.GetPositions(context)[1] >= 1.4


def test_a_monitor_of_ones_own_waits():
    builder, plant = links()
    ports = {"state": plant.get_state_output_port()}
    add_monitor(
        builder,
        ports,
        excess=lambda state: state[0],
        why=lambda state: "positive",
        hold=0.2,
        after=0.1,
    )
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    plant.SetPositions(
        plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()), [0.5, 0.0]
    )
    status = simulator.AdvanceTo(2.0)
    assert status.message().endswith("positive")
    assert simulator.get_context().get_time() == pytest.approx(0.3, abs=0.02)


def ball_on_table():
    """Make a builder with a ball of 2 kg that rests on a box of the world."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    inertia = SpatialInertia(2.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    ball = plant.AddRigidBody("ball", plant.AddModelInstance("ball"), inertia)
    material = ProximityProperties()
    AddContactMaterial(10.0, 1e4, CoulombFriction(0.5, 0.5), material)
    plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(0.1), "ball", material)
    ground = RigidTransform([0, 0, -0.5])
    plant.RegisterCollisionGeometry(plant.world_body(), ground, Box(5, 5, 1), "table", material)
    plant.SetDefaultFloatingBaseBodyPose(ball, RigidTransform([0, 0, 0.101]))
    plant.Finalize()
    return builder, plant


def test_contact_sensors_measure_the_weight():
    builder, plant = ball_on_table()
    on_ball = add_contact_sensor(builder, plant, "ball", other="world")
    on_table = add_contact_sensor(builder, plant, "world", name="table")
    diagram = builder.Build()
    assert sum(name.get_name() == "plant.contacts" for name in diagram.GetSystems()) == 1
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    weight = 2.0 * 9.81
    for port, sign in ((on_ball, 1.0), (on_table, -1.0)):
        force = port.Eval(port.get_system().GetMyContextFromRoot(simulator.get_context()))[:3]
        np.testing.assert_allclose(force, [0, 0, sign * weight], atol=0.05)


@pytest.mark.parametrize(("falls", "expected"), [(False, 9.81), (True, 0.0)])
def test_an_imu_feels_its_weight_but_not_in_free_fall(falls, expected):
    builder, plant = ball_on_table()
    imu = add_imu(builder, plant, "ball", rate=100.0)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    if falls:
        body = plant.GetBodyByName("ball")
        plant.SetFreeBodyPose(
            plant.GetMyMutableContextFromRoot(context), body, RigidTransform([0, 0, 50])
        )
    simulator.AdvanceTo(1.0)
    force = imu.GetOutputPort("specific_force").Eval(imu.GetMyContextFromRoot(context))
    np.testing.assert_allclose(force, [0, 0, expected], atol=0.02)


class TestErrors:
    """Each error is one line that says what would be right."""

    @pytest.mark.parametrize(
        ("arguments", "match"),
        [
            ({"joints": ["sholder"]}, "shoulder"),
            ({"joints": "elbow"}, "a list of joint names"),
            ({"joints": []}, "at least one"),
            ({"joints": ["elbow", "elbow"]}, "different joint names"),
            ({"kp": [1.0, 2.0, 3.0]}, "one number, or 2"),
            ({"kp": {"knee": 1.0}}, "joint for kp"),
            ({"kp": -1.0}, "kp"),
            ({"kp": np.nan}, "must be finite"),
            ({"kp": {"shoulder": 3.0}}, "has no actuator"),
            ({"motor": "perpetuum"}, "motor"),
            ({"motor": Motor()}, "stall_torque"),
        ],
    )
    def test_arguments(self, arguments, match):
        builder, plant = links("elbow")
        with pytest.raises(SimrobError, match=match):
            add_joint_servos(builder, plant, **{"kp": 1.0, "kd": 1.0, **arguments})

    def test_too_much_damping_for_the_step(self):
        builder, plant = links("elbow", time_step=0.01)
        mass = plant.CalcMassMatrix(plant.CreateDefaultContext())
        largest = 2 / np.linalg.inv(mass)[1, 1] / 0.01
        with pytest.raises(
            SimrobError, match=rf"kd\['elbow'\].*at most {largest:.3g} at steps of 0.01 s"
        ):
            add_joint_servos(builder, plant, kp=1.0, kd=1.01 * largest)
        assert add_joint_servos(builder, plant, kp=1.0, kd=0.99 * largest).joints == [
            "shoulder",
            "elbow",
        ]

    def test_actuators_are_connected_once(self):
        builder, plant = links("elbow")
        add_joint_servos(builder, plant, kp=1.0, kd=1.0)
        with pytest.raises(SimrobError, match="actuators of links are already connected"):
            add_joint_servos(builder, plant, kp=1.0, kd=1.0, name="again")

    def test_the_plant(self):
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
        with pytest.raises(SimrobError, match=r"call plant\.Finalize"):
            add_joint_servos(builder, plant, kp=1.0, kd=1.0)
        plant.Finalize()
        with pytest.raises(SimrobError, match="not in this builder"):
            add_imu(DiagramBuilder(), plant, "world")
        with pytest.raises(SimrobError, match="plant is"):
            add_imu(builder, "plant", "world")

    def test_names_of_bodies_and_frames(self):
        builder, plant = links("elbow")
        with pytest.raises(SimrobError, match="lower"):
            add_contact_sensor(builder, plant, "lowr")
        with pytest.raises(SimrobError, match="a body with collision shapes"):
            add_contact_sensor(builder, plant, "lower")
        with pytest.raises(SimrobError, match="upper"):
            add_imu(builder, plant, "uper")
        with pytest.raises(SimrobError, match=r"rate.*Hz"):
            add_imu(builder, plant, "upper", rate=0.0)


def test_the_first_actuator_of_a_joint_is_its_motor() -> None:
    """Further actuators, which may model friction, do not change the limit of the servo."""
    plant = MultibodyPlant(0.0)
    link = plant.AddRigidBody("link", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    joint = plant.AddJoint(
        RevoluteJoint("joint", plant.world_frame(), link.body_frame(), [0, 1, 0])
    )
    plant.AddJointActuator("motor", joint, 30.0)
    plant.AddJointActuator("friction", joint, 999.0)
    plant.Finalize()

    np.testing.assert_array_equal(_effort_limits(plant, [joint]), [30.0])
