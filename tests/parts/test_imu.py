"""The inertial measurement unit: against closed forms of what it feels, and the statistics of its errors."""

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


def measured(station, duration, imu=None, *, reference=None, **overrides):
    """Run a station with an IMU, and look at each of its samples once."""
    config = load_station(station, {"sensors": {"imu": imu or {}}, "sample_rate": 200, **overrides})
    return simulate(config, duration=duration, reference=reference, progress=False)


def turns(result):
    """Return the orientations that the IMU tells, as matrices (m, 3, 3)."""
    quaternions = np.column_stack([result[name] for name in QUATERNION])
    return np.array(
        [transform_from_xyz_quaternion([0, 0, 0, *q]).rotation().matrix() for q in quaternions]
    )


def test_at_rest_it_feels_the_floor_s_push_upward():
    result = measured("irb120_dynamic", 0.1)
    np.testing.assert_allclose(
        result.vector("specific_force.imu"), np.tile([0, 0, G], (21, 1)), atol=1e-12
    )
    np.testing.assert_allclose(result.vector("angular_velocity.imu"), 0, atol=1e-12)
    np.testing.assert_allclose(turns(result), np.tile(np.eye(3), (21, 1, 1)), atol=1e-12)
    assert [
        result.units[name]
        for name in ("specific_force.imu.x", "angular_velocity.imu.x", QUATERNION[0])
    ] == [
        "m/s²",
        "rad/s",
        "1",
    ]


def test_in_free_fall_it_feels_nothing_and_an_impact_in_full():
    """The ball falls by 100 mm, which takes 0.1428 s; the sum of what is felt is all that changed the velocity."""
    result = measured("bouncing_ball", 0.5, {"frame": "ball"})
    felt = result.vector("specific_force.imu")
    falling = (result.times > PERIOD / 2) & (result.times < 0.14)
    np.testing.assert_allclose(felt[falling], 0, atol=1e-9)
    velocity = result.piece_velocity("ball")[:, :3]
    changed = np.cumsum(felt[1:] - [0, 0, G], axis=0) * PERIOD
    np.testing.assert_allclose(changed, velocity[1:] - velocity[0], atol=1e-9)
    assert felt[:, 2].max() > 5 * G


class TestOnATurntable:
    """Joint 1 of the arm turns the tool about an upright axis: closed forms of the mean over a sample."""

    def run(self, angles, **imu):
        times = PERIOD * np.arange(len(angles))
        rows = np.zeros((6, len(angles)))
        rows[0] = angles
        course = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(times, rows)
        return measured("irb120_kinematic", times[-1], {"frame": "load", **imu}, reference=course)

    def at_start(self, result):
        """Return where the tool is at the start, in the world: its pose as a transform."""
        assert result.names.count("tcp.x") == 1
        return transform_from_xyz_quaternion(result.pose("tcp")[0])

    def test_at_constant_speed_it_is_drawn_to_the_axis(self):
        speed = 1.5
        result = self.run(speed * PERIOD * np.arange(201))
        start = self.at_start(result)
        arm = start.translation() * [1, 1, 0]
        # the mean of a centripetal acceleration that turns
        chord = np.sinc(speed * PERIOD / 2 / np.pi)
        expected = start.rotation().inverse() @ (-(speed**2) * chord * arm + [0, 0, G])
        felt = result.vector("specific_force.imu")[2:-1]
        assert np.linalg.norm(arm) > 0.3
        np.testing.assert_allclose(felt, np.tile(expected, (len(felt), 1)), atol=1e-8)
        rates = result.vector("angular_velocity.imu")[1:-1]
        expected = start.rotation().inverse() @ [0, 0, speed]
        np.testing.assert_allclose(rates, np.tile(expected, (len(rates), 1)), atol=1e-8)
        angles = speed * result.times
        np.testing.assert_allclose(
            turns(result) @ start.rotation().inverse().matrix(), about_z(angles), atol=1e-9
        )

    def test_speeding_up_it_is_held_back_along_its_way(self):
        faster = 2.0
        result = self.run(faster * (PERIOD * np.arange(201)) ** 2 / 2)
        start = self.at_start(result)
        arm = start.translation() * [1, 1, 0]
        along = np.cross([0, 0, 1], arm)
        # in axes that turn with joint 1
        felt = result.vector("specific_force.imu")[1:] @ start.rotation().matrix().T
        speed = faster * (result.times[1:] - PERIOD / 2)
        expected = faster * along - speed[:, np.newaxis] ** 2 * arm + [0, 0, G]
        # of the order of T²
        np.testing.assert_allclose(felt, expected, atol=(speed[-1] * PERIOD) ** 2)


def about_z(angles):
    c, s, o = np.cos(angles), np.sin(angles), np.zeros_like(angles)
    return np.moveaxis(np.array([[c, -s, o], [s, c, o], [o, o, o + 1]]), -1, 0)


FIGURES = {
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
    def error(self, result):
        """Return what an arm's base at rest feels too much: specific force and rates, each (m, 3)."""
        return result.vector("specific_force.imu") - [0, 0, G], result.vector(
            "angular_velocity.imu"
        )

    @pytest.mark.long
    def test_its_samples_scatter_as_asked_about_the_bias(self):
        result = measured("irb120_kinematic", 15.0, {"seed": 7, **FIGURES})
        for error, noise, bias in zip(self.error(result), (0.2, 0.03), (0.1, 0.02), strict=True):
            assert len(np.unique(error)) == error.size == 3 * 3001
            # 4.6 times 1/sqrt(2 · 3001)
            np.testing.assert_allclose(error.std(axis=0), noise, rtol=0.06)
            offset = error.mean(axis=0)
            assert np.all(np.abs(offset) < 4 * bias)
            white = (error - offset) / noise
            # no memory
            assert np.abs((white[1:] * white[:-1]).mean(axis=0)).max() < 5 / np.sqrt(3000)
            np.testing.assert_allclose(np.corrcoef(white.T), np.eye(3), atol=5 / np.sqrt(3000))

    @pytest.mark.long
    def test_a_bias_stays_and_is_drawn_from_the_seed(self):
        quiet = {"accelerometer_bias": 0.1, "gyroscope_bias": 0.02}
        drawn = []
        for seed in range(20):
            force, rates = self.error(measured("irb120_kinematic", 0.02, {"seed": seed, **quiet}))
            assert np.abs(np.ptp(force, axis=0)).max() < 1e-12
            drawn.append([*force[-1] / 0.1, *rates[-1] / 0.02])
        assert np.std(drawn) == pytest.approx(1, abs=4 / np.sqrt(2 * 120))
        assert np.mean(drawn) == pytest.approx(0, abs=4 / np.sqrt(120))

    def test_a_seed_means_the_same_figures_to_the_last_bit(self):
        runs = [measured("irb120_kinematic", 0.2, {"seed": seed, **FIGURES}) for seed in (3, 3, 4)]
        np.testing.assert_array_equal(runs[0].values, runs[1].values)
        assert not np.isclose(self.error(runs[0])[0], self.error(runs[2])[0]).any()


class TestInTheLoop:
    def test_it_tells_what_a_replay_tells(self):
        told = [
            measured("irb120_kinematic", 0.7, {**NOISY, "in_loop": loop}) for loop in (True, False)
        ]
        # at a sample either may be told
        rows = np.abs(130 * told[0].times - np.round(130 * told[0].times)) > 1e-6
        names = [name for name in told[0].names if ".imu." in name]
        for name in names:
            np.testing.assert_allclose(told[0][name][rows], told[1][name][rows], atol=1e-9)

    @pytest.mark.long
    def test_it_tells_what_a_replay_tells_of_an_arm_that_is_stepped(self):
        figures = {**NOISY, "frame": "load"}
        told = [
            measured(
                "irb120_dynamic", 0.7, {**figures, "in_loop": loop}, **{"solver.accuracy": 1e-5}
            )
            for loop in (True, False)
        ]
        rows = np.abs(130 * told[0].times - np.round(130 * told[0].times)) > 1e-6
        felt = [result.vector("specific_force.imu")[rows] for result in told]
        assert np.ptp(felt[1], axis=0).max() > 5
        np.testing.assert_allclose(felt[0], felt[1], atol=0.05)  # the steps end elsewhere

    def test_a_run_goes_on_with_its_samples(self):
        discrete = {
            "solver": {"kind": "discrete", "time_step": 1e-3},
            "reference": {"kind": "hold"},
        }
        figures = {**NOISY, "rate": 100, "in_loop": True}
        config = load_station("irb120_dynamic", {"sensors": {"imu": figures}, **discrete})
        whole = simulate(config, duration=0.2, progress=False)
        first = simulate(config, duration=0.1, progress=False)
        second = simulate(config, duration=0.1, start=first.final_state, progress=False)
        assert first.final_state.blocks["sensor.imu"].discrete[-2][-1] == 10  # samples
        for name in whole.names:
            np.testing.assert_array_equal(second[name][1:], whole[name][11:])

    @pytest.mark.parametrize("in_loop", [True, False])
    def test_it_goes_with_its_run(self, in_loop):
        measured("irb120_kinematic", 0.02, {"in_loop": in_loop})
        gc.collect()
        assert not [each for each in gc.get_objects() if issubclass(type(each), InertialUnit)]

    @pytest.mark.long
    def test_it_stands_in_the_picture_and_in_the_plots(self, tmp_path):
        config = load_station("irb120_kinematic", {"sensors": {"imu": {"in_loop": True}}})
        assert "IMU\\nimu" in station_dot(config)
        result = simulate(config, duration=0.1, progress=False)
        assert result.notes["imu"] == {"kind": "imu", "frame": "base_link"}
        assert "imu_imu.png" in {file.name for file in save_plots(result, tmp_path)}


@pytest.mark.parametrize(
    ("station", "imu", "told"),
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
def test_what_cannot_be_is_told(station, imu, told):
    with pytest.raises(SimrobError, match=told):
        load_station(station, {"sensors": {"imu": {"kind": "imu", **imu}}})
