"""Program a legged robot by joint angles: SimRob's class Hum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.legged_walk import walking
from simrob_drake.programs.postures import postures_of, targets_on
from simrob_drake.programs.program import Cell, Move, Program, cell_of, move_of
from simrob_drake.programs.workcell import GOES_ON, Workcell
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.state import State
from simrob_drake.simulate import Reference
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import Station

STEP: tuple[Mapping[str, float], ...] = (
    {"left_hip_pitch": 60, "left_knee": 60},
    {"right_knee": 30, "right_ankle_pitch": -30},
    {"left_hip_pitch": 0, "left_knee": 0},
    {"right_knee": 0, "right_ankle_pitch": 0, "right_shoulder_pitch": 0},
)
"""The step of the thesis (p. 94, "Paso") [deg]."""
_MOVE_TIME = 1.0  # s, of a move unless told otherwise; tinc of the thesis


@dataclass(frozen=True)
class _Snapshot:
    """What :meth:`LeggedRobot.undo` goes back to."""

    program: Program
    state: State | None
    config: StationConfig


class LeggedRobot(LeggedGeometry):
    """A robot with legs, told by joint angles what to do: each move runs the station and returns its result.

    Axes go by name or alias, angles are absolute and in degrees, and the axes of a move go together, at constant speed
    on a dynamic station and with continuous acceleration on a kinematic one; axes that a move does not name stay where
    their references are. Every run goes on from the state that the last one left: joints, velocities, pose of the
    trunk. What cannot be done raises an error before anything moves, and leaves robot and program as they were.

    Attributes of :class:`LeggedGeometry`, and:
        program: the moves and cells that are stored.
    """

    def __init__(self, station: Workcell | str | Path | StationConfig | Station, robot: str | None = None) -> None:
        """Take a robot of a station; see :class:`LeggedGeometry`."""
        super().__init__(station, robot)
        self.program = Program()
        self._start = self.cell.config
        self._past: list[_Snapshot] = []

    def test_move(self, target_deg: Mapping[str, float], duration: float = _MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store nothing (TestMove); :meth:`undo` goes back to before it.

        Args:
            target_deg: where axes go [deg], by name or alias.
            duration: how long it takes [s].

        Raises:
            UnknownName: no such axis; proposes the nearest.
            JointLimitExceeded: tells which axis, and by how much.
            InvalidParameter: an angle that is no number, or a duration that is not positive.
        """
        return self._tried([move_of(target_deg, duration)])

    def add_move(self, target_deg: Mapping[str, float], duration: float = _MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store the move at the end of the program (AddMove).

        A run that diverges is not stored. Arguments and errors are those of :meth:`test_move`.
        """
        return self._added([move_of(target_deg, duration)])

    def add_reference(self, target_deg: Mapping[str, float]) -> None:
        """Store targets without a time as a cell for a sequencer, which decides when to go on (AddRef).

        Arguments and errors are those of :meth:`test_move`; nothing moves.
        """
        cell = cell_of(target_deg)
        targets_on(self.model, cell.target_deg, "the reference")
        self._remember()
        self.program = self.program.with_reference(cell)

    @property
    def cells(self) -> list[dict[int, float]]:
        """The stored references as a sequencer takes them: the place of each axis, and its target [rad]."""
        return [targets_on(self.model, cell.target_deg, "the reference") for cell in self.program.references]

    def step(self, move_time: float = _MOVE_TIME) -> SimulationResult:
        """Take the step of the thesis with the left leg, four moves, and store them (Paso).

        Args:
            move_time: of each of the moves [s].

        Raises:
            UnknownName: a robot without the joints of a humanoid.
            InvalidParameter: a time that is not positive.
        """
        return self._added([move_of(targets, move_time) for targets in STEP])

    def walk(self, steps: int, amplitude: float = 1.0, gait: str | None = None, **changes: Any) -> SimulationResult:
        """Walk from the last state, and store nothing (Marcha).

        The robot first takes the posture in which its gait begins. Servos and floor are those of the gait while it
        walks; the floor stays as large as it had to become.

        Args:
            steps: how many; legs in turn for a crawl.
            amplitude: scales the length of the steps and, where the gait has them, way sideways and turn.
            gait: one of the robot's ``gaits.yaml``; the first for its feet unless given.
            changes: other figures of the gait to change, such as ``step_time``.

        Raises:
            InvalidParameter: a robot without feet, without floor or without gaits, or figures that cannot be.
            UnknownName: no such gait.
            OutOfReach: steps that the legs cannot do; tells by how much.
        """
        config, reference, duration = walking(self, steps, amplitude, gait, changes)
        before = self.cell.config
        snapshot = self._snapshot()
        self.cell.change(config)
        try:
            result = self.cell.follow({self.name: reference}, duration)
        finally:
            self.cell.change(before.model_copy(update={"floor": config.floor}))
        if result.ending in GOES_ON:
            self._past.append(snapshot)
        return result

    def run(self, program: Program | Path | str) -> SimulationResult:
        """Run another program's moves as one, from the last state, and store nothing.

        Args:
            program: one, or the YAML file of one; it may have been made with another robot.

        Raises:
            InvalidParameter: a program without moves.
            InvalidConfig: a damaged file.
            SimrobError: as :meth:`test_move`, naming the move.
        """
        given = program if isinstance(program, Program) else Program.load(program)
        return self._tried(given.moves)

    def simulate(self) -> SimulationResult:
        """Run all stored moves as one from the start (Sim); the robot goes on from its end.

        Raises:
            InvalidParameter: an empty program.
        """
        self._check(self.program.moves, self.reference)
        snapshot = self._snapshot()
        self._back_to_start()
        try:
            result = self._run(self.program.moves)
        except BaseException:
            self._restore(snapshot)
            raise
        if result.ending in GOES_ON:
            self._past.append(snapshot)
        else:
            self._restore(snapshot)
        return result

    def reset(self, *, keep_program: bool = False) -> None:
        """Put the station back to its start and, unless ``keep_program``, forget the program (Reset)."""
        self._remember()
        self._back_to_start()
        if not keep_program:
            self.program = Program()

    def remove(self, index: int = -1) -> None:
        """Take a stored move out of the program, the last unless given; the robot stays where it is.

        Raises:
            InvalidParameter: no such move.
        """
        self._replace(self.program.removed(index))

    def edit(self, index: int, target_deg: Mapping[str, float] | None = None, duration: float | None = None) -> None:
        """Change targets or duration of a stored move; the robot stays where it is.

        Args:
            index: of the move, counted from 0; negative numbers count from the end.
            target_deg: in place of its targets [deg].
            duration: in place of its duration [s].

        Raises:
            SimrobError: as :meth:`test_move`, or no such move.
        """
        self.program.removed(index)  # there is one
        old = self.program.moves[index]
        move = move_of(
            old.target_deg if target_deg is None else target_deg, old.duration if duration is None else duration
        )
        self._replace(self.program.edited(index, move), move)

    def insert(self, index: int, target_deg: Mapping[str, float], duration: float = _MOVE_TIME) -> None:
        """Put a move before the stored one of number ``index``; the robot stays where it is.

        Raises:
            SimrobError: as :meth:`test_move`, or no such place.
        """
        move = move_of(target_deg, duration)
        self._replace(self.program.inserted(index, move), move)

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
            SimrobError: a program that this robot cannot do.
        """
        program = Program.load(file)
        for cell in program.references:
            targets_on(self.model, cell.target_deg, "the reference")
        postures_of(self.model, program.moves, self.reference)
        self._replace(program)

    def _replace(self, program: Program, *moves: Move) -> None:
        postures_of(self.model, moves, self.reference)  # the robot can do them
        self._remember()
        self.program = program

    def _tried(self, moves: Sequence[Move]) -> SimulationResult:
        self._check(moves, self.reference)
        snapshot = self._snapshot()
        result = self._run(moves)
        if result.ending in GOES_ON:
            self._past.append(snapshot)
        return result

    def _added(self, moves: Sequence[Move]) -> SimulationResult:
        result = self._tried(moves)
        if result.ending in GOES_ON:
            self.program = self.program.added(*moves)
        return result

    def _check(self, moves: Sequence[Move], start: Vector) -> None:
        if not moves:
            raise InvalidParameter("the program", "empty", "one with moves: add_move() stores them")
        postures_of(self.model, moves, start)

    def _run(self, moves: Sequence[Move]) -> SimulationResult:
        times, postures = postures_of(self.model, moves, self.reference)
        reference: Reference = (times, postures)
        if self.cell.config.mode == "kinematic":
            reference = sequence(postures[0], times[1:].tolist(), list(postures[1:]))
        return self.cell.follow({self.name: reference}, float(times[-1]))

    def _back_to_start(self) -> None:
        self.cell.state = None
        self.cell.change(self._start)

    def _remember(self) -> None:
        self._past.append(self._snapshot())

    def _snapshot(self) -> _Snapshot:
        return _Snapshot(self.program, self.cell.state, self.cell.config)

    def _restore(self, snapshot: _Snapshot) -> None:
        self.program, self.cell.state = snapshot.program, snapshot.state
        self.cell.change(snapshot.config)


__all__ = ["STEP", "Cell", "LeggedRobot", "Move", "Program"]
