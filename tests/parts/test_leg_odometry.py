"""Leg odometry: against its equations, closed forms, and walks with a known true motion."""

import gc
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.parts.sensors.frames import InertialUnit
from simrob_drake.parts.sensors.leg_odometry import BaseEstimator, LegOdometry, Soles
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.quadruped import trot
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.stations import feedback_loops
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

PERIOD = 0.005
"""Time between two samples [s]."""
GRAVITY = np.array([0.0, 0.0, -9.80665])


@cache
def close_station(station):
    """Build a station."""
    return closed_station(resolve(load_station(station)))


def robot_of(station):
    """Robot of a station, in its plant."""
    return close_station(station).ports.robot(None)


class Estimator(NamedTuple):
    """Block of an estimator.

    Attributes:
        block: the block.
        memory: memory at the start, for a robot upright at rest at the origin.
    """

    block: BaseEstimator
    memory: dict[str, Vector]


def make_estimator(station, **options):
    """Create the estimator of a station's robot."""
    soles = Soles(robot_of(station))
    start = np.array([0.0, 0, 0, 1, 0, 0, 0])
    section = LegOdometry.model_validate({"kind": "leg_odometry", "rate": 1 / PERIOD})
    count = len(soles.arms)
    memory = {
        "base_pose": start,
        "base_velocity": np.zeros(6),
        "bias": np.zeros(3),
        "lowest": np.zeros(4 * count),
        "places": np.zeros(3 * count),
        "shares": np.zeros(count),
    }
    return Estimator(BaseEstimator(section, soles, start=start, **options), memory)


def sample(block, memory, *reads):
    """Memory of a block after samples with these inputs."""
    for read in reads:
        memory = {**memory, **block.sample(memory, read)}
    return memory


def make_inputs(position, rotation=None, acceleration=None, rates=(0.1, 0.2, 0.3), **forces):
    """Inputs of the estimator for a robot in an orientation, at rest or with an acceleration [m/s²].

    Args:
        position: positions of the axes, shape (n,) [rad].
        rotation: rotation of the root link; none by default.
        acceleration: acceleration of the root link in the world, shape (3,); none by default.
        rates: angular velocity that the gyroscope measures [rad/s].
        **forces: vertical force on each foot [N], by the foot's link.
    """
    rotation = RotationMatrix() if rotation is None else rotation
    acceleration = np.zeros(3) if acceleration is None else np.array(acceleration)
    return {
        "position": position,
        "orientation": rotation.ToQuaternion().wxyz(),
        "angular_velocity": np.array(rates),
        "specific_force": rotation.matrix().T @ (acceleration - GRAVITY),
        **{foot: np.array([0.0, 0.0, force]) for foot, force in forces.items()},
    }


class Balls(NamedTuple):
    """The k ball feet of a robot.

    Attributes:
        middles: middles of the balls from the root link, in the world's axes, shape (k, 3) [m].
        rotations: rotations of the links of the balls, shape (k, 3, 3).
    """

    middles: Vector
    rotations: Vector


def balls_of(robot, position, rotation):
    """Compute the ball feet by Drake, for positions of the axes (n,) [rad] and a rotation of the root link."""
    plant = robot.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, position)
    positions = plant.GetPositions(context)
    start = robot.root.body().floating_positions_start()
    positions[start : start + 7] = [*rotation.ToQuaternion().wxyz(), 0, 0, 0]
    plant.SetPositions(context, positions)

    middles = []
    rotations = []
    for link, points in robot.feet.points.items():
        frame = plant.GetFrameByName(link, robot.instance)
        in_link = np.array(points).T
        in_world = plant.CalcPointsPositions(context, frame, in_link, plant.world_frame())
        middles += in_world.T.tolist()
        rotations += [frame.CalcPoseInWorld(context).rotation().matrix()] * len(points)
    return Balls(middles=np.array(middles), rotations=np.array(rotations))


class Weighted(NamedTuple):
    """Errors of the points of the feet in a sample.

    Attributes:
        errors: error e of each point, shape (k, 3) [m].
        weights: weight w of each point, shape (k,).
    """

    errors: Vector
    weights: Vector


def weigh_errors(robot, first, second, forces, step):
    """Compute errors and weights by the equations of the module, with a speed of slip of 0.07 m/s.

    Args:
        robot: robot on ball feet.
        first: its balls at the sample before.
        second: its balls at this sample.
        forces: forces on the feet at both samples, by link [N]; empty if they are not measured.
        step: predicted step of the base, shape (3,) [m].
    """
    links = robot.feet.links
    counts = [len(robot.feet.points[link]) for link in links]
    foot_of_ball = np.repeat(range(len(links)), counts)
    down = np.array([0.0, 0.0, robot.feet.radius])
    errors = []
    weights = []
    for ball, foot in enumerate(foot_of_ball):
        weight = 1.0
        for balls, own_forces in zip((first, second), forces, strict=True):
            heights = balls.middles[:, 2]
            # With forces, the balls of a foot are compared among themselves.
            compared = heights[foot_of_ball == foot] if own_forces else heights
            weight *= np.exp((compared.min() - heights[ball]) / 0.003)
            if own_forces:
                weight *= min(own_forces[links[foot]] / 20.0, 1.0)
        # The point that was the lowest one has moved with the ball.
        turned_down = second.rotations[ball] @ first.rotations[ball].T @ down
        first_point = first.middles[ball] - down
        second_point = second.middles[ball] - turned_down
        error = first_point - second_point - step
        errors.append(error)
        weights.append(weight / (1 + error @ error / (0.07 * PERIOD) ** 2))
    return Weighted(errors=np.array(errors), weights=np.array(weights))


@pytest.mark.parametrize(
    ("station", "forces"), [("zjudancer_dynamic", None), ("yobotics_dynamic", [10.0, 30, 40, 5])]
)
def test_a_sample_is_that_of_its_equations(station, forces):
    """Two samples of a robot that turns, accelerates and changes its posture, with forces on its feet or without."""
    robot = robot_of(station)
    turn_axis = np.array([0.6, 0.0, 0.8])
    first_rotation = RotationMatrix(AngleAxis(0.1, turn_axis))
    second_rotation = RotationMatrix(AngleAxis(0.11, turn_axis))
    change = 0.01 * np.random.default_rng(1).standard_normal(len(robot.axes))
    second_position = robot.initial + change
    first_forces = {}
    second_forces = {}
    if forces is not None:
        first_forces = dict(zip(robot.feet.links, forces, strict=True))
        second_forces = {link: 0.8 * force for link, force in first_forces.items()}
    acceleration = np.array([1.0, 2.0, 3.0])
    bias = np.array([0.03, 0.02, -0.01])
    velocity = np.array([0.1, -0.05, 0.02])
    place = np.array([1.0, 2.0, 0.3])

    estimator = make_estimator(station, level=True, force=None if forces is None else 20.0)
    block = estimator.block
    inputs = make_inputs(robot.initial, first_rotation, **first_forces)
    first = sample(block, estimator.memory, inputs)
    first["bias"] = bias
    first["base_velocity"] = np.array([*velocity, 0, 0, 0])
    first["base_pose"] = np.concatenate([place, first_rotation.ToQuaternion().wxyz()])
    inputs = make_inputs(second_position, second_rotation, acceleration, **second_forces)
    second = sample(block, first, inputs)

    # The prediction, with the rotation midway between the samples.
    middle_rotation = RotationMatrix(AngleAxis(0.105, turn_axis)).matrix()
    specific_force = second_rotation.matrix().T @ (acceleration - GRAVITY)
    predicted = middle_rotation @ (specific_force - bias) + GRAVITY
    new_velocity = velocity + PERIOD * predicted
    step = PERIOD * velocity + PERIOD**2 / 2 * predicted

    first_balls = balls_of(robot, robot.initial, first_rotation)
    second_balls = balls_of(robot, second_position, second_rotation)
    weighted = weigh_errors(robot, first_balls, second_balls, (first_forces, second_forces), step)
    total = weighted.weights.sum()
    trust = min(total, 1.0)
    error = weighted.weights @ weighted.errors / total
    assert trust > 0.01  # the feet take part

    # The correction, and the height on level ground.
    new_place = place + step + trust * error
    lowest_points = second_balls.middles[:, 2] - robot.feet.radius
    lowest_height = weighted.weights @ lowest_points / total
    new_place[2] += trust * (1 - np.exp(-PERIOD)) * (0.0 - lowest_height - new_place[2])
    gain = trust * (1 - np.exp(-PERIOD / 0.1)) / PERIOD
    new_bias = bias - gain / 1.0 * middle_rotation.T @ error
    assert second["bias"] == pytest.approx(new_bias, abs=1e-12)
    new_pose = [*new_place, *second_rotation.ToQuaternion().wxyz()]
    assert second["base_pose"] == pytest.approx(new_pose, abs=1e-12)
    new_spin = second_rotation.matrix() @ [0.1, 0.2, 0.3]
    expected_velocity = [*(new_velocity + gain * error), *new_spin]
    assert second["base_velocity"] == pytest.approx(expected_velocity, abs=1e-10)


def test_in_the_air_it_integrates_the_accelerometer():
    """After 0.5 s of a constant acceleration a the velocity is a t, and the distance a t² / 2."""
    estimator = make_estimator("zjudancer_dynamic", force=10.0)
    position = robot_of("zjudancer_dynamic").initial
    inputs = make_inputs(position, acceleration=[1.0, 0.0, -2.0], right_foot=0.0, left_foot=0.0)

    memory = sample(estimator.block, estimator.memory, *[inputs] * 100)

    assert memory["base_velocity"][:3] == pytest.approx([0.5, 0, -1], abs=1e-12)
    assert memory["base_pose"][:3] == pytest.approx([0.125, 0, -0.25], abs=1e-12)


def test_standing_feet_stop_the_estimate_and_show_the_bias():
    """An error of the accelerometer, and a wrong velocity, move the position by less than a millimetre."""
    block, memory = make_estimator("zjudancer_dynamic")
    memory["base_velocity"] = np.array([0.03, 0, 0, 0, 0, 0])
    position = robot_of("zjudancer_dynamic").initial
    inputs = make_inputs(position, acceleration=[0.0, 0.1, -0.2])

    memory = sample(block, memory, *[inputs] * 1600)

    assert memory["bias"] == pytest.approx([0, 0.1, -0.2], abs=2e-3)
    assert memory["base_velocity"][:3] == pytest.approx(np.zeros(3), abs=2e-4)
    assert np.abs(memory["base_pose"][:3]).max() < 1e-3


@pytest.mark.parametrize("name", ["position", "orientation", "angular_velocity", "specific_force"])
def test_a_sample_that_is_not_finite_is_skipped(name):
    """The base continues at its velocity, and the feet do not count at the next sample."""
    block, memory = make_estimator("zjudancer_dynamic")
    memory["base_velocity"] = np.array([0.2, 0, 0, 0, 0, 0])
    position = robot_of("zjudancer_dynamic").initial
    good = make_inputs(position)
    is_second = np.arange(len(good[name])) == 1
    bad = {**good, name: np.where(is_second, np.nan, good[name])}
    before = sample(block, memory, good, good)
    velocity = before["base_velocity"][:3]

    after = sample(block, before, bad)
    next_one = sample(block, after, make_inputs(position + 0.05))
    later = sample(block, after, *[good] * 200)

    moved = after["base_pose"] - before["base_pose"]
    assert moved == pytest.approx([*(PERIOD * velocity), 0, 0, 0, 0], abs=1e-15)
    assert (after["base_velocity"] == before["base_velocity"]).all()
    # The posture has changed while the sample was skipped: the feet seem to move, but do not count.
    expected = velocity - PERIOD * before["bias"]
    assert next_one["base_velocity"][:3] == pytest.approx(expected, abs=1e-12)
    assert all(np.isfinite(values).all() for values in later.values())
    assert np.abs(later["base_velocity"][:3]).max() < 0.01


NOISY = {
    "imu": {
        "gyroscope_noise": 0.02,
        "gyroscope_bias": 0.005,
        "accelerometer_noise": 0.1,
        "accelerometer_bias": 0.05,
    },
    "encoders": {"resolution_deg": 0.088, "noise_deg": 0.02},
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "plan", "duration", "least_distance"),
    [("zjudancer", walk, 2.5, 0.1), ("yobotics", trot, 2.0, 0.4)],
)
def test_it_follows_a_walk(robot, plan, duration, least_distance):
    """The estimate is a sample late. The bounds are a third above the measured errors, which the pages list."""
    motion = plan(robot, 6)
    sensors = {"true": {"kind": "frame", "frame": motion.model.root}}
    for name, errors in {"good": {kind: {} for kind in NOISY}, "worn": NOISY}.items():
        reads = {kind: f"{name}_{kind}" for kind in NOISY}
        sensors |= {name: {"kind": "leg_odometry", "reads": reads}}
        sensors |= {reads[kind]: {"kind": kind, **errors[kind]} for kind in NOISY}
    config = motion.station({"sensors": sensors, "sample_rate": 200, "duration": duration})

    result = simulate(config, reference=motion.trajectory(), progress=False)

    places = columns(result, "base.", "xyz")
    velocities = columns(result, "frame.true.v", "xyz")
    orientations = columns(result, "base.q", "wxyz")
    distance = np.linalg.norm(places[-1, :2] - places[0, :2])
    assert distance > least_distance
    for name, largest_error in (("good", 0.009), ("worn", 0.011)):
        place_errors = columns(result, f"base_pose.{name}.", "xyz")[1:] - places[:-1]
        assert np.linalg.norm(place_errors[-1, :2]) < 0.02 * distance
        assert np.abs(place_errors[:, 2]).max() < 0.005
        errors = columns(result, f"base_velocity.{name}.v", "xyz")[1:] - velocities[:-1]
        assert np.sqrt((errors**2).sum(axis=1).mean()) < largest_error
        estimated = columns(result, f"base_pose.{name}.q", "wxyz")
        assert estimated[1:] == pytest.approx(orientations[:-1], abs=1e-12)


def columns(result, start, ends):
    """Columns of a result whose names have a common start, shape (m, k)."""
    return np.column_stack([result[f"{start}{end}"] for end in ends])


STANDING = {
    "solver": {"kind": "discrete", "time_step": 1e-3},
    "sensors": {
        "odometry": {
            "kind": "leg_odometry",
            "reads": {"right_foot": "right", "left_foot": "left"},
            "delay": 0.005,
        },
        "right": {"kind": "force", "body": "right_foot"},
        "left": {"kind": "force", "body": "left_foot"},
        **{name: {**errors, "delay": 0.01} for name, errors in NOISY.items()},
    },
    "forces": {"push": {"start": 0, "duration": 0.05, "force": [0, 20, 0]}},
    "sample_rate": 200,
}
GUARD = {
    "kind": "fall_guard",
    "height": 0.2,
    "posture_deg": {"left_elbow": 30},
    "reads": {"base_pose": "odometry"},
}


def count_estimators():
    """Count the blocks of this sensor that are in memory."""
    gc.collect()
    return sum(issubclass(type(each), BaseEstimator) for each in gc.get_objects())


@pytest.mark.long
def test_values_in_a_loop_are_those_of_a_replay_and_a_run_continues_them():
    """Two halves of a run are equal to the whole run to the last bit."""
    before = count_estimators()
    config = load_station("zjudancer_dynamic", {**STANDING, "controllers": {"guard": GUARD}})
    whole = simulate(config, duration=0.2, progress=False)
    first = simulate(config, duration=0.1, progress=False)
    rest = load_station(
        "zjudancer_dynamic", {**STANDING, "controllers": {"guard": GUARD}, "forces": {}}
    )
    second = simulate(rest, duration=0.1, start=first.final_state, progress=False)
    replayed = simulate(load_station("zjudancer_dynamic", STANDING), duration=0.2, progress=False)

    for name in second.names:
        np.testing.assert_array_equal(second[name][1:], whole[name][21:])
    for name in (name for name in whole.names if ".odometry." in name):
        assert np.ptp(whole[name]) > 0
        np.testing.assert_allclose(replayed[name][:-1], whole[name][1:], atol=1e-9, rtol=0)
    # The blocks are released with their runs.
    del whole, first, second, replayed
    assert count_estimators() == before


def test_a_sensor_that_is_replayed_takes_each_sample_once(monkeypatch):
    """The odometry reads samples of the IMU, and the result has them as columns: both use the same replay."""
    samples = []
    take_sample = InertialUnit.sample

    def count_and_sample(*arguments):
        samples.append(arguments)
        return take_sample(*arguments)

    monkeypatch.setattr(InertialUnit, "sample", count_and_sample)

    result = simulate(load_station("zjudancer_dynamic", STANDING), duration=0.1, progress=False)

    assert len(samples) == 21
    assert np.ptp(result["base_pose.odometry.x"]) > 0


@pytest.mark.parametrize("robot", ["zjudancer", "roid1", "humanoid", "yobotics"])
def test_a_walk_with_the_sensors_of_the_example_reads_them_alone(robot):
    """The walk depends on the measurements: it differs a little from the one that reads the true state."""
    sensors = read_yaml(Path(__file__).parents[2] / "examples" / "loops" / "on_sensors.yaml")

    true = simulate(load_station(f"{robot}_walking"), duration=0.1, progress=False)
    measured = simulate(load_station(f"{robot}_walking", sensors), duration=0.1, progress=False)

    assert {name for name in measured.names if ".odometry." in name}
    assert not measured["walk.blind"].any()
    names = [name for name in true.names if name.startswith(("walk.capture", "walk.target"))]
    differences = [np.abs(measured[name] - true[name]).max() for name in names]
    assert 1e-6 < max(differences) < 0.1


def test_on_a_slope_the_height_is_not_held_and_the_block_picture_shows_the_sensor():
    """Only level ground is the plane z = 0."""
    slope = {
        "sensors": {"imu": {}, "encoders": {}, "leg_odometry": {"in_loop": True}},
        "floor.incline_deg": 3,
    }
    station = closed_station(resolve(load_station("zjudancer_dynamic", slope)))

    assert not station.diagram.GetSubsystemByName("sensor.leg_odometry").level
    assert "Leg odometry" in station_dot(load_station("zjudancer_dynamic", slope))


OWN = {"imu": {}, "encoders": {}}
LEFT = {"left": {"kind": "force", "body": "left_foot"}}


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        (
            {"encoders": {}, "leg_odometry": {}},
            "leg_odometry.reads.imu: there is no sensor of kind imu",
        ),
        (
            {**OWN, "leg_odometry": {"reads": {"imu": "imuu"}}},
            "reads.imu 'imuu'; did you mean 'imu'",
        ),
        (
            {**OWN, "leg_odometry": {"reads": {"imuu": "imu"}}},
            "input for .*'imuu'; did you mean 'imu'",
        ),
        (
            {**OWN, "leg_odometry": {"reads": {"imu": "leg_odometry"}}},
            "sensor of kind imu .*known: imu",
        ),
        (
            {**OWN, "second": {"kind": "imu"}, "leg_odometry": {}},
            "reads.imu is None.*one of imu, second",
        ),
        (
            {**OWN, **LEFT, "leg_odometry": {"reads": {"left_foot": "left"}}},
            "name force sensors for all feet, or for none",
        ),
        (
            {**OWN, "leg_odometry": {"rate": 100}},
            "rate is 100 Hz; it must be 200 Hz, the rate of sensors.imu",
        ),
        (
            {**OWN, "imu": {"frame": "head"}, "leg_odometry": {}},
            "sensors.imu.frame is head; it must be chest",
        ),
        ({**OWN, "leg_odometry": {"slip": 0}}, "slip.*greater than 0"),
    ],
)
def test_an_invalid_section_is_refused_with_its_cause(sensors, message):
    with pytest.raises(SimrobError, match=message):
        load_station("zjudancer_dynamic", {"sensors": sensors})


def test_a_robot_that_does_not_stand_on_feet_is_refused():
    with pytest.raises(SimrobError, match="robot has no feet, or its base is fixed"):
        load_station("irb120_dynamic", {"sensors": {**OWN, "leg_odometry": {}}})


def test_a_loop_of_another_station_comes_with_the_sensors_of_its_sensors(tmp_path, monkeypatch):
    """The page of a robot offers the loops of other stations with this robot, each with all that it reads."""
    text = (feedback_loops.diagrams_root() / "zjudancer_dynamic.yaml").read_text()
    parts = {
        "sensors": {
            "imu": {},
            "encoders": {},
            "other": {"kind": "distance", "body": "chest"},
            "odometry": {"kind": "leg_odometry"},
        }
    }
    parts["controllers"] = {"guard": GUARD}
    (tmp_path / "lent.yaml").write_text(f"{text}\n{yaml.safe_dump(parts)}")
    station = load_station("zjudancer_dynamic")
    monkeypatch.setattr(feedback_loops, "diagrams_root", lambda: tmp_path)

    known = feedback_loops.loops_known(station)
    assert set(known["guard"]) == {
        "controllers.guard",
        "sensors.odometry",
        "sensors.imu",
        "sensors.encoders",
    }
