"""The motion of a run in pictures, rendered without display or browser: a strip of images, and a video.

A *strip* is a few images side by side with a caption under each. A robot that walks is followed by the camera, and
lines on the floor show how far it has gone.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from importlib.metadata import distribution
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

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
from simrob_drake.base.extras import importing_extra
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
    walked_displacement,
)
from simrob_drake.results.animation.scene import RENDERER, ViewedStation, with_floor_under
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun, events_of
from simrob_drake.stations.config import StationConfig

Pixels = npt.NDArray[np.uint8]
"""An image: red, green and blue of each pixel, shape (height, width, 3)."""

Frames: TypeAlias = int | Literal["events"]
"""Images of a strip: their count, at even times, or one for each event of the run."""


class _Size(NamedTuple):
    """Size of an image [pixels]."""

    width: int
    height: int


_FEW = 7
"""Largest count of images of a strip that are high."""

_HEIGHT = 360
"""Height of the images of a strip with at most `_FEW` images [pixels]."""

_LOW_HEIGHT = 240
"""Height of the images of a strip with more images [pixels], which are more in a row and in more rows."""

_LEAST_HEIGHT = 16
"""Least height of an image of a strip [pixels]."""

_GAP = 6
"""Distance of neighbouring images [pixels]."""

_CAPTION = 0.1
"""Height of a line of a caption, as a part of the height of an image."""

_LEAST_CAPTION = 14
"""Least height of a line of a caption [pixels], so that it can be read."""

_WIDEST = 5.8
"""Width of a row of a strip, in heights of an image. More images are in further rows."""

_STILL = _Size(width=480, height=360)
"""Size of an image without a run."""

_AROUND = 10.0
"""Extent of the floor around the start of a station without a run [m]."""

_VIDEO_SIZE = _Size(width=960, height=540)
"""Size of a video. H.264 needs even numbers."""

_BACKGROUND = np.array([0.98, 0.98, 0.98])
"""Colour of the background: red, green and blue, from 0 to 1."""

_NARROWEST_ASPECT = 0.6
_WIDEST_ASPECT = 2.4
"""Smallest and largest width over height of an image whose size follows from the motion."""

_PATH_SAMPLES = 200
"""Count of positions of a path along which the floor has lines."""

_SHADOW_MAP = 1024
"""Length of an edge of the map from which shadows are computed [pixels]."""

_WHITE = (255, 255, 255)
_GREY = (64, 64, 64)

_FONT = "matplotlib/mpl-data/fonts/ttf/DejaVuSans.ttf"
"""Path of a font in the folder of installed packages. Its file is read without loading Matplotlib."""


def film_strip(result: RecordedRun, *, frames: Frames = 7, height: int | None = None) -> bytes:
    """Render images of a run or a program side by side, with the time under each image.

    If the camera follows a robot that walks, its distance from the start is in the caption, too. The floor then has
    lines every 0.1 m, and bold ones every 0.5 m.

    Args:
        result: the run.
        frames: count of images, at even times from the start to the end; or "events": then there is an image for the
            start, each contact that begins, each end of a move, each piece that is attached or detached, and the end of
            the run. Of events that are close together only one is shown; there are two dozen at most.
        height: height of an image [pixels]. If it is None, it is 360 for up to seven images, and 240 for more.

    Returns:
        content of a PNG file.

    Raises:
        InvalidParameter: there are fewer than two images, or the height is less than 16 pixels.
    """
    check_frames(frames)
    events = events_of(result) if frames == "events" else []
    if events:
        times = np.array([time for time, _ in events])
    else:
        times = np.linspace(result.start_time, result.stop_time, int(frames))
    if height is None:
        height = _HEIGHT if len(times) <= _FEW else _LOW_HEIGHT
    if height < _LEAST_HEIGHT:
        raise InvalidParameter(
            "height", height, message("results.least_pixels", "at least 16 [pixels]")
        )
    # Checked above: setting up the studio takes seconds.
    studio = Studio(result, height=height, oversampling=2)
    texts = captions_of(result, studio, times)
    if events:
        texts = [
            f"{caption}\n{translate(text)}"
            for caption, (_, text) in zip(texts, events, strict=True)
        ]
    content = BytesIO()
    side_by_side(list(studio.images(times)), texts).save(content, format="png")
    return content.getvalue()


def check_frames(frames: Frames) -> None:
    """Check how many images a strip shall have.

    Args:
        frames: a count, or "events".

    Raises:
        InvalidParameter: it is another text, or a count below two.
    """
    if frames != "events" and (not isinstance(frames, int) or frames < 2):
        raise InvalidParameter(
            "frames", frames, message("results.two_or_events", 'at least 2, or "events"')
        )


def save_film_strip(
    result: RecordedRun, file: Path, *, frames: Frames = 7, height: int | None = None
) -> Path:
    """Write a :func:`film_strip` to a ``.png`` file. Returns the file.

    Args:
        result: the run.
        file: the file.
        frames: count of images, or "events" for an image of each event.
        height: height of an image [pixels]; 360 or 240 if it is None, depending on the count of images.

    Raises:
        InvalidParameter: there are fewer than two images, or the height is less than 16 pixels.
        OutputError: the file cannot be written.
    """
    strip = film_strip(result, frames=frames, height=height)
    with replaced_at_once(file) as work:
        work.write_bytes(strip)
    return file


def save_video(result: RecordedRun, file: Path, *, frames_per_second: float = 30.0) -> Path:
    """Write the motion of a run as a video in real time (H.264 in ``.mp4``). Returns the file.

    Args:
        result: the run.
        file: the file.
        frames_per_second: rate of the images [1/s].

    Raises:
        InvalidParameter: the rate is not positive.
        SimrobError: the package that writes videos is not installed.
        OutputError: the file cannot be written.
    """
    # Rendering takes minutes. All that can fail without it is checked before.
    frame_writer()
    times = frame_times(result.stop_time, frames_per_second, begin=result.start_time)
    if not file.parent.is_dir():
        problem = message(
            "results.no_folder_for_file",
            "{file} cannot be written: the folder {folder} does not exist",
            file=file,
            folder=file.parent,
        )
        raise OutputError(problem)
    studio = Studio(result, height=_VIDEO_SIZE.height, width=_VIDEO_SIZE.width)
    with progress_bar("video", len(times), shown=True) as advance:
        return write_video(_with_progress(studio.images(times), advance), file, frames_per_second)


def _with_progress(images: Iterable[Pixels], advance: Advance | None) -> Iterator[Pixels]:
    """Yield images, and move a progress bar after each.

    Args:
        images: the images.
        advance: function that moves the bar to the count of images that are done; None if there is no bar.
    """
    for done_count, image in enumerate(images, start=1):
        yield image
        if advance:
            advance(done_count)


def write_video(images: Iterable[Pixels], file: Path, frames_per_second: float) -> Path:
    """Write images as a video (H.264). Returns the file.

    Args:
        images: one image or more, all of the same size. Width and height are even numbers.
        file: the file.
        frames_per_second: rate of the images [1/s].

    Raises:
        SimrobError: the package that writes videos is not installed.
        OutputError: the file cannot be written.
    """
    write_frames = frame_writer()
    remaining = iter(images)
    first = next(remaining)  # its size is that of the video
    encoding = {
        "quality": 8,
        "macro_block_size": 2,
        "output_params": ["-preset", "veryfast"],
        "ffmpeg_log_level": "fatal",
    }
    size = _Size(width=first.shape[1], height=first.shape[0])
    with replaced_at_once(file) as work:
        with closing(write_frames(str(work), size, fps=frames_per_second, **encoding)) as writer:
            writer.send(None)  # starts the generator, which then waits for images
            for image in chain([first], remaining):
                writer.send(np.ascontiguousarray(image))
        # Before the file gets its name: a broken video never replaces a good one.
        _check_video(work)
    return file


def _check_video(file: Path) -> None:
    """Check that a video is complete, by reading it to its end: ffmpeg reports no error when the disk becomes full.

    Raises:
        OutputError: the video is not complete.
    """
    from imageio_ffmpeg import count_frames_and_secs

    try:
        count_frames_and_secs(str(file))
    except RuntimeError as error:
        problem = message(
            "results.video_broke_off",
            "{work} cannot be written: the video is incomplete. The disk may be full",
            work=file,
        )
        raise OutputError(problem) from error


def frame_writer() -> Callable[..., Any]:
    """Find the function that writes videos, ``write_frames`` of imageio-ffmpeg.

    Raises:
        SimrobError: the package is not installed.
    """
    with importing_extra(message("results.a_video", "a video"), "video"):
        import imageio_ffmpeg
    writer: Callable[..., Any] = imageio_ffmpeg.write_frames
    return writer


def captions_of(result: RecordedRun, studio: "Studio", times: Vector) -> list[str]:
    """Write the captions of a run's images: the time, and the distance of a robot that walks from its start.

    Args:
        result: the run.
        studio: the studio that draws its images, which has found out whether a robot walks.
        times: times of the images, shape (k,) [s].
    """
    walks = studio.robot_displacement is not None
    return captions(times, base_distances(result, times) if walks else None)


def captions(times: Vector, distances: Vector | None) -> list[str]:
    """Write the captions of images: the time, and the distance of a robot that walks from its start.

    Args:
        times: times of the images, shape (k,) [s].
        distances: distance of the robot from its start at these times, shape (k,) [m]; None if no robot walks.
    """
    if distances is None:
        return [f"{time:.2f} s" for time in times]
    return [
        f"{time:.2f} s, {distance:.2f} m" for time, distance in zip(times, distances, strict=True)
    ]


def side_by_side(images: list[Pixels], texts: list[str]) -> Image.Image:
    """Place images side by side with captions. Images that do not fit in one row are in several, and remain large.

    Args:
        images: the images, all of one size.
        texts: caption of each image. A line that is wider than its image is broken.
    """
    height, width = images[0].shape[:2]
    line_height = max(round(_CAPTION * height), _LEAST_CAPTION)
    # Letters fill 0.6 of a line, so that lines keep a distance.
    font = ImageFont.truetype(str(distribution("matplotlib").locate_file(_FONT)), 0.6 * line_height)
    wrapped_texts = [_wrap(text, width, font) for text in texts]
    line_count = max(text.count("\n") for text in wrapped_texts) + 1
    caption_height = line_height * line_count

    # As many rows as needed for the largest width, then as few columns as these rows need, so that all rows are about
    # equally full; this may need fewer rows.
    row_count = _ceiling_division(len(images) * width, round(_WIDEST * height))
    column_count = _ceiling_division(len(images), row_count)
    row_count = _ceiling_division(len(images), column_count)

    row_height = height + caption_height
    strip = Image.new("RGB", (column_count * (width + _GAP) - _GAP, row_count * row_height), _WHITE)
    pen = ImageDraw.Draw(strip)
    for number, (image, text) in enumerate(zip(images, wrapped_texts, strict=True)):
        left = number % column_count * (width + _GAP)
        top = number // column_count * row_height
        strip.paste(Image.fromarray(image), (left, top))
        # The anchor "mm" puts the middle of the text at this point.
        middle_of_caption = (left + width / 2, top + height + caption_height / 2)
        pen.multiline_text(middle_of_caption, text, _GREY, font, anchor="mm", align="center")
    return strip


def _ceiling_division(dividend: int, divisor: int) -> int:
    """Quotient of two positive integers, rounded up."""
    return -(-dividend // divisor)


def _wrap(text: str, width: float, font: ImageFont.FreeTypeFont) -> str:
    """Break the lines of a text at spaces, so that each is no wider than a given width.

    A word that is wider than that stays whole.

    Args:
        text: the text.
        width: largest width of a line [pixels].
        font: the font in which the text is drawn.
    """
    lines = []
    for line in text.split("\n"):
        fitting = ""
        for word in line.split(" "):
            longer = f"{fitting} {word}" if fitting else word
            # Measured in the font itself: an estimate by letters would break captions too early, or let
            # neighbours touch.
            if fitting and font.getlength(longer) > width:
                lines.append(fitting)
                fitting = word
            else:
                fitting = longer
        lines.append(fitting)
    return "\n".join(lines)


class Studio:
    """A station in front of a camera that has the whole motion of a run in its picture.

    The camera does not move, or follows a robot that walks.

    Attributes:
        robot_displacement: displacement since the start of the robot that walks, without the sway of its steps, shape
            (k, 3) [m] at times (k,) [s]; None if no robot walks.
        camera_displacement: displacement of the camera; None if the camera does not move.
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
        widest: float = _WIDEST_ASPECT,
    ) -> None:
        """Set the camera up for a run.

        Args:
            result: the run.
            height: height of the images [pixels].
            width: width of the images [pixels]. If it is None, it follows from the motion.
            oversampling: edge of the square of rendered pixels whose mean is a pixel of the image. Edges are smoother
                with more.
            follow: whether the camera follows a robot that walks. Otherwise the whole path is in the picture.
            azimuth: direction from the station to the eye, counterclockwise from x [rad]. If it is None, it is at the
                right of the front.
            widest: largest width over height, if the width follows from the motion.

        Raises:
            SimrobError: the station cannot be built, such as a robot without its files.
        """
        self._result = result
        self.robot_displacement = walked_displacement(result)
        self.camera_displacement = self.robot_displacement if follow else None
        path: Vector | None = None
        config = result.config
        if self.robot_displacement is not None:
            path = self.robot_displacement(
                np.linspace(result.start_time, result.stop_time, _PATH_SAMPLES)
            )
            # A floor that ends under a walking robot would look as if the robot left the station.
            config = with_floor_under(config, path)
        self._scene = ViewedStation(config, engine=MakeRenderEngineVtk(_engine_params()), path=path)
        if azimuth is None:
            azimuth = side(self._scene.station)
        points = self._scene.extents_of_run(result, self.camera_displacement)
        if not width:
            aspect = np.clip(aspect_of(points, azimuth=azimuth), _NARROWEST_ASPECT, widest)
            width = round(height * aspect)
        self._camera = camera_on(points, aspect=width / height, azimuth=azimuth)
        self._lens = _Lens(self._camera, _Size(width, height), oversampling)

    def images(self, times: Vector) -> Iterator[Pixels]:
        """Yield an image, shape (height, width, 3), for each time, shape (k,) [s]."""
        displacements = np.zeros((len(times), 3))
        if self.camera_displacement is not None:
            displacements = self.camera_displacement(times)
        rows = positions_in(self._scene.station, self._result, times)
        for positions, displacement in zip(rows, displacements, strict=True):
            yield self._lens.image(self._scene, positions, self._camera.translate(displacement))


class Still:
    """A station in front of a camera, without a run.

    If the base of a robot moves freely, the camera follows the middle of all bodies.
    """

    def __init__(self, config: StationConfig) -> None:
        """Set the camera up for a station.

        Raises:
            SimrobError: the station cannot be built, such as a robot without its files.
        """
        around = np.array([[-_AROUND, -_AROUND, 0.0], [_AROUND, _AROUND, 0.0]])
        self._scene = ViewedStation(
            with_floor_under(config, around), engine=MakeRenderEngineVtk(_engine_params())
        )
        self._follows = any(robot.floats for robot in self._scene.station.robots.values())
        plant = self._scene.plant
        initial = plant.GetPositions(plant.CreateDefaultContext())
        points = self._scene.extents(initial[np.newaxis])
        self._middle = points.mean(axis=0)
        azimuth = side(self._scene.station)
        self._camera = camera_on(points, aspect=_STILL.width / _STILL.height, azimuth=azimuth)
        self._lens = _Lens(self._camera, _STILL, oversampling=1)

    def image(self, positions: Vector) -> Pixels:
        """Render an image of the station.

        Args:
            positions: positions of the whole plant, shape (nq,).

        Returns:
            the image, 360 pixels high and 480 wide, shape (360, 480, 3).
        """
        camera = self._camera
        if self._follows:
            # The middle of all bodies, since without a run no signal of the base exists.
            middle = self._scene.extents(positions[np.newaxis]).mean(axis=0)
            displacement = middle - self._middle
            # The camera stays at its height, so that a fall is visible.
            displacement[2] = 0.0
            camera = camera.translate(displacement)
        return self._lens.image(self._scene, positions, camera)


class _Lens:
    """Renderer of images of a scene, seen by a camera that may move."""

    def __init__(self, camera: Camera, size: _Size, oversampling: int) -> None:
        """Prepare the rendering.

        Args:
            camera: the camera, whose distance from its target sets the range of depths.
            size: size of the images.
            oversampling: edge of the square of rendered pixels whose mean is a pixel of the image.
        """
        self._oversampling = oversampling
        distance = float(np.linalg.norm(camera.target - camera.eye))
        lens = CameraInfo(
            width=size.width * oversampling,
            height=size.height * oversampling,
            fov_y=FIELD_OF_VIEW,
        )
        # A larger range would make the depths too coarse to decide which of two surfaces is in front.
        depth = ClippingRange(distance / 20, distance * 20)
        self._lens = ColorRenderCamera(RenderCameraCore(RENDERER, lens, depth, RigidTransform()))

    def image(self, scene: ViewedStation, positions: Vector, camera: Camera) -> Pixels:
        """Render a scene at some positions as a camera sees it.

        Args:
            scene: the scene. It keeps the positions.
            positions: positions of the plant, shape (nq,).
            camera: the camera.

        Returns:
            the image, shape (height, width, 3).
        """
        scene.place(positions)
        query = scene.query()
        rendered = query.RenderColorImage(
            self._lens, query.inspector().world_frame_id(), _pose(camera)
        )
        size = (rendered.width(), rendered.height())
        # Drake's pixels have a fourth value, the opacity, which is not used.
        image = Image.frombuffer("RGBX", size, rendered.data, "raw", "RGBX", 0, 1)
        # A copy, since the array would keep the whole rendered image with its fourth value in memory.
        return np.asarray(image.reduce(self._oversampling))[:, :, :3].copy()


def _engine_params() -> RenderEngineVtkParams:
    """Parameters of the render engine: its lamps and shadows.

    Only the lamp straight above casts shadows: they show what is over what on the floor, and steep faces, where shadow
    maps are speckled, get nothing of its light. The lamps by the camera are points far away, which cast none.
    """
    above = LightParameter(
        type="directional",
        frame="world",
        direction=[0.0, 0.0, -1.0],
        intensity=0.4,
    )
    behind_camera = LightParameter(
        type="point",
        frame="camera",
        position=[-10.0, -10.0, -30.0],
        intensity=0.95,
    )
    right_of_camera = LightParameter(
        type="point",
        frame="camera",
        position=[27.0, -3.0, -15.0],
        intensity=0.35,
    )
    return RenderEngineVtkParams(
        default_clear_color=_BACKGROUND,
        lights=[above, behind_camera, right_of_camera],
        cast_shadows=True,
        shadow_map_size=_SHADOW_MAP,
    )


def _pose(camera: Camera) -> RigidTransform:
    """Pose of a camera's frame in the world: x to the right in the picture, y downwards, and z forward."""
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return RigidTransform(RotationMatrix(np.column_stack([right, down, forward])), camera.eye)
