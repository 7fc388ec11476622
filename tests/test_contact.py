"""Contact, sensors and their monitors in whole stations, against closed forms and independent integrations."""

import base64
import json
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.results.animation.recording import save_recording

GRAVITY = 9.80665
BALL = 0.9048  # kg
RADIUS = 0.06  # m
STIFFNESS, DISSIPATION = 1000.0, 0.011  # N/m and s/m, the station's
BOX = 2.0  # kg


def bounces(duration):
    """Integrate the ball by scipy; return apexes over the floor [m] and times of landing [s]."""

    def rates(_, state):
        pressed = max(RADIUS - state[0], 0.0)
        force = max(STIFFNESS * pressed * (1 - DISSIPATION * state[1]), 0.0)
        return state[1], force / BALL - GRAVITY

    def turns(_, state):
        return state[1]

    def lands(_, state):
        return state[0] - RADIUS

    turns.direction = lands.direction = -1
    events = (turns, lands)
    start = (0.16, 0.0)
    tight = {"rtol": 1e-10, "atol": 1e-12, "max_step": 5e-3}
    solution = solve_ivp(rates, (0, duration), start, method="DOP853", events=events, **tight)
    tops = solution.y_events[0][solution.t_events[0] > 0, 0] - RADIUS
    return tops, solution.t_events[1]


@pytest.fixture(scope="module")
def ball():
    return simulate(load_station("bouncing_ball", {"sample_rate": 2000}))


def falls(times, values):
    """Return when a signal goes through zero downwards."""
    rows = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    part = values[rows] / (values[rows] - values[rows + 1])
    return times[rows] + part * (times[rows + 1] - times[rows])


class TestBouncingBall:
    @pytest.mark.long
    def test_heights_and_times_are_those_of_an_independent_integration(self, ball):
        apexes, landings = bounces(3.0)
        tops = [
            ball["distance.gap"][int(row)]
            for row in np.flatnonzero(
                (ball["piece.ball.vz"][:-1] > 0) & (ball["piece.ball.vz"][1:] <= 0)
            )
            if ball["distance.gap"][int(row)] > 0
        ]

        assert len(apexes) >= 7
        np.testing.assert_allclose(tops[: len(apexes)], apexes, rtol=0.01)
        np.testing.assert_allclose(
            falls(ball.times, ball["distance.gap"])[: len(landings)], landings, rtol=0.01
        )

    @pytest.mark.long
    def test_it_stays_where_a_converged_run_has_it(self, ball):
        """Within 0.2 mm over all bounces: with the accuracy of other stations, 1e-3, it is off by 10 mm."""
        converged = simulate(
            load_station("bouncing_ball", {"sample_rate": 2000, "solver.accuracy": 1e-8})
        )
        np.testing.assert_allclose(
            ball["piece.ball.z"], converged["piece.ball.z"], rtol=0, atol=2e-4
        )

    def test_energy_never_grows(self, ball):
        height, speed = ball["piece.ball.z"], ball["piece.ball.vz"]

        energy = GRAVITY * (height - RADIUS) + speed**2 / 2
        flying = energy[height > RADIUS]
        assert np.diff(flying).max() < 5e-4 * energy[0]  # what the solver's accuracy of 3e-4 leaves
        assert flying[-1] < 0.85 * flying[0]

    def test_without_dissipation_energy_does_not_grow_and_hardly_fades(self):
        result = simulate(
            load_station("bouncing_ball", {"contact.dissipation": 0, "sample_rate": 500})
        )

        flying = result["distance.gap"] > 0
        energy = GRAVITY * result["distance.gap"] + result["piece.ball.vz"] ** 2 / 2
        assert energy[flying].max() < (1 + 5e-4) * energy[0]
        assert energy[flying].min() > 0.99 * energy[0]

    @pytest.mark.parametrize("stiffness", [500.0, 1e4])
    def test_at_rest_it_sinks_by_weight_over_stiffness(self, stiffness):
        depth = BALL * GRAVITY / stiffness
        overrides = {
            "contact.stiffness": stiffness,
            "pieces.ball.pose": [0, 0, RADIUS - depth / 2, 0, 0, 0],
        }

        result = simulate(load_station("bouncing_ball", {**overrides, "contact.dissipation": 20}))

        assert -result["distance.gap"][-1] == pytest.approx(depth, rel=0.01)
        assert result["force.floor.z"][-1] == pytest.approx(BALL * GRAVITY, rel=0.005)

    def test_a_piece_s_own_surface_makes_a_harmonic_mean(self):
        own = {"pieces.ball.contact": {"stiffness": 3000}, "contact.dissipation": 20}
        depth = BALL * GRAVITY / (2 * 3000 * 1000 / (3000 + 1000))
        start = {"pieces.ball.pose": [0, 0, RADIUS - depth, 0, 0, 0]}

        result = simulate(load_station("bouncing_ball", {**own, **start}), duration=0.5)

        assert -result["distance.gap"][-1] == pytest.approx(depth, rel=1e-6)

    def test_on_a_pressed_surface_it_sinks_as_the_closed_form_says(self):
        """Pressure E (1 - r/R) of a sphere cut by a plane sums up to pi E x² (1 - 2 x / (3 R))."""
        modulus, depth = 1e5, 5.4e-3
        force = np.pi * modulus * depth**2 * (1 - 2 * depth / (3 * RADIUS))
        fine = {
            "contact.model": "hydroelastic",
            "contact.hydroelastic_modulus": modulus,
            "contact.resolution": 0.005,
        }
        start = {"pieces.ball.pose": [0, 0, RADIUS - depth, 0, 0, 0]}

        result = simulate(load_station("bouncing_ball", {**fine, **start}), duration=0.001)

        # of a mesh with edges of 5 mm
        assert result["force.floor.z"][0] == pytest.approx(force, rel=0.05)

    def test_dissipation_takes_height_and_stiffness_depth(self):
        depths, backs = [], []
        for overrides in ({}, {"contact.dissipation": 0.2}, {"contact.stiffness": 1e4}):
            result = simulate(load_station("bouncing_ball", overrides), duration=0.8)
            depths.append(-result["distance.gap"].min())
            backs.append(result["distance.gap"][result.times > 0.25].max())

        assert backs[1] < 0.7 * backs[0]
        assert depths[2] < 0.35 * depths[0]

    def test_it_says_in_its_summary_where_the_ball_is(self, ball):
        summary = ball.summary()

        assert summary["robot"] is None
        assert summary["final"]["piece_pose"]["ball"][2] == pytest.approx(ball["piece.ball.z"][-1])
        assert summary["peak"]["force"]["floor"] == pytest.approx(ball["force.floor.z"].max())

    @pytest.mark.long
    def test_its_result_can_be_saved_and_run_again(self, tmp_path):
        result = simulate(load_station("bouncing_ball"), duration=0.4)
        folder = result.save(tmp_path / "ball")

        assert {file.name for file in (folder / "plots").iterdir()} == {
            "piece_ball.png",
            "sensors.png",
        }

        again = simulate(load_station(folder / "station.yaml"))
        np.testing.assert_array_equal(again.values, result.values)


def test_sensors_that_only_report_change_no_step():
    with_sensors = simulate(load_station("bouncing_ball"), duration=1.0)
    config = load_station("bouncing_ball").model_copy(update={"sensors": {}})

    without = simulate(config, duration=1.0)

    np.testing.assert_array_equal(with_sensors.step_times, without.step_times)
    np.testing.assert_array_equal(with_sensors["piece.ball.z"], without["piece.ball.z"])


def test_a_sampled_sensor_holds_its_value_between_samples():
    result = simulate(
        load_station("bouncing_ball", {"sensors.gap.rate": 10, "sample_rate": 100}), duration=0.5
    )
    assert len(np.unique(result["distance.gap"])) <= 6


CORNERS = {
    f"corner_{number}": {"kind": "force", "body": f"box.corner_{number}"} for number in range(1, 5)
}
SURFACE = {
    "pieces.box.model": "box",
    "contact.model": "hydroelastic",
    "contact.hydroelastic_modulus": 1e6,
}


class TestBoxOnFloor:
    def test_each_of_four_corners_carries_a_quarter(self):
        result = simulate(load_station("box_on_floor", {"sensors": CORNERS}))

        shares = [result[f"force.{corner}.z"][-1] / (BOX * GRAVITY) for corner in CORNERS]
        np.testing.assert_allclose(shares, 0.25, rtol=0.01)
        assert result["force.floor.z"][-1] == pytest.approx(BOX * GRAVITY, rel=0.005)
        assert result.vector("moment.floor")[-1] == pytest.approx([0, 0, 0], abs=1e-3)
        assert -result["distance.gap"][-1] == pytest.approx(BOX * GRAVITY / 4 / 1e5, rel=0.01)

    @pytest.mark.parametrize(
        "overrides", [SURFACE, {"pieces.box.model": "box"}], ids=["surface", "bare"]
    )
    def test_other_contacts_carry_the_weight_too(self, overrides):
        result = simulate(load_station("box_on_floor", overrides))
        assert result["force.floor.z"][-1] == pytest.approx(BOX * GRAVITY, rel=0.005)

    @pytest.mark.parametrize(("lean_deg", "falls_over"), [(22, False), (30, True)])
    def test_it_tips_over_beyond_its_balance(self, lean_deg, falls_over):
        """The balls' middles are 45 mm beside and 95 mm below that of the box: balance is lost beyond 25.3 degrees."""
        lean = np.deg2rad(lean_deg)
        height = 0.045 * np.sin(lean) + 0.095 * np.cos(lean) + 0.005

        result = simulate(
            load_station(
                "box_on_floor", {"pieces.box.pose": [0, 0, float(height), 0, float(lean), 0]}
            )
        )

        assert bool(result["piece.box.z"][-1] < 0.06) is falls_over
        assert np.abs(result.piece_velocity("box")[-1]).max() < 0.05

    def test_under_cenic_friction_is_that_of_the_momentum_and_says_so(self):
        """While the box tips, the floor's force across the surface is its mass times its acceleration."""
        lean = float(np.deg2rad(22))
        height = 0.045 * np.sin(lean) + 0.095 * np.cos(lean) + 0.005
        pose = {"pieces.box.pose": [0, 0, float(height), 0, lean, 0]}

        result = simulate(load_station("box_on_floor", {**pose, "sample_rate": 1000}), duration=0.2)

        assert result.summary()["sensors"]["floor"]["tangential"] == "momentum balance"

        moving = slice(20, 180)  # before the other edge lands
        force = BOX * np.gradient(result["piece.box.vx"], result.times)
        assert np.abs(force[moving]).max() > 1.0
        np.testing.assert_allclose(result["force.floor.x"][moving], force[moving], atol=0.3)

    @pytest.mark.long
    def test_a_fall_ends_the_run(self):
        lean = float(np.deg2rad(30))
        height = 0.045 * np.sin(lean) + 0.095 * np.cos(lean) + 0.005
        pose = {"pieces.box.pose": [0, 0, float(height), 0, lean, 0]}
        stopped = simulate(
            load_station("box_on_floor", {**pose, "monitors": {"fall": {"height": 0.07}}})
        )

        whole = simulate(load_station("box_on_floor", {**pose, "sample_rate": 2000}))

        assert stopped.stopped_by == "fall"
        assert stopped.stop_time == pytest.approx(
            whole.times[np.argmax(whole["piece.box.z"] < 0.07)], abs=1.5e-3
        )

        standing = simulate(
            load_station("box_on_floor", {"monitors": {"fall": {"height": 0.07, "tilt_deg": 5}}})
        )
        assert standing.ending == "completed"


@pytest.fixture(scope="module")
def touched():
    return simulate(load_station("irb120_force_stop"))


class TestForceStop:
    @pytest.mark.long
    @pytest.mark.usefixtures("no_plots")
    def test_the_run_ends_where_the_ball_touches(self, touched, tmp_path):
        assert (touched.ending, touched.stopped_by) == ("monitor", "stop")
        assert touched.message == f"tip and floor touch, at {touched.stop_time:.4g} s"

        speed = np.gradient(touched.pose("tcp")[:, 2], touched.times)[-2]
        assert abs(touched["distance.gap"][-1]) < 1e-3 * abs(speed) + 1e-6  # within 1 ms of contact
        # the middle of a ball of 10 mm
        assert touched.pose("tcp")[-1, 2] == pytest.approx(0.01, abs=1e-3)

        folder = touched.save(tmp_path / "stop")
        summary = json.loads((folder / "summary.json").read_text())
        assert summary["stopped_by"] == "stop"
        assert summary["stop_time"] == touched.times[-1] == touched.step_times[-1]

    def test_by_force_it_ends_a_little_later(self, touched):
        by_force = {"monitors.stop.kind": "force_limit", "monitors.stop.limit": 20}
        result = simulate(load_station("irb120_force_stop", by_force))

        assert (
            result.message
            == f"the force on tip reached the limit of 20 N, at {result.stop_time:.4g} s"
        )

        size = np.linalg.norm(result.vector("force.touch")[-1])
        assert 20 <= size < 20 + 1e-3 * 1e5 * 0.3  # 1 ms of the ball's way into a floor of 1e5 N/m
        assert touched.stop_time < result.stop_time < touched.stop_time + 0.01

    def test_a_limit_of_a_body_region_is_known_by_its_name(self):
        by_region = {
            "monitors.stop.kind": "force_limit",
            "monitors.stop.limit": "hands_and_fingers",
        }
        result = simulate(load_station("irb120_force_stop", by_region))
        assert "limit of 140 N (hands and fingers)" in result.message

    def test_an_arm_that_stays_above_the_floor_is_not_stopped(self):
        high = {
            "reference.target_deg": [0, 0, 26.1, 0, 63.9, 0],
            "monitors.force": {"kind": "force_limit", "limit": 1},
        }
        result = simulate(load_station("irb120_force_stop", high), duration=0.5)

        assert result.ending == "completed"
        assert result["distance.gap"].min() > 0.1

    def test_the_tool_leaves_its_workspace(self, touched):
        box = {"kind": "workspace", "lower": [0, -1, 0.1], "upper": [1, 1, 1]}
        result = simulate(load_station("irb120_force_stop", {"monitors.box": box}))

        assert result.stopped_by == "box"
        assert (
            result.message
            == f"the tool left its workspace: z below 0.1 m, at {result.stop_time:.4g} s"
        )

        height = touched.pose("tcp")[:, 2]
        assert result.stop_time == pytest.approx(
            float(np.interp(-0.1, -height, touched.times)), abs=2e-3
        )


FINE = {"solver.accuracy": 1e-4, "solver.max_step": 0.02}


class TestCobot:
    @pytest.mark.long
    def test_it_swings_and_a_tighter_run_swings_alike(self):
        runs = [simulate(load_station("irb120_cobot", overrides)) for overrides in ({}, FINE)]
        swings = [np.ptp(run.pose("tcp")[100:, 2]) for run in runs]

        assert swings[0] > 0.03
        assert swings[0] == pytest.approx(swings[1], rel=0.05)

    @pytest.mark.long
    def test_it_yields_more_and_more_without_chatter(self):
        swings = []

        for gain in (0, 10, 100, 300, 1000):
            result = simulate(load_station("irb120_cobot", {"servo.admittance_gain": gain}))
            assert result.ending == "completed"
            late = result.times >= 1.0
            swings.append(np.ptp(result.pose("tcp")[late, 2]))
            turns = np.diff(
                np.sign(result["v.joint_2"][late & (np.abs(result["v.joint_2"]) > 1e-3)])
            )
            # a force of 5 rad/s turns three times in two seconds
            assert np.count_nonzero(turns) <= 6
        assert (np.diff(swings) > 0).all()
        assert swings[0] < 0.003 < 10 * swings[0] < swings[-1]

    def test_with_no_gain_it_only_sags(self):
        result = simulate(
            load_station(
                "irb120_cobot", {"servo.admittance_gain": 0, "forces.hand.amplitude": [0, 0, 0]}
            )
        )
        position = result.axes("q")[-1]

        np.testing.assert_allclose(
            (result.axes("q_ref")[-1] - position) * 1000, result.axes("tau")[-1], atol=0.05
        )
        assert "felt.joint_1" not in result.names

    def test_a_known_force_is_felt_while_it_stands_and_while_it_moves(self):
        force = np.array([3.0, -4.0, 12.0])
        push = {"start": 0.2, "duration": 2.8, "force": force.tolist()}
        overrides = {
            "forces": {"push": push},
            "sensors": {"hand": {"kind": "external_torque"}},
            "reference": {"kind": "move", "target_deg": 30, "duration": 1.0},
            "solver.max_step": 0.01,
        }
        result = simulate(load_station("irb120_dynamic", overrides))

        error = np.linalg.norm(
            result.vector("external_force.hand") - force, axis=1
        ) / np.linalg.norm(force)

        moving = (result.times > 0.45) & (result.times < 1.0)
        assert np.abs(result.axes("v")[moving]).max() > 0.5
        assert error[moving].max() < 0.05
        assert error[(result.times > 2.0) & (result.times < 2.9)].max() < 0.02

    def test_in_the_loop_the_observer_tells_the_same(self):
        push = {"start": 0.1, "duration": 1.0, "force": [0, 0, 8]}
        sensor = {"kind": "external_torque", "in_loop": True}
        overrides = {
            "forces": {"push": push},
            "sensors": {"hand": sensor},
            "robot.initial_deg": {"joint_5": 45},
        }
        overrides["reference"] = {"kind": "hold", "target_deg": {"joint_5": 45}}

        result = simulate(load_station("irb120_dynamic", overrides), duration=1.0)

        np.testing.assert_allclose(result.vector("external_force.hand")[-1], [0, 0, 8], atol=0.16)


@pytest.mark.parametrize("self_collision", [False, True])
def test_surfaces_leave_neighbours_free_to_move(self_collision):
    """The links of an arm overlap at its joints; new surfaces do not make them collide there."""
    contact = {"contact": {"stiffness": 1e4, "dissipation": 1, "self_collision": self_collision}}
    overrides = {"floor": None, "pieces": {}}
    touching = simulate(load_station("irb120_dynamic", {**overrides, **contact}), duration=0.2)

    free = simulate(load_station("irb120_dynamic", overrides), duration=0.2)

    np.testing.assert_allclose(touching.axes("q"), free.axes("q"), atol=1e-12)


def test_joint_torque_sensors_read_what_the_servos_give_less_the_damping(caplog):
    overrides = {"sensors": {"gears": {"kind": "joint_torque"}}}
    with caplog.at_level("WARNING", logger="drake"):
        result = simulate(load_station("double_pendulum", overrides), duration=1.0)

    assert caplog.records == []  # of joint limits, for which a station has stops of its own
    gears = np.column_stack([result[f"joint_torque.gears.joint_{number}"] for number in (1, 2)])
    np.testing.assert_allclose(gears, result.axes("tau") - 0.01 * result.axes("v"), atol=1e-9)


def test_distances_are_measured_in_a_kinematic_station():
    sensor = {
        "sensors": {"gap": {"kind": "distance", "body": "tip"}},
        "pieces.tip": {"parent": "load"},
    }
    result = simulate(load_station("irb120_kinematic", sensor), duration=0.5)
    np.testing.assert_allclose(result["distance.gap"], result.pose("tcp")[:, 2] - 0.01, atol=1e-9)


def test_two_runs_with_sensors_and_monitors_are_equal_to_the_last_bit(touched):
    again = simulate(load_station("irb120_force_stop"))
    np.testing.assert_array_equal(again.values, touched.values)


def test_under_cenic_the_friction_of_an_arm_is_left_out_and_that_is_said():
    overrides = {
        "solver.scheme": "cenic",
        "solver.max_step": 0.01,
        "monitors.stop.kind": "force_limit",
    }
    result = simulate(load_station("irb120_force_stop", {**overrides, "monitors.stop.limit": 20}))

    assert result.summary()["sensors"]["touch"]["tangential"] == "left out"
    np.testing.assert_allclose(result.vector("force.touch")[:, :2], 0, atol=1e-9)
    assert 20 <= result["force.touch.z"][-1] < 60


def test_the_recording_shows_the_contact_forces(tmp_path):
    result = simulate(load_station("box_on_floor"), duration=0.2)
    page = save_recording(result, tmp_path / "box.html").read_text(encoding="utf-8")

    messages = [base64.b64decode(text) for text in re.findall(r"base64,([A-Za-z0-9+/=]+)", page)]

    (animation,) = [message for message in messages if b"set_animation" in message]
    assert animation.count(b"/drake/contact_forces/") >= 4

    flying = simulate(load_station("bouncing_ball"), duration=0.1)
    page = save_recording(flying, tmp_path / "ball.html").read_text(encoding="utf-8")

    assert not any(
        b"contact_forces" in base64.b64decode(text)
        for text in re.findall(r"base64,([\w+/=]+)", page)
    )


@pytest.mark.parametrize("own", [{"model": "point"}, {}], ids=["at a point", "over facets"])
def test_a_piece_that_meets_others_at_points_rolls_on_where_its_facets_would_brake_it(own):
    """A ball that rolls on the level keeps its speed."""
    changes = {
        "contact.model": "hydroelastic_with_fallback",
        "contact.dissipation": 5.0,
        "contact.stiffness": 1.0e4,
        "pieces": {
            "ball": {"model": "ball", "free": True, "pose": [0, 0, 0.06, 0, 0, 0], "contact": own}
        },
        "forces.push": {"at": "ball", "start": 0, "duration": 0.1, "force": [5, 0, 0]},
        "sensors": {},
        "solver": {"kind": "discrete", "time_step": 0.001},
    }
    result = simulate(load_station("bouncing_ball", changes), duration=1.5, progress=False)

    speed = result.piece_velocity("ball")[:, 0]

    kept = speed[-1] / speed[20]
    assert (kept > 0.97) == bool(own)


def test_a_piece_that_meets_others_at_points_needs_a_model_that_allows_it():
    own = {
        "ball": {
            "model": "ball",
            "free": True,
            "pose": [0, 0, 0.06, 0, 0, 0],
            "contact": {"model": "point"},
        }
    }
    station = load_station(
        "bouncing_ball", {"contact.model": "hydroelastic", "pieces": own, "sensors": {}}
    )
    with pytest.raises(InvalidParameter, match="hydroelastic_with_fallback"):
        simulate(station, duration=0.1, progress=False)
