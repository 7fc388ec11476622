"""Pieces at places of chance: as many as asked, apart, within their box, and the same ones for the same seed."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_yaml

WITHIN = "[[0.1, -0.2, 0.02], [0.5, 0.2, 0.05]]"


def scattered(folder: Path, keys: str, rest: str = "", overrides: dict[str, Any] | None = None) -> StationConfig:
    """Return a station of free cubes that are scattered so."""
    text = (
        f"pieces:\n  cube: {{scatter: {{within: {WITHIN}, {keys}}}}}\n{rest}contact: {{}}\nsolver: {{kind: discrete}}\n"
    )
    (folder / "own.yaml").write_text(text)
    return load_station(folder / "own.yaml", overrides)


def poses(config: StationConfig) -> list[Any]:
    return [transform_from_pose(piece.pose) for piece in config.pieces.values()]


def test_they_lie_apart_within_their_box(tmp_path: Path) -> None:
    config = scattered(tmp_path, "count: 12, apart: 0.08, turn_deg: [0, 30], seed: 5")
    assert list(config.pieces) == [f"cube_{number}" for number in range(1, 13)]
    assert all(piece.free and piece.model == "cube" for piece in config.pieces.values())
    places = np.array([pose.translation() for pose in poses(config)])
    assert (places >= [0.1, -0.2, 0.02]).all()
    assert (places <= [0.5, 0.2, 0.05]).all()
    assert np.ptp(places[:, :2], axis=0).min() > 0.2  # all over it
    assert min(np.linalg.norm(one - other) for one, other in combinations(places, 2)) >= 0.08
    turns = [pose.rotation().ToRollPitchYaw().vector() for pose in poses(config)]
    np.testing.assert_allclose(np.array(turns)[:, :2], 0.0, atol=1e-12)
    assert 0 <= min(turn[2] for turn in turns) < max(turn[2] for turn in turns) <= np.deg2rad(30)


def test_a_seed_tells_all(tmp_path: Path) -> None:
    one, same = (scattered(tmp_path, "count: 3, tumbled: true, seed: 1") for _ in range(2))
    other = scattered(tmp_path, "count: 3, tumbled: true, seed: 1", overrides={"pieces.cube.scatter.seed": 2})
    assert one == same
    assert one.pieces["cube_1"].pose != other.pieces["cube_1"].pose
    up = [pose.rotation().matrix()[2, 2] for pose in poses(one)]
    assert max(abs(value) for value in up) < 1 - 1e-3  # no side is up


def test_what_is_saved_has_the_places(tmp_path: Path) -> None:
    config = scattered(tmp_path, "count: 3, seed: 1")
    (tmp_path / "saved.yaml").write_text(station_yaml(config))
    assert load_station(tmp_path / "saved.yaml") == config


@pytest.mark.parametrize(
    ("keys", "rest", "message"),
    [
        ("count: 100, apart: 0.2", "", r"cube\.scatter has room for \d+ of 100: give it a larger box, or less apart"),
        ("count: 0", "", r"pieces\.cube\.scatter\.count"),
        ("count: 2, turn_deg: [30, 0]", "", "within and turn_deg have the lower values first"),
        ("count: 2", "  cube_2: {model: cube, free: true}\n", "cube_2 stands there, and would be one of the scattered"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path: Path, keys: str, rest: str, message: str) -> None:
    with pytest.raises(InvalidConfig, match=message):
        scattered(tmp_path, keys, rest)


def test_their_poses_are_drawn(tmp_path: Path) -> None:
    with pytest.raises(InvalidConfig, match="leave parent and pose out"):
        scattered(tmp_path, "count: 2", overrides={"pieces.cube.pose": [0, 0, 1, 0, 0, 0]})
