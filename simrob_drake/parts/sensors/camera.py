r"""Camera: colour images, depth images and images of labels, rendered by VTK without a display.

A label is the index of the body of the plant that a pixel shows. The camera looks along its z axis, with x to the right
and y down in the image. The point of a pixel (u, v) of depth z is, in the camera's axes,

.. math:: p = z\,\Bigl(\frac{u - c_u}{f}, \frac{v - c_v}{f}, 1\Bigr), \qquad f = \frac{h}{2 \tan(\alpha / 2)},

for an image of width w and height h [pixels] with the opening angle :math:`\alpha` of its height and its centre at
:math:`c = ((w - 1) / 2, (h - 1) / 2)`. The noise of the depth grows with the square of the distance, as for cameras
that triangulate (K. Khoshelham and S. Oude Elberink, Sensors 12, 2012, eq. 11).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

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

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.base.sections import ORIGIN, Boolean, Integer, NotNegative, Pose, Positive
from simrob_drake.blocks.block import Block, add_and_connect
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.sensors.sensor import Sensor, sensor_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import frame_of, owner_of_shape

# Name of the renderer in the scene graph. All cameras of a station share it.
_RENDERER = "cameras"
# Distance at which VTK begins to draw, as a part of the nearest measured depth [1].
_NEAR_CLIPPING = 0.1
# Light of the room, and light from the camera for what the other leaves dark.
_LIGHTS = [
    LightParameter(type="directional", frame="world", direction=[0.3, 0.2, -1.0], intensity=0.6),
    LightParameter(type="directional", frame="camera", direction=[0.0, 0.0, 1.0], intensity=0.6),
]
# Resolution of the time from which the noise of an image is drawn [s].
_TIME_RESOLUTION = 1e-6


@dataclass(frozen=True)
class Image:
    """Images of a camera at one moment.

    Attributes:
        time: time of the run [s].
        color: shape (h, w, 3), 0 to 255.
        depth: depth along the camera's z axis, shape (h, w) [m]; 0 if something is too near, infinite if nothing is
            there.
        labels: index of the body of the plant, shape (h, w); above 32 000 for no body.
        pose: pose of the camera in the world.
        focal: focal length [pixels].
    """

    time: float
    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    labels: npt.NDArray[np.int16]
    pose: RigidTransform
    focal: float

    @property
    def has_depth(self) -> npt.NDArray[np.bool_]:
        """Whether each pixel has a measured depth, shape (h, w)."""
        return (self.depth > 0) & np.isfinite(self.depth)

    def points(self, where: npt.NDArray[np.bool_] | None = None) -> Vector:
        """Compute the points in the world of the pixels that have a depth.

        Args:
            where: pixels that are used, shape (h, w). If it is None, all are.

        Returns:
            The points, shape (m, 3) [m].
        """
        # A pixel without a depth, too near or with nothing behind it, has no point.
        is_used = self.has_depth
        if where is not None:
            is_used = is_used & where
        rows, columns = np.nonzero(is_used)
        depth = self.depth[rows, columns].astype(float)

        # p = z ((u - c_u) / f, (v - c_v) / f, 1), where u is the column and v the row of the pixel.
        # The middle of the first pixel is (0, 0), so the centre of the image is at half of the last indices.
        height, width = self.depth.shape
        centre_u = (width - 1) / 2
        centre_v = (height - 1) / 2
        right = (columns - centre_u) / self.focal
        down = (rows - centre_v) / self.focal
        ahead = np.ones_like(right)
        in_camera = depth * np.array([right, down, ahead])  # shape (3, m)

        in_world = self.pose @ in_camera
        return np.asarray(in_world.T)


keep_former_attributes(Image, seen="has_depth")


@dataclass(frozen=True)
class Lens:
    """Optics of a camera.

    Attributes:
        width: width of the images [pixels].
        height: height of the images [pixels].
        opening: opening angle of the height [rad].
        near: smallest measured depth [m].
        far: largest measured depth [m].
        noise: standard deviation of the depth of something 1 m away [m].
        seed: seed of the noise.
    """

    width: int
    height: int
    opening: float
    near: float
    far: float
    noise: float = 0.0
    seed: int = 0

    @property
    def focal(self) -> float:
        """Focal length [pixels]."""
        return float(self.height / (2 * np.tan(self.opening / 2)))

    @cached_property
    def _cameras(self) -> tuple[ColorRenderCamera, DepthRenderCamera]:
        """Drake's descriptions of the camera, for colours and labels, and for depth."""
        # VTK's coordinates begin at a corner of the first pixel, not in its middle.
        info = CameraInfo(
            self.width, self.height, self.focal, self.focal, self.width / 2, self.height / 2
        )
        # VTK draws a little more than the range of depths: colour images also show what is too near or too far.
        clipping = ClippingRange(_NEAR_CLIPPING * self.near, 2 * self.far)
        # The pose is given when an image is taken, so that of the description is the identity.
        core = RenderCameraCore(_RENDERER, info, clipping, RigidTransform())
        return ColorRenderCamera(core), DepthRenderCamera(core, DepthRange(self.near, self.far))

    def image(
        self, query: QueryObject, parent: FrameId, pose: RigidTransform, time: float
    ) -> Image:
        """Take an image.

        Args:
            query: query object of the scene graph.
            parent: frame of the scene graph to which the camera is fixed.
            pose: pose of the camera in the parent.
            time: time of the run [s], from which the noise of the depth is drawn.
        """
        color_camera, depth_camera = self._cameras
        # Copies of the channels, since a view would keep the whole of Drake's image in memory. The fourth channel of a
        # colour image, which is not used, is the opacity.
        color = query.RenderColorImage(color_camera, parent, pose).data[:, :, :3].copy()
        depth = query.RenderDepthImage(depth_camera, parent, pose).data[:, :, 0].copy()
        labels = query.RenderLabelImage(color_camera, parent, pose).data[:, :, 0].copy()
        if self.noise > 0:
            # The time is a part of the seed, so an image is the same whether or not others were taken before it.
            generator = np.random.default_rng([self.seed, round(time / _TIME_RESOLUTION)])
            noise = generator.standard_normal(depth.shape)
            # sigma(z) = noise z²; infinite depths, where nothing is, stay infinite.
            finite_depth = np.where(np.isfinite(depth), depth, 0.0)
            depth = (depth + self.noise * finite_depth**2 * noise).astype(np.float32)
        return Image(
            time=time,
            color=color,
            depth=depth,
            labels=labels,
            pose=query.GetPoseInWorld(parent) @ pose,
            focal=self.focal,
        )


def add_renderer(scene_graph: SceneGraph) -> None:
    """Add the cameras' renderer to a scene graph, if it is not there yet."""
    if not scene_graph.HasRenderer(_RENDERER):
        scene_graph.AddRenderer(
            _RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams(lights=_LIGHTS))
        )


class CameraBlock(Block):
    """Camera that other blocks can read: it takes an image when its output is evaluated.

    Ports:
        in  ``query``: the query object of the scene graph.
        out ``image``: an :class:`Image`.
    """

    def __init__(self, lens: Lens, *, parent: FrameId, pose: RigidTransform) -> None:
        """Create the block.

        Args:
            lens: optics of the camera.
            parent: frame of the scene graph to which the camera is fixed.
            pose: pose of the camera in the parent.
        """
        super().__init__()
        self._lens = lens
        self._parent = parent
        self._pose = pose
        self._query = self.DeclareAbstractInputPort("query", Value[QueryObject]())
        self.DeclareAbstractOutputPort("image", Value[object], weakly(self._calc_image))

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        """Take an image at the time of the context, and write it to `output`."""
        query = self._query.Eval(context)
        output.set_value(self._lens.image(query, self._parent, self._pose, context.get_time()))


Pixels = Annotated[Integer, Field(ge=8, le=4096, multiple_of=2)]

# A camera that is less deep in a shape counts as on its surface [m].
_INSIDE = 1e-3


class CameraSensor(Sensor):
    """A camera. Its images are taken after the run, so they do not slow it down."""

    takes_images: ClassVar[bool] = True

    kind: Literal["camera"]
    frame: str = WORLD
    """Frame to which it is fixed: a link or a tool of a robot, a piece (its TCP), or `world`."""
    pose: Pose = ORIGIN
    """Pose in this frame, [x y z Rz Ry Rx]; it looks along its z axis, with x to the right and y down in the image."""
    rate: Positive = 10.0
    """Images a second of a result [Hz]."""
    width: Pixels = 320
    """Width of an image [pixels]."""
    height: Pixels = 240
    """Height of an image [pixels]."""
    opening_deg: Annotated[Positive, Field(lt=180)] = 45.0
    """Opening angle of the image's height [deg]."""
    near: Positive = 0.05
    """Smallest depth that it measures [m]."""
    far: Positive = 5.0
    """Largest depth that it measures [m]."""
    depth_noise: NotNegative = 0.0
    """Standard deviation of the depth of something 1 m away [m]; it grows with the square of the distance."""
    seed: Integer = Field(default=0, ge=0)
    """Seed of the noise: the same seed gives the same values."""
    in_loop: Boolean = False
    """Give blocks of the user's own an input `image.<sensor>`, an image when they ask for one."""

    @model_validator(mode="after")
    def _check_depths(self) -> Self:
        """Check that the range of depths is not empty.

        Raises:
            ValueError: ``far`` is not larger than ``near``.
        """
        if self.far <= self.near:
            raise ValueError(
                message(
                    "parts.far_below_near",
                    "far is {far:g} m; it must be larger than near, {near:g} m",
                    far=self.far,
                    near=self.near,
                )
            )
        return self

    @property
    def samples_while_stepping(self) -> bool:
        """Whether blocks can read its images while the station is stepped."""
        return self.in_loop

    @property
    def lens(self) -> Lens:
        """Optics of the camera."""
        opening = float(np.deg2rad(self.opening_deg))
        return Lens(
            self.width, self.height, opening, self.near, self.far, self.depth_noise, self.seed
        )

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Note the camera for the result. If it is in a loop, add the block that other blocks can read.

        A run records no images: those of a result are rendered after it. So a camera has no signals.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.

        Raises:
            Unsuitable: the camera is inside a collision shape at the start.
        """
        parent, pose = self.mount(site.plant)
        self._check_outside(name, site.plant, parent, pose)
        site.outputs.notes[name] = {"kind": self.kind, "frame": self.frame}
        # Without a reader, the camera needs no block and no renderer: both would make each station slower to build.
        if not self.in_loop:
            return

        scene_graph = site.plant.scene_graph
        add_renderer(scene_graph)
        block = CameraBlock(self.lens, parent=parent, pose=pose)
        system_name = f"sensor.{name}"
        port = add_and_connect(builder, system_name, block, scene_graph.get_query_output_port())
        site.outputs.images[f"image.{name}"] = port
        label = sensor_label(message("parts.block_camera", "Camera"), name)
        site.picture.draw(system_name, "sensor", label)

    def mount(self, plant: StationPlant) -> tuple[FrameId, RigidTransform]:
        """Find the frame of the scene graph to which the camera is fixed, and the camera's pose in it."""
        # The scene graph has frames of bodies only: the pose of the camera in the body is that of the named frame in
        # the body, times that of the camera in the named frame.
        frame = frame_of(plant, self.frame)
        parent = plant.plant.GetBodyFrameIdOrThrow(frame.body().index())
        return parent, frame.GetFixedPoseInBodyFrame() @ transform_from_pose(self.pose)

    def _check_outside(
        self, name: str, station: StationPlant, parent: FrameId, pose: RigidTransform
    ) -> None:
        """Check that the camera is not inside of a collision shape at the start.

        Args:
            name: name of the sensor.
            station: the plant, with the positions at the start as its default.
            parent: frame of the scene graph to which the camera is fixed.
            pose: pose of the camera in the parent.

        Raises:
            Unsuitable: the camera is more than 1 mm deep inside a collision shape.
        """
        plant = station.plant
        scene_graph = station.scene_graph
        # The diagram is not built yet, so the scene graph gets the poses of all bodies from here.
        state = plant.CreateDefaultContext()
        poses = FramePoseVector()
        for frame in scene_graph.model_inspector().FramesForSource(plant.get_source_id()):
            poses.set_value(
                frame, plant.EvalBodyPoseInWorld(state, plant.GetBodyFromFrameId(frame))
            )
        context = scene_graph.CreateDefaultContext()
        scene_graph.get_source_pose_port(plant.get_source_id()).FixValue(context, poses)
        query = scene_graph.get_query_output_port().Eval(context)
        eye = (query.GetPoseInWorld(parent) @ pose).translation()
        # With the threshold 0, only shapes around the point are found: their distance is negative.
        for found in query.ComputeSignedDistanceToPoint(eye, 0.0):
            # On the surface, such as that of the link that carries it, a camera sees out.
            if found.distance >= -_INSIDE:
                continue
            coordinates = ", ".join(f"{value:.3g}" for value in eye)
            raise Unsuitable(
                f"sensors.{name}.pose",
                message(
                    "parts.eye_inside_of",
                    "the camera is at ({eye}) m, inside {body}",
                    eye=coordinates,
                    body=owner_of_shape(station, found.id_G),
                ),
                message("parts.outside_of_bodies", "move it outside all bodies"),
            )


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"let_render": "add_renderer"})
