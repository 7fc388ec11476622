"""Settings that a solver or contact model ignores: reported by the check, the result and --strict."""

import json

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.cli.app import run_command
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.ignored_settings import rounded_delays

DISCRETE = {"kind": "discrete", "time_step": 0.001}
SAP_WARNING = (
    "the solver scheme sap ignores contact.dissipation; use solver.scheme lagged or similar"
)


def warnings_of_check(config):
    return [finding.text for finding in check_station(config) if finding.level == "warning"]


def test_a_ball_that_cannot_bounce_is_reported_by_the_result(tmp_path):
    """sap ignores dissipation: the ball stays 9 mm deep in the floor instead of bouncing."""
    config = load_station("bouncing_ball", {"solver": DISCRETE})
    assert SAP_WARNING in warnings_of_check(config)

    result = simulate(config, duration=0.3, progress=False)
    assert SAP_WARNING in result.warnings

    folder = result.save(tmp_path / "result", recording=False)
    assert SAP_WARNING in json.loads((folder / "summary.json").read_text())["warnings"]

    bouncing = simulate(load_station("bouncing_ball"), duration=0.3, progress=False)
    assert SAP_WARNING not in bouncing.warnings


@pytest.mark.usefixtures("no_plots")
def test_strict_ends_with_4(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    args = [
        "run",
        "bouncing_ball",
        "--set",
        "solver={kind: discrete, time_step: 0.001}",
        "--duration",
        "0.2",
    ]

    assert run_command([*args, "--strict", "--out", "strict"]) == 4
    assert run_command([*args, "--out", "lenient"]) == 0


SLOPE = 30.0


def slides(write_station, solver, friction):
    angle = np.deg2rad(SLOPE)
    pose = [float(-0.1 * np.sin(angle)), 0, float(0.1 * np.cos(angle)), 0, float(-angle), 0]
    box = {"box": [0.2, 0.2, 0.2], "mass": 3, "free": True, "pose": pose}
    content = {
        "pieces": {"box": box},
        "floor": {"size": 20, "incline_deg": SLOPE},
        "contact": {"friction": friction},
        "solver": solver,
        "duration": 0.5,
    }
    result = simulate(load_station(write_station(content)), progress=False)
    return -result["piece.box.x"][-1] + result["piece.box.x"][0] > 0.05, result.warnings


@pytest.mark.parametrize(
    "solver",
    [
        {"kind": "discrete", "scheme": "sap"},
        {"kind": "discrete", "scheme": "lagged"},
        {"kind": "discrete", "scheme": "similar"},
        {"kind": "mujoco"},
    ],
)
def test_fixed_steps_ignore_static_friction_and_say_so(write_station, solver):
    """tan 30° = 0.58 lies between the coefficients: the static one should hold the box."""
    slid, warnings = slides(write_station, solver, {"static": 0.8, "dynamic": 0.3})

    assert slid
    assert any("ignores contact.friction.static (0.8)" in warning for warning in warnings)

    slid, warnings = slides(write_station, solver, {"static": 0.8, "dynamic": 0.8})
    assert not slid
    assert warnings == []


@pytest.mark.parametrize(("scheme", "step"), [("cenic", 0.01), ("radau3", 0.1)])
def test_continuous_schemes_hold_by_static_friction(write_station, scheme, step):
    solver = {"kind": "continuous", "scheme": scheme, "max_step": step}
    slid, warnings = slides(write_station, solver, {"static": 0.8, "dynamic": 0.3})

    assert not slid
    assert warnings == []


@pytest.mark.parametrize(
    ("station", "overrides", "key"),
    [
        (
            "bouncing_ball",
            {"contact.hydroelastic_modulus": 1e6},
            "ignores contact.hydroelastic_modulus",
        ),
        (
            "bouncing_ball",
            {"contact.model": "hydroelastic", "contact.stiffness": 1e4},
            "hydroelastic ignores contact.stiffness",
        ),
        (
            "box_on_floor",
            {"pieces.box.contact": {"dissipation": 1.0}, "solver": DISCRETE},
            "sap ignores pieces.box.contact.dissipation",
        ),
        (
            "irb120_dynamic",
            {
                "joint_stops.stiffness": 1e4,
                "solver": {"kind": "discrete"},
                "servo.realization": "implicit",
            },
            "holds joint limits by itself and ignores joint_stops",
        ),
    ],
)
def test_each_ignored_key_is_named(station, overrides, key):
    assert any(key in text for text in warnings_of_check(load_station(station, overrides)))


@pytest.mark.parametrize(
    ("latency", "note"),
    [
        (0.0099, "the delay of 9.9 ms becomes 0 ms: delays last whole samples, here of 20 ms"),
        (0.03, "the delay of 30 ms becomes 40 ms: delays last whole samples, here of 20 ms"),
        (0.04, ""),
        (0.0, ""),
    ],
)
def test_a_latency_that_is_no_whole_sample_is_noted(latency, note):
    bus = {"servo.bus": {"rate": 50, "latency": latency}}
    findings = check_station(load_station("irb120_dynamic", {"servo.feedforward": "none", **bus}))

    found = [finding for finding in findings if finding.subject == "servo.bus.latency"]
    assert [(finding.level, finding.text) for finding in found] == (
        [("note", note)] if note else []
    )


def test_a_latency_is_named_by_the_section_that_has_it():
    """Robots without servos of their own share the section of the station, which has one finding."""
    bus = {"rate": 50, "latency": 0.03}
    robots = {name: {"model": "irb120"} for name in ("left", "right")}
    shared = {"name": "two", "robots": robots, "servo": {"bus": bus}}
    assert [finding.subject for finding in rounded_delays(load_station(shared))] == [
        "servo.bus.latency"
    ]
    own = {"name": "two", "robots": robots | {"right": {"model": "irb120", "servo": {"bus": bus}}}}
    assert [finding.subject for finding in rounded_delays(load_station(own))] == [
        "robots.right.servo.bus.latency"
    ]
    only = {"name": "one", "robot": {"model": "irb120", "servo": {"bus": bus}}}
    assert [finding.subject for finding in rounded_delays(load_station(only))] == [
        "robot.servo.bus.latency"
    ]


@pytest.mark.parametrize(
    ("rate", "delay", "subjects"),
    [(50, 0.03, ["sensors.touch.delay"]), (50, 0.04, []), (None, 0.0, [])],
)
def test_a_force_sensors_delay_is_noted_if_it_is_no_whole_sample(rate, delay, subjects):
    sensor = {"kind": "force", "body": "robot", "rate": rate, "delay": delay}
    config = load_station("irb120_force_stop", {"sensors": {"touch": sensor}})

    found = rounded_delays(config)

    assert [finding.subject for finding in found] == subjects
