"""Robots by path: clean ones as they are, others imported once."""

import re
import struct

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.files import models_root
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.importer import importing
from simrob_drake.importer.importing import import_summary, robot_from_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.simulation import simulate
from simrob_drake.stations.load import load_station


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


@pytest.mark.long
def test_of_two_that_import_at_once_the_first_wins(published_irb120, cache, monkeypatch):
    first = []

    def meanwhile(*_args):
        monkeypatch.setattr(importing, "probe", lambda *_args: None)
        first.append(robot_from_file(published_irb120).folder.stat().st_ino)

    monkeypatch.setattr(importing, "probe", meanwhile)
    assert robot_from_file(published_irb120).folder.stat().st_ino == first[0]
    assert len(list(cache.iterdir())) == 1


@pytest.mark.long
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


@pytest.mark.long
def test_a_correction_of_the_importer_imports_anew(published_irb120, cache, tmp_path, monkeypatch):
    robot_from_file(published_irb120)
    (tmp_path / "code").mkdir()
    monkeypatch.setattr("simrob_drake.importer.importing._CODE", [tmp_path / "code"])
    robot_from_file(published_irb120)
    (tmp_path / "code" / "gains.py").write_text("_FREQUENCY = 31.0")

    robot_from_file(published_irb120)

    assert len(list(cache.iterdir())) == 3


def test_options_import_even_a_clean_robot(cache):
    robot = robot_from_file(
        models_root() / "irb120" / "irb120.urdf", ImportOptions(base="floating")
    )
    assert robot.folder.is_relative_to(cache)


@pytest.mark.long
def test_a_published_arm_moves_by_torque_as_ours_does(published_irb120):
    """The defaults of its motors suffice for the move, so nothing but the visuals is different."""
    ours = simulate(load_station("irb120_dynamic"), progress=False)
    theirs = simulate(
        load_station("irb120_dynamic", {"robot.urdf": str(published_irb120)}), progress=False
    )

    assert theirs.config.robots["robot"].urdf == published_irb120
    np.testing.assert_allclose(theirs.axes("q")[-1], ours.axes("q")[-1], atol=1e-6)
    np.testing.assert_allclose(theirs.axes("tau")[-1], ours.axes("tau")[-1], atol=1e-4)


@pytest.mark.long
def test_a_robot_without_inertias_is_refused_by_name_for_motion_by_torque(published_irb120):
    text = re.sub(r"<inertial>.*?</inertial>", "", published_irb120.read_text(), flags=re.DOTALL)
    published_irb120.write_text(text)

    robot = {"robot.urdf": str(published_irb120), "pieces": {}}
    with pytest.raises(
        InvalidModel,
        match=r"arm\.urdf: the moving links link_1, link_2, .*estimate_inertia to true",
    ):
        simulate(load_station("irb120_dynamic", robot), duration=0.1, progress=False)

    estimated = load_station(
        "irb120_dynamic", robot | {"robot.import_options": {"estimate_inertia": True}}
    )
    assert simulate(estimated, duration=0.3, progress=False).ending == "completed"
    assert (
        simulate(load_station("irb120_kinematic", robot), duration=0.3, progress=False).ending
        == "completed"
    )
