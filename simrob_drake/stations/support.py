"""The points on which a robot may stand: those of its feet, else of its collision shapes."""

from __future__ import annotations

import numpy as np
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from simrob_drake.blocks.distance_sensor import lowest_points, shape_corners
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot


def support_points(station: StationPlant, robot: StationRobot, context: Context) -> list[tuple[Frame, Vector]]:
    """Return the points that a robot may stand on in a state, by the frames of its bodies: in the world, (k, 3) [m].

    Args:
        station: with the robot.
        robot: with feet or without.
        context: of the plant.
    """
    plant = station.plant
    if robot.feet is not None:
        frames = {link: plant.GetFrameByName(link, robot.instance) for link in robot.feet.links}
        standing = {link: frame.CalcPoseInWorld(context).GetAsMatrix4()[np.newaxis] for link, frame in frames.items()}
        return [(frames[link], robot.feet.lowest_points(link, pose)[0]) for link, pose in standing.items()]
    inspector = station.scene_graph.model_inspector()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot.instance)]
    shapes = [(body, shape) for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    poses = [plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(shape) for body, shape in shapes]
    return [
        (body.body_frame(), lowest_points(inspector.GetShape(shape), pose, shape_corners(inspector, shape)))
        for (body, shape), pose in zip(shapes, poses, strict=True)
    ]
