"""Inertial measurement unit: measurements against closed forms, and statistics of their errors."""

import gc

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.parts.sensors.frames import InertialUnit
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.results.plots.own import save_plots

G = 9.80665
PERIOD = 1 / 200
QUATERNION = [f"orientation.imu.{part}" for part in ("qw", "qx", "qy", "qz")]


def measure(station, duration, imu=None, *, reference=None, **overrides):
    """Run a station with an IMU. The result has one row for each sample of the IMU."""
    config = load_station(station, {"sensors": {"imu": imu or {}}, "sample_rate": 200, **overrides})
    return simulate(config, duration=duration, reference=reference, progress=False)


def measured_rotations(result):
    """Orientations that the IMU measures, as matrices (m, 3, 3)."""
    quaternions = np.column_stack([result[name] for name in QUATERNION])
    return np.array(
        [transform_from_xyz_quaternion([0, 0, 0, *q]).rotation().matrix() for q in quaternions]
    )


def test_at_rest_it_measures_gravity_upward():
    result = measure("irb120_dynamic", 0.1)

    force = result.vector("specific_force.imu")
    np.testing.assert_allclose(force, np.tile([0, 0, G], (21, 1)), atol=1e-12)
    np.testing.assert_allclose(result.vector("angular_velocity.imu"), 0, atol=1e-12)
    rotations = measured_rotations(result)
    np.testing.assert_allclose(rotations, np.tile(np.eye(3), (21, 1, 1)), atol=1e-12)
    assert result.units["specific_force.imu.x"] == "m/s²"
    assert result.units["angular_velocity.imu.x"] == "rad/s"
    assert result.units["orientation.imu.qw"] == "1"


def test_in_free_fall_it_measures_zero_and_an_impact_in_full():
    """The ball falls by 100 mm in 0.1428 s. The sum of the specific forces and gravity is its change of velocity."""
    result = measure("bouncing_ball", 0.5, {"frame": "ball"})

    force = result.vector("specific_force.imu")
    is_falling = (result.times > PERIOD / 2) & (result.times < 0.14)
    np.testing.assert_allclose(force[is_falling], 0, atol=1e-9)
    velocity = result.piece_velocity("ball")[:, :3]
    measured_change = np.cumsum(force[1:] - [0, 0, G], axis=0) * PERIOD
    np.testing.assert_allclose(measured_change, velocity[1:] - velocity[0], atol=1e-9)
    assert force[:, 2].max() > 5 * G


class TestOnATurntable:
    """Joint 1 of the arm turns the tool about an upright axis: closed forms of the mean over a sample."""

    def run(self, angles, **imu):
        """Run the arm with angles of joint 1 (m,) [rad] at the samples."""
        times = PERIOD * np.arange(len(angles))
        rows = np.zeros((6, len(angles)))
        rows[0] = angles
        motion = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(times, rows)
        return measure("irb120_kinematic", times[-1], {"frame": "load", **imu}, reference=motion)

    def pose_at_start(self, result):
        """Pose of the tool in the world at the start."""
        assert result.names.count("tcp.x") == 1
        return transform_from_xyz_quaternion(result.pose("tcp")[0])

    def test_at_constant_speed_it_measures_the_centripetal_acceleration(self):
        speed = 1.5

        result = self.run(speed * PERIOD * np.arange(201))

        start = self.pose_at_start(result)
        to_tool = start.rotation().inverse()
        arm = start.translation() * [1, 1, 0]
        assert np.linalg.norm(arm) > 0.3
        # The mean of an acceleration that turns by an angle is shorter, as a chord is shorter than its arc.
        chord = np.sinc(speed * PERIOD / 2 / np.pi)
        expected_force = to_tool @ (-(speed**2) * chord * arm + [0, 0, G])
        force = result.vector("specific_force.imu")[2:-1]
        np.testing.assert_allclose(force, np.tile(expected_force, (len(force), 1)), atol=1e-8)
        expected_rates = to_tool @ [0, 0, speed]
        rates = result.vector("angular_velocity.imu")[1:-1]
        np.testing.assert_allclose(rates, np.tile(expected_rates, (len(rates), 1)), atol=1e-8)
        from_start = measured_rotations(result) @ to_tool.matrix()
        np.testing.assert_allclose(from_start, about_z(speed * result.times), atol=1e-9)

    def test_at_constant_acceleration_it_also_measures_the_tangential_one(self):
        acceleration = 2.0

        result = self.run(acceleration * (PERIOD * np.arange(201)) ** 2 / 2)

        start = self.pose_at_start(result)
        arm = start.translation() * [1, 1, 0]
        tangent = np.cross([0, 0, 1], arm)
        # In axes that turn with joint 1.
        force = result.vector("specific_force.imu")[1:] @ start.rotation().matrix().T
        # The mean over a sample is the value midway between two samples, up to terms of the order of T².
        speed = acceleration * (result.times[1:] - PERIOD / 2)
        expected = acceleration * tangent - speed[:, np.newaxis] ** 2 * arm + [0, 0, G]
        np.testing.assert_allclose(force, expected, atol=(speed[-1] * PERIOD) ** 2)


def about_z(angles):
    """Rotations about z by angles (m,) [rad], as matrices (m, 3, 3)."""
    cos = np.cos(angles)
    sin = np.sin(angles)
    zero = np.zeros_like(angles)
    rows = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1]])
    return np.moveaxis(rows, -1, 0)


ERRORS = {
    "accelerometer_noise": 0.2,
    "gyroscope_noise": 0.03,
    "accelerometer_bias": 0.1,
    "gyroscope_bias": 0.02,
}
NOISY = {
    "seed": 5,
    "accelerometer_noise": 0.1,
    "gyroscope_noise": 0.01,
    "accelerometer_bias": 0.3,
    "rate": 130,
}


class TestNoise:
    def force_error(self, result):
        """Errors of the specific force at an arm's base at rest, shape (m, 3) [m/s²]."""
        return result.vector("specific_force.imu") - [0, 0, G]

    def rate_error(self, result):
        """Errors of the angular velocity at an arm's base at rest, shape (m, 3) [rad/s]."""
        return result.vector("angular_velocity.imu")

    @pytest.mark.long
    def test_samples_have_white_noise_of_the_given_size_about_the_bias(self):
        result = measure("irb120_kinematic", 15.0, {"seed": 7, **ERRORS})

        errors = (self.force_error(result), self.rate_error(result))
        for error, noise, bias in zip(errors, (0.2, 0.03), (0.1, 0.02), strict=True):
            assert len(np.unique(error)) == error.size == 3 * 3001
            # The tolerance is 4.6 standard deviations, 1/sqrt(2 · 3001) each.
            np.testing.assert_allclose(error.std(axis=0), noise, rtol=0.06)
            offset = error.mean(axis=0)
            assert np.all(np.abs(offset) < 4 * bias)
            white = (error - offset) / noise
            # Neither successive samples nor axes are correlated.
            correlation = (white[1:] * white[:-1]).mean(axis=0)
            assert np.abs(correlation).max() < 5 / np.sqrt(3000)
            np.testing.assert_allclose(np.corrcoef(white.T), np.eye(3), atol=5 / np.sqrt(3000))

    @pytest.mark.long
    def test_a_bias_is_constant_and_drawn_from_the_seed(self):
        biases = {"accelerometer_bias": 0.1, "gyroscope_bias": 0.02}
        drawn = []

        for seed in range(20):
            result = measure("irb120_kinematic", 0.02, {"seed": seed, **biases})
            force = self.force_error(result)
            assert np.abs(np.ptp(force, axis=0)).max() < 1e-12
            drawn.append([*force[-1] / 0.1, *self.rate_error(result)[-1] / 0.02])

        # Four standard deviations of the spread and of the mean of 120 normal values.
        assert np.std(drawn) == pytest.approx(1, abs=4 / np.sqrt(2 * 120))
        assert np.mean(drawn) == pytest.approx(0, abs=4 / np.sqrt(120))

    def test_the_same_seed_gives_the_same_values_to_the_last_bit(self):
        first, second, other = (
            measure("irb120_kinematic", 0.2, {"seed": seed, **ERRORS}) for seed in (3, 3, 4)
        )

        np.testing.assert_array_equal(first.values, second.values)
        assert not np.isclose(self.force_error(first), self.force_error(other)).any()


def is_between_samples(result, rate):
    """Whether each time of a result is no sample of a sensor, shape (m,). At a sample, either value may be recorded."""
    samples = rate * result.times
    return np.abs(samples - np.round(samples)) > 1e-6


class TestInTheLoop:
    def test_its_values_are_those_of_a_replay(self):
        stepped = measure("irb120_kinematic", 0.7, {**NOISY, "in_loop": True})
        replayed = measure("irb120_kinematic", 0.7, {**NOISY, "in_loop": False})

        rows = is_between_samples(stepped, rate=130)
        names = [name for name in stepped.names if ".imu." in name]
        for name in names:
            np.testing.assert_allclose(stepped[name][rows], replayed[name][rows], atol=1e-9)

    @pytest.mark.long
    def test_its_values_are_those_of_a_replay_of_an_arm_moved_by_forces(self):
        accurate = {"solver.accuracy": 1e-5}
        imu = {**NOISY, "frame": "load"}

        stepped = measure("irb120_dynamic", 0.7, {**imu, "in_loop": True}, **accurate)
        replayed = measure("irb120_dynamic", 0.7, {**imu, "in_loop": False}, **accurate)

        rows = is_between_samples(stepped, rate=130)
        force = stepped.vector("specific_force.imu")[rows]
        replayed_force = replayed.vector("specific_force.imu")[rows]
        assert np.ptp(replayed_force, axis=0).max() > 5
        # Samples of a block end steps of the solver, so the two runs have different steps.
        np.testing.assert_allclose(force, replayed_force, atol=0.05)

    def test_a_run_that_continues_another_one_continues_its_samples(self):
        discrete = {
            "solver": {"kind": "discrete", "time_step": 1e-3},
            "reference": {"kind": "hold"},
        }
        imu = {**NOISY, "rate": 100, "in_loop": True}
        config = load_station("irb120_dynamic", {"sensors": {"imu": imu}, **discrete})

        whole = simulate(config, duration=0.2, progress=False)
        first = simulate(config, duration=0.1, progress=False)
        second = simulate(config, duration=0.1, start=first.final_state, progress=False)

        sample_count = first.final_state.blocks["sensor.imu"].discrete[-2][-1]
        assert sample_count == 10
        for name in whole.names:
            np.testing.assert_array_equal(second[name][1:], whole[name][11:])

    @pytest.mark.parametrize("in_loop", [True, False])
    def test_its_block_is_released_with_its_run(self, in_loop):
        measure("irb120_kinematic", 0.02, {"in_loop": in_loop})

        gc.collect()
        assert not [each for each in gc.get_objects() if issubclass(type(each), InertialUnit)]

    @pytest.mark.long
    def test_the_block_picture_and_the_plots_show_it(self, tmp_path):
        config = load_station("irb120_kinematic", {"sensors": {"imu": {"in_loop": True}}})

        result = simulate(config, duration=0.1, progress=False)

        assert "IMU\\nimu" in station_dot(config)
        assert result.notes["imu"] == {"kind": "imu", "frame": "base_link"}
        assert "imu_imu.png" in {file.name for file in save_plots(result, tmp_path)}


@pytest.mark.parametrize(
    ("station", "imu", "message"),
    [
        ("irb120_dynamic", {"frame": "link_7"}, "sensors.imu.frame.*'link_7'.*link_6"),
        ("two_irb120", {}, "sensors.imu.frame.*one of"),
        ("bouncing_ball", {}, "sensors.imu.frame"),
        ("irb120_dynamic", {"rate": 0}, "sensors.imu.*rate.*greater than 0"),
        ("irb120_dynamic", {"gyroscope_noise": -1}, "sensors.imu.*gyroscope_noise.*0"),
        ("irb120_dynamic", {"seed": -1}, "sensors.imu.*seed.*0"),
        ("irb120_dynamic", {"noise": 1}, "sensors.imu.*noise"),
    ],
)
def test_an_invalid_section_is_refused_with_its_cause(station, imu, message):
    with pytest.raises(SimrobError, match=message):
        load_station(station, {"sensors": {"imu": {"kind": "imu", **imu}}})
