"""Program a robot with legs by joint angles and gaits: SimRob's class Hum.

Each method that moves the robot runs the station and returns the result. A robot can store moves in its *program*, run
it again from the start, and undo what was done last.

A *stage* is a part of a program that is one run, such as a walk, or an action that takes no time, such as attaching a
piece. In an *automatic* program a controller, the sequencer, leads the robot to references, also called *cells*. (The
attribute `cell` is something else: the station with its state, a workcell.)
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from simrob_drake.base.arguments import instance, truth
from simrob_drake.base.errors import Unsuitable, format_count
from simrob_drake.base.frames import PoseLike, as_transform, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.arm import Workcell, workcell_of
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.get_up import GetUpMove
from simrob_drake.programs.moves.joints import move_of, targets_on
from simrob_drake.programs.moves.kinds import (
    ActMove,
    AttachMove,
    GoMove,
    JointMove,
    ReleaseMove,
    WalkMove,
    move_from,
)
from simrob_drake.programs.moves.move import MOVE_TIME, Move, make_move
from simrob_drake.programs.moves.walk import GO_TIME
from simrob_drake.programs.program import Program
from simrob_drake.programs.stages import (
    ProgramStage,
    Snapshot,
    check_program,
    joint_reference,
    leg_moves,
    stages_of,
    step_moves,
)
from simrob_drake.programs.stages import stages_of_program as program_stages
from simrob_drake.programs.stateful_station import GOES_ON
from simrob_drake.programs.timeline import following
from simrob_drake.results.record.run import MoveSpan, robot_that_fell
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.simulation import ReferenceLike
from simrob_drake.stations.station import StationLike


class LeggedRobot(LeggedGeometry):
    """A robot with legs that is programmed by joint angles and gaits.

    Axes are named by their names or aliases, and angles are absolute and in degrees. The axes of a move move at the
    same time, at constant speed on a dynamic station and with continuous acceleration on a kinematic one. Axes that a
    move does not name stay at their references. Every run continues from the state that the last one left: joints,
    velocities, pose of the trunk.

    A move that cannot be done raises an error before anything moves, and leaves robot and program unchanged. A run that
    diverges, is interrupted, ends because a block fails, or is ended by a monitor of a fall leaves them unchanged, too,
    but raises no error: nothing of it is stored, and there is nothing to undo; the ``message`` of its result has the
    reason. A run that another monitor ends counts as done.

    Changes of the program move nothing.

    Attributes of :class:`LeggedGeometry`, and:
        program: the stored moves and cells.
        runs: results of the runs of the last move or program, in their order.
        move_spans: times at which each of its moves began and ended, since the start of the first run.
    """

    def __init__(
        self,
        station: "Workcell | StationLike",
        robot: str | None = None,
        *,
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        """Take a robot of a station.

        Args:
            station: a workcell; or name, file or configuration of a station, of which one is made.
            robot: name of the robot in the station. It may be None if the station has a single robot.
            overrides: new values of the station, as of :func:`simrob_drake.load_station`.

        Raises:
            UnknownName: there is no such station or robot.
            InvalidParameter: the station has no robot, or it has several and none is named.
            Unsuitable: there are overrides for a workcell.
        """
        super().__init__(workcell_of(station, overrides), robot)
        # A saved program names the station, unless no name gives this very station.
        self._station_name: str | None = None
        if isinstance(station, str | Path) and not overrides:
            is_file = is_yaml_name(str(station))
            self._station_name = str(Path(station).absolute()) if is_file else str(station)
        self.program = Program()
        # The station at the start, to which `reset` and `simulate` return: attached pieces change the present one.
        self._start = self.cell.config
        self.runs: list[SimulationResult] = []
        self.move_spans: list[MoveSpan] = []
        # States to which `undo` returns, the most recent one at the end.
        self._past: list[Snapshot] = []

    def _description(self) -> list[str]:
        """Parts of the text that `repr` returns, with the feet and the length of the program."""
        feet = [] if self.worn_feet is None else [f"feet {self.worn_feet}"]
        return [
            *super()._description(),
            *feet,
            f"program of {format_count(len(self.program.moves), 'move')}",
        ]

    def do(self, move: Move | Mapping[str, Any], *, store: bool = False) -> SimulationResult | None:
        """Perform a move of any kind from the last state.

        Args:
            move: a move, or an entry of a program's file, such as ``{"act": "bow"}``.
            store: whether the move is stored at the end of the program.

        Returns:
            The result of its run, or None if the move takes no time.

        Raises:
            SimrobError: the move has a wrong key or value, or cannot be done.
        """
        # One move has at most one run.
        runs = self._perform_moves([move_from(move)], store=store)
        return runs[-1] if runs else None

    def test_move(
        self, target_deg: Mapping[str, float], duration: float = MOVE_TIME
    ) -> SimulationResult:
        """Move axes from the last state without storing the move (TestMove). :meth:`undo` returns to the state before.

        Args:
            target_deg: target of each axis by name or alias [deg].
            duration: duration of the move [s].

        Raises:
            UnknownName: there is no such axis. The message proposes the nearest name.
            JointLimitExceeded: a target is beyond a limit. The message names the axis and the excess.
            InvalidParameter: an angle is no number, or the duration is not positive.
        """
        return self._run(move_of(target_deg, duration))

    def add_move(
        self, target_deg: Mapping[str, float], duration: float = MOVE_TIME
    ) -> SimulationResult:
        """Move axes from the last state, and store the move at the end of the program (AddMove).

        The move is not stored if the run diverges, fails, is interrupted or ends in a fall. For arguments and errors
        see :meth:`test_move`.
        """
        return self._run(move_of(target_deg, duration), True)

    def step(self, move_time: float | None = None) -> SimulationResult:
        """Take one step ahead, and store it (Paso).

        A robot whose ``gaits.yaml`` has a sequence ``step`` goes through its postures by moves of joints. That of the
        humanoid of MATLAB is the step of the thesis with the left leg (p. 94): four moves, made for its large feet.
        Other robots, and this one on much smaller feet, take one step of full length by the first gait for their feet,
        and bring their feet together.

        Args:
            move_time: duration of each of the moves, or of each step of the gait [s]; the thesis has 1 s. If it is
                None, that of the sequence or the gait.

        Raises:
            SimrobError: see :meth:`walk`; or the time is not positive.

        Returns:
            The result of the run.
        """
        moves = step_moves(self.model, self.worn_feet, move_time)
        return self._perform_moves(moves, store=True)[-1]

    def walk(
        self,
        steps: int,
        amplitude: float = 1.0,
        gait: str | None = None,
        *,
        store: bool = False,
        **changes: Any,
    ) -> SimulationResult:
        """Walk from the last state (Marcha).

        The robot first moves into the posture in which its gait begins, in up to 2.5 s. If it is in this posture, it
        walks at once. While it walks, the gains of the servos are those of the gait if it has any, and steps of the
        scheme `cenic` are at most 5 ms. The floor becomes as large as the walk needs, and stays so.

        Args:
            steps: count of full steps ahead. The steps of the ramps (``ramp_steps``) and the last one, which brings the
                feet together, come in addition. For a crawl, the count of legs that swing.
            amplitude: factor of the step length and, if the gait has them, of the distance sideways and the turn. For a
                march, of how far all joints move.
            gait: a walk, trot, crawl or march of the robot's ``gaits.yaml``. If it is None, the first one for its feet.
            store: whether the walk is stored at the end of the program.
            **changes: values of other parameters of the gait, such as ``step_time``.

        Raises:
            UnknownName: there is no such gait, or it has no such parameter. The message proposes the nearest name.
            OutOfReach, JointLimitExceeded: the legs cannot do the steps. The message has the excess.
            SimrobError: the gait needs other feet or another station, or a parameter has an invalid value.
        """
        return self._run(
            make_move(WalkMove, steps=steps, amplitude=amplitude, gait=gait, **changes), store
        )

    def go(
        self,
        ahead: float = 0.0,
        sideways: float = 0.0,
        turn: float = 0.0,
        duration: float = GO_TIME,
        *,
        strict: bool = False,
        store: bool = False,
    ) -> SimulationResult:
        """Walk at a commanded speed from the last state. Each step is decided during the walk, from measurements.

        The robot does not stop at the end: another call continues in the middle of the step, and one without speeds
        stops the robot.

        Args:
            ahead: speed ahead [m/s].
            sideways: speed to the left [m/s].
            turn: turning speed to the left [rad/s].
            duration: duration of the walk [s].
            strict: whether a command that the legs cannot follow is an error. Otherwise it is clipped, with a warning.
            store: whether the walk is stored at the end of the program.

        Raises:
            InvalidParameter: a value is invalid, or `strict` is True and the legs cannot follow the command.
            SimrobError: the robot does not stand on feet of its own or has no such walk, or the station is kinematic.
        """
        return self._run(GoMove.at(ahead, sideways, turn, duration=duration, strict=strict), store)

    def act(self, name: str, *, store: bool = False, **changes: Any) -> SimulationResult:
        """Go through a sequence of postures from the last state, or stand on three legs.

        The robot first moves into the first posture, in up to 2.5 s. If it is in this posture, it begins at once.

        Args:
            name: one of the sequences and stands of the robot's ``gaits.yaml``, such as ``bow``.
            store: whether the act is stored at the end of the program.
            **changes: values of its parameters, such as ``repeat``, or ``foot`` of ``three_legs``.

        Raises:
            SimrobError: see :meth:`walk`.
        """
        return self._run(make_move(ActMove, name=name, **changes), store)

    def get_up(self, *, attempts: int = 5, store: bool = False) -> SimulationResult:
        """Get up where the robot has fallen. The ``message`` of the result has the outcome.

        Args:
            attempts: largest count of attempts.
            store: whether the move is stored at the end of the program.

        Raises:
            InvalidParameter: the count is invalid.
            SimrobError: the robot's ``gaits.yaml`` has no postures for getting up, the robot does not stand on feet of
                its own, or the station is kinematic.
        """
        return self._run(make_move(GetUpMove, attempts=attempts), store)

    def attach(
        self,
        piece: str,
        tool: str | None = None,
        *,
        pose: PoseLike | None = None,
        store: bool = False,
    ) -> None:
        """Attach a piece to a tool of the robot; see :meth:`Workcell.attach`.

        Args:
            piece: name of the piece.
            tool: one of :attr:`tools`, such as ``left_hand``, or a link, such as ``trunk``. If it is None, the first
                tool: the right hand of a humanoid, the trunk of a quadruped.
            pose: pose of the piece in the frame of the tool. If it is None, the piece stays where it is.
            store: whether the move is stored at the end of the program.

        Raises:
            UnknownName: there is no such piece or tool. The message proposes the nearest name.
            InvalidParameter: the piece is more than 30 mm away, and no pose is given.
        """
        # A move stores numbers, as a program's file does, so that the pose can be saved.
        pose_numbers = None if pose is None else pose_from_transform(as_transform(pose))
        self.do(make_move(AttachMove, piece=piece, tool=tool, pose=pose_numbers), store=store)

    def release(
        self, piece: str, parent: str = WORLD, *, fixed: bool = False, store: bool = False
    ) -> None:
        """Release a piece, in the world or on another piece; see :meth:`Workcell.release`, also for the errors.

        ``store`` says whether the move is stored at the end of the program.
        """
        self.do(make_move(ReleaseMove, piece=piece, parent=parent, fixed=fixed), store=store)

    def run(self, program: Program | Path | str) -> SimulationResult:
        """Run another program from the last state, without storing its moves.

        Args:
            program: a program, or its YAML file. It may have been made with another robot.

        Returns:
            The result of its last run. :attr:`runs` has all of them.

        Raises:
            SimrobError: the program has no moves, the file is damaged, or a move cannot be done. The message names it.
        """
        instance(
            program,
            "program",
            (Program, Path, str),
            message("programs.a_program_or_yaml", "a Program or the path of its YAML file"),
        )
        loaded = program if isinstance(program, Program) else Program.load(program)
        # Messages name the file only if the program was read from one.
        file = "" if loaded is program else str(program)
        with following(self.cell, loaded.grid, loaded.changes):
            return self._perform(program_stages(self, loaded, self.cell.config, file))[-1]

    def reference_of(self, program: Program) -> tuple[ReferenceLike, float]:
        """Make the reference for a program of moves of joints from where the robot is. Nothing moves.

        ``cell.follow({robot.name: reference, ...}, duration)`` runs the references of several robots at the same time.

        Args:
            program: the program.

        Returns:
            The reference, and its duration [s].

        Raises:
            SimrobError: see :meth:`run`; or the program has a walk, an act or a piece.
        """
        instance(program, "program", Program, message("programs.a_program", "a Program"))
        return joint_reference(self, leg_moves(program))

    def simulate(
        self, *, automatic: bool | Mapping[str, Any] | None = None, strict: bool = False
    ) -> SimulationResult:
        """Run the stored program from the start of the station (Sim). The next move continues from its end.

        Moves of joints that follow each other are one run, and so is each walk and act, which has its own gains and
        solver. Pieces are attached and released between runs. A monitor that ends a run ends the program. If the last
        run diverges, fails, is interrupted or ends in a fall, the next move continues from the state before the
        program.

        In an automatic program a sequencer leads the robot to the references, to each one when the joints have reached
        the one before. The ``cells`` of the result have the times. A reference that takes longer than the time-out ends
        the run.

        Args:
            automatic: whether the references run instead of the moves; or options for that, such as
                ``{"tolerance_deg": 3, "timeout": 20}``, the keys of
                :class:`~simrob_drake.programs.program.Automatic`. If it is None, the program's own key `automatic`
                decides.
            strict: whether a run with warnings raises a ``VerdictError``, and leaves robot and program unchanged.

        Returns:
            The result of the last run. :attr:`runs` has all of them, and :meth:`film` shows them as one.

        Raises:
            SimrobError: the program is empty, or a move cannot be done from the start. The message names it.
        """
        # The argument overrides what the program itself has under `automatic`.
        program = self.program if automatic is None else self.program.with_automatic(automatic)
        with following(self.cell, program.grid, program.changes, strict=truth(strict, "strict")):
            return self._perform(program_stages(self, program, self._start), from_start=True)[-1]

    def add_reference(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> None:
        """Store targets as a cell for :meth:`simulate` with ``automatic`` (AddRef). Nothing moves.

        A cell lasts until its targets are reached. For the errors see :meth:`test_move`.

        Args:
            target_deg: target of each axis by name or alias [deg]. Axes that are left out stay.
            duration: duration of the way to the targets [s].
        """
        move = move_of(target_deg, duration)
        # Called for its errors: the targets are converted again when the cells run.
        targets_on(
            self.model,
            move.target_deg,
            message("programs.the_reference", "the reference"),
            move.duration,
        )
        # Only a valid cell becomes a step for `undo`.
        self._remember()
        self.program = self.program.with_reference(move)

    def remove(self, index: int = -1) -> None:
        """Remove a stored move from the program, by default the last one. The robot stays where it is.

        Args:
            index: index of the move, from 0. Negative indices count from the end.

        Raises:
            InvalidParameter: the index is out of range.
        """
        program = self.program.without_move(index)
        self._remember()
        self.program = program

    def edit(
        self,
        index: int,
        move: Move | Mapping[str, Any] | None = None,
        duration: float | None = None,
    ) -> None:
        """Change a stored move. The robot stays where it is.

        Args:
            index: index of the move, from 0. Negative indices count from the end.
            move: new targets [deg] or a new move, see :meth:`insert`. If it is None, only the duration changes.
            duration: new duration of a move of joints [s]. If it is None, the duration stays; it is 1 if targets
                replace another kind of move.

        Raises:
            SimrobError: see :meth:`insert`; or the index is out of range.
        """
        # Called for its check of the index only; the copy is not used.
        self.program.without_move(index)
        old = leg_moves(self.program)[index]
        content: Move | Mapping[str, Any] = old
        old_duration = MOVE_TIME
        # A move of joints may get new targets or another duration, and keeps the other. Other moves are replaced as a
        # whole.
        if isinstance(old, JointMove):
            content = old.target_deg
            old_duration = old.duration
        if move is not None:
            content = move
        self._replace(
            self.program.with_replaced_move(
                index, move_from(content, duration, otherwise=old_duration)
            )
        )

    def insert(
        self, index: int, move: Move | Mapping[str, Any], duration: float | None = None
    ) -> None:
        """Insert a move into the stored program. The robot stays where it is.

        Args:
            index: index that the move gets, from 0. Negative indices count from the end.
            move: targets [deg] by axis, or an entry of a program's file, such as ``{"walk": {"steps": 4}}``,
                ``{"act": "bow"}`` or ``{"attach": "parcel"}``.
            duration: duration of a move of joints [s]. If it is None, 1.

        Raises:
            SimrobError: the index is out of range, the move has a wrong key or value, or the robot cannot perform the
                new program from its start.
        """
        # The whole program is checked again: a new move changes where the later ones begin.
        self._replace(self.program.with_inserted_move(index, move_from(move, duration)))

    def undo(self) -> None:
        """Undo the last run or change of the program: robot and program return to the state before.

        Raises:
            InvalidParameter: nothing has been done, or all of it is undone already.
        """
        if not self._past:
            raise Unsuitable(
                "undo",
                message("programs.asked_before_moves", "nothing has been done yet"),
                message("programs.called_after_move", "call it after a move or a change"),
            )
        self._restore(self._past.pop())

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML; see :meth:`Program.save`.

        The file names the station of this robot, so that ``simrob run FILE`` runs it, unless the program already names
        one. A station without a name (a configuration, a workcell, or one with overrides) is left out.
        """
        program = self.program
        if program.station is None and self._station_name is not None:
            program = program.on(self._station_name)
        return program.save(file)

    def load(self, file: Path | str) -> None:
        """Replace the stored program by that of a YAML file. The robot stays where it is.

        Raises:
            SimrobError: the file is damaged, or this robot cannot perform the program. The message names the file and
                the move.
        """
        self._replace(Program.load(file), str(file))

    def result(self) -> SimulationResult:
        """Join :attr:`runs` to one result; see :func:`~simrob_drake.results.result.join_runs`."""
        return join_runs(self.runs, move_spans=self.move_spans)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write :attr:`runs`, one after the other, as one film; see :meth:`SimulationResult.film`."""
        return self.result().film(file, frames=frames)

    def reset(self, *, keep_program: bool = False) -> None:
        """Return the station to its start, and delete the program unless ``keep_program`` is True (Reset)."""
        kept = self.program if truth(keep_program, "keep_program") else Program()
        # `undo` can take back a reset, so its snapshot comes first.
        self._remember()
        self._back_to_start()
        self.program = kept

    def _run(self, move: Move, store: bool = False) -> SimulationResult:
        """Perform a move that takes time, and return the result of its run; see :meth:`_perform_moves`."""
        return self._perform_moves([move], store=store)[-1]

    def _perform_moves(
        self, moves: Sequence[Move], *, store: bool = False
    ) -> list[SimulationResult]:
        """Check moves, perform them from the last state, and return the results of the runs.

        Args:
            moves: the moves.
            store: whether they are stored at the end of the program afterwards. They are not if the last run diverges,
                fails, is interrupted or ends in a fall.

        Returns:
            The results. There are fewer than moves if moves of joints follow each other, if a move takes no time, or if
            a run did not complete, which was then the last one.

        Raises:
            SimrobError: a move cannot be done.
        """
        stages = stages_of(self, moves, self.cell.config)
        return self._perform(stages, store=moves if truth(store, "store") else ())

    def _perform(
        self,
        stages: Sequence[ProgramStage],
        *,
        store: Sequence[Move] = (),
        from_start: bool = False,
    ) -> list[SimulationResult]:
        """Run stages one after the other, and return the results of the runs.

        If a stage raises an error, robot and program are restored. They are, too, if the last run diverged, failed,
        was interrupted or ended in a fall; its results are still returned. Otherwise the state before can be restored
        by `undo`. The runs and the times of their moves are kept in :attr:`runs` and :attr:`move_spans`.

        Args:
            stages: the stages.
            store: moves that are stored at the end of the program afterwards.
            from_start: whether the station first returns to its start.
        """
        snapshot = self._snapshot()
        runs: list[SimulationResult] = []
        spans: list[MoveSpan] = []
        now = 0.0
        try:
            # The snapshot is taken before, so that an error also undoes the return to the start.
            if from_start:
                self._back_to_start()
            for stage in stages:
                result = stage.run(self)
                # An attached piece takes no time: its span begins and ends at the same moment.
                end = now if result is None else now + result.stop_time
                spans += stage.spans(now, end)
                now = end
                if result is not None:
                    runs.append(result)
                    # A monitor or the user has ended the run: later stages would begin elsewhere.
                    if result.ending != "completed":
                        break
        # Ctrl+C counts, too: a robot must not stay half-way through a program.
        except BaseException:
            self._restore(snapshot)
            raise
        # Attaching a piece has no run: `film` and `result` keep those of the last motion.
        if runs:
            self.runs = runs
            self.move_spans = spans
        # No next move can begin where the robot has fallen, or where the simulation has diverged, failed or was
        # interrupted.
        if runs and (runs[-1].ending not in GOES_ON or robot_that_fell(runs[-1]) is not None):
            self._restore(snapshot)
            return runs
        self._remember(snapshot)
        if store:
            self.program = self.program.with_added_moves(*store)
        return runs

    def _back_to_start(self) -> None:
        """Return the station to its start: configuration, state, and time of its timeline."""
        self.cell.change(self._start)
        self.cell.state = State.at_start_of(self._start)
        self.cell.timeline.now = 0.0

    def _replace(self, program: Program, file: str = "") -> None:
        """Replace the stored program, after a check from the start of the station. `undo` restores the present one.

        Args:
            program: the new program.
            file: its file, for messages; empty if there is none.

        Raises:
            SimrobError: the robot cannot perform the program. The message names the move, and the file if there is one.
        """
        # The check comes first: a program that fails leaves the present one, and no step for `undo`.
        check_program(self, program, self._start, file)
        self._remember()
        self.program = program

    def _remember(self, snapshot: Snapshot | None = None) -> None:
        """Store a snapshot for :meth:`undo`, by default of the present state."""
        self._past.append(snapshot or self._snapshot())

    def _snapshot(self) -> Snapshot:
        """Snapshot of the present state of robot and program."""
        return Snapshot(self.program, self.cell.state, self.cell.config, self.cell.timeline.now)

    def _restore(self, snapshot: Snapshot) -> None:
        """Return robot and program to a snapshot."""
        self.program = snapshot.program
        self.cell.state = snapshot.state
        self.cell.timeline.now = snapshot.now
        # The configuration comes last, because a change draws the station in its present state.
        self.cell.change(snapshot.config)


keep_former_attributes(LeggedRobot, planned="reference_of")
