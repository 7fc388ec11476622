"""A program of a legged robot in stages that run one after the other.

Moves of joints that follow each other are one run, each walk and act is one, and pieces change hands between runs. All
of a program is checked before the first stage runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter, SimrobError, UnknownName
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.moves import ActMove, AnyMove, AttachMove, JointMove, ReleaseMove, WalkMove
from simrob_drake.programs.pieces import reparented
from simrob_drake.programs.postures import move_name, postures_of, targets_on
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import Reference
from simrob_drake.stations.config import StationConfig


class Stage(Protocol):
    """A stage of a program, checked and ready."""

    def run(self, robot: LeggedGeometry) -> SimulationResult | None:
        """Do it from where the robot is; returns the run, or None if it takes no time."""


@dataclass(frozen=True)
class JointMoves:
    """Moves of joints, one after the other."""

    moves: tuple[JointMove, ...]

    def run(self, robot: LeggedGeometry) -> SimulationResult:
        """Run them as one."""
        reference, duration = joint_reference(robot, self.moves)
        return robot.cell.follow({robot.name: reference}, duration)


@dataclass(frozen=True)
class Gait:
    """A walk or an act."""

    motion: JointMotion

    def run(self, robot: LeggedGeometry) -> SimulationResult:
        """Perform it."""
        return perform(robot, self.motion)


@dataclass(frozen=True)
class HandOver:
    """A piece that is taken or let go."""

    move: AttachMove | ReleaseMove

    def run(self, robot: LeggedGeometry) -> None:
        """Go on with the station in which the piece hangs elsewhere."""
        robot.cell.change(handed_over(robot.cell.model, robot.name, self.move))


def stages_of(robot: LeggedGeometry, moves: Sequence[AnyMove], station: StationConfig, file: str = "") -> list[Stage]:
    """Cut a program into stages, after checking all of it.

    Args:
        robot: who does it.
        moves: of the program.
        station: as it is when the program begins.
        file: that the program stands in, for messages.

    Raises:
        SimrobError: what the robot cannot do; names the move.
    """
    stages: list[Stage] = []
    for number, move in enumerate(moves):
        name = move_name(number, len(moves), file)
        if isinstance(move, JointMove):
            targets_on(robot.model, move.target_deg, name, move.duration)
            before = stages[-1] if stages else None
            if isinstance(before, JointMoves):
                stages[-1] = JointMoves((*before.moves, move))
            else:
                stages.append(JointMoves((move,)))
            continue
        with _naming(name if len(moves) > 1 or file else ""):
            match move:
                case WalkMove(walk=walk):
                    figures = walk.model_extra or {}
                    amplitude = walk.amplitude
                    stages.append(Gait(planned_gait(robot, walk.gait, figures, steps=walk.steps, amplitude=amplitude)))
                case ActMove(act=act):
                    stages.append(Gait(planned_gait(robot, act.name, act.model_extra or {})))
                case AttachMove() | ReleaseMove():
                    station = handed_over(StationModel(station), robot.name, move)
                    stages.append(HandOver(move))
    return stages


def joint_reference(robot: LeggedGeometry, moves: Sequence[AnyMove]) -> tuple[Reference, float]:
    """Return the reference that moves of joints are from where a robot is, and its duration [s].

    Raises:
        InvalidParameter: no move, or one that is no move of joints.
        SimrobError: what the robot cannot do; names the move.
    """
    check_some(moves)
    joint_moves = [move for move in moves if isinstance(move, JointMove)]
    for number, move in enumerate(moves):
        if not isinstance(move, JointMove):
            kind = next(iter(type(move).model_fields))
            raise InvalidParameter(f"move {number}", kind, "a move of joints, to be run with other robots'")
    times, postures = postures_of(robot.model, joint_moves, robot.reference)
    if robot.cell.config.mode == "dynamic":
        return (times, postures), float(times[-1])
    return sequence(postures[0], times[1:].tolist(), list(postures[1:])), float(times[-1])


def handed_over(model: StationModel, robot: str, move: AttachMove | ReleaseMove) -> StationConfig:
    """Return the station in which a robot has taken a piece or let go of it.

    Raises:
        UnknownName: no such piece, tool or parent.
    """
    if isinstance(move, AttachMove):
        piece, tool, pose = move.attach.piece, move.attach.tool, move.attach.pose
        own = model.robots[robot]
        if tool is not None and tool not in own.tools:
            raise UnknownName(f"tool of {own.model.name}", tool, own.tools)
        if tool in model.config.pieces:
            return reparented(model, piece, tool, pose=pose)
        return reparented(model, piece, robot, frame=tool, pose=pose)
    return reparented(model, move.release.piece, move.release.parent)


def check_some(moves: Sequence[AnyMove]) -> None:
    """Check that a program to be run does something that takes time.

    Raises:
        InvalidParameter: it does not.
    """
    if all(isinstance(move, (AttachMove, ReleaseMove)) for move in moves):
        state = "without a move that takes time" if moves else "empty"
        raise InvalidParameter("the program", state, "one with moves: add_move() stores them")


@contextmanager
def _naming(move: str) -> Iterator[None]:
    """Put the name of a move before what goes wrong with it."""
    try:
        yield
    except SimrobError as problem:
        if move:
            problem.args = (f"{move}: {problem}",)
        raise
