"""Plots: the files, what the curves are, and how the end of a run is shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from simrob_drake import load_station, simulate
from simrob_drake.errors import OutputError
from simrob_drake.results.plots import save_plots


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.6, progress=False)


@pytest.fixture
def drawn(monkeypatch):
    """Draw the plots of a run and return their figures by the file's stem, unsaved."""

    def draw(result) -> dict[str, Figure]:
        figures: dict[str, Figure] = {}
        monkeypatch.setattr(Figure, "savefig", lambda figure, file, **_: figures.update({Path(file).stem: figure}))
        save_plots(result, Path())
        return figures

    return draw


def curve(panel, label):
    return next(line for line in panel.get_lines() if line.get_label() == label)


def labels(panel):
    return [line.get_label() for line in panel.get_lines()]


def texts(figure):
    return " ".join(text.get_text() for text in figure.texts)


def test_a_robot_with_a_tool_has_three_pictures(result, tmp_path):
    files = save_plots(result, tmp_path / "plots")
    assert [file.name for file in files] == ["position.png", "torque.png", "tcp.png"]
    for file in files:
        picture = imread(file)
        assert picture.shape[0] > 300
        assert picture.shape[1] > 800
        assert 0.01 < (picture[:, :, :3].min(axis=2) < 0.9).mean() < 0.5  # neither blank nor black


def test_several_robots_have_their_own_pictures(tmp_path):
    result = simulate(load_station("two_irb120"), duration=0.05, progress=False)
    names = [f"{robot}_{what}.png" for robot in ("left", "right") for what in ("position", "torque", "tcp")]
    assert [file.name for file in save_plots(result, tmp_path)] == names


def test_positions_are_in_degrees_with_reference_and_error(result, drawn):
    position, error = drawn(result)["position"].axes[2:4]  # two panels an axis
    reached, wanted = np.rad2deg(result["q.joint_2"]), np.rad2deg(result["q_ref.joint_2"])
    np.testing.assert_allclose(curve(position, "position").get_ydata(), reached)
    np.testing.assert_allclose(curve(position, "reference").get_ydata(), wanted)
    assert curve(position, "reference").get_linestyle() == "--"
    np.testing.assert_allclose(curve(error, "error: reference - position").get_ydata(), wanted - reached)


def test_a_kinematic_run_has_no_error(drawn):
    result = simulate(load_station("irb120_kinematic"), duration=0.1, progress=False)
    assert len(drawn(result)["position"].axes) == 6


def test_a_limit_is_drawn_where_the_torque_comes_near_and_said_everywhere(result, drawn):
    limited = simulate(load_station("irb120_dynamic", {"servo.torque_limit": 15}), duration=0.6, progress=False)
    near = drawn(limited)["torque"].axes[1]
    assert {tuple(line.get_ydata()[:1]) for line in near.get_lines()[1:]} == {(15.0,), (-15.0,)}
    far = drawn(result)["torque"].axes[1]
    assert labels(far) == ["torque"]
    assert far.get_title(loc="right") == "limit ±150 N·m"


@pytest.mark.parametrize("name", ["position", "torque", "tcp"])
def test_the_end_of_a_stopped_run_is_marked_with_its_reason(name, drawn, result):
    monitor = {"monitors.joint_limit": {"margin_deg": 60}}  # joint 3 on its way to 30 of 70 deg
    stopped = simulate(load_station("irb120_dynamic", monitor), duration=0.6, progress=False)
    assert 0 < stopped.stop_time < 0.6
    figure = drawn(stopped)[name]
    assert f"stopped by joint_limit: {stopped.message}" in texts(figure)
    assert all(curve(panel, "stop").get_xdata()[0] == stopped.stop_time for panel in figure.axes)
    completed = drawn(result)[name]
    assert "stopped" not in texts(completed)
    assert not any("stop" in labels(panel) for panel in completed.axes)


def test_a_run_that_is_stopped_at_its_start_shows_a_point(drawn):
    result = simulate(load_station("irb120_dynamic", {"monitors.joint_limit": {"margin_deg": 70}}), progress=False)
    assert result.stop_time == 0
    assert curve(drawn(result)["position"].axes[0], "position").get_marker() == "o"


def test_what_a_run_diverges_with_does_not_flatten_the_rest(result, drawn):
    values = result.values.copy()
    values[-1] = 1e300
    values[-2] = np.inf
    message = "diverged at 0.6 s: a state is no number any more"
    diverged = replace(result, values=values, ending="diverged", stopped_by="diverged", message=message)
    figure = drawn(diverged)["position"]
    assert message in texts(figure)
    assert np.abs(figure.axes[0].get_ylim()).max() < 90


def test_a_folder_that_cannot_be_made_is_one_clear_error(result, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match="taken"):
        save_plots(result, tmp_path / "taken")
