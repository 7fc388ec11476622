"""Postures one after the other, or a stand on three legs."""

from collections.abc import Mapping
from typing import ClassVar

from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import planned_gait
from simrob_drake.programs.moves.walk import GaitMove
from simrob_drake.stations.config import StationConfig


class ActMove(GaitMove):
    """Postures one after the other, or a stand on three legs."""

    key: ClassVar[str] = "act"
    title: ClassVar[str] = "Act"
    brief: ClassVar[bool] = True
    form: ClassVar[Mapping[str, str | float | None]] = {"name": "acts"}

    name: str
    """One of the robot's gaits that go no steps."""

    def caption(self, *, robots: bool = False) -> str:
        """Return which act."""
        return f"act {self.name}"

    def planned(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Return the motion, planned for a station."""
        return planned_gait(robot, self.name, self.model_extra or {}, station=station)
