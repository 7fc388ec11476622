"""Programs of a robot with legs, cut into stages that run one after the other.

A *stage* is one run of the station, or an action that takes no time. Moves of joints that follow each other are one
stage, each walk and each act is one, and pieces are attached and released between runs. The whole program is checked
before its first stage runs.

An *automatic* program has references instead of moves, also called cells: postures to which a controller leads the
robot, each when the last one is reached.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import sequence
from simrob_drake.programs.gaits.registry import carries, first_gait, gaits_of
from simrob_drake.programs.gaits.sequences import Posing
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.joints import JointMove, move_of, targets_on
from simrob_drake.programs.moves.kinds import leg_kinds
from simrob_drake.programs.moves.move import (
    Move,
    Outlook,
    Stage,
    make_move,
    move_name,
    naming,
    reference_name,
)
from simrob_drake.programs.moves.walk import WalkMove
from simrob_drake.programs.program import Program, run_cells
from simrob_drake.results.record.run import MoveSpan, move_title
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import ReferenceLike
from simrob_drake.stations.config import StationConfig

SEQUENCE = "step"
"""Name of the sequence in a robot's ``gaits.yaml`` that is a single step by joint angles."""


@dataclass(frozen=True)
class Snapshot:
    """State to which a robot returns when something is undone.

    Attributes:
        program: the program.
        state: state of the station. If it is None, the station has not moved yet.
        config: description of the station.
        now: time of the station [s].
    """

    program: Program
    state: State | None
    config: StationConfig
    now: float


@dataclass(frozen=True)
class ProgramStage:
    """A stage of a program, with the moves that it contains.

    Attributes:
        run: function that runs the stage.
        first: index of its first move in the program.
        durations: duration of each of its moves [s]. A stage of one move that is no move of joints has a single 0,
            because its duration is known only after the run. The stage of an automatic program has none.
    """

    run: Stage
    first: int = 0
    durations: Sequence[float] = ()

    def spans(self, begin: float, end: float) -> list[MoveSpan]:
        """Compute when each move of the stage began and ended.

        Args:
            begin: time at which the run of the stage began [s].
            end: time at which it ended [s].

        Returns:
            One span for each move, without those that had not begun when the run ended. The stage of an automatic
            program has no spans.
        """
        spans: list[MoveSpan] = []
        last = len(self.durations) - 1
        now = begin
        for number, duration in enumerate(self.durations):
            # The last move lasts to the end of the run, which can be longer than the moves: it ends on the grid.
            move_end = end if number == last else min(now + duration, end)
            spans.append(MoveSpan(index=self.first + number, begin=now, end=move_end))
            now = move_end
            # A monitor has ended the run here: later moves have not begun.
            if number < last and now >= end:
                break
        return spans


def stages_of(
    robot: LeggedGeometry,
    moves: Sequence[Move],
    station: StationConfig,
    file: str = "",
) -> list[ProgramStage]:
    """Check moves of a robot, and cut them into stages.

    Args:
        robot: the robot.
        moves: the moves.
        station: the station as it will be before the first move.
        file: file of the program for messages. It is empty if there is none.

    Returns:
        The stages, in order. Moves of joints that follow each other are one stage, each other move is one.

    Raises:
        SimrobError: the robot cannot perform a move. The message names the move and the file.
    """
    outlook = Outlook(station)  # each move changes it to the station as it will be after the move
    stages: list[ProgramStage] = []
    joint_moves: list[JointMove] = []  # moves of the last stage, if it consists of moves of joints
    for number, move in enumerate(moves):
        name = move_name(number, len(moves), file)
        # Moves of joints name themselves in their messages, and a single move needs no name.
        is_only_move = len(moves) == 1 and not file
        needs_name = not isinstance(move, JointMove) and not is_only_move
        with naming(name if needs_name else ""):
            # Moves of joints are checked here as well, although the stage of the whole group replaces their own
            # stages.
            stage = move.stage(robot, outlook, name)
        if not isinstance(move, JointMove):
            joint_moves = []
            stages.append(ProgramStage(stage, first=number, durations=(0.0,)))
            continue
        if joint_moves:
            stages.pop()  # a new one with one move more replaces it
        joint_moves = [*joint_moves, move]
        first = number + 1 - len(joint_moves)
        durations = [joint_move.duration for joint_move in joint_moves]
        stages.append(
            ProgramStage(partial(_move_joints, moves=joint_moves), first=first, durations=durations)
        )
    return stages


def stages_of_program(
    robot: LeggedGeometry,
    program: Program,
    station: StationConfig,
    file: str = "",
) -> list[ProgramStage]:
    """Check a program, and cut it into stages, see :func:`stages_of`. An automatic program is a single stage.

    Args:
        robot: the robot.
        program: the program.
        station: the station as it will be before the first move.
        file: file of the program for messages. It is empty if there is none.

    Raises:
        InvalidParameter: the program is not automatic, and no move takes time or one is not possible for robots with
            legs.
        SimrobError: the robot cannot perform a move, or cannot reach a reference.
    """
    _check_references(robot, program, file)
    # `program.automatic` has the options of a program of cells, and is None for a program of moves.
    if program.automatic:
        return [ProgramStage(partial(run_cells, cells=program.references, pace=program.automatic))]
    # A program that only attaches pieces has no run, and so no result that could be returned.
    check_takes_time(program.moves)
    return stages_of(robot, leg_moves(program, file), station, file)


def leg_moves(program: Program, file: str = "") -> tuple[Move, ...]:
    """Moves of a program, checked to be of kinds that robots with legs can perform; arms may perform them, too.

    Args:
        program: the program.
        file: file of the program for messages. It is empty if there is none.

    Raises:
        InvalidParameter: a move is of a kind for arms only. The message names the move and the file.
    """
    for number, move in enumerate(program.moves):
        # Named here, because the move itself would only say that it is for arms.
        if not move.of_legs:
            expected = message(
                "programs.one_of_leg_kinds",
                "a move for robots with legs: one of {kinds}",
                kinds=", ".join(leg_kinds()),
            )
            raise InvalidParameter(move_name(number, len(program.moves), file), move.key, expected)
    return program.moves


def check_program(
    robot: LeggedGeometry, program: Program, station: StationConfig, file: str = ""
) -> None:
    """Check that a robot can perform a program, both its moves and its references. A program may have none of either.

    Args:
        robot: the robot.
        program: the program.
        station: the station as it will be before the first move.
        file: file of the program for messages. It is empty if there is none.

    Raises:
        SimrobError: the robot cannot perform a move, or cannot reach a reference.
    """
    _check_references(robot, program, file)
    stages_of(robot, leg_moves(program, file), station, file)


def check_takes_time(
    moves: Sequence[Move],
    name: str = message("programs.the_program", "the program"),
    remedy: str = message("programs.moves_stored", "add one by add_move()"),
) -> None:
    """Check that at least one move of a program takes time.

    Args:
        moves: the moves.
        name: name of the program for the message.
        remedy: how to add a move, as a command for the message.

    Raises:
        Unsuitable: no move takes time.
    """
    if not any(move.takes_time for move in moves):
        problem = message("programs.without_taking_time", "it has no move that takes time")
        raise Unsuitable(name, problem, remedy)


class JointReference(NamedTuple):
    """Reference of the axes of a robot.

    Attributes:
        reference: the reference, as :func:`simrob_drake.simulate` accepts it.
        duration: its duration [s].
    """

    reference: ReferenceLike
    duration: float


def joint_reference(robot: LeggedGeometry, moves: Sequence[Move]) -> JointReference:
    """Make the reference for moves of joints from where a robot's reference is. Nothing moves.

    On a dynamic station it consists of straight lines between the postures at the ends of the moves, on a kinematic one
    it is smooth, with rest at each of these postures.

    Args:
        robot: the robot.
        moves: the moves, one after the other.

    Raises:
        InvalidParameter: there is no move, or one that is no move of joints.
        SimrobError: the robot cannot reach a target. The message names the move.
    """
    check_takes_time(moves)
    joint_moves = list[JointMove]()
    for number, move in enumerate(moves):
        if not isinstance(move, JointMove):
            raise InvalidParameter(
                move_title(number),
                move.key,
                message(
                    "programs.move_with_other_robots",
                    "a move of joints: only such moves run at the same time as those of other robots",
                ),
            )
        joint_moves.append(move)
    times, postures = postures_of(robot.model, joint_moves, robot.reference)
    duration = float(times[-1])
    if robot.cell.config.engine.moves_by_forces:
        # The servos of a dynamic station get straight lines between the postures, as in SimRob.
        return JointReference((times, postures), duration)
    # A kinematic station is wherever the reference is, which therefore has to be smooth.
    return JointReference(sequence(postures[0], times[1:].tolist(), list(postures[1:])), duration)


class TimedPostures(NamedTuple):
    """Postures at the ends of moves of joints.

    Attributes:
        times: times at which the moves end, from 0 on, shape (k + 1,) [s].
        postures: positions of the axes at these times, shape (k + 1, n) [rad or m].
    """

    times: Vector
    postures: Vector


def postures_of(model: RobotModel, moves: Sequence[JointMove], start: Vector) -> TimedPostures:
    """Compute the postures at the ends of moves of joints.

    Args:
        model: the robot.
        moves: the moves.
        start: posture at the start, shape (n,) [rad or m]. Axes that no move names stay there.

    Raises:
        SimrobError: a target is wrong, see :func:`targets_on`.
    """
    times = [0.0]
    postures = [np.array(start, dtype=float)]
    for number, move in enumerate(moves):
        # Axes without a target keep the position of the move before.
        posture = postures[-1].copy()
        where = move_name(number, len(moves))
        for index, position in targets_on(model, move.target_deg, where, move.duration).items():
            posture[index] = position
        times.append(times[-1] + move.duration)
        postures.append(posture)
    return TimedPostures(np.array(times), np.array(postures))


def step_moves(model: RobotModel, feet: str | None, move_time: float | None = None) -> list[Move]:
    """Make the moves of one step ahead.

    They are those of the robot's sequence ``step``, one move of joints for each of its postures. If the robot has no
    such sequence for its feet, it is one walk of a full step by its first gait.

    Args:
        model: the robot.
        feet: kind of its feet in the station. It is None if the robot has no feet.
        move_time: duration of each move, or of the step [s]. If it is None, those of the sequence or the gait.

    Raises:
        InvalidParameter: the robot has no feet, no gaits, or no gait for these feet; or the time is not positive.
    """
    if model.feet is None:
        raise InvalidParameter(
            "robot",
            model.name,
            message("programs.robot_with_legs", "a robot with legs, for step()"),
        )
    # The thesis describes its step by joint angles. Robots that have such a sequence take this step.
    own_step = gaits_of(model, steps=False).get(SEQUENCE)
    if isinstance(own_step, Posing) and carries(model, feet, own_step.made_for(model)):
        return _moves_of_sequence(model, own_step, move_time)
    gaits = gaits_of(model, steps=True)
    gait = gaits[first_gait(model, feet, gaits)]
    # Parameters with which the gait takes a single step; `pace` is the name of its parameter for the time of a step.
    changes = dict(gait.one_step)
    if move_time is not None:
        changes[gait.pace] = move_time
    return [make_move(WalkMove, steps=1, **changes)]


def _moves_of_sequence(model: RobotModel, posing: Posing, move_time: float | None) -> list[Move]:
    """Make one move of joints for each posture of a sequence.

    Args:
        model: the robot.
        posing: the sequence.
        move_time: duration of each move [s]. If it is None, the time between the postures of the sequence.
    """
    # The sequence has times since its start [s], a move has a duration.
    durations = np.diff([0.0, *(target.time for target in posing.targets)])
    moves = list[Move]()
    for target, duration in zip(posing.targets, durations, strict=True):
        # A mapping names its axes. A single number, or a list, is for all axes.
        target_deg = target.target_deg
        if not isinstance(target_deg, dict):
            target_deg = _targets_of_driven(model, target_deg)
        moves.append(move_of(target_deg, float(duration) if move_time is None else move_time))
    return moves


def _targets_of_driven(model: RobotModel, target_deg: AxisValues) -> dict[str, float]:
    """Targets by axis name from one number for all axes or one for each [deg, or m of a prismatic axis].

    Axes without a motor (passive axes) are left out, because they cannot follow a target.
    """
    values = model.axis_vector(target_deg, SEQUENCE).tolist()
    by_axis = dict(zip(model.axes, values, strict=True))
    return {axis: value for axis, value in by_axis.items() if axis not in model.passive_axes}


def _check_references(robot: LeggedGeometry, program: Program, file: str) -> None:
    """Check the targets of all references of a program. There may be none.

    Args:
        robot: the robot.
        program: the program.
        file: file of the program for messages. It is empty if there is none.

    Raises:
        Unsuitable: a reference has an option `check` other than the default.
        SimrobError: a target is wrong, see :func:`targets_on`. The message names the reference, and the file if the
            text `file` is not empty.
    """
    for number, reference in enumerate(program.references):
        name = reference_name(number, file)
        # A sequencer is the controller that leads the joints to the references: it checks no collisions on the way.
        reference.refuse_check(name)
        targets_on(robot.model, reference.target_deg, name)


def _move_joints(robot: LeggedGeometry, moves: Sequence[Move]) -> SimulationResult:
    """Run moves of joints, one after the other, as one run from where the robot's reference is."""
    reference, duration = joint_reference(robot, moves)
    return robot.cell.follow({robot.name: reference}, duration)
