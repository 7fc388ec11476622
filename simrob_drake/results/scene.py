"""The visible world of a station, put into any configuration, and where to look at it from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    QueryObject,
    RenderEngine,
    Role,
    SceneGraph,
)
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.frames import Vector
from simrob_drake.results.result import DIVERGED, SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import StationPlant, add_plant

FIELD_OF_VIEW = np.deg2rad(35.0)
"""Vertical opening of the cameras [rad]; narrow, so that links keep their proportions."""

RENDERER = "renderer"
"""The name of the render engine in the scene graph."""

_AZIMUTH = np.deg2rad(-50.0)  # of the eye: robots face x, so it stands to the right of their front
_ELEVATION = np.deg2rad(20.0)
_MARGIN = 1.12  # how much wider than what moves the picture is
_NEAREST = 0.1  # how near a camera goes [m]
_LOOKS = 24  # configurations that stand for a motion
_TRUSTED = 0.9  # the part of a diverging run that is framed: then the robot may fly off
_BOX_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


class Scene:
    """A station's robots, pieces and floor, without dynamics and contact.

    It is built anew from the configuration, so that showing it cannot touch a simulation.

    Attributes:
        station: its plant, with the robots.
        initial: the configuration at the start, shape (nq,).
        visualizer: what draws into Meshcat, where there is one.
    """

    def __init__(
        self, config: StationConfig, *, meshcat: Meshcat | None = None, engine: RenderEngine | None = None
    ) -> None:
        """Build the scene, with the robots in their initial positions.

        Args:
            config: the station.
            meshcat: to draw into.
            engine: to render images with.

        Raises:
            InvalidModel: a robot that cannot be built.
        """
        builder = DiagramBuilder()
        station = add_plant(builder, config.model_copy(update={"contact": None}))
        self.station: StationPlant = station
        self._plant = station.plant
        self._scene_graph = station.scene_graph
        if engine is not None:
            station.scene_graph.AddRenderer(RENDERER, engine)
        self._positions_port = station.add_geometry_poses(builder) if config.mode == "kinematic" else None
        self.visualizer = None if meshcat is None else _add_visualizer(builder, station.scene_graph, meshcat)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self.initial: Vector = station.plant.GetPositions(station.plant.CreateDefaultContext())
        self.place(self.initial)

    def place(self, positions: Vector) -> None:
        """Put the station into a configuration, shape (nq,)."""
        if self._positions_port is None:
            self._plant.SetPositions(self._plant.GetMyMutableContextFromRoot(self._context), positions)
        else:
            system = self._positions_port.get_system()
            self._positions_port.FixValue(system.GetMyMutableContextFromRoot(self._context), positions)

    def draw(self, positions: Vector, time: float = 0.0) -> None:
        """Show a configuration, shape (nq,), in Meshcat; a recording files it under ``time`` [s]."""
        self.place(positions)
        self._context.SetTime(time)
        self._diagram.ForcedPublish(self._context)

    def query(self) -> QueryObject:
        """Return the geometry in its present configuration, for rendering."""
        port = self._scene_graph.get_query_output_port()
        query: QueryObject = port.Eval(self._scene_graph.GetMyContextFromRoot(self._context))
        return query

    def extents(self, positions: Vector) -> Vector:
        """Return points, shape (m, 3) [m], around all that stands or moves in the configurations, shape (k, nq).

        They are the origins of the links and the corners of their shapes' boxes; the floor is left out.
        """
        inspector = self._scene_graph.model_inspector()
        world = inspector.world_frame_id()
        links = [frame for frame in inspector.GetAllFrameIds() if frame != world]
        boxes = {}
        for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
            box = inspector.GetObbInGeometryFrame(geometry)
            if box is not None and inspector.GetFrameId(geometry) != world:
                boxes[geometry] = box.pose() @ (_BOX_SIGNS * box.half_width()).T
        points: list[Vector] = []
        for row in positions:
            self.place(row)
            query = self.query()
            points += [query.GetPoseInWorld(link).translation() for link in links]
            points += [(query.GetPoseInWorld(geometry) @ corners).T for geometry, corners in boxes.items()]
        return np.vstack(points)

    def extents_of_run(self, result: SimulationResult) -> Vector:
        """Return points, shape (m, 3) [m], around the motion of a run."""
        end = result.stop_time * (_TRUSTED if result.stopped_by == DIVERGED else 1.0)
        return self.extents(result.positions_at(np.linspace(0.0, end, _LOOKS)))


@dataclass(frozen=True)
class View:
    """A camera: where its eye is and where it looks, shape (3,) [m] each; z is up in the picture."""

    eye: Vector
    target: Vector


def view_of(points: Vector, *, aspect: float) -> View:
    """Return the nearest camera that has all points in its picture.

    Args:
        points: what is to be seen, shape (m, 3) [m].
        aspect: width of the picture over its height.
    """
    axes = _camera_axes()
    across, along = (points @ axes.T)[:, :2], points @ axes[2]
    half = np.tan(FIELD_OF_VIEW / 2) / _MARGIN * np.array([aspect, 1.0])
    # An edge of the picture is a plane through the eye; these are the planes that just touch the points.
    low = (across + half * along[:, np.newaxis]).min(axis=0)
    high = (across - half * along[:, np.newaxis]).max(axis=0)
    depth = min(((low - high) / (2 * half)).min(), along.min() - _NEAREST)
    eye = np.append((low + high) / 2, depth)
    target = np.append(eye[:2], (along.min() + along.max()) / 2)
    return View(eye @ axes, target @ axes)


def aspect_of(points: Vector) -> float:
    """Return the width over the height of points as a camera sees them."""
    width, height = np.ptp((points @ _camera_axes().T)[:, :2], axis=0)
    return float(width / height)


def frame_times(end: float, frames_per_second: float) -> Vector:
    """Return the times [s] of the frames of a motion; its end is the last one, wherever it lies."""
    count = max(int(np.ceil(end * frames_per_second - 1e-9)), 0)
    return np.append(np.arange(count) / frames_per_second, end)


def _camera_axes() -> Vector:
    """Return right, up and forward of the cameras as rows, shape (3, 3)."""
    level, rise = np.cos(_ELEVATION), np.sin(_ELEVATION)
    forward = -np.array([level * np.cos(_AZIMUTH), level * np.sin(_AZIMUTH), rise])
    right = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    return np.array([right, np.cross(right, forward), forward])


def _add_visualizer(builder: DiagramBuilder, scene_graph: SceneGraph, meshcat: Meshcat) -> MeshcatVisualizer:
    params = MeshcatVisualizerParams(prefix="station", enable_alpha_slider=False)
    return MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
