"""Program a legged robot by joint angles: SimRob's class Hum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from simrob_drake.errors import InvalidParameter
from simrob_drake.given import instance, truth
from simrob_drake.programs.legged_moves import LeggedMoves
from simrob_drake.programs.legged_stages import (
    Stage,
    check_program,
    goes_on,
    joint_reference,
    leg_moves,
    stages_of,
    stages_of_program,
)
from simrob_drake.programs.moves import (
    MOVE_TIME,
    JointMove,
    LegMove,
    any_move,
    move_of,
)
from simrob_drake.programs.one_move import targets_on
from simrob_drake.programs.program import Program, counted
from simrob_drake.programs.snapshot import Snapshot
from simrob_drake.programs.timeline import following
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.whole import joined
from simrob_drake.simulation import Reference
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike


class LeggedRobot(LeggedMoves):
    """A robot with legs, told by joint angles what to do: each move runs the station and returns its result.

    Axes go by name or alias, angles are absolute and in degrees, and the axes of a move go together, at constant speed
    on a dynamic station and with continuous acceleration on a kinematic one; axes that a move does not name stay where
    their references are. Every run goes on from the state that the last one left: joints, velocities, pose of the
    trunk. What cannot be done raises an error before anything moves, and leaves robot and program as they were. So does
    a run that diverges, is interrupted, or is ended by a monitor of a fall: nothing of it is stored, and there is
    nothing to undo; ``message`` of the result tells what happened. What another monitor stops counts as done.

    Changes of the program move nothing.

    Attributes of :class:`LeggedMoves`, and:
        program: the moves and cells that are stored.
        runs: what the last move or program was made of, in order.
    """

    def __init__(self, station: Workcell | StationLike, robot: str | None = None) -> None:
        """Take a robot of a station.

        Args:
            station: a workcell, or what makes one: a station's name, file or configuration.
            robot: its name in the station; needed where there are several.

        Raises:
            UnknownName: no such station or robot.
            InvalidParameter: a station without a robot, or no robot named where there are several.
        """
        super().__init__(station if isinstance(station, Workcell) else Workcell(station), robot)
        self.program = Program()
        self._start = self.cell.config
        self.runs: list[SimulationResult] = []
        self._past: list[Snapshot] = []

    def _described(self) -> list[str]:
        feet = [] if self.worn_feet is None else [f"feet {self.worn_feet}"]
        return [*super()._described(), *feet, f"program of {counted(len(self.program.moves), 'move')}"]

    def run(self, program: Program | Path | str) -> SimulationResult:
        """Run another program from the last state, as :meth:`simulate` runs the stored one, and store nothing.

        Args:
            program: one, or the YAML file of one; it may have been made with another robot.

        Raises:
            InvalidParameter: a program without moves.
            InvalidConfig: a damaged file.
            SimrobError: as :meth:`test_move`, naming the move.
        """
        instance(program, "program", (Program, Path, str), "a Program, or the YAML file of one")
        given = program if isinstance(program, Program) else Program.load(program)
        file = "" if given is program else str(program)
        return self._perform_all(given, self.cell.config, file)

    def planned(self, program: Program) -> tuple[Reference, float]:
        """Return the reference that a program of joint moves is from where the robot is, and its duration [s].

        Nothing moves.

        With several robots in a workcell, ``cell.follow({robot.name: reference, ...}, duration)`` runs theirs at once.

        Raises:
            SimrobError: as :meth:`run`; or a program with a walk, an act or a piece.
        """
        return joint_reference(self, leg_moves(instance(program, "program", Program, "a Program")))

    def simulate(self, *, automatic: bool | Mapping[str, Any] | None = None) -> SimulationResult:
        """Run all that is stored from the start (Sim); the robot goes on from its end.

        Moves of joints that follow each other are one run, and so is each walk and act, which has servos and solver
        of its own; pieces change hands between runs. A monitor that ends a run ends the program; if the robot falls,
        it goes on from where it was before.

        Automatic, a sequencer goes through the references: to the next one when the joints have reached the last.
        ``cells`` of the result tells when; one that takes longer than the time-out ends the run.

        Args:
            automatic: whether to do that, or how, such as ``{"tolerance_deg": 3, "timeout": 20}``, the keys of
                :class:`~simrob_drake.programs.automatic.Automatic`; as the program says unless given.

        Returns:
            the last run; :attr:`runs` has all of them, and :meth:`film` shows them as one.

        Raises:
            InvalidParameter: an empty program.
            SimrobError: what cannot be done from the start; names the move.
        """
        program = self.program if automatic is None else self.program.with_automatic(automatic)
        return self._perform_all(program, self._start, from_start=True)

    def add_reference(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> None:
        """Store targets as a cell for :meth:`simulate` with ``automatic`` (AddRef), which lasts until they are reached.

        Nothing moves. Arguments and errors are those of :meth:`test_move`; ``duration`` is that of the way there.
        """
        cell = move_of(target_deg, duration)
        targets_on(self.model, cell.target_deg, "the reference", cell.duration)
        self._remember()
        self.program = self.program.with_reference(cell)

    def remove(self, index: int = -1) -> None:
        """Take a stored move out of the program, the last unless given; the robot stays where it is.

        Raises:
            InvalidParameter: no such move.
        """
        program = self.program.removed(index)
        self._remember()
        self.program = program

    def edit(self, index: int, move: LegMove | Mapping[str, Any] | None = None, duration: float | None = None) -> None:
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
        new = any_move(before[0] if move is None else move, duration, otherwise=before[1])
        self._replace(self.program.edited(index, new))

    def insert(self, index: int, move: LegMove | Mapping[str, Any], duration: float | None = None) -> None:
        """Put a move before the stored one of number ``index``; the robot stays where it is.

        Args:
            index: counted from 0; negative numbers count from the end.
            move: targets [deg] by axis, or what stands in a program's file, such as ``{"walk": {"steps": 4}}``,
                ``{"act": "bow"}`` or ``{"attach": "parcel"}``.
            duration: of a move of joints [s]; 1 unless given.

        Raises:
            SimrobError: no such place, a move that is wrong, or a program that the robot cannot do from its start.
        """
        self._replace(self.program.inserted(index, any_move(move, duration)))

    def undo(self) -> None:
        """Take back the last thing that was done, a test, a run or a change of the program: robot and program.

        Raises:
            InvalidParameter: nothing was done.
        """
        if not self._past:
            raise InvalidParameter("undo", "asked for before anything was done", "called after a move or a change")
        self._restore(self._past.pop())

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML; see :meth:`Program.save`."""
        return self.program.save(file)

    def load(self, file: Path | str) -> None:
        """Take the program of a YAML file in place of the stored one; the robot stays where it is.

        Raises:
            InvalidConfig: a damaged file.
            SimrobError: a program that this robot cannot do; names the file and the move.
        """
        self._replace(Program.load(file), str(file))

    def result(self) -> SimulationResult:
        """Return :attr:`runs` as one result; see :func:`~simrob_drake.results.whole.joined`.

        Raises:
            InvalidParameter: nothing was run.
        """
        return joined(self.runs)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write :attr:`runs`, one after the other, as one film; see :meth:`SimulationResult.film`."""
        return self.result().film(file, frames=frames)

    def reset(self, *, keep_program: bool = False) -> None:
        """Put the station back to its start and, unless ``keep_program``, forget the program (Reset)."""
        kept = self.program if truth(keep_program, "keep_program") else Program()
        self._remember()
        self._back_to_start()
        self.program = kept

    def _do(self, moves: Sequence[LegMove], *, store: bool = False) -> list[SimulationResult]:
        """Do moves from the last state, perhaps store them, and return the runs."""
        return self._perform(stages_of(self, moves, self.cell.config), store=moves if truth(store, "store") else ())

    def _perform_all(
        self, program: Program, station: StationConfig, file: str = "", *, from_start: bool = False
    ) -> SimulationResult:
        with following(self.cell, program.grid, program.changes):
            return self._perform(stages_of_program(self, program, station, file), from_start=from_start)[-1]

    def _perform(
        self, stages: Sequence[Stage], *, store: Sequence[LegMove] = (), from_start: bool = False
    ) -> list[SimulationResult]:
        """Do stage after stage, and return the runs; what goes wrong leaves robot and program as they were."""
        snapshot, runs = self._snapshot(), list[SimulationResult]()
        try:
            if from_start:
                self._back_to_start()
            for stage in stages:
                result = stage(self)
                if result is not None:
                    runs.append(result)
                    if result.ending != "completed":
                        break
        except BaseException:
            self._restore(snapshot)
            raise
        self.runs = runs or self.runs
        if runs and not goes_on(runs[-1]):
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
