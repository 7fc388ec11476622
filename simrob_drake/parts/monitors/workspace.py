"""A tool, or a free piece, that leaves a box."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import model_validator

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.parts.monitors.monitor import Made
from simrob_drake.parts.monitors.of_poses import PoseMonitorSection
from simrob_drake.parts.site import Site
from simrob_drake.quantities import Triple

_AXES = "xyz"


class Workspace(PoseMonitorSection):
    """End the run when the tool, or a free piece, leaves a box."""

    kind: Literal["workspace"]
    lower: Triple
    """Smallest x, y and z in the world [m]."""
    upper: Triple
    """Largest x, y and z in the world [m]."""
    tool: str | None = None
    """The robot's tool that is watched; its `tcp` unless given."""

    @model_validator(mode="after")
    def _not_empty(self) -> Workspace:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower must be below upper, {list(self.upper)}")
        return self

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        who, output, _ = self.watched_pose(name, site, f"tcp_pose.{self.tool}" if self.tool else "tcp_pose")
        return WorkspaceMonitor(name=who, lower=self.lower, upper=self.upper, **self.times), {"pose": output}


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
        self.watch(pose=len(XYZ_QUATERNION_NAMES))

    def excess(self, *values: Vector) -> float:
        """Return how far outside the point is [m]."""
        return largest(self._overshoot(*values))[1]

    def why(self, *values: Vector) -> str:
        """Name the side."""
        index, _ = largest(self._overshoot(*values))
        side, bound = ("above", self._upper) if index < len(_AXES) else ("below", self._lower)
        axis = index % len(_AXES)
        return f"{self._name} left its workspace: {_AXES[axis]} {side} {bound[axis]:g} m"

    def _overshoot(self, pose: Vector) -> Vector:
        return np.concatenate([pose[:3] - self._upper, self._lower - pose[:3]])
