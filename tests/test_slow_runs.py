"""Runs that hardly get on: each says what holds it up, found by trials, and what to set."""

import warnings

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.cli.app import run_command
from simrob_drake.simulation import pace
from simrob_drake.simulation.pace import SlowRunWarning
from simrob_drake.simulation.runner import Runner
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.resolve import resolve

RADAU = {"kind": "continuous", "scheme": "radau3", "max_step": 0.1}


def pallet(**overrides):
    """Return a parcel that has been let go a little askew on a pallet, under a scheme that cannot hold contacts."""
    pieces = {
        "pallet": {"parent": "world"},
        "parcel": {"free": True, "pose": [0, 0, 0.087, 0.1, 0.02, 0.01]},
        "ball": {"free": True, "pose": [3, 0, 5, 0, 0, 0]},
    }
    given = {
        "solver": RADAU,
        "pieces": pieces,
        "contact": {"model": "point", "corners": False},
        "sensors": {},
    }
    return load_station("box_on_floor", {**given, **overrides})


FINGER = """<robot name="finger"><link name="palm"/>
  <link name="first"><inertial><origin xyz="0.01 0 0"/><mass value="0.0002"/>
    <inertia ixx="2e-9" ixy="0" ixz="0" iyy="3e-9" iyz="0" izz="3e-9"/></inertial></link>
  <joint name="bend" type="revolute"><parent link="palm"/><child link="first"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="1.7" effort="1" velocity="5"/></joint></robot>"""


@pytest.fixture
def finger(tmp_path, monkeypatch):
    """A station of a finger of 0.2 g whose weight leans on its stop."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "finger.urdf").write_text(FINGER)
    file = tmp_path / "finger.yaml"
    file.write_text(draft_station(tmp_path / "finger.urdf", folder=tmp_path))
    return load_station(
        file, {"solver": RADAU, "servo.realization": "per_joint", "servo.feedforward": "none"}
    )


@pytest.fixture
def impatient(monkeypatch):
    """Runs are looked at after each step, and must be faster than any is."""
    monkeypatch.setattr(pace, "_PATIENCE", 0.0)
    monkeypatch.setattr(pace, "_SLOWEST", 1e6)
    # the shortest of these runs ends before a quick machine has looked once
    monkeypatch.setattr(pace, "_OFTEN", 0.0)
    monkeypatch.setattr(pace, "_BUSY", 0.0)
    monkeypatch.setattr(pace, "_TRIAL", 0.1)


def said_of(config, stop=0.5, **options):
    """Return what a run says that its user ends when it has said something, or after so many seconds of its time."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")

        def end(time, _):
            if caught or time > stop:
                raise KeyboardInterrupt

        result = simulate(config, progress=False, on_step=end, **options)
    return [str(one.message) for one in caught if one.category is SlowRunWarning], result


def test_a_released_piece_that_creeps_is_blamed_with_what_it_lies_on(impatient):
    (said,), result = said_of(pallet())

    assert result.ending == "interrupted"
    assert said.startswith("box_on_floor runs at ")
    assert "the contact of pallet and parcel makes radau3 take steps of " in said
    assert "set solver.scheme=cenic and solver.max_step=0.01 (" in said
    assert "× real time in a trial)" in said


def test_a_stop_that_is_too_stiff_is_blamed_with_its_figures(impatient, finger):
    """The link has m r² = 2e-4 · 0.01² and 3e-9 kg m² of its own about its joint."""
    (said,), _ = said_of(finger)
    assert (
        "bend moves 2.3e-08 kg m², for which its stop (joint_stops.stiffness) of 5.7e+05 N·m/rad"
        in said
    )
    assert "use solver.kind discrete and servo.realization implicit (" in said


def test_a_run_of_dear_steps_says_what_they_cost(impatient, monkeypatch):
    monkeypatch.setattr(pace, "_HALF", 0.0)  # the largest part, however large
    # which may cost as much, on some machines
    monkeypatch.setattr(pace.Slow, "_find_contacts", lambda *_: None)

    (said,), _ = said_of(load_station("roid1_walking", {"duration": 1.0}))

    assert "each step of 0.0" in said
    assert "of which the block controller.walk takes " in said
    assert "lower controllers.walk.rate" in said


def test_steps_of_one_length_can_be_longer(impatient):
    (said,), _ = said_of(
        load_station("irb120_dynamic", {"solver": {"kind": "discrete", "time_step": 1e-3}})
    )
    assert said.endswith("take longer steps (solver.time_step)")


def test_looking_for_the_cause_changes_nothing(impatient, monkeypatch):
    runner = Runner(pallet(duration=0.004))

    with pytest.warns(SlowRunWarning):
        looked = runner.run()

    monkeypatch.setattr(pace, "_PATIENCE", 1e9)
    np.testing.assert_array_equal(runner.run().values, looked.values)


@pytest.mark.parametrize(("slowest", "busy"), [(1e-12, True), (1e6, False)])
def test_a_busy_machine_is_blamed_only_if_a_whole_processor_would_do(
    impatient, monkeypatch, slowest, busy
):
    """The run gets 1 % of a processor. What it would make of a whole one decides on the cause; both rates are told."""
    monkeypatch.setattr(pace, "_BUSY", 0.5)
    config = load_station("irb120_dynamic", {"solver": {"kind": "discrete", "time_step": 1e-3}})
    watch = pace.PaceWatch(
        config, lambda: closed_station(resolve(config)), own_blocks=False, show=None
    )
    monkeypatch.setattr(pace, "_SLOWEST", slowest)
    context = watch._built().diagram.CreateDefaultContext()
    context.SetTime(0.01)
    watch._wall_time, watch._processor_time, watch._steps = 10.0, 0.1, 10

    complaint = watch._slow_run_message(context)

    assert complaint.startswith(
        "irb120_dynamic runs at 0.001 × real time with 1 % of a processor (0.1 × with a whole"
    )
    assert ("the machine is busy with other work" in complaint) == busy
    assert ("each step of 0.001 s takes 0.01 s" in complaint) != busy


def test_a_pause_does_not_count(impatient, monkeypatch):
    """Somebody holds the run for a second after its first step: what is slow is not the run."""
    clock = iter(np.arange(0.0, 1e6, 1.0))
    monkeypatch.setattr(pace, "monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(pace, "process_time", lambda: 0.0)

    said, result = said_of(load_station("irb120_dynamic", {"duration": 0.1}))

    assert said == []
    assert result.ending == "completed"


def test_a_command_warns_once(impatient, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pace, "_BUSY", 1e9)

    assert (
        run_command(
            ["run", "irb120_dynamic", "--duration", "0.3", "--no-recording", "--plots", "svg"]
        )
        == 0
    )

    said = " ".join(capsys.readouterr().err.split())
    assert "warning irb120_dynamic runs at " in said
    assert said.count("warning") == 1, said


def test_a_command_leaves_the_warnings_of_others_to_python(monkeypatch, capsys):
    monkeypatch.setattr(
        "simrob_drake.cli.app.app", lambda *_, **__: warnings.warn("of another", stacklevel=1)
    )
    with pytest.warns(UserWarning, match="of another"):
        assert run_command([]) == 0
    assert capsys.readouterr().err == ""
