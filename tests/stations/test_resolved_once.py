"""A run resolves its station once and reads each robot once, and notices files that have changed in between."""

import cProfile
import pstats
import re
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.file_cache import FileCache, file_state
from simrob_drake.base.files import robot_files, text_of
from simrob_drake.stations.resolve import resolve

PACKAGE = Path(__file__).parents[2] / "simrob_drake"

# Calls of the package's functions in f7bae559, of which at most a third may remain.
CALLS_BEFORE = {"sections.py": 2003, "urdf.py": 1867}


@pytest.fixture(scope="module")
def calls():
    """Count the calls of each function of the package in a run, by the name of its module and its own name."""
    # imports modules; the station of the run is another configuration
    resolve(load_station("irb120_dynamic"))
    profile = cProfile.Profile()
    profile.runcall(simulate, "irb120_dynamic", duration=0.1, progress=False)
    counts = Counter()
    for (file, _, function), (_, count, *_) in pstats.Stats(profile).stats.items():
        # Python 3.11 calls comprehensions as functions, newer ones do not.
        is_comprehension = function in ("<listcomp>", "<dictcomp>", "<setcomp>")
        if Path(file).is_relative_to(PACKAGE) and not is_comprehension:
            counts[Path(file).name, function] += count
    return counts


def test_a_run_resolves_its_station_once(calls):
    # The function computes where the axes begin; every resolution calls it.
    assert calls["coupled.py", "starting_positions"] == 1


def test_a_run_reads_sections_and_urdf_with_a_third_of_the_calls(calls):
    counts = Counter()
    for (file, _), count in calls.items():
        counts[file] += count

    assert 0 < counts["sections.py"] <= CALLS_BEFORE["sections.py"] / 3
    together = counts["sections.py"] + counts["urdf.py"]
    assert together <= sum(CALLS_BEFORE.values()) / 3


@pytest.mark.parametrize("station", ["irb120_dynamic", "two_irb120", "humanoid_dynamic"])
def test_a_run_reads_each_robot_once(monkeypatch, station, copied_models, tmp_path):
    """Two robots of the same model share what is read of its files."""
    robots = copied_models(station)
    counts = Counter()

    def counting_text(file, *arguments):
        if Path(file).is_relative_to(tmp_path):
            counts[Path(file).name] += 1
        return text_of(file, *arguments)

    monkeypatch.setattr("simrob_drake.base.yaml_files.text_of", counting_text)
    monkeypatch.setattr("simrob_drake.robots.urdf.text_of", counting_text)
    simulate(load_station(station, robots), duration=0.01, progress=False)

    assert counts["robot.yaml"] == 1
    assert len(counts) == 2, "the description and the URDF"
    assert set(counts.values()) == {1}


@pytest.fixture
def copied_models(tmp_path):
    """Copy the robots of a station, so that no cache has them. Returns overrides that name the copies."""

    def copy(station):
        overrides = {}
        robots = load_station(station).robots
        for name, robot in robots.items():
            folder = robot_files()[str(robot.model)].parent
            target = tmp_path / folder.name
            shutil.copytree(folder, target, dirs_exist_ok=True)
            # Meshes of the package may be shared with other robots; the copy needs none of them.
            for file in target.glob("*.urdf"):
                file.write_text(without_meshes(file.read_text()))
            section = "robot" if list(robots) == ["robot"] else f"robots.{name}"
            overrides[f"{section}.model"] = str(target / "robot.yaml")
        return overrides

    return copy


def without_meshes(text):
    """Replace the meshes of a URDF by small boxes."""
    return re.sub(r"<mesh\b[^>]*/>", '<box size="0.01 0.01 0.01"/>', text)


def test_a_changed_urdf_is_read_again(copied_models):
    config = load_station("irb120_dynamic", copied_models("irb120_dynamic"))
    robot = config.robots[config.only_robot]
    before = resolve(config)
    assert resolve(config) is before

    urdf = Path(robot.model).parent / before.robots[config.only_robot].model.urdf
    limits = before.robots[config.only_robot].model.speed_limits
    urdf.write_text(urdf.read_text().replace('velocity="', 'velocity="1'))

    after = resolve(config)
    assert after is not before
    assert np.all(after.robots[config.only_robot].model.speed_limits > limits)


def test_changed_copies_of_a_configuration_share_its_robots():
    config = load_station("irb120_dynamic")
    changed = config.model_copy(update={"duration": 1.0})

    before, after = resolve(config), resolve(changed)

    assert after is not before
    assert after.robots["robot"].model is before.robots["robot"].model


def test_a_cache_makes_a_value_again_if_a_file_changes_appears_or_vanishes(tmp_path):
    file, missing = tmp_path / "a.txt", tmp_path / "b.txt"
    file.write_text("one")
    made = []

    def make():
        file_state(missing)
        made.append(text_of(file) if file.exists() else "")
        return made[-1]

    cache = FileCache(size=2)
    assert [cache.value("key", make) for _ in range(3)] == ["one"] * 3
    assert made == ["one"]
    file.write_text("three")
    assert cache.value("key", make) == "three"
    missing.write_text("")
    cache.value("key", make)
    assert made == ["one", "three", "three"]
    file.unlink()
    assert cache.value("key", make) == ""


def test_a_cache_around_another_one_notices_the_files_of_both(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("one")
    inner, outer = FileCache(size=2), FileCache(size=2)

    def outer_value():
        return outer.value("outer", lambda: inner.value("inner", lambda: text_of(file)).upper())

    # the value that the outer cache asks for is there already
    inner.value("inner", lambda: text_of(file))
    assert outer_value() == "ONE"
    file.write_text("two!")
    assert outer_value() == "TWO!"


def test_a_cache_keeps_as_many_values_as_it_may_and_no_error():
    cache = FileCache(size=2)
    for key in "abc":
        cache.value(key, lambda key=key: key)
    made = []
    for key in "bca":
        cache.value(key, lambda key=key: made.append(key))
    assert made == ["a"]

    with pytest.raises(ValueError, match="no value"):
        cache.value("d", fail)
    assert cache.value("d", lambda: "now") == "now"


def test_a_cache_drops_the_value_that_was_made_longest_ago(tmp_path):
    """A value that is made again, since its file has changed, is a new one."""
    file = tmp_path / "a.txt"
    file.write_text("one")
    cache = FileCache(size=2)
    cache.value("a", lambda: text_of(file))
    cache.value("b", lambda: "b")
    file.write_text("three")
    cache.value("a", lambda: text_of(file))
    cache.value("c", lambda: "c")

    made = []
    for key in "ac":
        cache.value(key, lambda key=key: made.append(key))
    assert made == []
    cache.value("b", lambda: made.append("b"))
    assert made == ["b"]


def fail():
    raise ValueError("no value")
