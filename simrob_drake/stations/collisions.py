"""The collision policy, shared by moves, programs, checks and drafts.

Two shapes collide if they overlap by more than their tolerance. These pairs do not count:

- links that a joint connects, and links that are fixed to each other (Drake excludes these),
- links of one robot that touch in its home posture, or overlap in nearly every posture,
- meshes whose convex hulls overlap although the convex parts of the meshes do not.

What a robot carries, or holds between its fingers, counts as a part of the robot.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import combinations

import numpy as np
from pydrake.geometry import GeometryId, QueryObject, Role, SceneGraphInspector

from simrob_drake.blocks.contacts import Distances, Pair
from simrob_drake.frames import Vector
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.stations.fine_shapes import FineShapes
from simrob_drake.stations.posed import PosedStation, random_posture

OWN_TOLERANCE = 5e-3
"""Overlap above which two links of one robot collide [m].

The collision shapes of neighbouring links are rough and often overlap by a few millimetres."""

OTHER_TOLERANCE = 1e-3
"""Overlap above which bodies of different owners collide [m].

A piece that rests on a table, or that fingers hold, overlaps slightly."""

START_TOLERANCE = 5e-3
"""Overlap up to which bodies of different owners may touch at the start [m].

A larger overlap is an error of the station."""

ANY_DEPTH = 1e-9
"""Overlap above which shapes count as touching [m]; larger than rounding errors."""

_SAMPLES = 24  # count of random postures in which permanent overlaps are sought
_NEARLY_ALL = 0.9  # links overlap permanently if they overlap in at least this fraction of the random postures

Bodies = tuple[str, str]
"""Names of two bodies in alphabetical order: links, pieces, the floor."""


@dataclass(frozen=True)
class Overlap:
    """Two bodies that overlap.

    Attributes:
        depth: depth of the deepest pair of shapes [m]. It is too large if a body passes
            through a thin shape.
        bodies: names of the bodies in alphabetical order.
        robot: name of the robot that both bodies belong to; an empty string if the bodies
            have different owners.
        moved: names of the bodies; the body that belongs to a moving robot is first.
    """

    depth: float
    bodies: Bodies
    robot: str
    moved: Bodies

    @property
    def is_between_owners(self) -> bool:
        """Whether the two bodies have different owners, such as a robot and a table."""
        return not self.robot


class CollisionPolicy:
    """Decides which bodies of a posed station collide."""

    def __init__(self, posed: PosedStation, *, trusts_home: bool = True) -> None:
        """Prepare the policy for one station.

        Args:
            posed: the station, with collision shapes and `contact.self_collision`.
            trusts_home: leave out links that touch in the home posture. Set it to False if
                the home posture itself is checked, as in the search for a first posture.
        """
        self._posed = posed
        self._trusts_home = trusts_home
        self._fine = FineShapes(posed.station)
        # These owners never change, so each is looked up only once. The robots that hold
        # pieces with their fingers may change, see :meth:`owner`.
        self._fixed_owner = cache(partial(owner_and_robot, posed.station))

    def owner(self, shape: GeometryId) -> tuple[str, str]:
        """Names of the body of a shape and of the robot that owns or holds the body.

        The name of the robot is an empty string for the floor, and for a piece that no
        robot carries.
        """
        body, robot = self._fixed_owner(shape)
        return body, self._posed.holders.get(body, robot)

    def overlaps(
        self,
        movers: Collection[str] | None = None,
        begun: Mapping[Bodies, float] | None = None,
        share: float = 1.0,
    ) -> list[Overlap]:
        """Find the collisions in the present posture, the deepest first.

        Args:
            movers: names of the robots that move. Only pairs with a body of such a robot
                count; if it is None, all pairs count.
            begun: depth [m] that each of these pairs of bodies may have in addition to the
                tolerance, see :meth:`allowed_from_start`.
            share: factor on the tolerances, from 0 to 1.
        """
        holders = self._posed.holders
        extra_depths = {} if begun is None else begun
        found: dict[Bodies, Overlap] = {}
        query = self._posed.query()
        for pair in query.ComputePointPairPenetration():
            # `first` and `second` are bodies, `one` and `other` the robots that own them.
            first, one = self._fixed_owner(pair.id_A)
            second, other = self._fixed_owner(pair.id_B)
            if holders:  # a piece between fingers belongs to the robot that holds it
                one = holders.get(first, one)
                other = holders.get(second, other)
            if movers is not None and one not in movers and other not in movers:
                continue

            # The cheap tests come first: most pairs that touch are within the tolerance.
            # The convex parts of the meshes are compared last, since that is slow.
            bodies = (first, second) if first < second else (second, first)
            robot = one if one == other else ""  # empty if the owners differ
            tolerance = OWN_TOLERANCE if robot else OTHER_TOLERANCE
            allowed = extra_depths.get(bodies, 0.0) + share * tolerance
            if pair.depth <= allowed or (robot and bodies in self.left_out):
                continue
            depth = self._fine_depth(pair.depth, pair.id_A, pair.id_B)
            if depth <= allowed:
                continue

            # A body may have several shapes: keep the deepest overlap of the two bodies.
            known = found.get(bodies)
            if known is None or depth > known.depth:
                is_first_moving = movers is None or one in movers
                moved = (first, second) if is_first_moving else (second, first)
                found[bodies] = Overlap(depth, bodies, robot, bodies if robot else moved)
        return sorted(found.values(), key=lambda overlap: -overlap.depth)

    def touching(
        self,
        movers: Collection[str] | None = None,
        refined_from: float = 0.0,
        *,
        own_only: bool = False,
    ) -> dict[Bodies, Overlap]:
        """Find all pairs of bodies that touch in the present posture, even slightly.

        Args:
            movers: names of the robots that move. Only pairs with a body of such a robot
                are found; if it is None, all pairs are found.
            refined_from: overlap of two convex hulls [m] above which the convex parts of
                the meshes are compared. A larger value is faster.
            own_only: find only pairs of bodies that belong to the same robot.

        Returns:
            the deepest overlap of each pair of bodies.
        """
        found: dict[Bodies, Overlap] = {}
        for pair in self._posed.query().ComputePointPairPenetration():
            # Sorted by the names of the bodies, `first` and `second`; `one` and `other`
            # are the robots that own them.
            bodies_and_robots = sorted((self.owner(pair.id_A), self.owner(pair.id_B)))
            (first, one), (second, other) = bodies_and_robots
            if movers is not None and one not in movers and other not in movers:
                continue
            robot = one if one == other else ""  # empty if the owners differ
            if own_only and not robot:
                continue
            bodies = first, second
            depth = float(pair.depth)
            if depth > refined_from:
                depth = self._fine_depth(depth, pair.id_A, pair.id_B)
            known = found.get(bodies)
            largest_so_far = ANY_DEPTH if known is None else known.depth
            if depth > largest_so_far:
                found[bodies] = Overlap(depth, bodies, robot, bodies)
        return found

    def allowed_from_start(self, movers: Collection[str]) -> dict[Bodies, float]:
        """Overlap [m] that each pair of bodies may keep because it touches at the start.

        Call this in the start posture. A pair may stay as deep during the move, such as a
        piece on its table. The depth is infinite for bodies of different owners
        that overlap by more than START_TOLERANCE: such a pair is not checked at all, so
        that a move can separate the two bodies.

        Args:
            movers: names of the robots that move.
        """
        allowed: dict[Bodies, float] = {}
        for bodies, overlap in self.touching(movers, OTHER_TOLERANCE).items():
            is_too_deep = overlap.is_between_owners and overlap.depth > START_TOLERANCE
            allowed[bodies] = np.inf if is_too_deep else overlap.depth
        return allowed

    def _fine_depth(self, depth: float, first: GeometryId, second: GeometryId) -> float:
        """Overlap of two shapes [m], measured with the convex parts of their meshes.

        The result is negative if only the convex hulls overlap and the parts do not.

        Args:
            depth: overlap of the convex hulls [m]. It is returned if neither shape is a
                concave mesh.
            first: one shape.
            second: the other shape.
        """
        distance = self._fine.distance(self._posed.query(), first, second)
        return float(depth) if distance is None else min(float(depth), -distance)

    @cached_property
    def home_contacts(self) -> Mapping[Bodies, str]:
        """Pairs of links that touch in the home posture of their robot, with the robot's name.

        Pairs with a piece are not included: a piece is not a link, so its overlap with a
        link always counts.
        """
        if not self._trusts_home:
            return {}
        before = self._posed.plant.GetPositions(self._posed.context)
        robots = self._posed.station.robots
        # Home is zero if the robot's file gives no other posture, and the limits of an axis
        # may exclude zero.
        homes = {name: np.clip(robot.model.home, *robot.model.axis_limits) for name, robot in robots.items()}
        self._posed.place_robots(homes)
        contacts = self.touching(own_only=True).items()
        self._posed.place(before)
        pieces = self._posed.resolved.pieces
        return {bodies: found.robot for bodies, found in contacts if not any(body in pieces for body in bodies)}

    @cached_property
    def permanent_overlaps(self) -> Mapping[Bodies, str]:
        """Pairs of links that overlap in nearly every posture, with the robot's name.

        An example is a ball in its socket.
        """
        before = self._posed.plant.GetPositions(self._posed.context)
        random = np.random.default_rng(0)
        robots = self._posed.station.robots
        counts = Counter[tuple[Bodies, str]]()  # count of postures in which the links of a robot overlap
        for _ in range(_SAMPLES):
            postures = {name: random_posture(robot, random) for name, robot in robots.items()}
            self._posed.place_robots(postures)
            touching = self.touching(refined_from=OWN_TOLERANCE, own_only=True)
            for bodies, found in touching.items():
                if found.depth > OWN_TOLERANCE:
                    counts[bodies, found.robot] += 1
        self._posed.place(before)
        least = _NEARLY_ALL * _SAMPLES
        return {bodies: robot for (bodies, robot), count in counts.items() if count >= least}

    @cached_property
    def left_out(self) -> Mapping[Bodies, str]:
        """Pairs of links of one robot that never count as a collision, with the robot's name."""
        return {**self.home_contacts, **self.permanent_overlaps}

    def own_distances(self, robot: str) -> "OwnDistances":
        """Distances between all pairs of shapes of one robot that can collide.

        Shapes of the same body, pairs that Drake excludes and :attr:`left_out` cannot.
        """
        inspector = self._posed.station.scene_graph.model_inspector()
        shapes = [shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if self.owner(shape)[1] == robot]
        pairs = []
        for first, second in combinations(shapes, 2):
            one, _ = self.owner(first)
            other, _ = self.owner(second)
            bodies = (one, other) if one < other else (other, one)
            is_filtered = inspector.CollisionFiltered(first, second)
            if one != other and not is_filtered and bodies not in self.left_out:
                pairs.append((first, second))
        return OwnDistances(pairs, inspector, self._fine)


class OwnDistances(Distances):
    """Signed distances of pairs of shapes; concave meshes are replaced by their convex parts."""

    def __init__(self, pairs: Collection[Pair], inspector: SceneGraphInspector, fine: FineShapes) -> None:
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
        """Distances of a subset of the pairs."""
        return OwnDistances(pairs, self._inspector, self._fine)

    def of(self, query: QueryObject) -> Vector:
        """Compute the distances of all k pairs, shape (k,) [m]; negative if shapes overlap."""
        distances = super().of(query)
        # Convex hulls enclose their meshes: only where hulls overlap can the parts differ.
        for index in np.flatnonzero(distances < 0.0):
            distance = self._fine.distance(query, *self.pairs[index])
            if distance is not None:
                distances[index] = max(distances[index], distance)
        return distances
