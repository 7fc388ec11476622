"""A whole small model: what is read of it, and that it moves as its equations say."""

import json

import numpy as np
import pytest
from slx_files import INERTIA, Level, pendulum, write_model

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidModel, OutputError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.reading.model_file import Libraries
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.values.workspace import variables_of
from simrob_drake.robots.catalog import load_robot_file


@pytest.fixture
def imported(tmp_path):
    return import_simulink(pendulum(tmp_path / "arm one.slx"), tmp_path / "out")


def test_the_law_is_a_servo_with_its_limit_where_servos_are_asked_for(imported, tmp_path):
    model = pendulum(tmp_path / "arm one.slx")
    station = load_station(import_simulink(model, tmp_path / "servos", servos=True).station)
    assert (station.servo.kp, station.servo.kd, station.servo.torque_limit) == (
        200.0,
        15.0,
        {"Shoulder": 30.0},
    )
    law = load_station(imported.station).controllers["law"]
    assert law.torque == {"Shoulder": {"Limit": 1.0}}
    assert law.blocks["Limit"].of == {
        "q_ref.Shoulder": 200.0,
        "q.Shoulder": -200.0,
        "v.Shoulder": -15.0,
    }
    assert station.gravity == 9.81
    assert station.duration == 1.0
    assert station.robots["robot"].initial_deg == {"Shoulder": 20.0}


def test_the_robot_has_the_bodies_of_the_model(imported):
    robot = load_robot_file(imported.station.parent / "Arm" / "robot.yaml")
    lower, upper = robot.axis_limits
    np.testing.assert_allclose([lower[0], upper[0]], np.deg2rad([-100, 100]))
    (mass,) = [float(mass.get("value")) for mass in robot.element.iter("mass")]
    assert mass == pytest.approx(2.0, rel=1e-12)
    (inertia,) = robot.element.iter("inertia")  # of a bar L x L/10 x L/10 with L = 0.4
    expected = [
        2 / 12 * (0.04**2 + 0.04**2),
        2 / 12 * (0.4**2 + 0.04**2),
        2 / 12 * (0.4**2 + 0.04**2),
    ]
    np.testing.assert_allclose(
        [float(inertia.get(key)) for key in ("ixx", "iyy", "izz")], expected, rtol=1e-12
    )
    assert list(robot.tools) == ["Tip"]


def test_it_rests_where_its_equation_says(imported):
    """At rest kp (20° - q) = -m g L/2 cos of the angle from the horizontal; the joint hangs straight down at zero."""
    result = simulate(imported.station, duration=3.0, progress=False)
    angle, torque = result["q.Shoulder"][-1], result["tau.Shoulder"][-1]
    np.testing.assert_allclose(torque, 200 * (np.deg2rad(20) - angle), atol=1e-3)
    np.testing.assert_allclose(torque, 2 * 9.81 * 0.2 * np.sin(angle), atol=2e-3)
    np.testing.assert_allclose(
        np.linalg.norm(result.pose("tcp")[-1, :3] - [0, 0, 0.5]), 0.4, atol=1e-12
    )


@pytest.mark.long
def test_a_free_joint_swings_as_a_pendulum_does(tmp_path):
    model = pendulum(tmp_path / "free.slx", driven=False, workspace="Kp=0; Kw=0; theta0=5;")
    station = import_simulink(model, tmp_path / "out").station
    tight = {"solver.accuracy": 1e-6, "solver.max_step": 0.01}
    result = simulate(load_station(station, tight), duration=2.0, progress=False)
    inertia = 2 / 12 * (0.4**2 + 0.04**2) + 2 * 0.2**2
    decay, stiffness = 0.1 / (2 * inertia), 2 * 9.81 * 0.2 / inertia
    frequency = np.sqrt(stiffness - decay**2)
    times = result.times
    expected = np.exp(-decay * times) * (
        np.cos(frequency * times) + decay / frequency * np.sin(frequency * times)
    )
    # sin is not its angle: 4e-5
    np.testing.assert_allclose(result["q.Shoulder"], np.deg2rad(5) * expected, atol=2e-4)


@pytest.mark.long
def test_the_station_runs_again_as_its_result_tells(imported, tmp_path):
    first = simulate(imported.station, duration=0.2, progress=False)
    again = simulate(first.save(tmp_path / "run", recording=False) / "station.yaml", progress=False)
    assert np.array_equal(first.values, again.values)


def test_unknown_variables_are_told_at_once(tmp_path):
    model = pendulum(tmp_path / "arm.slx", workspace="theta0 = 20;")
    with pytest.raises(
        InvalidModel, match=r"Kp \(Stiffness: Gain\); Kw \(Damping: Gain\).*--set Kp=VALUE"
    ) as told:
        import_simulink(model, tmp_path / "out")
    assert str(model) in str(told.value)
    assert not (tmp_path / "out").exists()
    given = variables_of({"Kp": "10", "Kw": "sqrt(4)"}, [])
    import_simulink(model, tmp_path / "out", variables=given)
    assert (
        load_station(tmp_path / "out" / "arm.yaml")
        .controllers["law"]
        .blocks["Limit"]
        .of["v.Shoulder"]
        == -2.0
    )


def test_defaults_are_taken_only_where_the_user_asks(tmp_path):
    model = pendulum(tmp_path / "arm.slx", workspace="")
    imported = import_simulink(model, tmp_path / "out", assume=True)
    # of Gain itself
    assert (
        load_station(imported.station).controllers["law"].blocks["Limit"].of["q.Shoulder"] == -1.0
    )
    assert {entry.element for entry in imported.report.of("defaulted")} == {
        "Arm/Shoulder",
        "Stiffness",
        "Damping",
    }
    assert imported.fidelity == "mechanics complete; 3 figures assumed"


def test_variables_are_taken_from_the_files_that_set_most_of_them(tmp_path):
    (tmp_path / "other.m").write_text("Kp = 1;\n")
    (tmp_path / "start.m").write_text("clear\nKw = 4; Kp = 70; K9 = 1;\nsim('model')\n")
    (tmp_path / "function_of.m").write_text(
        "function x = function_of(y)\nKw = 5; Kp = 6;\nx = Kp * Kw * y;\n"
    )
    model = pendulum(tmp_path / "model.slx", workspace="theta0 = 20;")
    with pytest.raises(InvalidModel, match="only MATLAB knows: Kp"):
        import_simulink(model, tmp_path / "out")
    imported = import_simulink(model, tmp_path / "out", assume=True)
    assert load_station(imported.station).controllers["law"].blocks["Limit"].of == pytest.approx(
        {"q.Shoulder": -70.0, "v.Shoulder": -4.0, "q_ref.Shoulder": 70.0}
    )
    assert imported.fidelity == "mechanics complete; 1 figure assumed"  # other.m has another Kp
    taken = [
        entry.text.partition(" ")[0]
        for entry in imported.report.entries
        if entry.element == "start.m"
    ]
    assert sorted(taken) == ["Kp", "Kw"]


def test_files_beside_a_model_that_lacks_nothing_are_left_alone(tmp_path, monkeypatch):
    searched = []
    monkeypatch.setattr(Libraries, "offered", lambda _, model: searched.append(model) or {})
    import_simulink(pendulum(tmp_path / "arm.slx"), tmp_path / "out", assume=True)
    assert searched == []
    import_simulink(pendulum(tmp_path / "open.slx", workspace=""), tmp_path / "open", assume=True)
    assert len(searched) == 1


def test_a_structure_that_two_scripts_fill_has_the_fields_of_both(tmp_path):
    """What both set is as the likelier one says, which sets more variables of the model."""
    (tmp_path / "drives.m").write_text("arm.gain.p = 70; theta0 = 20;\n")
    (tmp_path / "loads.m").write_text("arm.gain.p = 60; arm.gain.w = 4;\n")
    model = pendulum(tmp_path / "model.slx", workspace="", kp="arm.gain.p", kw="arm.gain.w")
    imported = import_simulink(model, tmp_path / "out", assume=True)
    assert load_station(imported.station).controllers["law"].blocks["Limit"].of == pytest.approx(
        {"q.Shoulder": -70.0, "v.Shoulder": -4.0, "q_ref.Shoulder": 70.0}
    )
    assert imported.fidelity == "mechanics complete; 1 figure assumed"


def test_a_script_called_after_the_model_counts_before_others(tmp_path):
    """As the DataFile that ``smimport`` writes: all robots of a folder have the same variable in theirs."""
    (tmp_path / "near").mkdir()
    (tmp_path / "near" / "check.m").write_text("arm.Kp = 1; arm.Kw = 2; theta0 = 20;\n")
    (tmp_path / "arm_DataFile.m").write_text("arm.Kp = 70; arm.Kw = 4;\n")
    model = pendulum(tmp_path / "arm.slx", workspace="theta0 = 20;", kp="arm.Kp", kw="arm.Kw")
    imported = import_simulink(model, tmp_path / "out", assume=True)
    assert (
        load_station(imported.station).controllers["law"].blocks["Limit"].of["q.Shoulder"] == -70.0
    )
    assert imported.fidelity == "mechanics complete"


def test_figures_of_a_library_are_looked_for_too(tmp_path):
    library, top = Level(), Level()
    library.block(INERTIA, "Ball", Mass="ball.mass")
    write_model(tmp_path / "own.slx", library, kind="Library")
    (tmp_path / "start.m").write_text("ball.mass = 70;\n")
    top.block("own/Ball", "Ball")
    read = read_simulink(write_model(tmp_path / "a.slx", top), assume=True)
    assert read.bodies.bodies[0].solids[0].weight.mass == 70.0
    assert not read.findings.undefined


def test_open_inputs_are_told(tmp_path):
    report = read_simulink(pendulum(tmp_path / "arm.slx", law=False)).report
    assert [(entry.kind, entry.element, entry.text) for entry in report.entries] == [
        ("defaulted", "Arm/In", "input 1 is not connected: it is 0")
    ]


def test_nothing_is_overwritten_without_force(imported, tmp_path):
    with pytest.raises(OutputError):
        import_simulink(tmp_path / "arm one.slx", tmp_path / "out")
    import_simulink(tmp_path / "arm one.slx", tmp_path / "out", force=True)


@pytest.mark.long
def test_the_command_line_imports_checks_and_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pendulum(tmp_path / "arm.slx", workspace="")
    assert run_command(["import", "arm.slx"]) == 2
    assert (
        "variables that only MATLAB knows: theta0 (Arm/Shoulder: PositionTargetValue)"
        in capsys.readouterr().err
    )
    (tmp_path / "figures.m").write_text("theta0 = 20;", encoding="utf-8")
    assert run_command(["import", "arm.slx"]) == 2
    assert (
        "or take what figures.m would set, and else defaults, with --assume"
        in capsys.readouterr().err
    )
    (tmp_path / "figures.m").unlink()
    given = ["--set", "theta0=20", "--set", "Kp=200", "--set", "Kw=15"]
    assert run_command(["check", "arm.slx", *given]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.slx"]
    assert run_command(["check", "arm.slx"]) == 2
    assert "Damping: Gain" in capsys.readouterr().out
    assert run_command(["import", "arm.slx", *given, "--servos", "--out", "servos"]) == 0
    assert "axis Shoulder of Arm: servo kp 200, kd 15, limit 30" in " ".join(
        capsys.readouterr().out.split()
    )
    assert run_command(["import", "arm.slx", *given]) == 0
    assert "axis Shoulder of Arm: driven by the blocks of its law" in " ".join(
        capsys.readouterr().out.split()
    )
    assert (
        run_command(
            ["run", "arm_imported/arm.yaml", "--duration", "0.1", "--no-recording", "--out", "run"]
        )
        == 0
    )
    assert run_command(["import", "arm.slx", *given, "--collision", "box"]) == 2
    assert run_command(["import", "arm.urdf", "--assume"]) == 2
    assert run_command(["check", "irb120_dynamic", "--assume"]) == 2


def test_the_report_tells_what_became_what(imported):
    content = json.loads((imported.station.parent / "report.json").read_text())
    assert content["source"].endswith("arm one.slx")
    entries = [(entry["kind"], entry["element"], entry["text"]) for entry in content["entries"]]
    assert (
        "read",
        "Arm/Shoulder",
        "axis Shoulder of Arm: driven by the blocks of its law",
    ) in entries
