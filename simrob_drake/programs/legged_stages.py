"""A program of a legged robot in stages that run one after the other, each within the limits of its joints.

Moves of joints that follow each other are one run, each walk and act is one, and pieces change hands between runs. All
of a program is checked before the first stage runs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import groupby

import numpy as np

from simrob_drake.blocks.references import sequence
from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.grasps import let_go
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.model import StationModel, reparented
from simrob_drake.programs.moves import ActMove, AnyMove, AttachMove, JointMove, ReleaseMove, WalkMove
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import Reference
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

Stage = Callable[[LeggedGeometry], SimulationResult | None]
"""A part of a program, checked and ready, that a robot does from where it is; None of one that takes no time."""
_ROUNDING = 1e-9  # rad or m


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
            with _naming(name if len(moves) > 1 or file else ""):
                if isinstance(move, AttachMove | ReleaseMove):
                    station, changed = handed_over(StationModel(station), robot.name, move), True
                    stages.append(partial(_hand_over, move=move, name=name))
                else:
                    motion = _planned(robot, move, station)
                    anew = changed or resolve(station).ground.incline  # then it depends on what was done before
                    stages.append(
                        partial(_walk_anew, move=move, name=name) if anew else partial(perform, motion=motion)
                    )
    return stages


def _planned(robot: LeggedGeometry, move: WalkMove | ActMove, station: StationConfig) -> JointMotion:
    if isinstance(move, ActMove):
        return planned_gait(robot, move.act.name, move.act.model_extra or {}, station=station)
    walk, more = move.walk, move.walk.model_extra or {}
    return planned_gait(robot, walk.gait, more, steps=walk.steps, amplitude=walk.amplitude, station=station)


def _walk_anew(robot: LeggedGeometry, move: WalkMove | ActMove, name: str) -> SimulationResult:
    with _naming(name):
        return perform(robot, _planned(robot, move, robot.cell.config))


def _move_joints(robot: LeggedGeometry, moves: Sequence[AnyMove]) -> SimulationResult:
    reference, duration = joint_reference(robot, moves)
    return robot.cell.follow({robot.name: reference}, duration)


def _hand_over(robot: LeggedGeometry, move: AttachMove | ReleaseMove, name: str) -> None:
    with _naming(name):
        if isinstance(move, ReleaseMove):
            given = move.release
            robot.cell.release(given.piece, given.parent, fixed=given.fixed)
        else:
            piece, (parent, frame) = move.attach, _taker(robot.cell.config, robot.name, move)
            robot.cell.attach(piece.piece, parent, frame=frame, pose=piece.pose)


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
    """Return the station in which a robot has taken a piece or let go of it, however far away it is now.

    Raises:
        UnknownName: no such piece, tool or parent.
    """
    if isinstance(move, AttachMove):
        parent, frame = _taker(model.config, robot, move)
        return reparented(model, move.attach.piece, parent, frame=frame, pose=move.attach.pose)
    return let_go(model, move.release.piece, move.release.parent, fixed=move.release.fixed)


def _taker(station: StationConfig, robot: str, move: AttachMove) -> tuple[str, str | None]:
    """Return what a robot takes a piece with: a piece that it carries, or itself with a tool."""
    tool = move.attach.tool
    return (tool, None) if tool is not None and tool in station.pieces else (robot, tool)


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


def targets_on(model: RobotModel, target_deg: Mapping[str, float], where: str, time: float = 0.0) -> dict[int, float]:
    """Return the targets of a move on one robot: the place of each axis, and its position [rad or m].

    Args:
        model: the robot.
        target_deg: by axis name or alias.
        where: what messages call the move.
        time: how long it takes, for the error [s].

    Raises:
        UnknownName: an axis that the robot does not have; proposes the nearest.
        InvalidParameter: an axis under two names.
        JointLimitExceeded: a target beyond an axis' limits; tells by how much.
    """
    names, units, slides = list(model.axes), model.user_units, model.prismatic
    lower, upper = model.axis_limits
    found: dict[int, float] = {}
    for axis, value in target_deg.items():
        place = model.axis_index(axis, where)
        if place in found:
            raise InvalidParameter(f"{where}: {axis}", "another name of an axis that it moves, too", "named once")
        position = float(value * units[place])
        bound = lower[place] if position < lower[place] else upper[place]
        if abs(position - np.clip(position, lower[place], upper[place])) > _ROUNDING:
            unit, limit = ("m" if slides[place] else "deg"), bound / units[place]
            shown = f"{value:.4g} {unit}, {abs(value - limit):.4g} {unit} beyond its limit of {limit:.4g} {unit}"
            raise JointLimitExceeded(where, names[place], point=1, time=time, value=position, shown=shown)
        found[place] = position
    return found


def move_name(number: int, count: int, file: str = "") -> str:
    """Return what messages call a move of a program that has so many, and may stand in a file."""
    if file:
        return f"{file}: moves[{number}]"
    return f"move {number}" if count > 1 else "the move"


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
