"""All postures of an arm for one pose of its tool, and the smallest distances of a robot along a motion.

A branch is one of the postures that bring the tool to the pose, such as "elbow up". For each branch this module
finds the torque that holds it, the distance of the axes to their limits, and what the arm would collide with.

The surroundings of a robot are all bodies that neither belong to it nor are carried by it or held between its fingers,
also other robots. A body may consist of several *shapes*, between which distances are computed.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.geometry import GeometryId, Role

from simrob_drake.base.arguments import instance
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.contacts import Distances, Pair
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.every_branch import branches
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan, axis_text, check_collisions
from simrob_drake.programs.segments import PathPoint
from simrob_drake.results.record.run import Approach, Approaches
from simrob_drake.stations.collisions import OTHER_TOLERANCE


class AxisValue(NamedTuple):
    """A value of one axis: the largest or smallest value of all axes.

    Attributes:
        value: the value.
        axis: name of the axis.
    """

    value: float
    axis: str


class Gap(NamedTuple):
    """The smallest distance between an arm, with what it carries or holds, and its surroundings.

    Attributes:
        distance: distance [m]; negative if the bodies overlap. It is infinite if no pair of bodies counts, see
            :func:`gaps`.
        body: name of the arm's body; empty if no pair counts.
        other: name of the other body; empty if no pair counts.
    """

    distance: float
    body: str
    other: str


@dataclass(frozen=True, eq=False)
class Branch:
    """One posture of an arm, held at rest.

    Attributes:
        posture: positions of the axes, shape (n,) [rad or m].
        torque: torques that hold the posture with what the arm carries, shape (n,) [N·m or N].
        load: largest ratio of a torque to its motor's limit, and the axis; above 1 the servo cannot hold the posture.
        room: smallest distance of an axis to its limits [rad or m], and the axis; negative beyond a limit.
        collision: the collision in this posture, such as "link_5 in table"; empty if there is none.
        gap: the smallest distance to the surroundings.
    """

    posture: Vector
    torque: Vector
    load: AxisValue
    room: AxisValue
    collision: str
    gap: Gap

    @classmethod
    def of(
        cls, chain: Chain, posture: Vector, torque: Vector, limit: Vector, collision: str, gap: Gap
    ) -> "Branch":
        """Evaluate a posture, given its torques and its surroundings.

        Args:
            chain: the arm.
            posture: positions of the axes, shape (n,) [rad or m].
            torque: torques that hold the posture, shape (n,) [N·m or N].
            limit: torque limits of the motors, shape (n,) [N·m or N]. It is infinite for an axis without a motor.
            collision: the collision in this posture; empty if there is none.
            gap: the smallest distance to the surroundings.
        """
        loads = np.abs(torque) / limit
        rooms = np.minimum(posture - chain.lower, chain.upper - posture)
        # A posture at a limit may exceed it by rounding errors: that counts as a distance of zero.
        is_beyond = chain.limits.excess(posture) > 0.0
        rooms = np.where(is_beyond, rooms, np.maximum(rooms, 0.0))
        most_loaded = int(np.argmax(loads))
        nearest_limit = int(np.argmin(rooms))
        return cls(
            posture=posture,
            torque=torque,
            load=AxisValue(float(loads[most_loaded]), chain.names[most_loaded]),
            room=AxisValue(float(rooms[nearest_limit]), chain.names[nearest_limit]),
            collision=collision,
            gap=gap,
        )

    @property
    def usable(self) -> bool:
        """Whether the motors can hold the posture, within the limits of the axes and without a collision."""
        return self.load.value <= 1.0 and self.room.value >= 0.0 and not self.collision


@dataclass(frozen=True, eq=False)
class Branches:
    """Postures of an arm for a pose, the usable postures first.

    As text it is a table, in which a star marks the usable postures.

    Attributes:
        chain: the arm.
        found: the postures.
    """

    chain: Chain
    found: tuple[Branch, ...]

    @classmethod
    def of(
        cls,
        chain: Chain,
        target: Vector,
        start: npt.ArrayLike,
        held: Mapping[str, npt.ArrayLike],
        evaluate: Callable[[Vector], Branch],
    ) -> "Branches":
        """Find and evaluate all postures for a target.

        Args:
            chain: the arm.
            target: pose of the tool in the base of the arm, shape (1, 4, 4).
            start: posture (n,) [rad or m]. Of positions of an axis that differ by whole turns, the one nearest to it is
                taken.
            held: axes that do not take part in the search, by name: one position [rad or m], or several positions that
                are all tried. If there are several such axes, all combinations are tried.
            evaluate: evaluates a posture (n,).

        Returns:
            The postures, usable ones first; others are beyond a limit, in collision or too heavy. There are none if no
            posture reaches the target.

        Raises:
            InvalidParameter: `held` is not a mapping, or contains positions that are no finite numbers; or the start
                has a wrong shape.
            UnknownName: `held` names an unknown axis.
        """
        instance(
            held,
            "held",
            Mapping,
            message("programs.axes_to_positions", "a mapping of axes to positions [rad or m]"),
        )
        # The positions of each held axis. An empty list of positions is kept as a position, so that the search refuses
        # it with a message.
        choices = [np.ravel(positions).tolist() or [positions] for positions in held.values()]
        postures = []
        for positions in product(*choices):
            held_positions = dict(zip(held, positions, strict=True))
            # The search takes several targets and gives a list for each: here there is one.
            postures.append(branches(chain, target, start, held_positions)[0])
        found = [evaluate(posture) for posture in np.concatenate(postures)]
        # False comes before True. Otherwise the order stays.
        return cls(chain, tuple(sorted(found, key=lambda branch: not branch.usable)))

    def __len__(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[Branch]:
        return iter(self.found)

    def __getitem__(self, index: int) -> Branch:
        return self.found[index]

    def __repr__(self) -> str:
        """Table of the postures, with columns aligned to the right."""
        if not self.found:
            return message("programs.no_posture_reaches", "no posture reaches the pose")
        header = [
            "",
            *self.chain.names,
            message("programs.of_torque_limit", "share of the torque limit"),
            message("programs.room_to_limit", "distance to a limit"),
            message("programs.gap", "distance to others"),
            message("programs.would_be_in", "collision"),
        ]
        rows = [header, *(self._row(branch) for branch in self.found)]
        widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
        lines = []
        for row in rows:
            cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
            lines.append("  ".join(cells).rstrip())
        return "\n".join(lines)

    __str__ = __repr__

    def _row(self, branch: Branch) -> list[str]:
        """Cells of the table for one posture: a star if it is usable, the positions of the axes, and the rest."""
        is_revolute = dict(zip(self.chain.names, self.chain.revolute.tolist(), strict=True))
        positions = branch.posture + 0.0  # makes 0 of -0
        star = "*" if branch.usable else ""
        load = compound("{load:.0f} % {axis}", load=100 * branch.load.value, axis=branch.load.axis)
        room = compound(
            "{axis_text} {axis}",
            axis_text=axis_text(branch.room.value, is_revolute[branch.room.axis]),
            axis=branch.room.axis,
        )
        gap = (
            message(
                "programs.gap_to_other",
                "{distance:.0f} mm from {body} to {other}",
                distance=1e3 * branch.gap.distance,
                body=branch.gap.body,
                other=branch.gap.other,
            )
            if branch.gap.other
            else ""
        )
        return [
            star,
            *map(axis_text, positions, is_revolute.values()),
            load,
            room,
            gap,
            branch.collision,
        ]


_LOOKS = 6  # count of random postures that show which distances change
_SAME = 1e-6  # a distance that changes by less is constant [m]
_CLEAR_CHANGE = 1e-3  # a recorded distance that changes by more is not noise, whatever the plan [m]
_SPARSE = 4  # all pairs of shapes are evaluated at every fourth posture
_NEAREST = 6  # count of pairs of shapes that are evaluated at every posture


def collision(model: StationModel, robot: str, now: Vector, posture: Vector) -> str:
    """Describe the deepest overlap of a robot in a posture (n,) [rad or m], such as "link_5 in table".

    Returns an empty string if there is no collision. Bodies that touch in the posture ``now`` (n,) from which the robot
    comes, such as its reference, may stay as deep. The robot of the model is left in the posture.
    """
    # A motion of two postures: the first one shows what touches already, the second is checked.
    motion = {robot: np.array([now, posture])}
    times = np.array([0.0, 1.0])
    try:
        check_collisions(model, motion, times, lambda _: PathPoint(1, robot))
    except PathCollision as found:
        return message(
            "programs.body_in_other",
            "{body} in {other}",
            body=found.bodies[0],
            other=found.bodies[1],
        )
    return ""


def _surroundings(model: StationModel, robot: str) -> Distances:
    """Distances of all pairs of shapes between a robot and its surroundings.

    One shape of each pair belongs to the robot (or to what it carries or holds), and the other does not. The robot's
    shape is first. Pairs that the station filters from collisions are left out. The returned object computes the
    distances in any posture of the model.
    """
    inspector = model.station.scene_graph.model_inspector()
    is_of_robot: dict[GeometryId, bool] = {}
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        # Name of the robot that the shape belongs to, or that carries or holds it; or an empty text.
        _, owner = model.policy.owner(shape)
        is_of_robot[shape] = owner == robot
    pairs = []
    for first, second in combinations(is_of_robot, 2):
        is_mixed = is_of_robot[first] != is_of_robot[second]
        if is_mixed and not inspector.CollisionFiltered(first, second):
            pairs.append((first, second) if is_of_robot[first] else (second, first))
    return Distances(pairs, inspector)


def gaps(model: StationModel, robot: str, chain: Chain) -> Callable[[Vector], Gap]:
    """Make a function that computes the smallest distance of a robot to its surroundings.

    The function takes a posture (n,) [rad or m], and places the robot of the model there. Pairs of shapes with a
    constant distance do not count, such as a turning column and the floor below. If no pair counts, the distance is
    infinite and both names are empty.

    Args:
        model: the station with collision shapes.
        robot: name of the robot.
        chain: its axes, from whose limits random postures are drawn that show which distances change.
    """
    surroundings = _surroundings(model, robot)

    def distances(posture: Vector) -> Vector:
        """Distances of all pairs of shapes in a posture, shape (pairs,) [m]."""
        model.place_robots({robot: posture})
        return surroundings.of(model.query())

    samples = [distances(posture) for posture in random_postures(chain, _LOOKS, 0)]
    changes = np.ptp(samples, axis=0) > _SAME  # for each pair, shape (pairs,)

    def gap(posture: Vector) -> Gap:
        """Smallest distance in a posture (n,) [rad or m]."""
        if not changes.any():
            return Gap(np.inf, "", "")
        counted = np.where(changes, distances(posture), np.inf)
        nearest = int(counted.argmin())
        first, second = surroundings.pairs[nearest]
        return Gap(float(counted[nearest]), model.owner(first), model.owner(second))

    return gap


def approaches(model: StationModel, plan: Plan, rows: Vector, times: Vector) -> Approaches:
    """Find the smallest distances of a robot, with what it carries or holds, along a recorded move.

    Which pairs of bodies count depends on the plan: a pair whose distance the plan does not change, such as a turning
    column and the floor below, counts only if the recorded distance changes clearly. Noise does not decide. These
    pairs do not count either: a body of the robot and one of the surroundings that touch at the start, links that the
    collision policy leaves out, and a link and a piece that fingers hold at the start or at the end.

    Args:
        model: the station with collision shapes, whose plant is placed along the motion.
        plan: the plan of the move.
        rows: recorded positions (k, nq) of the plant along the motion.
        times: times of these positions since the start of the move, shape (k,) [s].

    Returns:
        the smallest distance to the surroundings, and that between bodies of the robot itself. Both are infinite and
        without names if the base of a robot is not fixed; one is if no pair counts for it.
    """
    nothing = Approach(np.inf, "")
    # The recorded positions have another size if the base of a robot is not fixed.
    if rows.shape[1] != model.plant.num_positions():
        return Approaches(nothing, nothing)
    postures = plan.postures(np.minimum(times, plan.duration))
    # Along the planned positions the robot moves as planned, and everything else stays where it is at the start.
    around = np.repeat(rows[:1], len(rows), axis=0)
    planned = model.robots[plan.robot].axis_map.spread_positions(postures, around)
    motion = _Motion(recorded=rows, planned=planned)

    # Pieces that fingers of the robot hold, at the end and at the start of the move.
    inspector = model.station.scene_graph.model_inspector()
    model.place(rows[-1])
    held_at_end = {piece for piece, robot in model.gripping_robots().items() if robot == plan.robot}
    with model.holding_at(rows[0]):
        held_at_start = {piece for piece, robot in model.holders.items() if robot == plan.robot}
        held = held_at_start | held_at_end
        # The links of the robot have a prefix in the names of bodies if the station has several robots.
        links = {
            f"{model.robots[plan.robot].prefix}{link}"
            for link in model.robots[plan.robot].model.links
        }

        def may_approach(pair: Pair) -> bool:
            """Whether the pair is not one of a link and a piece that the fingers hold."""
            bodies = {model.owner(shape) for shape in pair}
            return held.isdisjoint(bodies) or links.isdisjoint(bodies)

        surroundings = _surroundings(model, plan.robot)
        others = [pair for pair in surroundings.pairs if may_approach(pair)]
        own = model.policy.own_distances(plan.robot)
        own_pairs = [pair for pair in own.pairs if may_approach(pair)]
        return Approaches(
            to_others=_nearest_approach(
                model,
                motion,
                others,
                lambda pairs: Distances(pairs, inspector),
                ignores_first_contacts=True,
            ),
            to_itself=_nearest_approach(
                model, motion, own_pairs, own.only, ignores_first_contacts=False
            ),
        )


class _Motion(NamedTuple):
    """A move of a robot, as positions of the plant at the same k times.

    Attributes:
        recorded: positions in the run, shape (k, nq).
        planned: positions with the robot as planned and all else at rest, shape (k, nq).
    """

    recorded: Vector
    planned: Vector


def _nearest_approach(
    model: StationModel,
    motion: _Motion,
    pairs: list[Pair],
    for_pairs: Callable[[list[Pair]], Distances],
    *,
    ignores_first_contacts: bool,
) -> Approach:
    """Find the smallest of several distances along a motion, and the two bodies between which it is.

    To save time, all pairs of shapes are evaluated at every fourth posture only. The pairs
    that come nearest there are then evaluated at every posture.

    A pair counts only if its distance changes along the planned motion, or clearly along the recorded one.

    Args:
        model: the station with collision shapes, whose plant is placed along the motion.
        motion: positions of the plant along the motion.
        pairs: the pairs of shapes whose distances may count.
        for_pairs: makes an object that computes the distances of some of these pairs.
        ignores_first_contacts: leave out the pairs that touch at the start, by the tolerance of collisions.

    Returns:
        the smallest distance [m] and the text "<body> to <body>"; infinite and without names if no pair counts.
    """
    nothing = Approach(np.inf, "")
    if not pairs:
        return nothing
    # Distances of all pairs at every fourth posture, shape (postures, pairs).
    distances = for_pairs(pairs)
    sparse = _distances_along(model, distances, motion.recorded[::_SPARSE])
    planned = _distances_along(model, distances, motion.planned[::_SPARSE])
    # By how much each distance changes decides whether its pair counts, shape (pairs,).
    counts = (np.ptp(planned, axis=0) > _SAME) | (np.ptp(sparse, axis=0) > _CLEAR_CHANGE)
    if ignores_first_contacts:
        counts &= sparse[0] > OTHER_TOLERANCE
    least = np.where(counts, sparse.min(axis=0), np.inf)  # infinite for pairs that do not count
    order = np.argsort(least)[:_NEAREST]
    nearest_pairs = [distances.pairs[index] for index in order if np.isfinite(least[index])]
    if not nearest_pairs:
        return nothing
    # The few nearest pairs, evaluated at every posture. The object may sort its pairs in another order.
    nearest = for_pairs(nearest_pairs)
    smallest = _distances_along(model, nearest, motion.recorded).min(axis=0)
    pair = nearest.pairs[int(smallest.argmin())]
    first, second = (model.owner(shape) for shape in pair)
    names = message("programs.body_to_body", "{first} to {second}", first=first, second=second)
    return Approach(float(smallest.min()), names)


def _distances_along(model: StationModel, distances: Distances, rows: Vector) -> Vector:
    """Compute the distances of all pairs of shapes at positions (k, nq) of the plant, shape (k, pairs) [m].

    The plant of the model is left at the last positions.
    """
    found = list[Vector]()
    for positions in rows:
        model.place(positions)
        found.append(distances.of(model.query()))
    return np.array(found)
