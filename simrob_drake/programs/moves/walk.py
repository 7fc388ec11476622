"""Gaits that are planned before they begin: steps (SimRob's Marcha), postures in a row, a stand on three legs."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import perform, planned_gait, taught_arms
from simrob_drake.programs.moves.move import MOST_AMPLITUDE, MOST_STEPS, Move, Outlook, Stage, naming
from simrob_drake.results.result import SimulationResult
from simrob_drake.sections import Number
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve


class GaitMove(Move):
    """A gait of a robot with legs; keys beside its own are parameters of the gait in place of the gait's own."""

    model_config = ConfigDict(extra="allow")
    of_arms: ClassVar[bool] = False

    @abstractmethod
    def planned(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Return the motion, planned for a station."""

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Plan it, and return the stage that runs it; it is planned anew where it depends on what was done before."""
        plans, arms = [self.planned(robot, outlook.station)], taught_arms(robot)  # nobody keeps a plan while it runs
        if outlook.changed or resolve(outlook.station).ground.incline:
            plans.clear()

        def go(robot: LeggedGeometry) -> SimulationResult:
            if taught_arms(robot) != arms:
                plans.clear()
            return replace(perform(robot, plans.pop() if plans else anew(robot)), did=self.caption())

        def anew(robot: LeggedGeometry) -> JointMotion:
            with naming(name):
                return self.planned(robot, robot.cell.config)

        return go


class WalkMove(GaitMove):
    """Steps by a gait."""

    key: ClassVar[str] = "walk"
    title: ClassVar[str] = "Walk"
    form: ClassVar[Mapping[str, str | float | None]] = {"steps": 4, "amplitude": None, "gait": "gaits"}

    steps: Annotated[int, Field(strict=True, ge=-MOST_STEPS, le=MOST_STEPS)]
    """How many step lengths ahead; the gait's `ramp_steps` come in addition. Legs in turn for a crawl."""
    amplitude: Annotated[Number, Field(ge=-MOST_AMPLITUDE, le=MOST_AMPLITUDE)] = 1.0
    """Scales them."""
    gait: str | None = None
    """One of the robot's gaits that go steps; the first for its feet unless given."""

    def planned(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Return the motion, planned for a station."""
        changes = self.model_extra or {}
        return planned_gait(robot, self.gait, changes, steps=self.steps, amplitude=self.amplitude, station=station)


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
