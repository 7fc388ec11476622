r"""Prescribed joints: joints that follow a given motion while everything else moves by forces.

The section ``prescribed`` of a station gives a *reference* (a trajectory) for each such joint, by the name of its
axis. The joint has no servo. This module adds the blocks that move the joint, and that compute the torque which
the motion takes. The torque is in N·m, or in N for a prismatic joint.

**Moving the joint.** The joint's motor gets a rotor with the inertia :math:`J = 10^6 M_{pp}`, where :math:`M_{pp}` is
the joint's diagonal element of the mass matrix. The rotor is so heavy that nothing else in the station turns it
noticeably. The torque u accelerates it as the reference :math:`q_r` demands, and removes deviations at the rate
:math:`\omega`:

.. math:: u = J\,(\ddot q_r + 2 \omega (\dot q_r - v) + \omega^2 (q_r - q)).

A rotor appears only in the diagonal element of its own joint in the mass matrix. So the rest of the station is
affected by the motion, and not by the rotor. A load that accelerates the joint by a makes it lag by
:math:`10^{-6} a / \omega^2`, which is small compared with the integrator's error. Discrete solvers and ``cenic`` take
the reference as it is at the start of a step, and follow it less exactly: see ``docs/stations.md``.

**The torque that the motion takes.** Continuous schemes compute accelerations to rounding. The torque is what remains
of u when the rotor's part is subtracted:

.. math:: \tau = u - J \dot v + S (\ddot q_r - \dot v).

The last part corrects the torque for the solver's error in :math:`\dot v`. S is the joint's inertia at the start
while the rest of the station moves freely.

Discrete solvers stop at a tolerance that is relative to the momentum of the whole station, rotors included. Where
bodies touch, the difference of the two large numbers u and :math:`J \dot v` is then wrong by thousands of newtons. With
contact the torque is therefore computed from what acts on the links: Drake's *reaction force* in the joint along its
axis, :math:`f`, is inverse dynamics with contact forces and all that is applied, without the rotor. The motor also
overcomes the joint's damping d and Coulomb friction c:

.. math:: \tau = f + S (\ddot q_r - \dot v) + d\,(v + h \dot v) + c\,\mathrm{sat}(v / v_s).

Contact forces themselves have that tolerance: some 2 % of the weight of what touches. Drake's reaction forces do not
include the forces of constraints. So with couplings and contact the first formula is used, and the run warns.

All blocks are C++ primitives of Drake, except for the sensor of reaction forces.
"""

from dataclasses import replace

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, JointActuator, JointActuatorIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Multiplexer, PassThrough

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer
from simrob_drake.blocks.joint_torque import JointTorqueSensor
from simrob_drake.blocks.references import reference_values
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import ServoConfig, StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.servos import passive_axis

_ROTOR_FACTOR = 1e6
"""Inertia of a prescribed joint's rotor, as a multiple of the joint's diagonal element of the mass matrix."""

_CONTINUOUS_RATE = 100.0
"""Rate omega at which deviations are removed, if the solver evaluates the reference within its steps [1/s]."""

_STEPPED_RATE = 20.0
"""Rate omega if the solver takes the reference as it is at the start of a step [1/s]."""

_MOTION_SIZE = 3  # a motion is given by its position, velocity and acceleration


def prescribed_axes(config: StationConfig, robot: str, model: RobotModel) -> dict[str, int]:
    """Find the prescribed axes of a robot, and check that the station can prescribe them.

    Args:
        config: configuration of the station.
        robot: name of the robot.
        model: model of the robot.

    Returns:
        the index of each prescribed axis, by its key in the section ``prescribed``: the name or an alias of the axis,
        after ``<robot>.`` if the station has several robots.

    Raises:
        UnknownName: a key names a robot or an axis that does not exist.
        InvalidParameter: the station is kinematic, the robot has servos that prescribed joints exclude, or an axis is
            passive.
    """
    keys = []  # those of this robot
    for key in config.prescribed:
        if config.only_robot:
            keys.append(key)
            continue
        owner = key.partition(".")[0]
        if owner not in config.robots:
            raise UnknownName(
                message("stations.robot_under_prescribed", "robot under prescribed"),
                key,
                [f"{name}.<axis>" for name in config.robots],
            )
        if owner == robot:
            keys.append(key)
    if not keys:
        return {}
    if not config.engine.moves_by_forces:
        raise Unsuitable(
            "prescribed",
            message(
                "stations.reference_moves_joints",
                "the reference of a kinematic station moves all joints",
            ),
        )
    _check_servo(config.servo_of(robot))
    prefix = config.prefix(robot)
    indices = {key: model.axis_index(key.removeprefix(prefix), "prescribed") for key in keys}
    for key, axis in indices.items():
        if model.passive[axis]:  # a prescribed joint is moved by the rotor of its motor
            raise passive_axis(f"prescribed.{key}", key)
    return indices


def _check_servo(servo: ServoConfig) -> None:
    """Check that the servos of a robot can leave out its prescribed joints.

    Raises:
        InvalidParameter: they cannot, since they are inside of Drake's actuators, or compute torques from the model of
            the whole robot.
    """
    if servo.realization == "implicit":
        raise InvalidParameter(
            "servo.realization",
            "implicit",
            message(
                "stations.prescribed_realization",
                "per_joint or vector, since a prescribed joint has no servo",
            ),
        )
    if servo.law == "computed_torque":
        raise InvalidParameter(
            "servo.law",
            "computed_torque",
            message(
                "stations.prescribed_law",
                "pid or cascade, since a prescribed joint has no servo",
            ),
        )
    if servo.feedforward != "none" or servo.admittance_gain:
        expected = message(
            "stations.without_feedforward",
            "one without feedforward and admittance_gain, since joints are prescribed",
        )
        raise InvalidParameter(
            "servo",
            message("stations.knows_the_model", "one that uses the robot's model"),
            expected,
        )


def with_prescribed_axes(config: StationConfig, robot: ResolvedRobot) -> ResolvedRobot:
    """Add the references of the prescribed axes to a robot, and remove the servos of these axes.

    A move starts from the initial position of its axis, as those of other axes do. Other references may begin
    elsewhere, such as a sine with a phase. The initial positions of the prescribed axes of the returned robot are those
    of their references at the time 0.

    Args:
        config: configuration of the station.
        robot: a robot of the station.

    Returns:
        the changed robot, or the same robot if it has no prescribed axes.

    Raises:
        SimrobError: an error of :func:`prescribed_axes`, or a reference does not fit its axis.
    """
    references = {}
    for key, axis in prescribed_axes(config, robot.name, robot.model).items():
        # `trajectory` makes positions for all axes of a robot, so it gets a robot that has this axis alone.
        single = alone_on(robot, axis)
        references[axis] = config.prescribed[key].trajectory(single, single.initial)
    if not references:
        return robot
    # A factor on the gains of each axis: 0 switches the servo of a prescribed axis off.
    has_servo = np.array([axis not in references for axis in range(len(robot.axes))], dtype=float)
    old = robot.gains
    gains = replace(old, kp=has_servo * old.kp, ki=has_servo * old.ki, kd=has_servo * old.kd)
    changed = replace(robot, gains=gains, prescribed=references)
    initial, _ = begin_on_prescribed(changed, robot.initial, np.zeros_like(robot.initial))
    return replace(changed, initial=initial)


def alone_on(robot: ResolvedRobot, axis: int) -> ResolvedRobot:
    """Copy a robot and leave it only one axis, so that a reference for a single axis can be made and checked with it.

    Its axes and its initial positions are reduced to those of this axis; gains, motors and the like stay as they are.

    Args:
        robot: the robot.
        axis: index of the axis that remains.
    """
    name = robot.axes[axis]
    fields = dict(robot.model)
    fields["axes"] = {name: robot.model.axes[name]}
    model = RobotModel.model_construct(**fields)  # as it is, without validation
    return replace(robot, model=model, initial=robot.initial[[axis]], prescribed={})


def begin_on_prescribed(
    robot: ResolvedRobot,
    positions: Vector,
    velocities: Vector,
) -> tuple[Vector, Vector]:
    """Replace positions and velocities of the prescribed axes by those of their references at time 0.

    Args:
        robot: the robot with its prescribed axes.
        positions: positions of all its axes, shape (n,) [rad or m]. They are not changed.
        velocities: velocities of all its axes, shape (n,) [rad/s or m/s]. They are not changed.

    Returns:
        the new positions and the new velocities, in the same shapes and units.
    """
    new_positions = positions.copy()
    new_velocities = velocities.copy()
    start = np.zeros(1)  # time [s]
    for axis, reference in robot.prescribed.items():
        new_positions[axis] = reference_values(reference, start)[0, 0]
        new_velocities[axis] = reference_values(reference, start, order=1)[0, 0]
    return new_positions, new_velocities


def set_rotors(plant: MultibodyPlant, joints: list[Joint], robot: ResolvedRobot) -> None:
    """Give the motors of a robot's prescribed joints their heavy rotors.

    Args:
        plant: a finalized plant. The default parameters of its actuators are changed.
        joints: joints of the robot's axes in the plant, in order.
        robot: the robot with its prescribed axes.
    """
    mass_matrix = plant.CalcMassMatrix(plant.CreateDefaultContext())
    diagonal = np.diag(mass_matrix)
    for axis in robot.prescribed:
        joint = joints[axis]
        motor = _motor(plant, joint)
        # Inertia of the rotor as felt at the joint, behind the gear.
        inertia = _ROTOR_FACTOR * diagonal[joint.velocity_start()]
        motor.set_default_rotor_inertia(inertia / motor.default_gear_ratio() ** 2)


def add_prescribed_motion(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, reference: OutputPort
) -> OutputPort:
    """Add an input ``prescribed.<axis>`` for each prescribed axis, and put their positions into the robot's reference.

    Each input takes a position [rad or m], a velocity and an acceleration (the derivatives by the time in s) in one
    vector. The inputs are added to those of the station.

    Args:
        builder: the diagram under construction.
        ports: ports of the station.
        robot: the robot, with at least one prescribed joint.
        reference: desired positions of all axes, size n [rad or m].

    Returns:
        the desired positions of all axes, size n [rad or m], with those of the inputs for the prescribed axes.
    """
    motions = []
    for axis in robot.prescribed:
        axis_name = f"{robot.prefix}{robot.axes[axis]}"
        name = f"{robot.prefix}prescribed.{robot.axes[axis]}"
        block = builder.AddNamedSystem(name, PassThrough(_MOTION_SIZE))
        ports.inputs[name] = block.get_input_port()
        ports.picture.draw(
            name,
            "reference",
            message("stations.block_prescribed", "Prescribed motion\nof {axis}", axis=axis_name),
            robot,
        )
        motions.append(block.get_output_port())
    name = f"{robot.prefix}prescribed"
    multiplexer = Multiplexer([_MOTION_SIZE] * len(motions))
    all_motions = add_and_connect(builder, name, multiplexer, *motions)

    # The matrix from [reference (n), motions (3 for each prescribed axis)] to the new reference (n): its row for a
    # prescribed axis selects the position of the axis' motion.
    axes = list(robot.prescribed)
    count = len(robot.axes)
    selection = np.hstack([np.eye(count), np.zeros((count, _MOTION_SIZE * len(axes)))])
    selection[axes] = 0.0
    for index, axis in enumerate(axes):
        selection[axis, count + _MOTION_SIZE * index] = 1.0
    both = add_multiplexer(builder, f"{name}.references", reference, all_motions)
    ports.picture.draw_nothing(name, f"{name}.references", f"{name}.whole")
    return add_matrix_gain(builder, f"{name}.whole", selection, both)


def add_prescribed_torque(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, torque: OutputPort
) -> OutputPort:
    """Add the blocks that move a robot's prescribed joints, and compute the torques that the motions take.

    Call :func:`add_prescribed_motion` before. The force that moves the joints is appended to the generalized forces of
    the station. The equations are those of the module's docstring.

    Args:
        builder: the diagram under construction.
        ports: ports of the station.
        robot: the robot, with k prescribed joints, at least one.
        torque: torques of the robot's servos, size n [N·m or N].

    Returns:
        the torques of all axes, size n [N·m or N]: the servos' torques, and for prescribed joints the torques that
        their motions take. If :func:`uses_reaction_forces`, the part that overcomes Coulomb friction is not included,
        and the caller adds it.
    """
    plant = ports.plant.plant
    name = f"{robot.prefix}prescribed"
    axes = list(robot.prescribed)
    motors = [_motor(plant, robot.joints[axis]) for axis in axes]
    # Inertia J of the rotor of each prescribed joint, on the diagonal.
    rotors = np.diag([motor.default_reflected_inertia() for motor in motors])
    # Matrix (k, nv) from generalized velocities to those of the joints.
    to_joints = robot.axis_map.velocity_matrix[axes]
    to_plant = to_joints.T  # (nv, k), from the joints' torques to generalized forces

    # All quantities are linear in the signals, so that matrices compute them. The bus is one vector: the motions (3
    # values for each prescribed joint), then the plant's state.
    motions = builder.GetSubsystemByName(name).get_output_port()
    bus = add_multiplexer(builder, f"{name}.bus", motions, ports.state)
    # Discrete schemes and cenic take the reference as it is at the start of a step. MuJoCo, which would too, has no
    # prescribed joints.
    engine = ports.config.engine
    takes_start_of_step = engine.has_discrete_states or engine.holds_inputs_over_steps
    rate = _STEPPED_RATE if takes_start_of_step else _CONTINUOUS_RATE
    law = _rotor_law(robot, rotors, rate)
    force = add_matrix_gain(builder, f"{name}.force", to_plant @ law, bus)
    ports.generalized_forces.append(force)

    # The torques of the motions depend on the bus, then on the generalized accelerations.
    acceleration = plant.get_generalized_acceleration_output_port()
    # This matrix and `resistance` have the columns [bus, accelerations], `law` has those of the bus.
    missed_torque = _missed_torque(robot, plant, rotors)
    signals = [torque, bus, acceleration]
    if uses_reaction_forces(ports.config):
        # tau = S (ddq_r - dv/dt) + d (v + h dv/dt) + f, where f, the reaction forces, follows the accelerations.
        signals.append(_add_joint_forces(builder, ports, robot))
        resistance = _joint_resistance(robot, engine.time_step)
        motion_torque = np.hstack([missed_torque + resistance, np.eye(len(axes))])
    else:
        # tau = S (ddq_r - dv/dt) + u - J dv/dt
        motion_torque = missed_torque + np.hstack([law, -rotors @ to_joints])

    # The torques of all axes: the servos' torques (zero for prescribed joints), plus the torques of the motions.
    every_axis = np.eye(len(robot.axes))
    matrix = np.hstack([every_axis, every_axis[:, axes] @ motion_torque])
    efforts = add_multiplexer(builder, f"{name}.efforts", *signals)
    ports.picture.draw_nothing(f"{name}.bus", f"{name}.efforts", f"{name}.torque")
    ports.picture.draw(
        f"{name}.force",
        "force",
        message("stations.block_moves_prescribed", "Drive of the\nprescribed joints"),
        robot,
    )
    return add_matrix_gain(builder, f"{name}.torque", matrix, efforts)


def _rotor_law(robot: StationRobot, rotors: Vector, rate: float) -> Vector:
    """Compute the matrix that gives the torques u, which move the rotors of the k prescribed joints.

    u = J (ddq_r + 2 omega (dq_r - v) + omega² (q_r - q)), see the module's docstring.

    Args:
        robot: the robot with the joints.
        rotors: inertias J of the rotors on the diagonal, shape (k, k) [kg m² or kg].
        rate: rate omega at which deviations are removed [1/s].

    Returns:
        a matrix with k rows. Its columns take the prescribed motions (3 for each joint), then the plant's state.
    """
    axes = list(robot.prescribed)
    count = len(robot.axes)
    velocities = [count + axis for axis in axes]
    # Rows of the matrix from the plant's state to q and v of the joints.
    measured = robot.axis_map.state_matrix[[*axes, *velocities]]
    identity = np.eye(len(axes))
    # ddq_r + 2 omega dq_r + omega² q_r: a motion has the order position, velocity, acceleration.
    desired = np.kron(identity, [rate**2, 2 * rate, 1.0])
    # -(omega² q + 2 omega v)
    feedback = -np.hstack([rate**2 * identity, 2 * rate * identity]) @ measured
    return np.asarray(rotors @ np.hstack([desired, feedback]))


def _missed_torque(robot: StationRobot, plant: MultibodyPlant, rotors: Vector) -> Vector:
    """Compute the matrix that gives S (ddq_r - dv/dt), the torque for the accelerations that the solver falls short of.

    The solver's accelerations dv/dt differ from the desired ones ddq_r, since it only tracks them.

    S is the inertia of the k prescribed joints at the start while the rest of the station moves freely:
    S = (B' M^-1 B)^-1 - J, with the mass matrix M (rotors J included) and the matrix B from joint torques to
    generalized forces.

    Args:
        robot: the robot with the joints.
        plant: the plant that contains it.
        rotors: inertias J of the rotors on the diagonal, shape (k, k) [kg m² or kg].

    Returns:
        a matrix with k rows. Its columns take the prescribed motions (3 for each joint), the plant's state, and the
        plant's generalized accelerations.
    """
    axes = list(robot.prescribed)
    to_plant = robot.axis_map.velocity_matrix[axes].T
    mobility = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    free_inertia = np.linalg.inv(to_plant.T @ mobility @ to_plant) - rotors
    desired_acceleration = np.kron(free_inertia, [0.0, 0.0, 1.0])
    no_state = np.zeros((len(axes), robot.axis_map.state_matrix.shape[1]))
    return np.hstack([desired_acceleration, no_state, -free_inertia @ to_plant.T])


def uses_reaction_forces(config: StationConfig) -> bool:
    """Whether torques of prescribed joints are computed from Drake's reaction forces in the joints.

    They are for a station with contact under a discrete solver: there the reaction forces are much more accurate than
    the torque that moves the heavy rotor (see the module's docstring). With couplings they would be wrong: Drake's
    reaction forces leave out the forces of constraints, so a gear's force on the joint would be missing.
    """
    return is_discrete_with_contact(config) and not constraining_couplings(config)


def is_discrete_with_contact(config: StationConfig) -> bool:
    """Whether the station has a section ``contact`` and a solver with discrete states."""
    return config.engine.has_discrete_states and config.contact is not None


def constraining_couplings(config: StationConfig) -> list[str]:
    """Names of the couplings that Drake's discrete solvers hold as constraints; the other couplings are springs."""
    return [name for name, coupling in config.couplings.items() if coupling.constrains]


def _add_joint_forces(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
) -> OutputPort:
    """Add a sensor block for the reaction forces in the robot's k prescribed joints.

    Returns:
        the block's output: the reaction torque about, or force along, each joint's axis, size k [N·m or N].
    """
    axes = list(robot.prescribed)
    block = JointTorqueSensor(
        joints=[robot.joints[axis] for axis in axes],
        signs=robot.axis_map.signs[axes],
    )
    name = f"{robot.prefix}prescribed.joint_forces"
    ports.picture.draw_nothing(name)
    return add_and_connect(
        builder, name, block, ports.plant.plant.get_reaction_forces_output_port()
    )


def _joint_resistance(robot: StationRobot, step: float) -> Vector:
    """Compute the matrix that gives the torques which overcome the damping of the k prescribed joints.

    Args:
        robot: the robot with the joints.
        step: step of the discrete solver [s].

    Returns:
        a matrix with k rows. Its columns take the prescribed motions (3 for each joint), the plant's state, and the
        plant's generalized accelerations.
    """
    axes = list(robot.prescribed)
    count = len(robot.axes)
    damping = np.diag([robot.joints[axis].default_damping() for axis in axes])
    # Matrices that select the velocities of the joints from the state, and their accelerations.
    velocities = robot.axis_map.state_matrix[[count + axis for axis in axes]]
    accelerations = robot.axis_map.velocity_matrix[axes]
    no_motion = np.zeros((len(axes), _MOTION_SIZE * len(axes)))
    # Discrete solvers evaluate damping at the velocity of the step's end: d (v + h dv/dt).
    return np.hstack([no_motion, damping @ velocities, step * damping @ accelerations])


def _motor(plant: MultibodyPlant, joint: Joint) -> JointActuator:
    """Find the actuator that carries the rotor of a joint.

    A joint with Coulomb friction has two actuators: its motor, and a brake that stands for the friction. Drake uses
    only the rotor of the joint's last actuator, so the last one is returned.
    """
    actuators_of_joint = []
    for index in range(plant.num_actuators()):
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        if actuator.joint().index() == joint.index():
            actuators_of_joint.append(actuator)
    return actuators_of_joint[-1]
