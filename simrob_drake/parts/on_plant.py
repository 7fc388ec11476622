"""Servos, motors, monitors, contact sensors and IMUs for a plant of the user's own, without any station.

All functions but `add_monitor` take a builder and a finalized ``MultibodyPlant`` in it, find joints and bodies by their
names, add the blocks, and connect them to the plant. `add_monitor` takes ports. All values are in SI units and radians;
of joints that slide, m takes the place of rad and N the place of N·m.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    FrameIndex,
    Joint,
    JointActuatorIndex,
    ModelInstanceIndex,
    PrismaticJoint,
    RigidBody,
)
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.base.arguments import drake_asserts, instance
from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable, one_of, quote_value
from simrob_drake.base.frames import Flags, Vector, numbers
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain
from simrob_drake.blocks.contacts import ContactReader, ForceSensor
from simrob_drake.blocks.monitor import Condition, Monitor
from simrob_drake.blocks.servo import MotorLine, ServoGains, ServoSignals
from simrob_drake.blocks.servo import add_servos as add_servo_blocks
from simrob_drake.parts.sensors.frames import Imu, InertialUnit
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.motors import Motor, known_motors

JointValues: TypeAlias = float | Sequence[float] | npt.NDArray[np.float64] | Mapping[str, float]
"""One value for all joints with an actuator, n values in the order of the joints, or values by the joint's name.

A joint that a mapping leaves out has the gain 0, or as its torque limit the effort limit of its actuator. Joints
without an actuator have 0."""

MotorChoice: TypeAlias = str | Motor | Mapping[str, str | Motor]
"""A motor for all joints, or motors by the joint's name; a text is the name of a known motor."""

_STABLE_DAMPING = 2.0
"""An explicit damper is stable while kd h / M stays below this, with the step h and the inertia M of the joint."""


@dataclass(frozen=True)
class JointServos:
    """Ports of the servos of n joints.

    Attributes:
        joints: names of the joints, in order.
        passive: names of those joints that have no actuator: nothing moves them, and their torque is 0.
        reference: input of the desired positions, size n [rad].
        state: output of the measured positions and then velocities, size 2n [rad, rad/s].
        torque: output of the torques of the motors, size n [N·m].
        reference_velocity: input of the desired velocities, size n [rad/s]; None unless it was asked for.
        feedforward: input of torques that are added before the saturation, size n [N·m]; None unless asked for.
    """

    joints: list[str]
    passive: list[str]
    reference: InputPort
    state: OutputPort
    torque: OutputPort
    reference_velocity: InputPort | None = None
    feedforward: InputPort | None = None


@drake_asserts()
def add_joint_servos(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    joints: Sequence[str] | None = None,
    *,
    kp: JointValues,
    kd: JointValues,
    ki: JointValues = 0.0,
    torque_limit: JointValues | None = None,
    motor: MotorChoice | None = None,
    model_instance: ModelInstanceIndex | None = None,
    with_reference_velocity: bool = False,
    with_feedforward: bool = False,
    name: str = "servos",
) -> JointServos:
    """Add PID servos with saturation for joints of a finalized plant, and connect them to its actuators.

    The law is that of a station's servos, see :mod:`simrob_drake.blocks.servo`. A joint without an actuator is passive.

    Args:
        builder: builder of the diagram that contains the plant.
        plant: the plant, finalized.
        joints: names of the joints; None means all joints that turn or slide about one axis, of `model_instance` if it
            is given.
        kp: stiffness [N·m/rad].
        kd: damping [N·m·s/rad].
        ki: integral gain [N·m/(rad·s)].
        torque_limit: limits of the torques [N·m]; None means the effort limits of the actuators.
        motor: motors whose torque falls with their speed; None means motors that give the limit at any speed.
        model_instance: model instance of the joints. It may be None if only one has joints of these names.
        with_reference_velocity: whether the servos take desired velocities; otherwise kd acts on the velocity alone.
        with_feedforward: whether torques from outside are added before the saturation.
        name: prefix of the names of the blocks, with a dot after it.

    Returns:
        The ports. Connect ``reference`` and, if asked for, the other inputs.

    Raises:
        UnknownName: there is no such joint or motor.
        InvalidParameter: a value is invalid, ``kd`` is too large for the time step of a discrete plant, there are no
            joints, a joint is named twice, or the joints are of several model instances.
        SimrobError: the plant is not finalized or not in the builder, or the actuators are connected already.
    """
    _check_plant(builder, plant)
    found = _joints_of(plant, joints, model_instance)
    # All joints are of one instance, whose actuators have one input port.
    owner = found[0].model_instance()
    names = [joint.name() for joint in found]
    passive = _without_actuator(plant, found)
    gains = _gains(
        plant, found, passive, kp=kp, ki=ki, kd=kd, torque_limit=torque_limit, motor=motor
    )
    _check_damping(plant, found, gains)
    # An input of a Drake system can only be connected once, and Drake's own error does not name the reason.
    actuation_port = plant.get_actuation_input_port(owner)
    if not passive.all() and builder.IsConnectedOrExported(actuation_port):
        raise SimrobError(
            message(
                "parts.actuators_connected",
                "the actuators of {instance} are already connected; "
                "one block must command all actuators of an instance",
                instance=plant.GetModelInstanceName(owner),
            )
        )
    # Values are those of the joints, without signs: only axes of a station's robots may be opposite to their joints.
    axes = AxisMap.of_joints(plant, found)

    def add_input(port: str) -> PassThrough:
        """Add the block of an input of one value for each joint."""
        return builder.AddNamedSystem(f"{name}.{port}", PassThrough(len(found)))

    # Inputs are blocks that pass their values on, so that each of them is one port, whoever reads it in the servos.
    reference = add_input("reference")
    velocity = add_input("reference_velocity") if with_reference_velocity else None
    feedforward = add_input("feedforward") if with_feedforward else None
    state = add_matrix_gain(
        builder, f"{name}.state", axes.state_matrix, plant.get_state_output_port()
    )
    signals = ServoSignals(
        reference=reference.get_output_port(),
        state=state,
        reference_velocity=None if velocity is None else velocity.get_output_port(),
        feedforward=None if feedforward is None else feedforward.get_output_port(),
    )
    torque = add_servo_blocks(builder, signals, gains, names=names, prefix=f"{name}.")
    # From the joints' order to that of the instance's actuators, which also has actuators of other joints.
    actuation_matrix = axes.actuation_matrix(plant, owner, passive)
    # Without any actuator, the port has no entries.
    if not passive.all():
        builder.Connect(
            add_matrix_gain(builder, f"{name}.actuation", actuation_matrix, torque), actuation_port
        )
    return JointServos(
        joints=names,
        passive=[joint for joint, is_passive in zip(names, passive, strict=True) if is_passive],
        reference=reference.get_input_port(),
        state=state,
        torque=torque,
        reference_velocity=None if velocity is None else velocity.get_input_port(),
        feedforward=None if feedforward is None else feedforward.get_input_port(),
    )


@drake_asserts()
def add_monitor(
    builder: DiagramBuilder,
    watched: Mapping[str, OutputPort],
    *,
    excess: Callable[..., float],
    why: Callable[..., str],
    hold: float = 0.0,
    after: float = 0.0,
    name: str = "monitor",
) -> Monitor:
    """Add a monitor, which ends ``AdvanceTo`` once a condition has lasted, and connect what it watches.

    Args:
        builder: builder of the diagram.
        watched: the output ports whose values the two functions get, in this order, by names for the monitor's inputs.
        excess: computes by how much the condition is exceeded. It holds where this is not negative.
        why: reason in words, for the message of the simulator's status.
        hold: how long the condition must last [s].
        after: time at which watching begins [s].
        name: name of the block.

    Raises:
        InvalidParameter: ``hold`` or ``after`` is not a finite time, or ``builder`` is no builder.
    """
    instance(builder, "builder", DiagramBuilder, _a_builder())
    # The monitor gets an input for each port, in this order, which is also that of the functions' arguments.
    sizes = {signal: port.size() for signal, port in watched.items()}
    monitor = Monitor(Condition(watched=sizes, excess=excess, why=why), hold=hold, after=after)
    add_and_connect(builder, name, monitor, *watched.values())
    return monitor


@drake_asserts()
def add_joint_limit_monitor(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    joints: Sequence[str] | None = None,
    *,
    margin: float = 0.0,
    model_instance: ModelInstanceIndex | None = None,
    hold: float = 0.0,
    name: str = "joint_limit",
) -> Monitor:
    """Add a monitor that ends a run when a joint reaches a limit of its range.

    Args:
        builder: builder of the diagram that contains the plant.
        plant: the plant, finalized.
        joints: names of the joints; None means all joints with one axis, of `model_instance` if it is given.
        margin: distance before a limit at which the run ends [rad or m].
        model_instance: model instance of the joints. It may be None if only one has joints of these names.
        hold: how long a joint must be there [s].
        name: name of the block.

    Raises:
        UnknownName: there is no such joint.
        InvalidParameter: there are no joints, a joint is named twice, the joints are of several model instances, or
            ``hold`` is not a finite time.
        SimrobError: the plant is not finalized, or not in the builder.
    """
    _check_plant(builder, plant)
    found = _joints_of(plant, joints, model_instance)
    names = [joint.name() for joint in found]
    lower = np.array([joint.position_lower_limit() for joint in found])
    upper = np.array([joint.position_upper_limit() for joint in found])
    # Indices of the joints' positions in the state, which begins with the positions of the whole plant.
    position_indices = AxisMap.of_joints(plant, found).position_places
    units = ["m" if isinstance(joint, PrismaticJoint) else "rad" for joint in found]

    def distances_beyond(state: Vector) -> Vector:
        """Compute how far each joint is beyond its nearer limit moved inward by the margin, shape (n,) [rad or m].

        The state is that of the plant, positions and then velocities. The result is negative within the limits.
        """
        positions = state[position_indices]
        return np.asarray(np.maximum(lower - positions, positions - upper) + margin)

    def excess(state: Vector) -> float:
        """Compute how far the worst joint is beyond its limit moved inward by the margin [rad or m]."""
        return float(distances_beyond(state).max())

    def why(state: Vector) -> str:
        """Give the reason of the end: the worst joint and its position."""
        worst = int(np.argmax(distances_beyond(state)))
        position = float(state[position_indices][worst])
        if margin > 0:
            return message(
                "parts.joint_near_limit",
                "{joint} came within {margin:g} {unit} of a joint limit, at {position:.4g} {unit}",
                joint=names[worst],
                margin=margin,
                position=position,
                unit=units[worst],
            )
        return message(
            "parts.joint_at_limit",
            "{joint} reached a joint limit at {position:.4g} {unit}",
            joint=names[worst],
            position=position,
            unit=units[worst],
        )

    ports = {"state": plant.get_state_output_port()}
    return add_monitor(builder, ports, excess=excess, why=why, hold=hold, name=name)


@drake_asserts()
def add_contact_sensor(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    body: str,
    *,
    other: str | None = None,
    frame: str | None = None,
    model_instance: ModelInstanceIndex | None = None,
    name: str = "",
) -> OutputPort:
    """Add a sensor of the contact force on a body.

    Args:
        builder: builder of the diagram that contains the plant.
        plant: the plant, finalized.
        body: name of the body on which the force acts.
        other: name of the body that presses on it; None means everything else. ``world`` is the plant's world body,
            such as a floor; bodies that are welded to it have names of their own.
        frame: name of the frame in whose axes, and about whose origin, the wrench is given; None means the world's.
        model_instance: model instance of ``body`` and ``frame``; it may be None if their names are unique.
        name: name of the block; ``contact.<body>`` by default.

    Returns:
        the wrench, size 6: force [N], then moment [N·m].

    Raises:
        UnknownName: there is no such body or frame.
        InvalidParameter: a body has no collision shapes, or several bodies or frames have the name.
        SimrobError: the plant is not finalized, or not in the builder.
    """
    _check_plant(builder, plant)
    # If it is None, the sensor takes the world's frame.
    felt_at = None if frame is None else plant.get_frame(_frame_index(plant, frame, model_instance))
    own_body = _body_of(plant, body, model_instance)
    other_body = None if other is None else _body_of(plant, other, None)
    # Drake gives no contacts of a body without collision shapes, and the sensor would always measure zero.
    for each in (own_body, other_body):
        if each is not None and not plant.GetCollisionGeometriesForBody(each):
            needed = message("parts.body_that_collides", "a body with collision shapes")
            raise InvalidParameter("body", quote_value(each.name()), needed)
    sensor = ForceSensor(
        plant=plant,
        body=plant.GetCollisionGeometriesForBody(own_body),
        other=None if other_body is None else plant.GetCollisionGeometriesForBody(other_body),
        frame=felt_at,
    )
    contacts = _contacts_of(builder, plant)
    return add_and_connect(
        builder, name or f"contact.{body}", sensor, contacts, plant.get_body_poses_output_port()
    )


@drake_asserts()
def add_imu(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    frame: str,
    *,
    rate: float = 200.0,
    accelerometer_noise: float = 0.0,
    gyroscope_noise: float = 0.0,
    accelerometer_bias: float = 0.0,
    gyroscope_bias: float = 0.0,
    seed: int = 0,
    model_instance: ModelInstanceIndex | None = None,
    name: str = "",
) -> InertialUnit:
    """Add an inertial measurement unit at a frame of a plant.

    Args:
        builder: builder of the diagram that contains the plant.
        plant: the plant, finalized.
        frame: name of the frame, or of a body.
        rate: samples per second [Hz].
        accelerometer_noise: standard deviation of a sample of each axis [m/s²].
        gyroscope_noise: standard deviation of a sample of each axis [rad/s].
        accelerometer_bias: standard deviation of the constant error of each axis [m/s²].
        gyroscope_bias: standard deviation of the constant error of each axis [rad/s].
        seed: seed of noise and biases. The same seed gives the same values.
        model_instance: model instance of the frame; it may be None if its name is unique.
        name: name of the block; ``imu.<frame>`` by default.

    Returns:
        the block, with the output ports ``specific_force`` (3) [m/s²], ``angular_velocity`` (3) [rad/s], both in the
        axes of the frame, and ``orientation`` (4): qw qx qy qz of the frame in the world.

    Raises:
        UnknownName: there is no such frame.
        InvalidParameter: the rate is invalid, or several frames have the name.
        InvalidConfig: a noise, a bias or the seed is invalid.
        SimrobError: the plant is not finalized, or not in the builder.
    """
    _check_plant(builder, plant)
    positive_rate = np.isfinite(rate) and rate > 0
    if not positive_rate:
        raise InvalidParameter(
            "rate", rate, message("parts.positive_rate", "a positive number [Hz]")
        )
    # The section of a station file checks the other values, and has them for the block.
    section = Imu(
        kind="imu",
        rate=rate,
        seed=seed,
        accelerometer_noise=accelerometer_noise,
        gyroscope_noise=gyroscope_noise,
        accelerometer_bias=accelerometer_bias,
        gyroscope_bias=gyroscope_bias,
    )
    block = InertialUnit(
        section, plant, plant.get_frame(_frame_index(plant, frame, model_instance))
    )
    add_and_connect(builder, name or f"imu.{frame}", block, plant.get_state_output_port())
    return block


def _a_builder() -> str:
    """Text for errors: what a builder is."""
    return message("parts.diagram_builder", "a Drake DiagramBuilder")


def _check_plant(builder: object, plant: object) -> None:
    """Check that a plant is finalized and in a builder.

    Raises:
        InvalidParameter: an argument is no builder, or no plant.
        SimrobError: the plant is not finalized, or is in another builder.
    """
    instance(builder, "builder", DiagramBuilder, _a_builder())
    instance(
        plant, "plant", MultibodyPlant, message("parts.drakes_plant", "a Drake MultibodyPlant")
    )
    assert isinstance(builder, DiagramBuilder)
    assert isinstance(plant, MultibodyPlant)
    if not plant.is_finalized():
        raise SimrobError(
            message(
                "parts.plant_not_finalized",
                "the plant is not finalized; call plant.Finalize() before you add parts",
            )
        )
    if not any(system is plant for system in builder.GetSystems()):
        raise SimrobError(
            message(
                "parts.plant_elsewhere",
                "the plant is not in this builder; give the builder that contains the plant",
            )
        )


def _joints_of(
    plant: MultibodyPlant, names: Sequence[str] | None, model_instance: ModelInstanceIndex | None
) -> list[Joint]:
    """Find joints of one axis by their names.

    Args:
        plant: the plant.
        names: names of the joints; None means all joints that turn or slide about one axis.
        model_instance: model instance of the joints; None means any.

    Returns:
        the joints, in the order of the names or, without names, of the plant.

    Raises:
        UnknownName: there is no joint of one axis with such a name.
        InvalidParameter: a text in place of a list, no joints, a name twice, or joints of several model instances.
    """
    every = [plant.get_joint(index) for index in plant.GetJointIndices()]
    # Joints of one axis, about which they turn or along which they slide: the servos have one value for each joint.
    single = [
        joint for joint in every if joint.num_positions() == 1 and joint.num_velocities() == 1
    ]
    if model_instance is not None:
        single = [joint for joint in single if joint.model_instance() == model_instance]
    if names is None:
        found = single
    else:
        if isinstance(names, str):
            needed = message("parts.list_of_joints", "a list of joint names")
            raise InvalidParameter("joints", quote_value(names), needed)
        known = [joint.name() for joint in single]
        found = []
        for name in names:
            one_of(message("parts.joint_of_one_axis", "joint of one axis"), name, known)
            # Several model instances may have a joint of this name; the check below finds that.
            found += [joint for joint in single if joint.name() == name]
    # The actuators of an instance share one port, so servos for several instances would need several blocks.
    instances = {int(joint.model_instance()) for joint in found}
    if len(instances) > 1:
        listed = ", ".join(
            plant.GetModelInstanceName(ModelInstanceIndex(index)) for index in sorted(instances)
        )
        raise Unsuitable(
            "joints",
            message(
                "parts.in_instances",
                "joints of these names are in several model instances: {instances}",
                instances=listed,
            ),
            message("parts.of_one_instance", "give model_instance"),
        )
    has_repeated_names = names is not None and len(set(names)) < len(names)
    if not found or has_repeated_names:
        raise InvalidParameter(
            "joints",
            quote_value(names),
            message("parts.different_joints", "a list of different joint names, at least one"),
        )
    return found


def _without_actuator(plant: MultibodyPlant, joints: Sequence[Joint]) -> Flags:
    """Find whether each joint has no actuator, shape (n,), and so is passive."""
    actuators = [
        plant.get_joint_actuator(JointActuatorIndex(index))
        for index in range(plant.num_actuators())
    ]
    driven = {int(actuator.joint().index()) for actuator in actuators}
    return np.array([int(joint.index()) not in driven for joint in joints])


def _effort_limits(plant: MultibodyPlant, joints: Sequence[Joint]) -> Vector:
    """Effort limit of each joint's first actuator, shape (n,) [N·m]. It is 0 if a joint has no actuator."""
    limits = np.zeros(len(joints))
    row_of_joint = {int(joint.index()): row for row, joint in enumerate(joints)}
    # From the last to the first, so that the first one remains: a joint's first actuator is its motor, and further ones
    # may be its friction.
    for index in reversed(range(plant.num_actuators())):
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        row = row_of_joint.get(int(actuator.joint().index()))
        # Actuators of joints that are not asked for have no row.
        if row is not None:
            limits[row] = actuator.effort_limit()
    return limits


def _values(
    key: str,
    value: JointValues,
    names: Sequence[str],
    passive: Flags,
    otherwise: float | Vector = 0.0,
) -> Vector:
    """Spread a value over joints, shape (n,). Passive joints get 0.

    Args:
        key: name of the argument, for errors.
        value: one value, n values, or values by name.
        names: names of the n joints.
        passive: whether each joint is passive (has no actuator), shape (n,).
        otherwise: value, or values (n,), of joints that a mapping leaves out.

    Raises:
        UnknownName: the mapping has a name that is no joint.
        InvalidParameter: the count of values differs, a passive joint gets one by its name that is not 0, or a value is
            not finite (except torque limits).
    """
    if isinstance(value, Mapping):
        values = np.array(np.broadcast_to(otherwise, len(names)), dtype=float)
        what = message("parts.joint_in", "joint for {key}", key=key)
        for name, own in value.items():
            index = list(names).index(one_of(what, name, names))
            if passive[index] and own:
                raise Unsuitable(
                    f"{key}[{name!r}]",
                    message("parts.no_actuator", "this joint has no actuator in the plant"),
                )
            values[index] = own
    else:
        entries = numbers(value)
        if entries.shape not in ((), (len(names),)):
            expected = message(
                "parts.values_of_joints",
                "one number, or {count} numbers, one for each joint",
                count=len(names),
            )
            raise InvalidParameter(key, quote_value(value), expected)
        values = np.array(np.broadcast_to(entries, len(names)))
    # An infinite torque limit is a motor without a limit; infinite gains are mistakes.
    if not np.isfinite(values[~passive]).all() and key != "torque_limit":
        raise InvalidParameter(key, quote_value(value), message("parts.finite_numbers", "finite"))
    return np.where(passive, 0.0, values)


def _gains(
    plant: MultibodyPlant,
    joints: Sequence[Joint],
    passive: Flags,
    *,
    kp: JointValues,
    ki: JointValues,
    kd: JointValues,
    torque_limit: JointValues | None,
    motor: MotorChoice | None,
) -> ServoGains:
    """Collect the gains and limits of servos.

    Args:
        plant: the finalized plant.
        joints: the n joints.
        passive: whether each joint is passive (has no actuator), shape (n,).
        kp: stiffness [N·m/rad].
        ki: integral gain [N·m/(rad·s)].
        kd: damping [N·m·s/rad].
        torque_limit: limits of the torques [N·m]; None means the effort limits of the actuators.
        motor: motors whose torque falls with their speed; None means motors that give the limit at any speed.

    Raises:
        UnknownName: there is no such joint or motor.
        InvalidParameter: a value is invalid.
    """
    names = [joint.name() for joint in joints]
    efforts = _effort_limits(plant, joints)
    # A limit of 0 marks a passive joint, see `ServoGains`.
    limit = np.where(passive, 0.0, efforts)
    if torque_limit is not None:
        limit = _values("torque_limit", torque_limit, names, passive, otherwise=efforts)
    line = None
    if motor is not None:
        motors = _motors(motor, names, passive)
        line = _line(motors)
        # A motor's peak torque limits it, too, whatever the speed.
        peaks = np.full(len(motors), np.inf)
        for index, own in enumerate(motors):
            if own is not None and own.peak_torque is not None:
                peaks[index] = own.peak_torque
        limit = np.minimum(limit, peaks)
    # Drake's actuators without an effort limit have an infinite one, for which a saturation needs a number.
    limit = np.minimum(limit, np.finfo(float).max)
    return ServoGains(
        kp=_values("kp", kp, names, passive),
        ki=_values("ki", ki, names, passive),
        kd=_values("kd", kd, names, passive),
        torque_limit=limit,
        # The integral part alone may give the whole torque, but no more: it would only wind up.
        integral_limit=limit,
        line=line,
    )


def _motors(choice: MotorChoice, names: Sequence[str], passive: Flags) -> list[Motor | None]:
    """Find the motor of each joint, with torques and speeds behind its gear. Joints without a motor get None.

    Args:
        choice: one motor for all joints that are not passive, or motors by joint.
        names: names of the n joints.
        passive: whether each joint is passive (has no actuator), shape (n,).

    Raises:
        UnknownName: there is no such motor or joint.
        InvalidParameter: a motor lacks its torque at rest or its speed without load.
    """
    # A single motor is one of that kind at each joint.
    by_joint = choice if isinstance(choice, Mapping) else dict.fromkeys(names, choice)
    motors: list[Motor | None] = [None] * len(names)
    what = message("parts.joint_in", "joint for {key}", key="motor")
    for name, own in by_joint.items():
        index = list(names).index(one_of(what, name, names))
        # One motor for all joints is not meant for those without an actuator. A motor given for such a joint by name
        # has no effect either.
        if passive[index]:
            continue
        if isinstance(own, str):
            known = known_motors()
            model = known[one_of(message("parts.motor", "motor"), own, known)]
        else:
            model = own
        # The line from the torque at rest to the speed without load needs both of its ends.
        if model.stall_torque is None or model.no_load_speed is None:
            expected = message(
                "parts.whole_motor", "a Motor with stall_torque [N·m] and no_load_speed [rad/s]"
            )
            raise InvalidParameter("motor", quote_value(own), expected)
        motors[index] = model.at_output
    return motors


def _line(motors: Sequence[Motor | None]) -> MotorLine:
    """Describe how the torques of n motors fall with their speeds.

    The line of a joint without a motor (None) is infinite at all speeds.
    """
    # Without a motor a joint is limited by its torque limit alone.
    stall = np.full(len(motors), np.inf)
    slope = np.zeros(len(motors))
    for index, motor in enumerate(motors):
        if motor is not None:
            # torque(v) = stall - slope v, which is zero at the speed without load.
            torque_at_rest, no_load_speed = motor.line
            stall[index] = torque_at_rest
            slope[index] = torque_at_rest / no_load_speed
    # No dampers: the joints of the user's plant are not changed, so the blocks reduce the torques alone.
    return MotorLine(stall=stall, slope=slope, damping=np.zeros(len(motors)))


def _check_damping(plant: MultibodyPlant, joints: Sequence[Joint], gains: ServoGains) -> None:
    """Check that servos as blocks are stable at the steps of a discrete plant, which takes their torques explicitly.

    Raises:
        InvalidParameter: a joint's damping is too large for the time step.
    """
    step = plant.time_step()
    # A solver of a continuous plant chooses steps that are short enough.
    if step == 0:
        return
    # The servos' torque -kd v acts for a whole step: a velocity v becomes (1 - kd h / M) v in a step h, which must not
    # be larger than v: kd h / M < 2.
    mass_matrix = plant.CalcMassMatrix(plant.CreateDefaultContext())
    # Inertia of each axis while the others move freely. With the others at rest it would be larger, and the check too
    # tolerant.
    free_inertias = 1 / np.diag(np.linalg.inv(mass_matrix))
    inertias = free_inertias[[joint.velocity_start() for joint in joints]]
    worst = int(np.argmax(gains.kd / inertias))
    largest = _STABLE_DAMPING * inertias[worst] / step
    if gains.kd[worst] > largest:
        expected = message(
            "parts.stable_damping",
            "at most {largest:.3g} at steps of {step:g} s; "
            "larger values need a shorter time step, or a continuous plant",
            largest=largest,
            step=step,
        )
        raise InvalidParameter(f"kd[{joints[worst].name()!r}]", gains.kd[worst], expected)


def _body_of(
    plant: MultibodyPlant, name: str, model_instance: ModelInstanceIndex | None
) -> RigidBody:
    """Find a body by its name.

    Args:
        plant: the plant.
        name: name of the body.
        model_instance: model instance of the body; if it is None, any body of this name is meant.

    Raises:
        UnknownName: there is no such body.
        InvalidParameter: there are several bodies of this name.
    """
    # From index 0, the world, since ``world`` is a name that a user may give.
    bodies = [plant.get_body(BodyIndex(index)) for index in range(plant.num_bodies())]
    if model_instance is not None:
        bodies = [body for body in bodies if body.model_instance() == model_instance]
    names = [body.name() for body in bodies]
    return bodies[_index_of_unique("body", message("parts.body", "body"), name, names)]


def _frame_index(
    plant: MultibodyPlant, name: str, model_instance: ModelInstanceIndex | None
) -> FrameIndex:
    """Find the index of a frame by its name.

    Args:
        plant: the plant.
        name: name of the frame, or of a body, for the frame of the body.
        model_instance: model instance of the frame; if it is None, any frame of this name is meant.

    Raises:
        UnknownName: there is no such frame.
        InvalidParameter: there are several frames of this name.
    """
    frames = [plant.get_frame(FrameIndex(index)) for index in range(plant.num_frames())]
    if model_instance is not None:
        frames = [frame for frame in frames if frame.model_instance() == model_instance]
    names = [frame.name() for frame in frames]
    return frames[_index_of_unique("frame", message("parts.frame", "frame"), name, names)].index()


def _index_of_unique(argument: str, what: str, name: str, names: Sequence[str]) -> int:
    """Find the index of a name that must be unique.

    Args:
        argument: name of the user's argument, for errors.
        what: word for what is named, for errors.
        name: the name.
        names: all names.

    Raises:
        UnknownName: there is no such name.
        InvalidParameter: the name is not unique.
    """
    one_of(what, name, names)
    if names.count(name) > 1:
        expected = message("parts.unique_name", "a unique name, or one with model_instance")
        raise InvalidParameter(argument, quote_value(name), expected)
    return names.index(name)


def _contacts_of(builder: DiagramBuilder, plant: MultibodyPlant) -> OutputPort:
    """Find the block that reads the contacts of a plant, or add it: all contact sensors of the plant share it."""
    # The name of the plant is part of the block's: a builder may contain several plants.
    name = f"{plant.get_name()}.contacts"
    if builder.HasSubsystemNamed(name):
        return builder.GetSubsystemByName(name).get_output_port()
    return add_and_connect(builder, name, ContactReader(), plant.get_contact_results_output_port())
