"""Whatever a caller gives, what comes back is a result or one of the package's own errors, in one line."""

import json
import random
import re
from collections.abc import Callable
from dataclasses import replace
from threading import Lock
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Sphere
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

import simrob_drake as sim
from simrob_drake.base.arguments import DrakeRefused, drake_asserts
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.results.record.state import JointState
from simrob_drake.stations.contact import _check_resolution

VALUES: dict[str, Any] = {
    "None": None,
    "no text": "",
    "text": "x",
    "nan": np.nan,
    "inf": np.inf,
    "-1": -1,
    "0": 0,
    "beyond floats": 10**400,
    "beyond digits": 10**5000,
    "huge": 1e300,
    "tiny": 1e-300,
    "many": 10**9,
    "empty": [],
    "ragged": [[1, 2], [3]],
    "masked": np.ma.masked_array([1.0] * 6, mask=[1, 0, 0, 0, 0, 0]),
    "int keys": {1: 2},
    "object": object(),
    "complex": 1j,
    "nan row": [np.nan] * 6,
    "huge row": [10**400] * 6,
    "texts": ["a"] * 6,
    "no rows": np.zeros((0, 6)),
    "no places": np.zeros((0, 3)),
    "deep": np.zeros((2, 3, 4, 5)),
    "function": len,
}
NAN_ROW = np.full(6, np.nan)


@pytest.fixture(scope="module")
def arm() -> sim.Arm:
    return sim.Arm(sim.load_station("irb120_kinematic", {"duration": 0.1}))


@pytest.fixture(scope="module")
def legged() -> sim.LeggedRobot:
    return sim.LeggedRobot(sim.load_station("humanoid_fixed", {"duration": 0.1}))


@pytest.fixture(scope="module")
def result(arm: sim.Arm) -> sim.SimulationResult:
    return sim.simulate(arm.cell.config, progress=False)


def run(config: Any, **asked: Any) -> sim.SimulationResult:
    return sim.simulate(config, progress=False, **asked)


def over(key: str) -> Callable[[Any, Any, Any, Any], Any]:
    return lambda arm, legged, result, value: run(
        sim.load_station("irb120_kinematic", {"duration": 0.02, key: value})
    )


def start(part: str) -> Callable[[Any, Any, Any, Any], Any]:
    return lambda arm, legged, result, value: run(
        arm.cell.config, start=replace(result.final_state, **{part: value})
    )


CALLS: dict[str, Callable[[sim.Arm, sim.LeggedRobot, sim.SimulationResult, Any], Any]] = {
    **{
        f"simulate {key}": over(key)
        for key in ("duration", "robot.base", "reference.duration", "reference.start")
    },
    **{
        f"start {part}": start(part)
        for part in ("positions", "velocities", "references", "joints", "blocks")
    },
    "overrides": lambda arm, legged, result, value: sim.load_station("irb120_kinematic", value),
    "inner overrides": lambda arm, legged, result, value: sim.load_station(
        "irb120_kinematic", {"reference": value}
    ),
    "station": lambda arm, legged, result, value: run(value),
    "reference": lambda arm, legged, result, value: run(arm.cell.config, reference=value),
    "times": lambda arm, legged, result, value: run(
        arm.cell.config, reference=(value, np.zeros((2, 6)))
    ),
    "positions": lambda arm, legged, result, value: run(arm.cell.config, reference=([0, 1], value)),
    "duration": lambda arm, legged, result, value: run(arm.cell.config, duration=value),
    "blocks": lambda arm, legged, result, value: run(arm.cell.config, blocks=value),
    "begin": lambda arm, legged, result, value: run(arm.cell.config, start=value),
    "on_step": lambda arm, legged, result, value: run(
        arm.cell.config, on_step=None if value is len else value
    ),
    "pushes": lambda arm, legged, result, value: sim.Runner("irb120_dynamic").run(
        pushes=value, duration=0.01
    ),
    "builder": lambda arm, legged, result, value: sim.add_station(value, arm.cell.config),
    "added": lambda arm, legged, result, value: sim.add_station(DiagramBuilder(), value),
    "diagram": lambda arm, legged, result, value: sim.simulate_diagram(
        value, value, progress=False
    ),
    "robot": lambda arm, legged, result, value: sim.Arm(arm.cell, value),
    "tool": lambda arm, legged, result, value: sim.Arm(arm.cell.config, tool=value),
    "workcell": lambda arm, legged, result, value: sim.Workcell("irb120_kinematic", value),
    "position": lambda arm, legged, result, value: arm.cell.position(value),
    "frame": lambda arm, legged, result, value: arm.frame(value),
    "pose": lambda arm, legged, result, value: arm.pose(value),
    "joint": lambda arm, legged, result, value: arm.joint(value),
    "near": lambda arm, legged, result, value: arm.joint(arm.pose(), start=value),
    "jacobian": lambda arm, legged, result, value: arm.jacobian(value),
    "speeds": lambda arm, legged, result, value: arm.inverse_dynamics(arm.position, value),
    "wait": lambda arm, legged, result, value: arm.wait(value),
    "follow": lambda arm, legged, result, value: arm.cell.follow(value, 0.01),
    "run": lambda arm, legged, result, value: arm.cell.run(value),
    "change": lambda arm, legged, result, value: arm.cell.change(value),
    "attach": lambda arm, legged, result, value: arm.attach(value),
    "move_abs_j": lambda arm, legged, result, value: arm.plan.move_abs_j(value),
    "move_j": lambda arm, legged, result, value: arm.plan.move_j(value),
    "move_l": lambda arm, legged, result, value: arm.plan.move_l(value),
    "move_c": lambda arm, legged, result, value: arm.plan.move_c(value, value),
    "solver": lambda arm, legged, result, value: arm.plan.move_j(arm.pose(), solver=value),
    **{
        key: lambda arm, legged, result, value, key=key: arm.plan.move_abs_j(
            arm.position + 0.01, **{key: value}
        )
        for key in ("points", "duration", "times", "speed", "check")
    },
    "signal": lambda arm, legged, result, value: result[value],
    "save": lambda arm, legged, result, value: (
        None if value is VALUES["text"] else result.save(value)
    ),
    "walk": lambda arm, legged, result, value: legged.walk(value),
    "amplitude": lambda arm, legged, result, value: legged.walk(4, value),
    "step_time": lambda arm, legged, result, value: legged.walk(4, step_time=value),
    "act": lambda arm, legged, result, value: legged.act(value),
    "repeat": lambda arm, legged, result, value: legged.act("bow", repeat=value),
    "test_move": lambda arm, legged, result, value: legged.test_move(value, 0.01),
    "move time": lambda arm, legged, result, value: legged.test_move({legged.axes[0]: 1.0}, value),
    "program": lambda arm, legged, result, value: legged.run(value),
    "program reference": lambda arm, legged, result, value: legged.reference_of(value),
    "insert": lambda arm, legged, result, value: legged.insert(value, value),
    "added move": lambda arm, legged, result, value: sim.Program().with_added_moves(value),
    "targets_deg": lambda arm, legged, result, value: legged.targets_deg(value),
    "hand": lambda arm, legged, result, value: legged.pose(value),
    "film": lambda arm, legged, result, value: legged.film(value),
    "point": lambda arm, legged, result, value: sim.three_point_frame([0, 0, 0], value, [0, 1, 0]),
}
SOME = 5
"""How many values each call gets in one run of the suite, always the same ones."""


@pytest.mark.parametrize("name", CALLS)
def test_hostile_values_get_one_clear_line(name, arm, legged, result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for key in random.Random(name).sample(list(VALUES), SOME):
        try:
            CALLS[name](arm, legged, result, VALUES[key])
        except BaseException as problem:  # SystemExit, too
            told = str(problem)
            if not isinstance(problem, SimrobError) or len(told) > 600 or "\n" in told:
                pytest.fail(f"{name} of {key}: {type(problem).__name__}: {told[:400]}")


MANY = np.array([1, 2])


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda arm, legged: arm.plan.move_abs_j(arm.position, stop=MANY), "stop is array"),
        (lambda arm, legged: legged.act("bow", store=MANY), "store is array"),
        (lambda arm, legged: legged.reset(keep_program=MANY), "keep_program is array"),
        (lambda arm, legged: arm.wait(0.01).save("out", force=MANY), "force is array"),
        (lambda arm, legged: run(arm.cell.config, on_step=MANY), "on_step is array"),
        (lambda arm, legged: sim.simulate(arm.cell.config, progress=MANY), "progress is array"),
        (
            lambda arm, legged: sim.load_station("irb120_kinematic", {"duration": Lock()}),
            "duration: is <unlocked",
        ),
        (
            lambda arm, legged: sim.load_station("irb120_dynamic", {"servo.kp": 1e12}),
            r"kp: a gain must be between 0 and 1e\+09",
        ),
        (
            lambda arm, legged: sim.load_station("irb120_dynamic", {"gravity": 1e10}),
            "gravity: .* 10000",
        ),
        (
            lambda arm, legged: sim.load_station("irb120_dynamic", {"servo.kp": 1e300}),
            r"kp: must be zero, or 1e-100",
        ),
        (
            lambda arm, legged: sim.Program(moves=[{"wait": 5e-324}]),
            r"Program: moves\[0\].wait: must be zero, or",
        ),
        (lambda arm, legged: sim.Program(moves=None), "Program: moves: must be a list"),
        (
            lambda arm, legged: JointMove(target_deg=None),
            "JointMove: target_deg: must be a section",
        ),
    ],
)
def test_values_of_no_use_are_told_by_their_names(call, told, arm, legged, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    before = legged.program
    with pytest.raises(SimrobError, match=told):
        call(arm, legged)
    assert legged.program is before


@pytest.mark.parametrize("duration", [1e-300, 1e300, 10**400])
@pytest.mark.parametrize(
    "key", ["reference.duration", "reference.start", "forces.push.duration", "forces.push.start"]
)
def test_times_that_are_none_are_told_where_they_stand(key, duration):
    changes = {"reference.kind": "ramp", "forces.push.force": [1, 0, 0], key: duration}
    with pytest.raises(InvalidConfig, match=rf"override {key}: "):
        sim.load_station("irb120_dynamic", changes)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"solver.max_step": 1e-9}, r"solver\.max_step is 1e-09 s; it must be at least 1e-07 s"),
        (
            {"solver": {"kind": "discrete", "time_step": 1e-9}},
            r"solver\.time_step is 1e-09 s; it must be at least",
        ),
        (
            {"sensors.imu": {"frame": "tool0", "rate": 1e9}},
            r"sensors\.imu\.rate is 1e\+09 Hz; it must be at most 1e\+07",
        ),
        (
            {"sensors.imu": {"frame": "tool0", "delay": 1e9}},
            r"sensors\.imu\.delay is 1e\+09 s; it must be at most 50 s at a rate of 200 Hz",
        ),
        (
            {"sensors.imu": {"frame": "tool0", "rate": 5e-324}},
            r"rate: must be zero, or 1e-100 to 1e\+15 in magnitude",
        ),
        ({f"sensors.{'x' * 5000}": {"kind": "imu"}}, "is not a valid name"),
        (
            {"reference": {"kind": "sine", "frequency": 1e9}},
            r"reference\.frequency: .*at most 10000",
        ),
    ],
)
def test_steps_that_never_end_are_told_before_the_run(changes, told):
    with pytest.raises(InvalidConfig, match=told):
        sim.load_station("irb120_dynamic", {"duration": 1.0, **changes})
    runner = sim.Runner(
        sim.load_station("irb120_dynamic", {"solver.max_step": 1e-4, "sample_rate": 1})
    )
    with pytest.raises(
        InvalidParameter, match=r"solver\.max_step is 0\.0001 s; it must be at least 0\.01 s"
    ):
        runner.run(duration=1e5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("forces.a.amplitude", [1, 0, 0]),
        ("sensors.a.rate", 3),
        ("monitors.a.hold", 3),
        ("reference", {}),
        ("robot.reference", {"duration": 1}),
    ],
)
def test_a_section_without_its_kind_is_told_what_kinds_there_are(key, value):
    with pytest.raises(InvalidConfig, match=r"\.kind: this key is required; known: \w+, \w+"):
        sim.load_station("irb120_dynamic", {key: value})


@pytest.mark.parametrize("resolution", [1e-99, 1e-4])
def test_a_surface_of_too_many_faces_is_told_before_drake_makes_it(resolution):
    changes = {"contact.model": "hydroelastic_with_fallback", "duration": 0.01}

    with pytest.raises(
        InvalidParameter, match=r"contact\.resolution is .* m; it must be (.*) m or more"
    ) as caught:
        run(sim.load_station("bouncing_ball", {**changes, "contact.resolution": resolution}))
    finest = float(str(caught.value).split("it must be ")[1].split(" m")[0])
    # a ball of 0.06 m then has about 4 π r² / finest² faces, that is 20 000
    assert 1e-3 < finest < 5e-3


@pytest.mark.parametrize("station", ["irb120_kinematic", "irb120_dynamic"])
def test_a_reference_that_is_no_number_is_told_before_the_run(station):
    trajectory = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.full((6, 2), np.nan))
    with pytest.raises(InvalidParameter, match=r"reference of joint_1 is nan at 0\.00 s"):
        run(station, reference=trajectory)
    with pytest.raises(InvalidParameter, match="a trajectory of no segment"):
        run(station, reference=PiecewisePolynomial())


def test_what_drake_alone_finds_out_ends_no_script():
    """Not a number for a millisecond only: no look before the run hits it."""
    rows = np.zeros((6, 5))
    rows[:, 2] = np.nan
    trajectory = PiecewisePolynomial.FirstOrderHold([0.0, 0.1011, 0.1013, 0.1015, 1.0], rows)

    config = sim.load_station("irb120_kinematic", {"duration": 1.0, "sample_rate": 10_000.0})

    with pytest.raises(DrakeRefused, match="condition 'AllFinite"):
        run(config, reference=trajectory)
    with pytest.raises(SystemExit, match="4"), drake_asserts():
        raise SystemExit(4)


@pytest.mark.parametrize("station", ["irb120_kinematic", "irb120_dynamic"])
def test_no_run_begins_where_there_is_no_number(station, tmp_path):
    state = run(station, duration=0.02).final_state

    for part in ("positions", "velocities", "references"):
        with pytest.raises(InvalidParameter, match=rf"start: {part} of robot is .*nan"):
            run(station, start=replace(state, **{part: {"robot": NAN_ROW}}))
    with pytest.raises(InvalidParameter, match=r"start: robot/joint_1 is array\(\[nan\]\)"):
        run(
            station,
            start=replace(state, joints={"robot/joint_1": JointState(NAN_ROW[:1], NAN_ROW[:1])}),
        )
    for number, told in (
        (np.nan, "is not JSON: NaN is not a finite number"),
        (None, "positions.robot: .* number"),
    ):
        file = tmp_path / "start.json"
        file.write_text(
            json.dumps({**json.loads(state.to_json()), "positions": {"robot": [number] * 6}})
        )
        with pytest.raises(
            InvalidConfig,
            match=rf"start\.json: {told}.*the key `start` expects the file start.json of a result",
        ):
            run(sim.load_station(station, {"start": str(file)}))


@pytest.mark.parametrize("radius", [0.06, 0.013, 0.25, 1.0])
def test_the_resolution_that_an_error_proposes_is_taken(radius):
    """It was rounded down at times, and then refused again."""
    with pytest.raises(InvalidParameter) as caught:
        _check_resolution(1e-9, [Sphere(radius)])
    proposed = float(re.search(r"must be (.*) m or more", str(caught.value))[1])

    _check_resolution(proposed, [Sphere(radius)])
