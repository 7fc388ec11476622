"""Go to one posture at constant speed."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import ramp
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ToOnePosture
from simrob_drake.sections import NotNegative


class Ramp(ToOnePosture):
    """Go to a posture at constant speed, as SimRob's interpolated moves do, and stay there."""

    kind: Literal["ramp"]
    blend: NotNegative = 0.0
    """How long the speed grows at the start, and falls at the end [s]; at once unless given."""

    @model_validator(mode="after")
    def _blends_apart(self) -> Ramp:
        if self.blend and not self.blend < self.duration / 2:
            raise ValueError(f"blend, {self.blend:g} s, must be less than half of the duration, {self.duration:g} s")
        return self

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        return ramp(start, target, duration=self.duration, start_time=self.start, blend=self.blend)
