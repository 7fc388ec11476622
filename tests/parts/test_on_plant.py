"""Servos, motors, monitors, contact sensors and IMUs on a plant without a station, against their equations."""

from typing import NamedTuple

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
from simrob_drake.base.frames import Vector
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


def links(*driven, time_step=0.0, elbow="revolute"):
    """Make a builder with a finalized plant of the two links, hung from the world.

    Args:
        driven: names of the joints that have an actuator.
        time_step: time step of the plant [s], 0 for a continuous plant.
        elbow: type of the joint elbow.
    """
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
    transmissions = "".join(TRANSMISSION.replace("JOINT", joint) for joint in driven)
    text = TWO_LINKS.replace("TRANSMISSIONS", transmissions).replace('"revolute"', f'"{elbow}"')
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return builder, plant


class Torques(NamedTuple):
    """Torques in a state [N·m].

    Attributes:
        servos: torques that the servos report, shape (n,).
        actuators: torques that the actuators of the plant apply, shape (m,).
    """

    servos: Vector
    actuators: Vector


def torques_at(builder, plant, servos, state, **inputs):
    """Evaluate the torques of servos in a state (nq + nv,) with inputs by name."""
    for name in inputs:
        builder.ExportInput(getattr(servos, name), name)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    for name, values in inputs.items():
        diagram.GetInputPort(name).FixValue(context, values)
    system = servos.torque.get_system()
    return Torques(
        servos=servos.torque.Eval(system.GetMyContextFromRoot(context)),
        actuators=plant.get_net_actuation_output_port().Eval(plant.GetMyContextFromRoot(context)),
    )


STATE = np.array([0.3, -0.4, 1.2, -0.7])  # rad, rad, rad/s, rad/s


@pytest.mark.parametrize("order", [["shoulder", "elbow"], ["elbow", "shoulder"]])
def test_the_law_of_the_servos(order):
    """The torque is kp (reference - q) - kd (v - reference velocity) + feedforward, within the limit."""
    builder, plant = links("shoulder", "elbow")
    kp = {"shoulder": 20.0, "elbow": 30.0}
    kd = {"shoulder": 2.0, "elbow": 3.0}
    servos = add_joint_servos(
        builder,
        plant,
        order,
        kp=kp,
        kd=kd,
        torque_limit={"shoulder": 50.0},
        with_reference_velocity=True,
        with_feedforward=True,
    )
    reference = np.array([1.0, 0.5])
    reference_velocity = np.array([0.2, -0.1])
    feedforward = np.array([0.4, -0.6])

    torques = torques_at(
        builder,
        plant,
        servos,
        STATE,
        reference=reference,
        reference_velocity=reference_velocity,
        feedforward=feedforward,
    ).servos

    # The limit of the elbow is the effort limit of the file.
    limits = {"shoulder": 50.0, "elbow": 8.0}
    positions = {"shoulder": STATE[0], "elbow": STATE[1]}
    velocities = {"shoulder": STATE[2], "elbow": STATE[3]}
    for index, joint in enumerate(order):
        position_part = kp[joint] * (reference[index] - positions[joint])
        velocity_part = kd[joint] * (velocities[joint] - reference_velocity[index])
        command = position_part - velocity_part + feedforward[index]
        expected = np.clip(command, -limits[joint], limits[joint])
        assert torques[index] == pytest.approx(expected, abs=1e-12)
    assert torques[order.index("elbow")] == pytest.approx(8.0)
    assert servos.passive == []


def test_a_joint_without_an_actuator_is_passive():
    builder, plant = links("elbow")

    servos = add_joint_servos(builder, plant, kp=5.0, kd=1.0)
    torques = torques_at(builder, plant, servos, STATE, reference=np.ones(2))

    assert servos.joints == ["shoulder", "elbow"]
    assert servos.passive == ["shoulder"]
    elbow_torque = 5.0 * (1.0 - STATE[1]) - 1.0 * STATE[3]
    np.testing.assert_allclose(torques.servos, [0.0, elbow_torque], atol=1e-12)
    np.testing.assert_allclose(torques.actuators, [elbow_torque], atol=1e-12)


def test_servos_of_a_plant_without_actuators_have_no_torque():
    builder, plant = links()

    servos = add_joint_servos(builder, plant, kp=5.0, kd=1.0)

    torques = torques_at(builder, plant, servos, STATE, reference=np.ones(2))
    np.testing.assert_array_equal(torques.servos, np.zeros(2))


@pytest.mark.parametrize("speed", [-4.0, 0.0, 2.0, 6.0, 9.0])
def test_a_motor_has_less_torque_the_faster_it_turns(speed):
    """The largest torque in the direction of the command is stall (1 - v / v_0)."""
    builder, plant = links("shoulder", "elbow")
    motor = Motor(stall_torque=6.0, no_load_speed=8.0)
    servos = add_joint_servos(
        builder, plant, kp=1000.0, kd=0.0, torque_limit=100.0, motor={"elbow": motor}
    )
    state = np.array([0.0, 0.0, 0.0, speed])

    torques = torques_at(builder, plant, servos, state, reference=np.array([0.0, 1.0]))

    assert torques.servos[1] == pytest.approx(6.0 * (1 - speed / 8.0), abs=1e-12)


def test_servos_hold_the_links_against_gravity():
    builder, plant = links("shoulder", "elbow")
    servos = add_joint_servos(builder, plant, kp=500.0, kd=40.0, torque_limit=100.0)
    builder.ExportInput(servos.reference, "reference")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    diagram.GetInputPort("reference").FixValue(simulator.get_mutable_context(), [0.5, 0.5])

    simulator.AdvanceTo(3.0)

    # At rest the servos carry the weight: kp (reference - q) = -gravity.
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

    # The limit is at 1.5 rad, and the margin 0.1 rad.
    assert status.reason() == status.ReturnReason.kReachedTerminationCondition
    assert "elbow came within 0.1 rad of a joint limit, at 1.4" in status.message()
    assert status.message().endswith(" rad")
    assert plant.GetPositions(context)[1] >= 1.4


@pytest.mark.parametrize(
    ("kind", "margin", "reason"),
    [
        ("revolute", 0.0, "elbow reached a joint limit at 1.6 rad"),
        ("revolute", -0.1, "elbow reached a joint limit at 1.6 rad"),
        ("prismatic", 0.0, "elbow reached a joint limit at 1.6 m"),
        ("prismatic", 0.2, "elbow came within 0.2 m of a joint limit, at 1.6 m"),
    ],
)
def test_the_reason_of_a_joint_limit_has_a_unit_and_the_margin(kind, margin, reason):
    builder, plant = links("elbow", elbow=kind)
    add_joint_limit_monitor(builder, plant, ["elbow"], margin=margin)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    # Beyond the limit of 1.5 from the start.
    plant.SetPositions(context, [0.0, 1.6])

    assert reason in simulator.AdvanceTo(0.1).message()


def test_a_monitor_ends_the_run_when_its_condition_has_lasted():
    """The condition holds from the start, is watched after 0.1 s, and must last for 0.2 s."""
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
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, [0.5, 0.0])

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
    simulator = Simulator(diagram)

    simulator.AdvanceTo(1.0)

    def measured_force(port):
        return port.Eval(port.get_system().GetMyContextFromRoot(simulator.get_context()))[:3]

    weight = 2.0 * 9.81
    np.testing.assert_allclose(measured_force(on_ball), [0, 0, weight], atol=0.05)
    np.testing.assert_allclose(measured_force(on_table), [0, 0, -weight], atol=0.05)
    # Both sensors share the block that reads the contacts.
    names = [system.get_name() for system in diagram.GetSystems()]
    assert names.count("plant.contacts") == 1


@pytest.mark.parametrize(
    ("height", "expected"), [(0.101, 9.81), (50.0, 0.0)], ids=["at rest", "in free fall"]
)
def test_an_imu_measures_gravity_at_rest_and_zero_in_free_fall(height, expected):
    builder, plant = ball_on_table()
    imu = add_imu(builder, plant, "ball", rate=100.0)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    pose = RigidTransform([0, 0, height])
    plant.SetFreeBodyPose(plant_context, plant.GetBodyByName("ball"), pose)

    simulator.AdvanceTo(1.0)

    force = imu.GetOutputPort("specific_force").Eval(imu.GetMyContextFromRoot(context))
    np.testing.assert_allclose(force, [0, 0, expected], atol=0.02)


class TestErrors:
    """Invalid arguments are refused, each with a message that names what would be right."""

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
        message = rf"kd\['elbow'\].*at most {largest:.3g} at steps of 0.01 s"

        with pytest.raises(SimrobError, match=message):
            add_joint_servos(builder, plant, kp=1.0, kd=1.01 * largest)
        servos = add_joint_servos(builder, plant, kp=1.0, kd=0.99 * largest)

        assert servos.joints == ["shoulder", "elbow"]

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
