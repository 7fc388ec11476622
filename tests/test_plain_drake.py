"""Stations against the same robots wired by hand in plain Drake, which uses nothing of this package but its URDFs.

Both are stepped at fixed steps, so that their motions may differ by rounding alone: 1e-9 rad, m or N·m.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    JointActuatorIndex,
    MultibodyForces,
    PdControllerGains,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.controllers import LinearQuadraticRegulator, PidController
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Linearize,
    Multiplexer,
    Saturation,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.files import models_root

GRAVITY = 9.80665  # m/s², where a station does not say otherwise
TOLERANCE = 1e-9
STEP = 1e-3  # of the discrete solvers [s]
SAP = {"kind": "discrete", "scheme": "sap", "time_step": STEP}


def run(name: str, overrides: Mapping[str, Any]) -> SimulationResult:
    """Run a station."""
    return simulate(load_station(name, overrides), progress=False)


def set_gravity(plant: MultibodyPlant, size: float = GRAVITY) -> None:
    """Set the gravity of a plant [m/s²]."""
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -size])


def positions_at(simulator: Simulator, plant: MultibodyPlant, times: np.ndarray) -> np.ndarray:
    """Simulate to each of the times (m,) [s]; return the plant's positions there, shape (m, nq)."""
    context = plant.GetMyContextFromRoot(simulator.get_context())
    positions = []
    simulator.Initialize()
    for time in times:
        if time > simulator.get_context().get_time():
            simulator.AdvanceTo(time)
        positions.append(plant.GetPositions(context).copy())
    return np.array(positions)


def test_irb120() -> None:
    """The bare arm with a PID and a saturation in each joint, in continuous time."""
    step = 5e-5  # the damping of the servos asks for steps below 2e-4 s at the wrist
    duration = 0.25
    result = run(
        "irb120_dynamic",
        {
            "pieces": {},
            "floor": None,
            "solver": {"kind": "continuous", "scheme": "runge_kutta2", "max_step": step},
            "duration": duration,
        },
    )

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    set_gravity(plant)
    (arm,) = Parser(plant).AddModels(str(models_root() / "irb120" / "irb120.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link"))
    plant.Finalize()

    ramp = PiecewisePolynomial.FirstOrderHold(
        [0.0, 1.0], np.outer(np.ones(6), [0.0, np.deg2rad(30.0)])
    )
    reference = builder.AddSystem(TrajectorySource(ramp))
    no_velocity = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    desired = builder.AddSystem(Multiplexer([6, 6]))
    servos = builder.AddSystem(
        PidController(kp=np.full(6, 1000.0), ki=np.zeros(6), kd=np.full(6, 10.0))
    )
    limits = np.array([150.0, 150.0, 100.0, 30.0, 30.0, 15.0])  # N·m
    motors = builder.AddSystem(Saturation(-limits, limits))
    builder.Connect(reference.get_output_port(), desired.get_input_port(0))
    builder.Connect(no_velocity.get_output_port(), desired.get_input_port(1))
    builder.Connect(plant.get_state_output_port(arm), servos.get_input_port_estimated_state())
    builder.Connect(desired.get_output_port(), servos.get_input_port_desired_state())
    builder.Connect(servos.get_output_port(), motors.get_input_port())
    builder.Connect(motors.get_output_port(), plant.get_actuation_input_port(arm))
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(
        integration_scheme="runge_kutta2", max_step_size=step, use_error_control=False
    )
    ApplySimulatorConfig(config, simulator)

    expected = positions_at(simulator, plant, result.times)
    np.testing.assert_allclose(result.axes("q"), expected, atol=TOLERANCE)
    assert np.ptp(expected, axis=0).min() > 0.01  # all joints move
    torques = motors.get_output_port().Eval(motors.GetMyContextFromRoot(simulator.get_context()))
    # 1000 N·m/rad times the tolerance
    np.testing.assert_allclose(result.axes("tau")[-1], torques, atol=1e-6)


def surface(
    *, stiffness: float, dissipation: float | None, friction: tuple[float, float]
) -> ProximityProperties:
    """Material of a shape: stiffness [N/m], dissipation [s/m], static and dynamic friction."""
    properties = ProximityProperties()
    properties.AddProperty("material", "point_contact_stiffness", stiffness)
    properties.AddProperty("material", "coulomb_friction", CoulombFriction(*friction))
    if dissipation is not None:
        properties.AddProperty("material", "hunt_crossley_dissipation", dissipation)
    return properties


def test_ball() -> None:
    """A ball that falls on the floor and bounces, in continuous time."""
    step = 1e-4
    solver = {"kind": "continuous", "scheme": "runge_kutta2", "max_step": step}
    result = run("bouncing_ball", {"solver": solver, "duration": 0.8, "contact.stiffness": 1000})

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    set_gravity(plant)
    radius = 0.06  # m
    mass = 0.9048  # kg
    moment = 1.303e-3 / mass  # of inertia, for a mass of 1 kg [m²]
    ball = plant.AddRigidBody(
        "ball", SpatialInertia(mass, np.zeros(3), UnitInertia(moment, moment, moment))
    )
    # Two springs of 2000 N/m in a row are one of 1000 N/m.
    material = surface(stiffness=2000.0, dissipation=0.011, friction=(1.0, 0.9))
    plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(radius), "ball", material)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "floor", material
    )
    plant.SetDefaultFloatingBaseBodyPose(ball, RigidTransform([0.0, 0.0, 0.16]))
    plant.Finalize()
    plant.set_stiction_tolerance(1e-3)
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(
        integration_scheme="runge_kutta2", max_step_size=step, use_error_control=False
    )
    ApplySimulatorConfig(config, simulator)

    heights = positions_at(simulator, plant, result.times)[:, 6]
    np.testing.assert_allclose(result["piece.ball.z"], heights, atol=TOLERANCE)
    assert heights.min() < radius  # it sinks into the floor
    assert np.diff(np.sign(np.diff(heights))).min() < 0  # and comes up again, to an apex


FOOT_SPHERES = [
    (0.055125, 0.04725, -0.02),
    (-0.055125, 0.04725, -0.02),
    (-0.055125, -0.102375, -0.02),
    (0.055125, -0.102375, -0.02),
    (0.055125, -0.133875, -0.02),
    (-0.055125, -0.133875, -0.02),
]
"""Middles of the contact spheres of a foot of the humanoid, in its link [m]."""
HUMANOID_JOINTS = [
    ("right_shoulder_frontal", 1),
    ("right_shoulder_sagittal", 1),
    ("right_elbow", 1),
    ("right_wrist", 1),
    ("right_hip_sagittal", 1),
    ("right_hip_frontal", -1),
    ("right_knee", 1),
    ("right_ankle", 1),
    ("left_shoulder_frontal", -1),
    ("left_shoulder_sagittal", 1),
    ("left_elbow", 1),
    ("left_wrist", 1),
    ("left_hip_sagittal", 1),
    ("left_hip_frontal", 1),
    ("left_knee", -1),
    ("left_ankle", 1),
    ("trunk_shoulder", 1),
    ("shoulder_neck", 1),
]
"""Joints of the humanoid in the order of its axes, and the sense of each axis against its joint."""


def test_humanoid() -> None:
    """A humanoid on its own feet that lifts its arms and bends its knees, with Drake's own servos."""
    targets = {
        "right_shoulder_pitch": 40,
        "left_shoulder_roll": 20,
        "right_knee": 10,
        "left_knee": 10,
        "neck_yaw": 30,
    }
    duration = 0.4
    reference = {"kind": "ramp", "target_deg": targets, "duration": 0.3}
    result = run(
        "humanoid_dynamic",
        {"solver": SAP, "monitors": {}, "reference": reference, "duration": duration},
    )

    builder = DiagramBuilder()
    settings = MultibodyPlantConfig(time_step=STEP, discrete_contact_approximation="sap")
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    set_gravity(plant)
    (robot,) = Parser(plant).AddModels(str(models_root() / "humanoid" / "humanoid.urdf"))
    source = plant.get_source_id()
    for name in ("right_foot", "left_foot"):
        foot = plant.GetBodyByName(name)
        for shape in plant.GetCollisionGeometriesForBody(foot):
            scene_graph.RemoveRole(source, shape, Role.kProximity)
        for number, point in enumerate(FOOT_SPHERES):
            material = surface(stiffness=2e5, dissipation=50.0, friction=(1.0, 0.9))
            plant.RegisterCollisionGeometry(
                foot, RigidTransform(point), Sphere(0.01), f"{name}_{number}", material
            )
    floor = surface(stiffness=1e9, dissipation=None, friction=(1.0, 0.9))
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "floor", floor
    )
    for index in range(plant.num_actuators()):
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        actuator.set_effort_limit(3.0)  # N·m
        actuator.set_controller_gains(PdControllerGains(p=100.0, d=100.0))
    plant.SetDefaultFloatingBaseBodyPose(
        plant.GetBodyByName("trunk"), RigidTransform([0.0, 0.0, 0.446])
    )
    plant.set_stiction_tolerance(1e-3)
    plant.Finalize()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot)]
    shapes = GeometrySet(
        [shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    )
    scene_graph.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(shapes))

    axes = result.plant.robots["robot"].axes
    joints = {
        axis: plant.GetJointByName(joint)
        for axis, (joint, _) in zip(axes, HUMANOID_JOINTS, strict=True)
    }
    signs = np.array([sign for _, sign in HUMANOID_JOINTS])
    actuated = [
        plant.get_joint_actuator(index).joint().name()
        for index in plant.GetJointActuatorIndices(robot)
    ]
    ends = np.zeros(len(actuated))
    for axis, target in targets.items():
        place = axes.index(axis)
        ends[actuated.index(joints[axis].name())] = signs[place] * np.deg2rad(target)
    ramp = PiecewisePolynomial.FirstOrderHold(
        [0.0, 0.3], np.column_stack([np.zeros(len(ends)), ends])
    )
    target = builder.AddSystem(TrajectorySource(ramp))
    no_velocity = builder.AddSystem(ConstantVectorSource(np.zeros(len(ends))))
    desired = builder.AddSystem(Multiplexer([len(ends)] * 2))
    builder.Connect(target.get_output_port(), desired.get_input_port(0))
    builder.Connect(no_velocity.get_output_port(), desired.get_input_port(1))
    builder.Connect(desired.get_output_port(), plant.get_desired_state_input_port(robot))
    simulator = Simulator(builder.Build())

    expected = positions_at(simulator, plant, result.times)
    places = [joint.position_start() for joint in joints.values()]
    np.testing.assert_allclose(result.axes("q"), signs * expected[:, places], atol=TOLERANCE)
    # The floating base comes first: a quaternion, then x, y and z.
    base = np.column_stack([result[f"base.{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(base, expected[:, 4:7], atol=TOLERANCE)
    assert np.ptp(expected[:, places[0]]) > 0.01


class PlainSwingUp(LeafSystem):
    """Energy swing-up and LQR of one driven and one passive axis, on the functions `model` and `energy` of the state.

    Ports:
        in  ``state`` (4): positions of both axes, then velocities.
        out ``torque`` (1): of the driven axis, held between samples.
    """

    def __init__(
        self,
        *,
        model: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
        energy: Callable[[np.ndarray, np.ndarray], float],
        driven: int,
        upright: np.ndarray,
        turns: np.ndarray,
        gains: tuple[float, float, float],
        regulator: tuple[np.ndarray, np.ndarray],
        catch: float,
    ) -> None:
        super().__init__()
        self._model = model
        self._energy = energy
        self._driven = driven
        self._upright = upright
        self._turns = turns
        self._gains = gains
        self._gain, self._cost = regulator
        self._catch = catch
        self.DeclareVectorInputPort("state", 4)
        self._torque = self.DeclareDiscreteState(1)
        self._balancing = self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("torque", self._torque)
        self.DeclarePeriodicDiscreteUpdateEvent(0.005, 0.0, self._sample)

    def _sample(self, context: Context, discrete: DiscreteValues) -> None:
        """Compute the torque that is held until the next sample."""
        state = self.get_input_port().Eval(context)
        position = state[:2]
        velocity = state[2:]
        error = position - self._upright
        error = np.where(self._turns, (error + np.pi) % (2 * np.pi) - np.pi, error)
        x = np.concatenate([error, velocity])
        was_balancing = context.get_discrete_state(self._balancing).value()[0]
        is_balancing = x @ self._cost @ x < self._catch * (2.0 if was_balancing else 1.0)
        torque = (
            -(self._gain @ x).item() if is_balancing else self._swing(position, velocity, error)
        )
        discrete.set_value(self._torque, [torque])
        discrete.set_value(self._balancing, [float(is_balancing)])

    def _swing(self, position: np.ndarray, velocity: np.ndarray, error: np.ndarray) -> float:
        """Torque that gives the driven axis the acceleration of the energy law."""
        a = self._driven
        p = 1 - a
        mass, bias = self._model(position, velocity)
        speed = velocity[p]
        if abs(speed) < 0.05:
            speed = np.copysign(0.05, speed)
        of_energy, of_position, of_velocity = self._gains
        acceleration = of_energy * self._energy(position, velocity) * mass[a, p] * speed
        acceleration += -of_position * error[a] - of_velocity * velocity[a]
        # From the passive axis's equation: q_p'' = -(M_pa q_a'' + h_p) / M_pp.
        of_passive = -(mass[p, a] * acceleration + bias[p]) / mass[p, p]
        return float(mass[a, a] * acceleration + mass[a, p] * of_passive + bias[a])


def regulator_of(
    plant: MultibodyPlant, upright: np.ndarray, weights: np.ndarray, torque_weight: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gain (1, 4) and cost (4, 4) of the regulator, from Drake's linearisation of a continuous plant."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, upright)
    port = plant.get_actuation_input_port()
    port.FixValue(context, [0.0])
    system = Linearize(plant, context, port.get_index(), plant.get_state_output_port().get_index())
    return LinearQuadraticRegulator(system.A(), system.B(), weights, torque_weight * np.eye(1))


def lone_plant(
    name: str, root: str, *, time_step: float, builder: DiagramBuilder | None = None
) -> MultibodyPlant:
    """A robot alone in a plant, in a diagram unless the builder is None."""
    if builder is None:
        plant = MultibodyPlant(time_step)
    else:
        # With sampled ports, Drake steps the plant before the controller takes a sample of the same time.
        settings = MultibodyPlantConfig(
            time_step=time_step,
            discrete_contact_approximation="sap",
            use_sampled_output_ports=False,
        )
        plant, _ = AddMultibodyPlant(settings, builder)
    set_gravity(plant, 9.81)
    Parser(plant).AddModels(str(models_root() / name / f"{name}.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(root))
    plant.Finalize()
    return plant


def swing_positions(
    plant: MultibodyPlant, builder: DiagramBuilder, block: LeafSystem, times: np.ndarray
) -> np.ndarray:
    """Positions (m, 2) of a robot whose motor gets the torque of a block within its effort limit."""
    limit = plant.get_joint_actuator(JointActuatorIndex(0)).effort_limit()
    builder.AddSystem(block)
    motor = builder.AddSystem(Saturation([-limit], [limit]))
    builder.Connect(plant.get_state_output_port(), block.get_input_port())
    builder.Connect(block.get_output_port(), motor.get_input_port())
    builder.Connect(motor.get_output_port(), plant.get_actuation_input_port())
    return positions_at(Simulator(builder.Build()), plant, times)


def test_cart_pole() -> None:
    """The pole swings up and is balanced, by a controller with the closed form of the cart and its pole."""
    result = run("cart_pole", {"solver": SAP, "duration": 3.0})
    assert result["swing_up.balancing"][-1] == 1.0

    total, mass_length, moment = 11.0, 0.5, 0.25016  # kg, kg m, kg m²

    def model(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sine, cosine = np.sin(position[1]), np.cos(position[1])
        mass = np.array([[total, -mass_length * cosine], [-mass_length * cosine, moment]])
        bias = np.array([mass_length * sine * velocity[1] ** 2, 9.81 * mass_length * sine])
        return mass, bias

    def energy(position: np.ndarray, velocity: np.ndarray) -> float:
        return 0.5 * moment * velocity[1] ** 2 - 9.81 * mass_length * (np.cos(position[1]) + 1.0)

    upright = np.array([0.0, np.pi])
    alone = lone_plant("cart_pole", "rail", time_step=0.0)
    gain, cost = regulator_of(alone, upright, np.diag([10.0, 10.0, 1.0, 1.0]), 0.01)
    builder = DiagramBuilder()
    plant = lone_plant("cart_pole", "rail", time_step=STEP, builder=builder)
    block = PlainSwingUp(
        model=model,
        energy=energy,
        driven=0,
        upright=upright,
        turns=np.array([False, True]),
        gains=(1.0, 1.0, 1.0),
        regulator=(gain, cost),
        catch=100.0**2 / (gain @ np.linalg.solve(cost, gain.T)).item(),
    )
    expected = swing_positions(plant, builder, block, result.times)
    np.testing.assert_allclose(result.axes("q"), expected, atol=TOLERANCE)


def test_acrobot() -> None:
    """The first two swings, with the equations of motion of a plant of plain Drake in the controller."""
    result = run("acrobot", {"solver": SAP, "duration": 2.0})

    alone = lone_plant("acrobot", "base", time_step=0.0)
    context = alone.CreateDefaultContext()

    def model(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        alone.SetPositions(context, position)
        alone.SetVelocities(context, velocity)
        forces = MultibodyForces(alone)
        alone.CalcForceElementsContribution(context, forces)
        return alone.CalcMassMatrix(context), alone.CalcInverseDynamics(
            context, np.zeros(2), forces
        )

    def energy(position: np.ndarray, velocity: np.ndarray) -> float:
        alone.SetPositions(context, [np.pi, 0.0])
        top = alone.CalcPotentialEnergy(context)
        alone.SetPositions(context, position)
        alone.SetVelocities(context, velocity)
        return alone.CalcPotentialEnergy(context) + alone.CalcKineticEnergy(context) - top

    upright = np.array([np.pi, 0.0])
    gain, cost = regulator_of(
        lone_plant("acrobot", "base", time_step=0.0), upright, np.diag([10.0, 10.0, 1.0, 1.0]), 1.0
    )
    builder = DiagramBuilder()
    plant = lone_plant("acrobot", "base", time_step=STEP, builder=builder)
    block = PlainSwingUp(
        model=model,
        energy=energy,
        driven=1,
        upright=upright,
        turns=np.array([True, True]),
        gains=(0.5, 3.0, 5.0),
        regulator=(gain, cost),
        catch=1.5 * 40.0**2 / (gain @ np.linalg.solve(cost, gain.T)).item(),
    )
    expected = swing_positions(plant, builder, block, result.times)
    np.testing.assert_allclose(result.axes("q"), expected, atol=TOLERANCE)
    assert np.ptp(expected, axis=0).min() > 1.0
