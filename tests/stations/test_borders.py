"""Files that a station may read: only the user widens the border, never the file; and a result carries copies."""

import os
from pathlib import Path

import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.packages import MESH_PATH_VARIABLE, granted_folders, granting
from simrob_drake.parts import controllers
from simrob_drake.programs.program import Program
from simrob_drake.robots.catalog import load_robot_file
from simrob_drake.stations.file_paths import (
    FILES,
    changes_with_absolute_paths,
    station_with_absolute_path,
    with_copied_files,
)
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.resolve import resolve

BOX = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
URDF = """<robot name="arm"><link name="base"/>
  <link name="tip"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9" velocity="2"/></joint></robot>"""


@pytest.fixture
def places(tmp_path: Path) -> tuple[Path, Path]:
    """The folder of a station, and a folder of the user next to it, whose files the station may not read."""
    own, other = tmp_path / "downloaded", tmp_path / "private"
    for folder in (own, other):
        folder.mkdir()
        (folder / "arm.urdf").write_text(URDF.format(mesh="box.obj"))
        (folder / "box.obj").write_text(BOX)
        (folder / "table.csv").write_text("time,j\n0,0\n1,0.1\n")
    return own, other


def station(folder: Path, text: str) -> Path:
    file = folder / "station.yaml"
    file.write_text(f"mode: kinematic\n{text}")
    return file


OTHERS = {
    "robot.urdf": "robot: {urdf: OTHER/arm.urdf}",
    "robots.a.urdf": "robots: {a: {urdf: OTHER/arm.urdf}}",
    "robot.model": "robot: {model: OTHER/robot.yaml}",
    "robot.import_options.mesh_path": "robot: {urdf: arm.urdf, import_options: {mesh_path: [OTHER]}}",
    "pieces.p.mesh": "robot: {urdf: arm.urdf}\npieces: {p: {mesh: OTHER/box.obj, scale: 1, parent: world}}",
    "pieces.p.model": "robot: {urdf: arm.urdf}\npieces: {p: {model: OTHER/piece.yaml, parent: world}}",
    "reference.file": "robot: {urdf: arm.urdf}\nreference: {kind: table, file: OTHER/table.csv}",
    "robot.reference.file": "robot: {urdf: arm.urdf, reference: {kind: table, file: OTHER/table.csv}}",
    "start": "robot: {urdf: arm.urdf}\nstart: OTHER/start.json",
}
if "policy" in controllers.KINDS:  # the extension learning adds it
    OTHERS["controllers.c.network"] = (
        "robot: {urdf: arm.urdf}\ncontrollers: {c: {kind: policy, network: OTHER/net.onnx}}"
    )


@pytest.mark.parametrize("key", OTHERS)
@pytest.mark.parametrize("way", ["../private", "{other}", "link"])
def test_a_station_reaches_nothing_of_others(places, key, way):
    own, other = places
    os.symlink(other, own / "link")

    file = station(own, OTHERS[key].replace("OTHER", way.format(other=other)))

    with pytest.raises(InvalidConfig) as refusal:
        load_station(file)
    told = str(refusal.value)
    assert told.startswith(f"{file}: {key}: ")
    assert f"allow it with --mesh-path {other}" in told


def test_the_user_may_allow_it(places):
    own, other = places
    (own / "arm.urdf").write_text(URDF.format(mesh=other / "box.obj"))
    file = station(
        own, f"robot: {{urdf: arm.urdf}}\nreference: {{kind: table, file: {other}/table.csv}}"
    )

    config = load_station(file, mesh_path=[other])

    assert config.reference.file == other / "table.csv"
    assert (
        resolve(config).robots["robot"].model.element.find("link/visual/geometry/mesh") is not None
    )

    with granting([other]):
        assert granted_folders() == [other]
        load_station(file)
    assert granted_folders() == []
    with pytest.raises(InvalidConfig, match=r"reference.file"):
        load_station(file)

    load_station(station(own, "robot: {urdf: arm.urdf}"), {"robot.urdf": str(other / "arm.urdf")})


def test_the_environment_may_allow_it(places, monkeypatch):
    own, other = places
    monkeypatch.setenv(MESH_PATH_VARIABLE, f"/nowhere{os.pathsep}{other}")
    load_station(station(own, f"robot: {{urdf: {other}/arm.urdf}}"))


def test_the_package_of_a_station_is_its_own(places):
    own, _ = places
    (own / "package.xml").write_text("<package><name>downloaded</name></package>")
    (own / "stations").mkdir()

    load_station(station(own / "stations", "robot: {urdf: ../arm.urdf}"))


def test_a_station_that_allows_itself_all_reads_no_file_of_the_machine(tmp_path):
    (tmp_path / "host.yaml").write_text("kept: secret")
    (tmp_path / "own").mkdir()
    options = f"{{mesh_path: ['{tmp_path.anchor}']}}"

    file = station(tmp_path / "own", f"robot: {{urdf: arm.xacro, import_options: {options}}}")

    with pytest.raises(InvalidConfig, match=r"robot.import_options.mesh_path"):
        load_station(file)


def test_other_files_are_held_to_the_same_border(places, tmp_path):
    own, other = places
    robot = own / "robot.yaml"

    robot.write_text("urdf: ../private/arm.urdf\nroot: base\naxes: [j]\n")

    with pytest.raises(InvalidConfig, match="is outside the robot's folder"):
        load_robot_file(robot)

    station(other, "robot: {urdf: arm.urdf}")
    with pytest.raises(InvalidConfig, match=r"station: .*is outside the allowed folders"):
        station_with_absolute_path("../private/station.yaml", own / "program.yaml")
    assert station_with_absolute_path("irb120_dynamic", own / "program.yaml") == "irb120_dynamic"

    (own / "program.yaml").write_text(
        f"changes: [{{time: 1, set: {{start: {other}/start.json}}}}]\n"
    )
    with pytest.raises(InvalidConfig, match=r"program.yaml: start: .*--mesh-path"):
        Program.load(own / "program.yaml")


def test_changes_by_dotted_keys_start_at_the_folder_of_their_file(tmp_path):
    changes = {
        "robot.urdf": "a.urdf",
        "pieces": {"p": {"mesh": "b.obj"}},
        "servo.kp": 3,
        "robot.model": "irb120",
    }
    assert changes_with_absolute_paths(changes, tmp_path) == {
        **changes,
        "robot.urdf": str(tmp_path / "a.urdf"),
        "pieces": {"p": {"mesh": str(tmp_path / "b.obj")}},
    }


def test_a_file_that_was_deleted_is_not_copied(places, tmp_path):
    """The copy of the station names where the file was; files that are there are copied all the same."""
    own, _ = places
    (own / "box.obj").write_text(BOX)
    text = """robot: {urdf: arm.urdf}
reference: {kind: table, file: table.csv}
pieces: {part: {mesh: box.obj, scale: 1, parent: world}}
"""
    config = load_station(station(own, text))
    (own / "table.csv").unlink()

    copied = with_copied_files(config, tmp_path)

    assert copied.reference.file == own / "table.csv"
    assert copied.pieces["part"].mesh == Path("files/pieces/part/box.obj")
    assert (tmp_path / "files" / "pieces" / "part" / "box.obj").is_file()


def test_a_mesh_that_was_deleted_is_not_copied(places, tmp_path):
    own, _ = places
    (own / "box.obj").write_text(BOX)
    (own / "other.obj").write_text(BOX)
    text = """robot: {urdf: arm.urdf}
reference: {kind: table, file: table.csv}
pieces: {part: {mesh: other.obj, scale: 1, parent: world}}
"""
    config = load_station(station(own, text))
    (own / "other.obj").unlink()

    copied = with_copied_files(config, tmp_path)

    assert copied.pieces["part"].mesh == own / "other.obj"
    assert copied.reference.file == Path("files/reference/table.csv")


def test_a_mesh_with_a_texture_of_others_is_not_copied(places, tmp_path):
    own, other = places
    (other / "wood.mtl").write_text("newmtl wood\n")
    (own / "box.obj").write_text(f"mtllib ../{other.name}/wood.mtl\n{BOX}")
    (own / "piece.yaml").write_text("mass: 1\ninertia: [1, 1, 1]\nshapes: [{mesh: box.obj}]\n")
    text = "robot: {urdf: arm.urdf}\npieces: {part: {model: piece.yaml, parent: world}}\n"
    (own / "arm.urdf").write_text(URDF.format(mesh="plain.obj"))
    (own / "plain.obj").write_text(BOX)
    config = load_station(station(own, text))

    copied = with_copied_files(config, tmp_path)

    assert copied.pieces["part"].model == str(own / "piece.yaml")
    assert copied.robots["robot"].urdf == Path("files/robots/robot/arm.urdf")


def test_a_station_carries_what_it_names(places, tmp_path):
    own, other = places
    (own / "arm.urdf").write_text(URDF.format(mesh=other / "box.obj"))
    (own / "bin").mkdir()
    (own / "bin" / "piece.yaml").write_text("mass: 1\nshapes: [{mesh: bin.obj}]\n")
    (own / "bin" / "bin.obj").write_text(BOX)
    text = f"""robot: {{urdf: arm.urdf}}
reference: {{kind: table, file: table.csv}}
pieces:
  part: {{mesh: {other}/box.obj, scale: 1, parent: world}}
  bin: {{model: bin/piece.yaml, parent: world}}
"""
    config = load_station(station(own, text), mesh_path=[other])
    result = tmp_path / "result"
    result.mkdir()
    (result / "station.yaml").write_text(station_yaml(with_copied_files(config, result)))
    before = resolve(config)
    moved = result.rename(tmp_path / "elsewhere")
    for folder in (own, other):
        folder.rename(folder.with_name(f"{folder.name}_gone"))

    after = resolve(load_station(moved / "station.yaml"))

    assert (moved / FILES / "reference" / "table.csv").is_file()
    model = after.robots["robot"].model
    assert model.folder.is_relative_to(moved)
    assert model.axes == before.robots["robot"].model.axes
    assert model.element.find("link/visual/geometry/mesh") is not None
    assert all(
        after.pieces[name].model.mass == before.pieces[name].model.mass for name in ("part", "bin")
    )
