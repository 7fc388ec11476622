"""What each posture that brings an arm's tool to a pose means: torque to hold it, room to limits and around it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import numpy.typing as npt
from pydrake.geometry import GeometryId, Role

from simrob_drake.arguments import instance
from simrob_drake.blocks.contacts import Distances, Pair
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.every_branch import branches
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import check_collisions, shown
from simrob_drake.results.record.run import Approach, Approaches
from simrob_drake.stations.collisions import OTHER_TOLERANCE


@dataclass(frozen=True, eq=False)
class Branch:
    """One posture of an arm, held at rest."""

    posture: Vector  # shape (n,) [rad or m]
    torque: Vector  # that holds it with what the arm carries, shape (n,) [N·m or N]
    # the largest share that is of an axis's limit, and the axis; above 1 it is more than the servo gives
    load: tuple[float, str]
    # the least distance of an axis to its limits [rad or m], and the axis; below 0 it is beyond them
    room: tuple[float, str]
    collision: str  # what would be in what; empty if nothing is
    # the least distance of the arm and what it carries to anything else [m], below 0 in it, and of what to what;
    # infinite with nothing around
    gap: tuple[float, str, str]

    @classmethod
    def of(
        cls, chain: Chain, posture: Vector, torque: Vector, limit: Vector, collision: str, gap: tuple[float, str, str]
    ) -> "Branch":
        """Evaluate a posture (n,) that needs a torque (n,) to be held, given the torque limits (n,) of the motors."""
        loads = np.abs(torque) / limit
        rooms = np.minimum(posture - chain.lower, chain.upper - posture)
        # A posture at a limit may exceed it by rounding errors: that counts as a distance of zero.
        rooms = np.where(chain.limits.excess(posture) > 0.0, rooms, np.maximum(rooms, 0.0))
        most, least = int(np.argmax(loads)), int(np.argmin(rooms))
        load, room = (float(loads[most]), chain.names[most]), (float(rooms[least]), chain.names[least])
        return cls(posture, torque, load, room, collision, gap)

    @property
    def usable(self) -> bool:
        """Whether the arm can stand so."""
        return self.load[0] <= 1.0 and self.room[0] >= 0.0 and not self.collision


@dataclass(frozen=True, eq=False)
class Branches:
    """All postures of an arm for a pose, usable ones first; as text a table, in which a star tells these."""

    chain: Chain
    found: tuple[Branch, ...]

    @classmethod
    def of(
        cls,
        chain: Chain,
        target: Vector,
        start: npt.ArrayLike,
        held: Mapping[str, npt.ArrayLike],
        meaning: Callable[[Vector], Branch],
    ) -> "Branches":
        """Return all postures for a target (1, 4, 4), with axes held at one position or each of several."""
        positions = instance(held, "held", Mapping, "a mapping of axes to positions [rad or m]").values()
        values = [np.ravel(value).tolist() or [value] for value in positions]
        ways = [dict(zip(held, row, strict=True)) for row in product(*values)]
        rows = np.concatenate([branches(chain, target, start, way)[0] for way in ways])
        return cls(chain, tuple(sorted(map(meaning, rows), key=lambda branch: not branch.usable)))

    def __len__(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[Branch]:
        return iter(self.found)

    def __getitem__(self, index: int) -> Branch:
        return self.found[index]

    def __repr__(self) -> str:
        if not self.found:
            return "no posture reaches the pose"
        turns = dict(zip(self.chain.names, self.chain.revolute.tolist(), strict=True))
        rows = [["", *turns, "of the torque limit", "room to a limit", "gap", "would be in"]]
        for branch in self.found:
            postures = (shown(value, turn) for value, turn in zip(branch.posture + 0.0, turns.values(), strict=True))
            load, room = (
                f"{100 * branch.load[0]:.0f} % {branch.load[1]}",
                shown(branch.room[0], turns[branch.room[1]]),
            )
            distance, nearest, other = branch.gap
            gap = f"{1e3 * distance:.0f} mm {nearest} to {other}" if other else ""
            rows.append(["*" * branch.usable, *postures, load, f"{room} {branch.room[1]}", gap, branch.collision])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join("  ".join(map(str.rjust, row, widths)).rstrip() for row in rows)

    __str__ = __repr__


_LOOKS = 6  # count of random postures that show which distances change
_SAME = 1e-6  # a distance that changes by less is constant [m]
_SPARSE = 4  # all pairs of shapes are evaluated at every fourth posture
_NEAREST = 6  # count of pairs of shapes that are evaluated at every posture


def collision(model: StationModel, robot: str, now: Vector, posture: Vector) -> str:
    """Describe the collision of a robot in a posture (n,) [rad or m], such as "link_5 in table".

    Returns an empty string if there is no collision. Bodies that touch in the present posture
    ``now`` (n,) may stay as deep.
    """
    # A motion of two postures: the first one shows what touches already, the second is checked.
    try:
        check_collisions(model, {robot: np.array([now, posture])}, np.array([0.0, 1.0]), lambda _: (1, robot))
    except PathCollision as found:
        return f"{found.bodies[0]} in {found.bodies[1]}"
    return ""


def _surroundings(model: StationModel, robot: str) -> Distances:
    """Distances of all pairs of shapes between a robot and its surroundings.

    One shape of each pair belongs to the robot (or to what it carries), and the other does
    not. The robot's shape is first.
    """
    inspector = model.station.scene_graph.model_inspector()
    is_of_robot: dict[GeometryId, bool] = {}
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        _, owner = model.policy.owner(shape)
        is_of_robot[shape] = owner == robot
    pairs = [
        (first, second) if is_of_robot[first] else (second, first)
        for first, second in combinations(is_of_robot, 2)
        if is_of_robot[first] != is_of_robot[second] and not inspector.CollisionFiltered(first, second)
    ]
    return Distances(pairs, inspector)


def gaps(model: StationModel, robot: str, chain: Chain) -> Callable[[Vector], tuple[float, str, str]]:
    """Make a function that computes the smallest distance of a robot to its surroundings.

    The function takes a posture (n,) [rad or m]. It returns the distance [m] and the names of
    the two bodies, the robot's body first. The distance is negative if the bodies overlap.
    Pairs of shapes with a constant distance do not count, such as a turning column and the
    floor below. If no pair counts, the distance is infinite and both names are empty.
    """
    near = _surroundings(model, robot)

    def distances(posture: Vector) -> Vector:
        model.place_robots({robot: posture})
        return near.of(model.query())

    samples = [distances(posture) for posture in random_postures(chain, _LOOKS, 0)]
    changes = np.ptp(samples, axis=0) > _SAME

    def gap(posture: Vector) -> tuple[float, str, str]:
        if not changes.any():
            return np.inf, "", ""
        found = np.where(changes, distances(posture), np.inf)
        nearest = int(found.argmin())
        first, second = (model.owner(shape) for shape in near.pairs[nearest])
        return float(found[nearest]), first, second

    return gap


def approaches(model: StationModel, robot: str, rows: Vector) -> Approaches:
    """Find the smallest distances of a robot, with what it carries, along a motion.

    These pairs do not count: a body of the robot and one of the surroundings that touch at
    the start, two bodies whose distance is constant, and links that the collision policy
    leaves out.

    Args:
        model: the station with collision shapes.
        robot: the robot's name.
        rows: positions (k, nq) of the plant along the motion.
    """
    nothing = Approach(np.inf, "")
    # The recorded positions have another size if the base of a robot is not fixed.
    if rows.shape[1] != model.plant.num_positions():
        return Approaches(nothing, nothing)
    inspector = model.station.scene_graph.model_inspector()
    own = model.policy.own_distances(robot)
    return Approaches(
        to_others=_approach(
            model,
            rows,
            _surroundings(model, robot),
            lambda pairs: Distances(pairs, inspector),
            ignores_first_contacts=True,
        ),
        to_itself=_approach(model, rows, own, own.only, ignores_first_contacts=False),
    )


def _approach(
    model: StationModel,
    rows: Vector,
    near: Distances,
    only: Callable[[list[Pair]], Distances],
    *,
    ignores_first_contacts: bool,
) -> Approach:
    """Find the smallest of several distances along a motion.

    To save time, all pairs of shapes are evaluated at every fourth posture only. The pairs
    that come nearest there are then evaluated at every posture.

    Args:
        model: the station with collision shapes.
        rows: positions of the plant along the motion, shape (k, nq).
        near: the distances of all pairs of shapes.
        only: makes the distances of a subset of the pairs.
        ignores_first_contacts: leave out the pairs that touch at the start.

    Returns:
        the smallest distance; infinite and without names if no pair counts.
    """
    if not near.pairs:
        return Approach(np.inf, "")
    sparse = _distances(model, near, rows[::_SPARSE])
    counts = np.ptp(sparse, axis=0) > _SAME
    if ignores_first_contacts:
        counts &= sparse[0] > OTHER_TOLERANCE
    least = np.where(counts, sparse.min(axis=0), np.inf)  # infinite for pairs that do not count
    order = np.argsort(least)[:_NEAREST]
    nearest = [near.pairs[index] for index in order if np.isfinite(least[index])]
    if not nearest:
        return Approach(np.inf, "")
    near = only(nearest)
    found = _distances(model, near, rows).min(axis=0)
    pair = near.pairs[int(found.argmin())]
    names = " to ".join(model.owner(shape) for shape in pair)
    return Approach(float(found.min()), names)


def _distances(model: StationModel, near: Distances, rows: Vector) -> Vector:
    """Compute the distances of all pairs of shapes at positions (k, nq) of the plant, shape (k, pairs) [m]."""
    distances = list[Vector]()
    for positions in rows:
        model.place(positions)
        distances.append(near.of(model.query()))
    return np.array(distances)
