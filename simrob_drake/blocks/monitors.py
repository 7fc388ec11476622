"""The monitors of a station: joint limit, torque limit, standstill and divergence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.robots.units import REVOLUTE, AxisUnit

_AT_LIMIT = 1e-6
"""Part of a torque limit that may be missing where a servo counts as saturated."""


class JointLimitMonitor(Monitor):
    """End the run when a joint reaches a limit of its range.

    Ports:
        in  ``position`` (n): measured joint positions [rad or m].
        out ``excess`` (1): largest overshoot of a limit [rad or m].
    """

    def __init__(
        self,
        *,
        axes: Sequence[str],
        lower: Vector,
        upper: Vector,
        margin: float | Vector = 0.0,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Watch ``axes``, all of which turn unless ``units`` says so, from ``margin`` before their limits (n,)."""
        super().__init__(hold=hold, after=after)
        self._units = list(units) or [REVOLUTE] * len(axes)
        self._axes, self._lower, self._upper = list(axes), lower + margin, upper - margin
        self._position = self.watch("position", len(axes))

    def excess(self, context: Context) -> float:
        """Return the largest overshoot [rad or m]."""
        return largest(self._overshoot(context))[1]

    def why(self, context: Context) -> str:
        """Name the joint and its limit."""
        index, _ = largest(self._overshoot(context))
        axis, side = self._axes[index % len(self._axes)], "upper" if index < len(self._axes) else "lower"
        limit = (self._upper if side == "upper" else self._lower)[index % len(self._axes)]
        return f"{axis} reached its {side} limit of {self._units[index % len(self._axes)].told(limit)}"

    def _overshoot(self, context: Context) -> Vector:
        position = self._position.Eval(context)
        return np.concatenate([position - self._upper, self._lower - position])


class TorqueLimitMonitor(Monitor):
    """End the run when a servo has been at its torque limit for too long.

    Ports:
        in  ``torque`` (n): torques after saturation [N·m or N].
        out ``excess`` (1): largest part of a limit that is used, minus one.
    """

    def __init__(
        self,
        *,
        axes: Sequence[str],
        limit: Vector,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.5,
        after: float = 0.0,
    ) -> None:
        """Watch ``axes``, all of which turn unless ``units`` says so, with torque limits (n,), for ``hold`` [s]."""
        super().__init__(hold=hold, after=after)
        if not (limit > 0).all():
            raise InvalidParameter("limit", limit, "positive [N·m or N]")
        self._axes, self._limit, self._units = list(axes), limit, list(units) or [REVOLUTE] * len(axes)
        self._torque = self.watch("torque", len(axes))

    def excess(self, context: Context) -> float:
        """Return the largest part of a limit in use, minus one."""
        return largest(self._use(context))[1] - 1 + _AT_LIMIT

    def why(self, context: Context) -> str:
        """Name the joint, its limit and how long it was there."""
        index, _ = largest(self._use(context))
        limit = f"{self._limit[index]:g} {self._units[index].effort}"
        return f"{self._axes[index]} stayed at its torque limit of {limit} for {self.hold:g} s"

    def _use(self, context: Context) -> Vector:
        return np.asarray(np.abs(self._torque.Eval(context)) / self._limit)


class SettledMonitor(Monitor):
    """End the run when the robot stands still, and near its reference if that is asked.

    Ports:
        in  ``velocity`` (n): joint velocities [rad/s or m/s].
        in  ``position`` (n), ``reference`` (n): where a largest error is given [rad or m].
        out ``excess`` (1): how far below the bounds the worst joint is, as a part of them.
    """

    def __init__(
        self,
        *,
        size: int,
        speed: float | Vector,
        error: float | Vector | None = None,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.2,
        after: float = 0.0,
    ) -> None:
        """Watch ``size`` joints, all of which turn unless ``units`` says so.

        Args:
            size: n.
            speed: below which a joint stands, for all or each of them [rad/s or m/s].
            error: largest distance from the reference, for all or each of them [rad or m].
            units: of the joints.
            hold: how long the condition must last [s].
            after: when watching begins [s].
        """
        super().__init__(hold=hold, after=after)
        for name, value in (("speed", speed), ("error", error)):
            if value is not None and not np.all(np.greater(value, 0)):
                raise InvalidParameter(name, value, "positive")
        self._speed, self._error = np.broadcast_to(speed, size), error
        self._units = list(units) or [REVOLUTE] * size
        self._velocity = self.watch("velocity", size)
        if error is not None:
            self._position, self._reference = self.watch("position", size), self.watch("reference", size)

    def excess(self, context: Context) -> float:
        """Return one minus the worst use of a bound."""
        use = float((np.abs(self._velocity.Eval(context)) / self._speed).max())
        if self._error is not None:
            error = self._reference.Eval(context) - self._position.Eval(context)
            use = max(use, float((np.abs(error) / self._error).max()))
        return 1 - use

    def why(self, context: Context) -> str:
        """Say since when the robot stands."""
        bounds = zip(self._speed, self._units, strict=True)
        told = dict.fromkeys(f"{speed / unit.size:g} {unit.name}/s" for speed, unit in bounds)
        return f"the robot has stood still (below {' and '.join(told)}) for {self.hold:g} s"


class DivergenceMonitor(Monitor):
    """End the run when a joint runs away, or when a value is no number any more.

    Ports:
        in  ``velocity`` (n): joint velocities [rad/s or m/s].
        out ``excess`` (1): the largest speed over the bound.
    """

    def __init__(
        self,
        *,
        axes: Sequence[str],
        speed_limit: float,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Watch ``axes``, all of which turn unless ``units`` says so, for speeds above a limit [rad/s or m/s]."""
        super().__init__(hold=hold, after=after)
        if not speed_limit > 0:
            raise InvalidParameter("speed_limit", speed_limit, "positive [rad/s or m/s]")
        self._axes, self._limit, self._units = list(axes), speed_limit, list(units) or [REVOLUTE] * len(axes)
        self._velocity = self.watch("velocity", len(axes))

    def excess(self, context: Context) -> float:
        """Return the largest speed over the bound [rad/s or m/s]."""
        return largest(np.abs(self._velocity.Eval(context)))[1] - self._limit

    def why(self, context: Context) -> str:
        """Name the joint and its speed."""
        index, speed = largest(np.abs(self._velocity.Eval(context)))
        unit = f"{self._units[index].si}/s"
        return f"{self._axes[index]} ran away: {speed:.4g} {unit}, above {self._limit:g} {unit}"
