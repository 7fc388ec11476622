"""A camera: colours, depth and bodies, as images."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.camera import CameraBlock, Lens, let_render
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import transform_from_pose
from simrob_drake.parts.sensors.sensor import Sensor, sensor_label
from simrob_drake.parts.site import WORLD, Site, StationPlant, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of, owner_of_shape
from simrob_drake.sections import ORIGIN, Boolean, Integer, NotNegative, Pose, Positive

Pixels = Annotated[Integer, Field(ge=8, le=4096, multiple_of=2)]

_INSIDE = 1e-3  # m: one on the face of a link is not inside of it


class CameraSensor(Sensor):
    """A camera; its images are taken after the run, and then cost it nothing."""

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
    seed: Integer = 0
    """Of the noise."""
    in_loop: Boolean = False
    """Give blocks of the user's own an input `image.<sensor>`, an image when they ask for one."""

    @model_validator(mode="after")
    def _check_depths(self) -> Self:
        if self.far <= self.near:
            raise ValueError(f"far is {self.far:g}; it must be more than near ({self.near:g})")
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

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the frame exists."""
        check_frame(station, f"{key}.frame", self.frame)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Let loops look through it if they may; it has no signals."""
        parent, pose = self.mount(site.plant)
        self._check_outside(name, site.plant, parent, pose)
        site.notes[name] = {"kind": self.kind, "frame": self.frame}
        if self.in_loop:
            let_render(site.plant.scene_graph)
            block = CameraBlock(self.lens, parent=parent, pose=pose)
            query = site.plant.scene_graph.get_query_output_port()
            site.images[f"image.{name}"] = fed(builder, f"sensor.{name}", block, query)
            site.draw(f"sensor.{name}", "sensor", sensor_label("Camera", name))

    def mount(self, plant: StationPlant) -> tuple[FrameId, RigidTransform]:
        """Return the frame of the geometry that it moves with, and its pose in that."""
        frame = frame_of(plant, self.frame)
        parent = plant.plant.GetBodyFrameIdOrThrow(frame.body().index())
        return parent, frame.GetFixedPoseInBodyFrame() @ transform_from_pose(self.pose)

    def _check_outside(self, name: str, station: StationPlant, parent: FrameId, pose: RigidTransform) -> None:
        """Check that it is not inside of a shape at the start.

        Raises:
            InvalidParameter: it is.
        """
        plant, scene_graph = station.plant, station.scene_graph
        state, context, poses = plant.CreateDefaultContext(), scene_graph.CreateDefaultContext(), FramePoseVector()
        for frame in scene_graph.model_inspector().FramesForSource(plant.get_source_id()):
            poses.set_value(frame, plant.EvalBodyPoseInWorld(state, plant.GetBodyFromFrameId(frame)))
        scene_graph.get_source_pose_port(plant.get_source_id()).FixValue(context, poses)
        query = scene_graph.get_query_output_port().Eval(context)
        eye = (query.GetPoseInWorld(parent) @ pose).translation()
        for found in query.ComputeSignedDistanceToPoint(eye, 0.0):
            if found.distance < -_INSIDE:
                where = f"at {', '.join(f'{value:.3g}' for value in eye)} m, inside of "
                where += owner_of_shape(station, found.id_G)
                raise InvalidParameter(f"sensors.{name}.pose", where, "outside of every body")
