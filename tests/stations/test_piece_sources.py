"""Pieces of a station: of the package, of a folder of the user's own, and from mesh files."""

import contextlib
import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from simrob_drake.base.errors import InvalidConfig, InvalidModel, OutputError, SimrobError
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.importer.meshes.checks import MESH_FORMATS
from simrob_drake.importer.meshes.library import drake_mesh
from simrob_drake.robots.pieces import PieceModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import build_station

SIDES = np.array([0.1, 0.2, 0.3])


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep converted meshes out of the user's cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


def box_file(folder: Path, name: str, scale: float = 1.0) -> Path:
    """Write a box from the origin into the first octant."""
    mesh = trimesh.creation.box(SIDES * scale)
    mesh.apply_translation(SIDES * scale / 2)
    if name.endswith((".glb", ".gltf")):  # whose y points upwards
        mesh.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    mesh.export(folder / name)
    return folder / name


def station(folder: Path, pieces: str, overrides: dict[str, Any] | None = None) -> StationConfig:
    """Load a station whose robot carries a piece, unless the entry of the piece has another parent."""
    hung = (
        pieces
        if "parent" in pieces or "free" in pieces
        else pieces.replace("{", "{parent: robot, ", 1)
    )
    (folder / "own.yaml").write_text(
        f"robot: {{model: double_pendulum}}\npieces:\n  part: {hung}\n"
    )
    return load_station(folder / "own.yaml", overrides)


def piece_model(config: StationConfig) -> PieceModel:
    return resolve(config).pieces["part"].model


def part(folder: Path, section: str) -> PieceModel:
    return piece_model(station(folder, section))


@pytest.mark.parametrize("kind", MESH_FORMATS)
def test_a_mesh_of_every_format_becomes_a_piece(tmp_path: Path, kind: str) -> None:
    box_file(tmp_path, f"box{kind}")
    model = part(tmp_path, f"{{mesh: box{kind}, density: 1000, colour: [1, 0, 0, 1]}}")

    # glTF and STL hold single precision
    assert model.mass == pytest.approx(1000 * SIDES.prod(), rel=1e-5)
    np.testing.assert_allclose(model.com, SIDES / 2, atol=1e-6)
    moments = model.mass / 12 * (SIDES @ SIDES - SIDES**2)
    np.testing.assert_allclose(model.inertia, [*moments, 0, 0, 0], atol=1e-6)
    assert model.colour == (1, 0, 0, 1)


def test_millimetres_are_scaled(tmp_path: Path) -> None:
    box_file(tmp_path, "box.stl", scale=1000)
    model = part(tmp_path, "{mesh: box.stl, scale: 0.001, mass: 3}")

    assert model.mass == 3
    np.testing.assert_allclose(model.com, SIDES / 2, atol=1e-6)
    np.testing.assert_allclose(model.inertia[:3], 3 / 12 * (SIDES @ SIDES - SIDES**2), atol=1e-6)


def test_faces_that_look_inwards_are_turned(tmp_path: Path) -> None:
    mesh = trimesh.creation.box(SIDES)
    mesh.invert()

    mesh.export(tmp_path / "box.stl")

    assert part(tmp_path, "{mesh: box.stl, density: 1000}").mass == pytest.approx(6.0, rel=1e-5)


def test_a_mesh_that_is_only_seen_weighs_nothing(tmp_path: Path) -> None:
    box_file(tmp_path, "box.stl")
    assert part(tmp_path, "{mesh: box.stl, parent: world}").mass == 0
    assert part(tmp_path, "{mesh: box.stl, mass: 0}").mass == 0


@pytest.mark.parametrize(
    ("entry", "seen"),
    [
        ("{mesh: box.stl, parent: robot}", ", 0 if the piece is only visible"),
        ("{mesh: box.stl, free: true}", ""),
        ("{sphere: 0.1, free: true}", ""),
    ],
)
def test_what_a_robot_carries_or_falls_says_what_it_weighs(
    tmp_path: Path, entry: str, seen: str
) -> None:
    box_file(tmp_path, "box.stl")
    with pytest.raises(
        SimrobError, match=rf"pieces\.part\.mass is None; .* a mass \[kg\]{seen}; or give a density"
    ):
        station(tmp_path, entry)


def test_a_box_has_the_mass_and_inertia_of_its_volume(tmp_path: Path) -> None:
    """A box of a density has m = rho a b c, and about x the inertia m / 12 (b² + c²)."""
    box = part(tmp_path, "{box: [0.1, 0.2, 0.3], density: 1000}")

    assert box.mass == pytest.approx(6.0)
    np.testing.assert_allclose(box.inertia[:3], box.mass / 12 * (SIDES @ SIDES - SIDES**2))


def test_a_cylinder_has_the_mass_of_its_volume(tmp_path: Path) -> None:
    """A cylinder of a density has m = rho pi r² l."""
    cylinder = part(tmp_path, "{cylinder: [0.1, 0.2], density: 1000}")

    assert cylinder.mass == pytest.approx(1000 * np.pi * 0.1**2 * 0.2)


def test_a_ball_has_the_inertia_of_its_mass(tmp_path: Path) -> None:
    """A full ball has the inertia 2/5 m r² about each axis."""
    ball = part(tmp_path, "{sphere: 0.1, mass: 2}")

    np.testing.assert_allclose(ball.inertia[:3], 2 / 5 * 2 * 0.1**2)


def test_several_shapes_have_one_centre_of_mass(tmp_path: Path) -> None:
    """Two equal balls have their centre of mass in the middle between them."""
    two_balls = part(
        tmp_path, "{shapes: [{sphere: 0.1, pose: [1, 0, 0, 0, 0, 0]}, {sphere: 0.1}], mass: 2}"
    )

    np.testing.assert_allclose(two_balls.com, [0.5, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{box: [1, 1, 1], sphere: 1, mass: 1}", "only one of box and sphere"),
        ("{box: [1, 1, 1], model: cube, mass: 1}", "only one of model and box"),
        ("{shapes: [{mesh: a.obj}], mass: 1}", "give a mesh under the key mesh"),
        ("{box: [1, 1], mass: 1}", r"pieces\.part\.box"),
    ],
)
def test_a_piece_is_one_thing(tmp_path: Path, entry: str, message: str) -> None:
    with pytest.raises(InvalidConfig, match=message):
        station(tmp_path, entry)


def test_a_mesh_without_unit_and_scale_is_no_mountain(tmp_path: Path) -> None:
    for name in ("box.stl", "box.obj", "box.ply", "box.off"):
        box_file(tmp_path, name, scale=150)
        with pytest.raises(
            SimrobError,
            match=r"pieces\.part\.scale is None; .* 0\.001 for millimetres, or 1 if the mesh is",
        ):
            station(tmp_path, f"{{mesh: {name}, density: 2700}}")
    assert part(tmp_path, "{mesh: box.stl, scale: 0.001, density: 2700}").mass < 0.1
    assert part(tmp_path, "{mesh: box.stl, scale: 1, density: 2700}").mass > 1e6

    box_file(tmp_path, "box.glb", scale=10)  # glTF is in metres
    assert part(tmp_path, "{mesh: box.glb, density: 1}").mass == pytest.approx(
        1000 * SIDES.prod(), rel=1e-5
    )


def test_figures_of_the_station_replace_those_of_the_mesh(tmp_path: Path) -> None:
    box_file(tmp_path, "box.stl")
    model = part(
        tmp_path,
        "{mesh: box.stl, mass: 2, com: [0, 0, 1], inertia: [1, 1, 1], tcp: [0, 0, 0.3, 0, 0, 0]}",
    )

    assert (model.mass, model.com, model.inertia) == (2, (0, 0, 1), (1, 1, 1))
    assert model.frame_poses["tcp"] == (0, 0, 0.3, 0, 0, 0)


def test_the_piece_stands_in_the_plant(tmp_path: Path) -> None:
    box_file(tmp_path, "box.stl")
    config = station(
        tmp_path, "{mesh: box.stl, density: 1000, parent: world, pose: [1, 0, 0, 0, 0, 0]}"
    )

    plant = build_station(config).GetSubsystemByName("plant")

    assert plant.GetBodyByName("part").default_mass() == pytest.approx(6.0, rel=1e-5)


def test_a_mesh_is_converted_once_for_its_content(tmp_path: Path, cache: Path) -> None:
    first = drake_mesh(box_file(tmp_path, "a.stl"))

    assert first.is_relative_to(cache / "simrob_drake" / "pieces")
    assert "a" not in first.stem

    written = first.stat().st_mtime_ns
    assert drake_mesh(box_file(tmp_path, "b.stl")) == first
    assert first.stat().st_mtime_ns == written
    assert drake_mesh(box_file(tmp_path, "a.stl", scale=2)) != first
    assert {file.name for file in first.parent.iterdir()} == {"mesh.obj"}


@pytest.mark.parametrize("large", ["box.gltf", "gltf_buffer_0.bin"])
def test_a_mesh_that_is_too_large_is_not_even_read(tmp_path: Path, large: str) -> None:
    file = box_file(tmp_path, "box.gltf")
    os.truncate(tmp_path / large, 1_000_000_000)  # a hole, which takes no room on the disk
    with pytest.raises(
        InvalidModel, match=r"box\.gltf: cannot be read \(it is larger than 100 MB\)"
    ):
        drake_mesh(file)


def test_the_resolved_station_holds_the_path(tmp_path: Path) -> None:
    box_file(tmp_path, "box.stl")
    config = station(tmp_path, "{mesh: box.stl, density: 1000}")

    assert config.pieces["part"].mesh == tmp_path / "box.stl"

    (tmp_path / "resolved").mkdir()
    (tmp_path / "resolved" / "own.yaml").write_text(station_yaml(config))

    assert load_station(tmp_path / "resolved" / "own.yaml", mesh_path=[tmp_path]) == config


def test_a_folder_of_ones_own_is_a_model(tmp_path: Path) -> None:
    (tmp_path / "peg").mkdir()
    box_file(tmp_path / "peg", "peg.obj")
    (tmp_path / "peg" / "piece.yaml").write_text(
        "density: 100\nframes: {top: [0, 0, 0.3, 0, 0, 0]}\nshapes: [{mesh: peg.obj}]"
    )

    config = station(tmp_path, "{model: peg/piece.yaml, density: 1000}")

    assert piece_model(config).mass == pytest.approx(6.0)
    assert piece_model(config).frame_poses["top"] == (0, 0, 0.3, 0, 0, 0)


def test_a_piece_hangs_on_a_named_frame(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text("""
robot: {model: double_pendulum}
pieces:
  board: {model: chess_board, parent: world, pose: [0.3, -0.1, 0.1, 0.5, 0, 0]}
  rook: {parent: board, frame: square_1_1}
  ball: {model: die, parent: robot, frames: {side: [0.01, 0, 0, 0, 0, 0]}}
  pin: {model: pawn, parent: ball, frame: side}
""")
    plant = build_station(load_station(tmp_path / "own.yaml")).GetSubsystemByName("plant")
    context = plant.CreateDefaultContext()
    board = transform_from_pose([0.3, -0.1, 0.1, 0.5, 0, 0])

    found = plant.GetFrameByName("rook").CalcPoseInWorld(context)

    np.testing.assert_allclose(found.translation(), board @ [0.075, 0.075, 0.007], atol=1e-12)

    pin, side = (
        plant.GetFrameByName(name).CalcPoseInWorld(context) for name in ("pin", "ball_side")
    )
    np.testing.assert_allclose(pin.GetAsMatrix4(), side.GetAsMatrix4(), atol=1e-12)


def test_a_mesh_with_holes_needs_its_mass(tmp_path: Path) -> None:
    mesh = trimesh.creation.box(SIDES)
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)

    mesh.export(tmp_path / "open.stl")

    with pytest.raises(SimrobError, match=r"encloses a volume.*give the mass instead"):
        station(tmp_path, "{mesh: open.stl, density: 1000}")

    model = part(tmp_path, "{mesh: open.stl, mass: 6}")  # as its hull
    np.testing.assert_allclose(model.inertia[:3], 6 / 12 * (SIDES @ SIDES - SIDES**2), atol=1e-6)


WRONG = [
    ("{mesh: none.stl}", r"none\.stl: cannot be read \(No such file"),
    ("{mesh: .}", r"is not a mesh that a piece can have"),
    (
        "{mesh: notes.txt}",
        r"notes\.txt: is not a mesh that a piece can have; the formats are \.stl, ",
    ),
    ("{mesh: empty.stl}", r"empty\.stl: (is |contains no triangles)"),
    *(
        (f"{{mesh: garbage{kind}}}", rf"garbage\{kind}: (is |contains no triangles)")
        for kind in MESH_FORMATS
    ),
    ("{mesh: huge.stl}", r"pieces\.part\.scale is 1\.0; .*now 300 m long.*0\.001 for millimetres"),
    ("{mesh: box.stl, scale: 1e-6}", r"pieces\.part\.scale is 1e-06"),
    ("{mesh: box.stl, scale: -1}", r"pieces\.part\.scale: .*greater than 0"),
    ("{mesh: box.stl, scale: 0}", r"pieces\.part\.scale: .*greater than 0"),
    ("{mesh: box.stl, density: 1, mass: 1}", r"pieces\.part: .*either mass or density"),
    ("{mesh: box.stl, model: rook}", r"pieces\.part: .*only one of model and mesh"),
    ("{model: rook, scale: 2}", r"pieces\.part: .*scale needs the key mesh"),
    ("{mesh: box.stl, density: -1}", r"pieces\.part\.density: .*greater than 0"),
    (
        "{mesh: box.stl, mass: 1, frames: {tcp: [0, 0, 0, 0, 0, 0]}}",
        r"pieces\.part: .*there are two frames 'tcp'",
    ),
    ("{model: rok}", r"there is no piece 'rok'; did you mean 'rook'"),
    ("{model: none/piece.yaml}", r"none/piece\.yaml: cannot be read"),
    ("{model: bad.yaml}", r"bad\.yaml: mas: unknown key; did you mean 'mass'"),
    (
        "{mesh: box.stl, mass: 1, frame: q}",
        r"no tool or link of robot for pieces\.part\.frame 'q'",
    ),
    (
        "{mesh: box.stl, parent: world, frame: tip}",
        r"pieces\.part\.frame: .* world, which has no frames; leave it out",
    ),
]


@pytest.mark.parametrize(("section", "message"), WRONG, ids=[section for section, _ in WRONG])
def test_a_source_that_cannot_be_is_named(tmp_path: Path, section: str, message: str) -> None:
    box_file(tmp_path, "box.stl")
    box_file(tmp_path, "huge.stl", scale=1000)
    (tmp_path / "empty.stl").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("no mesh")
    (tmp_path / "bad.yaml").write_text("mas: 1")

    for kind in MESH_FORMATS:
        (tmp_path / f"garbage{kind}").write_bytes(bytes(range(7, 256)) * 3)

    with pytest.raises(SimrobError, match=message) as caught:
        station(tmp_path, section)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", MESH_FORMATS)
def test_a_mesh_that_is_cut_off_is_refused_or_read_to_its_end(tmp_path: Path, kind: str) -> None:
    file = box_file(tmp_path, f"box{kind}")
    data = file.read_bytes()
    for part_of_it in (0.1, 0.5, 0.9):
        file.write_bytes(data[: int(len(data) * part_of_it)])
        with contextlib.suppress(InvalidModel):
            assert drake_mesh(file).is_file()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path, cache: Path) -> None:
    cache.mkdir()
    cache.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(OutputError, match="cannot be written"):
        drake_mesh(box_file(tmp_path, "box.stl"))


def test_a_cache_whose_place_is_taken_is_named(tmp_path: Path, cache: Path) -> None:
    cache.write_text("no folder")
    with pytest.raises(OutputError, match="cannot be written"):
        drake_mesh(box_file(tmp_path, "box.stl"))


@pytest.mark.long
def test_the_package_is_quick_to_import_without_the_mesh_library() -> None:
    import subprocess
    import sys

    code = "import sys, simrob_drake.stations.poses; sys.exit('trimesh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_wrong_piece_names_the_station(tmp_path: Path) -> None:
    with pytest.raises(InvalidConfig, match=r"own\.yaml"):
        station(tmp_path, "{mesh: none.stl}")
