"""How a robot with a free base stands at the start, without stepping: support, margin and the torques it takes."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context

from simrob_drake.blocks.distance_sensor import lowest_points, shape_corners
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot

_TOUCHING = 1e-3  # what lies less above the lowest point carries, too: contacts and servos give way by as much [m]
_TURNS = [  # which bring each of 26 directions down
    RigidTransform(RotationMatrix.MakeFromOneVector(-np.array(way), 2).inverse(), np.zeros(3))
    for way in product((-1.0, 0.0, 1.0), repeat=3)
    if any(way)
]
KNEELING = 0.25
"""A link that carries nearer to its joint than this part of its length kneels: heels are at 0.3 and more."""

_EVEN = 1e-4  # weight of sharing the load evenly, where there are more contacts than equations


@dataclass(frozen=True)
class Standing:
    """A robot on the ground, at rest.

    Attributes:
        mass: of the robot with what it carries [kg].
        gap: height of the lowest point over the ground [m]; negative if it lies deeper.
        contacts: how many points carry.
        margin: distance of the centre of mass, seen from above, from the border of the support area [m]; negative
            outside of it, and zero where the points span no area.
        height: of the centre of mass over the lowest point [m].
        torque: what the joints hold against gravity, shape (n,) [N·m].
        ends: of each link that carries, by its name, how far from its joint it does, as part of its length: 1 at its
            farthest point, near 0 at a knee; 1 of the root, which hangs on no joint.
    """

    mass: float
    gap: float
    contacts: int
    margin: float
    height: float
    torque: Vector
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
    """Return points of a robot's collision shapes in a state, of each the lowest over the floor, with their bodies.

    They are in the world, shape (k, 3) [m].
    """
    plant, tilt = station.plant, station.ground.tilt
    inspector, from_floor = station.scene_graph.model_inspector(), tilt.inverse()
    found = []
    for body in map(plant.get_body, plant.GetBodyIndices(robot.instance)):
        for shape in plant.GetCollisionGeometriesForBody(body):
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
    inspector, found = station.scene_graph.model_inspector(), [np.zeros((0, 3))]
    for shape in station.plant.GetCollisionGeometriesForBody(body):
        pose, corners = inspector.GetPoseInFrame(shape), shape_corners(inspector, shape)
        if len(corners):
            found.append(np.asarray((pose @ corners.T).T))
            continue
        for turn in _TURNS:
            points = lowest_points(inspector.GetShape(shape), turn @ pose, corners)
            found.append(np.asarray((turn.inverse() @ points.T).T))
    return np.vstack(found)


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
