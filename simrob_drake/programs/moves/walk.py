"""Moves of robots with legs: gaits that are planned before they begin, and walks that follow commands of speed.

`walk` (SimRob's Marcha) and `act` run a gait of the robot's `gaits.yaml`: with steps, or a sequence of postures. `go`
runs the walking controller of the station, which decides each step from measurements while the robot walks.

A program is checked as a whole before it runs. The *outlook* is the station as it will be before a move, and the
*stage* of a move is the function that performs it later.
"""

import math
from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.frames import finite
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Duration, Number
from simrob_drake.blocks.references import hold
from simrob_drake.parts.controllers.walk import Walk
from simrob_drake.programs.gaits.motion import JointMotion, short_steps
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import perform, planned_gait, taught_arms
from simrob_drake.programs.moves.move import (
    MOST_AMPLITUDE,
    MOST_STEPS,
    Move,
    NameOf,
    Outlook,
    Stage,
    make_move,
    naming,
)
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.walking.commands import Commanded


class GaitMove(Move):
    """A gait of a robot with legs. Further keys are parameters of the gait, and replace the gait's own."""

    model_config = ConfigDict(extra="allow")
    of_arms: ClassVar[bool] = False

    @abstractmethod
    def plan_motion(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Plan the motion of a robot.

        Args:
            robot: the robot.
            station: the station as it will be before the move.

        Raises:
            SimrobError: the robot cannot perform the gait there.
        """

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Plan the motion as a check, and return the stage that runs it.

        The first run of the stage uses this plan, unless the station is on a slope, an earlier move changes the station
        in a way that is not known exactly, or arms are elsewhere by then. Otherwise, and in each further run, the stage
        plans again.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move. It stays as it is.
            name: name of the move for messages.

        Raises:
            SimrobError: the robot cannot perform the gait. The stage raises it, too, if it plans again.
        """
        # A gait whose legs are solved leaves arms (axes in no leg) where earlier moves have put them: its plan depends
        # on their positions. Here they are where they are before the program.
        arms_at_check = taught_arms(robot)
        # The plan of the check, as long as it is valid. It is taken out of the list when it runs, which frees its
        # memory. If the list is empty, the stage plans again.
        valid_plans = [self.plan_motion(robot, outlook.station)]
        # If an earlier move changes the load, or the heading on a slope, this plan is a check only.
        if outlook.changed or resolve(outlook.station).ground.incline:
            valid_plans.clear()

        def run_stage(moving_robot: LeggedGeometry) -> SimulationResult:
            """Run the gait from where the robot is."""
            if taught_arms(moving_robot) != arms_at_check:
                valid_plans.clear()
            # No variable of this function holds the plan, so that `perform` can free it before the run.
            result = perform(
                moving_robot, valid_plans.pop() if valid_plans else plan_again(moving_robot)
            )
            return replace(result, did=self.caption())

        def plan_again(moving_robot: LeggedGeometry) -> JointMotion:
            """Plan the motion for the present station. An error names the move."""
            with naming(name):
                return self.plan_motion(moving_robot, moving_robot.cell.config)

        return run_stage


class WalkMove(GaitMove):
    """Steps of a planned gait."""

    key: ClassVar[str] = "walk"

    steps: Annotated[int, Field(strict=True, ge=-MOST_STEPS, le=MOST_STEPS)]
    """Count of full steps. The gait's `ramp_steps` come in addition. For a crawl, the count of legs that swing."""
    amplitude: Annotated[Number, Field(ge=-MOST_AMPLITUDE, le=MOST_AMPLITUDE)] = 1.0
    """Factor of the step length."""
    gait: Annotated[str | None, NameOf("gaits")] = None
    """Name of one of the robot's gaits with steps. If it is not set, the first one for its feet."""

    def plan_motion(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Plan the motion, see :meth:`GaitMove.plan_motion`."""
        changes = self.model_extra or {}
        return planned_gait(
            robot, self.gait, changes, steps=self.steps, amplitude=self.amplitude, station=station
        )


class ActMove(GaitMove):
    """A gait without steps: postures one after the other, or a stand on three legs."""

    key: ClassVar[str] = "act"
    says: ClassVar[str] = "act {it.name}"
    brief: ClassVar[bool] = True

    name: Annotated[str, NameOf("acts")]
    """Name of one of the robot's gaits without steps."""

    def plan_motion(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Plan the motion, see :meth:`GaitMove.plan_motion`."""
        return planned_gait(robot, self.name, self.model_extra or {}, station=station)


GO_TIME = 3.0
"""Default duration of a walk that follows a command [s]. It is long enough to stop."""

_FLOOR_AROUND = 1.0  # floor that has to remain around the path of the robot [m]


class GoMove(Move):
    """A walk that reacts to measurements, by the parameters under `reacting` in the robot's `gaits.yaml`.

    Without a speed the robot stops and stands. A command that the legs cannot follow is clipped, with a warning.
    """

    key: ClassVar[str] = "go"
    of_arms: ClassVar[bool] = False

    ahead: Number = 0.0
    """Speed ahead [m/s]."""
    sideways: Number = 0.0
    """Speed to the left [m/s]."""
    turn_deg: Number = 0.0
    """Turning speed to the left [deg/s]."""
    duration: Duration = GO_TIME
    """Duration of the walk [s]. The robot does not stop at its end: another `go` can follow in the middle of a step."""
    strict: Boolean = False
    """Whether a command that the legs cannot follow is an error."""

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that the pendant's input form offers for this move: all of them; see :meth:`Move.possible_keys`.

        Returns None if the robot cannot walk so in the station, for one of the reasons under :meth:`station`.
        """
        # Whether a robot can follow commands is known only by making the station: its parts check themselves.
        try:
            cls().station(config, robot)
        except SimrobError:
            return None
        return frozenset(cls.model_fields)

    @classmethod
    def at(
        cls, ahead: float, sideways: float, turn: float, *, duration: float, strict: bool
    ) -> "GoMove":
        """Make a walk from arguments of a user.

        Args:
            ahead: speed ahead [m/s].
            sideways: speed to the left [m/s].
            turn: turning speed to the left [rad/s].
            duration: duration of the walk [s].
            strict: whether a command that the legs cannot follow is an error.

        Raises:
            InvalidParameter: a value is not a finite number, or the duration is not positive.
        """
        # Checked here, because an error of `make_move` would name `turn_deg`, which the user did not give.
        for name, value in (("ahead", ahead), ("sideways", sideways), ("turn", turn)):
            # The result of `finite` has the shape () only for a single finite number.
            if finite(value).shape != ():
                expected = message("programs.one_speed", "a finite number [m/s]")
                if name == "turn":
                    expected = message("programs.finite_turn", "a finite number [rad/s]")
                raise InvalidParameter(name, value, expected)
        return make_move(
            cls,
            ahead=ahead,
            sideways=sideways,
            turn_deg=math.degrees(turn),
            duration=duration,
            strict=strict,
        )

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can follow commands, and return the stage in which it walks.

        The outlook is marked as changed, because where the walk ends is not known before.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move.
            name: name of the move for messages. It is not used.

        Raises:
            SimrobError: see :meth:`station`.
        """
        self.station(outlook.station, robot.name)
        outlook.changed = True
        return self._walk

    def station(self, config: StationConfig, robot: str, *, start: float = 0.0) -> StationConfig:
        """Make a copy of a station in which a robot follows the command.

        The copy has the walking controller that the station has for the robot (the first one of several), or else a new
        one, with the command of this move. The controller's name stays the same from run to run, and with it its state,
        so that the robot continues in the middle of a step. Steps of a solver that holds references over a step are
        short, and a floor is as large as the walk needs.

        Args:
            config: the station.
            robot: name of the robot.
            start: the larger one of the robot's distances from the world's origin along x and along y [m].

        Raises:
            SimrobError: the robot does not stand on feet of its own or has no such walk, the station is kinematic, or
                `strict` is set and the legs cannot follow the command.
        """
        walks = {
            key: section for key, section in config.controllers.items() if isinstance(section, Walk)
        }
        own_walks = [
            key for key, section in walks.items() if (section.robot or config.only_robot) == robot
        ]
        # A second walking controller would move the same axes: the robot's own one gets the command.
        if own_walks:
            name = own_walks[0]
            walk = walks[name]
        else:
            name = f"{robot}_walk" if "walk" in config.controllers else "walk"
            walk = Walk(kind="walk", robot=robot)
        command = Commanded(ahead=self.ahead, sideways=self.sideways, turn_deg=self.turn_deg)
        # One command replaces the timetable of the station's file, and its path, which gives commands as well.
        settings = {"commands": (command,), "path": None, "strict": self.strict}
        # The servos also follow the speed of their references, which reduces their lag.
        inputs = (*config.inputs, "reference_velocity")
        changes: dict[str, Any] = {
            "controllers": {**config.controllers, name: walk.model_copy(update=settings)},
            "inputs": tuple(dict.fromkeys(inputs)),  # each input once
            "solver": short_steps(config.solver),
        }
        if config.floor is not None:
            # The floor is a square around the origin. Its side is twice the largest distance, because the robot may
            # walk in any direction.
            distance = start + math.hypot(self.ahead, self.sideways) * self.duration + _FLOOR_AROUND
            size = max(config.floor.size, math.ceil(2.0 * distance))
            changes["floor"] = config.floor.model_copy(update={"size": size})
        changed = config.model_copy(update=changes)
        check_parts(resolve(changed))
        return changed

    def _walk(self, robot: LeggedGeometry) -> SimulationResult:
        """Run the walk from the present state, on a station that is changed for this run only.

        A floor that had to become larger stays so.
        """
        # The floor is a square around the origin, so the larger coordinate decides how far the robot is from its
        # edge.
        start = float(abs(robot.base_pose.translation()[:2]).max())
        station = self.station(robot.cell.config, robot.name, start=start)
        # The controller replaces the references of the axes that it moves. The others hold their positions.
        references = {robot.name: hold(robot.reference)}
        return replace(robot.cell.follow_as(station, references, self.duration), did=self.caption())
