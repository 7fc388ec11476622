"""Robots by path: clean ones as they are, others imported once."""

import struct

import pytest

from simrob_drake.importer.cache import CACHE_VARIABLE, import_summary, robot_from_file
from simrob_drake.importer.options import ImportOptions
from simrob_drake.paths import models_root


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "simrob_drake" / "robots"


def test_a_clean_robot_is_read_where_it_lies(cache):
    file = models_root() / "irb120" / "irb120.urdf"
    robot = robot_from_file(file)
    assert robot.urdf_path == file
    assert import_summary(robot) == ""
    assert not cache.exists()


def test_a_published_robot_is_imported_once(published_irb120, cache):
    first = robot_from_file(published_irb120)
    stamp = first.urdf_path.stat().st_mtime_ns
    second = robot_from_file(published_irb120)
    assert second == first
    assert second.urdf_path.stat().st_mtime_ns == stamp
    assert len(list(cache.iterdir())) == 1
    assert "6 defaulted" in import_summary(second) or "defaulted" in import_summary(second)
    assert "arm" not in first.folder.name  # the names of the cache are never the file's


@pytest.mark.parametrize("change", ["urdf", "mesh", "options", "description"])
def test_any_change_imports_anew(published_irb120, cache, change):
    robot_from_file(published_irb120)
    options = None
    if change == "urdf":
        published_irb120.write_text(published_irb120.read_text().replace("6.215", "7.0"))
    elif change == "mesh":
        mesh = next(published_irb120.parent.parent.glob("meshes/*.STL"))
        data = bytearray(mesh.read_bytes())
        data[84 + 12 : 84 + 16] = struct.pack("<f", 0.0123)  # one coordinate
        mesh.write_bytes(bytes(data))
    elif change == "options":
        options = ImportOptions(collision="box")
    else:
        lines = "urdf: arm.urdf\nroot: base_link\naxes: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]\n"
        (published_irb120.parent / "robot.yaml").write_text(lines)
    robot_from_file(published_irb120, options)
    assert len(list(cache.iterdir())) == 2


def test_options_import_even_a_clean_robot(cache):
    robot = robot_from_file(models_root() / "irb120" / "irb120.urdf", ImportOptions(base="floating"))
    assert robot.folder.is_relative_to(cache)
