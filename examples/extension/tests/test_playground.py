"""The extension in use: its parts in stations, its move in a program, its gait on its robot."""

import numpy as np
import pytest
from simrob_playground.power_plot import power_plot

from simrob_drake import Arm, LeggedRobot, load_station, simulate
from simrob_drake.base.errors import SimrobError
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


def test_the_plot_shows_the_power_of_each_joint(tmp_path):
    ramp = {"kind": "ramp", "target_deg": 10, "duration": 0.2}
    result = simulate(load_station("nodding_arm", {"program": None, "reference": ramp}), duration=0.2, progress=False)
    figure = power_plot(result)
    curves = {curve.get_label(): curve for curve in figure.axes[0].lines}
    np.testing.assert_array_equal(curves["joint_5"].get_ydata(), result["tau.joint_5"] * result["v.joint_5"])
    assert tmp_path / "joint_power.png" in save_plots(result, tmp_path)


def test_the_standstill_is_the_share_of_samples_without_motion():
    """Without gravity nothing moves before the ramp, which begins in the middle of the run."""
    ramp = {"kind": "ramp", "target_deg": {"joint_5": 30}, "start": 0.5, "duration": 0.5}
    station = {"program": None, "reference": ramp, "gravity": 0, "verdict.standstill": 0.1}
    result = simulate(load_station("nodding_arm", station), duration=1.0, progress=False)
    measure = result.verdict["standstill"]
    assert measure.worst.value == pytest.approx(0.5, abs=0.02)
    assert measure.warning.startswith("robot stood still for")
