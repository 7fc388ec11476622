"""Runs of the stations against closed forms, independent computations and converged runs."""

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial
from scipy.integrate import solve_ivp

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.files import diagrams_root
from simrob_drake.simulation.stepping import Stepper
from simrob_drake.stations.checks import holding_torque

TIGHT = {"solver.accuracy": 1e-4, "solver.max_step": 0.01}


@pytest.fixture(scope="module")
def moved():
    """The main job: 30 degrees on all joints."""
    return simulate(load_station("irb120_dynamic"))


@pytest.fixture(scope="module")
def overloaded():
    return simulate(load_station("irb120_dynamic", {"servo.torque_limit": 10, "sample_rate": 1000}))


def test_the_move_ends_where_the_torques_hold_it(moved):
    assert moved.ending == "completed"
    # facts of the arm: -20.79 N·m at 30 deg
    assert moved["tau.joint_2"][-1] == pytest.approx(-20.8, abs=0.2)

    position, torque = moved.axes("q")[-1], moved.axes("tau")[-1]
    expected = holding_torque(moved.plant, moved.plant.robots["robot"], position)

    np.testing.assert_allclose(torque, expected, rtol=0.01, atol=1e-3)
    # sag = torque / kp
    np.testing.assert_allclose(moved.axes("q_ref")[-1] - position, torque / 1000, atol=1e-5)


def test_the_move_is_within_3_mrad_of_a_tighter_one(moved):
    tight = simulate(load_station("irb120_dynamic", TIGHT))
    np.testing.assert_allclose(moved.axes("q"), tight.axes("q"), atol=3e-3)


@pytest.mark.parametrize("realization", ["vector", "implicit"])
def test_the_realizations_agree(moved, realization):
    other = simulate(load_station("irb120_dynamic", {"servo.realization": realization}))
    np.testing.assert_allclose(other.axes("q"), moved.axes("q"), atol=3e-3)
    np.testing.assert_allclose(other.axes("tau")[-1], moved.axes("tau")[-1], atol=0.01)


def test_the_equations_of_motion_hold_against_scipy():
    """An integration of M(q) dv/dt = tau - bias by scipy, with the servo law written out, gives the same motion."""
    result = simulate(load_station("irb120_dynamic", {**TIGHT, "duration": 0.5}))
    plant = result.plant.plant
    context = plant.CreateDefaultContext()

    def derivative(time, state):
        q, v = state[:6], state[6:]
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        torque = 1000 * (np.full(6, np.pi / 6) * min(time, 1.0) - q) - 10 * v
        bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        return np.concatenate([v, np.linalg.solve(plant.CalcMassMatrix(context), torque - bias)])

    solution = solve_ivp(
        derivative,
        (0, 0.5),
        np.zeros(12),
        method="Radau",
        rtol=1e-8,
        atol=1e-10,
        t_eval=result.times,
    )
    np.testing.assert_allclose(result.axes("q"), solution.y[:6].T, atol=1e-4)


def first_time(result, degrees):
    return result.times[np.argmax(result["q.joint_2"] >= np.deg2rad(degrees))]


@pytest.mark.long
def test_a_weak_motor_lets_the_arm_fall_to_its_stop(overloaded):
    tight = simulate(
        load_station("irb120_dynamic", {"servo.torque_limit": 10, "sample_rate": 1000, **TIGHT})
    )

    assert overloaded["tau.joint_2"][-1] == pytest.approx(-10)
    assert np.rad2deg(overloaded["q.joint_2"][-1]) == pytest.approx(110, abs=0.1)
    assert first_time(overloaded, 109.9) == pytest.approx(first_time(tight, 109.9), abs=0.03)
    assert np.abs(overloaded.axes("tau")).max() <= 10 + 1e-9

    others = np.abs(overloaded.axes("q") - overloaded.axes("q_ref"))[:, [0, 3, 4, 5]]
    assert others.max() > np.deg2rad(0.5)  # they are disturbed


@pytest.mark.long
def test_a_heavy_load_is_too_much():
    result = simulate(load_station("irb120_dynamic", {"pieces.load.mass": 200}), duration=2.0)
    assert np.rad2deg(result["q.joint_2"][-1]) == pytest.approx(110, abs=1)
    assert np.abs(result["tau.joint_2"]).max() == pytest.approx(150)


@pytest.mark.long
def test_without_damping_joint_2_keeps_swinging():
    """With gripper and load 5.9 deg in the last second, bare 3.4 deg: both confirmed with explicit Runge-Kutta."""
    swings = {}
    for pieces in ("loaded", "bare"):
        overrides = {"servo.kd": 0, **({"pieces": {}} if pieces == "bare" else {})}
        result = simulate(load_station("irb120_dynamic", overrides))
        swings[pieces] = np.rad2deg(np.ptp(result["q.joint_2"][result.times >= 2]))

    assert swings["loaded"] == pytest.approx(5.85, abs=0.3)
    assert swings["bare"] == pytest.approx(3.42, abs=0.2)


def test_the_free_pendulum_loses_what_its_damping_takes():
    free = {
        "servo.kp": 0,
        "servo.kd": 0,
        "reference.kind": "hold",
        "solver.accuracy": 1e-6,
        "sample_rate": 2000,
    }
    result = simulate(load_station("double_pendulum", free), duration=1.0)
    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    energy = []
    for q, v in zip(result.axes("q"), result.axes("v"), strict=True):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        energy.append(plant.CalcPotentialEnergy(context) + plant.CalcKineticEnergy(context))

    power = 0.01 * (result.axes("v") ** 2).sum(axis=1)  # B = 0.01 N·m·s/rad in both joints

    lost = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(result.times))])
    assert lost[-1] > 0.01
    np.testing.assert_allclose(np.array(energy) + lost, energy[0], atol=1e-4 * lost[-1] + 2e-6)


def test_the_pendulum_reaches_its_reference():
    result = simulate(load_station("double_pendulum"))
    expected = holding_torque(result.plant, result.plant.robots["robot"], result.axes("q")[-1])

    # Kw/Kp: a lag of 1 s fades
    np.testing.assert_allclose(result.axes("tau")[-1], expected, rtol=0.05, atol=1e-4)
    np.testing.assert_allclose(np.rad2deg(result.axes("q")[-1]), [70, 60], atol=0.5)


def test_the_kinematic_arm_follows_exactly_and_feels_its_weight():
    result = simulate(load_station("irb120_kinematic"))

    np.testing.assert_array_equal(result.axes("q"), result.axes("q_ref"))
    assert result["tau.joint_2"][-1] == pytest.approx(-20.79, abs=0.01)  # facts of the arm
    assert result["tau.joint_3"][-1] == pytest.approx(-9.61, abs=0.01)


@pytest.mark.long
def test_the_discrete_solver_comes_to_the_same_end(moved):
    overrides = {"solver.kind": "discrete", "servo.realization": "implicit"}
    result = simulate(load_station("irb120_dynamic", overrides))

    np.testing.assert_allclose(result.axes("q")[-1], moved.axes("q")[-1], atol=1e-4)
    np.testing.assert_allclose(result.axes("tau")[-1], moved.axes("tau")[-1], atol=0.05)
    assert np.diff(result.step_times) == pytest.approx(1e-3)


def test_two_runs_are_equal_to_the_last_bit(moved):
    again = simulate(
        load_station("irb120_dynamic"), progress=False, on_step=lambda time, positions: None
    )
    np.testing.assert_array_equal(again.values, moved.values)


def test_the_sample_rate_does_not_change_the_samples(moved):
    finer = simulate(load_station("irb120_dynamic", {"sample_rate": 300}))
    np.testing.assert_array_equal(finer.times[::3], moved.times)
    np.testing.assert_array_equal(finer.values[::3], moved.values)


def test_on_step_sees_every_step(moved):
    seen = []
    result = simulate(
        load_station("irb120_dynamic"),
        duration=0.5,
        on_step=lambda time, q: seen.append((time, q[1])),
    )

    times, joint_2 = np.array(sorted(dict(seen).items())).T
    np.testing.assert_array_equal(times[1:], result.step_times[1:])
    np.testing.assert_allclose(joint_2[-1], result["q.joint_2"][-1])


class TestReferences:
    times = (0.0, 0.5, 1.0)
    positions = np.outer(times, np.full(6, 0.2))

    def test_an_array_with_its_times_in_front(self):
        pair = simulate(
            load_station("irb120_dynamic"), reference=(self.times, self.positions), duration=0.5
        )
        array = np.column_stack([self.times, self.positions])

        rows = simulate(load_station("irb120_dynamic"), reference=array, duration=0.5)

        np.testing.assert_array_equal(pair.values, rows.values)
        np.testing.assert_allclose(
            pair.axes("q_ref"), np.outer(pair.times, np.full(6, 0.2)), atol=1e-15
        )

    def test_a_trajectory(self):
        trajectory = PiecewisePolynomial.FirstOrderHold(self.times, self.positions.T)
        result = simulate(load_station("irb120_dynamic"), reference=trajectory, duration=0.5)

        pair = simulate(
            load_station("irb120_dynamic"), reference=(self.times, self.positions), duration=0.5
        )

        np.testing.assert_array_equal(result.values, pair.values)

    def test_samples_are_joined_smoothly_where_the_torque_needs_an_acceleration(self):
        times = np.linspace(0, 1, 41)
        swing = np.outer(np.sin(3 * times), np.full(6, 0.2))

        result = simulate(load_station("irb120_kinematic"), reference=(times, swing), duration=1.0)

        np.testing.assert_allclose(result["v.joint_1"], 0.6 * np.cos(3 * result.times), atol=1e-3)

    @pytest.mark.parametrize(
        ("reference", "message"),
        [
            (((0, 1), np.zeros((2, 5))), "2 x 5.*6 columns"),
            (((1, 0), np.zeros((2, 6))), r"reference times: 0 s follows 1 s; increase each time"),
            (((0, 1), np.full((2, 6), np.nan)), "row 0 .*finite"),
            (((0, 1), np.full((2, 6), 3.0)), r"joint_1 is 171\.89 deg at 0\.00 s; .*-165 to 165"),
            (((0, 1, 2), np.zeros((2, 6))), r"must be of shapes \(m,\) and \(m, n\)"),
            (np.zeros(6), r"an array \(m, 1 \+ n\)"),
            (
                PiecewisePolynomial(np.zeros((5, 1))),
                "5 joints; it must be a trajectory of 6 joints",
            ),
            ({"arm": np.zeros((2, 7))}, "no robot 'arm'"),
        ],
    )
    def test_wrong_ones_are_refused(self, reference, message):
        with pytest.raises(SimrobError, match=message):
            simulate(load_station("irb120_dynamic"), reference=reference)

    def test_several_robots_need_a_mapping(self):
        with pytest.raises(
            SimrobError, match="a mapping of robots to references; the robots are left, right"
        ):
            simulate(load_station("two_irb120"), reference=np.zeros((2, 7)))


class TestMonitors:
    def test_a_joint_limit_ends_the_run_at_its_crossing(self, overloaded):
        config = load_station(
            "irb120_dynamic", {"servo.torque_limit": 10, "monitors": {"joint_limit": {}}}
        )
        result = simulate(config)

        assert (result.ending, result.stopped_by) == ("monitor", "joint_limit")
        assert (
            result.message
            == f"joint_2 reached its upper limit of 110.0 deg, at {result.stop_time:.4g} s"
        )
        # sampled at 1 kHz
        assert result.stop_time == pytest.approx(first_time(overloaded, 110.0), abs=1.5e-3)
        assert result["q.joint_2"][-1] == pytest.approx(np.deg2rad(110), abs=1e-3)
        assert result.step_times[-1] == result.stop_time

    def test_a_torque_limit_held_too_long(self, overloaded):
        config = load_station(
            "irb120_dynamic",
            {"servo.torque_limit": 10, "monitors": {"torque_limit": {"hold": 0.2}}},
        )
        result = simulate(config)

        free = np.abs(overloaded.axes("tau")).max(axis=1) < 10 - 1e-6

        free_times = overloaded.times[free]
        # the first stretch that long; joint 2 lets go once before
        held = np.flatnonzero(np.diff(free_times) > 0.2)
        onset = free_times[held[0]] if len(held) else free_times[-1]
        assert result.stop_time == pytest.approx(onset + 0.2, abs=2e-3)
        assert "joint_2 stayed at its torque limit of 10 N·m for 0.2 s" in result.message

    def test_settled(self, moved):
        result = simulate(load_station("irb120_dynamic", {"monitors": {"settled": {"after": 1.0}}}))
        fast = np.abs(moved.axes("v")).max(axis=1) >= np.deg2rad(0.1)

        last_fast = moved.times[np.flatnonzero(fast)[-1]]
        assert result.stop_time == pytest.approx(last_fast + 0.2, abs=0.02)  # sampled at 100 Hz

    def test_none_fires_where_none_must(self, moved):
        monitors = {"joint_limit": {}, "torque_limit": {}, "divergence": {}}
        result = simulate(load_station("irb120_dynamic", {"monitors": monitors}))

        assert result.ending == "completed"
        np.testing.assert_array_equal(result.values, moved.values)  # watching changes nothing

    def test_a_violation_at_the_start_ends_the_run_there(self):
        config = load_station("irb120_dynamic", {"monitors": {"joint_limit": {"margin_deg": 75}}})
        result = simulate(config)

        assert (result.stop_time, result.stopped_by) == (0.0, "joint_limit")
        assert "joint_3" in result.message

    @pytest.mark.parametrize("failure", [RuntimeError, SystemExit])
    def test_a_run_whose_end_cannot_be_stepped_again_stays_as_it_was_recorded(
        self, monkeypatch, failure
    ):
        seen, calls, again = [], [], Stepper.step

        def fails_at_second(*arguments):
            calls.append(arguments)
            if len(calls) > 1:
                raise failure("step size below its minimum")
            return again(*arguments)

        monkeypatch.setattr(Stepper, "step", fails_at_second)
        config = load_station(
            "irb120_dynamic", {"servo.torque_limit": 10, "monitors": {"joint_limit": {}}}
        )
        result = simulate(config, on_step=lambda time, _: seen.append(time))
        assert (result.ending, result.stopped_by, len(calls)) == ("monitor", "joint_limit", 2)
        steps = sorted(set(seen))  # monitors look a few steps late
        np.testing.assert_array_equal(result.step_times, steps[: len(result.step_times)])

    def test_discrete_runs_end_at_the_step_that_saw_it(self):
        overrides = {
            "solver.kind": "discrete",
            "servo.realization": "implicit",
            "servo.torque_limit": 10,
        }
        result = simulate(
            load_station(
                "irb120_dynamic", {**overrides, "monitors": {"joint_limit": {"margin_deg": 5}}}
            )
        )

        assert result.stopped_by == "joint_limit"
        position = np.rad2deg(result["q.joint_2"])
        assert position[-1] >= 105 > position[-2]
        assert result.stop_time == pytest.approx(round(result.stop_time, 3))

    @pytest.mark.parametrize(
        ("margins", "stopped_by"),
        [({"margin_deg": 2}, None), ({"margin_deg": 2, "margin_m": 0.4}, "joint_limit")],
    )
    def test_margins_in_degrees_are_none_in_metres(self, margins, stopped_by):
        """The carriage goes from 0.5 to 1.2 m of the belt's 1.5 m."""
        there = {
            "robot.initial_deg": {"belt": 0.5},
            "reference": {"kind": "move", "target_deg": {"belt": 1.2}},
        }
        result = simulate(
            load_station("irb120_on_belt", {**there, "monitors": {"joint_limit": margins}})
        )

        assert result.stopped_by == stopped_by
        assert result["q.belt"][-1] == pytest.approx(1.1 if stopped_by else 1.2, abs=1e-3)

    @pytest.mark.parametrize(
        ("bounds", "settles"),
        [
            ({}, True),
            ({"error_deg": 5}, True),
            ({"error_m": 0.2}, True),
            ({"error_m": 0.05}, False),
        ],
    )
    def test_axes_that_slide_settle_by_metres(self, bounds, settles):
        """A carriage without force stays where it is, 0.1 m from where it should be."""
        weak = {
            "mode": "dynamic",
            "servo.torque_limit": {"belt": 1e-3},
            "robot.initial_deg": {"belt": 0.5},
        }
        there = {
            "reference": {"kind": "hold", "target_deg": {"belt": 0.6}},
            "monitors": {"settled": {"speed_deg": 5, "speed_m": 0.05, **bounds}},
        }

        result = simulate(load_station("irb120_on_belt", {**weak, **there}), duration=1.0)

        assert (result.stopped_by == "settled") is settles

    def test_an_axis_that_creeps_stands_still_up_to_its_bound(self):
        creeping = np.zeros((2, 8))
        creeping[1, :2] = 1.0, 5e-4  # s, m
        for speed, stopped_by in ((1e-3, "settled"), (1e-4, None)):
            config = load_station("irb120_on_belt", {"monitors": {"settled": {"speed_m": speed}}})
            assert simulate(config, reference=creeping).stopped_by == stopped_by

    def test_kinematic_runs_are_watched_too(self):
        config = load_station("irb120_kinematic", {"monitors": {"joint_limit": {"margin_deg": 50}}})
        result = simulate(config)
        assert np.rad2deg(result["q.joint_3"][-1]) == pytest.approx(20, abs=0.01)


class TestDivergence:
    def test_what_was_recorded_is_kept_with_the_likely_cause(self):
        overrides = {
            "solver.scheme": "explicit_euler",
            "solver.max_step": 0.01,
            "servo.torque_limit": 1e12,
        }
        result = simulate(load_station("irb120_dynamic", overrides))

        assert (result.ending, result.stopped_by) == ("diverged", "diverged")
        assert 0 < result.stop_time < 1
        assert np.isfinite(result.values).all()
        assert "likely cause: the damping of joint_6" in result.message

    def test_a_run_of_too_long_steps_says_that_it_cannot_be_trusted(self):
        overrides = {"solver.kind": "discrete", "solver.time_step": 0.01}
        explicit = simulate(load_station("irb120_dynamic", overrides), duration=0.1)

        assert "unstable with steps above" in explicit.warnings[0]

        implicit = load_station("irb120_dynamic", {**overrides, "servo.realization": "implicit"})
        assert simulate(implicit, duration=0.1).warnings == []

    def test_a_run_that_the_user_interrupts_keeps_what_there_is(self):
        def press_control_c(time, _positions):
            if time > 0.2:
                raise KeyboardInterrupt

        result = simulate(load_station("irb120_dynamic"), on_step=press_control_c)
        assert (result.ending, result.stopped_by) == ("interrupted", "interrupted")
        assert 0.2 < result.stop_time < 0.4
        assert result.times[-1] == result.stop_time

    @pytest.mark.parametrize("kind", [RuntimeError, SystemExit, ValueError])
    def test_what_the_users_own_function_raises_is_no_divergence(self, kind):
        def fail(time, _positions):
            if time > 0.1:
                raise kind("of my own")

        with pytest.raises(kind, match="of my own"):
            simulate(load_station("irb120_dynamic"), on_step=fail, duration=0.5)

    def test_a_bad_duration_is_refused(self):
        for duration in (0, -1, np.nan, np.inf):
            with pytest.raises(SimrobError, match="duration"):
                simulate(load_station("irb120_dynamic"), duration=duration)


def test_a_gripper_that_may_touch_comes_to_rest_on_the_floor():
    overrides = {"servo.torque_limit": 12, "floor": {"size": 2}, "duration": 2.0}
    overrides |= {
        "servo.realization": "implicit",
        "solver": {"kind": "discrete", "scheme": "sap", "time_step": 2e-3},
    }
    through = simulate(load_station("irb120_dynamic", overrides))

    onto = simulate(load_station("irb120_dynamic", {**overrides, "contact": {"model": "point"}}))

    assert through.pose("tcp")[-1, 2] < -0.05
    assert onto.pose("tcp")[-1, 2] > -0.01


@pytest.mark.parametrize("station", ["double_pendulum", diagrams_root() / "double_pendulum.yaml"])
def test_a_station_goes_by_its_name_or_file_too(station):
    assert (
        simulate(station, duration=0.1).config
        == simulate(load_station(station), duration=0.1).config
    )
    assert build_station(station).config == load_station(station)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"station": 5}, "station is 5; it must be a name"),
        ({"start": 5}, "start is 5; it must be a State"),
        ({"duration": "a"}, "duration is 'a'; it must be a positive time"),
        ({"duration": True}, "duration is True"),
        ({"reference": "x"}, "reference is 'x'; it must be a trajectory, an array"),
        ({"reference": [[0, 1], [2]]}, "reference is .* it must be a trajectory"),
    ],
)
def test_what_cannot_be_meant_is_refused(given, message):
    with pytest.raises(InvalidParameter, match=message):
        simulate(**{"station": "double_pendulum", **given})


@pytest.mark.parametrize(("name", "overrides"), [(5, None), ("double_pendulum", [1])])
def test_what_names_no_station_is_refused(name, overrides):
    with pytest.raises(InvalidParameter, match="it must be a"):
        load_station(name, overrides)
