"""A kick of a ball, which flies by the contact alone."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import ConfigDict

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Number, Positive
from simrob_drake.programs.gaits.biped import Kick
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.registry import has_gait
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.moves.move import Move, NameOf, Outlook, Stage, naming
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve


class KickMove(Move):
    """A foot that swings through a ball; keys beside these are parameters of the gait in place of the gait's own."""

    model_config = ConfigDict(extra="allow")
    key: ClassVar[str] = "kick"
    of_arms: ClassVar[bool] = False

    ball: Annotated[str | None, NameOf("pieces")] = None
    """The piece to hit in its middle, seen when the kick begins; unless given the foot swings through the air."""
    toward: tuple[Number, Number] | None = None
    """The place in the world to which the ball shall go [m]; where the robot looks unless given."""
    speed: Positive | None = None
    """Of the foot when it meets the ball [m/s]; the gait's own unless given."""
    gait: str = Kick.usual
    """One of the kicks of the robot's `gaits.yaml`."""

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Find the keys; None for a robot without the usual kick in its `gaits.yaml`."""
        return frozenset(cls.model_fields) if has_gait(model, Kick, Kick.usual) else None

    def caption(self, *, robots: bool = False) -> str:
        """Return which ball."""
        return f"kick {self.ball}" if self.ball else "kick"

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can swing its foot so, and return the stage that aims it when its turn comes."""
        self.swing(robot, outlook.station, {})
        if self.ball is not None:
            self._radius(outlook.station)

        def go(robot: LeggedGeometry) -> SimulationResult:
            with naming(name):
                motion = self.swing(robot, robot.cell.config, self.aim(robot))
            return replace(perform(robot, motion), did=self.caption())

        return go

    def swing(self, robot: LeggedGeometry, station: StationConfig, aim: Mapping[str, Any]) -> JointMotion:
        """Plan the kick through the point of an aim.

        Raises InvalidParameter: a speed at which a joint would turn faster than its motor does without load;
        SimrobError: as :meth:`simrob_drake.LeggedRobot.act`.
        """
        motion = self._plan(robot, station, aim, self.speed)
        limits = resolve(station).robots[robot.name].speed_limits
        fastest = np.abs(motion.velocities).max(axis=0)
        worst = int((fastest / limits).argmax())
        if fastest[worst] <= limits[worst]:
            return motion
        speed = Kick.of(Walker.of(robot.model), self.gait, self._changes(self.speed)).speed

        def is_slow_enough(hundredths: int) -> bool:
            """Whether all motors follow a kick at a speed, in hundredths of a metre per second."""
            slower = self._plan(robot, station, aim, hundredths / 100)
            return bool((np.abs(slower.velocities) <= limits).all())

        # The joints turn the faster the faster the kick is: the speeds that work come first, and their count is the
        # largest of them in hundredths.
        largest = bisect_left(range(1, ceil(100 * speed)), True, key=lambda count: not is_slow_enough(count))
        details: dict[str, Any] = {
            "axis": robot.axes[worst],
            "speed": fastest[worst],
            "limit": limits[worst],
        }
        expected = (
            message(
                "programs.kick_at_most",
                "at most {most:g} m/s: {axis} would turn at {speed:.2f} rad/s, and can at {limit:.2f}",
                most=largest / 100,
                **details,
            )
            if largest
            else message(
                "programs.slower_kick",
                "slower: {axis} would turn at {speed:.2f} rad/s, and can at {limit:.2f}",
                **details,
            )
        )
        given = (
            message("programs.gaits_own", "the gait's")
            if self.speed is None
            else compound("{speed:g} m/s", speed=speed)
        )
        raise InvalidParameter(message("programs.speed_of_kick", "speed of the kick"), given, expected)

    def _changes(self, speed: float | None) -> dict[str, Any]:
        """Parameters that replace those of the gait, with a speed of the foot [m/s]; None for the gait's own."""
        return {**({} if speed is None else {"speed": speed}), **(self.model_extra or {})}

    def _plan(
        self, robot: LeggedGeometry, station: StationConfig, aim: Mapping[str, Any], speed: float | None
    ) -> JointMotion:
        """Plan the kick at a speed of the foot [m/s]; None for the gait's own."""
        return planned_gait(robot, self.gait, {**aim, **self._changes(speed)}, station=station)

    def aim(self, robot: LeggedGeometry) -> dict[str, Any]:
        """Return foot, point and direction of the gait for where robot and ball are now; nothing without a ball."""
        if self.ball is None:
            return {}
        walker, cell = Walker.of(robot.model), robot.cell
        return Kick.of(walker, self.gait, self.model_extra or {}).aimed(
            walker,
            robot.base_pose.GetAsMatrix4(),
            robot.position,
            ball=cell.frame(self.ball).translation()[:2],
            radius=self._radius(cell.config),
            toward=None if self.toward is None else np.array(self.toward),
        )

    def _radius(self, station: StationConfig) -> float:
        """Return the radius of the ball [m]."""
        name = str(self.ball)
        one_of(message("base.piece", "piece"), name, station.pieces)
        piece = resolve(station).pieces[name]
        radii = [shape.sphere for shape in piece.model.shapes if shape.sphere is not None]
        if not piece.free or len(radii) != 1:
            raise InvalidParameter(
                "ball", name, message("programs.a_free_sphere", "a free piece whose shape is a sphere")
            )
        return radii[0]
