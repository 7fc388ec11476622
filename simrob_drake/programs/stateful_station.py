"""A station that keeps its state from run to run, so that each run begins where the last one ended.

A *plan* is a motion of an arm that has been checked, see :class:`~simrob_drake.programs.plan.Plan`; its *stretches* are
the splines that it consists of. The *reference* of a robot is where its axes should be: its next move begins there.
The *tape* records the runs: a *take* is a run, and an *entry* is a move as the file of a program has it. The *tool in
use* of a robot is the frame to which its moves refer: a tool of its own, or a piece that it carries.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import instance, seconds
from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import PoseLike, Vector, as_transform, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.free_path import FreeSpace
from simrob_drake.programs.grasps import release_piece, take_piece, with_efforts
from simrob_drake.programs.model import StationModel, reparent_piece
from simrob_drake.programs.plan import Plan, check_moves
from simrob_drake.programs.planning import HasTool, Planning, WorkObject, check_units, pose_numbers
from simrob_drake.programs.segments import Stretch, rest, trajectory, until
from simrob_drake.programs.tape import Entry, Take, Tape, asked_move, plans_caption, run_entry
from simrob_drake.programs.timeline import Timeline, run_timed
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.record.run import AskedMove
from simrob_drake.results.record.state import State, free_joint
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import OnStep, ReferenceLike, Runner
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike, config_of

GOES_ON = ("completed", "monitor")
"""Endings of a run after which the next run begins where it ended.

After others (the run diverged, was interrupted, or a block failed) the station is as it was before the run.
"""

# Largest distance from the robot's reference at which a plan may begin [rad or m].
_SAME_PLACE = 1e-9


class StatefulStation(ABC):
    """A station, kinematic or dynamic, that keeps its state from run to run: postures, velocities, servos, pieces.

    A move that cannot be done raises an error before anything moves, and leaves the station unchanged. A run that
    diverges, is interrupted or ends because a block fails raises no error: its result is returned, and the station is
    left unchanged, too.

    Attributes:
        config: the station, with its pieces on their present parents.
        state: its state. It is None before the first run, unless the station's file names a state under ``start``.
        tape: the recorded runs.
        progress: whether a bar on a terminal shows the progress of a run. The default is False.
        strict: whether a run with warnings raises an error, too, and leaves the station unchanged. The default is
            False.
        timeline: what happens to the station while its robots move, such as pushes.
        watcher: callback of each step of a run, as ``on_step`` of :func:`simrob_drake.simulate`. It replaces the
            browser window. It is None if there is none.
    """

    def __init__(self, station: StationLike, overrides: Mapping[str, Any] | None = None) -> None:
        """Load a station.

        Args:
            station: a name of :func:`simrob_drake.station_names`, a YAML file, a configuration, or a built station.
            overrides: changes of the station, as of :func:`simrob_drake.load_station`.

        Raises:
            SimrobError: see :func:`simrob_drake.load_station`.
        """
        config = config_of(station, overrides)
        # The station's own program is not run: calls of this object decide what the robots do.
        self.config = config.model_copy(update={"program": None})
        self.state = State.at_start_of(self.config)
        self.tape = Tape()
        self.progress = False
        self.strict = False
        self.timeline = Timeline()
        self.watcher: OnStep | None = None
        self._window: LiveView | None = None
        self._runner: Runner | None = None
        self._model = StationModel(self.config)
        # Station, state and plans of the last collision check without a finding, see `check_collisions`.
        self._collision_free: tuple[object, ...] = ()

    def __repr__(self) -> str:
        robots = (
            ", ".join(f"{name} ({robot.model.name})" for name, robot in self._model.robots.items())
            or "no robot"
        )
        pieces = f", pieces {', '.join(self.config.pieces)}" if self.config.pieces else ""
        return f"<{type(self).__name__} {self.config.name}, {self.config.mode}: {robots}{pieces}>"

    def position(self, robot: str) -> Vector:
        """Positions of a robot's axes, shape (n,) [rad or m]."""
        initial = self.robot(robot).initial
        # A copy: the state itself must not change with the array of a caller.
        return (initial if self.state is None else self.state.positions[robot]).copy()

    def velocity(self, robot: str) -> Vector:
        """Velocities of a robot's axes, shape (n,) [rad/s or m/s]."""
        initial = self.robot(robot).initial
        return np.zeros_like(initial) if self.state is None else self.state.velocities[robot].copy()

    def reference(self, robot: str) -> Vector:
        """References of a robot's axes, from which its next move begins, shape (n,) [rad or m]."""
        initial = self.robot(robot).initial
        return (initial if self.state is None else self.state.references[robot]).copy()

    @property
    def model(self) -> StationModel:
        """The station's plant with robots and pieces where they are now."""
        # The plant is placed anew each time, because planning and collision checks move it.
        self._model.place_pieces(self.state)
        self._model.place_robots({robot: self.position(robot) for robot in self.config.robots})
        self._model.place_bases(self.state)
        return self._model

    def robot(self, name: str) -> StationRobot:
        """Robot of the station's plant, by its name.

        Raises:
            UnknownName: there is no such robot.
        """
        return self._model.robots[one_of(message("base.robot", "robot"), name, self._model.robots)]

    def robot_name(self, name: str | None) -> str:
        """Check the name of a robot.

        Args:
            name: the name. If it is None, the only robot of the station is meant.

        Returns:
            The name, or that of the only robot.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the station has no robot, or none is named and there are several.
        """
        robots = self.config.robots
        if not robots:
            raise InvalidParameter(
                "station",
                self.config.name,
                message("programs.station_with_robot", "a station with a robot"),
            )
        if name is None and self.config.only_robot is None:
            raise InvalidParameter(
                "robot",
                message("programs.not_named", "not named"),
                message(
                    "programs.name_one_robot",
                    "one of {robots}, such as robot='{first}'",
                    robots=", ".join(robots),
                    first=next(iter(robots)),
                ),
            )
        return one_of(
            message("base.robot", "robot"), self.config.only_robot if name is None else name, robots
        )

    def frame(self, wobj: WorkObject) -> RigidTransform:
        """Pose of a work object in the world.

        Args:
            wobj: None or "world"; the name of a piece (its tool centre point), or one of its frames as ``piece.frame``;
                the name of a robot or an :class:`Arm` (its tool centre point now, or the root link of a robot without
                a tool); or a pose in any form.

        Raises:
            UnknownName: there is no such piece, frame or robot.
            InvalidParameter: the value is no pose, or it is in other units than m and rad.
        """
        if wobj is None or (isinstance(wobj, str) and wobj == WORLD):
            return RigidTransform()
        if isinstance(wobj, HasTool):
            return wobj.tool_pose()
        if not isinstance(wobj, str):
            check_units(wobj, "wobj")
            return as_transform(wobj)
        model = self.model
        # A name with a dot is a frame of a piece. A robot has only one frame for targets: its tool centre point.
        name, dot, frame = wobj.partition(".")
        if name in model.robots and not dot:
            robot = model.robots[name]
            return model.pose(robot.tools[robot.tcp] if robot.tcp else robot.root)
        one_of(
            message("programs.work_object", "work object"),
            name,
            [*self.config.pieces, WORLD, *self.config.robots],
        )
        return model.pose(model.piece_frame(name, frame) if dot else model.piece_frame(name))

    def run(self, *plans: Plan, duration: float | None = None) -> SimulationResult:
        """Run planned moves at the same time, while the other robots hold their positions.

        Args:
            plans: plans of different robots, such as ``left.plan.move_l(...)``. Without any, all robots wait.
            duration: duration of the run [s]. If it is None, until the last move ends. A shorter one cuts the moves.

        Returns:
            The result of the run. The next run begins where it ended if its ending is one of :data:`GOES_ON`.

        Raises:
            InvalidParameter: see :meth:`check_together`; there is neither a plan nor a duration; or the duration is
                not positive.
            PathCollision: see :meth:`check_together`.
            VerdictError: the run has warnings, and `strict` is True.
        """
        # Everything is checked before the first step, so that an error leaves the station where it is.
        self.check_together(*plans)
        if not plans and duration is None:
            raise Unsuitable(
                "run",
                message("programs.without_plans", "neither plans nor a duration are given"),
                message(
                    "programs.plans_or_duration",
                    "give a plan, such as arm.plan.move_l(...), or a duration to wait",
                ),
            )
        end = seconds(max(plan.duration for plan in plans) if duration is None else duration)
        # Robots without a plan, and those whose move ends earlier, rest until the end of the run.
        stretches_of_plans = {plan.robot: plan.stretches for plan in plans}
        stretches = {
            robot: until(stretches_of_plans.get(robot, ()), self.reference(robot), end)
            for robot in self.config.robots
        }
        references = {robot: trajectory(motion) for robot, motion in stretches.items()}
        several = len(self.config.robots) > 1
        entry = run_entry(plans, duration, self.frame, several=several)
        caption = plans_caption(plans, several=several)
        moves = tuple(asked_move(plan, self._model) for plan in plans)
        return self._run(references, end, stretches, entry, caption, moves)

    def check_together(self, *plans: Plan) -> None:
        """Check that planned moves can be run at the same time from where the robots are.

        Raises:
            InvalidParameter: a value is no plan, two plans are of the same robot, or a plan begins elsewhere.
            PathCollision: a robot would collide whose plan has the option to check collisions.
        """
        for plan in plans:
            instance(
                plan,
                "plans",
                Plan,
                message("programs.a_plan", "a plan, such as that of arm.plan.move_l(...)"),
            )
        if len({plan.robot for plan in plans}) < len(plans):
            raise InvalidParameter(
                "plans",
                [plan.robot for plan in plans],
                message("programs.of_different_robots", "of different robots"),
            )
        for plan in plans:
            # A plan that was made before another run may begin elsewhere: the axes would jump.
            if np.abs(plan.start - self.reference(plan.robot)).max() > _SAME_PLACE:
                raise Unsuitable(
                    message("programs.plan_of", "plan of {robot}", robot=plan.robot),
                    message(
                        "programs.made_for_other_place",
                        "it begins in another posture than that of the robot",
                    ),
                    message(
                        "programs.planned_at_robot", "plan the move again from where the robot is"
                    ),
                )
        # Each plan was checked alone when it was made, with the other robots at rest where they were then.
        if any(plan.check == "collision" for plan in plans):
            self.check_collisions(*plans)

    def follow(self, references: Mapping[str, ReferenceLike], duration: float) -> SimulationResult:
        """Run references, while the robots without one rest at their references of the last run.

        Args:
            references: reference of some robots by name, as :func:`simrob_drake.simulate` accepts it. The caller makes
                sure that it begins where the robot is, so that nothing jumps.
            duration: duration of the run [s].

        Returns:
            The result of the run. The next run begins where it ended if its ending is one of :data:`GOES_ON`.

        Raises:
            InvalidParameter: the references are no mapping, or the duration is not positive.
            VerdictError: the run has warnings, and `strict` is True.
            SimrobError: the station cannot follow a reference.
        """
        instance(
            references,
            "references",
            Mapping,
            message("programs.mapping_by_robot", "a mapping by the names of robots"),
        )
        seconds(duration)
        # Without a reference the station's file would decide, and the robot would move.
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
        """Run references of robots from the present state.

        If the run is completed or a monitor ends it, the station takes over its final state, and the tape records the
        run. Otherwise the station stays as it was. An open window shows the run in both cases.

        Args:
            references: reference of each robot by name. A robot without one follows the reference of the station's
                file.
            duration: duration of the run [s].
            stretches: motions of each robot by name. It is None if the references are no planned moves.
            entry: entry of a program's file that makes this run again. It is None if no file can.
            did: caption of the run; empty if it has none.
            moves: the planned moves.

        Returns:
            The result of the run, also if the station stays as it was.

        Raises:
            VerdictError: the run has warnings, and `strict` is True.
            SimrobError: the station cannot follow a reference, or a change of the timeline is not possible.
        """
        # The take keeps the station and the state of the start, from which it can be repeated.
        config = self.config
        start = self.state
        # A timeline with a grid cuts the run at its changes, and restarts the solver at each moment of the grid.
        if self.timeline.grid is not None:
            result = run_timed(self, references, duration)
        else:
            result = self.runner_of(config).run(
                reference=references,
                duration=duration,
                start=start,
                progress=self.progress,
                on_step=self.on_step,
            )
        result = replace(result, did=did, moves=moves).check(self.strict)
        # A run that diverged, was interrupted or failed is returned to be looked at, but the station stays as it was.
        if result.ending in GOES_ON:
            self.state = result.final_state
            self.timeline.now += result.stop_time
            self.tape.keep(Take(config, start, references, duration, result, stretches, entry))
        if self._window:
            self._window.add_paths(result)
        return result

    def follow_as(
        self,
        station: StationConfig,
        references: Mapping[str, ReferenceLike],
        duration: float,
        *,
        forget: str = "",
    ) -> SimulationResult:
        """Run references on another station for this run only. Afterwards, only its floor remains.

        Args:
            station: the other station, with the same robots.
            references: reference of each robot by name.
            duration: duration of the run [s].
            forget: name of a controller whose state is deleted afterwards, so that it begins anew next time. It is
                empty if all controllers keep their states.

        Returns:
            The result of the run. The next run begins where it ended if its ending is one of :data:`GOES_ON`.

        Raises:
            SimrobError: see :meth:`follow` and :meth:`change`.
        """
        # `change` marks the tape: no file can describe a run with a controller or gains of its own.
        own_station = self.config
        self.change(station)
        try:
            return self.follow(references, duration)
        finally:
            # A floor that had to become larger stays so: the robot may stand on the new part.
            self.change(own_station.model_copy(update={"floor": station.floor}))
            if forget and self.state is not None:
                forgotten = f"controller.{forget}"
                # The state of each block of the station, by the block's name.
                blocks = {
                    name: block for name, block in self.state.blocks.items() if name != forgotten
                }
                self.state = replace(self.state, blocks=blocks)

    @abstractmethod
    def planning(self, robot: str | None) -> Planning:
        """Prepare the planning of a move of an arm from its reference. None means the only robot of the station."""

    def take(
        self,
        piece: str,
        robot: str | None = None,
        *,
        frame: str | None = None,
        pose: PoseLike | None = None,
    ) -> None:
        """Attach a piece to a robot; see :meth:`attach`, also for the errors.

        If the tool in use is a piece, such as a gripper, the new piece is attached to it. Otherwise it is attached to
        the robot.

        Args:
            piece: name of the piece.
            robot: name of the robot. If it is None, the only robot of the station.
            frame: a frame of the piece that is the tool in use; or a tool or link of the robot, in place of its first
                tool.
            pose: pose of the piece in the frame of its new parent, to which it jumps. If it is None, the piece stays
                where it is, and must be near.
        """
        name = self.robot_name(robot)
        tool = self.model.tool_in_use(name)
        self.attach(piece, tool if tool in self.config.pieces else name, frame=frame, pose=pose)

    def wait(self, duration: float) -> SimulationResult:
        """Run the station for a time [s] while all robots hold their positions. With dynamics they come to rest."""
        return self.run(duration=duration)

    def play(self, duration: float) -> SimulationResult:
        """Run the station for a time [s] while all robots follow the references of its file, from where they are."""
        # The references depend on the station's file, so another station could not repeat them. A recording that has
        # runs already is no program from here on; one that begins with this run can still be one.
        self.tape.note(None)
        return self._run({}, seconds(duration), entry={"play": float(duration)}, did="play")

    def attach(
        self,
        piece: str,
        parent: str = WORLD,
        *,
        frame: str | None = None,
        pose: PoseLike | None = None,
    ) -> None:
        """Attach a piece to the world, a robot or another piece (SimRob's PegarEn).

        Without a `pose` the piece keeps its pose in the world, to rounding. The robot that takes the piece uses the
        piece's tool centre point from then on, unless the piece is on a link that is no tool; on a dynamic station it
        feels its weight. A robot that gives its tool away uses the tool that carried it, or else its first own tool.
        Velocities stay unchanged.

        Args:
            piece: name of the piece. Pieces that are attached to it stay attached.
            parent: ``world``, a robot (its flange), or a piece (its tool centre point).
            frame: a frame of the parent piece; or a tool or link of the robot, such as the trunk for a backpack. If it
                is None, the tool centre point of the piece, or the first tool of the robot.
            pose: pose of the piece in the parent's frame, to which it jumps from wherever it is. If it is None, the
                piece stays where it is.

        Raises:
            UnknownName: there is no such piece, parent or frame.
            InvalidParameter: the parent is the piece itself or one that is fixed on it; a frame of the world is named;
                a robot takes the piece without a ``pose`` from more than 30 mm away; or the ``pose`` is no pose, or in
                other units than m and rad.
        """
        # With a pose the piece may be anywhere: it is placed there. Without one the tool has to be near it.
        if pose is None:
            self._change(take_piece(self.model, piece, parent, frame=frame))
        else:
            check_units(pose_from_transform(as_transform(pose)), "pose")
            self._change(reparent_piece(self.model, piece, parent, frame=frame, pose=pose))
        numbers = None if pose is None else pose_numbers(pose)
        self.tape.note(
            {"attach": {"piece": piece, "parent": parent, "frame": frame, "pose": numbers}}
        )

    def release(
        self, piece: str, parent: str = WORLD, *, frame: str | None = None, fixed: bool = False
    ) -> None:
        """Release a piece, in the world or on another piece.

        In the world of a dynamic station the piece is free from then on: it starts with the velocity with which it was
        carried, falls, and comes to rest on what it meets. On another piece, and on a kinematic station, it is fixed
        where it is.

        Args:
            piece: name of the piece.
            parent: ``world``, or a piece on which it is fixed from then on.
            frame: a frame of that piece. If it is None, its tool centre point.
            fixed: whether the piece stays where it is in the world of a dynamic station, too, instead of falling.

        Raises:
            UnknownName: there is no such piece, parent or frame.
            InvalidParameter: the piece is attached to nothing; or it would fall forever, because there is no contact,
                no shape that collides or nothing below it; or it has no mass or inertia.
        """
        model = self.model
        state = self.state
        config = release_piece(model, piece, parent, frame=frame, fixed=fixed)
        if state is not None and config.pieces[piece].free:
            # The free joint of the piece starts with the velocity with which it was carried, so that a thrown piece
            # flies.
            state = replace(
                state, joints={**state.joints, free_joint(piece): model.motion(piece, state)}
            )
        # The station first, because the state has a joint that only the changed station has.
        self._change(config)
        self.state = state
        self.tape.note(
            {"release": {"piece": piece, "parent": parent, "frame": frame, "fixed": fixed}}
        )

    def tool(self, robot: str, tool: str | PoseLike) -> None:
        """Change the tool centre point of a robot; see :meth:`Arm.tool`.

        Args:
            robot: name of the robot.
            tool: name of a tool, a link or a carried piece; or a pose in the frame of the present tool centre point.

        Raises:
            UnknownName: the robot has no such tool or link.
            InvalidParameter: the value is no pose, or it is in other units than m and rad.
        """
        entry = self.config.robots[robot]
        station_robot = self.model.robots[robot]
        if isinstance(tool, str):
            one_of(
                message("programs.tool_of_robot", "tool of {robot}", robot=robot),
                tool,
                [*station_robot.tools, *station_robot.model.links],
            )
            # With an offset the tool centre point is the tool `tcp`: this name keeps the offset. The name of the tool
            # itself is another one, and deletes the offset.
            changes: dict[str, object] = (
                {} if tool == station_robot.tcp else {"tcp": tool, "tcp_offset": None}
            )
        else:
            offset = as_transform(tool)
            check_units(pose_from_transform(offset), "tool")
            # The pose is measured from the present tool centre point, so it is added to the offset that this point
            # has.
            before = (
                RigidTransform() if entry.tcp_offset is None else as_transform(entry.tcp_offset)
            )
            changes = {"tcp_offset": tuple(pose_from_transform(before @ offset).tolist())}
        robots = {**self.config.robots, robot: entry.model_copy(update=changes)}
        self._change(self.config.model_copy(update={"robots": robots}))
        own_tool = {"name": tool} if isinstance(tool, str) else {"pose": pose_numbers(tool)}
        self.tape.note({"tool": {**own_tool, "robot": None if self.config.only_robot else robot}})

    def limit_efforts(self, robot: str, efforts: Mapping[str, float]) -> None:
        """Set torque limits of some motors of a robot, by the names of their axes [N·m or N].

        The other motors keep theirs. The tape does not note the change.
        """
        self._change(with_efforts(self.config, self.robot(robot), efforts))

    def change(self, config: StationConfig) -> None:
        """Continue from this state with a changed station, such as one with other gains. An open window shows it.

        A recording that contains this change cannot be written as a program.

        Raises:
            InvalidParameter: the station has other robots, or is no StationConfig.
        """
        self._change(config)
        # No entry of a program's file can describe the change.
        self.tape.note(None)

    def _change(self, config: StationConfig) -> None:
        """Change the station, without a note on the tape; see :meth:`change`, also for the errors."""
        instance(
            config,
            "config",
            StationConfig,
            message("programs.loaded_station", "a StationConfig, as load_station() returns it"),
        )
        if list(config.robots) != list(self.config.robots):
            raise InvalidParameter(
                "config",
                list(config.robots),
                message(
                    "programs.of_station_with",
                    "that of a station with the robots {robots}",
                    robots=", ".join(self.config.robots),
                ),
            )
        # Built first: an error leaves the old station in place.
        model = StationModel(config)
        self.config = config
        self._model = model
        if self._window:
            self._window.draw(config, self._shown_state())

    def check_collisions(self, *plans: Plan) -> None:
        """Check that moves at the same time have no collision, while the other robots are at rest.

        Collisions of a robot whose plan leaves out the check do not count.

        Raises:
            PathCollision: bodies collide. The message names the first point.
        """
        # The same plans are often checked twice: when they are made, and when they run. Station, state and stretches
        # are never changed in place, and those of the last check are kept in memory: if all identities are the same,
        # nothing has changed since then.
        checked: list[object] = [self.config, self.state]
        for plan in plans:
            checked += [plan.robot, plan.stretches, plan.check]
        if [id(part) for part in checked] == [id(part) for part in self._collision_free]:
            return
        check_moves(self.collision_model, plans)
        self._collision_free = tuple(checked)

    @property
    def collision_model(self) -> StationModel:
        """The station's plant with collision shapes, with the robots placed at their references.

        Only fingers are where they are now, because a piece may keep them from their references.
        """
        model = self._model.colliding
        model.place_state(self.state, self.position, self.reference)
        return model

    def free_space(self, robots: Sequence[str]) -> FreeSpace:
        """Prepare the space in which robots that move at the same time have to avoid collisions.

        Args:
            robots: names of the robots that move. They begin at their references.

        Raises:
            StartInCollision: at its reference, a robot that moves overlaps another body by more than the tolerance.
        """
        return FreeSpace(self.collision_model, {robot: self.reference(robot) for robot in robots})

    def _shown_state(self) -> State:
        """State for the browser window. Before the first run, the robots are at rest in their initial postures."""
        if self.state is not None:
            return self.state
        robots = list(self.config.robots)
        return State(
            {robot: self.position(robot) for robot in robots},
            {robot: self.velocity(robot) for robot in robots},
            {robot: self.reference(robot) for robot in robots},
        )

    def runner_of(self, config: StationConfig) -> Runner:
        """Runner of a station, which simulates it. The last one is kept, because building it takes time."""
        if self._runner is None or self._runner.config != config:
            self._runner = Runner(config)
        return self._runner

    @property
    def on_step(self) -> OnStep | None:
        """Callback of each step of a run: the watcher, or else the browser window. It is None without either."""
        return self.watcher or (self._window.on_step if self._window else None)
