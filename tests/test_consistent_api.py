"""The same argument has the same name in all functions, and former names are still accepted."""

import subprocess
import sys

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import (
    Arm,
    RunBranch,
    Runner,
    Workcell,
    add_station,
    apply_solver,
    build_station,
    linearize,
    load_station,
    simulate,
)
from simrob_drake.base.errors import SimrobError
from simrob_drake.results.record.summary import summary_of

LIGHT = {"gravity": 1.6}  # m/s²


def test_overrides_are_accepted_wherever_a_station_is():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic", overrides=LIGHT)
    built = build_station("irb120_dynamic", overrides=LIGHT)

    configs = [
        simulate("irb120_dynamic", overrides=LIGHT, duration=0.01, progress=False).config,
        simulate(
            load_station("irb120_dynamic"), overrides=LIGHT, duration=0.01, progress=False
        ).config,
        Runner("irb120_dynamic", overrides=LIGHT).config,
        Runner(build_station("irb120_dynamic"), overrides=LIGHT).config,
        Workcell(load_station("irb120_dynamic"), LIGHT).config,
        Arm("irb120_dynamic", overrides=LIGHT).cell.config,
        ports.config,
        built.config,
    ]

    assert {config.gravity for config in configs} == {1.6}
    np.testing.assert_allclose(ports.plant.plant.gravity_field().gravity_vector(), [0, 0, -1.6])

    light, heavy = (linearize("double_pendulum", overrides=own) for own in (LIGHT, {}))
    assert not np.allclose(light.A, heavy.A)

    simulator = Simulator(built)
    apply_solver(simulator, built, overrides={"solver.max_step": 0.0125})

    assert simulator.get_integrator().get_maximum_step_size() == 0.0125


def test_wrong_overrides_are_named():
    with pytest.raises(SimrobError, match=r"overrides.*gravitty"):
        Runner(load_station("irb120_dynamic"), overrides={"gravitty": 1})
    with pytest.raises(SimrobError, match="overrides is 5; it must be a mapping"):
        simulate("irb120_dynamic", overrides=5)
    with pytest.raises(SimrobError, match="overrides: the workcell is loaded already"):
        Arm(Workcell("irb120_workcell"), overrides=LIGHT)


@pytest.mark.parametrize(
    "call",
    [
        lambda: simulate(config_or_station="bouncing_ball", duration=0.01, progress=False),
        lambda: add_station(DiagramBuilder(), config="bouncing_ball"),
        lambda: build_station(config="bouncing_ball"),
        lambda: apply_solver(Simulator(build_station("bouncing_ball")), config="bouncing_ball"),
    ],
)
def test_former_names_of_the_station_are_accepted_with_a_warning(call):
    with pytest.warns(DeprecationWarning, match=r"is now station; the former name works until"):
        call()


def test_pushes_alike_in_simulate_and_in_a_runner():
    pushes = {"shove": {"start": 0.05, "duration": 0.1, "force": [0, 6, 0]}}
    station = load_station("roid1_dynamic")
    first = simulate(station, pushes=pushes, duration=0.3, progress=False)

    second = Runner(station).run(pushes=pushes, duration=0.3)

    np.testing.assert_array_equal(first.values, second.values)
    assert first["applied_force.shove.y"].max() == 6.0


def test_a_branch_gives_the_whole_run_with_signals():
    runner = Runner("humanoid_dynamic", overrides={"duration": 0.6})
    branch = runner.branch(0.3)

    assert isinstance(branch, RunBranch)
    for force in (5.0, -8.0):
        pushes = {"shove": {"start": 0.3, "duration": 0.1, "force": [0, force, 0]}}
        whole = runner.run(pushes=pushes)
        branched = branch.run(pushes=pushes)
        np.testing.assert_array_equal(branched.times, whole.times)
        np.testing.assert_array_equal(branched.values, whole.values)
        assert branch.outcome(pushes).message == whole.message
    np.testing.assert_array_equal(branch.run().values, runner.run().values)
    with pytest.raises(
        SimrobError, match=r"pushes: shove is a push at 0.1 s; it must be a push at 0.3 s"
    ):
        branch.run(pushes={"shove": {"start": 0.1, "force": [1, 0, 0]}})
    with pytest.raises(SimrobError, match=r"pushes: shove is a push at 0.1 s; it must be"):
        branch.outcome({"shove": {"start": 0.1, "force": [1, 0, 0]}})


def test_a_branch_of_a_solver_with_memory_and_pushes():
    """Under radau3, the run up to the branch is stepped again."""
    runner = Runner("irb120_dynamic", overrides={"duration": 0.12})
    pushes = {"shove": {"start": 0.06, "duration": 0.03, "force": [5, 0, 0]}}
    np.testing.assert_array_equal(
        runner.branch(0.06).run(pushes=pushes).values, runner.run(pushes=pushes).values
    )


def test_a_branch_is_continued_by_pushes_of_other_names_or_none():
    """Pushes that the station does not have act, and those of the station that are left out do not."""
    push = {"start": 0.3, "duration": 0.15, "force": [0, 400, 0]}
    of_station = {"kind": "push", **push}
    pushed = Runner("humanoid_dynamic", overrides={"duration": 0.6, "forces.shove": of_station})
    branch = pushed.branch(0.25)
    assert branch.outcome({}).ending == "completed"
    assert branch.outcome({"shove": push}).stopped_by == "fall"

    branch = Runner("humanoid_dynamic", overrides={"duration": 0.6}).branch(0.25)
    assert branch.outcome({"nudge": push}).stopped_by == "fall"
    assert branch.outcome({}).ending == "completed"


def test_fork_is_a_former_name():
    runner = Runner("bouncing_ball")
    with pytest.warns(DeprecationWarning, match=r"now Runner.branch\(\)"):
        assert runner.fork(0.1).begun.ending == "completed"


def test_the_speed_of_a_run_has_one_name():
    result = simulate("bouncing_ball", duration=0.05, progress=False)

    assert result.realtime_rate == pytest.approx(result.simulated_time / result.wall_time)
    assert result.wall_time == result.stepping_time + result.signal_time
    assert "real time" in result.speed_in_words
    with pytest.warns(DeprecationWarning, match=r"pace is now SimulationResult.speed_in_words"):
        assert result.pace == result.speed_in_words


def test_the_end_of_a_run_has_the_same_names_in_python_and_in_files():
    result = simulate("bouncing_ball", duration=0.05, progress=False)
    summary = summary_of(result, result.verdict)
    for name in ("ending", "stopped_by", "message", "realtime_rate", "wall_time"):
        assert summary[name] == getattr(result, name)


@pytest.mark.long
def test_type_checkers_know_the_keywords_of_configurations(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        'from simrob_drake import StationConfig\n\nStationConfig(name="x", durration=3.0)\n'
    )
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--config-file=",
        "--follow-imports=silent",
        str(script),
    ]

    checked = subprocess.run(command, capture_output=True, text=True, check=False)

    assert 'Unexpected keyword argument "durration"' in checked.stdout
