"""Program an arm in the words of RAPID: SimRob's class Kin, later Cin."""

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
from simrob_drake.programs.stages import check_takes_time
from simrob_drake.programs.time_optimal import Motors
from simrob_drake.programs.timeline import following
from simrob_drake.results.record.run import MoveSpan
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike

P = ParamSpec("P")
Result = TypeVar("Result")


class Planner(Planning):
    """Plans moves of one robot from where it is, with everything checked; nothing moves.

    All moves begin at rest where the robot's reference is, and rest at their end; of several targets they rest at each
    unless they have a ``zone``, but for those of ``move_abs_j`` and ``move_j``, which pass through smoothly unless
    ``stop`` is set.
    """

    move_abs_j, move_j, move_l, move_c = plan_move_abs_j, plan_move_j, plan_move_l, plan_move_c
    move_free = plan_move_free

    def __repr__(self) -> str:
        return f"<Planner of {self.robot}: {self.chain!r}>"


def _running(plan: Callable[Concatenate[Planning, P], Plan]) -> "Callable[Concatenate[Arm, P], SimulationResult]":
    """Return the method of an arm that runs what ``plan`` plans."""

    @wraps(plan)
    def run(arm: "Arm", /, *targets: P.args, **how: P.kwargs) -> SimulationResult:
        return arm.cell.run(plan(arm.plan, *targets, **how))

    describe(run, plan)
    return run


def _of_cell(method: Callable[Concatenate[RecordedStation, P], Result]) -> "Callable[Concatenate[Arm, P], Result]":
    """Return the method of an arm that has its workcell do something."""

    @wraps(method)
    def ask(arm: "Arm", /, *arguments: P.args, **options: P.kwargs) -> Result:
        return method(arm.cell, *arguments, **options)

    return ask


class Arm(ArmGeometry):
    """A robot of a station: kinematics and torques of its tool, and moves that run the station.

    Every move begins where the reference of the last one ended, rests at its end, and returns the run. On a kinematic
    station the arm is then exactly there; on a dynamic one it is where its motors brought it, and goes on from that
    state. A move that cannot be done raises an error before anything moves. ``points``, ``duration``, ``times``,
    ``speed``, ``acceleration``, ``profile``, ``zone`` and ``check`` of moves are those of
    :class:`~simrob_drake.programs.timing.How`.

    Poses are those of the tool centre point, in the world unless a work object is given: pose vectors
    [x y z Rz Ry Rx], matrices (4, 4), RigidTransforms, one or many; or places [x y z], which keep the orientation.
    A work object is a piece's name (its tool centre point) or one of its frames as ``piece.frame``, a robot's name or
    an arm (its tool centre point; an arm's own is where its reference is), or a pose in any form.

    Attributes:
        cell: the station and its state; several arms may share it.
        name: of the robot in the station.
        solver: of the inverse kinematics, where a call names none.
        references: the cells that :meth:`add_reference` stored; ``clear()`` forgets them.
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
            station: a workcell, or what makes one: a station's name, file or configuration.
            robot: its name in the station; needed where there are several.
            tool: see :meth:`tool`.
            solver: ``auto``, ``numeric``, ``analytic``, ``incremental``, ``constrained``, or one made for ``chain``.
            overrides: new values of the station, as :func:`simrob_drake.load_station` takes them.

        Raises:
            UnknownName: no such station, robot or tool.
            InvalidParameter: a robot without a tool, or on a base that moves.
        """
        self.cell: Workcell
        super().__init__(workcell_of(station, overrides), robot)
        self.solver = solver
        self.references: list[JointMove] = []
        model = self.cell.model.robots[self.name].model
        if model.base != "fixed":
            raise InvalidParameter(
                "robot",
                model.name,
                message("programs.robot_on_fixed_base", "one on a fixed base; LeggedRobot programs those with legs"),
            )
        if not self.cell.model.robots[self.name].tcp:
            raise InvalidParameter(
                "robot",
                model.name,
                message("programs.robot_with_tool", "one with a tool frame, under tools: in its robot.yaml"),
            )
        if tool is not None:
            self.tool(tool)
        _ = self.chain  # of joints that can be followed

    def _described(self) -> list[str]:
        values = np.append(self.pose()[:3], np.rad2deg(self.pose()[3:])).round(6) + 0.0  # no -0
        place, angles = (" ".join(f"{value:.4g}" for value in part) for part in (values[:3], values[3:]))
        tool = self.cell.model.robots[self.name].tcp
        return [*super()._described(), f"tool {tool} at {place} m, Rz Ry Rx {angles} deg"]

    def tool(self, tool: str | PoseLike) -> None:
        """Change the tool centre point (SimRob's Tool).

        Args:
            tool: one of :attr:`tools`, a frame of the robot or a piece that it carries, or any link; or a pose in the
                frame of the tool that it has now.

        Raises:
            UnknownName: no such tool.
        """
        self.cell.tool(self.name, tool)

    @property
    def plan(self) -> Planner:
        """Plan moves without running them: the methods of the same names; :meth:`Workcell.run` runs several at once."""
        robot = self.cell.robot(self.name)
        model = robot.model
        return Planner(
            robot=self.name,
            model=model,
            rate_limits=(robot.speed_limits, model.accelerations),
            chain=self.chain,
            start=self.reference,
            solver=self.solver,
            frame=self.frame,
            collide=self.cell.check_collisions,
            motors=lambda robots: Motors(self.cell.model.rigid, robots),
            space=self.cell.free_space,
        )

    def do(self, move: Move | Mapping[str, Any]) -> SimulationResult | None:
        """Do a move of any kind, as a program does it, and return its run; None of one that takes no time.

        Args:
            move: one, or what would stand in a program's file, such as ``{"move_l": [0.3, 0, 0.2]}``.

        Raises:
            SimrobError: it is wrong, or cannot be done.
        """
        return cast(SimulationResult | None, move_from(move).perform(self.cell, self.name, self.cell.run_plans))

    move_abs_j = _running(plan_move_abs_j)
    """Move the axes to a posture (n,), or through many (k, n) [rad or m]; see :func:`plan_move_abs_j`."""
    move_j = _running(plan_move_j)
    """Move the tool to poses the easiest way, straight in the joints; see :func:`plan_move_j`."""
    move_l = _running(plan_move_l)
    """Move the tool along straight lines; see :func:`plan_move_l`."""
    move_c = _running(plan_move_c)
    """Move the tool along arcs of circles; see :func:`plan_move_c`."""
    move_free = _running(plan_move_free)
    """Move the tool to a pose or a piece, or the axes to a posture, around obstacles; see :func:`plan_move_free`."""

    def grip(self, **how: Any) -> SimulationResult:
        """Close the fingers, until something is between them, with a ``force`` each [N], or to a ``width`` [m].

        They hold by friction alone, and keep that force. Keywords are the keys of
        :class:`~simrob_drake.programs.moves.grip.GripMove`.

        Raises:
            InvalidParameter: a robot without fingers, or what they cannot do.
        """
        return cast(SimulationResult, self.do({"grip": how}))

    def open(self, **how: Any) -> SimulationResult:
        """Open the fingers, all the way or to a ``width`` [m]; see :meth:`grip`."""
        return cast(SimulationResult, self.do({"open": how}))

    wait = _of_cell(RecordedStation.wait)
    """Hold the place for a time [s]; on a dynamic station the arm settles."""
    release = _of_cell(RecordedStation.release)
    """Let go of a piece, in the world or on another piece; see :meth:`Workcell.release`."""
    record = _of_cell(RecordedStation.record)
    """Forget what was recorded, and record everything from now on (SimRob's ``Rec()``)."""
    pause = _of_cell(RecordedStation.pause)
    """Stop recording (``Rec(0)``)."""
    resume = _of_cell(RecordedStation.resume)
    """Go on recording (``Rec(1)``)."""
    replay = _of_cell(RecordedStation.replay)
    """Run the recorded moves again, each from the state that it began in (``Rep()``); the arm stays where it is."""
    result = _of_cell(RecordedStation.result)
    """Return all that was recorded as one result; see :meth:`Workcell.result`."""
    save = _of_cell(RecordedStation.save)
    """Write all that was recorded to a folder; see :meth:`Workcell.save`."""
    film = _of_cell(RecordedStation.film)
    """Write all that was recorded as a film; see :meth:`Workcell.film`."""

    def attach(
        self, piece: str, parent: str | None = None, *, frame: str | None = None, pose: PoseLike | None = None
    ) -> None:
        """Take a piece with the tool that the arm has now, or hang it on ``parent``; see :meth:`Workcell.attach`."""
        if parent is None:
            self.cell.take(piece, self.name, frame=frame, pose=pose)
        else:
            self.cell.attach(piece, parent, frame=frame, pose=pose)

    def add_reference(self, targets: npt.ArrayLike, duration: float = MOVE_TIME) -> None:
        """Store a posture (n,), or many (k, n) [rad or m], as cells for :meth:`simulate` with ``automatic`` (AddRef).

        Nothing moves. A cell lasts until it is reached; ``duration`` [s] is that of the way there.

        Raises:
            SimrobError: as :meth:`move_abs_j`; they are looked at as moves from where the arm is.
        """
        self.plan.move_abs_j(targets)
        rows = np.atleast_2d(self.chain.postures(targets, "targets"))
        values = rows / self.cell.robot(self.name).model.user_units
        self.references += [move_of(dict(zip(self.axes, row.tolist(), strict=True)), duration) for row in values]

    def simulate(
        self,
        station: str | Path | StationConfig | None = None,
        *,
        duration: float | None = None,
        automatic: bool | Mapping[str, Any] = False,
        strict: bool = False,
    ) -> SimulationResult:
        """Do again all that was recorded, on this station or another; see :meth:`Workcell.simulate`. The arm stays.

        Args:
            station: another one, such as the dynamic one.
            duration: of the whole [s].
            automatic: run :attr:`references` instead, from the station's start and in the robot's own time; see
                :meth:`LeggedRobot.simulate`.
            strict: a run with warnings raises a :class:`~simrob_drake.base.errors.VerdictError`.
        """
        config = None if station is None else Workcell(station).config
        if automatic is False:
            return self.cell.simulate(config, duration=duration, strict=strict)
        if duration is not None:
            raise Unsuitable(
                "duration",
                message("programs.automatic_robot_times", "an automatic robot takes the time of its own references"),
            )
        other = Workcell(self.cell.config if config is None else config)
        other.progress, other.strict = self.cell.progress, self.cell.strict or strict
        return run_cells(Arm(other, self.name), self.references, pace_of(automatic))

    def show(self, q: npt.ArrayLike | None = None) -> str:
        """Open a browser window that shows all moves from now on, and return its address on this computer.

        Args:
            q: a posture (n,) to show, without moving there.
        """
        if q is not None:
            self.cell.draw({self.name: self.chain.postures(q, "q")[0]})
        return self.cell.show()


def workcell_of(station: "Workcell | StationLike", overrides: Mapping[str, Any] | None) -> "Workcell":
    """Find the workcell that a user means by a station.

    Args:
        station: a workcell, or a station from which one is made.
        overrides: new values of the station; None if there are none.

    Raises:
        Unsuitable: there are overrides for a workcell, whose station is in use already.
        SimrobError: there is no such station.
    """
    if not isinstance(station, Workcell):
        return Workcell(station, overrides)
    if overrides:
        raise Unsuitable(
            "overrides",
            message("programs.given_with_workcell", "given with a workcell"),
            message("programs.overrides_of_workcell", "given to the workcell: Workcell(station, overrides)"),
        )
    return station


class Workcell(RecordedStation):
    """A station with arms, which share its state: see :class:`StatefulStation` and :class:`RecordedStation`."""

    def arm(self, name: str | None = None, tool: str | PoseLike | None = None, *, solver: SolverLike = "auto") -> Arm:
        """Return one of the station's robots, to be programmed.

        Args:
            name: of the robot; needed where there are several.
            tool: see :meth:`Arm.tool`.
            solver: of the inverse kinematics, where a move names none.
        """
        return Arm(self, name, tool, solver=solver)

    def planning(self, robot: str | None) -> Planner:
        """Return what plans moves of an arm from where it is; the only one need not be named."""
        return self.arm(robot).plan

    def perform(self, program: Program | Path | str) -> SimulationResult:
        """Do a program of arms from the state that the station is in, and return all of it as one result.

        All of it is looked at before anything moves, up to a move that depends on where a piece comes to rest. A run
        that does not go to its end, as a monitor ends it, is the last. What cannot be done leaves all as it was.

        Args:
            program: one, or the YAML file of one; see :class:`Program`.

        Raises:
            InvalidParameter: a program without a move that takes time, or with moves for legs.
            InvalidConfig: a damaged file.
            SimrobError: what the arms cannot do; names the move.
        """
        instance(
            program,
            "program",
            (Program, Path, str),
            message("programs.a_program_or_yaml", "a Program, or the YAML file of one"),
        )
        loaded, file = (program, "") if isinstance(program, Program) else (Program.load(program), str(program))
        trial = Workcell(self.config)
        trial.state = self.state
        trial.rehearse(loaded, file)
        config, state, entries = self.config, self.state, list(self.tape.entries)
        try:
            with following(self, loaded.grid, loaded.changes):
                runs, spans = self._perform(loaded, file)
        except BaseException:
            self._change(config)
            self.state, self.tape.entries = state, entries
            raise
        text = loaded.on(STATION).text()
        return joined(runs, begun=(config, state), left=self.config, program=text, move_spans=spans)

    def rehearse(self, program: Program, file: str = "") -> tuple[int, float]:
        """Check that arms can do a program, as far as this can be known without a run.

        The robots are put where each move leads them, without a simulation, and stay there at the end. A free piece
        that fingers close on moves with them until they open. The check ends before a move that depends on what only
        a simulation shows: where a piece comes to rest that falls, or what the station's own references do.

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
            message("programs.program_with_moves", "one with moves, such as move_abs_j"),
        )
        released: set[str] = set()  # free pieces whose place the moves before have changed
        dropped: set[str] = set()  # free pieces that fingers released in the air

        def stand(plans: list[Plan], duration: float | None) -> float:
            time, dropped_now = self._stand(plans, duration)
            dropped.update(dropped_now)
            return time

        total_time = 0.0
        for number, move in enumerate(program.moves):
            depends_on_run = isinstance(move, PlayMove) or not released.isdisjoint(move.pieces())
            # A dropped piece is anywhere below: any motion may run into it.
            may_meet_dropped = bool(dropped) and move.takes_time
            if depends_on_run or may_meet_dropped:
                return number, total_time
            with naming(move_name(number, len(program.moves), file)):
                total_time += move.perform(self, program.robot, stand) or 0.0
            released |= {name for name in self.config.free_pieces if name in move.pieces()}
        return len(program.moves), total_time

    def _perform(self, program: Program, file: str) -> tuple[list[SimulationResult], list[MoveSpan]]:
        """Do the moves of a program one after the other, up to one whose run does not go to its end.

        Returns:
            the runs, and when each move began and ended.
        """
        runs: list[SimulationResult] = []
        spans: list[MoveSpan] = []
        now = 0.0
        is_named = not program.plays_references
        for number, move in enumerate(program.moves):
            try:
                with naming(move_name(number, len(program.moves), file)):
                    run = move.perform(self, program.robot, self.run_plans)
            except PathCollision as problem:
                _explain_by_lost_piece(problem, runs)
                raise
            begin = now
            if run is not None:
                now = begin + run.stop_time
                runs.append(run.numbered(number) if is_named else run)
            spans.append(MoveSpan(index=number, begin=begin, end=now, is_named=is_named))
            if run is not None and run.ending != "completed":
                break
        return runs, spans

    def run_plans(self, plans: list[Plan], duration: float | None) -> SimulationResult:
        """Run planned moves of a list, as :meth:`run` does, for a duration [s] if there is one."""
        return self.run(*plans, duration=duration)

    def stand(self, plans: list[Plan], duration: float | None) -> float:
        """Put robots, and what their fingers hold, where moves lead them, without a simulation.

        Args:
            plans: the moves, which run at the same time.
            duration: duration of the run [s]; if it is None, the run lasts until the last move ends.

        Returns:
            the duration of the run [s].
        """
        return self._stand(plans, duration)[0]

    def _stand(self, plans: list[Plan], duration: float | None) -> tuple[float, frozenset[str]]:
        """Do what :meth:`stand` does, and find out which pieces fingers dropped.

        Returns:
            the duration of the run [s], and the names of the pieces that fingers released with nothing below them.
        """
        self.check_together(*plans)
        time = max(plan.duration for plan in plans) if duration is None else duration
        foresight = foresee(self, plans, time)
        self.state = foresight.state
        return time, foresight.dropped


def _explain_by_lost_piece(problem: PathCollision, runs: Sequence[SimulationResult]) -> None:
    """Add to a refused move that its obstacle is a piece that slipped out of fingers in a move before.

    Args:
        problem: the error of the move. It stays as it is if the obstacle is something else.
        runs: the runs of the moves before.
    """
    for run in reversed(runs):
        for measure in run.verdict.measures:
            is_lost = measure.criterion.name == "lost_piece" and measure.warning
            if is_lost and measure.worst.subject in problem.bodies:
                problem.add_lost_piece(measure.worst.subject, run.place)
                return
