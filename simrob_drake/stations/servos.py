"""The servos of a station's robots: gains, limits and motors, of the station, the robot's own file and its URDF.

A robot has n axes. A *passive* axis has no motor, and so no servo. The *line* of a motor describes how its torque falls
with its speed: from the *stall torque* at rest to zero at the speed without load. *Drives* are the rotors, gears,
friction and backlash of the axes. Values that a user *states* are those in the station's file.
"""

from typing import Any

import numpy as np

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.blocks.servo import MotorLine, ServoGains
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.catalog import LIMIT, PASSIVE, RobotModel
from simrob_drake.robots.motors import NO_MOTOR, OF_URDF, Drives, Motor, known_motors
from simrob_drake.stations.config import ServoConfig, StationConfig

_KEY = "servo.motor"
_KEYS_WITH_MOTOR = "kp", "ki", "kd", "torque_limit", "integral_limit"
"""Keys of a servo whose values a passive axis cannot have."""

_DRIVE_KEYS = "rotor_inertia", "gear_ratio", "damping", "friction", "backlash_deg"
"""Keys of drives whose values the description of a motor may contain."""


def station_motors(robot: RobotModel, servo: ServoConfig) -> list[Motor | None]:
    """Find the motor of each axis of a robot: that of the station, else the robot's own, with all values filled in.

    If the station has the key ``servo.motor``, the motors of the robot's own file do not count, also for axes that a
    mapping of the station leaves out. The entry of an axis is None if its servo has no model of a motor, or if the axis
    is passive.

    Raises:
        UnknownName: there is no motor or no axis of that name.
        InvalidParameter: a motor takes its values from the URDF, which does not limit both effort and velocity, or a
            supply is given without the voltage or current at which the motor's values hold.
        Unsuitable: a motor has no torque at rest or no speed without load, or the station names a motor for a passive
            axis.
    """
    # One motor for all axes, a mapping by axis, or None: the name of a motor, or its values.
    choice = robot.servo.motor if servo.motor is None else servo.motor
    found: list[Motor | None] = [None] * len(robot.axes)
    if choice is None:
        return found
    # Axes that a mapping leaves out have no model of a motor.
    by_axis = choice if isinstance(choice, dict) else dict.fromkeys(robot.axes, choice)
    passive = _passive_indices(robot, servo)
    for axis, own in by_axis.items():
        index = robot.axis_index(axis, _KEY)
        if index not in passive:
            found[index] = _complete_motor(own, robot, index)
        # A choice for all axes, or one of the robot's own file, leaves passive axes out. A station that names a passive
        # axis asks for a motor there, which is an error unless it says that there is none.
        elif isinstance(servo.motor, dict) and NO_MOTOR not in (own, getattr(own, "model", None)):
            raise passive_axis(f"{_KEY}.{axis}", axis)
    return found


def _passive_indices(robot: RobotModel, servo: ServoConfig) -> set[int]:
    """Indices of the passive axes: those that the station names, else the robot's own."""
    names = robot.passive_axes if servo.passive is None else servo.passive
    return {robot.axis_index(axis, PASSIVE) for axis in names}


def passive_axis(key: str, axis: str) -> Unsuitable:
    """Create the error for a key that a passive axis cannot have, such as a motor, a gain or a target."""
    return Unsuitable(
        key,
        message("stations.axis_is_passive", "{axis} is passive: no motor moves it", axis=axis),
        message(
            "stations.leave_out_or_give_motor",
            "leave it out, or give the axis a motor by servo.passive and servo.torque_limit",
        ),
    )


def check_drives(robot: RobotModel, drives: Drives) -> None:
    """Check that a station gives no parts of a motor to passive axes by their names.

    Args:
        robot: the robot, with the passive axes of the station.
        drives: the section ``drives`` of the robot in the station.

    Raises:
        UnknownName: a mapping names an axis that the robot does not have.
        Unsuitable: a mapping gives a rotor, a gear or backlash to a passive axis.
    """
    # The other keys, damping and friction, are allowed: they belong to the joint, which a passive axis has as well.
    for key in ("rotor_inertia", "gear_ratio", "backlash_deg"):
        values = getattr(drives, key)
        if not isinstance(values, dict):
            continue  # a number or a list is meant for the axes with motors
        for axis in values:
            if robot.passive[robot.axis_index(axis, f"drives.{key}")]:
                raise passive_axis(f"drives.{key}.{axis}", axis)


def with_passive_axes(robot: RobotModel, servo: ServoConfig) -> RobotModel:
    """Copy a robot with the passive axes that the station names; the same robot if the station names none.

    An axis that is passive in the robot's file gets a motor if the station's list leaves it out. Its largest torque is
    that of the station's key ``torque_limit``, else that of the same key in the robot's own file, else that of the
    motor of the axis.

    Raises:
        UnknownName: there is no axis of such a name.
        Unsuitable: an axis gets a motor whose largest torque is not given.
        SimrobError: an error of :func:`station_motors`.
    """
    if servo.passive is None:
        return robot
    own = robot.servo.torque_limit  # of the robot's own file
    # NaN stands for axes without a value.
    limits = robot.axis_vector({} if own is None else own, LIMIT, np.nan)
    if servo.torque_limit is not None:
        limits = robot.axis_vector(servo.torque_limit, LIMIT, limits)
    # Largest torques by axis, as far as they are given.
    known = {
        axis: limit
        for axis, limit in zip(robot.axes, limits.tolist(), strict=True)
        if np.isfinite(limit)
    }
    for axis, motor in zip(robot.axes, station_motors(robot, servo), strict=True):
        if motor is not None:
            # A limit that is given comes before that of the motor.
            known.setdefault(axis, motor.peak_torque or motor.line[0])
    changed = robot.with_passive_axes(servo.passive, known)
    changed.element  # noqa: B018  # raises now if a motor has no limit
    return changed


def _complete_motor(choice: str | Motor, robot: RobotModel, axis: int) -> Motor | None:
    """Fill in the values of an axis's motor from the entry of the motor catalogue that it names.

    Args:
        choice: name of a motor in the catalogue, or values of a motor. The values may contain such a name, and then
            replace single values of the named motor. Two names are no entries: ``urdf`` for the limits of the URDF, and
            ``none`` for no motor.
        robot: the robot, for a motor that has the limits of the URDF.
        axis: index of the axis.

    Returns:
        the motor with its torques behind the losses of its gear, or None if the choice names ``none``.

    Raises:
        UnknownName: the catalogue has no motor of that name.
        InvalidParameter: the URDF does not limit effort and velocity, or a supply is given without the voltage or the
            current at which the motor's values hold.
        Unsuitable: the torque at rest or the speed without load is missing.
    """
    stated = Motor(model=choice) if isinstance(choice, str) else choice
    # The user may remove a motor that the robot's own file names.
    if stated.model == NO_MOTOR:
        return None
    # The motor that is named, whose values are replaced below by those that are stated.
    if stated.model == OF_URDF:
        base = _motor_of_urdf(robot, axis)
    elif stated.model is None:
        base = Motor()
    elif stated.model in known_motors():
        base = known_motors()[stated.model]
    else:
        subject = message("stations.motor_for", "motor for {key}", key=_KEY)
        raise UnknownName(subject, stated.model, [*known_motors(), OF_URDF, NO_MOTOR])
    # Values that are stated replace those of the named motor.
    motor = base.model_copy(update=stated.model_dump(exclude_unset=True, exclude={"model"}))
    _check_motor_values(motor)
    # Servos count torques at the joint. Until here, the torques of a motor with a gear efficiency are those before the
    # losses in the gear: `at_output` multiplies them by the efficiency. Ratio and speeds stay.
    return motor.at_output


def _motor_of_urdf(robot: RobotModel, axis: int) -> Motor:
    """Create a motor from the effort and velocity limits of an axis in the URDF.

    Raises:
        InvalidParameter: the URDF does not limit both. An effort of 0 counts as missing, and so does a velocity of 0,
            which `RobotModel.speed_limits` reads as infinite.
    """
    torque = float(robot.efforts[axis])
    speed = float(robot.speed_limits[axis])
    # Two points define the line of a motor: effort at rest, and speed without torque. Missing values are infinite or 0.
    has_limits = np.isfinite([torque, speed]).all() and torque > 0
    if not has_limits:
        name = [*robot.axes][axis]
        subject = message("stations.key_of", "{key} of {name}", key=_KEY, name=name)
        expected = message(
            "stations.values_needed",
            "values of a motor, since its URDF does not limit both effort and velocity",
        )
        raise InvalidParameter(subject, OF_URDF, expected)
    return Motor(
        stall_torque=torque,
        no_load_speed=speed,
        source=message("stations.urdf_limits", "limits of the URDF, an estimate"),
    )


def _check_motor_values(motor: Motor) -> None:
    """Check that a motor has the values that its torque line and its supply need.

    Raises:
        Unsuitable: the torque at rest or the speed without load is missing.
        InvalidParameter: a supply is given without the voltage or the current at which the motor's values hold.
    """
    for needed in ("stall_torque", "no_load_speed"):
        if getattr(motor, needed) is None:
            problem = message("stations.is_missing", "the value is missing")
            remedy = message(
                "stations.give_it_or_motor", "give the value, or name a motor that has it"
            )
            raise Unsuitable(f"{_KEY}.{needed}", problem, remedy)
    # Torque and speed scale with supply / voltage, so the voltage of the given values must be
    # known.
    needs_of_supply = {"supply": ("voltage",), "supply_resistance": ("voltage", "stall_current")}
    for key, needs in needs_of_supply.items():
        is_complete = all(getattr(motor, need) is not None for need in needs)
        if getattr(motor, key) and not is_complete:
            expected = message(
                "stations.given_with",
                "given together with the motor's {needs}, for which its other values hold",
                needs=join_texts(needs, message("base.and", " and ")),
            )
            raise InvalidParameter(f"{_KEY}.{key}", f"{getattr(motor, key):g}", expected)


def drives_of(motors: list[Motor | None], robot: RobotModel) -> Drives:
    """Collect the drives (rotors, gears, friction) that the motors of a robot's axes bring.

    A motor's gear ratio is left out if neither the motor nor the robot's drives give a rotor inertia: the axis then has
    the rotor inertia of the URDF, which belongs to the gear ratio of the URDF.

    Args:
        motors: motor of each axis, or None.
        robot: the robot.

    Returns:
        mappings by axis for the keys of drives that at least one motor gives; the other keys are left out.
    """
    # A mapping without entries gives each axis the value NaN below.
    own_inertias = {} if robot.drives.rotor_inertia is None else robot.drives.rotor_inertia
    # NaN if the robot's drives give none.
    inertias = robot.axis_vector(own_inertias, "rotor_inertia", np.nan)
    values: dict[str, dict[str, float]] = {key: {} for key in _DRIVE_KEYS}
    for axis, motor, inertia in zip(robot.axes, motors, inertias.tolist(), strict=True):
        if motor is None:
            continue
        has_inertia = motor.rotor_inertia is not None or not np.isnan(inertia)
        for key in _DRIVE_KEYS:
            value = getattr(motor, key)
            if value is not None and (key != "gear_ratio" or has_inertia):
                values[key][axis] = value
    unchecked: dict[str, Any] = {key: by_axis for key, by_axis in values.items() if by_axis}
    return Drives(**unchecked)


def servo_gains(
    robot: RobotModel,
    servo: ServoConfig,
    *,
    dampers: bool = False,
) -> ServoGains:
    """Collect the gains and limits of a robot's servos.

    A gain is that of the station, else that of the robot's own file, else 0. A torque limit is that of the station,
    else the largest torque of the axis' motor, else the effort of the URDF. An axis that the URDF gives no motor, but
    the key ``servo.passive`` of the robot's file does, has the ``servo.torque_limit`` of that file as its effort. The
    limit of an integral part is that of the station, else the torque limit. The speed limit of a cascade is that of the
    station, else that of the URDF.

    Passive axes have neither gains nor a torque limit: these values are 0.

    Args:
        robot: the robot, with the passive axes of the station.
        servo: the section ``servo`` of the robot.
        dampers: whether dampers of the plant's joints represent the fall of the motors' torques with speed, where the
            torque limits allow this.

    Raises:
        InvalidParameter: a value does not fit the law of the servos.
        Unsuitable: the station gives a value to a passive axis by its name, or the law does not work with passive axes.
        SimrobError: an error of :func:`station_motors`.
    """
    passive = robot.passive
    if passive.any():
        _check_passive(robot, servo)
    motors = station_motors(robot, servo)
    # A motor gives its peak torque or, if that is not known, its torque at rest: the first value of its line.
    efforts = np.array(
        [
            effort if motor is None else motor.peak_torque or motor.line[0]
            for motor, effort in zip(motors, robot.efforts, strict=True)
        ]
    )

    def gains_of(key: str) -> Vector:
        """Gains (n,) of a key: the station's, else the robot's own, else 0."""
        own = getattr(robot.servo, key, None)
        base = robot.axis_vector(own, key) if own is not None else np.zeros(len(robot.axes))
        stated = getattr(servo, key)
        # Axes that a mapping leaves out keep the robot's own value.
        gains = base if stated is None else robot.axis_vector(stated, f"servo.{key}", base)
        return np.where(passive, 0.0, gains)

    def limits(key: str, otherwise: Vector) -> Vector:
        """Limits (n,) of a key: the station's, else the given ones (n,)."""
        stated = getattr(servo, key)
        return otherwise if stated is None else robot.axis_vector(stated, f"servo.{key}", otherwise)

    # A limit of 0 is what makes an axis passive, see `ServoGains`.
    limit = np.where(passive, 0.0, limits("torque_limit", efforts))
    speed = limits("speed_limit", robot.speed_limits) if servo.law == "cascade" else None
    if servo.law == "computed_torque" and (gains_of("ki") > 0).any():
        expected = message(
            "stations.zero_with_computed_torque",
            "0 with law computed_torque, whose model replaces the integral part",
        )
        largest = float(gains_of("ki").max())  # perhaps of the robot's own file
        raise InvalidParameter("servo.ki", largest, expected)
    line = _motor_line(motors, limit, dampers=dampers) if any(motors) else None
    return ServoGains(
        kp=gains_of("kp"),
        ki=gains_of("ki"),
        kd=gains_of("kd"),
        torque_limit=limit,
        integral_limit=np.where(passive, 0.0, limits("integral_limit", limit)),
        speed_limit=speed,
        line=line,
    )


def _check_passive(robot: RobotModel, servo: ServoConfig) -> None:
    """Check that the servos of a robot with passive axes do not need a motor on every axis.

    Raises:
        Unsuitable: the law needs motors on all axes, or a mapping gives a value above 0 to a passive axis.
    """
    names = robot.passive_axes
    # Keys with which every axis needs a motor: their value as a text, which is empty if the station does not use them.
    needs_motors = {
        "servo.law": servo.law if servo.law != "pid" else "",
        "servo.admittance_gain": f"{servo.admittance_gain:g}" if servo.admittance_gain > 0 else "",
    }
    for key, value in needs_motors.items():
        if value:
            problem = message(
                "stations.needs_all_motors",
                "{value} needs a motor on every axis; passive: {axes}",
                value=value,
                axes=", ".join(names),
            )
            remedy = message(
                "stations.use_pid",
                "use law pid without admittance_gain, or give every axis a motor",
            )
            raise Unsuitable(key, problem, remedy)
    for key in _KEYS_WITH_MOTOR:
        stated = getattr(servo, key)
        if not isinstance(stated, dict):
            continue  # a number or a list is meant for the axes with motors
        for axis, value in stated.items():
            if value > 0 and robot.passive[robot.axis_index(axis, f"servo.{key}")]:
                raise passive_axis(f"servo.{key}.{axis}", axis)


def _motor_line(motors: list[Motor | None], limit: Vector, *, dampers: bool) -> MotorLine:
    """Collect how the torques of motors fall with their speeds.

    Args:
        motors: motor of each axis, or None.
        limit: torque limits of the servos, shape (n,) [N·m or N].
        dampers: whether the slopes are dampers of joints where the limit allows it: where it does not cut the line.

    Returns:
        stall torques, slopes of the lines, and the slopes that dampers represent, shape (n,) each. For an axis without
        a motor the stall torque is infinite, and the slopes are 0.
    """
    # Torque at rest [N·m or N] and speed without load [rad/s or m/s] of each axis; infinite without a motor.
    lines = [(np.inf, np.inf) if motor is None else motor.line for motor in motors]
    stall, fastest = np.array(lines).T
    # The torque falls along a line, tau = tau_s - D omega, with the slope D = tau_s / omega_0 [N·m·s/rad or N·s/m].
    # For an axis without a motor the quotient is 0 / 1, so that its slope is 0 and not inf / inf.
    stall_or_zero = np.where(np.isfinite(stall), stall, 0.0)
    speed_or_one = np.where(np.isfinite(fastest), fastest, 1.0)
    slope = stall_or_zero / speed_or_one
    # A limit below the stall torque cuts the line, which a damper cannot represent.
    damping = np.where(stall <= limit, slope, 0.0) if dampers else np.zeros_like(slope)
    return MotorLine(stall=stall, slope=slope, damping=damping)


def check_motors(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check that servos and solver can realize a robot's motors.

    Only motors that actuators of the plant realize have bounds. Kinematic stations, and robots without motor models,
    pass.

    Raises:
        Unsuitable: the law of the servos is ``computed_torque``, and actuators realize the motors.
        InvalidParameter: a torque limit or a gain does not fit the motor in an actuator; the message names the key and
            its bound.
    """
    gains = robot.gains
    servo = config.servo_of(robot.name)
    engine = config.engine
    in_actuators = servo.realization == "implicit" or engine.limits_torques_in_actuators
    # Outside of actuators, the motor's line is a block of its own, which has no such bounds.
    if gains.line is None or not engine.moves_by_forces or not in_actuators:
        return
    blocks = message(
        "stations.per_joint_without_cenic", "realization per_joint and a solver other than cenic"
    )
    if servo.law == "computed_torque":
        problem = message(
            "stations.computed_torque_without_motor", "law computed_torque does not support motors"
        )
        remedy = message("stations.leave_out_or", "leave it out, or use {blocks}", blocks=blocks)
        raise Unsuitable("servo.motor", problem, remedy)
    # Where dampers of joints realize motors (not in MuJoCo), that is right only if the torque limit does not cut the
    # line. Where the slope is not a damper (see `_motor_line`), a limit cuts the line.
    capped = config.motors_are_dampers(robot.name) & (gains.line.slope > gains.damping)
    if capped.any():
        axis = int(np.argmax(capped))
        stall = message(
            "stations.stall_or_more",
            "{stall:.4g} or more, the stall torque of its motor",
            stall=gains.line.stall[axis],
        )
        name = message(
            "stations.torque_limit_of",
            "the torque limit (motor.peak_torque or servo.torque_limit) of {axis}",
            axis=robot.axes[axis],
        )
        expected = message(
            "stations.stall_or_mujoco",
            "{stall}; otherwise use solver.kind mujoco, or {blocks}",
            stall=stall,
            blocks=blocks,
        )
        raise InvalidParameter(name, f"{gains.torque_limit[axis]:g}", expected)
    # A damper is subtracted from the kd of a servo in an actuator, which must not become negative. The same bound holds
    # for all motors that are checked here.
    is_too_small = gains.line.slope > gains.kd
    if is_too_small.any():
        axis = int(np.argmax(is_too_small))
        expected = message(
            "stations.least_kd",
            "at least {slope:.3g}, since the torque of its motor falls with speed; otherwise use {blocks}",
            slope=gains.line.slope[axis],
            blocks=blocks,
        )
        name = message("stations.kd_of", "servo.kd of {axis}", axis=robot.axes[axis])
        raise InvalidParameter(name, f"{gains.kd[axis]:g}", expected)


def check_servo_uses_no_model(servo: ServoConfig) -> None:
    """Check that servos do not compute torques from the robot's model, as a robot that stands on its feet requires.

    The model contains only the robot itself. It lacks the contact forces at the feet, so its torques would be wrong.

    Args:
        servo: the section ``servo`` of the robot.

    Raises:
        InvalidParameter: the servos use the model; the message names the key and what would be right.
    """
    reason = message(
        "stations.model_lacks_forces",
        "the model of a robot with a floating base lacks the contact forces that carry it",
    )
    if servo.law == "computed_torque":
        expected = message(
            "stations.pid_or_cascade", "pid or cascade, since {reason}", reason=reason
        )
        raise InvalidParameter("servo.law", servo.law, expected)
    if servo.feedforward != "none":
        expected = message("stations.no_feedforward", "none, since {reason}", reason=reason)
        raise InvalidParameter("servo.feedforward", servo.feedforward, expected)
