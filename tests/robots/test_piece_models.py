"""The pieces of the package: their sizes, frames, masses and meshes."""

import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from simrob_drake.base.files import models_root
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.robots.pieces import (
    PieceModel,
    described_piece,
    piece_file,
    piece_names,
    solid_inertia,
)
from tests.robots.known_pieces import load_piece

PIECES = models_root() / "pieces"
MESHES = sorted(PIECES.glob("*/*.obj"))

# Bounding boxes of the library's meshes, lowest and highest x y z [mm]: facts of the IRB120, section 6.
CHESS_BOARD = ((-27.5, -22.5, -20), (422.5, 427.5, 2))
SIZES = {
    "gripper": ((-47, -39.78, 0), (47, 39.78, 85)),
    "long_gripper": ((-47, -39.78, 0), (47, 39.78, 157)),
    "vacuum_cup": ((-51.93, -30.78, 0), (51.6, 30.74, 42.63)),
    "pencil": ((-30, -24, 0), (35, 24, 147.4)),
    "pawn": ((-22.5, -22.5, -5), (22.5, 22.5, 45)),
    "rook": ((-22.5, -22.5, -5), (22.5, 22.5, 55)),
    "knight": ((-22.5, -22.5, -5), (22.5, 22.5, 66.01)),
    "bishop": ((-22.5, -22.5, -5), (22.5, 22.5, 71)),
    "queen": ((-22.5, -22.5, -5), (22.5, 22.5, 77.84)),
    "king": ((-22.5, -22.5, -5), (22.5, 22.5, 87)),
    "half_die": ((-14, -14, 0), (14, 14, 28)),
    "die": ((-28, -28, 0), (28, 28, 56)),
    "chess_board": CHESS_BOARD,
    "board": CHESS_BOARD,
    "inclined_table": ((150, -500, 0), (746.4, 133, 100)),
    "half_sphere": ((-150, -150, 0), (150, 149.9, 149.2)),
    "cylinder": ((-125, -125, -150), (125, 125, 150)),
    "pencil_holder": ((-246, -90, 0), (246, 90, 144)),
    "bar_10": ((-30, -24, 0), (30, 24, 158)),
    "bar_15": ((-30, -24, 0), (30, 24, 148)),
    "bar_20": ((-30, -24, 0), (30, 24, 198)),
    "bar_30": ((-30, -24, 0), (30, 24, 298)),
    "bottle": ((2.437, 19.85, 1.909), (89.49, 315.6, 88.54)),
    "bar_box": ((-50, 0, 0), (90, 300, 200)),
    "fruit_box": ((-216, 0, -144), (216, 162.3, 144)),
    "pallet": ((-240, -240, 0), (240, 240, 57.6)),
    "belt": ((0, -10, -140), (200, 1510, 20)),
}


def outline(piece: PieceModel) -> np.ndarray:
    """Return points on the surfaces of a piece's shapes, in its frame, shape (n, 3)."""
    turn = np.linspace(0, 2 * np.pi, 181)
    points = []
    for shape in piece.shapes:
        if shape.box is not None:
            own = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.box
        elif shape.cylinder is not None:
            radius, length = shape.cylinder
            rim = np.stack(
                [radius * np.cos(turn), radius * np.sin(turn), np.full_like(turn, length / 2)],
                axis=1,
            )
            own = np.vstack([rim, rim * (1, 1, -1)])
        else:
            own = vertices(piece.folder / str(shape.mesh))
        points.append(transform_from_pose(shape.pose) @ own.T)
    return np.hstack(points).T


def vertices(file: Path) -> np.ndarray:
    return np.array(ReadObjToTriangleSurfaceMesh(str(file)).vertices())


def test_every_piece_has_a_size_here() -> None:
    assert set(SIZES) <= set(piece_names())


@pytest.mark.parametrize("name", SIZES)
def test_a_piece_has_size_and_origin_of_the_original(name: str) -> None:
    points = outline(load_piece(name))
    np.testing.assert_allclose(
        [points.min(axis=0), points.max(axis=0)], np.array(SIZES[name]) * 1e-3, atol=1e-3
    )


@pytest.mark.parametrize("file", MESHES, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_a_mesh_is_closed_and_small(file: Path) -> None:
    import trimesh

    mesh = trimesh.load_mesh(file, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    if file.parent.name != "chess_board":  # its squares touch along edges
        assert mesh.is_watertight
    assert file.stat().st_size < 300_000


def test_all_meshes_together_are_small() -> None:
    assert sum(file.stat().st_size for file in MESHES) < 2_000_000


@pytest.mark.long
def test_the_meshes_are_what_the_script_makes(tmp_path: Path) -> None:
    subprocess.run([sys.executable, PIECES / "make_meshes.py", tmp_path], check=True)
    made = {file.relative_to(tmp_path): file.read_bytes() for file in tmp_path.rglob("*.obj")}
    assert made == {file.relative_to(PIECES): file.read_bytes() for file in MESHES}


@pytest.mark.parametrize(
    "name", [name for name in piece_names() if described_piece(piece_file(name)).density]
)
def test_a_mass_is_volume_times_density(name: str) -> None:
    described, piece = described_piece(piece_file(name)), load_piece(name)
    volume = solid_inertia(
        [shape.solid(piece.folder) for shape in piece.shapes], closed=True
    ).volume

    assert described.density is not None
    assert piece.mass == pytest.approx(described.density * volume, rel=1e-12)

    points = outline(piece)
    assert (points.min(axis=0) < piece.com).all()
    assert (piece.com < points.max(axis=0)).all()


# By hand from the sizes: a die (rounded edges take 3.5 % off), a wedge, shells less their holes (with few facets on
# the inside, which makes them thicker by some percent), boxes and cylinders, a bottle with shoulders.
@pytest.mark.parametrize(
    ("name", "mass", "tolerance"),
    [
        ("die", 700 * 0.056**3, 0.04),
        ("half_die", 700 * 0.028**3, 0.04),
        ("inclined_table", 700 * 0.5 * 0.5 * 0.4 * 0.1, 1e-4),
        (
            "half_sphere",
            1100 * (2 / 3 * np.pi * (0.15**3 - 0.144**3) - 17 * np.pi * 0.0155**2 * 0.006),
            0.06,
        ),
        (
            "cylinder",
            1100 * (np.pi * (0.125**2 - 0.119**2) * 0.3 - 24 * np.pi * 0.0155**2 * 0.006),
            0.06,
        ),
        ("chess_board", 700 * (0.45 * 0.45 * 0.022 - 0.4 * 0.4 * 0.002), 1e-4),
        (
            "bar_20",
            1100 * (0.06 * 0.048 * 0.03 + np.pi * (0.02**2 * 0.006 + 0.015**2 * 0.162)),
            1e-6,
        ),
        ("bottle", 1000 * np.pi * 0.0433**2 * 0.2958, 0.3),
    ],
)
def test_a_mass_is_the_one_of_the_sizes(name: str, mass: float, tolerance: float) -> None:
    assert load_piece(name).mass == pytest.approx(mass, rel=tolerance)


def test_chess_figures_weigh_what_wood_does() -> None:
    masses = {
        name: load_piece(name).mass
        for name in ("pawn", "rook", "knight", "bishop", "queen", "king")
    }
    assert min(masses, key=lambda name: masses[name]) == "pawn"
    assert all(0.015 < mass < 0.04 for mass in masses.values())


@pytest.mark.parametrize(
    ("name", "count"), [("half_sphere", 17), ("cylinder", 24), ("pencil_holder", 12)]
)
def test_holes_are_where_their_frames_say_and_free_for_the_pencil(name: str, count: int) -> None:
    piece = load_piece(name)

    holes = {frame: pose for frame, pose in piece.frame_poses.items() if frame != "tcp"}
    assert len(holes) == count

    (mesh,) = [shape.mesh for shape in piece.shapes if shape.mesh is not None]
    points = vertices(piece.folder / mesh)

    for pose in holes.values():
        x, y, z = transform_from_pose(pose).inverse() @ points.T
        wall = (abs(z) < 0.02) & (np.hypot(x, y) < 0.017)
        np.testing.assert_allclose(np.hypot(x, y)[wall], 0.0155, atol=2e-6)  # the file's digits
        assert z[wall].min() < -0.005  # the hole goes on inwards
        # and ends at its mouth; round a bore the surface falls by up to 1 mm
        assert -0.001 < z[wall].max() < 1e-6


def test_holes_point_outwards() -> None:
    for name in ("half_sphere", "cylinder"):
        for frame, values in load_piece(name).frame_poses.items():
            pose = transform_from_pose(values)
            if frame != "tcp":
                outwards = pose.translation() * ((1, 1, 1) if name == "half_sphere" else (1, 1, 0))
                np.testing.assert_allclose(
                    pose.rotation().col(2), outwards / np.linalg.norm(outwards), atol=1e-12
                )


def test_the_holes_of_the_sphere_are_the_frames_of_the_original() -> None:
    frames = load_piece("half_sphere").frame_poses  # Prod(Esf, [0 0 0 | 45 rz, 30 ry, 0])
    for turn, tilt in product(range(8), (30, 60)):
        axis = transform_from_pose([0, 0, 0, np.deg2rad(45 * turn), np.deg2rad(tilt), 0])
        found = transform_from_pose(frames[f"hole_{tilt}_{turn}"])
        np.testing.assert_allclose(found.rotation().matrix(), axis.rotation().matrix(), atol=1e-12)
        np.testing.assert_allclose(found.translation(), axis @ [0, 0, 0.15], atol=1e-12)


def test_squares_of_the_chess_board_are_50_mm_apart() -> None:
    frames = load_piece("chess_board").frame_poses

    for column, row in product(range(8), range(8)):
        expected = [0.025 + 0.05 * column, 0.025 + 0.05 * row, 0.007, 0, 0, 0]
        np.testing.assert_allclose(frames[f"square_{column}_{row}"], expected, atol=1e-12)
    assert len(frames) == 65
    assert frames["tcp"] == frames["square_0_0"]


def test_figures_stand_on_the_squares() -> None:
    board = outline(load_piece("chess_board"))
    assert board[:, 2].max() == pytest.approx(
        0.007 + outline(load_piece("rook"))[:, 2].min(), abs=1e-6
    )


def test_the_inclined_table_has_the_frame_of_three_points() -> None:
    frame = transform_from_pose(load_piece("inclined_table").tcp)

    np.testing.assert_allclose(frame.translation(), [0.4, 0.133, 0.0], atol=1e-12)

    expected = [[-0.5, 0.8365, -0.2241], [-0.8660, -0.4830, 0.1294], [0.0, 0.2588, 0.9659]]
    np.testing.assert_allclose(frame.rotation().matrix(), expected, atol=5e-5)  # facts, section 5
    for point, corner in (
        ((0.15, -0.3, 0.0), (0.5, 0, 0)),
        ((0.7232, -0.0536, 0.1), (0, 0.3864, 0)),
    ):
        np.testing.assert_allclose(frame @ corner, point, atol=1e-4)

    points = frame.inverse() @ outline(load_piece("inclined_table")).T
    assert points[2].max() == pytest.approx(0.0, abs=2e-6)  # the frame lies in the surface


def test_the_carriage_of_the_belt_starts_at_its_tcp() -> None:
    frame = transform_from_pose(load_piece("belt").tcp)
    np.testing.assert_allclose(frame.translation(), [0.1, 0.05, 0.025], atol=1e-12)
    np.testing.assert_allclose(frame.rotation().col(2), [0, 1, 0], atol=1e-12)


def test_the_bottle_has_its_tcp_in_its_foot() -> None:
    frame = transform_from_pose(load_piece("bottle").tcp)
    np.testing.assert_allclose(frame.translation(), [0.045, 0, 0.045], atol=1e-12)
    np.testing.assert_allclose(frame.rotation().col(2), [0, 1, 0], atol=1e-12)
