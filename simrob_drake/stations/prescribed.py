r"""Joints whose motion is given while all else moves by forces, with the torque that it takes.

The joint's motor gets a rotor so heavy, :math:`J = 10^6 M_{pp}`, that nothing else in the station turns it noticeably,
and the torque that gives this rotor the acceleration of the reference:

.. math:: u = J\,(\ddot q_r + 2 \omega (\dot q_r - v) + \omega^2 (q_r - q)).

A reflected rotor stands in the joint's own row of the mass matrix alone, so the rest of the station feels the motion
and nothing of the rotor. What is left for the joint is the torque that the motion takes. Continuous schemes compute
accelerations to rounding, so it is

.. math:: \tau = u - J \dot v + S (\ddot q_r - \dot v),

whose last part corrects the torque for the solver's error in :math:`\dot v`. S is the joint's inertia at the start
while the rest of the station moves freely.

Discrete solvers stop at a tolerance that is relative to the momentum of the whole station,
rotors included. Where bodies touch, the difference of the two large numbers u and
:math:`J \dot v` is then wrong by thousands of newtons. With contact the torque is therefore
computed from what acts on the links: Drake's force in the joint along its axis, :math:`f`,
is inverse dynamics with contact forces and all that is applied, without the rotor. In the
joint the motor overcomes damping d and Coulomb friction c, too:

.. math:: \tau = f + S (\ddot q_r - \dot v) + d\,(v + h \dot v) + c\,\mathrm{sat}(v / v_s).

The contact forces themselves have that tolerance: some 2 % of the weight of what touches.
Drake's forces in joints do not include the forces of constraints. So with couplings and contact the
first formula is used, and the run warns.

With a load of acceleration a the joint lags by :math:`10^{-6} a / \omega^2`: nothing beside the integrator's error.
Discrete solvers and ``cenic`` take the reference as it is at the start of a step, and follow it less exactly:
``docs/stations.md`` has the figures. Only C++ primitives are used.
"""

from dataclasses import replace

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, JointActuator, JointActuatorIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Multiplexer, PassThrough

from simrob_drake.blocks.block import fed, joined, mapped
from simrob_drake.blocks.joint_torque import JointTorqueSensor
from simrob_drake.blocks.references import reference_values
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.site import ResolvedRobot, StationRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import DiscreteSolver

_HEAVIER = 1e6
_RATES = {True: 100.0, False: 20.0}
"""1/s: how fast what is missed is made up for, by whether the solver sees the reference within its steps."""


def prescribed_axes(config: StationConfig, robot: str, model: RobotModel) -> dict[str, int]:
    """Return prescribed axes' places by key; raises UnknownName: no axis; InvalidParameter: no station for them."""
    keys = [key for key in config.prescribed if config.only_robot or key.partition(".")[0] == robot]
    for key in config.prescribed:
        if not config.only_robot and key.partition(".")[0] not in config.robots:
            raise UnknownName("robot under prescribed", key, [f"{name}.<axis>" for name in config.robots])
    if not keys:
        return {}
    if config.mode == "kinematic":
        raise InvalidParameter("prescribed", ", ".join(keys), "left out: a kinematic station's reference moves all")
    servo = config.servo_of(robot)
    for key, usual in (("realization", "implicit"), ("law", "computed_torque")):
        if getattr(servo, key) == usual:
            raise InvalidParameter(f"servo.{key}", usual, "another one: a prescribed joint has no servo")
    if servo.feedforward != "none" or servo.admittance_gain:
        raise InvalidParameter("servo", "one that knows the robot's model", "one without it beside prescribed joints")
    return {key: model.axis_index(key.removeprefix(config.prefix(robot)), "prescribed") for key in keys}


def with_prescribed_axes(config: StationConfig, robot: ResolvedRobot) -> ResolvedRobot:
    """Return a robot with the references of its prescribed axes, which start where these begin, without servos.

    They begin as others do: about or at the axis' initial position. Raises SimrobError: as :func:`prescribed_axes`, or
    a reference that cannot be.
    """
    references = {}
    for key, place in prescribed_axes(config, robot.name, robot.model).items():
        alone = alone_on(robot, place)
        references[place] = config.prescribed[key].trajectory(alone, alone.initial)
    if not references:
        return robot
    served = np.array([place not in references for place in range(len(robot.axes))], dtype=float)
    own = robot.gains
    gains = replace(own, kp=served * own.kp, ki=served * own.ki, kd=served * own.kd)
    driven = replace(robot, gains=gains, prescribed=references)
    return replace(driven, initial=begin_on_prescribed(driven, robot.initial, np.zeros_like(robot.initial))[0])


def alone_on(robot: ResolvedRobot, place: int) -> ResolvedRobot:
    """Return a robot as references see it that are for one of its axes."""
    name = robot.axes[place]
    model = RobotModel.model_construct(**{**dict(robot.model), "axes": {name: robot.model.axes[name]}})
    return replace(robot, model=model, initial=robot.initial[[place]], prescribed={})


def begin_on_prescribed(robot: ResolvedRobot, positions: Vector, velocities: Vector) -> tuple[Vector, Vector]:
    """Return positions and velocities (n,) of a robot's axes with the prescribed ones as their references begin."""
    positions, velocities = positions.copy(), velocities.copy()
    for place, own in robot.prescribed.items():
        positions[place], velocities[place] = (reference_values(own, np.zeros(1), order)[0, 0] for order in (0, 1))
    return positions, velocities


def set_rotors(plant: MultibodyPlant, joints: list[Joint], robot: ResolvedRobot) -> None:
    """Give the motors of a robot's prescribed joints their rotors; the plant is finalized."""
    mass = np.diag(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    for place in robot.prescribed:
        motor, start = _motor(plant, joints[place]), joints[place].velocity_start()
        motor.set_default_rotor_inertia(_HEAVIER * mass[start] / motor.default_gear_ratio() ** 2)


def add_prescribed_motion(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, reference: OutputPort
) -> OutputPort:
    """Add inputs ``prescribed.<axis>`` of position, rate, acceleration [rad or m], and return the robot's reference."""
    inputs = []
    for place in robot.prescribed:
        name = f"{robot.prefix}prescribed.{robot.axes[place]}"
        block = builder.AddNamedSystem(name, PassThrough(3))
        ports.inputs[name] = block.get_input_port()
        ports.draw(name, "reference", f"Prescribed motion\nof {robot.prefix}{robot.axes[place]}", robot)
        inputs.append(block.get_output_port())
    count, places = len(robot.axes), list(robot.prescribed)
    motion = fed(builder, f"{robot.prefix}prescribed", Multiplexer([3] * len(inputs)), *inputs)
    whole = np.hstack([np.eye(count), np.zeros((count, 3 * len(places)))])
    whole[places] = 0.0
    whole[places, count + 3 * np.arange(len(places))] = 1.0
    both = joined(builder, f"{robot.prefix}prescribed.references", reference, motion)
    ports.draw_nothing(*(f"{robot.prefix}prescribed{part}" for part in ("", ".references", ".whole")))
    return mapped(builder, f"{robot.prefix}prescribed.whole", whole, both)


def add_prescribed_torque(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, torque: OutputPort
) -> OutputPort:
    """Add the blocks that move a robot's prescribed joints, and compute the torques that the motions take.

    Args:
        builder: the diagram under construction.
        ports: ports of the station; the force that moves the joints is added to its generalized forces.
        robot: the robot, with at least one prescribed joint.
        torque: torques of the robot's servos, size n [N·m or N].

    Returns:
        the torques of all axes, size n [N·m or N]: the servos' torques, and for prescribed joints the torques that
        their motions take. If :func:`uses_reaction_forces`, the part that overcomes Coulomb friction is not included,
        and the caller adds it.
    """
    plant, prefix, config = ports.plant.plant, robot.prefix, ports.config
    places = list(robot.prescribed)
    count = len(robot.axes)
    motors = [_motor(plant, robot.joints[place]) for place in places]
    rotors = np.diag([motor.default_reflected_inertia() for motor in motors])
    rate = _RATES[not config.solver.holds_joint_limits]
    each = np.eye(len(places))

    # The force u that moves the rotors, as a matrix from the bus: first position, velocity and acceleration of each
    # prescribed motion, then the plant's state.
    measured = robot.axis_map.state_matrix[[*places, *(count + place for place in places)]]
    desired = np.kron(each, [rate**2, 2 * rate, 1.0])
    feedback = -np.hstack([rate**2 * each, 2 * rate * each]) @ measured
    law = rotors @ np.hstack([desired, feedback])
    spread = robot.axis_map.velocity_matrix[places].T
    motion = builder.GetSubsystemByName(f"{prefix}prescribed").get_output_port()
    bus = joined(builder, f"{prefix}prescribed.bus", motion, ports.state)
    force = mapped(builder, f"{prefix}prescribed.force", spread @ law, bus)
    ports.generalized_forces.append(force)

    # The joints' inertia S while the rest of the station moves freely, at the start. It turns the acceleration that
    # the solver misses into the torque that was missed.
    mobility = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    free = np.linalg.inv(spread.T @ mobility @ spread) - rotors
    missed = np.hstack([np.kron(free, [0.0, 0.0, 1.0]), np.zeros_like(feedback), -free @ spread.T])

    acceleration = plant.get_generalized_acceleration_output_port()
    signals = [torque, bus, acceleration]
    if isinstance(config.solver, DiscreteSolver) and uses_reaction_forces(config):
        signals.append(_add_joint_forces(builder, ports, robot))
        passive = _joint_resistance(robot, config.solver.time_step)
        taken = np.hstack([missed + passive, each])
    else:
        taken = missed + np.hstack([law, -rotors @ spread.T])
    every = np.eye(count)
    matrix = np.hstack([every, every[:, places] @ taken])
    efforts = joined(builder, f"{prefix}prescribed.efforts", *signals)
    ports.draw_nothing(*(f"{prefix}prescribed.{part}" for part in ("bus", "efforts", "torque")))
    ports.draw(f"{prefix}prescribed.force", "force", "What moves\nprescribed joints", robot)
    return mapped(builder, f"{prefix}prescribed.torque", matrix, efforts)


def uses_reaction_forces(config: StationConfig) -> bool:
    """Whether torques of prescribed joints are computed from Drake's reaction forces in the joints.

    With contact under a discrete solver, the reaction forces are much more accurate than the torque that moves the
    heavy rotor (see the module's docstring). With couplings they would be wrong: Drake's reaction forces leave out the
    forces of constraints, so a gear's force on the joint would be missing.
    """
    return is_discrete_with_contact(config) and not constraining_couplings(config)


def is_discrete_with_contact(config: StationConfig) -> bool:
    """Whether the station has contact and is stepped by one of Drake's discrete solvers."""
    return isinstance(config.solver, DiscreteSolver) and config.contact is not None


def constraining_couplings(config: StationConfig) -> list[str]:
    """Find the couplings that are constraints of the plant under a discrete solver. Returns their names."""
    return [name for name, coupling in config.couplings.items() if coupling.constrains]


def _add_joint_forces(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot) -> OutputPort:
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
    ports.draw_nothing(name)
    return fed(builder, name, block, ports.plant.plant.get_reaction_forces_output_port())


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
    speeds = robot.axis_map.state_matrix[[count + axis for axis in axes]]
    accelerations = robot.axis_map.velocity_matrix[axes]
    no_motion = np.zeros((len(axes), 3 * len(axes)))
    # Discrete solvers evaluate damping at the velocity of the step's end, v + h dv/dt.
    return np.hstack([no_motion, damping @ speeds, step * damping @ accelerations])


def _motor(plant: MultibodyPlant, joint: Joint) -> JointActuator:
    """Find the actuator that carries the rotor of a joint.

    A joint with Coulomb friction has two actuators: its motor, and a brake that stands for the friction. Drake uses
    only the rotor of the joint's last actuator, so the last one is returned.
    """
    actuators = [plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators())]
    own = [actuator for actuator in actuators if actuator.joint().index() == joint.index()]
    return own[-1]
