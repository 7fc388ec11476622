"""Plots: the files, what the curves are, and how the end of a run is shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import SimulationResult, build_station, load_station, simulate, simulate_diagram
from simrob_drake.base.errors import OutputError, UnknownName
from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.results.plots import joint_plots
from simrob_drake.results.plots.grid import Curve, Plot, Stack, grid_figure
from simrob_drake.results.plots.joint_plots import side_groups
from simrob_drake.results.plots.own import save_plots
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.6, progress=False)


@pytest.fixture(scope="module")
def standing():
    return simulate(load_station("humanoid_dynamic"), duration=0.2, progress=False)


def changed(result, **columns):
    """Return a run whose signals of these names, with __ for a dot, are others."""
    values = result.values.copy()
    for name, column in columns.items():
        values[:, result.names.index(name.replace("__", "."))] = column
    return replace(result, values=values)


@pytest.fixture(scope="module")
def stopped():
    """A run that a monitor ends: joint 3 is on its way to 30 of 70 deg."""
    monitor = {"monitors.joint_limit": {"margin_deg": 60}}
    return simulate(load_station("irb120_dynamic", monitor), duration=0.6, progress=False)


@pytest.fixture(scope="module")
def drawn():
    """Draw the plots of a run and return their figures by the file's stem, unsaved.

    What a run of this module shows is drawn once: no test changes a figure that others look at.
    """
    known: list[tuple[SimulationResult, dict[str, Figure]]] = []

    def draw(result) -> dict[str, Figure]:
        for run, figures in known:
            if run is result:
                return figures
        figures: dict[str, Figure] = {}
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                Figure,
                "savefig",
                lambda figure, file, **_: figures.update({Path(file).stem: figure}),
            )
            save_plots(result, Path())
        known.append((result, figures))
        return figures

    return draw


def curve(panel, label):
    return next(line for line in panel.get_lines() if line.get_label() == label)


def labels(panel):
    return [line.get_label() for line in panel.get_lines()]


def texts(figure):
    return " ".join(text.get_text() for text in figure.texts)


@pytest.mark.long
def test_a_robot_with_a_tool_has_three_pictures(result, tmp_path):
    files = save_plots(result, tmp_path / "plots")
    assert [file.name for file in files] == ["position.png", "torque.png", "tcp.png"]
    for file in files:
        picture = imread(file)
        assert picture.shape[0] > 300
        assert picture.shape[1] > 800
        assert 0.01 < (picture[:, :, :3].min(axis=2) < 0.9).mean() < 0.5  # neither blank nor black


@pytest.mark.long
@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_plots_are_lines_where_that_is_asked_for_and_the_same_twice(kind, result, tmp_path):
    first, second = (save_plots(result, tmp_path / folder, kind) for folder in "ab")
    assert [file.name for file in first] == [f"position.{kind}", f"torque.{kind}", f"tcp.{kind}"]
    for file, again in zip(first, second, strict=True):
        assert file.read_bytes() == again.read_bytes()
        assert file.read_bytes()[:5] == {"svg": b"<?xml", "pdf": b"%PDF-"}[kind]


def test_plots_of_another_kind_are_refused_before_anything_is_written(result, tmp_path):
    with pytest.raises(UnknownName, match="no format of plots 'jpg'; did you mean 'png'"):
        result.save(tmp_path / "r", plots="jpg")
    assert not (tmp_path / "r").exists()


def test_what_is_applied_and_what_is_felt_are_plotted_together(drawn):
    """A sine of 5 N that a station's section gives, and 3 N that stand at its input."""
    station = build_station(load_station("irb120_cobot", {"inputs": ["external_force"]}))
    builder = DiagramBuilder()
    builder.AddSystem(station)
    source = builder.AddSystem(ConstantVectorSource([0.0, 0.0, 3.0]))
    builder.Connect(source.get_output_port(), station.GetInputPort("external_force"))
    hold = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    builder.Connect(hold.get_output_port(), station.GetInputPort("reference"))

    result = simulate_diagram(builder.Build(), station.ports, duration=0.4, progress=False)

    np.testing.assert_allclose(
        result.vector("applied_force"), np.tile([0.0, 0.0, 3.0], (len(result.times), 1))
    )

    figure = drawn(result)["sensors"]
    assert "irb120_cobot: applied forces" in texts(figure)

    titles = [panel.get_title(loc="left") for panel in figure.axes]
    assert titles == [
        "external force at load, in the tool's axes",
        "applied force 'hand' at load, in its axes",
    ]
    assert np.abs(curve(figure.axes[1], "z").get_ydata()).max() == pytest.approx(5.0, rel=0.01)


def test_angles_of_panels_are_in_degrees(result, drawn):
    panel = Panel("own", "a block", "lean", "lean [rad]", ("q.joint_1",))
    (panel,) = drawn(
        replace(result, signals=(Signal(panel.columns, ("rad",), "own", panel=panel),))
    )["own"].axes

    assert panel.get_ylabel() == "lean [deg]"
    np.testing.assert_allclose(curve(panel, "joint_1").get_ydata(), np.rad2deg(result["q.joint_1"]))


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_any_name_is_drawn_as_it_is(result, tmp_path):
    named = replace(result, config=result.config.model_copy(update={"name": "a$b_{$ 机器人"}))
    assert len(save_plots(named, tmp_path)) == 3


def test_several_robots_have_their_own_pictures(drawn):
    result = simulate(load_station("two_irb120"), duration=0.05, progress=False)
    names = [
        f"{robot}_{what}" for robot in ("left", "right") for what in ("position", "torque", "tcp")
    ]
    assert list(drawn(result)) == names


def test_positions_are_in_degrees_with_reference_and_error(result, drawn):
    position, error = drawn(result)["position"].axes[2:4]  # two panels an axis

    reached, wanted = np.rad2deg(result["q.joint_2"]), np.rad2deg(result["q_ref.joint_2"])
    np.testing.assert_allclose(curve(position, "position").get_ydata(), reached)
    np.testing.assert_allclose(curve(position, "reference").get_ydata(), wanted)
    assert curve(position, "reference").get_linestyle() == "--"
    np.testing.assert_allclose(
        curve(error, "error: reference - position").get_ydata(), wanted - reached
    )


def test_the_tool_is_shown_with_its_reference_and_what_it_misses(result, drawn):
    """Against the pose that the plant tells for the reference; the strips tell the same angles as the curves."""
    figure = drawn(result)["tcp"]
    panels = figure.axes[::2]
    assert [panel.get_title(loc="left") for panel in panels] == ["x", "y", "z", "Rz", "Ry", "Rx"]

    row = len(result.times) // 2
    robot = result.plant.robots["robot"]
    context = robot.plant.CreateDefaultContext()
    robot.plant.SetPositions(context, result.axes("q_ref")[row])
    wanted = robot.tools[robot.tcp].CalcPoseInWorld(context)

    reached = transform_from_xyz_quaternion(result.pose("tcp")[row])
    for of, pose in (("reference", wanted), ("tool centre point", reached)):
        shown = [curve(panel, of).get_ydata()[row] for panel in panels]
        np.testing.assert_allclose(shown[:3], pose.translation(), atol=1e-12)
        turn = RollPitchYaw(*np.deg2rad(shown[:2:-1])).ToRotationMatrix()
        np.testing.assert_allclose(turn.matrix(), pose.rotation().matrix(), atol=1e-9)

    errors = [panel.get_lines()[0].get_ydata()[row] for panel in figure.axes[1::2]]
    np.testing.assert_allclose(
        errors[:3], 1e3 * (wanted.translation() - reached.translation()), atol=1e-9
    )

    asked, got = (
        [curve(panel, of).get_ydata()[row] for panel in panels[3:]]
        for of in ("reference", "tool centre point")
    )
    assert np.abs(errors[3:]).max() > 0.1
    np.testing.assert_allclose(errors[3:], np.subtract(asked, got), atol=1e-9)


@pytest.mark.parametrize(
    ("reached", "shown"),
    [((2, 81, 1), (1, 80, 2)), ((361, 79, 2), (361, 80, 2)), ((182, 99, 181), (181, 100, 182))],
)
def test_angles_of_the_reference_are_those_nearest_to_the_tools(reached, shown):
    """Of all Rz, Ry, Rx of one orientation: else the error would jump by 180 degrees where Ry goes through 90."""
    found = np.rad2deg(joint_plots._nearest(*np.deg2rad([[[1.0, 80.0, 2.0]], [reached]])))

    np.testing.assert_allclose(found, [shown])

    one, same = (
        RollPitchYaw(*np.deg2rad(angles[::-1])).ToRotationMatrix() for angles in ((1, 80, 2), shown)
    )
    assert one.IsNearlyEqualTo(same, 1e-12)


def test_where_small_turns_are_large_angles_the_plot_says_so(result, drawn):
    half = np.full(len(result.times), np.deg2rad(44))  # of Ry
    nothing = np.zeros_like(half)
    upright = changed(
        result, tcp__qw=np.cos(half), tcp__qx=nothing, tcp__qy=np.sin(half), tcp__qz=nothing
    )

    notes = [panel.get_title(loc="right") for panel in drawn(upright)["tcp"].axes[6::2]]

    assert notes == [
        "large where Ry is near ±90 deg (gimbal lock)",
        "",
        "large where Ry is near ±90 deg (gimbal lock)",
    ]
    assert not any(panel.get_title(loc="right") for panel in drawn(result)["tcp"].axes)


def test_angles_that_go_on_turning_do_not_jump(result, drawn):
    # of Rz, through 180 degrees
    half = np.linspace(np.deg2rad(85), np.deg2rad(100), len(result.times))
    nothing = np.zeros_like(half)

    turning = changed(
        result, tcp__qw=np.cos(half), tcp__qx=nothing, tcp__qy=nothing, tcp__qz=np.sin(half)
    )

    np.testing.assert_allclose(
        curve(drawn(turning)["tcp"].axes[6], "tool centre point").get_ydata(), np.rad2deg(2 * half)
    )


def test_a_kinematic_run_has_no_error(drawn):
    result = simulate(load_station("irb120_kinematic"), duration=0.1, progress=False)
    assert len(drawn(result)["position"].axes) == 6


def test_a_limit_is_drawn_where_the_torque_comes_near_and_said_everywhere(result, drawn):
    limited = simulate(
        load_station("irb120_dynamic", {"servo.torque_limit": 15}), duration=0.6, progress=False
    )
    near = drawn(limited)["torque"].axes[1]

    assert {tuple(line.get_ydata()[:1]) for line in near.get_lines()[1:]} == {(15.0,), (-15.0,)}

    far = drawn(result)["torque"].axes[1]
    assert labels(far) == ["torque"]
    assert far.get_title(loc="right") == "limit ±150 N·m"


@pytest.mark.parametrize("name", ["position", "torque", "tcp"])
def test_the_end_of_a_stopped_run_is_marked_with_its_reason(name, drawn, result, stopped):
    assert 0 < stopped.stop_time < 0.6

    figure = drawn(stopped)[name]
    assert f"stopped by joint_limit: {stopped.message}" in texts(figure)
    assert all(curve(panel, "stop").get_xdata()[0] == stopped.stop_time for panel in figure.axes)

    completed = drawn(result)[name]
    assert "stopped" not in texts(completed)
    assert not any("stop" in labels(panel) for panel in completed.axes)


@pytest.mark.long
def test_a_run_that_is_stopped_at_its_start_shows_a_point(drawn):
    result = simulate(
        load_station("irb120_dynamic", {"monitors.joint_limit": {"margin_deg": 70}}), progress=False
    )
    assert result.stop_time == 0
    assert curve(drawn(result)["position"].axes[0], "position").get_marker() == "o"


def test_what_a_run_diverges_with_does_not_flatten_the_rest(result, drawn):
    values = result.values.copy()
    values[-1] = 1e300
    values[-2] = np.inf
    message = "diverged at 0.6 s: a state is no number any more"
    diverged = replace(
        result, values=values, ending="diverged", stopped_by="diverged", message=message
    )

    figure = drawn(diverged)["position"]

    assert message in texts(figure)
    assert np.abs(figure.axes[0].get_ylim()).max() < 90


def test_a_folder_that_cannot_be_made_is_one_clear_error(result, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match="taken"):
        save_plots(result, tmp_path / "taken")


def test_right_and_left_joints_share_a_panel_and_none_is_lost(standing, drawn):
    figure = drawn(standing)["torque"]
    panels = {panel.get_title(loc="left"): panel for panel in figure.axes}

    assert list(panels)[:3] == ["shoulder_pitch", "shoulder_roll", "elbow"]
    assert labels(panels["knee"]) == ["right", "left"]
    for side in ("right", "left"):
        np.testing.assert_array_equal(
            curve(panels["knee"], side).get_ydata(), standing[f"tau.{side}_knee"]
        )
    np.testing.assert_array_equal(
        curve(panels["neck_yaw"], "middle").get_ydata(), standing["tau.neck_yaw"]
    )

    groups = side_groups(standing.plant.robots["robot"])
    assert sorted(place for group in groups for place in group.axes.values()) == list(range(18))


def test_the_sides_of_a_quadruped_are_told_apart_in_front_and_behind():
    robot = next(
        iter(add_plant(DiagramBuilder(), resolve(load_station("yobotics_dynamic"))).robots.values())
    )
    found = {
        group.name: [robot.axes[place] for place in group.axes.values()]
        for group in side_groups(robot)
    }

    assert found["rear_knee"] == ["rear_right_knee", "rear_left_knee"]
    assert found["front_knee"] == ["front_right_knee", "front_left_knee"]
    assert len(found) == 6


def test_only_a_free_base_with_feet_has_a_plot(standing, result, drawn):
    assert "base" in drawn(standing)
    assert "base" not in drawn(result)
    assert "base" not in drawn(
        simulate(load_station("humanoid_fixed"), duration=0.02, progress=False)
    )


def test_the_plot_of_the_base_tells_its_way_tilt_and_yaw(standing, drawn):
    """The base goes 3 m to x and 1 m to y while it turns by 200 degrees, then tilted by 20 degrees about x."""
    part = standing.times / standing.stop_time
    half, lean = np.deg2rad(200) * part / 2, np.deg2rad(20) / 2
    turned = {"qw": np.cos(half), "qz": np.sin(half)}
    pose = {
        "x": 3 * part,
        "y": part,
        "z": 0.3,
        "qw": turned["qw"] * np.cos(lean),
        "qz": turned["qz"] * np.cos(lean),
    }
    pose |= {"qx": turned["qw"] * np.sin(lean), "qy": turned["qz"] * np.sin(lean)}
    walked = changed(standing, **{f"base__{name}": values for name, values in pose.items()})

    way, height, tilt, yaw, above = drawn(walked)["base"].axes

    np.testing.assert_allclose(curve(way, "x").get_ydata(), 3 * part)
    np.testing.assert_allclose(curve(way, "y").get_ydata(), part)
    np.testing.assert_allclose(curve(height, "z").get_ydata(), 0.3)
    np.testing.assert_allclose(curve(tilt, "tilt").get_ydata(), 20.0)
    np.testing.assert_allclose(curve(yaw, "yaw").get_ydata(), 200 * part, atol=1e-9)
    assert [panel.get_ylabel() for panel in (way, height, tilt, yaw)] == [
        "x, y [m]",
        "height z [m]",
        "tilt [deg]",
        "yaw [deg]",
    ]
    np.testing.assert_allclose(above.get_lines()[0].get_xydata(), np.column_stack([3 * part, part]))

    origin, along_x, along_y = above.transData.transform([(0, 0), (1, 0), (0, 1)])
    assert along_x[0] - origin[0] == pytest.approx(along_y[1] - origin[1])  # equal axes


@pytest.fixture(scope="module")
def far(standing):
    """A run whose axes have numbers of many digits."""
    return changed(
        standing,
        tcp__x=-0.0832 + 1e-5 * standing.times,
        tau__left_knee=-1234.5678 * standing.times,
        base__z=0.2 + 1e-4 * standing.times,
    )


@pytest.mark.parametrize("name", ["position", "torque", "tcp", "base"])
def test_numbers_and_labels_keep_clear_of_each_other_and_of_the_edge(far, name, drawn):
    figure = drawn(far)[name]
    figure.draw_without_rendering()

    edge = figure.bbox.padded(0.1)

    for panel in figure.axes:
        numbers = [text.get_window_extent() for text in panel.get_yticklabels() if text.get_text()]
        assert all(edge.x0 <= box.x0 for box in numbers)
        if panel.get_ylabel():
            label = panel.yaxis.get_label().get_window_extent()
            assert label.x0 >= edge.x0
            assert all(label.x1 <= box.x0 for box in numbers)
        others = [other.get_window_extent() for other in figure.axes if other is not panel]
        assert not any(box.overlaps(other) for box in numbers for other in others)


def test_a_long_run_that_moves_all_the_time_is_shown_in_detail_too(result, drawn):
    times = np.linspace(0.0, 30.0, len(result.times))
    slow = replace(result, times=times, positions_at=lambda at: result.positions_at(at / 50))
    busy = changed(slow, tau__joint_2=(-1.0) ** np.arange(len(times)))

    figures = drawn(busy)

    assert set(figures) == {"position", "torque", "torque_detail", "tcp"}

    detail = curve(figures["torque_detail"].axes[1], "torque")
    assert detail.get_xdata()[[0, -1]] == pytest.approx([13.5, 16.5], abs=0.51)

    whole = curve(figures["torque"].axes[1], "torque")
    assert whole.get_linewidth() < detail.get_linewidth()
    assert set(drawn(slow)) == {"position", "torque", "tcp"}  # long, but calm


def test_noise_makes_no_thin_lines(result, drawn):
    noisy = changed(result, tau__joint_2=1e-9 * (-1.0) ** np.arange(len(result.times)))
    calm, loud = (
        drawn(run)["torque"].axes[0].get_lines()[0].get_linewidth() for run in (noisy, result)
    )
    assert calm == loud


def test_a_free_piece_is_shown_where_it_is_and_how_fast(drawn):
    result = simulate(load_station("bouncing_ball"), duration=0.2, progress=False)
    position, velocity = drawn(result)["piece_ball"].axes

    assert (position.get_ylabel(), velocity.get_ylabel()) == ("position [m]", "velocity [m/s]")
    for axis in "xyz":
        np.testing.assert_array_equal(
            curve(position, axis).get_ydata(), result[f"piece.ball.{axis}"]
        )
        np.testing.assert_array_equal(
            curve(velocity, f"v{axis}").get_ydata(), result[f"piece.ball.v{axis}"]
        )


@pytest.mark.long
def test_sensors_share_a_figure_which_tells_why_the_run_was_stopped(drawn):
    result = simulate(load_station("irb120_force_stop"), progress=False)
    figure = drawn(result)["sensors"]

    assert [panel.get_title(loc="left") for panel in figure.axes] == [
        "contact force 'touch'",
        "distance 'gap'",
    ]
    assert result.message in texts(figure)
    assert all(curve(panel, "stop").get_xdata()[0] == result.stop_time for panel in figure.axes)
    force, distance = figure.axes
    assert [text.get_text() for text in force.get_legend().get_texts()] == ["x", "y", "z"]
    assert distance.get_legend() is None  # one curve, which the title names


def test_many_curves_of_a_panel_are_told_apart(standing, drawn):
    axes = standing.plant.robots["robot"].axes[:-1]
    # not of the axes alone, which would be drawn one by one
    columns = (
        *(f"tau.{axis}" for axis in axes),
        "base.z",
    )
    panels = (
        Panel("own", "a block", "drive", "torque [N·m]", columns),
        Panel("own", "a block", "one", "u", columns[:1]),
    )
    signals = tuple(
        Signal(panel.columns, ("1",) * len(panel.columns), "motion", panel=panel)
        for panel in panels
    )

    figure = drawn(replace(standing, signals=signals))["own"]
    assert "a block" in texts(figure)

    lines = figure.axes[0].get_lines()
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == len(columns) == 18

    figure.draw_without_rendering()
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [*axes, "z"]

    box, frame = legend.get_window_extent(), figure.axes[0].get_window_extent()
    assert frame.x1 <= box.x0 < box.x1 <= figure.bbox.x1
    assert frame.y0 <= box.y0


def sheet(run, *entries, role="own"):
    """Return the run with panels of a block, each a title, columns with their units, and perhaps names of these."""
    signals = []
    for title, units, *components in entries:
        panel = Panel(
            "controller_b",
            "the block 'b'",
            title,
            f"{title} [{', '.join(units.values())}]",
            tuple(units),
        )
        panel = replace(panel, components=components[0]) if components else panel
        signals.append(Signal(panel.columns, tuple(units.values()), role, panel=panel))
    return replace(run, signals=tuple(signals))


def test_what_a_loop_gives_each_axis_is_shown_joint_by_joint(standing, drawn):
    """Right and left share a panel; those that do not move are named, and numbers that are no axes stand apart."""
    axes = standing.plant.robots["robot"].axes
    time = standing.times
    moved = changed(
        standing,
        **{f"q__{axis}": np.full(len(time), 0.3) for axis in axes},
        **{f"v__{axis}": 1e-3 * np.sin(9 * time) for axis in axes},  # a noise beside what moves
    )
    moved = changed(moved, **{f"tau__{axis}": 2.0 for axis in axes})
    moved = changed(
        moved, q__right_knee=0.5 + time, v__right_knee=1 + 8 * time, q__left_knee=0.5 - time
    )
    run = sheet(
        moved,
        ("target", {f"q.{axis}": "rad" for axis in axes}),
        ("rate", {f"v.{axis}": "rad/s" for axis in axes}),
        ("height", {"base.z": "m"}),
        ("effort", {f"tau.{axis}": "N·m" for axis in axes}),
    )

    figures = drawn(run)

    assert {"controller_b", "controller_b_axes"} <= set(figures)
    target, rate = figures["controller_b_axes"].axes
    assert target.get_title(loc="left") == "knee"
    assert (target.get_ylabel(), rate.get_ylabel()) == ("target [deg]", "rate [rad/s]")
    assert labels(target) == labels(rate) == ["right", "left"]
    np.testing.assert_allclose(curve(target, "left").get_ydata(), np.rad2deg(0.5 - time))

    said = texts(figures["controller_b_axes"]).replace("\n", " ")
    assert "almost constant, not plotted: shoulder_pitch, shoulder_roll, elbow" in said
    assert "effort of every axis" in said
    assert "knee" not in said
    assert figures["controller_b_axes"].get_size_inches()[0] < 7.5


@pytest.mark.long
def test_constants_of_a_block_are_named_and_its_numbers_have_names_and_units_of_their_own(
    result, drawn
):
    time = result.times
    columns = {"tcp.x": "m/s", "tcp.y": "m/s", "tcp.z": "rad"}
    run = changed(
        result, tcp__x=time, tcp__y=0.25 + 0 * time, tcp__z=0.1 * time, tau__joint_1=3.0 + 0 * time
    )
    run = sheet(
        run, ("command", columns, ("ahead", "left", "turn")), ("count", {"tau.joint_1": "1"})
    )

    figure = drawn(run)["controller_b"]

    assert [panel.get_ylabel() for panel in figure.axes] == ["command [m/s]", "command [deg]"]
    assert [labels(panel) for panel in figure.axes] == [["ahead"], ["turn"]]
    assert "constant, not plotted: command left 0.25 m/s, count 3" in texts(figure)

    every = drawn(replace(run, signals=tuple(replace(one, role="motion") for one in run.signals)))[
        "controller_b"
    ]
    assert [labels(panel) for panel in every.axes] == [["ahead", "left"], ["turn"], ["joint_1"]]


def test_what_a_loop_tells_before_its_first_sample_sets_no_scale(result, drawn):
    target = np.where(result.times > 0, 100.0 + result.times, 0.0)
    (panel,) = drawn(sheet(changed(result, tcp__x=target), ("target", {"tcp.x": "N"})))[
        "controller_b"
    ].axes
    assert panel.get_ylim()[0] > 99


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ((0.0, 2.5e-7, 5e-7), ["0", "2.5e-07", "5e-07"]),
        ((1e9, 1.5e9), ["1e+09", "1.5e+09"]),
        ((999999.25, 999999.5), ["999999.25", "999999.50"]),
        ((-0.025, 0.0, 0.025), ["-0.025", "0.000", "0.025"]),
    ],
)
def test_numbers_at_an_axis_need_no_power_of_ten_over_it(values, texts, result):
    stack = Stack("one", [Plot("u", [Curve(result.times, "u", "0")])])
    shown = grid_figure(result, "numbers", [stack]).axes[0].yaxis.get_major_formatter()

    assert [
        text.replace("\N{MINUS SIGN}", "-") for text in shown.format_ticks(list(values))
    ] == texts
    assert shown.get_offset() == ""


def test_a_constant_is_drawn_whatever_its_size(result, drawn):
    constant = changed(result, tau__joint_1=1e6)
    panel = Panel("own", "a block", "count", "count", ("tau.joint_1",))
    signal = Signal(panel.columns, ("1",), "own", panel=panel)

    low, high = drawn(replace(constant, signals=(signal,)))["own"].axes[0].get_ylim()

    assert low < 1e6 < high
    assert high - low < 10


def test_a_long_reason_is_told_to_its_end(result, drawn):
    message = (
        "diverged at 0.6 s: "
        + "the state of a joint that nobody thought of is no number any more, " * 5
        + "end"
    )
    figure = drawn(replace(result, ending="diverged", stopped_by="diverged", message=message))[
        "torque"
    ]

    assert message in texts(figure)

    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in figure.texts]

    titles = [
        text.get_window_extent()
        for text in figure.findobj(Text)
        if text.get_text().startswith("joint_")
    ]

    assert len(titles) == 6
    assert all(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 for box in boxes)
    assert not any(box.overlaps(title) for box in boxes for title in titles)


@pytest.mark.long
def test_of_hundreds_of_axes_a_figure_shows_the_first_and_says_so(result):
    values = np.zeros_like(result.times)
    stacks = [
        Stack(f"joint_{place}", [Plot("torque [N·m]", [Curve(values, "torque", "0")])])
        for place in range(300)
    ]

    figure = grid_figure(result, "joint torques", stacks)

    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"joint_{place}" for place in range(48)
    ]
    assert "joint torques: the first 48 of 300" in texts(figure)
    assert "the first" not in texts(grid_figure(result, "joint torques", stacks[:48]))
