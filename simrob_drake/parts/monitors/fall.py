"""A robot, or a free piece, that falls."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import model_validator
from pydrake.math import RotationMatrix

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.parts.monitors.monitor import Made
from simrob_drake.parts.monitors.of_poses import PoseMonitorSection
from simrob_drake.parts.site import Site
from simrob_drake.quantities import Positive


class Fall(PoseMonitorSection):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _some_bound(self) -> Fall:
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall needs a bound: height or tilt_deg")
        return self

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        who, output, start = self.watched_pose(name, site, "base_pose")
        tilt = None if self.tilt_deg is None else float(np.deg2rad(self.tilt_deg))
        monitor = FallMonitor(name=who, upright=start.rotation(), height=self.height, tilt=tilt, **self.times)
        return monitor, {"pose": output}


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
        self.watch(pose=len(XYZ_QUATERNION_NAMES))

    def excess(self, *values: Vector) -> float:
        """Return the larger part of a bound by which it is exceeded."""
        parts = self._parts(*values)
        return max(parts) if all(map(math.isfinite, parts)) else math.inf

    def why(self, *values: Vector) -> str:
        """Say how it fell."""
        low, leaning = self._parts(*values)
        if not (math.isfinite(low) and math.isfinite(leaning)):
            return f"{self._name} is nowhere"
        if self._tilt is None or low >= leaning:
            return f"{self._name} fell: its height is below {self._height:g} m"
        return f"{self._name} fell: it leans by more than {np.rad2deg(self._tilt):g} deg"

    def _parts(self, pose: Vector) -> tuple[float, float]:
        """Return the parts by which height and tilt exceed their bounds, -1 for a bound that is not given.

        Plain numbers, because a run asks after every step.
        """
        _, _, z, qw, qx, qy, qz = pose.tolist()
        to_x, to_y, to_z = self._up
        upward = 2 * (qx * qz - qw * qy) * to_x + 2 * (qy * qz + qw * qx) * to_y + (1 - 2 * (qx * qx + qy * qy)) * to_z
        low = -1.0 if self._height is None else float(1 - z / self._height)
        tilt = math.acos(min(max(upward, -1.0), 1.0)) if math.isfinite(upward) else upward
        return low, -1.0 if self._tilt is None else float(tilt / self._tilt - 1)
