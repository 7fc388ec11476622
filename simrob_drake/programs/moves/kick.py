"""Kick a ball. The ball flies by the forces of the contact alone.

A program is checked as a whole before it runs. The *outlook* is the station as it will be before a move, and the
*stage* of a move is the function that performs it later. To *aim* is to compute the parameters of the gait with which
the foot hits the ball.
"""

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
    """A foot that swings through a ball. Further keys are parameters of the gait, and replace the gait's own."""

    model_config = ConfigDict(extra="allow")
    key: ClassVar[str] = "kick"
    of_arms: ClassVar[bool] = False

    ball: Annotated[str | None, NameOf("pieces")] = None
    """Piece to hit in its middle, where it is when the kick begins. If it is not set, the foot hits nothing."""
    toward: tuple[Number, Number] | None = None
    """Position in the world towards which the ball is kicked [m]. If it is not set, where the robot looks."""
    speed: Positive | None = None
    """Speed of the foot when it hits the ball [m/s]. If it is not set, that of the gait."""
    gait: str = Kick.usual
    """Name of one of the kicks in the robot's `gaits.yaml`."""

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that the pendant's input form offers for this move, without the parameters of the gait.

        See :meth:`Move.possible_keys`.

        Returns None if the robot's `gaits.yaml` has no kick of the usual name.
        """
        # A form offers the kick only to robots that have one; the speed and the ball are always possible.
        return frozenset(cls.model_fields) if has_gait(model, Kick, Kick.usual) else None

    def caption(self, *, robots: bool = False) -> str:
        """Caption with the name of the ball, if there is one. The move names no robot, so `robots` has no effect."""
        return f"kick {self.ball}" if self.ball else "kick"

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can swing its foot, and return the stage that aims at the ball and kicks.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move. It stays as it is.
            name: name of the move for messages.

        Raises:
            UnknownName: the station has no such ball.
            InvalidParameter: the ball is no free sphere, or a joint would turn too fast.
            SimrobError: the robot cannot perform the gait. The stage raises it, too, if it cannot reach the ball.
        """
        # Where the ball will be is not known yet: only a swing through the air can be checked.
        self.swing(robot, outlook.station, {})
        # The radius itself is not needed yet: the call checks that the ball is a free sphere.
        if self.ball is not None:
            self._radius(outlook.station)

        def run_stage(robot: LeggedGeometry) -> SimulationResult:
            """Kick the ball where it is now. Without a ball, the foot swings through the air."""
            with naming(name):
                motion = self.swing(robot, robot.cell.config, self.aim(robot))
            return replace(perform(robot, motion), did=self.caption())

        return run_stage

    def swing(
        self, robot: LeggedGeometry, station: StationConfig, aim: Mapping[str, Any]
    ) -> JointMotion:
        """Plan the motion of the kick.

        Args:
            robot: the robot.
            station: the station as it will be before the move.
            aim: parameters of the gait from :meth:`aim`. If it is empty, the kick is not aimed.

        Raises:
            InvalidParameter: a joint would turn faster than its motor can without a load. The message has the largest
                speed that all joints can do, if there is one.
            SimrobError: see :meth:`simrob_drake.LeggedRobot.act`.
        """
        motion = self._plan(robot, station, aim, self.speed)
        # Speed limit of each axis, and its largest speed in the motion, shape (n,) [rad/s].
        limits = resolve(station).robots[robot.name].speed_limits
        fastest = np.abs(motion.velocities).max(axis=0)
        # Index of the axis nearest to its limit, or furthest beyond.
        worst = int((fastest / limits).argmax())
        if fastest[worst] <= limits[worst]:
            return motion
        # For the message: search the fastest kick that the joints can do, below the present speed [m/s].
        speed = Kick.of(Walker.of(robot.model), self.gait, self._changes({}, self.speed)).speed

        def is_too_fast(hundredths: int) -> bool:
            """Whether a motor is too slow for a kick at a speed, in hundredths of a metre per second."""
            slower = self._plan(robot, station, aim, hundredths / 100)
            return not bool((np.abs(slower.velocities) <= limits).all())

        # The joints turn the faster the faster the kick is: of the speeds from 0.01 m/s on, those that work come first.
        # The bisection finds their count, which is the largest of them in hundredths. It is 0 if none works.
        largest = bisect_left(range(1, ceil(100 * speed)), True, key=is_too_fast)
        details: dict[str, Any] = {
            "axis": robot.axes[worst],
            "speed": fastest[worst],
            "limit": limits[worst],
        }
        if largest:
            expected = message(
                "programs.kick_at_most",
                "at most {most:g} m/s: {axis} would turn at {speed:.2f} rad/s, beyond its limit of {limit:.2f} rad/s",
                most=largest / 100,
                **details,
            )
        else:
            expected = message(
                "programs.slower_kick",
                "slower: {axis} would turn at {speed:.2f} rad/s, beyond its limit of {limit:.2f} rad/s",
                **details,
            )
        value = message("programs.gaits_own", "that of the gait")
        if self.speed is not None:
            value = compound("{speed:g} m/s", speed=self.speed)
        raise InvalidParameter(
            message("programs.speed_of_kick", "speed of the kick"), value, expected
        )

    def _changes(self, aim: Mapping[str, Any], speed: float | None) -> dict[str, Any]:
        """Collect the parameters that replace those of the gait. Keys that the user sets in the move override the aim.

        Args:
            aim: parameters that aim the kick, see :meth:`aim`. There are none if the kick is not aimed.
            speed: speed of the foot when it hits [m/s]. If it is None, that of the gait.
        """
        changes = dict(aim)
        if speed is not None:
            changes["speed"] = speed
        # Keys that the user sets replace those of the aim.
        changes.update(self.model_extra or {})
        return changes

    def _plan(
        self,
        robot: LeggedGeometry,
        station: StationConfig,
        aim: Mapping[str, Any],
        speed: float | None,
    ) -> JointMotion:
        """Plan the kick at a speed of the foot. Speeds of the joints are not checked.

        Args:
            robot: the robot.
            station: the station as it will be before the move.
            aim: parameters that aim the kick, see :meth:`aim`. There are none if the kick is not aimed.
            speed: speed of the foot when it hits [m/s]. If it is None, that of the gait.
        """
        return planned_gait(robot, self.gait, self._changes(aim, speed), station=station)

    def aim(self, robot: LeggedGeometry) -> dict[str, Any]:
        """Compute the parameters of the gait with which the robot hits the ball, from where both are now.

        Returns:
            Values of `foot`, `point`, `toward_deg` and perhaps `lift` of the gait. It is empty without a ball.

        Raises:
            SimrobError: the ball is no free sphere, or the robot has no such kick or other feet. Whether its leg is
                long enough is found only when the kick is planned.
        """
        if self.ball is None:
            return {}
        walker = Walker.of(robot.model)
        cell = robot.cell
        # The ball is where it lies now: earlier moves may have pushed it.
        return Kick.of(walker, self.gait, self.model_extra or {}).aim(
            walker,
            robot.base_pose.GetAsMatrix4(),
            robot.position,
            ball=cell.frame(self.ball).translation()[:2],
            radius=self._radius(cell.config),
            toward=None if self.toward is None else np.array(self.toward),
        )

    def _radius(self, station: StationConfig) -> float:
        """Radius of the ball [m]. The move must have one.

        Args:
            station: the station.

        Raises:
            UnknownName: the station has no such piece.
            InvalidParameter: the piece is not free, or it has no sphere or several among its shapes.
        """
        name = str(self.ball)
        one_of(message("base.piece", "piece"), name, station.pieces)
        # A ball on a robot or in the world is fixed, and would stop the foot.
        piece = resolve(station).pieces[name]
        radii = [shape.sphere for shape in piece.model.shapes if shape.sphere is not None]
        if not piece.free or len(radii) != 1:
            raise InvalidParameter(
                "ball",
                name,
                message("programs.a_free_sphere", "a free piece whose shape is a sphere"),
            )
        return radii[0]
