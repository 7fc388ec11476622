"""A program of arms, move by move: looked at before anything moves, and run.

What a dynamic station does is known only once it is done. So the look at a program stands its robots where each move
leads them, without a simulation; it ends before a move that depends on a piece that was let fall, and before the
station's own references.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.arm_moves import PlannedMove, TogetherMove, ToolMove, in_si, said
from simrob_drake.programs.hands import apply
from simrob_drake.programs.moves import AttachMove, JointMove, PlayMove, ReleaseMove, WaitMove
from simrob_drake.programs.one_move import move_name, naming, targets_on
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.program import AnyMove, Program
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult

if TYPE_CHECKING:
    from simrob_drake.programs.workcell import Workcell

_Run = Callable[[list[Plan], float | None], Any]


def perform(cell: Workcell, program: Program, file: str = "") -> list[SimulationResult]:
    """Do a program of arms from where a station is; a run that does not go to its end is the last.

    Args:
        cell: the station.
        program: what is done.
        file: that it stands in, for messages.

    Returns:
        the runs, one for each move that takes time.

    Raises:
        SimrobError: what cannot be done, before anything moves where that can be known; names the move.
    """
    runs: list[SimulationResult] = []
    for number, move in enumerate(program.moves):
        with naming(move_name(number, len(program.moves), file)):
            run = _done(cell, move, program.robot, lambda plans, duration: cell.run(*plans, duration=duration))
        if run is not None:
            runs.append(run)
            if run.ending != "completed":
                break
    return runs


def rehearse(cell: Workcell, program: Program, file: str = "") -> tuple[int, float]:
    """Look whether arms can do a program, as far as that can be known without running it.

    Args:
        cell: a station of its own, which stands where the program leads it afterwards.
        program: what is to be done.
        file: that it stands in, for messages.

    Returns:
        how many of the moves were looked at, and how long they take [s].

    Raises:
        InvalidParameter: a program without a move that takes time.
        SimrobError: what cannot be done; names the move.
    """
    if all(isinstance(move, AttachMove | ReleaseMove | ToolMove) for move in program.moves):
        state = "without a move that takes time" if program.moves else "empty"
        raise InvalidParameter(file or "the program", state, "one with moves, such as move_abs_j")
    fallen, whole = set[str](), 0.0
    for number, move in enumerate(program.moves):
        if isinstance(move, PlayMove) or not fallen.isdisjoint(_names(move)):
            return number, whole
        with naming(move_name(number, len(program.moves), file)):
            whole += _done(cell, move, program.robot, lambda plans, duration: _stand(cell, plans, duration)) or 0.0
        fallen |= {name for name in cell.config.free_pieces if name in _names(move)}
    return len(program.moves), whole


def _done(cell: Workcell, move: AnyMove, robot: str | None, run: _Run) -> Any:
    """Do a move, and return what ``run`` gives; None of what takes no time."""
    if isinstance(move, WaitMove):
        return run([], move.wait)
    if isinstance(move, PlayMove):
        return cell.play(move.play)
    if isinstance(move, TogetherMove):
        return run([_plan(cell, one, robot) for one in move.together], move.duration)
    if isinstance(move, PlannedMove | JointMove):
        return run([_plan(cell, move, robot)], None)
    if isinstance(move, AttachMove) and move.attach.parent is None and move.attach.tool is None:
        taken = move.attach
        cell.arm(taken.robot or robot).attach(taken.piece, frame=taken.frame, pose=taken.pose)
        return None
    if isinstance(move, AttachMove | ReleaseMove | ToolMove):
        apply(cell, move, robot)
        return None
    raise InvalidParameter("the move", next(iter(type(move).model_fields)), "one of arms: this one is for legs")


def _plan(cell: Workcell, move: PlannedMove | JointMove, robot: str | None) -> Plan:
    if isinstance(move, JointMove):
        arm = cell.arm(robot)
        posture = arm.reference
        for place, position in targets_on(cell.robot(arm.name).model, move.target_deg, "the target").items():
            posture[place] = position
        return arm.plan.move_abs_j(posture, duration=move.duration)
    name, own = said(move)
    arm = cell.arm(own.robot or robot)
    of_axes, targets = name == "move_abs_j", own.targets
    if own.targets_deg is not None:
        targets = in_si(own.targets_deg, poses=not of_axes, units=cell.robot(arm.name).model.user_units)
    more = {key: getattr(own, key) for key in ("wobj", "solver", "stop", "via") if getattr(own, key, None) is not None}
    plan: Plan = getattr(arm.plan, name)(targets=targets, **more, **own.how)
    return plan


def _stand(cell: Workcell, plans: list[Plan], duration: float | None) -> float:
    """Put robots where their moves lead them, and return how long the moves take [s]."""
    cell.check_together(*plans)
    time = max(plan.duration for plan in plans) if duration is None else duration
    at = {robot: cell.reference(robot) for robot in cell.config.robots}
    at |= {plan.robot: plan.postures(np.array([min(time, plan.duration)]))[0] for plan in plans}
    still = {robot: np.zeros_like(posture) for robot, posture in at.items()}
    before = cell.state or State(at, still, at)
    cell.state = replace(before, positions=at, velocities=still, references=at)
    return time


def _names(move: AnyMove) -> Iterator[str]:
    """Yield the pieces that a move names."""
    if isinstance(move, AttachMove):
        yield move.attach.piece
    elif isinstance(move, ReleaseMove):
        yield move.release.piece
    elif isinstance(move, TogetherMove):
        for one in move.together:
            yield from _names(one)
    elif isinstance(move, PlannedMove):
        wobj = getattr(said(move)[1], "wobj", None)
        if isinstance(wobj, str):
            yield wobj.split(".", 1)[0]


ARM_ONLY = PlannedMove | ToolMove | TogetherMove
"""Moves by which a program is one of arms."""
