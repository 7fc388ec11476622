"""The one policy of what counts as a collision, for moves, programs, checks and drafts.

Two shapes collide if they lie deeper in each other than their tolerance. Left out are

- links that a joint connects, and links that are fixed to each other (by Drake),
- links of one robot that touch in its home posture, or overlap in nearly every posture,
- hulls that overlap where the convex parts of their meshes do not.

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
"""Depth at which links of one robot collide [m]: shapes of links are rough."""

OTHER_TOLERANCE = 1e-3
"""Depth at which anything else collides [m]: a piece that rests or is held touches."""

START_TOLERANCE = 5e-3
"""Depth up to which different owners may touch at the start [m]: more is a fault."""

ANY_DEPTH = 1e-9
"""Depth at which shapes touch [m]: larger than rounding."""

_SAMPLES = 24  # random postures that show which links always overlap
_NEARLY_ALL = 0.9  # fraction of them in which such links overlap

Bodies = tuple[str, str]
"""Names of two bodies in alphabetical order: links, pieces, the floor."""


@dataclass(frozen=True)
class Overlap:
    """Two bodies that lie in each other.

    Attributes:
        depth: depth of the deepest pair of shapes [m]; through thin shapes it is too large.
        bodies: names of the bodies in alphabetical order.
        robot: robot that both bodies belong to; empty if they have different owners.
        moved: the bodies, the one that a moving robot owns first.
    """

    depth: float
    bodies: Bodies
    robot: str
    moved: Bodies


class CollisionPolicy:
    """Decides which bodies of a posed station collide."""

    def __init__(self, posed: PosedStation, *, trusts_home: bool = True) -> None:
        """Judge a station.

        Args:
            posed: the station, with collision shapes and `contact.self_collision`.
            trusts_home: leave out links that touch at home; false where it is home that
                is judged, as in the search for a first posture.
        """
        self._posed = posed
        self._trusts_home = trusts_home
        self._fine = FineShapes(posed.station)
        self._fixed_owner = cache(partial(owner_and_robot, posed.station))

    def owner(self, shape: GeometryId) -> tuple[str, str]:
        """Return the body of a shape, and the robot that it belongs to or that holds it.

        The robot is empty for the floor and for pieces that no robot carries.
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
            movers: robots that move; pairs without any of them do not count. All pairs
                count if it is None.
            begun: depths [m] by bodies that are allowed beyond the tolerance, see
                :meth:`allowed_from_start`.
            share: fraction of the tolerances that is used.
        """
        holders = self._posed.holders
        touching = {} if begun is None else begun
        found: dict[Bodies, Overlap] = {}
        query = self._posed.query()
        for pair in query.ComputePointPairPenetration():
            first, one = self._fixed_owner(pair.id_A)
            second, other = self._fixed_owner(pair.id_B)
            if holders:
                one = holders.get(first, one)
                other = holders.get(second, other)
            if movers is not None and one not in movers and other not in movers:
                continue

            # The cheap criteria come first: most pairs that touch are below tolerance.
            bodies = (first, second) if first < second else (second, first)
            robot = one if one == other else ""
            tolerance = OWN_TOLERANCE if robot else OTHER_TOLERANCE
            allowed = touching.get(bodies, 0.0) + share * tolerance
            if pair.depth <= allowed or (robot and bodies in self.left_out):
                continue
            depth = self._fine_depth(pair.depth, pair.id_A, pair.id_B)
            if depth <= allowed:
                continue
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
        """Find all bodies that touch in the present posture, however little.

        Args:
            movers: robots that move; pairs without any of them are left out. All pairs
                are found if it is None.
            refined_from: depth of two hulls [m] from which on convex parts decide.
            own_only: leave out bodies of different owners.
        """
        found: dict[Bodies, Overlap] = {}
        for pair in self._posed.query().ComputePointPairPenetration():
            ends = sorted((self.owner(pair.id_A), self.owner(pair.id_B)))
            (first, one), (second, other) = ends
            if movers is not None and one not in movers and other not in movers:
                continue
            robot = one if one == other else ""
            if own_only and not robot:
                continue
            bodies = first, second
            depth = float(pair.depth)
            if depth > refined_from:
                depth = self._fine_depth(depth, pair.id_A, pair.id_B)
            known = found.get(bodies)
            if depth > (ANY_DEPTH if known is None else known.depth):
                found[bodies] = Overlap(depth, bodies, robot, bodies)
        return found

    def allowed_from_start(self, movers: Collection[str]) -> dict[Bodies, float]:
        """Depths [m] that bodies may have because they touch in the present posture.

        Such bodies may touch as deep on the way, as a piece on its table. Different
        owners that begin deep in each other are not judged, so that a move can lead out.

        Args:
            movers: robots that move.
        """
        return {
            bodies: overlap.depth if overlap.robot or overlap.depth <= START_TOLERANCE else np.inf
            for bodies, overlap in self.touching(movers, OTHER_TOLERANCE).items()
        }

    def _fine_depth(self, depth: float, first: GeometryId, second: GeometryId) -> float:
        """Depth of two shapes in each other [m] by the convex parts of their meshes.

        It is negative if the hulls overlap, by `depth`, and the parts do not.
        """
        distance = self._fine.distance(self._posed.query(), first, second)
        return float(depth) if distance is None else min(float(depth), -distance)

    @cached_property
    def home_contacts(self) -> Mapping[Bodies, str]:
        """Links that touch another link of their robot at home, with the robot.

        Pieces are no part of the robot's own shapes, so they are judged against links.
        """
        if not self._trusts_home:
            return {}
        before = self._posed.plant.GetPositions(self._posed.context)
        robots = self._posed.station.robots
        # Home is zero where no file gives another one, which limits may exclude.
        homes = {name: np.clip(robot.model.home, *robot.model.axis_limits) for name, robot in robots.items()}
        self._posed.place_robots(homes)
        contacts = self.touching(own_only=True).items()
        self._posed.place(before)
        pieces = self._posed.resolved.pieces
        return {bodies: found.robot for bodies, found in contacts if not any(body in pieces for body in bodies)}

    @cached_property
    def permanent_overlaps(self) -> Mapping[Bodies, str]:
        """Links that overlap in nearly every posture, with their robot: sockets."""
        before = self._posed.plant.GetPositions(self._posed.context)
        random = np.random.default_rng(0)
        robots = self._posed.station.robots
        counts = Counter[tuple[Bodies, str]]()
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
        """Links of one robot that never count as a collision, with the robot."""
        return {**self.home_contacts, **self.permanent_overlaps}

    def own_distances(self, robot: str) -> "OwnDistances":
        """Return the distances between the bodies of a robot that can collide."""
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
    """Signed distances of pairs of shapes; those of concave meshes by convex parts."""

    def __init__(self, pairs: Collection[Pair], inspector: SceneGraphInspector, fine: FineShapes) -> None:
        """Take pairs of shapes, and the convex parts of the station's meshes."""
        super().__init__(pairs, inspector)
        self._inspector = inspector
        self._fine = fine

    def only(self, pairs: Collection[Pair]) -> "OwnDistances":
        """Return the distances of some of the pairs."""
        return OwnDistances(pairs, self._inspector, self._fine)

    def of(self, query: QueryObject) -> Vector:
        """Return the distances, negative if shapes overlap, shape (k,) [m]."""
        distances = super().of(query)
        for index in np.flatnonzero(distances < 0.0):
            distance = self._fine.distance(query, *self.pairs[index])
            if distance is not None:
                distances[index] = max(distances[index], distance)
        return distances
