"""Contact points at the corners and edges of flat bodies.

In point contact, Drake pushes two shapes apart at one point, the deepest. A box that lies flat on a floor has no such
point: it jumps from corner to corner, the box trembles, and friction stops a body that should slide. Small balls at
the corners and along the edges carry a flat body as Coulomb's law and statics demand, under every solver:

* A box of 2 kg, pushed with 15 N at a friction of 0.4, slides as far as Coulomb's law says, within 1 %.
* A box twice as high as wide stands on a slope of 25 degrees and falls at 28; in theory it tips at 26.6. With
  hydroelastic surfaces it falls at 22 degrees, since the sudden load at the start shakes it.

Terms:

* A **ball** is such a small collision sphere, fixed to the body of the shape for which it stands.
* A **polyhedron** is a box, or the convex hull of a mesh with few corners. It touches planes and other polyhedra with
  balls alone.
* A **round shape** is a cylinder, a capsule or a mesh with more corners. The shape itself touches as well; its balls
  protrude a little, so that they carry its flat faces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise, product
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    GeometryId,
    GeometrySet,
    HalfSpace,
    Mesh,
    ProximityProperties,
    Role,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import FLOOR, own_name, piece_of_shape
from simrob_drake.robots.outlines import shape_corners
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import ResolvedStation

LARGEST_RADIUS = 1e-3
"""Radius of the balls of large shapes with stiff contacts [m]. Balls lie inside of their shape, so that its corners
become rounder by this radius."""

RADIUS_SHARE = 0.05
"""Largest radius of the balls with stiff contacts, as a share of the shape's shortest side."""

SOFT_RADIUS_SHARE = 0.2
"""Largest radius of the balls with soft contacts, as a share of the shape's shortest side.

Soft contacts need larger balls: a ball must not sink in by more than its radius. If it did and were near an edge of the
body on which it lies, the side of that body would push it away sideways."""

SMALLEST_PROTRUSION = 2e-5
"""Least height by which balls of round shapes protrude beyond the flat faces [m].

With Drake's default stiffness, a body sinks in by less under its own weight (12 µm for a box of 3 kg)."""

LARGEST_PROTRUSION = 5e-4
"""Largest height by which balls of round shapes protrude, with soft contacts [m]."""

RIM_POINTS = 12
"""Count of balls on each rim of a cylinder. Between two balls the rim is nearer to the axis by r (1 - cos(180°/12)),
which is 3.4 % of the radius, so that the cylinder tips a little too early."""

MOST_CORNERS = 32
"""Largest count of a convex hull's corners that get balls. Of more corners, those that are farthest apart get balls."""

MOST_EDGE_PARTS = 8
"""Largest count of parts into which balls divide an edge."""

# Count of balls that share the weight of a body that lies on a face.
_CARRYING_BALLS = 4


class ContactBall(NamedTuple):
    """One ball of a shape.

    Attributes:
        centre: position of the ball's centre in the frame of the shape, shape (3,) [m].
        radius: radius of the ball [m].
    """

    centre: Vector
    radius: float


class Edge(NamedTuple):
    """An edge of a polyhedron.

    Attributes:
        first: index of one end among the corners of the polyhedron.
        second: index of the other end.
    """

    first: int
    second: int


@dataclass
class ContactPoints:
    """The balls of a plant, and the shapes that they replace.

    Attributes:
        corners: balls at corners of polyhedra, and all balls of round shapes.
        edges: balls along the edges of polyhedra. They carry a body that lies across another one.
        polyhedra: polyhedra with balls, and the boxes of the terrain. The boxes have no balls of their own, since the
            balls of the bodies on them suffice.
    """

    corners: list[GeometryId] = field(default_factory=list)
    edges: list[GeometryId] = field(default_factory=list)
    polyhedra: list[GeometryId] = field(default_factory=list)

    @property
    def balls(self) -> list[GeometryId]:
        """The balls of `corners` and `edges` in one list."""
        return [*self.corners, *self.edges]


def uses_contact_points(config: StationConfig) -> bool:
    """Whether flat shapes of a station may get balls: in point contact, unless ``contact.corners`` is false.

    They get none in a kinematic station, which has no contact forces, and with an engine that finds several contact
    points for each pair of shapes. :func:`add_contact_points` decides which shapes get balls.
    """
    contact = config.contact
    if contact is None or not config.has_contact_forces or config.engine.touches_at_several_points:
        return False
    return contact.model == "point" and contact.corners


def add_contact_points(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    station: ResolvedStation,
    robots: Sequence[StationRobot],
    shapes: Sequence[GeometryId],
) -> ContactPoints:
    """Register the balls of a station's flat shapes in the plant, before the plant is finalized.

    Free pieces get balls, and so do robots that float: only their feet if they have feet, otherwise all their links,
    and the pieces that they carry. If there are any of these, the bodies on which they can lie and between which they
    can be held get balls, too: the other pieces, and the fingers of robots that do not float. Only flat shapes get
    balls.

    Args:
        plant: the plant with all robots and pieces, not finalized.
        scene_graph: the scene graph of the plant.
        station: the station with its pieces and configuration.
        robots: the robots in the plant.
        shapes: collision shapes of the station.

    Returns:
        the balls, and the polyhedra for which they stand; empty if the station does not use contact points, or has
        neither free pieces nor robots that float with flat shapes.
    """
    points = ContactPoints()
    if not uses_contact_points(station.config):
        return points
    owners = _ShapeOwners(plant, scene_graph.model_inspector(), station, robots)
    flat = [shape for shape in shapes if is_flat(owners.inspector, shape)]
    free = [shape for shape in flat if owners.is_free(shape)]
    if not free:  # nothing rests on a face, and balls would only cost time
        return points
    supports = [shape for shape in flat if owners.is_support(shape)]
    # The heaviest free body presses balls in deepest: its weight is the load by which the radii of all balls are
    # chosen.
    heaviest = max(owners.moved_mass(shape) for shape in free)
    load = heaviest * abs(station.config.gravity)
    for shape in [*free, *supports]:
        _register_balls(owners, shape, load, points)
    points.polyhedra += [shape for shape in flat if _is_terrain_box(owners.inspector, shape)]
    return points


def filter_contact_points(
    scene_graph: SceneGraph, points: ContactPoints
) -> list[tuple[GeometryId, GeometryId]]:
    """Exclude the pairs of shapes that would count a contact twice, after the plant is finalized.

    * Balls do not touch balls.
    * Polyhedra themselves do not touch planes, and of their balls only those at corners do: the lowest point of a
      polyhedron over a plane is always a corner.
    * Polyhedra themselves do not touch each other: if two overlap, a corner or an edge of one of them is in the other.

    Returns:
        the pairs of shapes (no balls) that touched before and no longer do. The balls of these shapes touch in their
        place.
    """
    if not points.balls:
        return []
    inspector = scene_graph.model_inspector()
    shapes = inspector.GetAllGeometryIds(Role.kProximity)
    planes = [shape for shape in shapes if isinstance(inspector.GetShape(shape), HalfSpace)]
    manager = scene_graph.collision_filter_manager()
    manager.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(points.balls)))

    polyhedra = set(points.polyhedra)
    planes_and_polyhedra = polyhedra.union(planes)
    replaced = []
    # The filter above has removed the pairs of two balls, which can be thousands and would take most of the time of
    # building a station. Sorted, so that the order of the pairs is the same in every run.
    for pair in sorted(inspector.GetCollisionCandidates()):
        has_polyhedron = not polyhedra.isdisjoint(pair)
        if has_polyhedron and planes_and_polyhedra.issuperset(pair):
            replaced.append(pair)

    filters = CollisionFilterDeclaration()
    filters.ExcludeWithin(GeometrySet(points.polyhedra))
    filters.ExcludeBetween(GeometrySet([*points.edges, *points.polyhedra]), GeometrySet(planes))
    manager.Apply(filters)
    return replaced


def is_flat(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    """Whether a shape can lie on another one with a face or an edge, so that one point does not carry it."""
    return isinstance(inspector.GetShape(shape), Box | Cylinder | Capsule | Mesh | Convex)


def _is_terrain_box(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    """Whether a shape is a box of the floor's terrain, which is called ``floor.<number>``."""
    return own_name(inspector, shape).startswith(f"{FLOOR}.")


@dataclass(frozen=True)
class _ShapeOwners:
    """Finds the bodies, pieces and robots to which the collision shapes of a plant belong.

    Attributes:
        plant: the plant with all robots and pieces.
        inspector: inspector of the plant's scene graph.
        station: the station with its pieces.
        robots: the robots in the plant.
    """

    plant: MultibodyPlant
    inspector: SceneGraphInspector
    station: ResolvedStation
    robots: Sequence[StationRobot]

    def body(self, shape: GeometryId) -> RigidBody:
        """Find the body of the plant to which a shape is fixed."""
        return self.plant.GetBodyFromFrameId(self.inspector.GetFrameId(shape))

    def piece(self, shape: GeometryId) -> str | None:
        """Find the name of the piece to which a shape belongs. Returns None for shapes of robots and of the floor."""
        return piece_of_shape(self.station, self.inspector, shape)

    def robot(self, shape: GeometryId) -> StationRobot | None:
        """Find the robot that owns a shape, or carries the shape's piece. Returns None if there is no such robot."""
        instance = self.body(shape).model_instance()
        return next((robot for robot in self.robots if robot.instance == instance), None)

    def moved_mass(self, shape: GeometryId) -> float:
        """Mass of the free piece, or of the whole robot with what it carries, with which a shape moves [kg].

        Pieces that are mounted on a free piece are not counted.
        """
        instance = self.body(shape).model_instance()
        indices = self.plant.GetBodyIndices(instance)
        return float(sum(self.plant.get_body(index).default_mass() for index in indices))

    def is_free(self, shape: GeometryId) -> bool:
        """Whether contact carries the body of a shape: a free piece, a robot that floats, or a piece on such a robot.

        If the robot has feet, only these of its links are carried by contact. A piece that is mounted on a free piece
        does not count as free.
        """
        piece = self.piece(shape)
        # A piece that no robot carries has the world as its carrier.
        if piece is not None and self.station.pieces[piece].carrier == WORLD:
            return self.station.pieces[piece].free
        robot = self.robot(shape)
        if robot is None or not robot.floats:
            return False
        if robot.feet is None or piece is not None:
            return True
        # Feet may be named after links that were merged into other bodies, so that bodies are compared, not names.
        feet = [
            self.plant.GetFrameByName(link, robot.instance).body().index()
            for link in robot.feet.links
        ]
        return self.body(shape).index() in feet

    def is_support(self, shape: GeometryId) -> bool:
        """Whether free bodies can lie on a shape or be held by it: that of a piece that is not free, or of a finger.

        Fingers of robots that float, and pieces that such robots carry, do not count.
        """
        piece = self.piece(shape)
        robot = self.robot(shape)
        if robot is not None and robot.floats:
            return False
        if piece is not None:
            return not self.station.pieces[piece].free
        if robot is None:
            return False
        fingers = [robot.joints[axis].child_body().index() for axis in robot.model.fingers]
        return self.body(shape).index() in fingers


def _register_balls(
    owners: _ShapeOwners,
    shape: GeometryId,
    load: float,
    points: ContactPoints,
) -> None:
    """Register the balls of one shape in the plant. Append them, and the shape if it is a polyhedron, to ``points``.

    Each ball has the material of the shape, and the shape's name with a number.

    Args:
        owners: the plant with its shapes.
        shape: the flat shape.
        load: weight of the heaviest body that such balls carry [N].
        points: the balls registered so far; changed.
    """
    inspector = owners.inspector
    body = owners.body(shape)
    # Balls are registered in the frame of the body, but computed in that of the shape.
    pose = inspector.GetPoseInFrame(shape)
    material = inspector.GetProximityProperties(shape)
    name = own_name(inspector, shape)

    def register(ball: ContactBall, label: str) -> GeometryId:
        """Register one ball, whose name ends with a label. Returns its id."""
        # The ball's name begins with that of the shape, so that forces on it count as forces on the shape's piece.
        centre = RigidTransform(pose.multiply(ball.centre))
        properties = ProximityProperties(material)
        return owners.plant.RegisterCollisionGeometry(
            body, centre, Sphere(ball.radius), f"{name}.{label}", properties
        )

    depth = _sinking_depth(owners.station.config, owners.piece(shape), load)
    corners = shape_corners(inspector, shape)
    # Cylinders and capsules have no corners.
    is_polyhedron = 0 < len(corners) <= MOST_CORNERS
    if is_polyhedron:
        balls = balls_at_corners(corners, depth=depth)
        # The balls at the corners have the order of the corners, and are the ends of the edges.
        on_edges = balls_on_edges(balls, _edges_of(inspector, shape))
        points.polyhedra.append(shape)
        points.edges += [register(ball, f"edge_{number}") for number, ball in enumerate(on_edges)]
    else:
        balls = _balls_of_round_shape(inspector, shape, depth)
    points.corners += [register(ball, f"corner_{number}") for number, ball in enumerate(balls)]


def balls_at_corners(
    corners: Vector,
    *,
    depth: float = 0.0,
    protrusion: float = 0.0,
) -> list[ContactBall]:
    """Place a ball inside each corner of a convex body, so that the balls touch its faces from inside.

    Each ball is shifted inward along x, y and z by its radius, less the protrusion. So it reaches exactly to faces that
    are parallel to the planes of the shape's frame, or beyond them by the protrusion. A ball whose corner is exactly in
    the middle of the body in x, y or z, as the tip of a pyramid, is not shifted in that direction. At slanted faces a
    ball ends below the face or protrudes from it, usually by less than its radius; on strongly slanted bodies by more.

    Args:
        corners: corners of the body, shape (m, 3) [m], in the frame of the shape.
        depth: how far the balls sink in under the body's weight [m]; soft contacts get larger balls.
        protrusion: how far the balls reach beyond the faces [m].
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    shortest_side = float(np.ptp(corners, axis=0).min())
    radius = _ball_radius(shortest_side, depth)
    # Signs of the directions along x, y and z from the middle to each corner; 0 in the middle.
    outward = np.sign(corners - middle)
    centres = corners - outward * (radius - protrusion)
    return [ContactBall(centre, radius) for centre in centres]


def balls_on_edges(corners: Sequence[ContactBall], edges: Sequence[Edge]) -> Iterator[ContactBall]:
    """Yield balls along the edges of a polyhedron, evenly spaced between the balls at its corners.

    Two neighbouring balls are apart by at most half of the smallest extent of the polyhedron along its axes, unless an
    edge would then have more than MOST_EDGE_PARTS parts.

    Args:
        corners: balls at all corners of the polyhedron.
        edges: edges between these corners.
    """
    centres = np.array([ball.centre for ball in corners])
    # Half of the smallest extent. The box around the balls is a little smaller than that around the polyhedron.
    longest_part = float(np.ptp(centres, axis=0).min()) / 2
    for edge in edges:
        start = centres[edge.first]
        along = centres[edge.second] - start
        needed = np.ceil(np.linalg.norm(along) / longest_part)
        parts = int(min(needed, MOST_EDGE_PARTS))
        # The two ends of the edge, 0 and `parts`, have the balls of the corners.
        for part in range(1, parts):
            yield ContactBall(start + along * part / parts, corners[edge.first].radius)


def _edges_of(inspector: SceneGraphInspector, shape: GeometryId) -> list[Edge]:
    """Find the edges of a box or of a mesh's convex hull; the corners are numbered as in :func:`shape_corners`."""
    if isinstance(inspector.GetShape(shape), Box):
        return _edges_of_box(shape_corners(inspector, shape))
    hull = inspector.GetConvexHull(shape)
    # Two faces share each edge, so the ends are sorted and duplicates dropped.
    edges = set[Edge]()
    for face in range(hull.num_elements()):
        polygon = hull.element(face)
        around = [polygon.vertex(index) for index in range(polygon.num_vertices())]
        closed = [*around, around[0]]
        edges |= {Edge(min(ends), max(ends)) for ends in pairwise(closed)}
    return sorted(edges)


def _edges_of_box(corners: Vector) -> list[Edge]:
    """Find the twelve edges of a box from its corners (8, 3) in its own frame: their ends differ in one coordinate."""
    edges = []
    for first, second in combinations(range(len(corners)), 2):
        differences = np.count_nonzero(corners[first] != corners[second])
        if differences == 1:
            edges.append(Edge(first, second))
    return edges


def _sinking_depth(config: StationConfig, piece: str | None, load: float) -> float:
    """Compute how far four balls sink in under a load [m].

    Only the stiffness that the user gives counts: that of the piece, otherwise that of the station. Without one, the
    depth is 0: with Drake's default stiffness bodies sink in by some micrometres only.

    Args:
        config: configuration of the station.
        piece: name of the piece to which the balls belong, or None if they belong to a robot or the floor.
        load: the load on all balls together [N].
    """
    stiffness = None if config.contact is None else config.contact.stiffness
    contact_of_piece = None if piece is None else config.pieces[piece].contact
    if contact_of_piece is not None and contact_of_piece.stiffness is not None:
        stiffness = contact_of_piece.stiffness
    if stiffness is None:
        return 0.0
    # Each ball carries an equal part of the load: depth = force / stiffness.
    return load / (_CARRYING_BALLS * stiffness)


def _balls_of_round_shape(
    inspector: SceneGraphInspector,
    shape_id: GeometryId,
    depth: float,
) -> list[ContactBall]:
    """Place the balls of a shape that is flat in parts only: a cylinder, a capsule or a mesh with many corners.

    The balls protrude by twice the depth [m] by which they sink in, but at least by SMALLEST_PROTRUSION and at most by
    LARGEST_PROTRUSION, so that they carry the flat parts.
    """
    # Twice the depth, so that balls that have sunk in still hold the flat part off.
    protrusion = float(np.clip(2 * depth, SMALLEST_PROTRUSION, LARGEST_PROTRUSION))
    shape = inspector.GetShape(shape_id)
    if isinstance(shape, Cylinder):
        return balls_of_cylinder(shape.radius(), shape.length() / 2, protrusion)
    if isinstance(shape, Capsule):
        return _balls_of_capsule(shape, protrusion)
    corners = _spread_corners(shape_corners(inspector, shape_id), MOST_CORNERS)
    return balls_at_corners(corners, depth=depth, protrusion=protrusion)


def _balls_of_capsule(capsule: Capsule, protrusion: float) -> list[ContactBall]:
    """Place two balls at the ends of a capsule, on which it lies; their radius is its own plus the protrusion [m]."""
    balls = []
    for side in (-1.0, 1.0):
        centre = np.array([0.0, 0.0, side * capsule.length() / 2])
        balls.append(ContactBall(centre, capsule.radius() + protrusion))
    return balls


def balls_of_cylinder(
    radius: float,
    half_length: float,
    protrusion: float,
) -> list[ContactBall]:
    """Place small balls on both rims of a cylinder and, if it is longer than wide, two wide balls on which it rolls.

    The small balls protrude from the end faces but not from the mantle, so that they do not disturb rolling. The wide
    balls are inside the ends of the cylinder, and protrude from the mantle, so that the cylinder rolls on them.

    Args:
        radius: radius of the cylinder [m].
        half_length: half of its length along z [m].
        protrusion: how far the small balls reach beyond the end faces, and the wide ones beyond the mantle [m].
    """
    # The shortest side of a cylinder is its diameter or its length.
    small = _ball_radius(2 * min(radius, half_length), protrusion)
    # A small ball reaches to `radius - protrusion` across, and to `half_length + protrusion` along the axis.
    across = radius - small - protrusion
    height = half_length - small + protrusion
    angles = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    balls = []
    for side, angle in product((-1.0, 1.0), angles):
        centre = np.array([across * np.cos(angle), across * np.sin(angle), side * height])
        balls.append(ContactBall(centre, small))
    # In a shorter cylinder, balls of its radius would protrude from both end faces.
    if half_length > radius:
        for side in (-1.0, 1.0):
            # A ball of the cylinder's radius touches the end face from inside there.
            centre = np.array([0.0, 0.0, side * (half_length - radius)])
            balls.append(ContactBall(centre, radius + protrusion))
    return balls


def _ball_radius(shortest_side: float, depth: float) -> float:
    """Choose the radius of a shape's small balls [m].

    Args:
        shortest_side: shortest side of the shape [m].
        depth: how far the balls sink in, or protrude [m]. The radius is at least twice as large, unless the shape is
            too small for such balls.
    """
    # Small balls keep the shape's form; only soft contacts need larger ones.
    usual = min(LARGEST_RADIUS, RADIUS_SHARE * shortest_side)
    # With the factor 2, a ball sinks in by no more than half of its radius, unless the shape's side limits the radius.
    soft = min(2 * depth, SOFT_RADIUS_SHARE * shortest_side)
    return max(usual, soft)


def _spread_corners(corners: Vector, count: int) -> Vector:
    """Select some of k corners (k, 3) [m] so that they are far apart: each next one is the farthest from those before.

    The choice begins at the corner with the lowest z, then y, then x. Of corners that are equally far away, the
    first one in the order of the mesh's hull is taken. So the choice is the same in every run.

    Args:
        corners: all corners of a hull, shape (k, 3) [m].
        count: number of corners to select, smaller than k.

    Returns:
        the selected corners, shape (count, 3) [m].
    """
    lowest = int(np.lexsort(corners.T)[0])
    chosen = [lowest]
    # Distance of each corner from the nearest chosen one.
    distances = np.linalg.norm(corners - corners[lowest], axis=1)
    while len(chosen) < count:
        farthest = int(np.argmax(distances))
        chosen.append(farthest)
        distances = np.minimum(distances, np.linalg.norm(corners - corners[farthest], axis=1))
    return corners[chosen]
