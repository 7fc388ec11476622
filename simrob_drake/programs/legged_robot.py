"""Program a legged robot by joint angles: SimRob's class Hum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import PoseLike, Vector
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.legged_program import MOVE_TIME, Programmed
from simrob_drake.programs.postures import postures_of
from simrob_drake.programs.program import Move, Program, move_of
from simrob_drake.programs.workcell import GOES_ON
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulate import Reference
from simrob_drake.stations.names import WORLD

STEP: tuple[Mapping[str, float], ...] = (
    {"left_hip_pitch": 60, "left_knee": 60},
    {"right_knee": 30, "right_ankle_pitch": -30},
    {"left_hip_pitch": 0, "left_knee": 0},
    {"right_knee": 0, "right_ankle_pitch": 0, "right_shoulder_pitch": 0},
)
"""The step of the thesis (p. 94, "Paso") [deg]."""


class LeggedRobot(Programmed):
    """A robot with legs, told by joint angles what to do: each move runs the station and returns its result.

    Axes go by name or alias, angles are absolute and in degrees, and the axes of a move go together, at constant speed
    on a dynamic station and with continuous acceleration on a kinematic one; axes that a move does not name stay where
    their references are. Every run goes on from the state that the last one left: joints, velocities, pose of the
    trunk. What cannot be done raises an error before anything moves, and leaves robot and program as they were.

    Attributes of :class:`LeggedGeometry`, and:
        program: the moves and cells that are stored.
    """

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
        return self._tried([move_of(target_deg, duration)])

    def add_move(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store the move at the end of the program (AddMove).

        A run that diverges is not stored. Arguments and errors are those of :meth:`test_move`.
        """
        return self._added([move_of(target_deg, duration)])

    def step(self, move_time: float = MOVE_TIME) -> SimulationResult:
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
        walks, and steps of the solver are 10 ms at most; the floor stays as large as it had to become.

        Args:
            steps: how many; legs in turn for a crawl.
            amplitude: scales the length of the steps and, where the gait has them, way sideways and turn; of a march,
                how far all joints go.
            gait: a walk, trot, crawl or march of the robot's ``gaits.yaml``; the first for its feet unless given.
            changes: other figures of the gait to change, such as ``step_time``.

        Raises:
            InvalidParameter: a robot without gaits, other feet or another station than the gait needs, or figures that
                cannot be.
            UnknownName: no such gait, or no such figure of it; proposes the nearest.
            InvalidConfig: a figure that cannot be.
            OutOfReach, JointLimitExceeded: steps that the legs cannot do; tells by how much.
        """
        if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or steps < 1:
            raise InvalidParameter("steps", steps, "a whole number of at least 1")
        if not np.isfinite(amplitude):
            raise InvalidParameter("amplitude", amplitude, "a finite number; 1 walks as the gait's figures say")
        return self._performed(planned_gait(self, gait, changes, steps=int(steps), amplitude=amplitude))

    def act(self, name: str, **changes: Any) -> SimulationResult:
        """Go through postures from the last state, or stand on three legs, and store nothing.

        The robot first takes the posture in which the act begins.

        Args:
            name: one of the sequences and stands of the robot's ``gaits.yaml``, such as ``bow``.
            changes: its figures to change, such as ``repeat``, or ``foot`` of ``three_legs``.

        Raises:
            SimrobError: as :meth:`walk`.
        """
        return self._performed(planned_gait(self, name, changes))

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

    def planned(self, program: Program) -> tuple[Reference, float]:
        """Return the reference that a program is from where the robot is, and its duration [s]; nothing moves.

        With several robots in a workcell, ``cell.follow({robot.name: reference, ...}, duration)`` runs theirs at once.

        Raises:
            SimrobError: as :meth:`run`.
        """
        self._check(program.moves, self.reference)
        return self._planned(program.moves)

    def attach(self, piece: str, *, pose: PoseLike | None = None) -> None:
        """Take a piece with the robot's first tool, on the humanoids the right hand; see :meth:`Workcell.attach`.

        Args:
            piece: which.
            pose: its pose in the hand, to put it there; it keeps its place in the world unless given.

        Raises:
            UnknownName: no such piece.
        """
        snapshot = self._snapshot()
        self.cell.attach(piece, self.name, pose=pose)
        self._remember(snapshot)

    def release(self, piece: str, parent: str = WORLD) -> None:
        """Let go of a piece: it stays where it is, in the world or on another piece; see :meth:`Workcell.attach`.

        Raises:
            UnknownName: no such piece or parent.
        """
        snapshot = self._snapshot()
        self.cell.attach(piece, parent)
        self._remember(snapshot)

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
            self._remember(snapshot)
        else:
            self._restore(snapshot)
        return result

    def reset(self, *, keep_program: bool = False) -> None:
        """Put the station back to its start and, unless ``keep_program``, forget the program (Reset)."""
        self._remember()
        self._back_to_start()
        if not keep_program:
            self.program = Program()

    def _performed(self, motion: JointMotion) -> SimulationResult:
        snapshot = self._snapshot()
        try:
            result = perform(self, motion)
        except BaseException:
            self._restore(snapshot)
            raise
        if result.ending in GOES_ON:
            self._remember(snapshot)
        else:
            self._restore(snapshot)
        return result

    def _tried(self, moves: Sequence[Move]) -> SimulationResult:
        self._check(moves, self.reference)
        snapshot = self._snapshot()
        result = self._run(moves)
        if result.ending in GOES_ON:
            self._remember(snapshot)
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
        reference, duration = self._planned(moves)
        return self.cell.follow({self.name: reference}, duration)

    def _planned(self, moves: Sequence[Move]) -> tuple[Reference, float]:
        times, postures = postures_of(self.model, moves, self.reference)
        if self.cell.config.mode == "dynamic":
            return (times, postures), float(times[-1])
        return sequence(postures[0], times[1:].tolist(), list(postures[1:])), float(times[-1])

    def _back_to_start(self) -> None:
        self.cell.state = None
        self.cell.change(self._start)
