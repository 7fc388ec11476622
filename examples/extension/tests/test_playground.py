"""The extension in use: its parts in stations, its move in a program, its gait on its robot."""

import numpy as np
import pytest
from simrob_playground.power_plot import power_plot

from simrob_drake import Arm, LeggedRobot, Program, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.results.plots.own import save_plots


def test_the_power_is_torque_times_speed():
    ramp = {"kind": "ramp", "target_deg": 10, "duration": 0.2}
    station = load_station("nodding_arm", {"program": None, "reference": ramp})
    result = simulate(station, duration=0.3, progress=False)
    for axis in ("joint_1", "joint_5"):
        expected = result[f"tau.{axis}"] * result[f"v.{axis}"]
        np.testing.assert_allclose(result[f"joint_power.joint_power.{axis}"], expected, atol=1e-9)
    assert result["joint_power.joint_power.joint_1"].max() > 0.0


def test_a_nod_turns_one_axis_and_returns():
    run = Arm("nodding_arm").do({"nod": {"axis": "joint_5", "angle_deg": 25}})
    angle = np.rad2deg(run["q.joint_5"])
    assert angle.max() == pytest.approx(25, abs=1.0)
    assert angle[-1] == pytest.approx(0, abs=1.0)


def test_a_wrong_axis_is_an_error_with_the_nearest_name():
    with pytest.raises(SimrobError, match="joint_5"):
        Arm("nodding_arm").do({"nod": {"axis": "joint_55"}})


def test_the_table_goes_down_as_far_as_its_bent_legs_are_shorter():
    """Legs of two halves of 0.16 m, bent by 40 degrees at the hip, are 0.32 (1 - cos 40 deg) = 75 mm shorter."""
    run = LeggedRobot("bobbing_table_dynamic").act("bob")
    height = run["base.z"]
    assert height[0] - height.min() == pytest.approx(0.0749, abs=0.006)
    assert height[-1] == pytest.approx(height[0], abs=0.006)


def test_the_csv_file_has_the_positions_of_the_motion(tmp_path):
    file = tmp_path / "nod.csv"
    assert run_command(["export", "nodding_arm", "--csv", str(file), "--rate", "50"]) == 0
    with file.open() as text:
        headings = text.readline().strip().split(",")
        rows = np.loadtxt(text, delimiter=",")
    assert headings == ["time [s]", *(f"joint_{number} [deg]" for number in range(1, 7))]
    np.testing.assert_allclose(np.diff(rows[:, 0]), 1 / 50, atol=1e-9)
    # The program nods with joint 5 by 25 degrees, and keeps all other joints.
    assert rows[:, 5].max() == pytest.approx(25, abs=1.0)
    assert np.abs(rows[:, [1, 4, 6]]).max() < 0.5


def test_a_list_of_postures_is_a_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.postures").write_text(
        "left 30 0 0 0 60 0  # deg\npause 0.2\nright -30 0 0 0 60 0\n"
    )
    assert run_command(["import", "arm.postures", "--robot", "irb120", "--out", "arm.yaml"]) == 0
    program = Program.load("arm.yaml")
    assert [move.key for move in program.moves] == ["move_abs_j", "wait", "move_abs_j"]
    arm = Arm("irb120_kinematic")
    first, _, last = (arm.do(move) for move in program.moves)
    np.testing.assert_allclose(np.rad2deg(first["q.joint_1"])[[0, -1]], [0, 30], atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(last["q.joint_1"])[[0, -1]], [30, -30], atol=1e-6)
    assert np.rad2deg(last["q.joint_5"][-1]) == pytest.approx(60)


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("left 30 0", 2, "arm.postures: line 1: left has 2 angles; irb120 has 6 joints"),
        (
            "left 0 0 0 0 0 0\nspeed fast",
            4,
            "lost: 1 line; --allow-losses accepts the program without them",
        ),
    ],
)
def test_a_wrong_list_is_one_line(tmp_path, monkeypatch, capsys, text, code, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.postures").write_text(text)
    assert run_command(["import", "arm.postures", "--robot", "irb120"]) == code
    assert message in capsys.readouterr().err


def test_the_plot_shows_the_power_of_each_joint(tmp_path):
    ramp = {"kind": "ramp", "target_deg": 10, "duration": 0.2}
    result = simulate(
        load_station("nodding_arm", {"program": None, "reference": ramp}),
        duration=0.2,
        progress=False,
    )
    figure = power_plot(result)
    curves = {curve.get_label(): curve for curve in figure.axes[0].lines}
    np.testing.assert_array_equal(
        curves["joint_5"].get_ydata(), result["tau.joint_5"] * result["v.joint_5"]
    )
    assert tmp_path / "joint_power.png" in save_plots(result, tmp_path)


def test_the_standstill_is_the_share_of_samples_without_motion():
    """Without gravity nothing moves before the ramp, which begins in the middle of the run."""
    ramp = {"kind": "ramp", "target_deg": {"joint_5": 30}, "start": 0.5, "duration": 0.5}
    station = {"program": None, "reference": ramp, "gravity": 0, "verdict.standstill": 0.1}
    result = simulate(load_station("nodding_arm", station), duration=1.0, progress=False)
    measure = result.verdict["standstill"]
    assert measure.worst.value == pytest.approx(0.5, abs=0.02)
    assert measure.warning.startswith("robot stood still for")
