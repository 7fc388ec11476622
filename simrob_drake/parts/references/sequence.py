"""Go through postures."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydrake.trajectories import Trajectory

from simrob_drake.arguments import SHORTEST
from simrob_drake.blocks.references import sequence
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ReferenceSection, si_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Duration, Strict


class Waypoint(Strict):
    """A posture and the time to be there."""

    time: Duration
    """When to be there [s]."""
    target_deg: AxisValues
    """Posture, per axis; a mapping leaves the other axes where they were."""


class Sequence(ReferenceSection):
    """Go through postures, resting at each, with continuous acceleration."""

    kind: Literal["sequence"]
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures and their times, which rise."""

    @model_validator(mode="after")
    def _sorted(self) -> Sequence:
        times = [target.time for target in self.targets]
        if any(later - earlier < SHORTEST for earlier, later in pairwise(times)):
            raise ValueError(f"the times of a sequence rise from target to target, by {SHORTEST:g} s or more")
        return self

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Return the targets."""
        return {f"targets at {target.time:g} s": target.target_deg for target in self.targets}

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        postures = [start]
        for waypoint in self.targets:
            postures.append(si_positions(waypoint.target_deg, robot, postures[-1]))
        return sequence(start, [waypoint.time for waypoint in self.targets], postures[1:])

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        return f"sequence of {len(self.targets)} postures in {self.targets[-1].time:g} s"
