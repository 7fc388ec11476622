"""The points on which a robot may stand: those of its feet, else of its collision shapes."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Capsule, Cylinder, Ellipsoid, GeometryId, SceneGraphInspector, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from simrob_drake.blocks.distance_sensor import shape_corners
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot

_RIM = 16  # points that stand for the rim of a cylinder


def support_points(station: StationPlant, robot: StationRobot, context: Context) -> list[tuple[Frame, Vector]]:
    """Return the points that a robot may stand on in a state, by the frames of its bodies: in the world, (k, 3) [m].

    Args:
        station: with the robot.
        robot: with feet or without.
        context: of the plant.
    """
    plant = station.plant
    if robot.feet is not None:
        feet = [plant.GetFrameByName(link, robot.instance) for link in robot.feet.links]
        return [(foot, _of_foot(robot, foot, context)) for foot in feet]
    inspector = station.scene_graph.model_inspector()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
    shapes = [(body, shape) for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    poses = [plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(shape) for body, shape in shapes]
    return [
        (body.body_frame(), points_of_shape(inspector, shape, pose))
        for (body, shape), pose in zip(shapes, poses, strict=True)
    ]


def _of_foot(robot: StationRobot, foot: Frame, context: Context) -> Vector:
    feet, link, pose = robot.feet, foot.name(), foot.CalcPoseInWorld(context)
    assert feet is not None  # the caller found a foot
    if link in feet.boxes:
        return np.array([pose @ corner for corner in feet.support_points(link)])
    return np.array([pose @ np.array(centre) - (0.0, 0.0, feet.radius) for centre in feet.points[link]])


def points_of_shape(inspector: SceneGraphInspector, shape_id: GeometryId, pose: RigidTransform) -> Vector:
    """Return points of a convex shape of which some are its lowest, shape (k, 3) [m].

    Args:
        inspector: of the scene.
        shape_id: of the shape.
        pose: of the shape.
    """
    up = pose.rotation().matrix()[2]  # the world's z axis in the frame of the shape
    match shape := inspector.GetShape(shape_id):
        case Sphere():
            points = -shape.radius() * up[np.newaxis]
        case Ellipsoid():
            axes = np.array([shape.a(), shape.b(), shape.c()])
            points = -(axes**2 * up / np.linalg.norm(axes * up))[np.newaxis]
        case Capsule():
            ends = np.array([[0.0, 0.0, side * shape.length() / 2] for side in (-1, 1)])
            points = ends - shape.radius() * up
        case Cylinder():
            turns = np.arange(_RIM) * 2 * np.pi / _RIM
            rim = shape.radius() * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(_RIM)])
            middle = np.array([0.0, 0.0, shape.length() / 2])
            points = np.vstack([rim - middle, rim + middle])
        case _:
            points = shape_corners(inspector, shape_id)
    return np.asarray((pose @ points.T).T)
