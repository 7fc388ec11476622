"""Scenes with a mistake: one line says what is wrong, where, and what would be right."""

from pathlib import Path

import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.messages import in_language
from simrob_drake.cli.app import run_command
from tests.extensions.drake_scenes.samples import SCENES

MODEL = "- add_model: {name: arm, file: package://simrob_scenes/models/arm.urdf}\n"

PROBLEMS = {
    "unknown package": (
        "directives:\n- add_model: {name: iiwa, file: package://drake_models/iiwa.sdf}\n",
        "add_model.file: package://drake_models (line 2): no package drake_models is on this computer",
        "el paquete drake_models no está en este ordenador",
    ),
    "unknown driver": (
        f"directives:\n{MODEL}model_drivers:\n  arm: !PandaDriver {{}}\n",
        "model_drivers.arm: the driver PandaDriver (line 4) is none of those that a station has: IiwaDriver",
        "el controlador PandaDriver (línea 4) no es ninguno de los que tiene una estación",
    ),
    "unknown tag": (
        "directives:\n- add_frame:\n    name: f\n    X_PF: {base_frame: world, rotation: !Euler {deg: [0, 0, 1]}}\n",
        "the tag !Euler (line 4) is unknown; known are Rpy",
        "etiqueta !Euler (línea 4): no se conoce",
    ),
    "unknown directive": (
        "directives:\n- add_robot: {name: arm}\n",
        "the directive add_robot (line 2) is unknown; known are add_model",
        "directiva add_robot (línea 2): no se conoce",
    ),
    "unknown key": (
        f"directives:\n{MODEL}plant_confg: {{time_step: 0.1}}\n",
        "the key plant_confg (line 3) is unknown; known are directives",
        "clave plant_confg (línea 3): no se conoce",
    ),
    "no URI": (
        "directives:\n- add_model: {name: arm, file: models/arm.urdf}\n",
        "models/arm.urdf (line 2) must begin with package:// or file://",
        "debe empezar por package:// o file://",
    ),
    "missing file": (
        "directives:\n- add_model: {name: arm, file: package://simrob_scenes/none.urdf}\n",
        "package://simrob_scenes/none.urdf (line 2): there is no file",
        "no existe el fichero",
    ),
    "weld of a missing frame": (
        f"directives:\n{MODEL}- add_weld: {{parent: world, child: arm::nose}}\n",
        "Drake cannot read this file: GetFrameByName(): There is no Frame named 'nose'",
        "Drake no puede leer este fichero",
    ),
    "wrong type": (
        f"directives:\n{MODEL}plant_config: {{time_step: soon}}\n",
        "Drake cannot read this file",
        "Drake no puede leer este fichero",
    ),
}
"""By what is wrong: the file, and words of the message in English and Spanish."""


def test_a_scenario_is_recognised(tmp_path: Path) -> None:
    """On its own it has no model, and the message is about that, not about its tags."""
    file = tmp_path / "scene.yaml"
    file.write_text("directives: []\nmodel_drivers: {arm: !ZeroForceDriver {}}\n")
    with pytest.raises(InvalidConfig) as caught:
        load_station(file)
    assert "is not YAML" not in str(caught.value)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_one_line_says_what_is_wrong(
    problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, english, spanish = PROBLEMS[problem]
    file = tmp_path / "scene.dmd.yaml"
    file.write_text(text)
    for command in ("check", "import"):
        assert run_command([command, str(file), "--mesh-path", str(SCENES)]) == 2
        errors = " ".join(capsys.readouterr().err.split())
        assert f"{file}: " in errors
        assert english in errors
    with pytest.raises(InvalidConfig) as caught:
        load_station(file, mesh_path=[SCENES])
    assert spanish in " ".join(in_language(caught.value.message, "es").split())
    assert not (tmp_path / "scene_imported").exists()


def test_a_file_with_tags_that_is_no_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "station.yaml"
    file.write_text("robot: {model: irb120}\nservo: !Iiwa {kp: 3}\n")
    assert run_command(["run", str(file)]) == 2
    errors = " ".join(capsys.readouterr().err.split())
    assert "has the tag !Iiwa (line 2), which only Drake scenes have" in errors
    assert "is not YAML" not in errors


def test_add_directives_of_a_station_that_is_no_scene(tmp_path: Path) -> None:
    (tmp_path / "other.yaml").write_text("robot: {model: irb120}\n")
    station = tmp_path / "station.yaml"
    station.write_text("add_directives: [other.yaml]\n")
    with pytest.raises(InvalidConfig, match=r"add_directives: .* has no model directives of Drake"):
        load_station(station)


def test_the_only_scenario_of_a_file_is_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "one.scenarios.yaml"
    file.write_text("Only:\n  directives: []\n  model_drivers: {arm: !FooDriver {}}\n")
    assert run_command(["check", str(file)]) == 2
    errors = " ".join(capsys.readouterr().err.split())
    assert "FooDriver" in errors
    assert "choose one" not in errors


def test_several_scenarios_need_a_choice(capsys: pytest.CaptureFixture[str]) -> None:
    file = SCENES / "drivers.scenarios.yaml"
    assert run_command(["run", str(file)]) == 2
    assert "has the scenarios Held, Iiwa, Falling; choose one" in " ".join(
        capsys.readouterr().err.split()
    )
    assert run_command(["check", str(file), "--scenario", "None"]) == 2
    assert "None: is no scenario of the file; it has: Held, Iiwa, Falling" in " ".join(
        capsys.readouterr().err.split()
    )


def test_models_may_not_name_files_beyond_their_package(tmp_path: Path) -> None:
    """A scene of somebody else reads nothing outside of its folder."""
    secret = tmp_path / "secret.obj"
    secret.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>scene</name></package>")
    mesh = '<visual><geometry><mesh filename="../secret.obj"/></geometry></visual>'
    (folder / "part.urdf").write_text(f'<robot name="part"><link name="part">{mesh}</link></robot>')
    weld = "- add_weld: {parent: world, child: part::part}\n"
    (folder / "scene.dmd.yaml").write_text(
        f"directives:\n- add_model: {{name: part, file: package://scene/part.urdf}}\n{weld}"
    )
    with pytest.raises(InvalidConfig, match=r"secret\.obj is outside the allowed folders"):
        load_station(folder / "scene.dmd.yaml")
    (folder / "scene.dmd.yaml").write_text(
        f"directives:\n- add_model: {{name: part, file: 'file://{secret}'}}\n"
    )
    with pytest.raises(InvalidConfig, match=r"secret\.obj is outside the allowed folders"):
        load_station(folder / "scene.dmd.yaml")


def test_a_joint_that_stations_do_not_have(tmp_path: Path) -> None:
    (tmp_path / "package.xml").write_text("<package><name>ball</name></package>")
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = (
        '<drake:joint xmlns:drake="http://drake.mit.edu" name="ball" type="ball">'
        '<parent link="a"/><child link="b"/></drake:joint>'
    )
    links = f'<link name="a">{inertia}</link><link name="b">{inertia}</link>'
    (tmp_path / "ball.urdf").write_text(f'<robot name="ball">{links}{joint}</robot>')
    file = tmp_path / "scene.dmd.yaml"
    file.write_text("directives:\n- add_model: {name: ball, file: package://ball/ball.urdf}\n")
    with pytest.raises(
        Exception, match="the joint 'ball' is of the type ball_rpy; robots have revolute"
    ):
        load_station(file)
