"""A station that goes on where its last run left it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import instance, seconds
from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import PoseLike, Vector, as_transform, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.free_path import FreeSpace
from simrob_drake.programs.grasps import let_go, taken, with_efforts
from simrob_drake.programs.model import StationModel, reparented
from simrob_drake.programs.plan import Plan, check_moves
from simrob_drake.programs.planning import HasTool, Planning, WorkObject, check_units, pose_numbers
from simrob_drake.programs.segments import Stretch, rest, trajectory, until
from simrob_drake.programs.tape import Entry, Take, Tape, asked_move, in_words, run_entry
from simrob_drake.programs.timeline import Timeline, run_timed
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.record.run import AskedMove
from simrob_drake.results.record.state import State, free_joint
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import OnStep, ReferenceLike, Runner
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike, config_of

GOES_ON = ("completed", "monitor")  # endings of a run after which the next one begins where it ended
_SAME_PLACE = 1e-9  # how far from the robot's reference a plan may begin [rad or m]


class StatefulStation(ABC):
    """A station, kinematic or dynamic, that keeps its state from run to run: postures, velocities, servos, pieces.

    A move that cannot be done raises an error before anything moves, and leaves the station as it was; so does a run
    that diverges or is interrupted, whose result still tells what happened.

    Attributes:
        config: the station, with its pieces where they hang now.
        state: where it is; None before the first run.
        tape: what was recorded.
        progress: show a bar on a terminal while it runs; off at first.
        strict: a run with warnings raises an error, too, and leaves the station as it was; off at first.
        timeline: what happens to it beside what its robots do.
        watcher: is told of each step of a run, as ``on_step`` of :func:`simrob_drake.simulate`, in the window's place.
    """

    def __init__(self, station: StationLike, overrides: Mapping[str, Any] | None = None) -> None:
        """Take a station.

        Args:
            station: a name of :func:`simrob_drake.station_names`, a YAML file, a configuration, or a built station.
            overrides: what to change in it, as :func:`simrob_drake.load_station` takes it.

        Raises:
            SimrobError: as :func:`simrob_drake.load_station`.
        """
        config = config_of(station, overrides)
        self.config = config.model_copy(update={"program": None})  # who has the station at hand says what is done
        self.state = State.at_start_of(self.config)
        self.tape = Tape()
        self.progress = self.strict = False
        self.timeline = Timeline()
        self.watcher: OnStep | None = None
        self._window: LiveView | None = None
        self._runner: Runner | None = None
        self._model = StationModel(self.config)
        self._collision_free: tuple[object, ...] = ()  # what was found so last

    def __repr__(self) -> str:
        robots = ", ".join(f"{name} ({robot.model.name})" for name, robot in self._model.robots.items()) or "no robot"
        pieces = f", pieces {', '.join(self.config.pieces)}" if self.config.pieces else ""
        return f"<{type(self).__name__} {self.config.name}, {self.config.mode}: {robots}{pieces}>"

    def position(self, robot: str) -> Vector:
        """Return where a robot's axes are, shape (n,) [rad or m]."""
        initial = self.robot(robot).initial
        return (initial if self.state is None else self.state.positions[robot]).copy()

    def velocity(self, robot: str) -> Vector:
        """Return how fast a robot's axes move, shape (n,) [rad/s or m/s]."""
        initial = self.robot(robot).initial
        return np.zeros_like(initial) if self.state is None else self.state.velocities[robot].copy()

    def reference(self, robot: str) -> Vector:
        """Return where a robot's axes should be, and its next move begins, shape (n,) [rad or m]."""
        initial = self.robot(robot).initial
        return (initial if self.state is None else self.state.references[robot]).copy()

    @property
    def model(self) -> StationModel:
        """The station's plant, where it is and in the postures that it has now."""
        self._model.place_pieces(self.state)
        self._model.place_robots({robot: self.position(robot) for robot in self.config.robots})
        self._model.place_bases(self.state)
        return self._model

    def robot(self, name: str) -> StationRobot:
        """Return what a robot is in the station's plant."""
        return self._model.robots[one_of(message("base.robot", "robot"), name, self._model.robots)]

    def robot_name(self, name: str | None) -> str:
        """Return a robot's name, the only one's unless named; raises UnknownName, InvalidParameter: none, several."""
        robots = self.config.robots
        if not robots:
            raise InvalidParameter(
                "station", self.config.name, message("programs.station_with_robot", "one with a robot; it has none")
            )
        if name is None and self.config.only_robot is None:
            raise InvalidParameter(
                "robot",
                message("programs.not_named", "not named"),
                message(
                    "programs.name_one_robot",
                    "one of {robots}: robot='{first}'",
                    robots=", ".join(robots),
                    first=next(iter(robots)),
                ),
            )
        return one_of(message("base.robot", "robot"), self.config.only_robot if name is None else name, robots)

    def frame(self, wobj: WorkObject) -> RigidTransform:
        """Return the pose of a work object in the world.

        Args:
            wobj: None or "world"; a piece's name (its tool centre point), or one of its frames as ``piece.frame``; a
                robot's name or an :class:`Arm` (its tool centre point now); or a pose in any form.

        Raises:
            UnknownName: no such piece, frame or robot.
            InvalidParameter: something that is no pose.
        """
        if wobj is None or (isinstance(wobj, str) and wobj == WORLD):
            return RigidTransform()
        if isinstance(wobj, HasTool):
            return wobj.tool_pose()
        if not isinstance(wobj, str):
            check_units(wobj, "wobj")
            return as_transform(wobj)
        model, (name, *frame) = self.model, wobj.split(".", 1)
        if name in model.robots and not frame:
            robot = model.robots[name]
            return model.pose(robot.tools[robot.tcp] if robot.tcp else robot.root)
        one_of(message("programs.work_object", "work object"), name, [*self.config.pieces, WORLD, *self.config.robots])
        return model.pose(model.piece_frame(name, *frame))

    def run(self, *plans: Plan, duration: float | None = None) -> SimulationResult:
        """Run planned moves at the same time, while the other robots hold their places.

        Args:
            plans: of different robots, such as ``left.plan.move_l(...)``; none just lets the time pass.
            duration: of the run [s]; until the last move ends unless given.

        Returns:
            the run; unless it diverged or was interrupted, the next one begins where it ended.
        """
        self.check_together(*plans)
        if not plans and duration is None:
            raise InvalidParameter(
                "plans",
                "empty",
                message("programs.plans_or_duration", "some, such as arm.plan.move_l(...), or a duration to wait"),
            )
        end = seconds(max(plan.duration for plan in plans) if duration is None else duration)
        own = {plan.robot: plan.stretches for plan in plans}
        stretches = {robot: until(own.get(robot, ()), self.reference(robot), end) for robot in self.config.robots}
        references = {robot: trajectory(motion) for robot, motion in stretches.items()}
        several = len(self.config.robots) > 1
        entry = run_entry(plans, duration, self.frame, several=several)
        did, moves = in_words(plans, duration, several=several), tuple(asked_move(plan, self._model) for plan in plans)
        return self._run(references, end, stretches, entry, did, moves)

    def check_together(self, *plans: Plan) -> None:
        """Check that planned moves can be run at the same time from where the robots are.

        Raises:
            InvalidParameter: something that is no plan, two of one robot, or one that begins elsewhere.
            PathCollision: they would run into something, where that is to be looked at.
        """
        for plan in plans:
            instance(plan, "plans", Plan, message("programs.a_plan", "made by arm.plan, such as arm.plan.move_l(...)"))
        if len({plan.robot for plan in plans}) < len(plans):
            raise InvalidParameter(
                "plans", [plan.robot for plan in plans], message("programs.of_different_robots", "of different robots")
            )
        for plan in plans:
            if np.abs(plan.start - self.reference(plan.robot)).max() > _SAME_PLACE:
                raise InvalidParameter(
                    message("programs.plan_of", "plan of {robot}", robot=plan.robot),
                    message("programs.made_for_other_place", "made for another place"),
                    message("programs.planned_at_robot", "planned where the robot is"),
                )
        if any(plan.check == "collision" for plan in plans):  # each alone was, with the others as they stood then
            self.check_collisions(*plans)

    def follow(self, references: Mapping[str, ReferenceLike], duration: float) -> SimulationResult:
        """Run references as :func:`simrob_drake.simulate` takes them, while the other robots hold their places.

        Args:
            references: by robot; that nothing jumps where they begin is up to whoever gives them.
            duration: of the run [s].

        Returns:
            the run; unless it diverged or was interrupted, the next one begins where it ended.
        """
        instance(references, "references", Mapping, message("programs.mapping_by_robot", "a mapping by robot"))
        seconds(duration)
        still = [robot for robot in self.config.robots if robot not in references]
        held = {robot: trajectory((rest(self.reference(robot), 0.0, duration),)) for robot in still}
        return self._run({**held, **references}, duration)

    def _run(
        self,
        references: Mapping[str, ReferenceLike],
        duration: float,
        stretches: Mapping[str, tuple[Stretch, ...]] | None = None,
        entry: Entry | None = None,
        did: str = "",
        moves: tuple[AskedMove, ...] = (),
    ) -> SimulationResult:
        """Run references of all robots, and record that; ``entry`` is what a program's file has of it."""
        config, start = self.config, self.state
        if self.timeline.grid is not None:
            result = run_timed(self, references, duration)
        else:
            how: dict[str, Any] = {"progress": self.progress, "on_step": self.on_step}
            result = self.runner_of(config).run(reference=references, duration=duration, start=start, **how)
        result = replace(result, did=did, moves=moves).check(self.strict)
        if result.ending in GOES_ON:
            self.state = result.final_state
            self.timeline.now += result.stop_time
            self.tape.keep(Take(config, start, references, duration, result, stretches, entry))
        if self._window:
            self._window.add_paths(result)
        return result

    def follow_as(
        self, station: StationConfig, references: Mapping[str, ReferenceLike], duration: float, *, forget: str = ""
    ) -> SimulationResult:
        """Follow references on a station that is another one for this run alone, but for its floor, which stays so.

        What the controller to ``forget`` has come to is forgotten behind it.
        """
        own = self.config
        self.change(station)
        try:
            return self.follow(references, duration)
        finally:
            self.change(own.model_copy(update={"floor": station.floor}))
            if forget and self.state is not None:
                left = {name: one for name, one in self.state.blocks.items() if name != f"controller.{forget}"}
                self.state = replace(self.state, blocks=left)

    @abstractmethod
    def planning(self, robot: str | None) -> Planning:
        """Return what plans moves of an arm, from where its reference is; the only one need not be named."""

    def take(
        self, piece: str, robot: str | None = None, *, frame: str | None = None, pose: PoseLike | None = None
    ) -> None:
        """Let a robot take a piece with the tool that it has now; see :meth:`attach`."""
        name = self.robot_name(robot)
        tool = self.model.tool_in_use(name)
        self.attach(piece, tool if tool in self.config.pieces else name, frame=frame, pose=pose)

    def wait(self, duration: float) -> SimulationResult:
        """Let time pass [s] while all robots hold their places; on a dynamic station they settle."""
        return self.run(duration=duration)

    def play(self, duration: float) -> SimulationResult:
        """Let all robots follow the references of the station's file for a time [s], from where they are."""
        self.tape.note(None)
        return self._run({}, seconds(duration), entry={"play": float(duration)}, did="play")

    def attach(
        self, piece: str, parent: str = WORLD, *, frame: str | None = None, pose: PoseLike | None = None
    ) -> None:
        """Let a piece hang on something else (SimRob's PegarEn); it keeps its place in the world, to rounding.

        The robot that takes it uses its tool centre point from then on, and on a dynamic station feels its weight;
        one that gives it away goes back to the tool that carried it. Velocities stay as they are.

        Args:
            piece: which; what hangs on it comes along.
            parent: ``world``, a robot (its flange), or a piece (its tool centre point).
            frame: a frame of the parent piece, instead of its tool centre point; or a tool or link of the robot,
                instead of the first tool: a backpack hangs on the trunk.
            pose: the piece's pose in the parent's frame, to put it there from wherever it is.

        Raises:
            UnknownName: no such piece, parent or frame.
            InvalidParameter: the piece itself as its parent, or one that hangs on it; or a robot takes it without a
                ``pose`` from more than 30 mm away: the tool's tool centre point, or the link, from its shapes.
        """
        if pose is None:
            self._change(taken(self.model, piece, parent, frame=frame))
        else:
            check_units(pose_from_transform(as_transform(pose)), "pose")
            self._change(reparented(self.model, piece, parent, frame=frame, pose=pose))
        place = None if pose is None else pose_numbers(pose)
        self.tape.note({"attach": {"piece": piece, "parent": parent, "frame": frame, "pose": place}})

    def release(self, piece: str, parent: str = WORLD, *, frame: str | None = None, fixed: bool = False) -> None:
        """Let go of a piece, in the world or on another piece.

        In the world of a dynamic station it is free from then on: it goes on as fast as it was carried, falls, and
        rests on what it meets. On another piece, and on a kinematic station, it hangs where it is.

        Args:
            piece: which.
            parent: ``world``, or a piece that it hangs on from then on.
            frame: a frame of that piece, instead of its tool centre point.
            fixed: hang it in the world, too.

        Raises:
            UnknownName: no such piece, parent or frame.
            InvalidParameter: it would fall for ever: no contact, no shape that collides, nothing beneath it; or it
                has no mass.
        """
        model, state = self.model, self.state
        config = let_go(model, piece, parent, frame=frame, fixed=fixed)
        if state is not None and config.pieces[piece].free:
            state = replace(state, joints={**state.joints, free_joint(piece): model.motion(piece, state)})
        self._change(config)
        self.state = state
        self.tape.note({"release": {"piece": piece, "parent": parent, "frame": frame, "fixed": fixed}})

    def tool(self, robot: str, tool: str | PoseLike) -> None:
        """Change the tool centre point of a robot; see :meth:`Arm.tool`.

        Raises:
            UnknownName: the robot has no such tool or link.
            InvalidParameter: the pose of the tool is none, or it is in other units than m and rad.
        """
        entry, own = self.config.robots[robot], self.model.robots[robot]
        if isinstance(tool, str):
            one_of(
                message("programs.tool_of_robot", "tool of {robot}", robot=robot), tool, [*own.tools, *own.model.links]
            )
            changes: dict[str, object] = {} if tool == own.tcp else {"tcp": tool, "tcp_offset": None}
        else:
            offset = as_transform(tool)
            check_units(pose_from_transform(offset), "tool")
            before = RigidTransform() if entry.tcp_offset is None else as_transform(entry.tcp_offset)
            changes = {"tcp_offset": tuple(pose_from_transform(before @ offset).tolist())}
        robots = {**self.config.robots, robot: entry.model_copy(update=changes)}
        self._change(self.config.model_copy(update={"robots": robots}))
        own_tool = {"name": tool} if isinstance(tool, str) else {"pose": pose_numbers(tool)}
        self.tape.note({"tool": {**own_tool, "robot": None if self.config.only_robot else robot}})

    def limit_efforts(self, robot: str, efforts: Mapping[str, float]) -> None:
        """Have motors of a robot give at most so much [N·m or N], by axis; the others as before."""
        self._change(with_efforts(self.config, self.robot(robot), efforts))

    def change(self, config: StationConfig) -> None:
        """Go on from this state with a changed station, such as other gains; raises InvalidParameter: other robots."""
        self._change(config)
        self.tape.note(None)

    def _change(self, config: StationConfig) -> None:
        instance(config, "config", StationConfig, message("programs.loaded_station", "what load_station() gives"))
        if list(config.robots) != list(self.config.robots):
            raise InvalidParameter(
                "config",
                list(config.robots),
                message("programs.of_station_with", "of a station with {robots}", robots=", ".join(self.config.robots)),
            )
        model = StationModel(config)  # if it cannot be built, all stays as it was
        self.config, self._model = config, model
        if self._window:
            self._window.draw(config, self._shown_state())

    def check_collisions(self, *plans: Plan) -> None:
        """Check that moves run at once hit nothing, other robots at rest; raises PathCollision: the first point."""
        parts = (part for plan in plans for part in (plan.robot, plan.stretches, plan.check))
        looked_at = (self.config, self.state, *parts)
        if list(map(id, looked_at)) == list(map(id, self._collision_free)):  # all of which are kept, and do not change
            return
        check_moves(self.collision_model, plans)
        self._collision_free = looked_at

    @property
    def collision_model(self) -> StationModel:
        """The station's plant with the shapes that collide, robots where they should be now."""
        return self._placed(self._model.colliding)

    def free_space(self, robots: Sequence[str]) -> FreeSpace:
        """Return what robots that move together must not touch; raises StartInCollision: one touches something now."""
        return FreeSpace(self.collision_model, {robot: self.reference(robot) for robot in robots})

    def _placed(self, model: StationModel) -> StationModel:
        model.place_state(self.state, self.position, self.reference)
        return model

    def _shown_state(self) -> State:
        def of_all(value: Callable[[str], Vector]) -> dict[str, Vector]:
            return {robot: value(robot) for robot in self.config.robots}

        return self.state or State(of_all(self.position), of_all(self.velocity), of_all(self.reference))

    def runner_of(self, config: StationConfig) -> Runner:
        """Return what runs the station as a configuration of it says; the last one is kept."""
        if self._runner is None or self._runner.config != config:
            self._runner = Runner(config)
        return self._runner

    @property
    def on_step(self) -> OnStep | None:
        """What is told of each step of a run."""
        return self.watcher or (self._window.on_step if self._window else None)
