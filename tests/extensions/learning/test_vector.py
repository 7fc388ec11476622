"""Many robots at once in MuJoCo: as one at a time in Drake, each by itself, and all from seeds."""

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("simrob_drake.extensions.mujoco")
gymnasium = pytest.importorskip("gymnasium")

import simrob_drake.extensions.learning  # noqa: E402, F401  # registers the environments
from simrob_drake.base.errors import SimrobError  # noqa: E402
from simrob_drake.extensions.learning.vector import StationVectorEnvironment  # noqa: E402

EXACT = {f"sensors.encoders.{key}": 0 for key in ("noise_deg", "resolution_deg")}
STILL = {**EXACT, "sensors.imu.gyroscope_noise": 0, "sensors.imu.gyroscope_bias": 0}
LEANS = {
    "observes": ["lean", "heading_error", "angular_velocity", "position", "velocity", "goal"],
    "goal": [0, 0, 1],
}
ON_MOTORS = {
    **STILL,
    **{f"controllers.policy.{key}": own for key, own in LEANS.items()},
    "servo.motor": "urdf",
}
ON_MOTORS |= {"controllers.policy.clock": []}


def many(name, count, **options):
    kind = {"vectorization_mode": "vector_entry_point"}
    return gymnasium.make_vec(f"simrob/{name}-v0", num_envs=count, **kind, **options)


def actions(size, steps, scale, seed=0):
    """Yield actions that stay for ten steps each."""
    draw = np.random.default_rng(seed)
    for step in range(steps):
        if step % 10 == 0:
            action = draw.uniform(-scale, scale, size)
        yield action


WALKS = [pytest.param("Walk", STILL, 0.1, marks=pytest.mark.long), ("Walk", ON_MOTORS, 0.1)]


@pytest.mark.long
@pytest.mark.parametrize(("name", "overrides", "scale"), [("Reach", EXACT, 0.3), *WALKS])
def test_a_robot_moves_and_sees_as_in_drake(name, overrides, scale):
    """Drake at 0.5 ms and MuJoCo at its 2 ms: 0.31° and 0.18° in the root of the mean square; sensors 10 ms apart."""
    fine = {**overrides, "solver": {"kind": "discrete", "time_step": 5e-4}}
    one = gymnasium.make(f"simrob/{name}-v0", overrides=fine).unwrapped
    both = many(name, 2, overrides=overrides)
    for each in (one, both):
        each.task = each.task.model_copy(update={"noise_deg": 0, "goals": None})
    seen, _ = one.reset(seed=1)
    told, _ = both.reset(seed=1)
    np.testing.assert_allclose(told, np.tile(seen, (2, 1)), atol=1e-6)
    axes, rows, earned = len(one.episode.robot.axes), [], np.zeros(2)
    sizes = {
        "position": axes,
        "velocity": axes,
        "attitude": 3,
        "lean": 2,
        "heading_error": 1,
        "angular_velocity": 3,
    }
    # what follows them is known
    parts = [part for part in one.episode.section.observes if part in sizes]
    ends = np.cumsum([sizes[part] for part in parts])
    for action in actions(one.action_space.shape, 40, scale):
        seen, reward, *_ = one.step(action)
        told, rewards, *_ = both.step(np.tile(action, (2, 1)))
        np.testing.assert_array_equal(told[0], told[1])  # each steps by itself, alike
        rows.append((seen, told[0]))
        earned += reward, rewards[0]
    each = zip(parts, np.split(np.array(rows)[:, :, : ends[-1]], ends[:-1], axis=2), strict=True)
    for part, (in_drake, in_mujoco) in ((part, np.moveaxis(values, 1, 0)) for part, values in each):
        error, size = (
            np.sqrt(np.mean(np.square(values))) for values in (in_drake - in_mujoco, in_drake)
        )
        assert 0 < error < 0.4 * size, part
        assert part != "position" or np.rad2deg(error) < 0.5
    assert earned[1] == pytest.approx(earned[0], rel=0.1, abs=0.05)


def played(environment, seed, steps=12):
    environment.reset(seed=seed)
    draw = np.random.default_rng(3)
    return [
        environment.step(draw.uniform(-1, 1, environment.action_space.shape))[:2]
        for _ in range(steps)
    ]


def test_all_that_is_random_follows_from_the_seeds():
    environment = many("Balance", 3)
    first, again, other = (played(environment, seed) for seed in (5, 5, 6))
    for (seen, earned), (same, likewise), (different, _) in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(seen, same)
        np.testing.assert_array_equal(earned, likewise)
        assert np.abs(seen - different).max() > 1e-3
        assert np.abs(seen[0] - seen[1]).max() > 1e-3


def test_who_falls_begins_anew_and_the_others_go_on():
    environment = many("Balance", 2, overrides={"monitors.fall.tilt_deg": 20, "duration": 1.0})
    environment.reset(seed=1)
    asked = np.zeros(environment.action_space.shape)
    asked[0] = 1.0  # all axes to one side
    times, ends = [], []
    for _ in range(50):
        _, earned, terminated, truncated, info = environment.step(asked)
        times.append(info["time"].copy())
        ends.append((terminated.copy(), truncated.copy(), info["ended"].copy(), earned.copy()))
    fell = next(step for step, (terminated, *_) in enumerate(ends) if terminated[0])
    assert "fell" in ends[fell][2][0]
    assert ends[fell][3][0] < -5  # what the end costs
    assert times[fell + 1][0] == pytest.approx(0.02)
    np.testing.assert_allclose([time[1] for time in times], 0.02 * np.arange(1, 51))
    assert ends[-1][1][1]  # its time is over
    assert not any(terminated[1] for terminated, *_ in ends)


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        (
            "HandGuide",
            {},
            r"controllers\.policy\.observes is external_force\.hand; it must be of position, velocity",
        ),
        (
            "Reach",
            {"step": 0.003},
            r"step is 0\.003 s; it must be a part of a control period, 0\.05 s",
        ),
        ("Walk", {"threads": -1}, r"threads is -1; it must be"),
        (
            "Walk",
            {"station": "humanoid_dynamic"},
            r"step is 0\.002 s; it must be at most .* s, or servo\.kd smaller, .*: at its torque limit .* kd of 100",
        ),
        (
            "Walk",
            {"overrides": {"sensors.encoders.delay": 0.02}},
            r"sensors\.encoders\.delay is 0\.02; it must be 0",
        ),
    ],
)
def test_what_cannot_be_told_is_refused_by_name(name, options, told):
    with pytest.raises(SimrobError, match=told):
        many(name, 2, **options)


TASK = """
station: yobotics_dynamic
overrides:
  forces: {push: {kind: push, duration: 0.1, force: [0, 1, 0]}}
  controllers: {policy: {kind: policy, moves_deg: 20, observes: [position, velocity, goal], goal: [0.3, 0]}}
duration: 0.2
pushes: {name: push, force: [0, 10], start: [0, 0]}
rewards: {tracking: 1, effort: 0}
"""


def task(folder, more):
    file = folder / "task.yaml"
    file.write_text(f"{TASK}{more}\n")
    return file


@pytest.mark.long
def test_each_episode_is_in_a_station_that_was_drawn(tmp_path):
    keys = (
        "{robot.mass_factors.trunk: uniform:1:2, servo.kp: uniform:50:90, gravity: normal:9.8:0.01}"
    )
    robots = many("Walk", 6, task=task(tmp_path, f"random: {keys}"), variants=3).unwrapped
    robots.reset(seed=1)
    masses = {float(model.body_mass.sum()) for model in robots._models}
    assert len(masses) == 3
    assert max(masses) > min(masses) + 0.5
    assert {float(model.body_mass.sum()) for model in robots._own} <= masses
    seen, *_ = robots.step(np.zeros((6, 12)))
    assert len(np.unique(seen[:, 12], axis=0)) > 1
    one = gymnasium.make("simrob/Walk-v0", task=task(tmp_path, f"random: {keys}"))
    kps = [(one.reset(seed=seed), one.unwrapped.episode.robot.gains.kp[0])[1] for seed in (1, 2, 1)]
    assert kps[0] == kps[2] != kps[1]
    assert 50 <= min(kps) < max(kps) <= 90


def test_averaged_speeds_begin_anew_with_each_episode(tmp_path):
    """In both environments, by the pace of each moment: the eleventh step of a vector is the first of an episode."""
    file, over = task(tmp_path, "averaged: 0.1\nastray: 0.2"), 0.1
    robots, one = (
        many("Walk", 2, task=file).unwrapped,
        gymnasium.make("simrob/Walk-v0", task=file).unwrapped,
    )
    for environment, steps in ((robots, 13), (one, 10)):
        environment.reset(seed=1)
        mean, goal = np.zeros(2), np.array([0.3, 0.0])
        for step in range(steps):
            action = np.full(environment.action_space.shape, 0.5)
            *_, info = environment.step(action)
            if step == 9 and environment is robots:  # it has begun anew already
                mean = np.zeros(2)
                continue
            turn, speed = pace_of(environment)
            ahead = np.exp(-1j * turn) * complex(*speed)
            mean += (1 - np.exp(-0.02 / over)) * (np.array([ahead.real, ahead.imag]) - mean)
            expected = 0.02 * np.exp(-np.sum((mean - goal) ** 2) / 0.2**2)
            assert np.ravel(info["rewards"]["tracking"])[0] == pytest.approx(expected, rel=1e-6), (
                step
            )


def pace_of(environment):
    """Return how the first robot of an environment faces [rad] and its speed in the world's plane [m/s]."""
    if isinstance(environment, StationVectorEnvironment):
        pose, velocity = (
            environment._value(name, environment._motion)[0]
            for name in ("base_pose", "base_velocity")
        )
    else:
        pose, velocity = (
            environment.episode._value(name) for name in ("base_pose", "base_velocity")
        )
    w, x, y, z = pose[3:]
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), velocity[:2]


def now(robots):
    return robots._curriculum.of(robots.task)


def test_what_grows_goes_by_steps_or_by_returns(tmp_path):
    push, effort = (
        "{first: [0, 0], last: [0, 90], steps: 30}",
        "{first: 0, last: -2, returns: [0, 1]}",
    )
    file = task(tmp_path, f"grows: {{pushes.force: {push}, rewards.effort: {effort}}}")
    robots = many("Walk", 3, task=file).unwrapped
    robots.reset(seed=1)
    assert now(robots).pushes.force == (0, 0)
    for _ in range(10):  # all episodes end with the tenth step
        robots.step(np.zeros((3, 12)))
    assert now(robots).pushes.force == (0, 90)
    mean = np.mean(robots._curriculum._returns)
    assert 0 < mean < 1
    assert now(robots).rewards["effort"] == pytest.approx(-2 * mean)
    assert now(many("Walk", 1, task=file, grown=True).unwrapped).rewards["effort"] == -2


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            "random: {sensors.imu.delay: uniform:0:0.1}",
            r"random is sensors\.imu\.delay; it must be of contact, floor",
        ),
        (
            "random: {robot.base: {values: [[0, 0, 1, 0, 0, 0]]}}",
            r"random is robot\.base; it must be keys that leave joints",
        ),
        ("grows: {pushs.force: {first: 0, last: 1, steps: 9}}", r"'pushs'; did you mean 'pushes'"),
        (
            "grows: {pushes.force: {first: [0, 0], last: [9, 0], steps: 9}}",
            "force is from the least to the largest",
        ),
        (
            "grows: {rewards.effort: {first: 0, last: 1}}",
            "steps or with returns: one of them must be given",
        ),
        ("goals: {low: [0], high: [1]}", "a box of 1 figures"),
    ],
)
def test_a_task_that_cannot_be_is_refused_by_name(more, told, tmp_path):
    with pytest.raises(SimrobError, match=told) as refused:
        many("Walk", 2, task=task(tmp_path, more))
    assert "\n" not in str(refused.value)


def test_robots_are_seen_where_they_are():
    robots = many("Reach", 2, render_mode="rgb_array")
    robots.reset(seed=3)
    one, other = robots.render()
    assert one.shape == (360, 480, 3)
    assert one.dtype == np.uint8
    assert np.abs(one.astype(int) - other).max() > 100  # they begin in postures of their own
