"""Contact points at the corners and edges of flat bodies.

In point contact, Drake pushes two shapes apart at one point, the deepest. A box that lies flat on a floor has no such
point: it jumps from corner to corner, the box trembles, and friction stops a body that should slide. Small balls at
the corners and along the edges carry a flat body as Coulomb's law and statics demand, under every solver:

* A box of 2 kg, pushed with 15 N at a friction of 0.4, slides as far as Coulomb's law says, within 1 %.
* A box twice as high as wide stands on a slope of 25 degrees and falls at 28; in theory it tips at 26.6. With
  hydroelastic surfaces it falls at 22 degrees, since the sudden load at the start shakes it.

A box touches others with its balls alone. So does the convex hull of a mesh with few corners. Of cylinders, capsules
and rounder meshes, the shape itself touches as well; its balls protrude a little, so that they carry its flat faces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
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

from simrob_drake.frames import Vector
from simrob_drake.parts.site import WORLD, StationRobot
from simrob_drake.parts.targets import FLOOR, own_name, piece_of_shape
from simrob_drake.robots.outlines import shape_corners
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import ResolvedStation

LARGEST_RADIUS = 1e-3
"""Radius of the balls [m], unless the shape is small. They lie inside of the shape, so it gets rounder by this."""

RADIUS_SHARE = 0.05
"""Largest radius of the balls as a share of the shortest side of a shape."""

SOFT_RADIUS_SHARE = 0.2
"""The same where contacts are soft: a ball must not sink in by more than its radius, or the side of a body on which it
lies near an edge would push it away sideways."""

SMALLEST_PROTRUSION = 2e-5
"""How far the balls of round shapes protrude beyond their flat faces [m]. Drake's default stiffness gives way by less
under a body's own weight (12 µm for a box of 3 kg)."""

LARGEST_PROTRUSION = 5e-4
"""Limit of the protrusion where contacts are soft [m]."""

RIM_POINTS = 12
"""Balls on each rim of a cylinder. It tips up to r (1 - cos(180°/12)), 3.4 % of its radius, too early."""

MOST_CORNERS = 32
"""Corners of a mesh's convex hull that get balls. If a hull has more, those that are farthest apart get them."""

MOST_EDGE_PARTS = 8
"""Parts into which balls divide an edge. A part is at most half of the shape's shortest side, if these suffice."""


class ContactBall(NamedTuple):
    """A ball that stands for a part of a flat shape.

    Attributes:
        centre: in the frame of the shape, shape (3,) [m].
        radius: [m].
    """

    centre: Vector
    radius: float


@dataclass
class ContactPoints:
    """The balls of a plant.

    Attributes:
        corners: balls at corners, rims and ends.
        edges: balls along edges, which carry what lies across another body.
        polyhedra: shapes whose corners all have balls, so that they need not touch planes or each other themselves.
    """

    corners: list[GeometryId] = field(default_factory=list)
    edges: list[GeometryId] = field(default_factory=list)
    polyhedra: list[GeometryId] = field(default_factory=list)

    @property
    def balls(self) -> list[GeometryId]:
        """All balls."""
        return [*self.corners, *self.edges]


def uses_contact_points(config: StationConfig) -> bool:
    """Whether flat bodies of a station touch at their corners: in point contact, unless it is turned off.

    MuJoCo finds several points for each pair of shapes by itself.
    """
    contact = config.contact
    if config.mode != "dynamic" or contact is None or config.solver.scheme == "mujoco":
        return False
    return contact.model == "point" and contact.corners


def add_contact_points(
    plant: MultibodyPlant, scene_graph: SceneGraph, station: ResolvedStation, robots: Sequence[StationRobot]
) -> ContactPoints:
    """Give the flat shapes of a station their balls, before the plant is finalized.

    Free pieces and robots that float get them. If there are any of these, so do the things on which they can lie and
    between which they can be held: fixed and carried pieces, and the fingers of robots.
    """
    points = ContactPoints()
    if not uses_contact_points(station.config):
        return points
    inspector = scene_graph.model_inspector()
    shapes = [shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if is_flat(inspector, shape)]
    free = [shape for shape in shapes if _is_free(plant, inspector, station, robots, shape)]
    if free:
        supports = [shape for shape in shapes if _is_support(plant, inspector, station, robots, shape)]
        load = max(_mass_of(plant, inspector, shape) for shape in free) * abs(station.config.gravity)
        for shape in [*free, *supports]:
            _add_balls(plant, inspector, station, shape, load, points)
        # Boxes of a terrain need no balls: those of the bodies on them find their faces.
        points.polyhedra += [shape for shape in shapes if own_name(inspector, shape).startswith(f"{FLOOR}.")]
    return points


def filter_contact_points(scene_graph: SceneGraph, points: ContactPoints) -> list[tuple[GeometryId, GeometryId]]:
    """Leave out the pairs of shapes that would count a contact twice, after the plant is finalized.

    Returns the pairs of shapes for which balls touch.

    * Balls do not touch balls.
    * Over a plane, the lowest point of a polyhedron is a corner. So only balls at corners touch planes.
    * Two polyhedra touch with their balls: a corner or an edge of one of them is always on the other.
    """
    if not points.balls:
        return []
    inspector = scene_graph.model_inspector()
    everything = inspector.GetAllGeometryIds(Role.kProximity)
    planes = [shape for shape in everything if isinstance(inspector.GetShape(shape), HalfSpace)]
    polyhedra = set(points.polyhedra)
    others = polyhedra | set(planes)
    replaced = [
        pair
        for pair in sorted(inspector.GetCollisionCandidates())
        if polyhedra.intersection(pair) and others.issuperset(pair)
    ]
    filters = CollisionFilterDeclaration()
    filters.ExcludeWithin(GeometrySet(points.balls))
    filters.ExcludeWithin(GeometrySet(points.polyhedra))
    filters.ExcludeBetween(GeometrySet([*points.edges, *points.polyhedra]), GeometrySet(planes))
    scene_graph.collision_filter_manager().Apply(filters)
    return replaced


def is_flat(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    """Whether a shape can lie on another one with a face or an edge, so that one point does not carry it."""
    return isinstance(inspector.GetShape(shape), Box | Cylinder | Capsule | Mesh | Convex)


def _is_free(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    station: ResolvedStation,
    robots: Sequence[StationRobot],
    shape: GeometryId,
) -> bool:
    """Whether a shape belongs to a body that only contact carries: a free piece, or a robot that floats.

    A robot with feet is carried by these alone, so its other links keep their single points.
    """
    piece = piece_of_shape(station, inspector, shape)
    if piece is not None and station.pieces[piece].carrier == WORLD:
        return station.pieces[piece].free
    robot = _robot_of(plant, inspector, robots, shape)
    if robot is None or not robot.floats:
        return False
    if robot.feet is None or piece is not None:
        return True
    feet = [plant.GetFrameByName(link, robot.instance).body().index() for link in robot.feet.links]
    return _body_of(plant, inspector, shape).index() in feet


def _is_support(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    station: ResolvedStation,
    robots: Sequence[StationRobot],
    shape: GeometryId,
) -> bool:
    """Whether free bodies can lie on a shape or be held by it: a fixed or carried piece, or a finger."""
    piece = piece_of_shape(station, inspector, shape)
    robot = _robot_of(plant, inspector, robots, shape)
    if piece is not None:
        floats = robot is not None and robot.floats
        return not (floats or station.pieces[piece].free)
    if robot is None or robot.floats:
        return False
    fingers = [robot.joints[axis].child_body().index() for axis in robot.model.fingers]
    return _body_of(plant, inspector, shape).index() in fingers


def _body_of(plant: MultibodyPlant, inspector: SceneGraphInspector, shape: GeometryId) -> RigidBody:
    """Find the body to which a shape is fixed."""
    return plant.GetBodyFromFrameId(inspector.GetFrameId(shape))


def _mass_of(plant: MultibodyPlant, inspector: SceneGraphInspector, shape: GeometryId) -> float:
    """Mass of everything that moves with a shape: a free piece, or a whole robot [kg]."""
    instance = _body_of(plant, inspector, shape).model_instance()
    return float(sum(plant.get_body(index).default_mass() for index in plant.GetBodyIndices(instance)))


def _robot_of(
    plant: MultibodyPlant, inspector: SceneGraphInspector, robots: Sequence[StationRobot], shape: GeometryId
) -> StationRobot | None:
    """Find the robot to whose links a shape is fixed. Returns None for pieces that stand alone, and for the floor."""
    instance = _body_of(plant, inspector, shape).model_instance()
    return next((robot for robot in robots if robot.instance == instance), None)


def _add_balls(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    station: ResolvedStation,
    shape: GeometryId,
    load: float,
    points: ContactPoints,
) -> None:
    """Register the balls of one shape, with its material, under its name and a number.

    The load is the weight of the heaviest body that such balls carry [N].
    """
    body = _body_of(plant, inspector, shape)
    pose = inspector.GetPoseInFrame(shape)
    material = inspector.GetProximityProperties(shape)
    name = own_name(inspector, shape)

    def register(ball: ContactBall, label: str) -> GeometryId:
        centre = RigidTransform(pose.multiply(ball.centre))
        properties = ProximityProperties(material)
        return plant.RegisterCollisionGeometry(body, centre, Sphere(ball.radius), f"{name}.{label}", properties)

    corners = shape_corners(inspector, shape)
    depth = _sinking(station.config, piece_of_shape(station, inspector, shape), load)
    if 0 < len(corners) <= MOST_CORNERS:
        balls = balls_at_corners(corners, depth=depth)
        on_edges = balls_on_edges(balls, _edges_of(inspector, shape))
        points.polyhedra.append(shape)
        points.edges += [register(ball, f"edge_{number}") for number, ball in enumerate(on_edges)]
    else:
        balls = _balls_of_round_shape(inspector, shape, depth)
    points.corners += [register(ball, f"corner_{number}") for number, ball in enumerate(balls)]


def balls_at_corners(corners: Vector, *, depth: float = 0.0, protrusion: float = 0.0) -> list[ContactBall]:
    """Place a ball inside each corner of a convex body, so that the balls touch its faces from inside.

    Each ball is shifted inward along x, y and z by its radius. So it touches faces that are parallel to the planes of
    the shape's frame exactly. At slanted faces it ends below the face or protrudes from it, usually by less than its
    radius; on strongly slanted bodies it can protrude by more.

    Args:
        corners: corners of the body, shape (m, 3) [m], in the frame of the shape.
        depth: how far the balls sink in under the body's weight [m]; their radius is chosen by it.
        protrusion: how far the balls reach beyond the faces [m].
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = _radius(float(np.ptp(corners, axis=0).min()), depth)
    outward = np.sign(corners - middle)
    centres = corners - outward * (radius - protrusion)
    return [ContactBall(centre, radius) for centre in centres]


def balls_on_edges(corners: Sequence[ContactBall], edges: Sequence[tuple[int, int]]) -> Iterator[ContactBall]:
    """Yield balls along edges, evenly spaced between those at the corners.

    Args:
        corners: balls at the corners of a polyhedron.
        edges: the places of an edge's two ends among the corners.
    """
    centres = np.array([ball.centre for ball in corners])
    longest_part = float(np.ptp(centres, axis=0).min()) / 2
    for first, second in edges:
        along = centres[second] - centres[first]
        needed = np.ceil(np.linalg.norm(along) / longest_part)
        parts = int(min(needed, MOST_EDGE_PARTS))
        for part in range(1, parts):
            yield ContactBall(centres[first] + along * part / parts, corners[first].radius)


def _edges_of(inspector: SceneGraphInspector, shape_id: GeometryId) -> list[tuple[int, int]]:
    """Find the edges of a box or a convex hull, as pairs of the places of their ends among the shape's corners."""
    if isinstance(inspector.GetShape(shape_id), Box):
        corners = shape_corners(inspector, shape_id)
        # The ends of an edge of a box differ in one coordinate.
        differences = (corners[:, np.newaxis] != corners).sum(axis=2)
        return [(int(first), int(second)) for first, second in np.argwhere(np.triu(differences == 1))]
    hull = inspector.GetConvexHull(shape_id)
    edges = set[tuple[int, int]]()
    for face in range(hull.num_elements()):
        polygon = hull.element(face)
        around = [polygon.vertex(place) for place in range(polygon.num_vertices())]
        edges |= {(min(ends), max(ends)) for ends in pairwise([*around, around[0]])}
    return sorted(edges)


def _sinking(config: StationConfig, piece: str | None, load: float) -> float:
    """Compute how far four balls of a piece sink in under a load [N], in [m].

    This counts where the station or the piece states a stiffness. Drake's default gives way by some micrometres,
    and the result is 0.
    """
    contact = config.contact
    stiffness = None if contact is None else contact.stiffness
    own = None if piece is None else config.pieces[piece].contact
    if own is not None and own.stiffness is not None:
        stiffness = own.stiffness
    return 0.0 if stiffness is None else load / (4 * stiffness)


def _balls_of_round_shape(inspector: SceneGraphInspector, shape_id: GeometryId, depth: float) -> list[ContactBall]:
    """Place the balls of a shape that is flat in parts only: a cylinder, a capsule or a mesh with many corners.

    They protrude by twice the depth (m) to which they sink in, so that they carry its flat faces.
    """
    protrusion = float(np.clip(2 * depth, SMALLEST_PROTRUSION, LARGEST_PROTRUSION))
    shape = inspector.GetShape(shape_id)
    if isinstance(shape, Cylinder):
        return balls_of_cylinder(shape.radius(), shape.length() / 2, protrusion)
    if isinstance(shape, Capsule):
        ends = np.array([[0.0, 0.0, side * shape.length() / 2] for side in (-1.0, 1.0)])
        return [ContactBall(end, shape.radius() + protrusion) for end in ends]
    corners = _spread(shape_corners(inspector, shape_id), MOST_CORNERS)
    return balls_at_corners(corners, depth=depth, protrusion=protrusion)


def balls_of_cylinder(radius: float, half_length: float, protrusion: float) -> list[ContactBall]:
    """Place balls on both rims of a cylinder and, if it is long, two as wide as itself on which it rolls.

    The balls on the rims protrude from the end faces and not from the mantle, so that they do not disturb rolling.

    Args:
        radius: [m].
        half_length: half of its length along z [m].
        protrusion: how far the balls reach beyond the end faces, and the wide ones beyond the mantle [m].
    """
    small = _radius(2 * min(radius, half_length), protrusion)
    across = radius - small - protrusion
    height = half_length - small + protrusion
    angles = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    balls = []
    for side, angle in product((-1.0, 1.0), angles):
        centre = np.array([across * np.cos(angle), across * np.sin(angle), side * height])
        balls.append(ContactBall(centre, small))
    if half_length > radius:
        for side in (-1.0, 1.0):
            centre = np.array([0.0, 0.0, side * (half_length - radius)])
            balls.append(ContactBall(centre, radius + protrusion))
    return balls


def _radius(shortest_side: float, depth: float) -> float:
    """Compute the radius of the balls of a shape that sink in by a depth under its weight, all in [m]."""
    usual = min(LARGEST_RADIUS, RADIUS_SHARE * shortest_side)
    soft = min(2 * depth, SOFT_RADIUS_SHARE * shortest_side)
    return max(usual, soft)


def _spread(corners: Vector, most: int) -> Vector:
    """Select ``most`` corners (k, 3) that are far apart: each is the farthest from those before.

    The choice begins at the corner with the lowest z, then y, then x. Of corners that are equally far away, the
    first one in the order of the mesh's hull is taken, which is the same in every run.
    """
    chosen = [int(np.lexsort(corners.T)[0])]
    distances = np.linalg.norm(corners - corners[chosen[0]], axis=1)
    while len(chosen) < most:
        farthest = int(np.argmax(distances))
        chosen.append(farthest)
        distances = np.minimum(distances, np.linalg.norm(corners - corners[farthest], axis=1))
    return corners[chosen]
