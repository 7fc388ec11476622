"""What the file of a program says of what was done with an arm in Python."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.errors import SimrobError
from simrob_drake.frames import POSE_SIZE, PoseLike, as_transform, pose_from_transform, poses_from_matrices
from simrob_drake.kinematics.poses import pose_matrices
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.parts.site import WORLD
from simrob_drake.programs.arm_moves import PLANNED, ArmMove, PlannedMove, TogetherMove, ToolMove, said
from simrob_drake.programs.moves import PlayMove, WaitMove, plain
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.targets import HasTool, PoseTargets, WorkObject, is_place

_SAME = 1e-12  # m and parts of a rotation: rounding


def told_pose(pose: PoseLike) -> list[float]:
    """Return a pose as a file says it, [x y z Rz Ry Rx]; numbers that it was given by are kept to the last bit."""
    if not isinstance(pose, RigidTransform) and np.shape(pose) == (POSE_SIZE,):
        return [float(value) for value in np.asarray(pose)]
    return [float(value) for value in pose_from_transform(as_transform(pose))]


def told(
    name: str,
    robot: str,
    targets: PoseTargets,
    how: Mapping[str, Any],
    *,
    wobj: WorkObject = None,
    solver: SolverLike = "auto",
    **more: Any,
) -> PlannedMove | None:
    """Return what a file would say in place of a call of a method of an arm; None if none can say it.

    Args:
        name: of the method.
        robot: of the arm.
        targets: what it was given, as all that follows.
        how: likewise.
        wobj: likewise.
        solver: that it uses.
        more: ``stop`` or ``via``.
    """
    if not isinstance(solver, str):
        return None
    frame: Any = None if isinstance(wobj, str) and wobj == WORLD else wobj
    if isinstance(wobj, HasTool):
        frame = getattr(wobj, "name", None)
    elif frame is not None and not isinstance(frame, str):
        frame = told_pose(frame)
    content = {"targets": _told_rows(targets), "robot": robot, **how, "wobj": frame, "solver": solver, **more}
    if "via" in more:
        content["via"] = _told_rows(more["via"])
    if solver == "auto":
        del content["solver"]
    made = {key: plain(value) for key, value in content.items() if value is not None}
    return cast(PlannedMove, PLANNED[name].model_validate({name: made}))


def told_run(
    plans: Sequence[Plan],
    duration: float | None,
    frame: Callable[[WorkObject], RigidTransform],
    *,
    several: bool,
) -> ArmMove | None:
    """Return what a file would say of planned moves that are run at the same time; None if none can say it.

    Args:
        plans: the moves.
        duration: of the run, where it was given [s].
        frame: gives the pose of a work object now: one that has moved since the move was planned is told as a pose.
        several: whether the station has several robots.
    """
    if not plans:
        return WaitMove(wait=float(duration or 0.0))
    moves = []
    for plan in plans:
        if plan.told is None:
            return None
        name, own = said(cast(PlannedMove, plan.told))
        wobj = getattr(own, "wobj", None)
        if plan.frame is not None and isinstance(wobj, str) and wobj != plan.robot:
            try:
                moved = not frame(wobj).IsNearlyEqualTo(plan.frame, _SAME)
            except SimrobError:  # a robot of another station
                moved = True
            if moved:
                own = own.model_copy(update={"wobj": tuple(told_pose(plan.frame))})
        moves.append(PLANNED[name](**{name: own if several else own.model_copy(update={"robot": None})}))
    if len(moves) == 1 and duration is None:
        return cast(PlannedMove, moves[0])
    return TogetherMove(together=tuple(moves), duration=duration)


def in_words(move: ArmMove, *, several: bool) -> str:
    """Return what a run does, in a few words; whose move it is where there are several robots."""
    if isinstance(move, TogetherMove):
        return ", ".join(in_words(one, several=several) for one in move.together)
    if isinstance(move, WaitMove | PlayMove | ToolMove):
        return next(iter(type(move).model_fields))
    name, own = said(move)
    return f"{name} of {own.robot}" if several else name


def _told_rows(targets: Any) -> Any:
    """Return targets as numbers: those that were given, or pose vectors in place of matrices and transforms."""
    if is_place(targets):
        return np.asarray(targets, dtype=float).tolist()
    try:
        values = np.asarray(targets, dtype=float)
    except (TypeError, ValueError):  # transforms
        values = np.zeros((4, 4))
    return values.tolist() if values.shape[-2:] != (4, 4) else poses_from_matrices(pose_matrices(targets, "")).tolist()
