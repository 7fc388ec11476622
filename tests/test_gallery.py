"""The gallery shows every station, and its page is what its script writes."""

import re
from itertools import combinations
from runpy import run_path

import numpy as np
import pytest
from PIL import Image

from simrob_drake import simulate, station_names
from simrob_drake.base.files import models_root
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.robots.catalog import robot_names
from tests.test_readme import PAGES, ROOT

ALIKE = 60  # of 255
GALLERY = run_path(str(ROOT / "docs" / "gallery.py"))


def test_the_page_is_up_to_date():
    assert PAGES["docs/gallery.md"] == GALLERY["page"]()


@pytest.mark.parametrize("station", station_names())
def test_a_station_has_a_small_picture_and_a_command(station):
    picture = ROOT / "docs" / "gallery" / f"{station}.png"

    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size < 60_000

    command = GALLERY["command"](station)
    assert command.startswith("simrob") or (ROOT / command.split()[1]).is_file()


def test_the_pictures_are_those_of_the_stations():
    files = [file.name for file in (ROOT / "docs" / "gallery").iterdir()]
    pictures, clips = (
        {f"{name}.{kind}" for name in of}
        for kind, of in (("png", station_names()), ("webp", GALLERY["CLIPS"]))
    )
    assert set(files) == pictures | clips


@pytest.mark.parametrize("station", GALLERY["CLIPS"])
def test_a_clip_is_short_small_and_begins_again(station):
    file = ROOT / "docs" / "gallery" / f"{station}.webp"

    assert file.stat().st_size < 400_000

    clip = Image.open(file)
    assert clip.size == GALLERY["CLIP"]
    assert clip.info["loop"] == 0  # for ever
    assert 10 < clip.n_frames <= GALLERY["MOST_FRAMES"]

    first = np.asarray(clip.convert("RGB"), dtype=int)
    clip.seek(clip.n_frames // 2)

    assert np.abs(np.asarray(clip.convert("RGB"), dtype=int) - first).max() > 100  # something moves


def test_there_are_twelve_clips_and_both_front_pages_show_four():
    assert len(GALLERY["CLIPS"]) == 12

    shown = {
        page: re.findall(r"docs/gallery/(\w+)\.webp", PAGES[page])
        for page in ("README.md", "README.es.md")
    }
    assert shown["README.md"] == shown["README.es.md"]
    assert len(set(shown["README.md"])) == 4
    assert set(shown["README.md"]) <= set(GALLERY["CLIPS"])


def test_no_two_pictures_are_alike():
    """Made as small as icons, they still differ clearly where they differ most."""
    icons = {
        station: np.asarray(
            Image.open(ROOT / "docs" / "gallery" / f"{station}.png").convert("L").resize((48, 16)),
            float,
        )
        for station in station_names()
    }
    for (one, first), (other, second) in combinations(icons.items(), 2):
        assert np.percentile(np.abs(first - second), 95) > ALIKE, (one, other)


@pytest.mark.parametrize("robot", robot_names())
def test_a_robot_has_a_small_portrait(robot):
    portrait = models_root() / robot / "picture.png"
    assert Image.open(portrait).size == (GALLERY["SIDE"], GALLERY["SIDE"])
    assert portrait.stat().st_size < 5_000


def test_a_picture_shows_what_its_command_does(monkeypatch, tmp_path):
    monkeypatch.setitem(GALLERY["save_pictures"].__globals__, "DOCS", tmp_path)
    (tmp_path / "gallery").mkdir()

    (run,) = GALLERY["shown"]("irb120_on_belt")

    assert run["q.belt"][-1] == pytest.approx(0.9)

    (picture,) = GALLERY["save_pictures"]("irb120_on_belt")
    assert picture.stat().st_size < 60_000


@pytest.mark.long
def test_a_walk_is_one_picture_with_the_robot_at_several_places_from_left_to_right():
    motion = walk("zjudancer", 6)
    run = simulate(motion.station(), reference=motion.trajectory(), progress=False)

    picture = np.asarray(GALLERY["walk_picture"](run, height=60).convert("RGB"), dtype=int)[:60]

    blue = (picture[..., 2] > picture[..., 0] + 60).any(axis=0)  # the robot is
    assert np.ptp(np.flatnonzero(blue)) > 0.4 * picture.shape[1]
