"""A tool, or a free piece, that leaves a box."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import PoseMonitorSection, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Triple

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

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far outside the origin of the pose is [m]."""
        who, watched, _ = self.watched_pose(name, station, f"tcp_pose.{self.tool}" if self.tool else "tcp_pose")

        def overshoots(pose: Vector) -> Vector:
            return np.concatenate([pose[:3] - self.upper, self.lower - pose[:3]])

        def why(index: int, _: float) -> str:
            axis = index % len(_AXES)
            side, bound = ("above", self.upper[axis]) if index < len(_AXES) else ("below", self.lower[axis])
            return f"{who} left its workspace: {_AXES[axis]} {side} {bound:g} m"

        return worst(watched, overshoots, why)
