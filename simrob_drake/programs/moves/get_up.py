"""A robot that has fallen gets up where it lies."""

from dataclasses import replace
from typing import ClassVar

from simrob_drake.base.errors import SimrobError
from simrob_drake.blocks.references import hold
from simrob_drake.parts.controllers.get_up import STANDS, Attempts, GetUp
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.programs.gaits.motion import monitors_without_fall, short_steps
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import Move, Outlook, Stage
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import check_parts, resolve

_LONGEST = 30.0  # that an attempt takes, with all that is waited for [s]


class GetUpMove(Move):
    """Get up from the belly or the back, by the postures under `get_up` in the robot's `gaits.yaml`.

    It ends when the robot has stood for a second, at once where it has not fallen.
    """

    key: ClassVar[str] = "get_up"
    says: ClassVar[str] = "get up"
    of_arms: ClassVar[bool] = False

    attempts: Attempts = 5
    """How often it tries."""

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Find the keys; None for a robot without postures to get up by, or on a kinematic station."""
        try:
            cls().station(config, robot)
        except SimrobError:
            return None
        return frozenset(cls.model_fields)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can, and return the stage in which it does."""
        self.station(outlook.station, robot.name)
        outlook.changed = True
        return self._got_up

    def station(self, config: StationConfig, robot: str) -> StationConfig:
        """Return a station in which a robot gets up, without its other loops and what watches for its fall.

        Raises SimrobError: a robot that cannot, or does not stand on feet of its own; a station that is kinematic.
        """

        def rests(one: object) -> bool:
            return isinstance(one, LoopSection) and (one.robot or config.only_robot) == robot and not one.uppermost

        others = {name: one for name, one in config.controllers.items() if not rests(one)}
        section = GetUp(kind="get_up", robot=robot, attempts=self.attempts, ends=True)
        changes = {"controllers": {**others, self.key: section}, "monitors": monitors_without_fall(config, robot)}
        changed = config.model_copy(update={**changes, "solver": short_steps(config.solver)})
        check_parts(resolve(changed))
        return changed

    def _got_up(self, robot: LeggedGeometry) -> SimulationResult:
        """Let a robot get up, and return the run."""
        station, held = self.station(robot.cell.config, robot.name), {robot.name: hold(robot.reference)}
        result = robot.cell.follow_as(station, held, self.attempts * _LONGEST, forget=self.key)
        if STANDS in result.message:
            result = replace(result, ending="completed", stopped_by=None)
        return replace(result, did=self.caption())
