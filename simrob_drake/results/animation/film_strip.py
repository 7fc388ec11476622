"""A run's motion in pictures: a strip of frames and a video."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from simrob_drake.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.results.animation.camera import Way
from simrob_drake.results.animation.rendering import Image, Studio
from simrob_drake.results.animation.scene import frame_times
from simrob_drake.results.record.run import RecordedRun

_DPI = 100
_GAP = 6  # pixels between frames
_CAPTION = 0.1  # height of the line under the frames, as a part of theirs
_VIDEO_SIZE = 960, 540  # pixels; even, as H.264 needs them


def save_film_strip(result: RecordedRun, file: Path, *, frames: int = 7, height: int = 360) -> Path:
    """Write frames at even times, side by side, with the time under each.

    The camera follows a robot that walks; then how far that is from its start stands there too, and the floor has lines
    every 0.1 m.

    Args:
        result: the run.
        file: where to, ``.png``.
        frames: how many, from the start to the end of the run.
        height: of a frame [pixels].

    Returns:
        the file.

    Raises:
        InvalidParameter: fewer than two frames, or a height of less than 16 pixels.
        OutputError: the file cannot be written.
    """
    if frames < 2:
        raise InvalidParameter("frames", frames, "at least 2")
    if height < 16:
        raise InvalidParameter("height", height, "at least 16 [pixels]")
    times = np.linspace(0.0, result.stop_time, frames)
    studio = Studio(result, height=height, oversampling=2)
    figure = _strip(list(studio.images(times)), _captions(times, studio.way))
    try:
        figure.savefig(file, dpi=_DPI, format="png")
    except OSError as problem:
        raise OutputError(f"{file}: cannot be written: {problem.strerror}") from problem
    return file


def save_video(result: RecordedRun, file: Path, *, frames_per_second: float = 30.0) -> Path:
    """Write the motion of a run as a video at the pace of the clock (H.264 in ``.mp4``).

    Args:
        result: the run.
        file: where to, ``.mp4``.
        frames_per_second: positive [1/s].

    Returns:
        the file.

    Raises:
        InvalidParameter: the rate is not positive.
        SimrobError: the package that writes videos is not installed.
        OutputError: the file cannot be written.
    """
    if not (np.isfinite(frames_per_second) and frames_per_second > 0):
        raise InvalidParameter("frames_per_second", frames_per_second, "a positive rate [1/s]")
    write_frames = frame_writer()
    width, height = _VIDEO_SIZE
    times = frame_times(result.stop_time, frames_per_second)
    if not file.parent.is_dir():
        raise OutputError(f"{file}: cannot be written: there is no folder {file.parent}")
    encoding = {"quality": 8, "macro_block_size": 2, "output_params": ["-preset", "veryfast"]}
    writer = write_frames(str(file), _VIDEO_SIZE, fps=frames_per_second, **encoding)
    try:
        writer.send(None)
        for image in Studio(result, height=height, width=width).images(times):
            writer.send(np.ascontiguousarray(image))
    except OSError as problem:
        raise OutputError(f"{file}: cannot be written: {str(problem).splitlines()[0]}") from problem
    finally:
        writer.close()
    return file


def frame_writer() -> Callable[..., Any]:
    """Return imageio-ffmpeg's ``write_frames``; to be called before long work whose end is a video.

    Raises:
        SimrobError: the package is not installed.
    """
    try:
        import imageio_ffmpeg
    except ImportError as problem:
        raise SimrobError('videos need another package: pip install "simrob-drake[video]"') from problem
    writer: Callable[..., Any] = imageio_ffmpeg.write_frames
    return writer


def _captions(times: Vector, way: Way | None) -> list[str]:
    """Return what stands under the frames: the time, and how far from its start a robot is that walks."""
    if way is None:
        return [f"{time:.2f} s" for time in times]
    distances = np.linalg.norm(way(times) - way(times[:1]), axis=1)
    return [f"{time:.2f} s, {distance:.2f} m" for time, distance in zip(times, distances, strict=True)]


def _strip(images: list[Image], captions: list[str]) -> Figure:
    height, width = images[0].shape[:2]
    caption = max(round(_CAPTION * height), 14)
    total = len(images) * (width + _GAP) - _GAP, height + caption
    figure = Figure(figsize=(total[0] / _DPI, total[1] / _DPI), dpi=_DPI)
    for column, (image, text) in enumerate(zip(images, captions, strict=True)):
        left = column * (width + _GAP)
        figure.figimage(image, left, caption)
        middle = (left + width / 2) / total[0], caption / 2 / total[1]
        points = 0.6 * caption * 72 / _DPI
        figure.text(*middle, text, ha="center", va="center", fontsize=points, color="0.25")
    return figure
