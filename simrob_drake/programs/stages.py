"""A program of a robot with legs in stages that run one after the other, each within the limits of its joints.

Moves of joints that follow each other are one run, each walk and act is one, and pieces change hands between runs. All
of a program is checked before the first stage runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import sequence
from simrob_drake.programs.gaits.registry import carries, first_gait, gaits_of
from simrob_drake.programs.gaits.sequences import Posing
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.joints import JointMove, move_of, targets_on
from simrob_drake.programs.moves.kinds import leg_kinds
from simrob_drake.programs.moves.move import Move, Outlook, Stage, checked, move_name, naming, reference_name
from simrob_drake.programs.moves.walk import WalkMove
from simrob_drake.programs.program import Program, run_cells
from simrob_drake.results.record.run import MoveSpan, move_title
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import ReferenceLike
from simrob_drake.stations.config import StationConfig

SEQUENCE = "step"  # the sequence of a robot's ``gaits.yaml`` that is a step by joint angles, if it has one


@dataclass(frozen=True)
class Snapshot:
    """What a robot goes back to when something is undone: a program, where a station is, how it is, its time [s]."""

    program: Program
    state: State | None
    config: StationConfig
    now: float


@dataclass(frozen=True)
class ProgramStage:
    """A part of a program that is one run, or takes no time.

    Attributes:
        run: runs the stage.
        first: index of its first move in the program.
        durations: how long its moves take [s], one each. That of a single move is known only when the stage has run,
            and is 0 before; the references of an automatic program have none.
    """

    run: Stage
    first: int = 0
    durations: Sequence[float] = ()

    def spans(self, begin: float, end: float) -> list[MoveSpan]:
        """Find when each move of the stage began and ended, of a run from ``begin`` to ``end`` [s].

        Moves that were not begun, because the run was ended before, are left out.
        """
        spans: list[MoveSpan] = []
        last = len(self.durations) - 1
        now = begin
        for number, duration in enumerate(self.durations):
            # The last move lasts to the end of the run, which can be longer than the moves: it ends on the grid.
            move_end = end if number == last else min(now + duration, end)
            spans.append(MoveSpan(index=self.first + number, begin=now, end=move_end))
            now = move_end
            if number < last and now >= end:
                break
        return spans


def stages_of(
    robot: LeggedGeometry, moves: Sequence[Move], station: StationConfig, file: str = ""
) -> list[ProgramStage]:
    """Cut a robot's checked moves into stages, from a station on.

    Moves of joints that follow each other are one stage, each other move is one.

    Raises:
        SimrobError: a move that cannot be done; names the move, and its file.
    """
    outlook = Outlook(station)
    stages: list[ProgramStage] = []
    joint_moves: list[JointMove] = []  # of the stage that goes on; empty after another move
    for number, move in enumerate(moves):
        name = move_name(number, len(moves), file)
        with naming("" if isinstance(move, JointMove) or (len(moves) == 1 and not file) else name):
            stage = move.stage(robot, outlook, name)
        if not isinstance(move, JointMove):
            joint_moves = []
            stages.append(ProgramStage(stage, first=number, durations=(0.0,)))
            continue
        if joint_moves:
            stages.pop()  # it is made anew with one move more
        joint_moves = [*joint_moves, move]
        first = number + 1 - len(joint_moves)
        durations = [joint_move.duration for joint_move in joint_moves]
        stages.append(ProgramStage(partial(_move_joints, moves=joint_moves), first=first, durations=durations))
    return stages


def stages_of_program(
    robot: LeggedGeometry, program: Program, station: StationConfig, file: str = ""
) -> list[ProgramStage]:
    """Cut a program into stages as :func:`stages_of` does; the references of an automatic one are a single stage.

    Raises InvalidParameter: a program that does nothing; SimrobError: as :func:`stages_of`.
    """
    _check_references(robot, program, file)
    if program.automatic:
        return [ProgramStage(partial(run_cells, cells=program.references, pace=program.automatic))]
    check_takes_time(program.moves)
    return stages_of(robot, leg_moves(program, file), station, file)


def leg_moves(program: Program, file: str = "") -> tuple[Move, ...]:
    """Return the moves of a program for a robot with legs; raises InvalidParameter: one for arms."""
    for number, move in enumerate(program.moves):
        if not move.of_legs:
            expected = message(
                "programs.one_of_leg_kinds", "one of {kinds}: the others are for arms", kinds=", ".join(leg_kinds())
            )
            raise InvalidParameter(move_name(number, len(program.moves), file), move.key, expected)
    return program.moves


def check_program(robot: LeggedGeometry, program: Program, station: StationConfig, file: str = "") -> None:
    """Check that a robot can do all of a program, moves and references; raises SimrobError: as :func:`stages_of`."""
    _check_references(robot, program, file)
    stages_of(robot, leg_moves(program, file), station, file)


def check_takes_time(
    moves: Sequence[Move],
    name: str = message("programs.the_program", "the program"),
    expected: str = message("programs.moves_stored", "one with moves: add_move() stores them"),
) -> None:
    """Check that a program to be run does something that takes time; raises InvalidParameter: it does not."""
    if not any(move.takes_time for move in moves):
        state = message("programs.without_taking_time", "without a move that takes time") if moves else "empty"
        raise InvalidParameter(name, state, expected)


def joint_reference(robot: LeggedGeometry, moves: Sequence[Move]) -> tuple[ReferenceLike, float]:
    """Return the reference that moves of joints are from where a robot is, and its duration [s].

    Raises InvalidParameter: no move, or one that is no move of joints; SimrobError: what the robot cannot do; names the
    move.
    """
    check_takes_time(moves)
    joint_moves = list[JointMove]()
    for number, move in enumerate(moves):
        if not isinstance(move, JointMove):
            raise InvalidParameter(
                move_title(number),
                move.key,
                message("programs.move_with_other_robots", "a move of joints, to be run with other robots'"),
            )
        joint_moves.append(move)
    times, postures = postures_of(robot.model, joint_moves, robot.reference)
    if robot.cell.config.engine.moves_by_forces:
        return (times, postures), float(times[-1])
    return sequence(postures[0], times[1:].tolist(), list(postures[1:])), float(times[-1])


def postures_of(model: RobotModel, moves: Sequence[JointMove], start: Vector) -> tuple[Vector, Vector]:
    """Return when moves of joints end and where, the start included: times (k + 1,) [s], postures (k + 1, n).

    Axes that no move names stay as at the start (n,) [rad or m]. Raises SimrobError: as :func:`targets_on`.
    """
    times, postures = [0.0], [np.array(start, dtype=float)]
    for number, move in enumerate(moves):
        posture = postures[-1].copy()
        where = move_name(number, len(moves))
        for place, position in targets_on(model, move.target_deg, where, move.duration).items():
            posture[place] = position
        times.append(times[-1] + move.duration)
        postures.append(posture)
    return np.array(times), np.array(postures)


def step_moves(model: RobotModel, feet: str | None, move_time: float | None = None) -> list[Move]:
    """Return one step ahead: the robot's sequence ``step``, else a step of its first gait, of full length.

    ``move_time`` is of each move or step, their own unless given [s]. Raises InvalidParameter: a robot without feet or
    gaits, without a gait for the feet that it wears, or a time that is not positive.
    """
    if model.feet is None:
        raise InvalidParameter(
            "robot", model.name, message("programs.robot_with_legs", "one with legs: step() is for legged robots")
        )
    own = gaits_of(model, steps=False).get(SEQUENCE)
    if isinstance(own, Posing) and carries(model, feet, own.made_for(model)):
        return _moves_of(model, own, move_time)
    known = gaits_of(model, steps=True)
    gait = known[first_gait(model, feet, known)]
    changes = {**gait.one_step, **({} if move_time is None else {gait.pace: move_time})}
    return [checked(WalkMove, steps=1, **changes)]


def _moves_of(model: RobotModel, own: Posing, move_time: float | None) -> list[Move]:
    times = np.diff([0.0, *(target.time for target in own.targets)])
    return [
        move_of(
            target.target_deg if isinstance(target.target_deg, dict) else _targets_of_driven(model, target.target_deg),
            float(time) if move_time is None else move_time,
        )
        for target, time in zip(own.targets, times, strict=True)
    ]


def _targets_of_driven(model: RobotModel, target_deg: AxisValues) -> dict[str, float]:
    """Spread one number or a list over the axes that have a motor, by name [deg, or m of a prismatic axis]."""
    values = model.axis_vector(target_deg, SEQUENCE).tolist()
    by_axis = dict(zip(model.axes, values, strict=True))
    return {axis: value for axis, value in by_axis.items() if axis not in model.passive_axes}


def _check_references(robot: LeggedGeometry, program: Program, file: str) -> None:
    for number, cell in enumerate(program.references):
        cell.refuse_check(reference_name(number, file))
        targets_on(robot.model, cell.target_deg, reference_name(number, file))


def _move_joints(robot: LeggedGeometry, moves: Sequence[Move]) -> SimulationResult:
    reference, duration = joint_reference(robot, moves)
    return robot.cell.follow({robot.name: reference}, duration)
