"""A run's motion in pictures, rendered without display or browser: a strip of frames and a video."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from importlib.metadata import distribution
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
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

from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.base.extras import needed
from simrob_drake.base.folders import replaced_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, translate
from simrob_drake.base.progress import Advance, progress_bar
from simrob_drake.results.animation.camera import (
    FIELD_OF_VIEW,
    Camera,
    aspect_of,
    base_distances,
    camera_on,
    frame_times,
    side,
    walked_way,
)
from simrob_drake.results.animation.scene import RENDERER, ViewedStation, with_floor_under
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun, events_of
from simrob_drake.stations.config import StationConfig

Pixels = npt.NDArray[np.uint8]
Frames: TypeAlias = int | Literal["events"]  # of a strip: how many at even times, or one for each event

_HEIGHT, _LOW, _FEW = 360, 240, 7  # pixels of a frame; of one of many, and how many are few
_GAP = 6  # pixels between frames
_CAPTION = 0.1  # height of the line under the frames, as a part of theirs
_WIDEST = 5.8  # width of a strip, in heights of a frame
_STILL = 360, 480  # pixels of a picture without a run: height, width
_AROUND = 10.0  # m of floor about where such a station begins
_VIDEO_SIZE = 960, 540  # pixels; even, as H.264 needs them
_BACKGROUND = np.array([0.98, 0.98, 0.98])
_ASPECTS = 0.6, 2.4  # narrowest and widest picture
_PLACES = 200  # of a way, under which the floor has lines
_SHADOW_MAP = 1024  # pixels a side
_WHITE, _GREY = (255, 255, 255), (64, 64, 64)
_FONT = "matplotlib/mpl-data/fonts/ttf/DejaVuSans.ttf"  # matplotlib need not be loaded for it


def film_strip(result: RecordedRun, *, frames: Frames = 7, height: int | None = None) -> bytes:
    """Return frames side by side of a run or a program, with the time under each, as PNG.

    The camera follows a robot that walks; then how far that is from its start stands there too, and the floor has lines
    every 0.1 m, bold ones every 0.5 m. Frames are so many at even times from the start to the end, or one for each
    event: a contact that begins, the end of a move, a piece that is attached or detached, and what stopped the run, two
    dozen at most. They are 360 pixels high unless given, many 240. Raises InvalidParameter: fewer than two frames, or a
    height of less than 16 pixels.
    """
    check_frames(frames)
    events = events_of(result) if frames == "events" else []
    times = (
        np.array([time for time, _ in events])
        if events
        else np.linspace(result.start_time, result.stop_time, int(frames))
    )
    height = (_HEIGHT if len(times) <= _FEW else _LOW) if height is None else height
    if height < 16:
        raise InvalidParameter("height", height, message("results.least_pixels", "at least 16 [pixels]"))
    studio = Studio(result, height=height, oversampling=2)
    distances = None if studio.walked is None else base_distances(result, times)
    texts = captions(times, distances)
    strip = BytesIO()
    if events:
        texts = [f"{caption}\n{translate(text)}" for caption, (_, text) in zip(texts, events, strict=True)]
    side_by_side(list(studio.images(times)), texts).save(strip, format="png")
    return strip.getvalue()


def check_frames(frames: Frames) -> None:
    """Check how many frames a strip shall have; raises InvalidParameter: fewer than two."""
    if frames != "events" and (not isinstance(frames, int) or frames < 2):
        raise InvalidParameter("frames", frames, message("results.two_or_events", 'at least 2, or "events"'))


def save_film_strip(result: RecordedRun, file: Path, *, frames: Frames = 7, height: int | None = None) -> Path:
    """Write a :func:`film_strip`, ``.png``, return its file; raises InvalidParameter: as there; OutputError."""
    strip = film_strip(result, frames=frames, height=height)
    with replaced_at_once(file) as work:
        work.write_bytes(strip)
    return file


def save_video(result: RecordedRun, file: Path, *, frames_per_second: float = 30.0) -> Path:
    """Write the motion of a run as a video at the pace of the clock (H.264 in ``.mp4``), and return the file.

    Raises InvalidParameter: a rate [1/s] that is not positive; SimrobError: the package that writes videos is not
    installed; OutputError: the file cannot be written.
    """
    frame_writer()
    width, height = _VIDEO_SIZE
    times = frame_times(result.stop_time, frames_per_second, begin=result.start_time)
    if not file.parent.is_dir():
        raise OutputError(
            message(
                "results.no_folder_for_file",
                "{file} cannot be written: there is no folder {folder}",
                file=file,
                folder=file.parent,
            )
        )
    images = Studio(result, height=height, width=width).images(times)
    with progress_bar("video", len(times), shown=True) as move:
        return write_video(_counted(images, move), file, frames_per_second)


def _counted(images: Iterable[Pixels], move: Advance | None) -> Iterator[Pixels]:
    for number, image in enumerate(images):
        yield image
        if move:
            move(number)


def write_video(images: Iterable[Pixels], file: Path, frames_per_second: float) -> Path:
    """Write images of one size, shape (h, w, 3) of even numbers, as a video (H.264), and return its file.

    Raises SimrobError: the package that writes videos is not installed; OutputError: the file cannot be written.
    """
    write_frames, images = frame_writer(), iter(images)
    first = next(images)
    encoding = {
        "quality": 8,
        "macro_block_size": 2,
        "output_params": ["-preset", "veryfast"],
        "ffmpeg_log_level": "fatal",
    }
    size = first.shape[1], first.shape[0]
    with replaced_at_once(file) as work:
        with closing(write_frames(str(work), size, fps=frames_per_second, **encoding)) as writer:
            writer.send(None)
            for image in chain([first], images):
                writer.send(np.ascontiguousarray(image))
        # ffmpeg is silent about a disk that is full: the video is read to its end
        from imageio_ffmpeg import count_frames_and_secs

        try:
            count_frames_and_secs(str(work))
        except RuntimeError as problem:
            raise OutputError(
                message(
                    "results.video_broke_off", "{work} cannot be written: it broke off, the disk may be full", work=work
                )
            ) from problem
    return file


def frame_writer() -> Callable[..., Any]:
    """Return imageio-ffmpeg's ``write_frames``, before long work for a video; raises SimrobError: not installed."""
    with needed(message("results.a_video", "a video"), "video"):
        import imageio_ffmpeg
    writer: Callable[..., Any] = imageio_ffmpeg.write_frames
    return writer


def captions(times: Vector, distances: Vector | None) -> list[str]:
    """Write the captions of frames: the time, and how far from its start a robot is that walks.

    Args:
        times: times of the frames, shape (k,) [s].
        distances: distance of the robot from its start at these times, shape (k,) [m]; None if no robot walks.
    """
    if distances is None:
        return [f"{time:.2f} s" for time in times]
    return [f"{time:.2f} s, {distance:.2f} m" for time, distance in zip(times, distances, strict=True)]


def side_by_side(images: list[Pixels], texts: list[str]) -> Image.Image:
    """Put images side by side with captions, in as many rows as keep them large where they are wide.

    Args:
        images: the images, all of one size.
        texts: caption of each. A line that is wider than its image is broken.
    """
    height, width = images[0].shape[:2]
    line_height = max(round(_CAPTION * height), 14)
    font = ImageFont.truetype(str(distribution("matplotlib").locate_file(_FONT)), 0.6 * line_height)
    texts = [_wrapped(text, width, font) for text in texts]
    lines = max(text.count("\n") for text in texts) + 1
    below = line_height * lines
    columns = -(-len(images) // -(-len(images) * width // round(_WIDEST * height)))
    rows = -(-len(images) // columns)
    strip = Image.new("RGB", (columns * (width + _GAP) - _GAP, rows * (height + below)), _WHITE)
    pen = ImageDraw.Draw(strip)
    for number, (image, text) in enumerate(zip(images, texts, strict=True)):
        left, top = number % columns * (width + _GAP), number // columns * (height + below)
        strip.paste(Image.fromarray(image), (left, top))
        middle = left + width / 2, top + height + below / 2
        pen.multiline_text(middle, text, _GREY, font, anchor="mm", align="center")
    return strip


def _wrapped(text: str, width: float, font: ImageFont.FreeTypeFont) -> str:
    """Break the lines of a text at spaces, so that each is no wider than a width [pixels].

    A word that is wider than that stays whole.
    """
    lines = []
    for line in text.split("\n"):
        fitting = ""
        for word in line.split(" "):
            longer = f"{fitting} {word}" if fitting else word
            if fitting and font.getlength(longer) > width:
                lines.append(fitting)
                fitting = word
            else:
                fitting = longer
        lines.append(fitting)
    return "\n".join(lines)


class Studio:
    """A station before a camera that has the whole motion of a run in its picture.

    It stands still, but for a robot that walks: beside that it goes, and lines on the floor show the way.
    """

    def __init__(
        self,
        result: RecordedRun,
        *,
        height: int,
        width: int | None = None,
        oversampling: int = 1,
        follow: bool = True,
        azimuth: float | None = None,
        widest: float = _ASPECTS[1],
    ) -> None:
        """Set the camera up for a run, with images of a height and a width, to suit the motion unless given [pixels].

        ``oversampling`` pixels a side are rendered for one: more make smoother edges. It goes beside a robot that walks
        with ``follow``, else all of its way is in the picture; the eye is at ``azimuth`` from x [rad], before the front
        quarter unless given; images that suit the motion are at most ``widest`` over their height. Raises InvalidModel:
        a robot that cannot be built.
        """
        self._result = result
        self.walked = walked = walked_way(result)  # how far a robot that walks goes; None where nothing walks
        self.way = way = walked if follow else None  # of the camera; None where it stands still
        gone = None if walked is None else walked(np.linspace(result.start_time, result.stop_time, _PLACES))
        config = result.config if gone is None else with_floor_under(result.config, gone)
        self._scene = scene = ViewedStation(config, engine=MakeRenderEngineVtk(_engine_params()), way=gone)
        azimuth = side(scene.station) if azimuth is None else azimuth
        points = scene.extents_of_run(result, way)
        width = width or round(height * np.clip(aspect_of(points, azimuth=azimuth), _ASPECTS[0], widest))
        self._camera = camera_on(points, aspect=width / height, azimuth=azimuth)
        self._lens = _Lens(self._camera, height=height, width=width, oversampling=oversampling)

    def images(self, times: Vector) -> Iterator[Pixels]:
        """Yield an image, shape (height, width, 3), for each time, shape (k,) [s]."""
        ways = np.zeros((len(times), 3)) if self.way is None else self.way(times)
        rows = positions_in(self._scene.station, self._result, times)
        for positions, way in zip(rows, ways, strict=True):
            yield self._lens.image(self._scene, positions, self._camera.moved(way))


class Still:
    """A station before a camera, without a run, in pictures (360, 480, 3): that goes beside a robot on legs."""

    def __init__(self, config: StationConfig) -> None:
        """Set the camera up; raises InvalidModel: a robot that cannot be built."""
        around = np.array([[-_AROUND, -_AROUND, 0.0], [_AROUND, _AROUND, 0.0]])
        config = with_floor_under(config, around)
        self._scene = scene = ViewedStation(config, engine=MakeRenderEngineVtk(_engine_params()))
        self._walks = any(robot.floats for robot in scene.station.robots.values())
        plant = scene.station.plant
        points = scene.extents(plant.GetPositions(plant.CreateDefaultContext())[np.newaxis])
        height, width = _STILL
        self._middle, azimuth = points.mean(axis=0), side(scene.station)
        self._camera = camera_on(points, aspect=width / height, azimuth=azimuth)
        self._lens = _Lens(self._camera, height=height, width=width, oversampling=1)

    def image(self, positions: Vector) -> Pixels:
        """Return an image of a configuration, shape (nq,)."""
        gone = self._scene.extents(positions[np.newaxis]).mean(axis=0) - self._middle if self._walks else np.zeros(3)
        return self._lens.image(self._scene, positions, self._camera.moved(gone * [1, 1, 0]))


class _Lens:
    """What makes images of a scene, as a camera that may move sees it."""

    def __init__(self, camera: Camera, *, height: int, width: int, oversampling: int) -> None:
        self._oversampling = oversampling
        distance = float(np.linalg.norm(camera.target - camera.eye))
        lens = CameraInfo(width=width * oversampling, height=height * oversampling, fov_y=FIELD_OF_VIEW)
        depth = ClippingRange(distance / 20, distance * 20)
        self._lens = ColorRenderCamera(RenderCameraCore(RENDERER, lens, depth, RigidTransform()))

    def image(self, scene: ViewedStation, positions: Vector, camera: Camera) -> Pixels:
        scene.place(positions)
        query = scene.query()
        rendered = query.RenderColorImage(self._lens, query.inspector().world_frame_id(), _pose(camera))
        size = rendered.width(), rendered.height()
        image = Image.frombuffer("RGBX", size, rendered.data, "raw", "RGBX", 0, 1)
        return np.asarray(image.reduce(self._oversampling))[:, :, :3].copy()


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


def _pose(camera: Camera) -> RigidTransform:
    """Return the pose of a camera body: z forward, x right and y down in the picture."""
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), camera.eye)
