"""Monitors of poses: a box that is not to be left, and a fall."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from pydrake.math import RotationMatrix
from pydrake.systems.framework import Context

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector

_AXES = "xyz"


class WorkspaceMonitor(Monitor):
    """End the run when a point leaves a box.

    Ports:
        in  ``pose`` (7): x y z [m] qw qx qy qz of the point.
        out ``excess`` (1): how far outside it is [m].
    """

    def __init__(
        self, *, name: str, lower: npt.ArrayLike, upper: npt.ArrayLike, hold: float = 0.0, after: float = 0.0
    ) -> None:
        """Watch the point called ``name`` in the box from ``lower`` to ``upper``, each (3,) [m] in the world."""
        super().__init__(hold=hold, after=after)
        self._name = name
        self._lower, self._upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
        if not (self._lower < self._upper).all():
            raise InvalidParameter("lower", list(self._lower), f"below upper, {list(self._upper)} [m]")
        self._pose = self.watch("pose", len(XYZ_QUATERNION_NAMES))

    def excess(self, context: Context) -> float:
        """Return how far outside the point is [m]."""
        return largest(self._overshoot(context))[1]

    def why(self, context: Context) -> str:
        """Name the side."""
        index, _ = largest(self._overshoot(context))
        side, bound = ("above", self._upper) if index < len(_AXES) else ("below", self._lower)
        axis = index % len(_AXES)
        return f"{self._name} left its workspace: {_AXES[axis]} {side} {bound[axis]:g} m"

    def _overshoot(self, context: Context) -> Vector:
        point = self._pose.Eval(context)[:3]
        return np.concatenate([point - self._upper, self._lower - point])


class FallMonitor(Monitor):
    """End the run when a body is too low, or leans too far from how it stood at the start.

    Ports:
        in  ``pose`` (7): x y z [m] qw qx qy qz of the body.
        out ``excess`` (1): the part of a bound by which it is exceeded.
    """

    def __init__(
        self,
        *,
        name: str,
        upright: RotationMatrix,
        height: float | None = None,
        tilt: float | None = None,
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Make the block.

        Args:
            name: of the body.
            upright: its orientation when it stands.
            height: of its origin, below which it counts as fallen [m].
            tilt: angle from how it stands, from which on it counts as fallen [rad].
            hold: how long the condition must last [s].
            after: when watching begins [s].

        Raises:
            InvalidParameter: a bound that is not positive, or none at all.
        """
        super().__init__(hold=hold, after=after)
        for key, value in (("height", height), ("tilt", tilt)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InvalidParameter(key, value, "positive")
        if height is None and tilt is None:
            raise InvalidParameter("height", None, "given, or tilt: a fall needs a bound")
        self._name, self._height, self._tilt = name, height, tilt
        self._up: list[float] = (upright.inverse() @ np.array([0.0, 0.0, 1.0])).tolist()
        self._pose = self.watch("pose", len(XYZ_QUATERNION_NAMES))

    def excess(self, context: Context) -> float:
        """Return the larger part of a bound by which it is exceeded."""
        parts = self._parts(context)
        return max(parts) if all(map(math.isfinite, parts)) else math.inf

    def why(self, context: Context) -> str:
        """Say how it fell."""
        low, leaning = self._parts(context)
        if not (math.isfinite(low) and math.isfinite(leaning)):
            return f"{self._name} is nowhere"
        if self._tilt is None or low >= leaning:
            return f"{self._name} fell: its height is below {self._height:g} m"
        return f"{self._name} fell: it leans by more than {np.rad2deg(self._tilt):g} deg"

    def _parts(self, context: Context) -> tuple[float, float]:
        """Return the parts by which height and tilt exceed their bounds, -1 for a bound that is not given.

        Plain numbers, because a run asks after every step.
        """
        _, _, z, qw, qx, qy, qz = self._pose.Eval(context).tolist()
        to_x, to_y, to_z = self._up
        upward = 2 * (qx * qz - qw * qy) * to_x + 2 * (qy * qz + qw * qx) * to_y + (1 - 2 * (qx * qx + qy * qy)) * to_z
        low = -1.0 if self._height is None else float(1 - z / self._height)
        tilt = math.acos(min(max(upward, -1.0), 1.0)) if math.isfinite(upward) else upward
        return low, -1.0 if self._tilt is None else float(tilt / self._tilt - 1)
