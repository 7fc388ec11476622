"""Images of a run's motion, rendered off-screen: no display and no browser is needed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from simrob_drake.frames import Vector
from simrob_drake.results.animation.camera import FIELD_OF_VIEW, View, aspect_of, side, view_of, walked_way
from simrob_drake.results.animation.scene import RENDERER, Scene
from simrob_drake.results.record.run import RecordedRun

Image = npt.NDArray[np.uint8]

_BACKGROUND = np.array([0.98, 0.98, 0.98])
_ASPECTS = 0.6, 1.6  # narrowest and widest picture
_SHADOW_MAP = 1024  # pixels a side


class Studio:
    """A station before a camera that has the whole motion of a run in its picture.

    It stands still, but for a robot that walks: beside that it goes, and lines on the floor show the way.

    Attributes:
        way: of the camera; None where it stands still.
    """

    def __init__(self, result: RecordedRun, *, height: int, width: int | None = None, oversampling: int = 1) -> None:
        """Set the camera up.

        Args:
            result: the run.
            height: of the images [pixels].
            width: of the images [pixels]; chosen to suit the motion unless given.
            oversampling: pixels a side that are rendered for one of the image: more make smoother edges.

        Raises:
            InvalidModel: a robot that cannot be built.
        """
        self._result = result
        self.way = walked_way(result)
        engine = MakeRenderEngineVtk(_engine_params())
        self._scene = Scene(result.config, engine=engine, way=None if self.way is None else self.way(result.times))
        azimuth = side(self._scene.station)
        points = self._scene.extents_of_run(result, self.way)
        width = width or round(height * np.clip(aspect_of(points, azimuth=azimuth), *_ASPECTS))
        self._view = view_of(points, aspect=width / height, azimuth=azimuth)
        self._shape = height, oversampling, width, oversampling, 3
        self._camera = _camera(
            width * oversampling, height * oversampling, float(np.linalg.norm(self._view.target - self._view.eye))
        )

    def images(self, times: Vector) -> Iterator[Image]:
        """Yield an image, shape (height, width, 3), for each time, shape (k,) [s]."""
        ways = np.zeros((len(times), 3)) if self.way is None else self.way(times)
        for positions, way in zip(self._result.positions_at(times), ways, strict=True):
            self._scene.place(positions)
            query, pose = self._scene.query(), _camera_pose(self._view.moved(way))
            rendered = query.RenderColorImage(self._camera, query.inspector().world_frame_id(), pose)
            colours = rendered.data[:, :, :3]
            yield (
                colours.reshape(self._shape).mean(axis=(1, 3)).astype(np.uint8)
                if self._shape[1] > 1
                else colours.copy()
            )


def _engine_params() -> RenderEngineVtkParams:
    """Return the light of a studio.

    Only the lamp straight above casts shadows: they show what is over what on the floor, and steep faces, where shadow
    maps are speckled, get nothing of its light. The lamps by the camera are points far away, which cast none.
    """
    lights = [
        LightParameter(type="directional", frame="world", direction=[0.0, 0.0, -1.0], intensity=0.4),
        LightParameter(type="point", frame="camera", position=[-10.0, -10.0, -30.0], intensity=0.95),
        LightParameter(type="point", frame="camera", position=[27.0, -3.0, -15.0], intensity=0.35),
    ]
    return RenderEngineVtkParams(
        default_clear_color=_BACKGROUND, lights=lights, cast_shadows=True, shadow_map_size=_SHADOW_MAP
    )


def _camera(width: int, height: int, distance: float) -> ColorRenderCamera:
    info = CameraInfo(width=width, height=height, fov_y=FIELD_OF_VIEW)
    return ColorRenderCamera(
        RenderCameraCore(RENDERER, info, ClippingRange(distance / 20, distance * 20), RigidTransform())
    )


def _camera_pose(view: View) -> RigidTransform:
    """Return the pose of a camera body: z forward, x right and y down in the picture."""
    forward = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), view.eye)
