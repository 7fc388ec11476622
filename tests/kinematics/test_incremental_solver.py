"""The damped Jacobian along paths: tracking, the rotation limit, half turns, singular postures."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.kinematics import IncrementalSolver, Unreachable, require
from simrob_drake.kinematics.incremental import _damped_steps


def _line(chain, start, way, count):
    path = np.repeat(chain.forward(start), count, axis=0)
    path[:, :3, 3] += np.linspace([0, 0, 0], way, count)
    return path


def test_straight_line(irb120_chain, home):
    path = _line(irb120_chain, home, [0.05, 0.2, -0.1], 100)
    solutions = IncrementalSolver(irb120_chain).solve(path, home)

    found = irb120_chain.forward(require(solutions))

    np.testing.assert_allclose(found, path, atol=1e-4)
    assert np.abs(np.diff(solutions.positions, axis=0)).max() < 0.02


def test_one_step_a_point_is_the_pseudoinverse(irb120_chain, home):
    path = _line(irb120_chain, home, [0.001, 0.002, 0.0], 2)
    found = IncrementalSolver(irb120_chain, iterations=1).solve(path, home).positions[1]

    step = np.linalg.pinv(irb120_chain.jacobian(home)[0]) @ [0.001, 0.002, 0, 0, 0, 0]

    np.testing.assert_allclose(found - home, step, atol=1e-12)


def test_whole_turns_without_jumps(irb120_chain, home):
    """The tool turns about itself by 360°: every angle of a pose vector jumps at ±π, the joints must not."""
    start = home + np.array([0.2, 0.1, -0.1, 0.3, -0.3, -3.0])
    turns = np.linspace(0, 2 * np.pi, 80)
    path = np.repeat(irb120_chain.forward(start), 80, axis=0)
    path[:, :3, :3] = (
        path[:, :3, :3] @ Rotation.from_rotvec(turns[:, np.newaxis] * [0, 0, 1]).as_matrix()
    )

    found = require(IncrementalSolver(irb120_chain).solve(path, start))

    np.testing.assert_allclose(found, start + turns[:, np.newaxis] * [0, 0, 0, 0, 0, 1], atol=1e-3)


def _with_turn(chain, start, angle):
    goal = chain.forward(start)
    goal[0, :3, 3] += [0.0, 0.02, 0.01]
    goal[0, :3, :3] = Rotation.from_rotvec([angle, 0, 0]).as_matrix() @ goal[0, :3, :3]
    return goal


@pytest.mark.parametrize(
    ("limit", "angle", "turns"),
    [(0.3, 0.29, True), (0.3, 0.31, False), (0.3, 3.0, False), (0.0, 0.1, False), (-1, 0.9, True)],
)
def test_rotation_limit(irb120_chain, home, limit, angle, turns):
    goal = _with_turn(irb120_chain, home, angle)
    solutions = IncrementalSolver(irb120_chain, rotation_limit=limit).solve(goal, home)

    found = irb120_chain.forward(solutions.positions)

    np.testing.assert_allclose(found[0, :3, 3], goal[0, :3, 3], atol=1e-5)

    wanted = goal if turns else irb120_chain.forward(home)
    np.testing.assert_allclose(found[0, :3, :3], wanted[0, :3, :3], atol=1e-4)
    assert solutions.reached[0] == (turns or limit == 0)


def test_rotation_limit_is_the_reason(irb120_chain, home):
    with pytest.raises(
        Unreachable,
        match=r"rotation limit: the tool would turn by 0\.5 rad \(28\.6 deg\) from one point",
    ):
        require(IncrementalSolver(irb120_chain).solve(_with_turn(irb120_chain, home, 0.5), home))


def test_passes_a_singular_wrist(irb120_chain):
    """A straight path whose middle has axes 4 and 6 in one line, a hair aside of it: joint speeds stay bounded."""
    before, after = (
        np.array([0.3, 0.4, -0.2, 0.02, 0.35, 0.1]),
        np.array([0.3, 0.5, -0.35, 0.0, -0.35, 0.14]),
    )
    ends = irb120_chain.forward([before, after])
    parts = np.linspace(0, 1, 200)
    path = np.repeat(ends[:1], 200, axis=0)
    path[:, :3, 3] += parts[:, np.newaxis] * (ends[1] - ends[0])[:3, 3]
    path[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix(ends[:, :3, :3]))(parts).as_matrix()
    solutions = IncrementalSolver(irb120_chain).solve(path, before)

    smallest = np.linalg.svd(irb120_chain.jacobian(solutions.positions), compute_uv=False)[
        :, -1
    ].min()

    assert smallest < 0.005
    assert np.abs(np.diff(solutions.positions, axis=0)).max() < 0.5

    away = np.linalg.norm(
        irb120_chain.forward(solutions.positions)[:, :3, 3] - path[:, :3, 3], axis=1
    )
    # the tool gives way by up to 7% of its 72 mm while damping holds axes 4 and 6 back
    assert away.max() < 5e-3
    assert solutions.reached[-1]


@pytest.mark.parametrize(
    ("smallest", "damping_squared"),
    [
        (0.05, 0.0),
        (0.02, 0.0),
        (0.015, 0.0016 * (1 - 0.75**2)),
        (0.01, 0.0016 * (1 - 0.5**2)),
        (0.005, 0.0016 * (1 - 0.25**2)),
    ],
)
def test_damping_grows_as_nakamura_and_hanafusa_say(smallest, damping_squared):
    """A step is J' (J J' + d I)^-1 e with d = 0.04² (1 - (s/0.02)²) for singular values s below 0.02."""
    rotations = Rotation.random(4, random_state=3).as_matrix()
    left = np.zeros((6, 6))
    left[:3, :3], left[3:, 3:] = rotations[:2]
    right = np.zeros((6, 6))
    right[:3, :3], right[3:, 3:] = rotations[2:]
    jacobian = left @ np.diag([1.0, 0.9, 0.8, 0.7, 0.6, smallest]) @ right
    error = np.array([0.01, -0.02, 0.005, 0.0005, -0.001, 0.0008])

    step = _damped_steps(jacobian[np.newaxis], error[np.newaxis])[0]

    square = jacobian @ jacobian.T + damping_squared * np.eye(6)
    expected = jacobian.T @ np.linalg.solve(square, error)
    assert np.abs(expected).max() < 0.5  # the longest step
    assert step == pytest.approx(expected, abs=1e-12)


def test_exactly_singular_start(irb120_chain):
    straight = np.zeros(6)
    path = _line(irb120_chain, straight, [0.0, 0.0, -0.1], 50)
    assert IncrementalSolver(irb120_chain).solve(path, straight).reached.all()


def test_stops_at_limits(irb120_chain, home):
    start = home + np.array([0, 0, 0, 0, 0, 6.9])
    path = np.repeat(irb120_chain.forward(start), 20, axis=0)
    turns = Rotation.from_rotvec(np.linspace(0, 0.5, 20)[:, np.newaxis] * [0, 0, 1]).as_matrix()
    path[:, :3, :3] = path[:, :3, :3] @ turns

    solutions = IncrementalSolver(irb120_chain).solve(path, start)

    assert (solutions.positions <= irb120_chain.upper).all()
    assert not solutions.reached[-1]
    with pytest.raises(Unreachable, match="joint limit: joint_6"):
        require(solutions)


def test_seven_axes(dh_chain, tables, belt):
    chain = dh_chain(tables["irb120"], slide=belt)
    start = np.array([0.1, 0, 0.2, -0.1, 0.1, 1.2, 0])

    path = _line(chain, start, [0.2, -0.3, 0.1], 60)

    assert IncrementalSolver(chain).solve(path, start).reached.all()


@pytest.mark.parametrize(
    "options",
    [
        {"iterations": 0},
        {"rotation_limit": np.nan},
        {"position_tolerance": -1.0},
        {"rotation_tolerance": 0.0},
    ],
)
def test_bad_settings(irb120_chain, options):
    with pytest.raises(InvalidParameter, match=next(iter(options))):
        IncrementalSolver(irb120_chain, **options)
