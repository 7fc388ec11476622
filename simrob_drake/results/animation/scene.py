"""The visible world of a station, which is put into any configuration, on a floor with lines.

The lines show how far a robot walks from picture to picture. They are parallel to the edges of a square floor, which
may be tilted. A *configuration* is the positions of the whole plant, shape (nq,).
"""

from typing import Any, NamedTuple

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
from simrob_drake.results.animation.camera import Displacement, framed_time
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun, begins_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.posed import PosedStation

RENDERER = "renderer"
"""Name of the render engine in the scene graph."""

SPACING = 0.1
"""Distance of neighbouring lines on the floor [m]."""

LINES = "/drake/station/lines"
"""Path of the lines in Meshcat's tree. They are under the station, so that they disappear with it."""

_COLOUR = Rgba(0.66, 0.69, 0.73, 1.0)
_DARK = Rgba(0.36, 0.40, 0.46, 1.0)
"""Colours of usual lines and of bold ones."""

_BOLD = 5
"""One line in this many is dark and wide, so that a line is recognised in the next picture."""

_AROUND = 1.5
"""Distance up to which there are lines around a path [m]."""

_WIDTH = 0.004
"""Width of a line in images [m]."""

_TOP = 0.0005
"""Height of a line over the floor [m], so that the floor does not hide it."""

_REACH = 5.0
"""Distance up to which a page has lines around the origin of the world [m]."""

_CONFIGURATION_COUNT = 24
"""Count of configurations, at even times, that represent a motion."""

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""Corners of a cube with half edges of length 1, shape (8, 3)."""


class ViewedStation(PosedStation):
    """A station's robots, pieces and floor, without dynamics and contact.

    It is built from the configuration of the station, so that a picture never changes a simulation.

    Attributes of :class:`PosedStation`, and:
        visualizer: the system that draws into Meshcat; None without Meshcat.
    """

    def __init__(
        self,
        config: StationConfig,
        *,
        meshcat: Meshcat | None = None,
        engine: RenderEngine | None = None,
        path: Vector | None = None,
    ) -> None:
        """Build the scene with all robots in their initial positions.

        Args:
            config: the station.
            meshcat: Meshcat into which the scene is drawn, if any.
            engine: engine that renders images of the scene, if any.
            path: positions that a robot passes, shape (k, 3) [m]. Images have a grid of lines on the floor around them.

        Raises:
            SimrobError: the station cannot be built, such as a robot without its files.
        """
        self.visualizer: MeshcatVisualizer | None = None

        def add(builder: DiagramBuilder, station: StationPlant) -> None:
            """Add what draws the station to its diagram, before the diagram is built."""
            if engine is not None:
                station.scene_graph.AddRenderer(RENDERER, engine)
            if path is not None and config.floor is not None:
                add_floor_grid(
                    station.scene_graph,
                    path,
                    size=config.floor.size,
                    tilt=station.ground.floor_pose,
                )
            if meshcat is not None:
                params = MeshcatVisualizerParams(prefix="station", enable_alpha_slider=False)
                self.visualizer = MeshcatVisualizer.AddToBuilder(
                    builder, station.scene_graph, meshcat, params
                )

        # Without contact the plant needs no collision shapes, which it would have to load.
        super().__init__(config.model_copy(update={"contact": None}), add)

    def draw(self, positions: Vector, time: float = 0.0) -> None:
        """Draw a configuration, shape (nq,), into Meshcat. While Meshcat records, it is the frame of a time [s]."""
        self.place(positions)
        self._root_context.SetTime(time)
        self._diagram.ForcedPublish(self._root_context)

    def extents(self, positions: Vector) -> Vector:
        """Points around all links and pieces in several configurations, without the world's own shapes as the floor.

        Args:
            positions: the configurations, shape (k, nq).

        Returns:
            the points in the world, shape (m, 3) [m].
        """
        return self._corners(positions, None).reshape(-1, 3)

    def extents_of_run(
        self, result: RecordedRun, displacement: Displacement | None = None
    ) -> Vector:
        """Points around the motion of a run, at 24 even times and where its parts follow each other.

        Of a run that diverged, the last tenth is left out.

        Args:
            result: the run.
            displacement: displacement of a camera that follows the only robot. Then the points are those of this
                robot, relative to the camera's start.

        Returns:
            the points, shape (m, 3) [m].
        """
        even_times = np.linspace(result.start_time, framed_time(result), _CONFIGURATION_COUNT)
        # The moves of a program end where the robot rests, often at the greatest distance.
        times = np.union1d(even_times, begins_of(*result.parts)[1:-1])
        positions = positions_in(self.station, result, times)
        if displacement is None:
            return self.extents(positions)
        (robot,) = self.station.robots.values()
        # Pieces stay where they are while the camera moves, so that only the robot has to be in the picture.
        corners = self._corners(positions, robot.instance)
        return (corners - displacement(times)[:, np.newaxis]).reshape(-1, 3)

    def _corners(self, positions: Vector, instance: ModelInstanceIndex | None) -> Vector:
        """Origins of links and pieces, and corners of the boxes around their visible shapes, in several configurations.

        The world's own shapes, such as the floor, are left out.

        Args:
            positions: the configurations, shape (k, nq).
            instance: model instance of the bodies; None for the bodies of all instances.

        Returns:
            the points in the world, shape (k, m, 3) [m].
        """
        inspector = self.station.scene_graph.model_inspector()
        links = []
        for frame in inspector.GetAllFrameIds():
            body = self.plant.GetBodyFromFrameId(frame)
            if body is None or frame == inspector.world_frame_id():
                continue
            if instance is None or body.model_instance() == instance:
                links.append(frame)
        # Corners of the box around each visible shape, in the frame of the shape, shape (3, 8).
        corners_of_shapes = {}
        for shape in inspector.GetAllGeometryIds(Role.kIllustration):
            box = inspector.GetObbInGeometryFrame(shape)
            # Infinite shapes, such as a half space, have no box around them.
            if box is not None and inspector.GetFrameId(shape) in links:
                corners_of_shapes[shape] = box.pose() @ (_CORNERS * box.half_width()).T
        points: list[Vector] = []
        for row in positions:
            self.place(row)
            query = self.query()
            origins = np.array(
                [query.GetPoseInWorld(link).translation() for link in links]
            ).reshape(-1, 3)
            corners = [
                (query.GetPoseInWorld(shape) @ own).T for shape, own in corners_of_shapes.items()
            ]
            points.append(np.vstack([origins, *corners]))
        return np.array(points)


def with_floor_under(config: StationConfig, path: Vector) -> StationConfig:
    """Copy of a station whose floor, if it has one, is large enough for a path.

    Args:
        config: the station.
        path: positions of the path, shape (m, 3) [m].
    """
    if config.floor is None:
        return config
    size = max(config.floor.size, 2 * (float(np.abs(path[:, :2]).max()) + _AROUND))
    return config.model_copy(update={"floor": config.floor.model_copy(update={"size": size})})


def floor_lines(around: Vector, *, size: float) -> Vector:
    """Compute lines on a floor, in both directions, at whole multiples of their spacing.

    The lines reach 1.5 m beyond the positions on all sides, but not beyond the floor.

    Args:
        around: positions around which there are lines, in the frame of the floor, shape (m, 3) [m].
        size: length of an edge of the floor [m].

    Returns:
        both ends of each line in the frame of the floor, shape (n, 2, 3) [m].
    """
    low = np.maximum(around.min(axis=0) - _AROUND, -size / 2)
    high = np.minimum(around.max(axis=0) + _AROUND, size / 2)
    lines = []
    # Lines along x first, which have a whole multiple as their y; then lines along y.
    for along, across in ((0, 1), (1, 0)):
        first = int(np.ceil(low[across] / SPACING))
        last = int(np.floor(high[across] / SPACING))
        for number in range(first, last + 1):
            line = np.full((2, 3), (0.0, 0.0, _TOP))
            line[:, along] = (low[along], high[along])
            line[:, across] = number * SPACING
            lines.append(line)
    return np.array(lines)


def add_floor_grid(
    scene_graph: SceneGraph, path: Vector, *, size: float, tilt: RigidTransform
) -> None:
    """Add lines on a square floor to a scene graph, for rendered images. Each fifth line is bold.

    Args:
        scene_graph: the scene graph.
        path: positions around which there are lines, in the world, shape (m, 3) [m].
        size: length of an edge of the floor [m].
        tilt: pose of the floor in the world.
    """
    source = scene_graph.RegisterSource("floor_grid")
    # In the frame of the floor. Drake's poses take points as columns.
    path_on_floor = (tilt.inverse() @ path.T).T
    for number, (begin, end) in enumerate(floor_lines(path_on_floor, size=size)):
        # The line is where one coordinate is the same at both of its ends.
        across = 0 if begin[0] == end[0] else 1
        # Counted from the origin of the floor, so that bold lines stay in place whatever part of the floor has
        # lines.
        is_bold = round(begin[across] / SPACING) % _BOLD == 0
        width = _WIDTH * (2 if is_bold else 1)
        # Render engines have no lines: each is a flat box, whose top is over the floor. A line has a length in one
        # direction; in the others its box gets the width and the height.
        shape = Box(*np.maximum(end - begin, (width, width, 2 * _TOP)))
        middle = (begin + end) / 2 - (0.0, 0.0, _TOP)
        line = GeometryInstance(tilt @ RigidTransform(middle), shape, f"line_{number}")
        looks = PerceptionProperties()
        looks.AddProperty("phong", "diffuse", _DARK if is_bold else _COLOUR)
        line.set_perception_properties(looks)
        scene_graph.RegisterAnchoredGeometry(source, line)


class _PagePose(NamedTuple):
    """Path of an object in Meshcat's tree, and its pose in the world."""

    path: str
    pose: RigidTransform


def floor_under(scene: ViewedStation, place: Vector) -> list[dict[str, Any]]:
    """Commands to Meshcat's page that move the floor and its lines below a robot.

    They move by whole distances of bold lines, so that the lines seem to stay where they are.

    Args:
        scene: the scene that the page shows.
        place: position of the robot in the world, shape (3,) [m].

    Returns:
        the commands. There are none if the station has no floor.
    """
    inspector = scene.query().inspector()
    shapes_of_world = inspector.GetGeometries(inspector.world_frame_id(), Role.kIllustration)
    slab = next((shape for shape in shapes_of_world if inspector.GetName(shape) == FLOOR), None)
    if slab is None:
        return []
    tilt = scene.station.ground.floor_pose
    place_on_floor = tilt.inverse() @ place
    mesh = SPACING * _BOLD  # distance of bold lines [m]
    steps = np.round(place_on_floor[:2] / mesh) * mesh  # in the frame of the floor, shape (2,) [m]
    shift = RigidTransform(tilt.rotation() @ np.array([*steps, 0.0]))
    moved = [
        _PagePose(LINES, shift),
        _PagePose(f"/drake/station/{FLOOR}", shift @ inspector.GetPoseInFrame(slab)),
    ]
    found = []
    for path, pose in moved:
        # Meshcat expects the matrix column by column. Seven decimals are exact to less than a micrometre. For the
        # page's script, "still" excludes the object from the moving bodies.
        matrix = np.round(pose.GetAsMatrix4(), 7).ravel(order="F").tolist()
        found.append({"type": "set_transform", "path": path, "matrix": matrix, "still": True})
    return found


def draw_floor_lines(meshcat: Meshcat, scene: ViewedStation, *, size: float) -> None:
    """Draw lines on the floor of a scene into Meshcat, around the floor's origin.

    Args:
        meshcat: the Meshcat.
        scene: the scene.
        size: length of an edge of the floor [m].
    """
    around_origin = np.array([[-_REACH, -_REACH, 0.0], [_REACH, _REACH, 0.0]])
    above_floor = RigidTransform([0.0, 0.0, _WIDTH / 2])
    pose = scene.station.ground.floor_pose @ above_floor
    lines = floor_lines(around_origin, size=size)
    begins = pose @ lines[:, 0].T
    ends = pose @ lines[:, 1].T
    meshcat.SetLineSegments(LINES, begins, ends, 1.0, _COLOUR)
