"""The film strip and the video: what is in the pictures."""

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.results.animation.pictures import Studio, save_film_strip, save_video


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.6, progress=False)


def changed(first, second):
    """Return the part of the pixels that differ clearly."""
    return (np.abs(first.astype(int) - second.astype(int)).max(axis=2) > 30).mean()


def test_the_strip_shows_the_motion_from_left_to_right(result, tmp_path):
    picture = imread(save_film_strip(result, tmp_path / "strip.png", frames=3, height=120)) * 255

    assert picture.shape[0] > 120  # the times stand below

    width = picture.shape[1] // 3
    first, middle, last = (
        picture[:110, index * width : (index + 1) * width - 8, :3] for index in range(3)
    )

    assert changed(first, last) > 0.05
    assert changed(first, middle) > 0.05
    captions = picture[122:, :, :3].min(axis=(0, 2)) < 150
    assert all(captions[index * width : (index + 1) * width].any() for index in range(3))


@pytest.mark.long
def test_wide_frames_stand_in_two_rows(tmp_path):
    result = simulate(load_station("two_irb120"), duration=0.3, progress=False)
    studio = Studio(result, height=60, oversampling=2)
    frames = list(studio.images(np.linspace(0, 0.3, 7)))
    wide = frames[0].shape[1]

    picture = imread(save_film_strip(result, tmp_path / "strip.png", height=60)) * 255

    assert picture.shape[:2] == (2 * (60 + 14), 4 * (wide + 6) - 6)
    for place, frame in ((0, frames[0]), (3, frames[3]), (4, frames[4]), (6, frames[6])):
        left, top = place % 4 * (wide + 6), place // 4 * (60 + 14)
        assert changed(picture[top : top + 60, left : left + wide, :3], frame) < 0.01


def test_images_are_of_their_times(result):
    studio = Studio(result, height=90)
    start, end, again = studio.images(np.array([0.0, result.stop_time, 0.0]))

    np.testing.assert_array_equal(start, again)
    assert changed(start, end) > 0.05


@pytest.mark.parametrize("width", [None, 100, 300])
def test_nothing_that_moves_leaves_the_picture(width):
    result = simulate(load_station("double_pendulum"), progress=False)  # it has no floor
    for image in Studio(result, height=150, width=width).images(
        np.linspace(0, result.stop_time, 4)
    ):
        background = image[0, 0]
        edge = np.vstack([image[0], image[-1], image[:, 0], image[:, -1]])
        assert (edge == background).all()
        assert (image != background).any(axis=2).mean() > 0.02


@pytest.mark.long
def test_oversampling_smooths_edges_and_keeps_the_size(result):
    plain, smooth = (
        next(Studio(result, height=90, oversampling=n).images(np.zeros(1))) for n in (1, 3)
    )

    assert plain.shape == smooth.shape
    assert len(np.unique(smooth.reshape(-1, 3), axis=0)) > len(
        np.unique(plain.reshape(-1, 3), axis=0)
    )
    assert changed(plain, smooth) < 0.2


@pytest.mark.long
def test_the_video_plays_the_run(result, tmp_path):
    from imageio_ffmpeg import read_frames

    reader = read_frames(str(save_video(result, tmp_path / "run.mp4", frames_per_second=10)))
    size = next(reader)["size"]
    frames = [np.frombuffer(frame, np.uint8).reshape(size[1], size[0], 3) for frame in reader]
    assert len(frames) == 7
    assert changed(frames[0], frames[-1]) > 0.03


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_video_that_breaks_off_is_said_and_leaves_the_old_one(result, tmp_path, monkeypatch):
    import imageio_ffmpeg

    file, write_frames = tmp_path / "run.mp4", imageio_ffmpeg.write_frames

    def to_a_full_disk(work, *given, **options):
        Path(work).symlink_to("/dev/full")
        return write_frames(work, *given, **{**options, "output_params": ["-f", "mpegts"]})

    file.write_text("old")
    monkeypatch.setattr(imageio_ffmpeg, "write_frames", to_a_full_disk)
    with pytest.raises(OutputError, match=r"run\.mp4 cannot be written"):
        save_video(result, file, frames_per_second=10)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_missing_package_is_named_with_what_to_type(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        SimrobError, match=r'a video needs the extra video: pip install "imageio-ffmpeg>='
    ):
        save_video(result, tmp_path / "run.mp4")


def test_what_cannot_be_drawn_is_said(result, tmp_path):
    with pytest.raises(InvalidParameter, match="frames"):
        save_film_strip(result, tmp_path / "strip.png", frames=1)
    with pytest.raises(InvalidParameter, match="frames_per_second"):
        save_video(result, tmp_path / "run.mp4", frames_per_second=float("nan"))
    with pytest.raises(OutputError, match="nowhere"):
        save_film_strip(result, tmp_path / "nowhere" / "strip.png", frames=2, height=30)
    with pytest.raises(OutputError, match="nowhere"):
        save_video(result, tmp_path / "nowhere" / "run.mp4")
