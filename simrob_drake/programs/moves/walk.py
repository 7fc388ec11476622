"""Walks: steps by a gait that is planned before it begins (SimRob's Marcha), postures in a row; or by a command."""

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
from simrob_drake.programs.moves.move import MOST_AMPLITUDE, MOST_STEPS, Move, NameOf, Outlook, Stage, checked, naming
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.walking.commands import Commanded


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

    steps: Annotated[int, Field(strict=True, ge=-MOST_STEPS, le=MOST_STEPS)]
    """How many step lengths ahead; the gait's `ramp_steps` come in addition. Legs in turn for a crawl."""
    amplitude: Annotated[Number, Field(ge=-MOST_AMPLITUDE, le=MOST_AMPLITUDE)] = 1.0
    """Scales them."""
    gait: Annotated[str | None, NameOf("gaits")] = None
    """One of the robot's gaits that go steps; the first for its feet unless given."""

    def planned(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Return the motion, planned for a station."""
        changes = self.model_extra or {}
        return planned_gait(robot, self.gait, changes, steps=self.steps, amplitude=self.amplitude, station=station)


class ActMove(GaitMove):
    """Postures one after the other, or a stand on three legs."""

    key: ClassVar[str] = "act"
    says: ClassVar[str] = "act {it.name}"
    brief: ClassVar[bool] = True

    name: Annotated[str, NameOf("acts")]
    """One of the robot's gaits that go no steps."""

    def planned(self, robot: LeggedGeometry, station: StationConfig) -> JointMotion:
        """Return the motion, planned for a station."""
        return planned_gait(robot, self.name, self.model_extra or {}, station=station)


GO_TIME = 3.0  # time of a walk by commands unless another one is asked for [s]: enough to stop
_BEYOND = 1.0  # floor beyond the way that a robot goes [m]


class GoMove(Move):
    """A walk that is made while it goes, by `reacting` in its robot's `gaits.yaml`.

    Nothing but its duration: it stops and stands. What the legs cannot follow is clipped, and the result says so.
    """

    key: ClassVar[str] = "go"
    of_arms: ClassVar[bool] = False

    ahead: Number = 0.0
    """[m/s]."""
    sideways: Number = 0.0
    """To the left [m/s]."""
    turn_deg: Number = 0.0
    """To the left [deg/s]."""
    duration: Duration = GO_TIME
    """How long [s]; it does not stop at its end, so that another `go` can follow in the middle of a step."""
    strict: Boolean = False
    """Refuse what the legs cannot follow."""

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Find the keys; None for a robot without a walk by commands, or on a kinematic station."""
        try:
            cls().station(config, robot)
        except SimrobError:
            return None
        return frozenset(cls.model_fields)

    @classmethod
    def at(cls, ahead: float, sideways: float, turn: float, *, duration: float, strict: bool) -> "GoMove":
        """Return a walk at speeds [m/s] and a turn [rad/s], from a user; raises InvalidParameter: no such numbers."""
        for name, value in (("ahead", ahead), ("sideways", sideways), ("turn", turn)):
            if finite(value).shape != ():
                raise InvalidParameter(
                    name,
                    value,
                    message("programs.finite_turn", "a finite number [rad/s]")
                    if name == "turn"
                    else message("programs.one_speed", "one [m/s]"),
                )
        content = {"ahead": ahead, "sideways": sideways, "turn_deg": math.degrees(turn)}
        return checked(cls, **content, duration=duration, strict=strict)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can walk by commands, and return the stage in which it does."""
        self.station(outlook.station, robot.name)
        outlook.changed = True
        return self._gone

    def station(self, config: StationConfig, robot: str, *, start: float = 0.0) -> StationConfig:
        """Return a station on which a robot goes so, from so far from the world's origin [m].

        The walk is that of the station if it has one for the robot; its name stays the same from run to run, so its
        state does, and the robot goes on in the middle of a step. Raises SimrobError: a robot that does not stand on
        feet of its own, or has no walk; a station that is kinematic.
        """
        known = {name: section for name, section in config.controllers.items() if isinstance(section, Walk)}
        own = [name for name, section in known.items() if (section.robot or config.only_robot) == robot]
        name = own[0] if own else f"{robot}_walk" if "walk" in config.controllers else "walk"
        command = Commanded(ahead=self.ahead, sideways=self.sideways, turn_deg=self.turn_deg)
        walk = known[name] if own else Walk(kind="walk", robot=robot)
        settings = {"commands": (command,), "path": None, "strict": self.strict}
        changes: dict[str, Any] = {
            "controllers": {**config.controllers, name: walk.model_copy(update=settings)},
            "inputs": tuple(dict.fromkeys((*config.inputs, "reference_velocity"))),
            "solver": short_steps(config.solver),
        }
        if config.floor is not None:
            way = start + math.hypot(self.ahead, self.sideways) * self.duration + _BEYOND
            changes["floor"] = config.floor.model_copy(update={"size": max(config.floor.size, math.ceil(2.0 * way))})
        changed = config.model_copy(update=changes)
        check_parts(resolve(changed))
        return changed

    def _gone(self, robot: LeggedGeometry) -> SimulationResult:
        """Let a robot go, and return the run; the floor stays as large as it had to become."""
        start = float(abs(robot.base_pose.translation()[:2]).max())
        station, held = self.station(robot.cell.config, robot.name, start=start), {robot.name: hold(robot.reference)}
        return replace(robot.cell.follow_as(station, held, self.duration), did=self.caption())
