"""Pieces at random poses: the requested count, apart from each other, within their box, and equal for equal seeds."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_yaml

# Opposite corners of the box in which the cubes are [m].
LOWEST = [0.1, -0.2, 0.02]
HIGHEST = [0.5, 0.2, 0.05]
WITHIN = f"[{LOWEST}, {HIGHEST}]"


def scattered(
    folder: Path, keys: str, rest: str = "", overrides: dict[str, Any] | None = None
) -> StationConfig:
    """Load a station of free cubes with keys of their section ``scatter``, and further text of the file."""
    cube = f"  cube: {{scatter: {{within: {WITHIN}, {keys}}}}}"
    text = f"pieces:\n{cube}\n{rest}contact: {{}}\nsolver: {{kind: discrete}}\n"
    (folder / "own.yaml").write_text(text)
    return load_station(folder / "own.yaml", overrides)


def poses(config: StationConfig) -> list[Any]:
    """Initial poses of the pieces in the world."""
    return [transform_from_pose(piece.pose) for piece in config.pieces.values()]


@pytest.fixture
def dozen(tmp_path: Path) -> StationConfig:
    """Twelve cubes, 0.08 m apart, turned by 0 to 30 degrees."""
    return scattered(tmp_path, "count: 12, apart: 0.08, turn_deg: [0, 30], seed: 5")


def test_copies_are_free_and_numbered(dozen: StationConfig) -> None:
    """Each copy is a free piece of the same model, named after the piece with a number from 1."""
    assert list(dozen.pieces) == [f"cube_{number}" for number in range(1, 13)]
    assert all(piece.free and piece.model == "cube" for piece in dozen.pieces.values())


def test_they_lie_apart_within_their_box(dozen: StationConfig) -> None:
    """Positions are inside of the box, spread over it, and no two are nearer than asked for."""
    positions = np.array([pose.translation() for pose in poses(dozen)])

    assert (positions >= LOWEST).all()
    assert (positions <= HIGHEST).all()
    assert np.ptp(positions[:, :2], axis=0).min() > 0.2
    distances = [np.linalg.norm(one - other) for one, other in combinations(positions, 2)]
    assert min(distances) >= 0.08


def test_they_are_turned_about_the_vertical_within_their_range(dozen: StationConfig) -> None:
    """Roll and pitch are zero, and the yaw differs between 0 and 30 degrees."""
    angles = np.array([pose.rotation().ToRollPitchYaw().vector() for pose in poses(dozen)])

    np.testing.assert_allclose(angles[:, :2], 0.0, atol=1e-12)
    yaws = angles[:, 2]
    assert 0 <= yaws.min() < yaws.max() <= np.deg2rad(30)


def test_a_seed_determines_the_poses(tmp_path: Path) -> None:
    """The same seed gives an equal station, another seed other poses."""
    keys = "count: 3, tumbled: true, seed: 1"

    first = scattered(tmp_path, keys)
    same = scattered(tmp_path, keys)
    other = scattered(tmp_path, keys, overrides={"pieces.cube.scatter.seed": 2})

    assert first == same
    assert first.pieces["cube_1"].pose != other.pieces["cube_1"].pose


def test_tumbled_pieces_have_no_side_up(tmp_path: Path) -> None:
    """The z axis of a tumbled piece is not along the world's z axis."""
    config = scattered(tmp_path, "count: 3, tumbled: true, seed: 1")

    cosines = [pose.rotation().matrix()[2, 2] for pose in poses(config)]

    assert max(abs(cosine) for cosine in cosines) < 1 - 1e-3


def test_what_is_saved_has_the_places(tmp_path: Path) -> None:
    """A saved station has the copies with their poses, and is equal when it is loaded."""
    config = scattered(tmp_path, "count: 3, seed: 1")
    (tmp_path / "saved.yaml").write_text(station_yaml(config))
    assert load_station(tmp_path / "saved.yaml") == config


@pytest.mark.parametrize(
    ("keys", "rest", "message"),
    [
        (
            "count: 100, apart: 0.2",
            "",
            r"cube\.scatter has room for only \d+ of 100 pieces; enlarge within, or reduce apart",
        ),
        ("count: 0", "", r"pieces\.cube\.scatter\.count"),
        ("count: 2, turn_deg: [30, 0]", "", "in within and turn_deg, the lower values come first"),
        (
            "count: 2",
            "  cube_2: {model: cube, free: true}\n",
            "the piece cube_2 exists already, and a copy of",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    tmp_path: Path, keys: str, rest: str, message: str
) -> None:
    with pytest.raises(InvalidConfig, match=message):
        scattered(tmp_path, keys, rest)


def test_their_poses_are_drawn(tmp_path: Path) -> None:
    with pytest.raises(InvalidConfig, match="leave parent and pose out"):
        scattered(tmp_path, "count: 2", overrides={"pieces.cube.pose": [0, 0, 1, 0, 0, 0]})
