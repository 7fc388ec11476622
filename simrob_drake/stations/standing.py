"""How a robot with a free base stands at the start, without stepping: support, margin and the torques it takes."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import Context

from simrob_drake.blocks.distance_sensor import lowest_points, shape_corners
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot

_TOUCHING = 1e-3  # what lies less above the lowest point carries, too: contacts and servos give way by as much [m]
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
        torque: what the joints hold against gravity, shape (n,) [N·m].
    """

    mass: float
    gap: float
    contacts: int
    margin: float
    torque: Vector


def standing(station: StationPlant, robot: StationRobot) -> Standing | None:
    """Return how a robot stands in its initial posture, without feet on its collision shapes; None without either."""
    plant = station.plant
    context = plant.CreateDefaultContext()
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
    return Standing(mass, gap, len(points), _margin(points[:, :2], com[:2]), torque)


def _support_points(station: StationPlant, robot: StationRobot, context: Context) -> list[tuple[Frame, Vector]]:
    """Return the points that a robot may stand on in a state, by the frames of its bodies: in the world, (k, 3) [m]."""
    plant, tilt = station.plant, station.ground.tilt
    from_floor = tilt.inverse()

    def seen(points: Vector) -> Vector:
        return np.asarray((tilt @ points.T).T)

    if robot.feet is not None:
        frames = {link: plant.GetFrameByName(link, robot.instance) for link in robot.feet.links}
        poses = {link: from_floor @ frame.CalcPoseInWorld(context) for link, frame in frames.items()}
        lowest = {
            link: robot.feet.lowest_points(link, pose.GetAsMatrix4()[np.newaxis])[0] for link, pose in poses.items()
        }
        return [(frames[link], seen(points)) for link, points in lowest.items()]
    inspector = station.scene_graph.model_inspector()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
    shapes = [(body, shape) for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    placed = [from_floor @ plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(s) for body, s in shapes]
    return [
        (body.body_frame(), seen(lowest_points(inspector.GetShape(shape), pose, shape_corners(inspector, shape))))
        for (body, shape), pose in zip(shapes, placed, strict=True)
    ]


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
