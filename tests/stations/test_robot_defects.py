"""Defects of a robot's file and losses of its import: each is reported once, with the setting that helps."""

import json

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.dynamics import Dynamics
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.checks import check_station
from tests.programs.lifting import gripper_urdf, lifting_file

SHORT = {"duration": 0.05, "program": None}
KINEMATIC = {
    "mode": "kinematic",
    "pieces": {},
    "couplings": {},
    "solver": {"kind": "continuous", "scheme": "radau3"},
    "contact": None,
    **SHORT,
}


def named(file):
    """Give the only robot of a station's file the name `arm`, under the key `robots`. Returns the file."""
    content = yaml.safe_load(file.read_text())
    content["robots"] = {"arm": content.pop("robot")}
    file.write_text(yaml.safe_dump(content))
    return file


def warnings_of(config):
    return [finding.text for finding in check_station(config) if finding.level == "warning"]


def test_lost_friction_names_the_setting_that_brings_it_back(tmp_path):
    file = lifting_file(tmp_path, [{"wait": 0.1}], friction=1.0)
    (warning,) = warnings_of(load_station(file))

    assert warning == (
        "the import of lift_gripper.urdf leaves out joint friction, which is seldom measured: lift 1 N; "
        "`--set robot.drives.friction.lift=1` restores it"
    )

    with_friction = load_station(file, {"robot.drives.friction.lift": 1})
    assert warnings_of(with_friction) == []


def test_lost_friction_of_an_only_robot_with_a_name_has_a_setting_that_acts(tmp_path):
    file = named(lifting_file(tmp_path, [{"wait": 0.1}], friction=1.0))
    (warning,) = warnings_of(load_station(file))

    assert "`--set robots.arm.drives.friction.lift=1` restores it" in warning
    assert warnings_of(load_station(file, {"robots.arm.drives.friction.lift": 1})) == []


ESTIMATE = "robots.arm.import_options.estimate_inertia"


def test_links_without_inertia_name_the_key_of_the_robot_that_has_them(tmp_path):
    """The key of a robot with a name is under `robots`: the key `robot` would be refused."""
    file = named(lifting_file(tmp_path, [{"wait": 0.1}], right_has_inertia=False))

    with pytest.raises(SimrobError, match=rf"kinematic, or {ESTIMATE} to true"):
        check_station(load_station(file))

    kinematic = load_station(file, KINEMATIC)
    (warning,) = simulate(kinematic, progress=False).warnings

    assert f"set {ESTIMATE} to true, or write the inertias in the URDF" in warning
    assert load_station(file, {ESTIMATE: True}).robots["arm"].import_options.estimate_inertia


def test_torques_that_are_not_predicted_name_the_key_of_the_robot(tmp_path):
    (tmp_path / "arm.urdf").write_text(
        """<robot name="arm"><link name="base"/><link name="bar"/>
        <joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""
    )
    file = tmp_path / "bare.yaml"
    file.write_text("{mode: kinematic, robots: {arm: {urdf: arm.urdf}}}")

    texts = [finding.text for finding in check_station(load_station(file))]

    (text,) = [text for text in texts if text.startswith("not predicted")]
    assert text.endswith(f"set {ESTIMATE} to true")


def test_a_run_says_that_friction_was_left_out_and_not_that_it_is_inaccurate(tmp_path):
    file = lifting_file(tmp_path, [{"wait": 0.1}], friction=1.0)
    result = simulate(load_station(file, SHORT), progress=False)

    assert str(result.verdict).endswith("Joint friction was left out")
    assert result.verdict.severity == "warning"


def test_a_warning_before_the_run_is_not_repeated_after_it(tmp_path, capfd):
    file = lifting_file(tmp_path, [{"wait": 0.1}], friction=1.0)
    settings = ["--set", "program=null", "--set", "duration=0.05", "--no-recording"]

    code = run_command(["run", str(file), *settings, "--out", str(tmp_path / "run")])

    assert code == 0

    captured = capfd.readouterr()
    text = " ".join((captured.out + captured.err).split())

    assert text.count("leaves out joint friction") == 1
    assert "Joint friction was left out." in text


@pytest.mark.parametrize("key", ["drives.friction.lift", "initial_deg", "base", "tcp"])
def test_a_key_of_a_robot_outside_of_it_is_refused_with_its_place(tmp_path, key):
    file = lifting_file(tmp_path, [{"wait": 0.1}])
    section = key.partition(".")[0]
    with pytest.raises(
        SimrobError,
        match=rf"{section} is a key of a robot: write robot\.{section}, or robots\.NAME",
    ):
        load_station(file, {key: 1})


def test_a_kinematic_station_warns_of_a_weight_that_its_forces_lack(tmp_path):
    file = lifting_file(tmp_path, [{"wait": 0.1}], right_has_inertia=False)
    result = simulate(load_station(file, KINEMATIC), progress=False)
    (warning,) = result.warnings
    assert warning.startswith(
        "forces do not include the weight of links without inertia (finger_right); set"
    )
    # The lift carries the carriage and one finger: 1.3 kg, not 1.4 kg.
    assert result["tau.lift"][0] == pytest.approx(1.3 * 9.81, rel=1e-3)

    whole = simulate(
        load_station(lifting_file(tmp_path, [{"wait": 0.1}]), KINEMATIC), progress=False
    )
    assert whole.warnings == []
    assert whole["tau.lift"][0] == pytest.approx(1.4 * 9.81, rel=1e-3)


def test_an_estimated_inertia_is_a_note_of_the_run_and_of_its_summary(tmp_path):
    file = lifting_file(tmp_path, [{"wait": 0.1}], right_has_inertia=False)
    config = load_station(file, {**SHORT, "robot.import_options": {"estimate_inertia": True}})

    note = "the inertia of finger_right (0.027 kg) is an estimate, since lift_gripper.urdf has no usable value"

    assert note in [finding.text for finding in check_station(config)]

    result = simulate(config, progress=False)
    assert [(remark.severity, remark.text) for remark in result.verdict.remarks[1:]] == [
        ("note", note)
    ]
    assert result.verdict.severity == "success"

    result.save(tmp_path / "run", recording=False)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert {"severity": "note", "text": note} in summary["verdict"]["remarks"]


def test_a_first_station_says_that_it_estimated_an_inertia(tmp_path, capfd):
    file = tmp_path / "lift_gripper.urdf"
    file.write_text(gripper_urdf(right_has_inertia=False))

    assert (
        run_command(
            ["station", str(file), "--estimate-inertia", "--out", str(tmp_path / "first.yaml")]
        )
        == 0
    )

    sentence = "The inertia of finger_right (0.027 kg) is an estimate, since lift_gripper.urdf has no usable value."
    assert sentence in " ".join(capfd.readouterr().out.split())
    assert f"# {sentence}\n" in (tmp_path / "first.yaml").read_text()


def test_the_weakest_posture_obeys_mimic_joints_and_the_gear_of_fingers(tmp_path):
    file = tmp_path / "lift_gripper.urdf"
    for text in (gripper_urdf(), gripper_urdf().replace('<mimic joint="finger_left_joint"/>', "")):
        file.write_text(text)
        model = robot_from_file(file, ImportOptions())
        dynamics = Dynamics.of_robot(model)
        lift, left, right = dynamics.weakest_posture()
        assert left == pytest.approx(right, abs=1e-12)
        # All postures of a lift are as weak: what it holds is the rest of its force.
        assert dynamics.payload(np.array([lift, left, right])).min() == pytest.approx(
            120 / 9.80665 - 1.4, rel=1e-6
        )
