"""Program a legged robot by joint angles: SimRob's class Hum."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from simrob_drake.base.arguments import instance, truth
from simrob_drake.base.errors import InvalidParameter, counted
from simrob_drake.base.frames import PoseLike, as_transform, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.arm import Workcell, workcell_of
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.get_up import GetUpMove
from simrob_drake.programs.moves.joints import move_of, targets_on
from simrob_drake.programs.moves.kinds import ActMove, AttachMove, GoMove, JointMove, ReleaseMove, WalkMove, move_from
from simrob_drake.programs.moves.move import MOVE_TIME, Move, checked
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
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.simulation import ReferenceLike
from simrob_drake.stations.station import StationLike


class LeggedRobot(LeggedGeometry):
    """A robot with legs, told by joint angles what to do: each move runs the station and returns its result.

    Axes go by name or alias, angles are absolute and in degrees, and the axes of a move go together, at constant speed
    on a dynamic station and with continuous acceleration on a kinematic one; axes that a move does not name stay where
    their references are. Every run goes on from the state that the last one left: joints, velocities, pose of the
    trunk. What cannot be done raises an error before anything moves, and leaves robot and program as they were. So does
    a run that diverges, is interrupted, or is ended by a monitor of a fall: nothing of it is stored, and there is
    nothing to undo; ``message`` of the result tells what happened. What another monitor stops counts as done.

    Changes of the program move nothing.

    Attributes of :class:`LeggedGeometry`, and:
        program: the moves and cells that are stored.
        runs: what the last move or program was made of, in order.
        move_spans: when each move of it began and ended, since the start of the first run.
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
            station: a workcell, or what makes one: a station's name, file or configuration.
            robot: its name in the station; needed where there are several.
            overrides: new values of the station, as :func:`simrob_drake.load_station` takes them.

        Raises:
            UnknownName: no such station or robot.
            InvalidParameter: a station without a robot, or no robot named where there are several.
        """
        super().__init__(workcell_of(station, overrides), robot)
        self.program = Program()
        self._start = self.cell.config
        self.runs: list[SimulationResult] = []
        self.move_spans: list[MoveSpan] = []
        self._past: list[Snapshot] = []

    def _described(self) -> list[str]:
        feet = [] if self.worn_feet is None else [f"feet {self.worn_feet}"]
        return [*super()._described(), *feet, f"program of {counted(len(self.program.moves), 'move')}"]

    def do(self, move: Move | Mapping[str, Any], *, store: bool = False) -> SimulationResult | None:
        """Do a move of any kind from the last state, and return its run; None of one that takes no time.

        Args:
            move: one, or what would stand in a program's file, such as ``{"act": "bow"}``.
            store: at the end of the program.

        Raises:
            SimrobError: it is wrong, or cannot be done.
        """
        runs = self._perform_moves([move_from(move)], store=store)
        return runs[-1] if runs else None

    def test_move(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store nothing (TestMove); :meth:`undo` goes back to before it.

        Args:
            target_deg: where axes go [deg], by name or alias.
            duration: how long it takes [s].

        Raises:
            UnknownName: no such axis; proposes the nearest.
            JointLimitExceeded: tells which axis, and by how much.
            InvalidParameter: an angle that is no number, or a duration that is not positive.
        """
        return self._run(move_of(target_deg, duration))

    def add_move(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store the move at the end of the program (AddMove).

        A run that diverges or in which the robot falls is not stored. Arguments and errors are those of
        :meth:`test_move`.
        """
        return self._run(move_of(target_deg, duration), True)

    def step(self, move_time: float | None = None) -> SimulationResult:
        """Go one step ahead, and store it (Paso).

        A robot whose ``gaits.yaml`` has a sequence ``step``, as the humanoid of MATLAB, goes through its postures by
        moves of joints: the step of the thesis with the left leg, four moves (p. 94), made for its large feet. The
        others take one step of the first gait for their feet, of full length, and bring their feet together.

        Args:
            move_time: of each of the moves [s], 1 in the thesis; or of each step of the gait. Their own unless given.

        Raises:
            SimrobError: as :meth:`walk`; or a time that is not positive.
        """
        return self._perform_moves(step_moves(self.model, self.worn_feet, move_time), store=True)[-1]

    def walk(
        self, steps: int, amplitude: float = 1.0, gait: str | None = None, *, store: bool = False, **changes: Any
    ) -> SimulationResult:
        """Walk from the last state (Marcha).

        The robot first takes the posture in which its gait begins, in up to 2.5 s; if it stands so, it walks at once.
        Servos and floor are those of the gait while it walks, and steps of the solver are 10 ms at most; the floor
        stays as large as it had to become.

        Args:
            steps: how many step lengths ahead; the steps of the ramps (``ramp_steps``) and the last one, which brings
                the feet together, come in addition. Legs in turn for a crawl.
            amplitude: scales the length of the steps and, where the gait has them, way sideways and turn; of a march,
                how far all joints go.
            gait: a walk, trot, crawl or march of the robot's ``gaits.yaml``; the first for its feet unless given.
            store: at the end of the program.
            changes: other parameters of the gait to change, such as ``step_time``.

        Raises:
            UnknownName: no such gait, or no such parameter of it; proposes the nearest.
            OutOfReach, JointLimitExceeded: steps that the legs cannot do; tells by how much.
            SimrobError: other feet or another station than the gait needs, or a parameter that cannot be.
        """
        return self._run(checked(WalkMove, steps=steps, amplitude=amplitude, gait=gait, **changes), store)

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
        """Walk by a command from the last state, in steps that are made while it goes and answer what disturbs it.

        It does not stop at the end: another call goes on in the middle of the step, and one without speeds stops.

        Args:
            ahead: [m/s].
            sideways: to the left [m/s].
            turn: to the left [rad/s].
            duration: [s].
            strict: refuse what the legs cannot follow; it is clipped otherwise, and the result's summary says so.
            store: at the end of the program.

        Raises:
            InvalidParameter: a robot without a walk by commands, or numbers that cannot be.
        """
        return self._run(GoMove.at(ahead, sideways, turn, duration=duration, strict=strict), store)

    def act(self, name: str, *, store: bool = False, **changes: Any) -> SimulationResult:
        """Go through postures from the last state, or stand on three legs.

        The robot first takes the posture in which the act begins, in up to 2.5 s, or at once if it stands so.

        Args:
            name: one of the sequences and stands of the robot's ``gaits.yaml``, such as ``bow``.
            store: at the end of the program.
            changes: its parameters to change, such as ``repeat``, or ``foot`` of ``three_legs``.

        Raises:
            SimrobError: as :meth:`walk`.
        """
        return self._run(checked(ActMove, name=name, **changes), store)

    def get_up(self, *, attempts: int = 5, store: bool = False) -> SimulationResult:
        """Get up where the robot has fallen, in so many attempts; ``message`` of the result says how that went.

        Raises InvalidParameter: a robot without postures for it in its ``gaits.yaml``, or a number that cannot be.
        """
        return self._run(checked(GetUpMove, attempts=attempts), store)

    def attach(self, piece: str, tool: str | None = None, *, pose: PoseLike | None = None, store: bool = False) -> None:
        """Take a piece with a tool of the robot; see :meth:`Workcell.attach`.

        Args:
            piece: which.
            tool: one of :attr:`tools`, such as ``left_hand``, or a link, such as ``trunk``; the first tool unless
                given, on the humanoids the right hand, and the trunk of a quadruped.
            pose: its pose in the hand, to put it there; it keeps its place in the world unless given.
            store: at the end of the program.

        Raises:
            UnknownName: no such piece or tool; proposes the nearest.
            InvalidParameter: a piece that is more than 30 mm away, and no pose.
        """
        place = None if pose is None else pose_from_transform(as_transform(pose))
        self.do(checked(AttachMove, piece=piece, tool=tool, pose=place), store=store)

    def release(self, piece: str, parent: str = WORLD, *, fixed: bool = False, store: bool = False) -> None:
        """Let go of a piece, in the world or on another piece; see :meth:`Workcell.release`, also for the errors."""
        self.do(checked(ReleaseMove, piece=piece, parent=parent, fixed=fixed), store=store)

    def run(self, program: Program | Path | str) -> SimulationResult:
        """Run another program from the last state, as :meth:`simulate` runs the stored one, and store nothing.

        Args:
            program: one, or the YAML file of one; it may have been made with another robot.

        Raises:
            SimrobError: a program without moves, a damaged file, or as :meth:`test_move`, naming the move.
        """
        instance(
            program,
            "program",
            (Program, Path, str),
            message("programs.a_program_or_yaml", "a Program, or the YAML file of one"),
        )
        loaded = program if isinstance(program, Program) else Program.load(program)
        file = "" if loaded is program else str(program)
        with following(self.cell, loaded.grid, loaded.changes):
            return self._perform(program_stages(self, loaded, self.cell.config, file))[-1]

    def planned(self, program: Program) -> tuple[ReferenceLike, float]:
        """Return the reference that a program of joint moves is from where the robot is, and its duration [s].

        Nothing moves. ``cell.follow({robot.name: reference, ...}, duration)`` runs those of several robots at once.

        Raises:
            SimrobError: as :meth:`run`; or a program with a walk, an act or a piece.
        """
        return joint_reference(
            self, leg_moves(instance(program, "program", Program, message("programs.a_program", "a Program")))
        )

    def simulate(self, *, automatic: bool | Mapping[str, Any] | None = None, strict: bool = False) -> SimulationResult:
        """Run all that is stored from the start (Sim); the robot goes on from its end.

        Moves of joints that follow each other are one run, and so is each walk and act, which has servos and solver
        of its own; pieces change hands between runs. A monitor that ends a run ends the program; if the robot falls,
        it goes on from where it was before.

        Automatic, a sequencer goes through the references: to the next one when the joints have reached the last.
        ``cells`` of the result tells when; one that takes longer than the time-out ends the run.

        Args:
            automatic: whether to do that, or how, such as ``{"tolerance_deg": 3, "timeout": 20}``, the keys of
                :class:`~simrob_drake.programs.program.Automatic`; as the program says unless given.
            strict: a run with warnings raises a ``VerdictError``, and leaves robot and program as they were.

        Returns:
            the last run; :attr:`runs` has all of them, and :meth:`film` shows them as one.

        Raises:
            SimrobError: an empty program, or what cannot be done from the start; names the move.
        """
        program = self.program if automatic is None else self.program.with_automatic(automatic)
        with following(self.cell, program.grid, program.changes, strict=truth(strict, "strict")):
            return self._perform(program_stages(self, program, self._start), from_start=True)[-1]

    def add_reference(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> None:
        """Store targets as a cell for :meth:`simulate` with ``automatic`` (AddRef), which lasts until they are reached.

        Nothing moves. Arguments and errors are those of :meth:`test_move`; ``duration`` is that of the way there.
        """
        cell = move_of(target_deg, duration)
        targets_on(self.model, cell.target_deg, message("programs.the_reference", "the reference"), cell.duration)
        self._remember()
        self.program = self.program.with_reference(cell)

    def remove(self, index: int = -1) -> None:
        """Take a stored move out of the program, the last unless given; the robot stays where it is."""
        program = self.program.removed(index)
        self._remember()
        self.program = program

    def edit(self, index: int, move: Move | Mapping[str, Any] | None = None, duration: float | None = None) -> None:
        """Change a stored move; the robot stays where it is.

        Args:
            index: of the move, counted from 0; negative numbers count from the end.
            move: in place of its targets [deg] or the whole move, as :meth:`insert` takes it.
            duration: in place of the duration [s] of a move of joints.

        Raises:
            SimrobError: as :meth:`insert`, or no such move.
        """
        self.program.removed(index)  # there is one
        old = leg_moves(self.program)[index]
        before = (old.target_deg, old.duration) if isinstance(old, JointMove) else (old, MOVE_TIME)
        new = move_from(before[0] if move is None else move, duration, otherwise=before[1])
        self._replace(self.program.edited(index, new))

    def insert(self, index: int, move: Move | Mapping[str, Any], duration: float | None = None) -> None:
        """Put a move before the stored one of number ``index``; the robot stays where it is.

        Args:
            index: counted from 0; negative numbers count from the end.
            move: targets [deg] by axis, or what stands in a program's file, such as ``{"walk": {"steps": 4}}``,
                ``{"act": "bow"}`` or ``{"attach": "parcel"}``.
            duration: of a move of joints [s]; 1 unless given.

        Raises:
            SimrobError: no such place, a move that is wrong, or a program that the robot cannot do from its start.
        """
        self._replace(self.program.inserted(index, move_from(move, duration)))

    def undo(self) -> None:
        """Take back the last thing that was done, a test, a run or a change of the program: robot and program."""
        if not self._past:
            raise InvalidParameter(
                "undo",
                message("programs.asked_before_moves", "asked for before anything was done"),
                message("programs.called_after_move", "called after a move or a change"),
            )
        self._restore(self._past.pop())

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML; see :meth:`Program.save`."""
        return self.program.save(file)

    def load(self, file: Path | str) -> None:
        """Take the program of a YAML file in place of the stored one; the robot stays where it is.

        Raises:
            SimrobError: a damaged file, or a program that this robot cannot do; names the file and the move.
        """
        self._replace(Program.load(file), str(file))

    def result(self) -> SimulationResult:
        """Return :attr:`runs` as one result; see :func:`~simrob_drake.results.result.joined`."""
        return joined(self.runs, move_spans=self.move_spans)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write :attr:`runs`, one after the other, as one film; see :meth:`SimulationResult.film`."""
        return self.result().film(file, frames=frames)

    def reset(self, *, keep_program: bool = False) -> None:
        """Put the station back to its start and, unless ``keep_program``, forget the program (Reset)."""
        kept = self.program if truth(keep_program, "keep_program") else Program()
        self._remember()
        self._back_to_start()
        self.program = kept

    def _run(self, move: Move, store: bool = False) -> SimulationResult:
        return self._perform_moves([move], store=store)[-1]

    def _perform_moves(self, moves: Sequence[Move], *, store: bool = False) -> list[SimulationResult]:
        """Do moves from the last state, perhaps store them, and return the runs."""
        return self._perform(stages_of(self, moves, self.cell.config), store=moves if truth(store, "store") else ())

    def _perform(
        self, stages: Sequence[ProgramStage], *, store: Sequence[Move] = (), from_start: bool = False
    ) -> list[SimulationResult]:
        """Do stage after stage, and return the runs; what goes wrong leaves robot and program as they were."""
        snapshot = self._snapshot()
        runs: list[SimulationResult] = []
        spans: list[MoveSpan] = []
        now = 0.0
        try:
            if from_start:
                self._back_to_start()
            for stage in stages:
                result = stage.run(self)
                end = now if result is None else now + result.stop_time
                spans += stage.spans(now, end)
                now = end
                if result is not None:
                    runs.append(result)
                    if result.ending != "completed":
                        break
        except BaseException:
            self._restore(snapshot)
            raise
        if runs:
            self.runs = runs
            self.move_spans = spans
        if runs and (runs[-1].ending not in GOES_ON or robot_that_fell(runs[-1]) is not None):
            self._restore(snapshot)
            return runs
        self._remember(snapshot)
        if store:
            self.program = self.program.added(*store)
        return runs

    def _back_to_start(self) -> None:
        self.cell.change(self._start)
        self.cell.state, self.cell.timeline.now = State.at_start_of(self._start), 0.0

    def _replace(self, program: Program, file: str = "") -> None:
        check_program(self, program, self._start, file)
        self._remember()
        self.program = program

    def _remember(self, snapshot: Snapshot | None = None) -> None:
        self._past.append(snapshot or self._snapshot())

    def _snapshot(self) -> Snapshot:
        return Snapshot(self.program, self.cell.state, self.cell.config, self.cell.timeline.now)

    def _restore(self, snapshot: Snapshot) -> None:
        self.program, self.cell.state, self.cell.timeline.now = snapshot.program, snapshot.state, snapshot.now
        self.cell.change(snapshot.config)
