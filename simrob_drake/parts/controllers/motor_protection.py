r"""A loop that gives way, and then stops, when a motor is loaded too much or for too long (the thesis, p. 60).

How warm a motor is follows from its torque by a first-order model, with the torque :math:`\tau_n` that it may give
forever; 1 is as warm as that makes it:

.. math:: T_{th} \dot\theta = (\tau / \tau_n)^2 - \theta, \qquad
    \theta \leftarrow \theta + (1 - e^{-T / T_{th}}) \bigl((\tau / \tau_n)^2 - \theta\bigr) .

To give way is to move the reference of an axis by x so that the torque of its servo falls to the limit L, and back as
far as that lets it: :math:`x \leftarrow x + \mathrm{clip}(-x, (-L - \tau)/k_p, (L - \tau)/k_p)`.
"""

import math
import weakref
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.loop import LoopSection, check_force_is_read
from simrob_drake.parts.monitors.places import force_limit
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot, Surroundings
from simrob_drake.robots.axis_map import AxisMap, AxisValues
from simrob_drake.sections import NotNegative, Positive

_GUARDS, _WARNS, _GIVES_WAY, _STOPPED = 0.0, 1.0, 2.0, 3.0


class MotorProtection(LoopSection):
    """Give way where a motor is loaded too much or gets too warm, then stop the robot where it is.

    It watches the torques of the servos, and perhaps the force at a sensor (`reads: {force: <sensor>}`), which stops it
    without giving way first. It lies above all other loops of its robot, whatever their priorities.
    """

    uppermost: ClassVar[bool] = True

    stages: ClassVar[tuple[str, ...]] = ("Heat of the motors", "Stage\nwatch, give way, stop", "Offsets of the joints")

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
            raise InvalidParameter(f"{key}.weight", self.weight, "left out: what protects must show whole")
        limit, nominal = self._limits(key, robot)
        if self.force is None and not np.isfinite([limit, nominal]).any():
            raise InvalidParameter(key, "without a limit, a nominal torque and a force", "given one of them to watch")
        for axis, name in enumerate(robot.axes):
            unit, servo, watched = robot.model.units[axis].effort, robot.gains, min(limit[axis], nominal[axis])
            if not watched > 0:
                raise InvalidParameter(f"{key}, of {name},", f"{watched:g} {unit}", "positive")
            if math.isfinite(limit[axis]) and not limit[axis] < servo.torque_limit[axis]:
                expected = f"less than the servo gives at most, {servo.torque_limit[axis]:g} {unit}: it is never above"
                raise InvalidParameter(f"{key}.limit of {name}", f"{limit[axis]:g} {unit}", expected)
            if math.isfinite(nominal[axis]) and nominal[axis] > limit[axis]:
                expected = f"at most its limit, {limit[axis]:g} {unit}"
                raise InvalidParameter(f"{key}.nominal of {name}", f"{nominal[axis]:g} {unit}", expected)
            if math.isfinite(watched) and servo.kp[axis] == 0:
                raise InvalidParameter(f"servo.kp of {name}", "0", f"positive, so that {key} can make it give way")
        if self.force is not None:
            check_force_is_read(self, key)
            force_limit(self.force)

    def _limits(self, key: str, robot: ResolvedRobot) -> tuple[Vector, Vector]:
        """Return the limits and the nominal torques, shape (n,); infinite where there are none."""
        limit, nominal = ({} if values is None else values for values in (self.limit, self.nominal))
        spread = robot.model.axis_vector
        return spread(limit, f"{key}.limit", math.inf), spread(nominal, f"{key}.nominal", math.inf)

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
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
    """Watch the torques of servos; give way, then stop.

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
        """Make the block.

        Args:
            section: its parameters.
            limit: L of each axis, shape (n,) [N·m]; infinite for none.
            nominal: torque that each may give forever, likewise.
            stiffness: kp of the servos, shape (n,) [N·m/rad].
            fastest: how fast each axis comes back, shape (n,) [rad/s].
            names: of the axes, for the reason of an end.
            units: of their torques, likewise.
            held_by: a finalized plant, the axes in it and how far each sags [rad/(N·m)], shape (n,): then an axis is
                held by a reference that is above it by what it will sag under its weight.
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
            return {**known, **self._stop(read["position"], f"the force was above {self._force:g} N for {pressed:g} s")}
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
            hot = " for it is too warm" if heat[which] >= 1 else ""
            why = f"{self._names[which]} was held at {allowed[which]:g} {self._units[which]} for {lasts:g} s{hot}"
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
