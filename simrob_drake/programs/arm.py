"""Program an arm by moves that have the names of RAPID: SimRob's class Kin, later Cin.

A :class:`Workcell` is a station with its state; several objects :class:`Arm` may share it. A *planner* plans moves
without running them: a *plan* is a move that was checked and can be run. The *reference* of a robot is where its axes
should be. A *cell* of an automatic program is a posture to which a controller leads the robot; it lasts until the
posture is reached. (An attribute or argument `cell` is a workcell.)
"""

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import PoseLike
from simrob_drake.base.messages import message
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.foresight import foresee
from simrob_drake.programs.geometry import ArmGeometry
from simrob_drake.programs.moves.joints import JointMove, move_of
from simrob_drake.programs.moves.kinds import move_from
from simrob_drake.programs.moves.motion import describe
from simrob_drake.programs.moves.move import MOVE_TIME, Move, move_name, naming
from simrob_drake.programs.moves.move_free import plan_move_free
from simrob_drake.programs.moves.move_j import plan_move_abs_j, plan_move_j
from simrob_drake.programs.moves.move_l import plan_move_c, plan_move_l
from simrob_drake.programs.moves.wait import PlayMove
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import Planning
from simrob_drake.programs.program import Program, pace_of, run_cells
from simrob_drake.programs.recorded import STATION, RecordedStation
from simrob_drake.programs.smooth_path import RateLimits
from simrob_drake.programs.stages import check_takes_time
from simrob_drake.programs.time_optimal import Motors
from simrob_drake.programs.timeline import following
from simrob_drake.results.record.run import MoveSpan
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike

P = ParamSpec("P")
Result = TypeVar("Result")


class Planner(Planning):
    """Plans and checks moves of one robot from where it is. Nothing moves.

    All moves begin at rest at the robot's reference, and rest at their end. With several targets, those with a ``zone``
    turn to the next target near each one, and others rest at each of them. Only ``move_abs_j`` and ``move_j`` without
    ``zone`` and ``stop`` pass the targets smoothly.
    """

    # As methods of a class, these functions get the planner as their first argument.
    move_abs_j = plan_move_abs_j
    move_j = plan_move_j
    move_l = plan_move_l
    move_c = plan_move_c
    move_free = plan_move_free

    def __repr__(self) -> str:
        return f"<Planner of {self.robot}: {self.chain!r}>"


def _method_that_runs(
    plan: Callable[Concatenate[Planning, P], Plan],
) -> "Callable[Concatenate[Arm, P], SimulationResult]":
    """Make a method of :class:`Arm` that plans a move by a function, and runs the plan.

    Args:
        plan: function that plans the move. Its first argument is the planner of the arm. The method has the other
            arguments of this function and, for `help`, its docstring without that argument.
    """

    @wraps(plan)
    def run(arm: "Arm", /, *targets: P.args, **how: P.kwargs) -> SimulationResult:
        return arm.cell.run(plan(arm.plan, *targets, **how))

    # `wraps` has copied the docstring of the planning function, whose first argument is the planning and not an arm.
    describe(run, plan)
    return run


def _method_of_cell(
    method: Callable[Concatenate[RecordedStation, P], Result],
) -> "Callable[Concatenate[Arm, P], Result]":
    """Make a method of :class:`Arm` that calls a method of its workcell, with the same arguments and docstring."""

    @wraps(method)
    def call(arm: "Arm", /, *arguments: P.args, **options: P.kwargs) -> Result:
        return method(arm.cell, *arguments, **options)

    return call


class Arm(ArmGeometry):
    """A robot of a station: kinematics and torques of its tool, and moves that run the station.

    Every move begins where the reference of the last one ended, rests at its end, and returns the result of the run. On
    a kinematic station the arm is then exactly there; on a dynamic one it is where its motors brought it, and the next
    run continues from that state. A move that cannot be done raises an error before anything moves. The options
    ``points``, ``duration``, ``times``, ``speed``, ``acceleration``, ``profile``, ``zone`` and ``check`` of moves are
    those of :class:`~simrob_drake.programs.timing.How`.

    Poses are those of the tool centre point, in the world unless a work object is given: pose vectors
    [x y z Rz Ry Rx], matrices (4, 4) or RigidTransforms, one or several; or places [x y z], which keep the orientation.
    A work object is the name of a piece (its tool centre point) or one of its frames as ``piece.frame``, the name of a
    robot or an arm (its tool centre point; for the arm itself, at its reference), or a pose in any form.

    Attributes:
        cell: the station and its state. Several arms may share it.
        name: name of the robot in the station.
        solver: solver of the inverse kinematics for calls that name none.
        references: cells that :meth:`add_reference` stored. ``references.clear()`` deletes them.
    """

    def __init__(
        self,
        station: "Workcell | StationLike",
        robot: str | None = None,
        tool: str | PoseLike | None = None,
        *,
        solver: SolverLike = "auto",
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        """Take a robot of a station.

        Args:
            station: a workcell; or name, file or configuration of a station, of which one is made.
            robot: name of the robot in the station. It may be None if the station has a single robot.
            tool: see :meth:`tool`. If it is None, the tool of the station.
            solver: ``auto``, ``numeric``, ``analytic``, ``incremental``, ``constrained``, or one made for ``chain``.
            overrides: new values of the station, as of :func:`simrob_drake.load_station`.

        Raises:
            UnknownName: there is no such station, robot or tool.
            InvalidParameter: the robot has no tool, or a base that moves; none is named and the station has no robot or
                several; or there are overrides for a workcell.
            SimrobError: kinematics do not support a joint of the robot.
        """
        # The base class has any station with state. An arm needs a workcell, which records its runs.
        self.cell: Workcell
        super().__init__(workcell_of(station, overrides), robot)
        self.solver = solver
        self.references: list[JointMove] = []
        model = self.cell.model.robots[self.name].model
        # Kinematics are computed from the world to the tool: a base that moves would move the whole path of the tool.
        if model.base != "fixed":
            raise InvalidParameter(
                "robot",
                model.name,
                message(
                    "programs.robot_on_fixed_base",
                    "a robot with a fixed base; LeggedRobot programs robots with legs",
                ),
            )
        if not self.cell.model.robots[self.name].tcp:
            raise InvalidParameter(
                "robot",
                model.name,
                message(
                    "programs.robot_with_tool",
                    "a robot with a tool frame, listed under tools in its robot.yaml",
                ),
            )
        if tool is not None:
            self.tool(tool)
        # Read for its error only: kinematics do not support every kind of joint, and a move is too late for the error.
        _ = self.chain

    def _description(self) -> list[str]:
        """Parts of the text that `repr` returns, with the present tool and its pose in the world."""
        pose = self.pose()
        # Adding 0 turns -0 into 0.
        position = pose[:3].round(6) + 0.0
        degrees = np.rad2deg(pose[3:]).round(6) + 0.0
        place = " ".join(f"{value:.4g}" for value in position)
        angles = " ".join(f"{value:.4g}" for value in degrees)
        tool = self.cell.model.robots[self.name].tcp
        return [*super()._description(), f"tool {tool} at {place} m, Rz Ry Rx {angles} deg"]

    def tool(self, tool: str | PoseLike) -> None:
        """Change the tool centre point (SimRob's Tool).

        Args:
            tool: name of one of :attr:`tools`, which are frames of the robot and pieces that it carries, or of a link;
                or a pose in the frame of the present tool, which makes an offset. A name other than ``tcp`` deletes an
                offset.

        Raises:
            UnknownName: there is no such tool.
            InvalidParameter: the value is no pose, or it is in other units than m and rad.
        """
        self.cell.tool(self.name, tool)

    @property
    def plan(self) -> Planner:
        """Planner whose methods plan the moves of this class. :meth:`Workcell.run` runs several plans at once."""
        robot = self.cell.robot(self.name)
        model = robot.model
        return Planner(
            robot=self.name,
            model=model,
            rate_limits=RateLimits(robot.speed_limits, model.accelerations),
            chain=self.chain,
            start=self.reference,
            solver=self.solver,
            frame=self.frame,
            collide=self.cell.check_collisions,
            # Functions of robots' names. Torques are computed in a plant in which free pieces are fixed.
            motors=lambda robots: Motors(self.cell.model.rigid, robots),
            space=self.cell.free_space,
        )

    def do(self, move: Move | Mapping[str, Any]) -> SimulationResult | None:
        """Perform a move of any kind, as in a program.

        Args:
            move: a move, or an entry of a program's file, such as ``{"move_l": [0.3, 0, 0.2]}``.

        Returns:
            The result of its run, or None if the move takes no time.

        Raises:
            SimrobError: the move has a wrong key or value, or cannot be done.
        """
        # A move returns what the function returns by which it runs its plans, here `run_plans`. Its type is not known
        # there.
        return cast(
            SimulationResult | None,
            move_from(move).perform(self.cell, self.name, self.cell.run_plans),
        )

    move_abs_j = _method_that_runs(plan_move_abs_j)
    """Move the axes to a posture (n,), or through several (k, n) [rad or m]; see :func:`plan_move_abs_j`."""
    move_j = _method_that_runs(plan_move_j)
    """Move the tool to poses, straight in the joints; see :func:`plan_move_j`."""
    move_l = _method_that_runs(plan_move_l)
    """Move the tool along straight lines; see :func:`plan_move_l`."""
    move_c = _method_that_runs(plan_move_c)
    """Move the tool along arcs of circles; see :func:`plan_move_c`."""
    move_free = _method_that_runs(plan_move_free)
    """Move the tool to a pose or a piece, or the axes to a posture, around obstacles; see :func:`plan_move_free`."""

    def grip(self, **how: Any) -> SimulationResult:
        """Close the fingers, until a piece is between them or to a ``width`` [m], with a ``force`` of each [N].

        They hold the piece by friction alone, and keep that force.

        Args:
            **how: keys of :class:`~simrob_drake.programs.moves.grip.GripMove`: ``width`` [m], ``force`` [N] and
                ``duration`` [s].

        Raises:
            InvalidParameter: the robot has no fingers, or they cannot close so far or so hard.
        """
        return cast(SimulationResult, self.do({"grip": how}))

    def open(self, **how: Any) -> SimulationResult:
        """Open the fingers as far as they can, or to a ``width`` [m]; see :meth:`grip`."""
        return cast(SimulationResult, self.do({"open": how}))

    wait = _method_of_cell(RecordedStation.wait)
    """Hold the position for a time [s]. On a dynamic station the arm comes to rest."""
    release = _method_of_cell(RecordedStation.release)
    """Release a piece, in the world or on another piece; see :meth:`Workcell.release`."""
    record = _method_of_cell(RecordedStation.record)
    """Delete the recording, and record all runs from now on (SimRob's ``Rec()``)."""
    pause = _method_of_cell(RecordedStation.pause)
    """Stop recording (``Rec(0)``)."""
    resume = _method_of_cell(RecordedStation.resume)
    """Continue recording (``Rec(1)``)."""
    replay = _method_of_cell(RecordedStation.replay)
    """Run the recorded moves again, each from its own start (``Rep()``). The arm stays where it is."""
    result = _method_of_cell(RecordedStation.result)
    """Join all recorded runs to one result; see :meth:`Workcell.result`."""
    save = _method_of_cell(RecordedStation.save)
    """Write the recording to a folder; see :meth:`Workcell.save`."""
    film = _method_of_cell(RecordedStation.film)
    """Write the recording as a film; see :meth:`Workcell.film`."""

    def attach(
        self,
        piece: str,
        parent: str | None = None,
        *,
        frame: str | None = None,
        pose: PoseLike | None = None,
    ) -> None:
        """Attach a piece to the arm or to another ``parent``; see :meth:`Workcell.attach`.

        Without ``parent``, the piece is attached to the tool in use if that is a piece itself. Otherwise it is attached
        to the robot: at ``frame``, or else at the robot's first tool.

        Args:
            piece: name of the piece.
            parent: ``world``, a robot or another piece. If it is None, the piece in use as tool, or else the robot.
            frame: a frame of the parent piece, or a tool or link of the robot.
            pose: pose of the piece in the parent's frame, to which it jumps. If it is None, the piece stays where it
                is, and must be near.
        """
        # The tool in use may be a piece that the robot carries, so only the station can find it.
        if parent is None:
            self.cell.take(piece, self.name, frame=frame, pose=pose)
        else:
            self.cell.attach(piece, parent, frame=frame, pose=pose)

    def add_reference(self, targets: npt.ArrayLike, duration: float = MOVE_TIME) -> None:
        """Store postures as cells for :meth:`simulate` with ``automatic`` (AddRef). Nothing moves.

        Args:
            targets: a posture (n,), or several (k, n) [rad or m].
            duration: duration of the way to each [s]. A cell lasts until its posture is reached.

        Raises:
            SimrobError: see :meth:`move_abs_j`. The postures are checked as a move from where the arm is.
        """
        # The plan is not run: planning checks limits and collisions.
        self.plan.move_abs_j(targets)
        rows = np.atleast_2d(self.chain.postures(targets, "targets"))  # one posture in each row
        # Cells are stored as in a program's file: in degrees, or in metres for axes that slide.
        values = rows / self.cell.robot(self.name).model.user_units
        # Each cell has a target for every axis, by the axis' name.
        self.references += [
            move_of(dict(zip(self.axes, row.tolist(), strict=True)), duration) for row in values
        ]

    def simulate(
        self,
        station: str | Path | StationConfig | None = None,
        *,
        duration: float | None = None,
        automatic: bool | Mapping[str, Any] = False,
        strict: bool = False,
    ) -> SimulationResult:
        """Do again all that was recorded, on this station or on another one; see :meth:`Workcell.simulate`.

        The arm itself stays where it is.

        Args:
            station: another station, such as the dynamic one. If it is None, the station of the recording.
            duration: duration of all runs together [s]. If it is None, as recorded.
            automatic: whether :attr:`references` run instead, from the station's start; or options for that, see
                :meth:`LeggedRobot.simulate`.
            strict: whether a run with warnings raises a :class:`~simrob_drake.base.errors.VerdictError`. It does, too,
                if the workcell is strict.

        Raises:
            Unsuitable: a duration is given for an automatic program, or there is nothing to run.
            SimrobError: the station cannot repeat the recording, see :meth:`Workcell.simulate`; or an automatic program
                cannot run, because the station is kinematic or a reference is beyond a limit.
        """
        # The name of a station, or its file, is loaded first, so that its errors come before any run.
        config = None if station is None else Workcell(station).config
        if automatic is False:
            return self.cell.simulate(config, duration=duration, strict=strict)
        # Each reference lasts until its posture is reached: no duration can be kept.
        if duration is not None:
            raise Unsuitable(
                "duration",
                message(
                    "programs.automatic_robot_times",
                    "an automatic program lasts as long as its references",
                ),
            )
        # A new workcell runs the references, so that this arm stays where it is.
        other = Workcell(self.cell.config if config is None else config)
        other.progress = self.cell.progress
        other.strict = self.cell.strict or strict
        return run_cells(Arm(other, self.name), self.references, pace_of(automatic))

    def show(self, q: npt.ArrayLike | None = None) -> str:
        """Open a browser window that shows all moves from now on.

        Args:
            q: posture (n,) [rad or m] that is shown without moving there. If it is None, the present one is shown.

        Returns:
            Address of the window on this computer.
        """
        if q is not None:
            self.cell.draw({self.name: self.chain.postures(q, "q")[0]})
        return self.cell.show()


def workcell_of(
    station: "Workcell | StationLike", overrides: Mapping[str, Any] | None
) -> "Workcell":
    """Find the workcell that a user means by a station: a given workcell itself, or a new one of a station.

    Args:
        station: a workcell, or a station from which one is made.
        overrides: new values of the station by key; None if there are none.

    Raises:
        Unsuitable: there are overrides for a workcell, whose station is in use already.
        SimrobError: there is no such station.
    """
    if not isinstance(station, Workcell):
        return Workcell(station, overrides)
    # A workcell has a state already. Other values would need another one.
    if overrides:
        raise Unsuitable(
            "overrides",
            message(
                "programs.given_with_workcell", "the workcell is loaded already, without overrides"
            ),
            message(
                "programs.overrides_of_workcell",
                "give them to the workcell: Workcell(station, overrides)",
            ),
        )
    return station


class Workcell(RecordedStation):
    """A station with arms, which share its state: see :class:`StatefulStation` and :class:`RecordedStation`."""

    def arm(
        self,
        name: str | None = None,
        tool: str | PoseLike | None = None,
        *,
        solver: SolverLike = "auto",
    ) -> Arm:
        """Make an arm of one of the station's robots.

        Args:
            name: name of the robot. It may be None if the station has a single robot.
            tool: see :meth:`Arm.tool`. If it is None, the tool of the station.
            solver: solver of the inverse kinematics for calls that name none.
        """
        return Arm(self, name, tool, solver=solver)

    def planning(self, robot: str | None) -> Planner:
        """Planner of a robot from its reference. None means the only robot of the station."""
        return self.arm(robot).plan

    def perform(self, program: Program | Path | str) -> SimulationResult:
        """Run a program of arms from the present state of the station.

        The program is checked before anything moves, up to a move that depends on what only a run shows, see
        :meth:`rehearse`. A run that does not complete (a monitor or the user ends it, it diverges, or a block fails) is
        the last one. If a move cannot be done, the station is left unchanged.

        Args:
            program: a program, or its YAML file; see :class:`Program`.

        Returns:
            All runs as one result.

        Raises:
            InvalidParameter: the program has no move that takes time, or has moves for legs.
            InvalidConfig: the file is damaged.
            SimrobError: a move cannot be done. The message names it.
        """
        instance(
            program,
            "program",
            (Program, Path, str),
            message("programs.a_program_or_yaml", "a Program or the path of its YAML file"),
        )
        if isinstance(program, Program):
            loaded = program
            file = ""
        else:
            loaded = Program.load(program)
            file = str(program)
        # Check the program on a copy, which is placed where each move leads.
        trial = Workcell(self.config)
        trial.state = self.state
        trial.rehearse(loaded, file)
        # What is restored if a move fails.
        config = self.config
        state = self.state
        # The state and the configuration are never changed in place: references to them are enough. The tape, the
        # recorded runs and changes, is changed in place, so its entries are copied.
        entries = list(self.tape.entries)
        try:
            # The changes of the program happen at their times while its moves run.
            with following(self, loaded.grid, loaded.changes):
                runs, spans = self._perform(loaded, file)
        except BaseException:
            self._change(config)
            self.state = state
            self.tape.entries = entries
            raise
        # The result is saved with the station in which it began, so its program refers to that file.
        text = loaded.on(STATION).text()
        return join_runs(
            runs, begun=(config, state), left=self.config, program=text, move_spans=spans
        )

    def rehearse(self, program: Program, file: str = "") -> tuple[int, float]:
        """Check that arms can do a program, as far as this can be known without a run.

        The robots of this workcell are put where each move leads them, without a simulation, and stay there at the end:
        call it on a copy. A free piece that fingers close on moves with them until they open. The check ends before a
        move that depends on what only a simulation shows: where a piece comes to rest that falls, or what the station's
        own references do.

        Args:
            program: the program.
            file: file of the program, for messages.

        Returns:
            the count of moves that were checked, and their duration [s].

        Raises:
            InvalidParameter: the program has no move that takes time.
            SimrobError: a move cannot be done; the message names the move.
        """
        check_takes_time(
            program.moves,
            file or message("programs.the_program", "the program"),
            message("programs.program_with_moves", "add one, such as move_abs_j"),
        )
        released: set[str] = set()  # free pieces whose place the moves before have changed
        dropped: set[str] = set()  # free pieces that fingers released in the air

        def stand(plans: list[Plan], duration: float | None) -> float:
            """Place the robots at the ends of plans, and note the dropped pieces. Returns the duration [s].

            The moves call it in place of the function that runs the plans.
            """
            time, dropped_now = self._stand(plans, duration)
            dropped.update(dropped_now)
            return time

        total_time = 0.0
        for number, move in enumerate(program.moves):
            depends_on_run = isinstance(move, PlayMove) or not released.isdisjoint(move.pieces())
            # A dropped piece is anywhere below: any motion may run into it.
            may_meet_dropped = bool(dropped) and move.takes_time
            # What comes then is checked when it runs, from the state that the run has left.
            if depends_on_run or may_meet_dropped:
                return number, total_time
            with naming(move_name(number, len(program.moves), file)):
                # A move that takes no time returns None.
                total_time += move.perform(self, program.robot, stand) or 0.0
            # Every move that names a free piece may have moved it: a later one would need its new place.
            released |= {name for name in self.config.free_pieces if name in move.pieces()}
        return len(program.moves), total_time

    def _perform(
        self, program: Program, file: str
    ) -> tuple[list[SimulationResult], list[MoveSpan]]:
        """Perform the moves of a program one after the other, up to one whose run is ended early.

        Args:
            program: the program.
            file: file of the program, for messages; empty if there is none.

        Returns:
            The runs, and the times at which each move began and ended, since the start of the first run. Moves that
            take no time have a span, but no run.

        Raises:
            SimrobError: a move cannot be done. The message names it. The moves before have been done.
        """
        runs: list[SimulationResult] = []
        spans: list[MoveSpan] = []
        now = 0.0
        # Whether results refer to moves by their numbers. A program that only plays the references of the station's
        # file has no moves that a user would know.
        is_named = not program.plays_references
        for number, move in enumerate(program.moves):
            try:
                with naming(move_name(number, len(program.moves), file)):
                    run = move.perform(self, program.robot, self.run_plans)
            # A piece that has slipped out of fingers lies where no plan expected it. The message then names this
            # cause.
            except PathCollision as problem:
                _explain_by_lost_piece(problem, runs)
                raise
            begin = now
            if run is not None:
                now = begin + run.stop_time
                runs.append(run.with_move_number(number) if is_named else run)
            spans.append(MoveSpan(index=number, begin=begin, end=now, is_named=is_named))
            # A monitor or the user has ended the run: the moves that follow would begin elsewhere.
            if run is not None and run.ending != "completed":
                break
        return runs, spans

    def run_plans(self, plans: list[Plan], duration: float | None) -> SimulationResult:
        """Run planned moves of a list, as :meth:`run` does, for a duration [s] or, if it is None, to the last end."""
        return self.run(*plans, duration=duration)

    def stand(self, plans: list[Plan], duration: float | None) -> float:
        """Put robots, and what their fingers hold, where moves lead them, without a simulation.

        Args:
            plans: the moves, which run at the same time. There may be none if a duration is given.
            duration: duration of the run [s]; if it is None, the run lasts until the last move ends.

        Returns:
            the duration of the run [s].

        Raises:
            SimrobError: the moves cannot be run at the same time, see :meth:`check_together`.
        """
        return self._stand(plans, duration)[0]

    def _stand(self, plans: list[Plan], duration: float | None) -> tuple[float, frozenset[str]]:
        """Do what :meth:`stand` does, and find out which pieces fingers dropped.

        Arguments and errors are those of :meth:`stand`.

        Returns:
            the duration of the run [s], and the names of the pieces that fingers released with nothing below them.
        """
        self.check_together(*plans)
        time = max(plan.duration for plan in plans) if duration is None else duration
        foresight = foresee(self, plans, time)
        self.state = foresight.state
        return time, foresight.dropped


def _explain_by_lost_piece(problem: PathCollision, runs: Sequence[SimulationResult]) -> None:
    """Add to the message of a refused move that its obstacle is a piece that slipped out of fingers in a move before.

    Args:
        problem: the error of the move, which is changed. It stays as it is if the obstacle is something else.
        runs: the runs of the moves before. Their verdicts have a warning `lost_piece` if a piece slipped.
    """
    # The most recent loss explains the collision best: a piece can be lost, gripped and lost again.
    for run in reversed(runs):
        for measure in run.verdict.measures:
            is_lost = measure.criterion.name == "lost_piece" and measure.warning
            # The subject of this measure is the piece. A run's `place` is the name of its move in messages.
            if is_lost and measure.worst.subject in problem.bodies:
                problem.add_lost_piece(measure.worst.subject, run.place)
                return
