"""A robot that has fallen gets up where it lies.

A program is checked as a whole before it runs. The *outlook* is the station as it will be before a move, and the
*stage* of a move is the function that performs it later. A *loop* is a controller around the servos of a robot, such as
its balance.
"""

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

# Longest duration of one attempt, with the times in which the robot comes to rest [s].
_LONGEST = 30.0


class GetUpMove(Move):
    """Get up from the belly or the back, by the postures under `get_up` in the robot's `gaits.yaml`.

    The move ends when the robot has stood for a second. If the robot has not fallen, it ends at once.
    """

    key: ClassVar[str] = "get_up"
    says: ClassVar[str] = "get up"
    of_arms: ClassVar[bool] = False

    attempts: Attempts = 5
    """Largest count of attempts."""

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that the pendant's input form offers for this move: all of them; see :meth:`Move.possible_keys`.

        Returns None if the robot cannot get up in the station, for one of the reasons under :meth:`station`.
        """
        # Whether a robot can get up is known only by making the station: its parts check themselves.
        try:
            cls().station(config, robot)
        except SimrobError:
            return None
        return frozenset(cls.model_fields)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can get up, and return the stage in which it does.

        The outlook is marked as changed.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move.
            name: name of the move for messages. It is not used.

        Raises:
            SimrobError: see :meth:`station`.
        """
        self.station(outlook.station, robot.name)
        # Where the robot stands afterwards is not known before.
        outlook.changed = True
        return self._get_up

    def station(self, config: StationConfig, robot: str) -> StationConfig:
        """Make a copy of a station in which a robot gets up.

        A controller for getting up replaces the robot's loop controllers, except for a loop above all others, such as
        motor protection. No monitor watches for the robot's fall. A solver that holds references over a step gets
        short steps.

        Args:
            config: the station.
            robot: name of the robot.

        Raises:
            SimrobError: the robot cannot get up or does not stand on feet of its own, or the station is kinematic.
        """

        def is_replaced(section: object) -> bool:
            """Whether a section of the station's controllers is a loop of the robot, and not above all others."""
            if not isinstance(section, LoopSection) or section.uppermost:
                return False
            return (section.robot or config.only_robot) == robot

        controllers = {
            name: section
            for name, section in config.controllers.items()
            if not is_replaced(section)
        }
        # With `ends`, the controller ends the run when the robot stands.
        controllers[self.key] = GetUp(kind="get_up", robot=robot, attempts=self.attempts, ends=True)
        changes = {
            "controllers": controllers,
            "monitors": monitors_without_fall(config, robot),
            "solver": short_steps(config.solver),
        }
        changed = config.model_copy(update=changes)
        check_parts(resolve(changed))
        return changed

    def _get_up(self, robot: LeggedGeometry) -> SimulationResult:
        """Run the controller until the robot stands or its attempts are over, at most 30 s for each attempt.

        The ending of the result is `completed` if the robot stands, and also if that time is over before. If all
        attempts have failed, the ending is `monitor`, and the message says so.
        """
        station = self.station(robot.cell.config, robot.name)
        references = {robot.name: hold(robot.reference)}
        longest = self.attempts * _LONGEST
        # The controller's state is forgotten afterwards, so that the next move of this kind begins anew.
        result = robot.cell.follow_as(station, references, longest, forget=self.key)
        if STANDS in result.message:
            # The controller ends the run when the robot stands: for the move this is no early end.
            result = replace(result, ending="completed", stopped_by=None)
        return replace(result, did=self.caption())
