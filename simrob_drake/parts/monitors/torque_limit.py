"""A servo that stays at its torque limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made, MonitorSection, of_robot
from simrob_drake.parts.site import Site
from simrob_drake.quantities import NotNegative
from simrob_drake.robots.units import REVOLUTE, AxisUnit

_AT_LIMIT = 1e-6
"""Part of a torque limit that may be missing where a servo counts as saturated."""


class TorqueLimit(MonitorSection):
    """End the run when a servo stays at its torque limit."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """How long it must stay there [s]."""

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        robot = self.watched_robot(name, site)
        limit, units = robot.gains.torque_limit, robot.model.units
        return of_robot(TorqueLimitMonitor(axes=robot.axes, limit=limit, units=units, **self.times), robot)


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
        self.watch(torque=len(axes))

    def excess(self, *values: Vector) -> float:
        """Return the largest part of a limit in use, minus one."""
        return largest(self._use(*values))[1] - 1 + _AT_LIMIT

    def why(self, *values: Vector) -> str:
        """Name the joint, its limit and how long it was there."""
        index, _ = largest(self._use(*values))
        limit = f"{self._limit[index]:g} {self._units[index].effort}"
        return f"{self._axes[index]} stayed at its torque limit of {limit} for {self.hold:g} s"

    def _use(self, torque: Vector) -> Vector:
        return np.asarray(np.abs(torque) / self._limit)
