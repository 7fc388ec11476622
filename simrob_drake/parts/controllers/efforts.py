"""Loops on forces: one presses with a desired force, the other one protects motors from overload.

A loop moves the reference of its robot, to which the servos move the axes. Its output ``offset`` is added to the
reference; its output ``target`` replaces the reference while its output ``active`` is 1. Its input ``asked`` is the
reference below it, with the changes of other loops of lower priority. For prismatic axes, read m for rad and N for N·m.
"""

import math
import weakref
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.sections import NotNegative, Positive, Triple
from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import ASKED, LoopSection, check_force_is_read
from simrob_drake.parts.monitors.sections import force_limit
from simrob_drake.parts.resolved import WORLD, ResolvedRobot, StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import frame_of
from simrob_drake.robots.axis_map import AxisMap, AxisValues

# Squared damping of the least squares for the joint offsets, per row (rad² and m²). Near a singularity it keeps joint
# motions small; elsewhere its effect is negligible.
_DAMPING = 1e-6 * np.eye(6)
# Largest error of the force at which the integral part changes, as a part of the desired force [1].
_INTEGRAL_RANGE = 0.2


def _unit(direction: Triple) -> Triple:
    """Scale a direction to the length 1.

    Raises:
        ValueError: its length is zero.
    """
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ValueError(message("parts.zero_direction", "a direction must not be the zero vector"))
    x, y, z = direction
    return x / length, y / length, z / length


class ForceControl(LoopSection):
    """Press with the tool: move it along a direction until a force sensor measures the desired force.

    The sensor is named by `reads: {force: <sensor>}`. The loop moves all axes of its robot. In the other directions,
    the tool stays where the reference has it.
    """

    label: ClassVar[str] = message("parts.loop_force_control", "force control")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_force_error", "Force error"),
        message("parts.stage_law_of_path", "PI law\ntool path"),
        message("parts.stage_jacobian", "Jacobian\njoint offsets"),
    )

    kind: Literal["force_control"]
    force: Positive
    """Desired force [N]."""
    direction: Annotated[Triple, AfterValidator(_unit)] = (0.0, 0.0, -1.0)
    """Direction in which the tool presses, in the axes of the sensor's `frame` (by default the world's)."""
    kp: Positive = 0.003
    """Speed of the tool for an error of the force [m/(s·N)]."""
    ki: NotNegative = 0.003
    """Growth of this speed [m/(s²·N)]; 0 for no integral part."""
    approach: Positive = 0.01
    """Largest speed of the tool while it touches nothing [m/s]."""
    speed: Positive = 0.05
    """Largest speed of the tool in contact [m/s]."""
    reach: Positive = 0.05
    """Largest distance of the tool from its reference [m]."""

    def check(self, key: str, station: StationContents) -> None:
        """Check, in addition to the base class, that a force sensor is read and that the robot has a tool.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the section names no force sensor, or the robot has no tool; or by the checks of the base class
                the robot does not exist, the station has no servos, or the rate is too high.
        """
        super().check(key, station)
        check_force_is_read(self, key)
        robot = station.robot(self.robot, key)
        if not robot.tcp:
            raise Unsuitable(
                key,
                message(
                    "parts.robot_without_tool",
                    "{robot} has no tool or piece to press with",
                    robot=robot.name,
                ),
                message("parts.robot_that_presses", "give the robot a tool, or name another robot"),
            )

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""
        # Force and direction have the axes of the frame that the sensor's section names, if it names one.
        # The section may write the name of the sensor, or that of its output: ``tip`` or ``force.tip``.
        sensors = site.station.sensors
        source = self.reads["force"]
        sensor = sensors.get(source, sensors.get(source.removeprefix("force.")))
        # An output that is no sensor, such as that of a block of the user's own, has the axes of the world.
        sensor_frame = frame_of(site.plant, getattr(sensor, "frame", WORLD))
        return PressingTool(
            self, site.plant.plant, robot.axis_map, robot.tools[robot.tcp], sensor_frame
        )


class _ToolPath(NamedTuple):
    """State of the force control.

    Attributes:
        path: distance x of the tool from its reference along the direction [m].
        drift: integral part z of the tool's speed [m/s].
    """

    path: float
    drift: float


class PressingTool(SampledBlock):
    r"""PI control of the force on a tool, which moves along a direction until a sensor measures the desired force.

    With the error e of the force, the distance x of the tool from its reference along the direction d follows

    .. math:: \dot x = \mathrm{clip}(k_p e + z, \pm v), \qquad \dot z = k_i e, \qquad |x| \le x_{max}.

    The integral part z only changes while the force is near the desired one and the speed is within its limit, so it
    does not wind up on the approach. The limit v is lower until the tool touches. With the integral part, no error
    remains if a surface approaches steadily, or if an arm sags more and more. The joint offsets :math:`\Delta q` move
    the tool by x d from its reference, without turning it. They approach this goal by one step of damped least squares
    per sample, with the Jacobian J, the remaining rotation r and the remaining distance s:

    .. math:: \Delta q \leftarrow \Delta q + J^\top (J J^\top + \lambda^2)^{-1} \begin{pmatrix} r \\ s \end{pmatrix} .

    Ports:
        in  ``force`` (3) [N]: on the tool, in the axes of the sensor; ``asked`` (n) [rad]: the reference of the joints.
        out ``offset`` (n) [rad], added to the reference; ``pressing`` (1) [N]: the force that the tool exerts along the
        direction; ``path`` (1) [m]: x.
    """

    def __init__(
        self,
        section: ForceControl,
        plant: MultibodyPlant,
        axes: AxisMap,
        tool: Frame,
        sensor: Frame,
    ) -> None:
        """Create the block. Joints of the plant that are no axes are taken to stay where they are at the start.

        Args:
            section: section of the loop.
            plant: the finalized plant, which need not be part of the diagram.
            axes: the robot's axes in the plant.
            tool: frame of the tool.
            sensor: frame in whose axes force and direction are given.
        """
        size = len(axes.signs)
        zero = np.zeros(1)
        self.units = {"offset": "rad", "pressing": "N", "path": "m"}
        outputs = {"offset": np.zeros(size), "pressing": zero, "path": zero}
        super().__init__(
            period=1 / section.rate,
            reads={"force": 3, ASKED: size},
            memory={**outputs, "drift": zero},
            gives=list(outputs),
        )
        # The station owns the plant: a block must not keep it in memory. Frames refer to the plant, indices do not.
        self._plant = weakref.proxy(plant)
        self._axes = axes
        self._tool = tool.index()
        self._sensor = sensor.index()
        # Work space: every evaluation sets its positions anew.
        self._scratch = plant.CreateDefaultContext()
        # Positions of the joints that are no axes, shape (nq,).
        self._rest = plant.GetPositions(self._scratch)
        self._section = section
        self._direction = np.array(section.direction)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the tool's distance from its reference, and the joint offsets for it.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        # The sensor measures the force on the tool, which is opposite to the force that the tool exerts.
        pressing = float(-self._direction @ read["force"])
        tool_path = self.next_path(memory["path"][0], memory["drift"][0], pressing)
        offset = self.next_offsets(memory["offset"], read[ASKED], tool_path.path)
        return {
            "pressing": pressing,
            "path": tool_path.path,
            "drift": tool_path.drift,
            "offset": offset,
        }

    def next_path(self, path: float, drift: float, pressing: float) -> _ToolPath:
        """Compute x and z after a sample, by the equations of the class.

        Args:
            path: x before the sample [m].
            drift: z before the sample [m/s].
            pressing: force that the tool exerts along the direction [N]. The tool touches if it is positive.
        """
        section = self._section
        error = section.force - pressing
        # dx/dt = clip(kp e + z). Without a touch the tool approaches slowly, so that it does not hit the surface.
        largest_speed = section.speed if pressing > 0 else section.approach
        desired_speed = section.kp * error + drift
        speed = min(max(desired_speed, -largest_speed), largest_speed)
        # dz/dt = ki e, near the desired force and within the limit of the speed
        is_near = abs(error) < _INTEGRAL_RANGE * section.force
        new_drift = drift
        if is_near and speed == desired_speed:
            new_drift = drift + section.ki * error * self.period
        new_path = min(max(path + speed * self.period, -section.reach), section.reach)
        return _ToolPath(path=new_path, drift=new_drift)

    def next_offsets(self, offset: Vector, reference: Vector, path: float) -> Vector:
        """Compute joint offsets that move the tool by a distance from its reference.

        Args:
            offset: offsets before the sample, shape (n,) [rad].
            reference: reference of the axes without the offsets, shape (n,) [rad].
            path: distance x of the tool from its pose at the reference, along the direction [m].

        Returns:
            The new offsets, shape (n,) [rad]. They are one step nearer to those that reach the distance exactly.
        """
        plant = self._plant
        context = self._scratch
        world = plant.world_frame()
        tool = plant.get_frame(self._tool)
        sensor = plant.get_frame(self._sensor)

        # Pose of the tool at the reference, and the direction in the world.
        plant.SetPositions(context, self._axes.spread_positions(reference, self._rest))
        target = tool.CalcPoseInWorld(context)
        direction = sensor.CalcRotationMatrixInWorld(context) @ self._direction

        # Remaining rotation and distance from the posture with the offsets so far.
        plant.SetPositions(context, self._axes.spread_positions(reference + offset, self._rest))
        present = tool.CalcPoseInWorld(context)
        rotation = (target.rotation() @ present.rotation().inverse()).ToAngleAxis()
        error = np.empty(6)
        error[:3] = rotation.angle() * rotation.axis()
        error[3:] = target.translation() + path * direction - present.translation()

        # One step of damped least squares, J' (J J' + lambda^2)^-1 (r, s). Its rows are rotation, then translation,
        # as Drake orders spatial velocities.
        tool_origin = np.zeros(3)
        plant_jacobian = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, tool, tool_origin, world, world
        )
        jacobian = self._axes.velocities(plant_jacobian)  # its columns for the axes, shape (6, n)
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _DAMPING, error)
        return np.asarray(offset + step)


keep_former_attributes(PressingTool, joints="next_offsets")


# Stages of the motor protection, as its output `stage` gives them.
_WATCHES = 0.0
_WARNS = 1.0
_GIVES_WAY = 2.0
_STOPPED = 3.0


class MotorProtection(LoopSection):
    """Make an axis give way if its motor is overloaded or too warm, then stop the robot where it is.

    The loop watches the torques of the servos. It can also watch the force at a sensor (`reads: {force: <sensor>}`),
    which stops the robot without giving way first, once it has lasted for `hold`. It acts after all other loops of its
    robot, whatever their priorities.
    """

    uppermost: ClassVar[bool] = True

    label: ClassVar[str] = message("parts.loop_motor_protection", "motor protection")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_heat", "Motor heat"),
        message("parts.stage_stage_of_protection", "Stage\nwatch, give way, stop"),
        message("parts.stage_joint_offsets", "Joint offsets"),
    )

    kind: Literal["motor_protection"]
    limit: AxisValues | None = None
    """Torque above which an axis gives way, per axis [N·m or N]; less than the servo's own limit."""
    nominal: AxisValues | None = None
    """Torque that its motor may give forever [N·m or N], at most the limit. A motor that is too warm gives no more."""
    thermal_time: Positive = 30.0
    """Time constant of a motor's heat [s]."""
    warn: Annotated[float, Field(gt=0, lt=1)] = 0.8
    """Heat of a motor from which the loop warns; 1 is too warm."""
    hold: NotNegative = 0.1
    """Time for which a torque, or the force, must be above its limit [s]."""
    patience: NotNegative = 0.5
    """Time for which an axis gives way before the robot stops [s]."""
    return_deg: Positive = 20.0
    """Speed at which an axis returns once it can [deg/s, or m/s for a prismatic axis]."""
    force: Positive | str | None = None
    """Force that stops the robot [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""
    then: Literal["hold", "end"] = "hold"
    """Action when the robot stops: hold the posture of that moment, or end the run."""
    reset_after: Positive | None = None
    """Time without overload after which the robot moves on [s]; if it is left out, the robot stays stopped."""

    def check(self, key: str, station: StationContents) -> None:
        """Check, in addition to the base class, that the loop has something to watch, and that its limits fit servos.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the section has a weight, nothing to watch, or a limit that does not fit, or a check of the
                base class fails.
        """
        super().check(key, station)
        robot = station.robot(self.robot, key)
        if self.weight is not None:
            raise Unsuitable(
                f"{key}.weight",
                message("parts.protection_unweighted", "motor protection always acts in full"),
            )
        limit, nominal = self._limits(key, robot)
        if self.force is None and not np.isfinite([limit, nominal]).any():
            raise Unsuitable(
                key,
                message(
                    "parts.nothing_to_watch",
                    "it has neither a limit nor a nominal torque nor a force to watch",
                ),
                message("parts.one_to_watch", "give at least one of limit, nominal and force"),
            )
        for axis in range(len(robot.axes)):
            self._check_axis(key, robot, axis, limit=limit[axis], nominal=nominal[axis])
        if self.force is not None:
            check_force_is_read(self, key)
            force_limit(self.force)  # raises an error if the region of the body is unknown

    def _check_axis(
        self, key: str, robot: ResolvedRobot, axis: int, *, limit: float, nominal: float
    ) -> None:
        """Check that the limits of an axis fit its servo.

        Args:
            key: key of the section, for errors.
            robot: robot of the loop.
            axis: index of the axis.
            limit: torque limit of the axis [N·m or N]; infinite if there is none.
            nominal: torque that its motor may give forever [N·m or N]; infinite if it is not watched.

        Raises:
            InvalidParameter: a limit is not positive, ``limit`` is not less than the limit of the servo, ``nominal`` is
                larger than ``limit``, or the axis has one of both and its servo kp = 0.
        """
        name = robot.axes[axis]
        unit = robot.model.units[axis].effort
        servo_limit = robot.gains.torque_limit[axis]
        limit_key = message("parts.limit_of_axis", "{key}.limit of {name}", key=key, name=name)
        nominal_key = message(
            "parts.nominal_of_axis", "{key}.nominal of {name}", key=key, name=name
        )
        # The smaller of the two is the one that the motor meets first; infinite if neither is given.
        watched = min(limit, nominal)
        if not watched > 0:
            raise InvalidParameter(
                nominal_key if nominal < limit else limit_key,
                compound("{watched:g} {unit}", watched=watched, unit=unit),
                message("parts.positive", "positive"),
            )
        # The servo limits its torque itself, so a larger limit would never be exceeded.
        if math.isfinite(limit) and not limit < servo_limit:
            raise InvalidParameter(
                limit_key,
                compound("{limit:g} {unit}", limit=limit, unit=unit),
                message(
                    "parts.less_than_servo",
                    "less than the torque limit of the servo, {limit:g} {unit}",
                    limit=servo_limit,
                    unit=unit,
                ),
            )
        if math.isfinite(nominal) and nominal > limit:
            raise InvalidParameter(
                nominal_key,
                compound("{nominal:g} {unit}", nominal=nominal, unit=unit),
                message(
                    "parts.at_most_its_limit",
                    "at most its limit, {limit:g} {unit}",
                    limit=limit,
                    unit=unit,
                ),
            )
        # The axis gives way by an offset of its reference, (torque - limit) / kp.
        if math.isfinite(watched) and robot.gains.kp[axis] == 0:
            raise InvalidParameter(
                message("parts.kp_of_axis", "servo.kp of {name}", name=name),
                "0",
                message(
                    "parts.positive_to_give_way",
                    "positive, so that {key} can make the axis give way",
                    key=key,
                ),
            )

    def _limits(self, key: str, robot: ResolvedRobot) -> tuple[Vector, Vector]:
        """Spread the limits and the nominal torques over the axes, shape (n,) each [N·m or N].

        They are infinite for axes without one, and for passive axes, which no motor moves.

        Args:
            key: key of the section, for errors.
            robot: robot of the loop, with n axes.

        Returns:
            The limits, then the nominal torques.

        Raises:
            SimrobError: the section names an axis that the robot does not have, or lists a wrong count of values.
        """
        limit = {} if self.limit is None else self.limit
        nominal = {} if self.nominal is None else self.nominal
        limits = robot.model.axis_vector(limit, f"{key}.limit", math.inf)
        nominals = robot.model.axis_vector(nominal, f"{key}.nominal", math.inf)
        passive = robot.gains.passive
        return np.where(passive, math.inf, limits), np.where(passive, math.inf, nominals)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""
        limit, nominal = self._limits(key, robot)
        # Servos without an integral part sag by torque / kp. An integral part removes the sag.
        is_sagging = (robot.gains.ki == 0) & (robot.gains.kp > 0)
        # NumPy divides in both branches below, so an axis without sag gets 1 instead of 0.
        kp = np.where(is_sagging, robot.gains.kp, 1.0)
        compliance = np.where(is_sagging, 1 / kp, 0.0)
        # On a floating robot, the torques against the weight depend on the forces at its feet, which are not known.
        arm_weight = (
            None if robot.floats else _ArmWeight(site.plant.plant, robot.axis_map, compliance)
        )
        return GuardedMotors(
            self,
            limit=limit,
            nominal=nominal,
            stiffness=robot.gains.kp,
            # The units are factors from deg to rad for axes that turn, and 1 for axes that slide.
            return_speed=robot.model.user_units * self.return_deg,
            names=robot.axes,
            units=robot.model.effort_units,
            arm_weight=arm_weight,
        )


class _ArmWeight:
    """Compensates the sag of an arm on a fixed base under its weight, when the reference is set to a posture."""

    def __init__(self, plant: MultibodyPlant, axes: AxisMap, compliance: Vector) -> None:
        """Prepare the computation.

        Args:
            plant: the finalized plant.
            axes: the robot's axes in the plant.
            compliance: sag of each axis for a torque, shape (n,) [rad/(N·m)]; 0 for an axis whose servo does not sag.
        """
        self._plant = weakref.proxy(plant)
        self._axes = axes
        self._compliance = compliance
        self._scratch = plant.CreateDefaultContext()

    def compensation(self, position: Vector) -> Vector:
        """Compute the offset of the reference, shape (n,) [rad], with which the axes stay at a position (n,) [rad]."""
        # At rest: without velocities, gravity alone loads the joints.
        self._axes.set_positions(self._plant, self._scratch, position)
        # Torques against the weight. The servos give them at a distance of torque / kp from the reference.
        weight = -self._axes.efforts(self._plant.CalcGravityGeneralizedForces(self._scratch))
        return np.asarray(weight * self._compliance)


class GuardedMotors(SampledBlock):
    r"""Watch the torques of servos; give way if a motor is overloaded, then stop (the thesis, p. 60).

    The heat :math:`\theta` of a motor follows its torque by a first-order model. It approaches 1 at the torque
    :math:`\tau_n` that the motor may give forever:

    .. math:: T_{th} \dot\theta = (\tau / \tau_n)^2 - \theta, \qquad
        \theta \leftarrow \theta + (1 - e^{-T / T_{th}}) \bigl((\tau / \tau_n)^2 - \theta\bigr) .

    An axis gives way by an offset x of its reference, such that the torque of its servo falls to the limit L. The
    offset returns to 0 as far as the limit permits:

    .. math:: x \leftarrow x + \mathrm{clip}(-x, (-L - \tau)/k_p, (L - \tau)/k_p) .

    Ports:
        in  ``torque`` (n) [N·m] of the servos; ``position`` (n) [rad]; ``asked`` (n) [rad]: the reference; ``force``
        (3) [N] if the force has a limit.
        out ``offset`` (n) [rad]: x; ``target`` (n) [rad]: the posture that is held while ``active`` (1) is 1, after
        the robot has stopped; ``heat`` (n): 1 is too warm; ``stage`` (1): 0 watches, 1 warns, 2 gives way, 3 stopped.
    """

    def __init__(
        self,
        section: MotorProtection,
        *,
        limit: Vector,
        nominal: Vector,
        stiffness: Vector,
        return_speed: Vector,
        names: Sequence[str],
        units: Sequence[str],
        arm_weight: _ArmWeight | None = None,
    ) -> None:
        """Create the block for n axes.

        Args:
            section: section of the loop.
            limit: torque limit L of each axis, shape (n,) [N·m]; infinite for an axis without one.
            nominal: torque that each motor may give forever, shape (n,) [N·m]; infinite if its heat is not watched.
            stiffness: gain kp of the servos, shape (n,) [N·m/rad].
            return_speed: speed at which each axis returns after it has given way, shape (n,) [rad/s].
            names: names of the n axes, for messages.
            units: units of their torques, for messages.
            arm_weight: compensation of the arm's weight when the robot stops. If it is None, the axes may sag then.
        """
        size = len(limit)
        period = 1 / section.rate
        self.units = {"offset": "rad", "target": "rad"}
        self._section = section
        self._limit = limit
        self._nominal = nominal
        self._stiffness = stiffness
        self._heat_share = -math.expm1(-period / section.thermal_time)  # 1 - exp(-T / T_th)
        self._largest_return = period * return_speed  # in one sample [rad]
        self._force_limit = None if section.force is None else force_limit(section.force)
        self._names = names
        self._units = units
        self._arm_weight = arm_weight

        zeros = np.zeros(size)
        zero = np.zeros(1)
        outputs = {"offset": zeros, "target": zeros, "active": zero, "heat": zeros, "stage": zero}
        timers = {
            "above": zeros,  # time for which each torque is above its limit [s]
            "pressed": zero,  # time for which the force is above its limit [s]
            # Before the stop: time for which an axis is held at its limit. After the stop: time for which nothing is
            # overloaded [s].
            "lasts": zero,
        }
        reads = {"torque": size, "position": size, ASKED: size}
        if self._force_limit is not None:
            reads["force"] = 3
        super().__init__(
            period=period, reads=reads, memory={**outputs, **timers}, gives=list(outputs)
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the heat of the motors at this sample, and give way or stop if needed.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.

        Raises:
            RunEnds: the robot has to stop, and the section ends the run then.
        """
        section = self._section
        torque = read["torque"]
        # Heat and timers are kept in every stage: also a robot that has stopped cools down.
        last_heat = memory["heat"]
        # One period of T_th d(theta)/dt = (tau / tau_n)^2 - theta, exact for a constant torque. With tau_n infinite the
        # heat stays 0.
        heat = last_heat + self._heat_share * ((torque / self._nominal) ** 2 - last_heat)
        # The product is the time so far, or 0 for an axis whose torque is within its limit.
        above = (memory["above"] + self.period) * (abs(torque) > self._limit)
        changes: dict[str, Vector | float] = {"heat": heat, "above": above}
        pressed = 0.0
        if self._force_limit is not None:
            if math.hypot(*read["force"]) > self._force_limit:
                pressed = memory["pressed"][0] + self.period
            changes["pressed"] = pressed

        longest_above = float(above.max())
        largest_heat = float(heat.max())
        stage = memory["stage"][0]
        if stage == _STOPPED:
            # No torque or force may be above its limit, and motors must be cool enough not to warn, so that the robot
            # does not stop again soon.
            is_well = longest_above == pressed == 0 and largest_heat < section.warn
            return {**changes, **self._stay_stopped(memory, read, is_well=is_well)}
        # The force stops the robot whatever its motors do: axes give way to torques alone.
        if pressed > section.hold:
            reason = message(
                "parts.force_lasted",
                "the force was above {force:g} N for {pressed:g} s",
                force=self._force_limit,
                pressed=pressed,
            )
            return {**changes, **self._stop(read["position"], reason)}
        is_overloaded = longest_above > section.hold or largest_heat >= 1
        if stage == _GIVES_WAY or is_overloaded:
            return {**changes, **self._give_way(memory, read, heat)}
        return {**changes, "stage": _WARNS if largest_heat >= section.warn else _WATCHES}

    def _give_way(self, memory: Named, read: Named, heat: Vector) -> Changes:
        """Move overloaded axes with their load, and return the others; stop if that lasts too long.

        The time counts while at least one axis is at its limit, also if it is not always the same one.

        Args:
            memory: memory before the sample.
            read: inputs of the sample.
            heat: heat of the motors at this sample, shape (n,); 1 is too warm.

        Returns:
            The new values of the memory, without heat and timers of the single axes.

        Raises:
            RunEnds: axes are at their limits for too long, and the section ends the run then.
        """
        torque = read["torque"]
        offset = memory["offset"]
        # L, shape (n,) [N·m]. A motor that is too warm only gives its nominal torque, at which it cannot get warmer.
        allowed = np.where(heat >= 1, self._nominal, self._limit)
        # x <- x + clip(-x, (-L - tau) / kp, (L - tau) / kp): the offset returns to 0, no faster than `return_deg`,
        # within the range in which the torques stay allowed.
        desired_step = np.clip(-offset, -self._largest_return, self._largest_return)
        lowest_step = (-allowed - torque) / self._stiffness
        highest_step = (allowed - torque) / self._stiffness
        step = np.clip(desired_step, lowest_step, highest_step)
        is_at_limit = step != desired_step

        lasts = memory["lasts"][0] + self.period if is_at_limit.any() else 0.0
        if lasts > self._section.patience:
            # The reason names the first of the axes at their limits.
            axis = int(np.argmax(is_at_limit))
            hot = (
                message("parts.too_warm", ", since its motor is too warm")
                if heat[axis] >= 1
                else ""
            )
            reason = message(
                "parts.torque_held",
                "{axis} was held at {allowed:g} {unit} for {lasts:g} s{hot}",
                axis=self._names[axis],
                allowed=allowed[axis],
                unit=self._units[axis],
                lasts=lasts,
                hot=hot,
            )
            return self._stop(read["position"], reason)
        new_offset = offset + step
        gives_way = new_offset.any() or is_at_limit.any()
        return {
            "offset": new_offset,
            "lasts": lasts,
            "stage": _GIVES_WAY if gives_way else _WATCHES,
        }

    def _stop(self, position: Vector, reason: str) -> Changes:
        """Stop the robot: hold its posture from now on, or end the run, whichever the section says.

        Returns the new values of the memory if the posture is held.

        Args:
            position: measured positions of the axes, shape (n,) [rad].
            reason: reason for the end of the run. It is not used if the posture is held.

        Raises:
            RunEnds: the section ends the run.
        """
        if self._section.then == "end":
            raise RunEnds(reason)
        target = position
        if self._arm_weight is not None:
            # At the position itself as reference, the arm would sag away from it.
            target = position + self._arm_weight.compensation(position)
        # In the new stage, `lasts` is the time for which nothing is overloaded.
        return {"target": target, "active": 1.0, "stage": _STOPPED, "lasts": 0.0}

    def _stay_stopped(self, memory: Named, read: Named, *, is_well: bool) -> Changes:
        """Hold the position, until nothing is overloaded for long enough. Then the axes return as after giving way.

        Args:
            memory: memory before the sample.
            read: inputs of the block.
            is_well: whether nothing is overloaded at this sample, and no motor is so warm that the loop would warn.

        Returns:
            The new values of the memory. Without ``reset_after`` in the section, the robot stays stopped.
        """
        lasts = memory["lasts"][0] + self.period if is_well else 0.0
        if self._section.reset_after is None or lasts < self._section.reset_after:
            return {"lasts": lasts}
        # At first the offset keeps the present target, so that the robot does not jump to its reference.
        return {
            "active": 0.0,
            "stage": _GIVES_WAY,
            "lasts": 0.0,
            "offset": memory["target"] - read[ASKED],
        }
