"""A run that was stopped is continued as if it had never been stopped, to the last bit."""

import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import Runner, State, load_station, simulate, simulate_diagram
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.results.record.history import StateHistory
from simrob_drake.simulation.resume import RepeatedSteps, StepsDiffer
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

pytestmark = pytest.mark.usefixtures("no_plots")

PUSH = {"kind": "push", "start": 0.42, "duration": 0.15, "force": [0, 4, 0]}


def assert_equal_runs(first, second):
    """Check that two runs have the same samples, steps and end."""
    np.testing.assert_array_equal(first.times, second.times)
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.step_times, second.step_times)
    assert first.message == second.message
    for name, joint in first.final_state.joints.items():
        np.testing.assert_array_equal(joint.position, second.final_state.joints[name].position)
        np.testing.assert_array_equal(joint.velocity, second.final_state.joints[name].velocity)


@pytest.mark.parametrize(
    ("station", "overrides"),
    [
        ("humanoid_dynamic", {"forces": {"shove": PUSH}}),  # cenic, with a push across the cuts
        ("bouncing_ball", {}),  # runge_kutta3 with error control, and impacts
        ("irb120_dynamic", {}),  # radau3, which keeps its Jacobian from step to step
        ("irb120_cobot", {}),  # a sampled controller
        ("irb120_dynamic", {"solver": {"kind": "discrete"}, "servo.realization": "implicit"}),
        ("irb120_kinematic", {}),
    ],
)
def test_a_resumed_run_equals_the_whole_one(station, overrides):
    runner = Runner(load_station(station, overrides))
    whole = runner.run(duration=0.8)
    for cut in (0.3137, 0.5):
        part = runner.run(duration=cut)
        assert_equal_runs(runner.resume(part, until=0.8), whole)

        kept = runner.run(duration=0.8 - cut, start=part.final_state, start_time="keep")
        assert kept.start_time == cut
        later = whole.times > cut + 1e-9
        np.testing.assert_array_equal(kept.times[1:-1], whole.times[later][:-1])
        np.testing.assert_array_equal(kept.values[1:-1], whole.values[later][:-1])


def test_step_times_of_a_run_that_continues_another_begin_at_its_start():
    """The steps of the earlier run, which the solver repeats, are none of its own."""
    runner = Runner("humanoid_dynamic")
    part = runner.run(duration=0.3137)

    kept = runner.run(duration=0.1, start=part.final_state, start_time="keep")

    assert kept.step_times[0] == 0.3137
    assert (np.diff(kept.step_times) > 0).all()


def test_the_cut_run_of_before_would_differ():
    """The end of a run shortens its last steps: the continued run does not contain them."""
    runner = Runner(load_station("humanoid_dynamic"))
    part = runner.run(duration=0.3137)

    resumed = runner.resume(part, until=0.5)

    assert 0.3137 in part.step_times
    assert 0.3137 not in resumed.step_times


def test_resuming_twice_equals_resuming_once():
    runner = Runner(load_station("humanoid_dynamic"))
    first = runner.run(duration=0.3)

    twice = runner.resume(runner.resume(first, until=0.47), until=0.8)

    assert_equal_runs(twice, runner.run(duration=0.8))

    kept = runner.run(duration=0.17, start=first.final_state, start_time="keep")
    again = runner.run(duration=0.33, start=kept.final_state, start_time="keep")

    later = twice.times > 0.47 + 1e-9
    np.testing.assert_array_equal(again.values[1:-1], twice.values[later][:-1])


def test_a_start_without_its_time_begins_anew():
    """Without start_time, the push acts once more, at its time after the start."""
    runner = Runner(load_station("humanoid_dynamic", {"forces": {"shove": PUSH}}))
    part = runner.run(duration=0.6)
    anew = runner.run(duration=0.6, start=part.final_state)

    kept = runner.run(duration=0.6, start=part.final_state, start_time="keep")

    assert (anew.start_time, kept.start_time) == (0.0, 0.6)
    assert anew["applied_force.shove.y"][50] == 4.0
    assert not kept["applied_force.shove.y"].any()


def test_a_state_from_a_file_keeps_its_time():
    runner = Runner(load_station("irb120_dynamic"))
    part = runner.run(duration=0.5)

    read = State.from_json(part.final_state.to_json())

    assert read.time == 0.5

    whole = runner.run(duration=0.8)
    kept = runner.run(duration=0.3, start=read, start_time="keep")

    np.testing.assert_allclose(kept.axes("q")[-1], whole.axes("q")[-1], atol=1e-3)
    np.testing.assert_array_equal(kept.axes("q_ref")[-1], whole.axes("q_ref")[-1])


def test_a_changed_state_is_where_the_run_begins():
    runner = Runner(load_station("irb120_dynamic"))
    part = runner.run(duration=0.5)
    state = part.final_state
    moved = {name: values + 0.1 for name, values in state.positions.items()}
    changed = State(moved, state.velocities, state.references, time=state.time)

    kept = runner.run(duration=0.1, start=changed, start_time="keep")

    np.testing.assert_allclose(kept.axes("q")[0], part.axes("q")[-1] + 0.1)


def test_callbacks_see_new_steps_only():
    runner = Runner(load_station("humanoid_dynamic"))
    part = runner.run(duration=0.3)
    seen = []

    runner.resume(part, until=0.5, on_step=lambda time, positions: seen.append(time))

    assert min(seen) > 0.3
    assert max(seen) == 0.5


def test_a_monitor_that_has_waited_goes_on_waiting():
    """The condition of a monitor with ``hold`` has been met before the cut; the wait goes on."""
    overrides = {"servo.torque_limit": 12, "monitors.torque_limit.hold": 0.3}
    runner = Runner(load_station("irb120_dynamic", overrides))

    whole = runner.run(duration=1.5)

    assert whole.stopped_by == "torque_limit"

    part = runner.run(duration=whole.stop_time - 0.15)
    assert part.ending == "completed"
    assert_equal_runs(runner.resume(part, until=1.5), whole)


def test_an_interruption_within_the_repeated_steps_goes_on_to_the_caller(monkeypatch):
    runner = Runner(load_station("humanoid_dynamic"))
    part = runner.run(duration=0.3)

    def interrupt(self, recorder):
        raise KeyboardInterrupt

    monkeypatch.setattr(RepeatedSteps, "compare", interrupt)
    with pytest.raises(KeyboardInterrupt):
        runner.run(duration=0.1, start=part.final_state, start_time="keep")


def speed_up(time):
    """Command of a walk: forward from 0.03 s on."""
    return (0.05, 0.0, 0.0) if time > 0.03 else None


@pytest.mark.parametrize("cut", [0.1, 0.5])
def test_a_commanded_run_is_resumed_and_resumed_again(cut):
    """The run of 0.1 s has too few steps to repeat the last of them, so that it is stepped again from its start."""
    runner = Runner("roid1_walking", overrides={"duration": cut})
    part = runner.run(commands={"walk": speed_up})

    assert part.commanded == ("walk",)

    resumed = runner.resume(part, until=cut + 0.1)
    whole = Runner(part.config).run(duration=cut + 0.1)

    assert_equal_runs(resumed, whole)
    assert resumed.commanded == ("walk",)

    again = runner.resume(resumed, until=cut + 0.2)
    assert_equal_runs(again, Runner(part.config).run(duration=cut + 0.2))


class Clock(LeafSystem):
    """A block whose output is the time [s]."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorOutputPort(
            "time", 1, lambda context, output: output.SetAtIndex(0, context.get_time())
        )


def test_a_commanded_run_with_own_blocks_needs_new_blocks():
    runner = Runner("roid1_walking", blocks={"clock": Clock()})
    part = runner.run(duration=0.5, commands={"walk": speed_up})

    needs_new_blocks = r"to resume a run that functions commanded needs a Runner with new blocks"

    with pytest.raises(SimrobError, match=needs_new_blocks):
        runner.resume(part, until=0.6)

    fresh = Runner("roid1_walking", blocks={"clock": Clock()})
    assert fresh.resume(part, until=0.6)["clock.time"][-1] == pytest.approx(0.6)
    with pytest.raises(SimrobError, match=needs_new_blocks):
        fresh.resume(part, until=0.6)


def test_a_new_monitor_that_ends_the_run_within_the_repeated_steps_is_no_interruption():
    part = Runner("humanoid_dynamic").run(duration=0.3)
    overrides = {"monitors.low": {"kind": "fall", "height": 10.0}}

    kept = Runner("humanoid_dynamic", overrides=overrides).run(
        duration=0.1, start=part.final_state, start_time="keep"
    )

    assert (kept.ending, kept.stopped_by) == ("monitor", "low")
    assert kept.start_time == 0.3


def test_what_cannot_be_resumed():
    runner = Runner(load_station("bouncing_ball"))
    part = runner.run(duration=0.2)

    with pytest.raises(
        SimrobError, match=r"until is 0.1 s; it must be later than the end of the run, 0.2 s"
    ):
        runner.resume(part, until=0.1)
    with pytest.raises(SimrobError, match="it must be a result"):
        runner.resume("x", until=1)
    with pytest.raises(SimrobError, match=r"result is a run of a station with a different motion"):
        Runner(load_station("irb120_dynamic")).resume(part, until=1)
    with pytest.raises(SimrobError, match=r"start_time.*a start whose time is kept"):
        runner.run(start_time="keep")
    with pytest.raises(SimrobError, match="start_time"):
        runner.run(start=part.final_state, start_time="forever")

    stopped = Runner(load_station("irb120_force_stop")).run()
    assert stopped.ending == "monitor"
    with pytest.raises(SimrobError, match="ended early"):
        Runner(load_station("irb120_force_stop")).resume(stopped, until=100)


def test_a_context_later_than_zero_is_where_a_diagram_begins():
    config = load_station(
        "irb120_dynamic", {"solver": {"kind": "discrete"}, "servo.realization": "implicit"}
    )
    closed = closed_station(resolve(config), monitors=False)
    simulator = Simulator(closed.diagram)
    simulator.AdvanceTo(0.5)
    whole = simulate(config, duration=1.5, progress=False)

    late = simulate_diagram(
        closed.diagram,
        closed.ports,
        duration=1.0,
        context=simulator.get_context().Clone(),
        progress=False,
    )

    assert (late.start_time, late.stop_time) == (0.5, 1.5)
    assert late.config.duration == 1.0
    later = whole.times >= 0.5
    np.testing.assert_array_equal(late.times, whole.times[later])
    np.testing.assert_array_equal(late.axes("q"), whole.axes("q")[later])


def test_a_late_run_is_drawn_and_saved(tmp_path):
    runner = Runner(load_station("humanoid_dynamic"))
    part = runner.run(duration=0.3)
    late = runner.run(duration=0.3, start=part.final_state, start_time="keep")

    folder = late.save(tmp_path / "late")

    page = (folder / "recording.html").read_text()
    assert '"begin": 0.3, "end": 0.6' in page
    assert late.verdict.ended
    assert late.realtime_rate == pytest.approx(0.3 / late.wall_time)


def test_a_late_run_is_saved_with_its_reference_up_to_its_end(tmp_path):
    """Times of a reference count from 0, so that a table as long as the run alone would end too early."""
    positions = np.outer(np.ones(6), [0.0, 0.2])
    reference = PiecewisePolynomial.FirstOrderHold([0.0, 0.4], positions)
    runner = Runner("irb120_kinematic")
    first = runner.run(reference=reference, duration=0.2)
    late = runner.run(reference=reference, duration=0.2, start=first.final_state, start_time="keep")

    folder = late.save(tmp_path / "late", recording=False)

    table = np.loadtxt(folder / "reference.csv", delimiter=",", skiprows=1)
    assert table[-1, 0] == pytest.approx(0.4)
    np.testing.assert_allclose(table[-1, 1:7], 0.2)


RESUME = """
import pickle, sys
from simrob_drake import Runner
with open(sys.argv[1], "rb") as file:
    part = pickle.load(file)
resumed = Runner(part.config).resume(part, until=10.0)
with open(sys.argv[2], "wb") as file:
    pickle.dump(resumed, file)
"""


@pytest.mark.long
def test_a_walk_cut_anywhere_equals_the_whole_one_in_another_process_too(tmp_path):
    """Ten seconds of a walk with a push and a program of commands, cut at five random times."""
    commands = [
        {"time": 0.5, "ahead": 0.1},
        {"time": 3, "ahead": 0.05, "turn_deg": 10},
        {"time": 6, "ahead": 0.1},
    ]
    push = {"kind": "push", "start": 4.0, "duration": 0.1, "force": [0, 5, 0]}
    station = load_station(
        "roid1_walking", {"controllers.walk.commands": commands, "forces": {"shove": push}}
    )
    runner = Runner(station)
    whole = runner.run(duration=10.0)
    assert whole.ending == "completed"
    for cut in np.random.default_rng(56).uniform(0.5, 9.5, 5):
        part = runner.run(duration=float(cut))
        assert_equal_runs(runner.resume(part, until=10.0), whole)

    source = tmp_path / "part.pickle"
    target = tmp_path / "resumed.pickle"
    source.write_bytes(pickle.dumps(part))
    subprocess.run([sys.executable, "-c", RESUME, source, target], check=True, cwd=Path.cwd())
    assert_equal_runs(pickle.loads(target.read_bytes()), whole)


def compare_repeated_steps(changed_row, change):
    """Compare six recorded steps with repeated ones of which one differs. Stepping begins at 1 s, in row 1."""
    times = np.arange(6.0)
    expected = StateHistory(times, times[:, None])
    recorded = StateHistory(times, times[:, None].copy())
    recorded.continuous[changed_row] += change
    trace = SimpleNamespace(history=expected, free_row=3)
    recorder = SimpleNamespace(times=times, history=lambda: recorded)

    RepeatedSteps(trace, begin=1.0).compare(recorder)


@pytest.mark.parametrize("changed_row", [1, 2, 3])
def test_every_repeated_step_is_compared_up_to_the_last_that_the_end_did_not_change(changed_row):
    with pytest.raises(StepsDiffer):
        compare_repeated_steps(changed_row, change=1e-12)


@pytest.mark.parametrize("changed_row", [0, 4, 5])
def test_steps_before_the_repeated_ones_and_after_them_may_differ(changed_row):
    compare_repeated_steps(changed_row, change=1.0)


def test_the_reference_of_a_run_that_keeps_its_time_is_checked_up_to_its_end():
    """The reference leaves the limits of the joints after the first run, and before the end of the second one."""
    runner = Runner("irb120_dynamic")
    reference = (np.array([0.0, 0.1, 0.2]), np.array([np.zeros(6), np.zeros(6), np.full(6, 10.0)]))
    first = runner.run(reference=reference, duration=0.1)

    with pytest.raises(InvalidParameter, match="within the joint's limits"):
        runner.run(reference=reference, duration=0.1, start=first.final_state, start_time="keep")


def test_only_the_start_of_a_motion_is_checked_for_overlaps(monkeypatch):
    """A run that is resumed begins within the motion, where an impact may press bodies deep into each other."""
    checked_times = []
    monkeypatch.setattr(
        "simrob_drake.simulation.runner.check_start_overlap",
        lambda config, ports, root: checked_times.append(root.get_time()),
    )
    runner = Runner("bouncing_ball")
    part = runner.run(duration=0.3)

    runner.resume(part, until=0.4)

    assert set(checked_times) == {0.0}
