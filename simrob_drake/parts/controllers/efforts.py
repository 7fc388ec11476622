"""Loops that mind forces: one presses with the force that is asked for, one protects motors from too much."""

import math
import weakref
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import NotNegative, Positive, Triple
from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection, check_force_is_read
from simrob_drake.parts.monitors.sections import force_limit
from simrob_drake.parts.resolved import WORLD, ResolvedRobot, Surroundings
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import frame_of
from simrob_drake.robots.axis_map import AxisMap, AxisValues

_DAMPED = 1e-6 * np.eye(6)
"""The damping of the least squares, squared: near a singularity joints move less, elsewhere it does not show."""

_NEAR = 0.2  # how near the force must be to what is asked for, as a part of that, for the integral to act


def _unit(direction: Triple) -> Triple:
    size = float(np.linalg.norm(direction))
    if size == 0:
        raise ValueError(message("parts.zero_direction", "a direction of length zero points nowhere"))
    x, y, z = (entry / size for entry in direction)
    return x, y, z


class ForceControl(LoopSection):
    """Press with the tool: move it along a direction until a force sensor feels what is asked for.

    That is named by `reads: {force: <sensor>}`. It moves all axes of its robot; in the other directions the tool stays
    as the reference has it.
    """

    label: ClassVar[str] = message("parts.loop_force_control", "force control")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_force_error", "Error of the force"),
        message("parts.stage_law_of_path", "PI law\npath of the tool"),
        message("parts.stage_jacobian", "Jacobian\njoint offsets"),
    )

    kind: Literal["force_control"]
    force: Positive
    """With what force to press [N]."""
    direction: Annotated[Triple, AfterValidator(_unit)] = (0.0, 0.0, -1.0)
    """Where to, in the axes of the sensor's `frame`: those of the world unless that says otherwise."""
    kp: Positive = 0.003
    """How fast the tool moves for an error [m/(s·N)]."""
    ki: NotNegative = 0.003
    """How fast that speed grows [m/(s²·N)]; 0 for none."""
    approach: Positive = 0.01
    """How fast it may move while it touches nothing [m/s]."""
    speed: Positive = 0.05
    """How fast otherwise [m/s]."""
    reach: Positive = 0.05
    """How far it may be from where the reference has it [m]."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built."""
        super().check(key, station)
        check_force_is_read(self, key)
        if not station.robot(self.robot, key).tcp:
            raise InvalidParameter(
                key,
                message("parts.robot_without_tool", "for a robot without a tool"),
                message("parts.robot_that_presses", "for one that presses with a tool or a piece"),
            )

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        sensor = frame_of(site.plant, getattr(site.station.sensors.get(self.reads["force"]), "frame", WORLD))
        return PressingTool(self, site.plant.plant, robot.axis_map, robot.tools[robot.tcp], sensor)


class PressingTool(SampledBlock):
    r"""PI control of the force on a tool by moving it along a direction until a sensor feels what is asked for.

    With the error e of the force, the tool's path x along the direction d has the speed

    .. math:: \dot x = \mathrm{clip}(k_p e + z, \pm v), \qquad \dot z = k_i e, \qquad |x| \le x_{max},

    where z stands still unless the force is near what is asked for and the speed within its bound, so that it does not
    wind up on the way there; v is slower until the tool touches. A surface that comes nearer steadily, or an arm that
    sags more and more, then leaves no error. The joints' offsets follow so that the tool is displaced by x d from where
    the reference has it, and not turned, with the Jacobian J at that posture:

    .. math:: \Delta q = J^\top (J J^\top + \lambda^2)^{-1} \begin{pmatrix} \text{turn left} \\ \text{way left}
        \end{pmatrix} .

    Ports:
        in  ``force`` (3) [N]: on the tool, in the axes of the sensor; ``asked`` (n) [rad]: the reference of the joints.
        out ``offset`` (n) [rad]: to be added to it; ``pressing`` (1) [N]: against the direction; ``path`` (1) [m].
    """

    def __init__(self, section: ForceControl, plant: MultibodyPlant, axes: AxisMap, tool: Frame, sensor: Frame) -> None:
        """Make the block of a section, for axes of a finalized plant, which need not be part of the diagram.

        What is no axis stands there as at the start. Force and direction are given in the axes of the frame ``sensor``.
        """
        size, one = len(axes.signs), np.zeros(1)
        self.units = {"offset": "rad", "pressing": "N", "path": "m"}
        memory = {"offset": np.zeros(size), "pressing": one, "path": one}
        reads, outputs = {"force": 3, "asked": size}, list(memory)
        super().__init__(period=1 / section.rate, reads=reads, memory={**memory, "drift": one}, gives=outputs)
        self._plant, self._axes, self._tool, self._sensor = weakref.proxy(plant), axes, tool.index(), sensor.index()
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._rest = plant.GetPositions(self._scratch)
        self._section, self._direction = section, np.array(section.direction)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the tool and the joints are to be moved now."""
        pressing = float(-self._direction @ read["force"])
        path, drift = self.next_path(memory["path"][0], memory["drift"][0], pressing)
        offset = self.joints(memory["offset"], read["asked"], path)
        return {"pressing": pressing, "path": path, "drift": drift, "offset": offset}

    def next_path(self, path: float, drift: float, pressing: float) -> tuple[float, float]:
        """Return x [m] and z [m/s] by what they were, and by the force [N]."""
        section = self._section
        error, fastest = section.force - pressing, section.speed if pressing > 0 else section.approach
        desired = section.kp * error + drift
        speed = min(max(desired, -fastest), fastest)
        if abs(error) < _NEAR * section.force and speed == desired:
            drift += section.ki * error * self.period
        return min(max(path + speed * self.period, -section.reach), section.reach), drift

    def joints(self, offset: Vector, reference: Vector, path: float) -> Vector:
        """Return offsets (n,) [rad], from the last ones on, that put the tool ``path`` [m] beside the reference."""
        plant, context, axes = self._plant, self._scratch, self._axes
        world, tool, sensor = plant.world_frame(), plant.get_frame(self._tool), plant.get_frame(self._sensor)
        plant.SetPositions(context, axes.spread_positions(reference, self._rest))
        target = tool.CalcPoseInWorld(context)
        along = sensor.CalcRotationMatrixInWorld(context) @ self._direction
        plant.SetPositions(context, axes.spread_positions(reference + offset, self._rest))
        now = tool.CalcPoseInWorld(context)
        turn = (target.rotation() @ now.rotation().inverse()).ToAngleAxis()
        left = np.empty(6)
        left[:3] = turn.angle() * turn.axis()
        left[3:] = target.translation() + path * along - now.translation()
        jacobian = axes.velocities(
            plant.CalcJacobianSpatialVelocity(context, JacobianWrtVariable.kV, tool, np.zeros(3), world, world)
        )
        return np.asarray(offset + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _DAMPED, left))


_GUARDS, _WARNS, _GIVES_WAY, _STOPPED = 0.0, 1.0, 2.0, 3.0


class MotorProtection(LoopSection):
    """Give way where a motor is loaded too much or gets too warm, then stop the robot where it is.

    It watches the torques of the servos, and perhaps the force at a sensor (`reads: {force: <sensor>}`), which stops it
    without giving way first. It lies above all other loops of its robot, whatever their priorities.
    """

    uppermost: ClassVar[bool] = True

    label: ClassVar[str] = message("parts.loop_motor_protection", "motor protection")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_heat", "Heat of the motors"),
        message("parts.stage_stage_of_protection", "Stage\nwatch, give way, stop"),
        message("parts.stage_joint_offsets", "Offsets of the joints"),
    )

    kind: Literal["motor_protection"]
    limit: AxisValues | None = None
    """Torque above which an axis gives way, per axis [N·m or N]; less than the servo's own limit."""
    nominal: AxisValues | None = None
    """Torque that its motor may give forever [N·m or N]; not more than the limit. Too warm, it may give no more."""
    thermal_time: Positive = 30.0
    """Time constant with which a motor gets warm [s]."""
    warn: Annotated[float, Field(gt=0, lt=1)] = 0.8
    """How warm a motor is when it warns; 1 is too warm."""
    hold: NotNegative = 0.1
    """How long a torque, or the force, must be above its limit [s]."""
    patience: NotNegative = 0.5
    """How long an axis gives way before the robot stops [s]."""
    return_deg: Positive = 20.0
    """How fast an axis comes back once it can [deg/s, or m/s where it slides]."""
    force: Positive | str | None = None
    """Force that stops it [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""
    then: Literal["hold", "end"] = "hold"
    """To stop is to hold the posture of that moment, or to end the run."""
    reset_after: Positive | None = None
    """How long all must be well again before it lets go [s]; never unless given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built."""
        super().check(key, station)
        robot = station.robot(self.robot, key)
        if self.weight is not None:
            raise Unsuitable(
                f"{key}.weight", message("parts.protection_unweighted", "what protects the robot cannot be weighted")
            )
        limit, nominal = self._limits(key, robot)
        if self.force is None and not np.isfinite([limit, nominal]).any():
            raise InvalidParameter(
                key,
                message("parts.nothing_to_watch", "without a limit, a nominal torque and a force"),
                message("parts.one_to_watch", "given one of them to watch"),
            )
        for axis, name in enumerate(robot.axes):
            unit, servo, watched = robot.model.units[axis].effort, robot.gains, min(limit[axis], nominal[axis])
            if not watched > 0:
                raise InvalidParameter(
                    message("parts.key_of_axis", "{key}, of {name},", key=key, name=name),
                    compound("{watched:g} {unit}", watched=watched, unit=unit),
                    "positive",
                )
            if math.isfinite(limit[axis]) and not limit[axis] < servo.torque_limit[axis]:
                expected = message(
                    "parts.less_than_servo",
                    "less than the servo gives at most, {limit:g} {unit}: it is never above",
                    limit=servo.torque_limit[axis],
                    unit=unit,
                )
                raise InvalidParameter(
                    message("parts.limit_of_axis", "{key}.limit of {name}", key=key, name=name),
                    compound("{limit:g} {unit}", limit=limit[axis], unit=unit),
                    expected,
                )
            if math.isfinite(nominal[axis]) and nominal[axis] > limit[axis]:
                expected = message(
                    "parts.at_most_its_limit", "at most its limit, {limit:g} {unit}", limit=limit[axis], unit=unit
                )
                raise InvalidParameter(
                    message("parts.nominal_of_axis", "{key}.nominal of {name}", key=key, name=name),
                    compound("{nominal:g} {unit}", nominal=nominal[axis], unit=unit),
                    expected,
                )
            if math.isfinite(watched) and servo.kp[axis] == 0:
                raise InvalidParameter(
                    message("parts.kp_of_axis", "servo.kp of {name}", name=name),
                    "0",
                    message("parts.positive_to_give_way", "positive, so that {key} can make it give way", key=key),
                )
        if self.force is not None:
            check_force_is_read(self, key)
            force_limit(self.force)

    def _limits(self, key: str, robot: ResolvedRobot) -> tuple[Vector, Vector]:
        """Spread the limits and the nominal torques over the axes, shape (n,) each [N·m or N].

        They are infinite for axes without one, and for passive axes.
        """
        limit, nominal = ({} if values is None else values for values in (self.limit, self.nominal))
        spread = robot.model.axis_vector
        limits = spread(limit, f"{key}.limit", math.inf)
        nominals = spread(nominal, f"{key}.nominal", math.inf)
        passive = robot.gains.passive
        return np.where(passive, math.inf, limits), np.where(passive, math.inf, nominals)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        limit, nominal = self._limits(key, robot)
        sagging = (robot.gains.ki == 0) & (robot.gains.kp > 0)  # not with an integral part
        sags = np.where(sagging, 1 / np.where(sagging, robot.gains.kp, 1.0), 0.0)
        return GuardedMotors(
            self,
            limit=limit,
            nominal=nominal,
            stiffness=robot.gains.kp,
            fastest=robot.model.user_units * self.return_deg,
            names=robot.axes,
            units=robot.model.effort_units,
            held_by=None if robot.floats else (site.plant.plant, robot.axis_map, sags),
        )


class GuardedMotors(SampledBlock):
    r"""Watch the torques of servos; give way, then stop (the thesis, p. 60).

    How warm a motor is follows from its torque by a first-order model, with the torque :math:`\tau_n` that it may give
    forever; 1 is as warm as that makes it:

    .. math:: T_{th} \dot\theta = (\tau / \tau_n)^2 - \theta, \qquad
        \theta \leftarrow \theta + (1 - e^{-T / T_{th}}) \bigl((\tau / \tau_n)^2 - \theta\bigr) .

    To give way is to move the reference of an axis by x so that the torque of its servo falls to the limit L, and back
    as far as that lets it: :math:`x \leftarrow x + \mathrm{clip}(-x, (-L - \tau)/k_p, (L - \tau)/k_p)`.

    Ports:
        in  ``torque`` (n) [N·m]: of the servos; ``position`` (n) [rad]; ``asked`` (n) [rad]: the reference below; with
        a limit of force ``force`` (3) [N].
        out ``offset`` (n) [rad]: by how much an axis gives way; ``target`` (n) [rad] and ``active`` (1): the posture
        that is held once it has stopped; ``heat`` (n): 1 is too warm; ``stage`` (1): 0, 1 warns, 2 yields, 3 stopped.
    """

    def __init__(
        self,
        section: MotorProtection,
        *,
        limit: Vector,
        nominal: Vector,
        stiffness: Vector,
        fastest: Vector,
        names: Sequence[str],
        units: Sequence[str],
        held_by: tuple[MultibodyPlant, AxisMap, Vector] | None = None,
    ) -> None:
        """Make the block of a section, for axes by name, of a limit L and a nominal torque each, (n,) [N·m].

        ``stiffness`` is kp of the servos (n,) [N·m/rad], ``fastest`` how fast each axis comes back (n,) [rad/s]. With
        ``held_by``, a finalized plant, the axes in it and how far each sags [rad/(N·m)], shape (n,), an axis is held by
        a reference that is above it by what it will sag under its weight.
        """
        size, period = len(limit), 1 / section.rate
        zero, one = np.zeros(size), np.zeros(1)
        self.units = {"offset": "rad", "target": "rad"}
        self._limit, self._nominal, self._stiffness, self._section = limit, nominal, stiffness, section
        self._share, self._fastest = -math.expm1(-period / section.thermal_time), period * fastest
        self._force = force = None if section.force is None else force_limit(section.force)
        self._names, self._units = names, units
        self._held_by = None
        if held_by is not None:
            plant, axes, sags = held_by
            self._held_by = weakref.proxy(plant), plant.CreateDefaultContext(), axes, sags
        memory = {"offset": zero, "target": zero, "active": one, "heat": zero, "stage": one}
        reads = {"torque": size, "position": size, "asked": size, **({} if force is None else {"force": 3})}
        outputs = list(memory)
        memory |= {"above": zero, "pressed": one, "lasts": one}
        super().__init__(period=period, reads=reads, memory=memory, gives=outputs)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how warm the motors are now, and what is done about it."""
        torque, stage, before = read["torque"], memory["stage"][0], memory["heat"]
        heat = before + self._share * ((torque / self._nominal) ** 2 - before)
        above = (memory["above"] + self.period) * (abs(torque) > self._limit)
        known: dict[str, Vector | float] = {"heat": heat, "above": above}
        longest, warmest, pressed = float(above.max()), float(heat.max()), 0.0
        if self._force is not None:
            beyond = math.hypot(*read["force"]) > self._force
            known["pressed"] = pressed = memory["pressed"][0] + self.period if beyond else 0.0
        if stage == _STOPPED:
            well = longest == pressed == 0 and warmest < self._section.warn
            return {**known, **self._stopped(memory, read, well=well)}
        if pressed > self._section.hold:
            return {
                **known,
                **self._stop(
                    read["position"],
                    message(
                        "parts.force_lasted",
                        "the force was above {force:g} N for {pressed:g} s",
                        force=self._force,
                        pressed=pressed,
                    ),
                ),
            }
        if stage == _GIVES_WAY or longest > self._section.hold or warmest >= 1:
            return {**known, **self._give_way(memory, read, heat)}
        return {**known, "stage": _WARNS if warmest >= self._section.warn else _GUARDS}

    def _give_way(self, memory: Named, read: Named, heat: Vector) -> Changes:
        torque, offset = read["torque"], memory["offset"]
        allowed = np.where(heat >= 1, self._nominal, self._limit)
        back = np.clip(-offset, -self._fastest, self._fastest)
        room = [(side * allowed - torque) / self._stiffness for side in (-1, 1)]
        moved = np.clip(back, *room)
        bound = moved != back  # these axes are at their limit
        lasts = memory["lasts"][0] + self.period if bound.any() else 0.0
        if lasts > self._section.patience:
            which = int(np.argmax(bound))
            hot = message("parts.too_warm", " for it is too warm") if heat[which] >= 1 else ""
            why = message(
                "parts.torque_held",
                "{axis} was held at {allowed:g} {unit} for {lasts:g} s{hot}",
                axis=self._names[which],
                allowed=allowed[which],
                unit=self._units[which],
                lasts=lasts,
                hot=hot,
            )
            return self._stop(read["position"], why)
        offset = offset + moved
        return {"offset": offset, "lasts": lasts, "stage": _GIVES_WAY if offset.any() or bound.any() else _GUARDS}

    def _stop(self, position: Vector, why: str) -> Changes:
        if self._section.then == "end":
            raise RunEnds(why)
        target = position
        if self._held_by is not None:
            plant, context, axes, sags = self._held_by
            axes.set_positions(plant, context, position)
            weight = -axes.efforts(plant.CalcGravityGeneralizedForces(context))
            target = position + weight * sags
        return {"target": target, "active": 1.0, "stage": _STOPPED, "lasts": 0.0}

    def _stopped(self, memory: Named, read: Named, *, well: bool) -> Changes:
        lasts = memory["lasts"][0] + self.period if well else 0.0
        if self._section.reset_after is None or lasts < self._section.reset_after:
            return {"lasts": lasts}
        return {"active": 0.0, "stage": _GIVES_WAY, "lasts": 0.0, "offset": memory["target"] - read["asked"]}
