"""A station that is put into configurations, and never stepped: how near its robots come to what, how they stand."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, QueryObject
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.frames import Vector
from simrob_drake.lifetime import built
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR, owner_and_robot, owner_of_shape
from simrob_drake.robots.outlines import lowest_points, shape_corners, shape_outline
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContactConfig

_TOUCHING = 1e-3  # what lies less above the lowest point carries, too: contacts and servos give way by as much [m]
KNEELING = 0.25
"""A link that carries nearer to its joint than this part of its length kneels: heels are at 0.3 and more."""

_EVEN = 1e-4  # weight of sharing the load evenly, where there are more contacts than equations


@dataclass(frozen=True)
class Standing:
    """A robot on the ground, at rest."""

    mass: float  # of the robot with what it carries [kg]
    gap: float  # height of the lowest point over the ground [m]; negative if it lies deeper
    contacts: int  # how many points carry
    # distance of the centre of mass, seen from above, from the border of the support area [m]; negative outside of it,
    # and zero where the points span no area
    margin: float
    height: float  # of the centre of mass over the lowest point [m]
    torque: Vector  # what the joints hold against gravity, shape (n,) [N·m]
    # of each link that carries, by its name, how far from its joint it does, as part of its length: 1 at its farthest
    # point, near 0 at a knee; 1 of the root, which hangs on no joint
    ends: Mapping[str, float]


def standing(station: StationPlant, robot: StationRobot, context: Context | None = None) -> Standing | None:
    """Return how a robot stands in a state, or at the start; without feet on its collision shapes, without any None."""
    plant = station.plant
    context = plant.CreateDefaultContext() if context is None else context
    supports = _support_points(station, robot, context)
    if not supports:
        return None
    points = np.vstack([on_body for _, on_body in supports])
    heights = points[:, 2] - station.ground.beneath(points)
    gap = float(heights.min())
    carrying = heights <= gap + _TOUCHING
    frames = [frame for frame, on_body in supports for _ in on_body]
    points, frames = points[carrying], [frame for frame, carries in zip(frames, carrying, strict=True) if carries]
    jacobians = np.array([_lift(plant, context, frame, point) for frame, point in zip(frames, points, strict=True)])
    mass = plant.CalcTotalMass(context, [robot.instance])
    com = plant.CalcCenterOfMassPositionInWorld(context, [robot.instance])
    weight = mass * float(np.linalg.norm(plant.gravity_field().gravity_vector()))
    forces = _vertical_forces(points, com, weight)
    generalized = plant.CalcGravityGeneralizedForces(context) + np.einsum("kv,k->v", jacobians, forces)
    torque = -robot.axis_map.efforts(generalized)
    ends = {
        frame.name(): 1.0
        if frame.body().index() == robot.root.body().index()
        else _end(station, frame, context, points[[other is frame for other in frames]])
        for frame in dict.fromkeys(frames)
    }
    height = float(com[2] - points[:, 2].min())
    return Standing(mass, gap, len(points), _margin(points[:, :2], com[:2]), height, torque, ends)


def shape_points(station: StationPlant, robot: StationRobot, context: Context) -> list[tuple[RigidBody, Vector]]:
    """Return points of a robot's shapes in the world, of each the lowest over the floor, (k, 3) [m], with bodies."""
    plant, tilt = station.plant, station.ground.tilt
    inspector, from_floor = station.scene_graph.model_inspector(), tilt.inverse()
    found = []
    for body in map(plant.get_body, plant.GetBodyIndices(robot.instance)):
        for shape in station.shapes_of_body(body):
            pose = from_floor @ plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(shape)
            points = lowest_points(inspector.GetShape(shape), pose, shape_corners(inspector, shape))
            found.append((body, np.asarray((tilt @ points.T).T)))
    return found


def _support_points(station: StationPlant, robot: StationRobot, context: Context) -> list[tuple[Frame, Vector]]:
    """Return the points that a robot may stand on in a state, by the frames of its bodies: in the world, (k, 3) [m]."""
    if robot.feet is None:
        return [(body.body_frame(), points) for body, points in shape_points(station, robot, context)]
    plant, tilt = station.plant, station.ground.tilt
    found = []
    for link in robot.feet.links:
        frame = plant.GetFrameByName(link, robot.instance)
        seen = tilt.inverse() @ frame.CalcPoseInWorld(context)
        points = robot.feet.lowest_points(link, seen.GetAsMatrix4()[np.newaxis])[0]
        found.append((frame, np.asarray((tilt @ points.T).T)))
    return found


def outline(station: StationPlant, body: RigidBody) -> Vector:
    """Return points of the collision shapes of a body, those that are farthest out, in its frame, shape (k, 3) [m]."""
    inspector, shapes = station.scene_graph.model_inspector(), station.shapes_of_body(body)
    return np.vstack([np.zeros((0, 3)), *(shape_outline(inspector, shape) for shape in shapes)])


def _end(station: StationPlant, frame: Frame, context: Context, points: Vector) -> float:
    """Return how far points (k, 3) in the world are from the joint of a link, the nearest, as part of its length."""
    reach = np.linalg.norm(outline(station, frame.body()), axis=1).max(initial=0.0)
    ways = np.linalg.norm(points - frame.CalcPoseInWorld(context).translation(), axis=1)
    return float(ways.min() / reach) if reach > 0 else 1.0


def _lift(plant: MultibodyPlant, context: Context, frame: Frame, point: Vector) -> Vector:
    """Return what a lifting force at a point of a body does to the plant's velocities, shape (nv,)."""
    own = frame.CalcPoseInWorld(context).inverse() @ point
    world = plant.world_frame()
    jacobian = plant.CalcJacobianTranslationalVelocity(context, JacobianWrtVariable.kV, frame, own, world, world)
    return np.asarray(jacobian[2])


def _vertical_forces(points: Vector, com: Vector, weight: float) -> Vector:
    """Share the weight among points (k, 3), as evenly as the balance of moments about the centre of mass allows."""
    from scipy.optimize import nnls  # loaded where it is needed: importing the package stays quick

    arms = points[:, :2] - com[:2]
    balance = np.vstack([np.ones(len(points)), arms.T])
    rows = np.vstack([balance, _EVEN * np.eye(len(points))])
    share, _ = nnls(rows, np.concatenate([[1.0, 0.0, 0.0], np.zeros(len(points))]))
    return np.asarray(weight * share)


def _margin(points: Vector, com: Vector) -> float:
    """Return how far inside of the convex hull of points (k, 2) a point (2,) lies [m]."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        sides = ConvexHull(points).equations
    except (QhullError, ValueError):  # fewer than three points, or all in a line
        return 0.0
    return float(-(sides[:, :2] @ com + sides[:, 2]).max())


class PosedStation:
    """Robots, pieces and floor of a station, where they are told to be."""

    def __init__(
        self, config: StationConfig, add: Callable[[DiagramBuilder, StationPlant], None] = lambda *_: None
    ) -> None:
        """Build it as it begins; ``add`` puts more into its diagram; raises InvalidModel: an impossible robot."""
        builder = DiagramBuilder()
        self.resolved = resolve(config)  # what it is made of
        self.station = add_plant(builder, self.resolved)  # its plant, with the robots
        self.plant: MultibodyPlant = self.station.plant  # Drake's own
        stepped = config.mode == "dynamic"
        self._positions_port = None if stepped else self.station.add_geometry_poses(builder)
        add(builder, self.station)
        self._diagram = built(builder)
        self._scene = self._diagram.CreateDefaultContext()
        own = self.plant.CreateDefaultContext()
        inside = stepped and self.station.engine is None
        self.context = self.plant.GetMyMutableContextFromRoot(self._scene) if inside else own
        self.initial: Vector = self.plant.GetPositions(own)  # at the start, shape (nq,)
        self.place(self.initial)

    def place(self, positions: Vector) -> None:
        """Put the station into a configuration, shape (nq,)."""
        self.plant.SetPositions(self.context, positions)
        if self.station.engine is not None:
            self.station.place(self._scene, positions)
        if self._positions_port is not None:
            poses = self._positions_port.get_system()
            self._positions_port.FixValue(poses.GetMyMutableContextFromRoot(self._scene), positions)

    def pose(self, frame: Frame) -> RigidTransform:
        """Return the pose of a frame in the world."""
        return frame.CalcPoseInWorld(self.context)

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Put robots into postures (n,) [rad or m]; the others stay."""
        for name, posture in postures.items():
            self.station.robots[name].axis_map.set_positions(self.plant, self.context, posture)
        self.place(self.plant.GetPositions(self.context))

    def owner(self, shape: GeometryId) -> str:
        """Return what a shape belongs to: a piece, a link of a robot, the floor, or a box of its terrain."""
        return owner_of_shape(self.station, shape)

    def query(self) -> QueryObject:
        """Return the geometry in its present configuration, for distances and pictures."""
        return self.station.query(self._scene)

    def ignore_nearer_than(self, distance: float) -> None:
        """Let shapes that are nearer to each other now [m] pass through each other from now on."""
        scene = self.station.scene_graph
        filters = scene.collision_filter_manager(scene.GetMyMutableContextFromRoot(self._scene))
        for pair in self.query().ComputeSignedDistancePairwiseClosestPoints(distance):
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(GeometrySet(pair.id_A), GeometrySet(pair.id_B)))


TOUCH = 5e-3
"""How deep shapes may lie in each other before it counts [m]: what stands, or is held, touches, and hulls are rough."""

TURNS, SLIDES = (15.0, -15.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0), (0.1, 0.2, 0.4)
"""By how much an axis is moved to see whether another posture is better [deg, m]."""

_STEPS = 10  # axes that are turned to take links apart
_RANDOM, _MOSTLY = 24, 0.9  # postures of chance, and in which part of them shapes overlap that are made so


@dataclass(frozen=True)
class Overlap:
    """Two bodies that lie in each other."""

    depth: float  # of the deepest pair of their shapes [m]; through thin shapes it is too large
    bodies: tuple[str, str]  # their names, in alphabetical order
    robot: str  # whose links, or pieces in hand, both are; empty if they are of two owners


class Clearance(PosedStation):
    """A station in which it is seen what lies in what, links of one robot, too. Meshes count as convex hulls."""

    def __init__(self, config: StationConfig) -> None:
        """Build the station with its shapes, in its initial configuration; raises InvalidModel: an impossible robot."""
        self.config = config
        contact = (config.contact or ContactConfig()).model_copy(update={"self_collision": True})
        super().__init__(config.model_copy(update={"contact": contact}))
        self._owner = cache(partial(owner_and_robot, self.station))

    def lowest(self, robot: StationRobot) -> dict[str, float]:
        """Return how high each body of a robot that has shapes is over the ground beneath it [m], by its name."""
        found: dict[str, float] = {}
        for body, points in shape_points(self.station, robot, self.context):
            height = float((points[:, 2] - self.station.ground.beneath(points)).min())
            found[body.name()] = min(height, found.get(body.name(), height))
        return found

    def chains(self, robot: StationRobot) -> list[tuple[RigidBody, list[int]]]:
        """Return the bodies of a robot, and which of its axes move each, from its root outward."""
        inboard = {joint.child_body().index(): (axis, joint) for axis, joint in enumerate(robot.joints)}
        found = []
        for index in self.plant.GetBodyIndices(robot.instance):
            axes, at = list[int](), index
            while at in inboard:
                axis, joint = inboard[at]
                axes.insert(0, axis)
                at = joint.parent_body().index()
            found.append((self.plant.get_body(index), axes))
        return found

    def overlaps(self) -> list[Overlap]:
        """Return what lies in what, but for the floor and for links whose shapes are made so; the deepest first."""
        found = self._all_overlaps()
        return sorted(
            (overlap for overlap in found.values() if overlap.bodies not in self.made_so), key=lambda one: -one.depth
        )

    @cached_property
    def made_so(self) -> Mapping[tuple[str, str], str]:
        """The pairs of links that overlap in nearly every posture, with their robot: shapes in sockets."""
        before, random = self.plant.GetPositions(self.context), np.random.default_rng(0)
        counts = Counter[tuple[tuple[str, str], str]]()
        for _ in range(_RANDOM):
            self.place_robots({name: _by_chance(robot, random) for name, robot in self.station.robots.items()})
            counts.update((bodies, overlap.robot) for bodies, overlap in self._all_overlaps().items() if overlap.robot)
        self.place(before)
        return {bodies: robot for (bodies, robot), count in counts.items() if count >= _MOSTLY * _RANDOM}

    def _all_overlaps(self) -> dict[tuple[str, str], Overlap]:
        found: dict[tuple[str, str], Overlap] = {}
        for pair in self.query().ComputePointPairPenetration():
            (first, one), (second, other) = sorted((self._owner(pair.id_A), self._owner(pair.id_B)))
            if pair.depth > TOUCH and FLOOR not in (first, second):
                overlap = Overlap(float(pair.depth), (first, second), one if one == other else "")
                found[first, second] = max(overlap, found.get((first, second), overlap), key=lambda known: known.depth)
        return found


def span(robot: StationRobot) -> tuple[Vector, Vector]:
    """Return between what postures of chance lie, each (n,) [rad or m]: the limits, but a turn or a metre at most."""
    most = np.where(robot.model.prismatic, 1.0, np.pi)
    lower, upper = robot.model.axis_limits
    return np.clip(lower, -most, most), np.clip(upper, -most, most)


def _by_chance(robot: StationRobot, random: np.random.Generator) -> Vector:
    """Return a posture of chance (n,) [rad or m], in which fingers are open by one part of their way."""
    posture = random.uniform(*span(robot))
    if robot.model.fingers:
        closed, opened = np.array([*robot.model.fingers.values()]).T
        posture[[*robot.model.fingers]] = closed + random.uniform() * (opened - closed)
    return posture


def turned(robot: StationRobot, posture: Vector, axes: Iterable[int]) -> Iterator[Vector]:
    """Yield postures (n,) in which one of some axes is elsewhere, within the limits."""
    lower, upper = robot.model.axis_limits
    for axis in axes:
        for way in SLIDES if robot.model.prismatic[axis] else np.deg2rad(TURNS):
            tried = posture.copy()
            tried[axis] += way
            if lower[axis] <= tried[axis] <= upper[axis]:
                yield tried


def untangled(clearance: Clearance, robot: StationRobot, posture: Vector, axes: Collection[int]) -> Vector:
    """Return a posture (n,) less in itself, step by step by the axis that takes the deepest overlap apart best."""
    chains = {f"{robot.prefix}{body.name()}": set(order) for body, order in clearance.chains(robot)}

    def overlaps(tried: Vector) -> list[Overlap]:
        clearance.place_robots({robot.name: tried})
        return [overlap for overlap in clearance.overlaps() if overlap.robot == robot.name]

    def depth(tried: Vector) -> float:
        return sum(overlap.depth for overlap in overlaps(tried))

    for _ in range(_STEPS):
        found = overlaps(posture)
        if not found:
            break
        first, second = (chains.get(body, set()) for body in found[0].bodies)
        tried = [posture, *turned(robot, posture, sorted((first ^ second) & set(axes)))]
        best = min(tried, key=depth)
        if best is posture:
            break
        posture = best
    return posture
