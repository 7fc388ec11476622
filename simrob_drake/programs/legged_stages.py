"""A program of a legged robot in stages that run one after the other, each within the limits of its joints.

Moves of joints that follow each other are one run, each walk and act is one, and pieces change hands between runs. All
of a program is checked before the first stage runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby

import numpy as np

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.automatic import run_cells
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.going import going, perform_go
from simrob_drake.programs.grasps import let_go
from simrob_drake.programs.hands import apply, taker
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.model import StationModel, reparented
from simrob_drake.programs.moves import (
    LEG_KINDS,
    ActMove,
    AttachMove,
    GoMove,
    JointMove,
    LegMove,
    PlayMove,
    ReleaseMove,
    WaitMove,
    WalkMove,
)
from simrob_drake.programs.one_move import move_name, naming, targets_on
from simrob_drake.programs.ongoing import GOES_ON
from simrob_drake.programs.program import Program
from simrob_drake.results.record.walks import fallen
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import Reference
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.yaml_files import Strict

Stage = Callable[[LeggedGeometry], SimulationResult | None]
"""A part of a program, checked and ready, that a robot does from where it is; None of one that takes no time."""


def stages_of(robot: LeggedGeometry, moves: Sequence[LegMove], station: StationConfig, file: str = "") -> list[Stage]:
    """Cut a program into stages, after checking all of it.

    Args:
        robot: who does it.
        moves: of the program.
        station: as it is when the program begins.
        file: that the program stands in, for messages.

    Raises:
        SimrobError: what the robot cannot do; names the move.
    """
    stages, changed = list[Stage](), False
    for of_joints, group in groupby(enumerate(moves), lambda entry: isinstance(entry[1], JointMove)):
        numbered = list(group)
        if of_joints:
            stages.append(partial(_move_joints, moves=[move for _, move in numbered]))
        for number, move in numbered:
            name = move_name(number, len(moves), file)
            if isinstance(move, JointMove):
                targets_on(robot.model, move.target_deg, name, move.duration)
                continue
            if isinstance(move, WaitMove | PlayMove):
                stages.append(partial(_let_pass, move=move))
                changed = changed or isinstance(move, PlayMove)
                continue
            with naming(name if len(moves) > 1 or file else ""):
                if isinstance(move, GoMove):
                    going(station, robot.name, move.go)
                    stages.append(partial(_called, stage=partial(perform_go, go=move.go), did="go"))
                    changed = True
                elif isinstance(move, AttachMove | ReleaseMove):
                    station, changed = handed_over(StationModel(station), robot.name, move), True
                    stages.append(partial(_hand_over, move=move, name=name))
                else:
                    motion = _planned(robot, move, station)
                    anew = changed or resolve(station).ground.incline  # then it depends on what was done before
                    stage = (
                        partial(_walk_anew, move=move, name=name) if anew else partial(_go_as_planned, plan=[motion])
                    )
                    did = f"act {move.act.name}" if isinstance(move, ActMove) else "walk"
                    stages.append(partial(_called, stage=stage, did=did))
    return stages


def stages_of_program(robot: LeggedGeometry, program: Program, station: StationConfig, file: str = "") -> list[Stage]:
    """Cut a program into stages as :func:`stages_of` does; the references of an automatic one are a single stage.

    Raises:
        InvalidParameter: a program that does nothing.
        SimrobError: as :func:`stages_of`.
    """
    _check_references(robot, program, file)
    if program.automatic:
        return [partial(run_cells, cells=program.references, pace=program.automatic)]
    check_some(program.moves)
    return stages_of(robot, leg_moves(program, file), station, file)


def leg_moves(program: Program, file: str = "") -> list[LegMove]:
    """Return the moves of a program for a robot with legs.

    Raises:
        InvalidParameter: one for arms.
    """
    moves: list[LegMove] = []
    for number, move in enumerate(program.moves):
        if not isinstance(move, LegMove):
            kind, told = next(iter(type(move).model_fields)), f"one of {', '.join(LEG_KINDS)}: the others are for arms"
            raise InvalidParameter(move_name(number, len(program.moves), file), kind, told)
        moves.append(move)
    return moves


def check_program(robot: LeggedGeometry, program: Program, station: StationConfig, file: str = "") -> None:
    """Check that a robot can do all of a program, moves and references.

    Raises:
        SimrobError: as :func:`stages_of`.
    """
    _check_references(robot, program, file)
    stages_of(robot, leg_moves(program, file), station, file)


def _check_references(robot: LeggedGeometry, program: Program, file: str) -> None:
    for number, cell in enumerate(program.references):
        targets_on(robot.model, cell.target_deg, f"{file}: references[{number}]" if file else f"reference {number}")


def _planned(robot: LeggedGeometry, move: WalkMove | ActMove, station: StationConfig) -> JointMotion:
    if isinstance(move, ActMove):
        return planned_gait(robot, move.act.name, move.act.model_extra or {}, station=station)
    walk, more = move.walk, move.walk.model_extra or {}
    return planned_gait(robot, walk.gait, more, steps=walk.steps, amplitude=walk.amplitude, station=station)


def _called(robot: LeggedGeometry, stage: Callable[[LeggedGeometry], SimulationResult], did: str) -> SimulationResult:
    return replace(stage(robot), did=did)


def _go_as_planned(robot: LeggedGeometry, plan: list[JointMotion]) -> SimulationResult:
    return perform(robot, plan.pop())  # nobody keeps it while it runs


def _walk_anew(robot: LeggedGeometry, move: WalkMove | ActMove, name: str) -> SimulationResult:
    with naming(name):
        return perform(robot, _planned(robot, move, robot.cell.config))


def _move_joints(robot: LeggedGeometry, moves: Sequence[LegMove]) -> SimulationResult:
    reference, duration = joint_reference(robot, moves)
    return robot.cell.follow({robot.name: reference}, duration)


def _let_pass(robot: LeggedGeometry, move: WaitMove | PlayMove) -> SimulationResult:
    return robot.cell.wait(move.wait) if isinstance(move, WaitMove) else robot.cell.play(move.play)


def _hand_over(robot: LeggedGeometry, move: AttachMove | ReleaseMove, name: str) -> None:
    with naming(name):
        apply(robot.cell, move, robot.name)


def joint_reference(robot: LeggedGeometry, moves: Sequence[LegMove]) -> tuple[Reference, float]:
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
    """Return the station in which a robot has taken a piece or let go of it, however far away it is now.

    Raises:
        UnknownName: no such piece, tool or parent.
    """
    if isinstance(move, AttachMove):
        parent, frame = taker(model.config, move.attach.robot or robot, move.attach)
        return reparented(model, move.attach.piece, parent, frame=frame, pose=move.attach.pose)
    let = move.release
    return let_go(model, let.piece, let.parent, frame=let.frame, fixed=let.fixed)


def check_some(moves: Sequence[Strict]) -> None:
    """Check that a program to be run does something that takes time.

    Raises:
        InvalidParameter: it does not.
    """
    if all(isinstance(move, (AttachMove, ReleaseMove)) for move in moves):
        state = "without a move that takes time" if moves else "empty"
        raise InvalidParameter("the program", state, "one with moves: add_move() stores them")


def goes_on(result: SimulationResult) -> bool:
    """Tell whether a robot goes on from the end of a run: it came to an end, and no robot lies on the floor."""
    return result.ending in GOES_ON and fallen(result) is None


def postures_of(model: RobotModel, moves: Sequence[JointMove], start: Vector) -> tuple[Vector, Vector]:
    """Return when moves of joints end and where, the start included: times (k + 1,) [s], postures (k + 1, n).

    Args:
        model: the robot.
        moves: one after the other.
        start: the posture before them, shape (n,) [rad or m]; axes that no move names stay there.

    Raises:
        SimrobError: as :func:`targets_on`.
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
