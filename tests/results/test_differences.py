"""Results over each other: the legend names the keys that differ, and stays inside of the figure."""

import json

import numpy as np
import pytest
import yaml

from simrob_drake.results.plots.differences import differing_settings
from simrob_drake.results.plots.overlay import SavedSignals, overlay_figure, read_results
from simrob_drake.results.plots.own import panels, save_figure


def saved_result(folder, station, moves=None):
    """Write a folder of a result with one signal."""
    folder.mkdir(parents=True)
    (folder / "station.yaml").write_text(yaml.safe_dump({"name": folder.name, **station}))
    if moves is not None:
        (folder / "program.yaml").write_text(
            yaml.safe_dump({"station": "station.yaml", "moves": moves})
        )
    (folder / "signals.csv").write_text("time,q.lift\n0,0\n0.5,0.1\n1,0.2\n")
    gains = {
        "kp": {"lift": 14000.0, "finger": 8900.0},
        "ki": {"lift": 0.0},
        "kd": {"lift": 280.0, "finger": 60.0},
    }
    servos = {"robot": {**gains, "feedforward": "inverse_dynamics"}}
    (folder / "summary.json").write_text(json.dumps({"units": {"q.lift": "m"}, "servos": servos}))
    return folder


def station(kp):
    return {
        "mode": "dynamic",
        "servo": {"kp": {"lift": kp, "finger": 8900.0}},
        "floor": {"size": 3.0},
    }


def test_only_keys_that_differ_are_named(tmp_path):
    """Keys with equal values in all results are left out."""
    folders = [
        saved_result(tmp_path / "a", station(14000.0)),
        saved_result(tmp_path / "b", station(1500.0)),
    ]
    assert differing_settings(folders) == ["servo.kp.lift 14000", "servo.kp.lift 1500"]


def test_moves_and_missing_keys_are_named_but_not_what_a_program_decides(tmp_path):
    """Moves are compared, too, and a missing key is a dash. The duration of a program and bounds are left out."""
    weak, firm = ([{"grip": {"force": force}}, {"wait": 0.5}] for force in (1.0, 20.0))
    first = saved_result(tmp_path / "a", {**station(1.0), "gravity": 9.8, "duration": 3.0}, weak)

    second = saved_result(
        tmp_path / "b", {**station(1.0), "duration": 4.0, "verdict": {"heat": 2}}, firm
    )

    assert differing_settings([first, second]) == [
        "gravity 9.8, program.moves.0.grip.force 1",
        "gravity –, program.moves.0.grip.force 20",
    ]


def test_a_gain_of_one_joint_is_told_from_a_gain_of_all(tmp_path):
    """A gain of all axes is compared axis by axis with the gains of another result."""

    def saved(name, kp):
        servo = {"kp": kp, "kd": 100.0}
        return saved_result(
            tmp_path / name, {"servo": servo, "robot": {"model": "arm", "servo": servo}}
        )

    soft = saved("soft", {"knee": 30.0, "hip": 100.0, "ankle": 100.0})
    folders = [saved("stiff", 100.0), soft, saved("softer", {"knee": 20.0, "hip": 100.0})]
    assert differing_settings(folders[:2]) == ["servo.kp.knee 100", "servo.kp.knee 30"]
    assert differing_settings(folders)[2] == "servo.kp.ankle –, servo.kp.knee 20"


def test_a_servo_of_the_robot_alone_is_named_in_its_section(tmp_path):
    """A gain in the robot's own section is named with this section, if the one at the top is equal."""
    folders = [
        saved_result(tmp_path / f"{kp:g}", {"servo": {"kp": 5.0}, "robot": {"servo": {"kp": kp}}})
        for kp in (5.0, 7.0)
    ]
    assert differing_settings(folders) == ["robot.servo.kp 5", "robot.servo.kp 7"]


def test_equal_results_have_their_folders_alone(tmp_path):
    """The name of a result without differences is its folder."""
    folders = [saved_result(tmp_path / name, station(1.0)) for name in "ab"]
    assert [result.name for result in read_results(folders)] == [str(folder) for folder in folders]


def test_a_long_legend_stays_inside_of_a_narrow_figure(tmp_path):
    """Long names are broken into lines: the legend is within the figure and covers no frame."""
    parent = tmp_path / ("a_folder_with_a_long_name_" * 3)
    folders = [
        saved_result(parent / name, station(kp)) for name, kp in (("a", 14000.0), ("b", 1500.0))
    ]
    figure = overlay_figure(read_results(folders), ["q.lift"])

    save_figure(figure, tmp_path / "plot.png")

    (legend,) = figure.legends
    assert "servo.kp.lift 14000" in " ".join(legend.get_texts()[0].get_text().split())

    box = legend.get_window_extent()
    assert box.x0 >= -1
    assert box.x1 <= figure.bbox.x1 + 1
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)


@pytest.mark.parametrize("with_curve", [False, True])
def test_a_long_title_stays_inside_of_a_narrow_figure(tmp_path, with_curve):
    """A long title is broken into lines, with and without a legend."""
    figure, frames = panels("a title of many words " * 5, size=(4, 3))
    if with_curve:
        frames[0, 0].plot(np.arange(3), np.arange(3), label="curve")
    save_figure(figure, tmp_path / "plot.png")

    title = figure.legends[0].get_title() if with_curve else figure._suptitle

    assert title.get_window_extent().x1 <= figure.bbox.x1 + 1


@pytest.mark.parametrize(
    ("unit", "label", "factor"),
    [("rad", "deg", 57.29577951), ("rad/s", "deg/s", 57.29577951), ("m", "m", 1.0)],
)
def test_angles_and_their_speeds_are_drawn_in_degrees(unit, label, factor):
    values = np.array([-0.5, 0.0, 1.0])
    result = SavedSignals("run", np.arange(3.0), {"q.joint": values}, units={"q.joint": unit})

    (frame,) = overlay_figure([result]).axes

    np.testing.assert_allclose(frame.lines[0].get_ydata(), factor * values, rtol=1e-9)
    assert f"[{label}]" in f"{frame.get_title()} {frame.get_ylabel()}"
