r"""Joints whose motion is given while all else moves by forces, with the torque that it takes.

The joint's motor gets a rotor so heavy, :math:`J = 10^6 M_{pp}`, that nothing else in the station turns it noticeably,
and the torque that gives this rotor the acceleration of the reference:

.. math:: u = J\,(\ddot q_r + 2 \omega (\dot q_r - v) + \omega^2 (q_r - q)).

A reflected rotor stands in the joint's own row of the mass matrix alone, so the rest of the station feels the motion
and nothing of the rotor. What is left for the joint is the torque that the motion takes,
:math:`\tau = u - J \dot v + S (\ddot q_r - \dot v)`, its last part, with the joint's free inertia S at the start, what
the solver's own error in :math:`\dot v` makes of it.

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
from simrob_drake.blocks.references import reference_values
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.site import ResolvedRobot, StationRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts

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
    """Move a robot's prescribed joints; return its servos' torques (n,) [N·m or N] with what the motions take."""
    plant, axes, prefix, places = ports.plant.plant, robot.axis_map, robot.prefix, list(robot.prescribed)
    motion = builder.GetSubsystemByName(f"{prefix}prescribed").get_output_port()
    rotors = np.diag([_motor(plant, robot.joints[place]).default_reflected_inertia() for place in places])
    rate, each, count = _RATES[not ports.config.solver.holds_joint_limits], np.eye(len(places)), len(robot.axes)
    measured = axes.state_matrix[[*places, *(count + place for place in places)]]
    desired = np.kron(each, [rate**2, 2 * rate, 1.0])
    law = rotors @ np.hstack([desired, -np.hstack([rate**2 * each, 2 * rate * each]) @ measured])
    spread = axes.velocity_matrix[places].T
    bus = joined(builder, f"{prefix}prescribed.bus", motion, ports.state)
    ports.generalized_forces.append(mapped(builder, f"{prefix}prescribed.force", spread @ law, bus))
    mobility = np.linalg.inv(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    free = np.linalg.inv(spread.T @ mobility @ spread) - rotors  # of the joints at the start, while the rest is free
    taken = np.hstack([law, -(rotors + free) @ spread.T])
    taken[:, : 3 * len(places)] += np.kron(free, [0.0, 0.0, 1.0])
    every = np.eye(count)
    acceleration = plant.get_generalized_acceleration_output_port()
    whole = joined(builder, f"{prefix}prescribed.efforts", torque, bus, acceleration)
    ports.draw_nothing(*(f"{prefix}prescribed.{part}" for part in ("bus", "efforts", "torque")))
    ports.draw(f"{prefix}prescribed.force", "force", "What moves\nprescribed joints", robot)
    return mapped(builder, f"{prefix}prescribed.torque", np.hstack([every, every[:, places] @ taken]), whole)


def _motor(plant: MultibodyPlant, joint: Joint) -> JointActuator:
    motors = (plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators()))
    return next(motor for motor in motors if motor.joint().index() == joint.index())
