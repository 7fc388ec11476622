"""Leg odometry: against its equations on numbers, closed forms, and walks whose true motion is known."""

import gc
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.parts.sensors.frames import InertialUnit
from simrob_drake.parts.sensors.leg_odometry import BaseEstimator, LegOdometry, Soles
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.quadruped import trot
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.stations import feedback_loops
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

PERIOD, GRAVITY = 0.005, np.array([0.0, 0.0, -9.80665])
NAMES = "base_pose", "base_velocity", "bias", "lowest", "places", "shares"


@cache
def closed(station):
    return closed_station(resolve(load_station(station)))


def robot_of(station):
    return closed(station).ports.robot(None)


def estimator(station, **changes):
    """Return a block of a station's robot, and what it remembers at the start: at the origin, upright, at rest."""
    robot = robot_of(station)
    soles, start = Soles(robot), np.array([0.0, 0, 0, 1, 0, 0, 0])
    section = LegOdometry.model_validate({"kind": "leg_odometry", "rate": 1 / PERIOD})
    block = BaseEstimator(section, soles, start=start, **changes)
    sizes = dict(
        zip(
            NAMES, (7, 6, 3, 4 * len(soles.arms), 3 * len(soles.arms), len(soles.arms)), strict=True
        )
    )
    return block, {name: np.zeros(size) for name, size in sizes.items()} | {"base_pose": start}


def looked(block, memory, *reads):
    """Return what a block remembers after samples."""
    for read in reads:
        memory = {**memory, **block.sample(memory, read)}
    return memory


def seen(position, turn=None, force=None, rates=(0.1, 0.2, 0.3), **feet):
    """Return what the sensors tell of a robot at rest in an orientation, or what a ``force`` more in it tells."""
    turn = RotationMatrix() if turn is None else turn
    force = np.zeros(3) if force is None else np.array(force)
    quaternion = turn.ToQuaternion().wxyz()
    felt = turn.matrix().T @ (force - GRAVITY)
    return {
        "position": position,
        "orientation": quaternion,
        "angular_velocity": np.array(rates),
        "specific_force": felt,
        **{foot: np.array([0.0, 0.0, each]) for foot, each in feet.items()},
    }


def bottoms(robot, position, turn):
    """Return the middles of the spheres of all feet under a root link at the origin, by Drake, and the feet's turns."""
    plant, context = robot.plant, robot.plant.CreateDefaultContext()
    body = robot.root.body()
    robot.axis_map.set_positions(plant, context, position)
    places = plant.GetPositions(context)
    start = body.floating_positions_start()
    places[start : start + 7] = [*turn.ToQuaternion().wxyz(), 0, 0, 0]
    plant.SetPositions(context, places)
    found, turns = [], []
    for link, points in robot.feet.points.items():
        frame = plant.GetFrameByName(link, robot.instance)
        found += plant.CalcPointsPositions(
            context, frame, np.array(points).T, plant.world_frame()
        ).T.tolist()
        turns += [frame.CalcPoseInWorld(context).rotation().matrix()] * len(points)
    return np.array(found), np.array(turns)


@pytest.mark.parametrize(
    ("station", "forces"), [("zjudancer_dynamic", None), ("yobotics_dynamic", [10.0, 30, 40, 5])]
)
def test_a_step_is_that_of_its_equations(station, forces):
    robot, rng, slip, follows = robot_of(station), np.random.default_rng(1), 0.07, 0.1
    links, radius = robot.feet.links, robot.feet.radius
    told = (
        [{}, {}]
        if forces is None
        else [dict(zip(links, np.array(forces) * part, strict=True)) for part in (1, 0.8)]
    )
    block, memory = estimator(station, level=True, force=None if forces is None else 20.0)
    turns = [RotationMatrix(AngleAxis(angle, np.array([0.6, 0.0, 0.8]))) for angle in (0.1, 0.11)]
    positions = [robot.initial, robot.initial + 0.01 * rng.standard_normal(len(robot.axes))]
    first = looked(block, memory, seen(positions[0], turns[0], **told[0]))
    first["bias"] = np.array([0.03, 0.02, -0.01])
    first["base_velocity"] = np.array([0.1, -0.05, 0.02, 0, 0, 0])
    first["base_pose"] = np.concatenate([[1.0, 2.0, 0.3], turns[0].ToQuaternion().wxyz()])
    second = looked(block, first, seen(positions[1], turns[1], force=[1.0, 2.0, 3.0], **told[1]))

    middles, feet = zip(
        *(bottoms(robot, *each) for each in zip(positions, turns, strict=True)), strict=True
    )
    halfway = RotationMatrix(AngleAxis(0.105, np.array([0.6, 0.0, 0.8]))).matrix()
    acceleration = (
        halfway @ (turns[1].matrix().T @ ([1.0, 2.0, 3.0] - GRAVITY) - [0.03, 0.02, -0.01])
        + GRAVITY
    )
    speed = np.array([0.1, -0.05, 0.02]) + PERIOD * acceleration
    step = PERIOD * np.array([0.1, -0.05, 0.02]) + PERIOD**2 / 2 * acceleration
    owners = np.repeat(range(len(links)), [len(robot.feet.points[link]) for link in links])
    errors, weights = [], []
    for number, owner in enumerate(owners):
        weight, down = 1.0, np.array([0.0, 0.0, radius])
        for when in (0, 1):
            rivals = middles[when][:, 2] if forces is None else middles[when][owners == owner, 2]
            weight *= np.exp((rivals.min() - middles[when][number, 2]) / 0.003)
            weight *= 1.0 if forces is None else min(told[when][links[owner]] / 20.0, 1.0)
        # what was the ball's lowest is there now
        rolled = feet[1][number] @ feet[0][number].T @ down
        error = (middles[0][number] - down) - (middles[1][number] - rolled) - step
        errors.append(error)
        weights.append(weight / (1 + error @ error / (slip * PERIOD) ** 2))
    total = sum(weights)
    trust, error = min(total, 1.0), np.array(weights) @ np.array(errors) / total
    place = np.array([1.0, 2.0, 0.3]) + step + trust * error
    lowest = np.array(weights) @ (middles[1][:, 2] - radius) / total
    place[2] += trust * (1 - np.exp(-PERIOD)) * (0.0 - lowest - place[2])
    gain = trust * (1 - np.exp(-PERIOD / follows)) / PERIOD
    speed, bias = speed + gain * error, [0.03, 0.02, -0.01] - gain / 1.0 * halfway.T @ error
    assert second["bias"] == pytest.approx(bias, abs=1e-12)
    assert second["base_pose"] == pytest.approx(
        [*place, *turns[1].ToQuaternion().wxyz()], abs=1e-12
    )
    assert second["base_velocity"] == pytest.approx(
        [*speed, *(turns[1].matrix() @ [0.1, 0.2, 0.3])], abs=1e-10
    )
    assert trust > 0.01  # the feet took part


def test_in_the_air_it_sums_up_the_accelerometer():
    block, memory = estimator("zjudancer_dynamic", force=10.0)
    read = seen(
        robot_of("zjudancer_dynamic").initial, force=[1.0, 0.0, -2.0], right_foot=0.0, left_foot=0.0
    )
    memory = looked(block, memory, *[read] * 100)
    assert memory["base_velocity"][:3] == pytest.approx([0.5, 0, -1], abs=1e-12)
    assert memory["base_pose"][:3] == pytest.approx([0.125, 0, -0.25], abs=1e-12)


def test_feet_that_stand_stop_it_and_take_its_bias_away():
    """Meanwhile the position goes by what the feet cannot tell: less than a millimetre."""
    block, memory = estimator("zjudancer_dynamic")
    memory["base_velocity"] = np.array([0.03, 0, 0, 0, 0, 0])
    position = robot_of("zjudancer_dynamic").initial
    memory = looked(block, memory, *[seen(position, force=[0.0, 0.1, -0.2])] * 1600)
    assert memory["bias"] == pytest.approx([0, 0.1, -0.2], abs=2e-3)
    assert memory["base_velocity"][:3] == pytest.approx(np.zeros(3), abs=2e-4)
    assert np.abs(memory["base_pose"][:3]).max() < 1e-3


def test_what_is_not_finite_is_skipped():
    block, memory = estimator("zjudancer_dynamic")
    memory["base_velocity"] = np.array([0.2, 0, 0, 0, 0, 0])
    good = seen(robot_of("zjudancer_dynamic").initial)
    before = looked(block, memory, good, good)
    for name in good:
        bad = {**good, name: np.where(np.arange(len(good[name])) == 1, np.nan, good[name])}
        after = looked(block, before, bad)
        way = after["base_pose"] - before["base_pose"]
        assert way == pytest.approx(
            [*(PERIOD * before["base_velocity"][:3]), 0, 0, 0, 0], abs=1e-15
        )
        assert (after["base_velocity"] == before["base_velocity"]).all()
        # and the feet meanwhile
        moved = looked(block, after, seen(robot_of("zjudancer_dynamic").initial + 0.05))
        expected = before["base_velocity"][:3] - PERIOD * before["bias"]
        assert moved["base_velocity"][:3] == pytest.approx(expected, abs=1e-12)
        later = looked(block, after, *[good] * 200)
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
PLANS = {"zjudancer": (walk, 2.5, 0.1), "yobotics": (trot, 2.0, 0.4)}
"""Who goes how long [s], and how far at least [m]."""


@pytest.mark.long
@pytest.mark.parametrize("robot", PLANS)
def test_it_follows_a_walk(robot):
    """What it tells is a sample late. Bounds are a third above what was measured: they keep what the tables say."""
    planner, duration, least = PLANS[robot]
    motion = planner(robot, 6)
    sensors = {"true": {"kind": "frame", "frame": motion.model.root}}
    for name, errors in {"good": {kind: {} for kind in NOISY}, "worn": NOISY}.items():
        reads = {kind: f"{name}_{kind}" for kind in NOISY}
        sensors |= {name: {"kind": "leg_odometry", "reads": reads}}
        sensors |= {reads[kind]: {"kind": kind, **errors[kind]} for kind in NOISY}
    config = motion.station({"sensors": sensors, "sample_rate": 200, "duration": duration})
    result = simulate(config, reference=motion.trajectory(), progress=False)
    place, speed = (columns(result, each, "xyz") for each in ("base.", "frame.true.v"))
    way = np.linalg.norm(place[-1, :2] - place[0, :2])
    assert way > least
    for name, largest in (("good", 0.009), ("worn", 0.011)):
        off = columns(result, f"base_pose.{name}.", "xyz")[1:] - place[:-1]
        assert np.linalg.norm(off[-1, :2]) < 0.02 * way
        assert np.abs(off[:, 2]).max() < 0.005
        errors = columns(result, f"base_velocity.{name}.v", "xyz")[1:] - speed[:-1]
        assert np.sqrt((errors**2).sum(axis=1).mean()) < largest
        turned = columns(result, f"base_pose.{name}.q", "wxyz")
        assert turned[1:] == pytest.approx(columns(result, "base.q", "wxyz")[:-1], abs=1e-12)


def columns(result, start, ends):
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


def alive():
    gc.collect()
    return sum(issubclass(type(each), BaseEstimator) for each in gc.get_objects())


@pytest.mark.long
def test_a_loop_reads_it_and_a_run_goes_on_with_it():
    """While stepping it tells the same as after the run, and the halves of a run are the whole, to the last bit."""
    before = alive()
    config = load_station("zjudancer_dynamic", {**STANDING, "controllers": {"guard": GUARD}})
    whole = simulate(config, duration=0.2, progress=False)
    first = simulate(config, duration=0.1, progress=False)
    rest = load_station(
        "zjudancer_dynamic", {**STANDING, "controllers": {"guard": GUARD}, "forces": {}}
    )
    second = simulate(rest, duration=0.1, start=first.final_state, progress=False)
    for name in second.names:
        np.testing.assert_array_equal(second[name][1:], whole[name][21:])
    later = simulate(load_station("zjudancer_dynamic", STANDING), duration=0.2, progress=False)
    for name in (name for name in whole.names if ".odometry." in name):
        assert np.ptp(whole[name]) > 0
        np.testing.assert_allclose(later[name][:-1], whole[name][1:], atol=1e-9, rtol=0)
    del whole, first, second, later
    assert alive() == before  # it goes with its run


def test_sensors_that_nothing_reads_go_through_a_run_once(monkeypatch):
    """The odometry asks for what the IMU told a sample ago, the table for what it tells: both of the same samples."""
    seen, sample = [], InertialUnit.sample
    monkeypatch.setattr(InertialUnit, "sample", lambda *given: seen.append(given) or sample(*given))
    result = simulate(load_station("zjudancer_dynamic", STANDING), duration=0.1, progress=False)
    assert len(seen) == 21
    assert np.ptp(result["base_pose.odometry.x"]) > 0


@pytest.mark.parametrize("robot", ["zjudancer", "roid1", "humanoid", "yobotics"])
def test_a_walk_goes_on_the_sensors_of_the_example_alone(robot):
    """What it has the robot do comes of what they tell: not quite of the true state."""
    told = read_yaml(Path(__file__).parents[2] / "examples" / "loops" / "on_sensors.yaml")
    ends = [
        simulate(load_station(f"{robot}_walking", changes), duration=0.1, progress=False)
        for changes in ({}, told)
    ]
    assert {name for name in ends[1].names if ".odometry." in name}
    assert not ends[1]["walk.blind"].any()
    asked = [name for name in ends[0].names if name.startswith(("walk.capture", "walk.target"))]
    assert 1e-6 < max(np.abs(ends[1][name] - ends[0][name]).max() for name in asked) < 0.1


def test_it_stands_in_the_picture_of_a_station_on_a_slope():
    """On a slope the height is not held: only level ground lies at z = 0."""
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
    ("sensors", "told"),
    [
        ({"encoders": {}, "leg_odometry": {}}, "leg_odometry.reads.imu: there is no sensor of kind imu"),
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
def test_what_cannot_be_is_told(sensors, told):
    with pytest.raises(SimrobError, match=told):
        load_station("zjudancer_dynamic", {"sensors": sensors})


def test_a_robot_without_feet_of_its_own_is_refused():
    with pytest.raises(SimrobError, match="robot has no feet, or its base is fixed"):
        load_station("irb120_dynamic", {"sensors": {**OWN, "leg_odometry": {}}})


def test_a_loop_that_is_lent_brings_the_sensors_of_its_sensors(tmp_path, monkeypatch):
    """The page of a robot offers the loops of other stations of it, each with what it reads."""
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
