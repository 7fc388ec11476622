"""Clearance of the robots in a station that is posed but never simulated, and how the robots stand on the ground."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR
from simrob_drake.robots.outlines import lowest_points, shape_corners, shape_outline
from simrob_drake.stations.collisions import START_TOLERANCE, CollisionPolicy, Overlap
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.posed import PosedStation
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
    """Find the points of each collision shape of a robot that are lowest with respect to the floor.

    Returns one entry for each shape: the body, and points (k, 3) in the world [m].
    """
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
    """Outermost points of all collision shapes of a body, in the frame of the body, shape (k, 3) [m]."""
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


TURNS, SLIDES = (15.0, -15.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0), (0.1, 0.2, 0.4)
"""By how much an axis is moved to see whether another posture is better [deg, m]."""

_STEPS = 10  # axes that are turned to take links apart


class Clearance(PosedStation):
    """A posed station with collision shapes: which bodies collide, and how high they are.

    Attributes:
        config: the station.
        policy: decides which bodies collide.
    """

    def __init__(self, config: StationConfig, *, trusts_home: bool = True) -> None:
        """Build the station in its initial configuration.

        Args:
            config: the station.
            trusts_home: leave out links that touch in the home posture, see
                :class:`CollisionPolicy`.

        Raises:
            InvalidModel: a robot cannot be built.
        """
        self.config = config
        contact = config.contact or ContactConfig()
        contact = contact.model_copy(update={"self_collision": True})
        super().__init__(config.model_copy(update={"contact": contact}))
        self.policy = CollisionPolicy(self, trusts_home=trusts_home)
        # Depth [m] of each pair of different owners that touches slightly at the start. A
        # piece that stands on a table always overlaps it a little, which is no collision.
        overlaps_at_start = self.policy.touching(refined_from=START_TOLERANCE)
        self._depths_at_start = {
            bodies: overlap.depth
            for bodies, overlap in overlaps_at_start.items()
            if overlap.is_between_owners and overlap.depth <= START_TOLERANCE
        }

    def lowest(self, robot: StationRobot) -> dict[str, float]:
        """Height of each body of a robot above the ground beneath the body [m], by the body's name.

        Bodies without collision shapes are left out.
        """
        found: dict[str, float] = {}
        for body, points in shape_points(self.station, robot, self.context):
            height = float((points[:, 2] - self.station.ground.beneath(points)).min())
            found[body.name()] = min(height, found.get(body.name(), height))
        return found

    def chains(self, robot: StationRobot) -> list[tuple[RigidBody, list[int]]]:
        """Bodies of a robot, each with the indices of the axes that move the body, from the root outward."""
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
        """Find the collisions in the present posture, except those with the floor; the deepest first.

        Bodies of different owners that already touch at the start, by at most
        START_TOLERANCE, may overlap by that depth plus the usual tolerance.
        """
        collisions = self.policy.overlaps(depths_at_start=self._depths_at_start)
        return [overlap for overlap in collisions if FLOOR not in overlap.bodies]


def turned(robot: StationRobot, posture: Vector, axes: Iterable[int]) -> Iterator[Vector]:
    """Yield postures (n,) that differ from a posture in one of the given axes and keep to the limits [rad or m]."""
    lower, upper = robot.model.axis_limits
    for axis in axes:
        for way in SLIDES if robot.model.prismatic[axis] else np.deg2rad(TURNS):
            tried = posture.copy()
            tried[axis] += way
            if lower[axis] <= tried[axis] <= upper[axis]:
                yield tried


def untangled(clearance: Clearance, robot: StationRobot, posture: Vector, axes: Collection[int]) -> Vector:
    """Reduce the overlaps between the links of a robot, by turning one axis at a time.

    Each step turns the axis that reduces the overlaps most. Only the axes between the two
    links that overlap most are tried. Returns a posture (n,) [rad or m].
    """
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
