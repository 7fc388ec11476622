"""The collision policy, shared by moves, programs, checks and drafts.

The policy looks at a posed station: a station whose robots are set to positions, without simulation.
Two bodies (links, pieces or the floor) collide if their shapes overlap by more than a tolerance.
The owner of a body is the robot that it belongs to: the floor and free pieces have none. The tolerance is larger if
one robot owns both bodies. These pairs do not count:

- links that a joint connects, and links that are fixed to each other (Drake excludes these),
- links of one robot that touch in its home posture,
- bodies of one robot that overlap in nearly every posture,
- meshes whose convex hulls overlap although the convex parts of the meshes do not.

The robot that carries a piece, or holds it between its fingers, is the owner of the piece.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId, QueryObject, Role, SceneGraphInspector

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.contacts import Distances, Pair
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.stations.fine_shapes import FineShapes
from simrob_drake.stations.posed import PosedStation, random_posture

OWN_TOLERANCE = 5e-3
"""Overlap above which two links of one robot collide [m].

The collision shapes of neighbouring links are rough and often overlap by a few millimetres."""

OTHER_TOLERANCE = 1e-3
"""Overlap above which bodies collide that do not belong to the same robot [m].

A piece that rests on a table, or that fingers hold, overlaps slightly."""

START_TOLERANCE = 5e-3
"""Overlap up to which bodies that do not belong to the same robot may touch at the start [m].

A larger overlap is an error of the station."""

ANY_DEPTH = 1e-9
"""Overlap above which shapes count as touching [m]; larger than rounding errors."""

_SAMPLES = 24  # count of random postures in which permanent overlaps are sought
# Links overlap permanently if they overlap in at least this fraction of the random postures.
_NEARLY_ALL = 0.9

Bodies = tuple[str, str]
"""Names of two bodies in alphabetical order: links, pieces, the floor."""


class Owner(NamedTuple):
    """The body and the robot to which a shape belongs.

    Attributes:
        body: name of a link, of a piece, or ``floor``.
        robot: name of the robot that owns, carries or holds the body; an empty string if there
            is no such robot.
    """

    body: str
    robot: str


@dataclass(frozen=True)
class Overlap:
    """Two bodies that overlap.

    Attributes:
        depth: depth of the deepest pair of shapes [m]. It is too large if a body passes
            through a thin shape.
        bodies: names of the bodies in alphabetical order.
        robot: name of the robot that owns both bodies; an empty string if there is no such robot.
        moved: names of the bodies; in :meth:`CollisionPolicy.overlaps` the body of a moving
            robot is first, and either body if all pairs count. If one robot owns both bodies, the
            order is alphabetical, as it always is in :meth:`CollisionPolicy.touching`.
    """

    depth: float
    bodies: Bodies
    robot: str
    moved: tuple[str, str]

    @property
    def is_between_owners(self) -> bool:
        """Whether no robot owns both bodies: a robot and a table, two robots, or two pieces that lie free."""
        return not self.robot


class CollisionPolicy:
    """Decides which bodies of a posed station collide."""

    def __init__(self, posed: PosedStation, *, trusts_home: bool = True) -> None:
        """Prepare the policy for one station.

        Args:
            posed: the station, with collision shapes and `contact.self_collision`. Without this setting, Drake
                does not report pairs of links of one robot.
            trusts_home: leave out links that touch in the home posture. Set it to False if
                the home posture itself is checked, as in the search for a first posture.
        """
        self._posed = posed
        self._trusts_home = trusts_home
        self._fine = FineShapes(posed.station)  # the convex parts of concave meshes

        @cache
        def owner_without_fingers(shape: GeometryId) -> Owner:
            """Owner of a shape if fingers are left aside. It never changes, so that each shape is looked up once."""
            # A piece between fingers gets another owner in `_present_owner`.
            body, robot = owner_and_robot(posed.station, shape)
            return Owner(body, robot)

        self._owner_without_fingers = owner_without_fingers

    def owner(self, shape: GeometryId) -> Owner:
        """Find the body of a shape, and the robot that owns, carries or holds this body now."""
        return self._present_owner(shape, self._posed.holders)

    def _present_owner(self, shape: GeometryId, holders: Mapping[str, str]) -> Owner:
        """Find the owner of a shape; ``holders`` names the robot for each piece that is between its fingers now."""
        owner = self._owner_without_fingers(shape)
        if owner.body in holders:
            return Owner(owner.body, holders[owner.body])
        return owner

    def overlaps(
        self,
        movers: Collection[str] | None = None,
        depths_at_start: Mapping[Bodies, float] | None = None,
        tolerance_factor: float = 1.0,
    ) -> list[Overlap]:
        """Find the collisions in the present posture, also with the floor; the deepest first.

        Args:
            movers: names of the robots that move. Only pairs with a body of such a robot
                count; if it is None, all pairs count.
            depths_at_start: depth [m] that each of these pairs of bodies may have in addition
                to the tolerance, see :meth:`allowed_from_start`. If it is None, no pair may.
            tolerance_factor: factor on the tolerances, from 0 to 1.
        """
        extra_depths = {} if depths_at_start is None else depths_at_start
        holders = self._posed.holders  # for each piece between fingers, the robot of the fingers
        deepest: dict[Bodies, Overlap] = {}
        for pair in self._posed.query().ComputePointPairPenetration():
            first = self._present_owner(pair.id_A, holders)
            second = self._present_owner(pair.id_B, holders)
            if movers is not None and first.robot not in movers and second.robot not in movers:
                continue

            # The cheap tests come first: most pairs that touch are within the tolerance.
            # The convex parts of the meshes are compared last, since that is slow.
            bodies = _sorted_names(first, second)
            robot = _common_robot(first, second)
            tolerance = OWN_TOLERANCE if robot else OTHER_TOLERANCE
            allowed = extra_depths.get(bodies, 0.0) + tolerance_factor * tolerance
            if pair.depth <= allowed or (robot and bodies in self.excluded_pairs):
                continue
            depth = self._fine_depth(pair.depth, pair.id_A, pair.id_B)
            if depth <= allowed:
                continue

            # A body may have several shapes: keep the deepest overlap of the two bodies.
            known = deepest.get(bodies)
            if known is not None and depth <= known.depth:
                continue
            # The body of a moving robot comes first, if no robot owns both.
            if robot:
                mover_first = bodies
            elif movers is None or first.robot in movers:
                mover_first = (first.body, second.body)
            else:
                mover_first = (second.body, first.body)
            deepest[bodies] = Overlap(depth, bodies, robot, mover_first)
        return sorted(deepest.values(), key=lambda overlap: -overlap.depth)

    def touching(
        self,
        movers: Collection[str] | None = None,
        refined_from: float = 0.0,
        *,
        own_only: bool = False,
    ) -> dict[Bodies, Overlap]:
        """Find all pairs of bodies that touch in the present posture, even slightly.

        Pairs with the floor are found, too, and so are pairs in :attr:`excluded_pairs`. Pairs that Drake excludes, such
        as neighbouring links, are not.

        Args:
            movers: names of the robots that move. Only pairs with a body of such a robot
                are found; if it is None, all pairs are found.
            refined_from: overlap of two convex hulls [m] above which the convex parts of
                the meshes are compared. A larger value is faster.
            own_only: find only pairs of bodies that belong to the same robot.

        Returns:
            the deepest overlap of each pair of bodies.
        """
        holders = self._posed.holders
        deepest: dict[Bodies, Overlap] = {}
        for pair in self._posed.query().ComputePointPairPenetration():
            first = self._present_owner(pair.id_A, holders)
            second = self._present_owner(pair.id_B, holders)
            if movers is not None and first.robot not in movers and second.robot not in movers:
                continue
            robot = _common_robot(first, second)
            if own_only and not robot:
                continue
            depth = float(pair.depth)
            if depth > refined_from:
                depth = self._fine_depth(depth, pair.id_A, pair.id_B)
            bodies = _sorted_names(first, second)
            known = deepest.get(bodies)
            largest_so_far = ANY_DEPTH if known is None else known.depth
            if depth > largest_so_far:
                deepest[bodies] = Overlap(depth, bodies, robot, bodies)
        return deepest

    def allowed_from_start(self, movers: Collection[str]) -> dict[Bodies, float]:
        """Measure the overlap [m] that each pair of bodies may keep because it touches at the start.

        Call this in the start posture of a move. A pair may stay as deep during the move, such as a
        piece on its table. The allowed depth is infinite for bodies without a common owner
        that overlap by more than START_TOLERANCE: such a pair is not checked at all, so
        that a move can separate the two bodies.

        Args:
            movers: names of the robots that move.
        """
        allowed: dict[Bodies, float] = {}
        # Shallow overlaps are not refined: their depth matters little, and the comparison is slow.
        for bodies, overlap in self.touching(movers, refined_from=OTHER_TOLERANCE).items():
            is_too_deep = overlap.is_between_owners and overlap.depth > START_TOLERANCE
            allowed[bodies] = np.inf if is_too_deep else overlap.depth
        return allowed

    def _fine_depth(self, depth: float, first: GeometryId, second: GeometryId) -> float:
        """Measure the overlap of two shapes [m] with the convex parts of their meshes.

        The result is negative if only the convex hulls overlap and the parts do not.

        Args:
            depth: overlap of the convex hulls [m]. It is returned if neither shape has convex
                parts, or if one of them is a half-space.
            first: one shape.
            second: the other shape.
        """
        distance = self._fine.distance(self._posed.query(), first, second)
        if distance is None:
            return float(depth)
        # The parts are inside the hulls, so they cannot overlap more.
        return min(float(depth), -distance)

    @cached_property
    def home_contacts(self) -> Mapping[Bodies, str]:
        """Pairs of links that touch in the home posture of their robot, within its limits, with the robot's name.

        Pairs with a piece are not included: that a piece touches a link at home is no property of the robot. The
        mapping is empty if the home posture itself is checked (``trusts_home`` is False).
        """
        if not self._trusts_home:
            return {}
        # The positions are restored at the end: a caller may be in the middle of a check.
        before = self._posed.plant.GetPositions(self._posed.context)
        homes = {}
        for name, robot in self._posed.station.robots.items():
            # A robot's file may give a home posture beyond the limits: only the start of a station is checked.
            homes[name] = np.clip(robot.model.home, *robot.model.axis_limits)
        # All robots at once: only pairs within one robot count, so that overlaps of two robots do not matter.
        self._posed.place_robots(homes)
        touching = self.touching(own_only=True)
        self._posed.place(before)
        pieces = self._posed.resolved.pieces
        return {
            bodies: overlap.robot
            for bodies, overlap in touching.items()
            if pieces.keys().isdisjoint(bodies)
        }

    @cached_property
    def permanent_overlaps(self) -> Mapping[Bodies, str]:
        """Pairs of bodies of one robot that overlap in nearly every posture, with the robot's name.

        An example is a ball in its socket. The bodies are links, and pieces that the robot carries. They are sought in
        random postures when the property is first read; the positions of the station are restored.
        """
        before = self._posed.plant.GetPositions(self._posed.context)
        # A fixed seed, so that the pairs are always the same.
        random = np.random.default_rng(0)
        counts = Counter[Bodies]()  # for each pair, the count of postures in which it overlaps
        robot_of: dict[Bodies, str] = {}
        for _ in range(_SAMPLES):
            postures = {
                name: random_posture(robot, random)
                for name, robot in self._posed.station.robots.items()
            }
            self._posed.place_robots(postures)
            touching = self.touching(refined_from=OWN_TOLERANCE, own_only=True)
            for bodies, overlap in touching.items():
                if overlap.depth > OWN_TOLERANCE:
                    counts[bodies] += 1
                    robot_of[bodies] = overlap.robot
        self._posed.place(before)
        least_count = _NEARLY_ALL * _SAMPLES
        return {
            bodies: robot_of[bodies] for bodies, count in counts.items() if count >= least_count
        }

    @cached_property
    def excluded_pairs(self) -> Mapping[Bodies, str]:
        """Pairs of bodies that never count as a collision, with the name of their robot.

        These are the pairs of :attr:`home_contacts` and of :attr:`permanent_overlaps`.
        """
        return {**self.home_contacts, **self.permanent_overlaps}

    def own_distances(self, robot: str) -> "OwnDistances":
        """Prepare to measure the distances of all pairs of shapes of one robot that can collide, in many postures.

        Pairs of the same body, pairs that Drake excludes and pairs in :attr:`excluded_pairs` are not
        among them.

        Args:
            robot: the robot's name. The pieces that it carries or holds now belong to it.
        """
        inspector = self._posed.station.scene_graph.model_inspector()
        owner_of_shape = {}  # of the shapes that belong to this robot
        for shape in inspector.GetAllGeometryIds(Role.kProximity):
            owner = self.owner(shape)
            if owner.robot == robot:
                owner_of_shape[shape] = owner
        pairs = []
        for first, second in combinations(owner_of_shape, 2):
            bodies = _sorted_names(owner_of_shape[first], owner_of_shape[second])
            is_one_body = bodies[0] == bodies[1]
            if (
                is_one_body
                or bodies in self.excluded_pairs
                or inspector.CollisionFiltered(first, second)
            ):
                continue
            pairs.append((first, second))
        return OwnDistances(pairs, inspector, self._fine)


def _sorted_names(first: Owner, second: Owner) -> Bodies:
    """Names of two bodies in alphabetical order."""
    if first.body < second.body:
        return first.body, second.body
    return second.body, first.body


def _common_robot(first: Owner, second: Owner) -> str:
    """Name of the robot that owns two bodies; an empty string if no robot owns both."""
    return first.robot if first.robot == second.robot else ""


class OwnDistances(Distances):
    """Signed distances of pairs of shapes of one robot.

    Hulls enclose their meshes. Where hulls are apart, the meshes are too, and the smaller distance
    of the hulls is kept. Only where hulls overlap are the convex parts of the meshes measured.

    Attributes:
        pairs: the pairs of shapes, in the order of the distances.
    """

    def __init__(
        self,
        pairs: Collection[Pair],
        inspector: SceneGraphInspector,
        fine: FineShapes,
    ) -> None:
        """Prepare the distances.

        Args:
            pairs: the pairs of shapes.
            inspector: of the scene graph that contains the shapes.
            fine: the convex parts of the station's meshes.
        """
        super().__init__(pairs, inspector)
        self._inspector = inspector
        self._fine = fine

    def only(self, pairs: Collection[Pair]) -> "OwnDistances":
        """Prepare the distances of a subset of the pairs."""
        return OwnDistances(pairs, self._inspector, self._fine)

    def of(self, query: QueryObject) -> Vector:
        """Compute the distances of all k pairs, shape (k,) [m]; negative if shapes overlap.

        Args:
            query: Drake's query object, with the poses of the shapes.
        """
        distances = super().of(query)
        # Only overlaps of hulls are measured again, with the parts, see the class. The parts are inside of the hulls
        # (up to 5 mm for visible meshes), so that the larger of the two distances is the better one.
        for index in np.flatnonzero(distances < 0.0):
            distance = self._fine.distance(query, *self.pairs[index])
            if distance is not None:
                distances[index] = max(distances[index], distance)
        return distances
