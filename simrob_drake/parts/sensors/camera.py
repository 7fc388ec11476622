r"""A camera: colours, depth, and of which body each pixel is, rendered by VTK without a display.

The camera looks along its z axis, with x to the right and y down in the image. A pixel (u, v) of depth z is

.. math:: p = z\,\Bigl(\frac{u - c_u}{f}, \frac{v - c_v}{f}, 1\Bigr), \qquad f = \frac{h}{2 \tan(\alpha / 2)},

in its axes, for an image of height h [pixels] that opens by :math:`\alpha`, with its centre at
:math:`c = ((w - 1) / 2, (h - 1) / 2)`. Noise of the depth grows with the square of the distance, as that of cameras
which triangulate does (K. Khoshelham and S. Oude Elberink, Sensors 12, 2012, eq. 11).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    FramePoseVector,
    LightParameter,
    MakeRenderEngineVtk,
    QueryObject,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.base.sections import ORIGIN, Boolean, Integer, NotNegative, Pose, Positive
from simrob_drake.blocks.block import Block, add_and_connect
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.sensors.sensor import Sensor, sensor_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import frame_of, owner_of_shape

_RENDERER = "cameras"
_SHARPER = 0.1  # of the nearest depth: where VTK begins to draw
_LIGHTS = [  # a room's, and one at the camera, which shows what the other leaves dark
    LightParameter(type="directional", frame="world", direction=[0.3, 0.2, -1.0], intensity=0.6),
    LightParameter(type="directional", frame="camera", direction=[0.0, 0.0, 1.0], intensity=0.6),
]
_TICK = 1e-6  # s, to which the noise knows the time


@dataclass(frozen=True)
class Image:
    """What a camera sees at a moment.

    Attributes:
        time: of the run [s].
        color: shape (h, w, 3), 0 to 255.
        depth: along the camera's z axis, shape (h, w) [m]; 0 where something is too near, infinite where nothing is.
        labels: of which body of the plant each pixel is, by its index, shape (h, w); above 32 000 of none.
        pose: of the camera in the world.
        focal: length [pixels].
    """

    time: float
    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    labels: npt.NDArray[np.int16]
    pose: RigidTransform
    focal: float

    @property
    def seen(self) -> npt.NDArray[np.bool_]:
        """Where there is a depth, shape (h, w)."""
        return (self.depth > 0) & np.isfinite(self.depth)

    def points(self, where: npt.NDArray[np.bool_] | None = None) -> Vector:
        """Return the points in the world of pixels that have a depth, shape (m, 3) [m]; of those in a mask (h, w)."""
        rows, columns = np.nonzero(self.seen if where is None else self.seen & where)
        depth = self.depth[rows, columns].astype(float)
        middle = (np.array(self.depth.shape) - 1) / 2
        right, down = (columns - middle[1]) / self.focal, (rows - middle[0]) / self.focal
        return np.asarray((self.pose @ (depth * np.array([right, down, np.ones_like(right)]))).T)


@dataclass(frozen=True)
class Lens:
    """How a camera sees."""

    # of its images [pixels]
    width: int
    height: int
    opening: float  # of the height [rad]
    # between which it tells depth [m]
    near: float
    far: float
    noise: float = 0.0  # standard deviation of the depth of something 1 m away [m]
    seed: int = 0  # of that

    @property
    def focal(self) -> float:
        """Its length [pixels]."""
        return float(self.height / (2 * np.tan(self.opening / 2)))

    @cached_property
    def _cameras(self) -> tuple[ColorRenderCamera, DepthRenderCamera]:
        # VTK's coordinates begin at a corner of the first pixel, not in its middle
        info = CameraInfo(self.width, self.height, self.focal, self.focal, self.width / 2, self.height / 2)
        core = RenderCameraCore(_RENDERER, info, ClippingRange(_SHARPER * self.near, 2 * self.far), RigidTransform())
        return ColorRenderCamera(core), DepthRenderCamera(core, DepthRange(self.near, self.far))

    def image(self, query: QueryObject, parent: FrameId, pose: RigidTransform, time: float) -> Image:
        """Return what is seen from a pose in a frame of the geometry; a time [s] has its own noise."""
        seen, measured = self._cameras
        color = query.RenderColorImage(seen, parent, pose).data[:, :, :3].copy()
        depth = query.RenderDepthImage(measured, parent, pose).data[:, :, 0].copy()
        labels = query.RenderLabelImage(seen, parent, pose).data[:, :, 0].copy()
        if self.noise > 0:
            drawn = np.random.default_rng([self.seed, round(time / _TICK)]).standard_normal(depth.shape)
            near = np.where(np.isfinite(depth), depth, 0.0)
            depth = (depth + self.noise * near**2 * drawn).astype(np.float32)
        return Image(time, color, depth, labels, query.GetPoseInWorld(parent) @ pose, self.focal)


def let_render(scene_graph: SceneGraph) -> None:
    """Have a scene graph render what cameras see; once is enough."""
    if not scene_graph.HasRenderer(_RENDERER):
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams(lights=_LIGHTS)))


class CameraBlock(Block):
    """A camera that a loop may look through: it takes an image when it is asked for one.

    Ports:
        in  ``query``: of the scene graph.
        out ``image``: an :class:`Image`.
    """

    def __init__(self, lens: Lens, *, parent: FrameId, pose: RigidTransform) -> None:
        """Make the block for a camera at a pose in a frame of the geometry."""
        super().__init__()
        self._lens, self._parent, self._pose = lens, parent, pose
        self._query = self.DeclareAbstractInputPort("query", Value[QueryObject]())
        self.DeclareAbstractOutputPort("image", Value[object], weakly(self._look))

    def _look(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._lens.image(self._query.Eval(context), self._parent, self._pose, context.get_time()))


Pixels = Annotated[Integer, Field(ge=8, le=4096, multiple_of=2)]

_INSIDE = 1e-3  # m: one on the face of a link is not inside of it


class CameraSensor(Sensor):
    """A camera; its images are taken after the run, and then cost it nothing."""

    takes_images: ClassVar[bool] = True

    kind: Literal["camera"]
    frame: str = WORLD
    """What it is fixed to: a link or a tool of a robot, a piece (its TCP), or `world`."""
    pose: Pose = ORIGIN
    """Pose in that, [x y z Rz Ry Rx]; it looks along its z axis, with x to the right and y down in the image."""
    rate: Positive = 10.0
    """Images a second of a result [Hz]."""
    width: Pixels = 320
    """Of an image [pixels]."""
    height: Pixels = 240
    """Of an image [pixels]."""
    opening_deg: Annotated[Positive, Field(lt=180)] = 45.0
    """How far the height of the image opens [deg]."""
    near: Positive = 0.05
    """Nearest depth that it tells [m]."""
    far: Positive = 5.0
    """Farthest depth that it tells [m]."""
    depth_noise: NotNegative = 0.0
    """Standard deviation of the depth of something 1 m away [m]; it grows with the square of the distance."""
    seed: Integer = Field(default=0, ge=0)
    """Of the noise."""
    in_loop: Boolean = False
    """Give blocks of the user's own an input `image.<sensor>`, an image when they ask for one."""

    @model_validator(mode="after")
    def _check_depths(self) -> Self:
        if self.far <= self.near:
            raise ValueError(
                message(
                    "parts.far_below_near",
                    "far is {far:g}; it must be more than near ({near:g})",
                    far=self.far,
                    near=self.near,
                )
            )
        return self

    @property
    def stepped(self) -> bool:
        """Whether blocks may look through it while the station is stepped."""
        return self.in_loop

    @property
    def lens(self) -> Lens:
        """How it sees."""
        opening = float(np.deg2rad(self.opening_deg))
        return Lens(self.width, self.height, opening, self.near, self.far, self.depth_noise, self.seed)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Let loops look through it if they may; it has no signals."""
        parent, pose = self.mount(site.plant)
        self._check_outside(name, site.plant, parent, pose)
        site.outputs.notes[name] = {"kind": self.kind, "frame": self.frame}
        if self.in_loop:
            let_render(site.plant.scene_graph)
            block = CameraBlock(self.lens, parent=parent, pose=pose)
            query = site.plant.scene_graph.get_query_output_port()
            site.outputs.images[f"image.{name}"] = add_and_connect(builder, f"sensor.{name}", block, query)
            site.picture.draw(f"sensor.{name}", "sensor", sensor_label(message("parts.block_camera", "Camera"), name))

    def mount(self, plant: StationPlant) -> tuple[FrameId, RigidTransform]:
        """Return the frame of the geometry that it moves with, and its pose in that."""
        frame = frame_of(plant, self.frame)
        parent = plant.plant.GetBodyFrameIdOrThrow(frame.body().index())
        return parent, frame.GetFixedPoseInBodyFrame() @ transform_from_pose(self.pose)

    def _check_outside(self, name: str, station: StationPlant, parent: FrameId, pose: RigidTransform) -> None:
        """Check that it is not inside of a shape at the start."""
        plant, scene_graph = station.plant, station.scene_graph
        state, context, poses = plant.CreateDefaultContext(), scene_graph.CreateDefaultContext(), FramePoseVector()
        for frame in scene_graph.model_inspector().FramesForSource(plant.get_source_id()):
            poses.set_value(frame, plant.EvalBodyPoseInWorld(state, plant.GetBodyFromFrameId(frame)))
        scene_graph.get_source_pose_port(plant.get_source_id()).FixValue(context, poses)
        query = scene_graph.get_query_output_port().Eval(context)
        eye = (query.GetPoseInWorld(parent) @ pose).translation()
        for found in query.ComputeSignedDistanceToPoint(eye, 0.0):
            if found.distance < -_INSIDE:
                where = message(
                    "parts.eye_inside_of", "at {eye} m, inside of ", eye=", ".join(f"{value:.3g}" for value in eye)
                )
                where += owner_of_shape(station, found.id_G)
                raise InvalidParameter(
                    f"sensors.{name}.pose", where, message("parts.outside_of_bodies", "outside of every body")
                )
