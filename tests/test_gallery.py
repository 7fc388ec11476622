"""The gallery shows every station, and its page is what its script writes."""

from runpy import run_path

import pytest
from PIL import Image

from simrob_drake import station_names
from simrob_drake.files import models_root
from simrob_drake.robots.catalog import robot_names
from tests.test_readme import PAGES, ROOT

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
    assert {file.stem for file in (ROOT / "docs" / "gallery").iterdir()} == set(station_names())


@pytest.mark.parametrize("robot", robot_names())
def test_a_robot_has_a_small_portrait(robot):
    portrait = models_root() / robot / "picture.png"
    assert Image.open(portrait).size == (GALLERY["SIDE"], GALLERY["SIDE"])
    assert portrait.stat().st_size < 5_000


def test_a_picture_shows_what_its_command_does(monkeypatch, tmp_path):
    monkeypatch.setitem(GALLERY["save_picture"].__globals__, "DOCS", tmp_path)
    (tmp_path / "gallery").mkdir()
    (run,) = GALLERY["shown"]("irb120_on_belt")
    assert run["q.belt"][-1] == pytest.approx(0.9)
    assert GALLERY["save_picture"]("irb120_on_belt").stat().st_size < 60_000
