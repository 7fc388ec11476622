"""Whether moves that are run at the same time, or postures, run into anything."""

from collections.abc import Sequence

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.given import instance
from simrob_drake.programs.checks import check_collisions
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan, look_times


def check_moves(model: StationModel, plans: Sequence[Plan]) -> None:
    """Check that moves run into nothing, each other neither; other robots stand as they do in the model.

    Raises:
        PathCollision: names the first offending point, by the move that lasts longest.
    """
    for plan in plans:
        instance(plan, "plan", Plan, "made by arm.plan, such as arm.plan.move_l(...)")
    longest = max(plans, key=lambda plan: plan.duration)
    looks = [look_times(plan.duration, plan.points * len(plan.arrivals)) for plan in plans]
    times = np.unique(np.concatenate(looks))
    postures = {plan.robot: plan.postures(np.minimum(times, plan.duration)) for plan in plans}
    check_collisions(model, postures, times, longest.named)


def collision(model: StationModel, robot: str, now: Vector, posture: Vector) -> str:
    """Return what would be in what with a robot in a posture (n,), others as they stand; empty if nothing.

    What touches with the robot where it is ``now`` does not count.
    """
    try:
        check_collisions(model, {robot: np.array([now, posture])}, np.array([0.0, 1.0]), lambda _: (1, robot))
    except PathCollision as found:
        return f"{found.bodies[0]} in {found.bodies[1]}"
    return ""
