"""What `simrob export` writes for Drake, plain Drake loads to the same masses, welds, limits and positions."""

from pathlib import Path

import pytest

from simrob_drake import load_station
from simrob_drake.cli.app import run_command
from tests.extensions.drake_scenes.samples import (
    OwnPlant,
    PlainPlant,
    body_values,
    joint_values,
    largest_difference,
)

STATIONS = ["irb120_dynamic", "double_pendulum", "humanoid_dynamic", "two_arms", "box_on_floor"]
"""An arm that carries pieces, a pendulum, a robot that floats, two robots of one kind, and a free piece."""
FLOOR = ("floor", "world_shapes")  # the station's floor, which is no body of its plant


@pytest.mark.parametrize("station", STATIONS)
@pytest.mark.parametrize("option", ["dmd", "scenario"])
def test_directives_are_the_plant_of_the_station(station: str, option: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.dmd.yaml"
    assert run_command(["export", station, f"--{option}", str(file)]) == 0
    own = OwnPlant(load_station(station)).plant
    if option == "scenario":
        # Drake's parser loads directives only: the sections behind them are for manipulation's loader.
        text = file.read_text()
        file.write_text(text[: text.index("plant_config:")])
    plain = PlainPlant(file, tmp_path).plant
    expected, found = body_values(own), body_values(plain)
    found.pop(FLOOR, None)
    assert largest_difference(expected, found) < 1e-12
    assert largest_difference(joint_values(own), joint_values(plain)) < 1e-12


@pytest.mark.parametrize("station", STATIONS)
@pytest.mark.parametrize("option", ["urdf", "sdf"])
def test_a_single_file_has_the_same_masses_welds_and_limits(
    station: str, option: str, tmp_path: Path
) -> None:
    """URDF and SDF files have no positions of joints, so both plants are compared with all joints at their zeros."""
    file = tmp_path / f"scene.{option}"
    assert run_command(["export", station, f"--{option}", str(file)]) == 0
    own = OwnPlant(load_station(station)).plant
    plain = PlainPlant(file, tmp_path).plant
    for plant in (own, plain):
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            if joint.num_velocities() == 1:
                joint.set_default_positions([0.0])
    for body in plain.GetFloatingBaseBodies() if option == "urdf" else ():
        # A URDF does not say where a free body starts.
        name = plain.get_body(body).name()
        plain.SetDefaultFloatingBaseBodyPose(
            plain.get_body(body), own.GetDefaultFloatingBaseBodyPose(own.GetBodyByName(name))
        )
    # In a URDF all links are in one model, under their own names unless two have the same.
    expected = {f"{model}_{body}": values for (model, body), values in body_values(own).items()}
    found = {f"{model}_{body}": values for (model, body), values in body_values(plain).items()}
    if option == "urdf":
        found = {
            name.removeprefix(f"{load_station(station).name}_"): values
            for name, values in found.items()
        }
        if not found.keys() & expected.keys():
            expected = {body: values for (_, body), values in body_values(own).items()}
    found = {name: values for name, values in found.items() if "world_shapes" not in name}
    assert largest_difference(expected, found) < 1e-12
    limits = joint_values(own)
    if option == "urdf" and station == "two_arms":  # where both arms have the joint `joint_1`
        assert len(joint_values(plain)) == plain.num_positions()
        return
    assert largest_difference(limits, joint_values(plain)) < 1e-12


def test_a_written_scene_is_replaced_only_by_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "scene.dmd.yaml"
    arguments = ["export", "double_pendulum", "--dmd", str(file)]
    assert run_command(arguments) == 0
    assert run_command(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert run_command([*arguments, "--force"]) == 0


def test_a_scenario_names_what_drivers_do_not_do(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    arguments = ["export", "irb120_dynamic", "--set", "servo.ki=5", "--scenario", str(file)]
    assert run_command(arguments) == 0
    text = file.read_text()
    assert "# robot: JointStiffnessDriver adds the torque against gravity" in text
    assert "# robot: JointStiffnessDriver has no integral part" in text
    assert "!JointStiffnessDriver" in text
    assert "integration_scheme: radau3" in text
