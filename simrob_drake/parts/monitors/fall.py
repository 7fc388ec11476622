"""A robot, or a free piece, that falls."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import model_validator

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector, lean
from simrob_drake.parts.monitors.monitor import PoseMonitorSection
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Positive


class Fall(PoseMonitorSection):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin over the ground beneath, below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _some_bound(self) -> Fall:
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall needs a bound: height or tilt_deg")
        return self

    def faller(self, only_robot: str | None) -> str | None:
        """Return the robot that it watches, of a station with one robot or several; None if it watches a piece."""
        return None if self.piece is not None else self.robot or only_robot

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the larger part of a bound by which it is exceeded."""
        who, watched, start = self.watched_pose(name, station, "base_pose")
        ground = station.ground
        tilt = None if self.tilt_deg is None else math.radians(self.tilt_deg)
        up: list[float] = (start.rotation().inverse() @ np.array([0.0, 0.0, 1.0])).tolist()

        def parts(pose: Vector) -> tuple[float, float]:
            """Return the parts by which height and tilt exceed their bounds, -1 for a bound that is not given."""
            _, _, _, *quaternion = pose.tolist()
            low = -1.0 if self.height is None else 1 - ground.height(pose) / self.height
            return low, -1.0 if tilt is None else lean(up, *quaternion) / tilt - 1

        def excess(pose: Vector) -> float:
            found = parts(pose)
            return max(found) if all(map(math.isfinite, found)) else math.inf

        def why(pose: Vector) -> str:
            low, leaning = parts(pose)
            if not (math.isfinite(low) and math.isfinite(leaning)):
                return f"{who} is nowhere"
            if tilt is None or low >= leaning:
                return f"{who} fell: its height is below {self.height:g} m"
            return f"{who} fell: it leans by more than {self.tilt_deg:g} deg"

        return Condition(watched, excess, why)
