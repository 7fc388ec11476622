"""The result folder: what is in it, that it is whole, and that it can be run again."""

import csv
import json

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import Workcell, load_station, simulate
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, OutputError, UnknownName
from simrob_drake.blocks.references import sequence
from simrob_drake.results.record.walks import locomotion

pytestmark = pytest.mark.usefixtures("no_plots")


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.25)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    return result.save(tmp_path_factory.mktemp("runs") / "first", recording=False)


@pytest.mark.long
def test_the_summary_holds_what_the_contract_says(result, folder):
    """`summary.json` has the documented keys, with the values of the result."""
    summary = json.loads((folder / "summary.json").read_text())

    assert {
        "station",
        "robot",
        "duration",
        "stopped_by",
        "stop_time",
        "message",
        "solver",
        "wall_time",
    } <= set(summary)
    assert (summary["station"], summary["robot"], summary["stopped_by"]) == (
        "irb120_dynamic",
        "irb120",
        None,
    )
    assert summary["duration"] == summary["stop_time"] == 0.25
    assert summary["final"]["joint_position"]["joint_2"] == result["q.joint_2"][-1]
    assert summary["final"]["base_pose"] == [0, 0, 0, 0, 0, 0]
    assert len(summary["final"]["tcp_pose"]) == 6

    peaks = np.abs(result.axes("tau")).max(axis=0)
    np.testing.assert_allclose(np.abs(list(summary["peak"]["joint_torque"].values())), peaks)
    assert summary["realtime_rate"] > 1
    assert set(summary["versions"]) == {"simrob_drake", "drake", "numpy", "python"}


def test_the_signals_file_holds_the_same_bits(result, folder):
    """`signals.csv` reads back to the same numbers to the last bit."""
    with (folder / "signals.csv").open() as lines:
        header, *rows = csv.reader(lines)

    assert header[:2] == ["time", "q_ref.joint_1"]
    assert {"q.joint_6", "v.joint_1", "tau.joint_2", "base.x", "base.qz", "tcp.x", "tcp.qw"} <= set(
        header
    )
    np.testing.assert_array_equal(
        np.array(rows, dtype=float), np.column_stack([result.times, result.values])
    )


def test_the_saved_station_gives_the_same_result(result, folder):
    """The station's file of a result repeats the run to the last bit."""
    again = simulate(load_station(folder / "station.yaml"))
    np.testing.assert_array_equal(again.values, result.values)


@pytest.mark.parametrize("station", ["irb120_dynamic", "irb120_kinematic"])
def test_a_run_with_its_own_samples_can_be_run_again(station, tmp_path):
    """Samples that were passed to the run are saved as a CSV file, and the folder can be moved."""
    times = np.linspace(0, 0.2, 9)
    positions = np.outer(np.sin(5 * times), np.full(6, 0.1))
    result = simulate(load_station(station), reference=(times, positions), duration=0.2)

    folder = result.save(tmp_path / "own", recording=False)

    assert (folder / "reference.csv").is_file()

    moved = folder.rename(tmp_path / "elsewhere")  # nothing in it names the old place
    np.testing.assert_array_equal(
        simulate(load_station(moved / "station.yaml")).values, result.values
    )


BREAKS, POINTS = [-0.05, 0.1, 0.3], np.full((6, 3), 0.1) * [0, 1, 1.5]


@pytest.mark.parametrize(
    ("trajectory", "rows", "within"),
    [
        # cubics: its break and the run's ends
        (
            PiecewisePolynomial.CubicShapePreserving(BREAKS, POINTS),
            3,
            1e-12,
        ),
        (sequence(np.zeros(6), [0.1, 0.3], [*POINTS.T[1:]]), 201, 1e-7),  # of the fifth degree
        # with a corner in its velocity
        (
            PiecewisePolynomial.FirstOrderHold(BREAKS, POINTS),
            201,
            1e-4,
        ),
    ],
    ids=["cubic", "quintic", "corner"],
)
def test_a_trajectory_is_saved_as_what_gives_it_back(tmp_path, trajectory, rows, within):
    """A trajectory is saved as a table with speeds that repeats the run within the error of the table."""
    station = load_station("irb120_dynamic", {"inputs": ["reference_velocity"]})
    result = simulate(station, reference=trajectory, duration=0.2)

    folder = result.save(tmp_path / "own", recording=False)

    assert len((folder / "reference.csv").read_text().splitlines()) == 1 + rows

    again = simulate(load_station(folder / "station.yaml"))
    np.testing.assert_allclose(again.axes("q_ref"), result.axes("q_ref"), atol=within)
    np.testing.assert_allclose(again.axes("q"), result.axes("q"), atol=within)

    saved_again = again.save(tmp_path / "again", recording=False)
    assert (saved_again / "reference.csv").read_bytes() == (folder / "reference.csv").read_bytes()


def test_samples_are_joined_again_as_they_were(tmp_path):
    """The saved table has the interpolation that the run used for its samples."""
    samples = np.linspace(0, 0.2, 5), np.outer(np.linspace(0, 0.2, 5) ** 2, np.ones(6))
    station = load_station("irb120_dynamic", {"inputs": ["reference_velocity"]})
    result = simulate(station, reference=samples, duration=0.2)

    again = simulate(load_station(result.save(tmp_path / "own", recording=False) / "station.yaml"))

    np.testing.assert_array_equal(again.values, result.values)


def test_a_run_that_began_in_another_ones_end_can_be_run_again(result, tmp_path):
    """A start state is saved as `start.json`, and the station's file begins in it."""
    later = simulate("irb120_dynamic", duration=0.2, start=result.final_state)
    folder = later.save(tmp_path / "later", recording=False)

    assert "start: start.json" in (folder / "station.yaml").read_text()

    again = simulate(folder / "station.yaml")
    np.testing.assert_array_equal(again.values, later.values)
    np.testing.assert_array_equal(
        Workcell(folder / "station.yaml").position("robot"), result.axes("q")[-1]
    )


@pytest.mark.parametrize(
    ("content", "what"),
    [(None, r"cannot be read \(No such .*\)"), ("{}", "positions: this key is required")],
)
def test_a_start_that_is_none_is_refused(tmp_path, content, what):
    """A file of the key `start` that is missing or has no state raises an error with the expected file."""
    if content is not None:
        (tmp_path / "start.json").write_text(content)
    with pytest.raises(
        InvalidConfig,
        match=rf"start\.json: {what}; the key `start` expects the file start\.json of a result",
    ):
        simulate(load_station("double_pendulum", {"start": str(tmp_path / "start.json")}))


@pytest.mark.parametrize(("begin", "held"), [(5.0, 0.0), (-5.0, 0.2)])
def test_a_trajectory_outside_of_the_run_is_saved_as_what_it_was_a_hold(tmp_path, begin, held):
    """Before its start and after its end a trajectory holds its first or last position."""
    trajectory = PiecewisePolynomial.FirstOrderHold(
        [begin, begin + 1], np.full((6, 2), 1.0) * [0, 0.2]
    )
    result = simulate(load_station("irb120_dynamic"), reference=trajectory, duration=0.2)

    again = simulate(load_station(result.save(tmp_path / "own", recording=False) / "station.yaml"))

    np.testing.assert_allclose(again.axes("q_ref"), held)
    # rounding of the spline
    np.testing.assert_allclose(again.axes("q_ref"), result.axes("q_ref"), rtol=0, atol=1e-15)


def test_a_robot_is_named_where_there_is_not_just_one(result):
    """Signals of axes need the name of the robot in stations of several robots."""
    with pytest.raises(UnknownName, match="no robot 'nobody'; known: robot"):
        result.axes("q", "nobody")

    both = simulate(load_station("two_irb120"), duration=0.02)
    for signal in (lambda: both.axes("q"), lambda: both.pose("tcp")):
        with pytest.raises(InvalidParameter, match="robot is None; it must be one of left, right"):
            signal()
    with pytest.raises(InvalidParameter, match="there is no legged robot"):
        locomotion(both)
    with pytest.raises(UnknownName, match="no legged robot 'left'"):
        locomotion(both, "left")

    ball = simulate(load_station("bouncing_ball"), duration=0.02)
    with pytest.raises(InvalidParameter, match="there is no robot"):
        ball.axes("q")


def test_columns_of_several_robots_carry_their_names(tmp_path):
    """Columns and entries of the summary begin with the name of their robot."""
    result = simulate(load_station("two_irb120"), duration=0.05)

    assert "left.q.joint_1" in result.names
    assert "right.tcp.x" in result.names

    summary = result.summary()
    assert set(summary["robot"]) == {"left", "right"}
    assert "right.joint_6" in summary["final"]["joint_torque"]
    assert set(summary["final"]["tcp_pose"]) == {"left", "right"}


def test_nothing_is_overwritten_without_force(result, folder):
    """An earlier result is replaced with `force` only."""
    before = sorted(folder.iterdir())

    with pytest.raises(OutputError, match=r"exists already.*--force"):
        result.save(folder)
    assert sorted(folder.iterdir()) == before

    result.save(folder, force=True, recording=False)
    assert (folder / "summary.json").is_file()


def test_a_folder_that_is_no_result_is_never_replaced(result, tmp_path):
    """A folder without `summary.json` is not replaced, even with `force`."""
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(OutputError, match="contains files that are not a result"):
        result.save(tmp_path, force=True)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_a_folder_that_cannot_be_made_is_named(result, tmp_path):
    """The error of a folder that cannot be made has its path."""
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/result cannot be written: Not a directory"):
        result.save(tmp_path / "file" / "result")


def test_nothing_half_written_is_left(result, tmp_path, monkeypatch):
    """If writing fails, neither the folder nor a temporary one remains."""

    def full_disk(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("simrob_drake.results.files.write_table", full_disk)
    with pytest.raises(OutputError, match="No space left on device"):
        result.save(tmp_path / "result", recording=False)
    assert list(tmp_path.iterdir()) == []
