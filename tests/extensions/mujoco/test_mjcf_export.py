"""What `simrob export --mjcf` writes, MuJoCo loads by itself and moves alike; what MJCF cannot say is refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.mujoco.runner import MujocoRunner


def replayed(file: Path) -> mujoco.MjData:
    """Step a file from its keyframe with the controls beside it, as any user of MuJoCo would."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    rows = np.loadtxt(
        file.with_name(f"{file.stem}_mjcf") / "controls.csv", delimiter=",", skiprows=1
    )
    for row in rows[:-1]:
        data.ctrl[:] = row[1:]
        mujoco.mj_step(model, data)
    return data


@pytest.mark.parametrize("station", ["irb120_dynamic", "yobotics_dynamic", "two_irb120"])
def test_a_file_moves_as_the_roll_out_does(station: str, tmp_path: Path) -> None:
    """Its figures have six digits: a micrometre a link, and so the joints within some microradians."""
    push = {"forces": {"shove": {"kind": "push", "at": "trunk", "start": 0.1, "force": [0, 20, 0]}}}
    overrides = {"duration": 0.5, **(push if station == "yobotics_dynamic" else {})}
    file = tmp_path / "out" / "station.xml"
    told = [
        f"--set={key}={value}".replace("'", "")
        for key, value in overrides.items()
        if key == "duration"
    ]
    config = load_station(station, overrides)
    if station == "yobotics_dynamic":
        from simrob_drake.extensions.mujoco.export import save_mjcf

        save_mjcf(config, file)
    else:
        assert run_command(["export", station, "--mjcf", str(file), *told]) == 0
    data, runner = replayed(file), MujocoRunner(config)
    assert data.time == pytest.approx(0.5)
    q = runner.built.coordinates.to_drake(np.hstack([data.qpos, data.qvel])[np.newaxis])
    np.testing.assert_allclose(
        q[0, : len(data.qpos)], runner.run().positions_at(np.array([0.5]))[0], atol=1e-5
    )


def test_a_file_can_be_moved_with_its_folder_and_shows_the_robot(tmp_path: Path) -> None:
    assert (
        run_command(["export", "irb120_dynamic", "--mjcf", str(tmp_path / "here" / "arm.xml")]) == 0
    )
    (tmp_path / "here").rename(tmp_path / "there")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "there" / "arm.xml"))
    assert model.nmesh == 18
    assert model.body("link_6").mass[0] > 0
    text = (tmp_path / "there" / "arm.xml").read_text()
    assert str(tmp_path) not in text
    assert '<joint name="joint_1"' in text


@pytest.mark.parametrize(
    ("station", "overrides", "told"),
    [
        (
            "irb120_kinematic",
            {},
            r"mode is kinematic; it must be dynamic: MJCF moves things by forces",
        ),
        ("humanoid_balance", {}, r"controllers: MJCF holds no controllers; leave it out"),
        ("irb120_cobot", {}, r"servo.admittance_gain is 1000.0; it must be 0"),
        ("irb120_dynamic", {"servo.law": "cascade"}, r"servo.law is cascade; it must be pid"),
        (
            "irb120_dynamic",
            {"servo.feedforward": "gravity"},
            r"servo.feedforward is gravity; it must be none",
        ),
        (
            "humanoid_dynamic",
            {"contact.model": "hydroelastic", "robot.feet": "soles"},
            r"contact.model is hydroelastic",
        ),
        (
            "irb120_dynamic",
            {"inputs": ["reference_velocity"], "servo.ki": 1.0},
            r"servo.ki is .* must be 0 with",
        ),
        (
            "irb120_dynamic",
            {"inputs": ["reference_velocity"], "servo.kp": 0.0},
            r"servo.kp is .* must be positive with",
        ),
        (
            "two_irb120",
            {"robots.left.servo": {"law": "cascade"}},
            r"robots.left.servo.law is cascade",
        ),
    ],
)
def test_what_mjcf_cannot_say_is_refused(
    station: str, overrides: dict[str, object], told: str
) -> None:
    with pytest.raises(SimrobError, match=told):
        MujocoRunner(load_station(station, overrides))


def test_bad_input_of_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ball.xml"
    export = ["export", "bouncing_ball", "--mjcf"]
    assert run_command([*export, str(file)]) == 0
    for command, told in (
        ([*export, str(file)], "exists already"),
        ([*export, str(tmp_path / "ball.mjcf")], "a file that ends in .xml"),
        ([*export, str(tmp_path / "other.xml"), "--step", "0"], "step is 0.0; it must be"),
        (
            [*export, str(tmp_path / "other.xml"), "--step", "1e-9"],
            "at least 3e-06 s for a duration of 3 s",
        ),
        (
            ["export", "bouncing_bal", "--mjcf", str(tmp_path / "other.xml")],
            "did you mean 'bouncing_ball'",
        ),
        (["export", "bouncing_ball"], "--mjcf"),
        ([*export, "/proc/none/ball.xml"], "cannot be written"),
    ):
        capsys.readouterr()
        assert run_command(command) == 2
        error = capsys.readouterr().err
        assert told in error
        assert "Traceback" not in error
    assert not (tmp_path / "other.xml").exists()
    assert run_command([*export, str(file), "--force"]) == 0


def test_without_mujoco_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys
) -> None:
    monkeypatch.setattr("simrob_drake.base.extras.find_spec", lambda name: None)
    assert run_command(["export", "bouncing_ball", "--mjcf", str(tmp_path / "ball.xml")]) == 2
    assert "simrob export needs the extra mujoco: pip install" in capsys.readouterr().err
