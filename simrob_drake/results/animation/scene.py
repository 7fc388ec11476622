"""The visible world of a station, put into any configuration, on a floor with lines by which a way can be told."""

from typing import Any

import numpy as np
from pydrake.geometry import (
    Box,
    GeometryInstance,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    PerceptionProperties,
    RenderEngine,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import FLOOR
from simrob_drake.results.animation.camera import Way, framed_time
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun, begins_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.posed import PosedStation

RENDERER = "renderer"  # the name of the render engine in the scene graph
SPACING = 0.1  # from one line to the next [m]

_COLOUR, _DARK = Rgba(0.66, 0.69, 0.73, 1.0), Rgba(0.36, 0.40, 0.46, 1.0)
_BOLD = 5  # every so many lines one is darker and wider: by it a way is told from picture to picture
_AROUND = 1.5  # m of lines about the way
_WIDTH, _TOP = 0.004, 0.0005  # m

_SEEN = 5.0  # m
LINES = "/drake/station/lines"  # where they hang in Meshcat's tree: they go with the station
_LOOKS = 24  # configurations that stand for a motion
_BOX_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


class ViewedStation(PosedStation):
    """A station's robots, pieces and floor, without dynamics and contact.

    It is built anew from the configuration, so that showing it cannot touch a simulation.

    Attributes of :class:`PosedStation`, and:
        visualizer: what draws into Meshcat, where there is one.
    """

    def __init__(
        self,
        config: StationConfig,
        *,
        meshcat: Meshcat | None = None,
        engine: RenderEngine | None = None,
        way: Vector | None = None,
    ) -> None:
        """Build the scene to draw into Meshcat, or to render with an engine, with robots in initial positions.

        Images have lines on the floor along a ``way`` (k, 3) [m]. Raises InvalidModel: a robot that cannot be built.
        """
        self.visualizer: MeshcatVisualizer | None = None

        def add(builder: DiagramBuilder, station: StationPlant) -> None:
            if engine is not None:
                station.scene_graph.AddRenderer(RENDERER, engine)
            if way is not None and config.floor is not None:
                add_floor_grid(station.scene_graph, way, size=config.floor.size, tilt=station.ground.floor_pose)
            if meshcat is not None:
                params = MeshcatVisualizerParams(prefix="station", enable_alpha_slider=False)
                self.visualizer = MeshcatVisualizer.AddToBuilder(builder, station.scene_graph, meshcat, params)

        super().__init__(config.model_copy(update={"contact": None}), add)

    def draw(self, positions: Vector, time: float = 0.0) -> None:
        """Show a configuration, shape (nq,), in Meshcat; a recording files it under ``time`` [s]."""
        self.place(positions)
        self._root_context.SetTime(time)
        self._diagram.ForcedPublish(self._root_context)

    def extents(self, positions: Vector) -> Vector:
        """Return points (m, 3) [m] around all links and shapes in configurations (k, nq), without the floor."""
        return self._corners(positions, None).reshape(-1, 3)

    def extents_of_run(self, result: RecordedRun, way: Way | None = None) -> Vector:
        """Return points, shape (m, 3) [m], around the motion of a run; of its robot alone if a way is taken from it."""
        even = np.linspace(result.start_time, framed_time(result), _LOOKS)
        times = np.union1d(even, begins_of(*result.parts)[1:-1])  # where moves rest they reach furthest
        positions = positions_in(self.station, result, times)
        if way is None:
            return self.extents(positions)
        (robot,) = self.station.robots.values()
        return (self._corners(positions, robot.instance) - way(times)[:, np.newaxis]).reshape(-1, 3)

    def _corners(self, positions: Vector, instance: ModelInstanceIndex | None) -> Vector:
        """Return the origins of links and the corners of their shapes, shape (k, m, 3) [m]; of one robot or of all."""
        inspector = self.station.scene_graph.model_inspector()
        links = []
        for frame in inspector.GetAllFrameIds():
            body = self.plant.GetBodyFromFrameId(frame)
            if body is not None and frame != inspector.world_frame_id() and instance in (None, body.model_instance()):
                links.append(frame)
        boxes = {}
        for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
            box = inspector.GetObbInGeometryFrame(geometry)
            if box is not None and inspector.GetFrameId(geometry) in links:
                boxes[geometry] = box.pose() @ (_BOX_SIGNS * box.half_width()).T
        points: list[Vector] = []
        for row in positions:
            self.place(row)
            query = self.query()
            origins = np.array([query.GetPoseInWorld(link).translation() for link in links]).reshape(-1, 3)
            points.append(np.vstack([origins, *((query.GetPoseInWorld(g) @ c).T for g, c in boxes.items())]))
        return np.array(points)


def with_floor_under(config: StationConfig, way: Vector) -> StationConfig:
    """Return a station whose floor, if it has one, reaches beyond a way (m, 3) [m] over it."""
    if config.floor is None:
        return config
    size = max(config.floor.size, 2 * (float(np.abs(way[:, :2]).max()) + _AROUND))
    return config.model_copy(update={"floor": config.floor.model_copy(update={"size": size})})


def floor_lines(around: Vector, *, size: float) -> Vector:
    """Return ends of lines of whole tenths of a metre around places (m, 3) on a square floor, shape (n, 2, 3) [m]."""
    low = np.maximum(around.min(axis=0) - _AROUND, -size / 2)
    high = np.minimum(around.max(axis=0) + _AROUND, size / 2)
    lines = []
    for along, across in ((0, 1), (1, 0)):
        for number in range(int(np.ceil(low[across] / SPACING)), int(np.floor(high[across] / SPACING)) + 1):
            line = np.full((2, 3), (0.0, 0.0, _TOP))
            line[:, along], line[:, across] = (low[along], high[along]), number * SPACING
            lines.append(line)
    return np.array(lines)


def add_floor_grid(scene_graph: SceneGraph, way: Vector, *, size: float, tilt: RigidTransform) -> None:
    """Draw lines on a square floor, posed by ``tilt``, about a way (m, 3) [m], a bold one every 0.5 m, for images."""
    source = scene_graph.RegisterSource("floor_grid")
    for number, (begin, end) in enumerate(floor_lines((tilt.inverse() @ way.T).T, size=size)):
        across = 0 if begin[0] == end[0] else 1
        bold = round(begin[across] / SPACING) % _BOLD == 0
        shape = Box(*np.maximum(end - begin, (*[_WIDTH * (1 + bold)] * 2, 2 * _TOP)))
        line = GeometryInstance(tilt @ RigidTransform((begin + end) / 2 - (0.0, 0.0, _TOP)), shape, f"line_{number}")
        looks = PerceptionProperties()
        looks.AddProperty("phong", "diffuse", _DARK if bold else _COLOUR)
        line.set_perception_properties(looks)
        scene_graph.RegisterAnchoredGeometry(source, line)


def floor_under(scene: ViewedStation, place: Vector) -> list[dict[str, Any]]:
    """Return what brings a floor and lines below a place [m] in the page, by whole meshes, so that they stay."""
    tilt, mesh = scene.station.ground.floor_pose, SPACING * _BOLD
    inspector = scene.query().inspector()
    drawn = inspector.GetGeometries(inspector.world_frame_id(), Role.kIllustration)
    if (slab := next((one for one in drawn if inspector.GetName(one) == FLOOR), None)) is None:
        return []
    local = tilt.inverse() @ place
    shift = RigidTransform(tilt.rotation() @ np.array([*np.round(local[:2] / mesh) * mesh, 0.0]))
    poses = {LINES: shift, f"/drake/station/{FLOOR}": shift @ inspector.GetPoseInFrame(slab)}
    matrices = {path: np.round(pose.GetAsMatrix4(), 7).ravel(order="F").tolist() for path, pose in poses.items()}
    return [{"type": "set_transform", "path": path, "matrix": own, "still": True} for path, own in matrices.items()]


def draw_floor_lines(meshcat: Meshcat, scene: ViewedStation, *, size: float) -> None:
    """Draw lines on the floor of a scene, of a size [m], about the world's origin, by which a way can be told."""
    far = np.array([[-_SEEN, -_SEEN, 0.0], [_SEEN, _SEEN, 0.0]])
    tilt = scene.station.ground.floor_pose @ RigidTransform([0.0, 0.0, _WIDTH / 2])
    lines = floor_lines(far, size=size)
    meshcat.SetLineSegments(LINES, tilt @ lines[:, 0].T, tilt @ lines[:, 1].T, 1.0, _COLOUR)
