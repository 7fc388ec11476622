"""Environments: Gymnasium's checker, what a seed settles, and that an episode is a run of the station."""

import warnings

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from simrob_drake.base.files import models_root  # noqa: E402
from simrob_drake.extensions.learning import ENVIRONMENTS  # noqa: E402
from simrob_drake.extensions.learning.environment import StationEnvironment  # noqa: E402
from simrob_drake.extensions.learning.episode import Episode  # noqa: E402
from simrob_drake.extensions.learning.policy import Network  # noqa: E402
from simrob_drake.extensions.learning.task import beginning, load_task  # noqa: E402
from simrob_drake.extensions.learning.writing import write_network  # noqa: E402

SPAWN = {"context": "spawn"}  # a fork of a process with threads may hang
NOTHING = {"kind": "sine", "amplitude": [0, 0, 0], "frequency": 1}
WALKERS = ["yobotics_dynamic", "zjudancer_dynamic", "roid1_dynamic", "humanoid_dynamic"]


def made(name, **kwargs):
    return gymnasium.make(f"simrob/{name}-v0", **kwargs).unwrapped


def played(env, seed, steps=5):
    """Return what an episode with actions from a seed of their own shows: observations and rewards."""
    actions = np.random.default_rng(5).uniform(-0.3, 0.3, size=(steps, *env.action_space.shape))
    seen, rewards = [env.reset(seed=seed)[0]], []
    for action in actions:
        observation, reward, *_ = env.step(action.astype(np.float32))
        seen.append(observation)
        rewards.append(reward)
    return np.array(seen), np.array(rewards)


@pytest.mark.long
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_accepts_the_environments(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        check_env(made(name))


@pytest.mark.parametrize("station", WALKERS)
def test_every_robot_on_legs_can_learn_to_walk(station):
    env = made("Walk", station=station)
    axes = len(env.episode.robot.axes)
    assert env.action_space.shape == (axes,)
    assert env.observation_space.shape == (3 + 3 + 3 * axes + 2,)
    seen, rewards = played(env, 1)
    assert np.isfinite(seen).all()
    assert np.isfinite(rewards).all()


def test_an_engine_is_chosen_by_name():
    pytest.importorskip("simrob_drake.extensions.mujoco")
    env = made("HandGuide", engine="mujoco")
    assert env.config.solver.kind == "mujoco"
    first, drake = played(env, 7), played(made("HandGuide"), 7)
    np.testing.assert_array_equal(first[0], played(env, 7)[0])
    np.testing.assert_allclose(first[0][0], drake[0][0], atol=1e-6)  # they begin alike
    assert np.abs(np.subtract(first[0], drake[0])).max() > 1e-4


def test_a_seed_settles_an_episode_whatever_went_before():
    first = played(made("Balance"), 7)
    env = made("Balance")
    played(env, 3, steps=9)
    again, other = played(env, 7), played(env, 8)
    for one, same, different in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(one, same)
        assert not np.array_equal(one, different)


@pytest.mark.long
def test_environments_run_side_by_side_on_processes():
    alone = [played(made("Walk"), seed) for seed in (4, 5)]
    envs = gymnasium.make_vec(
        "simrob/Walk-v0", num_envs=2, vectorization_mode="async", vector_kwargs=SPAWN
    )
    try:
        actions = np.random.default_rng(5).uniform(
            -0.3, 0.3, size=(5, *envs.single_action_space.shape)
        )
        seen, _ = envs.reset(seed=[4, 5])
        np.testing.assert_array_equal(seen, [observations[0] for observations, _ in alone])
        for step, action in enumerate(actions.astype(np.float32)):
            seen, rewards, *_ = envs.step(np.array([action, action]))
            np.testing.assert_array_equal(
                seen, [observations[step + 1] for observations, _ in alone]
            )
            np.testing.assert_allclose(rewards, [given[step] for _, given in alone], rtol=1e-12)
    finally:
        envs.close()


@pytest.mark.parametrize(
    ("task", "changed"),
    [
        ("walk", {}),
        ("walk", {"solver": {"kind": "mujoco"}}),
        ("balance", {"forces.push.start": 0.05, "forces.none": NOTHING}),
        ("hand_guide", {}),
    ],
)
def test_an_episode_is_a_run_of_the_station(task, changed, tmp_path):
    """The policy of the station's file, and one that is asked from outside, see and do the same to rounding.

    Where only pushes act a run under cenic leaves them out of its diagram until one begins, which changes its steps.
    """
    if "mujoco" in str(changed):
        pytest.importorskip("simrob_drake.extensions.mujoco")
    config = load_task(task)[0].config(None, changed, task)
    episode = Episode(config)
    draw, policy = np.random.default_rng(2), episode.policy
    weights = 0.01 * draw.normal(size=(policy.acts, policy.observed))
    file = write_network(tmp_path / "net.onnx", [(weights, 0.1 * draw.normal(size=policy.acts))])
    network, period = Network(file, "here"), episode.period
    seen, positions = episode.begin(), []
    for _ in range(round(0.4 / period)):
        seen = episode.advance(network(seen))
        positions.append(episode.moment(goal=np.zeros(3)).tool)
    name = next(
        iter(key for key, section in config.controllers.items() if section.kind == "policy")
    )
    overrides = load_task(task)[0].overrides
    own = load_station(
        load_task(task)[0].station,
        {
            **overrides,
            **changed,
            f"controllers.{name}.network": str(file),
            "sample_rate": 1 / period,
        },
    )
    result = simulate(own, duration=0.4, progress=False)
    pose = result.pose("base" if episode.robot.floats else "tcp")[1:, :3]
    assert np.ptp(pose, axis=0).max() > 1e-3
    np.testing.assert_allclose(positions, pose, rtol=0, atol=1e-15)


def test_what_is_true_is_seen_from_where_the_robot_faces():
    """zjudancer faces the world's y: pushed backward it goes back, and its height falls as it tips over."""
    env = made(
        "Walk",
        station="zjudancer_dynamic",
        overrides={"forces.shove": {"kind": "push", "force": [0, -60, 0]}},
    )
    env.reset(seed=1)
    ended, steps = False, 0
    while not ended and steps < 100:
        _, reward, ended, _, info = env.step(np.zeros(env.action_space.shape))
        steps += 1
    assert ended
    assert "fell" in info["ended"]
    assert info["place"][0] < -0.1
    assert abs(info["place"][1]) < 0.1
    assert info["place"][2] < -0.05
    assert reward == pytest.approx(sum(info["rewards"].values()))
    assert info["rewards"]["ended"] == -10


def test_an_episode_that_nothing_ends_is_cut_off_at_its_duration():
    env = made("HandGuide")
    env.reset(seed=1)
    steps, truncated = 0, False
    while not truncated:
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        assert not terminated
        steps += 1
    assert steps == round(env.task.duration / env.episode.period)
    assert info["time"] == pytest.approx(env.task.duration)


def test_goals_and_pushes_differ_by_the_seed_and_stay_within_their_bounds():
    reach, guide = made("Reach"), made("HandGuide")
    goals = np.array([reach.reset(seed=seed)[0][-3:] for seed in range(6)])
    assert (goals >= np.array(reach.task.goals.low) - 1e-6).all()
    assert (goals <= np.array(reach.task.goals.high) + 1e-6).all()
    assert np.ptp(goals, axis=0).min() > 0.01
    robot, period = guide.episode.robot, guide.episode.period
    for seed in range(3):
        draw = np.random.default_rng(seed)
        push = beginning(
            guide.task, draw, robot=robot, forces=guide.config.forces, period=period
        ).pushes["hand"]
        assert 2 <= np.linalg.norm(push.force) <= 8
        assert push.start / period == pytest.approx(round(push.start / period))


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"task": "wlak"}, "there is no task 'wlak'; did you mean 'walk'"),
        ({"station": "yobotics_dynamc"}, "yobotics_dynamic"),
        ({"engine": "mujoko"}, "there is no engine 'mujoko'; did you mean 'mujoco'"),
        (
            {"overrides": {"controllers.policy": None}},
            "hold 0 controllers of kind policy; it must be one",
        ),
        ({"task": "balance", "overrides": {"forces.push": None}}, "pushes.name"),
        (
            {"task": "reach", "overrides": {"controllers.policy.observes": ["positon", "goal"]}},
            "mean 'position'",
        ),
    ],
)
def test_bad_input_gets_one_line(kwargs, told):
    with pytest.raises(SimrobError, match=told) as refused:
        StationEnvironment(**kwargs)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ("goals: {low: [0], high: [1]}", "a box of 1 figures; the policy's goal has 0"),
        ("goals: {low: [2], high: [1]}", "low is nowhere above high"),
        ("rewards: {distance: -1}", "needs a goal of the policy of x y z, not of 0"),
        ("rewards: {heading: 1}", "ahead and to the left and a rate to the left, not of 0"),
    ],
)
def test_goals_that_do_not_fit_are_refused(changed, told, tmp_path):
    text = (models_root() / "tasks" / "walk.yaml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith(changed.partition(":")[0])]
    file = tmp_path / "task.yaml"
    file.write_text("\n".join([*kept, changed]))
    with pytest.raises(SimrobError, match=told):
        StationEnvironment(file)


def test_a_task_with_an_unknown_term_names_the_nearest(tmp_path):
    file = tmp_path / "task.yaml"
    file.write_text("station: yobotics_dynamic\nrewards: {ahaed: 1}\n")
    with pytest.raises(SimrobError, match="did you mean 'ahead'"):
        load_task(file)
