"""Links so light that a continuous scheme creeps: reported by the check and the run, and avoided by the draft."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.stations import draft_trials
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.draft_trials import gets_through

LINK = """
  <link name="{name}"><inertial><origin xyz="0.01 0 0"/><mass value="0.0002"/>
    <inertia ixx="2e-9" ixy="0" ixz="0" iyy="3e-9" iyz="0" izz="3e-9"/></inertial></link>
  <joint name="bend_{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="{x} 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="{lower}" upper="1.7" effort="1" velocity="5"/></joint>"""
CREEPING = {
    "solver": {"kind": "continuous", "scheme": "radau3"},
    "servo.realization": "per_joint",
    "servo.feedforward": "none",
}


def finger(lower: float) -> str:
    """A finger of two links of 0.2 g that lies level: its weight presses on stops at 0."""
    first = LINK.format(name="first", parent="palm", x=0, lower=lower)
    second = LINK.format(name="second", parent="first", x=0.02, lower=lower)
    return f'<robot name="finger"><link name="palm"/>{first}{second}</robot>'


@pytest.fixture
def drafted(tmp_path, monkeypatch):
    """A function that drafts a station of a finger, and returns its file."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))

    def draft(lower: float):
        (tmp_path / "finger.urdf").write_text(finger(lower))
        file = tmp_path / "finger.yaml"
        file.write_text(draft_station(tmp_path / "finger.urdf", folder=tmp_path))
        return file

    return draft


def warnings(config):
    return [finding.text for finding in check_station(config) if finding.level == "warning"]


def test_a_draft_takes_the_solver_that_gets_through(drafted):
    config = load_station(drafted(lower=0.0))

    assert (config.solver.kind, config.servo_of("robot").realization) == ("discrete", "implicit")
    assert warnings(config) == []

    result = simulate(config, progress=False)
    error = np.rad2deg(np.abs(result.axes("q_ref") - result.axes("q")))

    assert result.ending == "completed"
    assert error[-1].max() < 1.05
    assert error.max() < 1.5


def test_away_from_its_stops_the_same_finger_moves_in_continuous_time(drafted):
    config = load_station(drafted(lower=-0.5))

    assert config.solver.kind == "continuous"
    assert warnings(config) == []
    assert len(simulate(config, progress=False).step_times) < 200


def test_a_stop_too_stiff_for_its_link_is_foretold_where_it_is_leaned_on(drafted):
    file = drafted(lower=0.0)
    (text,) = warnings(load_station(file, CREEPING))

    assert "bend_second moves" in text
    assert "joint_stops.stiffness" in text
    assert "use solver.kind discrete and servo.realization implicit" in text
    assert warnings(load_station(file, {**CREEPING, "joint_stops.stiffness": 10.0})) == []
    assert (
        warnings(
            load_station(file, {**CREEPING, "robot.initial_deg": 30, "reference.kind": "hold"})
        )
        == []
    )

    (on_the_way,) = warnings(
        load_station(file, {**CREEPING, "robot.initial_deg": 30, "reference.target_deg": 0})
    )
    assert "joint_stops.stiffness" in on_the_way


def test_a_run_that_creeps_says_so_and_what_would_help(drafted, capsys):
    config, steps = load_station(drafted(lower=0.0), CREEPING), []

    def interrupt(time, _):
        steps.append(time)
        if len(steps) > 300:
            raise KeyboardInterrupt

    result = simulate(config, on_step=interrupt)
    assert result.ending == "interrupted"
    assert result.stop_time < 300 * 1e-5
    said = capsys.readouterr().err
    for text in (result.message, said):
        assert "its steps are only " in text
        assert " s long, with 3 s left; use solver.kind discrete" in text
    assert said.count("its steps are only") == 1


def test_a_run_that_gets_on_says_nothing(capsys):
    simulate("irb120_dynamic", duration=0.5)
    assert capsys.readouterr().err == ""


def test_a_trial_ends_when_its_work_is_done(monkeypatch):
    """Twenty evaluations of the dynamics are no move of three seconds."""
    config = load_station("irb120_dynamic")

    assert gets_through(config)

    monkeypatch.setattr(draft_trials, "_MOST_EVALUATIONS", 20)
    assert not gets_through(config)


def test_a_trial_that_diverges_fails():
    config = load_station(
        "irb120_dynamic", {"servo.kd": 0, "servo.kp": 1e9, "servo.torque_limit": 1e9}
    )
    tight = {"scheme": "explicit_euler", "max_step": 0.01}
    assert not gets_through(
        config.model_copy(update={"solver": config.solver.model_copy(update=tight)})
    )
