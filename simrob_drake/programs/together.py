"""Whether moves that are run at the same time, or postures, run into anything, and how far they stay from it."""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from pydrake.geometry import Role

from simrob_drake.arguments import instance
from simrob_drake.blocks.distance_sensor import Distances
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan, check_collisions, look_times

_LOOKS = 6  # postures of chance that tell which distances change at all
_SAME = 1e-6  # m


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


def gaps(model: StationModel, robot: str, chain: Chain) -> Callable[[Vector], tuple[float, str, str]]:
    """Return what tells of a robot's postures (n,) how far it and what it carries are from anything else [m].

    Below 0 they are in it; the other values are what is so near to what. What no posture brings nearer, as a turning
    column to its floor, does not count. Infinite, and nothing, where there is nothing that could be met.
    """
    inspector, own = model.station.scene_graph.model_inspector(), model.robots[robot].instance
    owners = {
        shape: model.plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
    }
    pairs = [
        pair if owners[pair[0]] == own else pair[::-1]
        for pair in combinations(owners, 2)
        if own in (owners[pair[0]], owners[pair[1]]) and not inspector.CollisionFiltered(*pair)
    ]
    near = Distances(pairs, inspector)

    def distances(posture: Vector) -> Vector:
        model.place_robots({robot: posture})
        return near.of(model.query())

    changes = np.ptp([distances(posture) for posture in random_postures(chain, _LOOKS, 0)], axis=0) > _SAME

    def gap(posture: Vector) -> tuple[float, str, str]:
        if not changes.any():
            return np.inf, "", ""
        found = np.where(changes, distances(posture), np.inf)
        nearest = int(found.argmin())
        first, second = (model.owner(shape) for shape in near.pairs[nearest])
        return float(found[nearest]), first, second

    return gap
